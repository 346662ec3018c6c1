"""Compare what a proof.json states beside the hashes with the files: robot, inputs, motions, checks, findings."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from twin.core.json_types import JsonMapping
from twin.core.version import __version__
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.file_statements import ROBOT
from twin.exchange.audit.named_parts import has_all_names, named_parts
from twin.exchange.audit.report import MECHANISM, Check, Ledger
from twin.exchange.audit.sampled_states import CLIP

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

_PROTOCOLS = "trajectories"
"""Folder of a robot's protocols, each a file with the name of its motion."""

_CHANGED = ("proof.hash", "proof.missing", "proof.unlisted", "proof.file", "proof.doubled")
"""Codes of the findings that the folder has not the files that proof.json lists."""

_DIGITS = 2e-5
"""Largest relative difference of equal numbers, of which one has six digits."""

_CheckKey = tuple[str, str, str]
"""(name, file, what it is compared with) of a check."""

_OTHERS = "the other files"
"""What quantities of mechanism and shapes are compared with; an export has its mechanism among them."""

_REPEATED = 0.1
"""Largest difference between a stated measurement and the audit's own, as a fraction of its tolerance."""

_ROUNDING = 1e-12
"""Size up to which a measurement may be zero, and without a place, on another machine."""

_TIME = re.compile(r"t = (\d+(?:\.\d+)?(?:e[+-]?\d+)?) s")
"""Form of the time of a measurement."""

_QUOTED = re.compile(r"'([^']*)'")
"""Name in the place of a measurement, such as q1 in "joint 'q1'"."""

_LIBRARY = " on "
"""Before the library in the tool of a check, such as "twin.exchange.audit on usd-core"."""

_EXPORT_CODES = (
    "export.budget",
    "export.left_out",
    "export.mass_unknown",
    "export.no_equations",
    "export.not_planned",
    "export.partly_shown",
    "export.scene",
    "export.unjudged",
    "export.urdf_coupling",
    "export.urdf_loops",
    "export.urdf_transmission",
)
"""Codes of the findings that an export has beside those of its audit."""

_PLACED = ("export.left_out", "export.urdf_coupling", "export.urdf_loops")
"""Those whose message names all objects of their place."""

_BUDGETS = (
    ("any point of a link, between keys", "m", "between_position_m", "budget_position_m"),
    ("rotation of a link, between keys", "rad", "between_rotation_rad", "budget_rotation_rad"),
    ("gap of a joint, between keys", "m", "joint_gap_m", "budget_joint_gap_m"),
)
"""(check, its unit, measured entry of a clip, entry with its limit)."""

_CLIP_NUMBERS = ("rate", "keys", "duration_s", "between_position_m", "between_rotation_rad", "joint_gap_m")
"""Entries that each clip has, with numbers."""


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
    _check_protocols(proof["inputs"], proof["clips"], ledger)
    _check_clips(proof["clips"], contents, ledger)
    _check_rows(proof, ledger)
    _check_budgets(proof, ledger)
    audit_checks = list(checks)
    # The measurements belong to the files of the export, and to this version of the audit.
    changed = any(finding.code in _CHANGED for finding in ledger.found)
    if audit_checks and not changed and ledger.file == "proof.json" and proof["made_by"] == f"twin {__version__}":
        tracks = {content.file for content in contents if content.is_track}
        _check_repeated(proof["checks"], audit_checks, tracks, ledger)
        _check_places(proof, contents, audit_checks, ledger)
        _check_export_findings(proof["findings"], ledger)
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
    texts = set()
    for row in rows:
        # In JSON, the order of keys has no meaning: two entries may differ in it and be the same.
        text = json.dumps(row, sort_keys=True)
        if text in texts:
            ledger.wrong("proof.doubled", f"'{key}' in proof.json has an entry twice: {text[:80]}….", key)
        texts.add(text)


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
        stated_names = []
        for name, file in names.items():
            stated_names.append(f"'{name}' in {file}")
        real = ", ".join(stated_names) or "not stated in a file"
        ledger.wrong("proof.robot", f"proof.json is of the robot '{robot}'; its name is {real}.", "robot")
    stated = proof["model_hash"]
    if not _SHA.fullmatch(stated.removeprefix("sha256:")):
        # Texts of a changed proof.json are quoted in part only: they may be of any length.
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
        # A name such as ../../x must not make the audit read files outside of the folder.
        if not file.is_relative_to(folder.resolve()) or not file.is_file():
            absent.append(name)
        elif hashlib.sha256(file.read_bytes()).hexdigest() != digits:
            ledger.wrong("proof.input", f"the input '{name}' has another sha256 than proof.json states.", name)
    # An export has no inputs beside it. Who has put them there learns which of them are missing.
    if absent and len(absent) < len(rows):
        text = f"{len(absent)} inputs in proof.json were not compared, because they are not in the folder: {absent[0]}"
        if len(absent) > 1:
            text += ", …"
        ledger.add("proof.inputs_absent", "info", f"{text}.", "inputs")


