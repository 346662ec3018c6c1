"""`twin hazards`: run a campaign of faults on the machine of a robot."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin import api
from twin.cli import show
from twin.core import assets


def hazards(args: argparse.Namespace) -> int:
    """Run the sessions that are left, print and write the outcome by class; the log has each session.

    The exit code is 1 after a false cue.
    """
    from twin.api.hazards import FILE, Software
    from twin.api.hazards import hazards as run
    from twin.ui.report.files import write_result

    robot = api.load(args.robot)
    released = None if args.released is None else tuple(args.released.split(","))
    folder = Path(args.out) if args.out else Path("twin-out") / robot.name / f"{Path(args.campaign).stem}-hazards"
    with show.progress(args.quiet or args.json) as progress:
        found = run(
            robot,
            args.campaign,
            folder,
            source=args.robot,
            sessions=args.sessions,
            processes=args.processes,
            software=Software(args.mode, args.overdrive, released),
            progress=progress,
        )
    with assets.atomic_folder(folder) as work:
        pictures = write_result(found, work)
    return show.finish(found, args, folder, [*pictures, FILE])
