"""Find the names of a statement that have no value: an equation can run only if edits replace all of them."""

from __future__ import annotations

import ast

from twin.validation.explain.expression import Site
from twin.validation.explain.function_source import Edit

ByteRange = tuple[int, int]
"""First byte and end of a part of a file."""


def undefined(site: Site) -> list[ByteRange]:
    """Return where names without a value stand in a statement."""
    ranges: list[ByteRange] = []
    for node in ast.walk(site.statement.node):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id in site.pool.unknown:
            ranges.append(site.source.span(node))
    return sorted(ranges)


def replaces(edit: Edit, part: ByteRange) -> bool:
    """Return whether an edit replaces a part of a file."""
    start, end = part
    return edit.start <= start and end <= edit.end
