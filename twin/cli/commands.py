"""One function per command; each returns the exit code."""

from __future__ import annotations

import argparse
import filecmp
import json
import math
import platform
import shutil
import tempfile
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from twin import api, assets
from twin.cli import show
from twin.errors import TwinError, unknown


def list_robots(args: argparse.Namespace) -> int:
    """Print the built-in robots."""
    from twin.cad.description import load

    rows = []
    for name in assets.names():
        files = assets.files(name)
        rows.append(
            {
                "name": name,
                "title": load(files.description).title,
                "equations": files.formula.is_file(),
                "stage": files.stage.is_file(),
                "protocols": sorted(files.protocols()),
            }
        )
    if args.json:
        print(json.dumps(rows, indent=2))
    else:
        header = ("robot", "title", "equations", "stage", "protocols")
        yes = {True: "yes", False: "-"}
        print(
            show.table(
                [
                    (r["name"], r["title"], yes[r["equations"]], yes[r["stage"]], ", ".join(r["protocols"]))
                    for r in rows
                ],
                header,
            )
        )
    return 0


def info(args: argparse.Namespace) -> int:
    """Print joints, limits, frames, degrees of freedom and parameters."""
    from twin.units import DEG, MM

    robot = api.load(args.robot)
    with show.progress(args.quiet or args.json) as progress:
        progress("read CAD", 0.0)
        mechanism = robot.mechanism
        mobility = robot.reference().mobility(robot.reference().home().x)
    kin = robot.kinematics()
    parameters = [*kin.formula.parameters, *mechanism.parameters]
    variants = {
        e.name: {n: e.reasons.get(n, "") for n in e.variants} for e in kin.formula.equations if e.stage != "helper"
    }
    if args.json:
        print(
            json.dumps(
                {
                    "name": robot.name,
                    "source": kin.formula.source,
                    "degrees_of_freedom": mobility.freedom,
                    "redundant_constraints": mobility.redundancy,
                    "joints": [
                        {
                            "name": j.name,
                            "type": j.type,
                            "parent": j.parent,
                            "child": j.child,
                            "active": j.active,
                            "limits": j.limits,
                            "closes_loop": j in mechanism.loops,
                        }
                        for j in mechanism.joints
                    ],
                    "frames": [f.name for f in mechanism.frames],
                    "points": [p.name for p in mechanism.points],
                    "variants": variants,
                    "parameters": [vars(p) for p in parameters],
                    "findings": [f.as_dict() for f in robot.cad.findings],
                },
                indent=2,
            )
        )
        return 0
    print(f"{robot.name}: {robot.cad.description.title}\n  {kin.formula.source}\n")
    print(
        f"  {len(mechanism.bodies)} bodies, {len(mechanism.joints)} joints, {mobility.freedom} degrees of freedom, "
        f"{mobility.redundancy} redundant constraints; loops closed by {', '.join(j.name for j in mechanism.loops)}"
    )
    print(f"  frames: {', '.join(robot.frames)}   points: {', '.join(p.name for p in mechanism.points)}\n")
    rows = []
    for j in mechanism.joints:
        scale, unit = (DEG, "deg") if j.is_angle else (MM, "mm")
        limits = "" if j.limits is None else f"{j.limits[0] / scale:g} .. {j.limits[1] / scale:g} {unit}"
        role = "driven" if j.active else "closes a loop" if j in mechanism.loops else ""
        rows.append((j.name, j.type, f"{j.parent} -> {j.child}", limits, role))
    print(show.table(rows, ("joint", "type", "between", "limits", "")), "\n")
    for name, choices in variants.items():
        for variant, reason in choices.items():
            mark = "*" if kin.variants[name] == variant else " "
            print(f" {mark}{name}={variant}: {reason}")
    print("\n  parameters (* assumed: nobody has published it)")
    rows = [
        (("*" if p.provenance == "ASSUMED" else " ") + p.name, f"{p.shown:g} {p.unit}", p.provenance, p.note)
        for p in sorted(parameters, key=lambda p: p.provenance)
    ]
    print(show.table(rows))
    for f in robot.cad.findings:
        print(show.finding(f))
    return 0


def build(args: argparse.Namespace) -> int:
    """Write the stage, or with --check compare it with a fresh one."""
    robot = api.load(args.robot)
    chosen = _protocols(robot, args) if args.protocol else None
    with show.progress(args.quiet or args.json) as progress:
        if args.check:
            return _check(robot, args, progress)
        written = api.build(robot, Path(args.out) if args.out else None, protocols=chosen, progress=progress)
    if args.json:
        print(json.dumps({"files": [str(p) for p in written]}, indent=2))
    else:
        for path in written:
            print(f"  {path}  ({path.stat().st_size / 1e3:.0f} kB)")
    return 0


