"""Levenberg-Marquardt for every robot: the unknown is the joints where they give the pose, else the pose.

Nielsen's damping: the step minimises |J dx + r|^2 + mu |dx|^2; mu falls when the model predicts the
decrease well and doubles faster and faster when it does not. Residuals are dimensionless through
`length_scale`: 1 rad weighs as much as a miss by that length.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from twin import spatial
from twin.errors import KinematicsError
from twin.kinematics.tasks import Joints, Pose, Position, Task, Tip, Trocar, evaluate
from twin.spatial import Array

if TYPE_CHECKING:
    from twin.kinematics.compile import Kinematics

__all__ = ["Joints", "Pose", "Position", "Solution", "Task", "Tip", "Trocar", "descend", "seeds", "solve"]

TOLERANCE = 1e-10
"""Norm of the dimensionless residual at which a task counts as fulfilled: 8e-12 m for SILS."""

MAX_ITERATIONS = 120

_MU_FLOOR = 1e-11
"""Smallest damping, by the largest squared column of the first Jacobian."""

_LIMIT_TOL = 1e-9
"""Breach of a joint limit in m or rad that is rounding, not a breach."""


@dataclass(frozen=True)
class Solution:
    """Answer of `solve`.

    Attributes:
        q: active joints (n,) in m or rad.
        T_base_tool: pose (4, 4).
        residual: norm of the dimensionless, weighted residual.
        branch: label of the assembly, as from `Kinematics.branch`.
        iterations: steps tried, in all starts together.

    """

    q: Array
    T_base_tool: Array
    residual: float
    branch: str
    iterations: int


@dataclass(frozen=True)
class Descent:
    """Where one descent ended: state `T` (4, 4) and `q` (n,), residual of the task, steps tried."""

    T: Array
    q: Array
    residual: float
    iterations: int


def solve(
    kin: Kinematics,
    task: Task,
    seed: ArrayLike | None = None,
    limits: ArrayLike | None = None,
    *,
    starts: int = 48,
    rng: int = 0,
    any_branch: bool = False,
    length_scale: float | None = None,
    tolerance: float = TOLERANCE,
) -> Solution:
    """Solve a task.

    Args:
        kin: the robot.
        task: what is asked for; several with `+`, weighted with `*`.
        seed: q (n,) or pose (4, 4) to start from.
        limits: (n, 2) lower and upper limit of each joint, in m or rad; infinite where there is none.
        starts: how many starting values are tried: the seed, the formula's own, then random ones.
        rng: seed of the random ones; the same number gives the same answer.
        any_branch: accept any assembly or configuration, not only the seed's or the preferred one.
        length_scale: in m; default the robot's characteristic length.
        tolerance: norm of the dimensionless residual that counts as solved.

    Returns:
        The first solution on the seed's branch (without a seed: the preferred one) within the limits.

    Raises:
        KinematicsError: if no start leads to a solution; `best` is the best `Solution`.

    """
    kin.need_six_joints()
    bounds = _bounds(kin, limits)
    begin = _state(kin, seed) if seed is not None else None
    wanted = kin.preferred_branch if begin is None else _label(kin, begin)
    tried, best, why, iterations = 0, None, "", 0
    first = [] if begin is None else [begin]
    for start in islice(chain(first, seeds(kin, rng, starts, bounds)), starts):
        tried += 1
        result = descend(kin, task, start, bounds, length_scale, tolerance)
        iterations += result.iterations
        label = _label(kin, result.q if kin.closed_forward else result.T)
        broken = _breaches(kin, result.q, bounds)
        fine = result.residual <= tolerance and not broken and (any_branch or label == wanted)
        if best is None or (result.residual, len(broken)) < (
            best.residual,
            len(_breaches(kin, best.q, bounds)),
        ):
            best, why = Solution(result.q, result.T, result.residual, label, iterations), "; ".join(broken)
        if fine:
            return Solution(result.q, result.T, result.residual, label, iterations)
    if best is None:
        raise KinematicsError(f"{kin.formula.name}: no start: give a seed, or seeds in the formula.")
    if best.residual > tolerance:
        why = f"residual {best.residual:.3g} (dimensionless) stays above {tolerance:g}" + (f"; {why}" if why else "")
    elif not why:
        why = f"found only on branch {best.branch}, not on {wanted}"
    best = replace(best, iterations=iterations)
    raise KinematicsError(
        f"{kin.formula.name}: no solution of the task in {tried} starts: {why}.",
        best=best,
        residual=best.residual,
    )


def seeds(kin: Kinematics, rng: int, starts: int, bounds: Array | None = None) -> Iterator[Array]:
    """Yield starting states: q (n,) if there is a forward equation, else poses (4, 4).

    First the formula's seeds, then random ones: about them for poses, within the limits (or a full turn,
    or 1 m) for joints.
    """
    homes = [_from_formula(kin, np.asarray(s, float)) for s in kin.formula.seeds][:starts]
    yield from homes
    generator = np.random.default_rng(rng)
    if not kin.closed_forward:
        for i in range(len(homes), starts if homes else 0):
            T, xi = homes[generator.integers(len(homes))], generator.uniform(-1, 1, 6)
            spread = 0.2 + 0.8 * i / starts  # wider and wider, so that near starts come first
            R = spatial.exp_so3(spread * xi[3:]) @ T[:3, :3]
            yield spatial.pose(R, T[:3, 3] + 2 * spread * kin.characteristic_length * xi[:3])
        return
    low, high = (bounds if bounds is not None else _bounds(kin, None)).T
    reach = np.where(kin.revolute, np.pi, 1.0)
    low, high = np.where(np.isfinite(low), low, -reach), np.where(np.isfinite(high), high, reach)
    for _ in range(len(homes), starts):
        yield generator.uniform(low, high)


def descend(
    kin: Kinematics,
    task: Task,
    start: Array,
    bounds: Array | None = None,
    length_scale: float | None = None,
    tolerance: float = TOLERANCE,
) -> Descent:
    """Return where one descent from a state ends (converged or not); the start must be within reach.

    Joint unknowns are held within their bounds by projection; pose unknowns by a residual that grows with
    the breach, which is zero at any solution within the limits.
    """
    problem = (_JointProblem if kin.closed_forward else _PoseProblem)(kin, task, bounds, length_scale)
    x = problem.begin(start)
    r, J = problem.at(x)
    if not np.isfinite(r).all():
        return Descent(*problem.result(x), residual=np.inf, iterations=0)
    size = np.max(np.sum(J * J, axis=0), initial=1e-12)
    cost, mu, grow = r @ r, 1e-3 * size, 2.0
    tried = stuck = 0
    while tried < MAX_ITERATIONS and cost > (0.01 * tolerance) ** 2:
        free = problem.free(x, J.T @ r)
        if not free.any():
            break
        tried += 1
        Jf = J[:, free]
        g = Jf.T @ r
        step = np.zeros(J.shape[1])
        step[free] = -np.linalg.solve(Jf.T @ Jf + mu * np.eye(Jf.shape[1]), g)
        new = problem.move(x, step)
        r_new, J_new = problem.at(new)
        cost_new = r_new @ r_new
        predicted = step[free] @ (mu * step[free] - g)
        if np.isfinite(cost_new) and np.isfinite(J_new).all() and cost_new < cost:
            ratio = (cost - cost_new) / max(predicted, 1e-300)
            stuck = stuck + 1 if cost - cost_new < 1e-12 * cost else 0
            x, r, J, cost = new, r_new, J_new, cost_new
            # Not below the floor: what a task leaves free would be moved by rounding divided by mu.
            mu, grow = max(mu * max(1 / 30, 1 - (2 * ratio - 1) ** 3), _MU_FLOOR * size), 2.0
        else:
            mu, grow = mu * grow, grow * 2
            stuck += np.linalg.norm(step) < 1e-14
        if stuck >= 3 or mu > 1e12:
            break
    return Descent(*problem.result(x), residual=problem.task_residual(x), iterations=tried)


class _Problem:
    """Residual and Jacobian of a task by the unknown; `length_scale` makes both dimensionless."""

    def __init__(self, kin: Kinematics, task: Task, bounds: Array | None, length_scale: float | None) -> None:
        self.kin, self.task, self.bounds = kin, task, bounds
        self.scale = kin.characteristic_length if length_scale is None else float(length_scale)
        if not self.scale > 0:
            raise KinematicsError(f"length_scale {length_scale} m must be positive.")
        self.joint_scale = np.where(kin.revolute, 1.0, 1 / self.scale)

    def rows(self, T: Array, q: Array, by_twist: Array, by_joints: Array) -> tuple[Array, Array]:
        """Return the weighted rows of the task and their Jacobian, from those of pose and joints by x."""
        rs, Js = [np.zeros(0)], [np.zeros((0, by_twist.shape[1]))]
        for term in self.task.terms:
            if term.kind == "joints":
                if len(term.numbers) != len(q):
                    raise KinematicsError(f"task Joints: {len(term.numbers)} values for {len(q)} joints.")
                r, J, w = q - term.numbers, by_joints, self.joint_scale * term.weight
            else:
                r, by_pose, lengths = evaluate(term, T)
                J, w = by_pose @ by_twist, np.where(lengths, 1 / self.scale, 1.0) * term.weight
            rs.append(w * r)
            Js.append(w[:, None] * J)
        return np.concatenate(rs), np.vstack(Js)

    def task_residual(self, x: Array) -> float:
        """Return the norm of the task's rows at x, without those that keep the limits."""
        raise NotImplementedError


