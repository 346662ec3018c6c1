"""Compile a formula to `Kinematics`: compiled functions, and solvers that replace missing equations."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import KinematicsError, unknown
from twin.core.spatial import Array
from twin.core.units import MM
from twin.formula import variant_choice
from twin.formula.contract import Formula, check_formula
from twin.kinematics import forward_solver
from twin.kinematics.compiled import POSE_TOL, Compiled, ExtraJoint, poses
from twin.kinematics.solve import inverse_by_solver, inverse_by_solver_many


def compile_formula(
    formula: Formula,
    variants: Mapping[str, str] | str | None = None,
    parameters: Mapping[str, float] | None = None,
    extra_joints: Sequence[ExtraJoint] = (),
) -> Kinematics:
    """Compile the equations of a formula to functions.

    Args:
        formula: the equations.
        variants: {equation: variant}, or the name of one variant, used for all equations that have it; default: the
            default variant of each equation.
        parameters: {parameter: value in SI}; these values replace the published values.
        extra_joints: auxiliary joints (joints of the robot that are not in the equations), by ascending index in q.

    Raises:
        KinematicsError: the formula breaks the contract, a name is unknown, or a value is not finite.
    """
    check_formula(formula)
    chosen = variant_choice.choose(formula, variants)
    values = {}
    for parameter in formula.parameters:
        values[parameter.name] = float(parameter.value)
    for name, value in (parameters or {}).items():
        if name not in values:
            raise KinematicsError(f"formula '{formula.name}': {unknown('parameter', name, values)}")
        if not np.isfinite(value):
            raise KinematicsError(f"formula '{formula.name}': parameter '{name}' is {value}, not a finite number.")
        values[name] = float(value)
    return Kinematics(formula, chosen, values, extra_joints)


class Kinematics(Compiled):
    """A compiled formula with inverse and forward kinematics; created by `compile_formula`."""

    def inverse(self, T_base_tool: ArrayLike, seed: ArrayLike | None = None) -> Array:
        """Return q (n,) in m or rad at a pose (4, 4).

        Auxiliary joints have the values of `seed` (n,). Without inverse equations, the solver starts from `seed`.

        Raises:
            KinematicsError: the pose is not rigid, or out of reach; the message gives the chain that does not reach
                and the missing length.
        """
        T = poses(T_base_tool, batch=False)
        if not self.closed_inverse:
            return inverse_by_solver(self, T, seed)
        values = self.program.inverse.one(T.ravel())
        q = values[:-1]
        misfit = values.item(-1)
        if seed is not None and np.shape(seed) == q.shape:
            for i, _, _, _ in self.extra_joints:
                q[i] = seed[i]  # pyright: ignore[reportIndexIssue]
        if not misfit <= POSE_TOL:
            raise KinematicsError(
                f"{self.formula.name}: no values of {', '.join(self.formula.coordinates.names)} give this pose "
                f"(norm of the difference of the matrices {misfit:.3g}, limit {POSE_TOL:g}). Check that the pose is "
                "rigid and in metres.",
                best=q,
            )
        if not math.isfinite(q @ q):  # faster than a test of each joint; for @, see spatial.length
            raise KinematicsError(self._why_unreachable(T))
        return q

    def inverse_many(self, Ts_base_tool: ArrayLike) -> Array:
        """Return q (k, n) at poses (k, 4, 4); NaN rows where the pose is out of reach or not rigid."""
        Ts = poses(Ts_base_tool)
        if not self.closed_inverse:
            return inverse_by_solver_many(self, Ts)
        return self.program.judged_inverse.many(Ts.reshape(-1, 16))

    def inverse_of_all(self, Ts_base_tool: ArrayLike, seed: ArrayLike | None = None) -> Array:
        """Return q (k, n) at poses (k, 4, 4); raise if any pose has no solution.

        Auxiliary joints have the values of `seed` (n,). Without inverse equations, the solver starts from `seed` at the
        first pose, and from the previous solution at each later pose.

        Raises:
            KinematicsError: a pose has no solution; the message gives the index of the first such pose, the error
                message of `inverse` at this pose, and the number of poses without a solution.
        """
        Ts = poses(Ts_base_tool)
        if self.closed_inverse:
            q = self.inverse_many(Ts)
            if seed is not None and np.shape(seed) == q.shape[1:]:
                q[:, self.auxiliary] = np.asarray(seed)[self.auxiliary]
        else:
            q = inverse_by_solver_many(self, Ts, seed)
        if np.isnan(q.sum()):  # a row without a solution is NaN
            self._raise_unsolved(Ts, q, seed)
        return q

    def _raise_unsolved(self, Ts: Array, q: Array, seed: ArrayLike | None) -> None:
        """Raise the error of `inverse_of_all` for the first row of q (k, n) that is NaN."""
        unsolved = np.flatnonzero(np.isnan(q).any(axis=1))
        k = int(unsolved[0])
        pose = f"pose {k} (of 0 .. {len(Ts) - 1})"
        start = q[k - 1] if k else seed
        try:
            self.inverse(Ts[k], start)
        except KinematicsError as error:
            others = ""
            if len(unsolved) > 1:
                others = f"; poses without a solution: {len(unsolved)} of {len(Ts)}"
            raise KinematicsError(f"{pose}: {error}{others}", best=error.best) from None
        # `inverse` may solve a pose alone that the compiled batch refuses, at the limit of a tolerance.
        raise KinematicsError(f"{self.formula.name}: {pose} has no solution")

    def forward(self, q: ArrayLike, seed: ArrayLike | None = None) -> Array:
        """Return T_base_tool (4, 4) at q (n,).

        `seed` is a pose (4, 4) to start from; the solution has the branch label of the seed. Default: the preferred
        branch.

        Raises:
            KinematicsError: no assembly is found; `best` is the best pose.
        """
        return forward_solver.forward(self, self._joints(q, batch=False), self._seed(seed))

    def forward_many(self, qs: ArrayLike, seed: ArrayLike | None = None) -> Array:
        """Return poses (k, 4, 4) at qs (k, n), each solved from the previous pose; NaN without a solution.

        The rows of qs are usually consecutive points of a path. The first row starts from the pose `seed` (4, 4). With
        `seed` (k, 4, 4), each row i starts from seed[i] instead of the previous pose, and all rows are solved at once.
        """
        qs = self._joints(qs)
        if seed is not None and np.ndim(seed) == 3:
            Ts = poses(seed)
            if len(Ts) != len(qs):
                raise KinematicsError(f"{len(Ts)} seed poses for {len(qs)} rows of q: give one seed pose for each row.")
            return forward_solver.forward_many(self, qs, Ts)
        return forward_solver.forward_many(self, qs, self._seed(seed))

    def branches(self, q: ArrayLike) -> list[Array]:
        """Return the tool poses (4, 4) of all assemblies at q (n,), the preferred branch first; empty if there is none.

        Raises:
            KinematicsError: the formula has no enumeration of assemblies and no forward equations.
        """
        return forward_solver.branches(self, self._joints(q, batch=False))

    def _why_unreachable(self, T: Array) -> str:
        """Return the error text of a pose (4, 4) that the equations do not reach: the chains, and their lengths."""
        position_mm = np.array2string(T[:3, 3] / MM, precision=1, suppress_small=True)
        unreached: list[str] = []
        for name, margin in self.reach(T[None]).items():
            if margin[0] < 0:
                unreached.append(f"{name} is {-margin[0] / MM:.3f} mm beyond its limit")
        if unreached:
            return f"{self.formula.name}: tool at {position_mm} mm is out of reach: {', '.join(unreached)}."
        text = f"{self.formula.name}: the equations have no real solution with the tool at {position_mm} mm. "
        return (text + self.why(T)).rstrip()
