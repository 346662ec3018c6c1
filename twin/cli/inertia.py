"""`twin info --inertia`: check whether the stated masses and inertias are physically possible."""

from __future__ import annotations

import argparse

from twin import api
from twin.api import published
from twin.cli import show


def run(robot: api.Robot, args: argparse.Namespace) -> int:
    """Print the audit of every source of the robot's masses; the exit code is 1 if a value is impossible."""
    with show.progress(args.quiet or args.json) as progress:
        found = published.masses(robot, progress)
    return show.finish(found, args)
