"""Generate small edits of a row: names, functions, signs, operators, numbers, indices, parentheses, terms.

An edit replaces text of the file. An edit that results in invalid Python, or in code that cannot be evaluated, is
dropped when it is tried.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Container, Iterator
from itertools import pairwise
from typing import TypeGuard

from twin.validation.explain.function_source import Edit, Source, Statement
from twin.validation.explain.name_pool import NamePool
from twin.validation.explain.parentheses import other_parentheses
from twin.validation.explain.tokens import parents_of

_FUNCTIONS = (
    ("sin", "cos", "tan"),
    ("asin", "acos", "atan"),
    ("arcsin", "arccos", "arctan"),
    ("atan2", "arctan2"),
    ("rotation_x", "rotation_y", "rotation_z"),
    ("dot", "cross"),
    ("norm_2", "sumsqr"),
    ("fmin", "fmax"),
)
"""Groups of functions that are misprinted for each other."""

_OPERATORS: dict[type[ast.operator], tuple[str, tuple[str, ...]]] = {
    ast.Add: ("+", ("-", "*")),
    ast.Sub: ("-", ("+", "*")),
    ast.Mult: ("*", ("/", "+", "-")),
    ast.Div: ("/", ("*",)),
}
"""The sign of each operator, and the signs that may stand in its place."""

_NEAR_NUMBERS = {0, 1, 2, 3, 4, 6}
"""Numbers that are tried instead of any other: they are frequent in equations."""

_MOST_INDICES = 4
"""Number of indices that are tried, from 0 on: of a vector, or of a row or column of a pose."""

_SUM = (ast.Add, ast.Sub)
"""Operators between the terms of a sum."""


def statement_edits(source: Source, statement: Statement, pool: NamePool, kinds: Container[str]) -> Iterator[Edit]:
    """Yield the edits of a statement that have one of the given kinds."""
    seen: set[tuple[int, int, str]] = set()
    writer = _Writer(source, statement, pool)
    for make in (_names, _calls, _quotients, _signs, _operators, _numbers, _sides, _terms, _factors):
        for edit in make(writer, statement.node):
            key = (edit.start, edit.end, edit.new)
            if edit.kind in kinds and key not in seen and edit.new != edit.old:
                seen.add(key)
                yield edit
    if "parenthesis" in kinds:
        yield from _parentheses(writer, statement.node)


class _Writer:
    """Writes the edits of one statement."""

    def __init__(self, source: Source, statement: Statement, pool: NamePool) -> None:
        """Store the statement of a function, and the names that its edits may insert."""
        self.source = source
        self.statement = statement
        self.pool = pool
        self._parents = parents_of(statement.node)

    def parent(self, node: ast.AST) -> ast.AST | None:
        """Return the syntax node of which a node is a part."""
        return self._parents.get(node)

    def replace(self, node: ast.AST, new: str, kind: str, define: tuple[str, str] | None = None) -> Edit:
        """Return the edit that replaces the text of a node; `define`: see `Edit`."""
        start, end = self.source.span(node)
        return self.between(start, end, new, kind, define)

    def between(self, start: int, end: int, new: str, kind: str, define: tuple[str, str] | None = None) -> Edit:
        """Return the edit that replaces the bytes `start` to `end` of the file."""
        source = self.source
        line = source.line_of(start)
        old = source.text(start, end)
        return Edit(source.path, line, start, end, old, new, kind, self.statement.index, source.name, define)

    def inserted(self, at: int, new: str, kind: str, define: tuple[str, str] | None = None) -> Edit:
        """Return the edit that inserts a text before a byte of the file."""
        return self.between(at, at, new, kind, define)

    def text(self, node: ast.AST) -> str:
        """Return the text of a node, as it is in the file."""
        start, end = self.source.span(node)
        return self.source.text(start, end)

    def need(self, name: str) -> tuple[str, str] | None:
        """Return the definition (name, expression) that an inserted name requires; None if it requires none."""
        if name in self.pool.aliases:
            return name, self.pool.aliases[name]
        if name in self.pool.arguments:
            return None
        return name, ""


def _is_operation(node: ast.AST | None, *operators: type[ast.operator]) -> TypeGuard[ast.BinOp]:
    """Return whether a node is an operation of two operands with one of some operators."""
    return isinstance(node, ast.BinOp) and isinstance(node.op, operators)


def _expressions(root: ast.AST) -> Iterator[ast.expr]:
    """Yield the expressions of a statement that are read, not assigned."""
    for node in ast.walk(root):
        if isinstance(node, ast.expr) and not isinstance(getattr(node, "ctx", None), ast.Store):
            yield node


def _is_called(w: _Writer, node: ast.AST) -> bool:
    parent = w.parent(node)
    return isinstance(parent, ast.Call) and parent.func is node


def _stem(name: str) -> str:
    """Return a name without the digits of its indices, as "l_#" for l_12."""
    return re.sub(r"\d+", "#", name)


def kind_of_name(old: str, new: str, parameters: frozenset[str], aliases: dict[str, str] | None = None) -> str:
    """Return the kind of the edit that replaces name `old` by `new`: "index", "trig", "parameter" or "name"."""
    if _stem(old) == _stem(new):
        return "index"
    if new in (aliases or {}):
        return "trig"
    if old.startswith(("c_", "s_")) and new.startswith(("c_", "s_")):
        return "trig"
    if old in parameters and new in parameters:
        return "parameter"
    return "name"


def _names(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield other names instead of each name."""
    choices = sorted(w.pool.names | set(w.pool.aliases))
    symbols = w.pool.names | w.pool.arguments | w.pool.unknown
    for node in _expressions(root):
        if not isinstance(node, ast.Name) or _is_called(w, node):
            continue
        old = node.id
        if old not in symbols:  # a module, as in symbolic.pose, is not a symbol
            continue
        for new in choices:
            if new != old:
                kind = kind_of_name(old, new, w.pool.parameters, w.pool.aliases)
                yield w.replace(node, new, kind, w.need(new))


