"""Solve forward kinematics without a forward equation.

The forward kinematics of a parallel robot is the root T of q(T) - q, where q(T) is the inverse equation. There are
several roots, the assemblies at q. The signs of the formula's aspects at a pose identify its branch; the signs of a
solution are checked, because a Newton step can jump to another branch.

From a seed pose, the solver tries in order: Newton's method; Newton's method in small steps of q; Levenberg-Marquardt;
all assemblies that the formula can enumerate. Without a seed, it tries all assemblies that the formula can enumerate,
then Levenberg-Marquardt from the formula's seeds and random poses.
"""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.formula.program import newton_results
from twin.kinematics.compiled import Compiled
from twin.kinematics.solve import Joints, descend, seeds

FORWARD_TOL = 1e-11
"""Norm of the joint error, in m or rad, below which a forward solution is accepted."""

_SAME_POSE_DISTANCE = 1e-6
"""Difference in m and rad below which two poses count as the same assembly."""

_SEED_STEPS = 8
"""Number of steps of q from a seed, where Newton's method fails in one."""

_START_COUNT = 24
"""Number of starting states without a seed."""

_MAX_TRAVEL = 0.5
"""Maximum travel (see `Program.newton`) from the seed to the solution of Newton's method.

A solution with a larger travel might be on another branch. In this case the solver approaches q in small steps.
"""


def forward(kin: Compiled, q: Array, seed: Array | None) -> Array:
    """Return the pose (4, 4) at q (n,); see `Kinematics.forward`."""
    if kin.closed_forward:
        T = kin.program.forward.one(q)
        if not np.isfinite(T).all():
            raise KinematicsError(f"{kin.formula.name}: the equations have no real solution at q = {q}.")
        return T
    kin.need_six_joints()
    if not np.isfinite(q).all():
        raise KinematicsError(f"{kin.formula.name}: q = {q} is not finite.")
    if seed is not None:
        return _from_seed(kin, q, seed)
    return _without_seed(kin, q)


def forward_many(kin: Compiled, qs: Array, seed: Array | None) -> Array:
    """Return poses (k, 4, 4) at qs (k, n); see `Kinematics.forward_many`."""
    if kin.closed_forward:
        Ts = kin.program.forward.many(qs)
        Ts[~np.isfinite(Ts).all(axis=(1, 2))] = np.nan
        return Ts
    kin.need_six_joints()
    if seed is not None and seed.ndim == 3:
        return _from_seed_poses(kin, qs, seed)
    Ts = np.full((len(qs), 4, 4), np.nan)
    previous = seed
    for i, q in enumerate(qs):
        if not np.isfinite(q).all():
            continue
        try:
            Ts[i] = _without_seed(kin, q) if previous is None else _from_seed(kin, q, previous)
        except KinematicsError:
            continue
        previous = Ts[i]
    return Ts


def _from_seed_poses(kin: Compiled, qs: Array, seed_poses: Array) -> Array:
    """Return poses (k, 4, 4) at qs (k, n), each from its own seed (k, 4, 4); NaN without a solution."""
    Ts = _newton_many(kin, qs, seed_poses)  # all at once; the few rows that do not converge follow one by one
    for i in np.flatnonzero(np.isnan(Ts[:, 0, 0])):
        if not np.isfinite(qs[i]).all():
            continue
        try:
            Ts[i] = _from_seed(kin, qs[i], seed_poses[i])
        except KinematicsError:
            continue
    return Ts


def branches(kin: Compiled, q: Array) -> list[Array]:
    """Return all assemblies at q (n,); see `Kinematics.branches`."""
    if kin.closed_forward and kin.formula.branches is None:
        return [forward(kin, q, None)]
    if kin.formula.branches is None:
        raise KinematicsError(f"{kin.formula.name}: the formula has no function that enumerates its assemblies.")
    q_of_formula = q[~kin.auxiliary]
    candidates = kin.formula.branches(q_of_formula, kin.parameters, kin.variants)
    if kin.closed_forward:  # closed-form solutions need no refinement; the preferred assembly is already first
        return candidates
    assemblies: list[Array] = []
    for T in candidates:
        refined, error, _, _ = _newton(kin, q, T)
        if not error <= FORWARD_TOL:
            continue
        # Two candidates can converge to the same assembly.
        is_known = any(_distance(refined, assembly) <= _SAME_POSE_DISTANCE for assembly in assemblies)
        if not is_known:
            assemblies.append(refined)
    if not assemblies:
        return []
    scores = _preference_scores(kin, np.array(assemblies))
    best_first = np.argsort(-scores, kind="stable")
    return [assemblies[i] for i in best_first]


