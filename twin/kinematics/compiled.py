"""The compiled functions of a formula: points, Jacobians, measures, branch labels, for one pose or many.

All values are in SI units. Poses are T_base_tool (4, 4); the first axis of a batch is time. Twists and Jacobian rows
contain the linear velocity of the tool origin, then the angular velocity, both in base axes. The solvers (`solve`,
`forward_solver`) use these functions; `compile.Kinematics` adds inverse and forward kinematics.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import KinematicsError, unknown
from twin.core.spatial import Array
from twin.formula import equation_values
from twin.formula.contract import Formula
from twin.formula.program import POSE_TOL, Program
from twin.kinematics import conditioning

ExtraJoint = tuple[int, str, bool, float]
"""An auxiliary joint: (index in q, name, whether it is an angle, value that the inverse returns, in rad or m)."""


class Compiled(ABC):
    """The compiled functions of a formula; `Kinematics` adds the solvers.

    Methods with arguments `Ts` and `qs` compute from poses Ts (k, 4, 4) if the formula has inverse equations, otherwise
    from joints qs (k, n). If the required argument is missing, it is computed from the other argument. The exception is
    the Jacobian of forward equations, which is computed from qs if both are given.

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
        self.formula = formula
        self.extra_joints = tuple(extra_joints)
        names = [joint.name for joint in formula.joints]
        revolute = [joint.kind == "revolute" for joint in formula.joints]
        auxiliary = [False] * len(names)
        extra_values: dict[str, float] = {}
        for place, name, is_angle, value in extra_joints:  # in ascending order, so that each place is final
            names.insert(place, name)
            revolute.insert(place, is_angle)
            auxiliary.insert(place, True)
            extra_values[name] = value
        self.joints = tuple(names)
        self.auxiliary = np.array(auxiliary, bool)
        self.revolute = np.array(revolute)
        self.variants = dict(variants)
        self.parameters = dict(parameters)
        self.choices: dict[str, tuple[str, ...]] = {}
        for equation in formula.equations:
            if equation.stage != "helper":
                self.choices[equation.name] = tuple(equation.variants)
        self.closed_inverse = formula.has("inverse")
        self.closed_forward = formula.has("forward")
        what = f"formula '{formula.name}', characteristic_length"
        length = equation_values.call(formula.characteristic_length, parameters, what)  # type: ignore[arg-type]
        self.characteristic_length = float(length)
        self.program = Program(
            formula,
            self.variants,
            self.parameters,
            self.joints,
            self.characteristic_length,
            extra_values,
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
        names = tuple(name for name in self.formula.points if name in points)
        columns: list[Array] = []
        shapes: dict[str, tuple[int, ...]] = {}
        for name in names:
            column = np.atleast_2d(np.asarray(points[name], float))
            columns.append(column)
            shapes[name] = column.shape
        if not names or set(shapes.values()) != {(len(columns[0]), 3)}:
            raise KinematicsError(
                f"formula '{self.formula.name}': give points as (k, 3) arrays of equal length; found {shapes}."
            )
        return self.program.from_points(names).many(np.hstack(columns))

    def points_many(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> dict[str, Array]:
        """Return the named points {name: (k, 3)} in base, in m."""
        positions = self.program.points.many(self._states(Ts, qs))
        return {name: positions[:, i] for i, name in enumerate(self.formula.points)}

    def passive_many(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> dict[str, Array]:
        """Return the values of the passive joints {name: (k,)} in rad or m."""
        return self._named("passive", Ts, qs)

    def inverse_jacobian(self, T: ArrayLike | None = None, q: ArrayLike | None = None) -> Array:
        """Return the inverse Jacobian (n, 6), joint rates per tool twist, at the pose T or at q.

        If both T and q are given, T is used, except for a formula without inverse equations, which uses q.
        """
        return self.inverse_jacobian_many(_batch_of_one(T), _batch_of_one(q))[0]

    def inverse_jacobian_many(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> Array:
        """Return the inverse Jacobians (k, n, 6), joint rates per tool twist; NaN at singularities.

        Without inverse equations, the pseudo-inverses of `jacobian_many` are returned.
        """
        if self.closed_inverse:
            return self.program.inverse_jacobian.many(self._states(Ts, qs))
        return conditioning.invert_many(self.program.forward_jacobian.many(self._states(Ts, qs)))

    def jacobian(self, T: ArrayLike | None = None, q: ArrayLike | None = None) -> Array:
        """Return the Jacobian (6, n), tool twist per joint rates, at the pose T or at q.

        Raises:
            KinematicsError: the Jacobian does not exist (singular, or out of reach).
        """
        J = self.jacobian_many(_batch_of_one(T), _batch_of_one(q))[0]
        if not np.isfinite(J).all():
            raise KinematicsError(
                f"{self.formula.name}: the Jacobian does not exist at this pose: the pose is singular or out of reach."
            )
        return J

    def jacobian_many(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> Array:
        """Return the Jacobians (k, 6, n), tool twist per joint rates; NaN at singularities.

        With forward equations they are those at qs, if given, also if the formula has inverse equations; without
        forward equations, the inverses of `inverse_jacobian_many` are returned.
        """
        if not self.closed_forward:
            return conditioning.invert_many(self.program.inverse_jacobian.many(self._states(Ts, qs)))
        # The forward equations need q, also in a formula whose other functions start from poses.
        q = self.inverse_many(_required(Ts)) if qs is None else self._joints(qs)
        return self.program.forward_jacobian.many(q)

    def singularity(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> dict[str, Array]:
        """Return the singularity measures {name: (k,)}, dimensionless; each is 0 at its singularity."""
        return self._named("measure", Ts, qs)

    def singularity_alarm(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> dict[str, np.ndarray]:
        """Return {name of a measure: (k,) bool}; true where |measure| is below the alarm value, or is NaN."""
        values = self.singularity(Ts, qs)
        alarms: dict[str, np.ndarray] = {}
        for measure in self.formula.measures:
            is_safe = np.abs(values[measure.name]) >= measure.alarm
            alarms[measure.name] = ~is_safe  # also where the measure is NaN
        return alarms

    def reach(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> dict[str, Array]:
        """Return the reach margins {name: (k,)} in m; negative where the chain cannot reach."""
        return self._named("reach", Ts, qs)

    def aspect_signs(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> Array:
        """Return the signs (k, m) of the formula's m aspects: -1, 0 or +1; 0 also where an aspect is undefined."""
        return np.nan_to_num(np.sign(self.program.group["aspect"].many(self._states(Ts, qs))))

    def branch(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> np.ndarray:
        """Return the labels (k,) of the assemblies: names and signs of the aspects, such as "X_E+ z_up+ D-"."""
        marks = {1: "+", -1: "-", 0: "0"}
        names = self.formula.scalars["aspect"]
        labels: list[str] = []
        for signs in self.aspect_signs(Ts, qs):
            parts = []
            for name, sign in zip(names, signs, strict=True):
                parts.append(f"{name}{marks[int(sign)]}")
            labels.append(" ".join(parts))
        return np.array(labels)

    @property
    def preferred_branch(self) -> str:
        """Label that `branch` returns for the preferred assembly."""
        parts: list[str] = []
        for aspect in self.formula.aspects:
            mark = "+" if aspect.preferred > 0 else "-"
            parts.append(f"{aspect.symbol}{mark}")
        return " ".join(parts)

    def condition(self, T: ArrayLike | None = None, q: ArrayLike | None = None) -> float:
        """Return the condition number of the Jacobian at a pose or at q; see `condition_many`."""
        return float(self.condition_many(_batch_of_one(T), _batch_of_one(q))[0])

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
        return conditioning.condition_many(J)

    def why(self, T: Array) -> str:
        """Return a text: the line of a formula file whose result at a pose (4, 4) is NaN or infinite, and the cause.

        Only files with functions `inverse` or `forward` are traced (see `twin.formula.plain`). "": no line was found.
        """
        if self.formula.first_fault is None:
            return ""
        return self.formula.first_fault(T, self.parameters)

    def takes(self, Ts: ArrayLike) -> bool:
        """Return whether the equations prove that the robot can have the poses Ts (k, 4, 4); False: not proved.

        A robot with fewer than six degrees of freedom cannot have every pose. Each of three facts is a proof: the robot
        has six degrees of freedom; the inverse equations (which return NaN for a pose that the robot cannot have) have
        a solution for each pose; the forward equations reproduce each pose.
        """
        Ts = poses(Ts)
        if len(self.formula.joints) >= 6:
            if not self.closed_inverse:
                return False
            J = self.inverse_jacobian_many(Ts[:1])[0]
            return bool(np.isfinite(J).all() and np.linalg.matrix_rank(J) == 6)
        q = self.inverse_many(Ts)
        if not np.isfinite(q).all():
            return False
        if not self.closed_inverse:
            return True  # the solver converged
        if not self.closed_forward:
            # With fewer than six coordinates, `inverse_many` has compared their pose with the given one.
            return len(self.formula.coordinates.names) < 6
        Ts_of_q = self.program.forward.many(q)
        return bool(np.abs(Ts_of_q - Ts).max() <= POSE_TOL)

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
        """Return {name: (k,)} of the scalars of one kind: "passive", "measure" or "reach"."""
        names = self.formula.scalars[kind]
        if not names:  # without an inverse equation, the states would be solved for nothing
            return {}
        values = self.program.group[kind].many(self._states(Ts, qs))
        return dict(zip(names, values.T, strict=True))

    def _states(self, Ts: ArrayLike | None, qs: ArrayLike | None) -> Array:
        """Return the input of the compiled functions: poses (k, 16), or joints (k, n)."""
        if self.closed_inverse:
            matrices = self.forward_many(_required(qs)) if Ts is None else poses(Ts)
            return matrices.reshape(-1, 16)
        if qs is None:
            return self.inverse_many(_required(Ts))
        return self._joints(qs)

    def _joints(self, q: ArrayLike, batch: bool = True) -> Array:
        """Return q as an array; raise `KinematicsError` unless it is (n,) or, with `batch`, (k, n)."""
        n = len(self.joints)
        q = np.asarray(q, float)
        if q.ndim != 1 + batch or q.shape[-1] != n:
            shape = f"(k, {n})" if batch else f"({n},)"
            raise KinematicsError(
                f"{self.formula.name}: q must have shape {shape} for {', '.join(self.joints)}, not {q.shape}."
            )
        return q

    def _seed(self, seed: ArrayLike | None) -> Array | None:
        """Return the seed as a pose (4, 4), or None if it is not used."""
        if seed is None or not self.closed_inverse:
            return None  # a forward equation needs no seed
        T = poses(seed, batch=False)
        misfit = self.program.inverse.one(T.ravel())[-1]
        if not misfit <= POSE_TOL:
            raise KinematicsError(f"{self.formula.name}: the seed is not a rigid pose (4, 4) in metres.")
        return T


def _required(value: ArrayLike | None) -> ArrayLike:
    """Return poses or joint values; raise `KinematicsError` if a caller gave neither of the two."""
    if value is None:
        raise KinematicsError("give poses (T or Ts) or joint values (q or qs); both are missing.")
    return value


def _batch_of_one(value: ArrayLike | None) -> Array | None:
    """Return a pose or joint values as a batch of one."""
    if value is None:
        return None
    return np.asarray(value, float)[None]


def poses(Ts: ArrayLike, batch: bool = True) -> Array:
    """Return poses (k, 4, 4), or a pose (4, 4), as contiguous floats; raise `KinematicsError` for any other shape."""
    Ts = np.ascontiguousarray(Ts, float)
    if Ts.ndim != 2 + batch or Ts.shape[-2:] != (4, 4):
        shape = "(k, 4, 4)" if batch else "(4, 4)"
        raise KinematicsError(f"poses must have shape {shape}, not {Ts.shape}.")
    return Ts
