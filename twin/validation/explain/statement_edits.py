"""Generate small edits of a row: names, functions, signs, operators, numbers, indices, parentheses, terms.

An edit replaces text of the file. An edit that results in invalid Python, or in code that cannot be evaluated, is
dropped when it is tried.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Container, Iterator
from itertools import pairwise

from twin.validation.explain.function_source import Edit, Source, Statement
from twin.validation.explain.name_pool import NamePool
from twin.validation.explain.tokens import is_operation, is_sum, other_parentheses, parents_of

_CONFUSED_FUNCTIONS = (
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

_CONFUSED_OPERATORS: dict[type[ast.operator], tuple[str, tuple[str, ...]]] = {
    ast.Add: ("+", ("-", "*")),
    ast.Sub: ("-", ("+", "*")),
    ast.Mult: ("*", ("/", "+", "-")),
    ast.Div: ("/", ("*",)),
}
"""The sign of each operator, and the signs that may stand in its place."""

_FREQUENT_NUMBERS = {0, 1, 2, 3, 4, 6}
"""Numbers that are tried instead of any other: they are frequent in equations."""

_TRIED_INDICES = 4
"""Number of indices that are tried, from 0 on: of a vector, or of a row or column of a pose."""

_SUM_OPERATORS = (ast.Add, ast.Sub)
"""Operators between the terms of a sum."""


def statement_edits(source: Source, statement: Statement, pool: NamePool, kinds: Container[str]) -> Iterator[Edit]:
    """Yield the edits of a statement that have one of the given kinds."""
    yielded: set[tuple[int, int, str]] = set()
    writer = _Writer(source, statement, pool)
    for generate in (
        _name_edits,
        _call_edits,
        _quotient_edits,
        _sign_edits,
        _operator_edits,
        _number_edits,
        _left_side_edits,
        _term_edits,
        _factor_edits,
    ):
        for edit in generate(writer, statement.node):
            key = (edit.start, edit.end, edit.new)
            if edit.kind in kinds and key not in yielded and edit.new != edit.old:
                yielded.add(key)
                yield edit
    if "parenthesis" in kinds:
        yield from _parenthesis_edits(writer, statement.node)


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
        return self.source.edit_of(self.statement, (start, end), new, kind, define)

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


def _expressions(root: ast.AST) -> Iterator[ast.expr]:
    """Yield the expressions of a statement that are read, not assigned."""
    for node in ast.walk(root):
        if isinstance(node, ast.expr) and not isinstance(getattr(node, "ctx", None), ast.Store):
            yield node


def _is_called(writer: _Writer, node: ast.AST) -> bool:
    parent = writer.parent(node)
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


def _name_edits(writer: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield other names instead of each name."""
    choices = sorted(writer.pool.names | set(writer.pool.aliases))
    symbols = writer.pool.names | writer.pool.arguments | writer.pool.unknown
    for node in _expressions(root):
        if not isinstance(node, ast.Name) or _is_called(writer, node):
            continue
        old = node.id
        if old not in symbols:  # a module, as in symbolic.pose, is not a symbol
            continue
        for new in choices:
            if new != old:
                kind = kind_of_name(old, new, writer.pool.parameters, writer.pool.aliases)
                yield writer.replace(node, new, kind, writer.need(new))


