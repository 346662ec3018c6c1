"""Published experiments of a trainer with machine and model, with ASSUMED differences between the two.

They are those of "Surgeon Training in Telerobotic Surgery via a Hardware-in-the-Loop Simulator", sections 3.1 and
3.2.1. The machine has cables that stretch and have play, other masses and other friction than its model.

1. Without a fault: the deviation between machine and model at each motion scale, with two servos of the model: that of
   the released software, which the machine has as well, and that of the paper (PD; PID for the insertion).
2. The command of the first motor is stuck four times, for 300 cycles each, at intervals of 8 s.

The paper does not publish gains, motion and stuck value of its robot; therefore trends can be compared, but not
numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.core.errors import DescriptionError, unknown
from twin.core.progress import Progress
from twin.core.spatial import Array
from twin.simulation.campaigns.attacked_session import HARM, MM_PER_M
from twin.simulation.campaigns.packet_hand import Hand, wander
from twin.simulation.campaigns.traced_run import Trace, held_at_stop, trace
from twin.simulation.campaigns.trends_result import ScaleRow, StuckRow, Trends
from twin.simulation.campaigns.trends_table import CableTable, HandTable, PaperServo, StuckTable, TrendsTable
from twin.simulation.hazards.fault import Fault
from twin.simulation.machine.arithmetic import Arithmetic
from twin.simulation.machine.cable_plant import CablePlant, Cables
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_parts import Parts
from twin.simulation.machine.physics import Physics
from twin.simulation.machine.stability import require_stable


def trends(robot: str, parts: Parts, table: TrendsTable, progress: Progress) -> Trends:
    """Run both experiments, which takes about 60 s of processor time.

    Raises:
        DescriptionError: a cable or the servo names an unknown joint or motor, or some joints have no cable.
        MechanismError: the gains of the paper's servo make a joint oscillate.
    """
    physics = parts.plant.physics.changed(table.mass.value, table.friction.value)
    machine_parts = with_cables(parts, physics, table.cable)
    model_parts = {"released": parts}
    if table.paper_servo is not None:
        model_parts["paper"] = with_servo(parts, table.paper_servo)
    run_count = len(table.scales) * len(model_parts)
    for hand in table.stuck.hand:
        run_count += len(hand.shares)
    runs_begun = 0

    def begin_run(text: str) -> None:
        nonlocal runs_begun
        runs_begun += 1
        progress(text, runs_begun / (run_count + 1))  # the last part is for writing the results

    scale_rows = []
    for servo, parts_of_model in model_parts.items():
        for scale in table.scales:
            begin_run(f"motion scale {scale:g}")
            packets = table.free
            machine = trace(machine_parts, _hand(parts, scale, table.free_hand), packets, packets, physics)
            model = trace(parts_of_model, _hand(parts, scale, table.free_hand), packets, packets)
            deviation = _deviation(parts, machine, model)
            sizes = float(deviation.mean()), float(deviation.std()), float(deviation.max())
            scale_rows.append(ScaleRow(servo, scale, *sizes))

    motor = parts.settings.of_motors(parts.arm.mechanism)[0]
    largest_counts = getattr(motor.dac, parts.settings.mode)
    experiment = _StuckExperiment(parts, machine_parts, physics, table.stuck)
    stuck_rows = []
    curves = {}
    for hand in table.stuck.hand:
        model, faultless = experiment.without_fault(hand)
        for share in hand.shares:
            counts = share * largest_counts
            begin_run(f"stuck at {counts:.0f} counts")
            machine = experiment.with_fault(hand, counts)
            deviation = _deviation(parts, machine, model)
            curves[hand.seed, counts] = deviation
            # a machine with cables is apart from its model without a fault, too: jumps are counted from itself
            shift = _deviation(parts, machine, faultless)
            stuck_rows.append(experiment.row(hand, counts, deviation, shift, machine))
    return Trends(robot, motor.name, scale_rows, stuck_rows, curves, table)


def _hand(parts: Parts, scale: float, seed: int) -> Hand:
    """Return a new hand with the random motion of a seed; each run needs its own, because a hand counts its packets."""
    return Hand(parts.settings, scale, wander(seed))


@dataclass(frozen=True)
class _StuckExperiment:
    """The second experiment: the command of the first motor is stuck in each of several faults.

    Attributes:
        parts, machine_parts: compiled parts of the model, and of the machine with its cables.
        physics: parameters of the machine's plant.
        table: numbers and lengths of the faults.
    """

    parts: Parts
    machine_parts: Parts
    physics: Physics
    table: StuckTable

    @property
    def packets(self) -> int:
        """Number of packets of a run."""
        table = self.table
        return table.every * table.times + table.cycles + table.watched

    @property
    def first_packets(self) -> list[int]:
        """Numbers of the packets with which the faults begin: at the end of each period."""
        table = self.table
        return list(range(table.every, table.every * table.times + 1, table.every))

    def without_fault(self, hand: HandTable) -> tuple[Trace, Trace]:
        """Return the traces of the model and of the machine for a hand, both without a fault."""
        packets = self.packets
        scale = self.table.scale
        model = trace(self.parts, _hand(self.parts, scale, hand.seed), packets, packets)
        machine = trace(self.machine_parts, _hand(self.parts, scale, hand.seed), packets, packets, self.physics)
        return model, machine

    def with_fault(self, hand: HandTable, counts: float) -> Trace:
        """Return the trace of the machine, whose first motor is stuck at a number of counts of the DAC."""
        faults = []
        for first_packet in self.first_packets:
            end = first_packet + self.table.cycles
            faults.append(Fault("dac", first_packet, end, "overwrite", counts, target=0, counts=True))
        mover = _hand(self.parts, self.table.scale, hand.seed)
        return trace(self.machine_parts, mover, self.packets, 1, self.physics, faults)

    def row(self, hand: HandTable, counts: float, deviation: Array, shift: Array, machine: Trace) -> StuckRow:
        """Return the consequences of the faults of a run.

        Args:
            hand: the hand of the run.
            counts: the stuck command in counts of the DAC.
            deviation: (k,) distance in mm of the tip from that of the model, after each packet.
            shift: (k,) distance in mm of the tip from that of the same machine without a fault.
            machine: trace of the machine with the faults; it may end early, after a stop.
        """
        watched = self.table.cycles + self.table.watched
        peaks = []
        jumps = 0
        for first_packet in self.first_packets:
            # row k has packet k + 1
            window = slice(first_packet - 1, first_packet - 1 + watched)
            if len(deviation[window]):  # the machine had not stopped before
                peaks.append(float(deviation[window].max()))
                jumps += bool(shift[window].max() > HARM)
        stopped = None
        check = ""
        stops = np.flatnonzero(machine.levels == Level.E_STOP)
        if len(stops):
            stop_packet = stops[0] + 1
            stopped = int(np.searchsorted(self.first_packets, stop_packet, side="right"))
            check = machine.machine.reason
        return StuckRow(hand.seed, counts, peaks, jumps, stopped, check)


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
    count = len(machine.q)
    model_tips = parts.kin.forward_many(model.q[:count])[:, :3, 3]
    tips = parts.kin.forward_many(machine.q)[:, :3, 3]
    return np.linalg.norm(tips - held_at_stop(model_tips, machine), axis=1) * MM_PER_M
