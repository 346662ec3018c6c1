"""Check reach margins and singularity measures at their zeros, where the mechanism must be degenerate.

A reach margin is zero at the limit of the workspace and positive inside. A singularity measure is zero where the
mechanism is singular. The values of such a row (margin or measure) cannot be compared with a quantity of the mechanism,
but the zeros of the row can be checked. A search moves the mechanism to a zero of each row. There, the Jacobians show
whether the mechanism is degenerate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding, disagreement
from twin.core.quantity import Quantity
from twin.core.sampling import spread
from twin.core.spatial import Array, Index
from twin.core.units import DEG, MM, ROUNDING
from twin.reference.degeneracy import KINDS, Degeneracy
from twin.reference.loops import LENGTH_SCALE
from twin.reference.model import ReferenceModel
from twin.reference.newton_walks import NEARLY_ZERO_SHARE, Mask, Valid, Walks, walk_to_zeros
from twin.reference.states import SolvedSamples

_DEGENERATE_SHARE = 1e-2
"""Relative singular value below which the mechanism counts as degenerate; the error of a search for zeros is 1e-5."""

_MOST_STARTS = 12
"""Number of states at which walks start."""

_LENGTH_FACTOR = 1.25
"""Factor by which all lengths are multiplied, to test the dimension of a row."""

_FLAT_GRADIENT = 1e-2
"""Relative gradient per radian of a margin below which the margin counts as being at its minimum."""

_NEAR_ZERO = 0.05
"""Relative size below which another margin at the end of a search counts as zero, and as the reason for the end."""

_RANDOM_STEPS = 10
"""Number of steps of a random walk away from a given state."""

_RANDOM_STEP = 0.25
"""Tangent step of a random walk (rad, or units of `loops.LENGTH_SCALE`)."""

_EQUAL_VALUES = 1e-6
"""Relative difference up to which two values of a row are equal."""

_BLOCKED_STEPS = (1e-3, -1e-2, 0.1)
"""Sizes of the tool's steps to poses that the mechanism cannot reach: rad, or parts of the characteristic length."""

_SINGULAR_RATE = 30
"""Factor by which the joint rates of an inverse exceed their usual ones where it is singular."""

_SMALLEST_SIGN_RATIO = 0.3
"""Minimum of (sum of an aspect's values with the preferred sign) / (sum of its values with the other sign).

At this ratio or above, the preferred sign is confirmed. Values with the other sign are accepted because some of the
states may be in another assembly mode, or near a singularity.
"""

Status = Literal["agrees", "disagrees", "not judged"]


class StatedRows(Protocol):
    """Rows of a formula (reach margins, singularity measures, aspects); see `twin.kinematics.margins.Margins`."""

    names: tuple[str, ...]
    symbols: tuple[str, ...]
    equations: tuple[str, ...]
    kinds: tuple[str, ...]
    preferred: tuple[int, ...]

    def values(self, states: SolvedSamples, length_factor: float = 1.0) -> Array:
        """Return the values (k, names) of all rows at states; `length_factor` scales all lengths of the robot."""
        ...

    def valid(self, states: SolvedSamples, passive: bool) -> Mask:
        """Return (k,) bool: whether the equations reproduce each state (with `passive`: also its passive joints)."""
        ...

    def reach_margins(self, Ts_base_tool: Array) -> Array:
        """Return the r reach margins (k, r) in m at tool poses, from the equations alone; negative if out of reach."""
        ...

    def largest_inverse_rate(self, states: SolvedSamples) -> Array:
        """Return (k,) the largest joint rate per unit rate of the pose, from the formula; infinite if singular."""
        ...

    def is_homogeneous(self, states: SolvedSamples, length_factor: float) -> bool:
        """Return whether scaling all length parameters by `length_factor` leaves the angles unchanged."""
        ...


@dataclass(frozen=True)
class JudgedRow:
    """Result of checking one margin, measure or aspect with the mechanism.

    Attributes:
        name, symbol, equation: name of the margin, measure or aspect (the row), its symbol, and its equation.
        kind: "reach", "type1", "type2" or "aspect".
        why: the result in one sentence ("the row is zero where ..."), or the reason why the row was not judged.
        at: example of a state, as active joint values in mm and degrees; "" if there is none.
        size, unit: size of the disagreement (None: not measured), and the unit of this size.
    """

    name: str
    symbol: str
    equation: str
    kind: str
    status: Status
    why: str
    at: str = ""
    size: float | None = None
    unit: str = ""