def _check_protocols(inputs: Sequence[JsonMapping], clips: Sequence[JsonMapping], ledger: Ledger) -> None:
    """Report motions whose protocol is not among the inputs, if those of other motions are."""
    protocols = set()
    for row in inputs:
        path = PurePosixPath(str(row.get("file")))
        if path.parent.name == _PROTOCOLS:
            protocols.add(path.name)
    for row in clips:
        file = f"{row.get('protocol')}.toml"
        if protocols and file not in protocols:
            ledger.wrong("proof.input", f"the inputs in proof.json lack the protocol '{file}' of a motion.", file)


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
        for key in _CLIP_NUMBERS:
            if not _is_number(row.get(key)):
                ledger.wrong("proof.clip", f"clip '{name}' in proof.json has no number '{key}'.", key)
        limits = []
        for _, _, _, limit in _BUDGETS:
            if limit in row:
                limits.append(limit)
        if len(limits) not in (0, len(_BUDGETS)):
            text = f"clip '{name}' in proof.json has {', '.join(limits)}, but not all limits."
            ledger.wrong("proof.clip", text, "budget")
    for name in sorted(tracks.keys() - listed):
        ledger.wrong("proof.clip", f"proof.json lacks the clip '{name}' of {tracks[name]}.", name)


def _is_number(value: Any) -> bool:
    # Python counts a bool as an int; true in JSON is not a number. Python's JSON may also hold NaN and Infinity.
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _check_rows(proof: JsonMapping, ledger: Ledger) -> None:
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


def _fault_of_check(row: JsonMapping, known_files: set[str]) -> str:
    """Return the fault of a check, as the end of a sentence; "" without a fault."""
    for key in ("check", "file", "tool"):
        if not isinstance(row.get(key), str) or not row[key]:
            return f"has no '{key}'"
    for key in ("version", "unit", "where", "when"):
        if not isinstance(row.get(key), str):
            return f"has no text '{key}'"
    if row["tool"] != _WRITER and not isinstance(row.get("against"), str):
        return "has no text 'against'"
    if row["file"] not in known_files:
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
                if not _is_same(clip.get(entry), row.get(key)):
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


def _is_same(first: Any, second: Any) -> bool:
    """Return whether two numbers are equal but for the digits of a text, or both are None."""
    if not _is_number(first) or not _is_number(second):
        return first is None and second is None
    return abs(first - second) <= _DIGITS * max(abs(first), abs(second))


