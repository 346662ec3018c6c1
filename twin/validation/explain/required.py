"""Find a missing term, factor, square or sign from the value that an expression of a row must have.

For each expression of a statement, the value with which the wrong rows agree is computed at each pose, by
Gauss-Newton. A short formula of the expression and of other values in scope that gives this value at every pose is an
edit: the expression plus a term, times a factor, squared, or with the other sign. One solution thus replaces the trial
of thousands of edits. Terms and factors are symbols, expressions of the same function, their squares, and products of
two.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np

from twin.core.spatial import Array
from twin.formula.scalar import Scalar
from twin.validation.explain.candidate import residuals
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.judge import Judge
from twin.validation.explain.numeric import Matrix
from twin.validation.explain.rows import Key, Step
from twin.validation.explain.source import Edit, Source, Statement

_NAME = "_required_"
"""Name of the function, in the edited text, that changes the value of an expression."""

_STEPS, _DIFFERENCE = 12, 1e-6
"""Number of Gauss-Newton steps, and the difference with which derivatives are computed."""

_TIGHT = 1e-3
"""Residual at which Gauss-Newton ends, in units of the tolerance."""

_STARTS = (-2.0, -0.9, -0.6, -0.3, 0.5, 1.0)
"""Further shifts from which Gauss-Newton starts where a row has no value, as multiples of the expression's value."""

_FEWEST = 6
"""Minimum number of poses at which a row must have a value."""

_EQUAL = 1e-6
"""Relative difference up to which a formula gives the required value; the edit is then tried like any other."""

_MOST_ATOMS, _MOST_FACTORS, _MOST_ENTRIES = 200, 60, 4
"""Maximum number of values that may be terms, of those of which products are made, and of entries of a vector."""

_LONGEST = 100
"""Maximum length of the text of a value."""

_MOST_EDITS = 40
"""Maximum number of edits of one expression."""

_NUMBERS = {
    **{
        1.0: "1",
        2.0: "2",
        3.0: "3",
        4.0: "4",
        0.5: "1 / 2",
        0.25: "1 / 4",
        1 / 3: "1 / 3",
        2 / 3: "2 / 3",
        1.5: "3 / 2",
    },
    **{np.pi: "pi", np.pi / 2: "pi / 2", 2 * np.pi: "2 * pi", np.pi / 3: "pi / 3", 2 * np.pi / 3: "2 * pi / 3"},
    **{np.sqrt(3): "sqrt(3)", np.sqrt(3) / 2: "sqrt(3) / 2", np.sqrt(3) / 3: "sqrt(3) / 3"},
    **{np.sqrt(3) / 6: "sqrt(3) / 6", np.sqrt(2): "sqrt(2)", np.sqrt(2) / 2: "sqrt(2) / 2"},
}
"""Numbers that terms and factors may be."""


@dataclass(frozen=True)
class _Atom:
    """A value of which terms and factors are made: its text and its values (k,)."""

    text: str
    values: Array


class _Shift:
    """The function `_NAME`: returns its first argument plus `shift`, and stores this argument and the scope.

    `known` (k,): the poses at which the row has a value.
    """

    def __init__(self, k: int) -> None:
        self.shift: Array = np.zeros(k)
        self.value: Array = np.zeros(k)
        self.known: np.ndarray = np.ones(k, bool)
        self.scope: dict[str, Any] = {}

    def __call__(self, value: Any, scope: dict[str, Any]) -> Any:
        """Return the shifted value; raise TypeError if the value is no scalar."""
        x = value.x if isinstance(value, Scalar) else value
        if isinstance(x, Matrix) or np.shape(x) not in ((), self.shift.shape):
            raise TypeError("not a scalar")
        self.value = np.broadcast_to(np.asarray(x, float), self.shift.shape)
        self.scope = dict(scope)
        out = self.value + self.shift
        return type(value)(out) if isinstance(value, Scalar) else out


