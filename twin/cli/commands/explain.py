"""`twin explain`: show which row of which equation disagrees with the mechanism, and the edit that fixes it."""

from __future__ import annotations

import argparse
import math

from twin.cli.parser import VARIANT, Command
from twin.core.errors import TwinError

EXAMPLES = """\
  twin explain sils                         the default variants, which agree
  twin explain sils --variant printed       every equation as the paper prints it
  twin explain sils --variant eq1=printed --json
  twin explain my_robot/ --seconds 60       search longer for two edits in one row
  twin explain sils --variant printed --prove    prove the fixes at all poses"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin explain`."""
    command.robot()
    command.variants(VARIANT)
    command.accuracy()
    text = "time limit in seconds of processor time of the search for edits, numbers and conventions"
    command.number("--seconds", "S", text, 8.0)
    text = "prove each possible fix as `twin prove` does: an identity, or only close; fixes that are one are merged"
    command.flag("--prove", text)


def run(args: argparse.Namespace) -> int:
    """Print the explanation; the exit code is 0 for agreement, 1 for a disagreement, 2 if the check was impossible."""
    from twin.api.equation_checks import explain
    from twin.api.robot_loading import load
    from twin.cli import show
    from twin.cli.option_values import stated_variants

    # 0 is allowed: no time for a search of edits
    if not (math.isfinite(args.seconds) and args.seconds >= 0):
        raise TwinError(f"--seconds {args.seconds:g}: give a number of seconds, 0 or more")
    tolerance = show.micrometres("--tolerance-um", args.tolerance_um)
    robot = load(args.robot)
    chosen = stated_variants(args.variant)
    with show.progress(args.quiet or args.json) as progress:
        result = explain(robot, chosen, tolerance=tolerance, seconds=args.seconds, prove=args.prove, progress=progress)
    return show.finish(result, args)