def _from_seed(kin: Compiled, q: Array, seed: Array) -> Array:
    """Return the pose (4, 4) at q (n,) on the branch of the seed (4, 4)."""
    seed_signs = np.sign(kin.program.group["aspect"].one(seed.ravel()))
    T, error, travel, signs = _newton(kin, q, seed)
    if error <= FORWARD_TOL and travel < _MAX_TRAVEL and (signs == seed_signs).all():
        return T
    # Far from the seed, Newton's method may jump to another branch; small steps of q prevent this.
    T_stepped = _in_steps(kin, q, seed, seed_signs)
    if T_stepped is not None:
        return T_stepped
    result = descend(kin, Joints(q), seed)
    T, error, _, signs = _newton(kin, q, result.T)
    if error <= FORWARD_TOL and (signs == seed_signs).all():
        return T
    if kin.formula.branches is not None:  # the straight path of q from the seed may leave the workspace
        same_branch = []
        for T_branch in branches(kin, q):
            if _has_signs(kin, T_branch, seed_signs):
                same_branch.append(T_branch)
        if same_branch:
            return min(same_branch, key=lambda T: _distance(T, seed, kin.characteristic_length))
    cause = "Newton's method does not converge"
    if error <= FORWARD_TOL:
        cause = "Newton's method ends on another branch"
    raise KinematicsError(
        f"{kin.formula.name}: no assembly at q = {_q_text(kin, q)} was reached from the seed: {cause}. "
        "Give a closer seed, or omit the seed.",
        best=result.T,
        residual=result.residual,
    )


def _in_steps(kin: Compiled, q: Array, seed: Array, seed_signs: Array) -> Array | None:
    """Return the pose (4, 4) at q (n,), approached in steps of q from the seed (4, 4); None: a step fails.

    A step also fails if it leaves the branch of the seed with the aspect signs `seed_signs` (m,).
    """
    q_seed = kin.program.inverse.one(seed.ravel())[:-1]
    if not np.isfinite(q_seed).all():
        return None
    T = seed
    for fraction in np.linspace(0, 1, _SEED_STEPS + 1)[1:]:
        T, error, travel, signs = _newton(kin, q_seed + fraction * (q - q_seed), T)
        if not (error <= FORWARD_TOL and travel < _MAX_TRAVEL and (signs == seed_signs).all()):
            return None
    return T


def _without_seed(kin: Compiled, q: Array) -> Array:
    """Return the pose (4, 4) at q (n,) on the preferred branch, without a seed."""
    preferred = np.array([aspect.preferred for aspect in kin.formula.aspects])
    if kin.formula.branches is not None:
        for T in branches(kin, q):
            if _has_signs(kin, T, preferred):
                return T
    best: Array | None = None
    residual = np.inf
    for seed in seeds(kin, rng=0, starts=_START_COUNT):
        result = descend(kin, Joints(q), seed)
        T, error, _, signs = _newton(kin, q, result.T)
        if error <= FORWARD_TOL and (signs == preferred).all():
            return T
        if result.residual < residual:
            best = result.T
            residual = result.residual
    raise KinematicsError(
        f"{kin.formula.name}: no assembly was found on the branch {kin.preferred_branch} at q = {_q_text(kin, q)}. "
        "Check q, or give a seed pose.",
        best=best,
        residual=residual,
    )


def _newton(kin: Compiled, q: Array, T: Array) -> tuple[Array, float, float, Array]:
    """Return (pose (4, 4), joint error, travel, aspect signs) after Newton's method from T; failed: joint error NaN."""
    solved = newton_results(kin.program.newton.one(np.concatenate([q, T.ravel()])))
    return solved.T, float(solved.error), float(solved.travel), np.sign(solved.aspects)


def _newton_many(kin: Compiled, qs: Array, seed_poses: Array) -> Array:
    """Return the poses (k, 4, 4) found by Newton's method from seeds (k, 4, 4); NaN without convergence."""
    flat = seed_poses.reshape(-1, 16)
    results = newton_results(kin.program.newton.many(np.hstack([qs, flat])))
    seed_signs = np.sign(kin.program.group["aspect"].many(flat))
    on_branch = (np.sign(results.aspects) == seed_signs).all(axis=1)
    solved = (results.error <= FORWARD_TOL) & (results.travel < _MAX_TRAVEL) & on_branch
    Ts = results.T.copy()
    Ts[~solved] = np.nan
    return Ts


def _preference_scores(kin: Compiled, Ts: Array) -> Array:
    """Return scores (k,) of poses: the number of preferred aspect signs, minus at most 0.5 for the distance from home.

    Home is the first seed of the formula.
    """
    preferred = np.array([aspect.preferred for aspect in kin.formula.aspects])
    scores = (kin.aspect_signs(Ts) == preferred).sum(axis=1).astype(float)
    home = next(seeds(kin, rng=0, starts=1), None)
    if home is not None:
        distances = np.zeros(len(Ts))
        for i, T in enumerate(Ts):
            distances[i] = _distance(T, home, kin.characteristic_length)
        scores -= 0.5 * distances / (1 + distances)
    return scores


def _has_signs(kin: Compiled, T: Array, expected_signs: Array) -> bool:
    """Return whether a pose (4, 4) has these aspect signs (m,)."""
    signs = kin.aspect_signs(T[None])[0]
    return bool(np.all(signs == expected_signs))


def _distance(T: Array, T_other: Array, length: float = 1.0) -> float:
    """Return the larger of two differences of poses (4, 4): that of positions, divided by `length`, and the angle."""
    shift, angle = spatial.pose_difference(T, T_other)
    return max(shift / length, angle)


def _q_text(kin: Compiled, q: Array) -> str:
    """Return names and values of the joints, such as "q1 0.1, q2 -0.2"."""
    parts = []
    for name, value in zip(kin.joints, q, strict=True):
        parts.append(f"{name} {value:.6g}")
    return ", ".join(parts)
