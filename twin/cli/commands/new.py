"""`twin new`: create a robot folder from a description in another format, or only from CAD."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin.cli.parser import Command
from twin.core.assets import examples
from twin.core.errors import TwinError
from twin.exchange.formats import import_formats

EXAMPLES = """\
  twin new leg --from robot.urdf                   loops from robot.yaml in the same folder
  twin new gripper --from gripper.xml --out robots/gripper/
  twin new arm robot.urdf                          the same as --from robot.urdf
  twin new ur ur.urdf.xacro --arg name:=ur --arg ur_type:=ur5e --packages ~/ros/src
  twin new panda table.csv --dh modified --units m,rad    a table of Denavit-Hartenberg parameters, with its equations
  twin new arm.step                                an incomplete robot: joints are proposed as comments
  twin new my_hexapod --example hexapod            a complete example: STEP, description, equations, motion"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin new`."""
    command.add_argument("name", help="name of the robot (lower-case letters, digits and _), or the file to read")
    command.add_argument("file", nargs="?", help="the file to read, as --from")
    readable_suffixes: list[str] = []
    for format in import_formats():
        readable_suffixes += format.sources
    suffixes = ", ".join(readable_suffixes)
    command.text("--from", "FILE", f"a file with one of these suffixes: {suffixes}", dest="source")
    command.text("--example", "NAME", "copy an example instead of reading a file", choices=sorted(examples()))
    command.text("--closures", "FILE", "closure YAML of a URDF (default: the .yaml file of the same name)")
    text = "robot to read, if the file has several: prim path (USD), model (SDF) or body (MJCF)"
    command.text("--root", "NAME", text)
    command.xacro()
    command.table()
    command.flag("--force", "overwrite a robot folder; equations and protocols are kept")
    command.out("./<name>/")


def run(args: argparse.Namespace) -> int:
    """Read a description or CAD and write the robot folder."""
    from twin.api.robot_folder import new
    from twin.cli import show
    from twin.exchange.read import suffixes
    from twin.exchange.xacro import settings

    if args.example:
        return _copy(args)
    if args.source and args.file:
        raise TwinError(f"two files to read are given, {args.file} and {args.source}: omit one of them")
    source = args.source or args.file
    name = args.name
    if source is None:
        source = args.name
        name = None
        readable_suffixes = suffixes()
        if Path(source).suffix.lower() not in readable_suffixes:
            readable = ", ".join(readable_suffixes)
            raise TwinError(f"'{args.name}' is not a file to read: give a file with --from ({readable})")
    with show.progress(args.quiet or args.json) as progress:
        robot = new(
            source,
            name,
            out=args.out,
            closures=args.closures,
            root=args.root,
            xacro=settings(args.arg, args.packages),
            dh=args.dh,
            units=args.units,
            force=args.force,
            progress=progress,
        )
    show.finish(robot, args)
    return 0


def _copy(args: argparse.Namespace) -> int:
    """Copy an example into the folder that is named like the new robot."""
    from twin.cli import show
    from twin.exchange.example import copy_example

    if args.source or args.file:
        raise TwinError("--example copies a robot and reads no file: omit the file, or --example")
    for name in ("closures", "root", "arg", "packages", "dh", "units"):  # options that say how a file is read
        if getattr(args, name):
            raise TwinError(f"--{name} is for a file to read, and --example copies a robot: omit one of them")
    target = Path(args.out or args.name)
    files = list(map(str, copy_example(args.example, target, args.force)))
    if args.json:
        print(show.as_json(show.record("new", {"robot": args.example, "files": files}, [])))
        return 0
    print(f"  {target}/: {len(files)} files of the example {args.example}")
    print(f"  next: twin validate {target}/, twin view {target}/; the equations are in {target}/formula.py")
    return 0
