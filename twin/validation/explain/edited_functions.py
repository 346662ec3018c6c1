"""Group exact edits by the function that results: different edits may be readings of one repair.

Two edited functions are the same if their statements have the same canonical text, with sorted operands of sums and
products, or if the residuals of each row, at values that no mechanism has, differ by a constant factor only.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeGuard

import numpy as np

from twin.core.spatial import Array
from twin.validation.explain.candidate import Candidate, edited_residuals
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.function_source import Edit, Source, Statement
from twin.validation.explain.row_deviations import Judge
from twin.validation.explain.tokens import is_operation, is_sum

_RESIDUAL_ROUNDING = 1e-7
"""Relative difference of residuals, apart from a factor, below which two edited rows count as the same function."""

_AGREEING_RESIDUAL = 1e-3
"""Residual, in units of the tolerance, below which a row agrees but for rounding, which is about 1e-6 of them."""


@dataclass
class _SameFunction:
    """Candidates that result in one function.

    Attributes:
        residuals: residuals (k, entries) by row, at perturbed values; None if a row has no value there. Those of the
            first member: those of others may have another factor.
        members: the candidates, one for each text.
        texts: their canonical texts.
    """

    residuals: dict[RowKey, Array] | None
    members: list[Candidate]
    texts: set[str]


class EditedFunctions:
    """Compares the functions that result from edits."""

    def __init__(self, judge: Judge, perturbed_judge: Judge) -> None:
        """Set up for a judged formula; `perturbed_judge` judges it at perturbed values, which no mechanism has."""
        self.judge = judge
        self.perturbed_judge = perturbed_judge

    def grouped_by_function(self, exact: list[Candidate], rows: list[RowKey]) -> list[list[Candidate]]:
        """Group exact candidates by the resulting function; keep one candidate per different canonical text."""
        groups: list[_SameFunction] = []
        for candidate in exact:
            residuals = self.perturbed_residuals(candidate, rows)
            text = self.text(candidate)
            group = _group_of(groups, text, residuals)
            if group is None:
                groups.append(_SameFunction(residuals, [candidate], {text}))
            elif text not in group.texts:
                group.members.append(candidate)
                group.texts.add(text)
        return [group.members for group in groups]

    def text(self, candidate: Candidate) -> str:
        """Return the canonical text of the edited statements."""
        edits_of_statement: dict[tuple[Path, str, int], list[Edit]] = {}
        for edit in candidate.edits:
            edits_of_statement.setdefault((edit.path, edit.function, edit.statement), []).append(edit)
        parts: list[str] = []
        for place in sorted(edits_of_statement):
            edits = edits_of_statement[place]
            _, name, i = place
            source = self.judge.source_of(candidate.step, edits[0])
            parts.append(f"{name}:{i}:{canonical_statement(source, source.statements[i], edits)}")
        return "; ".join(parts)

    def perturbed_residuals(self, candidate: Candidate, rows: list[RowKey]) -> dict[RowKey, Array] | None:
        """Return a candidate's residuals (k, entries) at perturbed values, by row, to compare functions.

        Return None if the edits cannot be evaluated there, or if a row has only NaN.
        """
        deviations = edited_residuals(self.perturbed_judge, candidate.step.equation.name, candidate.edits)
        if not deviations:
            return None
        of_rows: dict[RowKey, Array] = {}
        for row, residual in deviations.items():
            if row in rows:
                of_rows[row] = residual
                if not np.isfinite(residual).any():
                    return None
        return of_rows


def _group_of(
    groups: Sequence[_SameFunction], text: str, residuals: dict[RowKey, Array] | None
) -> _SameFunction | None:
    """Return the group with the same canonical text, or else with the same residuals but for a factor."""
    for group in groups:
        if text in group.texts:
            return group
    if residuals is None:
        return None
    for group in groups:
        if group.residuals is not None and _are_equivalent(group.residuals, residuals):
            return group
    return None


def _are_equivalent(a: dict[RowKey, Array], b: dict[RowKey, Array]) -> bool:
    """Return whether two edited equations are equivalent: their residuals differ by a constant factor only.

    `a` and `b` are residuals (k, entries) by row. Any factor is allowed, because an implicit row may be multiplied by
    one: it has the same solutions.
    """
    if a.keys() != b.keys():
        return False
    for row in a:
        if a[row].shape != b[row].shape:
            return False
        has_value = np.isfinite(a[row])
        if not np.array_equal(has_value, np.isfinite(b[row])):
            return False
        x = a[row][has_value]
        y = b[row][has_value]
        x_is_zero = np.abs(x).max(initial=0.0) < _AGREEING_RESIDUAL
        y_is_zero = np.abs(y).max(initial=0.0) < _AGREEING_RESIDUAL
        if x_is_zero and y_is_zero:
            continue
        if x_is_zero or y_is_zero:  # a row that agrees everywhere has other solutions than one that does not
            return False
        # The largest entry gives the factor with the smallest rounding.
        largest = int(np.argmax(np.abs(x)))
        factor = y[largest] / x[largest]
        if np.abs(y - x * factor).max() > _RESIDUAL_ROUNDING * float(np.abs(y).max(initial=0.0)):
            return False
    return True


def canonical_statement(source: Source, statement: Statement, edits: Sequence[Edit]) -> str:
    """Return a statement after its edits, with the operands of sums and products in a fixed order."""
    text = source.edited(statement, edits)
    if statement.returns:
        text = text.removeprefix("return").strip()
    parts: list[str] = []
    for node in ast.parse(text).body:
        parts.append(_canonical_node(node))
    return "; ".join(parts)


def _is_product(node: ast.AST) -> TypeGuard[ast.BinOp]:
    return is_operation(node, ast.Mult, ast.Div)


def _is_minus(node: ast.AST) -> TypeGuard[ast.UnaryOp]:
    return isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub)


def _canonical_node(node: ast.AST) -> str:
    """Return the canonical text of a syntax node; it is no Python, and only equal to that of the same formula."""
    if is_sum(node) or _is_minus(node):
        terms = sorted(_signed_terms(node, "+"))
        return f"({' '.join(terms)})"
    if _is_product(node):
        sign, factors = _sign_and_factors(node)
        return f"[{sign}{' '.join(sorted(factors))}]"
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Constant):
        return repr(node.value)
    fields: list[str] = []
    for _, value in ast.iter_fields(node):
        if not isinstance(value, ast.expr_context):  # whether a name is read or assigned does not matter
            fields.append(_field_text(value))
    return f"{type(node).__name__}({', '.join(fields)})"


def _field_text(value: object) -> str:
    """Return the canonical text of a field of a node: a node, a list of fields, a name, or None for an absent part."""
    if isinstance(value, ast.AST):
        return _canonical_node(value)
    if isinstance(value, list):
        return f"[{', '.join(map(_field_text, value))}]"
    return repr(value)


def _signed_terms(node: ast.AST, sign: str) -> list[str]:
    """Return the terms of a sum, each with its sign."""
    opposite = "-" if sign == "+" else "+"
    if is_sum(node):
        right = sign if isinstance(node.op, ast.Add) else opposite
        return _signed_terms(node.left, sign) + _signed_terms(node.right, right)
    if _is_minus(node):
        return _signed_terms(node.operand, opposite)
    if _is_product(node):
        minus, factors = _sign_and_factors(node)
        if minus:
            sign = opposite
        return [sign + " ".join(sorted(factors))]
    return [sign + _canonical_node(node)]


def _sign_and_factors(node: ast.AST, divided: bool = False) -> tuple[str, list[str]]:
    """Return ("-" or "", factors of a product, each with "*" or "/" before it)."""
    if _is_product(node):
        left_sign, left_factors = _sign_and_factors(node.left, divided)
        right_sign, right = _sign_and_factors(node.right, divided != isinstance(node.op, ast.Div))
        sign = "-" if left_sign != right_sign else ""
        return sign, left_factors + right
    if _is_minus(node):
        sign, factors = _sign_and_factors(node.operand, divided)
        return ("" if sign else "-"), factors
    operator = "/" if divided else "*"
    return "", [operator + _canonical_node(node)]
