"""Short formulas for vectors: an expression with a further term or factor, each known by its values at poses."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from twin.core.spatial import Array
from twin.formula.scalar import Value
from twin.validation.explain.function_source import Source
from twin.validation.explain.rebuilt_functions import Matrix, to_array
from twin.validation.explain.term_texts import SIGNS, Atom, are_equal, as_factor, difference_limit, factors

VECTOR_ENTRIES = 3
"""Number of entries of a vector."""

_POSE_COLUMNS = 4
"""Number of columns of the largest matrix, a pose."""

_MOST_VECTORS = 60
"""Maximum number of vectors that terms and factors may be."""


def vector_atoms(source: Source, scope: Mapping[str, Value], k: int) -> list[Atom]:
    """Return the vectors in scope, with values (k, 3).

    They are names, expressions of the same function, and the other columns of matrices of which it uses one column.
    """
    texts: dict[str, None] = dict.fromkeys(sorted(source.arguments))  # in the order in which they are found
    for statement in source.statements:
        texts |= dict.fromkeys(sorted({*statement.reads, *statement.writes}))
        for node in ast.walk(statement.node):
            if isinstance(node, ast.Call | ast.BinOp | ast.Subscript):
                texts[ast.unparse(node)] = None
            if isinstance(node, ast.Subscript):
                texts |= dict.fromkeys(_columns(node))
    atoms: list[Atom] = []
    with np.errstate(all="ignore"):
        for text in sorted(texts, key=len):
            try:
                value = eval(text, dict(scope))
            except Exception:  # a name that is not in scope, an index out of range
                continue
            if isinstance(value, Matrix) and value.shape == (VECTOR_ENTRIES, 1):
                values = to_array(value, k)
                if np.isfinite(values).any() and np.nanmax(np.abs(values)) > 0:
                    atoms.append(Atom(text, values))
    return atoms[:_MOST_VECTORS]


def _columns(node: ast.Subscript) -> Iterator[str]:
    """Yield the texts of the columns 0 to 3 of the matrix of which `node` is a column, with the same rows."""
    index = node.slice
    if not isinstance(index, ast.Tuple) or len(index.elts) != 2 or not isinstance(index.elts[0], ast.Slice):
        return
    base = ast.unparse(node.value)
    rows = ast.unparse(index.elts[0])
    for column in range(_POSE_COLUMNS):
        yield f"{base}[{rows}, {column}]"


def vector_texts(
    text: str, node: ast.expr, value: Array, added: Array, atoms: Sequence[Atom], vectors: Sequence[Atom]
) -> Iterator[str]:
    """Yield texts that make the value (k, 3) of `text` larger by `added` (k, 3), the shortest kinds first.

    `node` is the expression, `atoms` are scalars with values (k,), `vectors` have values (k, 3).
    """
    factor_text = text
    if isinstance(node, ast.BinOp | ast.UnaryOp):
        factor_text = f"({text})"
    required = value + added
    for vector in vectors:  # the expression is the scalar of which a vector was the factor
        for minus, sign in (("", 1.0), ("-", -1.0)):
            if are_equal(required, sign * value * vector.values):
                yield f"{minus}{factor_text} * {as_factor(vector.text)}"
    ratio = _parallel_ratio(required, value)
    if ratio is not None:
        for factor in factors(ratio, atoms):
            yield f"{factor} * {factor_text}"
        for factor in factors(1 / ratio, atoms):
            yield f"{factor_text} / ({factor})"
    for vector in vectors:  # a further term: a scalar times a vector that stands elsewhere
        ratio = _parallel_ratio(added, vector.values)
        if ratio is None:
            continue
        name = as_factor(vector.text)
        for sign, sign_value in SIGNS:
            if are_equal(ratio, np.full(len(ratio), sign_value)):
                yield f"{text} {sign} {name}"
            for factor in factors(sign_value * ratio, atoms):
                yield f"{text} {sign} {factor} * {name}"


def _parallel_ratio(a: Array, b: Array) -> Array | None:
    """Return the scalars (k,) by which vectors b (k, 3) are multiplied in a (k, 3); None if a is not parallel to b."""
    with np.errstate(all="ignore"):
        ratio = np.sum(a * b, axis=1) / np.sum(b * b, axis=1)
    if not np.isfinite(ratio).all() or not np.abs(ratio).min() > 0:
        return None
    is_parallel = np.abs(ratio[:, None] * b - a).max() <= difference_limit(a)
    if not is_parallel:
        return None
    return ratio
