"""`twin audit`: check exported files of robots and motions, with readers that share no code with the writers."""

from __future__ import annotations

import argparse

from twin import api
from twin.cli import show


def audit(args: argparse.Namespace) -> int:
    """Audit a file or folder and print the results; the exit code is 1 for a fault, 2 for an unreadable file."""
    with show.progress(args.quiet or args.json) as progress:
        report = api.audit(args.path, args.robot, progress)
    return show.finish(report, args, text=report.text(args.all))
