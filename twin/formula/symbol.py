"""CasADi symbols as entries of NumPy arrays, so that a function written in NumPy can be evaluated on symbols."""

from __future__ import annotations

import casadi as ca
import numpy as np

from twin.formula.scalar import METHODS, Scalar, Value


class Symbol(Scalar):
    """A scalar whose value is a CasADi SX."""

    __slots__ = ()
    functions = {name: getattr(ca, name) for name in (*METHODS, "if_else")}  # noqa: RUF012


def from_sx(x: Value) -> Value:
    """Convert a CasADi SX to a `Symbol` or a NumPy array (n,) or (m, n) of symbols; return other values unchanged."""
    if not isinstance(x, ca.SX):
        return x
    rows, columns = x.shape
    if (rows, columns) == (1, 1):
        return Symbol(x)
    array = np.full((rows, columns), None, dtype=object)
    for i, j in np.ndindex(rows, columns):
        array[i, j] = Symbol(x[i, j])
    if columns == 1:
        return array[:, 0]
    return array


def to_sx(value: object) -> ca.SX:
    """Convert a number, a symbol, or an array (n,) or (m, n) of them to CasADi.

    Raises:
        TypeError: the value is not a number.
        ValueError: the array has more than two dimensions.
    """
    if isinstance(value, Scalar):
        return ca.SX(value.x)
    if isinstance(value, ca.SX):
        return value
    if isinstance(value, ca.DM):
        return ca.SX(value)
    if isinstance(value, int | float | np.number):
        return ca.SX(float(value))
    if not isinstance(value, np.ndarray | list | tuple):
        raise TypeError(f"{type(value).__name__} is not a number")
    array = np.asarray(value, dtype=object)
    if array.ndim > 2:
        raise ValueError(f"{array.ndim} dimensions")
    if array.ndim < 2:
        array = array.reshape(-1, 1)  # CasADi has no arrays of one dimension: a vector is a column
    rows = []
    for row in array:
        entries = []
        for entry in row:
            if isinstance(entry, np.ndarray):
                entry = entry.item()  # an array with one entry counts as a number
            entries.append(to_sx(entry))
        rows.append(ca.horzcat(*entries))
    return ca.vertcat(*rows)
