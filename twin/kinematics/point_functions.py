"""The compiled functions of a formula's `PointSearch`: its rows with derivatives, and points and joints of a robot."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from twin.core.spatial import Array
from twin.formula import equation_values, symbolic
from twin.formula.contract import POSE_SYMBOL, PointSearch
from twin.formula.evaluator import Evaluator
from twin.formula.scalar import Value
from twin.kinematics.compiled import Compiled


class PointFunctions:
    """The functions of a robot whose formula has a `PointSearch`; each is compiled when first used.

    Attributes:
        kin: the compiled equations of the robot.
        search: the search of its formula.
        count: number m of points.
    """

    def __init__(self, kin: Compiled, search: PointSearch) -> None:
        self.kin = kin
        self.search = search
        self.count = len(search.unknowns)

    def joints(self, points: Array, Ts: Array) -> Array:
        """Return q (k, n) from points (k, m, 3) and poses of the tool (k, 4, 4), by the inverse equations."""
        poses = Ts.reshape(-1, 16)
        coordinates = points.reshape(len(points), 3 * self.count)
        return self._joints.many(np.hstack([poses, coordinates]))

    def places(self, qs: Array) -> Array:
        """Return the points (k, m, 3) in m at joints qs (k, n)."""
        return self._places.many(qs).reshape(-1, self.count, 3)

    def closed(self, Ts: Array) -> Array:
        """Return the points (k, m, 3) in m at poses of the tool (k, 4, 4), by the inverse equations, without search."""
        return self._closed.many(Ts.reshape(-1, 16)).reshape(-1, self.count, 3)

    def rows(self, redundant: bool) -> Evaluator:
        """Return the function of points, tip and trocar that `rows_at` evaluates.

        With `redundant`, a further row is zero if the redundant joint is as in the inverse equations, or has the other
        sign, see `redundant_signs`.
        """
        return self._rows_with_redundant if redundant else self._rows

    @staticmethod
    def rows_at(rows: Evaluator, x: Array, tips_and_trocars: Array) -> tuple[Array, Array, Array]:
        """Return rows (k, r), their derivatives (k, r, 3 m), and `between` (k,).

        `x` (k, 3 m) are the points, `tips_and_trocars` (k, 6) tip and trocar, in m.
        """
        values = rows.many(np.hstack([x, tips_and_trocars]))
        unknown_count = x.shape[1]
        row_count = (values.shape[1] - 1) // (unknown_count + 1)
        r = values[:, :row_count]
        # The compiled function stacks the columns of each Jacobian.
        J = values[:, row_count:-1].reshape(len(x), unknown_count, row_count).transpose(0, 2, 1)
        return r, J, values[:, -1]

    def _symbols(self, x: ca.SX) -> dict[str, Value]:
        """Return the symbols of the parameters and of the points, which x (3 m,) stacks."""
        symbols: dict[str, Value] = dict(self.kin.parameters)
        for i, name in enumerate(self.search.unknowns):
            symbols[name] = x[3 * i : 3 * i + 3]
        return symbols

    @cached_property
    def _rows(self) -> Evaluator:
        return self._compiled(redundant=False)

    @cached_property
    def _rows_with_redundant(self) -> Evaluator:
        return self._compiled(redundant=True)

    def _compiled(self, redundant: bool) -> Evaluator:
        """Compile (points, tip, trocar) -> rows, their derivatives with respect to the points, `between`."""
        unknown_count = 3 * self.count
        arguments = ca.SX.sym("z", unknown_count + 6)
        symbols = self._symbols(arguments[:unknown_count])
        symbols[self.search.tip] = arguments[unknown_count : unknown_count + 3]
        symbols[self.search.trocar] = arguments[unknown_count + 3 :]
        r = self._call("residual", symbols)
        if redundant:
            r = ca.vertcat(r, self._call("redundant", symbols)[0])
        J = ca.jacobian(r, arguments)[:, :unknown_count]
        between = self._call("between", symbols)
        return Evaluator("point_rows", arguments, ca.vertcat(r, ca.vec(J), between))

    @cached_property
    def _redundant(self) -> Evaluator:
        coordinates = ca.SX.sym("z", 3 * self.count)
        sign = self._call("redundant", self._symbols(coordinates))[1]
        return Evaluator("redundant_sign", coordinates, sign)

    def redundant_signs(self, points: Array) -> Array:
        """Return numbers (k,) that are positive where the redundant joint has the sign of the inverse equations."""
        return self._redundant.many(points.reshape(len(points), 3 * self.count))[:, 0]

    @cached_property
    def _places(self) -> Evaluator:
        order = self.kin.program.order
        q = ca.SX.sym("q", len(order))
        symbols: dict[str, Value] = dict(self.kin.parameters)
        symbols.update(zip(order, ca.vertsplit(q), strict=True))
        points = self._call("places", symbols)
        return Evaluator("places", q, ca.vertcat(*points))

    @cached_property
    def _closed(self) -> Evaluator:
        pose_entries = ca.SX.sym("z", 16)
        of_pose = equation_values.from_pose(self.kin.formula, symbolic.unflat(pose_entries, 4, 4))
        symbols = self._inverse({**self.kin.parameters, **of_pose})
        points = [ca.SX(symbols[name]) for name in self.search.unknowns]
        return Evaluator("closed", pose_entries, ca.vertcat(*points))

    @cached_property
    def _joints(self) -> Evaluator:
        formula = self.kin.formula
        program = self.kin.program
        arguments = ca.SX.sym("z", 16 + 3 * self.count)
        T = symbolic.unflat(arguments[:16], 4, 4)
        # The given points replace those that the equations would compute from the pose.
        of_pose = equation_values.from_pose(formula, T)
        symbols = self._inverse({**of_pose, **self._symbols(arguments[16:]), POSE_SYMBOL: T})
        joints = equation_values.gather(formula, {**symbols, **program.extra_values}, program.order, "joint")
        return Evaluator("joints_of_points", arguments, joints)

    def _inverse(self, symbols: dict[str, Value]) -> dict[str, Value]:
        """Return the symbols with those that the inverse equations compute from them."""
        return equation_values.run(self.kin.formula, self.kin.variants, symbols, "inverse")

    def _call(self, name: str, symbols: dict[str, Value]) -> Value:
        """Return what a function of the `PointSearch` returns for symbols."""
        what = f"formula '{self.kin.formula.name}', point_search.{name}"
        return equation_values.call(getattr(self.search, name), symbols, what)
