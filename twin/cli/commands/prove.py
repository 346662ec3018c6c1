"""`twin prove`: prove that the equations agree with the mechanism at all poses, or show a pose where they do not."""

from __future__ import annotations

import argparse

from twin.cli.parser import VARIANT, Command, count

EXAMPLES = """\
  twin prove sils                           all loops, all points, at all poses
  twin prove sils --variant eq1=printed     a printed error is refuted, with a pose where it shows
  twin prove my_robot/ --json"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin prove`."""
    command.robot()
    command.variants(VARIANT)
    command.number("--states", "N", "number of random states, 64 to 1000000", 4096, count)
    command.seed("random seed of the states")
    command.out("./twin-out/<robot>/prove/")


def run(args: argparse.Namespace) -> int:
    """Print the claims; the exit code is 0 if all are proved, 1 if one is refuted, 2 if one is not proved."""
    from twin.api.proof import prove
    from twin.api.robot import load
    from twin.cli import show
    from twin.cli.chosen import asked

    robot = load(args.robot)
    folder = show.folder(args, robot.name, "prove")
    with show.progress(args.quiet or args.json) as progress:
        result = prove(robot, asked(args.variant), args.states, args.seed, progress)
    return show.store(result, args, folder)
