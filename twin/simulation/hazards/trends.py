"""Published experiments of a trainer with machine and model, with ASSUMED differences between the two.

They are those of "Surgeon Training in Telerobotic Surgery via a Hardware-in-the-Loop Simulator", sections 3.1 and
3.2.1. The machine has cables that stretch and have play, other masses and other friction than its model.

First experiment,
without a fault: the deviation between machine and model at each motion scale, with two servos of the model: that of the
released software, which the machine has as well, and that of the paper (PD; PID for the insertion). Second experiment:
the command of the first motor is stuck four times, for 300 cycles each, at intervals of 8 s. The paper does not publish
gains, motion and stuck value of its robot; therefore trends can be compared, but not numbers. The experiments are
defined in cad/raven_left/campaigns/trends.toml.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from twin.core.errors import DescriptionError, unknown
from twin.core.findings import Finding
from twin.core.json_types import JsonObject
from twin.core.progress import Progress
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.schema import Identifier, NotNegative, Positive, Sourced, Table, error_at, load_toml
from twin.simulation.hazards.attacked_session import HARM
from twin.simulation.hazards.campaign import SpreadQuantity
from twin.simulation.hazards.fault import Fault
from twin.simulation.hazards.packet_hand import Hand, wander
from twin.simulation.hazards.traced_run import Trace, held_at_stop, trace
from twin.simulation.machine.arithmetic import Arithmetic
from twin.simulation.machine.cable_plant import CablePlant, Cables
from twin.simulation.machine.levels import Level
from twin.simulation.machine.motor_plant import TICK, Physics
from twin.simulation.machine.simulated_machine import Parts
from twin.simulation.machine.stability import require_stable

PUBLISHED = (2.43, 1.72)
"""Mean and spread in mm of the error without faults over all motion scales; the paper's 3 mm limit implies both."""

_NUMBERS = {2: "two", 3: "three", 4: "four", 5: "five"}

_MM = 1e3

_Share = Annotated[float, Field(ge=-1, le=1)]
_Count = Annotated[int, Field(gt=0)]
_Scale = Annotated[float, Field(gt=0, le=1)]


class HandTable(Table):
    """Runs with one motion of the hand: seed of the motion, and stuck values as fractions of the motor's limit."""

    seed: Annotated[int, Field(ge=0)]
    shares: list[_Share] = Field(min_length=1)


class StuckTable(Table):
    """The stuck command: `times` faults of `cycles` packets each, at intervals of `every` packets."""

    scale: _Scale
    every: _Count
    cycles: _Count
    times: _Count
    watched: _Count
    hand: list[HandTable] = Field(min_length=1)


class CableTable(Sourced):
    """Cable of a joint, in the units of the joint; see `cable_plant.Cables`."""

    joint: Identifier
    stiffness: Positive
    play: NotNegative
    damping: NotNegative
    coulomb: NotNegative


class PaperServo(Sourced):
    """Servo of the paper's model: `ki` is the gain of the integral of `motor`; all other motors have none."""

    motor: Identifier
    ki: NotNegative


class TrendsTable(Table):
    """File of the experiments, such as cad/raven_left/campaigns/trends.toml.

    Without `cable`, the motors of the machine move its joints without cables. Without `paper_servo`, the model has the
    servo of the released software only.
    """

    title: str
    source: str
    scales: list[_Scale] = Field(min_length=1)
    free: _Count
    free_hand: Annotated[int, Field(ge=0)]
    mass: SpreadQuantity
    friction: SpreadQuantity
    cable: list[CableTable] = Field(default_factory=list)
    paper_servo: PaperServo | None = None
    stuck: StuckTable


def load(path: Path) -> TrendsTable:
    """Read the file of the experiments.

    Raises:
        DescriptionError: the file does not exist or is invalid, or a fault is not shorter than its period; the message
            has file, line, key and value.
    """
    if not path.is_file():
        raise DescriptionError(f"{path}: the file does not exist; cad/raven_left/campaigns/trends.toml is an example")
    table = load_toml(path, TrendsTable)
    if table.stuck.cycles >= table.stuck.every:
        text = f"cycles = {table.stuck.cycles} must be below the period, every = {table.stuck.every} packets"
        raise error_at(path, ("stuck", "cycles"), text)
    return table


