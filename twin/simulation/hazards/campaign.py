"""Read classes of faults with parameter ranges from a campaign file (TOML), and draw sessions at random from a seed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from twin.core.errors import DescriptionError, unknown
from twin.core.provenance import Parameter
from twin.core.units import MM, MS
from twin.schema import NotNegative, Origin, Positive, Table, error_at, load_toml
from twin.simulation.hazards.detection import Adaptive
from twin.simulation.hazards.fault import Fault, Operation
from twin.simulation.hazards.trainee import Reaction, Response
from twin.simulation.machine.simulated_machine import LOSABLE

_Range = tuple[float, float]
_Count = Annotated[int, Field(gt=0)]

Signal = Literal["wire", "packet", "usb", "encoder", "level", "tool", "joints", "dac"]
"""Signals of a machine, see `twin.simulation.machine.simulated_machine.LOCATIONS`."""

FREE = "none"
"""Class of the sessions without a fault."""


class SpreadQuantity(Table):
    """A number with its spread (standard deviation) and provenance."""

    value: Positive
    spread: NotNegative = 0.0
    provenance: Origin
    note: str = Field(min_length=1)


class TraineeTable(Table):
    """Reaction times in s of the simulated trainee, drawn for each session; see `trainee.Reaction`."""

    haptic: SpreadQuantity
    visual: SpreadQuantity
    troubleshoot: SpreadQuantity


class DetectionTable(Table):
    """Parameters of `detection.Adaptive`: limit at rest in mm, and increase of the limit in mm per m/s (= ms)."""

    floor_mm: SpreadQuantity
    lead_ms: SpreadQuantity


class Scenario(Table):
    """A scenario of the paper's Table 1.

    Attributes:
        name: name of the hazard; classes of faults refer to this name.
        action: unsafe control action.
        causes: possible causes.
        module: affected module of the robot's software, with its variables.
        impact: consequences in the reported incidents.
        incidents: numbers of the incident reports.
        responses: responses that the training teaches.
    """

    name: str = Field(min_length=1)
    action: str
    causes: str
    module: str
    impact: str
    incidents: list[str] = Field(min_length=1)
    responses: list[Response] = Field(min_length=1)


class Class(Table):
    """Faults of one kind; target, operation, length and value of each fault are drawn at random.

    Attributes:
        scenario: name of the scenario of the class; "": none.
        targets: possible targets. A target lists the names of those numbers of the signal that a fault changes
            together; []: all numbers.
        value: range of the value, which is the same for all numbers of a target; `whole`: whole numbers only.
        length: possible lengths in packets; one packet per ms.
        weight: relative frequency of this class.
    """

    name: str = Field(min_length=1)
    scenario: str = ""
    signal: Signal
    targets: list[list[str]] = Field(min_length=1)
    operations: list[Operation] = Field(min_length=1)
    value: _Range
    whole: bool = False
    length: list[_Count] = Field(min_length=1)
    weight: Annotated[float, Field(gt=0, le=1e6)] = 1.0


class CampaignTable(Table):
    """Content of a campaign file, such as cad/raven_left/campaigns/table1.toml.

    Attributes:
        title, source: title of the campaign, and the publication from which its faults are.
        seed: seed of all random draws.
        faults: number of sessions with one fault each.
        free: number of sessions without a fault.
        trained: number of the first sessions that run again with the simulated trainee, if he can notice something.
        mass, friction: range of the factor of all masses, and of all friction, of the machine's plant.
        lead: number of packets (one per ms) before the earliest fault; not the slope `DetectionTable.lead_ms`.
        scales: motion scales of the operator, of which each session draws one.
        trainee: reaction times of the simulated trainee.
        detection: parameters of the adaptive limit.
        scenario: scenarios to which classes of faults belong.
        class_: classes of faults, of which each session with a fault draws one by weight.
    """

    title: str
    source: str
    seed: Annotated[int, Field(ge=0)]
    faults: Annotated[int, Field(ge=0)]
    free: Annotated[int, Field(ge=0)]
    trained: Annotated[int, Field(ge=0)]
    mass: tuple[Positive, Positive]
    friction: tuple[NotNegative, NotNegative]
    lead: _Count
    scales: list[Annotated[float, Field(gt=0, le=1)]] = Field(min_length=1)
    trainee: TraineeTable
    detection: DetectionTable
    scenario: list[Scenario] = Field(min_length=1)
    class_: list[Class] = Field(min_length=1, alias="class")


@dataclass(frozen=True)
class DrawnSession:
    """One session of a campaign.

    Attributes:
        index: number of the session.
        kind: class of the fault; `FREE`: no fault.
        signal, target, operation, value, start, length: the fault; start and length in packets (one per ms).
        mass, friction: factors of masses and of friction of the machine's plant.
        scale: motion scale of the operator.
    """

    index: int
    kind: str
    signal: str
    target: str
    operation: Operation
    value: float
    start: int
    length: int
    mass: float
    friction: float
    scale: float


class Campaign:
    """Draws sessions and creates their faults from the classes of a campaign file."""

    def __init__(self, table: CampaignTable, places: dict[str, tuple[str, ...]]) -> None:
        """Store the campaign file; `places`: for each signal of the machine, the names of its numbers."""
        self.table = table
        self._places = places

    def __len__(self) -> int:
        return self.table.faults + self.table.free

    def draw(self, index: int) -> DrawnSession:
        """Return the session of an index; the session depends only on the campaign's seed and this index."""
        table = self.table
        # The order of the draws is part of the campaign: another order gives other sessions for the same seed.
        rng = np.random.default_rng([table.seed, index])
        mass = float(rng.uniform(*table.mass))
        friction = float(rng.uniform(*table.friction))
        scale = table.scales[rng.integers(len(table.scales))]
        if index >= table.faults:
            return DrawnSession(index, FREE, "", "", "hold", 0.0, table.lead, 1, mass, friction, scale)
        weights = np.array([kind.weight for kind in table.class_])
        kind = table.class_[rng.choice(len(weights), p=weights / weights.sum())]
        target = kind.targets[rng.integers(len(kind.targets))]
        operation = kind.operations[rng.integers(len(kind.operations))]
        value = float(rng.uniform(*kind.value))
        if kind.whole:
            value = float(round(value))
        length = int(kind.length[rng.integers(len(kind.length))])
        start = table.lead + int(rng.integers(100))
        return DrawnSession(
            index=index,
            kind=kind.name,
            signal=kind.signal,
            target=" ".join(target),
            operation=operation,
            value=value,
            start=start,
            length=length,
            mass=mass,
            friction=friction,
            scale=scale,
        )

    @property
    def adaptive(self) -> Adaptive:
        """The adaptive limit, with the parameters of the campaign file."""
        detection = self.table.detection
        return Adaptive(detection.floor_mm.value * MM, detection.lead_ms.value * MS)

    def parameters(self) -> list[Parameter]:
        """Return the parameters of trainee and detection with their provenance."""
        trainee = self.table.trainee
        detection = self.table.detection
        parameters = []
        for name, quantity, unit, si in (
            ("trainee.haptic", trainee.haptic, "s", 1.0),
            ("trainee.visual", trainee.visual, "s", 1.0),
            ("trainee.troubleshoot", trainee.troubleshoot, "s", 1.0),
            ("detection.floor_mm", detection.floor_mm, "mm", MM),
            ("detection.lead_ms", detection.lead_ms, "ms", MS),
        ):
            value = quantity.value
            parameters.append(Parameter(name, value * si, unit, value, quantity.provenance, quantity.note))
        return parameters

    def reaction(self, index: int) -> Reaction:
        """Return the trainee's reaction times in a session; they depend only on the campaign's seed and the index."""
        trainee = self.table.trainee
        rng = np.random.default_rng([self.table.seed, index, 1])
        times = []
        for quantity in (trainee.haptic, trainee.visual, trainee.troubleshoot):
            time = float(rng.normal(quantity.value, quantity.spread))
            # a normal distribution has negative numbers too
            times.append(max(time, quantity.value / 10))
        return Reaction(*times)

    def faults(self, session: DrawnSession) -> list[Fault]:
        """Return new faults of a session, for one machine; their start and end are packet numbers."""
        if session.kind == FREE:
            return []
        target = []
        for name in session.target.split():
            target.append(self._places[session.signal].index(name))
        stop = session.start + session.length
        # an empty target is that of all numbers, for which `Fault` has None
        places = target or None
        return [Fault(session.signal, session.start, stop, session.operation, session.value, places, counts=True)]


