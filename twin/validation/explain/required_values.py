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
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TypeGuard

import numpy as np

from twin.core.spatial import Array
from twin.validation.explain.analogies import analogies, scalar_values
from twin.validation.explain.candidate import residuals_with
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.equation_steps import RowKey, Step
from twin.validation.explain.function_source import Edit, Source, Statement, comprehension_targets
from twin.validation.explain.inverses import inverse
from twin.validation.explain.rebuilt_functions import Matrix, unguarded
from twin.validation.explain.row_deviations import Judge, Residuals, trial_residuals
from twin.validation.explain.shifts import DIFFERENCE, Calls, Flat, Shift, shifted, solution
from twin.validation.explain.swivel import fitted
from twin.validation.explain.term_texts import (
    VECTOR,
    Atom,
    Products,
    equal,
    factors,
    roots,
    sums,
    terms,
    vector_atoms,
    vector_texts,
)
from twin.validation.explain.tokens import parents_of

_NAME = "_required_"
"""Name of the function, in the edited text, that changes the value of an expression."""

_MOST_ATOMS, _MOST_ENTRIES = 200, 4
"""Maximum number of values that may be terms, and of entries of a vector of which each is such a value."""

_COFUNCTIONS = {"sin": "cos", "cos": "sin"}
"""The function that often stands with another one, of the same argument."""

_LONGEST = 100
"""Maximum length of the text of a value."""

_MOST_CALLS = 6
"""Maximum number of calls of an expression in which it may have different values."""

_MOST_EITHER = 6
"""Maximum number of terms, and of factors, that give a square its required value by either root at each pose."""

_MOST_EDITS = 40
"""Maximum number of edits of one expression."""


