"""Write statements with sorted operands of sums and products, so that equivalent statements have equal text."""

from __future__ import annotations

import ast

from twin.validation.explain.source import Edit, Source, Statement, apply


def canonical(source: Source, statement: Statement, change: list[Edit]) -> str:
    """Return the edited statement with the operands of sums and products in a fixed order."""
    text = apply(source.data, [e for e in change if e.statement == statement.index], statement.start, statement.end)
    text = text[len("return") :].strip() if statement.returns else text
    tree = ast.parse(text)
    return "; ".join(_sorted(n) for n in tree.body)


def _sorted(node: ast.AST) -> str:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        return "(" + " ".join(sorted(_sum(node, "+"))) + ")"
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div):
        sign, factors = _product(node)
        return f"[{sign}" + " ".join(sorted(factors)) + "]"
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return "(" + " ".join(sorted(_sum(node, "+"))) + ")"
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Constant):
        return repr(node.value)
    parts = [_sorted(c) for c in ast.iter_child_nodes(node) if not isinstance(c, ast.expr_context)]
    extra = getattr(node, "attr", "")
    return f"{type(node).__name__}{extra}({', '.join(parts)})"


def _sum(node: ast.AST, sign: str) -> list[str]:
    other = "-" if sign == "+" else "+"
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        return _sum(node.left, sign) + _sum(node.right, sign if isinstance(node.op, ast.Add) else other)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return _sum(node.operand, other)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div):
        minus, factors = _product(node)
        return [(other if minus else sign) + " ".join(sorted(factors))]
    return [sign + _sorted(node)]


def _product(node: ast.AST, divided: bool = False) -> tuple[str, list[str]]:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div):
        s1, left = _product(node.left, divided)
        s2, right = _product(node.right, divided != isinstance(node.op, ast.Div))
        return ("-" if (s1 == "-") != (s2 == "-") else ""), left + right
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        s, factors = _product(node.operand, divided)
        return ("" if s else "-"), factors
    return "", [("/" if divided else "*") + _sorted(node)]
