"""`twin selftest`: seed faults into a robot, and measure how many the validator finds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli.parser import Command
from twin.core.errors import TwinError, unknown

if TYPE_CHECKING:
    from twin.analysis.mutation.fault import Family

EXAMPLES = """\
  twin selftest sils                            equations, CAD, USD, units, timing
  twin selftest sils --family formula,cad --count 60 --seed 7
  twin selftest my_robot/ --json"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin selftest`."""
    command.robot()
    command.text("--protocol", "NAME", "the protocol (default: the robot's default protocol)")
    command.text("--family", "NAMES", "comma-separated list of formula, cad, usd, units, timing (default all)")
    command.integer("--count", "number of faults", 118)
    command.seed("random seed")
    command.out("./twin-out/<robot>/")


def run(args: argparse.Namespace) -> int:
    """Seed faults, validate and store the score; the exit code is 1 for a low score or for a false alarm."""
    from twin.analysis.mutation.fault import FAMILIES
    from twin.analysis.mutation.trials import selftest
    from twin.cli import show
    from twin.core import assets

    if args.count < 1:
        raise TwinError(f"--count {args.count}: give a number of faults, 1 or more")
    families: tuple[Family, ...] = FAMILIES
    if args.family:
        stated_names = list(map(str.strip, args.family.split(",")))
        for name in stated_names:
            if name not in FAMILIES:
                raise TwinError(f"--family: {unknown('family', name, FAMILIES)}")
        # in the order of `FAMILIES`, whatever the order in the option
        families = tuple(family for family in FAMILIES if family in stated_names)
    name = Path(args.robot).stem
    if Path(args.robot).is_dir():  # a folder may have another name than its robot, whose reports look for the score
        name = assets.files(args.robot).name
    folder = show.folder(args, name)
    with show.progress(args.quiet or args.json) as progress:
        score = selftest(
            args.robot, protocol=args.protocol, families=families, count=args.count, seed=args.seed, progress=progress
        )
    return show.store(score, args, folder, ["selftest.json"])
