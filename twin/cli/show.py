"""Print tables, results and progress of the commands; only `twin.cli` prints.

On a terminal, texts and tables fit its width and verdicts are colored; a file or pipe gets them unchanged.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import re
import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli import result_files
from twin.core import assets
from twin.core.errors import TwinError
from twin.core.findings import Finding
from twin.core.result import Line, Part, Result, TextTable, as_json, record
from twin.core.units import UM

if TYPE_CHECKING:
    from twin.api.robot import Robot

__all__ = [
    "as_json",
    "finding",
    "finish",
    "folder",
    "listed",
    "micrometres",
    "plain",
    "progress",
    "record",
    "store",
    "table",
    "table_lines",
    "terminal_width",
    "text",
    "tool_note",
]

_REPORT_INTERVAL = 15.0
"""Time in s after which a command whose stderr is not a terminal says how far it is, again and again."""

_SMALLEST_WIDTH = 40
"""Smallest width in characters to which texts are fitted."""

_SMALLEST_COLUMN = 8
"""Smallest width of a column that has been narrowed."""

_COLUMN_GAP = 2
"""Spaces between columns."""

_BROKEN_WORD_LINES = 2
"""Number of lines of a table that one broken word counts as, where the widths of columns are chosen."""

_BOLD_GREEN = "1;32"
_BOLD_RED = "1;31"
_BOLD_YELLOW = "1;33"

_COLORS = {
    **dict.fromkeys(("AGREE", "PASS", "PROVED", "MET"), _BOLD_GREEN),
    **dict.fromkeys(("DISAGREE", "FAIL", "REFUTED", "✖"), _BOLD_RED),
    **dict.fromkeys(("UNCHECKED", "OPEN", "▲"), _BOLD_YELLOW),
}
"""Color of the word that begins a line: a verdict, or the mark of a finding."""

_FIRST_WORD = re.compile(r"^(\s*)(\S+?)(:?)(?=\s|$)")
"""Indentation, first word and colon of a line."""

_MARKS = {"error": "✖", "disagreement": "✖", "warning": "▲", "info": "·"}
"""{severity: mark before a finding}."""


def tool_note(robot: Robot, quiet: bool) -> None:
    """Print the assumed tool if the stage does not define a tool."""
    if not quiet and robot.files is None and robot.mechanism and robot.tool_note:
        print(f"  {robot.tool_note} Choose another with --tool.", file=sys.stderr)


@contextlib.contextmanager
def progress(quiet: bool) -> Iterator[Callable[[str, float], None]]:
    """Yield a function that shows the progress; it shows nothing if `quiet` is set.

    If stderr is not a terminal, a command that takes long prints a line every `_REPORT_INTERVAL` seconds.
    """
    if quiet:
        yield lambda label, fraction: None
        return
    if not sys.stderr.isatty():
        yield _lines()
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("start", total=None)

        def update(label: str, fraction: float) -> None:
            total = None  # if the completed fraction is unknown (0), a moving bar is shown
            if fraction:
                total = 1.0
            bar.update(task, description=label, total=total, completed=fraction)

        yield update


def _lines() -> Callable[[str, float], None]:
    """Return a function that prints label, completed fraction and elapsed time to stderr every `_REPORT_INTERVAL`."""
    began = time.monotonic()
    spoke = began

    def update(label: str, fraction: float) -> None:
        nonlocal spoke
        time_now = time.monotonic()
        if time_now - spoke < _REPORT_INTERVAL:
            return
        spoke = time_now
        fraction_text = ""
        if fraction:
            fraction_text = f" {100 * fraction:.0f} %,"
        print(f"{label}:{fraction_text} {time_now - began:.0f} s so far", file=sys.stderr, flush=True)

    return update


def finish(
    result: Result,
    args: argparse.Namespace,
    folder: Path | None = None,
    files: Iterable[str] = (),
    text: Iterable[Part] | None = None,
) -> int:
    """Print a result as text or, with --json, as JSON; return its exit code.

    `files` are the names of the written files in `folder`, which are listed; `text` replaces the text of the result.
    """
    if args.json:
        data = dict(result.as_dict())
        if folder is not None:
            data["folder"] = str(folder)
        print(as_json(data))
        return result.exit_code
    if text is None:
        text = result.text()
    for part in text:
        if isinstance(part, Line):
            _styled(part)
        else:
            print(plain(part))
    for name in files:
        path = folder / name if folder else name
        print(f"  {path}")
    return result.exit_code


def listed(text: str | None) -> list[str]:
    """Return the names in the value of an option, which are separated by commas; [] if the option is not given."""
    names = []
    for name in (text or "").split(","):
        if name.strip():
            names.append(name.strip())
    return names


def micrometres(option: str, value: float | None) -> float | None:
    """Convert the value of an option from micrometres to m; None if the option is not given.

    Raises:
        TwinError: the value is not positive or not finite.
    """
    if value is None:
        return None
    if not math.isfinite(value) or value <= 0:
        raise TwinError(f"{option} {value:g}: give a positive number of micrometres")
    return value * UM


def folder(args: argparse.Namespace, *default: str) -> Path:
    """Return the folder of --out or, without this option, ./twin-out/<default>; do not create it.

    Raises:
        OutputError: the folder cannot be written.
    """
    path = Path(args.out) if args.out else Path("twin-out", *default)
    assets.require_writable(path)
    return path


def store(
    result: Result,
    args: argparse.Namespace,
    folder: Path,
    other_files: Iterable[str] = (),
    replacing: Collection[str] = (),
) -> int:
    """Write the page, pictures and data of a result into a folder; then print the result and return its exit code.

    `other_files` are the names of further files in the folder, to be listed after the pictures. Files of an earlier
    result with names in `replacing` are removed if this result does not write them.
    """
    with assets.atomic_folder(folder, replacing) as work:
        pictures = result_files.write_result(result, work)
    return finish(result, args, folder, [*pictures, *other_files])


def plain(part: Part) -> str:
    """Return a part of a result (text, table or finding) as printable text, fitted to the terminal, if there is one."""
    if isinstance(part, TextTable):
        return table(part.rows, part.header, fit=part.fit)
    if isinstance(part, Finding):
        return text(finding(part))
    if isinstance(part, Line):
        return text(part.text)
    return text(part)


def _styled(line: Line) -> None:
    from rich.console import Console
    from rich.text import Text

    class PipedConsole(Console):
        """A console that leaves a closed pipe to `twin.cli.command_line`; rich would raise SystemExit(1): disagree."""

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    console = PipedConsole(highlight=False, soft_wrap=True)
    for row in wrapped_lines(line.text):
        console.print(Text(row, style=line.style))


def table(rows: Sequence[Sequence[str]], header: Sequence[str] = (), indent: str = "  ", *, fit: bool = False) -> str:
    """Return a table as aligned text.

    On a terminal, it is fitted to the width: cells are wrapped or, with `fit`, long lines are cut.
    """
    rows_of_text = []
    if header:
        rows_of_text.append(list(header))
    for row in rows:
        rows_of_text.append(list(map(str, row)))
    if not rows_of_text:
        return ""
    columns = terminal_width()
    lines_of_rows = table_lines(rows_of_text, indent, None if fit else columns)
    if header:
        dashes = ["-" * width for width in _column_widths(rows_of_text)]
        rule = indent + (" " * _COLUMN_GAP).join(dashes)
        if columns is not None and len(rule) > columns:
            rule = indent + "-" * (columns - len(indent))
        lines_of_rows.insert(1, [rule])
    lines: list[str] = []
    for row in lines_of_rows:
        lines += row
    if fit and columns is not None:
        for i, line in enumerate(lines):
            if len(line) > columns:
                lines[i] = f"{line[: columns - 1]}…"
    return "\n".join(lines)


def finding(shown: Finding) -> str:
    """Return a finding as text of one or two lines."""
    text = f"  {_MARKS[shown.severity]} {shown.message}"
    place = ", ".join(filter(None, (shown.where, shown.when)))
    if place:
        text += f"  [{place}]"
    if shown.suggestion:
        text += f"\n      {shown.suggestion}"
    return text


def terminal_width() -> int | None:
    """Return the width of the terminal in characters; None if the output is not a terminal."""
    if not sys.stdout.isatty():
        return None
    return max(_SMALLEST_WIDTH, shutil.get_terminal_size().columns)


def has_color() -> bool:
    """Return whether colors are printed: on a terminal that has them, and without NO_COLOR (see no-color.org)."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return False
    return sys.stdout.isatty()


