"""`twin hazards`: run a campaign of faults on the machine of a robot, or the experiments of the paper."""

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
    from twin.api.hazards import FILE, Software, trends
    from twin.api.hazards import hazards as run
    from twin.ui.report.files import write_result

    robot = api.load(args.robot)
    software = Software(args.mode, args.overdrive, None if args.released is None else tuple(args.released.split(",")))
    name = "trends" if args.trends else f"{Path(args.campaign).stem}-hazards"
    folder = Path(args.out) if args.out else Path("twin-out") / robot.name / name
    assets.require_writable(folder)
    with show.progress(args.quiet or args.json) as progress:
        if args.trends:
            found = trends(robot, software=software, progress=progress)
        else:
            found = run(
                robot,
                args.campaign,
                folder,
                source=args.robot,
                sessions=args.sessions,
                processes=args.processes,
                software=software,
                progress=progress,
            )
    with assets.atomic_folder(folder) as work:
        pictures = write_result(found, work)
    return show.finish(found, args, folder, pictures if args.trends else [*pictures, FILE])
