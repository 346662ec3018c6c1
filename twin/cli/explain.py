"""`twin explain`: show which row (one compared equation) disagrees, where, why, and the edit that fixes it."""

from __future__ import annotations

import argparse
import math

from twin import api
from twin.cli import show
from twin.cli.variants import asked
from twin.core.errors import TwinError
from twin.core.units import UM


def explain(args: argparse.Namespace) -> int:
    """Print the explanation; the exit code is 0 for agreement, 1 for a disagreement, 2 if the check was impossible."""
    if not (math.isfinite(args.seconds) and args.seconds >= 0):
        raise TwinError(f"--seconds {args.seconds:g}: give a number of seconds, 0 or more")
    um = args.tolerance_um
    if um is not None and not (math.isfinite(um) and um > 0):
        raise TwinError(f"--tolerance-um {um:g}: give a positive number of micrometres")
    robot = api.load(args.robot)
    chosen = asked(args.variant)
    with show.progress(args.quiet or args.json) as progress:
        result = api.explain(
            robot, chosen, tolerance=None if um is None else um * UM, seconds=args.seconds, progress=progress
        )
    return show.finish(result, args)