class _PoseProblem(_Problem):
    """Unknown: the pose; steps are twists with the linear part divided by the length scale."""

    def begin(self, start: Array) -> Array:
        return start

    def at(self, T: Array) -> tuple[Array, Array]:
        q = self.kin.program.inverse.one(T.ravel())[:-1]
        if not np.isfinite(q).all():
            return np.array([np.inf]), np.zeros((1, 6))
        by_twist = np.diag([self.scale] * 3 + [1.0] * 3)
        by_joints = self.kin.program.inverse_jacobian.one(T.ravel()) @ by_twist
        r, J = self.rows(T, q, by_twist, by_joints)
        if self.bounds is not None:
            over = np.minimum(q - self.bounds[:, 0], 0) + np.maximum(q - self.bounds[:, 1], 0)
            bad = over != 0
            r = np.concatenate([r, (self.joint_scale * over)[bad]])
            J = np.vstack([J, (self.joint_scale[:, None] * by_joints)[bad]])
        return r, J

    def free(self, T: Array, gradient: Array) -> np.ndarray:
        return np.ones(6, bool)

    def move(self, T: Array, step: Array) -> Array:
        return spatial.pose(spatial.exp_so3(step[3:]) @ T[:3, :3], T[:3, 3] + self.scale * step[:3])

    def result(self, T: Array) -> tuple[Array, Array]:
        return T, self.kin.program.inverse.one(T.ravel())[:-1]

    def task_residual(self, T: Array) -> float:
        bounds, self.bounds = self.bounds, None
        r, _ = self.at(T)
        self.bounds = bounds
        return float(np.linalg.norm(r))


