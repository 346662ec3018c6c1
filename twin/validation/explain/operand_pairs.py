"""Try all pairs of edits in two operands of one operation, at one pose, by few evaluations.

Two edits of one statement that do not touch each other are in two operands of some operation, call or tuple in it.
Each operand is evaluated alone after each of its edits, and the rest of the statement once for all pairs of values.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Protocol

import numpy as np

from twin.core.spatial import Array
from twin.formula.scalar import Value
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.expression import Site, expression_code
from twin.validation.explain.function_source import RETURN_NAME, Edit, Source, Statement, text_after_edits
from twin.validation.explain.plain_values import with_copied_values
from twin.validation.explain.rebuilt_functions import Matrix

_MOST_PAIRS = 100_000
"""Maximum number of pairs in one evaluation."""

_OPERAND_NAMES = ("_first_operand_", "_second_operand_")
"""Names that stand for the operands."""

Scope = dict[str, Value]

_OperandValues = tuple[list[tuple[Edit, ...]], list[Value]]
"""Edits of an operand after which its values have the same form, and these values."""

EvaluatedPairs = tuple[list[tuple[Edit, ...]], list[tuple[Edit, ...]], dict[RowKey, Array]]
"""Edits of a second place, edits of a first one, and the residuals (pairs, entries) of rows.

