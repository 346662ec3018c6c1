"""Reach margins, singularity measures and aspects of a formula, evaluated at states of a mechanism."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from twin.core.spatial import Array
from twin.core.units import ROUNDING
from twin.kinematics.compile import Kinematics, compile_formula

_CLOSE = 1e-6
"""Maximum difference (m, rad) at which the result of exact equations counts as equal to a given state."""

_LEVER = 0.1
"""Length in m that divides an error in m, to give an error in rad; equations share no constant with the mechanism."""

_LENGTHS = ("mm", "m", "cm", "um")


class States(Protocol):
    """k given states of a mechanism: tool poses, values of active and passive joints, and positions of named points."""

    @property
    def Ts_base_tool(self) -> Array:  # noqa: N802 - T_a_b is a pose everywhere
        """Tool poses (k, 4, 4)."""
        ...

    @property
    def q(self) -> Array:
        """Active joints (k, n) in m or rad."""
        ...

    @property
    def q_passive(self) -> Mapping[str, Array]:
        """{name of a passive joint: values (k,) in m or rad}."""
        ...

    @property
    def points(self) -> Mapping[str, Array]:
        """{name of a point: positions (k, 3) in base, in m}."""
        ...


class Margins:
    """The reach margins, singularity measures and aspects of a formula; each is a column of `values`.

    Attributes:
        names: names of the columns: reach margins, then measures, then aspects.
        symbols: symbol of each column in the equations.
        equations: name of the equation that computes each column, or "".
        kinds: "reach", "type1", "type2" or "aspect" for each column.
        preferred: preferred sign of each aspect; 0 for other columns.
    """

    def __init__(
        self, kin: Kinematics, passive: Mapping[str, bool], points: tuple[str, ...], error: float = 0.0
    ) -> None:
        """Set up the columns from equations, the mechanism's passive joints {name: is an angle} and named points.

        `error` is the largest error in m of lengths that counts as agreement.
        """
        f = kin.formula
        self._kin = kin
        # Near the end of reach, an error of a length moves joints by the square root of the error.
        self._close = _CLOSE if error <= ROUNDING else max(_CLOSE, np.sqrt(error / _LEVER))
        self._passive = {p: passive[p] for p in f.passive if p in passive}
        self._points = tuple(p for p in f.points if p in points)
        self.names = (*f.reach, *(m.name for m in f.measures), *(a.symbol for a in f.aspects))
        self.symbols = (*f.reach.values(), *(m.symbol for m in f.measures), *(a.symbol for a in f.aspects))
        makers = {output: e.name for e in f.equations for output in e.outputs}
        self.equations = tuple(makers.get(s, "") for s in self.symbols)
        self.kinds = (*("reach" for _ in f.reach), *(m.kind for m in f.measures), *("aspect" for _ in f.aspects))
        self.preferred = (*(0 for _ in f.reach), *(0 for _ in f.measures), *(a.preferred for a in f.aspects))

    def values(self, s: States, larger: float = 1.0) -> Array:
        """Return the values (k, columns) at k states; all lengths of robot and states are multiplied by `larger`."""
        kin = self._kin
        numbers = {**kin.parameters, **self._lengths(larger)}
        z = [
            np.tile(np.array(list(numbers.values())), (len(s.q), 1)),
            _larger(s.Ts_base_tool, larger).reshape(-1, 16),
            s.q * np.where(kin.revolute, 1.0, larger),
            *(s.q_passive[n][:, None] * (1.0 if self._passive[n] else larger) for n in self._passive),
            *(s.points[n] * larger for n in self._points),
        ]
        with np.errstate(all="ignore"):
            return kin.program.margins_at(tuple(self._passive), self._points).many(np.ascontiguousarray(np.hstack(z)))

    def valid(self, s: States, passive: bool) -> NDArray[np.bool_]:
        """Return (k,) bool: whether the equations reproduce each state (with `passive`: including its passive joints).

        The equations do not reproduce a state if their solution is on another branch.
        """
        kin = self._kin
        with np.errstate(all="ignore"):
            if kin.closed_inverse and not self._many_ways:
                good = self._same_joints(kin.inverse_many(s.Ts_base_tool), s.q, self._close)
                turns = kin.passive_many(s.Ts_base_tool) if passive and self._passive else {}
            elif kin.closed_forward:
                good = np.abs(kin.program.forward.many(s.q) - s.Ts_base_tool).max(axis=(1, 2)) < self._close
                turns = kin.passive_many(qs=s.q) if passive and self._passive and not kin.closed_inverse else {}
            else:
                return np.ones(len(s.q), bool)
        for name in self._passive if turns else ():
            off = turns[name] - s.q_passive[name]
            size = np.abs(np.sin(off / 2) * 2 if self._passive[name] else off)
            good = np.logical_and(good, size < 100 * self._close)
        return np.asarray(good, bool)

    def refuses(self, Ts_base_tool: Array) -> Array:
        """Return the r reach margins (k, r) in m of the equations, at k poses out of reach of the mechanism."""
        with np.errstate(all="ignore"):
            found = self._kin.reach(Ts_base_tool)
        return np.stack([found[n] for n in self._kin.formula.reach], axis=1)

    def fails(self, s: States) -> Array:
        """Return the largest absolute entry (k,) of each inverse Jacobian; infinite for an unreachable state.

        The values are 0 if the formula has no inverse equations.
        """
        kin = self._kin
        if not kin.closed_inverse:
            return np.zeros(len(s.q))
        with np.errstate(all="ignore"):
            J = kin.inverse_jacobian_many(s.Ts_base_tool)
        size = np.abs(J).max(axis=(1, 2))
        return np.where(np.isfinite(size), size, np.inf)

    def homogeneous(self, s: States, by: float) -> bool:
        """Return whether all angles stay the same if all lengths of robot and states are multiplied by `by`.

        If the angles change, a length in the equations is a number instead of a parameter. A formula without lengths
        as parameters also returns False.
        """
        kin = self._kin
        lengths = self._lengths(by)
        if not lengths:
            return False
        large = compile_formula(kin.formula, kin.variants, {**kin.parameters, **lengths}, kin.extra_joints)
        scale = np.where(kin.revolute, 1.0, by)
        with np.errstate(all="ignore"):
            if kin.closed_inverse:
                q = kin.inverse_many(s.Ts_base_tool)
                return bool(self._same_joints(q * scale, large.inverse_many(_larger(s.Ts_base_tool, by)), _CLOSE).all())
            a, b = kin.program.forward.many(s.q), large.program.forward.many(s.q * scale)
        return bool(np.abs(_larger(a, by) - b).max() < _CLOSE)

    def _lengths(self, by: float) -> dict[str, float]:
        kin = self._kin
        return {p.name: by * kin.parameters[p.name] for p in kin.formula.parameters if p.unit in _LENGTHS}

    @property
    def _many_ways(self) -> bool:
        return len(self._kin.formula.joints) > 6

    def _same_joints(self, a: Array, b: Array, close: float) -> Array:
        off = a - b
        off = np.where(self._kin.revolute, 2 * np.sin(off / 2), off)[:, ~self._kin.auxiliary]
        return np.asarray(np.abs(off).max(axis=1) < close)


def _larger(Ts: Array, by: float) -> Array:
    out = Ts.copy()
    out[:, :3, 3] *= by
    return out
