"""Find one edit together with a missing term or factor, in one scalar expression that must have known values.

For each single edit of the expression, the values that another part must then have are computed. Many such values are
compared with all terms and factors at once; only for those that fit, the text is written.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np

from twin.core.spatial import Array
from twin.validation.explain.expression import Expression
from twin.validation.explain.inverses import inverse
from twin.validation.explain.required import in_square, is_square, scalar_atoms, written
from twin.validation.explain.shifts import Flat
from twin.validation.explain.source import Edit
from twin.validation.explain.term_texts import Atom, Products, factors, in_product, terms

_MOST_TEXTS = 12
"""Maximum number of texts for the required values of one part."""


def with_term(expression: Expression, wanted: Array) -> Iterator[tuple[Edit, Edit]]:
    """Yield pairs of a single edit and a term or factor, after which the expression has the values `wanted` (k,)."""
    shift = Flat(expression.k, expression.scopes)
    shift.known = expression.known
    site = expression.site
    atoms = scalar_atoms(site.source, site.statement, shift)
    atoms_where_known = [Atom(atom.text, atom.values[expression.known]) for atom in atoms]
    products = Products(atoms_where_known)
    yield from _around(expression, wanted, atoms_where_known, products)
    yield from _beside(expression, wanted, atoms, products)


def _around(
    expression: Expression, wanted: Array, atoms: Sequence[Atom], products: Products
) -> Iterator[tuple[Edit, Edit]]:
    """Yield pairs of an edit of a part, and a term or factor of this part."""
    singles = expression.singles[0]
    has_value = expression.known
    for part in expression.parts:
        if expression.deadline.passed:
            return
        start, end = expression.span_of(part)
        inside: list[int] = []
        for i, edit in enumerate(singles):
            if start <= edit.start and edit.end <= end:
                inside.append(i)
        if not inside:
            continue
        needed = expression.needed(part, (), wanted)
        if needed is None:
            continue
        values = expression.edited(part, singles, np.array(inside, np.intp))[:, has_value]
        if _takes_term(expression, part):
            added = needed[has_value] - values
            for n in products.likely(added):
                first = singles[inside[n]]
                for sign, text in terms(added[n], atoms):
                    if first.end < end:
                        yield first, _inserted(expression, end, f" {sign} {text}")
                    elif start < first.start:  # an insertion at the end would touch the edit
                        yield first, _inserted(expression, start, f"{sign.strip('+')}{text} + ")
        if _takes_factor(expression, part):
            with np.errstate(all="ignore"):
                ratio = needed[has_value] / values
            for n in products.likely(ratio):
                first = singles[inside[n]]
                for text in factors(ratio[n], atoms):
                    if start < first.start:  # a factor stands in front, as long as this does not touch the edit
                        yield first, _inserted(expression, start, f"{in_product(text)} * ")
                    elif first.end < end:
                        yield first, _inserted(expression, end, f" * {in_product(text)}")


def _beside(
    expression: Expression, wanted: Array, atoms: Sequence[Atom], products: Products
) -> Iterator[tuple[Edit, Edit]]:
    """Yield pairs of an edit, and a term or factor of a part that the edit does not touch."""
    has_value = expression.known
    needs: dict[ast.expr, list[tuple[Edit, Array]]] = {}
    for first in expression.singles[0]:
        for part in expression.beside(first):
            if expression.deadline.passed:
                return
            needed = expression.needed(part, (first,), wanted)
            if needed is not None:
                needs.setdefault(part, []).append((first, needed))
    for part, found in needs.items():
        own = expression.own(part)
        if own is None or expression.deadline.passed:
            continue
        for inner, values, rows in _inside(expression, part, own, found):
            with np.errstate(all="ignore"):
                added = products.likely(rows[:, has_value] - values[has_value])
                factors_of = products.likely(rows[:, has_value] / values[has_value])
            likely = {*added, *factors_of}
            candidates = sorted(int(n) for n in likely)
            if is_square(inner):  # what is missing in the square may be no single term or factor outside
                candidates = list(range(len(rows)))
            for n in candidates:
                if expression.deadline.passed:
                    return
                shift = _shift(expression, values, rows[n])
                for second in _texts(expression, inner, shift, atoms, products, n in likely):
                    yield found[n][0], second


def _shift(expression: Expression, values: Array, wanted: Array) -> Flat:
    """Return the shift of a part from its values (k,) to those (k,) that it must have."""
    shift = Flat(expression.k, expression.scopes)
    shift.known = expression.known
    shift.value = values[:, None]
    shift.shift = (wanted - values)[:, None]
    return shift


def _texts(
    expression: Expression, part: ast.expr, shift: Flat, atoms: Sequence[Atom], products: Products, likely: bool
) -> Iterator[Edit]:
    """Yield edits after which a part has its required values.

    A term or factor of the part is written only if it is `likely`; one inside a square is tried for every square.
    """
    site = expression.site
    if likely:
        yield from islice(written(site.source, site.statement, part, site.parents, shift, atoms), _MOST_TEXTS)
    if is_square(part):
        yield from in_square(site.source, site.statement, part, site.parents, shift, atoms, products)


def _inside(
    expression: Expression, part: ast.expr, own: Array, found: Sequence[tuple[Edit, Array]]
) -> Iterator[tuple[ast.expr, Array, Array]]:
    """Yield (a part of `part`, its values (k,), the values (n, k) that it must have), `part` itself first.

    Values required of a part are passed on to its parts; see `inverse`.
    """
    rows = np.array([needed for _, needed in found])
    todo = [(part, own, rows)]
    while todo:
        node, values, wanted = todo.pop(0)
        yield node, values, wanted
        for child in ast.iter_child_nodes(node):
            if not isinstance(child, ast.expr):
                continue
            inner = inverse(node, child, wanted, expression.own)
            value = expression.own(child) if inner is not None else None
            if inner is not None and value is not None:
                todo.append((child, value, inner))


def _takes_term(expression: Expression, part: ast.expr) -> bool:
    """Return whether a term can be put after a part; the terms of a sum are put after the sum."""
    parent = expression.site.parents.get(part)
    if isinstance(part, ast.BinOp) and isinstance(part.op, ast.Add | ast.Sub):
        return not (isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Add | ast.Sub))
    return not isinstance(parent, ast.BinOp | ast.UnaryOp)


def _takes_factor(expression: Expression, part: ast.expr) -> bool:
    """Return whether a factor can be put before a part."""
    parent = expression.site.parents.get(part)
    if isinstance(part, ast.UnaryOp) or (isinstance(part, ast.BinOp) and isinstance(part.op, ast.Add | ast.Sub)):
        return False
    return not (isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Mult | ast.Div | ast.Pow))


def _inserted(expression: Expression, at: int, new: str) -> Edit:
    site = expression.site
    line = site.source.line_of(at)
    return Edit(site.source.path, line, at, at, "", new, "missing", site.statement.index, site.source.name)
