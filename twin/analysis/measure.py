"""Compile one function (kernel) that evaluates poses: reachability, margin to joint limits, conditioning.

Condition numbers are computed from the eigenvalues of J J^T (J: Jacobian). Sweeps of Jacobi rotations diagonalise this
matrix, until the off-diagonal entries are rounding errors. The number of sweeps is the same for all poses that are
computed together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import combinations

import casadi as ca
import numpy as np

from twin.codegen import Kernel, Stage
from twin.core import spatial
from twin.core.spatial import Array
from twin.kinematics import Kinematics
from twin.kinematics.closed_loops.bounds import Bound
from twin.kinematics.closed_loops.passive_limits import PassiveCheck
from twin.kinematics.compile import POSE_TOL

NAMES = ("reached", "inverse_condition", "limit_margin", "singularity")
"""Names of the values at a pose.

`reached`: 1 or 0. `inverse_condition`: inverse condition number, 0..1. `limit_margin`: margin of the joint nearest to a
limit (1 in the middle of its range, 0 at the limit). `singularity`: smallest singularity measure of the equations (NaN
without measures).
"""

ROOT = 1.2207440846057596
"""Root of x^4 = x + 1; the fractional parts of i / root^k cover three dimensions more evenly than random numbers."""

_MOST_SWEEPS = 12
"""Maximum number of Jacobi sweeps."""

_LARGEST_OFF_DIAGONAL = 1e-13
"""Relative off-diagonal norm below which no further sweep is computed."""

_SMALLEST_NORM = 1e-300
"""Added to the norm of a diagonal, by which is divided."""


def shared(bounds: Sequence[Bound]) -> tuple[Bound, ...]:
    """Return the limits that involve several joints: of motors behind a transmission, and of gaps along a rail."""
    return tuple(bound for bound in bounds if bound.kind in ("motor", "gap"))


def agree(kin: Kinematics, passive: PassiveCheck, T: Array) -> bool:
    """Return whether the loops of a mechanism close at the joint values that the equations give for a pose T (4, 4).

    Limits of passive joints can be checked only then; it is not so if parameters of the equations have been changed.
    The equations must have a closed-form inverse.
    """
    q = kin.inverse_many(T[None])
    if not np.isfinite(q).all():
        return False
    _, closed = passive.unknowns_at_poses(q, T[None])
    return bool(closed.all())


def kernel(
    kin: Kinematics,
    limits: Array,
    pose: Callable[[ca.SX], ca.SX],
    *,
    bounds: Sequence[Bound] = (),
    passive: PassiveCheck | None = None,
    from_joints: bool = False,
    size: int = 1,
) -> Kernel | CheckedKernel:
    """Return a function that computes the values named in `NAMES` and the tool position from each sample.

    Its input is the index of a sample, or the sample itself (a pose or joint values).

    Args:
        kin: compiled equations of the robot.
        limits: (n, 2) limits of the active joints in m or rad, infinite where a joint has no limit.
        pose: function from the input (size,) to the pose (4, 4) or, with `from_joints`, to the joint values (n,).
        bounds: limits that involve several joints, see `shared`.
        passive: limits of passive joints; None: there are none, or they are not checked.
        from_joints: whether samples are joint values; requires forward equations.
        size: number of entries of the input.
    """
    sample = ca.SX.sym("i", size)
    T, q, J, solved = _solved(kin, pose(sample), from_joints)
    # `aspect` and `measure` are functions of the pose if the equations have an inverse, else of the joints.
    state = q
    if kin.closed_inverse or not from_joints:
        state = ca.reshape(T.T, 16, 1)
    reached, margin = _within(q, limits, bounds, solved)
    aspects = kin.program.group["aspect"]
    if aspects.function.numel_out(0):  # a pose in another assembly mode does not count as reached
        signs = ca.vertsplit(aspects.function(state))
        for sign, aspect in zip(signs, kin.formula.aspects, strict=True):
            reached = ca.logic_and(reached, sign * aspect.preferred > 0)
    measures = kin.program.group["measure"]
    singularity = ca.SX(np.nan)
    if measures.function.numel_out(0):
        sizes = ca.vertsplit(ca.fabs(measures.function(state)))
        singularity = reduce(ca.fmin, sizes)
    # The smaller of the two products: it has the same nonzero eigenvalues.
    gram = J.T @ J
    if J.shape[0] <= J.shape[1]:
        gram = J @ J.T
    size_of_gram = gram.shape[0]
    lower_triangle = []
    for row in range(size_of_gram):
        for column in range(row + 1):
            lower_triangle.append(gram[row, column])
    results = {
        "gram": ca.vertcat(*lower_triangle),
        "reached": reached,
        "margin": margin,
        "singularity": singularity,
        "position": T[:3, 3],
    }
    if passive is not None:
        results["joints"] = q
        results["rotation"] = ca.vec(T[:3, :3].T)
    dense = list(map(ca.densify, results.values()))
    first = ca.Function("pose", [sample], dense, {"cse": True})
    stages = [
        Stage(first, ("i",), tuple(results)),
        Stage(
            _sweep(size_of_gram),
            takes=("gram",),
            gives=("gram", "error"),
            repeat=_MOST_SWEEPS,
            tolerance=_LARGEST_OFF_DIAGONAL,
        ),
        Stage(_last(size_of_gram), ("gram", "reached", "margin", "singularity"), NAMES),
    ]
    if passive is None:
        return Kernel(stages, {"i": size}, [*NAMES, "position"])
    return CheckedKernel(Kernel(stages, {"i": size}, [*NAMES, "position", "joints", "rotation"]), passive)


@dataclass(frozen=True)
class CheckedKernel:
    """A kernel that also returns joints and rotations, and the limits of passive joints for the samples it reaches."""

    kernel: Kernel
    passive: PassiveCheck

    def __call__(self, samples: Array) -> tuple[Array, ...]:
        """Return the values `NAMES`, each (1, k), and the tool positions (3, k) of samples (size, k)."""
        *values, position, joints, rotation = self.kernel(samples)
        reached = np.flatnonzero(values[0][0] > 0)
        if len(reached):
            R = rotation[:, reached].T.reshape(-1, 3, 3)
            Ts = spatial.pose(R, position[:, reached].T)
            is_kept = self.passive.keeps_limits_at_poses(joints[:, reached].T, Ts)
            # as at a sample that is not reached, see `_last`
            for value, unreached in zip(values, (0.0, 0.0, 0.0, np.nan), strict=True):
                value[0, reached[~is_kept]] = unreached
        return *values, position


def _solved(kin: Kinematics, sample: ca.SX, from_joints: bool) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return (pose (4, 4), joint values (n,), scaled Jacobian, whether the equations have a solution) of a sample.

    The sample is a pose (4, 4) or, with `from_joints`, joint values (n,).
    """
    program = kin.program
    joint_count = len(kin.joints)
    length = kin.characteristic_length
    if from_joints:
        T = ca.reshape(program.forward.function(sample), 4, 4).T
        q = sample
        solved = ca.SX(1)
    else:
        T = sample
        solution = program.inverse.function(ca.reshape(sample.T, 16, 1))
        q = solution[:-1]
        solved = solution[-1] <= POSE_TOL  # the last entry is the error of the pose
    # The characteristic length makes rotations comparable with shifts.
    if from_joints or kin.closed_forward:  # a redundant arm has many inverse solutions, so use the forward Jacobian
        J = ca.reshape(program.forward_jacobian.function(q), joint_count, 6).T
        return T, q, ca.vertcat(J[:3, :], J[3:, :] * length), solved
    J = ca.reshape(program.inverse_jacobian.function(ca.reshape(T.T, 16, 1)), 6, joint_count).T
    return T, q, ca.horzcat(J[:, :3], J[:, 3:] / length), solved