def load(path: Path, places: dict[str, tuple[str, ...]]) -> Campaign:
    """Read a campaign file.

    Args:
        path: the file.
        places: for each signal of the machine, the names of its numbers.

    Raises:
        DescriptionError: the file does not exist or is invalid, a target is unknown, or a class is defined twice; the
            message has file, line, key and value.
    """
    if not path.is_file():
        campaigns = sorted(file.stem for file in path.parent.glob("*.toml"))
        names = ", ".join(campaigns) or "none"
        raise DescriptionError(f"{path}: the file does not exist; campaigns in this folder: {names}")
    table = load_toml(path, CampaignTable)
    _check_range(path, ("mass",), table.mass)
    _check_range(path, ("friction",), table.friction)
    for i, kind in enumerate(table.class_):
        _check_range(path, ("class", i, "value"), kind.value)
    scenarios = [scenario.name for scenario in table.scenario]
    names = {FREE}
    for i, kind in enumerate(table.class_):
        _check_targets(path, i, kind, places)
        if kind.name in names:
            text = f"class '{kind.name}' is defined twice, or its name is '{FREE}'"
            raise error_at(path, ("class", i, "name"), text)
        names.add(kind.name)
        if kind.scenario and kind.scenario not in scenarios:
            raise error_at(path, ("class", i, "scenario"), unknown("scenario", kind.scenario, scenarios))
        if kind.signal not in LOSABLE and ("skip" in kind.operations or "duplicate" in kind.operations):
            text = f"skip and duplicate are possible for packets only, not for {kind.signal}"
            raise error_at(path, ("class", i, "operations"), text)
        if "delay" in kind.operations and not (kind.whole and kind.value[0] >= 1):
            raise error_at(path, ("class", i, "value"), "a delay needs whole = true and values of at least 1 packet")
    return Campaign(table, places)


def _check_range(path: Path, keys: tuple[str | int, ...], limits: _Range) -> None:
    """Raise `DescriptionError` if a range is empty, or too wide for the generator of random numbers."""
    low, high = limits
    if low > high:
        raise error_at(path, keys, f"the range {(low, high)} goes down: give the smaller number first")
    if math.isinf(high - low):
        raise error_at(path, keys, f"the range {(low, high)} is too wide")


def _check_targets(path: Path, i: int, kind: Class, places: dict[str, tuple[str, ...]]) -> None:
    """Raise `DescriptionError` if a target of class number i is none of the `places` of its signal."""
    for k, target in enumerate(kind.targets):
        for name in target:
            if name not in places[kind.signal]:
                text = unknown(f"target of {kind.signal}", name, places[kind.signal])
                raise error_at(path, ("class", i, "targets", k), text)
