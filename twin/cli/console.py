"""`twin console`: check the equations of a surgeon's console against the requirements of an operator."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin import api
from twin.cli import show
from twin.cli.variants import asked
from twin.core import assets


def console(args: argparse.Namespace) -> int:
    """Check the equations and print every clause (requirement); write JSON, page and picture.

    The exit code is 1 if a clause fails.
    """
    from twin.ui.report.files import write_result

    variants = asked(args.variant)
    name = "-".join(
        ["console", *([variants] if isinstance(variants, str) else map("-".join, (variants or {}).items()))]
    )
    folder = Path(args.out) if args.out else Path("twin-out") / args.console / name
    with show.progress(args.quiet or args.json) as progress:
        found = api.console(args.console, variants, progress)
        assets.require_writable(folder)
        with assets.atomic_folder(folder) as work:
            pictures = write_result(found, work)
    return show.finish(found, args, folder, pictures)
