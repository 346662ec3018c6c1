"""Source of a formula function: its statements, their positions in the file, and edits of their text."""

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

from twin.formula.equations import EquationRow, definition, rows
from twin.formula.loader import text_of
from twin.validation.explain.tidy import tidy
from twin.validation.explain.tokens import line_starts, span

_BRANCHES = "the function returns from within a branch or a loop"

OUT = "_out_"
"""Name under which an executed function stores its return value."""


@dataclass(frozen=True)
class Edit:
    """One replacement in the text of a file.

    Attributes:
        path, line: file and line (from 1).
        start, end: range of bytes of the file that is replaced.
        old, new: old and new text.
        kind: "name", "index", "trig", "sign", "operator", "number", "parenthesis", "missing", "surplus", ...
        statement: index of the statement in its function.
        function: name of the function.
        define: (name, expression) of a definition that the new text requires, or None.
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
        """The edit as a short phrase."""
        old, new = self.old.strip(), self.new.strip()
        if not old:
            return f"insert `{new}`"
        return f"{old} -> {new}" if new else f"delete `{old}`"


@dataclass(frozen=True)
class Statement:
    """One top-level statement of a function, in the bytes `start` to `end` of the file.

    `home` is the function definition that contains the statement. `new`: whether only statements in the same definition
    may use the result of the statement. This is true for rows that a variant adds to the rows of another function
    (`twin.formula.equations`).
    """

    index: int
    node: ast.stmt
    start: int
    end: int
    line: int
    column: int
    reads: frozenset[str]
    writes: tuple[str, ...]
    home: ast.FunctionDef
    new: bool = False

    @property
    def returns(self) -> bool:
        """Whether the statement is a return statement."""
        return isinstance(self.node, ast.Return)

    def reads_at(self, position: int) -> set[str]:
        """Return the names that are used for the value at one position of an assignment or return."""
        value = self.node.value  # type: ignore[attr-defined]
        if isinstance(value, ast.Tuple) and position < len(value.elts):
            value = value.elts[position]
        return {n.id for n in ast.walk(value) if isinstance(n, ast.Name)}


class Source:
    """Text of one function.

    Attributes:
        path, name: file, and name of the function.
        data: bytes of the whole file.
        node: definition of the function.
        arguments: names of the arguments.
        statements: statements of the body without the docstring.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        """Read the source of a function.

        Raises:
            KinematicsError: the function has no editable source (a lambda, a built-in, a decorated wrapper).
        """
        body = rows(function)
        f = inspect.unwrap(function)
        self.path = Path(f.__code__.co_filename)  # type: ignore[attr-defined]
        self.data = text_of(self.path, f.__globals__)  # type: ignore[attr-defined]
        self._starts = line_starts(self.data)
        self.node = definition(function)
        self.name = self.node.name
        code = f.__code__  # type: ignore[attr-defined]
        self.arguments = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        self.statements = tuple(self._statement(i, row) for i, row in enumerate(body))
        inner = [n for row in body[:-1] for n in ast.walk(row.node) if isinstance(n, ast.Return)]
        self.plain = bool(body) and isinstance(body[-1].node, ast.Return) and not inner
        defined = [n for row in body for n in ast.walk(row.node) if isinstance(n, ast.FunctionDef)]
        self.why = _BRANCHES
        if defined:
            self.why = f"the function defines {defined[0].name}() inside; define {defined[0].name}() outside"

    def names_at(self, statement: Statement) -> tuple[set[str], set[str]]:
        """Return (names with a value before a statement, those of these names that the statement can use).

        If the statement is in a variant, the second set is smaller: a variant can only use its arguments, and names
        that it assigns before the statement. Otherwise the sets are equal.
        """
        before = [s for s in self.statements[: statement.index] if not s.new or s.home is statement.home]
        own = {a.arg for a in ast.walk(statement.home.args) if isinstance(a, ast.arg)}
        there = {w for s in before for w in s.writes} | own
        if statement.home is not self.statements[-1].home:  # a variant's row: other symbols become its arguments
            return there, own | {w for s in before if s.home is statement.home for w in s.writes}
        return there, there

    def _statement(self, index: int, row: EquationRow) -> Statement:
        node = row.node
        start, end = self.span(node)
        reads = {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)}
        loops = [n.target for n in ast.walk(node) if isinstance(n, ast.comprehension | ast.For)]
        reads -= {n.id for target in loops for n in ast.walk(target) if isinstance(n, ast.Name)}
        writes = [n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
        calls = {  # out += [...], out.append(...): the name is both used and assigned
            n.value.id for n in ast.walk(node) if isinstance(n, ast.Attribute) and isinstance(n.value, ast.Name)
        }
        if isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Name):
            reads.add(node.target.id)
        if isinstance(node, ast.Expr | ast.For):
            writes += sorted(calls)
        for n in ast.walk(node):  # q[i] = ...: an entry of the variable is assigned
            if isinstance(n, ast.Subscript) and isinstance(n.ctx, ast.Store) and isinstance(n.value, ast.Name):
                writes.append(n.value.id)
        reading, writing = frozenset(reads), tuple(dict.fromkeys(writes))
        return Statement(index, node, start, end, node.lineno, node.col_offset, reading, writing, row.home, row.new)

    def span(self, node: ast.AST) -> tuple[int, int]:
        """Return (first byte, end byte) of a syntax node of this file."""
        return span(node, self._starts)

    def line_of(self, offset: int) -> int:
        """Return the line (from 1) of a byte offset."""
        return int(self.data.count(b"\n", 0, offset)) + 1

    def text(self, start: int, end: int) -> str:
        """Return the bytes `start` to `end` of the file as text."""
        return self.data[start:end].decode()

    def edited(self, statement: Statement, edits: Iterable[Edit] = ()) -> str:
        """Return the text of a statement after its edits."""
        return apply(self.data, edits, statement.start, statement.end)

    def compiled(self, statement: Statement, edits: Iterable[Edit] = ()) -> CodeType:
        """Return a statement compiled for execution in one dictionary; a return stores its value under `OUT`.

        Raises:
            SyntaxError: the edited text is not valid Python.
        """
        text = self.edited(statement, edits)
        if statement.returns:
            text = f"{OUT} = ({text[len('return') :].strip()}\n)"
        elif statement.line != statement.node.end_lineno or isinstance(statement.node, ast.For | ast.If):
            text = "if 1:\n" + " " * max(statement.column, 1) + text
        return _code(text, self.path)

    def whole(self, edits: Iterable[Edit] = ()) -> CodeType:
        """Return code that redefines the function after edits; the function must be at the top level of its file.

        Raises:
            SyntaxError: the edited text is not valid Python, or the function is a variant (its text is in several
                places).
        """
        if any(s.home is not self.node for s in self.statements):
            raise SyntaxError(f"{self.name}() changes rows of another function")
        return _code(apply(self.data, edits, *self.span(self.node)), self.path)