class RequiredValues:
    """Search for changed expressions in the statements of one equation, and of the functions that it calls."""

    def __init__(
        self,
        judge: Judge,
        step: Step,
        rows: Sequence[RowKey],
        deadline: Deadline,
        fixed: Sequence[Edit] = (),
        refuted: Sequence[tuple[Path, int, int]] = (),
    ) -> None:
        """Set up the search for the wrong rows `rows`, which all depend on the equation of `step`.

        `fixed` are edits of the same function that are made in any case. `refuted` are places (file, first byte,
        end) of scalars with no value of which a row agrees; expressions in them are left out.
        """
        self.judge = judge
        self.step = step
        self.rows = rows
        self.deadline = deadline
        self.fixed = list(fixed)
        self.refuted = list(refuted)

    def edits(self, source: Source, statement: Statement) -> Iterator[Edit]:
        """Yield edits of a statement after which a row agrees, until the deadline; all of them must be tried."""
        atoms: dict[int, list[Atom]] = {}  # by the number of calls
        passed_on: dict[ast.expr, Shift] = {}  # required of the operands, where Gauss-Newton finds no value
        parents = parents_of(statement.node)
        for node in expressions(statement.node, parents):
            start, end = source.span(node)
            if any(start <= edit.end and edit.start <= end for edit in self.fixed):
                continue
            if any(path == source.path and first <= start and end <= last for path, first, last in self.refuted):
                continue
            for entries in (0, VECTOR):
                if self.deadline.passed:
                    return
                solved = self._solved(source, statement, node, entries)
                if solved is None and not entries:
                    solved = passed_on.get(node)
                if solved is None:
                    continue
                if not entries:
                    passed_on |= _of_operands(node, solved)
                calls = len(solved.scopes)
                if calls not in atoms:
                    atoms[calls] = scalar_atoms(source, statement, solved, self.fixed)
                writer = written if not entries else _written_vectors
                yield from islice(writer(source, statement, node, parents, solved, atoms[calls]), _MOST_EDITS)
                if not entries and is_square(node):
                    products = Products([Atom(a.text, a.values[solved.known]) for a in atoms[calls]])
                    yield from in_square(source, statement, node, parents, solved, atoms[calls], products)

    def _solved(self, source: Source, statement: Statement, node: ast.expr, entries: int) -> Shift | None:
        """Return the shift of an expression with which all rows agree, or the first row that can; None without one.

        `entries` is the number of entries of a vector, 0 for a scalar.
        """
        edit = shifted(source, statement, node, _NAME)
        at_zero = Shift(self.judge.reference.k, entries)
        base = self._residual(edit, at_zero, self._swivel)
        if base is None:
            return None
        at_zero.shift = np.full_like(at_zero.shift, DIFFERENCE)
        moved = self._residual(edit, at_zero, self._swivel)
        if moved is None:
            return None
        moved_rows = [k for k in self.rows if k in moved and k in base and not np.array_equal(base[k], moved[k])]
        every = [k for k in moved if k in base and not np.array_equal(base[k], moved[k])]
        if not entries and moved_rows:
            called = self._called(edit, every, at_zero)
            if called is not None:
                return called
        choices = [moved_rows, *([k] for k in moved_rows if len(moved_rows) > 1)]
        if entries and moved_rows:  # rows that agree also determine entries of a vector
            choices = [every, moved_rows]
        for rows in choices:
            shift = self._fitted(edit, rows, entries) if rows else None
            if shift is not None:
                return shift
        return None

    def in_calls(self, source: Source, statement: Statement, node: ast.expr) -> Shift | None:
        """Return the shift of a scalar that is computed several times; None for other expressions.

        With it, the rows agree that the expression moves; see `Calls.flat`.
        """
        edit = shifted(source, statement, node, _NAME)
        shift = Shift(self.judge.reference.k)
        base = self._residual(edit, shift, self._swivel)
        shift.shift = np.full_like(shift.shift, DIFFERENCE)
        moved = self._residual(edit, shift, self._swivel)
        if base is None or moved is None:
            return None
        rows = [k for k in moved if k in base and not np.array_equal(base[k], moved[k], equal_nan=True)]
        return self._called(edit, rows, shift) if rows else None

    def _called(self, edit: Edit, rows: Sequence[RowKey], probe: Shift) -> Shift | None:
        """Return the shifts of an expression in each of its calls with which the rows agree, as one.

        Return None without such shifts, or if `probe` was called once.
        """
        count = probe.count
        if not 1 < count <= _MOST_CALLS or self._swivel is not None:
            return None
        shift = Calls(self.judge.reference.k, count)

        def residual(values: Array) -> Array | None:
            shift.shift = values
            by_row = self._residual(edit, shift, None)
            if by_row is None or shift.count != count or any(k not in by_row for k in rows):
                return None
            return np.hstack([by_row[k] for k in rows])

        solved = solution(residual, np.zeros_like(shift.shift), lambda: shift.values.copy(), self.deadline)
        if solved is None:
            return None
        _, shift.known = solved
        return shift.flat()

    def _fitted(self, edit: Edit, rows: Sequence[RowKey], entries: int) -> Shift | None:
        """Return the shift with which the rows agree at every pose; None if Gauss-Newton does not find it."""
        shift = Shift(self.judge.reference.k, entries)
        unknowns = shift.shift.shape[1]
        start = np.zeros_like(shift.shift)
        swivel = self._swivel
        if swivel is not None:  # it is one more unknown
            start = np.column_stack([start, swivel])

        def residual(values: Array) -> Array | None:
            shift.shift = values[:, :unknowns]
            angle = None if swivel is None else values[:, -1]
            by_row = self._residual(edit, shift, angle)
            if by_row is None or any(k not in by_row for k in rows):
                return None
            return np.hstack([by_row[k] for k in rows])

        def scale() -> Array:
            if swivel is not None:
                return np.column_stack([shift.value, np.zeros(len(start))])
            return shift.value

        solved = solution(residual, start, scale, self.deadline)
        if solved is None:
            return None
        _, shift.known = solved
        return shift

    def _residual(self, edit: Edit, shift: Shift, angle: Array | None) -> dict[RowKey, Array] | None:
        """Return the residuals of the rows with a shifted expression; `angle`: values (k,) of the swivel, if any."""
        shift.begin()
        with unguarded():
            return residuals_with(self.judge, self.step.equation.name, [*self.fixed, edit], {_NAME: shift}, angle)

    @cached_property
    def _swivel(self) -> Array | None:
        """The first values (k,) of the swivel angle: those that are best after the edits `fixed`; None without one."""
        if not self.step.free:
            return None
        (angle,) = self.step.free.values()
        if not self.fixed:
            return np.asarray(angle, float)

        def rows(angle: Array) -> Residuals:
            return trial_residuals(self.judge, self.step, self.fixed, None, angle) or {}

        with unguarded():
            return fitted(rows, self.judge.reference.k)