def _check_repeated(
    rows: Sequence[JsonMapping], checks: Iterable[Check], tracks: Collection[str], ledger: Ledger
) -> None:
    """Compare the checks in proof.json with those of this audit that have the same name, file and counterpart.

    Where and when a deviation is largest may differ: several places may have the same, up to rounding. An export
    compares with the mechanism; an audit without a mechanism compares with other files instead. `tracks` are those
    among the other files.
    """
    checks_by_key: dict[_CheckKey, list[Check]] = {}
    for check in checks:
        if check.file != ledger.file:
            checks_by_key.setdefault((check.check, check.file, check.against), []).append(check)
    stated: set[_CheckKey] = set()
    for row in rows:
        key = (str(row.get("check")), str(row.get("file")), str(row.get("against", "")))
        stated.add(key)
        same_checks = checks_by_key.get(key, [])
        if not same_checks and row.get("tool") != _WRITER and not key[2]:
            text = f"proof.json has the check '{key[0][:80]}' of '{key[1]}', which this audit does not have."
            ledger.wrong("proof.check", text, "checks", suggestion="export again")
        elif same_checks and not any(_repeats(row, check) for check in same_checks):
            check = same_checks[0]
            text = (
                f"the check '{check.check[:80]}' of {check.file} is stated as {_shown(row)}; this audit has "
                f"{_shown(check.as_dict())}."
            )
            ledger.wrong("proof.check", text, check.file, suggestion="export again")
    for name, file, against in checks_by_key:
        # Drawn states are compared only if a mechanism is given to the audit, values of joints only if none is.
        if name.startswith(f"clip '{CLIP}'") or ": joint values against " in name:
            continue
        # A stage names a motion otherwise than the tracks and the mechanism.
        if name.startswith("clip '") and against not in ("", MECHANISM, *tracks):
            continue
        with_mechanism = name.replace(against, MECHANISM) if against else name
        if (name, file, against) not in stated and (with_mechanism, file, MECHANISM) not in stated:
            text = f"proof.json lacks the check '{name[:80]}' of '{file}'."
            ledger.wrong("proof.check", text, "checks", suggestion="export again")


def _repeats(row: JsonMapping, check: Check) -> bool:
    """Return whether a stated check is one of this audit, within a fraction of its tolerance."""
    if (
        row.get("unit") != check.unit
        or row.get("tool") != check.tool
        or not _is_same(row.get("tolerance"), check.tolerance)
    ):
        return False
    # The version of a check on a library is that of the library, which another machine may have otherwise.
    is_of_format = check.tool.startswith("twin.") and _LIBRARY not in check.tool
    if is_of_format and row.get("version") != check.version:
        return False
    worst = row.get("worst")
    if check.worst is None or worst is None or check.tolerance is None:
        return (worst is None) == (check.worst is None)
    if not _is_number(worst):
        return False
    if min(abs(worst), abs(check.worst)) > _ROUNDING:
        # A size has a place and a time in both, or in neither, and no other sign.
        if worst * check.worst < 0:
            return False
        if bool(row.get("where")) != bool(check.where) or bool(row.get("when")) != bool(check.when):
            return False
    return abs(worst - check.worst) <= _REPEATED * check.tolerance + _DIGITS * abs(check.worst)


def _shown(row: JsonMapping) -> str:
    """Return the measurement of a check as text: size, tolerance, place, time and tool."""
    size = f"{row.get('worst')} {row.get('unit')} (tolerance {row.get('tolerance')})"
    place = f"at '{row.get('where')}', '{row.get('when')}'"
    return f"{size} {place} by {row.get('tool')} {row.get('version')}"


