"""One function per command; each returns the exit code."""

from __future__ import annotations

import argparse
import filecmp
import math
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin import api
from twin.cli import show
from twin.cli.cure import Cures
from twin.cli.variants import asked
from twin.core import assets
from twin.core.atomic import Scratch
from twin.core.errors import TwinError, unknown
from twin.core.findings import EXIT_CODES, verdict

if TYPE_CHECKING:
    from twin.model.mechanism import Joint, Mechanism


def list_robots(args: argparse.Namespace) -> int:
    """Print the built-in robots and scenes."""
    from twin.cad.description import load
    from twin.cli import scene

    rows = []
    for name in assets.names():
        files = assets.files(name)
        rows.append(
            {
                "name": name,
                "kind": "robot",
                "title": load(files.description).title,
                "equations": files.has_equations,
                "stage": files.stage.is_file(),
                "protocols": sorted(files.protocols()),
            }
        )
    scenes = scene.listed()
    if args.json:
        print(show.as_json([*rows, *({"kind": "scene", **s} for s in scenes)]))
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
        print()
        print(
            show.table([(s["name"], s["title"], ", ".join(s["robots"])) for s in scenes], ("scene", "title", "robots"))
        )
    return 0


def info(args: argparse.Namespace) -> int:
    """Print joints, limits, frames, degrees of freedom and parameters."""
    from twin.cli import scene
    from twin.reference.regular import singular_home

    if (file := scene.find(args.robot)) is not None:
        if args.inertia:
            raise TwinError(f"--inertia judges one robot: {args.robot} is a scene")
        return scene.info(file, args)
    robot = api.load(args.robot, tool=args.tool)
    show.told(robot, args.quiet)
    if args.inertia:
        from twin.cli.inertia import run as run_inertia

        return run_inertia(robot, args)
    with show.progress(args.quiet or args.json) as progress:
        progress("read CAD", 0.0)
        mechanism = robot.mechanism
        model = robot.reference()
        home = model.home().x
        mobility = model.mobility(home)
    formula, chosen = None, {}
    if robot.files is not None and robot.files.has_equations:
        kin = robot.kinematics()
        formula, chosen = kin.formula, kin.variants
    cad = robot.cad if robot.files is not None else None
    equations = [e for e in formula.equations if e.stage != "helper"] if formula else []
    data = {
        "name": robot.name,
        "title": cad.description.title if cad else "",
        "source": formula.source if formula else cad.description.source if cad else mechanism.source,
        "degrees_of_freedom": mobility.freedom,
        "redundant_constraints": mobility.redundancy,
        "redundant": {n: {"count": c, "among": mobility.repeated[n]} for n, c in mobility.redundant.items() if c},
        "joints": [_joint(j, mechanism) for j in mechanism.joints],
        "actuators": [vars(a) for a in mechanism.actuators],
        "transmissions": [
            {"name": t.name, "joints": t.joints, "actuators": t.actuators, "matrix": t.matrix.tolist()}
            | {"equations": t.equations}
            for t in mechanism.transmissions
        ],
        "frames": [f.name for f in mechanism.frames],
        "points": [p.name for p in mechanism.points],
        "variants": {e.name: {n: e.reasons.get(n, "") for n in e.variants} for e in equations},
        "chosen": dict(chosen),
        "parameters": [
            vars(p)
            for p in (
                *(formula.parameters if formula else ()),
                *mechanism.parameters,
                *(cad.dimensions if cad else ()),
            )
        ],
        "findings": [f.as_dict() for f in (*(cad.findings if cad else ()), *singular_home(model, home))],
    }
    print(show.as_json(data) if args.json else show.info(data, len(mechanism.bodies)))
    return EXIT_CODES[verdict(cad.findings if cad else ())]


def _joint(j: Joint, mechanism: Mechanism) -> dict[str, Any]:
    return {
        "name": j.name,
        "type": j.type,
        "parent": j.parent,
        "child": j.child,
        "active": j.active,
        "auxiliary": j in mechanism.auxiliary,
        "limits": j.limits,
        "closes_loop": j in mechanism.loops,
    }


