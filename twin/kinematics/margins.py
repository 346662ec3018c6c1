"""Reach margins, singularity measures and aspects of a formula, evaluated at states of a mechanism."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from twin.core.spatial import Array
from twin.core.units import ROUNDING
from twin.kinematics.compile import Kinematics, compile_formula

_STATE_TOLERANCE = 1e-6
"""Maximum difference (m, rad) at which the result of exact equations counts as equal to a given state."""

_ERROR_LEVER = 0.1
"""Length in m that divides an error in m, to give an error in rad; equations share no constant with the mechanism."""

_PASSIVE_FACTOR = 100
"""Factor of the same difference for passive joints: near a singularity, they turn far for a small error of the tool."""

_LENGTH_UNITS = ("mm", "m", "cm", "um")
"""Units of lengths in formulas."""


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
        """Set up the columns for a mechanism with these passive joints {name: is an angle} and named points.

        `error` is the largest error in m of lengths that counts as agreement.
        """
        formula = kin.formula
        self._kin = kin
        # Near the end of reach, an error of a length moves joints by the square root of the error.
        self._state_tolerance = _STATE_TOLERANCE
        if error > ROUNDING:
            self._state_tolerance = max(_STATE_TOLERANCE, np.sqrt(error / _ERROR_LEVER))
        # in the order of the formula, in which the compiled function takes them
        self._passive: dict[str, bool] = {}
        for name in formula.passive:
            if name in passive:
                self._passive[name] = passive[name]
        self._points = tuple(name for name in formula.points if name in points)

        names: list[str] = []
        symbols: list[str] = []
        kinds: list[str] = []
        preferred: list[int] = []
        for name, symbol in formula.reach.items():
            names.append(name)
            symbols.append(symbol)
            kinds.append("reach")
            preferred.append(0)
        for measure in formula.measures:
            names.append(measure.name)
            symbols.append(measure.symbol)
            kinds.append(measure.kind)
            preferred.append(0)
        for aspect in formula.aspects:
            names.append(aspect.symbol)
            symbols.append(aspect.symbol)
            kinds.append("aspect")
            preferred.append(aspect.preferred)
        self.names = tuple(names)
        self.symbols = tuple(symbols)
        self.kinds = tuple(kinds)
        self.preferred = tuple(preferred)

        equation_of: dict[str, str] = {}
        for equation in formula.equations:
            for output in equation.outputs:
                equation_of[output] = equation.name
        equations = []
        for symbol in symbols:
            equations.append(equation_of.get(symbol, ""))
        self.equations = tuple(equations)

    def values(self, states: States, length_factor: float = 1.0) -> Array:
        """Return the values (k, columns) at k states, with all lengths of robot and states times `length_factor`."""
        kin = self._kin
        parameters = {**kin.parameters, **self._lengths(length_factor)}
        columns = [
            np.tile(np.array(list(parameters.values())), (len(states.q), 1)),
            _scaled(states.Ts_base_tool, length_factor).reshape(-1, 16),
            states.q * np.where(kin.revolute, 1.0, length_factor),
        ]
        for name, is_angle in self._passive.items():
            factor = 1.0 if is_angle else length_factor
            columns.append(states.q_passive[name][:, None] * factor)
        for name in self._points:
            columns.append(states.points[name] * length_factor)
        inputs = np.ascontiguousarray(np.hstack(columns))
        with np.errstate(all="ignore"):
            return kin.program.margins_at(tuple(self._passive), self._points).many(inputs)

    def valid(self, states: States, passive: bool) -> NDArray[np.bool_]:
        """Return (k,) bool: whether the equations reproduce each state (with `passive`: including its passive joints).

        The equations do not reproduce a state if their solution is on another branch.
        """
        kin = self._kin
        by_inverse = kin.closed_inverse and not self._is_redundant
        if not by_inverse and not kin.closed_forward:
            return np.ones(len(states.q), bool)
        checks_passive = passive and bool(self._passive)
        passive_values: Mapping[str, Array] = {}
        with np.errstate(all="ignore"):
            if by_inverse:
                reproduced = self._same_joints(kin.inverse_many(states.Ts_base_tool), states.q, self._state_tolerance)
                if checks_passive:
                    passive_values = kin.passive_many(states.Ts_base_tool)
            else:
                errors = np.abs(kin.program.forward.many(states.q) - states.Ts_base_tool)
                reproduced = errors.max(axis=(1, 2)) < self._state_tolerance
                # With inverse equations, the passive joints would belong to another solution of a redundant robot.
                if checks_passive and not kin.closed_inverse:
                    passive_values = kin.passive_many(qs=states.q)
        if not passive_values:
            return np.asarray(reproduced, bool)
        for name, is_angle in self._passive.items():
            error = passive_values[name] - states.q_passive[name]
            if is_angle:
                error = np.sin(error / 2) * 2  # a full turn is no error
            reproduced = np.logical_and(reproduced, np.abs(error) < _PASSIVE_FACTOR * self._state_tolerance)
        return np.asarray(reproduced, bool)

    def reach_margins(self, Ts_base_tool: Array) -> Array:
        """Return the r reach margins (k, r) in m of the equations, at k poses out of reach of the mechanism."""
        with np.errstate(all="ignore"):
            margins = self._kin.reach(Ts_base_tool)
        columns = [margins[name] for name in self._kin.formula.reach]
        return np.stack(columns, axis=1)

    def largest_inverse_rate(self, states: States) -> Array:
        """Return the largest absolute entry (k,) of each inverse Jacobian; infinite for an unreachable state.

        The values are 0 if the formula has no inverse equations.
        """
        kin = self._kin
        if not kin.closed_inverse:
            return np.zeros(len(states.q))
        with np.errstate(all="ignore"):
            J = kin.inverse_jacobian_many(states.Ts_base_tool)
        size = np.abs(J).max(axis=(1, 2))
        return np.where(np.isfinite(size), size, np.inf)

    def is_homogeneous(self, states: States, length_factor: float) -> bool:
        """Return whether all angles stay the same with all lengths of robot and states times `length_factor`.

        If the angles change, a length in the equations is a number instead of a parameter. A formula without lengths
        as parameters also returns False.
        """
        kin = self._kin
        lengths = self._lengths(length_factor)
        if not lengths:
            return False
        enlarged = compile_formula(kin.formula, kin.variants, {**kin.parameters, **lengths}, kin.extra_joints)
        scale = np.where(kin.revolute, 1.0, length_factor)
        with np.errstate(all="ignore"):
            if kin.closed_inverse:
                q_given = kin.inverse_many(states.Ts_base_tool)
                q_enlarged = enlarged.inverse_many(_scaled(states.Ts_base_tool, length_factor))
                return bool(self._same_joints(q_given * scale, q_enlarged, _STATE_TOLERANCE).all())
            Ts = kin.program.forward.many(states.q)
            Ts_large = enlarged.program.forward.many(states.q * scale)
        return bool(np.abs(_scaled(Ts, length_factor) - Ts_large).max() < _STATE_TOLERANCE)

    def _lengths(self, length_factor: float) -> dict[str, float]:
        """Return the values of the parameters that are lengths, multiplied by `length_factor`, in m."""
        parameters = self._kin.parameters
        lengths: dict[str, float] = {}
        for parameter in self._kin.formula.parameters:
            if parameter.unit in _LENGTH_UNITS:
                lengths[parameter.name] = length_factor * parameters[parameter.name]
        return lengths

    @property
    def _is_redundant(self) -> bool:
        """Whether a tool pose has infinitely many solutions: the robot is redundant."""
        return len(self._kin.formula.joints) > 6

    def _same_joints(self, q: Array, q_other: Array, tolerance: float) -> Array:
        """Return (k,) bool: whether two sets of joints (k, n) are equal, but for full turns and auxiliary joints."""
        error = q - q_other
        error = np.where(self._kin.revolute, 2 * np.sin(error / 2), error)
        error = error[:, ~self._kin.auxiliary]
        return np.asarray(np.abs(error).max(axis=1) < tolerance)


def _scaled(Ts: Array, length_factor: float) -> Array:
    """Return poses (k, 4, 4) with positions multiplied by `length_factor`."""
    enlarged = Ts.copy()
    enlarged[:, :3, 3] *= length_factor
    return enlarged
