"""`twin open`: open the last report in the browser."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from pathlib import Path

from twin.cli.parser import Command
from twin.core.atomic import UNFINISHED
from twin.core.errors import TwinError

EXAMPLES = """\
  twin open                      the last report that was written below ./twin-out/
  twin open twin-out/sils/       the last one of this folder"""

REPORT = b'<meta name="generator" content="twin">'
"""Line in the head of each report that twin writes (twin/ui/report/*.html.j2)."""

_HEAD = 1000
"""Number of bytes of a page in which the line is searched."""


def arguments(command: Command) -> None:
    """Add the arguments of `twin open`."""
    command.add_argument("folder", nargs="?", default="twin-out", help="folder to search (default ./twin-out)")


def run(args: argparse.Namespace) -> int:
    """Open the report that was written last; without a display, print its path."""
    from twin.cli import show
    from twin.cli.browser import open_file

    page = _last(Path(args.folder))
    reason = open_file(page)
    if args.json:
        print(show.as_json(show.record("open", {"page": str(page), "opened": not reason})))
        return 0
    print(f"  {page}")
    if reason:
        print(f"  {reason}")
    return 0


def _last(folder: Path) -> Path:
    """Return the report of a folder that was written last; a given page is returned as it is.

    Raises:
        TwinError: there is no report.
    """
    if folder.is_file() and folder.suffix == ".html":
        return folder
    last = None
    latest = -1
    for page in _pages(folder):
        try:
            written = page.stat().st_mtime_ns
            is_report = _is_report(page)
        except OSError:  # removed or replaced since it was found
            continue
        if is_report and written > latest:
            last = page
            latest = written
    if last is None:
        raise TwinError(f"{folder}: there is no report; `twin run sils` writes one, also with --open")
    return last


def _pages(folder: Path) -> Iterator[Path]:
    """Yield the pages in a folder, without those of runs in progress; folders that cannot be read are left out."""
    for parent, folders, files in os.walk(folder):
        # `os.walk` searches the folders that remain in this list
        folders[:] = [name for name in folders if not name.startswith(UNFINISHED)]
        for name in files:
            if name.endswith(".html"):
                yield Path(parent, name)


def _is_report(page: Path) -> bool:
    """Return whether twin has written a page as a report.

    Raises:
        OSError: the page cannot be read.
    """
    with page.open("rb") as file:
        return REPORT in file.read(_HEAD)
