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

_FIRST_SPREAD = 0.2
"""Largest turn in rad of the first random poses about each axis, from a seed."""

_SPREAD_GROWTH = 0.8
"""By how much this turn in rad grows up to the last random poses."""

_LARGEST_SHIFT = 2
"""Largest shift of a random pose along each axis, in characteristic lengths, for a spread of 1."""

_GOAL_SHARE = 0.01
"""Part of the tolerance at which a descent ends."""


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
        KinematicsError: no solution is found from any start, then `best` is the best `Solution`. Without `best`: there
            is no start, seed, limits or `length_scale` are malformed, or the task does not determine the joints.
    """
    kin.need_six_joints()
    bounds = _bounds(kin, limits)
    states = seeds(kin, rng, starts, bounds)
    accepted_branch = kin.preferred_branch
    if seed is not None:
        seed_state = _state_of_seed(kin, seed)
        states = chain([seed_state], states)
        accepted_branch = _branch_label(kin, seed_state)

    start_count = 0
    iterations = 0
    best: Solution | None = None
    best_exceeded: list[str] = []
    for start in islice(states, starts):
        start_count += 1
        result = descend(kin, task, start, bounds, length_scale)
        iterations += result.iterations
        label = _branch_label(kin, result.T if kin.closed_inverse else result.q)
        exceeded = _exceeded_limit_texts(kin, result.q, bounds)
        solution = Solution(result.q, result.T, result.residual, label, iterations)
        on_branch = any_branch or label == accepted_branch
        if result.residual <= TOLERANCE and not exceeded and on_branch:
            return solution
        # Of equal residuals, the solution with fewer exceeded limits is better.
        if best is None or (result.residual, len(exceeded)) < (best.residual, len(best_exceeded)):
            best = solution
            best_exceeded = exceeded
    if best is None:
        raise KinematicsError(f"{kin.formula.name}: no starting state: give a seed, or define seeds in the formula.")

    causes = best_exceeded
    if best.residual > TOLERANCE:
        causes = [f"residual {best.residual:.3g} (dimensionless) stays above {TOLERANCE:g}", *best_exceeded]
    elif not best_exceeded:
        causes = [f"a solution was found only on branch {best.branch}, not on {accepted_branch}"]
    raise KinematicsError(
        f"{kin.formula.name}: no solution of the task in {start_count} starts: {'; '.join(causes)}.",
        best=replace(best, iterations=iterations),
        residual=best.residual,
    )


def inverse_by_solver(kin: Compiled, T: Array, seed: ArrayLike | None) -> Array:
    """Return q (n,) at a pose (4, 4) for a formula that has only forward equations.

    Raises:
        KinematicsError: no solution is found.
    """
    return solve(kin, Pose(T), seed=seed).q


def inverse_by_solver_many(kin: Compiled, Ts: Array, seed: ArrayLike | None = None) -> Array:
    """Return q (k, n) at poses (k, 4, 4), each solved from the previous solution; NaN rows without a solution."""
    qs = np.full((len(Ts), len(kin.joints)), np.nan)
    for i, T in enumerate(Ts):
        try:
            q = inverse_by_solver(kin, T, seed)
        except KinematicsError:
            continue
        qs[i] = q
        seed = q
    return qs


def seeds(kin: Compiled, rng: int, starts: int, bounds: Array | None = None) -> Iterator[Array]:
    """Yield starting states: q (n,) if there is a forward equation, else poses (4, 4).

    The seeds of the formula come first, then random states. Random poses are near the seeds; random joint values are
    within the limits `bounds` (n, 2). Without a limit, they are within ±180 deg or ±1 m, or, where the other limit is
    positive (lower) or negative (upper), within this distance of it.
    """
    homes: list[Array] = []
    for seed in kin.formula.seeds[:starts]:
        home = _state_of_formula_seed(kin, np.asarray(seed, float))
        homes.append(home)
        yield home
    generator = np.random.default_rng(rng)
    if kin.closed_forward:
        yield from _random_joints(kin, generator, starts - len(homes), bounds)
        return
    if not homes:
        return  # without a pose to start near, a random pose would be out of reach
    for i in range(len(homes), starts):
        T = homes[generator.integers(len(homes))]
        xi = generator.uniform(-1, 1, 6)
        # increasing, so that starts near the seeds come first
        spread = _FIRST_SPREAD + _SPREAD_GROWTH * i / starts
        R = spatial.exp_so3(spread * xi[3:]) @ T[:3, :3]
        shift = _LARGEST_SHIFT * spread * kin.characteristic_length * xi[:3]
        yield spatial.pose(R, T[:3, 3] + shift)


def _random_joints(kin: Compiled, generator: np.random.Generator, count: int, bounds: Array | None) -> Iterator[Array]:
    """Yield random q (n,) within bounds (n, 2); see `seeds` for joints without limits."""
    lowest, highest = random_range(kin, bounds)
    for _ in range(count):
        yield generator.uniform(lowest, highest)


def random_range(kin: Compiled, bounds: Array | None) -> tuple[Array, Array]:
    """Return the lowest and the highest joint values (n,) of random starts; see `seeds` for joints without limits.

    `bounds` (n, 2) are limits in m or rad, infinite where there are none; None: no joint has limits.
    """
    if bounds is None:
        bounds = _bounds(kin, None)
    reach = np.where(kin.revolute, np.pi, 1.0)
    low, high = bounds.T
    lowest = np.where(np.isfinite(low), low, np.minimum(-reach, high - reach))
    highest = np.where(np.isfinite(high), high, np.maximum(reach, low + reach))
    return lowest, highest


def descend(
    kin: Compiled,
    task: Task,
    start: Array,
    bounds: Array | None = None,
    length_scale: float | None = None,
    history: list[float] | None = None,
) -> Descent:
    """Run one descent from a reachable state; return its result even if the descent does not converge.

    Args:
        kin: compiled equations of the robot.
        task: the task.
        start: q (n,) if there is a forward equation, else a pose (4, 4).
        bounds: (n, 2) limits of the joints in m or rad; None: no limits.
        length_scale: see `solve`.
        history: the residual of the task at the start and after each step is appended to it.

    Raises:
        KinematicsError: `length_scale` is not positive, or a task of joint values has another number of joints.
    """
    scale = kin.characteristic_length if length_scale is None else float(length_scale)
    if not scale > 0:
        raise KinematicsError(f"length_scale {length_scale} m must be positive.")
    for term in task.terms:
        if term.kind == "joints" and len(term.numbers) != len(kin.joints):
            raise KinematicsError(f"task Joints: {len(term.numbers)} values for {len(kin.joints)} joints.")
    if bounds is None:
        bounds = _bounds(kin, None)
    low, high = bounds.T

    # An error of the length scale counts as much as an error of 1 rad.
    joint_scale = np.where(kin.revolute, 1.0, 1 / scale)
    joint_weights = joint_scale
    start_values = start.ravel()
    step_scale = np.repeat([scale, 1.0], 3)
    if kin.closed_forward:
        start_values = np.minimum(np.maximum(start, low), high)
        step_scale = 1 / joint_scale
    else:
        # Auxiliary joints are not in the equations, so no pose determines their values.
        joint_weights = np.where(kin.auxiliary, 0.0, joint_scale)
    numbers: list[Array] = []
    weights: list[Array] = []
    kinds = []
    for term in task.terms:
        kinds.append((term.kind, term.rows))
        row_weights = joint_weights
        if term.kind != "joints":
            row_weights = np.where(is_length(term), 1 / scale, 1.0)
        numbers.append(term.numbers)
        weights.append(term.weight * row_weights)
    inputs = np.concatenate([*numbers, *weights, step_scale, joint_scale, low, high])

    # a tuple: compiled iterations are cached by robot and kinds
    compiled_iteration = iteration(kin.program, tuple(kinds))
    end, residual, steps_tried = compiled_iteration.run(start_values, inputs, _GOAL_SHARE * TOLERANCE, history)
    if kin.closed_forward:
        return Descent(kin.program.forward.one(end), end, residual, steps_tried)
    q = kin.program.inverse.one(end)[:-1]
    return Descent(end.reshape(4, 4), q, residual, steps_tried)


def _state_of_formula_seed(kin: Compiled, seed: Array) -> Array:
    """Convert a seed of the formula to a state; the seed is pose coordinates or, without inverse equations, q."""
    if not kin.closed_inverse:
        q = np.zeros(len(kin.joints))
        q[~kin.auxiliary] = seed
        q[kin.auxiliary] = [value for *_, value in kin.extra_joints]
        return q
    T = kin.program.pose_of_coordinates.one(seed)
    return kin.inverse(T) if kin.closed_forward else T


def _state_of_seed(kin: Compiled, seed: ArrayLike) -> Array:
    """Convert a seed, q (n,) or pose (4, 4), to a state: q if there is a forward equation, else a pose.

    Raises:
        KinematicsError: the seed is not finite, has another shape, or is a pose that is not rigid or out of reach.
    """
    seed = np.asarray(seed, float)
    if seed.shape == (4, 4):
        if not spatial.is_pose(seed, 1e-6):
            raise KinematicsError("the seed is not a rigid pose (4, 4).")
        return kin.inverse(seed) if kin.closed_forward else seed
    if seed.shape == (len(kin.joints),):
        if not np.isfinite(seed).all():
            raise KinematicsError(f"the seed is not finite: {dict(zip(kin.joints, seed.tolist(), strict=True))}.")
        return seed if kin.closed_forward else kin.forward(seed)
    raise KinematicsError(f"a seed must be q ({len(kin.joints)},) or a pose (4, 4), not {seed.shape}.")


def _branch_label(kin: Compiled, state: Array) -> str:
    """Return the branch label of a state, q (n,) or pose (4, 4)."""
    batch = state[None]
    labels = kin.branch(qs=batch) if state.ndim == 1 else kin.branch(Ts=batch)
    return str(labels[0])


def _bounds(kin: Compiled, limits: ArrayLike | None) -> Array:
    """Return limits (n, 2) of all joints; infinite if no limits are given."""
    n = len(kin.joints)
    if limits is None:
        return np.tile([-np.inf, np.inf], (n, 1))
    bounds = np.asarray(limits, float)
    if bounds.shape != (n, 2) or not np.all(bounds[:, 0] < bounds[:, 1]):
        raise KinematicsError(f"limits must be ({n}, 2), lower below upper, for {', '.join(kin.joints)}.")
    return bounds


def _exceeded_limit_texts(kin: Compiled, q: Array, bounds: Array) -> list[str]:
    """Return a text for each joint of q (n,) that exceeds its limits (n, 2)."""
    texts: list[str] = []
    for name, value, is_angle, (low, high) in zip(kin.joints, q, kin.revolute, bounds, strict=True):
        within = low - _LIMIT_TOL <= value <= high + _LIMIT_TOL
        if not within:
            unit = "rad" if is_angle else "m"
            texts.append(f"{name} = {value:.6g} {unit} is outside {low:g} .. {high:g}")
    return texts
