"""Compare the equations with the mechanism at very many states over the joint range (`validate --samples`).

The check of every report (`joint_range`) uses the reference model at 512 states. Here, compiled kernels evaluate the
equations and close the loops of the mechanism at as many states as wanted, on a graphics processor where there is one.
The kernels only find states: the reference model, which shares no code with them, decides. It closes the loops again
at the states where the equations seem to be wrong, and at some where they seem to be right.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from twin.core import compute_device, spatial
from twin.core.progress import Progress
from twin.core.spatial import Array
from twin.kinematics import Kinematics
from twin.kinematics.closed_loops import ClosedStates, LoopSolver
from twin.kinematics.closed_loops.passive_limits import PassiveCheck
from twin.reference import ReferenceModel
from twin.reference.joint_range import JointRange, draws, ends, within_limits
from twin.reference.loop_closing import Closing
from twin.validation.joint_range import TOLERANCE_FACTOR, beyond_reach, range_errors, reads_orientation
from twin.validation.range_samples_result import CONFIRMED_STATES, JudgedStage, RangeSamples
from twin.validation.residual_rows import Tolerances

_BLOCK_STATES = 1 << 18
"""Number of states that are computed together: more of them need more memory, and are not faster."""

_MOST_EXAMINED = 256
"""Maximum number of suspected states that the reference model judges, spread evenly over all."""

_PILOT_STATES = 2048
"""Number of states over the whole range that tell whether most states are possible."""

_MOSTLY_POSSIBLE = 0.5
"""Fraction of these states that must be possible; else, states are drawn on lines from the rest poses."""

_ORIENTATION_POSES = 1000
"""Number of poses at which it is found out whether the inverse equations read the orientation."""


@dataclass(frozen=True)
class StageKey:
    """A part of the equations that is judged by itself.

    Attributes:
        kind: inverse equations, forward equations, or a row of reach.
        row: name of the row of reach; "" for equations.
    """

    kind: Literal["inverse", "forward", "reach"]
    row: str = ""


INVERSE = StageKey("inverse")
FORWARD = StageKey("forward")


@dataclass
class SuspectReservoir:
    """At most a few of the suspected states, spread evenly over all that were found."""

    found: int = 0
    _kept: Array | None = None  # joint values (s, n)
    _every: int = 1  # one in so many of the found states is kept; doubled whenever there are too many

    def add(self, q: Array) -> None:
        """Add the suspected states with joint values q (s, n), at least one."""
        numbers = self.found + np.arange(len(q))
        self.found += len(q)
        # by the number of the state, not at random: the result must be the same in every run
        new = q[numbers % self._every == 0]
        self._kept = new if self._kept is None else np.concatenate([self._kept, new])
        while len(self._kept) > 2 * _MOST_EXAMINED:
            self._kept = self._kept[::2]
            self._every *= 2

    def chosen(self) -> Array | None:
        """Return joint values (s, n) of at most `_MOST_EXAMINED` states; None if none was found."""
        stored = self._kept
        if stored is None or len(stored) <= _MOST_EXAMINED:
            return stored
        return stored[np.linspace(0, len(stored) - 1, _MOST_EXAMINED).astype(int)]


@dataclass(frozen=True)
class _WorstSuspect:
    """The suspected state with the largest error by the kernels: this error relative to the tolerances, and q (n,)."""

    size: float
    q: Array


@dataclass
class _StageTally:
    """What the kernels have found about one stage so far."""

    judged: int = 0
    position: float | None = None  # largest errors of the states without a suspicion
    rotation: float | None = None
    suspects: SuspectReservoir = field(default_factory=SuspectReservoir)
    worst: _WorstSuspect | None = None  # None: no suspected state has a result

    def add(self, q: Array, offset: Array, turn: Array, tolerances: Tolerances) -> np.ndarray:
        """Add errors (k,) in m and rad at joint values q (k, n); return (k,) bool: whether a state is suspected."""
        right = (offset <= TOLERANCE_FACTOR * tolerances.position) & (turn <= TOLERANCE_FACTOR * tolerances.rotation)
        self.judged += len(q)
        if right.any():
            self.position = max(self.position or 0.0, float(offset[right].max()))
            self.rotation = max(self.rotation or 0.0, float(turn[right].max()))
        suspected = np.flatnonzero(~right)
        if len(suspected):
            self.suspects.add(q[suspected])
            size = offset[suspected] / tolerances.position + turn[suspected] / tolerances.rotation
            self._note_worst(q[suspected], size)
        return ~right

    def _note_worst(self, q: Array, size: Array) -> None:
        """Keep the state with the largest error, of suspected states q (s, n); errors (s,) are NaN without a result."""
        with_result = np.flatnonzero(~np.isnan(size))
        if not len(with_result):
            return
        largest = with_result[np.argmax(size[with_result])]
        if self.worst is None or size[largest] > self.worst.size:
            self.worst = _WorstSuspect(float(size[largest]), q[largest].copy())

    def examined(self, joints: int) -> Array:
        """Return joint values (s, joints) of at most `_MOST_EXAMINED` suspects, with the largest error among them."""
        chosen = self.suspects.chosen()
        if chosen is None:
            return np.zeros((0, joints))
        # the spread may have left the worst suspect out, whose error the report states
        if self.worst is not None and not (chosen == self.worst.q).all(axis=1).any():
            chosen = np.concatenate([self.worst.q[None], chosen[: _MOST_EXAMINED - 1]])
        return chosen


@dataclass(frozen=True)
class SampledRange:
    """Judges equations at states over the joint range of a mechanism.

    Attributes:
        robot: name of the robot.
        kin: the compiled equations.
        loops: the compiled loops of the mechanism.
        passive: limits of passive joints, or None.
        model: the reference model.
        tolerances: largest errors; here, 10 times these count as agreement, as in every check of the whole range.
    """

    robot: str
    kin: Kinematics
    loops: LoopSolver
    passive: PassiveCheck | None
    model: ReferenceModel
    tolerances: Tolerances

    def judge(self, samples: int, progress: Progress) -> RangeSamples:
        """Return the comparison at `samples` states; always the same states for the same number."""
        tallies = {key: _StageTally() for key in self._stages()}
        possible_count = 0
        beyond_count = 0
        unsuspected_count = 0
        unsuspected = np.zeros((0, len(self._rest)))
        for first in range(0, samples, _BLOCK_STATES):
            last = min(first + _BLOCK_STATES, samples)
            q = self._drawn(first, last, self._on_lines)
            closed = self.loops.forward_many(q)
            possible = self._possible(q, closed)
            possible_count += int(possible.sum())
            beyond, without_margin = self._outside_reach(q[possible], closed.Ts_base_tool[possible])
            beyond_count += int(beyond.sum())
            rows = np.flatnonzero(possible)[~beyond]
            without_margin = {row: states[~beyond] for row, states in without_margin.items()}
            suspected = self._compare_block(
                q[rows], closed.Ts_base_tool[rows], closed.states[rows], without_margin=without_margin, tallies=tallies
            )
            unsuspected_count += int((~suspected).sum())
            # the first ones suffice: draws with low discrepancy cover the whole range from the beginning
            if len(unsuspected) < CONFIRMED_STATES:
                unsuspected = np.concatenate([unsuspected, q[rows[~suspected]][:CONFIRMED_STATES]])
            progress(f"{samples:.3g} states", last / samples)
        progress("reference model", 0.0)
        confirmed, stages = self._judged_stages(tallies, unsuspected[:CONFIRMED_STATES])
        return RangeSamples(
            robot=self.robot,
            samples=samples,
            on_lines=self._on_lines,
            possible=possible_count,
            beyond=beyond_count,
            tolerance=(TOLERANCE_FACTOR * self.tolerances.position, TOLERANCE_FACTOR * self.tolerances.rotation),
            stages=stages,
            unsuspected=unsuspected_count,
            confirmed=confirmed,
            device=compute_device.current().name,
            mechanism=self.model.mechanism,
        )

    def _stages(self) -> list[StageKey]:
        """Return what is judged: the equations that exist, then the rows of reach."""
        keys: list[StageKey] = []
        if self.kin.closed_inverse:
            keys.append(INVERSE)
        if self.kin.closed_forward:
            keys.append(FORWARD)
        for row in self.kin.formula.scalars["reach"]:
            keys.append(StageKey("reach", row))
        return keys

    @cached_property
    def _rest(self) -> Array:
        """Joint values (n,) of the rest poses."""
        return self.model.home().q

    @cached_property
    def _ends(self) -> tuple[Array, Array]:
        """Ends (n,) and (n,) of the joint range."""
        return ends(self.model.mechanism, self._rest)

    def _drawn(self, first: int, last: int, on_lines: bool) -> Array:
        """Return the joint values (k, n) of the draws from `first` to before `last`."""
        low, high = self._ends
        if not on_lines:
            return low + draws(first + 1, last + 1, len(low)) * (high - low)
        # one coordinate more than joints: the position on the line from the rest poses to the target
        parts = draws(first + 1, last + 1, len(low) + 1)
        target = low + parts[:, :-1] * (high - low)
        return self._rest + parts[:, -1:] * (target - self._rest)

    @cached_property
    def _on_lines(self) -> bool:
        """Whether few states of the whole range are possible, so that states are drawn on lines."""
        q = self._drawn(0, _PILOT_STATES, on_lines=False)
        possible = self._possible(q, self.loops.forward_many(q))
        return bool(possible.mean() < _MOSTLY_POSSIBLE)

    @cached_property
    def _reads_orientation(self) -> bool:
        """Whether the inverse equations read the orientation: decided once, for kernels and reference model."""
        q = self._drawn(0, _ORIENTATION_POSES, self._on_lines)
        closed = self.loops.forward_many(q)
        Ts = closed.Ts_base_tool[self._possible(q, closed)]
        return not len(Ts) or reads_orientation(self.kin, Ts)

    def _possible(self, q: Array, closed: ClosedStates) -> np.ndarray:
        """Return (k,) bool: whether the loops close at joint values q (k, n), within the limits of passive joints."""
        possible = np.asarray(np.isfinite(closed.Ts_base_tool).all(axis=(1, 2)), bool)
        if self.passive is not None:
            possible[possible] = self.passive.keeps_limits(q[possible], closed.states[possible])
        return possible

    def _outside_reach(self, q: Array, Ts: Array) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return (whether states are beyond a row of reach, (k,) bool; `RangeErrors.without_margin`)."""
        outside = np.zeros(len(q), bool)
        if not len(q):
            return outside, {}
        beyond, without_margin = beyond_reach(self.kin, q, Ts)
        for states in beyond.values():
            outside |= states
        return outside, without_margin

    def _compare_block(
        self,
        q: Array,
        Ts: Array,
        states: Array,
        without_margin: dict[str, np.ndarray],
        tallies: dict[StageKey, _StageTally],
    ) -> np.ndarray:
        """Compare the equations at states of the mechanism; return (k,) bool: whether a state is suspected."""
        suspected = np.zeros(len(q), bool)
        if not len(q):
            return suspected
        for key, tally in tallies.items():
            if key.kind == "reach":
                offset = turn = _margin_errors(without_margin, key.row, len(q))
            elif key.kind == "inverse":
                offset, turn = self._inverse_errors(q, Ts, states)
            else:
                offset, turn = _pose_errors(Ts, self.kin.forward_many(q))
            suspected |= tally.add(q, offset, turn, self.tolerances)
        return suspected

    def _inverse_errors(self, q: Array, Ts: Array, states: Array) -> tuple[Array, Array]:
        """Return the errors (k,) in m and rad of the inverse equations: NaN without a result.

        The error is 0 where the equations give the joint values of the state; else, it is that of the mechanism's pose
        at the joint values that they give, infinite if its loops do not close there.
        """
        kin = self.kin
        answer = kin.inverse_many(Ts)
        answer[:, kin.auxiliary] = q[:, kin.auxiliary]  # the tool's pose does not determine a jaw
        answered = np.isfinite(answer).all(axis=1)
        difference = answer - q
        turns = np.round(difference / (2 * np.pi))
        difference[:, kin.revolute] -= 2 * np.pi * turns[:, kin.revolute]
        limit = np.where(kin.revolute, self.tolerances.rotation, self.tolerances.position)
        is_own_mode = answered & (np.abs(difference) <= limit).all(axis=1)
        other_rows = np.flatnonzero(answered & ~is_own_mode)
        offset = np.where(answered, 0.0, np.nan)
        turn = offset.copy()
        if len(other_rows):
            Ts_found = self.loops.forward_many(answer[other_rows], states[other_rows]).Ts_base_tool
            if not self._reads_orientation:
                Ts_found[:, :3, :3] = Ts[
                    other_rows, :3, :3
                ]  # in another working mode, a position has another orientation
            offset[other_rows], turn[other_rows] = _pose_errors(Ts[other_rows], Ts_found)
            open_loops = np.isnan(offset[other_rows])
            offset[other_rows[open_loops]] = np.inf
            turn[other_rows[open_loops]] = np.inf
        return offset, turn

    def _judged_stages(
        self, tallies: dict[StageKey, _StageTally], unsuspected: Array
    ) -> tuple[int, tuple[JudgedStage, ...]]:
        """Return (number of unsuspected states that the reference model judged, what it finds about each stage).

        Rows of reach without a suspicion are left out.
        """
        closing = Closing(self.model, np.ones(len(self._rest)))
        confirming = self._judged_by_reference(closing, unsuspected)
        confirmed = 0
        if confirming is not None:
            confirmed = len(confirming[0])
        stages = []
        for key, tally in tallies.items():
            if key.kind == "reach" and not tally.suspects.found:
                continue
            examining = self._judged_by_reference(closing, tally.examined(len(self._rest)))
            examined = 0
            if examining is not None:
                examined = len(examining[0])
            q = np.zeros((0, len(self._rest)))
            offset = np.zeros(0)
            turn = np.zeros(0)
            for judged in (examining, confirming):
                if judged is None:
                    continue
                states, errors = judged
                q = np.concatenate([q, states])
                offset = np.concatenate([offset, errors[key][0]])
                turn = np.concatenate([turn, errors[key][1]])
            stages.append(self._stage_result(key, tally, examined, q=q, offset=offset, turn=turn))
        return confirmed, tuple(stages)

    def _judged_by_reference(
        self, closing: Closing, q: Array
    ) -> tuple[Array, dict[StageKey, tuple[Array, Array]]] | None:
        """Return (joint values (s, n), errors of the stages) by the reference model at those of q that it can take."""
        if not len(q):
            return None
        states, is_closed = closing.states(q)
        states = states[is_closed]
        states = states[within_limits(self.model, states)]
        if not len(states):
            return None
        low, high = self._ends
        range_states = JointRange(self.model.collect(states), low, high)
        reads = None
        if self.kin.closed_inverse:
            reads = self._reads_orientation
        reference_errors = range_errors(
            self.kin, self.model, self.tolerances, range_states, free_angles=False, reads=reads
        )
        inside = reference_errors.inside
        errors: dict[StageKey, tuple[Array, Array]] = {}
        for key in self._stages():
            if key.kind == "reach":
                margin = _margin_errors(reference_errors.without_margin, key.row, len(inside))[inside]
                errors[key] = margin, margin
            else:
                offset, turn = reference_errors.errors[key.kind]
                errors[key] = offset[inside], turn[inside]
        return reference_errors.drawn.run.q[inside], errors

    def _stage_result(
        self, key: StageKey, tally: _StageTally, examined: int, q: Array, offset: Array, turn: Array
    ) -> JudgedStage:
        """Return what was found, given the reference model's errors (s,) in m and rad at joint values q (s, n)."""
        missing = np.isnan(offset)
        right = (offset <= TOLERANCE_FACTOR * self.tolerances.position) & (
            turn <= TOLERANCE_FACTOR * self.tolerances.rotation
        )
        wrong = np.flatnonzero(~missing & ~right)
        worst = None
        if len(wrong):
            size = offset[wrong] / self.tolerances.position + turn[wrong] / self.tolerances.rotation
            largest = int(wrong[np.argmax(size)])
            worst = (float(offset[largest]), float(turn[largest]), q[largest])
        missing_at = None
        if missing.any():
            missing_at = q[int(np.argmax(missing))]
        position = tally.position
        rotation = tally.rotation
        if key.kind == "reach":  # a margin has a value or none, but no error
            position = None
            rotation = None
        return JudgedStage(
            name=key.kind,
            judged=tally.judged,
            position=position,
            rotation=rotation,
            suspects=tally.suspects.found,
            examined=examined,
            by_reference=len(q),
            wrong=len(wrong),
            missing=int(missing.sum()),
            worst=worst,
            missing_at=missing_at,
            row=key.row,
        )


def _margin_errors(without_margin: dict[str, np.ndarray], row: str, count: int) -> Array:
    """Return an error (count,) for a row of reach: 0 with a value of the margin, NaN without one."""
    states = without_margin.get(row, np.zeros(count, bool))
    return np.where(states, np.nan, 0.0)


def _pose_errors(true: Array, Ts: Array) -> tuple[Array, Array]:
    """Return the errors (k,) in m and (k,) in rad of poses (k, 4, 4); NaN for poses that are NaN."""
    answered = np.isfinite(Ts).all(axis=(1, 2))
    offset = np.full(len(Ts), np.nan)
    turn = np.full(len(Ts), np.nan)
    offset[answered] = np.linalg.norm(Ts[answered, :3, 3] - true[answered, :3, 3], axis=1)
    turns = np.swapaxes(true[answered, :3, :3], 1, 2) @ Ts[answered, :3, :3]
    turn[answered] = spatial.rotation_angle(turns)
    return offset, turn
