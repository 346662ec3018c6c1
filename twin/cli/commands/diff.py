"""`twin diff`: compare two results in JSON."""

from __future__ import annotations

import argparse

from twin.cli.parser import Command

EXAMPLES = """\
  twin diff before.json after.json
  twin diff old/table2/ twin-out/sils/table2/    two folders of reports"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin diff`."""
    command.add_argument("first", help="the older result: a file that --json wrote, or the folder of a report")
    command.add_argument("second", help="the newer result")


def run(args: argparse.Namespace) -> int:
    """Print both verdicts and what differs.

    The exit code is 1 if the verdicts differ, a finding is new, or a residual is no longer finite.
    """
    from twin.api.result_difference import diff
    from twin.cli import show

    return show.finish(diff(args.first, args.second), args)
