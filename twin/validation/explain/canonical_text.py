"""Write statements with sorted operands of sums and products, so that equivalent statements have equal text."""

from __future__ import annotations

import ast
from typing import TypeGuard

from twin.validation.explain.function_source import Edit, Source, Statement


def canonical(source: Source, statement: Statement, change: list[Edit]) -> str:
    """Return the edited statement with the operands of sums and products in a fixed order."""
    edits = [e for e in change if e.statement == statement.index]
    text = source.edited(statement, edits)
    if statement.returns:
        text = text.removeprefix("return").strip()
    return "; ".join(_sorted(n) for n in ast.parse(text).body)


def _is_sum(node: ast.AST) -> TypeGuard[ast.BinOp]:
    return isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub)


def _is_product(node: ast.AST) -> TypeGuard[ast.BinOp]:
    return isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div)


def _is_minus(node: ast.AST) -> TypeGuard[ast.UnaryOp]:
    return isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub)


def _sorted(node: ast.AST) -> str:
    if _is_sum(node) or _is_minus(node):
        return f"({' '.join(sorted(_sum(node, '+')))})"
    if _is_product(node):
        sign, factors = _product(node)
        return f"[{sign}{' '.join(sorted(factors))}]"
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Constant):
        return repr(node.value)
    parts: list[str] = []
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.expr_context):  # whether a name is read or assigned does not matter
            parts.append(_sorted(child))
    attribute = getattr(node, "attr", "")
    return f"{type(node).__name__}{attribute}({', '.join(parts)})"


def _sum(node: ast.AST, sign: str) -> list[str]:
    """Return the terms of a sum, each with its sign."""
    opposite = "-" if sign == "+" else "+"
    if _is_sum(node):
        right = sign if isinstance(node.op, ast.Add) else opposite
        return _sum(node.left, sign) + _sum(node.right, right)
    if _is_minus(node):
        return _sum(node.operand, opposite)
    if _is_product(node):
        minus, factors = _product(node)
        if minus:
            sign = opposite
        return [sign + " ".join(sorted(factors))]
    return [sign + _sorted(node)]


def _product(node: ast.AST, divided: bool = False) -> tuple[str, list[str]]:
    """Return ("-" or "", factors of a product, each with "*" or "/" before it)."""
    if _is_product(node):
        left_sign, left = _product(node.left, divided)
        right_sign, right = _product(node.right, divided != isinstance(node.op, ast.Div))
        sign = "-" if left_sign != right_sign else ""
        return sign, left + right
    if _is_minus(node):
        sign, factors = _product(node.operand, divided)
        return ("" if sign else "-"), factors
    operator = "/" if divided else "*"
    return "", [operator + _sorted(node)]
