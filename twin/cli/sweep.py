"""`twin sweep`: evaluate designs that differ in parameters of the equations or distances of the mechanism."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin import api
from twin.cli import show
from twin.core import assets
from twin.core.errors import TwinError


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
