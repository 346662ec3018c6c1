"""`twin open`: open the last report in the browser."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin.cli.parser import Command
from twin.core.errors import TwinError

EXAMPLES = """\
  twin open                      the last page that was written below ./twin-out/
  twin open twin-out/sils/       the last one of this folder"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin open`."""
    command.add_argument("folder", nargs="?", default="twin-out", help="folder to search (default ./twin-out)")


def run(args: argparse.Namespace) -> int:
    """Open the page that was written last; without a display, print its path."""
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
    """Return the page of a folder that was written last.

    Raises:
        TwinError: there is no page.
    """
    if folder.is_file() and folder.suffix == ".html":
        return folder
    pages = [path for path in folder.rglob("*.html") if path.is_file()]
    if not pages:
        raise TwinError(f"{folder}: there is no report; `twin run sils` writes one, also with --open")
    return max(pages, key=lambda path: path.stat().st_mtime_ns)
