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
from twin.core.units import MM
from twin.schema import NotNegative, Origin, Positive, Table, error_at, load_toml
from twin.simulation.hazards import trainee
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
    """Content of a campaign file, such as cad/raven_left/campaigns/table1.toml."""

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
class Drawn:
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
        self.table, self._places = table, places

    def __len__(self) -> int:
        return self.table.faults + self.table.free

    def draw(self, index: int) -> Drawn:
        """Return the session of an index; the session depends only on the campaign's seed and this index."""
        t = self.table
        rng = np.random.default_rng([t.seed, index])
        mass, friction = float(rng.uniform(*t.mass)), float(rng.uniform(*t.friction))
        scale = t.scales[rng.integers(len(t.scales))]
        if index >= t.faults:
            return Drawn(index, FREE, "", "", "hold", 0.0, t.lead, 1, mass, friction, scale)
        weights = np.array([c.weight for c in t.class_])
        c = t.class_[rng.choice(len(weights), p=weights / weights.sum())]
        target = c.targets[rng.integers(len(c.targets))]
        operation = c.operations[rng.integers(len(c.operations))]
        value = float(rng.uniform(*c.value))
        value = float(round(value)) if c.whole else value
        length = int(c.length[rng.integers(len(c.length))])
        start = t.lead + int(rng.integers(100))
        return Drawn(index, c.name, c.signal, " ".join(target), operation, value, start, length, mass, friction, scale)

    @property
    def adaptive(self) -> Adaptive:
        """The adaptive limit, with the parameters of the campaign file."""
        d = self.table.detection
        return Adaptive(d.floor_mm.value * MM, d.lead_ms.value * MM)

    def parameters(self) -> list[Parameter]:
        """Return the parameters of trainee and detection with their provenance."""
        t, d = self.table.trainee, self.table.detection
        known = {f"trainee.{n}": (getattr(t, n), "s", 1.0) for n in ("haptic", "visual", "troubleshoot")}
        known |= {"detection.floor_mm": (d.floor_mm, "mm", MM), "detection.lead_ms": (d.lead_ms, "ms", MM)}
        return [Parameter(n, q.value * si, u, q.value, q.provenance, q.note) for n, (q, u, si) in known.items()]

    def reaction(self, index: int) -> Reaction:
        """Return the trainee's reaction times in a session; they depend only on the campaign's seed and the index."""
        t = self.table.trainee
        rng = np.random.default_rng([self.table.seed, index, 1])
        times = (t.haptic, t.visual, t.troubleshoot)
        return trainee.drawn(rng, [q.value for q in times], [q.spread for q in times])

    def faults(self, drawn: Drawn) -> list[Fault]:
        """Return new faults of a session, for one machine; their start and end are packet numbers."""
        if drawn.kind == FREE:
            return []
        target = [self._places[drawn.signal].index(n) for n in drawn.target.split()] or None
        stop = drawn.start + drawn.length
        return [Fault(drawn.signal, drawn.start, stop, drawn.operation, drawn.value, target, counts=True)]


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
        found = sorted(p.stem for p in path.parent.glob("*.toml"))
        raise DescriptionError(
            f"{path}: the file does not exist; campaigns in this folder: {', '.join(found) or 'none'}"
        )
    table = load_toml(path, CampaignTable)
    ranges = {("mass",): table.mass, ("friction",): table.friction}
    ranges |= {("class", i, "value"): c.value for i, c in enumerate(table.class_)}
    for keys, (low, high) in ranges.items():
        if low > high:
            raise error_at(path, keys, f"the range {(low, high)} goes down: give the smaller number first")
        if math.isinf(high - low):
            raise error_at(path, keys, f"the range {(low, high)} is too wide")
    scenarios = [s.name for s in table.scenario]
    for i, c in enumerate(table.class_):
        for k, target in enumerate(c.targets):
            for name in target:
                if name not in places[c.signal]:
                    wrong = unknown(f"target of {c.signal}", name, places[c.signal])
                    raise error_at(path, ("class", i, "targets", k), wrong)
        if c.name in [other.name for other in table.class_[:i]] or c.name == FREE:
            raise error_at(path, ("class", i, "name"), f"class '{c.name}' is defined twice, or its name is '{FREE}'")
        if c.scenario and c.scenario not in scenarios:
            raise error_at(path, ("class", i, "scenario"), unknown("scenario", c.scenario, scenarios))
        if c.signal not in LOSABLE and {"skip", "duplicate"} & set(c.operations):
            raise error_at(
                path,
                ("class", i, "operations"),
                f"skip and duplicate are possible for packets only, not for {c.signal}",
            )
        if "delay" in c.operations and not (c.whole and c.value[0] >= 1):
            raise error_at(path, ("class", i, "value"), "a delay needs whole = true and values of at least 1 packet")
    return Campaign(table, places)
