"""Source of a formula function: its statements, their positions in the file, and edits of their text."""

from __future__ import annotations

import ast
import difflib
import inspect
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from types import CodeType

from twin.formula.loader import text_of
from twin.formula.variant_rows import EquationRow, equation_rows, function_definition
from twin.validation.explain import augmented_assignments
from twin.validation.explain.edit_tidying import tidy
from twin.validation.explain.tokens import line_starts, span

_BRANCHES_REASON = "the function returns from within a branch or a loop"

_AUGMENTED_SIGN = re.compile(r"[-+*/@%]=")
"""Signs of augmented assignments, which few statements have."""

ByteRange = tuple[int, int]
"""First byte and end of a part of a file."""

TextPlace = tuple[Path, int, int]
"""File, first byte and end of an expression."""

RETURN_NAME = "_out_"
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

    def replaces(self, part: ByteRange) -> bool:
        """Return whether the edit replaces a part of its file."""
        start, end = part
        return self.start <= start and end <= self.end

    def is_within(self, part: ByteRange) -> bool:
        """Return whether the replaced text is in a part of its file, or, of an insertion, at its border."""
        start, end = part
        return start <= self.start and self.end <= end

    def is_of(self, source: Source) -> bool:
        """Return whether the edit is in the text of a function, not in that of a function that it calls."""
        return (self.path, self.function) == (source.path, source.name)

    @property
    def text(self) -> str:
        """The edit as a short phrase."""
        old = self.old.strip()
        new = self.new.strip()
        if not old:
            return f"insert `{new}`"
        if not new:
            return f"delete `{old}`"
        return f"{old} -> {new}"