def expressions(root: ast.AST, parents: dict[ast.AST, ast.AST]) -> Iterator[ast.expr]:
    """Yield the expressions of a statement that may be scalars or vectors, the outermost first."""
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


def scalar_atoms(source: Source, statement: Statement, shift: Shift, fixed: Sequence[Edit] = ()) -> list[Atom]:
    """Return the scalars in scope at a statement: names, entries of vectors, and expressions of the same function.

    Then expressions of the file with names that nobody reads, see `analogies`; `fixed` are edits made in any case.
    """
    scope = shift.scope
    texts: dict[str, None] = {}
    names_so_far = {w for s in source.statements[: statement.index + 1] for w in (*s.reads, *s.writes)}
    names_so_far.update(comprehension_targets(statement.node))
    for name in sorted({*source.arguments, *names_so_far}):
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
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _COFUNCTIONS:
                cofunction = _COFUNCTIONS[node.func.id]
                texts[f"{cofunction}({ast.unparse(node.args[0])})"] = None
                for angle in ast.walk(node.args[0]):
                    if isinstance(angle, ast.Name):
                        texts[f"{node.func.id}({angle.id})"] = None
                        texts[f"{cofunction}({angle.id})"] = None
    found_atoms = []
    with np.errstate(all="ignore"):
        for text in sorted(texts, key=len):
            values = scalar_values(compile(text, "<explain>", "eval"), shift)
            if values is not None:
                found_atoms.append(Atom(text, values))
    return [*found_atoms[:_MOST_ATOMS], *analogies(source, statement, shift, fixed)]


def _patterns(source: Source, expression: ast.expr, atoms: Sequence[Atom]) -> list[list[Atom]]:
    """Return, of each sum of the function, the terms that are among `atoms` and are no terms of `expression`."""
    own_terms = {ast.unparse(term) for term in _summands(expression)}
    known = {a.text: a for a in atoms if a.text not in own_terms}
    terms_of_sums: dict[tuple[str, ...], list[Atom]] = {}
    for s in source.statements:
        for node in ast.walk(s.node):
            if not (isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub)):
                continue
            texts = sorted({ast.unparse(term) for term in _summands(node)} & known.keys())
            if len(texts) > 1:
                terms_of_sums[tuple(texts)] = [known[text] for text in texts]
    return list(terms_of_sums.values())


