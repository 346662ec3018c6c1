"""Measures of a session with machines: the deviation between machine and model, and the result of a rehearsal."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from twin.core.findings import Finding, disagreement, warning
from twin.core.json_types import JsonObject
from twin.core.quantity import mm
from twin.core.spatial import Array
from twin.core.units import MM
from twin.kinematics import Kinematics
from twin.model.trainer import MODEL, TrainerTable
from twin.simulation import machine_scene
from twin.simulation.controllers.trainer_states import TrainerPhase, TrainerReason, reason_text
from twin.simulation.devices.machine_states import ANSWERS, LEVEL
from twin.simulation.machine.levels import Level
from twin.simulation.world import Recording
from twin.simulation.world.signal_kinds import ROBOT_CUE, ROBOT_DEVIATION, ROBOT_PHASE, ROBOT_Q, ROBOT_RUN

_LAG = 0.3
"""Maximum delay in s between record and replay that the comparison of their paths compensates."""

_AT_REST = 1e-4
"""Distance in m of a tip from its begin up to which it counts as at rest."""

_NAMES = {
    TrainerPhase.TELEOPERATE: "teleoperation",
    TrainerPhase.REHEARSE: "rehearsal in the model",
    TrainerPhase.JUDGED: "judged",
    TrainerPhase.REPLAY: "replay on the machine",
    TrainerPhase.DONE: "replayed",
    TrainerPhase.STOPPED: "refused or stopped",
}


@dataclass(frozen=True)
class TrainingSpan:
    """Time span of a session in which the trainer is in one phase.

    Attributes:
        phase: the phase.
        begin, end: times in s.
        deviation: maximum distance in m between the tips of machine and model; nan if only the model moves.
        record: largest distance in m of the machine's tip from the rehearsed path; nan outside of replays.
        text: why a record was refused or ended, or a replay stopped; "" otherwise.
    """

    phase: TrainerPhase
    begin: float
    end: float
    deviation: float
    record: float
    text: str

    def content(self) -> JsonObject:
        """Return plain data; keys end with their unit."""
        return {
            "phase": self.phase.name.lower(),
            "begin_s": self.begin,
            "end_s": self.end,
            "deviation_mm": _number(self.deviation / MM),
            "from_record_mm": _number(self.record / MM),
            "why": self.text or None,
        }


@dataclass(frozen=True)
class Training:
    """Measures of one machine in a session.

    Attributes:
        robot: name of the machine.
        t: (k,) times in s.
        deviation: (k,) distance in m between the tips of machine and model; nan while the model moves alone.
        limit: deviation in m above which the cue (force on the hand) acts.
        steps: the phases in order.
        cue: (largest force of the cue in N, total time in s in which the cue acts).
        stops: number of times that the machine went to E_STOP.
        silent: total time in s in which the machine did not answer, counted after its first state.
    """

    robot: str
    t: Array
    deviation: Array
    limit: float
    steps: tuple[TrainingSpan, ...]
    cue: tuple[float, float]
    stops: int
    silent: float

    @property
    def led(self) -> float:
        """Largest deviation in m during teleoperation; nan without teleoperation."""
        deviations = []
        for step in self.steps:
            if step.phase == TrainerPhase.TELEOPERATE:
                deviations.append(step.deviation)
        return max(deviations, default=float("nan"))

    def rows(self) -> Iterator[tuple[str, ...]]:
        """Yield for each step: phase, duration, deviation from the model, distance from the rehearsed path, reason."""
        for step in self.steps:
            duration = f"{step.end - step.begin:.1f} s"
            deviation = _distance_text(step.deviation)
            from_record = _distance_text(step.record)
            yield _NAMES[step.phase], duration, deviation, from_record, step.text or "-"

    def findings(self) -> Iterator[Finding]:
        """Yield findings on the machine: cues, stops, times without an answer, ended records and stopped replays."""
        if self.cue[0] > 0:
            yield warning(
                "training.cue",
                self.robot,
                f"the cue acted for {self.cue[1]:.2f} s with at most {self.cue[0]:.2f} N: largest deviation",
                mm(float(np.nanmax(self.deviation))),
                mm(self.limit),
                word="limit",
            )
        if self.stops:
            yield disagreement("training.stopped", self.robot, f"the machine went to E_STOP {self.stops} times")
        if self.silent > 0:
            yield warning("training.silent", self.robot, f"the machine did not answer for {self.silent:.2f} s")
        for step in self.steps:
            begin = f"{step.begin:.1f} s"
            if step.phase == TrainerPhase.STOPPED and step.text.startswith("the replay"):
                yield disagreement("training.replay", self.robot, step.text, when=begin)
            if step.phase == TrainerPhase.REHEARSE and step.text:
                reason = step.text.partition(". Press")[0]  # without what the person had to do next
                yield warning("training.record", self.robot, reason, when=begin)

    def content(self) -> JsonObject:
        """Return plain data; keys end with their unit."""
        return {
            "robot": self.robot,
            "cue_limit_mm": self.limit / MM,
            "cue_largest_n": self.cue[0],
            "cue_s": self.cue[1],
            "stops": self.stops,
            "silent_s": self.silent,
            "steps": [step.content() for step in self.steps],
        }


def _number(value: float) -> float | None:
    if np.isnan(value):
        return None
    return value


def _distance_text(distance: float) -> str:
    if np.isnan(distance):
        return "-"
    return f"{distance / MM:.2f} mm"


def measure(recording: Recording, table: TrainerTable, robot: str, kin: Kinematics) -> Training:
    """Return the measures of a machine from the kept signals of a session; `kin`: the machine's equations."""
    force = np.linalg.norm(recording[ROBOT_CUE.of(robot)], axis=1)
    cue = (float(force.max(initial=0.0)), float(np.sum(force > 0) * recording.dt))
    model_alone = np.isin(recording[ROBOT_PHASE.of(robot)][:, 0], (TrainerPhase.REHEARSE, TrainerPhase.JUDGED))
    deviation = np.where(model_alone, np.nan, recording[ROBOT_DEVIATION.of(robot)][:, 0])
    steps = _steps(recording, table, robot, kin, deviation)
    run = recording[ROBOT_RUN.of(robot)]
    answers = run[:, ANSWERS] > 0.5
    first_answer = int(np.argmax(answers)) if answers.any() else len(recording.t)
    # before its first state, a machine is not silent: it has not been connected yet
    # a machine that is in E_STOP at the start, or before and after a silence, has not gone there
    is_stopped = (run[answers, LEVEL] == Level.E_STOP).astype(int)
    stops = int(np.count_nonzero(np.diff(is_stopped) > 0))
    silent = float(np.sum(~answers[first_answer:]) * recording.dt)
    return Training(robot, recording.t, deviation, table.cue.tol_mm * MM, steps, cue, stops, silent)