class Required:
    """Search for changed expressions in the statements of one equation, and of the functions that it calls."""

    def __init__(self, judge: Judge, step: Step, rows: Sequence[Key], deadline: Deadline) -> None:
        """Set up the search for the wrong rows `rows`, which all depend on the equation of `step`."""
        self.judge, self.step, self.rows, self.deadline = judge, step, rows, deadline

    def edits(self, source: Source, statement: Statement) -> Iterator[Edit]:
        """Yield edits of a statement after which a row agrees, until the deadline; all of them must be tried."""
        atoms: list[_Atom] | None = None
        parents = {c: n for n in ast.walk(statement.node) for c in ast.iter_child_nodes(n)}
        for node in _scalars(statement.node, parents):
            if self.deadline.passed:
                return
            solved = self._solved(source, statement, node)
            if solved is None:
                continue
            if atoms is None:
                atoms = _atoms(source, statement, solved, self.judge.truth.k)
            yield from islice(_written(source, statement, node, parents, solved, atoms), _MOST_EDITS)

    def _solved(self, source: Source, statement: Statement, node: ast.expr) -> _Shift | None:
        """Return the shift of an expression with which all rows agree, or the first row that can; None without one."""
        start, end = source.span(node)
        text = source.text(start, end)
        new = f"{_NAME}({text}, locals())"
        line = source.line_of(start)
        edit = Edit(source.path, line, start, end, text, new, "required", statement.index, source.name)
        at_zero = _Shift(self.judge.truth.k)
        base = self._residual(edit, at_zero)
        if base is None:
            return None
        at_zero.shift = np.full(self.judge.truth.k, _DIFFERENCE)
        moved = self._residual(edit, at_zero)
        if moved is None:
            return None
        mine = [k for k in self.rows if k in moved and k in base and not np.array_equal(base[k], moved[k])]
        for rows in (mine, *([k] for k in mine if len(mine) > 1)):
            shift = self._fitted(edit, rows) if rows else None
            if shift is not None:
                return shift
        return None

    def _fitted(self, edit: Edit, rows: Sequence[Key]) -> _Shift | None:
        """Return the shift with which the rows agree at every pose; None if Gauss-Newton does not find it."""
        shift = _Shift(self.judge.truth.k)

        def residual(values: Array) -> Array | None:
            shift.shift = values
            found = self._residual(edit, shift)
            if found is None or any(k not in found for k in rows):
                return None
            return np.hstack([found[k] for k in rows])

        values = np.zeros(self.judge.truth.k)
        r = residual(values)
        if r is None:
            return None
        for factor in _STARTS if not np.isfinite(r).all() else ():  # where the wrong row has no value
            tried = factor * shift.value
            there = residual(tried)
            if there is None:
                return None
            better = _cost(there) < _cost(r)
            values, r = np.where(better, tried, values), np.where(better[:, None], there, r)
        known = np.isfinite(r).all(axis=1)
        if known.sum() < _FEWEST:
            return None
        for _ in range(_STEPS):
            if self.deadline.passed:
                return None
            if np.abs(r[known]).max() <= _TIGHT:
                break
            ahead = residual(values + _DIFFERENCE)
            if ahead is None:
                return None
            slope = (ahead - r) / _DIFFERENCE
            step = -np.sum(slope * r, axis=1) / np.maximum(np.sum(slope**2, axis=1), 1e-300)
            step = np.where(known, step, 0.0)
            if not np.isfinite(step).all():
                return None
            new = residual(values + step)
            for _ in range(4):  # half the step where the residual grows
                if new is None:
                    return None
                worse = known & ~(_cost(new) <= _cost(r))
                if not worse.any():
                    break
                step = np.where(worse, step / 2, step)
                new = residual(values + step)
            if new is None or np.abs(new[known]).max() > max(0.9 * np.abs(r[known]).max(), 1.0):
                return None  # this expression cannot make the rows agree
            values, r = values + step, new
        if not np.abs(r[known]).max() <= 1:
            return None
        residual(values)
        shift.known = np.asarray(known)
        return shift

    def _residual(self, edit: Edit, shift: _Shift) -> dict[Key, Array] | None:
        extra = {_NAME: shift}
        called = [h.function.__globals__ for h in self.judge.helpers(self.step)]
        called = called if edit.function != self.step.source.name else []
        for scope in called:
            scope.update(extra)
        try:
            return residuals(self.judge, self.step.equation.name, [edit], extra)
        finally:
            for scope in called:
                scope.pop(_NAME, None)


