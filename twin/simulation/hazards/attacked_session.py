"""One session of a campaign: an operator moves the tool in a circle, a fault acts, machine and model are compared.

First, a session is run without a response of the operator. The model, which has no faults, is run once per motion scale
for all sessions. In a second run of a session, a trainee responds; these responses act on machine and model.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.simulation.controllers.cue import Cue
from twin.simulation.hazards.detection import Adaptive
from twin.simulation.hazards.fault import Fault
from twin.simulation.hazards.packet_hand import Hand
from twin.simulation.hazards.trainee import HazardTrainee, Reaction
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_and_model import MachineAndModel
from twin.simulation.machine.motor_plant import TICK, Physics
from twin.simulation.machine.simulated_machine import Machine, Parts

_HOMED = 100
"""Tick at which the operator presses the pedal; an arm that starts at home completes homing earlier."""

_FOLLOWS = 10
"""Number of the packet from which the arm is expected to be in PEDAL_DN."""

_AFTER = 300
"""Number of packets after the end of a fault during which the consequences of the fault are recorded."""

_SETTLED = 100
"""Number of ticks after a stop in which the brakes bring the arm to rest; then the outcome no longer changes."""

_ROUND = 2000
"""The run of the model is extended to a multiple of this number of packets, so that few extensions are needed."""

_LONGEST = 12.0
"""Longest time in s of a session with a trainee."""

_MM = 1e3

HARM = 1.0
"""Distance in mm between the tips of machine and model above which the fault has caused harm."""


@dataclass(frozen=True)
class AttackedSession:
    """Inputs of a session: faults, plant and motion scale.

    Attributes:
        faults: function that creates the faults of the machine for each run, because a fault can be used only once.
        start: number of the packet with which the fault begins.
        length: duration of the fault in packets.
        mass, friction: factors of all masses and of all friction of the machine.
        scale: motion scale of the operator.
    """

    faults: Callable[[], Sequence[Fault]]
    start: int
    length: int
    mass: float = 1.0
    friction: float = 1.0
    scale: float = 0.1


@dataclass(frozen=True)
class Outcome:
    """Outcome of a session without a response of the operator; times in ms after the start of the fault, None: never.

    Attributes:
        peak: largest distance in mm between the true tips of machine and model; after a stop of the machine, the
            model's tip at the time of the stop is used.
        harm: time at which the distance exceeds `HARM`.
        jump: time at which the tip is more than `HARM` from every point of the model's path; a tip that only lags does
            not count.
        beyond: time at which the distance between the true tips exceeds the limit of the cue (a force that warns the
            operator when the measured distance exceeds this limit).
        cue: time of the first force on the operator's hand.
        adaptive: time at which the measured distance exceeds the adaptive limit.
        stop, check: time at which a check of the software stopped the arm, and the reason ("" without a stop).
        held, refused: number of packets with a target out of reach, and number of refused packets.
        residual, ratio: before the fault, the largest measured distance between the tips in mm, and the largest ratio
            of this distance to the adaptive limit.
        seen, seen_ratio: as `residual` and `ratio`, but from the start of the fault until harm or stop, whichever is
            first.
        noticeable: whether there was a force on the hand, or the arm did not follow while the pedal was down.
    """

    peak: float
    harm: int | None
    jump: int | None
    beyond: int | None
    cue: int | None
    adaptive: int | None
    stop: int | None
    check: str
    held: int
    refused: int
    residual: float
    ratio: float
    seen: float
    seen_ratio: float
    noticeable: bool


@dataclass(frozen=True)
class Response:
    """Responses of the trainee in one session; times are in ms from the start of the fault.

    Attributes:
        noticed: time of the first force or stop that the trainee could notice.
        acted: time of the first response.
        responses: the responses, in order of time.
        response_peak: largest distance in mm between the true tips of machine and model while the arm is not braked.
        response_harm: whether `response_peak` exceeded `HARM`.
        works: whether the arm followed the trainee's hand at the end.
    """

    noticed: int
    acted: int
    responses: list[str]
    response_peak: float
    response_harm: bool
    works: bool


@dataclass(frozen=True)
class Trace:
    """Record of a run from the first packet on.

    Attributes:
        q, measured: (k, n) true joint values, and joint values that the encoders measure.
        levels, read: (k,) run levels of the PLC, and run levels as the software reads them.
        machine: the machine after the run.
    """

    q: Array
    measured: Array
    levels: Array
    read: Array
    machine: Machine


class Arena:
    """Runs sessions of one robot.

    Attributes:
        cue: the equation of the force on the operator's hand.
    """

    def __init__(self, parts: Parts, adaptive: Adaptive) -> None:
        """Store the compiled parts of the robot; `adaptive`: limit of the deviation, which depends on the speed."""
        self._parts = parts
        self._adaptive = adaptive
        self.cue = Cue()
        self._models: dict[float, tuple[AttackedRun, Trace]] = {}

    def run(self, session: AttackedSession) -> Outcome:
        """Return the outcome of a session without a response."""
        start = session.start
        packets = start + session.length + _AFTER
        hand = Hand(self._parts.settings, session.scale)
        record = trace(self._parts, hand, packets, start + _SETTLED, self._physics(session), session.faults())
        k = len(record.q)
        model = self._model(session.scale, k)

        model_tips = self._tips(model.q[:k])
        true_tips = self._tips(record.q)
        deviation = np.linalg.norm(true_tips - held_at_stop(model_tips, record), axis=1) * _MM
        harmful = deviation > HARM
        stopped = record.levels == Level.E_STOP
        harm = _packets_until(harmful, start)
        stop = _packets_until(stopped, start)

        # What the software of the operator can see: encoders and levels, both with the effects of the fault.
        measured_model_tips = self._tips(model.measured[:k])
        measured_tips = self._tips(record.measured)
        following = (record.read == Level.PEDAL_DN) & (model.read[:k] == Level.PEDAL_DN)
        distance = np.linalg.norm(measured_model_tips - measured_tips, axis=1) * _MM
        residual = np.where(following, distance, 0.0)
        ratio = residual / (self._adaptive.limits(measured_model_tips) * _MM)
        force = residual > self.cue.tol
        not_following = record.levels[_FOLLOWS:] != Level.PEDAL_DN

        first = start - 1  # row of the packet `start`, because packet numbers begin at 1
        end = k
        for event in (harm, stop):
            if event is not None:
                end = min(end, first + event)
        return Outcome(
            peak=float(deviation.max()),
            harm=harm,
            jump=_packets_until(_off_path(true_tips, model_tips, harmful), start),
            beyond=_packets_until(deviation > self.cue.tol, start),
            cue=_packets_until(force, start),
            adaptive=_packets_until(ratio > 1, start),
            stop=stop,
            check=record.machine.reason if stopped.any() else "",
            held=record.machine.held,
            refused=record.machine.receiver.refused,
            residual=float(residual[:first].max(initial=0.0)),
            ratio=float(ratio[:first].max(initial=0.0)),
            seen=float(residual[first:end].max(initial=0.0)),
            seen_ratio=float(ratio[first:end].max(initial=0.0)),
            noticeable=bool(force.any() or not_following.any()),
        )

    def respond(self, session: AttackedSession, reaction: Reaction) -> Response | None:
        """Return the trainee's responses in a session.

        None: there was no force and no stop to notice, or no response within `_LONGEST`.
        """
        machine = Machine(self._parts, physics=self._physics(session), faults=session.faults())
        pair = MachineAndModel(machine, self.cue)
        hand = Hand(self._parts.settings, session.scale)
        trainee = HazardTrainee(reaction)
        deviation = _UnbrakedDeviation(pair, self._parts.kin.forward)
        # number of the packet after which the trainee can no longer notice a fault
        last = session.start + session.length + _AFTER
        number = 0
        pair.step(0.0)
        pair.start()
        for tick in range(1, round(_LONGEST / TICK)):
            packets = []
            if tick > _HOMED:
                number += 1
                packets = [(hand.packet(number, trainee.pace, trainee.pedal), "trainee")]
            pair.step(tick * TICK, packets)
            if number <= _FOLLOWS:  # the arm does not follow yet, also without a fault
                continue
            deviation.step()
            # The display shows the level of the one that follows less.
            level = min(pair.machine.plc.level, pair.model.plc.level)
            trainee.step(tick * TICK, bool(pair.force.any()), level)
            if trainee.restarts:
                for simulated in (pair.machine, pair.model):
                    simulated.stop()
                    simulated.start()
                deviation.restart()
            unnoticed = trainee.noticed is None and number >= last
            if trainee.done or unnoticed:
                break
        if trainee.noticed is None or not trainee.responses:
            return None
        begin = (session.start + _HOMED) * TICK
        acted = min(trainee.responses.values())
        responses = sorted(trainee.responses, key=lambda name: trainee.responses[name])
        follows = pair.machine.plc.level == Level.PEDAL_DN
        return Response(
            noticed=round((trainee.noticed - begin) / TICK),
            acted=round((acted - begin) / TICK),
            responses=list(responses),
            response_peak=deviation.peak,
            response_harm=deviation.peak > HARM,
            works=follows and "convert" not in responses,
        )

    def _physics(self, session: AttackedSession) -> Physics:
        return self._parts.plant.physics.changed(session.mass, session.friction)

    def _tips(self, q: Array) -> Array:
        return self._parts.kin.forward_many(q)[:, :3, 3]

    def _model(self, scale: float, packets: int) -> Trace:
        """Return the record of the model, which has no faults, with at least the given number of packets."""
        if scale not in self._models:
            run = AttackedRun(self._parts, Hand(self._parts.settings, scale))
            self._models[scale] = run, run.trace
        run, record = self._models[scale]
        if len(record.q) < packets:
            rounds = math.ceil(packets / _ROUND)
            run.go(_ROUND * rounds, packets)
            record = run.trace
            self._models[scale] = run, record
        return record


class _UnbrakedDeviation:
    """Largest distance between the true tips of machine and model while the machine is not braked.

    Attributes:
        peak: the distance in mm.
    """

    def __init__(self, pair: MachineAndModel, forward: Callable[[Array], Array]) -> None:
        """Store machine and model; `forward`: T_base_tool (4, 4) of joint values (n,)."""
        self.peak = 0.0
        self._pair = pair
        self._forward = forward
        # Before the machine has followed once, it counts as braked.
        self._ticks = _SETTLED  # since the machine followed
        self._model_tip = np.zeros(3)
        self._restarted = False
        # Tip of the machine minus that of the model, when the arm began to follow after a restart.
        self._offset = np.zeros(3)

    def restart(self) -> None:
        """Count the machine as braked until it follows again, then from where it is."""
        self._ticks = _SETTLED
        self._restarted = True

    def step(self) -> None:
        """Measure the distance after a tick of machine and model."""
        tip = self._forward(self._pair.machine.plant.q)[:3, 3]
        if self._pair.machine.plc.level == Level.PEDAL_DN:
            self._model_tip = self._forward(self._pair.model.plant.q)[:3, 3]
            if self._restarted:
                self._offset = tip - self._model_tip
            self._restarted = False
            self._ticks = 0
        self._ticks += 1
        if self._ticks <= _SETTLED:
            distance = float(np.linalg.norm(tip - self._model_tip - self._offset)) * _MM
            self.peak = max(self.peak, distance)


class AttackedRun:
    """A machine that receives the packets of a hand; `go` continues the run.

    Attributes:
        machine: the machine.
    """

    def __init__(self, parts: Parts, hand: Hand, physics: Physics | None = None, faults: Sequence[Fault] = ()) -> None:
        """Switch the machine on, and let it move to its home posture.

        Args:
            parts: compiled parts of the machine.
            hand: creates the packets.
            physics: parameters of the plant; None: those of the model.
            faults: faults of the machine.
        """
        self.machine = Machine(parts, physics=physics, faults=faults)
        self._hand = hand
        self._ticks_stopped = 0
        self._q: list[Array] = []
        self._measured: list[Array] = []
        self._levels: list[Level] = []
        self._read: list[Level] = []
        self.machine.step(0.0)
        self.machine.start()
        # without packets, until the arm has homed and the operator presses the pedal
        for tick in range(1, _HOMED + 1):
            self.machine.step(tick * TICK)

    def go(self, packets: int, settled: int) -> None:
        """Run until `packets` packets are sent, or after a stop, until the arm rests and `settled` packets are sent."""
        machine = self.machine
        for number in range(len(self._q) + 1, packets + 1):
            packet = self._hand.packet(number)
            machine.step((_HOMED + number) * TICK, [(packet, "operator")])
            self._q.append(machine.plant.q)
            self._measured.append(machine.q)
            self._levels.append(machine.plc.level)
            self._read.append(machine.level)
            if machine.plc.level == Level.E_STOP:
                self._ticks_stopped += 1
            else:
                self._ticks_stopped = 0
            if self._ticks_stopped > _SETTLED and number >= settled:
                break

    @property
    def trace(self) -> Trace:
        """Record of the run so far."""
        return Trace(
            q=np.array(self._q),
            measured=np.array(self._measured),
            levels=np.array(self._levels),
            read=np.array(self._read),
            machine=self.machine,
        )


def trace(
    parts: Parts, hand: Hand, packets: int, settled: int, physics: Physics | None = None, faults: Sequence[Fault] = ()
) -> Trace:
    """Return the record of a machine that receives packets of a hand; `packets`, `settled`: see `AttackedRun.go`."""
    run = AttackedRun(parts, hand, physics, faults)
    run.go(packets, settled)
    return run.trace


def held_at_stop(model_tips: Array, record: Trace) -> Array:
    """Return tips (k, 3) of the model for comparison with a machine: from its stop on, the model's tip at the stop."""
    tips = model_tips.copy()
    stopped = record.levels == Level.E_STOP
    if stopped.any():
        tips[stopped] = tips[int(np.argmax(stopped))]
    return tips


def _off_path(true_tips: Array, path: Array, is_far: np.ndarray) -> np.ndarray:
    """Return (k,) bool: whether a tip `is_far` and more than `HARM` from the path; valid only up to the first True."""
    is_off = is_far.copy()
    for k in np.flatnonzero(is_far):
        distances = np.linalg.norm(path - true_tips[k], axis=1)
        is_off[k] = float(np.min(distances)) * _MM > HARM
        if is_off[k]:  # the caller uses only the first
            break
    return is_off


def _packets_until(condition: np.ndarray, start: int) -> int | None:
    """Return the number of packets from `start` to the first true condition; packet numbers begin at 1."""
    rows = np.flatnonzero(condition)
    if not len(rows):
        return None
    return int(rows[0]) + 1 - start
