"""`twin selftest`: faults seeded into a correct robot, and how many of them the validator finds."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli import show
from twin.core import assets
from twin.core.errors import TwinError, unknown

if TYPE_CHECKING:
    from twin.analysis.mutation.fault import Family
    from twin.analysis.mutation.result import Score


def selftest(args: argparse.Namespace) -> int:
    """Seed, judge, print and keep the score; exit 1 if it is below the bar or the correct robot has a finding."""
    from twin.analysis.mutation.fault import FAMILIES
    from twin.analysis.mutation.run import selftest as run

    if args.count < 1:
        raise TwinError(f"--count {args.count}: give a number of faults, 1 or more")
    if args.seed < 0:
        raise TwinError(f"--seed {args.seed}: give a number that is not negative")
    families: tuple[Family, ...] = FAMILIES
    if args.family:
        asked = [f.strip() for f in args.family.split(",")]
        for name in asked:
            if name not in FAMILIES:
                raise TwinError(f"--family: {unknown('family', name, FAMILIES)}")
        families = tuple(f for f in FAMILIES if f in asked)
    name = Path(args.robot).resolve().name if Path(args.robot).is_dir() else args.robot
    folder = Path(args.out) if args.out else Path("twin-out") / name
    with show.progress(args.quiet or args.json) as progress:
        score = run(
            args.robot, protocol=args.protocol, families=families, count=args.count, seed=args.seed, progress=progress
        )
    with assets.atomic_folder(folder) as work:
        (work / "selftest.json").write_text(show.as_json(score.as_dict()) + "\n", encoding="utf-8")
    if args.json:
        print(show.as_json(score.as_dict()))
    else:
        print("\n".join(lines(score)))
        print(f"\n  {folder / 'selftest.json'}")
    return score.exit_code


def lines(score: Score) -> Iterator[str]:
    """Yield what is to be read."""
    yield f"{score.robot} · {score.protocol} · seed {score.seed} · {score.seconds:.0f} s"
    yield ""
    bar = f"{100 * score.bar:.0f} %"
    share = f"{score.caught} of {score.counted} seeded faults caught ({100 * score.share:.1f} %, the bar is {bar})"
    alarms = f"{len(score.false_alarms)} false alarms on the correct robot"
    yield f"  {'PASSED' if score.passed else 'FAILED'}: {share}, {alarms}"
    yield ""
    rows = [
        (
            r["family"],
            str(r["seeded"]),
            str(r["caught"]),
            str(r["warned"]),
            str(r["missed"]),
            str(r["equivalent"]),
            ", ".join(f"{code} {n}" for code, n in list(r["by"].items())[:4]),
        )
        for r in score.table()
    ]
    head = ("family", "seeded", "caught", "only warned", "missed", "equivalent", "caught by")
    yield show.table(rows, head, fit=True)
    for title, state in (("missed", "missed"), ("no fault at all: not counted", "equivalent")):
        some = [o for o in score.outcomes if o.state == state]
        if some:
            yield ""
            yield f"  {title}"
            yield from (f"    {o.family}, {o.kind}: {o.what} ({o.message})" for o in some)
    if score.false_alarms:
        yield ""
        yield "  false alarms"
        yield from (show.finding(f) for f in score.false_alarms)