def _cost(r: Array) -> Array:
    """Return the sum of squares of residuals (k, entries) at each pose; infinite without a value."""
    return np.nan_to_num(np.sum(r**2, axis=1), nan=np.inf)


def _scalars(root: ast.AST, parents: dict[ast.AST, ast.AST]) -> Iterator[ast.expr]:
    """Yield the expressions of a statement that may be scalars, the outermost first."""
    kinds = (ast.Name, ast.Call, ast.Subscript, ast.BinOp, ast.UnaryOp, ast.Attribute)
    for node in ast.walk(root):
        if not isinstance(node, kinds) or isinstance(getattr(node, "ctx", None), ast.Store):
            continue
        parent = parents.get(node)
        if isinstance(parent, ast.Call) and parent.func is node:
            continue
        if isinstance(parent, ast.Attribute | ast.keyword | ast.Starred) or _in_index(node, parents):
            continue
        yield node


def _in_index(node: ast.AST, parents: dict[ast.AST, ast.AST]) -> bool:
    while node in parents and not isinstance(node, ast.stmt):
        parent = parents[node]
        if isinstance(parent, ast.Subscript) and parent.slice is node:
            return True
        node = parent
    return False


def _atoms(source: Source, statement: Statement, shift: _Shift, k: int) -> list[_Atom]:
    """Return the scalars in scope at a statement: names, entries of vectors, and expressions of the same function."""
    scope = shift.scope
    texts: dict[str, None] = {}
    own = {w for s in source.statements[: statement.index + 1] for w in (*s.reads, *s.writes)}
    for name in sorted({*source.arguments, *own}):
        value = scope.get(name)
        size = len(value) if isinstance(value, np.ndarray) and value.dtype == object and value.ndim == 1 else 0
        if isinstance(value, Matrix) and value.shape[1] == 1:
            size = value.shape[0]
        if size and size <= _MOST_ENTRIES:
            texts.update(dict.fromkeys(f"{name}[{i}]" for i in range(size)))
        else:
            texts[name] = None
    for s in source.statements:
        for node in ast.walk(s.node):
            if isinstance(node, ast.Call | ast.BinOp | ast.Subscript) and len(ast.unparse(node)) <= _LONGEST:
                texts[ast.unparse(node)] = None
    out = []
    with np.errstate(all="ignore"):
        for text in sorted(texts, key=len):
            try:
                value = eval(text, dict(scope))
            except Exception:  # a name that is not in scope, a matrix, an index out of range
                continue
            x = value.x if isinstance(value, Scalar) else value
            if isinstance(x, Matrix | bool) or np.shape(x) not in ((), (k,)):
                continue
            try:
                values = np.broadcast_to(np.asarray(x, float), (k,))
            except (TypeError, ValueError):
                continue
            if np.isfinite(values).any() and np.nanmax(np.abs(values)) > 0:
                out.append(_Atom(text, values))
    return out[:_MOST_ATOMS]


def _written(
    source: Source,
    statement: Statement,
    node: ast.expr,
    parents: dict[ast.AST, ast.AST],
    shift: _Shift,
    atoms: Sequence[_Atom],
) -> Iterator[Edit]:
    """Yield the edits that give an expression its required value, the shortest first."""
    start, end = source.span(node)
    text = source.text(start, end)
    whole = f"({text})" if isinstance(node, ast.BinOp | ast.UnaryOp) else text
    parent = parents.get(node)
    free = isinstance(parent, ast.Assign | ast.Return | ast.Tuple | ast.List | ast.Call)
    summand = isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Add | ast.Sub)
    factor = isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Mult)

    def made(new: str, kind: str) -> Edit:
        bare = new if free else f"({new})"
        line = source.line_of(start)
        return Edit(source.path, line, start, end, text, bare, kind, statement.index, source.name)

    x, added = shift.value[shift.known], shift.shift[shift.known]
    wanted = x + added
    atoms = [_Atom(a.text, a.values[shift.known]) for a in atoms]
    if _equal(wanted, -x):
        yield made(f"-{whole}", "sign")
    if _equal(wanted, x**2):
        yield made(f"{whole}**2", "exponent")
    with np.errstate(all="ignore"):
        root, ratio = np.sqrt(x), wanted / x
    if _equal(wanted, root):
        prefix = "np." if "np." in source.text(statement.start, statement.end) else ""
        yield made(f"{prefix}sqrt({text})", "missing")
    if not summand:  # a term of the sum is found at the sum
        for sign, term in _terms(added, atoms):
            yield made(f"{text} {sign} {term}", "missing")
    if not factor and np.isfinite(ratio).all():
        for term in _factors(ratio, atoms):
            yield made(f"{term} * {whole}", "missing")
        for term in _factors(1 / ratio, atoms):
            yield made(f"{whole} / ({term})", "missing")


