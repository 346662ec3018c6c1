"""`twin tolerance`: errors of parts and encoders through the loops to the tool, against what is required."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from twin import api
from twin.cli import show
from twin.core import assets
from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.core.units import DEG, UM

_ALONG = 12
"""States along a protocol."""


def tolerance(args: argparse.Namespace) -> int:
    """Compute, print, write a picture and a file; exit 1 if a requirement is not met."""
    from twin.analysis.tolerance import Spread, Tolerances, all_states, as_dict
    from twin.ui.report.style import png
    from twin.ui.report.tolerance import figure

    given = (args.sigma_um, args.sigma_deg, args.encoder_um, args.encoder_deg)
    if args.samples and args.samples < 1000:
        raise TwinError(f"--samples {args.samples}: give at least 1000, or 0 for none")
    if args.require_um is not None and not (np.isfinite(args.require_um) and args.require_um > 0):
        raise TwinError(f"--require-um {args.require_um:g}: give a positive number of micrometres")
    robot = api.load(args.robot)
    if args.protocol or robot.mechanism.trocars:
        robot = robot.bound(robot.protocol(args.protocol))
    folder = Path(args.out) if args.out else Path("twin-out") / robot.name / "tolerance"
    assets.require_writable(folder)
    spread = Spread(args.sigma_um * UM, args.sigma_deg * DEG, args.encoder_um * UM, args.encoder_deg * DEG)
    with show.progress(args.quiet or args.json) as progress:
        states = _states(robot, args, progress)
        progress("equations of the errors", 0.0)
        budgets = all_states(Tolerances(robot.mechanism, spread), states, args.samples, args.seed, progress)
    asked = robot.cad.description.requirement if robot.files is not None else None
    required = args.require_um * UM if args.require_um is not None else asked.tool_um * UM if asked else None
    rows = [as_dict(b) for b in budgets]
    worst = max(rows, key=lambda b: b["within_position"])
    met = None if required is None else worst["within_position"] <= required
    data = {
        "robot": robot.name,
        "verdict": "unchecked" if met is None else "agree" if met else "disagree",
        "errors": {
            **dict(zip(("sigma_um", "sigma_deg", "encoder_um", "encoder_deg"), given, strict=True)),
            "note": "normal, independent, about each axis of each joint frame; ASSUMED unless you know better",
        },
        "required_um": None if required is None else required / UM,
        "requirement": f"{asked.provenance}: {asked.note}" if asked and args.require_um is None else "",
        "factor": None if required is None else required / worst["within_position"],
        "worst": worst["state"],
        "states": rows,
        "folder": str(folder),
    }
    with assets.atomic_folder(folder) as work:
        (work / "tolerance.json").write_text(show.as_json(data) + "\n", encoding="utf-8")
        (work / "tolerance.png").write_bytes(png(figure(robot.name, rows, required)))
    print(show.as_json(data) if args.json else "\n".join(_lines(data)))
    return 1 if met is False else 0


def _states(
    robot: api.Robot, args: argparse.Namespace, progress: Callable[[str, float], None]
) -> list[tuple[str, Array]]:
    if args.protocol:
        trajectory = api.plan(robot, args.protocol, progress)
        at = np.unique(np.linspace(0, len(trajectory.t) - 1, _ALONG).astype(int))
        return [(f"t = {trajectory.t[k]:.2f} s", trajectory.q[k]) for k in at]
    postures = robot.mechanism.postures
    return [(n, robot.mechanism.posture(n)) for n in postures] or [("as drawn", robot.loops.q)]


def _lines(data: Mapping[str, Any]) -> Iterator[str]:
    e = data["errors"]
    yield f"{data['robot']} · standard deviations about each axis of each joint frame, ASSUMED unless you know better:"
    yield (
        f"  {e['sigma_um']:g} µm and {e['sigma_deg']:g}° of its place, {e['encoder_um']:g} µm and "
        f"{e['encoder_deg']:g}° of an encoder"
    )
    yield ""
    rows = []
    for s in data["states"]:
        sd = ", ".join(f"{x / UM:.3g}" for x in s["sigma_position"])
        position, rotation = f"{s['within_position'] / UM:.4g} µm", f"{s['within_rotation'] / DEG:.3g}°"
        worst = ", ".join(f"{c['what']} {100 * c['position']:.0f} %" for c in s["contributors"][:3])
        rows.append((s["state"], position, rotation, sd, worst))
    yield show.table(rows, ("state", "95 % within", "turned", "sigma x, y, z [µm]", "worst contributors"), fit=True)
    yield ""
    for s in data["states"]:
        if chance := s.get("monte_carlo"):
            yield (
                f"  Monte Carlo, {chance['samples']} machines in state '{s['state']}': 95 % within "
                f"{chance['within_position'] / UM:.4g} µm; standard deviations differ by "
                f"{100 * chance['difference']:.2g} %"
            )
    if data["required_um"] is not None:
        met, factor = data["factor"] >= 1, data["factor"]
        text = "is met" if met else f"is NOT met: all errors together would have to be {1 / factor:.3g} times smaller"
        yield f"  required: {data['required_um']:g} µm {text}"
        if data["requirement"]:
            yield f"    {data['requirement']}"
    yield ""
    yield f"  {Path(data['folder']) / 'tolerance.png'}"