def _check(robot: api.Robot, args: argparse.Namespace, progress) -> int:
    assert robot.files is not None
    current = Path(args.out) if args.out else robot.files.usd
    with tempfile.TemporaryDirectory(prefix="twin-check-") as folder:
        fresh = api.build(robot, Path(folder), progress=progress)
        names = [p.relative_to(folder) for p in fresh]
        differing = [str(n) for n in names if not _same(Path(folder) / n, current / n)]
        extra = [str(p.relative_to(current)) for p in current.rglob("*.usd*") if p.relative_to(current) not in names]
        verdict = "agree" if not differing and not extra else "disagree"
    if args.json:
        print(json.dumps({"verdict": verdict, "differing": differing, "unexpected": extra}, indent=2))
    elif verdict == "agree":
        print(f"  {current} is current: {len(names)} files equal a fresh build")
    else:
        print(f"  {current} is not current. Rebuild it with: twin build {args.robot}")
        print(*(f"    differs: {n}" for n in differing), *(f"    unexpected: {n}" for n in extra), sep="\n")
    return 0 if verdict == "agree" else 1


def _same(a: Path, b: Path) -> bool:
    """Return whether two layers are equal: by bytes, or (another processor rounds differently) by content."""
    if not b.is_file():
        return False
    if filecmp.cmp(a, b, shallow=False):
        return True
    from twin.stage.same import same_layer

    return same_layer(a, b)


def plan(args: argparse.Namespace) -> int:
    """Time a protocol; print its phases and what the check found; write CSV and JSON."""
    from twin.trajectory.tracks import write_csv

    robot = api.load(args.robot)
    with show.progress(args.quiet or args.json) as progress:
        trajectory = api.plan(robot, args.protocol, progress)
    folder = Path(args.out) if args.out else Path("twin-out") / robot.name / trajectory.protocol
    with assets.atomic_folder(folder) as work:
        write_csv(trajectory, work / "trajectory.csv")
        (work / "trajectory.json").write_text(json.dumps(trajectory.as_dict(arrays=False), indent=2), encoding="utf-8")
    from twin.findings import EXIT_CODES, by_severity, verdict

    result = verdict(trajectory.findings)
    if args.json:
        print(json.dumps({"verdict": result, "folder": str(folder), **trajectory.as_dict(arrays=False)}, indent=2))
        return EXIT_CODES[result]
    print(f"{robot.name} · {trajectory.protocol} · {trajectory.duration:.3f} s, {len(trajectory.t)} samples\n")
    rows = [
        (p.name, p.type, f"{p.t0:.3f}", f"{p.t1:.3f}", p.waypoint or "", p.rcm_mode or "") for p in trajectory.phases
    ]
    print(show.table(rows, ("phase", "type", "from s", "to s", "ends at", "RCM")), "\n")
    for f in by_severity(trajectory.findings):
        print(show.finding(f))
    print(f"\n  {folder / 'trajectory.csv'}")
    return EXIT_CODES[result]


def validate(args: argparse.Namespace) -> int:
    """Judge the chosen protocols and variants; write a report for each."""
    from twin.validation.rows import Tolerances

    tolerances = None
    if args.tolerance_um is not None:
        if not (math.isfinite(args.tolerance_um) and args.tolerance_um > 0):
            raise TwinError(f"--tolerance-um {args.tolerance_um:g}: give a positive number of micrometres")
        tolerances = Tolerances().widened(args.tolerance_um * 1e-6)
    robot = api.load(args.robot)
    jobs = [(p, v) for p in _protocols(robot, args) for v in _variants(robot, args.variant)]
    root = Path(args.out) if args.out else Path("twin-out") / robot.name
    reports = []
    with show.progress(args.quiet or args.json) as progress:
        trajectories = {}
        for protocol, variants in jobs:
            if protocol not in trajectories:
                trajectories[protocol] = api.plan(robot, protocol, progress)
            report = api.validate(
                robot,
                trajectories[protocol],
                protocol=protocol,
                variants=variants,
                tolerances=tolerances,
                progress=progress,
            )
            progress("report", 0.0)
            reports.append((report, _write(report, root / _folder(report.protocol, variants))))
    return _finish(reports, args)


