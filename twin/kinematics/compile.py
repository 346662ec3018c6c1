"""Compile a formula: choose variants, bake in parameters, and answer in numpy.

Everything is SI. Poses are T_base_tool (4, 4); batches carry the time axis first. Twists and Jacobian
rows are linear first, in base axes, at the tool origin.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from twin.errors import KinematicsError, unknown
from twin.kinematics import assembly, flow, singularity
from twin.kinematics.contract import Formula, check_formula
from twin.kinematics.program import Program
from twin.spatial import Array
from twin.units import MM

POSE_TOL = 1e-6
"""Norm of what a pose may differ by from the one that its coordinates describe."""


def compile_formula(
    formula: Formula,
    variants: Mapping[str, str] | str | None = None,
    parameters: Mapping[str, float] | None = None,
) -> Kinematics:
    """Compile a formula.

    Args:
        formula: the equations.
        variants: equation -> variant, or one name for all equations that have it; default: each its own.
        parameters: parameter -> value in SI, to replace published values.

    Raises:
        KinematicsError: if the formula breaks the contract, or a name is unknown, or a value not finite.

    """
    check_formula(formula)
    chosen = flow.choose(formula, variants)
    values = {p.name: float(p.value) for p in formula.parameters}
    for name, value in (parameters or {}).items():
        if name not in values:
            raise KinematicsError(f"formula '{formula.name}': {unknown('parameter', name, values)}")
        if not np.isfinite(value):
            raise KinematicsError(f"formula '{formula.name}': parameter '{name}' is {value}, not a finite number.")
        values[name] = float(value)
    return Kinematics(formula, chosen, values)


class Kinematics:
    """A compiled formula; made by `compile_formula`.

    Methods that take `Ts` and `qs` need the poses (k, 4, 4) if the formula has a closed inverse, else the
    joints (k, n); what is missing is solved for.

    Attributes:
        formula: what was compiled.
        joints: active joints, in the order of q.
        variants: the variant in use, by equation.
        choices: the variants that exist, by equation.
        parameters: the values in use, in SI.
        closed_inverse, closed_forward: whether equations give q from the pose, the pose from q.
        characteristic_length: in m; a rotation by 1 rad counts as much as a translation by this.
        revolute: (n,) bool, which joints are angles.
        program: the compiled functions.

    """

    def __init__(self, formula: Formula, variants: Mapping[str, str], parameters: Mapping[str, float]) -> None:
        self.formula = formula
        self.joints = tuple(j.name for j in formula.joints)
        self.variants, self.parameters = dict(variants), dict(parameters)
        self.choices = {e.name: tuple(e.variants) for e in formula.equations if e.stage != "helper"}
        self.closed_inverse, self.closed_forward = formula.has("inverse"), formula.has("forward")
        self.revolute = np.array([j.kind == "revolute" for j in formula.joints])
        what = f"formula '{formula.name}', characteristic_length"
        self.characteristic_length = float(flow.call(formula.characteristic_length, parameters, what))  # type: ignore[arg-type]
        self.program = Program(formula, self.variants, self.parameters, self.joints, self.characteristic_length)
        if self.closed_inverse:
            self.program.inverse  # noqa: B018 - made now, so that a bad to_pose fails when compiled

    def inverse(self, T_base_tool: ArrayLike, seed: ArrayLike | None = None) -> Array:
        """Return q (n,) in m or rad at a pose (4, 4).

        Args:
            T_base_tool: the pose.
            seed: q to start from; used only without a closed inverse.

        Raises:
            KinematicsError: if the pose is not rigid, or out of reach (which chain, by how much).

        """
        T = _poses(T_base_tool, batch=False)
        if not self.closed_inverse:
            return assembly.inverse_by_solver(self, T, seed)
        out = self.program.inverse.one(T.ravel())
        q, misfit = out[:-1], out[-1]
        if not misfit <= POSE_TOL:
            raise KinematicsError(
                f"{self.formula.name}: no values of {', '.join(self.formula.coordinates.names)} "
                f"describe this pose (off by {misfit:.3g}). Is it a rigid pose in metres?",
                best=q,
            )
        if not np.isfinite(q).all():
            raise KinematicsError(self._why_unreachable(T))
        return q

    def inverse_many(self, Ts_base_tool: ArrayLike) -> Array:
        """Return q (k, n) at poses (k, 4, 4); NaN rows where the pose is out of reach or not rigid."""
        Ts = _poses(Ts_base_tool)
        if not self.closed_inverse:
            return assembly.inverse_by_solver_many(self, Ts)
        out = self.program.inverse.many(Ts.reshape(-1, 16))
        q = out[:, :-1].copy()
        q[~(out[:, -1] <= POSE_TOL) | ~np.isfinite(q).all(axis=1)] = np.nan
        return q

    def inverse_of_all(self, Ts_base_tool: ArrayLike, seed: ArrayLike | None = None) -> Array:
        """Return q (k, n) at poses (k, 4, 4), every one of which is to have an answer.

        Args:
            Ts_base_tool: the poses.
            seed: q of the first pose to start from, without a closed inverse; the others start from the one before.

        Raises:
            KinematicsError: as `inverse`, for the first pose without an answer, with its index and how many there are.

        """
        Ts = _poses(Ts_base_tool)
        q = self.inverse_many(Ts) if self.closed_inverse else assembly.inverse_by_solver_many(self, Ts, seed)
        lost = np.flatnonzero(~np.isfinite(q).all(axis=1))
        if len(lost):
            k = int(lost[0])
            before = q[k - 1] if k else seed
            try:
                self.inverse(Ts[k], before)
            except KinematicsError as error:
                others = f"; poses without an answer: {len(lost)} of {len(Ts)}" if len(lost) > 1 else ""
                raise KinematicsError(f"pose {k} (of 0 .. {len(Ts) - 1}): {error}{others}", best=error.best) from None
            raise KinematicsError(f"{self.formula.name}: pose {k} (of 0 .. {len(Ts) - 1}) has no answer")
        return q

    def joints_from_points(self, points: Mapping[str, ArrayLike]) -> Array:
        """Return q (k, n) from named points {name: (k, 3)} in m: the equations behind the points alone.

        Raises:
            KinematicsError: if a point is unknown or missing, or the equations also need the pose.

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
        """Return the passive joints {name: (k,)} in rad or m."""
        return self._named("passive", Ts, qs)

    def forward(self, q: ArrayLike, seed: ArrayLike | None = None) -> Array:
        """Return T_base_tool (4, 4) at q (n,).

        Args:
            q: active joints in m or rad.
            seed: pose to start from; the answer has its branch label. Without it: the preferred branch.

        Raises:
            KinematicsError: if no assembly is found; `best` is the best pose.

        """
        return assembly.forward(self, self._joints(q, batch=False), self._seed(seed))

    def forward_many(self, qs: ArrayLike, seed: ArrayLike | None = None) -> Array:
        """Return poses (k, 4, 4) at qs (k, n), each solved from the one before it; NaN where there is none.

        Args:
            qs: active joints, usually along a path.
            seed: pose (4, 4) to begin from; or poses (k, 4, 4), one for each row: then all at once.

        """
        qs = self._joints(qs)
        if seed is not None and np.ndim(seed) == 3:
            Ts = _poses(seed)
            if len(Ts) != len(qs):
                raise KinematicsError(f"{len(Ts)} seed poses for {len(qs)} rows of q.")
            return assembly.forward_many(self, qs, Ts)
        return assembly.forward_many(self, qs, self._seed(seed))

    def branches(self, q: ArrayLike) -> list[Array]:
        """Return all assemblies at q (n,) as poses, the preferred branch first; none: an empty list.

        Raises:
            KinematicsError: if the formula can neither enumerate them nor go forward.

        """
        return assembly.branches(self, self._joints(q, batch=False))

    def inverse_jacobian(self, T: ArrayLike | None = None, q: ArrayLike | None = None) -> Array:
        """Return dq/dtwist (n, 6) at a pose (or at q, for a formula that is only forward)."""
        return self.inverse_jacobian_many(_one(T), _one(q))[0]

    def inverse_jacobian_many(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> Array:
        """Return dq/dtwist (k, n, 6), NaN where it does not exist; by pseudo-inverse if only forward."""
        if self.closed_inverse:
            return self.program.inverse_jacobian.many(self._states(Ts, qs))
        return singularity.invert_many(self.program.forward_jacobian.many(self._states(Ts, qs)))

    def jacobian(self, T: ArrayLike | None = None, q: ArrayLike | None = None) -> Array:
        """Return dtwist/dq (6, n) at a pose, or at q.

        Raises:
            KinematicsError: where it does not exist (singular, or out of reach).

        """
        J = self.jacobian_many(_one(T), _one(q))[0]
        if not np.isfinite(J).all():
            raise KinematicsError(f"{self.formula.name}: no Jacobian here: singular, or out of reach.")
        return J

    def jacobian_many(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> Array:
        """Return dtwist/dq (k, 6, n); NaN where it does not exist."""
        if self.closed_forward:
            return self.program.forward_jacobian.many(
                self._joints(qs) if qs is not None else self.inverse_many(_need(Ts, "poses"))
            )
        return singularity.invert_many(self.program.inverse_jacobian.many(self._states(Ts, qs)))

    def singularity(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> dict[str, Array]:
        """Return the singularity measures {name: (k,)}, dimensionless; each vanishes at its singularity."""
        return self._named("measure", Ts, qs)

    def singularity_alarm(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> dict[str, np.ndarray]:
        """Return {name: (k,) bool}: whether a measure is below its alarm, or has no value."""
        values = self.singularity(Ts, qs)
        return {m.name: ~(np.abs(values[m.name]) >= m.alarm) for m in self.formula.measures}

    def reach(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> dict[str, Array]:
        """Return the reach margins {name: (k,)} in m; >= 0 where the chain reaches."""
        return self._named("reach", Ts, qs)

    def aspect_signs(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> Array:
        """Return the signs (k, m) of the formula's aspects: -1, +1, or 0 (also where undefined)."""
        return np.nan_to_num(np.sign(self.program.group["aspect"].many(self._states(Ts, qs))))

    def branch(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> np.ndarray:
        """Return the label (k,) of the assembly by the formula's aspects: "X_E+ z_up+ D-"."""
        names, marks = self.program.scalars["aspect"], {1: "+", -1: "-", 0: "0"}
        rows = self.aspect_signs(Ts, qs)
        return np.array([" ".join(f"{n}{marks[int(s)]}" for n, s in zip(names, r, strict=True)) for r in rows])

    @property
    def preferred_branch(self) -> str:
        """The label that `branch` gives to the preferred assembly."""
        return " ".join(f"{a.symbol}{'+' if a.preferred > 0 else '-'}" for a in self.formula.aspects)

    def condition(self, T: ArrayLike | None = None, q: ArrayLike | None = None) -> float:
        """Return the condition number of the Jacobian, rotations scaled by the characteristic length."""
        if self.closed_forward:
            return singularity.condition(self.jacobian(T, q), self.characteristic_length)
        return singularity.condition_inverse(self.inverse_jacobian(T, q), self.characteristic_length)

    def condition_many(self, Ts: ArrayLike | None = None, qs: ArrayLike | None = None) -> Array:
        """Return the condition numbers (k,), as `condition`; infinite where singular or without a Jacobian."""
        if self.closed_forward:
            J = self.jacobian_many(Ts, qs)
            J[:, 3:] *= self.characteristic_length
        else:
            J = self.inverse_jacobian_many(Ts, qs)
            J[:, :, 3:] /= self.characteristic_length
        return singularity.condition_many(J)

    def why(self, T: Array) -> str:
        """Return where a plain formula has no value at a pose (4, 4), and the reason; empty: it cannot tell."""
        return self.formula.numbers(T, self.parameters) if self.formula.numbers is not None else ""

    def takes(self, Ts: ArrayLike) -> bool:
        """Return whether the equations by themselves make sure that poses (k, 4, 4) are within the robot's freedoms.

        So they do where they have six of them, where they have fewer coordinates (a pose that these do not describe
        has no joint values), and where they lead back to the pose. Else they cannot tell, or deny it.
        """
        Ts = _poses(Ts)
        if len(self.joints) >= 6:
            J = self.inverse_jacobian_many(Ts[:1])[0] if self.closed_inverse else np.zeros((6, 6))
            return bool(np.isfinite(J).all() and np.linalg.matrix_rank(J) == 6)
        q = self.inverse_many(Ts)
        if not np.isfinite(q).all():
            return False
        if not self.closed_inverse or (len(self.formula.coordinates.names) < 6 and not self.closed_forward):
            return True  # solved for to the last digit, or measured by `inverse_many`
        if not self.closed_forward:
            return False
        back = self.program.forward.many(q)
        return bool(np.abs(back - Ts).max() <= POSE_TOL)

    def need_six_joints(self) -> None:
        """Raise `KinematicsError` if the pose cannot be solved for: fewer joints and no forward equation."""
        if not self.closed_forward and len(self.joints) != 6:
            raise KinematicsError(
                f"{self.formula.name}: {len(self.joints)} joints do not fix the 6 freedoms of a pose; "
                "add a forward equation to the formula."
            )

    def _named(self, kind: str, Ts: ArrayLike | None, qs: ArrayLike | None) -> dict[str, Array]:
        values = self.program.group[kind].many(self._states(Ts, qs))
        return {name: values[:, i] for i, name in enumerate(self.program.scalars[kind])}

    def _states(self, Ts: ArrayLike | None, qs: ArrayLike | None) -> Array:
        """Return what the compiled functions take: poses (k, 16), or joints (k, n)."""
        if self.closed_inverse:
            return (_poses(Ts) if Ts is not None else self.forward_many(_need(qs, "joints"))).reshape(-1, 16)
        return self._joints(qs) if qs is not None else self.inverse_many(_need(Ts, "poses"))

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
        T = _poses(seed, batch=False)
        if not self.program.inverse.one(T.ravel())[-1] <= POSE_TOL:
            raise KinematicsError(f"{self.formula.name}: the seed is not a rigid pose (4, 4) in metres.")
        return T

    def _why_unreachable(self, T: Array) -> str:
        margins = self.reach(T[None])
        short = [f"{name} by {-m[0] / MM:.3f} mm" for name, m in margins.items() if m[0] < 0]
        where = np.array2string(T[:3, 3] / MM, precision=1, suppress_small=True)
        if short:
            return f"{self.formula.name}: tool at {where} mm is out of reach: {', '.join(short)} too far."
        why = self.why(T)
        return f"{self.formula.name}: the equations have no real solution with the tool at {where} mm. {why}".rstrip()


def _need(value: ArrayLike | None, what: str) -> ArrayLike:
    if value is None:
        raise KinematicsError(f"give {what}.")
    return value


def _one(value: ArrayLike | None) -> Array | None:
    return None if value is None else np.asarray(value, float)[None]


def _poses(Ts: ArrayLike, batch: bool = True) -> Array:
    Ts = np.ascontiguousarray(Ts, float)
    if Ts.ndim != 2 + batch or Ts.shape[-2:] != (4, 4):
        raise KinematicsError(f"poses must have shape {'(k, 4, 4)' if batch else '(4, 4)'}, not {Ts.shape}.")
    return Ts
