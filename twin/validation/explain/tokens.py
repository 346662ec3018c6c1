"""Find tokens and syntax nodes in a text, and replace parts of a text."""

from __future__ import annotations

import ast
import contextlib
import io
import tokenize
from typing import AnyStr, NamedTuple


class Token(NamedTuple):
    """A name, number or operator of a text: its kind in `tokenize`, and the characters `start` to `end`."""

    kind: int
    text: str
    start: int
    end: int

    @property
    def is_operand(self) -> bool:
        """Whether the token is a name or a number."""
        return self.kind in (tokenize.NAME, tokenize.NUMBER)


def line_starts(text: AnyStr) -> list[int]:
    """Return the offset of each line of a text (in bytes or characters), and of its end."""
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    return starts


def span(node: ast.AST, starts: list[int]) -> tuple[int, int]:
    """Return (first byte, end byte) of a syntax node; `starts` are the offsets of the lines of its text in bytes."""
    start = starts[node.lineno - 1] + node.col_offset  # type: ignore[attr-defined]
    end = starts[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]
    return start, end


def parents_of(root: ast.AST) -> dict[ast.AST, ast.AST]:
    """Return the parent of each syntax node below `root`."""
    parents: dict[ast.AST, ast.AST] = {}
    for node in ast.walk(root):
        for child in ast.iter_child_nodes(node):
            parents[child] = node
    return parents


def names_in(root: ast.AST) -> set[str]:
    """Return the names in a syntax tree, read or assigned."""
    names: set[str] = set()
    for node in ast.walk(root):
        if isinstance(node, ast.Name):
            names.add(node.id)
    return names


def tokens_of(text: str) -> list[Token]:
    """Return the names, numbers and operators of an expression, in the order of the text."""
    lines = line_starts(text)
    tokens: list[Token] = []
    # A text that ends too early has an error only at its end; the tokens before it are kept.
    with contextlib.suppress(tokenize.TokenError, IndentationError):
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type in (tokenize.NAME, tokenize.NUMBER, tokenize.OP):
                first_line, first = token.start
                last_line, last = token.end
                start = lines[first_line - 1] + first
                end = lines[last_line - 1] + last
                tokens.append(Token(token.type, token.string, start, end))
    return tokens


def shape(text: str) -> str:
    """Return an expression in a form that does not depend on spaces; "" if it is not an expression."""
    try:
        return ast.dump(ast.parse(text.strip()))
    except (SyntaxError, ValueError):
        return ""


def cut(text: str, parts: list[tuple[int, int, str]]) -> str:
    """Return a text after replacing parts (start, end, new text), which must be in order."""
    for start, end, new in reversed(parts):  # from the end, so that earlier positions stay as they are
        text = text[:start] + new + text[end:]
    return text
