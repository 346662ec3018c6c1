"""CasADi symbols as entries of NumPy arrays, so that a function written in NumPy can be evaluated on symbols."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from twin.formula.scalar import METHODS, Scalar


class Symbol(Scalar):
    """A scalar whose value is a CasADi SX."""

    __slots__ = ()
    functions = {**{n: getattr(ca, n) for n in METHODS}, "if_else": ca.if_else}  # noqa: RUF012


def from_sx(x: Any) -> Any:
    """Convert a CasADi SX to a `Symbol` or a NumPy array (n,) or (m, n) of symbols; return other values unchanged."""
    if not isinstance(x, ca.SX):
        return x
    rows, columns = x.shape
    if (rows, columns) == (1, 1):
        return Symbol(x)
    a = np.array([[Symbol(x[i, j]) for j in range(columns)] for i in range(rows)], dtype=object)
    return a[:, 0] if columns == 1 else a


def to_sx(value: Any) -> ca.SX:
    """Convert a number, a symbol, or an array (n,) or (m, n) of them to CasADi.

    Raises:
        TypeError: the value is not a number.
        ValueError: the array has more than two dimensions.
    """
    if isinstance(value, Scalar):
        return ca.SX(value.x)
    if isinstance(value, ca.SX):
        return value
    if isinstance(value, ca.DM | int | float | np.number):
        return ca.SX(float(value)) if not isinstance(value, ca.DM) else ca.SX(value)
    if not isinstance(value, np.ndarray | list | tuple):
        raise TypeError(f"{type(value).__name__} is not a number")
    a = np.asarray(value, dtype=object)
    if a.ndim > 2:
        raise ValueError(f"{a.ndim} dimensions")
    a = a.reshape(-1, 1) if a.ndim < 2 else a
    rows = [ca.horzcat(*(to_sx(v.item() if isinstance(v, np.ndarray) else v) for v in row)) for row in a]
    return ca.vertcat(*rows)