@lru_cache(maxsize=4096)
def _code(text: str, path: Path) -> CodeType:
    """Compile a text; the result is cached, because the same text occurs in many combinations of edits."""
    return compile(text, f"{path}", "exec")


def apply(data: bytes, edits: Iterable[Edit], start: int, end: int) -> str:
    """Return the bytes `start` to `end` of a file as text, after the edits in this range."""
    out, at = [], start
    for e in sorted(edits, key=lambda e: (e.start, e.end)):
        out += [data[at : e.start], e.new.encode()]
        at = e.end
    return b"".join([*out, data[at:end]]).decode()


def patched(edits: Iterable[Edit]) -> str:
    """Return the whole file after edits, including the definitions that the edits require."""
    edits = list(dict.fromkeys(edits))
    data = edits[0].path.read_bytes()
    extra = {d for e in edits if e.define for d in definitions(data, e)}
    return apply(data, [*finished(data, edits), *extra], 0, len(data))


def finished(data: bytes, edits: list[Edit]) -> list[Edit]:
    """Return edits that have the effect of `edits` and also tidy the edited statements."""
    starts = line_starts(data)
    simple = [s for s in ast.walk(_tree(data)) if isinstance(s, ast.Assign | ast.AugAssign | ast.Return | ast.Expr)]
    out, left = [], list(edits)
    for statement in simple:
        start, end = span(statement, starts)
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


def diff(edits: Iterable[Edit], shown: str | None = None) -> str:
    """Return the unified diff of edits of one file, without context, including the definitions that they require.

    `shown` is the file name in the header of the diff; None: the path.
    """
    edits = list(edits)
    old, name = edits[0].path.read_text(encoding="utf-8"), shown or str(edits[0].path)
    return "\n".join(difflib.unified_diff(old.splitlines(), patched(edits).splitlines(), name, name, n=0, lineterm=""))


def definitions(data: bytes, edit: Edit) -> list[Edit]:
    """Return the edits that insert a required definition: an alias next to similar aliases, or a new argument."""
    assert edit.define is not None
    name, expression = edit.define
    starts = line_starts(data)
    around = [f for f in ast.walk(_tree(data)) if isinstance(f, ast.FunctionDef)]
    around = [f for f in around if f.lineno <= edit.line <= f.end_lineno]  # type: ignore[operator]
    for f in [f for f in around if f.name == edit.function] or around:  # a shared row is in another function
        if not expression:
            last = f.args.args[-1]
            return [_insertion(edit, span(last, starts)[1], f", {name}", last.lineno)]
        for s in f.body:
            if not (isinstance(s, ast.Assign) and s.lineno < edit.line):
                continue
            target, value = s.targets[0], s.value
            values = value.elts if isinstance(value, ast.Tuple) else [value]
            like = expression.split("(")[0]
            if any(isinstance(v, ast.Call) and getattr(v.func, "id", "") == like for v in values):
                return [
                    _insertion(edit, span(target, starts)[1], f", {name}", s.lineno),
                    _insertion(edit, span(value, starts)[1], f", {expression}", s.lineno),
                ]
    return []


def _insertion(edit: Edit, at: int, new: str, line: int) -> Edit:
    return Edit(edit.path, line, at, at, "", new, "definition", -1, edit.function)
