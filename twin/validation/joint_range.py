"""Compare the equations with the mechanism over the whole joint range; a protocol is only a small part of it.

An inverse that uses atan instead of atan2 is right near home and wrong behind the robot. Therefore the mechanism is put
into states all over its joint range (`reference.joint_range`), and the equations are evaluated at the tool poses and at
the joint values of these states. Joint values of another solution of the same pose are right: the mechanism is driven
to them, and its tool pose is compared. In a redundant mechanism, an angle that only the inverse reads (a swivel angle)
selects one of many solutions. It may have any value, so the inverse is also evaluated with another one: at the
published value, usually zero, terms vanish that are wrong elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core import spatial
from twin.core.findings import Kind
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.core.units import DEG, ROUNDING, display_unit
from twin.formula.contract import arguments
from twin.kinematics import Kinematics, compile_formula
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel, SolvedSamples
from twin.reference.joint_range import JointRange, joint_range
from twin.reference.loop_closing import Closing
from twin.validation.equations_comparison import EquationsComparison
from twin.validation.residual_rows import Tolerances, rotation_vectors
from twin.validation.result import Residual

HEADING = "joint range"

TOLERANCE_FACTOR = 10.0
"""Factor on the tolerances of the protocol: singularities at the ends of the range magnify rounding errors."""

_ANGLE_CHANGE = 0.4
"""Change in rad of an angle that selects one solution of a redundant mechanism."""

_WHOLE_RANGE_PART = 0.98
"""Fraction of a joint's range from which it counts as reached: finitely many states miss the very ends."""

_DIFFERS = Kind(
    "range.differs",
    "disagreement",
    "the equations are wrong in a part of the joint range: look for a quadrant (atan for atan2), a sign or a branch",
    word="tolerance",
)
_VANISHING_TERM_ADVICE = "the equations must hold for every value: look for a term that vanishes at the published value"
_FOLLOWS = Kind("range.differs", "info", word="tolerance")
_NO_ANSWER = Kind(
    "range.no_answer",
    "disagreement",
    "extend the equations, or state where they end by a row of `reach` in the formula",
    word="",
)
_NO_ANSWER_FOLLOWS = Kind("range.no_answer", "info", word="")
_NO_MARGIN = Kind(
    "range.no_margin",
    "disagreement",
    "let the row of `reach` have a value at all states: negative where the equations do not hold",
    word="",
)
_NO_MARGIN_FOLLOWS = Kind("range.no_margin", "info", word="")


@dataclass(frozen=True)
class RangeErrors:
    """Errors of the equations at states all over the joint range.

    Attributes:
        drawn: the states (k).
        beyond: {name of a row of reach: (k,) bool}, whether a state is beyond it, for rows that exclude any state.
        without_margin: {name of a row of reach: (k,) bool}, whether it is NaN at a state that no row excludes, for rows
            that are NaN at any. Such states are judged.
        errors: {"inverse" or "forward": errors of the tool pose, (k,) in m and (k,) in rad}; NaN without a result,
            infinite if the mechanism cannot take the joint values of the equations.
        own: (k,) bool, whether the inverse gives the joint values of the state, not those of another solution.
        other_values: errors of the inverse, as in `errors`, if a redundant mechanism's free angle has another value;
            by name and value of the angle. States without a result at this value are not judged.
    """

    drawn: JointRange
    beyond: dict[str, np.ndarray]
    without_margin: dict[str, np.ndarray]
    errors: dict[str, tuple[Array, Array]]
    own: np.ndarray
    other_values: dict[str, tuple[Array, Array]]

    @property
    def inside(self) -> np.ndarray:
        """Whether each state (k,) is within the reach that the equations state."""
        is_inside = np.ones(len(self.drawn.run.x), bool)
        for beyond in self.beyond.values():
            is_inside &= ~beyond
        return is_inside

    def wrong(self, tolerances: Tolerances) -> np.ndarray:
        """Return (k,) bool: whether any equations have no result, or an error above the tolerance."""
        is_wrong = np.zeros(len(self.drawn.run.x), bool)
        for offset, turn in self.errors.values():
            right = (offset <= TOLERANCE_FACTOR * tolerances.position) & (
                turn <= TOLERANCE_FACTOR * tolerances.rotation
            )
            is_wrong |= self.inside & ~right
        return is_wrong


