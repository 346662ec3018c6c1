"""Tables of a campaign file (TOML): classes of faults with parameter ranges, scenarios, trainee and detection."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from twin.core.errors import DescriptionError, unknown
from twin.schema import NotNegative, Origin, Positive, Table, error_at, load_toml
from twin.simulation.campaigns.hazard_trainee import Response
from twin.simulation.hazards.fault import Operation
from twin.simulation.machine.machine_faults import LOSABLE

_Range = tuple[float, float]
_Count = Annotated[int, Field(gt=0)]

Signal = Literal["wire", "packet", "usb", "encoder", "level", "tool", "joints", "dac"]
"""Signals of a machine, see `twin.simulation.machine.machine_faults.LOCATIONS`."""

FREE = "none"
"""FaultClass of the sessions without a fault."""


class SpreadQuantity(Table):
    """A number with its spread (standard deviation) and provenance."""

    value: Positive
    spread: NotNegative = 0.0
    provenance: Origin
    note: str = Field(min_length=1)


class TraineeTable(Table):
    """Reaction times in s of the simulated trainee, drawn for each session; see `hazard_trainee.Reaction`."""

    haptic: SpreadQuantity
    visual: SpreadQuantity
    troubleshoot: SpreadQuantity


class DetectionTable(Table):
    """Parameters of `AdaptiveLimit`: limit at rest in mm, and increase of the limit in mm per m/s (= ms)."""

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


class FaultClass(Table):
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
    class_: list[FaultClass] = Field(min_length=1, alias="class")


def read_table(path: Path, places: dict[str, tuple[str, ...]]) -> CampaignTable:
    """Read a campaign file, and check what its types cannot: ranges, targets, names and operations.

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
    for class_number, fault_class in enumerate(table.class_):
        _check_range(path, ("class", class_number, "value"), fault_class.value)
    scenario_names = [scenario.name for scenario in table.scenario]
    class_names = {FREE}
    for class_number, fault_class in enumerate(table.class_):
        _check_targets(path, class_number, fault_class, places)
        if fault_class.name in class_names:
            text = f"class '{fault_class.name}' is defined twice, or its name is '{FREE}'"
            raise error_at(path, ("class", class_number, "name"), text)
        class_names.add(fault_class.name)
        if fault_class.scenario and fault_class.scenario not in scenario_names:
            text = unknown("scenario", fault_class.scenario, scenario_names)
            raise error_at(path, ("class", class_number, "scenario"), text)
        _check_operations(path, class_number, fault_class)
    return table


def _check_range(path: Path, keys: tuple[str | int, ...], limits: _Range) -> None:
    """Raise `DescriptionError` if a range is empty, or too wide for the generator of random numbers."""
    low, high = limits
    if low > high:
        raise error_at(path, keys, f"the range {(low, high)} goes down: give the smaller number first")
    if math.isinf(high - low):
        raise error_at(path, keys, f"the range {(low, high)} is too wide")


def _check_targets(path: Path, class_number: int, fault_class: FaultClass, places: dict[str, tuple[str, ...]]) -> None:
    """Raise `DescriptionError` if a target of a class, which has the number in the file, is no place of its signal."""
    places_of_signal = places[fault_class.signal]
    for target_number, target in enumerate(fault_class.targets):
        for name in target:
            if name not in places_of_signal:
                text = unknown(f"target of {fault_class.signal}", name, places_of_signal)
                raise error_at(path, ("class", class_number, "targets", target_number), text)


def _check_operations(path: Path, class_number: int, fault_class: FaultClass) -> None:
    """Raise `DescriptionError` if an operation is impossible for the signal of a class, or for its values."""
    operations = fault_class.operations
    if fault_class.signal not in LOSABLE and ("skip" in operations or "duplicate" in operations):
        text = f"skip and duplicate are possible for packets only, not for {fault_class.signal}"
        raise error_at(path, ("class", class_number, "operations"), text)
    if "delay" in operations and not (fault_class.whole and fault_class.value[0] >= 1):
        text = "a delay needs whole = true and values of at least 1 packet"
        raise error_at(path, ("class", class_number, "value"), text)
