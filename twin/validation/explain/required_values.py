"""Find a missing term, factor, square or sign from the value that an expression of a row must have.

For each expression of a statement, the value with which the wrong rows agree is computed at each pose, by
Gauss-Newton. A short formula of the expression and of other values in scope that gives this value at every pose is an
edit: the expression plus a term, times a factor, squared, or with the other sign. One solution thus replaces the trial
of thousands of edits. Terms and factors are symbols, expressions of the same function, their squares, and products of
two.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from itertools import islice
from typing import TypeGuard

import numpy as np

from twin.core.spatial import Array
from twin.formula.scalar import Value
from twin.validation.explain.analogies import analogies, scalar_values
from twin.validation.explain.candidate import residuals_with
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.equation_steps import RowKey, Step
from twin.validation.explain.expression_shifts import (
    DERIVATIVE_STEP,
    FlatShift,
    Shift,
    ShiftOfCalls,
    newton_solution,
    shifted,
)
from twin.validation.explain.function_source import Edit, Source, Statement, TextPlace, comprehension_targets
from twin.validation.explain.inverse_operations import operand_values
from twin.validation.explain.rebuilt_functions import Matrix, unguarded
from twin.validation.explain.row_deviations import Judge, Residuals, entries_of, trial_residuals
from twin.validation.explain.swivel import fitted_swivel
from twin.validation.explain.term_texts import Atom, Products, are_equal, at_poses, factors, roots, sums, terms
from twin.validation.explain.tokens import is_operation, is_sum, parents_of
from twin.validation.explain.vector_texts import VECTOR_ENTRIES, vector_atoms, vector_texts

_SHIFT_NAME = "_required_"
"""Name of the function, in the edited text, that changes the value of an expression."""

_MOST_ATOMS = 200
"""Maximum number of values that may be terms."""

_LONGEST_VECTOR = 4
"""Maximum number of entries of a vector of which each is such a value."""

_COFUNCTIONS = {"sin": "cos", "cos": "sin"}
"""The function that often stands with another one, of the same argument."""

_LONGEST_TEXT = 100
"""Maximum length of the text of a value."""

_MOST_CALLS = 6
"""Maximum number of calls of an expression in which it may have different values."""

_MOST_ROOT_FORMULAS = 6
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
        refuted: Sequence[TextPlace] = (),
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
            if self._is_left_out(source, node):
                continue
            for entries in (0, VECTOR_ENTRIES):
                if self.deadline.passed:
                    return
                solved = self._solved(source, statement, node, entries)
                if solved is None and not entries:
                    solved = passed_on.get(node)
                if solved is None:
                    continue
                if not entries:
                    passed_on |= _operand_shifts(node, solved)
                calls = len(solved.scopes)
                if calls not in atoms:
                    atoms[calls] = scalar_atoms(source, statement, solved, self.fixed)
                writer = _vector_edits if entries else edits_to_required
                texts = writer(source, statement, node, parents, solved, atoms[calls])
                yield from islice(texts, _MOST_EDITS)
                if not entries and is_square(node):
                    products = Products(at_poses(atoms[calls], solved.valued_poses))
                    yield from edits_in_square(source, statement, node, parents, solved, atoms[calls], products)

    def _is_left_out(self, source: Source, node: ast.expr) -> bool:
        """Return whether an expression touches a fixed edit, or is in a scalar without a right value."""
        start, end = source.span(node)
        is_left_out = False
        for edit in self.fixed:
            is_left_out |= start <= edit.end and edit.start <= end
        for path, first, last in self.refuted:
            is_left_out |= path == source.path and first <= start and end <= last
        return is_left_out

    def _solved(self, source: Source, statement: Statement, node: ast.expr, entries: int) -> Shift | None:
        """Return the shift of an expression with which all rows agree, or the first row that can; None without one.

        `entries` is the number of entries of a vector, 0 for a scalar.
        """
        edit = shifted(source, statement, node, _SHIFT_NAME)
        at_zero = Shift(self.judge.reference.k, entries)
        base = self._residual(edit, at_zero, self._swivel)
        if base is None:
            return None
        at_zero.added = np.full_like(at_zero.added, DERIVATIVE_STEP)
        moved_residuals = self._residual(edit, at_zero, self._swivel)
        if moved_residuals is None:
            return None
        every_moved_row: list[RowKey] = []
        for row, residual in moved_residuals.items():
            if row in base and not np.array_equal(base[row], residual):
                every_moved_row.append(row)
        wrong_rows = [row for row in self.rows if row in every_moved_row]
        if not wrong_rows:
            return None
        choices: list[list[RowKey]] = [wrong_rows]
        if entries:  # rows that agree also determine entries of a vector
            choices = [every_moved_row, wrong_rows]
        else:
            shift_of_calls = self._shift_of_calls(edit, every_moved_row, at_zero)
            if shift_of_calls is not None:
                return shift_of_calls
            if len(wrong_rows) > 1:  # two faults: this expression can repair only one of the rows
                for row in wrong_rows:
                    choices.append([row])
        for rows in choices:
            shift = self._fitted(edit, rows, entries)
            if shift is not None:
                return shift
        return None

    def in_calls(self, source: Source, statement: Statement, node: ast.expr) -> Shift | None:
        """Return the shift of a scalar that is computed several times; None for other expressions.

        With it, the rows agree that the expression moves; see `ShiftOfCalls.flat`.
        """
        edit = shifted(source, statement, node, _SHIFT_NAME)
        shift = Shift(self.judge.reference.k)
        base = self._residual(edit, shift, self._swivel)
        shift.added = np.full_like(shift.added, DERIVATIVE_STEP)
        moved_residuals = self._residual(edit, shift, self._swivel)
        if base is None or moved_residuals is None:
            return None
        moved_rows: list[RowKey] = []
        for row, residual in moved_residuals.items():
            if row in base and not np.array_equal(base[row], residual, equal_nan=True):
                moved_rows.append(row)
        if not moved_rows:
            return None
        return self._shift_of_calls(edit, moved_rows, shift)

    def _shift_of_calls(self, edit: Edit, rows: Sequence[RowKey], probe: Shift) -> Shift | None:
        """Return the shifts of an expression in each of its calls with which the rows agree, as one.

        Return None without such shifts, or if `probe` was called once.
        """
        count = probe.call_count
        if not 1 < count <= _MOST_CALLS or self._swivel is not None:
            return None
        shift = ShiftOfCalls(self.judge.reference.k, count)

        def residual(values: Array) -> Array | None:
            shift.added = values
            by_row = self._residual(edit, shift, None)
            if by_row is None or shift.call_count != count or not by_row.keys() >= set(rows):
                return None
            return entries_of(by_row, rows)

        start = np.zeros_like(shift.added)
        solved = newton_solution(residual, start, lambda: shift.values.copy(), self.deadline)
        if solved is None:
            return None
        _, shift.valued_poses = solved
        return shift.flat()

    def _fitted(self, edit: Edit, rows: Sequence[RowKey], entries: int) -> Shift | None:
        """Return the shift with which the rows agree at every pose; None if Gauss-Newton does not find it."""
        shift = Shift(self.judge.reference.k, entries)
        unknowns = shift.added.shape[1]
        start = np.zeros_like(shift.added)
        swivel = self._swivel
        if swivel is not None:  # it is one more unknown
            start = np.column_stack([start, swivel])

        def residual(values: Array) -> Array | None:
            shift.added = values[:, :unknowns]
            angle = None if swivel is None else values[:, -1]
            by_row = self._residual(edit, shift, angle)
            if by_row is None or not by_row.keys() >= set(rows):
                return None
            return entries_of(by_row, rows)

        def scale() -> Array:
            if swivel is not None:
                return np.column_stack([shift.value, np.zeros(len(start))])
            return shift.value

        solved = newton_solution(residual, start, scale, self.deadline)
        if solved is None:
            return None
        _, shift.valued_poses = solved
        return shift

    def _residual(self, edit: Edit, shift: Shift, angle: Array | None) -> dict[RowKey, Array] | None:
        """Return the residuals of the rows with a shifted expression; `angle`: values (k,) of the swivel, if any."""
        shift.begin()
        with unguarded():
            return residuals_with(self.judge, self.step.equation.name, [*self.fixed, edit], {_SHIFT_NAME: shift}, angle)

    @cached_property
    def _swivel(self) -> Array | None:
        """The first values (k,) of the swivel angle: those that are best after the edits `fixed`; None without one."""
        if not self.step.swivel:
            return None
        (angle,) = self.step.swivel.values()
        if not self.fixed:
            return np.asarray(angle, float)

        def rows(angle: Array) -> Residuals:
            return trial_residuals(self.judge, self.step, self.fixed, None, angle) or {}

        with unguarded():
            return fitted_swivel(rows, self.judge.reference.k)


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
    """Return whether an expression is in the index of a subscript: it is no scalar of the row."""
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
    texts = dict.fromkeys(_names_and_entries(source, statement, shift.scope))  # in the order in which they are found
    for statement_of_function in source.statements:
        for node in ast.walk(statement_of_function.node):
            texts |= dict.fromkeys(_scalar_texts(node))
    atoms: list[Atom] = []
    with np.errstate(all="ignore"):
        for text in sorted(texts, key=len):
            values = scalar_values(compile(text, "<explain>", "eval"), shift)
            if values is not None:
                atoms.append(Atom(text, values))
    return [*atoms[:_MOST_ATOMS], *analogies(source, statement, shift, fixed)]


def _names_and_entries(source: Source, statement: Statement, scope: Mapping[str, Value]) -> Iterator[str]:
    """Yield the names that may have a value at a statement; of a short vector, its entries."""
    names = {*source.arguments, *comprehension_targets(statement.node)}
    for earlier in source.statements[: statement.index + 1]:
        names.update(earlier.reads, earlier.writes)
    for name in sorted(names):
        value = scope.get(name)
        size = 0  # number of entries of a vector
        if isinstance(value, np.ndarray) and value.dtype == object and value.ndim == 1:
            size = len(value)
        elif isinstance(value, Matrix) and value.shape[1] == 1:
            size = value.shape[0]
        if 0 < size <= _LONGEST_VECTOR:
            for i in range(size):
                yield f"{name}[{i}]"
        else:
            yield name


def _scalar_texts(node: ast.AST) -> Iterator[str]:
    """Yield the text of an expression; of a sine, also the cosine, and both of each name in its argument."""
    if isinstance(node, ast.Call | ast.BinOp | ast.Subscript):
        text = ast.unparse(node)
        if len(text) <= _LONGEST_TEXT:
            yield text
    if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Name) or node.func.id not in _COFUNCTIONS:
        return
    cofunction = _COFUNCTIONS[node.func.id]
    argument = node.args[0]
    yield f"{cofunction}({ast.unparse(argument)})"
    for angle in ast.walk(argument):
        if isinstance(angle, ast.Name):
            yield f"{node.func.id}({angle.id})"
            yield f"{cofunction}({angle.id})"


def _terms_of_other_sums(source: Source, expression: ast.expr, atoms: Sequence[Atom]) -> list[list[Atom]]:
    """Return, of each sum of the function, the terms that are among `atoms` and are no terms of `expression`."""
    own_terms = set(_summand_texts(expression))
    atoms_by_text: dict[str, Atom] = {}
    for atom in atoms:
        if atom.text not in own_terms:
            atoms_by_text[atom.text] = atom
    terms_of_sums: dict[tuple[str, ...], list[Atom]] = {}
    for statement in source.statements:
        for node in ast.walk(statement.node):
            if not is_sum(node):
                continue
            texts = sorted(atoms_by_text.keys() & set(_summand_texts(node)))
            if len(texts) > 1:  # single terms are tried anyway
                terms_of_sums[tuple(texts)] = [atoms_by_text[text] for text in texts]
    return list(terms_of_sums.values())


def _summand_texts(node: ast.expr) -> list[str]:
    """Return the texts of the terms of a sum without their signs."""
    return list(map(ast.unparse, _summands(node)))


def _summands(node: ast.expr) -> Iterator[ast.expr]:
    """Yield the terms of a sum without their signs."""
    if is_sum(node):
        yield from _summands(node.left)
        yield from _summands(node.right)
    else:
        yield node


def _replacement(
    source: Source, statement: Statement, node: ast.expr, parent: ast.AST | None, new: str, kind: str
) -> Edit:
    """Return the edit that replaces an expression, in parentheses where it is part of another expression."""
    if not isinstance(parent, ast.Assign | ast.Return | ast.Tuple | ast.List | ast.Call):
        new = f"({new})"
    return source.edit_of(statement, source.span(node), new, kind)


def edits_to_required(
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
    factor_text = text
    if isinstance(node, ast.BinOp | ast.UnaryOp):
        factor_text = f"({text})"
    parent = parents.get(node)

    def edit(new: str, kind: str) -> Edit:
        return _replacement(source, statement, node, parent, new, kind)

    x = shift.value[shift.valued_poses, 0]
    added = shift.added[shift.valued_poses, 0]
    required = x + added
    atoms = at_poses(atoms, shift.valued_poses)
    if are_equal(required, -x):
        yield edit(f"-{factor_text}", "sign")
    if are_equal(required, x**2):
        yield edit(f"{factor_text}**2", "exponent")
    root = "sqrt"
    if "np." in source.text(statement.start, statement.end):
        root = "np.sqrt"
    with np.errstate(all="ignore"):
        ratio = required / x
        is_root = are_equal(required, np.sqrt(x))
    if is_root:
        yield edit(f"{root}({text})", "missing")
    if not is_sum(parent):  # a term of the sum is found at the sum
        for sign, term in terms(added, atoms):
            yield edit(f"{text} {sign} {term}", "missing")
        for signed_terms in sums(added, _terms_of_other_sums(source, node, atoms)):
            yield edit(f"{text} {signed_terms}", "missing")
        for sign, sign_value in (("+", 1.0), ("-", -1.0)):
            for term in roots(sign_value * added, atoms, root):
                yield edit(f"{text} {sign} {term}", "missing")
    in_product_already = is_operation(parent, ast.Mult)
    if in_product_already or not np.isfinite(ratio).all():
        return
    for factor in factors(ratio, atoms):
        yield edit(f"{factor} * {factor_text}", "missing")
    if ratio.all():
        for divisor in factors(1 / ratio, atoms):
            yield edit(f"{factor_text} / ({divisor})", "missing")
    for factor in roots(ratio, atoms, root):
        yield edit(f"{factor} * {factor_text}", "missing")


def _present_values(part: ast.expr, shift: Shift) -> Array | None:
    """Return the present values (k,) of a part of an expression in the scopes of a shift; None if it is no scalar."""
    return scalar_values(compile(ast.unparse(part), "<explain>", "eval"), shift)


def _operand_shifts(node: ast.expr, shift: Shift) -> dict[ast.expr, Shift]:
    """Return the shifts of the operands of an expression that give it its required value; see `operand_values`."""
    required = shift.value[:, 0] + shift.added[:, 0]
    shifts: dict[ast.expr, Shift] = {}
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.expr):
            continue
        needed = operand_values(node, child, required, lambda part: _present_values(part, shift))
        if needed is None:
            continue
        values = _present_values(child, shift)
        if values is None or not np.isfinite((needed + values)[shift.valued_poses]).all():
            continue
        shifts[child] = _shift_of_part(shift, values, needed)
    return shifts


def _shift_of_part(shift: Shift, values: Array, required: Array) -> FlatShift:
    """Return the shift of a part of an expression from its values (k,) to others (k,), in the scopes of `shift`."""
    of_part = FlatShift(len(values), shift.scopes)
    of_part.valued_poses = shift.valued_poses
    of_part.value = values[:, None]
    of_part.added[shift.valued_poses, 0] = (required - values)[shift.valued_poses]
    return of_part


def is_square(node: ast.AST) -> TypeGuard[ast.BinOp]:
    """Return whether a syntax node is the square of an expression."""
    return is_operation(node, ast.Pow) and ast.unparse(node.right) == "2"


def edits_in_square(
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
        return _present_values(part, shift)

    valued = shift.valued_poses
    with np.errstate(all="ignore"):
        root = np.sqrt(shift.value[:, 0] + shift.added[:, 0])
    todo = [(node.left, root, -root)]
    while todo:
        part, first, second = todo.pop(0)
        present = value(part)
        if present is not None and np.isfinite(present[valued]).all():
            x = present[valued]
            with np.errstate(all="ignore"):
                added = products.either(first[valued] - x, second[valued] - x)
                ratios = products.either(first[valued] / x, second[valued] / x)
            with_term = x + added[:_MOST_ROOT_FORMULAS]
            with_factor = x * ratios[:_MOST_ROOT_FORMULAS]
            for required in (*with_term, *with_factor):
                of_part = FlatShift(len(present), shift.scopes)
                of_part.valued_poses = valued
                of_part.value = present[:, None]
                of_part.added[valued, 0] = required - x
                yield from islice(edits_to_required(source, statement, part, parents, of_part, atoms), _MOST_EDITS)
        for child in ast.iter_child_nodes(part):
            if not isinstance(child, ast.expr):
                continue
            above = operand_values(part, child, first, value)
            below = operand_values(part, child, second, value)
            if above is not None and below is not None:
                todo.append((child, above, below))


def _vector_edits(
    source: Source,
    statement: Statement,
    node: ast.expr,
    parents: dict[ast.AST, ast.AST],
    shift: Shift,
    atoms: Sequence[Atom],
) -> Iterator[Edit]:
    """Yield the edits that give an expression its required value, a vector."""
    start, end = source.span(node)
    text = source.text(start, end)
    valued = shift.valued_poses
    scalars = at_poses(atoms, valued)
    vectors = at_poses(vector_atoms(source, shift.scope, len(valued)), valued)
    for new in vector_texts(text, node, shift.value[valued], shift.added[valued], scalars, vectors):
        yield _replacement(source, statement, node, parents.get(node), new, "missing")