def build(args: argparse.Namespace) -> int:
    """Write the stage, or with --check compare it with a fresh one."""
    robot = api.load(args.robot)
    chosen = _protocols(robot, args) if args.protocol else None
    if args.check and chosen:
        raise TwinError("--check compares the whole stage: leave --protocol out")
    with show.progress(args.quiet or args.json) as progress:
        if args.check:
            return _check(robot, args, progress)
        written = api.build(robot, Path(args.out) if args.out else None, protocols=chosen, progress=progress)
    if args.json:
        print(show.as_json({"files": [str(p) for p in written]}))
    else:
        for path in written:
            print(f"  {path}  ({path.stat().st_size / 1e3:.0f} kB)")
        baked = {path.stem.removeprefix(f"{robot.name}_") for path in written}
        for name in robot.files.protocols() if robot.files is not None and robot.unwritten and not chosen else ():
            if name not in baked:
                print(f"  {name}: not baked, the mechanism cannot follow it; twin plan {args.robot} {name} says why")
    return 0


def _check(robot: api.Robot, args: argparse.Namespace, progress) -> int:
    if robot.files is None:
        raise TwinError(f"{robot.name} is a stage already")
    current = Path(args.out) if args.out else robot.files.usd
    with Scratch() as folder:
        fresh = api.build(robot, Path(folder), progress=progress)
        names = [p.relative_to(folder) for p in fresh]
        differing = [str(n) for n in names if not _same(Path(folder) / n, current / n)]
        extra = [str(p.relative_to(current)) for p in current.rglob("*.usd*") if p.relative_to(current) not in names]
        verdict = "agree" if not differing and not extra else "disagree"
    if args.json:
        print(show.as_json({"verdict": verdict, "differing": differing, "unexpected": extra}))
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
    from pxr import Tf

    from twin.usd.same import same_layer

    try:
        return same_layer(a, b)
    except Tf.ErrorException:  # not a layer at all
        return False


def plan(args: argparse.Namespace) -> int:
    """Time a protocol; print its phases and what the check found; write CSV and JSON."""
    from twin.planning.tracks import write_csv

    robot = api.load(args.robot)
    with show.progress(args.quiet or args.json) as progress:
        trajectory = api.plan(robot, args.protocol, progress)
    folder = Path(args.out) if args.out else Path("twin-out") / robot.name / trajectory.protocol
    with assets.atomic_folder(folder) as work:
        write_csv(trajectory, work / "trajectory.csv", [j.is_angle for j in robot.mechanism.active])
        (work / "trajectory.json").write_text(show.as_json(trajectory.as_dict(arrays=False)), encoding="utf-8")
    from twin.core.findings import EXIT_CODES, by_severity, verdict

    result = verdict(trajectory.findings)
    if args.json:
        print(show.as_json({"verdict": result, "folder": str(folder), **trajectory.as_dict(arrays=False)}))
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
    from twin.exchange.write.usd import fresh_stage
    from twin.validation.rows import Tolerances

    tolerances = None
    if args.tolerance_um is not None:
        if not (math.isfinite(args.tolerance_um) and args.tolerance_um > 0):
            raise TwinError(f"--tolerance-um {args.tolerance_um:g}: give a positive number of micrometres")
        tolerances = Tolerances().widened(args.tolerance_um * 1e-6)
    robot = api.load(args.robot)
    if args.sweep or args.compare:
        from twin.cli.stroke import run as run_stroke

        return run_stroke(robot, args)
    jobs = [(p, v) for p in _protocols(robot, args) for v in _variants(robot, args.variant)]
    root = Path(args.out) if args.out else Path("twin-out") / robot.name
    for protocol, variants in jobs:
        assets.require_writable(root / _folder(robot.protocol(protocol).name, variants))
    reports, cures = [], Cures(robot)
    with show.progress(args.quiet or args.json) as progress:
        trajectories = {p: api.plan(robot, p, progress) for p in dict.fromkeys(p for p, _ in jobs)}
        progress("USD stage", 0.0)
        assert robot.files is not None  # it has protocols
        with fresh_stage(robot.files) as stage:
            for protocol, variants in jobs:
                report = api.validate(
                    robot,
                    trajectories[protocol],
                    protocol=protocol,
                    variants=variants,
                    tolerances=tolerances,
                    stage=stage,
                    progress=progress,
                )
                report = cures.of(report, protocol, progress)
                progress("report", 0.0)
                folder = root / _folder(report.protocol, variants)
                with assets.atomic_folder(folder) as work:
                    _write(report, work, root)
                reports.append((report, folder))
    return _finish(reports, args)


