"""`twin session`: replay a recorded session at a console, measure it, and export it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli.parser import Command
from twin.core.progress import Progress

if TYPE_CHECKING:
    from twin.core.result import Result

EXAMPLES = """\
  twin session hands.session
  twin session hands.session --json
  twin session hands.session --out session/       page, plots, CSV, tracks, GLB, MCAP"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin session`."""
    command.add_argument("file", help="a file of twin serve --session, or hands.session of twin operate")
    command.text("--scene", "SCENE", "path of the session's scene (default: the built-in scene named in the file)")
    command.text("--out", "FOLDER", "folder to write to (default: nothing is written)")


def run(args: argparse.Namespace) -> int:
    """Replay the session and print its measures; with --out, write page, picture and data.

    The exit code is 1 if the replay differs from the recording, a target was not touched, or a check failed.
    """
    from twin.cli import show

    folder = show.folder(args) if args.out else None
    with show.progress(args.quiet or args.json) as progress:
        session = _replayed(args.file, args.scene, progress)
    if folder is None:
        return show.finish(session, args)
    return show.store(session, args, folder)


def report(file: str, scene: str) -> bytes:
    """Return the page that `twin session FILE --scene SCENE --out FOLDER` writes."""
    from twin.core.atomic import Scratch
    from twin.ui.report.report_folder import write_result

    with Scratch() as folder:
        pages = write_result(_replayed(file, scene, lambda label, fraction: None), Path(folder))
        return (Path(folder) / pages[0]).read_bytes()


def _replayed(file: str, scene: str | None, progress: Progress) -> Result:
    """Return the result of a replayed session, of a console or of a procedure."""
    from twin.api.console_runs import replay_session
    from twin.api.procedure import is_procedure, replay_procedure

    if is_procedure(file, scene):
        return replay_procedure(file, scene, progress)
    return replay_session(file, scene, progress)