class _JointProblem(_Problem):
    """Unknown: q, in rad and in lengths divided by the length scale."""

    def begin(self, start: Array) -> Array:
        return start if self.bounds is None else np.clip(start, self.bounds[:, 0], self.bounds[:, 1])

    def at(self, q: Array) -> tuple[Array, Array]:
        T = self.kin.program.forward.one(q)
        by_joints = np.diag(1 / self.joint_scale)
        if not np.isfinite(T).all():
            return np.array([np.inf]), np.zeros((1, len(q)))
        return self.rows(T, q, self.kin.program.forward_jacobian.one(q) @ by_joints, by_joints)

    def free(self, q: Array, gradient: Array) -> np.ndarray:
        """Return which joints may move: not those at a limit that the descent would push through."""
        if self.bounds is None:
            return np.ones(len(q), bool)
        low, high = self.bounds.T
        return ~(((q <= low) & (gradient > 0)) | ((q >= high) & (gradient < 0)))

    def move(self, q: Array, step: Array) -> Array:
        q = q + step / self.joint_scale
        return q if self.bounds is None else np.clip(q, self.bounds[:, 0], self.bounds[:, 1])

    def result(self, q: Array) -> tuple[Array, Array]:
        return self.kin.program.forward.one(q), q

    def task_residual(self, q: Array) -> float:
        return float(np.linalg.norm(self.at(q)[0]))


def _from_formula(kin: Kinematics, seed: Array) -> Array:
    """Return the state of a seed of the formula: coordinates, or q for a formula that is only forward."""
    if not kin.closed_inverse:
        return seed
    T = kin.program.pose_of_coordinates.one(seed)
    return kin.inverse(T) if kin.closed_forward else T


def _state(kin: Kinematics, seed: ArrayLike) -> Array:
    """Return the state of a seed, q (n,) or pose (4, 4)."""
    seed = np.asarray(seed, float)
    if seed.shape == (4, 4):
        if not spatial.is_pose(seed, 1e-6):
            raise KinematicsError("the seed is not a rigid pose (4, 4).")
        return kin.inverse(seed) if kin.closed_forward else seed
    if seed.shape == (len(kin.joints),):
        return seed if kin.closed_forward else kin.forward(seed)
    raise KinematicsError(f"a seed must be q ({len(kin.joints)},) or a pose (4, 4), not {seed.shape}.")


def _label(kin: Kinematics, state: Array) -> str:
    return str((kin.branch(qs=state[None]) if kin.closed_forward else kin.branch(Ts=state[None]))[0])


def _bounds(kin: Kinematics, limits: ArrayLike | None) -> Array:
    n = len(kin.joints)
    if limits is None:
        return np.tile([-np.inf, np.inf], (n, 1))
    bounds = np.asarray(limits, float)
    if bounds.shape != (n, 2) or not np.all(bounds[:, 0] < bounds[:, 1]):
        raise KinematicsError(f"limits must be ({n}, 2), lower below upper, for {', '.join(kin.joints)}.")
    return bounds


def _breaches(kin: Kinematics, q: Array, bounds: Array) -> list[str]:
    unit = np.where(kin.revolute, "rad", "m")
    return [
        f"{name} = {v:.6g} {u} is outside {low:g} .. {high:g}"
        for name, v, u, (low, high) in zip(kin.joints, q, unit, bounds, strict=True)
        if not low - _LIMIT_TOL <= v <= high + _LIMIT_TOL
    ]