@dataclass(frozen=True)
class ScaleRow:
    """Mean, spread and peak in mm of the distance between the true tips without a fault, at one motion scale.

    `servo` is that of the model, "released" or "paper".
    """

    servo: str
    scale: float
    mean: float
    spread: float
    peak: float


@dataclass(frozen=True)
class StuckRow:
    """Consequences of a stuck command in one run.

    Attributes:
        hand: seed of the motion of the hand.
        counts: the stuck command in counts of the DAC.
        peaks: largest deviation in mm during and shortly after each fault, until the arm was stopped.
        jumps: number of faults that moved the tip by more than `HARM` from where the same machine without a fault is.
        stopped: number of the fault, from 1, in or after which a check stopped the arm; None: no stop.
        check: reason of the stop; "" without a stop.
    """

    hand: int
    counts: float
    peaks: list[float]
    jumps: int
    stopped: int | None
    check: str


@dataclass(frozen=True)
class Trends(Result):
    """Results of both experiments.

    Attributes:
        robot, motor: names of the robot and of its first motor.
        scales, stuck: rows of the tables.
        curves: for each run with a stuck command, the deviation (k,) in mm in each tick; the keys are (seed of the
            hand, stuck command in counts of the DAC).
        table: the file of the experiments.
    """

    kind = "trends"
    judges = False
    robot: str
    motor: str
    scales: Sequence[ScaleRow]
    stuck: Sequence[StuckRow]
    curves: dict[tuple[int, float], Array]
    table: TrendsTable

    @property
    def findings(self) -> tuple[Finding, ...]:
        """No findings, because the paper's numbers belong to another plant."""
        return ()

    @property
    def grows(self) -> bool:
        """Whether the mean deviation grows with the motion scale, with each servo."""
        for rows in self.by_servo.values():
            means = [row.mean for row in rows]
            if not (np.diff(means) > 0).all():
                return False
        return True

    @property
    def within(self) -> bool:
        """Whether the mean deviation at every scale, with each servo, is within the published mean and spread."""
        mean, spread = PUBLISHED
        return all(abs(row.mean - mean) <= spread for row in self.scales)

    @property
    def by_servo(self) -> dict[str, list[ScaleRow]]:
        """Rows of the motion scales for each servo of the model."""
        rows: dict[str, list[ScaleRow]] = {}
        for row in self.scales:
            rows.setdefault(row.servo, []).append(row)  # in the order of the scales, on which `grows` relies
        return rows

    @property
    def as_published(self) -> list[StuckRow]:
        """Runs with a jump in each fault and a stop at the last fault, as in the paper."""
        times = self.table.stuck.times
        rows = []
        for row in self.stuck:
            if row.jumps == times and row.stopped == times:
                rows.append(row)
        return rows

    def content(self) -> JsonObject:
        """Return plain data."""
        return {
            "robot": self.robot,
            "published_mm": list(PUBLISHED),
            "scales": list(map(asdict, self.scales)),
            "stuck": list(map(asdict, self.stuck)),
            "grows_with_scale": self.grows,
            "within_published": self.within,
            "as_published": list(map(asdict, self.as_published)),
        }

    def text(self) -> Iterator[Part]:
        """Yield the parts of the printed result."""
        yield f"{self.robot} · the paper's experiments with an ASSUMED plant: trends, not numbers"
        yield "\nDeviation without a fault by motion scale"
        scale_rows = []
        for row in self.scales:
            sizes = f"{row.mean:.3f}", f"{row.spread:.3f}", f"{row.peak:.3f}"
            scale_rows.append((row.servo, f"{row.scale:g}", *sizes))
        yield TextTable(("servo of the model", "motion scale", "mean mm", "spread mm", "largest mm"), scale_rows)
        word = "grows" if self.grows else "does not grow"
        place = "within" if self.within else "not within"
        paper = f"in the paper it grows, {PUBLISHED[0]} ± {PUBLISHED[1]} mm over these scales"
        yield f"  the deviation {word} with the scale; {paper}; the means above are {place} these limits"
        stuck = self.table.stuck
        period = stuck.every * TICK
        yield f"\n{self.motor} stuck for {stuck.cycles} cycles every {period:g} s, motion scale {stuck.scale:g}"
        stuck_rows = []
        for row in self.stuck:
            peaks = ", ".join(f"{peak:.2f}" for peak in row.peaks)
            stopped = "-" if row.stopped is None else str(row.stopped)
            stuck_rows.append((str(row.hand), f"{row.counts:.0f}", peaks, str(row.jumps), stopped, row.check))
        head = ("hand", "stuck at counts", "peaks mm", f"jumps > {HARM:g} mm", "stopped at fault", "check")
        yield TextTable(head, stuck_rows)
        published = []
        for row in self.as_published:
            published.append(f"hand {row.hand} stuck at {row.counts:.0f} counts")
        published_text = ", ".join(published) or "none"
        count = _NUMBERS.get(stuck.times, str(stuck.times))
        yield f"  {count} jumps and a stop at the last, as in the paper: {published_text}"
        for name, quantity in (("masses", self.table.mass), ("friction", self.table.friction)):
            yield f"  {quantity.provenance} {name} times {quantity.value:g}: {quantity.note}"
        for cable in self.table.cable:
            values = f"stiffness {cable.stiffness:g}, play ± {cable.play:g}"
            yield f"  {cable.provenance} cable of {cable.joint}, {values}: {cable.note}"
        servo = self.table.paper_servo
        if servo is not None:
            yield f"  {servo.provenance} ki = {servo.ki:g} of {servo.motor} in the servo of the paper: {servo.note}"
        yield "  ASSUMED motions of the hand and stuck values: not published"


