"""`twin session`: replay a recorded session at a console, measure it, and export it."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin.api.procedure import is_procedure, replay_procedure
from twin.api.session import replay_session
from twin.cli import show


def report(file: str, scene: str) -> bytes:
    """Return the page that `twin session FILE --scene SCENE --out FOLDER` writes."""
    from twin.core.atomic import Scratch
    from twin.ui.report.files import write_result

    with Scratch() as folder:
        found = (replay_procedure if is_procedure(file, scene) else replay_session)(file, scene)
        pages = write_result(found, Path(folder))
        return (Path(folder) / pages[0]).read_bytes()


def session(args: argparse.Namespace) -> int:
    """Replay the session and print its measures; with --out, write page, picture and data.

    The exit code is 1 if the replay differs from the recording, or if a target was not touched or a check failed.
    """
    folder = show.folder(args) if args.out else None
    with show.progress(args.quiet or args.json) as progress:
        replay = replay_procedure if is_procedure(args.file, args.scene) else replay_session
        found = replay(args.file, args.scene, progress)
    return show.finish(found, args) if folder is None else show.store(found, args, folder)
