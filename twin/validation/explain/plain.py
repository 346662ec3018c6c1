"""Run a plain formula (functions `inverse(pose)` or `forward(q)` in NumPy) on many samples at once.

The code runs unchanged: each scalar is an object that holds the values at all samples.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Any

import numpy as np

from twin.formula.rows import PlainRows, entries
from twin.formula.scalar import METHODS, Scalar
from twin.validation.explain.numeric import Matrix
from twin.validation.explain.source import Source


class Samples(Scalar):
    """A scalar with its values (k,) at all samples."""

    __slots__ = ()
    functions = {**{n: getattr(np, n) for n in METHODS}, "if_else": np.where}  # noqa: RUF012


def enter(x: Any) -> Any:
    """Convert a value of the judge to the form that a plain function uses: a number, object or array of objects."""
    if isinstance(x, Matrix):
        _, rows, columns = x.a.shape
        out = np.array([[Samples(x.a[:, i, j]) for j in range(columns)] for i in range(rows)], dtype=object)
        return out[:, 0] if columns == 1 else out
    if isinstance(x, np.ndarray):
        return Samples(x)
    return x


def leave(x: Any) -> Any:
    """Convert a value of a plain function to the form that the judge uses: a number, array (k,) or matrix."""
    if isinstance(x, Samples):
        return np.asarray(x.x, float)
    if isinstance(x, np.ndarray) and x.ndim in (1, 2):
        a = x.reshape(len(x), -1)
        parts = np.broadcast_arrays(*(np.asarray(v.x if isinstance(v, Scalar) else v, float) for v in a.ravel()))
        return Matrix(np.stack(parts, axis=-1).reshape(-1, *a.shape))
    return x


def inside(row: PlainRows | None, x: Any) -> Any:
    """Convert a value from the form of the judge to the form of the plain function `row`; unchanged without `row`."""
    return x if row is None or row.casadi else enter(x)


def outside(row: PlainRows | None, x: Any) -> Any:
    """Convert a value from the form of the plain function `row` to the form of the judge; unchanged without `row`."""
    return x if row is None or row.casadi else leave(x)


def arguments(row: PlainRows, symbols: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a plain function, from the values of the symbols."""
    if row.casadi:
        return row.arguments(symbols, lambda x: x, lambda *q: Matrix(np.stack(np.broadcast_arrays(*q), 1)[:, :, None]))
    return row.arguments(symbols, enter, lambda *q: np.array([enter(x) for x in q], dtype=object))


def parts(row: PlainRows, value: Any) -> list[Any]:
    """Split the result of a plain function into one value per output."""
    if row.casadi:
        return row.spread(value, lambda x: [x[i] for i in range(x.numel())] if isinstance(x, Matrix) else None)
    return [leave(v) for v in row.spread(value, entries)]


_FILLED = frozenset((list, dict, np.ndarray))
"""Types of values that a statement may change in place."""


def copied(scope: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scope with copies of its lists, dicts and object arrays, because statements may change them."""
    own = dict(scope)
    for n, x in scope.items():
        if type(x) in _FILLED and (type(x) is not np.ndarray or x.dtype == object):
            own[n] = x.copy()
    return own


def held(source: Source, outputs: tuple[str, ...]) -> set[str]:
    """Return the outputs that the function returns as a variable of the same name, assigned exactly once."""
    returned = getattr(source.statements[-1].node, "value", None)
    if isinstance(returned, ast.Dict):
        pairs = [
            (k.value, v) for k, v in zip(returned.keys, returned.values, strict=True) if isinstance(k, ast.Constant)
        ]
    else:
        elements = getattr(returned, "elts", [returned])
        pairs = list(zip(outputs, elements, strict=False)) if len(elements) == len(outputs) else []
    writes = [w for s in source.statements for w in s.writes]
    return {v.id for n, v in pairs if isinstance(v, ast.Name) and v.id == n and writes.count(v.id) == 1}
