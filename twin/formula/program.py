"""The compiled functions of one formula, and their input symbols; most functions are compiled at first use."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from twin.core.errors import KinematicsError, unknown
from twin.core.spatial import Array
from twin.formula import equation_values, symbolic
from twin.formula.contract import POSE_SYMBOL, Formula
from twin.formula.evaluator import Evaluator
from twin.formula.scalar import Value

_NEWTON_TOLERANCE = 1e-14
"""Joint error and step in m or rad at which Newton's method ends: the rounding of a double."""

_NEWTON_STEPS = 12
"""Maximum number of steps of Newton's method, which doubles the number of correct digits in each near the solution."""

POSE_TOL = 1e-6
"""Maximum norm of the difference between a pose and the pose rebuilt from its coordinates.

The norm is over all 16 entries: positions in m and entries of the rotation count alike, 1 µm as much as 1 µrad.
"""


class NewtonResults(NamedTuple):
    """Results of `Program.newton`, of one start or of several (k, ...).

    Attributes:
        T: (..., 4, 4) pose at the end.
        error: (...) joint error in m or rad; NaN if the search failed.
        travel: (...) travel from the start pose; see `Program.newton`.
        aspects: (..., m) aspects at the end.
    """

    T: Array
    error: Array
    travel: Array
    aspects: Array


def newton_results(numbers: Array) -> NewtonResults:
    """Return the results that `Program.newton` computes as numbers (..., 18 + m)."""
    T = numbers[..., :16].reshape(*numbers.shape[:-1], 4, 4)
    return NewtonResults(T, numbers[..., 16], numbers[..., 17], numbers[..., 18:])


