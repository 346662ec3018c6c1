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
from twin.reference.degeneracy import Degeneracy
from twin.reference.loops import LENGTH_SCALE
from twin.reference.model import ReferenceModel
from twin.reference.seeking import NEARLY, Mask, Valid, Walks, seek, wander
from twin.reference.states import SolvedSamples

_DEGENERATE = 1e-2
"""Relative singular value below which the mechanism counts as degenerate; the error of a search for zeros is 1e-5."""

_STARTS = 12
"""Number of states at which walks start."""

_LARGER = 1.25
"""Factor by which all lengths are multiplied, to test the dimension of a row."""

_FLAT = 1e-2
"""Relative slope per radian of a margin below which the margin counts as being at its minimum."""

_ENDS = 0.05
"""Relative size below which another margin at the end of a search counts as zero, and as the reason for the end."""

_MOSTLY = 0.3
"""Minimum of (sum of an aspect's values with the preferred sign) / (sum of its values with the other sign).

At this ratio or above, the preferred sign is confirmed. Values with the other sign are accepted because some of the
states may be in another assembly mode, or near a singularity.
"""

Status = Literal["agrees", "disagrees", "not judged"]


class Stated(Protocol):
    """Rows of a formula (reach margins, singularity measures, aspects); see `twin.kinematics.margins.Margins`."""

    names: tuple[str, ...]
    symbols: tuple[str, ...]
    equations: tuple[str, ...]
    kinds: tuple[str, ...]
    preferred: tuple[int, ...]

    def values(self, s: SolvedSamples, larger: float = 1.0) -> Array:
        """Return the values (k, names) of all rows at states; `larger` scales all lengths of the robot."""
        ...

    def valid(self, s: SolvedSamples, passive: bool) -> Mask:
        """Return (k,) bool: whether the equations reproduce each state (with `passive`: also its passive joints)."""
        ...

    def refuses(self, Ts_base_tool: Array) -> Array:
        """Return the r reach margins (k, r) in m at tool poses, from the equations alone; negative if out of reach."""
        ...

    def fails(self, s: SolvedSamples) -> Array:
        """Return (k,) the largest joint rate per unit rate of the pose, from the formula; infinite if singular."""
        ...

    def homogeneous(self, s: SolvedSamples, by: float) -> bool:
        """Return whether scaling all length parameters by `by` leaves the angles unchanged."""
        ...


@dataclass(frozen=True)
class Judged:
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


