"""Find tokens and syntax nodes in a text, replace parts of a text, and change its parentheses."""

from __future__ import annotations

import ast
import contextlib
import io
import tokenize
from collections.abc import Iterator, Sequence
from typing import AnyStr, NamedTuple, TypeGuard

_FARTHEST_MOVE = 48
"""Maximum number of tokens by which a parenthesis is moved."""

_LONGEST_PAIR = _FARTHEST_MOVE // 2
"""Maximum number of tokens in a pair of parentheses that is added."""


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


def is_operation(node: ast.AST | None, *operators: type[ast.operator]) -> TypeGuard[ast.BinOp]:
    """Return whether a node is an operation of two operands with one of some operators."""
    return isinstance(node, ast.BinOp) and isinstance(node.op, operators)


def is_sum(node: ast.AST | None) -> TypeGuard[ast.BinOp]:
    """Return whether a node is a sum or a difference."""
    return is_operation(node, ast.Add, ast.Sub)


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


def syntax_form(text: str) -> str:
    """Return an expression in a form that does not depend on spaces; "" if it is not an expression."""
    try:
        return ast.dump(ast.parse(text.strip()))
    except (SyntaxError, ValueError):
        return ""


def with_replacements(text: str, parts: list[tuple[int, int, str]]) -> str:
    """Return a text after replacing parts (start, end, new text), which must be in order."""
    for start, end, new in reversed(parts):  # from the end, so that earlier positions stay as they are
        text = text[:start] + new + text[end:]
    return text


def other_parentheses(text: str) -> Iterator[tuple[int, int, str]]:
    """Yield (start, end, new text) of the changes of a text that give it other parentheses and another meaning."""
    known_shapes = {syntax_form(text)}
    for new in _parenthesised(text):
        new_shape = syntax_form(new)
        # Parentheses that change nothing are no edit, and many of them come to the same.
        if not new_shape or new_shape in known_shapes:
            continue
        known_shapes.add(new_shape)
        before, after = _changed_part(text, new)
        yield before, len(text) - after, new[before : len(new) - after]


def _changed_part(text: str, new: str) -> tuple[int, int]:
    """Return the numbers of equal characters before and after what differs between two texts, in whole names."""
    shorter = min(len(text), len(new))
    before = 0
    while before < shorter and text[before] == new[before]:
        before += 1
    if before == shorter:
        before = 0
    after = 0
    while after < shorter - before and text[-1 - after] == new[-1 - after]:
        after += 1
    if after == shorter - before:
        after = 0
    while before and (text[before - 1].isalnum() or text[before - 1] == "_"):
        before -= 1
    return before, after


def _parenthesised(text: str) -> Iterator[str]:
    """Yield a text with one pair of parentheses less, with one end of a pair elsewhere, or with one pair more."""
    tokens = tokens_of(text)
    for opening, closing in _pairs(tokens):
        is_of_call = opening > 0 and tokens[opening - 1].kind == tokenize.NAME
        if not is_of_call:
            yield with_replacements(text, [_removal(tokens[opening]), _removal(tokens[closing])])
        yield from _with_closing_elsewhere(text, tokens, opening, closing)
        if not is_of_call:  # the parenthesis after a function's name stays there
            yield from _with_opening_elsewhere(text, tokens, opening, closing)
    yield from _with_new_pair(text, tokens)


def _pairs(tokens: Sequence[Token]) -> list[tuple[int, int]]:
    """Return the indices of the opening and the closing token of each pair of parentheses, inner pairs first."""
    open_tokens: list[int] = []
    pairs: list[tuple[int, int]] = []
    for i, token in enumerate(tokens):
        if token.kind != tokenize.OP:
            continue
        if token.text == "(":
            open_tokens.append(i)
        elif token.text == ")" and open_tokens:
            pairs.append((open_tokens.pop(), i))
    return pairs


def _removal(token: Token) -> tuple[int, int, str]:
    """Return the part of a text that removes a token; see `with_replacements`."""
    return token.start, token.end, ""


def _with_closing_elsewhere(text: str, tokens: Sequence[Token], opening: int, closing: int) -> Iterator[str]:
    """Yield a text with the closing end of a pair after another operand or parenthesis."""
    for i, token in enumerate(tokens):
        # After the token before it, the end would stand where it is now.
        is_same_place = i in (closing, closing - 1)
        if abs(i - closing) > _FARTHEST_MOVE or i <= opening or is_same_place:
            continue
        if token.is_operand or token.text == ")":
            inserted = (token.end, token.end, ")")
            yield with_replacements(text, sorted([_removal(tokens[closing]), inserted]))


def _with_opening_elsewhere(text: str, tokens: Sequence[Token], opening: int, closing: int) -> Iterator[str]:
    """Yield a text with the opening end of a pair before another operand, parenthesis or sign."""
    for i, token in enumerate(tokens):
        if abs(i - opening) > _FARTHEST_MOVE or i >= closing or i == opening:
            continue
        if token.is_operand or token.text in ("(", "-"):
            inserted = (token.start, token.start, "(")
            yield with_replacements(text, sorted([_removal(tokens[opening]), inserted]))


def _with_new_pair(text: str, tokens: Sequence[Token]) -> Iterator[str]:
    """Yield a text with one pair of parentheses more, around some operands."""
    firsts: list[int] = []
    lasts: list[int] = []
    for i, token in enumerate(tokens):
        if token.is_operand or token.text == "(":
            firsts.append(i)
        if token.is_operand or token.text in (")", "]"):
            lasts.append(i)
    for i in firsts:
        start = tokens[i].start
        for j in lasts:
            if i < j <= i + _LONGEST_PAIR:
                end = tokens[j].end
                yield with_replacements(text, [(start, start, "("), (end, end, ")")])
