"""The form of a proof.json: the types of its entries, and what each check and finding in it must have."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeGuard

from twin.core.json_types import JsonMapping
from twin.exchange.audit.ledger import Ledger

_ENTRY_TYPES: Mapping[str, type] = {
    "robot": str,
    "model_hash": str,
    "made_by": str,
    "inputs": list,
    "files": list,
    "clips": list,
    "checks": list,
    "findings": list,
    "verdict": str,
}
"""Entries of version 1, with their types in JSON."""

WRITER = "twin.exchange.write"
"""Tool of the checks that compare the errors between keys with their budgets."""

_VERDICTS = ("agree", "disagree", "unchecked")
"""Verdicts of checks."""

SEVERITIES: Mapping[str, str] = {
    "info": "agree",
    "warning": "agree",
    "disagreement": "disagree",
    "error": "unchecked",
}
"""The verdict on files that have a finding of a severity and none that is worse."""

SAME_NUMBER_TOL = 2e-5
"""Largest relative difference of equal numbers, of which one has six digits."""


def check_kinds(proof: JsonMapping, ledger: Ledger) -> bool:
    """Report entries that are missing or of another type; return whether there are none."""
    fits = True
    for key, kind in _ENTRY_TYPES.items():
        if not isinstance(proof.get(key), kind):
            text = f"'{key}' in proof.json is missing, or is not of the type that version 1 has."
            ledger.wrong("proof.schema", text, key, suggestion="export again")
            fits = False
    for key in ("inputs", "clips", "checks", "findings"):
        rows = proof.get(key)
        if isinstance(rows, list) and not all(isinstance(row, dict) for row in rows):
            ledger.wrong("proof.schema", f"'{key}' in proof.json has an entry that is not an object.", key)
            fits = False
        elif isinstance(rows, list):
            _check_doubled(key, rows, ledger)
    return fits


def _check_doubled(key: str, rows: Sequence[JsonMapping], ledger: Ledger) -> None:
    texts = set()
    for row in rows:
        # In JSON, the order of keys has no meaning: two entries may differ in it and be the same.
        text = json.dumps(row, sort_keys=True)
        if text in texts:
            ledger.wrong("proof.doubled", f"'{key}' in proof.json has an entry twice: {text[:80]}….", key)
        texts.add(text)


def check_rows(proof: JsonMapping, ledger: Ledger) -> None:
    """Report checks and findings that are malformed, contradict themselves, or are of files that are not listed."""
    known_files = set()
    for row in proof["clips"]:
        known_files.add(f"clip {row.get('protocol')}")
    for row in proof["files"]:
        file = Path(str(row.get("file")))
        known_files.add(file.as_posix())
        known_files.update(map(Path.as_posix, file.parents))
    for row in proof["checks"]:
        name = str(row.get("check"))
        fault = _fault_of_check(row, known_files)
        if fault:
            ledger.wrong("proof.check", f"the check '{name[:80]}' in proof.json {fault}.", "checks")
    for row in proof["findings"]:
        if not (_has_text(row, "code") and _has_text(row, "message") and str(row.get("severity")) in SEVERITIES):
            code = str(row.get("code"))
            text = f"the finding '{code[:80]}' in proof.json lacks its code, its message, or a known severity."
            ledger.wrong("proof.finding", text, "findings")
        for key in ("where", "when", "unit", "suggestion", "cause"):
            if not isinstance(row.get(key), str):
                text = f"the finding '{row.get('code')}' in proof.json has no text '{key}'."
                ledger.wrong("proof.finding", text, "findings")
        for key in ("size", "limit"):
            if key not in row or not (row[key] is None or is_number(row[key])):
                text = f"the finding '{row.get('code')}' in proof.json has no number '{key}'."
                ledger.wrong("proof.finding", text, "findings")


def _fault_of_check(row: JsonMapping, known_files: set[str]) -> str:
    """Return the fault of a check, as the end of a sentence; "" without a fault."""
    for key in ("check", "file", "tool"):
        if not _has_text(row, key):
            return f"has no '{key}'"
    for key in ("version", "unit", "where", "when"):
        if not isinstance(row.get(key), str):
            return f"has no text '{key}'"
    if row["tool"] != WRITER and not isinstance(row.get("against"), str):
        return "has no text 'against'"
    if row["file"] not in known_files:
        return f"is of '{row['file']}', which is neither a listed file nor a clip"
    for key in ("worst", "tolerance"):
        if key not in row or not (row[key] is None or is_number(row[key])):
            return f"has no number '{key}'"
    if row.get("verdict") not in _VERDICTS:
        return f"has the verdict '{row.get('verdict')}', which does not exist"
    worst = row["worst"]
    tolerance = row["tolerance"]
    if row["verdict"] != "agree" or worst is None or tolerance is None:
        return ""
    if worst > tolerance + SAME_NUMBER_TOL * abs(tolerance):
        return f"agrees with {worst:g}, although its tolerance is {tolerance:g}"
    return ""


def _has_text(row: JsonMapping, key: str) -> bool:
    """Return whether a row has an entry that is a text, and not empty."""
    return isinstance(row.get(key), str) and bool(row[key])


def is_number(value: object) -> TypeGuard[int | float]:
    """Return whether a value of JSON is a finite number."""
    # Python counts a bool as an int; true in JSON is not a number. Python's JSON may also hold NaN and Infinity.
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number of hundreds of digits
        return False


def is_same_number(first: object, second: object) -> bool:
    """Return whether two numbers are equal but for the digits of a text, or both are None."""
    if not is_number(first) or not is_number(second):
        return first is None and second is None
    return abs(first - second) <= SAME_NUMBER_TOL * max(abs(first), abs(second))