class Boundary:
    """Checks that the mechanism is degenerate where a margin or measure of a formula is zero."""

    def __init__(self, model: ReferenceModel, stated: Stated, states: Array, error: float = ROUNDING) -> None:
        """Set up the search.

        `stated` contains the margins and measures of the formula. The search begins around the configurations `states`
        (k, nq). `error` is the largest error in m of lengths that counts as agreement.
        """
        self.model, self.stated = model, stated
        self._error = error
        some = states[spread(len(states), _STARTS)]
        run = model.collect(some)
        self._given = run
        self.motions = Degeneracy(model, some)
        self._whole = bool(stated.valid(run, True).any())  # False: passive joints are wrong; reported elsewhere
        good = stated.valid(run, self._whole)
        self._drawn = some[good]
        self._why = "" if good.any() else "there is no state at which the equations agree with the joint values"
        if not self._why:
            far = wander(self.motions, self._valid, self._drawn)
            self._pool = np.concatenate([self._drawn, far])
            self._values = self._at(self._pool)
            sizes = []
            for values in self._values.T:
                finite = np.abs(values[np.isfinite(values)])
                sizes.append(float(np.median(finite)) if len(finite) else 1.0)
            self._size = np.array(sizes)
            # A measure goes through zero as the square root of a margin, and so does its error.
            lengths = np.array([kind == "reach" for kind in stated.kinds])
            self._off = np.where(lengths, error, np.sqrt(error / LENGTH_SCALE) * self._size)

    def judge(self) -> list[Judged]:
        """Return the result for each row (margin, measure or aspect)."""
        s = self.stated
        rows = range(len(s.names))
        if self._why:
            return [self._row(i, "not judged", self._why) for i in rows]
        judged: dict[int, Judged] = {}
        undecided = []
        for i in rows:
            result = self._plain(i)
            if result is None:
                undecided.append(i)
            else:
                judged[i] = result
        judged |= self._walked(undecided)
        return [judged[i] for i in rows]

    # -- checks at known states -------------------------------------------------------------------------------

    def _plain(self, i: int) -> Judged | None:
        """Check value, sign and dimension of a row at the known states; return None if these checks do not decide."""
        s, v = self.stated, self._values[:, i]
        unit, scale = ("mm", MM) if s.kinds[i] == "reach" else ("", 1.0)
        if not np.isfinite(v).all():
            k = int(np.argmin(np.isfinite(v)))
            return self._row(
                i, "disagrees", "the value is undefined at a state that the mechanism can reach", self._pool[k]
            )
        drawn = v[: len(self._drawn)]
        if s.kinds[i] == "aspect":
            signed = drawn * s.preferred[i]
            if np.sum(np.maximum(signed, 0)) >= _MOSTLY * np.sum(np.maximum(-signed, 0)):
                return self._row(
                    i, "agrees", f"the values in the working range confirm the preferred sign {s.preferred[i]:+d}"
                )
            k = int(np.argmin(signed))
            text = f"the value is {drawn[k]:.4g} in the working range; the preferred sign is {s.preferred[i]:+d}"
            return self._row(i, "disagrees", text, self._pool[k], float(abs(drawn[k])))
        if s.kinds[i] == "reach" and v.min() < -self._error:
            k = int(np.argmin(v))
            text = f"the value is {v[k] / MM:.4g} mm (out of reach) at a state that the mechanism can reach"
            return self._row(i, "disagrees", text, self._pool[k], float(-v[k] / MM), "mm")
        if np.ptp(v) <= 1e-6 * np.abs(v).max():
            return self._constant(i, float(v[0]))
        large = s.values(self.model.collect(self._pool), _LARGER)[:, i]
        deviation = np.abs(large - v * (_LARGER if s.kinds[i] == "reach" else 1.0))
        k = int(np.argmax(deviation))
        if deviation[k] > 1e-6 * np.abs(v).max() and s.homogeneous(self._given, _LARGER):
            what = "length" if s.kinds[i] == "reach" else "dimensionless number"
            before = f"{v[k] / scale:.4g} {unit}".rstrip()  # a measure has no unit
            after = f"{large[k] / scale:.4g} {unit}".rstrip()
            text = (
                f"the row is not a {what}: multiplying all lengths by {_LARGER:g} changes it from {before} to {after}"
            )
            return self._row(i, "disagrees", text, self._pool[k], float(deviation[k] / scale), unit)
        return None

    def _constant(self, i: int, value: float) -> Judged:
        s = self.stated
        if s.kinds[i] != "reach":
            text = f"the value is {value:.4g} at all states, so the row does not mark a singularity"
            return self._row(i, "disagrees", text, size=abs(value))
        poses = self._beyond()
        if not len(poses):
            text = f"the value is {value / MM:.4g} mm at all states, so the row does not measure reach"
            return self._row(i, "disagrees", text, size=value / MM, unit="mm")
        accepted = s.refuses(poses)[:, i] >= 0
        if accepted.any():
            text = f"the row accepts {int(accepted.sum())} of {len(poses)} poses that the mechanism cannot reach"
            return self._row(i, "disagrees", text, size=float(accepted.sum()))
        return self._row(i, "agrees", f"the row rejects all {len(poses)} tested poses that the mechanism cannot reach")

    def _beyond(self) -> Array:
        """Return unreachable tool poses (k, 4, 4) near reachable ones; empty if there are six degrees of freedom."""
        X = self._drawn
        if self.motions.freedom >= 6:
            return np.zeros((0, 4, 4))
        twists = self.motions.tool(X)
        U = np.linalg.svd(twists)[0][:, :, self.motions.freedom :]
        Ts = self.model.collect(X).Ts_base_tool
        poses = []
        for j in range(U.shape[2]):
            for by in (1e-3, -1e-2, 0.1):
                xi = by * U[:, :, j]
                T = Ts.copy()
                T[:, :3, :3] = spatial.exp_so3(xi[:, 3:]) @ Ts[:, :3, :3]
                T[:, :3, 3] += xi[:, :3] * self.motions.length
                poses.append(T)
        return np.concatenate(poses)

    # -- checks at the ends of walks -----------------------------------------------------------------------------------

    def _walked(self, rows: list[int]) -> dict[int, Judged]:
        if not rows:
            return {}
        order, k = np.argsort(np.abs(self._values), axis=0), len(self._pool)
        walks = [self._seek(rows, [order[0], order[k // 4]], (False, False), self._valid, 0)]
        lacking = [i for i in rows if not len(self._zeros(i, walks))]
        if lacking:
            walks.append(
                self._seek(lacking, [order[0], order[k // 20], order[k // 2]], (True, True, True), self._valid, 1)
            )
            lacking = [i for i in lacking if not len(self._zeros(i, walks))]
        beyond = [self._seek(lacking, [order[0], order[k // 2]], (False, False), _anywhere, 2)] if lacking else []
        return {i: self._verdict(i, walks, beyond) for i in rows}

    def _seek(self, rows: list[int], picks: list[Index], aside: tuple[bool, ...], valid: Valid, seed: int) -> Walks:
        row = np.repeat(np.array(rows, np.intp), len(picks))
        # rows of `chosen`: the picks of one row after the other, as in `row`
        chosen = np.array(picks)[:, rows].T.ravel()
        starts = self._pool[chosen]
        return seek(self.motions, self._at, valid, starts, row, np.array(aside * len(rows)), self._size, seed)

    def _zeros(self, i: int, walks: list[Walks]) -> Array:
        """Return the states (k, nq) at which walks (sequences of Newton steps) found a zero of row i."""
        ends = np.concatenate([w.states[w.ended == "zero"] for w in walks])
        if not len(ends):
            return ends
        values = np.abs(self._at(ends)[:, i])
        return ends[values <= NEARLY * self._size[i]]

    def _degenerate(self, i: int, zeros: Array) -> Mask:
        """Return (k,) bool: whether the mechanism is degenerate at zeros (k, nq) of row i, within the error of lengths.

        An error of a length moves a zero away from a degenerate state by the square root of the error. Near another
        zero, a degenerate state is therefore searched; the row must be zero there within its own error.
        """
        is_degenerate = self.motions.of(zeros).min(axis=1) <= _DEGENERATE
        rest = np.flatnonzero(~is_degenerate)
        if len(rest):
            row, aside = np.zeros(len(rest), np.intp), np.zeros(len(rest), bool)
            ends = seek(self.motions, self._least, _anywhere, zeros[rest], row, aside, np.ones(1)).states
            ended = self.motions.of(ends).min(axis=1) <= _DEGENERATE
            values = self._at(ends)
            reach = values[:, [kind == "reach" for kind in self.stated.kinds]]
            # A measure has no value beyond the reach that the equations state.
            beyond = np.isnan(values[:, i]) & ((reach < 0) & (reach >= -self._error)).any(axis=1)
            is_degenerate[rest] = ended & (beyond | (np.abs(values[:, i]) <= self._off[i]))
        return np.asarray(is_degenerate, bool)

    def _least(self, states: Array) -> Array:
        """Return the distance (k, 1) from degeneracy."""
        return self.motions.of(states).min(axis=1)[:, None]

    def _verdict(self, i: int, walks: list[Walks], beyond: list[Walks]) -> Judged:
        s, zeros = self.stated, self._zeros(i, walks)
        if not len(zeros) and beyond:
            zeros = self._zeros(i, beyond)
            if len(zeros) and self._degenerate(i, zeros).any():
                return self._row(
                    i, "agrees", "the row is zero where the mechanism is degenerate, in another assembly mode"
                )
            zeros = zeros[:0]
        if not len(zeros):
            return self._unfound(i, walks)
        regular = ~self._degenerate(i, zeros)
        if not regular.any():
            return self._row(i, "agrees", f"the row is zero where the mechanism is degenerate, at {len(zeros)} states")
        left = np.where(regular, self.motions.of(zeros).min(axis=1), 0.0)
        k = int(np.argmax(left))
        if s.kinds[i] != "reach" and self._own(zeros[regular]):
            text = (
                "the row is zero where the mechanism is regular; the formula's own inverse is singular there and does "
                "not describe the mechanism"
            )
            return self._row(i, "not judged", text, zeros[k])
        what = "the mechanism can move further" if s.kinds[i] == "reach" else "the mechanism is regular"
        kept = f"the smallest singular value is {100 * min(left[k], 1):.2g} % of its usual value"
        text = f"the row is zero at a state where {what}: {kept}"
        return self._row(i, "disagrees", text, zeros[k], float(left[k]))

    def _own(self, states: Array) -> bool:
        """Return whether the formula's own inverse is singular at all given states."""
        usual = float(np.median(self.stated.fails(self._given)))
        return bool((self.stated.fails(self.model.collect(states)) > 30 * usual).all())

    def _unfound(self, i: int, walks: list[Walks]) -> Judged:
        s = self.stated
        ends = []
        for walk in walks:
            for j in np.flatnonzero(walk.row == i):
                ends.append((abs(walk.value[j]), walk.slope[j], walk.states[j]))
        value, slope, x = min(ends, key=lambda end: end[0])
        reach = s.kinds[i] == "reach"
        least = f"{value / MM:.4g} mm" if reach else f"{value:.4g}"
        flat = slope < _FLAT * max(value, self._size[i])
        if reach and flat and self.motions.of(x[None])[0, 2] < _DEGENERATE:
            if value <= self._error:
                return self._row(i, "agrees", f"the mechanism reaches its limit where the margin is {least}")
            others = np.array([kind == "reach" for kind in s.kinds])
            others[i] = False
            near = np.abs(self._at(x[None])[0]) < _ENDS * self._size
            if not near[others].any():
                text = (
                    f"the mechanism reaches its limit at a state where the margin is {least}, not 0, and no other "
                    "margin is near 0"
                )
                return self._row(i, "disagrees", text, x, value / MM, "mm")
        text = f"the row was zero at no tested state; its smallest absolute value was {least}"
        return self._row(i, "not judged", text, x)

    # -- helpers ----------------------------------------------------------------------------------------

    def _at(self, states: Array) -> Array:
        return self.stated.values(self.model.collect(states))

    def _valid(self, states: Array) -> Mask:
        return self.stated.valid(self.model.collect(states), self._whole)

    def _row(
        self, i: int, status: Status, why: str, x: Array | None = None, size: float | None = None, unit: str = ""
    ) -> Judged:
        s = self.stated
        at = "" if x is None else self._joints(self.model.collect(x[None]))
        return Judged(s.names[i], s.symbols[i], s.equations[i], s.kinds[i], status, why, at, size, unit)

    def _joints(self, run: SolvedSamples) -> str:
        texts = []
        for joint, q in zip(self.model.mechanism.active, run.q[0], strict=True):
            texts.append(f"{joint.name} {q / DEG:.2f}°" if joint.is_angle else f"{joint.name} {q / MM:.2f} mm")
        return ", ".join(texts)


def summary(rows: list[Judged]) -> str:
    """Return, as text, the number of checked rows, and the unchecked rows with their reasons."""
    reasons = []
    for row in rows:
        if row.status == "not judged":
            reasons.append(f"{row.name}: {row.why}")
    text = f"{len(rows) - len(reasons)} of {len(rows)}"
    if not reasons:
        return text
    return f"{text}; not judged: {'; '.join(reasons)}"


_WHAT = {"reach": "margin of reach", "aspect": "aspect"}


def disagreements(rows: list[Judged]) -> list[Finding]:
    """Return a finding for each row that the mechanism contradicts."""
    findings = []
    for row in rows:
        if row.status != "disagrees":
            continue
        what = _WHAT.get(row.kind, "singularity measure")
        code = row.kind if row.kind in _WHAT else "singularity"  # type1 and type2 have one code
        where = f"{row.equation}.{row.symbol}" if row.equation else row.symbol
        size = None
        if row.size is not None:
            size = Quantity(row.size, row.unit)
        finding = disagreement(
            f"margin.{code}",
            where,
            f"{what} '{row.name}' (row {row.symbol}): {row.why}",
            size,
            suggestion="`twin explain` shows the line of this row",
            when=row.at,
            word="",
        )
        findings.append(finding)
    return findings


def _anywhere(states: Array) -> Mask:
    return np.ones(len(states), bool)
