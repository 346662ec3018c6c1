"""`twin explain`: show which row (one compared equation) disagrees, where, why, and the edit that fixes it."""

from __future__ import annotations

import argparse
import math

from twin import api
from twin.cli import show
from twin.cli.variants import asked
from twin.core.errors import TwinError


def explain(args: argparse.Namespace) -> int:
    """Print the explanation; the exit code is 0 for agreement, 1 for a disagreement, 2 if the check was impossible."""
    if not (math.isfinite(args.seconds) and args.seconds >= 0):
        raise TwinError(f"--seconds {args.seconds:g}: give a number of seconds, 0 or more")
    tolerance = show.micrometres("--tolerance-um", args.tolerance_um)
    robot = api.load(args.robot)
    chosen = asked(args.variant)
    with show.progress(args.quiet or args.json) as progress:
        result = api.explain(robot, chosen, tolerance=tolerance, seconds=args.seconds, progress=progress)
    return show.finish(result, args)
