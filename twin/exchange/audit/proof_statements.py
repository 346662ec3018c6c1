"""Compare what a proof.json states beside the hashes with the files: robot, inputs, motions, checks, findings."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from twin.core.json_types import JsonMapping
from twin.core.version import __version__
from twin.exchange.audit.motion import Content
from twin.exchange.audit.report import Check, Ledger
from twin.exchange.audit.stated import ROBOT
from twin.exchange.audit.states import CLIP

_KINDS: Mapping[str, type] = {
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

_SHA = re.compile(r"[0-9a-f]{64}")
_MADE_BY = re.compile(r"twin \d+\.\d+\.\d+[\w.+-]*")
_WRITER = "twin.exchange.write"
"""Tool of the checks that compare the errors between keys with their budgets."""

_VERDICTS = ("agree", "disagree", "unchecked")
_SEVERITIES: Mapping[str, str] = {
    "info": "agree",
    "warning": "agree",
    "disagreement": "disagree",
    "error": "unchecked",
}
"""The verdict on files that have a finding of a severity and none that is worse."""

_CHANGED = ("proof.hash", "proof.missing", "proof.unlisted", "proof.file", "proof.doubled")
"""Codes of the findings that the folder has not the files that proof.json lists."""

_DIGITS = 2e-5
"""Largest relative difference of equal numbers, of which one has six digits."""

_REPEATED = 0.1
"""Largest difference between a stated measurement and the audit's own, as a fraction of its tolerance."""

_BUDGETS = (
    ("any point of a link, between keys", "m", "between_position_m", "budget_position_m"),
    ("rotation of a link, between keys", "rad", "between_rotation_rad", "budget_rotation_rad"),
    ("gap of a joint, between keys", "m", "joint_gap_m", "budget_joint_gap_m"),
)
"""(check, its unit, measured entry of a clip, entry with its limit)."""


def check_statements(
    proof: JsonMapping, folder: Path, contents: Sequence[Content], checks: Iterable[Check], ledger: Ledger
) -> None:
    """Report statements of a proof.json that contradict the files, this audit, or each other.

    `proof` is the content of the proof.json in `folder`; `checks` are those of this audit on the other files.
    """
    before = len(ledger.found)
    if not _check_kinds(proof, ledger):
        return
    _check_origin(proof, folder, contents, ledger)
    _check_inputs(proof["inputs"], folder, ledger)
    _check_clips(proof["clips"], contents, ledger)
    _check_rows(proof, ledger)
    _check_budgets(proof, ledger)
    own = list(checks)
    # The measurements belong to the files of the export, and to this version of the audit.
    changed = any(finding.code in _CHANGED for finding in ledger.found)
    if own and not changed and ledger.file == "proof.json" and proof["made_by"] == f"twin {__version__}":
        _check_repeated(proof["checks"], own, ledger)
    _check_verdict(proof, ledger)
    _check_readme_findings(proof["findings"], folder, ledger)
    wrong = 0
    for finding in ledger.found[before:]:
        wrong += finding.severity != "info"
    ledger.row("statements of proof.json", float(wrong), "found", 0.0, against="the files")


def _check_kinds(proof: JsonMapping, ledger: Ledger) -> bool:
    """Report entries that are missing or of another type; return whether there are none."""
    fits = True
    for key, kind in _KINDS.items():
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
    seen = set()
    for row in rows:
        text = json.dumps(row, sort_keys=True)
        if text in seen:
            ledger.wrong("proof.doubled", f"'{key}' in proof.json has an entry twice: {text[:80]}….", key)
        seen.add(text)


