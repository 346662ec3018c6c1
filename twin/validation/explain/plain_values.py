"""Run a plain formula (functions `inverse(pose)` or `forward(q)` in NumPy) on many samples at once.

The code runs unchanged: each scalar is an object that holds the values at all samples.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from twin.core.spatial import Array
from twin.formula.plain_function import PlainRows, entries
from twin.formula.scalar import METHODS, Scalar, Value
from twin.validation.explain.function_source import Source
from twin.validation.explain.rebuilt_functions import Matrix


def _numpy_functions() -> dict[str, Callable[..., Value]]:
    """Return the functions of NumPy by the names that scalars of plain functions use."""
    functions: dict[str, Callable[..., Value]] = {"if_else": np.where}
    for name in METHODS:
        functions[name] = getattr(np, name)
    return functions


class SampledScalar(Scalar):
    """A scalar with its values (k,) at all samples."""

    __slots__ = ()
    functions = _numpy_functions()


def as_objects(x: Value) -> Value:
    """Convert a value of the judge to the form that a plain function uses: a number, object or array of objects."""
    if isinstance(x, np.ndarray):
        return SampledScalar(x)
    if not isinstance(x, Matrix):
        return x
    rows, columns = x.shape
    objects = np.full((rows, columns), None, dtype=object)
    for i in range(rows):
        for j in range(columns):
            objects[i, j] = SampledScalar(x.a[:, i, j])
    if columns == 1:  # plain functions have vectors, not matrices of one column
        return objects[:, 0]
    return objects


def as_arrays(x: Value) -> Value:
    """Convert a value of a plain function to the form that the judge uses: a number, array (k,) or matrix."""
    if isinstance(x, SampledScalar):
        return np.asarray(x.x, float)
    if isinstance(x, np.ndarray) and x.ndim in (1, 2):
        table = x.reshape(len(x), -1)
        values: list[Array] = []
        for entry in table.ravel():
            values.append(np.asarray(unwrapped(entry), float))
        entries_last = np.stack(np.broadcast_arrays(*values), axis=-1)
        return Matrix(entries_last.reshape(-1, *table.shape))
    return x


def unwrapped(x: Value) -> Value:
    """Return the values of a scalar of a plain function; other values as they are."""
    if isinstance(x, Scalar):
        return x.x
    return x


def scalar_form(scope: Mapping[str, Value]) -> Callable[[Array], Value]:
    """Return a function that gives values the form of the scalars of a scope: in plain functions, they are objects."""
    for value in scope.values():
        if isinstance(value, Scalar):
            return type(value)
    return np.asarray


def to_function_form(row: PlainRows | None, x: Value) -> Value:
    """Convert a value from the form of the judge to the form of the plain function `row`; unchanged without `row`."""
    if row is None or row.casadi:
        return x
    return as_objects(x)


def from_function_form(row: PlainRows | None, x: Value) -> Value:
    """Convert a value from the form of the plain function `row` to the form of the judge; unchanged without `row`."""
    if row is None or row.casadi:
        return x
    return as_arrays(x)


def arguments(row: PlainRows, symbols: Mapping[str, Value]) -> dict[str, Value]:
    """Return the arguments of a plain function, from the values of the symbols."""
    if row.casadi:
        return row.arguments(symbols, lambda x: x, _joint_vector)
    return row.arguments(symbols, as_objects, _joint_objects)


def _joint_vector(*q: Value) -> Matrix:
    columns = np.broadcast_arrays(*q)
    return Matrix(np.stack(columns, axis=1)[:, :, None])


def _joint_objects(*q: Value) -> Value:
    objects: list[Value] = []
    for values in q:
        objects.append(as_objects(values))
    return np.array(objects, dtype=object)


def output_values(row: PlainRows, value: Value) -> list[Value]:
    """Split the result of a plain function into one value per output."""
    if row.casadi:
        return row.spread(value, _matrix_entries)
    values: list[Value] = []
    for entry in row.spread(value, entries):
        values.append(as_arrays(entry))
    return values


def _matrix_entries(x: Value) -> list[Value] | None:
    if not isinstance(x, Matrix):
        return None
    return [x[i] for i in range(x.numel())]


_CHANGEABLE_TYPES = frozenset((list, dict, np.ndarray))
"""Types of values that a statement may change in place."""


def with_copied_values(scope: Mapping[str, Value]) -> dict[str, Value]:
    """Return a scope with copies of its lists, dicts and object arrays, because statements may change them."""
    copies = dict(scope)
    for name, value in scope.items():
        # Arrays of numbers are never changed in place.
        is_filled = type(value) in _CHANGEABLE_TYPES and (type(value) is not np.ndarray or value.dtype == object)
        if is_filled:
            copies[name] = value.copy()
    return copies


def compared_variables(source: Source, outputs: tuple[str, ...]) -> set[str]:
    """Return the outputs that the function returns as a variable of the same name, assigned exactly once."""
    returned = getattr(source.statements[-1].node, "value", None)
    pairs: Iterable[tuple[object, ast.expr | None]] = ()
    if isinstance(returned, ast.Dict):
        keys: list[object] = []
        for key in returned.keys:
            keys.append(getattr(key, "value", None))  # a key that is no constant names no output
        pairs = zip(keys, returned.values, strict=True)
    else:
        elements = getattr(returned, "elts", [returned])
        if len(elements) == len(outputs):
            pairs = zip(outputs, elements, strict=True)
    writes: list[str] = []
    for statement in source.statements:
        writes += statement.writes
    names: set[str] = set()
    for output, element in pairs:
        if isinstance(element, ast.Name) and element.id == output and writes.count(element.id) == 1:
            names.add(element.id)
    return names
