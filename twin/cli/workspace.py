"""`twin workspace`: what the tool reaches, how well conditioned, how far from the limits and from singularities."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin import api
from twin.cli import show
from twin.core import assets
from twin.core.errors import TwinError
from twin.core.units import DEG, MM

if TYPE_CHECKING:
    from twin.analysis.workspace import Workspace


_POSITIONS = 50_000_000
"""What is kept of a position takes 16 bytes on disk; what is said of all takes as much memory again."""


def workspace(args: argparse.Namespace) -> int:
    """Sweep, print the volumes, write a picture and clouds of points."""
    from twin.analysis import cloud
    from twin.ui.report.style import png
    from twin.ui.report.workspace import figure

    for name, value, least in (("--count", args.count, 1000), ("--turns", args.turns, 1)):
        if value < least:
            raise TwinError(f"{name} {value}: give at least {least}")
    if args.step_mm is not None and not (np.isfinite(args.step_mm) and args.step_mm > 0):
        raise TwinError(f"--step-mm {args.step_mm:g}: give a positive number of millimetres")
    if not 0 <= args.tilt_deg <= 180:
        raise TwinError(f"--tilt-deg {args.tilt_deg:g}: give degrees from 0 to 180")
    robot = api.load(args.robot)
    if args.protocol or robot.mechanism.trocars:
        robot = robot.bound(robot.protocol(args.protocol))
    folder = Path(args.out) if args.out else Path("twin-out") / robot.name / "workspace"
    assets.require_writable(folder)
    with assets.atomic_folder(folder) as work, show.progress(args.quiet or args.json) as progress:
        found = _found(robot, args, work, progress)
        progress("write", 0.0)
        summary = {"robot": robot.name, **found.summary(), "folder": str(folder)}
        (work / "workspace.json").write_text(show.as_json(summary) + "\n", encoding="utf-8")
        picture = figure(robot.name, found.grid.low, found.grid.step, found.cube, summary)
        (work / "workspace.png").write_bytes(png(picture))
        cloud.write_ply(found, work / "workspace.ply")
        cloud.write_usd(found, work / "workspace.usdc")
    if args.json:
        print(show.as_json(summary))
        return 0
    print("\n".join(_lines(summary)))
    return 0


def _found(robot: api.Robot, args: argparse.Namespace, work: Path, progress: Callable[[str, float], None]) -> Workspace:
    from twin.analysis.cluster import cluster
    from twin.analysis.joints import by_joints
    from twin.analysis.workspace import Grid, box, centre, workspace

    step = args.step_mm * MM if args.step_mm else None
    closed = robot.files is not None and robot.files.has_equations and robot.kinematics().closed_inverse
    if args.joints or not closed:
        if args.scheduler:
            raise TwinError("--scheduler: samples of joints are judged on this machine; leave --joints out")
        return by_joints(robot, args.count, step, progress)
    progress("find the box", 0.0)
    T, tilt = centre(robot), args.tilt_deg * DEG
    turns = args.turns if tilt else 1
    low, high = box(robot, T, tilt, turns)
    if step is None:
        step = float((np.prod(high - low) * turns / args.count) ** (1 / 3))
    nx, ny, nz = (int(n) for n in np.floor((high - low) / step) + 1)
    grid = Grid(low, step, (nx, ny, nz), T[:3, :3], tilt, turns)
    if grid.positions > _POSITIONS:
        raise TwinError(
            f"{grid.positions:.3g} positions; at most {_POSITIONS:.0e} are kept. Take a larger --step-mm, or "
            "more --turns at fewer positions"
        )

    def store(shape: tuple[int, int]) -> np.ndarray:
        # On disk: the system keeps in memory what there is room for.
        return np.lib.format.open_memmap(work / "workspace.npy", "w+", np.float32, shape)

    if args.scheduler:
        with cluster(args.scheduler) as client:
            return workspace(robot, grid, store, progress, client=client, source=args.robot, protocol=args.protocol)
    return workspace(robot, grid, store, progress)


def _lines(s: Mapping[str, Any]) -> Iterator[str]:
    yield f"{s['robot']} · {_what(s)} · cells of {s['step_mm']:.3g} mm"
    yield ""
    corner = ", ".join(f"{a:.0f} .. {b:.0f}" for a, b in zip(s["box_mm"]["low"], s["box_mm"]["high"], strict=True))
    yield f"  reached           {s['volume_dm3']:.4g} ± {s['volume_error_dm3']:.1g} dm³ (grid) in x, y, z = {corner} mm"
    if s["orientations"] > 1:
        yield f"  every orientation {s['volume_every_orientation_dm3']:.4g} dm³"
    if s["global_conditioning_index"] is not None:
        spread = ", ".join(f"{k}: {v:.3f}" for k, v in s["inverse_condition_quantiles"].items())
        yield f"  inverse condition {s['global_conditioning_index']:.3f} in the mean ({spread})"
    spread = ", ".join(f"{k}: {v:.2f}" for k, v in s["limit_margin_quantiles"].items())
    yield f"  joint limits      best margin of a position, 1 in the middle of the range: {spread}"
    if s["smallest_singularity_measure"] is not None:
        yield f"  singularity       smallest measure {s['smallest_singularity_measure']:.3g}"
    if s["best_position_mm"] is not None:
        yield f"  best position     {', '.join(f'{x:.0f}' for x in s['best_position_mm'])} mm"
    yield "  collisions are not looked for"
    yield ""
    yield f"  {Path(s['folder']) / 'workspace.png'}"
    yield f"  {Path(s['folder']) / 'workspace.ply'}, .usdc, .json"


def _what(s: Mapping[str, Any]) -> str:
    if s.get("sampled") == "joints":
        return f"{s['samples']} joint positions, {100 * s['assembled']:.1f} % assembled"
    if s["orientations"] == 1:
        return f"{s['poses']} positions in one orientation"
    return f"{s['positions']} positions in {s['orientations']} orientations within {s['tilt_deg']:g}° about each axis"