def _calls(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield other functions, and other orders of arguments and of factors of matrix products."""
    for node in _expressions(root):
        if isinstance(node, ast.Attribute):
            yield from _other_attributes(w, node)
        if isinstance(node, ast.Call):
            yield from _other_calls(w, node)
        if _is_operation(node, ast.MatMult):
            yield w.replace(node, f"{w.text(node.right)} @ {w.text(node.left)}", "order")
            for side in (node.left, node.right):
                if getattr(side, "attr", "") != "T":
                    yield w.replace(side, f"({w.text(side)}).T", "transpose")


def _other_attributes(w: _Writer, node: ast.Attribute) -> Iterator[Edit]:
    """Yield other functions of the same module, as in `symbolic.cross`, and a matrix without its transposition."""
    for group in _FUNCTIONS:
        if node.attr not in group:
            continue
        module = w.text(node.value)
        for other in group:
            yield w.replace(node, f"{module}.{other}", "function")
    if node.attr == "T":
        yield w.replace(node, w.text(node.value), "transpose")


def _other_calls(w: _Writer, node: ast.Call) -> Iterator[Edit]:
    """Yield calls of other functions, calls with two arguments exchanged, and the argument without the call."""
    if isinstance(node.func, ast.Name):
        for group in _FUNCTIONS:
            if node.func.id not in group:
                continue
            kind = "function"
            if "cos" in group or "acos" in group:
                kind = "trig"
            for other in group:
                yield w.replace(node.func, other, kind)
    for first, second in pairwise(node.args):
        start, end_of_first = w.source.span(first)
        start_of_second, end = w.source.span(second)
        separator = w.source.text(end_of_first, start_of_second)
        yield w.between(start, end, f"{w.text(second)}{separator}{w.text(first)}", "order")
    if len(node.args) == 1 and isinstance(node.func, ast.Name):
        yield w.replace(node, f"({w.text(node.args[0])})", "surplus")


def _quotients(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield `atan2(n, d)` instead of `atan(n / d)`, which has angles of two quadrants only."""
    for node in _expressions(root):
        if not isinstance(node, ast.Call) or len(node.args) != 1:
            continue
        function = w.text(node.func)
        quotient = node.args[0]
        if function.rpartition(".")[2] not in ("atan", "arctan"):
            continue
        if _is_operation(quotient, ast.Div):
            new = f"{function}2({w.text(quotient.left)}, {w.text(quotient.right)})"
            yield w.replace(node, new, "function")


def _signs(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield edits that remove a minus sign, or put one in front of an operand."""
    for node in _expressions(root):
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            yield w.replace(node, w.text(node.operand), "sign")
        elif _begins_expression(w, node):
            yield _negated(w, node)


def _begins_expression(w: _Writer, node: ast.expr) -> bool:
    """Return whether a node is the first operand of an expression, in front of which a sign can stand."""
    if not isinstance(node, ast.Name | ast.Call | ast.Subscript | ast.Constant | ast.BinOp | ast.Attribute):
        return False
    parent = w.parent(node)
    if isinstance(node, ast.Constant) and isinstance(parent, ast.Subscript | ast.Slice):
        return False
    if isinstance(parent, ast.Tuple) and isinstance(w.parent(parent), ast.Subscript):
        return False
    if isinstance(parent, ast.Call):
        return node in parent.args
    if isinstance(parent, ast.BinOp):
        return parent.left is node
    return isinstance(parent, ast.Tuple | ast.List | ast.Return | ast.Assign | ast.GeneratorExp | ast.AugAssign)


def _negated(w: _Writer, node: ast.expr) -> Edit:
    """Return the edit that changes the sign of an operand, written as an author would write it."""
    parent = w.parent(node)
    start, _ = w.source.span(node)
    if _is_operation(node, *_SUM):
        return w.replace(node, f"-({w.text(node)})", "sign")
    if _is_operation(parent, ast.Add) and _plain(parent.right):
        return w.replace(parent, f"{w.text(parent.right)} - {w.text(node)}", "sign")
    if isinstance(node, ast.BinOp):
        return w.replace(node, f"-{w.text(node)}", "sign")
    return w.inserted(start, "-", "sign")


def _plain(node: ast.AST) -> bool:
    return isinstance(node, ast.Name | ast.Call | ast.Subscript)


def _operators(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield other operators between two operands."""
    for node in _expressions(root):
        if not isinstance(node, ast.BinOp) or type(node.op) not in _OPERATORS:
            continue
        sign, others = _OPERATORS[type(node.op)]
        _, start = w.source.span(node.left)
        end, _ = w.source.span(node.right)
        gap = w.source.text(start, end)
        at = gap.find(sign)  # there may be parentheses before or after the sign
        if at < 0:
            continue
        at_byte = start + len(gap[:at].encode())
        for other in others:
            kind = "operator"
            if {sign, other} == {"+", "-"}:
                kind = "sign"
            yield w.between(at_byte, at_byte + 1, other, kind)


def _numbers(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield other numbers instead of each number, and other fractions of pi."""
    for node in _expressions(root):
        # a bool is an int, but no number of an equation
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
            yield from _other_numbers(w, node, node.value)
    for node in _expressions(root):
        if not isinstance(node, ast.Name) or node.id != "pi":
            continue
        for text in ("(pi / 2)", "(2 * pi)", "0"):
            yield w.replace(node, text, "number")
        parent = w.parent(node)
        if _is_operation(parent, ast.Div):
            yield w.replace(parent, "pi", "number")
            yield w.replace(parent, "0", "number")


def _other_numbers(w: _Writer, node: ast.Constant, number: float) -> Iterator[Edit]:
    """Yield other numbers instead of a number: another index, exponent, factor or term."""
    parent = w.parent(node)
    in_index = isinstance(parent, ast.Subscript | ast.Slice)
    if isinstance(parent, ast.Tuple):
        in_index = isinstance(w.parent(parent), ast.Subscript)
    if in_index:
        for i in range(_MOST_INDICES):
            yield w.replace(node, str(i), "index")
        return
    if _is_operation(parent, ast.Pow) and parent.right is node:
        yield w.replace(parent, w.text(parent.left), "exponent")
        for i in (1, 2, 3, 4):
            yield w.replace(node, str(i), "exponent")
        return
    others = {number + 1, number - 1, 2 * number, number / 2} | _NEAR_NUMBERS
    for other in sorted(others - {number}):
        if other >= 0:
            yield w.replace(node, f"{other:g}", "number")
    if number in (0, 1):  # a symbol may be missing, which is 0 in a sum and 1 in a product
        for name in sorted(w.pool.names):
            yield w.replace(node, name, "missing", w.need(name))
        for text in ("pi", "pi / 2", "-pi / 2"):
            yield w.replace(node, text, "number")


def _sides(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield edits of the index of the symbol on the left side of an implicit row."""
    if root is not w.statement.node or not isinstance(root, ast.Assign):
        return
    target = root.targets[0]
    if not isinstance(target, ast.Name) or target.id not in w.source.arguments:
        return
    for other in sorted(w.pool.names - {target.id}):
        if _stem(other) == _stem(target.id) and other in w.source.arguments:
            yield w.replace(target, other, "left side")


def _terms(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield edits that remove a term or factor, or add a square, a root or a term."""
    for node in _expressions(root):
        if _is_operation(node, ast.Add, ast.Sub, ast.Mult, ast.Div, ast.MatMult):
            yield from _without_operand(w, node)
        end_of_base = _end_of_base(w, node)
        if end_of_base is not None and not _is_operation(w.parent(node), ast.Pow):
            yield w.inserted(end_of_base, "**2", "exponent")
        if _is_whole(w, node):
            _, end = w.source.span(node)
            if _has_square(node):
                yield from _squares(w, node)
            for name in sorted(w.pool.names):
                for sign in "+-":
                    yield w.inserted(end, f" {sign} {name}", "missing", w.need(name))
        elif _is_inner_sum(w, node) and _has_square(node):
            yield from _roots(w, node)
        elif isinstance(node, ast.Name) and _is_multiplied(w, node):
            for name in sorted(w.pool.names - {node.id}):
                for sign in "+-":
                    yield w.replace(node, f"({node.id} {sign} {name})", "missing", w.need(name))


def _without_operand(w: _Writer, node: ast.BinOp) -> Iterator[Edit]:
    """Yield an operation's left operand alone, and its right one with its sign; a divisor alone is no misprint."""
    yield w.replace(node, w.text(node.left), "surplus")
    if isinstance(node.op, ast.Div):
        return
    right = w.text(node.right)
    if isinstance(node.op, ast.Sub):
        right = f"-{right}"
    yield w.replace(node, right, "surplus")


def _is_whole(w: _Writer, node: ast.expr) -> bool:
    """Return whether a node is all that is assigned, returned or passed; of an assigned tuple, its entries are."""
    parent = w.parent(node)
    if isinstance(parent, ast.Call):
        return node in parent.args
    if isinstance(parent, ast.Tuple):
        return isinstance(w.parent(parent), ast.Return | ast.Assign)
    return isinstance(parent, ast.Assign | ast.Return) and not isinstance(node, ast.Tuple)


def _end_of_base(w: _Writer, node: ast.expr) -> int | None:
    """Return the byte after a name, an entry or a parenthesis that may be squared; None for other expressions."""
    parent = w.parent(node)
    start, end = w.source.span(node)
    if isinstance(parent, ast.Attribute) or _is_called(w, node):
        return None
    if isinstance(node, ast.Name):
        return end
    if not isinstance(parent, ast.BinOp):
        return None
    if isinstance(node, ast.Subscript):
        is_entry = not any(isinstance(n, ast.Slice) for n in ast.walk(node.slice))
        return end if is_entry else None
    if _is_operation(node, *_SUM):
        enclosed = w.source.text(start - 1, start) == "(" and w.source.text(end, end + 1) == ")"
        return end + 1 if enclosed else None
    return None


def _squares(w: _Writer, node: ast.expr) -> Iterator[Edit]:
    """Yield edits of an expression with squares: its square root, and one more square."""
    _, end = w.source.span(node)
    yield from _roots(w, node)
    for name in sorted(w.pool.names):
        for sign in "+-":
            yield w.inserted(end, f" {sign} {name}**2", "missing", w.need(name))


def _roots(w: _Writer, node: ast.expr) -> Iterator[Edit]:
    """Yield the edits that put an expression under a square root, as the file writes it."""
    names = re.findall(r"(?:\w+\.)?\bsqrt(?=\()", w.source.data.decode())
    for name in sorted(set(names)):
        yield w.replace(node, f"{name}({w.text(node)})", "missing")


def _has_square(node: ast.AST) -> bool:
    return any(_is_operation(part, ast.Pow) for part in ast.walk(node))


def _is_multiplied(w: _Writer, node: ast.AST) -> bool:
    """Return whether a node is what a matrix is multiplied by."""
    parent = w.parent(node)
    return _is_operation(parent, ast.MatMult) and parent.right is node


def _is_inner_sum(w: _Writer, node: ast.AST) -> bool:
    """Return whether a node is a sum in parentheses inside a sum or product."""
    parent = w.parent(node)
    if not (_is_operation(node, *_SUM) and isinstance(parent, ast.BinOp)):
        return False
    return not (_is_operation(parent, *_SUM, ast.Pow) and parent.left is node)


def _factors(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield edits that add a factor to a term of a sum, or to a whole expression without a sum."""
    names = sorted(w.pool.names | set(w.pool.aliases))
    for node in _expressions(root):
        if not (_is_operation(w.parent(node), *_SUM) or _is_whole(w, node)):
            continue
        # a factor before a sum would belong to its first term, which is a node of its own
        if isinstance(node, ast.Tuple | ast.UnaryOp) or _is_operation(node, *_SUM):
            continue
        start, _ = w.source.span(node)
        for name in names:
            yield w.inserted(start, f"{name} * ", "missing", w.need(name))
        yield w.inserted(start, "2 * ", "missing")
        yield w.inserted(start, "0.5 * ", "missing")


def _parentheses(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield edits of parentheses: move one end, remove a pair, add a pair."""
    start, end = w.source.span(root)
    if isinstance(root, ast.Return) and root.value is not None:
        start, end = w.source.span(root.value)
    text = w.source.text(start, end)
    if not text.isascii():  # the positions below are those of characters, not of bytes
        return
    for first, last, new in other_parentheses(text):
        yield w.between(start + first, start + last, new, "parenthesis")
