"""`twin selftest`: seed faults into a correct robot, and count how many of them the validator finds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli import show
from twin.core import assets
from twin.core.errors import TwinError, unknown

if TYPE_CHECKING:
    from twin.analysis.mutation.fault import Family


def selftest(args: argparse.Namespace) -> int:
    """Seed faults, validate and store the score; the exit code is 1 for a low score or for a false alarm."""
    from twin.analysis.mutation.fault import FAMILIES
    from twin.analysis.mutation.run import selftest as run
    from twin.ui.report.files import write_result

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
    folder = Path(args.out) if args.out else Path("twin-out") / name
    with show.progress(args.quiet or args.json) as progress:
        score = run(
            args.robot, protocol=args.protocol, families=families, count=args.count, seed=args.seed, progress=progress
        )
    with assets.atomic_folder(folder) as work:
        shown = write_result(score, work)
    return show.finish(score, args, folder, ["selftest.json", *shown])
