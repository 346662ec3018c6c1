"""`twin validate`: compare the equations with the mechanism."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli.parser import VARIANT, Command, count
from twin.core.errors import ProtocolError, TwinError
from twin.core.progress import Progress

if TYPE_CHECKING:
    from twin.api.robot import Robot
    from twin.core.result import Result
    from twin.validation.residual_rows import Tolerances

EXAMPLES = """\
  twin validate sils
  twin validate sils --variant eq1=printed
  twin validate sils --all-protocols --json
  twin validate sils --prove                                also the claims of `twin prove`, at all poses
  twin validate sher --sweep q5 --compare serial,mimic      over the joint range instead of along a protocol
  twin validate pa10 --samples 1e6                          at a million states all over the joint range"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin validate`."""
    command.robot()
    command.out("./twin-out/<robot>/<protocol>/")
    command.protocols()
    command.timing()
    command.variants(f"{VARIANT}: one report for each equation, and one for all together")
    command.accuracy()
    text = "compare over the whole range (stroke) of these joints (default all) instead of along a protocol"
    command.text("--sweep", "JOINTS", text, nargs="?", const="all")
    text = "with --sweep: also compute the error of simplified loop models (comma-separated list of serial, mimic)"
    command.text("--compare", "NAMES", text)
    text = "compare at N states all over the joint range, such as 1e6, instead of along a protocol"
    command.number("--samples", "N", text, None, count)
    command.device(when="--samples")
    command.flag("--prove", "also prove the claims of `twin prove`, at all poses, for each set of variants")


def run(args: argparse.Namespace) -> int:
    """Validate the equations on the chosen protocols and variants; write a report for each."""
    from twin.api.equation_checks import validate
    from twin.api.protocol_plan import plan
    from twin.api.robot_loading import load
    from twin.cli import reports, show
    from twin.cli.fix_search import FixSearch
    from twin.cli.option_values import protocols, variants_of_each
    from twin.core import assets
    from twin.validation.residual_rows import Tolerances

    width = show.micrometres("--tolerance-um", args.tolerance_um)
    robot = load(args.robot).with_timing(args.timing)
    tolerances = None
    if width is not None:  # a given accuracy replaces that of the CAD, as `validate` would compute it
        tolerances = Tolerances().widened(width, robot.mechanism.link_length)
    if args.samples is not None:
        return _samples(robot, args, tolerances)
    if args.device is not None:
        raise TwinError("--device applies to --samples N: give both, or omit --device")
    if args.sweep is not None or args.compare is not None:
        return _strokes(robot, args)
    chosen = protocols(robot, args)
    jobs: list[tuple[str, dict[str, str] | None]] = []
    for protocol in chosen:
        for variants in variants_of_each(robot, args.variant):
            jobs.append((protocol, variants))
    root = Path("twin-out") / robot.name
    if args.out:
        root = Path(args.out)
    for protocol, variants in jobs:  # before planning and judging, which take minutes
        assets.require_writable(root / reports.folder_name(robot.protocol(protocol).name, variants))
    fix_search = FixSearch(robot)
    written_reports = []
    with show.progress(args.quiet or args.json) as progress:
        trajectories = {}
        for protocol in dict.fromkeys(chosen):  # one motion for all variants
            try:
                trajectories[protocol] = plan(robot, protocol, progress)
            except ProtocolError as error:
                raise ProtocolError(f"{error} {_ways_out(args.robot)}") from error
        progress("USD stage", 0.0)
        with robot.source.fresh_stage() as stage:
            for protocol, variants in jobs:
                report = validate(
                    robot,
                    trajectories[protocol],
                    protocol=protocol,
                    variants=variants,
                    tolerances=tolerances,
                    stage=stage,
                    progress=progress,
                )
                report = fix_search.with_fix(report, protocol, progress)
                progress("report", 0.0)
                folder = root / reports.folder_name(report.protocol, variants)
                with assets.atomic_folder(folder) as work:
                    reports.write_report(report, work, root, robot)
                written_reports.append((report, folder))
        proofs = []
        if args.prove:
            for variants in variants_of_each(robot, args.variant):
                proofs.append(_proved(robot, variants, root, progress))
    return reports.print_reports(written_reports, args, proofs)


