"""`twin hazards`: run a campaign of faults on the machine of a robot."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin import api
from twin.cli import show


def hazards(args: argparse.Namespace) -> int:
    """Run the remaining sessions and print the number of outcomes by class; the log contains each session.

    The exit code is 1 after a false cue.
    """
    from twin.api.hazards import FILE
    from twin.api.hazards import hazards as run

    robot = api.load(args.robot)
    folder = show.folder(args, robot.name, f"{Path(args.campaign).stem}-hazards")
    with show.progress(args.quiet or args.json) as progress:
        found = run(
            robot,
            args.campaign,
            folder,
            source=args.robot,
            sessions=args.sessions,
            processes=args.processes,
            progress=progress,
        )
    return show.finish(found, args, folder, (FILE,))
