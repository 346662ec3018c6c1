"""Print tables, results and progress of the commands; only `twin.cli` prints."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli import layout, pages
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
    "micrometres",
    "plain",
    "progress",
    "record",
    "store",
    "table",
    "tool_note",
]

_SILENCE = 15.0
"""Time in s after which a command whose stderr is not a terminal says how far it is, again and again."""

_MARKS = {"error": "✖", "disagreement": "✖", "warning": "▲", "info": "·"}


def tool_note(robot: Robot, quiet: bool) -> None:
    """Print the assumed tool if the stage does not define a tool."""
    if not quiet and robot.files is None and robot.mechanism and robot.tool_note:
        print(f"  {robot.tool_note} Choose another with --tool.", file=sys.stderr)


@contextlib.contextmanager
def progress(quiet: bool) -> Iterator[Callable[[str, float], None]]:
    """Yield a function that shows the progress; it shows nothing if `quiet` is set.

    If stderr is not a terminal, a command that takes long prints a line every `_SILENCE` seconds.
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
    """Return a function that prints label, completed fraction and elapsed time to stderr every `_SILENCE` seconds."""
    began = time.monotonic()
    spoke = began

    def update(label: str, fraction: float) -> None:
        nonlocal spoke
        now = time.monotonic()
        if now - spoke < _SILENCE:
            return
        spoke = now
        done = ""
        if fraction:
            done = f" {100 * fraction:.0f} %,"
        print(f"{label}:{done} {now - began:.0f} s so far", file=sys.stderr, flush=True)

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
    out = Path(args.out) if args.out else Path("twin-out", *default)
    assets.require_writable(out)
    return out


def store(result: Result, args: argparse.Namespace, out: Path, more: Iterable[str] = ()) -> int:
    """Write the page, pictures and data of a result into a folder; then print the result and return its exit code.

    `more` are the names of further files in the folder, to be listed after the pictures.
    """
    with assets.atomic_folder(out) as work:
        pictures = pages.write_result(result, work)
    return finish(result, args, out, [*pictures, *more])


def plain(part: Part) -> str:
    """Return a part of a result (text, table or finding) as printable text, fitted to the terminal, if there is one."""
    if isinstance(part, TextTable):
        return table(part.rows, part.header, fit=part.fit)
    if isinstance(part, Finding):
        return layout.text(finding(part))
    if isinstance(part, Line):
        return layout.text(part.text)
    return layout.text(part)


def _styled(line: Line) -> None:
    from rich.console import Console
    from rich.text import Text

    class PipedConsole(Console):
        """A console that leaves a closed pipe to `twin.cli.command_line`; rich would raise SystemExit(1): disagree."""

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    console = PipedConsole(highlight=False, soft_wrap=True)
    for row in layout.fitted(line.text):
        console.print(Text(row, style=line.style))


def table(rows: Sequence[Sequence[str]], header: Sequence[str] = (), indent: str = "  ", *, fit: bool = False) -> str:
    """Return a table as aligned text.

    On a terminal, it is fitted to the width: cells are wrapped or, with `fit`, long lines are cut.
    """
    rows_of_text = [[str(cell) for cell in row] for row in rows]
    if header:
        rows_of_text.insert(0, list(header))
    if not rows_of_text:
        return ""
    columns = layout.width()
    drawn = layout.table(rows_of_text, indent, None if fit else columns)
    if header:
        widths = [max(len(cell) for cell in cells) for cells in zip(*rows_of_text, strict=True)]
        rule = indent + "  ".join("-" * width for width in widths)
        if columns is not None and len(rule) > columns:
            rule = indent + "-" * (columns - len(indent))
        drawn.insert(1, [rule])
    lines: list[str] = []
    for row in drawn:
        lines += row
    if fit and columns is not None:
        for i, line in enumerate(lines):
            if len(line) > columns:
                lines[i] = f"{line[: columns - 1]}…"
    return "\n".join(lines)


def finding(f: Finding) -> str:
    """Return a finding as text of one or two lines."""
    text = f"  {_MARKS[f.severity]} {f.message}"
    place = ", ".join(part for part in (f.where, f.when) if part)
    if place:
        text += f"  [{place}]"
    if f.suggestion:
        text += f"\n      {f.suggestion}"
    return text
