"""Compare the equations with the mechanism at very many states over the joint range (`validate --samples`).

The check of every report (`joint_range`) uses the reference model at 512 states. Here, compiled kernels evaluate the
equations and close the loops of the mechanism at as many states as wanted, on a graphics processor where there is one.
The kernels only find states: the reference model, which shares no code with them, decides. It closes the loops again
at the states where the equations seem to be wrong, and at some where they seem to be right.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from twin.core import compute_device, spatial
from twin.core.findings import Finding, Kind, by_severity
from twin.core.json_types import JsonObject
from twin.core.quantity import deg, mm
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.core.units import DEG, MM, display_unit
from twin.kinematics import Kinematics
from twin.kinematics.closed_loops import ClosedStates, LoopSolver
from twin.kinematics.closed_loops.passive_limits import PassiveCheck
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel
from twin.reference.closing import Closing
from twin.reference.joint_range import JointRange, draws, ends, within_limits
from twin.validation.joint_range import SLACK, beyond_reach, range_errors, reads_orientation
from twin.validation.rows import Tolerances

_BLOCK = 1 << 18
"""Number of states that are computed together: more of them need more memory, and are not faster."""

_SUSPECTS = 256
"""Maximum number of suspected states that the reference model judges, spread evenly over all."""

_CONFIRMED = 64
"""Number of states without a suspicion that the reference model judges as well."""

_PILOT = 2048
"""Number of states over the whole range that tell whether most states are possible."""

_ENOUGH = 0.5
"""Fraction of these states that must be possible; else, states are drawn on lines from the rest poses."""

_SEEN = 1000
"""Number of poses at which it is found out whether the inverse equations read the orientation."""

_REACH = "reach "
"""What the names of tallies of rows of reach begin with."""

_DIFFERS = Kind(
    "samples.differs",
    "disagreement",
    "look for a quadrant (atan for atan2), a sign or a branch; `twin explain` searches for an edit",
    word="tolerance",
)
_NO_ANSWER = Kind(
    "samples.no_answer",
    "disagreement",
    "extend the equations, or state where they end by a row of `reach` in the formula",
    word="",
)
_NO_MARGIN = Kind(
    "samples.no_margin",
    "disagreement",
    "let the row of `reach` have a value at all states: negative where the equations do not hold",
    word="",
)
_UNDECIDED = Kind(
    "samples.undecided",
    "error",
    "give --samples fewer states, or compare along protocols through these states",
    word="",
)
_NOTHING = Kind("samples.nothing", "error", "check the limits of the joints and the rest poses", word="")


@dataclass(frozen=True)
class JudgedStage:
    """What was found about the inverse equations, about the forward equations, or about a row of reach.

    Attributes:
        name: "inverse", "forward" or "reach".
        judged: number of states at which the equations were compared.
        position, rotation: largest errors in m and rad, over the states without a suspicion; None if all states are
            suspected, and for a row of reach.
        suspects: number of states at which the kernels find no result, or an error above the tolerance.
        examined: number of suspects that the reference model has judged.
        by_reference: number of states that the reference model has judged: examined ones, and some without a suspicion.
        wrong: number of these at which an error is above the tolerance.
        missing: number of these without a result of the equations.
        worst: errors in m and rad, and the joint values (n,) at which they occur, at that of the wrong states where
            they are largest, each relative to its tolerance; None if there is no wrong state with a result.
        missing_at: joint values (n,) of a state without a result; None if there is none.
        row: name of the row of reach, if the stage is one: a margin has no error, but may have no value.
    """

    name: str
    judged: int
    position: float | None
    rotation: float | None
    suspects: int
    examined: int
    by_reference: int
    wrong: int
    missing: int
    worst: tuple[float, float, Array] | None = None
    missing_at: Array | None = None
    row: str = ""

    @property
    def subject(self) -> str:
        """What the stage is about, as text."""
        return f"the row '{self.row}' of reach" if self.row else f"the {self.name} equations"

    @property
    def share(self) -> str:
        """How many of the judged states are suspected, as text."""
        return f"{self.suspects} of {self.judged} states ({_percent(self.suspects, self.judged)})"

    def cells(self) -> tuple[str, ...]:
        """Return the row of the stage in the table of the text."""
        name = f"{self.name}, {self.row}" if self.row else self.name
        error = "-"
        if self.position is not None and self.rotation is not None:
            error = f"{self.position / MM:.2g} mm, {self.rotation / DEG:.2g}°"
        counts = (self.suspects, self.examined, self.wrong, self.missing)
        return (name, str(self.judged), error, *(str(count) for count in counts))


@dataclass(frozen=True)
class RangeSamples(Result):
    """Comparison of equations and mechanism at many states over the joint range.

    Attributes:
        robot: name of the robot.
        samples: number of states that were drawn.
        on_lines: whether the states are drawn on lines from the rest poses to states over the whole range, because few
            states of the whole range are possible.
        possible: number of states that the mechanism can take, within its limits.
        beyond: number of possible states that are beyond the reach that the equations state; they are not judged.
        tolerance: largest errors in m and rad that count as agreement.
        stages: what was found about inverse and forward equations, and about rows of reach without a value.
        unsuspected: number of judged states without a suspicion.
        confirmed: number of these that the reference model has judged as well.
        device: what has computed the kernels, see `ComputeDevice.name`.
        mechanism: the mechanism, for names and units of joints.
    """

    robot: str
    samples: int
    on_lines: bool
    possible: int
    beyond: int
    tolerance: tuple[float, float]
    stages: tuple[JudgedStage, ...]
    unsuspected: int
    confirmed: int
    device: str
    mechanism: Mechanism = field(repr=False)

    kind = "samples"

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on equations that are wrong or without a result; if there are none, on what was not decided."""
        if self.possible == self.beyond:
            return (_NOTHING("mechanism", f"none of {self.samples} states over the joint range could be judged"),)
        faults: list[Finding] = []
        for stage in self.stages:
            faults += self._of_stage(stage)
        # What is wrong at some states is wrong, whatever was not decided at others.
        return tuple(faults or self._undecided())

    def _undecided(self) -> list[Finding]:
        """Return findings on states that the reference model could not judge."""
        findings: list[Finding] = []
        for stage in self.stages:
            if stage.examined < stage.suspects:
                text = (
                    f"over the joint range, the compiled kernels suspect {stage.subject} at {stage.share}; the "
                    f"reference model judged {stage.examined} of these, and found nothing wrong there"
                )
                findings.append(_UNDECIDED(stage.row or stage.name, text))
        asked = min(_CONFIRMED, self.unsuspected)
        if self.confirmed < asked:
            text = (
                f"over the joint range, the reference model could judge only {self.confirmed} of {asked} states at "
                "which the compiled kernels suspect nothing"
            )
            way_out = "compare along protocols, by `twin validate` without --samples"
            findings.append(_UNDECIDED("mechanism", text, suggestion=way_out))
        return findings

    def _of_stage(self, stage: JudgedStage) -> list[Finding]:
        """Return findings on equations of a stage that are wrong or without a result."""
        findings = []
        judged = f"{stage.by_reference} states that the reference model judged"
        suspected = f"the compiled kernels suspect {stage.share}"
        if stage.worst is not None:
            position, rotation, q = stage.worst
            size = mm(position)
            limit = mm(self.tolerance[0])
            if position <= self.tolerance[0]:
                size = deg(rotation)
                limit = deg(self.tolerance[1])
            text = (
                f"over the joint range, {stage.subject} are wrong at {stage.wrong} of {judged}; {suspected}; the "
                "largest error of those judged"
            )
            findings.append(_DIFFERS(stage.name, text, size, limit, when=self._state(q), cause=stage.name))
        if stage.missing_at is not None:
            kind = _NO_ANSWER
            fault = "give no result"
            if stage.row:
                kind = _NO_MARGIN
                fault = "has no value"
            text = (
                f"over the joint range, {stage.subject} {fault} at {stage.missing} of {judged} and that the mechanism "
                f"can take; {suspected}"
            )
            findings.append(kind(stage.row or stage.name, text, when=self._state(stage.missing_at), cause=stage.name))
        return findings

    def _state(self, q: Array) -> str:
        """Return joint values (n,) as text, in mm and degrees."""
        parts = []
        for joint, value in zip(self.mechanism.active, q, strict=True):
            unit, scale = display_unit(joint.is_angle)
            parts.append(f"{joint.name} = {value / scale:.3f} {unit}")
        return ", ".join(parts)

    def content(self) -> JsonObject:
        """Return the comparison as plain data in SI units."""
        stages = []
        for stage in self.stages:
            stages.append(
                {
                    "equations": stage.name,
                    "row": stage.row,
                    "judged": stage.judged,
                    "position_max": stage.position,
                    "rotation_max": stage.rotation,
                    "suspects": stage.suspects,
                    "examined": stage.examined,
                    "judged_by_reference": stage.by_reference,
                    "wrong": stage.wrong,
                    "without_result": stage.missing,
                }
            )
        return {
            "robot": self.robot,
            "samples": self.samples,
            "drawn": "on lines from the rest poses" if self.on_lines else "over the whole range",
            "possible": self.possible,
            "beyond_reach": self.beyond,
            "tolerance": list(self.tolerance),
            "unsuspected": self.unsuspected,
            "confirmed_by_reference": self.confirmed,
            "device": self.device,
            "stages": stages,
        }

    def text(self) -> Iterator[Part]:
        """Yield what was drawn, a row for each stage, who has judged, the findings and the verdict."""
        yield f"{self.robot} · equations and mechanism at {self.samples} states over the joint range · {self.device}"
        if self.on_lines:
            yield "  few states of the whole range are possible: drawn on lines from the rest poses to such states"
        yield f"  {self.possible} states are possible ({_percent(self.possible, self.samples)})"
        if self.beyond:
            yield f"  {self.beyond} of them are beyond the reach that the equations state, and are not judged"
        yield ""
        largest = "largest error of the unsuspected"
        header = ("equations", "judged", largest, "suspected", "examined", "wrong", "none")
        yield TextTable(header, [stage.cells() for stage in self.stages])
        yield "  suspected: by the compiled kernels; examined: suspected states that the reference model judged;"
        yield "  wrong, none: states with a wrong result, or without one, by the reference model"
        yield f"  the reference model also judged {self.confirmed} of {self.unsuspected} states without a suspicion"
        yield ""
        yield from by_severity(self.findings)
        verdicts = {
            "agree": f"AGREE: equations and mechanism agree over the joint range, {self.possible - self.beyond} states",
            "disagree": "DISAGREE: the equations are wrong, or have no result, in a part of the joint range",
            "unchecked": "UNCHECKED: not all that was drawn could be judged",
        }
        yield f"  {verdicts[self.verdict]} (exit code {self.exit_code})"
        yield ""