def trends(robot: str, parts: Parts, table: TrendsTable, progress: Progress) -> Trends:
    """Run both experiments, which takes about 60 s of processor time.

    Raises:
        DescriptionError: a cable or the servo names an unknown joint or motor, or some joints have no cable.
        MechanismError: the gains of the paper's servo make a joint oscillate.
    """
    stuck = table.stuck
    physics = parts.plant.physics.changed(table.mass.value, table.friction.value)
    machine_parts = with_cables(parts, physics, table.cable)
    models = {"released": parts}
    if table.paper_servo is not None:
        models["paper"] = with_servo(parts, table.paper_servo)
    runs = len(table.scales) * len(models)
    for hand in stuck.hand:
        runs += len(hand.shares)

    def hand_of(scale: float, seed: int) -> Hand:
        return Hand(parts.settings, scale, wander(seed))

    scale_rows: list[ScaleRow] = []
    for servo, model_parts in models.items():
        for scale in table.scales:
            # the last part is for writing the results
            progress(f"motion scale {scale:g}", (len(scale_rows) + 1) / (runs + 1))
            machine = trace(machine_parts, hand_of(scale, table.free_hand), table.free, table.free, physics)
            model = trace(model_parts, hand_of(scale, table.free_hand), table.free, table.free)
            deviation = _deviation(parts, machine, model)
            sizes = float(deviation.mean()), float(deviation.std()), float(deviation.max())
            scale_rows.append(ScaleRow(servo, scale, *sizes))

    packets = stuck.every * stuck.times + stuck.cycles + stuck.watched
    motor = parts.settings.of_motors(parts.arm.mechanism)[0]
    largest_counts = getattr(motor.dac, parts.settings.mode)
    # packet numbers: a fault begins at the end of each period
    begins = list(range(stuck.every, stuck.every * stuck.times + 1, stuck.every))
    stuck_rows: list[StuckRow] = []
    curves = {}
    for hand in stuck.hand:
        model = trace(parts, hand_of(stuck.scale, hand.seed), packets, packets)
        sound = trace(machine_parts, hand_of(stuck.scale, hand.seed), packets, packets, physics)
        for share in hand.shares:
            counts = share * largest_counts
            run = len(scale_rows) + len(stuck_rows) + 1
            progress(f"stuck at {counts:.0f} counts", run / (runs + 1))
            faults = []
            for begin in begins:
                faults.append(Fault("dac", begin, begin + stuck.cycles, "overwrite", counts, 0, counts=True))
            machine = trace(machine_parts, hand_of(stuck.scale, hand.seed), packets, 1, physics, faults)
            deviation = _deviation(parts, machine, model)
            curves[hand.seed, counts] = deviation
            tip_shift = _deviation(parts, machine, sound)
            row = _stuck_row(hand.seed, counts, (deviation, tip_shift), machine, begins, stuck.cycles + stuck.watched)
            stuck_rows.append(row)
    return Trends(robot, motor.name, scale_rows, stuck_rows, curves, table)


