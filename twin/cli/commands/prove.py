"""`twin prove`: prove that the equations agree with the mechanism at all poses, or show a pose where they do not."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from twin.cli.parser import VARIANT, Command, count
from twin.core.errors import TwinError
from twin.core.units import MM, UM

if TYPE_CHECKING:
    from twin.api.robot import Robot

EXAMPLES = """\
  twin prove sils                           all loops, all points, at all poses
  twin prove sils --variant eq1=printed     a printed error is refuted, with a pose where it shows
  twin prove sils --workspace               the tool positions without singularities, with their volume
  twin prove pa10 --bounds                  how far equations and mechanism can be apart, at all joint values
  twin prove pa10 --bounds --against my_pa10/
  twin prove sils --protocol table2         limits, speeds, RCM and loops between the samples as well
  twin prove sher --all-protocols --no-clearance
  twin prove my_robot/ --json"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin prove`."""
    command.robot()
    command.protocols()
    command.flag("--no-clearance", "do not bound distances between bodies along protocols")
    command.variants(VARIANT)
    command.number("--states", "N", "number of random states, 64 to 1000000", 4096, count)
    command.seed("random seed of the states")
    text = "bound the difference of forward equations and mechanism over all joint values, for a serial chain"
    command.flag("--bounds", text)
    command.text("--against", "ROBOT", "another robot, whose mechanism --bounds compares with that of the first")
    text = "by how much each length of the equations (--bounds) or joint of the CAD (--workspace, x, y, z) may be off"
    command.number("--tolerance-um", "UM", text, 0.0)
    text = "prove boxes of tool positions assembled, within limits and not singular, in the orientation of home"
    command.flag("--workspace", text)
    command.number("--edge-mm", "MM", "edge of the smallest boxes of --workspace (default: the longest side / 232)")
    text = "box of positions for --workspace: lower and upper end along x, y and z of base (default: all reached ones)"
    command.text("--box-mm", "MM", text, nargs=6, type=float)
    command.out("./twin-out/<robot>/prove/")


def run(args: argparse.Namespace) -> int:
    """Print the claims; the exit code is 0 if all are proved, 1 if one is refuted, 2 if one is not proved."""
    from twin.api.proof import prove
    from twin.api.robot_loading import load
    from twin.cli import show
    from twin.cli.option_values import protocols, stated_variants

    robot = load(args.robot)
    if args.bounds and args.workspace:
        raise TwinError("--bounds and --workspace are two results: give one of them")
    if (args.protocol or args.all_protocols) and (args.bounds or args.workspace):
        raise TwinError("--protocol and --all-protocols are for the claims: leave out --bounds and --workspace")
    if args.bounds:
        return _bounds(robot, args)
    if args.against:
        raise TwinError("--against needs --bounds")
    if args.workspace:
        return _workspace(robot, args)
    if args.tolerance_um:
        raise TwinError("--tolerance-um needs --bounds or --workspace")
    for option in ("edge_mm", "box_mm"):
        if getattr(args, option) is not None:
            raise TwinError(f"--{option.replace('_', '-')} needs --workspace")
    along: tuple[str, ...] = ()
    if args.protocol or args.all_protocols:
        along = protocols(robot, args)
    folder = show.folder(args, robot.name, "prove")
    with show.progress(args.quiet or args.json) as progress:
        result = prove(
            robot,
            stated_variants(args.variant),
            args.states,
            args.seed,
            progress,
            protocols=along,
            clearance=not args.no_clearance,
        )
    return show.store(result, args, folder)


def _workspace(robot: Robot, args: argparse.Namespace) -> int:
    """Print the volume of the tool positions that are proved free of singularities, and write the boxes."""
    import numpy as np

    from twin.analysis.proven_workspace import proven_workspace
    from twin.cli import show
    from twin.cli.option_values import stated_variants

    edge = None if args.edge_mm is None else args.edge_mm * MM
    corners = None
    if args.box_mm is not None:
        ends = MM * np.array(args.box_mm)
        # lower and upper end of x, then of y, then of z
        corners = ends[0::2], ends[1::2]
    folder = show.folder(args, robot.name, "prove-workspace")
    with show.progress(args.quiet or args.json) as progress:
        result = proven_workspace(robot, stated_variants(args.variant), edge, corners, progress, args.tolerance_um * UM)
    files = ["boxes.json"]
    if len(result.proof.low):  # without a proved box, there is nothing to certify
        files.append("certificate.json")
    return show.store(result, args, folder, files, replacing=["certificate.json"])


def _bounds(robot: Robot, args: argparse.Namespace) -> int:
    """Print by how much equations and mechanism can differ at any joint values."""
    from twin.api.chain_bounds import chain_bounds, mechanism_bounds
    from twin.api.robot_loading import load
    from twin.cli import show
    from twin.cli.option_values import stated_variants

    folder = show.folder(args, robot.name, "prove-bounds")
    if args.against:
        if args.variant or args.tolerance_um:
            raise TwinError("--against compares two mechanisms: leave out --variant and --tolerance-um, of equations")
        result = mechanism_bounds(robot, load(args.against))
    else:
        result = chain_bounds(robot, stated_variants(args.variant), args.tolerance_um * UM)
    return show.store(result, args, folder, ["certificate.json"])
