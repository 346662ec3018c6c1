"""`twin operate`: simulate an operator (handle, clutch pedal), with the same measures as in a user study."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin import api
from twin.cli import show
from twin.core import assets


def operate(args: argparse.Namespace) -> int:
    """Simulate the operator, print the measures, write JSON, CSV and a picture; exit 1 if a goal was not reached."""
    from twin.ui.report.files import write_result

    robot = api.load(args.robot)
    protocol = robot.protocol(args.protocol)
    folder = Path(args.out) if args.out else Path("twin-out") / robot.name / f"{protocol.name}-operator"
    assets.require_writable(folder)
    with show.progress(args.quiet or args.json) as progress:
        found = api.operate(
            robot,
            protocol,
            trials=args.trials,
            seed=args.seed,
            clutch=args.clutch,
            scale=args.scale,
            solver=args.solver,
            progress=progress,
        )
    with assets.atomic_folder(folder) as work:
        pictures = write_result(found, work)
    return show.finish(found, args, folder, pictures)
