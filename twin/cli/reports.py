"""Write and print the reports of `twin validate` and `twin run`."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

from twin.cli import pages, show


def folder(protocol: str, variants: Mapping[str, str] | None) -> str:
    """Return the name of a report's folder, made of protocol and variants."""
    name = protocol
    for equation, variant in (variants or {}).items():
        name += f"-{equation}-{variant}"
    return name


def write(report, folder: Path, root: Path, robot) -> None:
    """Write a report of a robot into a folder; if `root` contains selftest.json, include the score of the self-test."""
    folder.mkdir(parents=True, exist_ok=True)
    pages.write_report(report, folder, root / "selftest.json", robot)


def finish(reports, args: argparse.Namespace, proofs=()) -> int:
    """Print the reports, and proofs with their folders; return the exit code of the most severe verdict.

    With --json, one report is printed alone; several, or one with proofs, are lists `reports` and `proofs`.
    """
    most_severe, _ = max([*reports, *proofs], key=lambda written: written[0].exit_code)
    code = most_severe.exit_code
    if args.json:
        data = []
        for report, folder in reports:
            data.append({**report.as_dict(), "folder": str(folder)})
        if proofs:
            proved = [{**result.as_dict(), "folder": str(folder)} for result, folder in proofs]
            both = {"reports": data, "proofs": proved}
            print(show.as_json(show.record("reports", both, judged=most_severe.verdict)))
        elif len(data) == 1:
            print(show.as_json(data[0]))
        else:
            print(show.as_json(show.record("reports", {"reports": data}, judged=most_severe.verdict)))
        return code
    for report, folder in reports:
        show.finish(report, args)
        page = folder / "report.html"
        print(f"  report: {page}\n")
    if len(reports) > 1:
        rows = []
        for report, _ in reports:
            variants = ", ".join(f"{equation}={variant}" for equation, variant in report.variants.items())
            rows.append((report.protocol, variants, report.verdict))
        print(show.table(rows, ("protocol", "variants", "verdict")))
    for result, folder in proofs:
        print()
        show.finish(result, args, folder, ["prove.html", "certificate.json"])
    return code