def _check_places(proof: JsonMapping, contents: Sequence[Content], checks: Iterable[Check], ledger: Ledger) -> None:
    """Report checks in proof.json that are worst at a place that no file has, or at a time of no motion.

    Places are judged of the checks that this audit repeats, and of the writer's if there are tracks, which name all
    links and moving joints. The mechanism of the export may have parts that the formats in the folder cannot hold:
    checks against all other files are judged only if there is a stage, which holds all.
    """
    names = named_parts(contents)
    forms = set()
    moments = set()
    repeated = set()
    for check in checks:
        names.update(_named(check.where))
        forms.add(_QUOTED.sub("''", check.where))
        moments.add(check.when)
        repeated.add((check.check, check.file, check.against))
    has_tracks = any(content.is_track and content.clips for content in contents)
    last = 0.0
    for clip in proof["clips"]:
        if _is_number(clip.get("duration_s")):
            last = max(last, clip["duration_s"])
    for row in proof["checks"]:
        subject = f"the check '{str(row.get('check'))[:80]}' of '{row.get('file')}' in proof.json"
        where = str(row.get("where"))
        form = _QUOTED.sub("''", where)
        is_known = names.issuperset(_named(where)) and ("'" not in where or form in forms)
        is_writers = row.get("tool") == _WRITER and has_tracks
        is_repeated = (row.get("check"), row.get("file"), row.get("against")) in repeated
        if row.get("against") == _OTHERS:
            is_repeated = is_repeated and has_all_names(contents)
        if not is_known and (is_writers or is_repeated):
            text = f"{subject} is worst at '{where[:80]}', which no file has."
            ledger.wrong("proof.check", text, "where", suggestion="export again")
        when = str(row.get("when"))
        if when not in moments and not _is_time(when, last):
            text = f"{subject} is worst at '{when[:80]}'; the motions are from t = 0 s to t = {last:.6g} s."
            ledger.wrong("proof.check", text, "when", suggestion="export again")


def _named(where: str) -> list[str]:
    """Return the names in a place: those in quotes; without quotes, the last part of a path."""
    if "'" in where:
        return _QUOTED.findall(where)
    name = where.rsplit("/", 1)[-1]
    if not name:
        return []
    return [name]


def _is_time(when: str, last: float) -> bool:
    """Return whether a moment is a time from 0 to `last` in s, rounded to four digits."""
    time = _TIME.fullmatch(when)
    # Four digits lie at most 5e-4 of the time above it.
    return time is not None and 0.0 <= float(time[1]) <= last * (1 + 1e-3)


def _check_export_findings(rows: Sequence[JsonMapping], ledger: Ledger) -> None:
    """Report findings of the export itself with a code that twin has not, or a place that their message lacks."""
    for row in rows:
        code = str(row.get("code"))
        message = str(row.get("message"))
        if not code.startswith("export."):
            continue
        if code not in _EXPORT_CODES:
            ledger.wrong("proof.finding", f"proof.json has a finding with the code '{code[:80]}', which twin has not.")
        where = str(row.get("where"))
        if code in _PLACED and not (where and all(name in message for name in where.split(", "))):
            text = f"the finding '{message[:80]}…' in proof.json is at '{where[:80]}', which its message does not name."
            ledger.wrong("proof.finding", text, "where")
        if code in _PLACED:
            for key in ("when", "size", "unit", "limit", "cause"):
                if row.get(key):
                    text = f"the finding '{message[:80]}…' in proof.json has {key} '{str(row[key])[:80]}'; it has none."
                    ledger.wrong("proof.finding", text, key)


def _check_verdict(proof: JsonMapping, ledger: Ledger) -> None:
    """Report a verdict other than that of the findings, and checks that disagree although no finding does."""
    verdicts = set()
    for row in proof["findings"]:
        # `_check_rows` has reported an unknown severity: it says nothing about the verdict.
        verdicts.add(_SEVERITIES.get(str(row.get("severity")), "agree"))
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
    return finding.get("severity") == "warning" and str(finding.get("where")).startswith(file)


def _unwrapped(text: str) -> str:
    """Return a text with single spaces: README.txt wraps lines."""
    return " ".join(text.split())


def _check_readme_findings(rows: Sequence[JsonMapping], folder: Path, ledger: Ledger) -> None:
    """Report findings of the export in README.txt that proof.json does not have; it has those of the audit besides."""
    section = re.search(r"^Findings of the export\n-+\n(.*?)\n\n", _readme(folder), re.MULTILINE | re.DOTALL)
    if section is None:
        return
    messages = set()
    for row in rows:
        messages.add(_unwrapped(str(row.get("message"))))
    for entry in re.split(r"^- ", section[1], flags=re.MULTILINE)[1:]:
        message = _unwrapped(entry)
        if message not in messages and message != "nothing":
            text = f"README.txt has the finding '{message[:100]}', which proof.json does not have."
            ledger.wrong("proof.finding", text, "findings")