def _within(q: ca.SX, limits: Array, bounds: Sequence[Bound], solved: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return (whether a sample is reached: solved, all joints within limits; margin of the sample to the limits)."""
    reached = solved
    margin = ca.SX(1)
    for j, (low, high) in enumerate(limits):
        reached = ca.logic_and(reached, q[j] == q[j])  # NaN: out of reach
        if np.isfinite(low) and np.isfinite(high):
            margin_of_joint = 2 * ca.fmin(q[j] - low, high - q[j]) / (high - low)
            margin = ca.if_else(margin_of_joint < margin, margin_of_joint, margin)
        inside = ca.logic_and(q[j] >= low, q[j] <= high)
        reached = ca.logic_and(reached, inside)
    for bound in bounds:
        total = ca.dot(ca.SX(ca.DM(bound.weights)), q)
        reached = ca.logic_and(reached, total >= bound.least)
    return reached, margin


def _last(m: int) -> ca.Function:
    """Return a function that computes the values `NAMES`; its first input is the diagonalised matrix J J^T (m, m)."""
    a = ca.SX.sym("a", m * (m + 1) // 2)
    reached = ca.SX.sym("r")
    margin = ca.SX.sym("s")
    singularity = ca.SX.sym("t")
    eigenvalues = []
    for row in range(m):
        start_of_row = row * (row + 1) // 2
        eigenvalues.append(a[start_of_row + row])
    low = reduce(ca.fmin, eigenvalues)
    high = reduce(ca.fmax, eigenvalues)
    inverse_condition = ca.if_else(low > 0, ca.sqrt(ca.fmax(low, 0) / high), 0)
    results = [
        reached,
        ca.if_else(reached, inverse_condition, 0),
        ca.if_else(reached, margin, 0),
        ca.if_else(reached, singularity, np.nan),
    ]
    return ca.Function("judged", [a, reached, margin, singularity], list(map(ca.densify, results)))


def _sweep(m: int) -> ca.Function:
    """Return a function for one Jacobi sweep over a symmetric matrix; it also returns the off-diagonal norm.

    The matrix is stored as its lower triangle by rows; the off-diagonal norm is relative to the norm of the diagonal.
    """
    entries = ca.SX.sym("a", m * (m + 1) // 2)
    a: dict[tuple[int, int], ca.SX] = {}  # {(row, column): entry of the lower triangle}, by rows
    for r in range(m):
        for c in range(r + 1):
            a[r, c] = entries[len(a)]

    def place(r: int, c: int) -> tuple[int, int]:
        """Return where the symmetric entry is stored."""
        if r >= c:
            return r, c
        return c, r

    beside = ca.SX(0)
    along = ca.SX(0)
    for (r, c), entry in a.items():
        if r == c:
            along += entry**2
        else:
            beside += entry**2
    for p, q in combinations(range(m), 2):
        x = a[p, p]
        y = a[q, q]
        z = a[q, p]
        # tangent of the rotation that makes z zero, without dividing by z
        d = y - x
        root = ca.sqrt(d * d + 4 * z * z)
        tangent = ca.if_else(z == 0, 0, 2 * z / (d + ca.copysign(root, d)))
        cosine = 1 / ca.sqrt(1 + tangent * tangent)
        sine = tangent * cosine
        a[p, p] = x - tangent * z
        a[q, q] = y + tangent * z
        a[q, p] = ca.SX(0)
        for k in range(m):
            if k in (p, q):
                continue
            u = a[place(p, k)]
            v = a[place(q, k)]
            a[place(p, k)] = cosine * u - sine * v
            a[place(q, k)] = sine * u + cosine * v
    swept = ca.vertcat(*a.values())
    # Convergence is quadratic: the norm after this sweep is about the square of the returned norm before it.
    return ca.Function("sweep", [entries], [swept, ca.sqrt(beside / (along + _SMALLEST_NORM))])
