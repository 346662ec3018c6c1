"""`twin workspace`: compute reachable positions, conditioning, margins to limits and singularities."""

from __future__ import annotations

import argparse

import numpy as np

from twin import api
from twin.cli import show
from twin.core import assets
from twin.core.errors import TwinError
from twin.core.units import DEG, MM


def workspace(args: argparse.Namespace) -> int:
    """Compute the workspace, print its volumes, write a picture and point clouds."""
    from twin.analysis import cloud
    from twin.analysis.search import workspace as search
    from twin.ui.report.files import write_result

    for name, value, least in (("--count", args.count, 1000), ("--turns", args.turns, 1)):
        if value < least:
            raise TwinError(f"{name} {value}: give at least {least}")
    if args.step_mm is not None and not (np.isfinite(args.step_mm) and args.step_mm > 0):
        raise TwinError(f"--step-mm {args.step_mm:g}: give a positive number of millimetres")
    if not 0 <= args.tilt_deg <= 180:
        raise TwinError(f"--tilt-deg {args.tilt_deg:g}: give degrees from 0 to 180")
    robot = api.load(args.robot)
    folder = show.folder(args, robot.name, "workspace")
    with assets.atomic_folder(folder) as work, show.progress(args.quiet or args.json) as progress:
        found = search(
            robot,
            args.count,
            args.step_mm * MM if args.step_mm else None,
            tilt=args.tilt_deg * DEG,
            turns=args.turns,
            by_joint_positions=args.joints,
            protocol=args.protocol,
            store=work,
            scheduler=args.scheduler,
            source=args.robot,
            progress=progress,
        )
        progress("write", 0.0)
        shown = write_result(found, work)
        cloud.write_ply(found, work / "workspace.ply")
        cloud.write_usd(found, work / "workspace.usdc")
    return show.finish(found, args, folder, [*shown, "workspace.ply, .usdc, .json"])