def text(content: str) -> str:
    """Return a text with its lines wrapped to the width, and its verdicts colored, if it is printed on a terminal."""
    lines = wrapped_lines(content)
    if has_color():
        lines = list(map(_colored, lines))
    return "\n".join(lines)


def wrapped_lines(content: str) -> list[str]:
    """Return the lines of a text, wrapped to the width if it is printed on a terminal."""
    columns = terminal_width()
    lines = content.split("\n")
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
    """Return a line with ANSI codes around its first word if that is a verdict or the mark of a finding."""
    first = _FIRST_WORD.match(line)
    if first is None or first[2] not in _COLORS:
        return line
    start = len(first[1])
    end = start + len(first[2])
    return f"{line[:start]}\x1b[{_COLORS[first[2]]}m{first[2]}\x1b[0m{line[end:]}"


def table_lines(rows: Sequence[Sequence[str]], indent: str, columns: int | None) -> list[list[str]]:
    """Return the lines of each row of a table; cells of the widest columns are wrapped to fit into `columns`.

    Cells are padded to the width of their column. None: no row is wrapped.
    """
    widths = _column_widths(rows)
    if columns is not None:
        widths = _fitted(rows, widths, columns - len(indent))
    lines_of_rows = []
    for row in rows:
        cells = list(map(_cell, row, widths))
        height = max(map(len, cells))
        lines = []
        for k in range(height):
            parts = []
            for cell, size in zip(cells, widths, strict=True):
                part = cell[k] if k < len(cell) else ""
                parts.append(part.ljust(size))
            lines.append((indent + (" " * _COLUMN_GAP).join(parts)).rstrip())
        lines_of_rows.append(lines)
    return lines_of_rows


