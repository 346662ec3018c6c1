"""`twin operate`: a scripted hand works a protocol by handle and pedal, and is measured as the users of a study are."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from twin import api
from twin.cli import show
from twin.core import assets
from twin.core.errors import TwinError
from twin.core.findings import EXIT_CODES, Finding, by_severity, verdict
from twin.core.units import MM, UM

_NEAR, _THROUGH = 0.1e-3, 0.05e-3
"""How near the tool must come to the end of a phase, in m; ASSUMED: a tenth, and a twentieth before a hole."""


def operate(args: argparse.Namespace) -> int:
    """Let the hand work, print its measures, write JSON, CSV and a picture; exit 1 if a hole was not reached."""
    from twin.planning.path import build
    from twin.simulation.control.contract import clutch
    from twin.simulation.control.operator import Goal, measure
    from twin.simulation.control.operator import operate as work_through
    from twin.simulation.control.teleoperation import Gains, Teleoperation
    from twin.simulation.control.velocity import Limits
    from twin.ui.report.operate import figure
    from twin.ui.report.style import png

    if args.trials < 1:
        raise TwinError(f"--trials {args.trials}: at least 1")
    if not args.scale > 0:
        raise TwinError(f"--scale {args.scale:g}: must be above 0")
    robot = api.load(args.robot)
    protocol = robot.protocol(args.protocol)
    folder = Path(args.out) if args.out else Path("twin-out") / robot.name / f"{protocol.name}-operator"
    assets.require_writable(folder)
    with show.progress(args.quiet or args.json) as progress:
        progress("read CAD", 0.0)
        kin, T_tool_tip = robot.kinematics(), robot.mechanism.frame_in_tool(protocol.frame)
        paths = build(protocol, T_tool_tip)
        goals = []
        for path in paths:
            inserts = path.phase.type == "insertion"
            end = path.motion(np.array([1.0])).Ts_base_tool[0]
            goals.append(Goal(path.phase.name, end, _NEAR if inserts else _THROUGH, inserts))
        if not any(g.inserts for g in goals):
            raise TwinError(f"protocol '{protocol.name}' inserts nowhere: there is no hole to reach")
        active = robot.mechanism.active
        low, high = robot.mechanism.limits.T
        limits = Limits(low, high, np.array([j.max_speed or np.inf for j in active]))
        scale = np.array([1.0 if u == "rad" else args.scale for u in kin.formula.coordinates.units])

        def controller() -> Teleoperation:
            return Teleoperation(Gains(scale=scale), 1 / 200, args.clutch, len(scale))

        contract = clutch(controller)
        start = kin.inverse(paths[0].motion(np.array([0.0])).Ts_base_tool[0])
        trials = []
        for i in range(args.trials):

            def tell(name: str, part: float, i: int = i) -> None:
                progress(f"trial {i + 1} of {args.trials}: {name}", max((i + part) / args.trials, 1e-6))

            seed = args.seed + i
            record = work_through(kin, start, limits, controller(), goals, seed, solver=args.solver, progress=tell)
            measures = measure(record, goals, T_tool_tip, protocol.shaft_axis)
            trials.append((seed, record, measures))
    findings = []
    if not contract.keeps:
        findings.append(
            Finding(
                "clutch.jump",
                "disagreement",
                f"pressed again with the hand {contract.handle / MM:g} mm away and at rest, an ideal tool goes "
                f"{contract.jump / MM:.3g} mm; it must stand",
                "eq. (7)",
                size=contract.jump / MM,
                unit="mm",
                limit=0.0,
                suggestion="--clutch corrected keeps the offset until the pedal is pressed again",
            )
        )
    for seed, record, measures in trials:
        untouched = [n for n, touched in measures.contacts.items() if not touched]
        if untouched:
            why = f"; the hand gave up at '{record.missed}'" if record.missed else ""
            text = f"seed {seed}: no contact in {', '.join(untouched)}{why}"
            findings.append(Finding("task.missed", "disagreement", text, untouched[0]))
    rows = [
        {
            "seed": seed,
            "time_s": m.time,
            "clutch_presses": m.presses,
            "path_mm": m.path / MM,
            "contacts": m.contacts,
            "nearest_um": {n: v / UM for n, v in m.nearest.items()},
            "aside_um": {n: v / UM for n, v in m.aside.items()},
            "gave_up": r.missed,
        }
        for seed, r, m in trials
    ]
    data = {
        "verdict": verdict(findings),
        "robot": robot.name,
        "protocol": protocol.name,
        "clutch": args.clutch,
        "scale": args.scale,
        "solver": args.solver,
        "assumed": "hand, tremor, gains, scale and contact: the paper prints none",
        "trials": rows,
        "findings": [f.as_dict() for f in findings],
        "folder": str(folder),
    }
    with assets.atomic_folder(folder) as work:
        (work / "operate.json").write_text(show.as_json(data) + "\n", encoding="utf-8")
        (work / "operate.png").write_bytes(png(figure(robot.name, protocol.name, goals, trials)))
        names = kin.formula.coordinates.names
        head = ["t_s", "pedal", *(f"handle_{n}" for n in names), *robot.joints, "tip_x_m", "tip_y_m", "tip_z_m"]
        for seed, r, _ in trials:
            tip = (r.Ts_base_tool @ T_tool_tip)[:, :3, 3]
            body = np.column_stack([r.t, r.pedal, r.handle, r.q, tip])
            file = work / f"seed{seed}.csv"
            np.savetxt(file, body, "%.9g", ",", header=",".join(head), comments="")
    if args.json:
        print(show.as_json(data))
        return EXIT_CODES[verdict(findings)]
    print(f"{robot.name} · {protocol.title} · {args.clutch} clutch · hand, tremor, gains and scale ASSUMED\n")
    lines = []
    for seed, _, m in trials:
        touched = f"{sum(m.contacts.values())} of {len(m.contacts)}"
        aside = f"{max(m.aside.values()) / UM:.0f} µm" if m.aside else "-"
        lines.append((str(seed), f"{m.time:.1f} s", str(m.presses), f"{m.path / MM:.1f} mm", touched, aside))
    print(show.table(lines, ("seed", "time", "clutch presses", "path", "contacts", "beside the axis")))
    print()
    for f in by_severity(findings):
        print(show.finding(f))
    print(f"  {folder / 'operate.png'}")
    return EXIT_CODES[verdict(findings)]
