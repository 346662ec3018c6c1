"""The compiled functions of a formula: points, Jacobians, measures, branch labels, for one pose or many.

All values are in SI units. Poses are T_base_tool (4, 4); the first axis of a batch is time. Twists and Jacobian rows
contain the linear velocity of the tool origin, then the angular velocity, both in base axes. The solvers (`solve`,
`assembly`) use these functions; `compile.Kinematics` adds inverse and forward kinematics.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import KinematicsError, unknown
from twin.core.spatial import Array
from twin.formula import flow
from twin.formula.contract import Formula
from twin.formula.program import POSE_TOL, Program
from twin.kinematics import singularity

ExtraJoint = tuple[int, str, bool, float]
"""An auxiliary joint: (index in q, name, whether it is an angle, value that the inverse returns, in rad or m)."""


class Compiled(ABC):
    """The compiled functions of a formula; `Kinematics` adds the solvers.

    Methods with arguments `Ts` and `qs` compute from poses Ts (k, 4, 4) if the formula has inverse equations, otherwise
    from joints qs (k, n). If the required argument is missing, it is computed from the other argument.

    Attributes:
        formula: the formula from which the functions are compiled.
        joints: active joints, in the order of q.
        auxiliary: (n,) bool, whether a joint is auxiliary: it is not in the equations and cannot move the tool. For
            such a joint, the inverse returns the value given at compilation; the forward equations ignore the joint.
        variants: {equation: name of the variant in use}.
        choices: {equation: names of all its variants}.
        parameters: {name: value in use, in SI}.
        closed_inverse: whether the formula has equations for q from the pose (inverse equations).
        closed_forward: whether the formula has equations for the pose from q (forward equations).
        characteristic_length: length in m; a rotation by 1 rad counts as much as a translation by this length.
        revolute: (n,) bool, whether a joint is an angle.
        program: the compiled functions.
    """

    def __init__(
        self,
        formula: Formula,
        variants: Mapping[str, str],
        parameters: Mapping[str, float],
        extra_joints: Sequence[ExtraJoint] = (),
    ) -> None:
        self.formula, self.extra_joints = formula, tuple(extra_joints)
        joints = [(j.name, j.kind == "revolute") for j in formula.joints]
        for place, name, is_angle, _ in extra_joints:  # in ascending order
            joints.insert(place, (name, is_angle))
        self.joints = tuple(name for name, _ in joints)
        self.auxiliary = np.isin(self.joints, [name for _, name, _, _ in extra_joints])
        self.variants, self.parameters = dict(variants), dict(parameters)
        self.choices = {e.name: tuple(e.variants) for e in formula.equations if e.stage != "helper"}
        self.closed_inverse, self.closed_forward = formula.has("inverse"), formula.has("forward")
        self.revolute = np.array([is_angle for _, is_angle in joints])
        what = f"formula '{formula.name}', characteristic_length"
        self.characteristic_length = float(flow.call(formula.characteristic_length, parameters, what))  # type: ignore[arg-type]
        self.program = Program(
            formula,
            self.variants,
            self.parameters,
            self.joints,
            self.characteristic_length,
            {name: value for _, name, _, value in extra_joints},
        )
        if self.closed_inverse:
            self.program.inverse  # noqa: B018 - compile now, so that a faulty to_pose fails here

    @abstractmethod
    def inverse(self, T_base_tool: ArrayLike, seed: ArrayLike | None = None) -> Array:
        """Return q (n,) at a pose (4, 4)."""

    @abstractmethod
    def inverse_many(self, Ts_base_tool: ArrayLike) -> Array:
        """Return q (k, n) at poses (k, 4, 4); NaN rows where no solution exists."""

    @abstractmethod
    def forward(self, q: ArrayLike, seed: ArrayLike | None = None) -> Array:
        """Return T_base_tool (4, 4) at q (n,)."""

    @abstractmethod
    def forward_many(self, qs: ArrayLike, seed: ArrayLike | None = None) -> Array:
        """Return poses (k, 4, 4) at qs (k, n); NaN where no solution exists."""

    def joints_from_points(self, points: Mapping[str, ArrayLike]) -> Array:
        """Return q (k, n) from named points {name: (k, 3)} in m; only equations that use these points are evaluated.

        Raises:
            KinematicsError: a point is unknown or missing, or the equations also require the pose.
        """
        for name in points:
            if name not in self.formula.points:
                raise KinematicsError(f"formula '{self.formula.name}': {unknown('point', name, self.formula.points)}")
        names = tuple(n for n in self.formula.points if n in points)
        columns = [np.atleast_2d(np.asarray(points[n], float)) for n in names]
        if not names or {c.shape for c in columns} != {(len(columns[0]), 3)}:
            raise KinematicsError(
                f"formula '{self.formula.name}': give points as (k, 3) arrays of equal length; found "
                f"{ {n: c.shape for n, c in zip(names, columns, strict=True)} }."
            )
        return self.program.from_points(names).many(np.hstack(columns))

    def points_many(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> dict[str, Array]:
        """Return the named points {name: (k, 3)} in base, in m."""
        out = self.program.points.many(self._states(Ts, qs))
        return {name: out[:, i] for i, name in enumerate(self.formula.points)}

    def passive_many(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> dict[str, Array]:
        """Return the values of the passive joints {name: (k,)} in rad or m."""
        return self._named("passive", Ts, qs)

    def inverse_jacobian(self, T: ArrayLike | None = None, q: ArrayLike | None = None) -> Array:
        """Return the inverse Jacobian (n, 6), joint rates per tool twist, at the pose T or at q.

        If both T and q are given, T is used, except for a formula without inverse equations, which uses q.
        """
        return self.inverse_jacobian_many(_one(T), _one(q))[0]

    def inverse_jacobian_many(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> Array:
        """Return the inverse Jacobians (k, n, 6), joint rates per tool twist; NaN at singularities.

        Without inverse equations, the pseudo-inverses of `jacobian_many` are returned.
        """
        if self.closed_inverse:
            return self.program.inverse_jacobian.many(self._states(Ts, qs))
        return singularity.invert_many(self.program.forward_jacobian.many(self._states(Ts, qs)))

    def jacobian(self, T: ArrayLike | None = None, q: ArrayLike | None = None) -> Array:
        """Return the Jacobian (6, n), tool twist per joint rates, at the pose T or at q.

        Raises:
            KinematicsError: the Jacobian does not exist (singular, or out of reach).
        """
        J = self.jacobian_many(_one(T), _one(q))[0]
        if not np.isfinite(J).all():
            raise KinematicsError(
                f"{self.formula.name}: the Jacobian does not exist at this pose: the pose is singular or out of reach."
            )
        return J

    def jacobian_many(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> Array:
        """Return the Jacobians (k, 6, n), tool twist per joint rates; NaN at singularities."""
        if self.closed_forward:
            return self.program.forward_jacobian.many(
                self._joints(qs) if qs is not None else self.inverse_many(_given(Ts))
            )
        return singularity.invert_many(self.program.inverse_jacobian.many(self._states(Ts, qs)))

    def singularity(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> dict[str, Array]:
        """Return the singularity measures {name: (k,)}, dimensionless; each is 0 at its singularity."""
        return self._named("measure", Ts, qs)

    def singularity_alarm(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> dict[str, np.ndarray]:
        """Return {name of a measure: (k,) bool}; true where |measure| is below the alarm value, or is NaN."""
        values = self.singularity(Ts, qs)
        return {m.name: ~(np.abs(values[m.name]) >= m.alarm) for m in self.formula.measures}

    def reach(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> dict[str, Array]:
        """Return the reach margins {name: (k,)} in m; negative where the chain cannot reach."""
        return self._named("reach", Ts, qs)

    def aspect_signs(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> Array:
        """Return the signs (k, m) of the formula's m aspects: -1, 0 or +1; 0 also where an aspect is undefined."""
        return np.nan_to_num(np.sign(self.program.group["aspect"].many(self._states(Ts, qs))))

    def branch(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> np.ndarray:
        """Return the labels (k,) of the assemblies: names and signs of the aspects, such as "X_E+ z_up+ D-"."""
        names, marks = self.formula.scalars["aspect"], {1: "+", -1: "-", 0: "0"}
        rows = self.aspect_signs(Ts, qs)
        return np.array([" ".join(f"{n}{marks[int(s)]}" for n, s in zip(names, r, strict=True)) for r in rows])

    @property
    def preferred_branch(self) -> str:
        """Label that `branch` returns for the preferred assembly."""
        return " ".join(f"{a.symbol}{'+' if a.preferred > 0 else '-'}" for a in self.formula.aspects)

    def condition(self, T: ArrayLike | None = None, q: ArrayLike | None = None) -> float:
        """Return the condition number of the Jacobian at a pose or at q; see `condition_many`."""
        return float(self.condition_many(_one(T), _one(q))[0])

    def condition_many(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> Array:
        """Return the condition numbers (k,) of the Jacobians; without forward equations, of the inverse Jacobians.

        Rotations are scaled by the characteristic length. The number is infinite for a singular or NaN matrix.
        """
        if self.closed_forward:
            J = self.jacobian_many(Ts, qs)
            J[:, 3:] *= self.characteristic_length
        else:
            J = self.inverse_jacobian_many(Ts, qs)
            J[:, :, 3:] /= self.characteristic_length
        return singularity.condition_many(J)

    def why(self, T: Array) -> str:
        """Return a text: the line of a formula file whose result at a pose (4, 4) is NaN or infinite, and the cause.

        Only files with functions `inverse` or `forward` are traced (see `twin.formula.plain`). "": no line was found.
        """
        return self.formula.numbers(T, self.parameters) if self.formula.numbers is not None else ""

    def takes(self, Ts: ArrayLike) -> bool:
        """Return whether the equations prove that the robot can have the poses Ts (k, 4, 4); False: not proved.

        A robot with fewer than six degrees of freedom cannot have every pose. Each of three facts is a proof: the robot
        has six degrees of freedom; the inverse equations (which return NaN for a pose that the robot cannot have) have
        a solution for each pose; the forward equations reproduce each pose.
        """
        Ts = poses(Ts)
        if len(self.formula.joints) >= 6:
            J = self.inverse_jacobian_many(Ts[:1])[0] if self.closed_inverse else np.zeros((6, 6))
            return bool(np.isfinite(J).all() and np.linalg.matrix_rank(J) == 6)
        q = self.inverse_many(Ts)
        if not np.isfinite(q).all():
            return False
        if not self.closed_inverse or (len(self.formula.coordinates.names) < 6 and not self.closed_forward):
            return True  # the solver converged, or `inverse_many` checked the pose
        if not self.closed_forward:
            return False
        back = self.program.forward.many(q)
        return bool(np.abs(back - Ts).max() <= POSE_TOL)

    @property
    def determined(self) -> bool:
        """Whether joint values determine a tool pose: there is a forward equation, or there are exactly six joints."""
        return self.closed_forward or len(self.formula.joints) == 6

    def need_six_joints(self) -> None:
        """Raise `KinematicsError` if joint values do not determine a tool pose; see `determined`."""
        if not self.determined:
            raise KinematicsError(
                f"{self.formula.name}: {len(self.formula.joints)} joints do not determine the 6 numbers of a pose; "
                "add a forward equation to the formula."
            )

    def _named(self, kind: str, Ts: ArrayLike | None, qs: ArrayLike | None) -> dict[str, Array]:
        names = self.formula.scalars[kind]
        if not names:  # without an inverse equation, the states would be solved for nothing
            return {}
        values = self.program.group[kind].many(self._states(Ts, qs))
        return {name: values[:, i] for i, name in enumerate(names)}

    def _states(self, Ts: ArrayLike | None, qs: ArrayLike | None) -> Array:
        """Return the input of the compiled functions: poses (k, 16), or joints (k, n)."""
        if self.closed_inverse:
            return (poses(Ts) if Ts is not None else self.forward_many(_given(qs))).reshape(-1, 16)
        return self._joints(qs) if qs is not None else self.inverse_many(_given(Ts))

    def _joints(self, q: ArrayLike, batch: bool = True) -> Array:
        q = np.asarray(q, float)
        if q.ndim != 1 + batch or q.shape[-1] != len(self.joints):
            want = f"(k, {len(self.joints)})" if batch else f"({len(self.joints)},)"
            raise KinematicsError(
                f"{self.formula.name}: q must have shape {want} for {', '.join(self.joints)}, not {q.shape}."
            )
        return q

    def _seed(self, seed: ArrayLike | None) -> Array | None:
        if seed is None or not self.closed_inverse:
            return None  # a forward equation needs no seed
        T = poses(seed, batch=False)
        if not self.program.inverse.one(T.ravel())[-1] <= POSE_TOL:
            raise KinematicsError(f"{self.formula.name}: the seed is not a rigid pose (4, 4) in metres.")
        return T


def _given(value: ArrayLike | None) -> ArrayLike:
    if value is None:
        raise KinematicsError("give poses (T or Ts) or joint values (q or qs); both are missing.")
    return value


def _one(value: ArrayLike | None) -> Array | None:
    return None if value is None else np.asarray(value, float)[None]


def poses(Ts: ArrayLike, batch: bool = True) -> Array:
    """Return poses (k, 4, 4), or a pose (4, 4), as contiguous floats; raise `KinematicsError` for any other shape."""
    Ts = np.ascontiguousarray(Ts, float)
    if Ts.ndim != 2 + batch or Ts.shape[-2:] != (4, 4):
        raise KinematicsError(f"poses must have shape {'(k, 4, 4)' if batch else '(4, 4)'}, not {Ts.shape}.")
    return Ts
