"""`twin study`: check published tables of user studies and inertias."""

from __future__ import annotations

import argparse

from twin.api import published
from twin.cli import show


def study(args: argparse.Namespace) -> int:
    """Print the recomputed tables of a robot's studies or of one file.

    The exit code is 1 if they differ from the paper.
    """
    return show.finish(published.study(args.subject), args)
