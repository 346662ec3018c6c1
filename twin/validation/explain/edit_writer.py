"""Write edits of one statement: replace the text of a syntax node, or insert text beside it."""

from __future__ import annotations

import ast

from twin.validation.explain.function_source import Edit, Source, Statement
from twin.validation.explain.name_pool import NamePool


class EditWriter:
    """Writes the edits of one statement."""

    def __init__(self, source: Source, statement: Statement, pool: NamePool) -> None:
        """Store the statement of a function, and the names that its edits may insert."""
        self.source = source
        self.statement = statement
        self.pool = pool
        self._parents: dict[ast.AST, ast.AST] = {}
        for node in ast.walk(statement.node):
            for child in ast.iter_child_nodes(node):
                self._parents[child] = node

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