def range_errors(
    kin: Kinematics,
    model: ReferenceModel,
    tolerances: Tolerances,
    drawn: JointRange | None = None,
    *,
    free_angles: bool = True,
    reads: bool | None = None,
) -> RangeErrors:
    """Return the errors of the equations at the states `drawn`; default: those of `reference.joint_range`.

    Args:
        kin: the compiled equations.
        model: the reference model.
        tolerances: see `TOLERANCE_FACTOR`.
        drawn: the states.
        free_angles: whether to evaluate `RangeErrors.other_values` too.
        reads: whether the inverse equations read the orientation; None: as `reads_orientation` finds at the states.
    """
    if drawn is None:
        drawn = joint_range(model)
    is_own_mode = np.ones(len(drawn.run.x), bool)
    errors = {}
    if kin.closed_inverse:
        offset, turn, is_own_mode = _inverse_errors(kin, model, drawn, tolerances, reads)
        errors["inverse"] = offset, turn
    if kin.closed_forward:
        errors["forward"] = _forward_pose_errors(kin, drawn)
    other_values = {}
    angles = []
    if free_angles:
        angles = _free_angles(kin, model)
    for angle in angles:
        # compiled anew, because parameters are constants of the compiled equations
        changed_value = kin.parameters[angle.name] + _ANGLE_CHANGE
        changed_parameters = {**kin.parameters, angle.name: changed_value}
        extra_joints = model.mechanism.extra_joints(joint.name for joint in kin.formula.joints)
        changed = compile_formula(kin.formula, kin.variants, changed_parameters, extra_joints)
        offset, turn, _ = _inverse_errors(changed, model, drawn, tolerances, reads)
        is_judged = np.isfinite(offset)
        name = f"inverse, {angle.name} = {changed_value / DEG:.0f} deg"
        other_values[name] = np.where(is_judged, offset, np.nan), np.where(is_judged, turn, np.nan)
    beyond, without_margin = beyond_reach(kin, drawn.run.q, drawn.run.Ts_base_tool)
    return RangeErrors(
        drawn, beyond=beyond, without_margin=without_margin, errors=errors, own=is_own_mode, other_values=other_values
    )


def _free_angles(kin: Kinematics, model: ReferenceModel) -> list[Parameter]:
    """Return the assumed angles that inverse equations read and forward equations do not, if the robot is redundant."""
    if not (kin.closed_inverse and kin.closed_forward and model.redundant):
        return []
    read: dict[str, set[str]] = {"inverse": set(), "forward": set(), "helper": set()}
    for equation in kin.formula.equations:
        variant = kin.variants.get(equation.name, equation.default)
        required, optional = arguments(equation.variants[variant])
        read[equation.stage].update(required, optional)
    only_inverse = read["inverse"] - read["forward"]
    free: list[Parameter] = []
    for parameter in kin.formula.parameters:
        is_angle = parameter.unit in ("deg", "rad")
        if is_angle and parameter.provenance == "ASSUMED" and parameter.name in only_inverse:
            free.append(parameter)
    return free


def whole_range(
    kin: Kinematics, model: ReferenceModel, tolerances: Tolerances, comparison: EquationsComparison
) -> None:
    """Add rows, findings and facts of the comparison over the joint range to `comparison`."""
    if not model.mechanism.active:
        return
    errors = range_errors(kin, model, tolerances)
    inside = errors.inside
    if not inside.any():
        return
    comparison.facts[HEADING] = _facts(errors.drawn, inside, errors.beyond, model.mechanism)
    # a row of the protocol that disagrees is the better place to look: these rows then follow from it
    wrong_before = ""
    for residual in comparison.residuals:
        if residual.pair == "A-B" and not residual.agrees:
            wrong_before = residual.name
            break
    judge = _RangeJudge(
        drawn=errors.drawn,
        inside=inside,
        mechanism=model.mechanism,
        tolerances=tolerances,
        wrong_before=wrong_before,
        comparison=comparison,
    )
    for name, states in errors.without_margin.items():
        judge.no_margin(name, states)
    for name, (offset, turn) in errors.errors.items():
        judge.rows(name, offset, turn)
    for name, (offset, turn) in errors.other_values.items():
        judge.compared(name, offset, turn)


