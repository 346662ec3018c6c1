"""Edits of one scalar expression that give it required values, evaluated without the rest of its equation."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import islice
from types import CodeType

import numpy as np
from numpy.typing import NDArray

from twin.core.spatial import Array
from twin.formula.scalar import Value
from twin.validation.explain.candidate import MULTI_TOKEN_KINDS, TOKEN_KINDS
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.expression_shifts import DERIVATIVE_STEP, FlatShift, Shift
from twin.validation.explain.function_source import ByteRange, Edit, Source, Statement, text_after_edits
from twin.validation.explain.inverse_operations import operand_values
from twin.validation.explain.name_pool import NamePool
from twin.validation.explain.plain_values import scalar_form, unwrapped
from twin.validation.explain.required_values import edits_to_required, expressions, scalar_atoms
from twin.validation.explain.statement_edits import statement_edits
from twin.validation.explain.term_texts import RELATIVE_ROUNDING, Atom
from twin.validation.explain.tokens import parents_of

_HOLE = "_hole_"
"""Name that stands for a part of an expression whose value is sought."""

_MOST_NEWTON_STEPS = 10
"""Maximum number of Newton steps for the value of a part."""

_CONVERGED_DIFFERENCE = 1e-10
"""Relative difference at which Newton's method ends."""

_SMALLEST_COMPARED_SIZE = 1e-9
"""Size in m or rad below which values are compared as if they had this size: they are rounding of zero."""

_MOST_FORMULAS = 12
"""Maximum number of short formulas for the required value of one part."""


@dataclass(frozen=True)
class Site:
    """A statement of an equation or of a function that it calls, and the names that its edits may insert."""

    source: Source
    statement: Statement
    pool: NamePool

    def insertion(self, at: int, new: str) -> Edit:
        """Return the edit that inserts a missing text before a byte of the file."""
        return self.source.edit_of(self.statement, (at, at), new, "missing")

    @cached_property
    def edits(self) -> tuple[Edit, ...]:
        """All single edits of the statement that require no new name."""
        edits: list[Edit] = []
        for edit in statement_edits(self.source, self.statement, self.pool, (*TOKEN_KINDS, *MULTI_TOKEN_KINDS)):
            if edit.define is None and edit.kind != "left side":
                edits.append(edit)
        return tuple(edits)

    @cached_property
    def parents(self) -> dict[ast.AST, ast.AST]:
        """Parent of each syntax node of the statement."""
        return parents_of(self.statement.node)

    @cached_property
    def undefined(self) -> list[ByteRange]:
        """Where names without a value stand: the equation can run only if edits replace all of them."""
        ranges: list[ByteRange] = []
        for node in ast.walk(self.statement.node):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id in self.pool.unknown:
                ranges.append(self.source.span(node))
        return sorted(ranges)