class ZeroCheck:
    """Checks that the mechanism is degenerate where a margin or measure of a formula is zero.

    Each row is judged by the first of these checks that decides it:

    1. At known states: the value is defined; a margin is not negative; an aspect has its preferred sign; the value is
       not constant; multiplying all lengths changes it as its dimension requires.
    2. At zeros of the row, to which walks lead from known states with small values: the mechanism must be degenerate
       there.
    3. If no walk found a zero, walks that avoid singularities, then walks through other assembly modes.
    """

    def __init__(self, model: ReferenceModel, stated: StatedRows, states: Array, error: float = ROUNDING) -> None:
        """Set up the search.

        `stated` contains the margins and measures of the formula. The search begins around the configurations `states`
        (k, nq). `error` is the largest error in m of lengths that counts as agreement.
        """
        self.model = model
        self.stated = stated
        self._length_error = error
        sampled_states = states[spread(len(states), _MOST_STARTS)]
        run = model.collect(sampled_states)
        self._start_samples = run
        self.motions = Degeneracy(model, sampled_states)
        # False: the passive joints of the equations are wrong, which is reported elsewhere
        self._checks_passive = bool(stated.valid(run, True).any())
        is_valid = stated.valid(run, self._checks_passive)
        self._starts = sampled_states[is_valid]
        self._are_reach = np.array(stated.kinds, str) == "reach"
        self._no_result_reason = ""  # why nothing can be judged
        if not is_valid.any():
            self._no_result_reason = "there is no state at which the equations agree with the joint values"
            return
        random_states = _random_states(self.motions, self._valid, self._starts, seed=0)
        self._known_states = np.concatenate([self._starts, random_states])
        self._values = self._values_at(self._known_states)
        self._usual_sizes = _usual_sizes(self._values)
        # A measure goes through zero as the square root of a margin, and so does its error.
        error_of_measures = np.sqrt(error / LENGTH_SCALE) * self._usual_sizes
        self._row_errors = np.where(self._are_reach, error, error_of_measures)

    def judge(self) -> list[JudgedRow]:
        """Return the result for each row (margin, measure or aspect)."""
        rows = range(len(self.stated.names))
        if self._no_result_reason:
            return [self._result(i, "not judged", self._no_result_reason) for i in rows]
        judged: dict[int, JudgedRow] = {}
        undecided = []
        for i in rows:
            result = self._at_known_states(i)
            if result is None:
                undecided.append(i)
            else:
                judged[i] = result
        judged |= self._by_walks(undecided)
        return [judged[i] for i in rows]

    # -- checks at known states -------------------------------------------------------------------------------

    def _at_known_states(self, i: int) -> JudgedRow | None:
        """Check value, sign and dimension of row i at the known states; return None if these checks do not decide."""
        values = self._values[:, i]
        kind = self.stated.kinds[i]
        is_finite = np.isfinite(values)
        if not is_finite.all():
            state = self._known_states[int(np.argmin(is_finite))]
            text = "the value is undefined at a state that the mechanism can reach"
            return self._result(i, "disagrees", text, state)
        if kind == "aspect":
            return self._judge_aspect(i)
        if kind == "reach" and values.min() < -self._length_error:
            k = int(np.argmin(values))
            text = f"the value is {values[k] / MM:.4g} mm (out of reach) at a state that the mechanism can reach"
            return self._result(i, "disagrees", text, self._known_states[k], float(-values[k] / MM), "mm")
        if np.ptp(values) <= _EQUAL_VALUES * np.abs(values).max():
            return self._judge_constant(i, float(values[0]))
        return self._wrong_dimension(i)

    def _judge_aspect(self, i: int) -> JudgedRow:
        """Return whether the values of aspect i confirm its preferred sign in the working range."""
        preferred = self.stated.preferred[i]
        start_values = self._values[: len(self._starts), i]
        signed = start_values * preferred
        with_sign = np.sum(np.maximum(signed, 0))
        with_other_sign = np.sum(np.maximum(-signed, 0))
        if with_sign >= _SMALLEST_SIGN_RATIO * with_other_sign:
            text = f"the values in the working range confirm the preferred sign {preferred:+d}"
            return self._result(i, "agrees", text)
        k = int(np.argmin(signed))
        text = f"the value is {start_values[k]:.4g} in the working range; the preferred sign is {preferred:+d}"
        return self._result(i, "disagrees", text, self._known_states[k], float(abs(start_values[k])))

    def _wrong_dimension(self, i: int) -> JudgedRow | None:
        """Return the result of row i if it is no length, or no number without unit; None if its dimension is right.

        All lengths of the robot are multiplied by one factor: so must be a margin; a measure must stay the same.
        """
        values = self._values[:, i]
        what = "dimensionless number"
        factor = 1.0
        unit = ""
        unit_size = 1.0
        if self._are_reach[i]:
            what = "length"
            factor = _LENGTH_FACTOR
            unit = "mm"
            unit_size = MM
        larger = self.stated.values(self.model.collect(self._known_states), _LENGTH_FACTOR)[:, i]
        deviation = np.abs(larger - values * factor)
        k = int(np.argmax(deviation))
        has_right_dimension = deviation[k] <= _EQUAL_VALUES * np.abs(values).max()
        if has_right_dimension or not self.stated.is_homogeneous(self._start_samples, _LENGTH_FACTOR):
            return None
        before = f"{values[k] / unit_size:.4g} {unit}".rstrip()  # a measure has no unit
        after = f"{larger[k] / unit_size:.4g} {unit}".rstrip()
        change = f"multiplying all lengths by {_LENGTH_FACTOR:g} changes it from {before} to {after}"
        text = f"the row is not a {what}: {change}"
        return self._result(i, "disagrees", text, self._known_states[k], float(deviation[k] / unit_size), unit)

    def _judge_constant(self, i: int, value: float) -> JudgedRow:
        """Return the result of row i, which has one value at all known states."""
        if not self._are_reach[i]:
            text = f"the value is {value:.4g} at all states, so the row does not mark a singularity"
            return self._result(i, "disagrees", text, size=abs(value))
        poses = self._unreachable_poses()
        if not len(poses):
            text = f"the value is {value / MM:.4g} mm at all states, so the row does not measure reach"
            return self._result(i, "disagrees", text, size=value / MM, unit="mm")
        accepted = self.stated.reach_margins(poses)[:, i] >= 0
        if accepted.any():
            text = f"the row accepts {int(accepted.sum())} of {len(poses)} poses that the mechanism cannot reach"
            return self._result(i, "disagrees", text, size=float(accepted.sum()))
        text = f"the row rejects all {len(poses)} tested poses that the mechanism cannot reach"
        return self._result(i, "agrees", text)

    def _unreachable_poses(self) -> Array:
        """Return unreachable tool poses (k, 4, 4) near reachable ones; empty if there are six degrees of freedom."""
        X = self._starts
        if self.motions.freedom >= 6:
            return np.zeros((0, 4, 4))
        twists = self.motions.tool(X)
        left_vectors, _, _ = np.linalg.svd(twists)
        # (k, 6, j): unit twists of the tool that no motion of the mechanism has, with lengths in `motions.length`
        blocked = left_vectors[:, :, self.motions.freedom :]
        Ts = self.model.collect(X).Ts_base_tool
        poses = []
        for j in range(blocked.shape[2]):
            for size in _BLOCKED_STEPS:
                twist = size * blocked[:, :, j]
                T = Ts.copy()
                T[:, :3, :3] = spatial.exp_so3(twist[:, 3:]) @ Ts[:, :3, :3]
                T[:, :3, 3] += twist[:, :3] * self.motions.length
                poses.append(T)
        return np.concatenate(poses)

    # -- checks at the ends of walks -----------------------------------------------------------------------------------

    def _by_walks(self, rows: list[int]) -> dict[int, JudgedRow]:
        """Return {row: result} of rows that are zero at no known state, by walks to zeros."""
        if not rows:
            return {}
        # of each row, the states with the smallest values first
        order = np.argsort(np.abs(self._values), axis=0)
        count = len(self._known_states)
        starts = [order[0], order[count // 4]]
        walks = [self._walks_to_zeros(rows, starts, avoids_singularity=False, valid=self._valid, seed=0)]
        lacking = self._without_zero(rows, walks)
        if lacking:
            # again from other states, turned away from singularities
            starts = [order[0], order[count // 20], order[count // 2]]
            walks.append(self._walks_to_zeros(lacking, starts, avoids_singularity=True, valid=self._valid, seed=1))
            lacking = self._without_zero(lacking, walks)
        beyond = []
        if lacking:
            # at last through states of other assembly modes
            starts = [order[0], order[count // 2]]
            beyond = [self._walks_to_zeros(lacking, starts, avoids_singularity=False, valid=_anywhere, seed=2)]
        return {i: self._verdict(i, walks, beyond) for i in rows}

    def _walks_to_zeros(
        self, rows: list[int], picks: list[Index], avoids_singularity: bool, valid: Valid, seed: int
    ) -> Walks:
        """Return walks to zeros of some rows, each from several states.

        Args:
            rows: indices of the rows.
            picks: arrays (all rows,) of indices in the pool: of each row, a state from which a walk starts.
            avoids_singularity: whether the walks avoid singularities where their row does not vanish.
            valid: test of the states through which the walks may go.
            seed: seed of the random metrics.
        """
        row = np.repeat(np.array(rows, np.intp), len(picks))
        # rows of `chosen`: the picks of one row after the other, as in `row`
        chosen = np.array(picks)[:, rows].T.ravel()
        avoids_of_walks = np.full(len(row), avoids_singularity)
        return walk_to_zeros(
            self.motions,
            self._values_at,
            valid,
            self._known_states[chosen],
            row,
            avoids_of_walks,
            self._usual_sizes,
            seed,
        )

    def _zeros(self, i: int, walks: list[Walks]) -> Array:
        """Return the states (k, nq) at which walks (sequences of Newton steps) found a zero of row i."""
        ends = []
        for walk in walks:
            ends.append(walk.states[walk.ended == "zero"])
        # a walk to the zero of another row may also have ended at a zero of this one
        candidates = np.concatenate(ends)
        if not len(candidates):
            return candidates
        values = np.abs(self._values_at(candidates)[:, i])
        return candidates[values <= NEARLY_ZERO_SHARE * self._usual_sizes[i]]

    def _without_zero(self, rows: list[int], walks: list[Walks]) -> list[int]:
        """Return those of the rows of which no walk found a zero."""
        lacking = []
        for i in rows:
            if not len(self._zeros(i, walks)):
                lacking.append(i)
        return lacking

    def _degenerate(self, i: int, zeros: Array) -> Mask:
        """Return (k,) bool: whether the mechanism is degenerate at zeros (k, nq) of row i, within the error of lengths.

        An error of a length moves a zero away from a degenerate state by the square root of the error. Near another
        zero, a degenerate state is therefore searched; the row must be zero there within its own error.
        """
        is_degenerate = self.motions.of(zeros).min(axis=1) <= _DEGENERATE_SHARE
        regular_rows = np.flatnonzero(~is_degenerate)
        if len(regular_rows):
            walks = walk_to_zeros(
                self.motions,
                self._distance_from_degeneracy,
                _anywhere,
                zeros[regular_rows],
                row=np.zeros(len(regular_rows), np.intp),
                avoids_singularity=np.zeros(len(regular_rows), bool),
                size=np.ones(1),
            )
            ends = walks.states
            ends_degenerate = self.motions.of(ends).min(axis=1) <= _DEGENERATE_SHARE
            values = self._values_at(ends)
            is_zero = np.abs(values[:, i]) <= self._row_errors[i]
            # A measure has no value beyond the reach that the equations state.
            reach = values[:, self._are_reach]
            is_just_beyond = ((reach < 0) & (reach >= -self._length_error)).any(axis=1)
            is_undefined = np.isnan(values[:, i]) & is_just_beyond
            is_degenerate[regular_rows] = ends_degenerate & (is_undefined | is_zero)
        return np.asarray(is_degenerate, bool)

    def _distance_from_degeneracy(self, states: Array) -> Array:
        """Return the distance (k, 1) from degeneracy."""
        return self.motions.of(states).min(axis=1)[:, None]

    def _verdict(self, i: int, walks: list[Walks], beyond: list[Walks]) -> JudgedRow:
        """Return the result of row i from the ends of walks; `beyond` may have gone through other assembly modes."""
        zeros = self._zeros(i, walks)
        if not len(zeros):
            if beyond:
                zeros_beyond = self._zeros(i, beyond)
                if len(zeros_beyond) and self._degenerate(i, zeros_beyond).any():
                    text = "the row is zero where the mechanism is degenerate, in another assembly mode"
                    return self._result(i, "agrees", text)
            return self._without_result(i, walks)
        is_regular = ~self._degenerate(i, zeros)
        if not is_regular.any():
            text = f"the row is zero where the mechanism is degenerate, at {len(zeros)} states"
            return self._result(i, "agrees", text)
        smallest = np.where(is_regular, self.motions.of(zeros).min(axis=1), 0.0)
        k = int(np.argmax(smallest))
        what = "the mechanism can move further"
        if not self._are_reach[i]:
            what = "the mechanism is regular"
            if self._inverse_is_singular(zeros[is_regular]):
                text = (
                    "the row is zero where the mechanism is regular; the formula's own inverse is singular there and "
                    "does not describe the mechanism"
                )
                return self._result(i, "not judged", text, zeros[k])
        share = f"the smallest singular value is {100 * min(smallest[k], 1):.2g} % of its usual value"
        text = f"the row is zero at a state where {what}: {share}"
        return self._result(i, "disagrees", text, zeros[k], float(smallest[k]))

    def _inverse_is_singular(self, states: Array) -> bool:
        """Return whether the formula's own inverse is singular at all given states."""
        usual = float(np.median(self.stated.largest_inverse_rate(self._start_samples)))
        rates = self.stated.largest_inverse_rate(self.model.collect(states))
        return bool((rates > _SINGULAR_RATE * usual).all())

    def _without_result(self, i: int, walks: list[Walks]) -> JudgedRow:
        """Return the result of row i, of which no walk found a zero, at the state with its smallest value."""
        ends = []
        for walk in walks:
            for j in np.flatnonzero(walk.row == i):
                ends.append((abs(walk.value[j]), walk.gradient_norm[j], walk.states[j]))
        value, gradient_norm, x = min(ends, key=lambda end: end[0])
        if not self._are_reach[i]:
            text = f"the row was zero at no tested state; its smallest absolute value was {value:.4g}"
            return self._result(i, "not judged", text, x)
        size_mm = f"{value / MM:.4g} mm"
        is_flat = gradient_norm < _FLAT_GRADIENT * max(value, self._usual_sizes[i])
        distance_of_tool = self.motions.of(x[None])[0, KINDS.index("tool")]
        if is_flat and distance_of_tool < _DEGENERATE_SHARE:
            if value <= self._length_error:
                return self._result(i, "agrees", f"the mechanism reaches its limit where the margin is {size_mm}")
            other_margins = self._are_reach.copy()
            other_margins[i] = False
            is_near_zero = np.abs(self._values_at(x[None])[0]) < _NEAR_ZERO * self._usual_sizes
            if not is_near_zero[other_margins].any():
                text = (
                    f"the mechanism reaches its limit at a state where the margin is {size_mm}, not 0, and no other "
                    "margin is near 0"
                )
                return self._result(i, "disagrees", text, x, value / MM, "mm")
        text = f"the row was zero at no tested state; its smallest absolute value was {size_mm}"
        return self._result(i, "not judged", text, x)

    # -- helpers ----------------------------------------------------------------------------------------

    def _values_at(self, states: Array) -> Array:
        """Return the values (k, rows) of all rows at configurations (k, nq)."""
        return self.stated.values(self.model.collect(states))

    def _valid(self, states: Array) -> Mask:
        """Return (k,) bool: whether the equations reproduce each of the configurations (k, nq)."""
        return self.stated.valid(self.model.collect(states), self._checks_passive)

    def _result(
        self, i: int, status: Status, why: str, x: Array | None = None, size: float | None = None, unit: str = ""
    ) -> JudgedRow:
        """Return the result of row i; `x` (nq,) is the configuration that is its example."""
        stated = self.stated
        at = ""
        if x is not None:
            at = self._joints_text(x)
        return JudgedRow(
            name=stated.names[i],
            symbol=stated.symbols[i],
            equation=stated.equations[i],
            kind=stated.kinds[i],
            status=status,
            why=why,
            at=at,
            size=size,
            unit=unit,
        )

    def _joints_text(self, x: Array) -> str:
        """Return the active joint values at a configuration (nq,) as text, in mm and degrees."""
        run = self.model.collect(x[None])
        texts = []
        for joint, q in zip(self.model.mechanism.active, run.q[0], strict=True):
            if joint.is_angle:
                texts.append(f"{joint.name} {q / DEG:.2f}°")
            else:
                texts.append(f"{joint.name} {q / MM:.2f} mm")
        return ", ".join(texts)


def summary(rows: list[JudgedRow]) -> str:
    """Return, as text, the number of checked rows, and the unchecked rows with their reasons."""
    reasons = []
    for row in rows:
        if row.status == "not judged":
            reasons.append(f"{row.name}: {row.why}")
    text = f"{len(rows) - len(reasons)} of {len(rows)}"
    if not reasons:
        return text
    return f"{text}; not judged: {'; '.join(reasons)}"


_NOUN_OF_KIND = {"reach": "margin of reach", "aspect": "aspect"}
"""What a row of a kind is; a row of another kind is a singularity measure."""


def disagreements(rows: list[JudgedRow]) -> list[Finding]:
    """Return a finding for each row that the mechanism contradicts."""
    findings = []
    for row in rows:
        if row.status != "disagrees":
            continue
        noun = "singularity measure"
        code = "singularity"  # type1 and type2 have one code
        if row.kind in _NOUN_OF_KIND:
            noun = _NOUN_OF_KIND[row.kind]
            code = row.kind
        where = row.symbol
        if row.equation:
            where = f"{row.equation}.{row.symbol}"
        size = None
        if row.size is not None:
            size = Quantity(row.size, row.unit)
        finding = disagreement(
            f"margin.{code}",
            where,
            f"{noun} '{row.name}' (row {row.symbol}): {row.why}",
            size,
            suggestion="`twin explain` shows the line of this row",
            when=row.at,
            word="",
        )
        findings.append(finding)
    return findings


def _random_states(motions: Degeneracy, valid: Valid, starts: Array, seed: int) -> Array:
    """Return states (m, nq) reached from starts (w, nq) by random walks, which change direction when blocked.

    The walks visit only states that are `valid` and have closed loops.
    """
    rng = np.random.default_rng(seed)
    states = starts.copy()
    nv = motions.model.tree.model.nv
    scale = motions.scale
    direction = rng.standard_normal((len(states), nv)) * scale
    visited = []
    for _ in range(_RANDOM_STEPS):
        N = motions.motions(states)
        # the part of the direction that the mechanism can follow
        step = np.einsum("kij,klj,kl->ki", N, N / scale[:, None] ** 2, direction)
        length = np.maximum(np.linalg.norm(step / scale, axis=1), 1e-300)
        step *= (_RANDOM_STEP / length)[:, None]
        ends, closed = motions.moved(states, step)
        is_valid = closed & valid(ends)
        states[is_valid] = ends[is_valid]
        direction[is_valid] = step[is_valid]
        blocked = int(np.sum(~is_valid))
        direction[~is_valid] = rng.standard_normal((blocked, nv)) * scale
        visited.append(ends[is_valid])
    return np.concatenate(visited)


def _usual_sizes(values: Array) -> Array:
    """Return the median magnitude (rows,) of the finite values (k, rows) of each row; 1 if none is finite."""
    sizes = []
    for of_row in values.T:
        finite = np.abs(of_row[np.isfinite(of_row)])
        size = 1.0
        if len(finite):
            size = float(np.median(finite))
        sizes.append(size)
    return np.array(sizes)


def _anywhere(states: Array) -> Mask:
    """Return (k,) True: every state is valid."""
    return np.ones(len(states), bool)