def beyond_reach(kin: Kinematics, q: Array, Ts: Array) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the states beyond the reach that the equations state, and those at which they state none.

    `q` (k, n) and `Ts` (k, 4, 4) are joint values and tool poses. For `beyond` and `without_margin` see `RangeErrors`.
    """
    beyond: dict[str, np.ndarray] = {}
    unknown: dict[str, np.ndarray] = {}
    if kin.closed_inverse:
        for name, margin in kin.reach(Ts=Ts).items():
            beyond[name] = margin < 0
            unknown[name] = np.isnan(margin)
    if kin.closed_forward:
        for name, margin in kin.reach(qs=q).items():
            beyond[name] = beyond.get(name, margin < 0) | (margin < 0)
            # with an inverse, the margins are known at the true poses; those of wrong forward equations do not count
            unknown.setdefault(name, np.isnan(margin))
    outside = np.zeros(len(q), bool)
    for states in beyond.values():
        outside |= states
    excluding: dict[str, np.ndarray] = {}
    for name, states in beyond.items():
        if states.any():
            excluding[name] = states
    without_margin: dict[str, np.ndarray] = {}
    for name, states in unknown.items():
        unknown_inside = states & ~outside
        if unknown_inside.any():
            without_margin[name] = unknown_inside
    return excluding, without_margin


def _inverse_errors(
    kin: Kinematics, model: ReferenceModel, range_states: JointRange, tolerances: Tolerances, reads: bool | None
) -> tuple[Array, Array, np.ndarray]:
    """Return the errors of the inverse equations (see `RangeErrors`): (k,) in m, (k,) in rad, and `own` (k,).

    The error is 0 where the equations give the joint values of the state.
    """
    Ts, is_own_mode = poses_by_inverse(kin, model, range_states.run, tolerances, reads)
    true = range_states.run.Ts_base_tool
    is_other_mode = np.isfinite(Ts).all(axis=(1, 2)) & ~is_own_mode
    offset = np.where(np.isnan(Ts).any(axis=(1, 2)), np.nan, np.inf)
    offset[is_own_mode] = 0.0
    turn = offset.copy()
    offset[is_other_mode] = np.linalg.norm(Ts[is_other_mode, :3, 3] - true[is_other_mode, :3, 3], axis=1)
    turn[is_other_mode] = np.linalg.norm(rotation_vectors(true[is_other_mode], Ts[is_other_mode]), axis=1)
    return offset, turn, is_own_mode


def poses_by_inverse(
    kin: Kinematics, model: ReferenceModel, run: SolvedSamples, tolerances: Tolerances, reads: bool | None = None
) -> tuple[Array, np.ndarray]:
    """Return (tool poses (k, 4, 4) of the mechanism at the joint values that the inverse gives for its states, `own`).

    `own` (k,) says whether the inverse gives the joint values of the state; otherwise the mechanism is driven to its
    values. Poses are NaN without a result, infinite if the mechanism cannot take the joint values. For `reads` see
    `range_errors`.
    """
    q = kin.inverse_many(run.Ts_base_tool)
    q[:, kin.auxiliary] = run.q[:, kin.auxiliary]
    difference = q - run.q
    turns = np.round(difference / (2 * np.pi))
    difference[:, kin.revolute] -= 2 * np.pi * turns[:, kin.revolute]
    limit = np.where(kin.revolute, tolerances.rotation, tolerances.position)
    answered = np.isfinite(q).all(axis=1)
    is_own_mode = np.logical_and(answered, (np.abs(difference) <= limit).all(axis=1))
    poses = run.Ts_base_tool.copy()
    poses[~answered] = np.nan
    other_rows = np.flatnonzero(answered & ~is_own_mode)
    if not len(other_rows):
        return poses, is_own_mode
    # The mechanism is driven to the values of another solution: its tool must then be at the same pose.
    true = run.Ts_base_tool[other_rows]
    poses[other_rows] = np.inf
    smallest_error = np.full(len(q), np.inf)
    if reads is None:
        reads = reads_orientation(kin, run.Ts_base_tool)
    # the walks to the other solutions start from the judged states, which are closed
    closing = Closing(model, np.ones(q.shape[1]))
    closing.store(run.q, run.x)
    # Full turns change no pose, but a walk from the known states may reach only one of the values.
    within_one_turn = np.where(kin.revolute, (q + np.pi) % (2 * np.pi) - np.pi, q)
    nearest_turn = run.q + difference
    tried_values: list[Array] = []
    for values in (q, within_one_turn, nearest_turn):
        new = np.ones(len(other_rows), bool)
        for before in tried_values:
            new &= np.abs(values - before)[other_rows].max(axis=1) > ROUNDING
        tried_values.append(values)
        rows = other_rows[new]
        if not len(rows):
            continue
        states, possible = closing.states(values[rows])
        Ts = model.collect(states).Ts_base_tool
        if not reads:
            Ts[:, :3, :3] = true[new, :3, :3]  # in another working mode, a position has another orientation
        error = np.linalg.norm(Ts[:, :3, 3] - true[new, :3, 3], axis=1)
        error += np.linalg.norm(rotation_vectors(true[new], Ts), axis=1)
        nearer = possible & (error < smallest_error[rows])
        poses[rows[nearer]] = Ts[nearer]
        smallest_error[rows[nearer]] = error[nearer]
    return poses, is_own_mode


def reads_orientation(kin: Kinematics, Ts: Array) -> bool:
    """Return whether the inverse equations depend on the orientation of tool poses (k, 4, 4).

    They count as dependent unless all derivatives are known at some of the poses, and all that are known are zero.
    """
    rates = kin.inverse_jacobian_many(Ts=Ts)[:, :, 3:]
    zero = (rates == 0) | np.isnan(rates)
    is_known = np.isfinite(rates).all(axis=(1, 2))
    return not (is_known.any() and zero.all())


def _forward_pose_errors(kin: Kinematics, range_states: JointRange) -> tuple[Array, Array]:
    """Return the errors (k,) in m and (k,) in rad of the tool poses of the forward equations; NaN without a pose."""
    true = range_states.run.Ts_base_tool
    Ts = kin.forward_many(range_states.run.q)
    finite = np.isfinite(Ts).all(axis=(1, 2))
    offset = np.full(len(Ts), np.nan)
    turn = offset.copy()
    offset[finite] = np.linalg.norm(Ts[finite, :3, 3] - true[finite, :3, 3], axis=1)
    turn[finite] = spatial.rotation_angle(np.swapaxes(true[finite, :3, :3], 1, 2) @ Ts[finite, :3, :3])
    return offset, turn


@dataclass(frozen=True)
class _RangeJudge:
    """Turns errors at the states into rows and findings.

    Attributes:
        drawn: the states (k).
        inside: (k,) bool, whether a state is within the reach that the equations state.
        mechanism, tolerances: see `whole_range`.
        wrong_before: name of a row of the protocol that disagrees, and may be the cause; "" if none does.
        comparison: the comparison to fill.
    """

    drawn: JointRange
    inside: np.ndarray
    mechanism: Mechanism
    tolerances: Tolerances
    wrong_before: str
    comparison: EquationsComparison

    def rows(self, name: str, offset: Array, turn: Array) -> None:
        """Add a row for the position errors (k,) in m and one for the rotation errors (k,) in rad, and findings."""
        missing = self.inside & np.isnan(offset)
        if missing.any():
            self._no_answer(name, missing)
        self.compared(name, offset, turn)

    def compared(self, name: str, offset: Array, turn: Array) -> None:
        """Add rows and findings as `rows` does, but none on states without a result."""
        judged = self.inside & ~np.isnan(offset)
        if not judged.any():
            return
        position_limit = TOLERANCE_FACTOR * self.tolerances.position
        rotation_limit = TOLERANCE_FACTOR * self.tolerances.rotation
        position = self._row(name, "m", offset, judged=judged, limit=position_limit)
        rotation = self._row(name, "rad", turn, judged=judged, limit=rotation_limit)
        self.comparison.residuals += [position, rotation]
        wrong = judged & ((offset > position_limit) | (turn > rotation_limit))
        if not wrong.any():
            return
        residual = position
        errors = offset
        if position.agrees:
            residual = rotation
            errors = turn
        worst = int(np.argmax(np.where(wrong, errors, -1.0)))
        stage, _, value = name.partition(", ")  # "inverse, theta = 23 deg": another value of a free angle
        equations = f"{stage} equations"
        if value:
            equations += f" with {value}"
        kind = _FOLLOWS if self.wrong_before else _DIFFERS
        suggestion = ""
        if value and not self.wrong_before:
            suggestion = _VANISHING_TERM_ADVICE
        text = f"over the joint range, the {equations} are wrong at {_share_text(wrong, self.inside)}"
        finding = residual.finding(kind, text, suggestion=suggestion, when=self._state(worst), cause=stage)
        self.comparison.findings.append(finding)

    def _no_answer(self, name: str, missing: np.ndarray) -> None:
        """Add a finding on equations that give no result at states (k,) bool."""
        kind = _NO_ANSWER_FOLLOWS if self.wrong_before else _NO_ANSWER
        self._without_value(kind, name, f"the {name} equations give no result", states=missing, cause=name)

    def no_margin(self, name: str, states: np.ndarray) -> None:
        """Add a finding on a row of reach that is NaN at states (k,) bool."""
        kind = _NO_MARGIN_FOLLOWS if self.wrong_before else _NO_MARGIN
        self._without_value(kind, name, f"the row '{name}' of reach has no value", states=states, cause="reach")

    def _without_value(self, kind: Kind, name: str, what: str, states: np.ndarray, cause: str) -> None:
        """Add a finding on what the equations do not give at states (k,) bool that the mechanism can take."""
        text = f"over the joint range, {what} at {_share_text(states, self.inside)} that the mechanism can take"
        first = int(np.argmax(states))
        self.comparison.findings.append(kind(name, text, when=self._state(first), cause=cause))

    def _row(self, name: str, unit: str, error: Array, judged: np.ndarray, limit: float) -> Residual:
        """Return the row of errors (k,) in `unit`, of which those at the states `judged` (k,) bool count."""
        # an error is never negative, so that a state that is not judged is never the worst
        worst = int(np.argmax(np.where(judged, error, -1.0)))
        finite = error[judged & np.isfinite(error)]
        rms = float("nan")
        if len(finite):
            rms = float(np.sqrt(np.mean(finite**2)))
        return Residual(
            "A-B",
            "range",
            name,
            unit=unit,
            worst=float(error[worst]),
            rms=rms,
            tolerance=limit,
            t=0.0,
            phase=HEADING,
            samples=int(judged.sum()),
            consequence_of=self.wrong_before,
            note=f"largest at {self._state(worst)}",
        )

    def _state(self, k: int) -> str:
        """Return the joint values of state k as text, in mm and degrees."""
        parts = []
        for joint, value in zip(self.mechanism.active, self.drawn.run.q[k], strict=True):
            unit, scale = display_unit(joint.is_angle)
            parts.append(f"{joint.name} = {value / scale:.1f} {unit}")
        return ", ".join(parts)


def _share_text(states: np.ndarray, all_states: np.ndarray) -> str:
    """Return "n of k states (p %)"."""
    return f"{states.sum()} of {all_states.sum()} states ({100 * states.sum() / all_states.sum():.0f} %)"


def _facts(
    range_states: JointRange, inside: np.ndarray, beyond: dict[str, np.ndarray], mechanism: Mechanism
) -> dict[str, str]:
    """Return what was judged: share and number of states, excluded states, and the range of each joint."""
    facts = {"judged": f"{100 * inside.mean():.0f} % of the joint range, {inside.sum()} states"}
    for name, states in beyond.items():
        facts[f"beyond '{name}' of the equations"] = f"{100 * states.mean():.0f} % of the states, not judged"
    values = range_states.run.q
    for i, joint in enumerate(mechanism.active):
        unit, scale = display_unit(joint.is_angle)
        first = values[:, i].min() / scale
        last = values[:, i].max() / scale
        text = f"{first:.1f} .. {last:.1f} {unit}"
        if range_states.share[i] < _WHOLE_RANGE_PART:
            low = range_states.low[i] / scale
            high = range_states.high[i] / scale
            text += f"; not reached: the rest of {low:.1f} .. {high:.1f} {unit}"
        if joint.limits is None:
            text += "; the joint has no limits"
        facts[joint.name] = text
    return facts
