"""Solver tasks: residuals of the tool pose that can be weighted and added.

The residual of a task is zero if, and only if, the task is fulfilled. The rows of a residual are in m or rad. The
solver divides lengths by a length scale, so that residuals and weights are dimensionless.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.formula import symbolic


@dataclass(frozen=True)
class Term:
    """One weighted residual: `kind` names its function, `numbers` its arguments, `rows` the rows in use."""

    kind: str
    numbers: Array
    rows: tuple[int, ...]
    weight: float = 1.0


@dataclass(frozen=True)
class Task:
    """A sum of weighted residuals (terms). `a + b` combines two tasks; `w * a` weights a task."""

    terms: tuple[Term, ...] = field(default=())

    def __add__(self, other: Task) -> Task:
        return Task(self.terms + other.terms)

    def __mul__(self, weight: float) -> Task:
        if not (np.isfinite(weight) and weight > 0):
            raise KinematicsError(f"a weight must be positive, not {weight}.")
        weighted = []
        for term in self.terms:
            weighted.append(replace(term, weight=term.weight * float(weight)))
        return Task(tuple(weighted))

    __rmul__ = __mul__


def Pose(T_base_tool: ArrayLike, mask: Sequence[bool] = (True,) * 6) -> Task:  # noqa: N802 - reads as a type
    """Return the task of bringing the tool to a pose (4, 4).

    Args:
        T_base_tool: target pose.
        mask: six flags, one for each error: x, y, z of the position, then x, y, z of the rotation vector, in the axes
            of the target. An error with flag 0 is ignored: (1, 1, 1, 1, 1, 0) leaves the rotation about the target's z
            axis free.

    Examples:
        >>> import twin
        >>> robot = twin.load("pa10")
        >>> T = robot.forward([0.1, 0.4, 0.0, 1.2, 0.0, 0.5, 0.0])
        >>> free_about_z = twin.Pose(T, mask=(1, 1, 1, 1, 1, 0))
        >>> bool(abs(robot.solve(free_about_z).T_base_tool[:3, 3] - T[:3, 3]).max() < 1e-8)
        True
    """
    T = np.asarray(T_base_tool, float)
    if not spatial.is_pose(T, 1e-6) or T.shape != (4, 4):
        raise KinematicsError("task Pose: the target is not a rigid pose (4, 4).")
    if len(mask) != 6 or not any(mask):
        raise KinematicsError(
            f"task Pose: the mask must have 6 flags, including at least one True; found {tuple(mask)}."
        )
    return _one_term_task("pose", T.ravel(), tuple(i for i in range(6) if mask[i]))


def Tip(p_base: ArrayLike, p_tool_tip: ArrayLike = (0.0, 0.0, 0.0)) -> Task:  # noqa: N802
    """Return the task of bringing the point p_tool_tip (3,) of the tool frame to p_base (3,), both in m.

    Examples:
        >>> import twin
        >>> solution = twin.load("pa10").solve(twin.Tip([0.4, 0.1, 0.5]))
        >>> solution.T_base_tool[:3, 3].round(6).tolist()
        [0.4, 0.1, 0.5]
    """
    return _one_term_task(
        "tip", np.concatenate([_checked_vector("Tip", p_base), _checked_vector("Tip", p_tool_tip)]), (0, 1, 2)
    )


def Trocar(  # noqa: N802
    p_base: ArrayLike,
    axis: ArrayLike = (0.0, 0.0, -1.0),
    p_tool_tip: ArrayLike = (0.0, 0.0, 0.0),
    depth: float | None = None,
) -> Task:
    """Return the task of guiding a shaft through a trocar, with the tip beyond the trocar.

    With w = p - tip (p: the trocar) and the shaft direction a (towards the tip), the residual is w + |w| a. For a small
    error, the length of the residual is the distance from trocar to shaft axis in m. If the tip is on the wrong side of
    the trocar, the length of the residual is 2 |w|, so that this side is not a solution. The usual residual a x w, by
    contrast, is zero on both sides.

    Args:
        p_base: trocar (3,) in m.
        axis: shaft direction (3,) in the tool frame, towards the tip; of any length except 0.
        p_tool_tip: tip (3,) in the tool frame, in m; the shaft axis passes through the tip.
        depth: distance of the tip beyond the trocar, in m; None: free.

    Examples:
        >>> import twin
        >>> task = twin.Tip([0.5, 0.0, 0.3]) + twin.Trocar([0.5, 0.0, 0.4], axis=[0, 0, 1])
        >>> solution = twin.load("pa10").solve(task)
        >>> solution.T_base_tool[:3, 3].round(6).tolist()
        [0.5, 0.0, 0.3]
    """
    a = _checked_vector("Trocar", axis)
    if not np.linalg.norm(a) > 0:
        raise KinematicsError("task Trocar: the axis has length 0.")
    if depth is not None and not depth > 0:
        raise KinematicsError(f"task Trocar: depth {depth} m must be above 0.")
    numbers = [_checked_vector("Trocar", p_base), a / np.linalg.norm(a), _checked_vector("Trocar", p_tool_tip)]
    if depth is None:
        return _one_term_task("trocar", np.concatenate(numbers), (0, 1, 2))
    return _one_term_task("trocar_depth", np.concatenate([*numbers, [depth]]), (0, 1, 2))


def Joints(q: ArrayLike) -> Task:  # noqa: N802
    """Return the task of bringing the active joints to q (n,); with a small weight, the task of staying near q.

    Examples:
        >>> import twin
        >>> q = [0.1, 0.4, 0.2, 1.2, 0.3, 0.5, 0.6]
        >>> solution = twin.load("pa10").solve(twin.Joints(q))
        >>> bool(abs(solution.q - q).max() < 1e-8)
        True
    """
    q = np.asarray(q, float)
    if q.ndim != 1 or not np.isfinite(q).all():
        raise KinematicsError(f"task Joints: q must be a finite vector (n,), found shape {q.shape}.")
    return _one_term_task("joints", q, tuple(range(len(q))))


def is_length(term: Term) -> np.ndarray:
    """Return (rows,) bool: whether each row of a term is a length; invalid for "joints": their units vary by robot."""
    return np.array(_TERM_KINDS[term.kind].lengths)[list(term.rows)]


def argument_count(kind: str, joints: int) -> int:
    """Return the number of arguments of a term of the kind `kind`, for a robot with `joints` joints."""
    return joints if kind == "joints" else _TERM_KINDS[kind].arguments


def residual(kind: str, rows: tuple[int, ...], T: ca.SX, q: ca.SX, numbers: ca.SX) -> ca.SX:
    """Return the unweighted residual of a term as an expression of pose (4, 4), joints (n,) and the term's numbers."""
    r = q - numbers if kind == "joints" else _TERM_KINDS[kind].residual(T, numbers)
    return r[list(rows)]


