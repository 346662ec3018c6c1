"""Write and print the reports of `twin validate` and `twin run`."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

from twin.cli import pages, show


def folder(protocol: str, variants: Mapping[str, str] | None) -> str:
    """Return the name of a report's folder, made of protocol and variants."""
    return "-".join([protocol, *(f"{k}-{v}" for k, v in (variants or {}).items())])


def write(report, folder: Path, root: Path) -> None:
    """Write a report into a folder; if `root` contains selftest.json, include the score of the self-test."""
    folder.mkdir(parents=True, exist_ok=True)
    pages.write_report(report, folder, root / "selftest.json")


def finish(reports, args: argparse.Namespace) -> int:
    """Print the reports; return the exit code of the most severe verdict."""
    code = max(r.exit_code for r, _ in reports)
    if args.json:
        data = [{**r.as_dict(), "folder": str(folder)} for r, folder in reports]
        worst = max(reports, key=lambda r: r[0].exit_code)[0].verdict
        print(show.as_json(data[0] if len(data) == 1 else show.record("reports", {"reports": data}, judged=worst)))
        return code
    for report, folder in reports:
        show.finish(report, args)
        print(f"  report: {folder / 'report.html'}")
        print(f"\n  what to do: {report.what_to_do}\n" if report.what_to_do else "")
    if len(reports) > 1:
        rows = [(r.protocol, ", ".join(f"{k}={v}" for k, v in r.variants.items()), r.verdict) for r, _ in reports]
        print(show.table(rows, ("protocol", "variants", "verdict")))
    return code
