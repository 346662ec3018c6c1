"""`twin study`: a published user study recomputed from its own rows."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin import api
from twin.cli import show
from twin.errors import TwinError
from twin.findings import EXIT_CODES, by_severity, verdict


def study(args: argparse.Namespace) -> int:
    """Print the recomputed tables of a robot's studies, or of one file; exit 1 if print and rows disagree."""
    from twin.study import load, recompute

    path = Path(args.robot)
    if path.suffix == ".toml":
        paths = [path]
    else:
        robot = api.load(args.robot)
        paths = sorted((robot.files.trajectories / "study").glob("*.toml")) if robot.files is not None else []
        if not paths:
            raise TwinError(f"{robot.name} has no study; give the path of a study file")
    data, findings = [], []
    for file in paths:
        tables = load(file)
        rows, found = recompute(tables)
        findings += found
        data.append({"title": tables.title, "source": tables.source, "rows": [r.as_dict() for r in rows]})
        if args.json:
            continue
        print(f"{tables.title}\n  {tables.source}\n")
        lines = [
            (r.name, f"{r.printed_p:.2f}", f"{p:.3f}", name, "reproduces the print" if name == r.test() else "")
            for r in rows
            for name, p in r.tests.items()
        ]
        print(show.table(lines, ("", "printed p", "p", "test", "")), "\n")
    if args.json:
        said = [f.as_dict() for f in findings]
        print(show.as_json({"verdict": verdict(findings), "studies": data, "findings": said}))
    else:
        for f in by_severity(findings):
            print(show.finding(f))
    return EXIT_CODES[verdict(findings)]