@dataclass(frozen=True)
class Statement:
    """One top-level statement of a function, in the bytes `start` to `end` of the file.

    `home` is the function definition that contains the statement. `new`: whether only statements in the same definition
    may use the result of the statement. This is true for rows that a variant adds to the rows of another function
    (`twin.formula.variant_rows`).
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
        return _names_in_contexts(value, ast.Load, ast.Store)


def _names_in_contexts(node: ast.AST, *contexts: type[ast.expr_context]) -> set[str]:
    """Return the names in a syntax tree that are used in one of the given contexts."""
    names: set[str] = set()
    for part in ast.walk(node):
        if isinstance(part, ast.Name) and isinstance(part.ctx, contexts):
            names.add(part.id)
    return names


def comprehension_targets(node: ast.AST) -> dict[str, list[ast.Name]]:
    """Return the loop variables of comprehensions, which have a value only there, with their targets in the tree."""
    targets: dict[str, list[ast.Name]] = {}
    for inner in ast.walk(node):
        if not isinstance(inner, ast.comprehension):
            continue
        for target in ast.walk(inner.target):
            if isinstance(target, ast.Name):
                targets.setdefault(target.id, []).append(target)
    return targets


class Source:
    """Text of one function.

    Attributes:
        path, name: file, and name of the function.
        data: bytes of the whole file.
        node: definition of the function.
        arguments: names of the arguments.
        statements: statements of the body without the docstring.
    """

    def __init__(self, function: Callable[..., object]) -> None:
        """Read the source of a function.

        Raises:
            KinematicsError: the function has no editable source (a lambda, a built-in, a decorated wrapper).
        """
        body = equation_rows(function)
        unwrapped = inspect.unwrap(function)
        code = unwrapped.__code__  # type: ignore[attr-defined]
        module_globals = unwrapped.__globals__  # type: ignore[attr-defined]
        self.path = Path(code.co_filename)
        self.data = text_of(self.path, module_globals)
        self._starts = line_starts(self.data)
        self._casadi = augmented_assignments.uses_casadi(module_globals)
        self.node = function_definition(function)
        self.name = self.node.name
        self.arguments = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        statements: list[Statement] = []
        for i, row in enumerate(body):
            statements.append(self._statement(i, row))
        self.statements = tuple(statements)
        self.can_be_split = bool(body) and isinstance(body[-1].node, ast.Return)
        self.why_not_split = _BRANCHES_REASON
        for row in body:
            for node in ast.walk(row.node):
                if isinstance(node, ast.Return) and row is not body[-1]:
                    self.can_be_split = False
                if isinstance(node, ast.FunctionDef) and self.why_not_split is _BRANCHES_REASON:
                    self.why_not_split = f"the function defines {node.name}() inside; define {node.name}() outside"

    def names_at(self, statement: Statement) -> tuple[set[str], set[str]]:
        """Return (names with a value before a statement, those of these names that the statement can use).

        If the statement is in a variant, the second set is smaller: a variant can only use its arguments, and names
        that it assigns before the statement. Otherwise the sets are equal.
        """
        usable: set[str] = set()
        for node in ast.walk(statement.home.args):
            if isinstance(node, ast.arg):
                usable.add(node.arg)
        valued = set(usable)
        for earlier in self.statements[: statement.index]:
            in_home = earlier.home is statement.home
            if in_home:
                usable.update(earlier.writes)
            if in_home or not earlier.new:
                valued.update(earlier.writes)
        if statement.home is not self.statements[-1].home:  # a variant's row: other symbols become its arguments
            return valued, usable
        return valued, valued

    def _statement(self, index: int, row: EquationRow) -> Statement:
        """Return a top-level statement with the names that it reads, and those that it assigns or changes in place."""
        node = row.node
        start, end = self.span(node)
        reads = _names_in_contexts(node, ast.Load)
        writes: dict[str, None] = {}  # in the order of the text
        called: set[str] = set()
        entries: dict[str, None] = {}
        targets: set[int] = set()  # by identity: the same name may also be assigned elsewhere in the statement
        for names in comprehension_targets(node).values():
            targets.update(map(id, names))
        for part in ast.walk(node):
            if isinstance(part, ast.comprehension | ast.For):  # a loop variable is no symbol of the function
                reads -= _names_in_contexts(part.target, ast.Load, ast.Store)
            if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store) and id(part) not in targets:
                writes[part.id] = None
            if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name):
                called.add(part.value.id)
            if isinstance(part, ast.Subscript) and isinstance(part.ctx, ast.Store) and isinstance(part.value, ast.Name):
                entries[part.value.id] = None  # q[i] = ...: an entry of the variable is assigned
        if isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Name):  # out += ...: also used
            reads.add(node.target.id)
        if isinstance(node, ast.Expr | ast.For):  # out.append(...): assigned
            writes |= dict.fromkeys(sorted(called))
        return Statement(
            index=index,
            node=node,
            start=start,
            end=end,
            line=node.lineno,
            column=node.col_offset,
            reads=frozenset(reads),
            writes=tuple(writes | entries),
            home=row.definition,
            new=row.is_added,
        )

    def span(self, node: ast.AST) -> tuple[int, int]:
        """Return (first byte, end byte) of a syntax node of this file."""
        return span(node, self._starts)

    def edit_of(
        self, statement: Statement, part: ByteRange, new: str, kind: str, define: tuple[str, str] | None = None
    ) -> Edit:
        """Return the edit that replaces a part of the text of a statement; for `kind` and `define`, see `Edit`."""
        start, end = part
        return Edit(
            path=self.path,
            line=self.line_of(start),
            start=start,
            end=end,
            old=self.text(start, end),
            new=new,
            kind=kind,
            statement=statement.index,
            function=self.name,
            define=define,
        )

    def line_of(self, offset: int) -> int:
        """Return the line (from 1) of a byte offset."""
        return int(self.data.count(b"\n", 0, offset)) + 1

    def text(self, start: int, end: int) -> str:
        """Return the bytes `start` to `end` of the file as text."""
        return self.data[start:end].decode()

    def edited(self, statement: Statement, edits: Iterable[Edit] = ()) -> str:
        """Return the text of a statement after its edits."""
        return text_after_edits(self.data, edits, statement.start, statement.end)

    def compiled(self, statement: Statement, edits: Iterable[Edit] = ()) -> CodeType:
        """Return a statement compiled for execution in one dictionary; a return stores its value under `RETURN_NAME`.

        Raises:
            SyntaxError: the edited text is not valid Python.
        """
        text = self.edited(statement, edits)
        has_lines = statement.line != statement.node.end_lineno or isinstance(statement.node, ast.For | ast.If)
        if statement.returns:
            text = f"{RETURN_NAME} = ({text[len('return') :].strip()}\n)"
        elif has_lines:  # further lines are indented as in the function
            text = "if 1:\n" + " " * max(statement.column, 1) + text
        return _compiled(text, self.path, self._casadi)

    def elements(self, statement: Statement, edits: Iterable[Edit] = ()) -> list[CodeType]:
        """Return the elements of the tuple that a statement returns, each compiled as `compiled` does.

        The list is empty if the statement returns no tuple of plain elements.

        Raises:
            SyntaxError: the edited text is not valid Python.
        """
        if not statement.returns:
            return []
        text = f"({self.edited(statement, edits)[len('return') :].strip()}\n)"
        value = ast.parse(text, mode="eval").body
        codes: list[CodeType] = []
        if not isinstance(value, ast.Tuple):
            return codes
        for element in value.elts:
            if isinstance(element, ast.Starred):  # it stands for any number of outputs
                return []
            assignment = f"{RETURN_NAME} = ({ast.get_source_segment(text, element)}\n)"
            codes.append(_compiled(assignment, self.path, self._casadi))
        return codes

    def whole(self, edits: Iterable[Edit] = ()) -> CodeType:
        """Return code that redefines the function after edits; the function must be at the top level of its file.

        Raises:
            SyntaxError: the edited text is not valid Python, or the function is a variant (its text is in several
                places).
        """
        for statement in self.statements:
            if statement.home is not self.node:
                raise SyntaxError(f"{self.name}() changes rows of another function")
        return _compiled(text_after_edits(self.data, edits, *self.span(self.node)), self.path, self._casadi)


@lru_cache(maxsize=4096)
def _compiled(text: str, path: Path, casadi: bool) -> CodeType:
    """Compile a text; the result is cached, because the same text occurs in many combinations of edits.

    `casadi`: whether the text is run as CasADi runs it; see `augmented`.
    """
    if casadi and _AUGMENTED_SIGN.search(text):
        return augmented_assignments.compiled(text, f"{path}")
    return compile(text, f"{path}", "exec")


def text_after_edits(data: bytes, edits: Iterable[Edit], start: int, end: int) -> str:
    """Return the bytes `start` to `end` of a file as text, after the edits in this range."""
    parts: list[bytes] = []
    position = start
    for edit in _in_order(edits):
        parts.append(data[position : edit.start])
        parts.append(edit.new.encode())
        position = edit.end
    parts.append(data[position:end])
    return b"".join(parts).decode()


def _in_order(edits: Iterable[Edit]) -> list[Edit]:
    return sorted(edits, key=lambda edit: (edit.start, edit.end))


def patched(edits: Iterable[Edit]) -> str:
    """Return the whole file after edits, including the definitions that the edits require."""
    edits = list(dict.fromkeys(edits))
    data = edits[0].path.read_bytes()
    required: dict[Edit, None] = {}  # two edits may require the same definition
    for edit in edits:
        if edit.define:
            required |= dict.fromkeys(definitions(data, edit))
    return text_after_edits(data, [*tidied_edits(data, edits), *required], 0, len(data))


def tidied_edits(data: bytes, edits: list[Edit]) -> list[Edit]:
    """Return edits that have the effect of `edits` and also tidy the edited statements."""
    starts = line_starts(data)
    changes: list[Edit] = []
    remaining = list(edits)
    for statement in ast.walk(_parsed(data)):
        if not isinstance(statement, ast.Assign | ast.AugAssign | ast.Return | ast.Expr):
            continue
        start, end = span(statement, starts)
        inside: list[Edit] = []
        outside: list[Edit] = []
        for edit in remaining:
            if edit.is_within((start, end)):
                inside.append(edit)
            else:
                outside.append(edit)
        if not inside:
            continue
        remaining = outside
        text = text_after_edits(data, inside, start, end).encode()
        tidied = tidy(text, _edited_parts(inside, start))
        if tidied == text:
            changes += inside
            continue
        old = data[start:end].decode()
        changes.append(replace(inside[0], start=start, end=end, old=old, new=tidied.decode(), define=None))
    return changes + remaining


def _edited_parts(edits: list[Edit], start: int) -> list[tuple[int, int]]:
    """Return (first byte, end byte) of each new text, in the edited text of a statement that begins at `start`."""
    parts: list[tuple[int, int]] = []
    shift = -start
    for edit in _in_order(edits):
        size = len(edit.new.encode())
        first = edit.start + shift
        parts.append((first, first + size))
        shift += size - (edit.end - edit.start)
    return parts


@lru_cache(maxsize=8)
def _parsed(data: bytes) -> ast.Module:
    return ast.parse(data)


def diff(edits: Iterable[Edit], file_name: str | None = None) -> str:
    """Return the unified diff of edits of one file, without context, including the definitions that they require.

    `file_name` is the name in the header of the diff; None: the path.
    """
    edits = list(edits)
    path = edits[0].path
    old = path.read_text(encoding="utf-8").splitlines()
    new = patched(edits).splitlines()
    name = file_name or str(path)
    return "\n".join(difflib.unified_diff(old, new, name, name, n=0, lineterm=""))


def definitions(data: bytes, edit: Edit) -> list[Edit]:
    """Return the edits that insert a required definition: an alias next to similar aliases, or a new argument."""
    assert edit.define is not None
    name, expression = edit.define
    starts = line_starts(data)
    around: list[ast.FunctionDef] = []
    edited: list[ast.FunctionDef] = []
    for node in ast.walk(_parsed(data)):
        if isinstance(node, ast.FunctionDef) and node.lineno <= edit.line <= (node.end_lineno or 0):
            around.append(node)
            if node.name == edit.function:
                edited.append(node)
    for function in edited or around:  # a shared row is in another function
        if not expression:
            last = function.args.args[-1]
            _, end_of_last = span(last, starts)
            return [_insertion(edit, end_of_last, f", {name}", last.lineno)]
        called = expression.split("(")[0]
        for statement in function.body:
            if not isinstance(statement, ast.Assign) or statement.lineno >= edit.line:
                continue
            if not _assigns_call(statement, called):
                continue
            _, target_end = span(statement.targets[0], starts)
            _, value_end = span(statement.value, starts)
            return [
                _insertion(edit, target_end, f", {name}", statement.lineno),
                _insertion(edit, value_end, f", {expression}", statement.lineno),
            ]
    return []


def _assigns_call(statement: ast.Assign, function: str) -> bool:
    """Return whether a value of an assignment is a call of a function, as in `c, s = cos(a), sin(a)`."""
    values = [statement.value]
    if isinstance(statement.value, ast.Tuple):
        values = statement.value.elts
    called: list[str] = []
    for value in values:
        if isinstance(value, ast.Call):
            called.append(getattr(value.func, "id", ""))
    return function in called


def _insertion(edit: Edit, at: int, new: str, line: int) -> Edit:
    return Edit(edit.path, line, at, at, "", new, "definition", -1, edit.function)
