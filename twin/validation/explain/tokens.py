"""Find tokens and syntax nodes in a text, and replace parts of a text."""

from __future__ import annotations

import ast
import contextlib
import io
import tokenize
from typing import AnyStr


def line_starts(text: AnyStr) -> list[int]:
    """Return the offset of each line of a text (in bytes or characters), and of its end."""
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    return starts


def span(node: ast.AST, starts: list[int]) -> tuple[int, int]:
    """Return (first byte, end byte) of a syntax node; `starts` are the offsets of the lines of its text in bytes."""
    start = starts[node.lineno - 1] + node.col_offset  # type: ignore[attr-defined]
    return start, starts[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]


def tokens_of(text: str) -> list[tuple[int, str, int, int]]:
    """Return (kind, text, start, end) of each token of an expression."""
    lines = line_starts(text)
    tokens: list[tuple[int, str, int, int]] = []
    # A text that ends too early has an error only at its end; the tokens before it are kept.
    with contextlib.suppress(tokenize.TokenError, IndentationError):
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type in (tokenize.NAME, tokenize.NUMBER, tokenize.OP):
                (first_line, first), (last_line, last) = token.start, token.end
                tokens.append((token.type, token.string, lines[first_line - 1] + first, lines[last_line - 1] + last))
    return tokens


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