All edits of the first place come with the first edit of the second one, then with the next one.
"""


class ResidualsAfter(Protocol):
    """Returns the residuals of the rows of a statement and of those after it; None without a value."""

    def __call__(self, statement: Statement, scope: Scope, size: int, /) -> dict[RowKey, Array] | None:
        """Evaluate `size` values in a scope that has what the statement writes."""
        ...


def operand_pairs(
    site: Site, edits: Sequence[Edit], scope: Scope, residuals_after: ResidualsAfter, end: Deadline
) -> Iterator[EvaluatedPairs]:
    """Yield the residuals after pairs of edits of a statement; `scope` has the values before it, at one pose."""
    source = site.source
    edits_within: dict[ast.AST, list[Edit]] = {}
    for node in [site.statement.node, *site.parents]:
        if isinstance(node, ast.expr):
            span = source.span(node)
            edits_within[node] = [edit for edit in edits if edit.is_within(span)]
    groups_of_operand: dict[ast.AST, list[_OperandValues]] = {}

    def groups(operand: ast.AST) -> list[_OperandValues]:
        if operand not in groups_of_operand:  # an operand is in several pairs
            groups_of_operand[operand] = list(_operand_values(source, operand, edits_within[operand], scope, end))
        return groups_of_operand[operand]

    for node in [site.statement.node, *site.parents]:
        operands = [child for child in ast.iter_child_nodes(node) if edits_within.get(child)]
        for first, second in combinations(operands, 2):
            for firsts in groups(first):
                for seconds in groups(second):
                    yield from _residuals_of_groups(site, (first, second), firsts, seconds, scope, residuals_after, end)
            if end.passed:
                return
        if not isinstance(node, ast.expr | ast.stmt):  # the clause `for` of a comprehension: it has no sign of its own
            continue
        for operand in operands:
            for edit in _edits_beside_operand(source, node, operand, operands, edits):
                for firsts in groups(operand):
                    yield from _residuals_of_groups(
                        site, (operand,), firsts, ([(edit,)], [None]), scope, residuals_after, end
                    )
                if end.passed:
                    return


def _edits_beside_operand(
    source: Source, node: ast.AST, operand: ast.AST, operands: Sequence[ast.AST], edits: Sequence[Edit]
) -> Iterator[Edit]:
    """Yield the edits of an operation itself, such as that of a sign, that do not touch one of its operands."""
    start, end = source.span(node)
    operand_start, operand_end = source.span(operand)
    spans = [source.span(operand_of_node) for operand_of_node in operands]
    for edit in edits:
        if not edit.is_within((start, end)):
            continue
        touches_operand = operand_start <= edit.end and edit.start <= operand_end
        # Pairs with an edit inside another operand are tried as pairs of operands.
        is_in_operand = any(edit.is_within(span) for span in spans)
        if not touches_operand and not is_in_operand:
            yield edit


def _operand_values(
    source: Source, operand: ast.AST, edits: Sequence[Edit], scope: Scope, end: Deadline
) -> Iterator[_OperandValues]:
    """Yield the edits of an operand with its values, those of the same form together."""
    by_form: dict[Value, _OperandValues] = {}
    first, last = source.span(operand)
    for edit in edits:
        if end.passed:
            return
        code = expression_code(text_after_edits(source.data, [edit], first, last))
        if code is None:
            continue
        try:
            value = eval(code, dict(scope))
        except Exception:  # an edit may be any invalid text
            continue
        form_of_value = value_form(value, 1)
        if form_of_value is not None:
            edits_of_form, values = by_form.setdefault(form_of_value, ([], []))
            edits_of_form.append((edit,))
            values.append(value)
    yield from by_form.values()


def _residuals_of_groups(
    site: Site,
    operands: tuple[ast.AST, ...],
    firsts: _OperandValues,
    seconds: _OperandValues,
    scope: Scope,
    residuals_after: ResidualsAfter,
    end: Deadline,
) -> Iterator[EvaluatedPairs]:
    """Yield the residuals after pairs of edits of two operands, or of one operand and of the operation itself."""
    source = site.source
    changed = []
    for operand, name in zip(operands, _OPERAND_NAMES, strict=False):
        changed.append(source.edit_of(site.statement, source.span(operand), name, "required"))
    if len(operands) == 1:
        changed += seconds[0][0]
    try:
        code = source.compiled(site.statement, changed)
    except (SyntaxError, ValueError):
        return
    edits_of_first, values_of_first = firsts
    edits_of_second, values_of_second = seconds
    count = len(edits_of_first)
    most = max(_MOST_PAIRS // count, 1)
    for begin in range(0, len(edits_of_second), most):
        if end.passed:
            return
        part = edits_of_second[begin : begin + most]
        size = count * len(part)
        own_scope = with_copied_values(scope)
        own_scope[_OPERAND_NAMES[0]] = tiled(stacked(values_of_first, 1), count, len(part))
        if len(operands) == 2:
            own_scope[_OPERAND_NAMES[1]] = stacked(values_of_second[begin : begin + most], count)
        names = (RETURN_NAME,) if site.statement.returns else site.statement.writes
        try:
            exec(code, own_scope)
            forms = [value_form(own_scope[name], size) for name in names]
        except Exception:  # operands of forms that do not fit
            return
        if None in forms:
            continue
        deviations = residuals_after(site.statement, own_scope, size)
        if deviations is not None:
            yield part, edits_of_first, deviations


def value_form(value: Value, size: int) -> Value:
    """Return what values must have in common to be one array; None for values that cannot be part of one."""
    if isinstance(value, Matrix):
        return value.shape if len(value.a) in (1, size) else None
    if isinstance(value, list | tuple):
        forms: list[Value] = []
        for entry in value:
            forms.append(value_form(entry, size))
        if None in forms:
            return None
        return type(value), tuple(forms)
    is_number = isinstance(value, bool | int | float | np.ndarray | np.number)
    # an array of objects may hold matrices, which have forms of their own
    if is_number and np.shape(value) in ((), (1,), (size,)) and np.asarray(value).dtype != object:
        return "scalar"
    return None


def stacked(values: Sequence[Value], size: int) -> Value:
    """Return values of the same form, each of which has 1 or `size` values, as one array."""
    first = values[0]
    if isinstance(first, list | tuple):
        entries: list[Value] = []
        for entries_of_values in zip(*values, strict=True):
            entries.append(stacked(entries_of_values, size))
        return type(first)(entries)
    arrays: list[Array] = []
    if isinstance(first, Matrix):
        for value in values:
            arrays.append(np.broadcast_to(value.a, (size, *first.shape)))
        return Matrix(np.concatenate(arrays))
    for value in values:
        arrays.append(np.broadcast_to(np.asarray(value, float), (size,)))
    return np.concatenate(arrays)


def tiled(value: Value, size: int, count: int) -> Value:
    """Return `size` values, repeated for each of `count` edits; a single value holds for all of them."""
    if size == 1:
        return value
    if isinstance(value, Matrix) and len(value.a) == size:
        return Matrix(np.tile(value.a, (count, 1, 1)))
    if isinstance(value, list | tuple):
        entries: list[Value] = []
        for entry in value:
            entries.append(tiled(entry, size, count))
        return type(value)(entries)
    if isinstance(value, np.ndarray) and value.shape == (size,):
        return np.tile(value, count)
    return value