def _call_edits(writer: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield other functions, and other orders of arguments and of factors of matrix products."""
    for node in _expressions(root):
        if isinstance(node, ast.Attribute):
            yield from _other_attributes(writer, node)
        if isinstance(node, ast.Call):
            yield from _other_calls(writer, node)
        if is_operation(node, ast.MatMult):
            yield writer.replace(node, f"{writer.text(node.right)} @ {writer.text(node.left)}", "order")
            for side in (node.left, node.right):
                if getattr(side, "attr", "") != "T":
                    yield writer.replace(side, f"({writer.text(side)}).T", "transpose")


def _other_attributes(writer: _Writer, node: ast.Attribute) -> Iterator[Edit]:
    """Yield other functions of the same module, as in `symbolic.cross`, and a matrix without its transposition."""
    for group in _CONFUSED_FUNCTIONS:
        if node.attr not in group:
            continue
        module = writer.text(node.value)
        for other_name in group:
            yield writer.replace(node, f"{module}.{other_name}", "function")
    if node.attr == "T":
        yield writer.replace(node, writer.text(node.value), "transpose")


def _other_calls(writer: _Writer, node: ast.Call) -> Iterator[Edit]:
    """Yield calls of other functions, calls with two arguments exchanged, and the argument without the call."""
    if isinstance(node.func, ast.Name):
        for group in _CONFUSED_FUNCTIONS:
            if node.func.id not in group:
                continue
            kind = "function"
            if "cos" in group or "acos" in group:
                kind = "trig"
            for other_name in group:
                yield writer.replace(node.func, other_name, kind)
    for first, second in pairwise(node.args):
        start, end_of_first = writer.source.span(first)
        start_of_second, end = writer.source.span(second)
        separator = writer.source.text(end_of_first, start_of_second)
        yield writer.between(start, end, f"{writer.text(second)}{separator}{writer.text(first)}", "order")
    if len(node.args) == 1 and isinstance(node.func, ast.Name):
        yield writer.replace(node, f"({writer.text(node.args[0])})", "surplus")


def _quotient_edits(writer: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield `atan2(n, d)` instead of `atan(n / d)`, which has angles of two quadrants only."""
    for node in _expressions(root):
        if not isinstance(node, ast.Call) or len(node.args) != 1:
            continue
        function = writer.text(node.func)
        quotient = node.args[0]
        if function.rpartition(".")[2] not in ("atan", "arctan"):
            continue
        if is_operation(quotient, ast.Div):
            new = f"{function}2({writer.text(quotient.left)}, {writer.text(quotient.right)})"
            yield writer.replace(node, new, "function")


def _sign_edits(writer: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield edits that remove a minus sign, or put one in front of an operand."""
    for node in _expressions(root):
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            yield writer.replace(node, writer.text(node.operand), "sign")
        elif _begins_expression(writer, node):
            yield _negated(writer, node)


def _begins_expression(writer: _Writer, node: ast.expr) -> bool:
    """Return whether a node is the first operand of an expression, in front of which a sign can stand."""
    if not isinstance(node, ast.Name | ast.Call | ast.Subscript | ast.Constant | ast.BinOp | ast.Attribute):
        return False
    parent = writer.parent(node)
    # An index is no value of the row; a negative one counts from the end.
    if isinstance(node, ast.Constant) and isinstance(parent, ast.Subscript | ast.Slice):
        return False
    if isinstance(parent, ast.Tuple) and isinstance(writer.parent(parent), ast.Subscript):
        return False
    if isinstance(parent, ast.Call):
        return node in parent.args
    if isinstance(parent, ast.BinOp):
        return parent.left is node
    return isinstance(parent, ast.Tuple | ast.List | ast.Return | ast.Assign | ast.GeneratorExp | ast.AugAssign)


def _negated(writer: _Writer, node: ast.expr) -> Edit:
    """Return the edit that changes the sign of an operand, written as an author would write it."""
    parent = writer.parent(node)
    start, _ = writer.source.span(node)
    if is_sum(node):
        return writer.replace(node, f"-({writer.text(node)})", "sign")
    if is_operation(parent, ast.Add) and _is_plain(parent.right):  # b - a, not -a + b
        return writer.replace(parent, f"{writer.text(parent.right)} - {writer.text(node)}", "sign")
    if isinstance(node, ast.BinOp):
        return writer.replace(node, f"-{writer.text(node)}", "sign")
    return writer.inserted(start, "-", "sign")


def _is_plain(node: ast.AST) -> bool:
    """Return whether a node can stand before a minus sign without parentheses, and begins without a sign."""
    return isinstance(node, ast.Name | ast.Call | ast.Subscript)


def _operator_edits(writer: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield other operators between two operands."""
    for node in _expressions(root):
        if not isinstance(node, ast.BinOp) or type(node.op) not in _CONFUSED_OPERATORS:
            continue
        sign, others = _CONFUSED_OPERATORS[type(node.op)]
        _, start = writer.source.span(node.left)
        end, _ = writer.source.span(node.right)
        gap = writer.source.text(start, end)
        at = gap.find(sign)  # there may be parentheses before or after the sign
        if at < 0:
            continue
        at_byte = start + len(gap[:at].encode())
        for other_sign in others:
            kind = "operator"
            if {sign, other_sign} == {"+", "-"}:
                kind = "sign"
            yield writer.between(at_byte, at_byte + 1, other_sign, kind)


def _number_edits(writer: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield other numbers instead of each number, and other fractions of pi."""
    for node in _expressions(root):
        # a bool is an int, but no number of an equation
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
            yield from _other_numbers(writer, node, node.value)
    for node in _expressions(root):
        if not isinstance(node, ast.Name) or node.id != "pi":
            continue
        for text in ("(pi / 2)", "(2 * pi)", "0"):
            yield writer.replace(node, text, "number")
        parent = writer.parent(node)
        if is_operation(parent, ast.Div):
            yield writer.replace(parent, "pi", "number")
            yield writer.replace(parent, "0", "number")


def _other_numbers(writer: _Writer, node: ast.Constant, number: float) -> Iterator[Edit]:
    """Yield other numbers instead of a number: another index, exponent, factor or term."""
    parent = writer.parent(node)
    in_index = isinstance(parent, ast.Subscript | ast.Slice)
    if isinstance(parent, ast.Tuple):
        in_index = isinstance(writer.parent(parent), ast.Subscript)
    if in_index:
        for i in range(_TRIED_INDICES):
            yield writer.replace(node, str(i), "index")
        return
    if is_operation(parent, ast.Pow) and parent.right is node:
        yield writer.replace(parent, writer.text(parent.left), "exponent")
        for i in (1, 2, 3, 4):
            yield writer.replace(node, str(i), "exponent")
        return
    others = {number + 1, number - 1, 2 * number, number / 2} | _FREQUENT_NUMBERS
    for other_number in sorted(others - {number}):
        if other_number >= 0:
            yield writer.replace(node, f"{other_number:g}", "number")
    if number in (0, 1):  # a symbol may be missing, which is 0 in a sum and 1 in a product
        for name in sorted(writer.pool.names):
            yield writer.replace(node, name, "missing", writer.need(name))
        for text in ("pi", "pi / 2", "-pi / 2"):
            yield writer.replace(node, text, "number")


def _left_side_edits(writer: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield edits of the index of the symbol on the left side of an implicit row."""
    if root is not writer.statement.node or not isinstance(root, ast.Assign):
        return
    target = root.targets[0]
    if not isinstance(target, ast.Name) or target.id not in writer.source.arguments:
        return
    for other_name in sorted(writer.pool.names - {target.id}):
        if _stem(other_name) == _stem(target.id) and other_name in writer.source.arguments:
            yield writer.replace(target, other_name, "left side")


def _term_edits(writer: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield edits that remove a term or factor, or add a square, a root or a term."""
    for node in _expressions(root):
        if is_operation(node, ast.Add, ast.Sub, ast.Mult, ast.Div, ast.MatMult):
            yield from _without_operand(writer, node)
        end_of_base = _end_of_base(writer, node)
        if end_of_base is not None and not is_operation(writer.parent(node), ast.Pow):
            yield writer.inserted(end_of_base, "**2", "exponent")
        if _is_whole(writer, node):
            _, end = writer.source.span(node)
            if _has_square(node):
                yield from _square_edits(writer, node)
            for name in sorted(writer.pool.names):
                for sign in "+-":
                    yield writer.inserted(end, f" {sign} {name}", "missing", writer.need(name))
        elif _is_inner_sum(writer, node) and _has_square(node):
            yield from _root_edits(writer, node)
        elif isinstance(node, ast.Name) and _is_multiplied(writer, node):
            for name in sorted(writer.pool.names - {node.id}):
                for sign in "+-":
                    yield writer.replace(node, f"({node.id} {sign} {name})", "missing", writer.need(name))


def _without_operand(writer: _Writer, node: ast.BinOp) -> Iterator[Edit]:
    """Yield an operation's left operand alone, and its right one with its sign; a divisor alone is no misprint."""
    yield writer.replace(node, writer.text(node.left), "surplus")
    if isinstance(node.op, ast.Div):
        return
    right = writer.text(node.right)
    if isinstance(node.op, ast.Sub):
        right = f"-{right}"
    yield writer.replace(node, right, "surplus")


def _is_whole(writer: _Writer, node: ast.expr) -> bool:
    """Return whether a node is all that is assigned, returned or passed; of an assigned tuple, its entries are."""
    parent = writer.parent(node)
    if isinstance(parent, ast.Call):
        return node in parent.args
    if isinstance(parent, ast.Tuple):
        return isinstance(writer.parent(parent), ast.Return | ast.Assign)
    return isinstance(parent, ast.Assign | ast.Return) and not isinstance(node, ast.Tuple)


def _end_of_base(writer: _Writer, node: ast.expr) -> int | None:
    """Return the byte after a name, an entry or a parenthesis that may be squared; None for other expressions."""
    parent = writer.parent(node)
    start, end = writer.source.span(node)
    if isinstance(parent, ast.Attribute) or _is_called(writer, node):
        return None
    if isinstance(node, ast.Name):
        return end
    if not isinstance(parent, ast.BinOp):
        return None
    if isinstance(node, ast.Subscript):
        has_slice = any(isinstance(part, ast.Slice) for part in ast.walk(node.slice))
        if has_slice:  # several entries have no square
            return None
        return end
    if is_sum(node):
        enclosed = writer.source.text(start - 1, start) == "(" and writer.source.text(end, end + 1) == ")"
        if enclosed:
            return end + 1
    return None


def _square_edits(writer: _Writer, node: ast.expr) -> Iterator[Edit]:
    """Yield edits of an expression with squares: its square root, and one more square."""
    _, end = writer.source.span(node)
    yield from _root_edits(writer, node)
    for name in sorted(writer.pool.names):
        for sign in "+-":
            yield writer.inserted(end, f" {sign} {name}**2", "missing", writer.need(name))


def _root_edits(writer: _Writer, node: ast.expr) -> Iterator[Edit]:
    """Yield the edits that put an expression under a square root, as the file writes it."""
    names = re.findall(r"(?:\w+\.)?\bsqrt(?=\()", writer.source.data.decode())
    for name in sorted(set(names)):
        yield writer.replace(node, f"{name}({writer.text(node)})", "missing")


def _has_square(node: ast.AST) -> bool:
    return any(is_operation(part, ast.Pow) for part in ast.walk(node))


def _is_multiplied(writer: _Writer, node: ast.AST) -> bool:
    """Return whether a node is what a matrix is multiplied by."""
    parent = writer.parent(node)
    return is_operation(parent, ast.MatMult) and parent.right is node


def _is_inner_sum(writer: _Writer, node: ast.AST) -> bool:
    """Return whether a node is a sum in parentheses inside a sum or product."""
    parent = writer.parent(node)
    if not (is_sum(node) and isinstance(parent, ast.BinOp)):
        return False
    return not (is_operation(parent, *_SUM_OPERATORS, ast.Pow) and parent.left is node)


def _factor_edits(writer: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield edits that add a factor to a term of a sum, or to a whole expression without a sum."""
    names = sorted(writer.pool.names | set(writer.pool.aliases))
    for node in _expressions(root):
        if not (is_operation(writer.parent(node), *_SUM_OPERATORS) or _is_whole(writer, node)):
            continue
        # a factor before a sum would belong to its first term, which is a node of its own
        if isinstance(node, ast.Tuple | ast.UnaryOp) or is_sum(node):
            continue
        start, _ = writer.source.span(node)
        for name in names:
            yield writer.inserted(start, f"{name} * ", "missing", writer.need(name))
        yield writer.inserted(start, "2 * ", "missing")
        yield writer.inserted(start, "0.5 * ", "missing")


def _parenthesis_edits(writer: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield edits of parentheses: move one end, remove a pair, add a pair."""
    start, end = writer.source.span(root)
    if isinstance(root, ast.Return) and root.value is not None:
        start, end = writer.source.span(root.value)
    text = writer.source.text(start, end)
    if not text.isascii():  # the positions below are those of characters, not of bytes
        return
    for first, last, new in other_parentheses(text):
        yield writer.between(start + first, start + last, new, "parenthesis")
