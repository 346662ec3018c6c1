"""`twin hazards`: run a fault-injection campaign on the machine of a robot, or the experiments of the paper."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin import api
from twin.cli import show


def hazards(args: argparse.Namespace) -> int:
    """Run the remaining sessions, and print and write the outcomes by class; the log contains each session.

    The exit code is 1 if a cue (force on the operator's hand) occurred without a fault.
    """
    from twin.api.hazards import FILE, Software, trends
    from twin.api.hazards import hazards as run

    robot = api.load(args.robot)
    software = Software(args.mode, args.overdrive, None if args.released is None else tuple(args.released.split(",")))
    folder = show.folder(args, robot.name, "trends" if args.trends else f"{Path(args.campaign).stem}-hazards")
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
    return show.store(found, args, folder, [] if args.trends else [FILE])
