"""`twin export`: write files for headsets, game engines and simulators, and check them with independent readers."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli.parser import SHOWN_OBJECTS, Command
from twin.core.errors import TwinError
from twin.exchange.formats import export_formats

if TYPE_CHECKING:
    from twin.exchange.write.clip import ClipAccuracy

EXAMPLES = """\
  twin export sils                              every format, every protocol
  twin export sils --to glb,tracks --out xr/
  twin export sils --protocol lowered_patient --budget-um 20
  twin export my_robot/ --json
  twin export usd/pa10/pa10_circle.usda         a stage, with its baked motion
  twin export vsrs                              a scene: each robot at its place, and all in one stage"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin export`."""
    command.robot(SHOWN_OBJECTS)
    command.tool()
    command.out("./twin-out/<robot>/export/")
    format_names = ", ".join(format.name for format in export_formats())
    command.text("--to", "FORMATS", f"comma-separated list of {format_names} (default all)")
    group = command.add_mutually_exclusive_group()
    text = "a protocol of the robot, or the path of a protocol file; may be given more than once"
    group.add_argument("--protocol", metavar="NAME", action="append", help=text)
    group.add_argument("--all-protocols", action="store_true", help="every protocol of the robot (the default)")
    text = (
        "maximum error in micrometres, between keys, of the positions of link points and of joint gaps (default 100); "
        "determines the key rate. The maximum rotation error is proportional to it: 0.05 degrees for 100 micrometres"
    )
    command.number("--budget-um", "UM", text)
    command.timing()


def run(args: argparse.Namespace) -> int:
    """Write the export folder, audit it and print the files; the exit code is 1 if the audit finds a difference."""
    from twin.api.exports import export
    from twin.api.robot_loading import load
    from twin.cli import show
    from twin.core import assets
    from twin.exchange.write.bundle import chosen_formats
    from twin.exchange.write.clip import ClipAccuracy

    names = None
    if args.to is not None:
        names = show.listed(args.to)
    formats = chosen_formats(names)
    budget = ClipAccuracy()
    size = show.micrometres("--budget-um", args.budget_um)
    if size is not None:
        # one option for both: a rotation is as visible as the displacement that it causes at the links
        budget = ClipAccuracy(size, budget.rotation * size / budget.position, size)
    scene = assets.scene_file(args.robot)
    if scene is not None:  # a scene has its own bundle, with one of each robot inside
        return _scene(scene, args, formats, budget)
    robot = load(args.robot, tool=args.tool).with_timing(args.timing)
    show.tool_note(robot, args.quiet)
    with show.progress(args.quiet or args.json) as progress:
        bundle = export(
            robot,
            out=args.out,
            to=formats,
            protocols=args.protocol or None,
            budget=budget,
            progress=progress,
        )
    return show.finish(bundle, args)


def _scene(file: Path, args: argparse.Namespace, formats: tuple[str, ...], budget: ClipAccuracy) -> int:
    from twin.api.scene_export import export_scene
    from twin.cli import show

    if args.tool is not None or args.protocol or args.timing is not None:
        raise TwinError(
            f"{args.robot} is a scene: its file defines the tools and protocols; omit --tool, --protocol and --timing"
        )
    folder = Path(args.out) if args.out else Path("twin-out") / file.parent.name / "export"
    with show.progress(args.quiet or args.json) as progress:
        bundle = export_scene(file, folder, formats, budget=budget, progress=progress)
    return show.finish(bundle, args, folder, [""])
