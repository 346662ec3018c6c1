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

_MOST = 24
"""Maximum number of edits of one statement."""

_NUMBERS = {"pi"}
"""Names that always have the same value."""

_Names = Mapping[str, str]
"""Names of the whole expression, with those in the same places of the other expression."""


def counterpart_edits(source: Source, statement: Statement) -> Iterator[Edit]:
    """Yield the edits of a statement that put back what a counterpart elsewhere in the file has more."""
    _, usable = source.names_at(statement)
    parents = parents_of(statement.node)
    unread = sorted(unread_names(source, statement))
    seen: set[tuple[int, int, str]] = set()
    wholes = _roots_of(source.data)
    for node in _roots(statement.node):
        if len(_names(node)) < _FEWEST_NAMES:
            continue
        for whole in wholes:
            for part, counterpart, names in _with_gap(node, whole, {}):
                renamed = any(old != new for old, new in names.items())
                if renamed and len(names) < _FEWEST_RENAMED:
                    continue
                new = _written(source, counterpart, names, usable, unread)
                if new is None:
                    continue
                edit = _replacement(source, statement, part, parents.get(part), new)
                key = (edit.start, edit.end, edit.new)
                if key not in seen:
                    seen.add(key)
                    yield edit
                if len(seen) == _MOST:
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
    return names - _NUMBERS


def _matched(node: ast.AST, whole: ast.AST, names: _Names) -> _Names | None:
    """Return the names with which `whole` becomes `node`, or None; `names` are known already."""
    if type(node) is not type(whole):
        return None
    if isinstance(node, ast.Name) and isinstance(whole, ast.Name):
        return _matched_names(node.id, whole.id, names)
    if isinstance(node, ast.Constant) and isinstance(whole, ast.Constant):
        if node.value != whole.value:
            return None
        return names
    if _called(node) != _called(whole) or _form(node) != _form(whole):
        return None
    operands = _operands(node)
    whole_operands = _operands(whole)
    if len(operands) != len(whole_operands):
        return None
    for one, other in zip(operands, whole_operands, strict=True):
        matched = _matched(one, other, names)
        if matched is None:
            return None
        names = matched
    return names


def _matched_names(name: str, name_of_whole: str, names: _Names) -> _Names | None:
    """Return `names` with a further pair, or None if one of both names has another one already."""
    if name in _NUMBERS or name_of_whole in _NUMBERS:
        return names if name == name_of_whole else None
    if name_of_whole in names:
        return names if names[name_of_whole] == name else None
    if name in names.values():
        return None
    return {**names, name_of_whole: name}


def _with_gap(node: ast.AST, whole: ast.AST, names: _Names) -> Iterator[tuple[ast.expr, ast.expr, _Names]]:
    """Yield (part of `node`, the part of `whole` that has more, names) where leaving that out gives `node`."""
    for shorter in _shorter(whole):
        matched = _matched(node, shorter, names)
        if matched is not None and isinstance(node, ast.expr) and isinstance(whole, ast.expr):
            yield node, whole, matched
    if type(node) is not type(whole) or _called(node) != _called(whole) or _form(node) != _form(whole):
        return
    operands = _operands(node)
    whole_operands = _operands(whole)
    if len(operands) != len(whole_operands):
        return
    for i in range(len(operands)):  # the operand in which something is missing; the others must match
        known: _Names | None = names
        for j in range(len(operands)):
            if j != i and known is not None:
                known = _matched(operands[j], whole_operands[j], known)
        if known is not None:
            yield from _with_gap(operands[i], whole_operands[i], known)


def _shorter(whole: ast.AST) -> list[ast.expr]:
    """Return what an operation becomes without one of its operands, or without itself."""
    if isinstance(whole, ast.BinOp):
        if isinstance(whole.op, ast.Add | ast.Mult):
            return [whole.left, whole.right]
        return [whole.left]
    if isinstance(whole, ast.UnaryOp):
        return [whole.operand]
    if isinstance(whole, ast.Call) and _called(whole).endswith("sqrt") and len(whole.args) == 1:
        return [whole.args[0]]
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


def _written(source: Source, whole: ast.expr, names: _Names, usable: set[str], unread: Sequence[str]) -> str | None:
    """Return the text of `whole` with the names of a statement, or None if one of them has no value there.

    A name that only the missing part has stays as it is, or becomes the only name that nobody reads. Numbers are
    written as in the file.
    """
    if any(isinstance(node, ast.Lambda) for node in ast.walk(whole)):  # its arguments are names of its own
        return None
    replaced = dict(names)
    for name in sorted(_names(whole) - replaced.keys()):
        instead = name
        if name not in usable:
            free = [other for other in unread if other not in replaced.values()]
            if len(free) != 1:
                return None
            instead = free[0]
        if instead in replaced.values():
            return None
        replaced[name] = instead
    renamed = _Renamed(source, replaced)
    text = ast.unparse(renamed.visit(copy.deepcopy(whole)))
    for place, number in renamed.numbers.items():
        text = text.replace(place, number)
    return text


class _Renamed(ast.NodeTransformer):
    """Gives other names to variables, not to functions, attributes and keywords, and keeps the text of numbers."""

    def __init__(self, source: Source, names: _Names) -> None:
        self.source = source
        self.names = names
        self.numbers: dict[str, str] = {}

    def visit_Call(self, node: ast.Call) -> ast.Call:
        """Leave the function as it is."""
        node.args = [self.visit(part) for part in node.args]
        node.keywords = [self.visit(part) for part in node.keywords]
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
        place = f"number_{len(self.numbers)}_of_the_file"
        self.numbers[place] = self.source.text(*self.source.span(node))
        return ast.Name(place, ast.Load())


def _replacement(source: Source, statement: Statement, node: ast.expr, parent: ast.AST | None, new: str) -> Edit:
    start, end = source.span(node)
    if isinstance(parent, ast.BinOp | ast.UnaryOp | ast.Subscript | ast.Attribute):
        new = f"({new})"
    line = source.line_of(start)
    return Edit(source.path, line, start, end, source.text(start, end), new, "missing", statement.index, source.name)
