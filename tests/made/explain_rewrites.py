"""Equations that are written in another way and say the same."""

from __future__ import annotations

import ast

from made import explain_seeds as seeds


class Rewriter(ast.NodeTransformer):
    """Writes sums, products, squares and signs in another way that says the same."""

    def __init__(self, rng):
        self.rng, self.made = rng, 0

    def visit_BinOp(self, node):
        self.generic_visit(node)
        if self.rng.random() > 0.3 or not _scalar(node):
            return node
        self.made += 1
        if isinstance(node.op, ast.Add | ast.Mult):
            return ast.BinOp(node.right, node.op, node.left)
        if isinstance(node.op, ast.Sub):
            return ast.BinOp(ast.UnaryOp(ast.USub(), node.right), ast.Add(), node.left)
        if isinstance(node.op, ast.Div):
            return ast.BinOp(node.left, ast.Mult(), ast.BinOp(ast.Constant(1), ast.Div(), node.right))
        if isinstance(node.op, ast.Pow) and getattr(node.right, "value", 0) == 2:
            return ast.BinOp(node.left, ast.Mult(), node.left)
        self.made -= 1
        return node


def _scalar(node):
    """Whether no product of matrices, list or index is in it, where order matters."""
    odd = (ast.MatMult, ast.List, ast.Tuple, ast.Subscript, ast.FloorDiv, ast.Mod)
    return not any(isinstance(n, odd) for n in ast.walk(node))


def rewritten(case, rng):
    """The text of a formula with one function written in another way; None if nothing was there to rewrite."""
    text = case.path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    used = {f.__name__ for f in seeds.functions(case.formula)}
    functions = [n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name in used]
    f = functions[rng.integers(len(functions))]
    rewriter = Rewriter(rng)
    f.body = [rewriter.visit(s) for s in f.body]
    return ast.unparse(ast.fix_missing_locations(tree)) if rewriter.made else None
