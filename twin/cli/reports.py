"""Write and print the reports of `twin validate` and `twin run`, and print the proofs of `twin validate --prove`."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli import result_files, show
from twin.core.json_types import JsonObject
from twin.core.result import Result

if TYPE_CHECKING:
    from twin.api.robot import Robot
    from twin.validation.result import Report


def folder_name(protocol: str, variants: Mapping[str, str] | None) -> str:
    """Return the name of a report's folder, made of protocol and variants."""
    name = protocol
    for equation, variant in (variants or {}).items():
        name += f"-{equation}-{variant}"
    return name


def write_report(report: Report, folder: Path, root: Path, robot: Robot) -> None:
    """Write a report of a robot into a folder.

    If `root`, the folder of all results of the robot, has a selftest.json, the score of the self-test is included.
    """
    folder.mkdir(parents=True, exist_ok=True)
    result_files.write_report(report, folder, root / "selftest.json", robot)


def print_reports(
    reports: Sequence[tuple[Report, Path]], args: argparse.Namespace, proofs: Sequence[tuple[Result, Path]] = ()
) -> int:
    """Print reports (at least one) and proofs, each with its folder; return the exit code of the most severe verdict.

    With --json, one report is printed alone; several, or one with proofs, are lists `reports` and `proofs`.
    """
    results: list[Result] = []
    for result, _ in (*reports, *proofs):
        results.append(result)
    # exit codes rise with severity: 0 agree, 1 disagree, 2 unchecked
    most_severe = max(results, key=lambda result: result.exit_code)
    if args.json:
        _print_json(reports, proofs, most_severe)
    else:
        _print_text(reports, proofs, args)
    return most_severe.exit_code


def _print_json(
    reports: Sequence[tuple[Report, Path]], proofs: Sequence[tuple[Result, Path]], most_severe: Result
) -> None:
    report_data = _with_folders(reports)
    if len(report_data) == 1 and not proofs:
        print(show.as_json(report_data[0]))
        return
    content: JsonObject = {"reports": report_data}
    if proofs:
        content["proofs"] = _with_folders(proofs)
    print(show.as_json(show.record("reports", content, judged=most_severe.verdict)))


def _with_folders(results: Sequence[tuple[Result, Path]]) -> list[JsonObject]:
    """Return the data of each result, with its folder."""
    data = []
    for result, folder in results:
        data.append({**result.as_dict(), "folder": str(folder)})
    return data


def _print_text(
    reports: Sequence[tuple[Report, Path]], proofs: Sequence[tuple[Result, Path]], args: argparse.Namespace
) -> None:
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
