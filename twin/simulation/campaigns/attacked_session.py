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
from twin.simulation.campaigns.adaptive_limit import AdaptiveLimit
from twin.simulation.campaigns.hazard_trainee import HazardTrainee, Reaction
from twin.simulation.campaigns.packet_hand import Hand
from twin.simulation.campaigns.traced_run import HOMED, SETTLED, Trace, TracedRun, held_at_stop, trace
from twin.simulation.campaigns.unbraked_deviation import MM_PER_M, UnbrakedDeviation
from twin.simulation.controllers.cue import Cue
from twin.simulation.hazards.fault import Fault
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_and_model import MachineAndModel
from twin.simulation.machine.machine_parts import Parts
from twin.simulation.machine.physics import TICK, Physics
from twin.simulation.machine.simulated_machine import Machine

_FIRST_FOLLOWING_PACKET = 10
"""Number of the packet from which the arm is expected to be in PEDAL_DN."""

_PACKETS_AFTER_FAULT = 300
"""Number of packets after the end of a fault during which the consequences of the fault are recorded."""

_MODEL_RUN_STEP = 2000
"""The run of the model is extended to a multiple of this number of packets, so that few extensions are needed."""

_LONGEST_RESPONSE = 12.0
"""Longest time in s of a session with a trainee."""

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


