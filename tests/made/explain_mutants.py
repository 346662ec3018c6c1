"""Mutants of a formula file: slips of a kind that is drawn at random, among them missing terms, factors and squares."""

from __future__ import annotations

import ast
import inspect
import re
from pathlib import Path

from made import explain_seeds as seeds
from twin.validation.explain.tokens import line_starts, span

KINDS = (
    "sign",
    "operator",
    "function",
    "name",
    "index",
    "number",
    "square",
    "term",
    "factor",
    "order",
    "root",
    "minus",
)
"""Kinds of slips. Only expressions are changed, not the left sides."""

_OTHERS = {
    **{"sin": "cos", "cos": "sin", "acos": "asin", "asin": "acos", "atan2": "hypot"},
    **{"rotation_x": "rotation_y", "rotation_y": "rotation_z", "rotation_z": "rotation_x"},
}


def changes(text, function):
    """Return {kind: [(start, end, new text)]}, all slips of a function that the generator knows, as byte ranges."""
    data = text.encode()
    starts = line_starts(data)
    tree = next(n for n in ast.parse(text).body if isinstance(n, ast.FunctionDef) and n.name == function.__name__)
    body = tree.body[1:] if isinstance(tree.body[0], ast.Expr) else tree.body
    nodes = [n for s in body for n in ast.walk(s)]
    parents = {c: n for n in [tree, *nodes] for c in ast.iter_child_nodes(n)}
    code = inspect.unwrap(function).__code__
    names = sorted({*code.co_varnames[: code.co_argcount], *(n.id for n in nodes if _stored(n))})
    out = {kind: [] for kind in KINDS}

    def said(node):
        a, b = span(node, starts)
        return data[a:b].decode()

    def put(kind, node, new):
        out[kind].append((*span(node, starts), new))

    def whole(node):
        return f"({said(node)})" if isinstance(node, ast.BinOp | ast.UnaryOp) else said(node)

    for node in nodes:
        if isinstance(node, ast.BinOp):
            left, right = whole(node.left), whole(node.right)
            sign = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*"}.get(type(node.op))
            kind = "sign" if isinstance(node.op, ast.Add | ast.Sub) else "operator"
            if sign:
                put(kind, node, f"({left} {sign} {right})")
            if isinstance(node.op, ast.Add):
                put("term", node, left)
                put("term", node, right)
            if isinstance(node.op, ast.Sub):
                put("term", node, left)
            if isinstance(node.op, ast.Mult):
                put("factor", node, left)
                put("factor", node, right)
            if isinstance(node.op, ast.Pow):
                put("square", node, left)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and not _in_index(node, parents):
            put("minus", node, whole(node.operand))
        if isinstance(node, ast.Call):
            called = said(node.func)
            if called in _OTHERS and called != "atan2":
                put("function", node.func, _OTHERS[called])
            if called == "sqrt":
                put("root", node, f"({said(node.args[0])})")
            if called in ("atan2", "cross", "dot") and len(node.args) == 2:
                put("order", node, f"{called}({said(node.args[1])}, {said(node.args[0])})")
        if isinstance(node, ast.Constant) and type(node.value) in (int, float):
            n = node.value
            if _in_index(node, parents):
                out["index"] += [(*span(node, starts), str(i)) for i in range(3) if i != n and n in (0, 1, 2)]
            else:
                out["number"] += [(*span(node, starts), f"{x:g}") for x in (n + 1, 2 * n, n / 2) if x != n]
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id in names:
            alike = [n for n in names if n != node.id and re.sub(r"\d", "", n) == re.sub(r"\d", "", node.id)]
            for other in alike or [n for n in names if n != node.id]:
                put("index" if alike else "name", node, other)
    return {kind: found for kind, found in out.items() if found}


def _stored(node):
    return isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)


def _in_index(node, parents):
    while node in parents:
        node = parents[node]
        if isinstance(node, ast.Subscript | ast.Slice):
            return True
        if isinstance(node, ast.stmt):
            return False
    return False


def mutant(case, path, rng, count=1):
    """Write a formula file with `count` slips in one function to `path`; return the slips as text, None without any."""
    choices = seeds.functions(case.formula)
    function = choices[rng.integers(len(choices))]
    text = Path(function.__code__.co_filename).read_text(encoding="utf-8")
    found = changes(text, function)
    if not found:
        return None
    kinds = list(found)
    chosen, told = [], []
    for _ in range(count):
        kind = kinds[rng.integers(len(kinds))]
        start, end, new = found[kind][rng.integers(len(found[kind]))]
        if any(start < b and a < end for a, b, _ in chosen):
            return None
        chosen.append((start, end, new))
        old = text.encode()[start:end].decode()
        told.append(f"{kind}: {old} -> {new}")
    data = text.encode()
    for start, end, new in sorted(chosen, reverse=True):
        data = data[:start] + new.encode() + data[end:]
    path.write_bytes(data)
    return f"{function.__name__}: " + "; ".join(told)
