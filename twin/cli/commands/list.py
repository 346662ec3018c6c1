"""`twin list`: list the built-in robots and scenes."""

from __future__ import annotations

import argparse

from twin.cli.parser import Command

EXAMPLES = """\
  twin list
  twin list --json"""


def arguments(command: Command) -> None:
    """Add no arguments: `twin list` has none of its own."""


def run(args: argparse.Namespace) -> int:
    """Print the built-in robots and scenes."""
    from twin import api
    from twin.cli import show

    return show.finish(api.listing(), args)