def _ways_out(robot: str) -> str:
    """Return what to do if a protocol cannot be carried out: the equations that plan its motion may be wrong."""
    command = shlex.join(["twin", "validate", robot, "--samples", "512"])
    return f"If it should be possible, the equations, which plan its motion, may be wrong: judge them by `{command}`."


def _proved(robot: Robot, variants: dict[str, str] | None, root: Path, progress: Progress) -> tuple[Result, Path]:
    """Prove the claims about the equations in some variants; write the result and return it with its folder."""
    from twin.cli import reports, result_files
    from twin.core import assets

    # Loaded by name, as what writes pages: without --prove, nothing of a proof is reached from here.
    result = import_module("twin.api.proof").prove(robot, variants, progress=progress)
    folder = root / reports.folder_name("prove", variants)
    with assets.atomic_folder(folder) as work:
        result_files.write_result(result, work)
    return result, folder


def _refuse(args: argparse.Namespace, unused: Sequence[str], with_option: str, reason: str) -> None:
    """Raise a `TwinError` if one of the options `unused` is given, which has no effect together with another option."""
    for option in unused:
        if getattr(args, option):
            name = option.replace("_", "-")
            raise TwinError(f"--{name} and {with_option} cannot be combined: {reason}")


def _samples(robot: Robot, args: argparse.Namespace, tolerances: Tolerances | None) -> int:
    """Compare equations and mechanism at states all over the joint range; write samples.json and a page.

    The exit code is 1 if the equations disagree.
    """
    from twin.api.equation_checks import validate_samples
    from twin.cli import result_files, show
    from twin.cli.option_values import device, stated_variants
    from twin.core import assets

    unused = ("sweep", "compare", "protocol", "all_protocols", "timing", "prove")
    _refuse(args, unused, "--samples", "states over the joint range are compared")
    if args.samples < 1:
        raise TwinError(f"--samples {args.samples}: give at least 1")
    variants = stated_variants(args.variant)
    if isinstance(variants, str):
        raise TwinError(f"--variant {variants}: with --samples, give EQ=NAME, such as eq1={variants}")
    folder = show.folder(args, robot.name) / "samples"
    with show.progress(args.quiet or args.json) as progress:
        samples = validate_samples(
            robot,
            args.samples,
            variants=variants,
            tolerances=tolerances,
            device=device(args),
            progress=progress,
        )
        with assets.atomic_folder(folder) as work:
            pictures = result_files.write_result(samples, work)
    return show.finish(samples, args, folder, pictures)


def _strokes(robot: Robot, args: argparse.Namespace) -> int:
    """Compare equations, mechanism and simplified loop models over the range of each joint (`validate --sweep`).

    Print a table; write sweep.json, a CSV for each joint and sweep.png.

    The exit code is 1 if the equations disagree.
    """
    from twin.api.equation_checks import strokes
    from twin.cli import result_files, show
    from twin.cli.option_values import stated_variants
    from twin.core import assets
    from twin.core.errors import unknown
    from twin.validation.stroke import SIMPLIFIED_MODELS

    reason = "joints are moved over their ranges, and compared within fixed tolerances"
    _refuse(args, ("protocol", "all_protocols", "timing", "prove", "tolerance_um"), "--sweep", reason)
    standins = tuple(filter(None, (args.compare or "").split(",")))
    joints: tuple[str, ...] = ()
    if args.sweep not in (None, "all"):
        joints = tuple(args.sweep.split(","))
    variants = stated_variants(args.variant)
    if isinstance(variants, str):
        raise TwinError(f"--variant {variants}: with --sweep, give EQ=NAME, such as eq1={variants}")
    for name in standins:
        if name not in SIMPLIFIED_MODELS:
            raise TwinError(f"--compare: {unknown('simplified loop model', name, SIMPLIFIED_MODELS)}")
    for name in joints:
        if name not in robot.joints:
            raise TwinError(f"--sweep: {unknown('active joint', name, robot.joints)}")
    folder = show.folder(args, robot.name) / "sweep"
    with show.progress(args.quiet or args.json) as progress:
        result = strokes(robot, joints, standins, variants, progress)
        with assets.atomic_folder(folder) as work:
            pictures = result_files.write_result(result, work, "sweep")
    return show.finish(result, args, folder, pictures)
