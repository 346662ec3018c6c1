"""`twin sweep`: evaluate designs of a robot that differ in parameters or distances."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin.cli.parser import Command, count
from twin.core.errors import TwinError

EXAMPLES = """\
  twin sweep sils --vary l_p=120..150mm --vary l_2=180..260mm --samples 200
  twin sweep sher --vary l4:e_a-e_d=70..77mm --grid 9     a distance in the mechanism, evaluated by tolerance
  twin sweep sils --vary l_p=120..150mm --grid 50 --scheduler tcp://10.0.0.1:8786 --parquet"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin sweep`."""
    command.robot()
    text = "parameter of the equations, or distance body:joint-joint, with its range; may be given more than once"
    command.text("--vary", "NAME=LOW..HIGH", text, action="append", default=[])
    command.number("--samples", "N", "number of samples of the Latin hypercube", 64, count)
    command.integer("--grid", "number of values of each varied quantity: evaluate the full grid instead of samples")
    command.text("--objective", "NAMES", "comma-separated list of volume, conditioning, margin, tolerance")
    command.trocar()
    command.seed("random seed of the Latin hypercube")
    command.scheduler()
    command.device()
    command.integer("--workers", "number of worker processes (default: one for each processor)")
    command.flag("--parquet", "also write sweep.parquet")
    command.flag("--fresh", "evaluate all designs again instead of reusing results")
    command.out("./twin-out/<robot>/sweep-<key>/, one for each sweep")


def run(args: argparse.Namespace) -> int:
    """Evaluate every design and print the best ones; each result is stored at once, and stored results are reused."""
    from twin import api
    from twin.analysis import table
    from twin.analysis.sweep import sweep as judge
    from twin.cli import show
    from twin.cli.option_values import device
    from twin.core import assets
    from twin.ui.report.report_folder import write_result

    if not args.vary:
        raise TwinError("--vary is required, for example --vary l_p=120..150mm; it may be given more than once")
    for name, value, least in (("--samples", args.samples, 1), ("--grid", args.grid, 2)):
        if value is not None and value < least:
            raise TwinError(f"{name} {value}: give at least {least}")
    if args.workers is not None and args.workers < 1:
        raise TwinError(f"--workers {args.workers}: give at least 1")
    if args.parquet:
        table.arrow()  # raises now, not after the sweep, if the package is missing
    robot = api.load(args.robot)
    assets.require_writable(Path(args.out) if args.out else Path("twin-out") / robot.name)
    source = args.robot
    if Path(args.robot).exists():  # worker processes may have another working directory
        source = str(Path(args.robot).resolve())
    with show.progress(args.quiet or args.json) as progress:
        designs = judge(
            robot,
            args.vary,
            args.out,
            source=source,
            objectives=show.listed(args.objective),
            protocol=args.protocol,
            samples=args.samples,
            grid=args.grid,
            seed=args.seed,
            workers=args.workers,
            scheduler=args.scheduler,
            device=device(args),
            fresh=args.fresh,
            progress=progress,
        )
        progress("write", 0.0)
        with assets.atomic_folder(designs.folder) as work:
            table.write(designs.rows, work, parquet=args.parquet)
            pictures = write_result(designs, work)
    return show.finish(designs, args, designs.folder, [*pictures, "sweep.csv"])
