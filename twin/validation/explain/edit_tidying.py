"""Tidy an edited statement: no `- -x`, no `x**1`, no `1 * x`, no parentheses around one name."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence

from twin.validation.explain.tokens import is_operation, line_starts
from twin.validation.explain.tokens import span as span_of

Span = tuple[int, int]
"""(first byte, end byte) of a part of a text."""

_Change = tuple[Span, bytes]
"""A part of a text, and the bytes that replace it."""

_NEAR_BYTES = 3
"""Number of bytes around an edit in which the text may be tidied."""

_MOST_CHANGES = 8
"""Maximum number of changes of one statement; one change may make another one possible."""

_OPPOSITE = {ast.Add: b"-", ast.Sub: b"+"}
"""The sign that an addition or subtraction has if its right operand has the opposite sign."""

_WITHOUT_PARENTHESES = (ast.Name, ast.Constant, ast.Call, ast.Subscript, ast.Attribute)
"""Expressions that need no parentheses."""

_KEYWORDS = (b"return", b"in", b"and", b"or", b"not")
"""Words before a parenthesis that do not make it that of a call."""


def tidy(text: bytes, edited: Sequence[Span]) -> bytes:
    """Tidy a one-line Python statement around its edits, without changing its meaning.

    Text that is not valid Python is returned unchanged. `edited` are the edited parts of the text.
    """
    for _ in range(_MOST_CHANGES):
        tree = _parsed(text)
        if tree is None:
            return text
        change = _first_change_near(_changes(text, tree), edited)
        if change is None:
            return text
        (start, end), new = change
        tidied = text[:start] + new + text[end:]
        if _parsed(tidied) is None:  # two words may have grown together, as in `return(x)`
            return text
        text = tidied
        edited = _shifted(edited, start, len(new) - (end - start))
    return text


def _parsed(text: bytes) -> ast.Module | None:
    try:
        return ast.parse(text)
    except (SyntaxError, ValueError):
        return None


def _first_change_near(changes: Iterator[_Change], edited: Sequence[Span]) -> _Change | None:
    """Return the first change of a part that is near an edit; text far from the edits stays as its author wrote it."""
    for (start, end), new in changes:
        for first, last in edited:
            if start <= last + _NEAR_BYTES and first - _NEAR_BYTES <= end:
                return (start, end), new
    return None


def _shifted(spans: Sequence[Span], start: int, shift: int) -> list[Span]:
    """Return parts of a text after a change at `start` that makes the text longer by `shift`."""

    def moved(position: int) -> int:
        if position <= start:
            return position
        return max(start, position + shift)

    moved_spans: list[Span] = []
    for first, last in spans:
        moved_spans.append((moved(first), moved(last)))
    return moved_spans


def _changes(text: bytes, tree: ast.Module) -> Iterator[_Change]:
    """Yield (part, replacement) pairs that do not change the meaning."""
    starts = line_starts(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp):
            yield from _simpler_operation(text, node, starts)
        if isinstance(node, ast.UnaryOp):
            yield from _without_two_signs(text, node, starts)
        if isinstance(node, _WITHOUT_PARENTHESES):
            yield from _without_parentheses(text, node, starts)


def _simpler_operation(text: bytes, node: ast.BinOp, starts: list[int]) -> Iterator[_Change]:
    """Yield `a - b` for `a + -b` and `a + b` for `a - -b`, then an operation with one without this operation."""
    left_start, left_end = span_of(node.left, starts)
    right_start, right_end = span_of(node.right, starts)
    between = text[left_end:right_start]
    operator = between.strip()
    minus = _leading_minus(node.right)
    opposite = _OPPOSITE.get(type(node.op))
    if opposite and minus is not None and operator in (b"+", b"-"):
        minus_start, _ = span_of(minus, starts)
        if minus_start == right_start:
            operand_start, _ = span_of(minus.operand, starts)
            yield (left_end, operand_start), between.replace(operator, opposite)
    if operator not in (b"*", b"/", b"**"):  # there are parentheses beside the operator
        return
    if isinstance(node.op, ast.Pow | ast.Div | ast.Mult) and _is_one(node.right):
        yield (left_end, right_end), b""
    if isinstance(node.op, ast.Mult) and _is_one(node.left):
        yield (left_start, right_start), b""


def _without_two_signs(text: bytes, node: ast.UnaryOp, starts: list[int]) -> Iterator[_Change]:
    """Yield `x` for `--x`, if only spaces are between the signs."""
    outer = _leading_minus(node)
    if outer is None:
        return
    inner = _leading_minus(outer.operand)
    if inner is None:
        return
    outer_start, _ = span_of(outer, starts)
    inner_start, _ = span_of(inner, starts)
    if text[outer_start + 1 : inner_start].strip():
        return
    operand_start, _ = span_of(inner.operand, starts)
    yield (outer_start, operand_start), b""


def _without_parentheses(text: bytes, node: ast.expr, starts: list[int]) -> Iterator[_Change]:
    """Yield `x` for `(x)`, but not for the argument of a call."""
    first, last = span_of(node, starts)
    before = text[:first].rstrip()
    after = text[last:].lstrip()
    if not (before.endswith(b"(") and after.startswith(b")")):
        return
    start = len(before) - 1
    end = len(text) - len(after) + 1
    if b"\n" in text[start:end]:
        return
    outside = before[:-1].rstrip()
    is_called = outside[-1:].isalnum() or outside[-1:] in (b"_", b")", b"]")
    words = outside.split()
    follows_keyword = bool(words) and words[-1] in _KEYWORDS
    if not is_called or follows_keyword:
        yield (start, end), text[first:last]


def _leading_minus(node: ast.expr) -> ast.UnaryOp | None:
    """Return the minus sign at the beginning of a product, or None."""
    while is_operation(node, ast.Mult, ast.Div, ast.MatMult):
        node = node.left
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return node
    return None


def _is_one(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.value == 1
