"""`twin workspace`: compute the reachable poses, their conditioning and their margins."""

from __future__ import annotations

import argparse
import math

from twin.cli.parser import Command, count
from twin.core.errors import TwinError
from twin.core.units import DEG, MM

EXAMPLES = """\
  twin workspace sils                              a million positions in the home orientation
  twin workspace sils --count 1e7 --tilt-deg 20 --turns 50
  twin workspace pa10 --joints                     by sampling the joint ranges instead
  twin workspace my_robot/ --step-mm 2 --scheduler tcp://10.0.0.1:8786"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin workspace`."""
    command.robot()
    command.trocar()
    command.number("--count", "N", "total number of poses", 1_000_000, count)
    command.number("--step-mm", "MM", "distance between positions, instead of --count")
    command.number("--tilt-deg", "DEG", "maximum rotation of the tool about each axis", 0.0)
    command.integer("--turns", "number of orientations at each position", 30)
    text = "sample joint values instead of poses (always done for equations without a closed-form inverse)"
    command.flag("--joints", text)
    command.scheduler()
    command.device()
    command.out("./twin-out/<robot>/workspace/")


def run(args: argparse.Namespace) -> int:
    """Compute the workspace, print its volumes, write a picture and point clouds."""
    from twin import api
    from twin.analysis import cloud
    from twin.analysis.workspace import workspace as search
    from twin.cli import show
    from twin.cli.option_values import device
    from twin.core import assets
    from twin.core.compute_device import computing_on
    from twin.ui.report.report_folder import write_result

    for name, value, least in (("--count", args.count, 1000), ("--turns", args.turns, 1)):
        if value < least:
            raise TwinError(f"{name} {value}: give at least {least}")
    if args.step_mm is not None and not (math.isfinite(args.step_mm) and args.step_mm > 0):
        raise TwinError(f"--step-mm {args.step_mm:g}: give a positive number of millimetres")
    if not 0 <= args.tilt_deg <= 180:
        raise TwinError(f"--tilt-deg {args.tilt_deg:g}: give degrees from 0 to 180")
    step = None
    if args.step_mm is not None:
        step = args.step_mm * MM
    robot = api.load(args.robot)
    folder = show.folder(args, robot.name, "workspace")
    # the search itself writes into the folder: poses are stored block by block
    with assets.atomic_folder(folder) as work, show.progress(args.quiet or args.json) as progress:
        with computing_on(device(args)):
            workspace = search(
                robot,
                args.count,
                step,
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
        pictures = write_result(workspace, work)
        cloud.write_ply(workspace, work / "workspace.ply")
        cloud.write_usd(workspace, work / "workspace.usdc")
    return show.finish(workspace, args, folder, [*pictures, "workspace.ply, .usdc, .json"])
