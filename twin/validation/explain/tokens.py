"""Find tokens and syntax nodes in a text, and replace parts of a text."""

from __future__ import annotations

import ast
import contextlib
import io
import tokenize
from typing import AnyStr


def line_starts(text: AnyStr) -> list[int]:
    """Return the offset of each line of a text (in bytes or characters), and of its end."""
    out = [0]
    for line in text.splitlines(keepends=True):
        out.append(out[-1] + len(line))
    return out


def span(node: ast.AST, starts: list[int]) -> tuple[int, int]:
    """Return (first byte, end byte) of a syntax node; `starts` are the offsets of the lines of its text in bytes."""
    start = starts[node.lineno - 1] + node.col_offset  # type: ignore[attr-defined]
    return start, starts[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]


def tokens_of(text: str) -> list[tuple[int, str, int, int]]:
    """Return (kind, text, start, end) of each token of an expression."""
    lines = line_starts(text)
    out: list[tuple[int, str, int, int]] = []
    kinds = (tokenize.NAME, tokenize.NUMBER, tokenize.OP)
    with contextlib.suppress(tokenize.TokenError, IndentationError):
        out.extend(
            (t.type, t.string, lines[t.start[0] - 1] + t.start[1], lines[t.end[0] - 1] + t.end[1])
            for t in tokenize.generate_tokens(io.StringIO(text).readline)
            if t.type in kinds
        )
    return out


def shape(text: str) -> str:
    """Return an expression in a form that does not depend on spaces; "" if it is not an expression."""
    try:
        return ast.dump(ast.parse(text.strip()))
    except (SyntaxError, ValueError):
        return ""


def cut(text: str, parts: list[tuple[int, int, str]]) -> str:
    """Return a text after replacing parts (start, end, new text), which must be in order."""
    for a, b, new in reversed(parts):
        text = text[:a] + new + text[b:]
    return text
