"""`twin console`: check the published equations of a surgeon's console."""

from __future__ import annotations

import argparse

from twin.cli.parser import Command

EXAMPLES = """\
  twin console davinci                             the corrected reading of the equations
  twin console davinci --variant paper             every equation as printed
  twin console davinci --variant conjugate         eq. (2) as a complete change of frame
  twin console davinci --variant eq4=paper --json"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin console`."""
    command.add_argument("console", help="a console: davinci")
    text = "use another reading of an equation, such as eq4=paper, or of all equations: paper, conjugate or decoupled"
    command.variants(text)
    command.out("./twin-out/<console>/console-<variant>/")


def run(args: argparse.Namespace) -> int:
    """Check the equations and print every clause (requirement); write JSON, page and picture.

    The exit code is 1 if a clause fails.
    """
    from twin import api
    from twin.cli import show
    from twin.cli.option_values import stated_variants

    variants = stated_variants(args.variant)
    # results of other readings go to other folders
    folder_name = "console"
    if isinstance(variants, str):
        folder_name += f"-{variants}"
    else:
        for equation, variant in (variants or {}).items():
            folder_name += f"-{equation}-{variant}"
    with show.progress(args.quiet or args.json) as progress:
        result = api.console(args.console, variants, progress)
    return show.store(result, args, show.folder(args, args.console, folder_name))