class Expression:
    """A scalar expression of a statement, with the values of the names in its scope."""

    def __init__(self, site: Site, node: ast.expr, shift: Shift, deadline: Deadline) -> None:
        """Store the expression `node`; `shift` has the scope, the value, and the poses at which rows have values."""
        self.site = site
        self.node = node
        self.valued_poses: NDArray[np.bool_] = shift.valued_poses
        self.deadline = deadline
        self.scopes = [dict(scope) for scope in shift.scopes]
        self.k = len(shift.added)
        self._span = site.source.span(node)
        self._size = _largest_value(shift.value[:, 0])
        self._sizes: dict[ast.expr, float] = {}
        self._tables: dict[ast.expr, Array] = {}  # of `values_after`

    def single_edits(self, required: Array) -> Iterator[Edit]:
        """Yield single edits after which the expression has the values `required` (k,)."""
        singles, values = self.singles
        for i in self._equal(values, required, self._size):
            yield singles[i]

    def composed_edits(self, required: Array) -> Iterator[Edit]:
        """Yield edits that add a term or a factor, a root, a square or a sign to a part of the expression."""
        atoms: list[Atom] | None = None
        for part in self.parts:
            if self.deadline.passed:
                return
            needed = self.values_required_of(part, (), required)
            values = self.present_value(part)
            if needed is None or values is None:
                continue
            shift = FlatShift(self.k, self.scopes)
            shift.value = values[:, None]
            shift.added = (needed - values)[:, None]
            shift.valued_poses = self.valued_poses
            if atoms is None:
                atoms = scalar_atoms(self.site.source, self.site.statement, shift)
            texts = edits_to_required(self.site.source, self.site.statement, part, self.site.parents, shift, atoms)
            yield from islice(texts, _MOST_FORMULAS)

    def edit_pairs(self, required: Array) -> Iterator[tuple[Edit, Edit]]:
        """Yield pairs of edits after which the expression has the values `required` (k,).

        For each edit and each largest part beside it, the value that this part must then have is computed; the edits of
        the part that give this value are looked up.
        """
        singles, _ = self.singles
        indices_of_part: dict[ast.expr, NDArray[np.intp]] = {}
        for part in self.parts:
            indices_of_part[part] = self.singles_within(part)
        yielded: set[tuple[int, int]] = set()
        for i, first in enumerate(singles):
            for part in self.beside(first):
                if self.deadline.passed:
                    return
                inside = indices_of_part[part]
                if not len(inside):
                    continue
                needed = self.values_required_of(part, (first,), required)
                if needed is None:
                    continue
                values = self.values_after(part)
                fitting = inside[self._equal(values, needed, self._size_of(part))]
                for j in fitting.tolist():
                    pair = (min(i, j), max(i, j))
                    if pair not in yielded:
                        yielded.add(pair)
                        yield first, singles[j]

    def singles_within(self, part: ast.expr) -> NDArray[np.intp]:
        """Return the indices in `singles` of the edits inside a part."""
        span = self.span_of(part)
        edits, _ = self.singles
        indices: list[int] = []
        for i, edit in enumerate(edits):
            if edit.is_within(span):
                indices.append(i)
        return np.array(indices, dtype=np.intp)

    # -- parts ----------------------------------------------------------------------------------------------------

    @cached_property
    def parts(self) -> list[ast.expr]:
        """The scalar parts of the expression, itself first."""
        scalars: list[ast.expr] = []
        for node in expressions(self.node, self.site.parents):
            if self.deadline.passed:
                break
            if self.present_value(node) is not None:
                scalars.append(node)
        return scalars

    def span_of(self, node: ast.expr) -> tuple[int, int]:
        """Return (first byte, end byte) of a part."""
        return self.site.source.span(node)

    def beside(self, edit: Edit) -> Iterator[ast.expr]:
        """Yield the largest scalar parts whose text the edit does not touch."""
        parts = set(self.parts)
        todo: list[ast.AST] = [self.node]
        while todo:
            node = todo.pop()
            if isinstance(node, ast.expr) and node in parts:
                start, end = self.span_of(node)
                if edit.end < start or end < edit.start:
                    yield node
                    continue
            todo += ast.iter_child_nodes(node)

    def values_required_of(self, part: ast.expr, change: Sequence[Edit], required: Array) -> Array | None:
        """Return the values (k,) of a part with which the expression after `change` has the values `required`.

        Operations with an inverse are inverted; for others, Newton's method is used. None if it finds no values.
        """
        inverted = self._inverted(part, change, required)
        if inverted is not None:
            return inverted
        span = self.span_of(part)
        source = self.site.source
        hole = source.edit_of(self.site.statement, span, _HOLE, "required")
        code = expression_code(text_after_edits(source.data, [*change, hole], *self._span))
        values = self.present_value(part)
        if code is None or values is None:
            return None
        valued = self.valued_poses
        limit = _CONVERGED_DIFFERENCE * max(float(np.abs(required[valued]).max()), RELATIVE_ROUNDING)
        values = values.copy()
        previous_size = np.inf
        for _ in range(_MOST_NEWTON_STEPS):
            result = self._run(code, values)
            if result is None:
                return None
            error = result - required
            size = float(np.abs(error[valued]).max())
            if size <= limit:
                return values
            # Near the limit, rounding may make an error larger. The comparison is also false for NaN.
            if not size < max(previous_size, 10 * limit):
                return None
            previous_size = size
            result_ahead = self._run(code, values + DERIVATIVE_STEP)
            if result_ahead is None:
                return None
            step = error / ((result_ahead - result) / DERIVATIVE_STEP)
            values = values - np.where(np.isfinite(step), step, 0.0)
        return None

    def _inverted(self, part: ast.expr, change: Sequence[Edit], required: Array) -> Array | None:
        """Return what `values_required_of` does, by inverse operations; None if there is one without an inverse."""
        nodes: list[ast.AST] = [part]
        while nodes[-1] is not self.node:
            nodes.append(self.site.parents[nodes[-1]])
        values = required
        for child, node in zip(reversed(nodes[:-1]), reversed(nodes[1:]), strict=True):
            if not isinstance(node, ast.expr) or not isinstance(child, ast.expr):
                return None
            inner = operand_values(node, child, values, lambda operand: self.value(change, self.span_of(operand)))
            if inner is None or not np.isfinite(inner[self.valued_poses]).all():
                return None
            values = inner
        return values

    # -- values ---------------------------------------------------------------------------------------------------

    @cached_property
    def singles(self) -> tuple[list[Edit], Array]:
        """The single edits inside the expression that give it a value, and these values (edits, k)."""
        edits_with_value: list[Edit] = []
        values: list[Array] = []
        for edit in self.site.edits:
            if self.deadline.passed:
                break
            if edit.is_within(self._span):
                value = self.value((edit,), self._span)
                if value is not None:
                    edits_with_value.append(edit)
                    values.append(value)
        return edits_with_value, np.array(values).reshape(len(edits_with_value), self.k)

    def values_after(self, part: ast.expr) -> Array:
        """Return the values (edits, k) of a part after each edit of `singles_within` the part; NaN if none."""
        if part not in self._tables:
            singles, _ = self.singles
            inside = self.singles_within(part)
            span = self.span_of(part)
            values = np.full((len(inside), self.k), np.nan)
            for row, i in enumerate(inside):
                if self.deadline.passed:
                    break
                value = self.value((singles[i],), span)
                if value is not None:
                    values[row] = value
            self._tables[part] = values
        return self._tables[part]

    def _size_of(self, part: ast.expr) -> float:
        """Return the largest absolute value of a part before edits."""
        if part not in self._sizes:
            self._sizes[part] = _largest_value(self.present_value(part))
        return self._sizes[part]

    def _equal(self, values: Array, required: Array, size: float) -> NDArray[np.intp]:
        """Return the indices of the rows of `values` (n, k) that are equal to `required` (k,), or by full turns.

        `size` is the size of the values before: a value that must be zero is found up to rounding of this size.
        """
        if not len(values):
            return np.zeros(0, np.intp)
        differences = values[:, self.valued_poses] - required[self.valued_poses]
        turns = np.round(differences[:, :1] / (2 * np.pi))  # an angle may be found a full turn away
        differences = differences - 2 * np.pi * np.nan_to_num(turns)
        limit = RELATIVE_ROUNDING * max(float(np.abs(required[self.valued_poses]).max()), size, _SMALLEST_COMPARED_SIZE)
        return np.flatnonzero(np.abs(differences).max(axis=1) <= limit)

    def value(self, change: Sequence[Edit], span: tuple[int, int]) -> Array | None:
        """Return the values (k,) of the text in `span` after the edits in it; None if it is not a scalar."""
        start, end = span
        inside = [edit for edit in change if edit.is_within(span)]
        code = expression_code(text_after_edits(self.site.source.data, inside, start, end))
        if code is None:
            return None
        return self._run(code, None)

    def present_value(self, part: ast.expr) -> Array | None:
        """Return the values (k,) of a part without edits; None if it is not a scalar."""
        return self.value((), self.span_of(part))

    def _run(self, code: CodeType, hole: Array | None) -> Array | None:
        """Return the values (k,) of an expression in all scopes; `hole`: values (k,) of the part `_HOLE`, if any."""
        each = self.k // len(self.scopes)
        parts: list[Array] = []
        for n, scope in enumerate(self.scopes):
            if hole is not None:
                scope[_HOLE] = scalar_form(scope)(hole[n * each : (n + 1) * each])
            values = _scalar_values(code, scope, each)
            scope.pop(_HOLE, None)
            if values is None:
                return None
            parts.append(values)
        if len(parts) == 1:
            return parts[0]
        return np.concatenate(parts)


def _scalar_values(code: CodeType, scope: dict[str, Value], k: int) -> Array | None:
    """Return the values (k,) of an expression in a scope; None if it is not a scalar."""
    try:
        value: Value = eval(code, scope)
    except Exception:  # an edit may be any invalid text: a name without value, a matrix in a scalar function
        return None
    x = unwrapped(value)
    if not isinstance(x, int | float | np.number | np.ndarray) or isinstance(x, bool):
        return None
    if np.shape(x) not in ((), (k,)):
        return None
    try:
        return np.broadcast_to(np.asarray(x, float), (k,))
    except (TypeError, ValueError):
        return None


def _largest_value(values: Array | None) -> float:
    """Return the largest absolute value; zero without values."""
    if values is None:
        return 0.0
    finite = np.abs(values[np.isfinite(values)])
    return float(finite.max(initial=0.0))


@lru_cache(maxsize=8192)
def expression_code(text: str) -> CodeType | None:
    """Return the code of an expression; None if the text is not valid."""
    try:
        return compile(f"({text}\n)", "<explain>", "eval")
    except (SyntaxError, ValueError):
        return None