def _summands(node: ast.expr) -> Iterator[ast.expr]:
    """Yield the terms of a sum without their signs."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        yield from _summands(node.left)
        yield from _summands(node.right)
    else:
        yield node


def _replaced(
    source: Source, statement: Statement, node: ast.expr, parent: ast.AST | None, new: str, kind: str
) -> Edit:
    """Return the edit that replaces an expression, in parentheses where it is part of another expression."""
    start, end = source.span(node)
    if not isinstance(parent, ast.Assign | ast.Return | ast.Tuple | ast.List | ast.Call):
        new = f"({new})"
    line = source.line_of(start)
    return Edit(source.path, line, start, end, source.text(start, end), new, kind, statement.index, source.name)


def written(
    source: Source,
    statement: Statement,
    node: ast.expr,
    parents: dict[ast.AST, ast.AST],
    shift: Shift,
    atoms: Sequence[Atom],
) -> Iterator[Edit]:
    """Yield the edits that give an expression its required value, the shortest first."""
    start, end = source.span(node)
    text = source.text(start, end)
    whole = f"({text})" if isinstance(node, ast.BinOp | ast.UnaryOp) else text
    parent = parents.get(node)
    summand = isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Add | ast.Sub)
    factor = isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Mult)

    def made(new: str, kind: str) -> Edit:
        return _replaced(source, statement, node, parent, new, kind)

    x, added = shift.value[shift.known, 0], shift.shift[shift.known, 0]
    wanted = x + added
    atoms = [Atom(a.text, a.values[shift.known]) for a in atoms]
    if equal(wanted, -x):
        yield made(f"-{whole}", "sign")
    if equal(wanted, x**2):
        yield made(f"{whole}**2", "exponent")
    root = "np.sqrt" if "np." in source.text(statement.start, statement.end) else "sqrt"
    with np.errstate(all="ignore"):
        ratio = wanted / x
        is_root = equal(wanted, np.sqrt(x))
    if is_root:
        yield made(f"{root}({text})", "missing")
    if not summand:  # a term of the sum is found at the sum
        for sign, term in terms(added, atoms):
            yield made(f"{text} {sign} {term}", "missing")
        for several in sums(added, _patterns(source, node, atoms)):
            yield made(f"{text} {several}", "missing")
        for sign, factor_of_root in (("+", 1.0), ("-", -1.0)):
            for term in roots(factor_of_root * added, atoms, root):
                yield made(f"{text} {sign} {term}", "missing")
    if not factor and np.isfinite(ratio).all():
        for term in factors(ratio, atoms):
            yield made(f"{term} * {whole}", "missing")
        if ratio.all():
            for term in factors(1 / ratio, atoms):
                yield made(f"{whole} / ({term})", "missing")
        for term in roots(ratio, atoms, root):
            yield made(f"{term} * {whole}", "missing")


def _present(part: ast.expr, shift: Shift) -> Array | None:
    """Return the present values (k,) of a part of an expression in the scopes of a shift; None if it is no scalar."""
    return scalar_values(compile(ast.unparse(part), "<explain>", "eval"), shift)


def _of_operands(node: ast.expr, shift: Shift) -> dict[ast.expr, Shift]:
    """Return the shifts of the operands of an expression that give it its required value; see `inverse`."""
    wanted = shift.value[:, 0] + shift.shift[:, 0]
    shifts: dict[ast.expr, Shift] = {}
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.expr):
            continue
        needed = inverse(node, child, wanted, lambda part: _present(part, shift))
        values = _present(child, shift) if needed is not None else None
        if needed is None or values is None or not np.isfinite((needed + values)[shift.known]).all():
            continue
        inner = Flat(len(values), shift.scopes)
        inner.known = shift.known
        inner.value = values[:, None]
        inner.shift[shift.known, 0] = (needed - values)[shift.known]
        shifts[child] = inner
    return shifts


def is_square(node: ast.AST) -> TypeGuard[ast.BinOp]:
    """Return whether a syntax node is the square of an expression."""
    return isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow) and ast.unparse(node.right) == "2"


def in_square(
    source: Source,
    statement: Statement,
    node: ast.expr,
    parents: dict[ast.AST, ast.AST],
    shift: Shift,
    atoms: Sequence[Atom],
    products: Products,
) -> Iterator[Edit]:
    """Yield edits of a part of a square that give the square its required value.

    The part has two required values at each pose, because the root of the square may have either sign there.
    """
    if not is_square(node):
        return

    def value(part: ast.expr) -> Array | None:
        return _present(part, shift)

    known = shift.known
    with np.errstate(all="ignore"):
        root = np.sqrt(shift.value[:, 0] + shift.shift[:, 0])
    todo = [(node.left, root, -root)]
    while todo:
        part, first, second = todo.pop(0)
        values_of_part = value(part)
        if values_of_part is not None and np.isfinite(values_of_part[known]).all():
            with np.errstate(all="ignore"):
                added = products.either(first[known] - values_of_part[known], second[known] - values_of_part[known])
                ratios = products.either(first[known] / values_of_part[known], second[known] / values_of_part[known])
            for values in (
                *(values_of_part[known] + added[:_MOST_EITHER]),
                *(values_of_part[known] * ratios[:_MOST_EITHER]),
            ):
                inner = Flat(len(values_of_part), shift.scopes)
                inner.known = known
                inner.value = values_of_part[:, None]
                inner.shift[known, 0] = values - values_of_part[known]
                yield from islice(written(source, statement, part, parents, inner, atoms), _MOST_EDITS)
        for child in ast.iter_child_nodes(part):
            if isinstance(child, ast.expr):
                above, below = inverse(part, child, first, value), inverse(part, child, second, value)
                if above is not None and below is not None:
                    todo.append((child, above, below))


def _written_vectors(
    source: Source,
    statement: Statement,
    node: ast.expr,
    parents: dict[ast.AST, ast.AST],
    shift: Shift,
    atoms: Sequence[Atom],
) -> Iterator[Edit]:
    """Yield the edits that give an expression its required value, a vector."""
    text = source.text(*source.span(node))
    known = shift.known
    scalars = [Atom(a.text, a.values[known]) for a in atoms]
    vectors = [Atom(a.text, a.values[known]) for a in vector_atoms(source, shift.scope, len(known))]
    for new in vector_texts(text, node, shift.value[known], shift.shift[known], scalars, vectors):
        yield _replaced(source, statement, node, parents.get(node), new, "missing")