class Program:
    """Compiled functions of the state; the state is the pose (16,), row by row, or q (n,) without inverse equations.

    Attributes:
        parameters: values of the equations' parameters in m and rad, by name.
        order: symbols of all joints, in the order of q.
        extra_values: values (m, rad) of the joints that are not in the equations, by name; see `Compiled.auxiliary`.
        length: characteristic length in m.
        group: {kind: evaluator of all scalars of this kind}, see `Formula.scalars`.
        points: function of the state that returns the named points (k, 3) in m.
        has_inverse, has_forward: whether the formula has such equations.

    Raises:
        KinematicsError: a point, a measure, an aspect or the pose is missing, or has a wrong shape.
    """

    def __init__(
        self,
        formula: Formula,
        variants: Mapping[str, str],
        parameters: Mapping[str, float],
        order: tuple[str, ...],
        length: float,
        extra_values: Mapping[str, float],
    ) -> None:
        self.formula = formula
        self.variants = variants
        self.parameters = parameters
        self.order = order
        self.length = length
        self.extra_values = extra_values
        self.has_inverse = formula.has("inverse")
        self.has_forward = formula.has("forward")
        if self.has_inverse:
            self._state = ca.SX.sym("z", 16)
            symbols = self._after_pose(symbolic.unflat(self._state, 4, 4))
            self._q = self._joints(symbols)
        else:
            self._state = ca.SX.sym("q", len(order))
            self._q = self._state
            symbols = self._after_joints(self._state)
        self._symbols = equation_values.run(formula, variants, symbols, "helper")
        # Compiled here, not at first use, so that a missing point or measure causes an error at once.
        self.group = {}
        for kind, symbol_of_name in formula.scalars.items():
            column = equation_values.gather(formula, self._symbols, tuple(symbol_of_name.values()), kind)
            self.group[kind] = Evaluator(kind, self._state, column)
        self.points = Evaluator("points", self._state, self._points(), (len(formula.points), 3))
        self._from_points: dict[tuple[str, ...], Evaluator] = {}
        self._margins: dict[tuple[tuple[str, ...], tuple[str, ...]], Evaluator] = {}

    @cached_property
    def inverse(self) -> Evaluator:
        """Function of the pose (16,) that returns q (n) and a misfit, for a formula with inverse equations.

        The misfit is the norm of the difference between the pose and the pose rebuilt from its coordinates.
        """
        T = symbolic.unflat(self._state, 4, 4)
        T_rebuilt = equation_values.to_pose(self.formula, self._symbols)
        misfit = _norm(ca.vec(T_rebuilt - T))
        return Evaluator("inverse", self._state, ca.vertcat(self._q, misfit))

    @cached_property
    def inverse_of_parameters(self) -> Evaluator:
        """Function of the parameters, in the order of `parameters`, and the pose (16,) that returns q (n) and a misfit.

        See `inverse`; here, the parameters are inputs.
        """
        count = len(self.parameters)
        z = ca.SX.sym("z", count + 16)
        T = symbolic.unflat(z[count:], 4, 4)
        symbols: dict[str, Value] = _by_name(self.parameters, z[:count])
        symbols |= equation_values.from_pose(self.formula, T)
        for stage in ("inverse", "forward"):
            symbols = equation_values.run(self.formula, self.variants, symbols, stage)
        q = self._joints(symbols)
        misfit = _norm(ca.vec(equation_values.to_pose(self.formula, symbols) - T))
        return Evaluator("inverse_of_parameters", z, ca.vertcat(q, misfit))

    @cached_property
    def judged_inverse(self) -> Evaluator:
        """Function of the pose (16,) that returns q (n); NaN if out of reach, or if it is not rigid (`POSE_TOL`)."""
        result = self.inverse.function(self._state)
        q = result[:-1]
        misfit = result[-1]
        finite = ca.sumsqr(q) < np.inf  # false for NaN, too
        is_reached = ca.logic_and(misfit <= POSE_TOL, finite)
        judged = []
        for value in ca.vertsplit(q):
            judged.append(ca.if_else(is_reached, value, np.nan))
        return Evaluator("judged_inverse", self._state, ca.vertcat(*judged))

    @cached_property
    def inverse_jacobian(self) -> Evaluator:
        """Function of the pose (16,) that returns the derivative (n, 6) of q with respect to a twist of the tool.

        The twist is that of `symbolic.retract`: in base axes, at the tool origin, linear columns first. The formula has
        inverse equations: the state is a pose.
        """
        xi = ca.SX.sym("xi", 6)
        T = symbolic.retract(symbolic.unflat(self._state, 4, 4), xi)
        J = ca.jacobian(self.joints_at(T), xi)
        J = ca.cse(ca.substitute(J, xi, ca.SX.zeros(6)))  # at least a third faster, because derivatives repeat terms
        return Evaluator("inverse_jacobian", self._state, J, (len(self.order), 6))

    @cached_property
    def forward(self) -> Evaluator:
        """Function of q (n) that returns the pose (4, 4)."""
        q, T = self._forward()
        return Evaluator("forward", q, T, (4, 4))

    @cached_property
    def forward_jacobian(self) -> Evaluator:
        """Function of q (n) that returns the Jacobian (6, n): the tool's twist per rate of q, linear rows first.

        The twist is in base axes, at the tool origin.
        """
        q, T = self._forward()
        joint_count = len(self.order)
        R = T[0:3, 0:3]
        angular = []
        for i in range(joint_count):
            # dR/dq_i R^T is the cross product matrix of the angular velocity
            angular_matrix = ca.jtimes(R, q, ca.SX.eye(joint_count)[:, i]) @ R.T
            angular.append(ca.vertcat(angular_matrix[2, 1], angular_matrix[0, 2], angular_matrix[1, 0]))
        linear = ca.jacobian(T[0:3, 3], q)
        J = ca.vertcat(linear, ca.horzcat(*angular))
        return Evaluator("forward_jacobian", q, ca.cse(J), (6, joint_count))

    @cached_property
    def pose_of_coordinates(self) -> Evaluator:
        """Function of the coordinates of the published equations that returns the pose (4, 4)."""
        names = self.formula.coordinates.names
        x = ca.SX.sym("x", len(names))
        symbols = dict(zip(names, ca.vertsplit(x), strict=True))
        T = equation_values.to_pose(self.formula, symbols)
        return Evaluator("pose_of_coordinates", x, T, (4, 4))

    @cached_property
    def coordinates_of_pose(self) -> Evaluator:
        """Function of the pose (16,) that returns the coordinates of the published equations."""
        z = ca.SX.sym("z", 16)
        values = self.formula.coordinates.from_pose(symbolic.unflat(z, 4, 4))
        return Evaluator("coordinates_of_pose", z, ca.vertcat(*values))

    @cached_property
    def newton(self) -> Evaluator:
        """Newton's method: from q (n) and a start pose (16,), compute (pose (16,), joint error, travel, aspects).

        `newton_results` gives the results names. The joint error is a norm in m or rad. The travel is the norm of the
        motion from the start pose to the result: translation divided by the characteristic length, and rotation in rad.
        One call returns all results, because separate Python calls would take ten times as long as the solution.
        """
        joint_count = len(self.order)
        xi = ca.SX.sym("xi", 6)
        q_and_start = ca.SX.sym("p", joint_count + 16)
        q = q_and_start[:joint_count]
        T_start = symbolic.unflat(q_and_start[joint_count:], 4, 4)
        T = symbolic.retract(T_start, xi)
        # joints that are not in the equations have a fixed value here, whatever their q
        in_equations = []
        for i, name in enumerate(self.order):
            if name not in self.extra_values:
                in_equations.append(i)
        joint_errors = (self.joints_at(T) - q)[in_equations]
        finder = ca.rootfinder(
            "finder",
            "fast_newton",
            {"x": xi, "p": q_and_start, "g": joint_errors},
            {
                "error_on_fail": False,
                "abstol": _NEWTON_TOLERANCE,
                "abstolStep": _NEWTON_TOLERANCE,
                "max_iter": _NEWTON_STEPS,
            },
        )
        travel = _norm(ca.vertcat(xi[:3] / self.length, xi[3:]))
        aspects = self.group["aspect"].function(symbolic.flat(T))
        results = ca.vertcat(symbolic.flat(T), _norm(joint_errors), travel, aspects)
        results_function = ca.Function("answer", [xi, q_and_start], [results])
        numbers_in = ca.MX.sym("z", joint_count + 16)
        solution = finder(x0=ca.DM.zeros(6), p=numbers_in)["x"]
        results_of_solution = results_function(solution, numbers_in)
        return Evaluator("newton", numbers_in, results_of_solution, (results_of_solution.shape[0],))

    def from_points(self, names: tuple[str, ...]) -> Evaluator:
        """Return a function that computes q (n) from the named points (3 numbers each, in the order of `names`)."""
        if names not in self._from_points:
            z = ca.SX.sym("z", 3 * len(names))
            symbols = {**self.parameters, **self._symbols_of_points(names, z)}
            symbols = equation_values.run(self.formula, self.variants, symbols, "inverse")
            self._from_points[names] = Evaluator("from_points", z, self._joints(symbols))
        return self._from_points[names]

    def margins_at(self, passive: tuple[str, ...], points: tuple[str, ...]) -> Evaluator:
        """Return a function that computes reach margins, measures and aspects from a state of the mechanism.

        Its inputs are: parameters in the order of `parameters`, pose (16,), joints (n,), passive joints in the order of
        `passive`, and points (3 numbers each) in the order of `points`. The equations compute all other symbols.
        """
        key = (passive, points)
        if key not in self._margins:
            sizes = [len(self.parameters), 16, len(self.order), len(passive), 3 * len(points)]
            ends = np.cumsum(sizes).tolist()
            z = ca.SX.sym("z", sum(sizes))
            numbers, pose, q, passive_values, coordinates = ca.vertsplit(z, [0, *ends])
            symbols: dict[str, Value] = _by_name(self.parameters, numbers)
            symbols |= equation_values.from_pose(self.formula, symbolic.unflat(pose, 4, 4))
            symbols |= _by_name(self.order, q)
            symbols |= _by_name(passive, passive_values)
            symbols |= self._symbols_of_points(points, coordinates)
            for stage in ("inverse", "forward", "helper"):
                symbols = equation_values.run(self.formula, self.variants, symbols, stage)
            names = []
            for kind in ("reach", "measure", "aspect"):
                names += self.formula.scalars[kind].values()
            margins = equation_values.gather(self.formula, symbols, tuple(names), "margin")
            self._margins[key] = Evaluator("margins_at", z, margins)
        return self._margins[key]

    def _symbols_of_points(self, names: tuple[str, ...], coordinates: ca.SX) -> dict[str, ca.SX]:
        """Return {symbol: value} of named points from their coordinates, three for each point in this order."""
        symbols = {}
        for i, name in enumerate(names):
            symbol = self.formula.points[name]
            p = coordinates[3 * i : 3 * i + 3]
            if isinstance(symbol, str):
                symbols[symbol] = p
            else:
                symbols |= zip(symbol, ca.vertsplit(p), strict=True)
        return symbols

    def around(self, iterate: ca.SX, step: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return pose (4, 4) and joints (n) after a step from an iterate of a search, as expressions of both.

        With forward equations, the iterate is q (n,), and the step is added to q. Otherwise the iterate is a pose
        (16,), and the step is a twist (6,) of `symbolic.retract`. A formula with both has q as iterate here, though
        the state of its compiled functions is the pose.
        """
        if self.has_forward:
            q = iterate + step
            return ca.SX(self._after_joints(q)[POSE_SYMBOL]), q
        T = symbolic.retract(symbolic.unflat(iterate, 4, 4), step)
        return T, self.joints_at(T)

    def joints_at(self, T: ca.SX) -> ca.SX:
        """Return q (n) as an expression of a pose expression (4, 4)."""
        return self._joints(self._after_pose(T))

    def _joints(self, symbols: Mapping[str, Value]) -> ca.SX:
        """Return q (n) from the symbols; joints that are not in the equations have their fixed values."""
        return equation_values.gather(self.formula, {**symbols, **self.extra_values}, self.order, "joint")

    def _after_pose(self, T: ca.SX) -> dict[str, Value]:
        """Return the symbols that inverse and forward equations give for a pose (4, 4)."""
        symbols = {**self.parameters, **equation_values.from_pose(self.formula, T)}
        symbols = equation_values.run(self.formula, self.variants, symbols, "inverse")
        return equation_values.run(self.formula, self.variants, symbols, "forward")

    def _after_joints(self, q: ca.SX) -> dict[str, Value]:
        """Return the symbols that forward equations give for q (n), with the pose and its coordinates.

        Raises:
            KinematicsError: the pose has another shape than (4, 4).
        """
        symbols: dict[str, Value] = dict(self.parameters)
        symbols |= zip(self.order, ca.vertsplit(q), strict=True)
        symbols = equation_values.run(self.formula, self.variants, symbols, "forward")
        if POSE_SYMBOL not in symbols:
            symbols[POSE_SYMBOL] = equation_values.to_pose(self.formula, symbols)
        T = ca.SX(symbols[POSE_SYMBOL])
        if T.shape != (4, 4):
            raise KinematicsError(f"formula '{self.formula.name}': {POSE_SYMBOL} has shape {T.shape}, not (4, 4).")
        return {**equation_values.from_pose(self.formula, T), **symbols}

    def _forward(self) -> tuple[ca.SX, ca.SX]:
        """Return a symbol for q (n), and the pose (4, 4) as an expression of it."""
        q = ca.SX.sym("q", len(self.order))
        return q, ca.SX(self._after_joints(q)[POSE_SYMBOL])

    def _points(self) -> ca.SX:
        """Return the named points (k, 3) in m as an expression of the state.

        Raises:
            KinematicsError: the symbol of a point is missing, or has another number of entries than 3.
        """
        rows = []
        for name, symbol in self.formula.points.items():
            what = f"formula '{self.formula.name}', point '{name}'"
            if isinstance(symbol, str):
                if symbol not in self._symbols:
                    raise KinematicsError(f"{what}: {unknown('symbol', symbol, self._symbols)}")
                p = ca.SX(self._symbols[symbol])
            else:
                p = equation_values.gather(self.formula, self._symbols, tuple(symbol), f"point '{name}':")
            if p.numel() != 3:
                raise KinematicsError(f"{what} has shape {p.shape}, but must have 3 numbers.")
            rows.append(ca.reshape(p, 1, 3))
        if not rows:
            return ca.SX(0, 3)  # `vertcat` of nothing has no columns
        return ca.vertcat(*rows)


def _by_name(names: Iterable[str], column: ca.SX) -> dict[str, Value]:
    """Return {name: entry of a column}, in order; the column has one entry for each name."""
    symbols: dict[str, Value] = {}
    for i, name in enumerate(names):
        symbols[name] = column[i]
    return symbols


def _norm(v: ca.SX) -> ca.SX:
    """Return the Euclidean norm of v; NaN if an entry is NaN (a maximum norm with fmax would ignore NaN)."""
    return ca.sqrt(ca.sumsqr(v))