def _column_widths(rows: Sequence[Sequence[str]]) -> list[int]:
    """Return the number of characters of the longest cell of each column."""
    widths = []
    for column in zip(*rows, strict=True):
        widths.append(max(map(len, column)))
    return widths


def _fitted(rows: Sequence[Sequence[str]], widths: Sequence[int], available: int) -> list[int]:
    """Return widths of columns whose sum with gaps is at most `available`, so that the rows have few lines.

    Step by step, the column is narrowed that costs the least: lines of the table, and words that are broken. Of columns
    that cost the same, the widest is narrowed. Words of the first row, a heading, are broken last of all.
    """
    fitted = list(widths)
    columns = []  # (number of characters, characters of the longest word) of each cell
    for column_cells in zip(*rows, strict=True):
        columns.append([(len(cell), _longest_word(cell)) for cell in column_cells])
    heights = [1] * len(rows)
    excess = sum(fitted) + _COLUMN_GAP * (len(fitted) - 1) - available
    for _ in range(excess):
        best = None
        for column, cells in enumerate(columns):
            size = fitted[column] - 1
            if size < _SMALLEST_COLUMN:
                continue
            cost = 0
            for (length, word), height in zip(cells, heights, strict=True):
                lines = -(-length // size)  # rounded up
                cost += max(0, lines - height) + _BROKEN_WORD_LINES * (word > size)
            _, heading = cells[0]
            if heading > size:
                cost += _BROKEN_WORD_LINES * len(rows)
            if best is None or (cost, -size) < best[:2]:
                best = (cost, -size, column)
        if best is None:  # every column is narrow: the terminal wraps the lines
            break
        narrowed = best[2]
        fitted[narrowed] -= 1
        for row, (length, _) in enumerate(columns[narrowed]):
            heights[row] = max(heights[row], -(-length // fitted[narrowed]))
    return fitted


def _longest_word(cell: str) -> int:
    """Return the number of characters of the longest word of a cell; 0 for an empty cell."""
    return max(map(len, cell.split()), default=0)


def _cell(cell: str, size: int) -> list[str]:
    """Return the lines of a cell in a column of a width; words longer than the column are broken."""
    if len(cell) <= size:
        return [cell]
    return textwrap.wrap(cell, size, break_on_hyphens=False) or [""]
