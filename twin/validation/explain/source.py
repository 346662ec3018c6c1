"""The source of a function of symbols: its statements, where they are in the file, and edits of their text."""

from __future__ import annotations

import ast
import difflib
import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from types import CodeType
from typing import Any

from twin.core.errors import KinematicsError
from twin.validation.explain.tidy import tidy

OUT = "_out_"
"""Name under which a run function leaves what it would return."""


@dataclass(frozen=True)
class Edit:
    """A change of the text of one file.

    Attributes:
        path, line: where; the line counts from 1.
        start, end: bytes of the file that are replaced.
        old, new: what stood there, what stands there now.
        kind: "name", "index", "trig", "sign", "operator", "number", "parenthesis", "missing", "surplus", ...
        statement: index of the statement in its function.
        function: name of that function.
        define: (name, expression) that the new text needs and the function does not have yet, or None.
    """

    path: Path
    line: int
    start: int
    end: int
    old: str
    new: str
    kind: str
    statement: int
    function: str
    define: tuple[str, str] | None = None

    @property
    def text(self) -> str:
        """The edit in one phrase."""
        old, new = self.old.strip(), self.new.strip()
        if not old:
            return f"insert `{new}`"
        return f"{old} -> {new}" if new else f"delete `{old}`"


@dataclass(frozen=True)
class Statement:
    """One top-level statement of a function; `start` and `end` are bytes of the file."""

    index: int
    node: ast.stmt
    start: int
    end: int
    line: int
    column: int
    reads: frozenset[str]
    writes: tuple[str, ...]

    @property
    def returns(self) -> bool:
        """Whether it is the return of the function."""
        return isinstance(self.node, ast.Return)

    def reads_at(self, position: int) -> set[str]:
        """Return the names that one of the values reads, of those that it assigns or returns."""
        value = self.node.value  # type: ignore[attr-defined]
        if isinstance(value, ast.Tuple) and position < len(value.elts):
            value = value.elts[position]
        return {n.id for n in ast.walk(value) if isinstance(n, ast.Name)}


@lru_cache(maxsize=64)
def _parsed(path: str, stamp: tuple[int, int]) -> tuple[bytes, ast.Module, tuple[int, ...]]:
    data = Path(path).read_bytes()
    return data, ast.parse(data, path), tuple(_starts(data))