def _equal(a: Array, b: Array) -> bool:
    return bool(np.abs(a - b).max() <= _EQUAL * max(float(np.abs(a).max()), 1e-9))


def _terms(wanted: Array, atoms: Sequence[_Atom]) -> Iterator[tuple[str, str]]:
    """Yield (sign, text) of terms with the values `wanted` (k,)."""
    for value, text in _NUMBERS.items():
        for sign, factor in (("+", 1.0), ("-", -1.0)):
            if _equal(wanted, np.full(len(wanted), factor * value)):
                yield sign, text
    for coefficient, text in _products(wanted, atoms):
        sign = "-" if coefficient < 0 else "+"
        size = abs(coefficient)
        number = _number(size)
        if number is not None:
            yield sign, text if number == "1" else f"{number} * {text}"


def _factors(wanted: Array, atoms: Sequence[_Atom]) -> Iterator[str]:
    """Yield the texts of factors with the values `wanted` (k,)."""
    for value, text in _NUMBERS.items():
        if value != 1.0 and _equal(wanted, np.full(len(wanted), value)):
            yield text
    for coefficient, text in _products(wanted, atoms):
        if _equal(np.array([coefficient]), np.ones(1)):
            yield text


def _number(size: float) -> str | None:
    return next((text for value, text in _NUMBERS.items() if abs(size / value - 1) < _EQUAL), None)


def _products(wanted: Array, atoms: Sequence[_Atom]) -> Iterator[tuple[float, str]]:
    """Yield (coefficient, text) of atoms, then of squares and products of two, that are proportional to `wanted`."""
    if not atoms:
        return
    A = np.stack([a.values for a in atoms])
    texts = [_inside(a.text) for a in atoms]
    for i, coefficient in _proportional(wanted, A):
        yield coefficient, texts[i]
    if np.ptp(wanted) <= _EQUAL * np.abs(wanted).max():  # products of decimal numbers often coincide
        for i, coefficient in _proportional(wanted, A**2):
            yield coefficient, f"{texts[i]}**2"
        return
    A = A[:_MOST_FACTORS]
    first, second = np.triu_indices(len(A))
    for n, coefficient in _proportional(wanted, A[first] * A[second]):
        i, j = first[n], second[n]
        yield coefficient, f"{texts[i]}**2" if i == j else f"{texts[i]} * {texts[j]}"


def _proportional(wanted: Array, rows: Array) -> Iterator[tuple[int, float]]:
    """Yield (index, coefficient) of the rows (n, k) that are proportional to `wanted` (k,)."""
    with np.errstate(all="ignore"):
        coefficients = (rows @ wanted) / np.sum(rows**2, axis=1)
        off = np.abs(coefficients[:, None] * rows - wanted).max(axis=1)
    limit = _EQUAL * max(float(np.abs(wanted).max()), 1e-9)
    for i in np.flatnonzero(off <= limit):
        yield int(i), float(coefficients[i])


def _inside(text: str) -> str:
    """Return the text of a factor of a product, in parentheses where it needs them."""
    return f"({text})" if isinstance(ast.parse(text, mode="eval").body, ast.BinOp | ast.UnaryOp) else text