# Residuals of a pose T (4, 4) and the arguments n of a term, in the order in which `Pose`, `Tip` and `Trocar` put them.


def _pose(T: ca.SX, n: ca.SX) -> ca.SX:
    return symbolic.pose_residual(T, symbolic.unflat(n, 4, 4))


def _tip(T: ca.SX, n: ca.SX) -> ca.SX:
    return T[0:3, 3] + T[0:3, 0:3] @ n[3:6] - n[0:3]


def _trocar(T: ca.SX, n: ca.SX) -> ca.SX:
    R = T[0:3, 0:3]
    w = n[0:3] - (T[0:3, 3] + R @ n[6:9])  # from the tip to the trocar
    return w + symbolic.norm(w) * (R @ n[3:6])


def _trocar_depth(T: ca.SX, n: ca.SX) -> ca.SX:
    R = T[0:3, 0:3]
    return n[0:3] - (T[0:3, 3] + R @ n[6:9]) + n[9] * (R @ n[3:6])


@dataclass(frozen=True)
class _TermKind:
    """A kind of terms: its residual as a function of pose and arguments, and which rows of the residual are lengths."""

    residual: Callable[[ca.SX, ca.SX], ca.SX]
    arguments: int
    lengths: tuple[bool, ...]


_TERM_KINDS = {
    "pose": _TermKind(_pose, arguments=16, lengths=(True, True, True, False, False, False)),
    "tip": _TermKind(_tip, arguments=6, lengths=(True, True, True)),
    "trocar": _TermKind(_trocar, arguments=9, lengths=(True, True, True)),
    "trocar_depth": _TermKind(_trocar_depth, arguments=10, lengths=(True, True, True)),
}


def _one_term_task(kind: str, numbers: Array, rows: tuple[int, ...]) -> Task:
    numbers = np.array(numbers, float)
    numbers.setflags(write=False)
    return Task((Term(kind, numbers, rows),))


def _checked_vector(task: str, value: ArrayLike) -> Array:
    v = np.asarray(value, float)
    if v.shape != (3,) or not np.isfinite(v).all():
        raise KinematicsError(f"task {task}: expected a finite vector of 3 numbers, found {value}.")
    return v
