"""`twin study`: published tables recomputed from their own rows: user studies, and inertia tables."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin import api
from twin.cli import show
from twin.core.errors import TwinError
from twin.core.findings import EXIT_CODES, Finding, by_severity, verdict

_NEXT = "compare the numbers above with the document; if it prints them so, cite the recomputed ones beside them"


def study(args: argparse.Namespace) -> int:
    """Print the recomputed tables of a robot's studies, or of one file; exit 1 if print and rows disagree."""
    from twin.validation.study import load, recompute

    path = Path(args.robot)
    if path.suffix == ".toml":
        paths = [path]
    else:
        robot = api.load(args.robot)
        paths = sorted((robot.files.trajectories / "study").glob("*.toml")) if robot.files is not None else []
        exhibit = robot.files is not None and (robot.files.cad / "exhibit.toml").is_file()
        if not paths and not exhibit:
            raise TwinError(f"{robot.name} has no study and no exhibit; give the path of a study file")
        if exhibit and not paths:
            return _inertias(robot, args)
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
        summary = {"verdict": verdict(findings), "what_to_do": _what_to_do(findings)}
        print(show.as_json({**summary, "studies": data, "findings": said}))
    else:
        _conclude(findings, "the printed means, p-values and claims")
    return EXIT_CODES[verdict(findings)]


def _inertias(robot: api.Robot, args: argparse.Namespace) -> int:
    """Print what the published inertia tables of a robot imply; exit 1 if they cannot be used as printed."""
    from twin.validation.masses.audit import audit_report

    exhibit, rows, findings = audit_report(robot)
    if exhibit is None:  # the caller has looked
        raise TwinError(f"{robot.name} has no exhibit")
    if args.json:
        said = [f.as_dict() for f in findings]
        data = {"verdict": verdict(findings), "what_to_do": _what_to_do(findings)}
        data |= {"title": exhibit.title, "source": exhibit.source}
        print(show.as_json({**data, "rows": [r.as_dict() for r in rows], "findings": said}))
        return EXIT_CODES[verdict(findings)]
    print(f"{exhibit.title}\n  {exhibit.source}\n")
    lines = [
        (
            r.name,
            "yes" if r.definite else "NO",
            f"{r.slack:.2g}",
            f"{r.mass_printed:.3f}",
            f"{r.mass_negated:.3f}",
        )
        for r in rows
    ]
    plain, negated = sum(r.mass_printed for r in rows), sum(r.mass_negated for r in rows)
    lines.append(("sum", "", "", f"{plain:.2f}", f"{negated:.2f}"))
    head = ("row", "positive definite", "triangle slack", "minimum mass, as printed [kg]", "products negated [kg]")
    print(show.table(lines, head), "\n")
    _conclude(findings, "the printed masses and inertias")
    return EXIT_CODES[verdict(findings)]


def _conclude(findings: list[Finding], what: str) -> None:
    """Print the findings, the verdict in one line, and what to do."""
    for f in by_severity(findings):
        print(show.finding(f))
    state = verdict(findings)
    n = sum(f.severity == "disagreement" for f in findings)
    count = f"{n} of {what} {'do' if n > 1 else 'does'} not follow from what stands beside them"
    words = {
        "agree": f"AGREE: {what} follow from what stands beside them",
        "disagree": f"DISAGREE: {count}",
        "unchecked": f"UNCHECKED: {what} could not all be judged",
    }
    print(f"\n  {words[state]} (exit code {EXIT_CODES[state]})")
    if way := _what_to_do(findings):
        print(f"  what to do: {way}")


def _what_to_do(findings: list[Finding]) -> str:
    return _NEXT if verdict(findings) == "disagree" else ""
