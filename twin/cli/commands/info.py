"""`twin info`: show a robot, or the robots of a scene."""

from __future__ import annotations

import argparse

from twin.cli.parser import Command
from twin.core.errors import TwinError

EXAMPLES = """\
  twin info sils
  twin info sils --all            with all joints and parameters
  twin info vsrs                  a scene
  twin info pa10 --inertia        are masses and inertias physically possible?
  twin info raven_left --motion   published equations of motion against the mechanism"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin info`."""
    command.robot()
    command.tool()
    command.flag("--all", "all joints, motors and parameters with their provenance, instead of 30 lines")
    only = command.add_mutually_exclusive_group()
    for name, text in (
        ("--motion", "only compare the published equations of motion with the mechanism"),
        ("--inertia", "only check the masses and inertias in CAD, stage and tables"),
    ):
        only.add_argument(name, action="store_true", help=text)


def run(args: argparse.Namespace) -> int:
    """Print joints, limits, frames, degrees of freedom and parameters of a robot, or the robots of a scene."""
    from twin import api
    from twin.cli import show
    from twin.core import assets

    file = assets.scene_file(args.robot)
    if file is not None:
        for option in ("inertia", "motion"):
            if getattr(args, option):
                raise TwinError(f"--{option} checks one robot, but {args.robot} is a scene: name one of its robots")
        return show.finish(api.info_of_scene(api.load_scene(file), args.robot), args)
    robot = api.load(args.robot, tool=args.tool)
    show.tool_note(robot, args.quiet)
    text = None
    with show.progress(args.quiet or args.json) as progress:
        if args.inertia:
            result = api.masses(robot, progress)
        elif args.motion:
            result = api.equations_of_motion(robot)
        else:
            result = api.info(robot, progress)
            if not args.all:  # the JSON always has everything
                text = result.brief(args.robot)
    return show.finish(result, args, text=text)
