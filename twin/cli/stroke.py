"""`twin validate --sweep`: compare equations, mechanism and simplified loop models over the range of each joint."""

from __future__ import annotations

import argparse

from twin import api
from twin.cli import show
from twin.cli.variants import asked
from twin.core import assets
from twin.core.errors import TwinError


def run(robot: api.Robot, args: argparse.Namespace) -> int:
    """Sweep the joints and print a table; write sweep.json, a CSV for each joint and sweep.png.

    The exit code is 1 if the equations disagree.
    """
    from twin.ui.report.files import write_result

    standins = tuple(filter(None, (args.compare or "").split(",")))
    joints = () if args.sweep in (None, "all") else tuple(args.sweep.split(","))
    variants = asked(args.variant)
    if isinstance(variants, str):
        raise TwinError("--sweep accepts no variant name alone; give EQ=NAME pairs")
    folder = show.folder(args, robot.name) / "sweep"
    with show.progress(args.quiet or args.json) as progress:
        found = api.strokes(robot, joints, standins, variants, progress)
        with assets.atomic_folder(folder) as work:
            pictures = write_result(found, work, "sweep")
    return show.finish(found, args, folder, pictures)
