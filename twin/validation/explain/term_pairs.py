"""Find one edit together with a missing term or factor, in one scalar expression that must have known values.

For each single edit of the expression, the values that another part must then have are computed. Many such values are
compared with all terms and factors at once; only for those that fit, the text is written.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from twin.core.spatial import Array
from twin.validation.explain.expression import Expression
from twin.validation.explain.expression_shifts import FlatShift
from twin.validation.explain.function_source import Edit
from twin.validation.explain.inverse_operations import operand_values
from twin.validation.explain.required_values import edits_in_square, edits_to_required, is_square, scalar_atoms
from twin.validation.explain.term_texts import Atom, Products, as_factor, at_poses, factors, terms
from twin.validation.explain.tokens import is_operation, is_sum

_MOST_FORMULAS = 12
"""Maximum number of edits that give one part its required values by a short formula."""


def with_term(expression: Expression, required: Array) -> Iterator[tuple[Edit, Edit]]:
    """Yield pairs of a single edit and a term or factor, after which the expression has the values `required` (k,)."""
    site = expression.site
    scope = FlatShift(expression.k, expression.scopes)
    scope.valued_poses = expression.valued_poses
    atoms = scalar_atoms(site.source, site.statement, scope)
    valued_atoms = at_poses(atoms, expression.valued_poses)
    products = Products(valued_atoms)
    yield from _in_the_same_part(expression, required, valued_atoms, products)
    yield from _in_another_part(expression, required, atoms, products)


def _in_the_same_part(
    expression: Expression, required: Array, atoms: Sequence[Atom], products: Products
) -> Iterator[tuple[Edit, Edit]]:
    """Yield pairs of an edit of a part, and a term or factor of this part."""
    valued = expression.valued_poses
    singles, _ = expression.singles
    for part in expression.parts:
        if expression.deadline.passed:
            return
        span = expression.span_of(part)
        inside = expression.singles_within(part)
        if not len(inside):
            continue
        needed = expression.values_required_of(part, (), required)
        if needed is None:
            continue
        edits = [singles[i] for i in inside]
        after_edits = expression.values_after(part)[:, valued]
        if _takes_term(expression, part):
            missing_terms = needed[valued] - after_edits
            for edit, values in _likely_edits(edits, missing_terms, products):
                for addition in _terms_to_add(values, atoms):
                    yield from _edit_with_addition(expression, span, edit, addition)
        if _takes_factor(expression, part):
            with np.errstate(all="ignore"):
                missing_factors = needed[valued] / after_edits
            for edit, values in _likely_edits(edits, missing_factors, products):
                for addition in _factors_to_add(values, atoms):
                    yield from _edit_with_addition(expression, span, edit, addition)


@dataclass(frozen=True)
class _Addition:
    """A term or a factor as text, at the start and at the end of the part that it is added to."""

    at_start: str
    at_end: str
    prefers_end: bool


def _terms_to_add(values: Array, atoms: Sequence[Atom]) -> Iterator[_Addition]:
    """Yield terms with given values (k,)."""
    for sign, text in terms(values, atoms):
        leading_sign = sign.strip("+")
        yield _Addition(f"{leading_sign}{text} + ", f" {sign} {text}", prefers_end=True)


def _factors_to_add(values: Array, atoms: Sequence[Atom]) -> Iterator[_Addition]:
    """Yield factors with given values (k,)."""
    for text in factors(values, atoms):
        factor = as_factor(text)
        yield _Addition(f"{factor} * ", f" * {factor}", prefers_end=False)


def _likely_edits(edits: Sequence[Edit], missing: Array, products: Products) -> Iterator[tuple[Edit, Array]]:
    """Yield those of n edits whose missing values (n, k) may be those of a product, with these values (k,)."""
    for n in products.likely(missing):
        yield edits[n], missing[n]


def _edit_with_addition(
    expression: Expression, span: tuple[int, int], edit: Edit, addition: _Addition
) -> Iterator[tuple[Edit, Edit]]:
    """Yield an edit of a part together with an addition to this part, where the two do not touch.

    `span` is (first byte, end byte) of the part. The addition goes to the end that it prefers; if the edit is there, to
    the other one; to none if the edit is at both.
    """
    start, end = span
    fits_at_start = start < edit.start
    fits_at_end = edit.end < end
    if fits_at_end and (addition.prefers_end or not fits_at_start):
        yield edit, expression.site.insertion(end, addition.at_end)
    elif fits_at_start:
        yield edit, expression.site.insertion(start, addition.at_start)


def _in_another_part(
    expression: Expression, required: Array, atoms: Sequence[Atom], products: Products
) -> Iterator[tuple[Edit, Edit]]:
    """Yield pairs of an edit, and a term or factor of a part that the edit does not touch."""
    edits_with_needs: dict[ast.expr, list[tuple[Edit, Array]]] = {}
    singles, _ = expression.singles
    # By part, because the required values of one part after many edits are compared with all products at once.
    for edit in singles:
        for part in expression.beside(edit):
            if expression.deadline.passed:
                return
            needed = expression.values_required_of(part, (edit,), required)
            if needed is not None:
                edits_with_needs.setdefault(part, []).append((edit, needed))
    for part, with_needs in edits_with_needs.items():
        values_of_part = expression.present_value(part)
        if values_of_part is None or expression.deadline.passed:
            continue
        edits, needs_of_edits = zip(*with_needs, strict=True)
        needs = np.array(needs_of_edits)
        for inner, values, needs_of_inner in _inner_parts(expression, part, values_of_part, needs):
            if expression.deadline.passed:
                return
            yield from _completed(expression, inner, values, edits, needs_of_inner, atoms, products)


def _completed(
    expression: Expression,
    part: ast.expr,
    values: Array,
    edits: Sequence[Edit],
    needs: Array,
    atoms: Sequence[Atom],
    products: Products,
) -> Iterator[tuple[Edit, Edit]]:
    """Yield pairs of one of `edits`, and an edit that gives a part with `values` (k,) those of `needs` (edits, k)."""
    valued = expression.valued_poses
    with np.errstate(all="ignore"):
        by_term = products.likely(needs[:, valued] - values[valued])
        by_factor = products.likely(needs[:, valued] / values[valued])
    likely = {*by_term.tolist(), *by_factor.tolist()}
    candidates = sorted(likely)
    if is_square(part):  # what is missing in the square may be no single term or factor outside
        candidates = list(range(len(needs)))
    for n in candidates:
        if expression.deadline.passed:
            return
        shift = _shift(expression, values, needs[n])
        for second in _edits_of_part(expression, part, shift, atoms, products, n in likely):
            yield edits[n], second


def _shift(expression: Expression, values: Array, required: Array) -> FlatShift:
    """Return the shift of a part from its values (k,) to those (k,) that it must have."""
    shift = FlatShift(expression.k, expression.scopes)
    shift.valued_poses = expression.valued_poses
    shift.value = values[:, None]
    shift.added = (required - values)[:, None]
    return shift


def _edits_of_part(
    expression: Expression, part: ast.expr, shift: FlatShift, atoms: Sequence[Atom], products: Products, likely: bool
) -> Iterator[Edit]:
    """Yield edits after which a part has its required values.

    A term or factor of the part is written only if it is `likely`; one inside a square is tried for every square.
    """
    site = expression.site
    if likely:
        yield from islice(
            edits_to_required(site.source, site.statement, part, site.parents, shift, atoms), _MOST_FORMULAS
        )
    if is_square(part):
        yield from edits_in_square(site.source, site.statement, part, site.parents, shift, atoms, products)


def _inner_parts(
    expression: Expression, part: ast.expr, present_values: Array, needs: Array
) -> Iterator[tuple[ast.expr, Array, Array]]:
    """Yield (a part of `part`, its values (k,), the values (n, k) that it must have), `part` itself first.

    Values required of a part are passed on to its parts; see `operand_values`.
    """
    queue = [(part, present_values, needs)]
    while queue:
        node, values, required = queue.pop(0)
        yield node, values, required
        for child in ast.iter_child_nodes(node):
            if not isinstance(child, ast.expr):
                continue
            inner_wanted = operand_values(node, child, required, expression.present_value)
            if inner_wanted is None:
                continue
            inner_values = expression.present_value(child)
            if inner_values is not None:
                queue.append((child, inner_values, inner_wanted))


def _takes_term(expression: Expression, part: ast.expr) -> bool:
    """Return whether a term can be put after a part; the terms of a sum are put after the sum."""
    parent = expression.site.parents.get(part)
    if is_sum(part):
        return not is_sum(parent)
    return not isinstance(parent, ast.BinOp | ast.UnaryOp)


def _takes_factor(expression: Expression, part: ast.expr) -> bool:
    """Return whether a factor can be put before a part."""
    parent = expression.site.parents.get(part)
    if isinstance(part, ast.UnaryOp) or is_sum(part):
        return False
    return not is_operation(parent, ast.Mult, ast.Div, ast.Pow)