def with_cables(parts: Parts, physics: Physics, cables: Sequence[CableTable]) -> Parts:
    """Return the parts of a machine whose joints have these cables; without cables, the same parts.

    Raises:
        DescriptionError: a cable names an unknown joint, or not every joint has one cable.
        MechanismError: a number of a cable is impossible.
    """
    if not cables:
        return parts
    joints = [joint.name for joint in parts.arm.mechanism.active]
    by_joint = {cable.joint: cable for cable in cables}
    for cable in cables:
        if cable.joint not in joints:
            raise DescriptionError(unknown("joint", cable.joint, joints))
    missing = [name for name in joints if name not in by_joint]
    if missing or len(by_joint) != len(cables):
        text = f"no [[cable]] for {', '.join(missing)}" if missing else "a joint has two [[cable]]"
        raise DescriptionError(f"trends: {text}; give each joint one, or none")
    rows = []
    for name in joints:
        cable = by_joint[name]
        rows.append((cable.stiffness, cable.play, cable.damping, cable.coulomb))
    plant = CablePlant(parts.arm, physics, Cables(*np.array(rows).T))
    return replace(parts, plant=plant)


def with_servo(parts: Parts, servo: PaperServo) -> Parts:
    """Return parts whose motors have no integral gain, except that of the servo's motor.

    Raises:
        DescriptionError: the servo names an unknown motor.
        MechanismError: the gains make a joint oscillate.
    """
    mechanism = parts.arm.mechanism
    if servo.motor not in mechanism.motor_names:
        raise DescriptionError(unknown("motor", servo.motor, mechanism.motor_names))
    motors = []
    for motor in parts.settings.motor:
        ki = servo.ki if motor.name == servo.motor else 0.0
        motors.append(motor.model_copy(update={"ki": ki}))
    changed = parts.settings.model_copy(update={"motor": motors})
    require_stable(parts.arm, changed, parts.home)
    return replace(parts, settings=changed, arithmetic=Arithmetic.of(changed, mechanism))


def _deviation(parts: Parts, machine: Trace, model: Trace) -> Array:
    """Return the distance (k,) in mm between the true tips; after a stop, the model's tip at the stop is used."""
    k = len(machine.q)
    model_tips = parts.kin.forward_many(model.q[:k])[:, :3, 3]
    tips = parts.kin.forward_many(machine.q)[:, :3, 3]
    return np.linalg.norm(tips - held_at_stop(model_tips, machine), axis=1) * _MM


def _stuck_row(
    hand: int, counts: float, deviations: tuple[Array, Array], machine: Trace, begins: list[int], watched: int
) -> StuckRow:
    """Return the consequences of faults that begin at the packets `begins`, each for `watched` packets.

    `deviations` are the distances (k,) in mm of the tip from that of the model, and from that of the same machine
    without a fault: a machine with cables is apart from its model without a fault, too.
    """
    peaks = []
    jumps = 0
    for begin in begins:
        window = slice(begin - 1, begin - 1 + watched)
        deviation, tip_shift = (distances[window] for distances in deviations)
        if len(deviation):  # the machine had not stopped before
            peaks.append(float(deviation.max()))
            jumps += bool(tip_shift.max() > HARM)
    stopped = None
    check = ""
    stops = np.flatnonzero(machine.levels == Level.E_STOP)
    if len(stops):
        stop_packet = stops[0] + 1
        stopped = int(np.searchsorted(begins, stop_packet, side="right"))
        check = machine.machine.reason
    return StuckRow(hand, counts, peaks, jumps, stopped, check)
