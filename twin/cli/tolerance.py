"""`twin tolerance`: compute the tool error caused by part and encoder errors, and compare it with a requirement."""

from __future__ import annotations

import argparse

import numpy as np

from twin import api
from twin.cli import show
from twin.core.errors import TwinError
from twin.core.units import DEG, UM


def tolerance(args: argparse.Namespace) -> int:
    """Compute and print the tool error; write a picture and a file.

    The exit code is 1 if a requirement is not met.
    """
    from twin.analysis.tolerance import Spread
    from twin.analysis.tolerance import tolerance as compute

    if args.samples and args.samples < 1000:
        raise TwinError(f"--samples {args.samples}: give at least 1000, or 0 for none")
    if args.require_um is not None and not (np.isfinite(args.require_um) and args.require_um > 0):
        raise TwinError(f"--require-um {args.require_um:g}: give a positive number of micrometres")
    robot = api.load(args.robot)
    folder = show.folder(args, robot.name, "tolerance")
    spread = Spread(args.sigma_um * UM, args.sigma_deg * DEG, args.encoder_um * UM, args.encoder_deg * DEG)
    with show.progress(args.quiet or args.json) as progress:
        found = compute(
            robot,
            spread,
            args.protocol,
            required=None if args.require_um is None else args.require_um * UM,
            samples=args.samples,
            seed=args.seed,
            progress=progress,
        )
    return show.store(found, args, folder)