def _check_origin(proof: JsonMapping, folder: Path, contents: Sequence[Content], ledger: Ledger) -> None:
    """Compare the robot, the hash of its model and the version of twin with those that the files state."""
    robot = proof["robot"]
    names: dict[str, str] = {}
    hashes: dict[str, str] = {}
    for content in contents:
        if content.stated.get(ROBOT):
            names.setdefault(str(content.stated[ROBOT]), content.file)
        if content.model_hash:
            hashes.setdefault(content.model_hash, content.file)
    if not robot or (names and robot not in names):
        real = ", ".join(f"'{name}' in {file}" for name, file in names.items()) or "not stated in a file"
        ledger.wrong("proof.robot", f"proof.json is of the robot '{robot}'; its name is {real}.", "robot")
    stated = proof["model_hash"]
    if not _SHA.fullmatch(stated.removeprefix("sha256:")):
        ledger.wrong("proof.model_hash", f"model_hash '{stated[:80]}' is not a sha256 of 64 digits.", "model_hash")
    elif hashes and stated not in hashes:
        real, file = next(iter(hashes.items()))
        text = f"proof.json is of the model {stated[:23]}…, {file} of {real[:23]}…."
        ledger.wrong("proof.model_hash", text, "model_hash")
    made_by = proof["made_by"]
    written = re.search(r"^Written by (twin \S+) from:", _readme(folder), re.MULTILINE)
    if not _MADE_BY.fullmatch(made_by):
        ledger.wrong("proof.made_by", f"made_by '{made_by[:80]}' is not 'twin' with its version.", "made_by")
    elif written is not None and written[1] != made_by:
        text = f"proof.json was made by {made_by}, README.txt by {written[1]}: they are of two exports."
        ledger.wrong("proof.made_by", text, "made_by", suggestion="export again")


def _readme(folder: Path) -> str:
    """Return the text of README.txt in a folder; "" if there is none that can be read."""
    try:
        return (folder / "README.txt").read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""


def _check_inputs(rows: Sequence[JsonMapping], folder: Path, ledger: Ledger) -> None:
    """Report inputs without name or hash; compare the hashes of those that are in the folder, and name the others."""
    names = set()
    absent = []
    for row in rows:
        name = row.get("file")
        sha = row.get("sha256")
        if not isinstance(name, str) or not name or not isinstance(sha, str):
            ledger.wrong("proof.input", "an input in proof.json lacks its name or its sha256.", "inputs")
            continue
        if name in names:
            ledger.wrong("proof.doubled", f"proof.json lists the input '{name}' twice.", "inputs")
        names.add(name)
        digits = sha.removeprefix("sha256:")
        if not _SHA.fullmatch(digits):
            text = f"the sha256 of the input '{name}' has not 64 hexadecimal digits."
            ledger.wrong("proof.input", text, name)
            continue
        file = (folder / name).resolve()
        if not file.is_relative_to(folder.resolve()) or not file.is_file():
            absent.append(name)
        elif hashlib.sha256(file.read_bytes()).hexdigest() != digits:
            ledger.wrong("proof.input", f"the input '{name}' has another sha256 than proof.json states.", name)
    if absent:
        text = f"{len(absent)} inputs in proof.json were not compared, because they are not in the folder: {absent[0]}"
        if len(absent) > 1:
            text += ", …"
        ledger.add("proof.inputs_absent", "info", f"{text}.", "inputs")


