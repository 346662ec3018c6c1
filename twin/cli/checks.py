"""Commands that check equations, files and the validator itself."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from twin import api
from twin.cli import show
from twin.cli.commands import asked
from twin.core.errors import TwinError, unknown

if TYPE_CHECKING:
    from twin.analysis.mutation.fault import Family


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


def console(args: argparse.Namespace) -> int:
    """Check the equations and print every clause (requirement); write JSON, page and picture.

    The exit code is 1 if a clause fails.
    """
    variants = asked(args.variant)
    chosen = [variants] if isinstance(variants, str) else map("-".join, (variants or {}).items())
    with show.progress(args.quiet or args.json) as progress:
        found = api.console(args.console, variants, progress)
    return show.store(found, args, show.folder(args, args.console, "-".join(["console", *chosen])))


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
    name = Path(args.robot).resolve().stem
    folder = show.folder(args, name)
    with show.progress(args.quiet or args.json) as progress:
        score = run(
            args.robot, protocol=args.protocol, families=families, count=args.count, seed=args.seed, progress=progress
        )
    return show.store(score, args, folder, ["selftest.json"])


def audit(args: argparse.Namespace) -> int:
    """Audit a file or folder and print the results; the exit code is 1 for a fault, 2 for an unreadable file."""
    with show.progress(args.quiet or args.json) as progress:
        report = api.audit(args.path, args.robot, progress)
    return show.finish(report, args, text=report.text(args.all))
