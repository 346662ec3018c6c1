"""Campaign: draws sessions at random from a seed and the ranges of a campaign file, and creates their faults."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.core.provenance import Parameter
from twin.core.units import MM, MS
from twin.simulation.campaigns.adaptive_limit import AdaptiveLimit
from twin.simulation.campaigns.campaign_table import FREE, CampaignTable, read_table
from twin.simulation.campaigns.hazard_trainee import Reaction
from twin.simulation.hazards.fault import Fault, Operation

_START_SPREAD = 100
"""Number of packets among which the first packet of a fault is drawn: the earliest is `CampaignTable.lead`."""

_MEAN_PER_SHORTEST = 10
"""Mean of a reaction time divided by the shortest one: a normal distribution has negative numbers too."""


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
        weights = np.array([fault_class.weight for fault_class in table.class_])
        fault_class = table.class_[rng.choice(len(weights), p=weights / weights.sum())]
        target = fault_class.targets[rng.integers(len(fault_class.targets))]
        operation = fault_class.operations[rng.integers(len(fault_class.operations))]
        value = float(rng.uniform(*fault_class.value))
        if fault_class.whole:
            value = float(round(value))
        length = int(fault_class.length[rng.integers(len(fault_class.length))])
        start = table.lead + int(rng.integers(_START_SPREAD))
        return DrawnSession(
            index=index,
            kind=fault_class.name,
            signal=fault_class.signal,
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
    def adaptive_limit(self) -> AdaptiveLimit:
        """The adaptive limit, with the parameters of the campaign file."""
        detection = self.table.detection
        return AdaptiveLimit(detection.floor_mm.value * MM, detection.lead_ms.value * MS)

    def parameters(self) -> list[Parameter]:
        """Return the parameters of trainee and detection with their provenance."""
        trainee = self.table.trainee
        detection = self.table.detection
        parameters = []
        for name, quantity, unit, si_unit in (
            ("trainee.haptic", trainee.haptic, "s", 1.0),
            ("trainee.visual", trainee.visual, "s", 1.0),
            ("trainee.troubleshoot", trainee.troubleshoot, "s", 1.0),
            ("detection.floor_mm", detection.floor_mm, "mm", MM),
            ("detection.lead_ms", detection.lead_ms, "ms", MS),
        ):
            value = quantity.value
            parameters.append(Parameter(name, value * si_unit, unit, value, quantity.provenance, quantity.note))
        return parameters

    def reaction(self, index: int) -> Reaction:
        """Return the trainee's reaction times in a session; they depend only on the campaign's seed and the index."""
        trainee = self.table.trainee
        rng = np.random.default_rng([self.table.seed, index, 1])
        times = []
        for quantity in (trainee.haptic, trainee.visual, trainee.troubleshoot):
            time = float(rng.normal(quantity.value, quantity.spread))
            times.append(max(time, quantity.value / _MEAN_PER_SHORTEST))
        return Reaction(*times)

    def faults(self, session: DrawnSession) -> list[Fault]:
        """Return new faults of a session, for one machine; their start and end are packet numbers."""
        if session.kind == FREE:
            return []
        places = self._places[session.signal]
        target = []
        for name in session.target.split():
            target.append(places.index(name))
        stop = session.start + session.length
        fault = Fault(
            signal=session.signal,
            start=session.start,
            stop=stop,
            operation=session.operation,
            value=session.value,
            target=target or None,  # no names: all numbers, for which `Fault` has None
            counts=True,
        )
        return [fault]


def load(path: Path, places: dict[str, tuple[str, ...]]) -> Campaign:
    """Read a campaign file.

    Args:
        path: the file.
        places: for each signal of the machine, the names of its numbers.

    Raises:
        DescriptionError: see `read_table`.
    """
    return Campaign(read_table(path, places), places)
