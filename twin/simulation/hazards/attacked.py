"""One session of a campaign: an operator moves the tool in a circle, a fault acts, machine and model are compared.

First, a session is run without a response of the operator. The model, which has no faults, is run once per motion scale
for all sessions. In a second run of a session, a trainee responds; these responses act on machine and model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.core.spatial import Array
from twin.simulation.controllers.cue import Cue
from twin.simulation.hazards.detection import Adaptive
from twin.simulation.hazards.fault import Fault
from twin.simulation.hazards.hand import Hand
from twin.simulation.hazards.trainee import HazardTrainee, Reaction
from twin.simulation.machine.beside import Beside
from twin.simulation.machine.levels import Level
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
        self._parts, self._adaptive, self.cue = parts, adaptive, Cue()
        self._models: dict[float, tuple[AttackedRun, Trace]] = {}

    def run(self, session: AttackedSession) -> Outcome:
        """Return the outcome of a session without a response."""
        start, packets = session.start, session.start + session.length + _AFTER
        physics, hand = self._physics(session), Hand(self._parts.settings, session.scale)
        seen = trace(self._parts, hand, packets, start + _SETTLED, physics, session.faults())
        k = len(seen.q)
        model = self._model(session.scale, k)
        tips = self._tips(model.q[:k])
        stopped = seen.levels == Level.E_STOP
        wanted = tips.copy()
        if stopped.any():  # from the stop on, the machine is compared with the model at the stop
            wanted[stopped] = wanted[int(np.argmax(stopped))]
        true = self._tips(seen.q)
        apart = np.linalg.norm(true - wanted, axis=1) * _MM
        beside = self._tips(model.measured[:k])
        both = (seen.read == Level.PEDAL_DN) & (model.read[:k] == Level.PEDAL_DN)
        residual = np.where(both, np.linalg.norm(beside - self._tips(seen.measured), axis=1) * _MM, 0.0)
        ratio = residual / (self._adaptive.limits(beside) * _MM)
        harm, stop = _first(apart > HARM, start), _first(stopped, start)
        end = min([k, *(start - 1 + x for x in (harm, stop) if x is not None)])
        found = seen.machine
        return Outcome(
            float(apart.max()),
            harm,
            _first(_off(true, tips, apart > HARM), start),
            _first(apart > self.cue.tol, start),
            _first(residual > self.cue.tol, start),
            _first(ratio > 1, start),
            stop,
            found.reason if stopped.any() else "",
            found.held,
            found.receiver.refused,
            float(residual[: start - 1].max(initial=0.0)),
            float(ratio[: start - 1].max(initial=0.0)),
            float(residual[start - 1 : end].max(initial=0.0)),
            float(ratio[start - 1 : end].max(initial=0.0)),
            bool((residual > self.cue.tol).any() or (seen.levels[_FOLLOWS:] != Level.PEDAL_DN).any()),
        )

    def respond(self, session: AttackedSession, reaction: Reaction) -> Response | None:
        """Return the trainee's responses in a session.

        None: there was no force and no stop to notice, or no response within `_LONGEST`.
        """
        pair = Beside(Machine(self._parts, physics=self._physics(session), faults=session.faults()), self.cue)
        hand, trainee = Hand(self._parts.settings, session.scale), HazardTrainee(reaction)
        last, restarted = session.start + session.length + _AFTER, False
        pair.step(0.0)
        pair.start()
        peak, number, coasts, wanted = 0.0, 0, _SETTLED, np.zeros(3)
        aside = np.zeros(3)  # tip of the machine minus that of the model, when the arm began to follow after a restart
        forward = self._parts.kin.forward
        for k in range(1, round(_LONGEST / TICK)):
            packets = []
            if k > _HOMED:
                number += 1
                packets = [(hand.packet(number, trainee.pace, trainee.pedal), "trainee")]
            pair.step(k * TICK, packets)
            if number <= _FOLLOWS:
                continue
            level = pair.machine.plc.level
            tip = forward(pair.machine.plant.q)[:3, 3]
            if level == Level.PEDAL_DN:
                wanted = forward(pair.model.plant.q)[:3, 3]
                aside = tip - wanted if restarted else aside
                coasts, restarted = 0, False
            coasts += 1
            if coasts <= _SETTLED:
                peak = max(peak, float(np.linalg.norm(tip - wanted - aside)) * _MM)
            trainee.step(k * TICK, bool(pair.force.any()), min(level, pair.model.plc.level))
            if trainee.restarts:
                for one in (pair.machine, pair.model):
                    one.stop()
                    one.start()
                coasts, restarted = _SETTLED, True
            if trainee.done or (trainee.noticed is None and number >= last):
                break
        if trainee.noticed is None or not trainee.responses:
            return None
        begin = (session.start + _HOMED) * TICK
        order = sorted(trainee.responses, key=lambda name: trainee.responses[name])
        acted = min(trainee.responses.values())
        works = pair.machine.plc.level == Level.PEDAL_DN and "convert" not in order
        noticed = round((trainee.noticed - begin) / TICK)
        return Response(noticed, round((acted - begin) / TICK), list(order), peak, peak > HARM, works)

    def _physics(self, session: AttackedSession) -> Physics:
        return self._parts.plant.physics.changed(session.mass, session.friction)

    def _tips(self, q: Array) -> Array:
        return self._parts.kin.forward_many(q)[:, :3, 3]

    def _model(self, scale: float, packets: int) -> Trace:
        if scale not in self._models:
            run = AttackedRun(self._parts, Hand(self._parts.settings, scale))
            self._models[scale] = run, run.trace
        run, known = self._models[scale]
        if len(known.q) < packets:
            run.go(_ROUND * -(-packets // _ROUND), packets)
            known = run.trace
            self._models[scale] = run, known
        return known


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
        self.machine, self._hand, self._stands = Machine(parts, physics=physics, faults=faults), hand, 0
        self._rows: tuple[list[Any], ...] = ([], [], [], [])
        self.machine.step(0.0)
        self.machine.start()
        for k in range(1, _HOMED + 1):
            self.machine.step(k * TICK)

    def __len__(self) -> int:
        return len(self._rows[0])

    def go(self, packets: int, settled: int) -> None:
        """Run until `packets` packets are sent, or after a stop, until the arm rests and `settled` packets are sent."""
        m, (q, measured, levels, read) = self.machine, self._rows
        for number in range(len(self) + 1, packets + 1):
            m.step((_HOMED + number) * TICK, [(self._hand.packet(number), "operator")])
            q.append(m.plant.q)
            measured.append(m.q)
            levels.append(m.plc.level)
            read.append(m.level)
            self._stands = self._stands + 1 if m.plc.level == Level.E_STOP else 0
            if self._stands > _SETTLED and number >= settled:
                break

    @property
    def trace(self) -> Trace:
        """Record of the run so far."""
        q, measured, levels, read = map(np.array, self._rows)
        return Trace(q, measured, levels, read, self.machine)


def trace(
    parts: Parts, hand: Hand, packets: int, settled: int, physics: Physics | None = None, faults: Sequence[Fault] = ()
) -> Trace:
    """Return the record of a machine that receives packets of a hand; `packets`, `settled`: see `AttackedRun.go`."""
    run = AttackedRun(parts, hand, physics, faults)
    run.go(packets, settled)
    return run.trace


def _off(true: Array, path: Array, far: np.ndarray) -> np.ndarray:
    """Return (k,) bool: whether a tip is `far` and more than `HARM` from the path; valid only up to the first True."""
    out = far.copy()
    for k in np.flatnonzero(far):
        out[k] = float(np.min(np.linalg.norm(path - true[k], axis=1))) * _MM > HARM
        if out[k]:  # the caller uses only the first
            break
    return out


def _first(condition: np.ndarray, start: int) -> int | None:
    """Return the number of packets from `start` to the first true condition; packet numbers begin at 1."""
    places = np.flatnonzero(condition)
    return int(places[0]) + 1 - start if len(places) else None
