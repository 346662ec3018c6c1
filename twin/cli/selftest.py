"""`twin selftest`: seed faults into a correct robot, and count how many of them the validator finds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli import show
from twin.core.errors import TwinError, unknown

if TYPE_CHECKING:
    from twin.analysis.mutation.fault import Family


def selftest(args: argparse.Namespace) -> int:
    """Seed faults, validate and store the score; the exit code is 1 for a low score or for a false alarm."""
    from twin.analysis.mutation.fault import FAMILIES
    from twin.analysis.mutation.run import selftest as run

    if args.count < 1:
        raise TwinError(f"--count {args.count}: give a number of faults, 1 or more")
    if args.seed < 0:
        raise TwinError(f"--seed {args.seed}: give a number that is not negative")
    families: tuple[Family, ...] = FAMILIES
    if args.family:
        asked = [f.strip() for f in args.family.split(",")]
        for name in asked:
            if name not in FAMILIES:
                raise TwinError(f"--family: {unknown('family', name, FAMILIES)}")
        families = tuple(f for f in FAMILIES if f in asked)
    name = Path(args.robot).resolve().name if Path(args.robot).is_dir() else args.robot
    folder = show.folder(args, name)
    with show.progress(args.quiet or args.json) as progress:
        score = run(
            args.robot, protocol=args.protocol, families=families, count=args.count, seed=args.seed, progress=progress
        )
    return show.store(score, args, folder, ["selftest.json"])