def run(args: argparse.Namespace) -> int:
    """Build, plan and validate."""
    robot = api.load(args.robot)
    root = Path(args.out) if args.out else Path("twin-out") / robot.name
    chosen = _protocols(robot, args)
    baked = tuple(p for p in chosen if robot.files is not None and p in robot.files.protocols())
    reports = []
    with show.progress(args.quiet or args.json) as progress:
        written = api.build(robot, root / "usd", protocols=baked, progress=progress)
        for protocol in chosen:
            report = api.validate(robot, protocol=protocol, stage=written[0], progress=progress)
            progress("report", 0.0)
            reports.append((report, _write(report, root / report.protocol)))
    code = _finish(reports, args)
    if not args.json:
        print(f"  stage: {written[0]}")
    return code


def doctor(args: argparse.Namespace) -> int:
    """Print what is installed and what that allows."""
    packages = (
        "numpy",
        "casadi",
        "pin",
        "coal",
        "usd-core",
        "cascadio",
        "trimesh",
        "toppra",
        "matplotlib",
        "viser",
    )
    extras = {
        "build123d": "redraw the CAD (make cad-check)",
        "mujoco": "a second engine as witness (make test)",
    }
    programs = {"chromium": "pictures of the viewer", "uv": "the locked environment"}
    rows = [(n, _installed(n) or "MISSING", "needed") for n in packages]
    rows += [(n, _installed(n) or "-", f"optional: {why}") for n, why in extras.items()]
    rows += [(n, shutil.which(n) or "-", f"optional: {why}") for n, why in programs.items()]
    missing = [n for n in packages if _installed(n) is None]
    if args.json:
        print(
            json.dumps({"python": platform.python_version(), "found": {n: v for n, v, _ in rows}, "missing": missing})
        )
    else:
        print(f"  python {platform.python_version()} on {platform.system()} {platform.machine()}")
        print(f"  data in {assets.data_folder()}\n")
        print(show.table(rows, ("package", "found", "")))
        if missing:
            print(f"\n  missing: {', '.join(missing)}. Install twin again: pip install .")
    return 2 if missing else 0


def _installed(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _protocols(robot: api.Robot, args: argparse.Namespace) -> tuple[str, ...]:
    if robot.files is None:
        raise TwinError(f"{robot.name} is a USD stage: it has neither equations nor protocols to judge")
    if getattr(args, "all_protocols", False):
        return tuple(robot.files.protocols())
    if args.protocol:
        return (args.protocol,)
    from twin.cad.description import load

    return (load(robot.files.description).default_protocol,)


def _variants(robot: api.Robot, asked: Mapping | tuple | object) -> list[dict[str, str] | None]:
    """Return the variants to judge, one judgement each."""
    texts = [str(t) for t in asked] if isinstance(asked, tuple | list) else []
    if not texts:
        return [None]
    choices = robot.variants
    bare = [t for t in texts if "=" not in t]
    if bare and len(texts) > 1:
        raise TwinError("--variant: give either one bare name or EQ=NAME pairs, not both")
    if bare:
        having = [eq for eq, names in choices.items() if bare[0] in names]
        if not having:
            raise TwinError(f"--variant: {unknown('variant', bare[0], {n for v in choices.values() for n in v})}")
        alone: list[dict[str, str] | None] = [{eq: bare[0]} for eq in having]
        return [*alone, dict.fromkeys(having, bare[0])] if len(having) > 1 else alone
    pairs = dict(t.split("=", 1) for t in texts)
    for eq, name in pairs.items():
        if eq not in choices:
            raise TwinError(f"--variant: {unknown('equation', eq, choices)}")
        if name not in choices[eq]:
            raise TwinError(f"--variant {eq}: {unknown('variant', name, choices[eq])}")
    return [pairs]


def _folder(protocol: str, variants: Mapping[str, str] | None) -> str:
    return "-".join([protocol, *(f"{k}-{v}" for k, v in (variants or {}).items())])


def _write(report, folder: Path) -> Path:
    from twin.report.files import write_report

    with assets.atomic_folder(folder) as work:
        write_report(report, work)
    return folder


def _finish(reports, args: argparse.Namespace) -> int:
    """Print the reports; the exit code is that of the gravest verdict."""
    code = max(r.exit_code for r, _ in reports)
    if args.json:
        data = [{**r.as_dict(), "folder": str(folder)} for r, folder in reports]
        print(json.dumps(data[0] if len(data) == 1 else data, indent=2))
        return code
    for report, folder in reports:
        print(show.report(report))
        print(f"  report: {folder / 'report.html'}\n")
    if len(reports) > 1:
        rows = [(r.protocol, ", ".join(f"{k}={v}" for k, v in r.variants.items()), r.verdict) for r, _ in reports]
        print(show.table(rows, ("protocol", "variants", "verdict")))
    return code


COMMANDS = {
    "list": list_robots,
    "info": info,
    "build": build,
    "plan": plan,
    "validate": validate,
    "run": run,
    "doctor": doctor,
}
