"""`twin console`: check the equations of a surgeon's console against the requirements of an operator."""

from __future__ import annotations

import argparse

from twin import api
from twin.cli import show
from twin.cli.variants import asked


def console(args: argparse.Namespace) -> int:
    """Check the equations and print every clause (requirement); write JSON, page and picture.

    The exit code is 1 if a clause fails.
    """
    variants = asked(args.variant)
    chosen = [variants] if isinstance(variants, str) else map("-".join, (variants or {}).items())
    with show.progress(args.quiet or args.json) as progress:
        found = api.console(args.console, variants, progress)
    return show.store(found, args, show.folder(args, args.console, "-".join(["console", *chosen])))