class SessionRunner:
    """Runs sessions of one robot; keeps one run of the model without a fault for each motion scale.

    Attributes:
        cue: the equation of the force on the operator's hand.
    """

    def __init__(self, parts: Parts, adaptive_limit: AdaptiveLimit) -> None:
        """Store the compiled parts of the robot, and the limit of the deviation that depends on the speed."""
        self._parts = parts
        self._adaptive_limit = adaptive_limit
        self.cue = Cue()
        # for each motion scale, with the trace of the run: to make it anew for every session would take long
        self._model_runs: dict[float, tuple[TracedRun, Trace]] = {}

    def run(self, session: AttackedSession) -> Outcome:
        """Return the outcome of a session without a response."""
        start = session.start
        packets = start + session.length + _PACKETS_AFTER_FAULT
        hand = Hand(self._parts.settings, session.scale)
        machine = trace(self._parts, hand, packets, start + SETTLED, self._physics(session), session.faults())
        count = len(machine.q)
        model = self._model_trace(session.scale, count)

        model_tips = self._tips(model.q[:count])
        true_tips = self._tips(machine.q)
        deviation = np.linalg.norm(true_tips - held_at_stop(model_tips, machine), axis=1) * MM_PER_M
        is_harmful = deviation > HARM
        is_stopped = machine.levels == Level.E_STOP
        harm = _packets_until(is_harmful, start)
        stop = _packets_until(is_stopped, start)

        residual, ratio = self._seen_by_software(machine, model)
        has_force = residual > self.cue.tol
        is_not_following = machine.levels[_FIRST_FOLLOWING_PACKET:] != Level.PEDAL_DN

        fault_row = start - 1  # row of the packet `start`, because packet numbers begin at 1
        end_row = count  # of the time in which the fault can be detected: until harm or stop
        for event in (harm, stop):
            if event is not None:
                end_row = min(end_row, fault_row + event)
        after_run = machine.machine
        return Outcome(
            peak=float(deviation.max()),
            harm=harm,
            jump=_packets_until(_off_path(true_tips, model_tips, is_harmful), start),
            beyond=_packets_until(deviation > self.cue.tol, start),
            cue=_packets_until(has_force, start),
            adaptive=_packets_until(ratio > 1, start),
            stop=stop,
            check=after_run.reason if is_stopped.any() else "",
            held=after_run.held,
            refused=after_run.receiver.refused,
            residual=float(residual[:fault_row].max(initial=0.0)),
            ratio=float(ratio[:fault_row].max(initial=0.0)),
            seen=float(residual[fault_row:end_row].max(initial=0.0)),
            seen_ratio=float(ratio[fault_row:end_row].max(initial=0.0)),
            noticeable=bool(has_force.any() or is_not_following.any()),
        )

    def _seen_by_software(self, machine: Trace, model: Trace) -> tuple[Array, Array]:
        """Return what the operator's software sees in k packets: (distance of the tips, its ratio to its limit), (k,).

        It knows encoders and levels, both with the effects of the fault. The distance is in mm, and 0 while one of
        machine and model does not follow; the limit is the adaptive one.
        """
        count = len(machine.q)
        model_tips = self._tips(model.measured[:count])
        tips = self._tips(machine.measured)
        is_following = (machine.read == Level.PEDAL_DN) & (model.read[:count] == Level.PEDAL_DN)
        distance = np.linalg.norm(model_tips - tips, axis=1) * MM_PER_M
        residual = np.where(is_following, distance, 0.0)
        return residual, residual / (self._adaptive_limit.limits(model_tips) * MM_PER_M)

    def respond(self, session: AttackedSession, reaction: Reaction) -> Response | None:
        """Return the trainee's responses in a session.

        None: there was no force and no stop to notice, or no response within `_LONGEST_RESPONSE`.
        """
        machine = Machine(self._parts, physics=self._physics(session), faults=session.faults())
        pair = MachineAndModel(machine, self.cue)
        trainee = HazardTrainee(reaction)
        deviation = UnbrakedDeviation(pair, self._parts.kin.forward)
        self._run_with_trainee(session, pair, trainee, deviation)
        if trainee.noticed is None or not trainee.responses:
            return None
        fault_time = (session.start + HOMED) * TICK
        acted = min(trainee.responses.values())
        responses = sorted(trainee.responses, key=lambda name: trainee.responses[name])
        is_following = pair.machine.plc.level == Level.PEDAL_DN
        return Response(
            noticed=round((trainee.noticed - fault_time) / TICK),
            acted=round((acted - fault_time) / TICK),
            responses=list(responses),
            response_peak=deviation.peak,
            response_harm=deviation.peak > HARM,
            works=is_following and "convert" not in responses,
        )

    def _run_with_trainee(
        self, session: AttackedSession, pair: MachineAndModel, trainee: HazardTrainee, deviation: UnbrakedDeviation
    ) -> None:
        """Run machine and model until the trainee ends the session, can no longer notice a fault, or takes too long."""
        hand = Hand(self._parts.settings, session.scale)
        last_noticeable_packet = session.start + session.length + _PACKETS_AFTER_FAULT
        number = 0
        pair.step(0.0)
        pair.start()
        for tick in range(1, round(_LONGEST_RESPONSE / TICK)):
            t = tick * TICK
            packets = []
            if tick > HOMED:
                number += 1
                packets = [(hand.packet(number, trainee.pace, trainee.pedal), "trainee")]
            pair.step(t, packets)
            if number <= _FIRST_FOLLOWING_PACKET:  # the arm does not follow yet, also without a fault
                continue
            deviation.step()
            # The display shows the level of the one that follows less.
            level = min(pair.machine.plc.level, pair.model.plc.level)
            trainee.step(t, bool(pair.force.any()), level)
            if trainee.restarts:
                for simulated in (pair.machine, pair.model):
                    simulated.stop()
                    simulated.start()
                deviation.restart()
            is_unnoticed = trainee.noticed is None and number >= last_noticeable_packet
            if trainee.done or is_unnoticed:
                return

    def _physics(self, session: AttackedSession) -> Physics:
        """Return the parameters of the machine's plant."""
        return self._parts.plant.physics.changed(session.mass, session.friction)

    def _tips(self, q: Array) -> Array:
        """Return the tips (k, 3) in m, in base, at joint values (k, n)."""
        return self._parts.kin.forward_many(q)[:, :3, 3]

    def _model_trace(self, scale: float, packets: int) -> Trace:
        """Return the trace of the model, which has no faults, with at least the given number of packets."""
        if scale not in self._model_runs:
            run = TracedRun(self._parts, Hand(self._parts.settings, scale))
            self._model_runs[scale] = run, run.trace
        run, model = self._model_runs[scale]
        if len(model.q) < packets:
            rounds = math.ceil(packets / _MODEL_RUN_STEP)
            run.extend(_MODEL_RUN_STEP * rounds, packets)
            model = run.trace
            self._model_runs[scale] = run, model
        return model


def _off_path(true_tips: Array, path: Array, is_far: np.ndarray) -> np.ndarray:
    """Return (k,) bool: whether a tip `is_far` and more than `HARM` from the path; valid only up to the first True."""
    is_off = is_far.copy()
    for k in np.flatnonzero(is_far):
        distances = np.linalg.norm(path - true_tips[k], axis=1)
        is_off[k] = float(np.min(distances)) * MM_PER_M > HARM
        if is_off[k]:  # the caller uses only the first
            break
    return is_off


def _packets_until(condition: np.ndarray, start: int) -> int | None:
    """Return the number of packets from `start` to the first true condition; packet numbers begin at 1."""
    rows = np.flatnonzero(condition)
    if not len(rows):
        return None
    return int(rows[0]) + 1 - start
