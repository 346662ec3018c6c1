"""`twin compare`: compare two or more descriptions of one robot, and name the number that differs."""

from __future__ import annotations

import argparse

from twin.cli.parser import Command
from twin.exchange.formats import import_formats

EXAMPLES = """\
  twin compare old/robot.urdf new/robot.urdf
  twin compare robot.urdf robot.xml             a URDF and an MJCF of one arm
  twin compare robot.urdf robot.xml robot.sdf   which of three stands alone
  twin compare table.csv arm.urdf --dh modified --units mm,deg
  twin compare pa10@equations arm.urdf          the equations of a robot and a file
  twin compare poses.csv arm.urdf               measured poses (columns: joints, x, y, z, rotation)
  twin compare pa10 my_arm.urdf                 a built-in robot and a file
  twin compare a.urdf b.urdf --strict           also base frames, zeros and signs must be the same
  twin compare arm.urdf hand_arm.urdf --only joint_1,joint_2,joint_3
  twin compare a.urdf b.urdf --out report/      a page with both robots at the worst pose"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin compare`."""
    format_titles = ", ".join(format.title for format in import_formats())
    text = (
        "two or more sides: name of a built-in robot or robot folder (its equations with @equations behind it), "
        f"table of poses, or file of one of these formats: {format_titles}"
    )
    command.add_argument("sides", nargs="+", metavar="SIDE", help=text)
    command.number("--tolerance-um", "UM", "distance in µm up to which two joint axes coincide", 10.0)
    command.text("--only", "JOINT,...", "compare only these joints; all others are held at zero")
    command.xacro()
    command.table()
    command.text("--out", "FOLDER", "write a page with a picture of both robots at the worst pose into this folder")
    command.flag("--strict", "count a difference of convention (base frame, zero, sign, ...) as a disagreement")


def run(args: argparse.Namespace) -> int:
    """Print the comparison; the exit code is 0 for agreement, 1 for a disagreement, 2 if it was impossible."""
    from twin.api.comparison import compare
    from twin.cli import show
    from twin.exchange.xacro import settings

    tolerance = show.micrometres("--tolerance-um", args.tolerance_um)
    assert tolerance is not None
    folder = show.folder(args) if args.out else None
    only = show.listed(args.only)
    with show.progress(args.quiet or args.json) as progress:
        result = compare(
            *args.sides,
            tolerance=tolerance,
            only=only,
            strict=args.strict,
            xacro=settings(args.arg, args.packages),
            dh=args.dh,
            units=args.units,
            progress=progress,
        )
    if folder is not None:
        return show.store(result, args, folder)
    return show.finish(result, args)
