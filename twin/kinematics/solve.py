"""Levenberg-Marquardt solver for every robot. The unknowns are the joints or, without a forward equation, the pose.

Residuals are made dimensionless: an error of `length_scale` counts as much as an error of 1 rad.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.kinematics.compiled import Compiled
from twin.kinematics.descent import iteration
from twin.kinematics.tasks import Joints, Pose, Task, Tip, Trocar, is_length

__all__ = ["Joints", "Pose", "Solution", "Task", "Tip", "Trocar", "descend", "seeds", "solve"]

TOLERANCE = 1e-10
"""Norm of the dimensionless residual below which a task counts as solved; for the robot SILS, this is 8e-12 m."""

_LIMIT_TOL = 1e-9
"""Excess over a joint limit in m or rad that is ignored as a rounding error."""


@dataclass(frozen=True)
class Solution:
    """Solution of a task.

    Attributes:
        q: active joints (n,) in m or rad.
        T_base_tool: pose (4, 4).
        residual: norm of the dimensionless, weighted residual.
        branch: label of the assembly, as from `Kinematics.branch`.
        iterations: total number of steps tried in all starts.
    """

    q: Array
    T_base_tool: Array
    residual: float
    branch: str
    iterations: int


@dataclass(frozen=True)
class Descent:
    """Result of one descent: pose `T` (4, 4), joints `q` (n,), residual of the task, number of steps tried."""

    T: Array
    q: Array
    residual: float
    iterations: int


def solve(
    kin: Compiled,
    task: Task,
    seed: ArrayLike | None = None,
    limits: ArrayLike | None = None,
    *,
    starts: int = 48,
    rng: int = 0,
    any_branch: bool = False,
    length_scale: float | None = None,
) -> Solution:
    """Solve a task, from several starting states.

    Args:
        kin: compiled equations of the robot.
        task: the task; tasks are combined with `+` and weighted with `*`.
        seed: q (n,) or pose (4, 4) to start from.
        limits: (n, 2) lower and upper limit of each joint, in m or rad; infinite where a joint has no limit.
        starts: number of starting states: the seed, the formula's seeds, then random states.
        rng: seed of the random states; the same number gives the same solution.
        any_branch: whether to accept a solution on any branch; if false, only the branch under Returns is accepted.
        length_scale: length in m that counts as much as 1 rad; default: the robot's characteristic length.

    Returns:
        The first solution that is within the limits and on the branch of the seed (without a seed: on the preferred
        branch).

    Raises:
        KinematicsError: no solution is found from any start; `best` is the best `Solution`.
    """
    kin.need_six_joints()
    bounds = _bounds(kin, limits)
    begin = _state(kin, seed) if seed is not None else None
    wanted = kin.preferred_branch if begin is None else _label(kin, begin)
    tried, best, why, iterations = 0, None, "", 0
    first = [] if begin is None else [begin]
    for start in islice(chain(first, seeds(kin, rng, starts, bounds)), starts):
        tried += 1
        result = descend(kin, task, start, bounds, length_scale)
        iterations += result.iterations
        label = _label(kin, result.T if kin.closed_inverse else result.q)
        broken = _breaches(kin, result.q, bounds)
        fine = result.residual <= TOLERANCE and not broken and (any_branch or label == wanted)
        if best is None or (result.residual, len(broken)) < (
            best.residual,
            len(_breaches(kin, best.q, bounds)),
        ):
            best, why = Solution(result.q, result.T, result.residual, label, iterations), "; ".join(broken)
        if fine:
            return Solution(result.q, result.T, result.residual, label, iterations)
    if best is None:
        raise KinematicsError(f"{kin.formula.name}: no starting state: give a seed, or define seeds in the formula.")
    if best.residual > TOLERANCE:
        why = f"residual {best.residual:.3g} (dimensionless) stays above {TOLERANCE:g}" + (f"; {why}" if why else "")
    elif not why:
        why = f"a solution was found only on branch {best.branch}, not on {wanted}"
    best = replace(best, iterations=iterations)
    raise KinematicsError(
        f"{kin.formula.name}: no solution of the task in {tried} starts: {why}.",
        best=best,
        residual=best.residual,
    )


def seeds(kin: Compiled, rng: int, starts: int, bounds: Array | None = None) -> Iterator[Array]:
    """Yield starting states: q (n,) if there is a forward equation, else poses (4, 4).

    The seeds of the formula come first, then random states. Random poses are near the seeds; random joint values are
    within the limits (without limits: within ±180 deg or ±1 m).
    """
    homes: list[Array] = []
    for seed in kin.formula.seeds[:starts]:
        homes.append(_from_formula(kin, np.asarray(seed, float)))
        yield homes[-1]
    generator = np.random.default_rng(rng)
    if not kin.closed_forward:
        for i in range(len(homes), starts if homes else 0):
            T, xi = homes[generator.integers(len(homes))], generator.uniform(-1, 1, 6)
            spread = 0.2 + 0.8 * i / starts  # increasing, so that starts near the seeds come first
            R = spatial.exp_so3(spread * xi[3:]) @ T[:3, :3]
            yield spatial.pose(R, T[:3, 3] + 2 * spread * kin.characteristic_length * xi[:3])
        return
    low, high = (bounds if bounds is not None else _bounds(kin, None)).T
    reach = np.where(kin.revolute, np.pi, 1.0)
    low, high = np.where(np.isfinite(low), low, -reach), np.where(np.isfinite(high), high, reach)
    for _ in range(len(homes), starts):
        yield generator.uniform(low, high)


def descend(
    kin: Compiled,
    task: Task,
    start: Array,
    bounds: Array | None = None,
    length_scale: float | None = None,
    history: list[float] | None = None,
) -> Descent:
    """Run one descent from a reachable state; return its result even if the descent does not converge.

    The residual of the task at the start and after each step is appended to `history`.
    """
    scale = kin.characteristic_length if length_scale is None else float(length_scale)
    if not scale > 0:
        raise KinematicsError(f"length_scale {length_scale} m must be positive.")
    joint_scale = np.where(kin.revolute, 1.0, 1 / scale)
    kinds = tuple((t.kind, t.rows) for t in task.terms)
    for term in task.terms:
        if term.kind == "joints" and len(term.numbers) != len(kin.joints):
            raise KinematicsError(f"task Joints: {len(term.numbers)} values for {len(kin.joints)} joints.")
    # Auxiliary joints are not in the equations, so no pose determines their values.
    asked = np.where(kin.auxiliary, 0.0, joint_scale) if not kin.closed_forward else joint_scale
    weights = (t.weight * (asked if t.kind == "joints" else np.where(is_length(t), 1 / scale, 1.0)) for t in task.terms)
    low, high = (_bounds(kin, None) if bounds is None else bounds).T
    columns = 1 / joint_scale if kin.closed_forward else np.repeat([scale, 1.0], 3)
    inputs = np.concatenate([*(t.numbers for t in task.terms), *weights, columns, joint_scale, low, high])
    begin = np.minimum(np.maximum(start, low), high) if kin.closed_forward else start.ravel()
    end, residual, tried = iteration(kin.program, kinds).run(begin, inputs, 0.01 * TOLERANCE, history)
    if kin.closed_forward:
        return Descent(kin.program.forward.one(end), end, residual, tried)
    return Descent(end.reshape(4, 4), kin.program.inverse.one(end)[:-1], residual, tried)


def _from_formula(kin: Compiled, seed: Array) -> Array:
    """Convert a seed of the formula to a state; the seed is pose coordinates or, without inverse equations, q."""
    if not kin.closed_inverse:
        q = np.zeros(len(kin.joints))
        q[~kin.auxiliary], q[kin.auxiliary] = seed, [value for *_, value in kin.extra_joints]
        return q
    T = kin.program.pose_of_coordinates.one(seed)
    return kin.inverse(T) if kin.closed_forward else T


def _state(kin: Compiled, seed: ArrayLike) -> Array:
    """Convert a seed, q (n,) or pose (4, 4), to a state: q if there is a forward equation, else a pose."""
    seed = np.asarray(seed, float)
    if seed.shape == (4, 4):
        if not spatial.is_pose(seed, 1e-6):
            raise KinematicsError("the seed is not a rigid pose (4, 4).")
        return kin.inverse(seed) if kin.closed_forward else seed
    if seed.shape == (len(kin.joints),):
        return seed if kin.closed_forward else kin.forward(seed)
    raise KinematicsError(f"a seed must be q ({len(kin.joints)},) or a pose (4, 4), not {seed.shape}.")


def _label(kin: Compiled, state: Array) -> str:
    """Return the branch label of a state, q (n,) or pose (4, 4)."""
    return str((kin.branch(qs=state[None]) if state.ndim == 1 else kin.branch(Ts=state[None]))[0])


def _bounds(kin: Compiled, limits: ArrayLike | None) -> Array:
    n = len(kin.joints)
    if limits is None:
        return np.tile([-np.inf, np.inf], (n, 1))
    bounds = np.asarray(limits, float)
    if bounds.shape != (n, 2) or not np.all(bounds[:, 0] < bounds[:, 1]):
        raise KinematicsError(f"limits must be ({n}, 2), lower below upper, for {', '.join(kin.joints)}.")
    return bounds


def _breaches(kin: Compiled, q: Array, bounds: Array) -> list[str]:
    unit = np.where(kin.revolute, "rad", "m")
    return [
        f"{name} = {v:.6g} {u} is outside {low:g} .. {high:g}"
        for name, v, u, (low, high) in zip(kin.joints, q, unit, bounds, strict=True)
        if not low - _LIMIT_TOL <= v <= high + _LIMIT_TOL
    ]
