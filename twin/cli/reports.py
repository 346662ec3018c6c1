"""Write and print the reports of `twin validate` and `twin run`."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli import result_files, show
from twin.core.result import Result

if TYPE_CHECKING:
    from twin.api.robot import Robot
    from twin.validation.result import Report


def folder(protocol: str, variants: Mapping[str, str] | None) -> str:
    """Return the name of a report's folder, made of protocol and variants."""
    name = protocol
    for equation, variant in (variants or {}).items():
        name += f"-{equation}-{variant}"
    return name


def write(report: Report, folder: Path, root: Path, robot: Robot) -> None:
    """Write a report of a robot into a folder; if `root` contains selftest.json, include the score of the self-test."""
    folder.mkdir(parents=True, exist_ok=True)
    result_files.write_report(report, folder, root / "selftest.json", robot)


def finish(
    reports: Sequence[tuple[Report, Path]], args: argparse.Namespace, proofs: Sequence[tuple[Result, Path]] = ()
) -> int:
    """Print reports and proofs, each with its folder; return the exit code of the most severe verdict.

    With --json, one report is printed alone; several, or one with proofs, are lists `reports` and `proofs`.
    """
    results: list[Result] = []
    for result, _ in (*reports, *proofs):
        results.append(result)
    # exit codes rise with severity: 0 agree, 1 disagree, 2 unchecked
    most_severe = max(results, key=lambda result: result.exit_code)
    code = most_severe.exit_code
    if args.json:
        data = []
        for report, folder in reports:
            data.append({**report.as_dict(), "folder": str(folder)})
        if proofs:
            proof_data = []
            for result, folder in proofs:
                proof_data.append({**result.as_dict(), "folder": str(folder)})
            content = {"reports": data, "proofs": proof_data}
            print(show.as_json(show.record("reports", content, judged=most_severe.verdict)))
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
            variants = ", ".join(map("=".join, report.variants.items()))
            rows.append((report.protocol, variants, report.verdict))
        print(show.table(rows, ("protocol", "variants", "verdict")))
    for result, folder in proofs:
        print()
        show.finish(result, args, folder, ["prove.html", "certificate.json"])
    return code
