"""`twin new`: create a robot folder from a description in another format, or only from CAD."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli.parser import Command
from twin.core.assets import examples
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.exchange.formats import imported

if TYPE_CHECKING:
    from twin.core.findings import Finding

_SHOWN = 3
"""Maximum number of printed findings of one kind; the notes contain all findings."""


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
    known: list[str] = []
    for format in imported():
        known += format.sources
    suffixes = ", ".join(known)
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
    from twin.cli import show
    from twin.exchange.read import format_of, suffixes
    from twin.usd.read.names import identifier

    if args.example:
        return _copy(args)
    if args.source and args.file:
        raise TwinError(f"two files to read are given, {args.file} and {args.source}: omit one of them")
    given = args.source or args.file
    source = Path(given or args.name)
    name = args.name
    if given is None:
        known = suffixes()
        if source.suffix.lower() not in known:
            readable = ", ".join(known)
            raise TwinError(f"'{args.name}' is not a file to read: give a file with --from ({readable})")
        name = identifier(source.stem)
    elif identifier(name) != name:
        raise TwinError(f"'{name}' is not a valid robot name; use [a-z][a-z0-9_]*, as in {identifier(name)}")
    target = Path(args.out or name)
    with show.progress(args.quiet or args.json) as progress:
        data, findings = _make(args, name, source, target, progress)
    if args.json:
        print(show.as_json(show.record("new", data, findings)))
        return 0
    _print(findings)
    loops = ""
    if data["loops"]:
        loops = f", {data['loops']} loops closed within {data['worst_gap_m']:.2g} m"
    first = ""
    if not data["active"]:
        first = f"name the joints in {data['files'][0]}, then "
    following = (
        f"twin info {target}/, twin build {target}/, twin view {target}/; then your equations in formula.py and twin "
        f"validate {target}/"
    )
    if "table" in format_of(source).takes:
        following = (
            f"twin validate {target}/, twin info {target}/, twin view {target}/; the equations are in formula.py"
        )
    text = (
        f"  {target}/: {data['bodies']} bodies, {data['joints']} joints{loops}, {len(data['active'])} driven; "
        f"changes and omissions: {target}/IMPORT.md\n"
        f"  next: {first}{following}"
    )
    print(text)
    return 0


def _copy(args: argparse.Namespace) -> int:
    """Copy an example into the folder that is named like the new robot."""
    from twin.cli import show
    from twin.exchange.example import copy_example

    if args.source or args.file:
        raise TwinError("--example copies a robot and reads no file: omit the file, or --example")
    target = Path(args.out or args.name)
    files = [str(path) for path in copy_example(args.example, target, args.force)]
    if args.json:
        print(show.as_json(show.record("new", {"robot": args.example, "files": files}, [])))
        return 0
    print(f"  {target}/: {len(files)} files of the example {args.example}")
    print(f"  next: twin validate {target}/, twin view {target}/; the equations are in {target}/formula.py")
    return 0


def _make(
    args: argparse.Namespace, name: str, source: Path, target: Path, progress
) -> tuple[JsonObject, list[Finding]]:
    from twin.exchange.read import format_of, read
    from twin.exchange.read.closing import close
    from twin.exchange.read.folder import require_free, write_folder
    from twin.exchange.read.source import stated
    from twin.exchange.xacro import settings
    from twin.reference import ReferenceModel

    require_free(target, args.force)
    progress(f"read {source.name}", 0.0)
    xacro = settings(args.arg, args.packages)
    dh = stated(args.dh, args.units)
    if format_of(source).name == "step":
        from twin.exchange.formats.step.read import read_skeleton, write_skeleton

        if args.closures or args.root:
            raise TwinError(f"{source}: --closures and --root do not apply to a STEP file")
        if xacro.given or args.dh or args.units:
            raise TwinError(f"{source}: --arg, --packages, --dh and --units do not apply to a STEP file")
        skeleton = read_skeleton(source)
        progress("write the skeleton", 0.5)
        written, mechanism = write_skeleton(skeleton, name, target, source, args.force)
        findings = skeleton.findings
        worst = 0.0
    else:
        closures = Path(args.closures) if args.closures else None
        imported = read(source, closures, args.root, xacro=xacro, dh=dh)
        progress("close loops", 0.4)
        imported = close(imported)
        progress("write the folder", 0.8)
        written = write_folder(imported, name, target, source, args.force)
        mechanism = imported.mechanism
        findings = imported.findings
        worst = ReferenceModel(mechanism).home().worst_gap
    data = {
        "robot": name,
        "files": [str(path) for path in written],
        "bodies": len(mechanism.bodies),
        "joints": len(mechanism.joints),
        "active": [joint.name for joint in mechanism.active],
        "loops": len(mechanism.loops),
        "worst_gap_m": worst,
    }
    return data, findings


def _print(findings: list[Finding]) -> None:
    """Print the warnings, at most `_SHOWN` of each kind."""
    kinds: dict[str, list[Finding]] = {}
    for finding in findings:
        if finding.severity != "info":
            kinds.setdefault(finding.code, []).append(finding)
    for code, alike in kinds.items():
        for finding in alike[:_SHOWN]:
            print(f"  {finding.severity}: {finding.message}")
        if len(alike) > _SHOWN:
            print(f"    and {len(alike) - _SHOWN} more of {code}")
