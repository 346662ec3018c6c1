"""`twin audit`: check exported files with independent readers, and compare what they read."""

from __future__ import annotations

import argparse

from twin.cli.parser import Command
from twin.exchange.formats import audit_formats

EXAMPLES = """\
  twin audit twin-out/sils/export/
  twin audit twin-out/sils/export/ --robot sils    against the mechanism
  twin audit model.glb              a file from any source
  twin audit robot.usdz --json
  twin audit twin-out/sils/prove/certificate.json --robot sils    a proof, and the files that it is about"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin audit`."""
    format_titles = ", ".join(format.title for format in audit_formats())
    command.add_argument("path", help=f"a folder, or a file of one of these formats: {format_titles}")
    command.text("--robot", "NAME", "name or folder of the robot: also compare the poses with those of its mechanism")
    command.xacro()
    command.flag("--all", "show notes and all checks, not only the worst of each kind")


def run(args: argparse.Namespace) -> int:
    """Audit a file or folder and print the results; the exit code is 1 for a fault, 2 for an unreadable file."""
    from twin.api.export_audit import audit
    from twin.cli import show
    from twin.exchange.xacro import settings

    with show.progress(args.quiet or args.json) as progress:
        report = audit(args.path, args.robot, progress, settings(args.arg, args.packages))
    return show.finish(report, args, text=report.text(args.all))
