"""Functions of the commands; each returns the exit code."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from twin import api
from twin.api import published
from twin.cli import show
from twin.cli.cure import Cures
from twin.core import assets
from twin.core.errors import TwinError, unknown
from twin.core.units import MM

if TYPE_CHECKING:
    from twin.planning.rounds import Rounds


def list_robots(args: argparse.Namespace) -> int:
    """Print the built-in robots and scenes."""
    return show.finish(api.listing(), args)


def info(args: argparse.Namespace) -> int:
    """Print joints, limits, frames, degrees of freedom and parameters of a robot, or the robots of a scene."""
    if (file := assets.scene_file(args.robot)) is not None:
        if args.inertia or args.motion:
            raise TwinError(
                f"--{'inertia' if args.inertia else 'motion'} checks one robot, but {args.robot} is a scene: name one "
                "of its robots"
            )
        return show.finish(api.info_of_scene(api.load_scene(file), args.robot), args)
    robot = api.load(args.robot, tool=args.tool)
    show.tool_note(robot, args.quiet)
    with show.progress(args.quiet or args.json) as progress:
        if args.inertia:
            result = published.masses(robot, progress)
        elif args.motion:
            result = published.equations_of_motion(robot)
        else:
            result = api.info(robot, progress)
    return show.finish(result, args)


def build(args: argparse.Namespace) -> int:
    """Write the stage or, with --check, compare the existing stage with a newly built one."""
    robot = api.load(args.robot)
    chosen = _protocols(robot, args) if args.protocol else None
    if args.check and chosen:
        raise TwinError("--check compares the whole stage: omit --protocol")
    with show.progress(args.quiet or args.json) as progress:
        folder = Path(args.out) if args.out else None
        if args.check:
            return show.finish(api.check_build(robot, folder, args.robot, progress), args)
        written = api.build(robot, folder, protocols=chosen, progress=progress)
    if args.json:
        print(show.as_json({"files": [str(p) for p in written]}))
    else:
        for path in written:
            print(f"  {path}  ({path.stat().st_size / 1e3:.0f} kB)")
        baked = {path.stem.removeprefix(f"{robot.name}_") for path in written}
        for name in robot.files.protocols() if robot.files is not None and robot.unwritten and not chosen else ():
            if name not in baked:
                print(
                    f"  {name}: left out, because the mechanism cannot follow it; to see the reason, run twin plan "
                    f"{args.robot} {name}"
                )
    return 0


_COST = "path_cost.png"
"""Picture of the cost of the paths around obstacles over the samples of their searches."""


def plan(args: argparse.Namespace) -> int:
    """Plan a timed trajectory of a protocol; print phases and findings; write CSV and JSON."""
    from twin.planning.planned import FILES, Planned
    from twin.planning.protocol import avoiding

    robot = api.load(args.robot)
    if args.beside is not None:
        return _together(robot, args)
    protocol = robot.protocol(args.protocol)
    if args.avoid is not None:
        protocol = avoiding(protocol, args.avoid, args.clearance_mm * MM, args.seed)
    folder = show.folder(args, robot.name, protocol.name)
    with show.progress(args.quiet or args.json) as progress:
        trajectory = api.plan(robot, protocol, progress)
    planned = Planned(trajectory, [j.is_angle for j in robot.mechanism.active])
    with assets.atomic_folder(folder) as work:
        planned.write(work)
        drawn = _drawn(f"{robot.name} on {protocol.name}", planned.rounds, work)
    return show.finish(planned, args, folder, [FILES[0], *drawn])


def _drawn(what: str, searches: Mapping[str, Rounds], folder: Path) -> list[str]:
    """Draw the rounds of the searches of a plan, if there are any; return the names of the written files."""
    if not searches:
        return []
    from twin.ui.report import rounds, style

    (folder / _COST).write_bytes(style.png(rounds.figure(f"Paths around obstacles · {what}", searches)))
    return [_COST]


def _together(robot: api.Robot, args: argparse.Namespace) -> int:
    """Plan several robots of a scene at once (`plan --avoid SCENE --with ROBOT=PROTOCOL`)."""
    if not args.avoid:
        raise TwinError("--with: name the scene in which all robots stand, such as --avoid raven")
    scene = api.load_scene(args.avoid)
    places = {p.name: p.robot for p in scene.places}
    arms = {robot.name: (robot, robot.protocol(args.protocol))}
    for text in args.beside.split(","):
        name, _, chosen = text.strip().partition("=")
        if name in arms:
            raise TwinError(f"--with {name}: this robot is already planned; name each robot once, as in the scene")
        if name not in {*places, *places.values()}:
            raise TwinError(f"--with '{name}': scene '{scene.name}' has no such robot; it has: {', '.join(places)}")
        other = api.load(places.get(name) or name)
        arms[name] = other, other.protocol(chosen or None)
    folder = show.folder(args, scene.name, "_".join(arms))
    with show.progress(args.quiet or args.json) as progress:
        planned = api.plan_together(args.avoid, arms, args.clearance_mm * MM, args.seed, progress)
    with assets.atomic_folder(folder) as work:
        planned.write(work)
        drawn = _drawn(f"scene {scene.name}", planned.rounds, work)
    return show.finish(planned, args, folder, [*planned.files(), *drawn])


def validate(args: argparse.Namespace) -> int:
    """Validate the equations on the chosen protocols and variants; write a report for each."""
    from twin.validation.rows import Tolerances

    width = show.micrometres("--tolerance-um", args.tolerance_um)
    tolerances = None if width is None else Tolerances().widened(width)
    robot = api.load(args.robot)
    if args.sweep or args.compare:
        return _strokes(robot, args)
    jobs = [(p, v) for p in _protocols(robot, args) for v in _variants(robot, args.variant)]
    root = Path(args.out) if args.out else Path("twin-out") / robot.name
    for protocol, variants in jobs:
        assets.require_writable(root / _folder(robot.protocol(protocol).name, variants))
    reports, cures = [], Cures(robot)
    with show.progress(args.quiet or args.json) as progress:
        trajectories = {p: api.plan(robot, p, progress) for p in dict.fromkeys(p for p, _ in jobs)}
        progress("USD stage", 0.0)
        with robot.source.fresh_stage() as stage:
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


def _strokes(robot: api.Robot, args: argparse.Namespace) -> int:
    """Compare equations, mechanism and simplified loop models over the range of each joint (`validate --sweep`).

    Print a table; write sweep.json, a CSV for each joint and sweep.png.

    The exit code is 1 if the equations disagree.
    """
    from twin.ui.report.files import write_result

    standins = tuple(filter(None, (args.compare or "").split(",")))
    joints = () if args.sweep in (None, "all") else tuple(args.sweep.split(","))
    variants = asked(args.variant)
    if isinstance(variants, str):
        raise TwinError(f"--variant {variants}: with --sweep, give EQ=NAME, such as eq1={variants}")
    folder = show.folder(args, robot.name) / "sweep"
    with show.progress(args.quiet or args.json) as progress:
        found = api.strokes(robot, joints, standins, variants, progress)
        with assets.atomic_folder(folder) as work:
            pictures = write_result(found, work, "sweep")
    return show.finish(found, args, folder, pictures)


def run(args: argparse.Namespace) -> int:
    """Build, plan and validate a robot; play a scene."""
    from twin.cli import scene

    if (file := assets.scene_file(args.robot)) is not None:
        return scene.run(file, args)
    robot = api.load(args.robot)
    root = Path(args.out) if args.out else Path("twin-out") / robot.name
    chosen = _protocols(robot, args)
    for folder in ("usd", *(robot.protocol(p).name for p in chosen)):
        assets.require_writable(root / folder)
    reports, cures = [], Cures(robot)
    # The stage and its reports must match: they replace earlier files in one step.
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
        raise TwinError(f"{robot.name} is a USD stage, which has neither equations nor protocols to validate")
    if getattr(args, "all_protocols", False):
        chosen = tuple(robot.files.protocols())
        if not chosen:
            raise TwinError(f"{robot.name}: there is no protocol in {robot.files.trajectories}")
    else:
        chosen = (args.protocol or robot.source.description.default_protocol,)
    for name in chosen:
        robot.protocol(name)  # report invalid values before computing and writing
    return chosen


def asked(texts: Sequence[str]) -> str | dict[str, str] | None:
    """Return the variants of `--variant`: one name for all equations, or a name by equation; None without the option.

    Raises:
        TwinError: names are mixed with EQ=NAME pairs, several names are given, or an equation is given twice.
    """
    bare = [t for t in texts if "=" not in t]
    if bare and len(texts) > 1:
        raise TwinError("--variant: give either one variant name or EQ=NAME pairs, not both")
    if bare:
        return bare[0]
    pairs = dict(t.split("=", 1) for t in texts)
    if len(pairs) < len(texts):
        raise TwinError("--variant: an equation is given twice; give each equation once")
    return pairs or None


def _variants(robot: api.Robot, texts: Sequence[str]) -> list[dict[str, str] | None]:
    """Return the variants by equation of each report to write; None: the default variants."""
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
    """Write a report into a folder, with the score of the self-test found in `root`."""
    from twin.ui.report.files import write_report
    from twin.ui.report.selftest import with_selftest

    folder.mkdir(parents=True, exist_ok=True)
    write_report(with_selftest(report, root / "selftest.json"), folder)


def _finish(reports, args: argparse.Namespace) -> int:
    """Print the reports; return the exit code of the most severe verdict."""
    code = max(r.exit_code for r, _ in reports)
    if args.json:
        data = [{**r.as_dict(), "folder": str(folder)} for r, folder in reports]
        several = {"verdict": max(reports, key=lambda r: r[0].exit_code)[0].verdict, "reports": data}
        print(show.as_json(data[0] if len(data) == 1 else several))
        return code
    for report, folder in reports:
        show.finish(report, args)
        print(f"  report: {folder / 'report.html'}")
        print(f"\n  what to do: {report.what_to_do}\n" if report.what_to_do else "")
    if len(reports) > 1:
        rows = [(r.protocol, ", ".join(f"{k}={v}" for k, v in r.variants.items()), r.verdict) for r, _ in reports]
        print(show.table(rows, ("protocol", "variants", "verdict")))
    return code


def _later(file: str, name: str) -> Callable[[argparse.Namespace], int]:
    """Return the command `twin.cli.<file>.<name>`, whose file is imported only when the command runs."""
    return lambda args: getattr(import_module(f"twin.cli.{file}"), name)(args)


_OWN = (
    "view",
    "serve",
    "operate",
    "track",
    "study",
    "new",
    "export",
    "session",
    "machine",
    "follow",
    "hazards",
    "doctor",
)

_FILES = {
    "checks": ("explain", "console", "selftest", "audit"),
    "analyses": ("workspace", "tolerance", "sweep"),
    **{name: (name,) for name in _OWN},
}
"""Commands in other files, by file."""

COMMANDS = {
    "list": list_robots,
    "info": info,
    "build": build,
    "plan": plan,
    "validate": validate,
    "run": run,
    **{name: _later(file, name) for file, names in _FILES.items() for name in names},
}
