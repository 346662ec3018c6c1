"""`twin hazards`: run a fault-injection campaign on the machine of a robot, or repeat two published experiments."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin.cli.parser import Command
from twin.core.errors import TwinError

_DEFAULT = "table1"
"""Name of the campaign that runs without --campaign."""

EXAMPLES = """\
  twin hazards raven_left --campaign table1
  twin hazards pa10 --sessions 100 --processes 1
  twin hazards raven_left --overdrive hard --released none --out hard
  twin hazards raven_left --trends"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin hazards`."""
    command.robot()
    command.software()
    text = (
        "instead of a campaign, run the two experiments of the paper: deviation at each motion scale, and deviation "
        "with a fault every 8 s that holds the command of the first motor"
    )
    command.flag("--trends", text)
    text = f"name of a campaign of the robot, or path of a file (default {_DEFAULT})"
    command.text("--campaign", "NAME", text)
    text = "maximum number of sessions to run now (default: all that are not yet in the log)"
    command.integer("--sessions", text, least=0)
    command.integer("--processes", "number of processes (default: number of processors)", least=1)
    command.out("./twin-out/<robot>/<name>-hazards/")


def run(args: argparse.Namespace) -> int:
    """Run the sessions that are not yet in the log; print the number of sessions by class of outcome, and write files.

    The exit code is 1 if a cue (force on the operator's hand) occurred without a fault.
    """
    from twin import api
    from twin.api.hazards import FILE, Software, trends
    from twin.api.hazards import hazards as campaign
    from twin.cli import show

    if args.trends:  # the experiments have settings of their own, in the robot's file
        for name in ("campaign", "sessions", "processes"):
            if getattr(args, name) is not None:
                text = "it runs the two experiments of the robot's campaigns/trends.toml, in this process"
                raise TwinError(f"--{name} has no effect with --trends: {text}. Omit one of the two options")
    name = args.campaign or _DEFAULT
    robot = api.load(args.robot)
    released = None
    if args.released is not None:
        released = tuple(args.released.split(","))
    software = Software(args.mode, args.overdrive, released)
    folder_name = f"{Path(name).stem}-hazards"
    if args.trends:
        folder_name = "trends"
    folder = show.folder(args, robot.name, folder_name)
    with show.progress(args.quiet or args.json) as progress:
        if args.trends:
            result = trends(robot, software=software, progress=progress)
        else:
            result = campaign(
                robot,
                name,
                folder,
                source=args.robot,
                sessions=args.sessions,
                processes=args.processes,
                software=software,
                progress=progress,
            )
    log_files = [] if args.trends else [FILE]
    return show.store(result, args, folder, log_files)
