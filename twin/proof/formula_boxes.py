"""The equations' side of boxes of tool positions: predicted joint values, and where there are none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.proof import formula_side, intervals
from twin.proof.interval_function import IntervalFunction
from twin.proof.intervals import Certainty
from twin.proof.linear_limit import LinearLimit


class FormulaBoxes:
    """Evaluates inverse equations for tool positions with one orientation.

    Attributes:
        R: (3, 3) orientation of the tool in base.
    """

    def __init__(
        self,
        formula: Formula,
        variants: Mapping[str, str],
        R: Array,
        joints: Sequence[str],
        limits: Sequence[LinearLimit],
    ) -> None:
        """Compile the equations; `joints` are those whose values are predicted, in order.

        Raises:
            TwinError: the formula has no inverse equations, or gives no value of a joint.
        """
        if not formula.has("inverse"):
            raise TwinError(f"{formula.name}: the equations have no inverse, which must predict the joint values")
        self.R = R
        outputs = formula_side.from_pose(formula, variants, coordinates=False)
        pose = outputs.function.sx_in(0)
        parameters = outputs.function.sx_in(1)
        results = dict(zip(outputs.names, outputs.function(pose, parameters), strict=True))
        names = [joint.name for joint in formula.joints]
        symbols = dict(zip(names, ca.vertsplit(results["joints"]), strict=True))
        if "passive" in results:
            symbols |= zip(formula.passive, ca.vertsplit(results["passive"]), strict=True)
        missing = [name for name in joints if name not in symbols]
        if missing:
            raise TwinError(f"{formula.name}: the equations give no value of joint {', '.join(missing)}")
        values = ca.vertcat(*map(symbols.__getitem__, joints))
        margins = []
        for limit in limits:
            total = 0
            for name, weight in limit.weights.items():
                total = total + weight * symbols[name]
            margins.append(total - limit.least)
        margins += ca.vertsplit(results.get("reach", ca.SX(0, 1)))
        self._values = ca.Function("values", [pose, parameters], [values])
        self._margins = IntervalFunction(ca.Function("margins", [pose, parameters], [ca.vertcat(*margins)]))
        self._aspects: ca.Function | None = None
        if formula.aspects:
            self._aspects = formula_side.aspects(formula, variants)
        self._parameters = formula_side.parameter_values(formula)

    def values(self, p: Array) -> Array:
        """Return joint values (n, k) in m and rad at tool positions (n, 3) in m; NaN where there are none."""
        return self._at(self._values, p)

    def preferred(self, p: Array) -> Certainty:
        """Return where the assembly is the preferred one of the equations at tool positions (n, 3) in m."""
        if self._aspects is None:
            return np.ones(len(p), bool)
        return np.all(self._at(self._aspects, p) > 0, axis=1)

    def _at(self, function: ca.Function, p: Array) -> Array:
        """Return the results (n, k) of a function of pose and parameters at tool positions (n, 3)."""
        if not len(p):
            # without a column, the results have no column either, and their number of rows is lost
            return np.zeros((0, function.size1_out(0)))
        poses = np.zeros((4, 4, len(p)))
        poses[:3, :3] = self.R[..., None]
        poses[:3, 3] = p.T
        poses[3, 3] = 1.0
        parameters = np.tile(self._parameters[:, None], (1, len(p)))
        return np.array(function(poses.reshape(16, -1), parameters)).T

    def outside(self, low: Array, high: Array) -> Certainty:
        """Return where a margin of reach or of a limit is negative at all positions of boxes with corners (n, 3)."""
        pose = []  # row by row
        for axis in range(3):
            pose += map(intervals.exactly, self.R[axis])
            pose.append(intervals.between(low[:, axis], high[:, axis]))
        pose += map(intervals.exactly, (0.0, 0.0, 0.0, 1.0))
        # a parameter is written as a decimal: the interval contains it, not only the number nearest to it
        parameters = list(map(intervals.decimals, self._parameters))
        (margins,) = self._margins([pose, parameters])
        outside = np.zeros(len(low), bool)
        for margin in margins:
            outside |= margin < 0.0
        return outside
