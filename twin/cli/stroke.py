"""`twin validate --sweep`: the stroke of each joint, equations against mechanism and against stand-ins."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from twin import api
from twin.cli import show
from twin.cli.variants import asked
from twin.core import assets
from twin.core.errors import TwinError, unknown
from twin.core.units import DEG, MM, UM


def run(robot: api.Robot, args: argparse.Namespace) -> int:
    """Sweep, print a table, write sweep.json, sweep.csv and sweep.png; exit 1 if the equations disagree."""
    from twin.ui.report.style import png
    from twin.ui.report.sweep import figure
    from twin.validation.sweep import STANDINS, sweep

    standins = tuple(dict.fromkeys(filter(None, (args.compare or "").split(","))))
    for name in standins:
        if name not in STANDINS:
            raise TwinError(f"--compare: {unknown('stand-in', name, STANDINS)}")
    joints = robot.joints if args.sweep in (None, "all") else tuple(args.sweep.split(","))
    for name in joints:
        if name not in robot.joints:
            raise TwinError(f"--sweep: {unknown('active joint', name, robot.joints)}")
    variants = asked(args.variant)
    if isinstance(variants, str):
        raise TwinError("--sweep judges one choice of variants: give EQ=NAME pairs")
    folder = (Path(args.out) if args.out else Path("twin-out") / robot.name) / "sweep"
    assets.require_writable(folder)
    with show.progress(args.quiet or args.json) as progress:
        progress("read CAD", 0.0)
        kin, model = robot.kinematics(variants), robot.reference()
        home = model.home().q if robot.mechanism.home is None else robot.mechanism.home
        sweeps = []
        for i, joint in enumerate(joints):
            progress(f"sweep {joint}", (i + 0.5) / len(joints))
            sweeps.append(sweep(kin, model, joint, home, standins))
    need = robot.cad.description.requirement if robot.files is not None else None
    requirement = (need.tool_um * UM, f"required: {need.tool_um:g} µm") if need else None
    agree = all(s.agrees for s in sweeps)
    data = {
        "verdict": "agree" if agree else "disagree",
        "robot": robot.name,
        "requirement": {"tool_um": need.tool_um, "provenance": need.provenance, "note": need.note} if need else None,
        "sweeps": [s.as_dict() for s in sweeps],
        "folder": str(folder),
    }
    with assets.atomic_folder(folder) as work:
        (work / "sweep.json").write_text(show.as_json(data) + "\n", encoding="utf-8")
        (work / "sweep.png").write_bytes(png(figure(robot.name, sweeps, requirement)))
        for s in sweeps:
            curves = {"equations": s.formula, **s.standins}
            columns = {n: c for n, c in curves.items() if len(c.offset)}
            head = [f"{s.joint}_{'deg' if s.angle else 'mm'}"]
            head += [f"{n}_{a}_um" for n in columns for a in "xyz"]
            body = np.column_stack([s.q / (DEG if s.angle else MM), *(c.offset / UM for c in columns.values())])
            np.savetxt(work / f"{s.joint}.csv", body, "%.9g", ",", header=",".join(head), comments="")
    if args.json:
        print(show.as_json(data))
        return 0 if agree else 1
    print(f"{robot.name} · each stroke with the other joints at home · tool against the mechanism\n")
    rows = []
    for s in sweeps:
        scale, unit = (DEG, "deg") if s.angle else (MM, "mm")
        reach = f"{s.q[0] / scale:g} .. {s.q[-1] / scale:g} {unit}"
        for name, curve in {"equations": s.formula, **s.standins}.items():
            d = curve.as_dict()
            if d["position_max"] is None:
                rows.append((s.joint, reach, name, "-", "-", "-", curve.note))
                continue
            figures = [f"{d[k] / UM:.3g} µm" for k in ("position_mean", "position_max")]
            turned = f"{d['rotation_max'] / DEG:.2g}°"
            if name == "equations":
                verdict = "ok" if s.agrees else "DIFFERS"
            elif need:
                verdict = "within" if d["position_max"] <= need.tool_um * UM else f"over {need.tool_um:g} µm"
            else:
                verdict = ""
            rows.append((s.joint, reach, name, *figures, turned, verdict))
    print(show.table(rows, ("joint", "stroke", "model", "mean", "worst", "turned", "")))
    if need:
        print(f"\n  requirement: {need.tool_um:g} µm at the tool ({need.provenance}: {need.note})")
    print(f"\n  {folder / 'sweep.png'}")
    return 0 if agree else 1