def _check_clips(rows: Sequence[JsonMapping], contents: Sequence[Content], ledger: Ledger) -> None:
    """Report clips without a track, tracks without a clip, and clips that are listed twice or lack a number."""
    tracks = {}
    for content in contents:
        if content.is_track and content.clips:
            tracks[str(content.extra["data"].get("protocol"))] = content.file
    listed: set[str] = set()
    for row in rows:
        name = str(row.get("protocol"))
        if name in listed:
            ledger.wrong("proof.doubled", f"proof.json lists the clip '{name}' twice.", "clips")
        listed.add(name)
        if tracks and name not in tracks:
            ledger.wrong("proof.clip", f"proof.json lists the clip '{name}', which has no track.", name)
        for key in ("rate", "keys", "duration_s", *(measured for _, _, measured, _ in _BUDGETS)):
            if not _is_number(row.get(key)):
                ledger.wrong("proof.clip", f"clip '{name}' in proof.json has no number '{key}'.", key)
        limits = [limit for _, _, _, limit in _BUDGETS if limit in row]
        if len(limits) not in (0, len(_BUDGETS)):
            text = f"clip '{name}' in proof.json has {', '.join(limits)}, but not all limits."
            ledger.wrong("proof.clip", text, "budget")
    for name in sorted(tracks.keys() - listed):
        ledger.wrong("proof.clip", f"proof.json lacks the clip '{name}' of {tracks[name]}.", name)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _check_rows(proof: JsonMapping, ledger: Ledger) -> None:
    """Report checks and findings that are malformed, contradict themselves, or are of files that are not listed."""
    known = {f"clip {row.get('protocol')}" for row in proof["clips"]}
    for row in proof["files"]:
        file = Path(str(row.get("file")))
        known |= {file.as_posix(), *(folder.as_posix() for folder in file.parents)}
    for row in proof["checks"]:
        name = str(row.get("check"))
        fault = _fault_of_check(row, known)
        if fault:
            ledger.wrong("proof.check", f"the check '{name[:80]}' in proof.json {fault}.", "checks")
    for row in proof["findings"]:
        if not row.get("code") or not row.get("message") or row.get("severity") not in _SEVERITIES:
            code = str(row.get("code"))
            text = f"the finding '{code}' in proof.json lacks its code, its message, or a known severity."
            ledger.wrong("proof.finding", text, "findings")
        for key in ("where", "when", "unit", "suggestion", "cause"):
            if not isinstance(row.get(key), str):
                text = f"the finding '{row.get('code')}' in proof.json has no text '{key}'."
                ledger.wrong("proof.finding", text, "findings")
        for key in ("size", "limit"):
            if key not in row or not (row[key] is None or _is_number(row[key])):
                text = f"the finding '{row.get('code')}' in proof.json has no number '{key}'."
                ledger.wrong("proof.finding", text, "findings")


def _fault_of_check(row: JsonMapping, known: set[str]) -> str:
    for key in ("check", "file", "tool"):
        if not isinstance(row.get(key), str) or not row[key]:
            return f"has no '{key}'"
    for key in ("version", "unit", "where", "when"):
        if not isinstance(row.get(key), str):
            return f"has no text '{key}'"
    if row["tool"] != _WRITER and not isinstance(row.get("against"), str):
        return "has no text 'against'"
    if row["file"] not in known:
        return f"is of '{row['file']}', which is neither a listed file nor a clip"
    for key in ("worst", "tolerance"):
        if key not in row or not (row[key] is None or _is_number(row[key])):
            return f"has no number '{key}'"
    if row.get("verdict") not in _VERDICTS:
        return f"has the verdict '{row.get('verdict')}', which does not exist"
    worst = row["worst"]
    tolerance = row["tolerance"]
    if row["verdict"] != "agree" or worst is None or tolerance is None:
        return ""
    if worst > tolerance + _DIGITS * abs(tolerance):
        return f"agrees with {worst:g}, although its tolerance is {tolerance:g}"
    return ""


def _check_budgets(proof: JsonMapping, ledger: Ledger) -> None:
    """Compare the errors between keys, and their limits, in the list of clips with those in the list of checks."""
    rows = {}
    for row in proof["checks"]:
        if row.get("tool") == _WRITER:
            rows[(row.get("check"), row.get("file"))] = row
    for clip in proof["clips"]:
        for check, unit, measured, limit in _BUDGETS:
            name = f"clip {clip.get('protocol')}"
            row = rows.pop((check, name), None)
            if row is None:
                ledger.wrong("proof.check", f"proof.json lacks the check '{check}' of {name}.", name)
                continue
            for entry, key in ((measured, "worst"), (limit, "tolerance")):
                if not _same(clip.get(entry), row.get(key)):
                    text = f"{name}: {entry} is {clip.get(entry)}; the {key} of the check is {row.get(key)}."
                    ledger.wrong("proof.clip", text, entry)
            if row.get("unit") != unit:
                text = f"the check '{check}' of {name} is in '{row.get('unit')}', not in {unit}."
                ledger.wrong("proof.check", text, name)
            if f"twin {row.get('version')}" != proof["made_by"]:
                text = f"the check '{check}' is of version {row.get('version')}; the files are of {proof['made_by']}."
                ledger.wrong("proof.check", text, name)
    for check, name in rows:
        ledger.wrong("proof.check", f"proof.json has the check '{check}' of '{name}', which is no clip's.", "checks")


def _same(one: Any, other: Any) -> bool:
    if not _is_number(one) or not _is_number(other):
        return one is None and other is None
    return abs(one - other) <= _DIGITS * max(abs(one), abs(other))


