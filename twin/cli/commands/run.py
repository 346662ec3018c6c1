"""`twin run`: build, plan and validate a robot, or play a scene."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from twin.cli.parser import Command
from twin.core.errors import TwinError

EXAMPLES = """\
  twin run sils
  twin run sils --open                    and show the report in the browser
  twin run sils --protocol lowered_patient --out demo/"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin run`."""
    command.robot()
    command.out("./twin-out/<robot>/")
    command.protocols()
    command.timing()
    command.flag("--open", "open the report in the browser")


def run(args: argparse.Namespace) -> int:
    """Build, plan and validate a robot, or play a scene."""
    from twin import api
    from twin.cli import reports, scenes, show
    from twin.cli.browser import open_file
    from twin.cli.fix_search import FixSearch
    from twin.cli.option_values import protocols
    from twin.core import assets

    file = assets.scene_file(args.robot)
    if file is not None:
        if args.timing is not None:
            raise TwinError(f"--timing {args.timing}: {args.robot} is a scene; put the key timing into its protocols")
        if args.open:
            raise TwinError(f"--open shows the report of a robot, and {args.robot} is a scene: omit --open")
        return scenes.run(file, args)
    robot = api.load(args.robot).with_timing(args.timing)
    root = Path(args.out) if args.out else Path("twin-out") / robot.name
    chosen = protocols(robot, args)
    folder_names = ["usd"]
    for protocol in chosen:
        folder_names.append(robot.protocol(protocol).name)
    for name in folder_names:  # before building and planning, which take minutes
        assets.require_writable(root / name)
    written_reports = []
    fix_search = FixSearch(robot)
    # The stage and its reports must match: they replace earlier files in one step.
    with show.progress(args.quiet or args.json) as progress, assets.atomic_folder(root) as work:
        robot = robot.weighed()
        stage = api.build(robot, work / "usd", protocols=chosen, progress=progress)[0]
        for protocol in chosen:
            report = api.validate(robot, protocol=protocol, stage=stage, baked=True, progress=progress)
            report = fix_search.with_fix(report, protocol, progress)
            progress("report", 0.0)
            reports.write_report(report, work / report.protocol, root, robot)
            written_reports.append((report, root / report.protocol))
    code = reports.print_reports(written_reports, args)
    if not args.json:
        print(f"  stage: {root / stage.relative_to(work)}")
        print(f"  next:  twin view {args.robot}   (drag the tool in the browser)")
    if args.open:
        _, folder = written_reports[-1]
        reason = open_file(folder / "report.html")
        if reason:
            print(f"--open: {reason}", file=sys.stderr)
    return code
