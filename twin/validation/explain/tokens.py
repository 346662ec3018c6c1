"""Split expressions into tokens, and replace parts of a text."""

from __future__ import annotations

import ast
import contextlib
import io
import tokenize


def tokens_of(text: str) -> list[tuple[int, str, int, int]]:
    """Return (kind, text, start, end) of each token of an expression."""
    lines = [0]
    for line in text.splitlines(keepends=True):
        lines.append(lines[-1] + len(line))
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
