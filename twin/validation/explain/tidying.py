"""Tidy an edited statement: no `- -x`, no `x**1`, no `1 * x`, no parentheses around one name."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence

from twin.validation.explain.tokens import line_starts
from twin.validation.explain.tokens import span as span_of

Span = tuple[int, int]
"""(first byte, end byte) of a part of a text."""

_NEAR = 3
"""Number of bytes around an edit in which the text may be tidied."""

_OPPOSITE = {ast.Add: b"-", ast.Sub: b"+"}
_ATOM = (ast.Name, ast.Constant, ast.Call, ast.Subscript, ast.Attribute)


def tidy(text: bytes, edited: Sequence[Span]) -> bytes:
    """Tidy a one-line Python statement around its edits, without changing its meaning.

    Text that is not valid Python is returned unchanged. `edited` are the edited parts of the text.
    """
    for _ in range(8):
        tree = _parsed(text)
        if tree is None:
            return text
        change = next((c for c in _changes(text, tree) if _is_near(c[0], edited)), None)
        if change is None:
            return text
        (start, end), new = change
        if _parsed(text[:start] + new + text[end:]) is None:
            return text
        text = text[:start] + new + text[end:]
        shift = len(new) - (end - start)
        edited = [
            (a if a <= start else max(start, a + shift), b if b <= start else max(start, b + shift)) for a, b in edited
        ]
    return text


def _parsed(text: bytes) -> ast.Module | None:
    try:
        return ast.parse(text)
    except (SyntaxError, ValueError):
        return None


def _is_near(span: Span, edited: Sequence[Span]) -> bool:
    return any(span[0] <= b + _NEAR and a - _NEAR <= span[1] for a, b in edited)


def _changes(text: bytes, tree: ast.Module) -> Iterator[tuple[Span, bytes]]:
    """Yield (part, replacement) pairs that do not change the meaning."""
    starts = line_starts(text)

    def span(node: ast.expr) -> Span:
        return span_of(node, starts)

    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp):
            a, b, c, d = *span(node.left), *span(node.right)
            between = text[b:c]
            minus = _leading(node.right)
            opposite = _OPPOSITE.get(type(node.op))
            if opposite and minus is not None and span(minus)[0] == c and between.strip() in (b"+", b"-"):
                sign = between.replace(between.strip(), opposite)
                yield (b, span(minus.operand)[0]), sign
            bare = between.strip() in (b"*", b"/", b"**")
            if bare and isinstance(node.op, ast.Pow | ast.Div | ast.Mult) and _is_one(node.right):
                yield (b, d), b""
            if bare and isinstance(node.op, ast.Mult) and _is_one(node.left):
                yield (a, c), b""
        minus = _leading(node) if isinstance(node, ast.UnaryOp) else None
        inner = _leading(minus.operand) if minus is not None else None
        if minus is not None and inner is not None and not text[span(minus)[0] + 1 : span(inner)[0]].strip():
            yield (span(minus)[0], span(inner.operand)[0]), b""
        if isinstance(node, _ATOM):
            a, b = span(node)
            before, after = text[:a].rstrip(), text[b:].lstrip()
            if before.endswith(b"(") and after.startswith(b")"):
                outer = before[:-1].rstrip()
                called = outer[-1:].isalnum() or outer[-1:] in (b"_", b")", b"]")
                start, end = len(before) - 1, len(text) - len(after) + 1
                word = outer.split()[-1] if outer.split() else b""
                if (not called or word in (b"return", b"in", b"and", b"or", b"not")) and b"\n" not in text[start:end]:
                    yield (start, end), text[a:b]


def _leading(node: ast.expr) -> ast.UnaryOp | None:
    """Return the minus sign at the beginning of a product, or None."""
    while isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div | ast.MatMult):
        node = node.left
    return node if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) else None


def _is_one(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.value == 1
