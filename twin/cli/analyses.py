"""Commands that analyse designs: workspace, tool error, and sweeps over parameters and distances."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from twin import api
from twin.cli import show
from twin.core import assets
from twin.core.errors import TwinError
from twin.core.units import DEG, MM, UM


def workspace(args: argparse.Namespace) -> int:
    """Compute the workspace, print its volumes, write a picture and point clouds."""
    from twin.analysis import cloud
    from twin.analysis.search import workspace as search
    from twin.ui.report.files import write_result

    for name, value, least in (("--count", args.count, 1000), ("--turns", args.turns, 1)):
        if value < least:
            raise TwinError(f"{name} {value}: give at least {least}")
    if args.step_mm is not None and not (np.isfinite(args.step_mm) and args.step_mm > 0):
        raise TwinError(f"--step-mm {args.step_mm:g}: give a positive number of millimetres")
    if not 0 <= args.tilt_deg <= 180:
        raise TwinError(f"--tilt-deg {args.tilt_deg:g}: give degrees from 0 to 180")
    robot = api.load(args.robot)
    folder = show.folder(args, robot.name, "workspace")
    with assets.atomic_folder(folder) as work, show.progress(args.quiet or args.json) as progress:
        found = search(
            robot,
            args.count,
            args.step_mm * MM if args.step_mm else None,
            tilt=args.tilt_deg * DEG,
            turns=args.turns,
            by_joint_positions=args.joints,
            protocol=args.protocol,
            store=work,
            scheduler=args.scheduler,
            source=args.robot,
            progress=progress,
        )
        progress("write", 0.0)
        shown = write_result(found, work)
        cloud.write_ply(found, work / "workspace.ply")
        cloud.write_usd(found, work / "workspace.usdc")
    return show.finish(found, args, folder, [*shown, "workspace.ply, .usdc, .json"])


def tolerance(args: argparse.Namespace) -> int:
    """Compute and print the tool error; write a picture and a file.

    The exit code is 1 if a requirement is not met.
    """
    from twin.analysis.tolerance import Spread
    from twin.analysis.tolerance import tolerance as compute

    if args.samples and args.samples < 1000:
        raise TwinError(f"--samples {args.samples}: give at least 1000, or 0 to omit the Monte Carlo check")
    required = show.micrometres("--require-um", args.require_um)
    robot = api.load(args.robot)
    folder = show.folder(args, robot.name, "tolerance")
    spread = Spread(args.sigma_um * UM, args.sigma_deg * DEG, args.encoder_um * UM, args.encoder_deg * DEG)
    with show.progress(args.quiet or args.json) as progress:
        found = compute(
            robot,
            spread,
            args.protocol,
            required=required,
            samples=args.samples,
            seed=args.seed,
            progress=progress,
        )
    return show.store(found, args, folder)


def sweep(args: argparse.Namespace) -> int:
    """Evaluate every design and print the best; results are stored immediately, and stored results are reused."""
    from twin.analysis import table
    from twin.analysis.sweep import sweep as judge
    from twin.ui.report.files import write_result

    if not args.vary:
        raise TwinError("--vary is required, for example --vary l_p=120..150mm; it may be given more than once")
    if args.samples < 1 or (args.grid is not None and args.grid < 2):
        raise TwinError("--samples: give at least 1; --grid: give at least 2 levels")
    if args.workers is not None and args.workers < 1:
        raise TwinError(f"--workers {args.workers}: give at least 1")
    if args.parquet:
        table.arrow()
    robot = api.load(args.robot)
    folder = Path(args.out) if args.out else Path("twin-out") / robot.name
    assets.require_writable(folder)

    def place(key: str) -> Path:
        nonlocal folder
        folder = folder if args.out else folder / f"sweep-{key[:8]}"
        return folder

    with show.progress(args.quiet or args.json) as progress:
        found = judge(
            robot,
            args.vary,
            place,
            source=str(Path(args.robot).resolve()) if Path(args.robot).exists() else args.robot,
            objectives=[x.strip() for x in (args.objective or "").split(",") if x.strip()],
            protocol=args.protocol,
            samples=args.samples,
            grid=args.grid,
            seed=args.seed,
            workers=args.workers,
            scheduler=args.scheduler,
            fresh=args.fresh,
            progress=progress,
        )
        progress("write", 0.0)
        with assets.atomic_folder(folder) as made:
            table.write(found.rows, made, parquet=args.parquet)
            shown = write_result(found, made)
    return show.finish(found, args, folder, [*shown, "sweep.csv"])