def _steps(
    recording: Recording, table: TrainerTable, robot: str, kin: Kinematics, deviation: Array
) -> tuple[TrainingSpan, ...]:
    """Return the phases in order; deviation (k,) in m, nan while the model moves alone."""
    t = recording.t
    phase = recording[ROBOT_PHASE.of(robot)]
    tip = kin.forward_many(recording[ROBOT_Q.of(robot)])[:, :3, 3]
    model = kin.forward_many(recording[f"{robot}{MODEL}.q"])[:, :3, 3]
    limits = machine_scene.trainer_limits(table)
    longest_lag = round(_LAG / recording.dt)
    changes = np.any(np.diff(phase[:, :2], axis=0) != 0, axis=1)
    edges = [0, *(np.flatnonzero(changes) + 1).tolist(), len(t)]
    steps = []
    rehearsed = None
    for first, end_row in itertools.pairwise(edges):
        phase_number, why, value = phase[first]
        record = float("nan")
        # at the limit of the record, the model is at rest
        if phase_number == TrainerPhase.REHEARSE and why != TrainerReason.FULL:
            rehearsed = model[first:end_row]
        elif phase_number == TrainerPhase.REPLAY and rehearsed is not None:
            record = _apart(tip[first:end_row], rehearsed, longest_lag)
        part = deviation[first:end_row]
        largest = float("nan") if np.isnan(part).all() else float(np.nanmax(part))
        text = reason_text(TrainerReason(int(why)), float(value), limits, robot)
        begin = float(t[first])
        end = float(t[first] + (end_row - first) * recording.dt)
        steps.append(TrainingSpan(TrainerPhase(int(phase_number)), begin, end, largest, record, text))
    return tuple(steps)


def _apart(path: Array, record: Array, most: int) -> float:
    """Return the largest distance in m of a path (k, 3) from a record (n, 3), for the delay that minimises it.

    The delay is at most `most` samples. Path and record begin and end at rest.
    """
    record = record[_start_of_motion(record) :]
    start = _start_of_motion(path)
    largest_distances = []
    for lag in range(-most, most + 1):
        begin = max(start + lag, 0)
        n = min(len(record), len(path) - begin)
        if n > 0:
            distances = np.linalg.norm(path[begin : begin + n] - record[:n], axis=1)
            largest_distances.append(float(distances.max()))
    return min(largest_distances, default=float("nan"))


def _start_of_motion(path: Array) -> int:
    """Return the first sample of a path (k, 3) that is more than `_AT_REST` from its begin; 0 if there is none."""
    return int(np.argmax(np.linalg.norm(path - path[0], axis=1) > _AT_REST))
