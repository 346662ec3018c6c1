"""Functions for plain formulas, on numbers and symbols: rotations, poses, and a conditional expression."""

from __future__ import annotations

import numpy as np

from twin.formula.scalar import Scalar, Value


def if_else(condition: Value, yes: Value, no: Value) -> Value:
    """Return `yes` where the condition is true, else `no`, entry by entry; both values are always computed."""
    values = (condition, yes, no)
    if any(map(_has_entries, values)):
        arrays = []
        for value in values:
            arrays.append(np.asarray(value, dtype=object))
        conditions, yeses, noes = np.broadcast_arrays(*arrays)
        selected = np.full(conditions.shape, None, dtype=object)
        for i in np.ndindex(selected.shape):
            selected[i] = if_else(conditions[i], yeses[i], noes[i])
        return as_floats(selected)
    if isinstance(condition, Scalar):
        return condition.if_else(yes, no)
    if condition:
        return yes
    return no


def _has_entries(value: Value) -> bool:
    """Return whether a value is an array or a sequence, not a single number or symbol."""
    return isinstance(value, np.ndarray | list | tuple)


def rotation_x(angle: Value) -> np.ndarray:
    """Return the rotation (3, 3) about x; the angle is in rad."""
    c = np.cos(angle)
    s = np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def rotation_y(angle: Value) -> np.ndarray:
    """Return the rotation (3, 3) about y; the angle is in rad."""
    c = np.cos(angle)
    s = np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def rotation_z(angle: Value) -> np.ndarray:
    """Return the rotation (3, 3) about z; the angle is in rad."""
    c = np.cos(angle)
    s = np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def pose(R: Value, p: Value) -> np.ndarray:
    """Return the pose (4, 4) with a rotation (3, 3) and a position (3,) in m."""
    R = np.asarray(R)
    p = np.asarray(p)
    if R.shape != (3, 3) or p.shape != (3,):
        raise ValueError(f"pose(R, p) takes a rotation (3, 3) and a position (3,), not {R.shape} and {p.shape}")
    T = np.zeros((4, 4), np.result_type(R, p, float))  # objects if an entry is a symbol
    T[:3, :3] = R
    T[:3, 3] = p
    T[3, 3] = 1.0
    return T


def inverse(T: np.ndarray) -> np.ndarray:
    """Return the inverse of a pose (4, 4)."""
    R = T[:3, :3]
    p = T[:3, 3]
    return pose(R.T, -(R.T @ p))


def as_floats(array: np.ndarray) -> np.ndarray:
    """Return an array of objects as an array of floats if it contains only numbers, else unchanged."""
    if array.dtype == object and not any(isinstance(x, Scalar) for x in array.ravel()):
        return array.astype(float)
    return array