def _check_repeated(rows: Sequence[JsonMapping], checks: Iterable[Check], ledger: Ledger) -> None:
    """Compare the checks in proof.json with those of this audit that have the same name, file and counterpart.

    Where and when a deviation is largest is not compared: several places may have the same, up to rounding.
    """
    own: dict[tuple[Any, ...], list[Check]] = {}
    for check in checks:
        if check.file != ledger.file:
            own.setdefault((check.check, check.file, check.against), []).append(check)
    stated = set()
    for row in rows:
        key = (row.get("check"), row.get("file"), row.get("against"))
        stated.add(key)
        found = own.get(key, [])
        # What an export compares with the mechanism, an audit without one compares with other files.
        if not found and row.get("tool") != _WRITER and not row.get("against"):
            text = f"proof.json has the check '{str(key[0])[:80]}' of '{key[1]}', which this audit does not have."
            ledger.wrong("proof.check", text, "checks", suggestion="export again")
        elif found and not any(_repeats(row, check) for check in found):
            check = found[0]
            text = (
                f"the check '{check.check[:80]}' of {check.file} is stated as {_shown(row)}; this audit has "
                f"{_shown(check.as_dict())}."
            )
            ledger.wrong("proof.check", text, check.file, suggestion="export again")
    for key in own:
        # What is compared with other files, or at drawn states, depends on what is given to the audit.
        if key not in stated and not key[2] and not str(key[0]).startswith(f"clip '{CLIP}'"):
            text = f"proof.json lacks the check '{str(key[0])[:80]}' of '{key[1]}'."
            ledger.wrong("proof.check", text, "checks", suggestion="export again")


def _repeats(row: JsonMapping, check: Check) -> bool:
    """Return whether a stated check is one of this audit, within a fraction of its tolerance."""
    if (
        row.get("unit") != check.unit
        or row.get("tool") != check.tool
        or not _same(row.get("tolerance"), check.tolerance)
    ):
        return False
    if check.tool.startswith("twin.") and row.get("version") != check.version:
        return False
    worst = row.get("worst")
    if check.worst is None or worst is None or check.tolerance is None:
        return (worst is None) == (check.worst is None)
    if not _is_number(worst):
        return False
    return abs(worst - check.worst) <= _REPEATED * check.tolerance + _DIGITS * abs(check.worst)


def _shown(row: JsonMapping) -> str:
    size = f"{row.get('worst')} {row.get('unit')} (tolerance {row.get('tolerance')})"
    return f"{size} by {row.get('tool')} {row.get('version')}"


def _check_verdict(proof: JsonMapping, ledger: Ledger) -> None:
    """Report a verdict other than that of the findings, and checks that disagree although no finding does."""
    verdicts = {_SEVERITIES.get(str(row.get("severity")), "agree") for row in proof["findings"]}
    expected = "agree"
    if "unchecked" in verdicts:
        expected = "unchecked"
    elif "disagree" in verdicts:
        expected = "disagree"
    if proof["verdict"] != expected:
        text = f"the verdict in proof.json is '{proof['verdict']}'; by its findings it is '{expected}'."
        ledger.wrong("proof.verdict", text, "verdict")
    if expected == "agree":
        for row in proof["checks"]:
            if row.get("verdict") == "disagree":
                text = f"the check '{row.get('check')}' in proof.json disagrees, but none of its findings does."
                ledger.wrong("proof.check", text, "checks")


def _check_readme_findings(rows: Sequence[JsonMapping], folder: Path, ledger: Ledger) -> None:
    """Report findings of the export in README.txt that proof.json does not have; it has those of the audit besides."""
    section = re.search(r"^Findings of the export\n-+\n(.*?)\n\n", _readme(folder), re.MULTILINE | re.DOTALL)
    if section is None:
        return
    messages = {" ".join(str(row.get("message")).split()) for row in rows}
    for entry in re.split(r"^- ", section[1], flags=re.MULTILINE)[1:]:
        message = " ".join(entry.split())
        if message not in messages and message != "nothing":
            text = f"README.txt has the finding '{message[:100]}', which proof.json does not have."
            ledger.wrong("proof.finding", text, "findings")
