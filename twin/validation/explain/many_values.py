"""Values of many edits as one array: what they must have in common, and how they are put together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.formula.scalar import Value
from twin.validation.explain.rebuilt_functions import Matrix


def form(value: Value, size: int) -> Value:
    """Return what values must have in common to be one array; None for values that cannot be part of one."""
    if isinstance(value, Matrix):
        return value.shape if len(value.a) in (1, size) else None
    if isinstance(value, list | tuple):
        forms = tuple(form(entry, size) for entry in value)
        if None in forms:
            return None
        return type(value), forms
    is_number = isinstance(value, bool | int | float | np.ndarray | np.number)
    # an array of objects may hold matrices, which have forms of their own
    if is_number and np.shape(value) in ((), (1,), (size,)) and np.asarray(value).dtype != object:
        return "scalar"
    return None


def stacked(values: Sequence[Value], size: int) -> Value:
    """Return values of the same form, each of which has 1 or `size` values, as one array."""
    first = values[0]
    if isinstance(first, Matrix):
        return Matrix(np.concatenate([np.broadcast_to(v.a, (size, *first.shape)) for v in values]))
    if isinstance(first, list | tuple):
        return type(first)(stacked([v[i] for v in values], size) for i in range(len(first)))
    return np.concatenate([np.broadcast_to(np.asarray(v, float), (size,)) for v in values])


def tiled(value: Value, size: int, count: int) -> Value:
    """Return `size` values, repeated for each of `count` edits; a single value holds for all of them."""
    if size == 1:
        return value
    if isinstance(value, Matrix) and len(value.a) == size:
        return Matrix(np.tile(value.a, (count, 1, 1)))
    if isinstance(value, list | tuple):
        return type(value)(tiled(entry, size, count) for entry in value)
    if isinstance(value, np.ndarray) and value.shape == (size,):
        return np.tile(value, count)
    return value
