"""`twin track`: computed torque control along a protocol, and what a wrong model costs at the tip."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin import api
from twin.cli import show
from twin.core import assets
from twin.core.errors import TwinError
from twin.core.findings import EXIT_CODES, Finding, by_severity, verdict
from twin.core.units import MM, UM

if TYPE_CHECKING:
    from twin.planning.trajectory import Trajectory
    from twin.simulation.dynamics.inertia import Arm
    from twin.simulation.dynamics.track import Motion, Run

_SEEDS = (0, 1)
"""Runs in which links and frictions are wrong by chance, each with its own sign."""

_CURVE = tuple(np.arange(-20, 21, 5) / 100)
"""Inertia errors of the curve."""

_INERTIA = {
    "cited": "masses, mass centres and tensors as inertia.toml cites them",
    "cad": "masses, mass centres and tensors as drawn, by the densities of the CAD (ASSUMED where it says so)",
}


def track(args: argparse.Namespace) -> int:
    """Control the arm along a protocol, print errors and torques, write JSON, CSV and a picture; exit 1 above 1 mm."""
    from twin.cad.build import read_mechanism
    from twin.simulation.dynamics import inertia, model
    from twin.simulation.dynamics.track import ENCODER, Conditions, curve, run, torque_table
    from twin.ui.report.style import png
    from twin.ui.report.track import figure

    if not 0 <= args.mismatch < 100:
        raise TwinError(f"--mismatch {args.mismatch:g}: give percent from 0 to below 100")
    robot = api.load(args.robot)
    protocol = robot.protocol(args.protocol)
    if robot.files is None:
        raise TwinError(f"{robot.name} was loaded from a USD stage: it has no inertia.toml")
    table = inertia.of_robot(robot.files.cad)
    folder = Path(args.out) if args.out else Path("twin-out") / robot.name / f"{protocol.name}-track"
    assets.require_writable(folder)
    exact = Conditions(plant=args.plant)
    off = args.mismatch / 100
    cases = {"exact model": exact, f"links {args.mismatch:+g} %": exact.realistic(off)}
    if off:
        cases[f"links {-args.mismatch:+g} %"] = exact.realistic(-off)
        cases |= {f"links ±{args.mismatch:g} %, seed {s}": exact.realistic(off, s) for s in _SEEDS}
    with show.progress(args.quiet or args.json) as progress:
        progress("read CAD", 0.0)
        mechanism = robot.mechanism
        trajectory = api.plan(robot, protocol, progress)
        arm = inertia.arm(table, model.placements(mechanism))
        if args.inertia == "cad":
            progress("weigh CAD", 0.0)
            arm = replace(arm, links=model.links_of(read_mechanism(robot.files.description).mechanism))
        if arm.joints != trajectory.joint_names:
            raise TwinError(
                f"{robot.name}: inertia.toml has links of {', '.join(arm.joints)}, "
                f"the plan moves {', '.join(trajectory.joint_names)}"
            )
        motion = _motion(trajectory, model.tool_in_last(mechanism, trajectory.frame))
        runs: dict[str, Run] = {}
        for name, conditions in cases.items():
            progress(f"control, {name}", 0.0)
            runs[name] = run(arm, motion, conditions)
        curves = {}
        if args.curve:
            for name, c in {"links alone": exact, "links, friction, encoders": exact.realistic(0.0)}.items():
                curves[name] = curve(arm, motion, _CURVE, c, lambda part: progress("error curve", part))
    wrong = {n: r for n, r in runs.items() if n != "exact model"}
    worst = max(wrong, key=lambda n: wrong[n].tip_max)
    torques = torque_table(arm, *runs.values())
    findings = _findings(runs, arm)
    data = {
        "verdict": verdict(findings),
        "robot": robot.name,
        "protocol": protocol.name,
        "inertia": _INERTIA[args.inertia],
        "masses_kg": {j: round(b.mass, 6) for j, b in zip(arm.joints, arm.links, strict=True)},
        "duration_s": trajectory.duration,
        "assumed": "rate, gains, mismatch, encoders and instrument: the paper prints none",
        "runs": {n: r.as_dict() for n, r in runs.items()},
        "worst": worst,
        "torques": [row.as_dict() for row in torques],
        "curves": {n: [r.as_dict() for r in rs] for n, rs in curves.items()},
        "findings": [f.as_dict() for f in findings],
        "folder": str(folder),
    }
    head = f"{robot.name}, {protocol.name}: computed torque control, Kp = w², Kv = 2 w, w = {exact.w:g} rad/s"
    with assets.atomic_folder(folder) as work:
        (work / "track.json").write_text(show.as_json(data) + "\n", encoding="utf-8")
        _write_csv(work / "track.csv", motion, arm, runs, worst)
        (work / "track.png").write_bytes(png(figure(head, arm, runs, worst, _spans(trajectory), curves)))
    if args.json:
        print(show.as_json(data))
        return EXIT_CODES[verdict(findings)]
    print(f"{robot.name} · {protocol.title} · {trajectory.duration:.3f} s, moved by {args.plant}")
    print(
        f"  Kp = w², Kv = 2 w, w = {exact.w:g} rad/s, {exact.rate:g} Hz, torque held for a tick; with a wrong model:\n"
        f"  links {args.mismatch:g} % off, friction {100 * exact.friction_error:g} % off, joints in steps of "
        f"{ENCODER * 1e6:.2f} µrad. All ASSUMED: the paper prints none.\n"
        f"  Inertias: {_INERTIA[args.inertia]}; {sum(b.mass for b in arm.links):.2f} kg move.\n"
    )
    lines = [(n, f"{r.tip_max / UM:.2f}", f"{r.tip_rms / UM:.2f}", _um(r.rcm_max)) for n, r in runs.items()]
    print(show.table(lines, ("model", "tip, largest µm", "tip, RMS µm", "shaft from RCM µm")), "\n")
    for name, rs in curves.items():
        lines = [
            (f"{100 * r.conditions.inertia_error:+.0f} %", f"{r.tip_max / UM:.1f}", f"{r.tip_rms / UM:.1f}") for r in rs
        ]
        print(show.table(lines, (name, "largest µm", "RMS µm")), "\n")
    lines = [(r.joint, f"{r.peak:.2f}", f"{r.rms:.2f}", f"{r.limit:g}", f"{100 * r.margin:.0f} %") for r in torques]
    print(show.table(lines, ("all runs", "peak N m", "RMS N m", "limit N m", "margin")), "\n")
    for f in by_severity(findings):
        print(show.finding(f))
    print(f"  {folder / 'track.png'}")
    return EXIT_CODES[verdict(findings)]


def _motion(trajectory: Trajectory, T_last_tip: np.ndarray) -> Motion:
    """Return a planned trajectory as the controller takes it."""
    from twin.simulation.dynamics.track import Motion

    t = trajectory
    return Motion(t.t, t.q, t.qd, t.qdd, T_last_tip, t.shaft_axis, t.rcm)


def _findings(runs: dict[str, Run], arm: Arm) -> list[Finding]:
    from twin.simulation.dynamics.track import EXACT_LIMIT, TIP_LIMIT

    out = []
    for name, r in runs.items():
        if name == "exact model" and r.tip_max > EXACT_LIMIT:
            out.append(
                Finding(
                    "track.exact",
                    "warning",
                    f"with an exact model the tip is {r.tip_max / UM:.2f} µm off; the hold of one tick should cost "
                    f"less than {EXACT_LIMIT / UM:g} µm",
                    name,
                    size=r.tip_max / UM,
                    unit="um",
                    limit=EXACT_LIMIT / UM,
                )
            )
        if r.tip_max > TIP_LIMIT:
            out.append(
                Finding(
                    "track.tip",
                    "disagreement",
                    f"{name}: the tip is {r.tip_max / MM:.3f} mm off; the paper reports at most 1 mm",
                    name,
                    f"{r.t[int(r.tip_error.argmax())]:.3f} s",
                    r.tip_max / MM,
                    "mm",
                    TIP_LIMIT / MM,
                    "stiffer control (w), or a better known friction",
                )
            )
        cut = [joint for j, joint in enumerate(arm.joints) if r.saturated[:, j].any()]
        if cut:
            ticks = int(r.saturated.any(axis=1).sum())
            text = f"{name}: the drives of {', '.join(cut)} were at their limits in {ticks} ticks"
            out.append(Finding("track.saturated", "warning", text, cut[0]))
    return out


def _spans(trajectory: Trajectory):
    from twin.validation.result import PhaseSummary

    return tuple(PhaseSummary(p.name, p.type, p.t0, p.t1) for p in trajectory.phases)


def _write_csv(path: Path, motion: Motion, arm: Arm, runs: dict[str, Run], worst: str) -> None:
    """Write time, tip and RCM errors of every run, then joint errors and torques of the worst one."""
    columns, head = [motion.t], ["t_s"]
    for name, r in runs.items():
        label = _label(name)
        columns += [r.tip_error, r.rcm_error]
        head += [f"tip_error_{label}_m", f"rcm_error_{label}_m"]
    r = runs[worst]
    columns += [*r.joint_error.T, *r.torque.T]
    head += [*(f"error_{j}_rad" for j in arm.joints), *(f"torque_{j}_n_m" for j in arm.joints)]
    np.savetxt(path, np.column_stack(columns), "%.9g", ",", header=",".join(head), comments="")


def _label(name: str) -> str:
    """Return the name of a run as part of a column's name: "links -5 %" is links_minus_5_percent."""
    for sign, word in (("±", " either "), ("+", " plus "), ("-", " minus "), ("%", " percent "), (",", " ")):
        name = name.replace(sign, word)
    return "_".join(name.replace(".", "p").split())


def _um(value: float | None) -> str:
    return "-" if value is None else f"{value / UM:.2f}"
