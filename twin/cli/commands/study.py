"""`twin study`: check published tables of user studies and inertias, compare groups of users or of sessions."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli.parser import Command
from twin.core.errors import TwinError

if TYPE_CHECKING:
    from twin.core.result import Result

EXAMPLES = """\
  twin study sher
  twin study pa10                 inertia tables: are they physically possible?
  twin study davinci              groups of users, and the accuracy of a console
  twin study my_study.toml --json
  twin study users.csv            your own groups, with rank tests
  twin study users.csv --out study/           also a page with box plots and learning curves
  twin study first=a.session first=b.session last=c.session last=d.session    sessions at a console"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin study`."""
    text = "a built-in robot or study, a robot folder, a study file, a CSV of users, or sessions as GROUP=FILE"
    command.add_argument("subject", nargs="+", help=text)
    command.text("--out", "FOLDER", "write a page, a figure and the data of groups into this folder")


def run(args: argparse.Namespace) -> int:
    """Print the recomputed tables of a robot's studies or of one file, or the statistical tests between groups.

    With --out, write page, picture and data of a comparison of groups. The exit code is 1 if printed values do not
    follow from the printed rows.
    """
    from twin.cli import show

    folder = show.folder(args) if args.out else None
    result = _study(args)
    if folder is None:
        return show.finish(result, args)
    from twin.validation.rank_tests import Ranks

    if not isinstance(result, Ranks):
        raise TwinError("--out requires groups (a CSV file of users, or sessions as GROUP=FILE); otherwise omit --out")
    return show.store(result, args, folder, ["users.csv"])


def _study(args: argparse.Namespace) -> Result:
    """Return the result for a subject, or for groups of sessions as GROUP=FILE."""
    from twin import api
    from twin.cli import show

    groups_of_files = []
    ungrouped = []
    for text in args.subject:
        if "=" in text and not Path(text).exists():  # a file may have = in its name
            groups_of_files.append(text)
        else:
            ungrouped.append(text)
    if not groups_of_files:
        if len(args.subject) > 1:
            raise TwinError(
                f"{len(args.subject)} names or files are given: give one, or groups of sessions as GROUP=FILE, such as "
                f"first={args.subject[0]} last={args.subject[1]}"
            )
        return api.study(args.subject[0])
    if ungrouped:
        file = ungrouped[0]
        raise TwinError(f"'{file}' has no group: give every session as GROUP=FILE, such as first={file}")
    from twin.api.session_study import study_sessions

    groups: dict[str, list[str]] = {}
    for text in groups_of_files:
        group, _, file = text.partition("=")
        if not group or not file:
            raise TwinError(f"'{text}': give GROUP=FILE, such as first=a.session")
        groups.setdefault(group, []).append(file)  # in the order of the sessions, for learning curves
    with show.progress(args.quiet or args.json) as progress:
        return study_sessions(groups, progress)
