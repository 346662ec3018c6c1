"""`twin study`: check published tables of user studies and inertias, compare groups of users or of sessions."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin.api import published
from twin.cli import show
from twin.core.errors import TwinError
from twin.core.result import Result


def study(args: argparse.Namespace) -> int:
    """Print the recomputed tables of a robot's studies or of one file, or the tests of groups.

    With --out, write page, picture and data of a comparison of groups. The exit code is 1 if printed tables differ
    from the paper.
    """
    folder = show.folder(args) if args.out else None
    found = _found(args)
    if folder is None:
        return show.finish(found, args)
    from twin.validation.ranks import Ranks

    if not isinstance(found, Ranks):
        raise TwinError("--out applies only to groups of users (a CSV file) or of sessions (GROUP=FILE); omit --out")
    return show.store(found, args, folder, ["users.csv"])


def _found(args: argparse.Namespace) -> Result:
    named = [s for s in args.subject if "=" in s and not Path(s).exists()]
    if not named:
        if len(args.subject) > 1:
            raise TwinError(
                f"{len(args.subject)} names or files are given: give one, or groups of sessions as GROUP=FILE, such as "
                f"first={args.subject[0]} last={args.subject[1]}"
            )
        return published.study(args.subject[0])
    if len(named) < len(args.subject):
        other = next(s for s in args.subject if s not in named)
        raise TwinError(f"'{other}' has no group: give every session as GROUP=FILE, such as first={other}")
    from twin.api.learning import study_sessions

    groups: dict[str, list[str]] = {}
    for text in named:
        group, _, file = text.partition("=")
        if not group or not file:
            raise TwinError(f"'{text}': give GROUP=FILE, such as first=a.session")
        groups.setdefault(group, []).append(file)
    with show.progress(args.quiet or args.json) as progress:
        return study_sessions(groups, progress)
