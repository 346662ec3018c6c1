"""`twin build`: write the USD stage of a robot from its CAD."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from twin.cli.parser import Command
from twin.core.errors import TwinError

EXAMPLES = """\
  twin build sils
  twin build sils --check      is the committed stage current?
  twin build sils --out stage/"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin build`."""
    command.robot()
    command.out("usd/<robot>/ in a checkout, the robot folder's usd/ otherwise")
    command.protocols()
    command.timing()
    command.flag("--check", "write nothing; exit 1 if the stage is not current")


def run(args: argparse.Namespace) -> int:
    """Write the stage or, with --check, compare the existing stage with a newly built one."""
    from twin import api
    from twin.cli import show
    from twin.cli.option_values import protocols

    robot = api.load(args.robot).with_timing(args.timing)
    chosen = None
    if args.protocol:
        chosen = protocols(robot, args)
    if args.check and chosen:
        raise TwinError("--check compares the whole stage: omit --protocol")
    with show.progress(args.quiet or args.json) as progress:
        folder = Path(args.out) if args.out else None
        if args.check:
            return show.finish(api.check_build(robot, folder, args.robot, progress), args)
        written = api.build(robot, folder, protocols=chosen, progress=progress)
    if args.json:
        files = list(map(str, written))
        print(show.as_json(show.record("build", {"files": files})))
        return 0
    for path in written:
        kilobytes = math.ceil(path.stat().st_size / 1000)
        print(f"  {path}  ({kilobytes} kB)")
    if robot.files is None or chosen or not robot.unwritten:
        return 0
    # without equations, `build` skips motions that the mechanism cannot follow
    baked_names = [path.stem.removeprefix(f"{robot.name}_") for path in written]
    for name in robot.files.protocols():
        if name not in baked_names:
            print(
                f"  protocol {name} is left out, because the mechanism cannot follow it; to see the reason, run "
                f"twin plan {args.robot} {name}"
            )
    return 0
