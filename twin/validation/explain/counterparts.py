"""Find expressions that stand whole elsewhere in the file: what they have more is likely to be missing here.

Two expressions are counterparts if one becomes the other by omission of a term, a factor, a square, a root or a sign,
and by writing other names. The edit that puts this part back is tried first, alone and beside other edits.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache

from twin.validation.explain.analogies import unread_names
from twin.validation.explain.function_source import Edit, Source, Statement
from twin.validation.explain.tokens import parents_of

_FEWEST_NAMES = 2
"""Minimum number of different names of an expression, so that its form means something."""

_FEWEST_RENAMED = 3
"""The same if the counterpart has other names."""

_MOST_EDITS = 24
"""Maximum number of edits of one statement."""

_NUMBER_NAMES = {"pi"}
"""Names that always have the same value."""

_Names = Mapping[str, str]
"""Names of the longer expression, with those in the same places of the shorter one: {name: name there}."""


def counterpart_edits(source: Source, statement: Statement) -> Iterator[Edit]:
    """Yield the edits of a statement that put back what a counterpart elsewhere in the file has more."""
    _, usable = source.names_at(statement)
    parents = parents_of(statement.node)
    unread = sorted(unread_names(source, statement))
    yielded: set[tuple[int, int, str]] = set()
    roots_of_file = _roots_of(source.data)
    for node in _roots(statement.node):
        if len(_names(node)) < _FEWEST_NAMES:
            continue
        for root in roots_of_file:
            for part, counterpart, names in _with_gap(node, root, {}):
                is_renamed = list(names.keys()) != list(names.values())
                # With other names, a short form such as a * b has counterparts everywhere.
                if is_renamed and len(names) < _FEWEST_RENAMED:
                    continue
                new = _written(source, counterpart, names, usable, unread)
                if new is None:
                    continue
                edit = _replacement(source, statement, part, parents.get(part), new)
                key = (edit.start, edit.end, edit.new)
                if key not in yielded:
                    yielded.add(key)
                    yield edit
                if len(yielded) == _MOST_EDITS:
                    return


@lru_cache(maxsize=16)
def _roots_of(data: bytes) -> tuple[ast.expr, ...]:
    """Return the roots of the functions of a file, each text once."""
    roots: dict[str, ast.expr] = {}
    for function in ast.parse(data).body:
        if isinstance(function, ast.FunctionDef):
            for statement in function.body:
                for node in _roots(statement):
                    roots.setdefault(ast.unparse(node), node)
    return tuple(roots.values())


def _roots(statement: ast.AST) -> Iterator[ast.expr]:
    """Yield the sums, products, powers and calls of a statement that are no operand of another operation."""
    operations = (ast.BinOp, ast.UnaryOp)
    todo: list[tuple[ast.AST, bool]] = [(statement, False)]
    while todo:
        node, is_operand = todo.pop()
        if isinstance(node, (*operations, ast.Call)) and not is_operand:
            yield node
        for child in ast.iter_child_nodes(node):
            todo.append((child, isinstance(node, operations)))


def _names(node: ast.AST) -> set[str]:
    """Return the names in an expression, without those of functions and numbers."""
    names: set[str] = set()
    todo = [node]
    while todo:
        part = todo.pop()
        if isinstance(part, ast.Name):
            names.add(part.id)
        todo += _operands(part)
    return names - _NUMBER_NAMES


def _matched(node: ast.AST, longer: ast.AST, names: _Names) -> _Names | None:
    """Return the names with which `longer` becomes `node`, or None; `names` are matched already."""
    if isinstance(node, ast.Name) and isinstance(longer, ast.Name):
        return _matched_names(node.id, longer.id, names)
    if isinstance(node, ast.Constant) and isinstance(longer, ast.Constant):
        if node.value != longer.value:
            return None
        return names
    if not _is_same_operation(node, longer):
        return None
    for operand, longer_operand in zip(_operands(node), _operands(longer), strict=True):
        matched = _matched(operand, longer_operand, names)
        if matched is None:
            return None
        names = matched
    return names


def _is_same_operation(node: ast.AST, other: ast.AST) -> bool:
    """Return whether two syntax nodes differ at most in their operands, of which both have as many."""
    if type(node) is not type(other) or _called(node) != _called(other):
        return False
    return _form(node) == _form(other) and len(_operands(node)) == len(_operands(other))


def _matched_names(name: str, longer_name: str, names: _Names) -> _Names | None:
    """Return `names` with a further pair, or None if one of both names has another one already."""
    is_number = name in _NUMBER_NAMES or longer_name in _NUMBER_NAMES
    if is_number and name == longer_name:
        return names
    if longer_name in names and names[longer_name] == name:
        return names
    if is_number or longer_name in names or name in names.values():
        return None
    return {**names, longer_name: name}


def _with_gap(node: ast.AST, longer: ast.AST, names: _Names) -> Iterator[tuple[ast.expr, ast.expr, _Names]]:
    """Yield (part of `node`, the part of `longer` that has more, names) where leaving that out gives `node`."""
    for shorter in _shorter(longer):
        matched = _matched(node, shorter, names)
        if matched is not None and isinstance(node, ast.expr) and isinstance(longer, ast.expr):
            yield node, longer, matched
    if not _is_same_operation(node, longer):
        return
    operands = _operands(node)
    longer_operands = _operands(longer)
    for i in range(len(operands)):  # the operand in which something is missing; the others must match
        matched_names: _Names | None = names
        for j in range(len(operands)):
            if j != i and matched_names is not None:
                matched_names = _matched(operands[j], longer_operands[j], matched_names)
        if matched_names is not None:
            yield from _with_gap(operands[i], longer_operands[i], matched_names)


def _shorter(node: ast.AST) -> list[ast.expr]:
    """Return what an operation becomes without one of its operands, or without itself."""
    if isinstance(node, ast.BinOp):
        if isinstance(node.op, ast.Add | ast.Mult):
            return [node.left, node.right]
        return [node.left]  # a divisor, subtrahend or exponent alone has another meaning
    if isinstance(node, ast.UnaryOp):
        return [node.operand]
    if isinstance(node, ast.Call) and _called(node).endswith("sqrt") and len(node.args) == 1:
        return [node.args[0]]
    return []


def _called(node: ast.AST) -> str:
    """Return the text of the function that a call calls; "" for other nodes."""
    if not isinstance(node, ast.Call):
        return ""
    return ast.unparse(node.func)


def _form(node: ast.AST) -> list[tuple[str, object]]:
    """Return what a node has beside its operands: attributes, keywords, and which parts of it there are."""
    form: list[tuple[str, object]] = []
    for name, value in ast.iter_fields(node):
        if isinstance(value, list):
            form.append((name, len(value)))
        elif isinstance(value, ast.expr_context):
            form.append((name, type(value)))
        elif isinstance(value, ast.AST):
            form.append((name, ast.AST))
        elif not isinstance(node, ast.Name | ast.Constant):
            form.append((name, value))
    return form


def _operands(node: ast.AST) -> list[ast.AST]:
    """Return the parts of an expression that may have other names; the name of a called function may not."""
    if isinstance(node, ast.Call):
        return [*node.args, *node.keywords]
    return list(ast.iter_child_nodes(node))


def _written(
    source: Source, counterpart: ast.expr, names: _Names, usable: set[str], unread: Sequence[str]
) -> str | None:
    """Return the text of `counterpart` with the names of a statement, or None if one of them has no value there.

    A name that only the missing part has stays as it is, or becomes the only name that nobody reads. Numbers are
    written as in the file.
    """
    for node in ast.walk(counterpart):
        if isinstance(node, ast.Lambda):  # its arguments are names of its own
            return None
    new_names = dict(names)
    for name in sorted(_names(counterpart) - new_names.keys()):
        new_name = name
        if name not in usable:
            still_unread = set(unread).difference(new_names.values())
            if len(still_unread) != 1:  # with several, any of them would be a guess
                return None
            (new_name,) = still_unread
        if new_name in new_names.values():
            return None
        new_names[name] = new_name
    renamer = _Renamer(source, new_names)
    text = ast.unparse(renamer.visit(copy.deepcopy(counterpart)))
    for placeholder, number in renamer.numbers.items():
        text = text.replace(placeholder, number)
    return text


class _Renamer(ast.NodeTransformer):
    """Gives other names to variables, not to functions, attributes and keywords, and keeps the text of numbers."""

    def __init__(self, source: Source, names: _Names) -> None:
        self.source = source
        self.names = names
        self.numbers: dict[str, str] = {}

    def visit_Call(self, node: ast.Call) -> ast.Call:
        """Leave the function as it is."""
        for i, argument in enumerate(node.args):
            node.args[i] = self.visit(argument)
        for i, keyword in enumerate(node.keywords):
            node.keywords[i] = self.visit(keyword)
        return node

    def visit_Name(self, node: ast.Name) -> ast.Name:
        """Give a variable its other name."""
        return ast.Name(self.names.get(node.id, node.id), node.ctx)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.JoinedStr:
        """Leave a text as it is."""
        return node

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        """Return a name in the place of a number, which `ast.unparse` would write in another way."""
        if isinstance(node.value, bool) or not isinstance(node.value, int | float | complex):
            return node
        placeholder = f"number_{len(self.numbers)}_of_the_file"
        self.numbers[placeholder] = self.source.text(*self.source.span(node))
        return ast.Name(placeholder, ast.Load())


def _replacement(source: Source, statement: Statement, node: ast.expr, parent: ast.AST | None, new: str) -> Edit:
    """Return the edit that replaces an expression, in parentheses where it is an operand of its parent."""
    if isinstance(parent, ast.BinOp | ast.UnaryOp | ast.Subscript | ast.Attribute):
        new = f"({new})"
    return source.edit_of(statement, source.span(node), new, "missing")
