"""`twin sweep`: designs beside the drawn one, by parameters of the equations or distances of the mechanism."""

from __future__ import annotations

import argparse
import signal
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin import api
from twin.cli import show
from twin.core import assets
from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.core.units import MM

if TYPE_CHECKING:
    from twin.analysis.design import Job
    from twin.analysis.table import Table


def sweep(args: argparse.Namespace) -> int:
    """Judge every design, keep each as it is judged, print the best; what was judged before is not judged again."""
    from twin.analysis import design, table
    from twin.ui.report.design import figure
    from twin.ui.report.style import png

    if not args.vary:
        raise TwinError("--vary: say what is varied, as in --vary l_p=120..150mm; it may be given more than once")
    if args.samples < 1 or (args.grid is not None and args.grid < 2):
        raise TwinError("--samples: give at least 1; --grid: give at least 2 levels")
    if args.workers is not None and args.workers < 1:
        raise TwinError(f"--workers {args.workers}: give at least 1")
    if args.parquet:
        table.arrow()
    robot = api.load(args.robot)
    if args.protocol or robot.mechanism.trocars:
        robot = robot.bound(robot.protocol(args.protocol))
    factors = [design.factor(robot, text) for text in args.vary]
    if len({f.name for f in factors}) < len(factors):
        raise TwinError("--vary: a factor is given twice")
    default = "tolerance" if all(":" in f.name for f in factors) else "volume,conditioning"
    objectives = tuple(dict.fromkeys(x.strip() for x in (args.objective or default).split(",")))
    folder = Path(args.out) if args.out else Path("twin-out") / robot.name
    assets.require_writable(folder)
    with show.progress(args.quiet or args.json) as progress:
        progress("positions", 0.0)
        source = str(Path(args.robot).resolve()) if Path(args.robot).exists() else args.robot
        work = design.job(robot, source, args.protocol, factors, objectives)
        designs = design.values(factors, args.samples, args.grid, args.seed)
        if not args.out:
            folder /= f"sweep-{table.key_of(work, designs)[:8]}"
        with table.Table(folder, work, designs, fresh=args.fresh) as kept:
            before = len(kept.done)
            _judge(work, designs, kept, args, progress)
        progress("write", 0.0)
        judged = np.array([[kept.done[i][n] for n in objectives] for i in range(len(designs))])
        best = design.pareto(judged, [design.OBJECTIVES[n][1] for n in objectives])
        rows = [{**design.row(work, i, designs[i], kept.done[i]), "pareto": bool(best[i])} for i in range(len(designs))]
        names = list(rows[0])[1:-1]
        shown = designs / np.array([f.scale for f in factors])
        labels, measured = names[: len(factors)], names[len(factors) :]
        with assets.atomic_folder(folder) as made:
            files = table.write(rows, made, parquet=args.parquet)
            (made / "sweep.png").write_bytes(png(figure(robot.name, labels, shown, measured, judged, best)))
            names_written = [p.name for p in files]
    data = {
        "robot": robot.name,
        "designs": len(designs),
        "judged_before": before,
        "objectives": {n: {"unit": design.OBJECTIVES[n][0], "meaning": design.OBJECTIVES[n][2]} for n in objectives},
        "grid": None if "volume" not in objectives else _grid(work),
        "drawn": rows[0],
        "pareto": [r for r in rows if r["pareto"]],
        "folder": str(folder),
        "files": [*names_written, "sweep.png"],
    }
    print(show.as_json(data) if args.json else "\n".join(_lines(data)))
    return 0


def _grid(work: Job) -> dict[str, float]:
    from twin.analysis.design import grid_error

    return {"step_mm": work.step / MM, "volume_error_dm3": grid_error(work)}


def _judge(
    work: Job, designs: Array, kept: Table, args: argparse.Namespace, progress: Callable[[str, float], None]
) -> None:
    from twin.analysis.cluster import HERE, cluster, each
    from twin.analysis.design import judge

    todo = [i for i in range(len(designs)) if i not in kept.done]
    if not todo:
        return
    # To be stopped is to be asked to stop: what is judged is kept.
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with cluster(args.scheduler or HERE, args.workers) as client:
            for k, result in each(client, judge, [(work, designs[i].tolist()) for i in todo]):
                kept.add(todo[k], result)
                progress(f"{len(kept.done)} of {len(designs)} designs", len(kept.done) / len(designs))
    finally:
        signal.signal(signal.SIGTERM, before)


def _lines(data: Mapping[str, Any]) -> Iterator[str]:
    yield f"{data['robot']} · {data['designs']} designs, {data['judged_before']} of them judged before"
    for name, meaning in data["objectives"].items():
        yield f"  {name}: {meaning['meaning']}"
    if (grid := data["grid"]) is not None:
        cells = f"positions {grid['step_mm']:.3g} mm apart, the same for every design"
        yield f"  volume is counted on {cells}: ± {grid['volume_error_dm3']:.1g} dm³ as drawn"
    yield ""
    head = [n for n in data["drawn"] if n != "pareto"]
    best = [r for r in data["pareto"] if r["design"] != 0]
    rows = [tuple(_text(n, r[n]) for n in head) for r in [data["drawn"], *best[:20]]]
    yield show.table(rows, head, fit=True)
    if len(best) > 20:
        yield f"  and {len(best) - 20} more that none beats"
    beaten = data["designs"] - len(best) - 1
    if beaten:
        yield f"  not shown: {beaten} that another beats or that cannot be built; all are in sweep.csv"
    yield ""
    yield f"  {Path(data['folder']) / 'sweep.png'}"
    yield f"  {Path(data['folder']) / 'sweep.csv'}"


def _text(name: str, value: Any) -> str:
    if name == "design":
        return "as drawn" if value == 0 else str(value)
    return f"{value:.4g}"
