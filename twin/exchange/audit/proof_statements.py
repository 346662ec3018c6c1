"""Compare what a proof.json states beside the hashes with the files: robot, inputs, motions, checks, findings.

A proof.json is the record of an export, with its files and checks; proofs by `twin prove` are in the package `proof`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from twin.core.json_types import JsonMapping
from twin.core.version import __version__
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.ledger import Check, Ledger
from twin.exchange.audit.proof_form import SEVERITIES, check_kinds, check_rows
from twin.exchange.audit.proof_origin import (
    check_budgets,
    check_clips,
    check_inputs,
    check_origin,
    check_protocols,
)
from twin.exchange.audit.repeated_checks import check_export_findings, check_places, check_repeated

_CODES_OF_CHANGED_FILES = ("proof.hash", "proof.missing", "proof.unlisted", "proof.file", "proof.doubled")
"""Codes of the findings that the folder has not the files that proof.json lists."""


def check_statements(
    proof: JsonMapping, folder: Path, contents: Sequence[Content], checks: Iterable[Check], ledger: Ledger
) -> None:
    """Report statements of a proof.json that contradict the files, this audit, or each other.

    `proof` is the content of the proof.json in `folder`, as `check_proof` returns it: its `files` are valid. `checks`
    are those of this audit on the other files.
    """
    count_before = len(ledger.found)
    if not check_kinds(proof, ledger):
        return
    check_origin(proof, contents, ledger)
    check_inputs(proof["inputs"], folder, ledger)
    check_protocols(proof["inputs"], proof["clips"], ledger)
    check_clips(proof["clips"], contents, ledger)
    check_rows(proof, ledger)
    check_budgets(proof, ledger)
    audit_checks = list(checks)
    # The measurements belong to the files of the export, and to this version of the audit.
    is_changed = any(finding.code in _CODES_OF_CHANGED_FILES for finding in ledger.found)
    if audit_checks and not is_changed and ledger.file == "proof.json" and proof["made_by"] == f"twin {__version__}":
        tracks = {content.file for content in contents if content.is_track}
        check_repeated(proof["checks"], audit_checks, tracks, ledger)
        check_places(proof, contents, audit_checks, ledger)
        check_export_findings(proof["findings"], ledger)
    _check_verdict(proof, ledger)
    wrong = 0
    for finding in ledger.found[count_before:]:
        wrong += finding.severity != "info"
    ledger.row("statements of proof.json", float(wrong), "found", 0.0, against="the files")


def _check_verdict(proof: JsonMapping, ledger: Ledger) -> None:
    """Report a verdict other than that of the findings, and checks that disagree although no finding does."""
    verdicts = set()
    for row in proof["findings"]:
        # `check_rows` has reported an unknown severity: it says nothing about the verdict.
        verdicts.add(SEVERITIES.get(str(row.get("severity")), "agree"))
    expected = "agree"
    if "unchecked" in verdicts:
        expected = "unchecked"
    elif "disagree" in verdicts:
        expected = "disagree"
    if proof["verdict"] != expected:
        text = f"the verdict in proof.json is '{proof['verdict']}'; by its findings it is '{expected}'."
        ledger.wrong("proof.verdict", text, "verdict")
    if expected != "agree":
        return
    for row in proof["checks"]:
        # Findings that are warnings are counted by the checks of one file, and leave the verdict as it is.
        has_warning = any(_is_warning_on(finding, str(row.get("file"))) for finding in proof["findings"])
        if row.get("verdict") == "disagree" and not has_warning:
            text = f"the check '{row.get('check')}' in proof.json disagrees, but none of its findings does."
            ledger.wrong("proof.check", text, "checks")


def _is_warning_on(finding: JsonMapping, file: str) -> bool:
    """Return whether a finding is a warning on a file or folder, or on a place or a file in it."""
    where = str(finding.get("where"))
    # The next character tells robot.usd from robot.usda.
    is_on_file = where == file or where.startswith((f"{file}: ", f"{file}/"))
    return finding.get("severity") == "warning" and is_on_file