def run(args: argparse.Namespace) -> int:
    """Build, plan and validate; a scene: play it."""
    from twin.cli import scene

    if (file := scene.find(args.robot)) is not None:
        return scene.run(file, args)
    robot = api.load(args.robot)
    root = Path(args.out) if args.out else Path("twin-out") / robot.name
    chosen = _protocols(robot, args)
    for folder in ("usd", *(robot.protocol(p).name for p in chosen)):
        assets.require_writable(root / folder)
    reports, cures = [], Cures(robot)
    # A stage and the reports on it belong together: they appear in one step.
    with show.progress(args.quiet or args.json) as progress, assets.atomic_folder(root) as work:
        robot = robot.weighed()
        stage = api.build(robot, work / "usd", protocols=chosen, progress=progress)[0]
        for protocol in chosen:
            report = api.validate(robot, protocol=protocol, stage=stage, baked=True, progress=progress)
            report = cures.of(report, protocol, progress)
            progress("report", 0.0)
            _write(report, work / report.protocol, root)
            reports.append((report, root / report.protocol))
    code = _finish(reports, args)
    if not args.json:
        print(f"  stage: {root / stage.relative_to(work)}")
    return code


def _protocols(robot: api.Robot, args: argparse.Namespace) -> tuple[str, ...]:
    if robot.files is None:
        raise TwinError(f"{robot.name} is a USD stage: it has neither equations nor protocols to judge")
    from twin.cad.description import load

    if getattr(args, "all_protocols", False):
        chosen = tuple(robot.files.protocols())
        if not chosen:
            raise TwinError(f"{robot.name}: there is no protocol in {robot.files.trajectories}")
    else:
        chosen = (args.protocol or load(robot.files.description).default_protocol,)
    for name in chosen:
        robot.protocol(name)  # wrong ones are told before anything is computed or written
    return chosen


def _variants(robot: api.Robot, texts: Sequence[str]) -> list[dict[str, str] | None]:
    """Return the variants to judge, one judgement each."""
    chosen = asked(texts)
    if chosen is None:
        return [None]
    choices = robot.variants
    if isinstance(chosen, str):
        having = [eq for eq, names in choices.items() if chosen in names]
        if not having:
            raise TwinError(f"--variant: {unknown('variant', chosen, {n for v in choices.values() for n in v})}")
        alone: list[dict[str, str] | None] = [{eq: chosen} for eq in having]
        return [*alone, dict.fromkeys(having, chosen)] if len(having) > 1 else alone
    for eq, name in chosen.items():
        if eq not in choices:
            raise TwinError(f"--variant: {unknown('equation', eq, choices)}")
        if name not in choices[eq]:
            raise TwinError(f"--variant {eq}: {unknown('variant', name, choices[eq])}")
    return [chosen]


def _folder(protocol: str, variants: Mapping[str, str] | None) -> str:
    return "-".join([protocol, *(f"{k}-{v}" for k, v in (variants or {}).items())])


def _write(report, folder: Path, root: Path) -> None:
    """Write a report into a folder, with the score of the validator that lies in `root`."""
    from twin.ui.report.files import write_report
    from twin.ui.report.selftest import with_selftest

    folder.mkdir(parents=True, exist_ok=True)
    write_report(with_selftest(report, root / "selftest.json"), folder)


def _finish(reports, args: argparse.Namespace) -> int:
    """Print the reports; the exit code is that of the gravest verdict."""
    code = max(r.exit_code for r, _ in reports)
    if args.json:
        data = [{**r.as_dict(), "folder": str(folder)} for r, folder in reports]
        several = {"verdict": max(reports, key=lambda r: r[0].exit_code)[0].verdict, "reports": data}
        print(show.as_json(data[0] if len(data) == 1 else several))
        return code
    for report, folder in reports:
        print(show.report(report))
        print(f"  report: {folder / 'report.html'}")
        print(show.way_out(report))
    if len(reports) > 1:
        rows = [(r.protocol, ", ".join(f"{k}={v}" for k, v in r.variants.items()), r.verdict) for r, _ in reports]
        print(show.table(rows, ("protocol", "variants", "verdict")))
    return code


def _own_file(name: str) -> Callable[[argparse.Namespace], int]:
    """Return the command that has a file of its own, imported when it is run."""
    return lambda args: getattr(import_module(f"twin.cli.{name}"), name)(args)


_OWN = ("explain", "view", "serve", "operate", "track", "study", "new", "export", "audit", "selftest")
_OWN += ("workspace", "tolerance", "sweep", "doctor")

COMMANDS = {
    "list": list_robots,
    "info": info,
    "build": build,
    "plan": plan,
    "validate": validate,
    "run": run,
    **{name: _own_file(name) for name in _OWN},
}
