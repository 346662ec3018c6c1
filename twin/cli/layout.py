"""Fit texts and tables to the width of the terminal, and color verdicts there; a file or pipe gets them unchanged."""

from __future__ import annotations

import os
import re
import shutil
import sys
import textwrap
from collections.abc import Sequence

_LEAST = 40
"""Smallest width in characters to which texts are fitted."""

_NARROW = 8
"""Smallest width of a column that has been narrowed."""

_GAP = 2
"""Spaces between columns."""

_BOLD_GREEN = "1;32"
_BOLD_RED = "1;31"
_BOLD_YELLOW = "1;33"

_COLORS = {
    **dict.fromkeys(("AGREE", "PASS", "PROVED", "MET"), _BOLD_GREEN),
    **dict.fromkeys(("DISAGREE", "FAIL", "REFUTED", "✖"), _BOLD_RED),
    **dict.fromkeys(("UNCHECKED", "OPEN", "▲"), _BOLD_YELLOW),
}
"""Color of the word that begins a line: a verdict, or the mark of a finding."""

_FIRST = re.compile(r"^(\s*)(\S+?)(:?)(?=\s|$)")


def width() -> int | None:
    """Return the width of the terminal in characters; None if the output is not a terminal."""
    if not sys.stdout.isatty():
        return None
    return max(_LEAST, shutil.get_terminal_size().columns)


def has_color() -> bool:
    """Return whether colors are printed: on a terminal that has them, and without NO_COLOR (see no-color.org)."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return False
    return sys.stdout.isatty()


def text(given: str) -> str:
    """Return a text with its lines wrapped to the width, and its verdicts colored, if it is printed on a terminal."""
    lines = fitted(given)
    if has_color():
        lines = [_colored(line) for line in lines]
    return "\n".join(lines)


def fitted(given: str) -> list[str]:
    """Return the lines of a text, wrapped to the width if it is printed on a terminal."""
    columns = width()
    lines = given.split("\n")
    if columns is None:
        return lines
    wrapped: list[str] = []
    for line in lines:
        wrapped += _wrapped(line, columns)
    return wrapped


def _wrapped(line: str, columns: int) -> list[str]:
    """Return a line as lines of at most `columns` characters; further lines are indented more than the first."""
    if len(line) <= columns:
        return [line]
    indent = line[: len(line) - len(line.lstrip())]
    wrapper = textwrap.TextWrapper(
        columns,
        initial_indent=indent,
        subsequent_indent=indent[: columns // 4] + "    ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return wrapper.wrap(line.strip()) or [line]


def _colored(line: str) -> str:
    first = _FIRST.match(line)
    if first is None or first[2] not in _COLORS:
        return line
    start = len(first[1])
    end = start + len(first[2])
    return f"{line[:start]}\x1b[{_COLORS[first[2]]}m{first[2]}\x1b[0m{line[end:]}"


def table(rows: Sequence[Sequence[str]], indent: str, columns: int | None) -> list[list[str]]:
    """Return the lines of each row of a table; cells of the widest columns are wrapped to fit into `columns`.

    Cells are padded to the width of their column. None: no row is wrapped.
    """
    widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)]
    if columns is not None:
        widths = _fitted(widths, columns - len(indent))
    drawn = []
    for row in rows:
        cells = [_cell(cell, size) for cell, size in zip(row, widths, strict=True)]
        height = max(map(len, cells))
        lines = []
        for k in range(height):
            parts = []
            for cell, size in zip(cells, widths, strict=True):
                part = cell[k] if k < len(cell) else ""
                parts.append(part.ljust(size))
            lines.append((indent + (" " * _GAP).join(parts)).rstrip())
        drawn.append(lines)
    return drawn


def _fitted(widths: Sequence[int], available: int) -> list[int]:
    """Return widths of columns whose sum with gaps is at most `available`, made by narrowing the widest first."""
    fitted = list(widths)
    excess = sum(fitted) + _GAP * (len(fitted) - 1) - available
    while excess > 0:
        widest = fitted.index(max(fitted))
        if fitted[widest] <= _NARROW:
            break
        fitted[widest] -= 1
        excess -= 1
    return fitted


def _cell(cell: str, size: int) -> list[str]:
    """Return the lines of a cell in a column of a width; words longer than the column are broken."""
    if len(cell) <= size:
        return [cell]
    return textwrap.wrap(cell, size, break_on_hyphens=False) or [""]