def _percent(some: int, of: int) -> str:
    return f"{100 * some / max(of, 1):.3g} %"


@dataclass
class _Tally:
    """What the kernels have found about one stage so far."""

    judged: int = 0
    position: float | None = None  # largest errors of the states without a suspicion
    rotation: float | None = None
    suspects: int = 0
    kept: Array | None = None  # joint values of suspects (s, n), spread over all
    every: int = 1  # one in so many suspects is kept
    # largest error by the kernels, relative to the tolerances, and its joint values (n,)
    worst: tuple[float, Array] = (-1.0, np.zeros(0))

    def add(self, q: Array, offset: Array, turn: Array, tolerances: Tolerances) -> np.ndarray:
        """Add errors (k,) in m and rad at joint values q (k, n); return (k,) bool: whether a state is suspected."""
        right = (offset <= SLACK * tolerances.position) & (turn <= SLACK * tolerances.rotation)
        self.judged += len(q)
        if right.any():
            self.position = max(self.position or 0.0, float(offset[right].max()))
            self.rotation = max(self.rotation or 0.0, float(turn[right].max()))
        suspected = np.flatnonzero(~right)
        if len(suspected):
            # positions of the suspects among all that were found so far
            numbers = self.suspects + np.arange(len(suspected))
            self.suspects += len(suspected)
            new = q[suspected[numbers % self.every == 0]]
            self.kept = new if self.kept is None else np.concatenate([self.kept, new])
            while len(self.kept) > 2 * _SUSPECTS:
                self.kept = self.kept[::2]
                self.every *= 2
            size = offset[suspected] / tolerances.position + turn[suspected] / tolerances.rotation
            size = np.nan_to_num(size, nan=-1.0)
            largest = int(np.argmax(size))
            if size[largest] > self.worst[0]:
                self.worst = (float(size[largest]), q[suspected[largest]].copy())
        return ~right

    def examined(self) -> Array:
        """Return joint values of at most `_SUSPECTS` suspects (s, n), the one with the largest error first."""
        if self.kept is None:
            return np.zeros((0, len(self.worst[1])))
        kept = self.kept
        if len(kept) > _SUSPECTS:
            kept = kept[np.linspace(0, len(kept) - 1, _SUSPECTS).astype(int)]
        if self.worst[0] >= 0 and not (kept == self.worst[1]).all(axis=1).any():
            kept = np.concatenate([self.worst[1][None], kept[: _SUSPECTS - 1]])
        return kept


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

    def judge(self, samples: int, progress: Callable[[str, float], None]) -> RangeSamples:
        """Return the comparison at `samples` states; always the same states for the same number."""
        tallies: dict[str, _Tally] = {}
        for name, exists in (("inverse", self.kin.closed_inverse), ("forward", self.kin.closed_forward)):
            if exists:
                tallies[name] = _Tally()
        for row in self.kin.formula.scalars["reach"]:
            tallies[_REACH + row] = _Tally()
        possible_count = 0
        beyond_count = 0
        unsuspected_count = 0
        unsuspected = np.zeros((0, len(self._rest)))
        for first in range(0, samples, _BLOCK):
            last = min(first + _BLOCK, samples)
            q = self._drawn(first, last, self._on_lines)
            closed = self.loops.forward_many(q)
            possible = self._possible(q, closed)
            possible_count += int(possible.sum())
            beyond, without_margin = self._reach(q[possible], closed.Ts_base_tool[possible])
            beyond_count += int(beyond.sum())
            rows = np.flatnonzero(possible)[~beyond]
            without_margin = {name: states[~beyond] for name, states in without_margin.items()}
            block = q[rows], closed.Ts_base_tool[rows], closed.states[rows]
            suspected = self._block(*block, without_margin, tallies)
            unsuspected_count += int((~suspected).sum())
            if len(unsuspected) < _CONFIRMED:
                unsuspected = np.concatenate([unsuspected, q[rows[~suspected]][:_CONFIRMED]])
            progress(f"{samples:.3g} states", last / samples)
        progress("reference model", 0.0)
        confirmed, stages = self._decided(tallies, unsuspected[:_CONFIRMED])
        limit = (SLACK * self.tolerances.position, SLACK * self.tolerances.rotation)
        device = compute_device.current().name
        return RangeSamples(
            self.robot,
            samples,
            self._on_lines,
            possible_count,
            beyond_count,
            limit,
            stages,
            unsuspected_count,
            confirmed,
            device,
            self.model.mechanism,
        )

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
        parts = draws(first + 1, last + 1, len(low) + 1)
        target = low + parts[:, :-1] * (high - low)
        return self._rest + parts[:, -1:] * (target - self._rest)

    @cached_property
    def _on_lines(self) -> bool:
        """Whether few states of the whole range are possible, so that states are drawn on lines."""
        q = self._drawn(0, _PILOT, on_lines=False)
        possible = self._possible(q, self.loops.forward_many(q))
        return bool(possible.mean() < _ENOUGH)

    @cached_property
    def _reads(self) -> bool:
        """Whether the inverse equations read the orientation: decided once, for kernels and reference model."""
        q = self._drawn(0, _SEEN, self._on_lines)
        closed = self.loops.forward_many(q)
        Ts = closed.Ts_base_tool[self._possible(q, closed)]
        return not len(Ts) or reads_orientation(self.kin, Ts)

    def _possible(self, q: Array, closed: ClosedStates) -> np.ndarray:
        """Return (k,) bool: whether the loops close at joint values q (k, n), within the limits of passive joints."""
        possible = np.asarray(np.isfinite(closed.Ts_base_tool).all(axis=(1, 2)), bool)
        if self.passive is not None:
            possible[possible] = self.passive.within(q[possible], closed.states[possible])
        return possible

    def _reach(self, q: Array, Ts: Array) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return (whether states are beyond a row of reach, (k,) bool; `RangeErrors.without_margin`)."""
        outside = np.zeros(len(q), bool)
        if not len(q):
            return outside, {}
        beyond, without_margin = beyond_reach(self.kin, q, Ts)
        for states in beyond.values():
            outside |= states
        return outside, without_margin

    def _block(
        self,
        q: Array,
        Ts: Array,
        states: Array,
        without_margin: dict[str, np.ndarray],
        tallies: dict[str, _Tally],
    ) -> np.ndarray:
        """Compare the equations at states of the mechanism; return (k,) bool: whether a state is suspected."""
        suspected = np.zeros(len(q), bool)
        if not len(q):
            return suspected
        for name, tally in tallies.items():
            if name.startswith(_REACH):
                offset = turn = _of_margin(without_margin, name, len(q))
            elif name == "inverse":
                offset, turn = self._of_inverse(q, Ts, states)
            else:
                offset, turn = _errors(Ts, self.kin.forward_many(q))
            suspected |= tally.add(q, offset, turn, self.tolerances)
        return suspected

    def _of_inverse(self, q: Array, Ts: Array, states: Array) -> tuple[Array, Array]:
        """Return the errors (k,) in m and rad of the inverse equations: NaN without a result.

        The error is 0 where the equations give the joint values of the state; else, it is that of the mechanism's pose
        at the joint values that they give, infinite if its loops do not close there.
        """
        kin = self.kin
        answer = kin.inverse_many(Ts)
        answer[:, kin.auxiliary] = q[:, kin.auxiliary]
        answered = np.isfinite(answer).all(axis=1)
        difference = answer - q
        turns = np.round(difference / (2 * np.pi))
        difference[:, kin.revolute] -= 2 * np.pi * turns[:, kin.revolute]
        limit = np.where(kin.revolute, self.tolerances.rotation, self.tolerances.position)
        is_own_mode = answered & (np.abs(difference) <= limit).all(axis=1)
        other = np.flatnonzero(answered & ~is_own_mode)
        offset = np.where(answered, 0.0, np.nan)
        turn = offset.copy()
        if len(other):
            found = self.loops.forward_many(answer[other], states[other]).Ts_base_tool
            if not self._reads:
                found[:, :3, :3] = Ts[other, :3, :3]  # in another working mode, a position has another orientation
            offset[other], turn[other] = _errors(Ts[other], found)
            open_loops = np.isnan(offset[other])
            offset[other[open_loops]] = np.inf
            turn[other[open_loops]] = np.inf
        return offset, turn

    def _decided(self, tallies: dict[str, _Tally], unsuspected: Array) -> tuple[int, tuple[JudgedStage, ...]]:
        """Return (number of unsuspected states that the reference model judged, what it finds about each stage).

        Rows of reach without a suspicion are left out.
        """
        closing = Closing(self.model, np.ones(len(self._rest)))
        confirming = self._judged_by_reference(closing, unsuspected)
        stages = []
        for name, tally in tallies.items():
            if name.startswith(_REACH) and not tally.suspects:
                continue
            examining = self._judged_by_reference(closing, tally.examined())
            q = np.zeros((0, len(self._rest)))
            offset = np.zeros(0)
            turn = np.zeros(0)
            for judged in (examining, confirming):
                if judged is None:
                    continue
                states, errors = judged
                q = np.concatenate([q, states])
                offset = np.concatenate([offset, errors[name][0]])
                turn = np.concatenate([turn, errors[name][1]])
            examined = 0 if examining is None else len(examining[0])
            stages.append(self._stage(name, tally, examined, q, offset, turn))
        return 0 if confirming is None else len(confirming[0]), tuple(stages)

    def _judged_by_reference(self, closing: Closing, q: Array) -> tuple[Array, dict[str, tuple[Array, Array]]] | None:
        """Return (joint values (s, n), errors of the stages) by the reference model at those of q that it can take."""
        if not len(q):
            return None
        states, closed = closing.states(q)
        states = states[closed]
        states = states[within_limits(self.model, states)]
        if not len(states):
            return None
        drawn = JointRange(self.model.collect(states), *self._ends)
        reads = self._reads if self.kin.closed_inverse else None
        found = range_errors(self.kin, self.model, self.tolerances, drawn, free_angles=False, reads=reads)
        inside = found.inside
        errors = {}
        for name, (offset, turn) in found.errors.items():
            errors[name] = offset[inside], turn[inside]
        for row in self.kin.formula.scalars["reach"]:
            name = _REACH + row
            margin = _of_margin(found.without_margin, name, len(inside))[inside]
            errors[name] = margin, margin
        return found.drawn.run.q[inside], errors

    def _stage(self, name: str, tally: _Tally, examined: int, q: Array, offset: Array, turn: Array) -> JudgedStage:
        """Return what was found, given the reference model's errors (s,) in m and rad at joint values q (s, n)."""
        missing = np.isnan(offset)
        right = (offset <= SLACK * self.tolerances.position) & (turn <= SLACK * self.tolerances.rotation)
        wrong = ~missing & ~right
        worst = None
        if wrong.any():
            size = np.where(wrong, offset / self.tolerances.position + turn / self.tolerances.rotation, -1.0)
            k = int(np.argmax(size))
            worst = (float(offset[k]), float(turn[k]), q[k])
        missing_at = q[int(np.argmax(missing))] if missing.any() else None
        row = ""
        position = tally.position
        rotation = tally.rotation
        if name.startswith(_REACH):
            row = name.removeprefix(_REACH)
            name = "reach"
            position = rotation = None
        return JudgedStage(
            name,
            tally.judged,
            position,
            rotation,
            tally.suspects,
            examined,
            len(q),
            int(wrong.sum()),
            int(missing.sum()),
            worst,
            missing_at,
            row,
        )


def _of_margin(without_margin: dict[str, np.ndarray], name: str, count: int) -> Array:
    """Return an error (count,) for the row of reach of this tally: 0 with a value of the margin, NaN without one."""
    states = without_margin.get(name.removeprefix(_REACH), np.zeros(count, bool))
    return np.where(states, np.nan, 0.0)


def _errors(true: Array, Ts: Array) -> tuple[Array, Array]:
    """Return the errors (k,) in m and (k,) in rad of poses (k, 4, 4); NaN for poses that are NaN."""
    answered = np.isfinite(Ts).all(axis=(1, 2))
    offset = np.full(len(Ts), np.nan)
    turn = np.full(len(Ts), np.nan)
    offset[answered] = np.linalg.norm(Ts[answered, :3, 3] - true[answered, :3, 3], axis=1)
    turns = np.swapaxes(true[answered, :3, :3], 1, 2) @ Ts[answered, :3, :3]
    turn[answered] = spatial.rotation_angle(turns)
    return offset, turn