class Source:
    """The text of one function.

    Attributes:
        path, name: file and name. data: the whole file. node: its definition.
        arguments: names of its arguments. statements: its body without the docstring.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        """Find the source of a function.

        Raises:
            KinematicsError: it has none that can be edited (a lambda, a built-in, a decorated wrapper).
        """
        f = inspect.unwrap(function)
        code = getattr(f, "__code__", None)
        if code is None or not Path(code.co_filename).is_file():
            raise KinematicsError(f"{function!r} has no source file: it cannot be explained")
        self.path = Path(code.co_filename)
        stat = self.path.stat()
        self.data, tree, self._starts = _parsed(str(self.path), (stat.st_mtime_ns, stat.st_size))
        plain = (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef) and n.name == code.co_name)
        node = next((n for n in plain if _first_line(n) == code.co_firstlineno), None)
        if node is None:
            raise KinematicsError(f"{self.path}:{code.co_firstlineno}: '{code.co_name}' is no plain function")
        self.node: ast.FunctionDef = node
        self.name = self.node.name
        a = self.node.args
        self.arguments = tuple(x.arg for x in (*a.posonlyargs, *a.args, *a.kwonlyargs))
        body = self.node.body
        if body and isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant):
            body = body[1:]
        self.statements = tuple(self._statement(i, node) for i, node in enumerate(body))
        inner = [n for s in self.node.body[:-1] for n in ast.walk(s) if isinstance(n, ast.Return)]
        self.plain = bool(body) and isinstance(body[-1], ast.Return) and not inner

    def _statement(self, index: int, node: ast.stmt) -> Statement:
        start, end = self.span(node)
        reads = {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)}
        loops = [n.target for n in ast.walk(node) if isinstance(n, ast.comprehension | ast.For)]
        reads -= {n.id for target in loops for n in ast.walk(target) if isinstance(n, ast.Name)}
        writes = [n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
        calls = {  # out += [...], out.append(...): the name is read and written
            n.value.id for n in ast.walk(node) if isinstance(n, ast.Attribute) and isinstance(n.value, ast.Name)
        }
        if isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Name):
            reads.add(node.target.id)
        if isinstance(node, ast.Expr | ast.For):
            writes += sorted(calls)
        for n in ast.walk(node):  # q[i] = ...: part of what the name holds is written
            if isinstance(n, ast.Subscript) and isinstance(n.ctx, ast.Store) and isinstance(n.value, ast.Name):
                writes.append(n.value.id)
        return Statement(
            index, node, start, end, node.lineno, node.col_offset, frozenset(reads), tuple(dict.fromkeys(writes))
        )

    def span(self, node: ast.AST) -> tuple[int, int]:
        """Return first and last byte of a node of this file."""
        start = self._starts[node.lineno - 1] + node.col_offset  # type: ignore[attr-defined]
        return start, self._starts[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]

    def line_of(self, offset: int) -> int:
        """Return the line, from 1, of a byte."""
        return int(self.data.count(b"\n", 0, offset)) + 1

    def text(self, start: int, end: int) -> str:
        """Return a part of the file."""
        return self.data[start:end].decode()

    def edited(self, statement: Statement, edits: Iterable[Edit] = ()) -> str:
        """Return the text of a statement after edits of it."""
        return apply(self.data, edits, statement.start, statement.end)

    def compiled(self, statement: Statement, edits: Iterable[Edit] = ()) -> CodeType:
        """Return code of a statement to be run in one dictionary; a return leaves its value in `OUT`.

        Raises:
            SyntaxError: the edits make no Python.
        """
        text = self.edited(statement, edits)
        if statement.returns:
            text = f"{OUT} = ({text[len('return') :].strip()}\n)"
        elif statement.line != statement.node.end_lineno or isinstance(statement.node, ast.For | ast.If):
            text = "if 1:\n" + " " * max(statement.column, 1) + text
        return _code(text, self.path)

    def whole(self, edits: Iterable[Edit] = ()) -> CodeType:
        """Return code that defines the function anew after edits; the function is at the top level of its file.

        Raises:
            SyntaxError: the edits make no Python.
        """
        return _code(apply(self.data, edits, *self.span(self.node)), self.path)


@lru_cache(maxsize=4096)
def _code(text: str, path: Path) -> CodeType:
    """Return compiled text; one edit is tried beside many others."""
    return compile(text, f"{path}", "exec")


def _first_line(node: ast.FunctionDef) -> int:
    return min([node.lineno, *(d.lineno for d in node.decorator_list)])


def apply(data: bytes, edits: Iterable[Edit], start: int, end: int) -> str:
    """Return bytes start..end of a file after edits within them."""
    out, at = [], start
    for e in sorted(edits, key=lambda e: (e.start, e.end)):
        out += [data[at : e.start], e.new.encode()]
        at = e.end
    return b"".join([*out, data[at:end]]).decode()


def patched(edits: Iterable[Edit]) -> str:
    """Return the whole file after edits of it; what they need is defined as well."""
    edits = list(dict.fromkeys(edits))
    data = edits[0].path.read_bytes()
    extra = {d for e in edits if e.define for d in definitions(data, e)}
    return apply(data, [*finished(data, edits), *extra], 0, len(data))


def finished(data: bytes, edits: list[Edit]) -> list[Edit]:
    """Return edits of a file that lead to the same statements, tidied."""
    tree = _tree(data)
    starts = _starts(data)

    def span(node: ast.stmt) -> tuple[int, int]:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset

    simple = [s for s in ast.walk(tree) if isinstance(s, ast.Assign | ast.AugAssign | ast.Return | ast.Expr)]
    out, left = [], list(edits)
    for statement in simple:
        start, end = span(statement)
        mine = [e for e in left if start <= e.start and e.end <= end]
        if not mine:
            continue
        left = [e for e in left if e not in mine]
        text, made, shift = apply(data, mine, start, end).encode(), [], 0
        for e in sorted(mine, key=lambda e: (e.start, e.end)):
            new = len(e.new.encode())
            made.append((e.start - start + shift, e.start - start + shift + new))
            shift += new - (e.end - e.start)
        new = tidy(text, made)
        whole = replace(mine[0], start=start, end=end, old=data[start:end].decode(), new=new.decode(), define=None)
        out += mine if new == text else [whole]
    return out + left


@lru_cache(maxsize=8)
def _tree(data: bytes) -> ast.Module:
    return ast.parse(data)


def _starts(data: bytes) -> list[int]:
    out = [0]
    for line in data.splitlines(keepends=True):
        out.append(out[-1] + len(line))
    return out


def diff(edits: Iterable[Edit], shown: str | None = None) -> str:
    """Return the unified diff of edits of one file, without context; what they need is defined as well.

    Args:
        edits: of one file.
        shown: name of the file in the head; default its path.
    """
    edits = list(edits)
    old, name = edits[0].path.read_text(encoding="utf-8"), shown or str(edits[0].path)
    return "\n".join(difflib.unified_diff(old.splitlines(), patched(edits).splitlines(), name, name, n=0, lineterm=""))


def definitions(data: bytes, edit: Edit) -> list[Edit]:
    """Return the edits that define what an edit needs: an alias beside its like, or one more argument."""
    assert edit.define is not None
    name, expression = edit.define
    tree = _tree(data)
    starts = _starts(data)

    def end(node: ast.AST) -> int:
        return starts[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]

    for f in ast.walk(tree):
        if not (isinstance(f, ast.FunctionDef) and f.name == edit.function and f.lineno <= edit.line <= f.end_lineno):  # type: ignore[operator]
            continue
        if not expression:
            last = f.args.args[-1]
            return [_insertion(edit, end(last), f", {name}", last.lineno)]
        for s in f.body:
            if not (isinstance(s, ast.Assign) and s.lineno < edit.line):
                continue
            target, value = s.targets[0], s.value
            values = value.elts if isinstance(value, ast.Tuple) else [value]
            like = expression.split("(")[0]
            if any(isinstance(v, ast.Call) and getattr(v.func, "id", "") == like for v in values):
                return [
                    _insertion(edit, end(target), f", {name}", s.lineno),
                    _insertion(edit, end(value), f", {expression}", s.lineno),
                ]
    return []


def _insertion(edit: Edit, at: int, new: str, line: int) -> Edit:
    return Edit(edit.path, line, at, at, "", new, "definition", -1, edit.function)
