"""Compare the checks and findings in a proof.json with those of this audit."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence

from twin.core.json_types import JsonMapping
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.ledger import MECHANISM, Check, Ledger
from twin.exchange.audit.named_parts import has_all_names, named_parts
from twin.exchange.audit.proof_form import SAME_NUMBER_TOL, WRITER, is_number, is_same_number
from twin.exchange.audit.sampled_states import CLIP

_CheckKey = tuple[str, str, str]
"""(name, file, what it is compared with) of a check."""

_OTHER_FILES = "the other files"
"""What quantities of mechanism and shapes are compared with; an export has its mechanism among them."""

_MAX_DIFFERENCE = 0.1
"""Largest difference between a stated measurement and the audit's own, as a fraction of its tolerance."""

_ROUNDING = 1e-12
"""Size up to which a measurement may be zero, and without a place, on another machine."""

_TIME = re.compile(r"t = (\d+(?:\.\d+)?(?:e[+-]?\d+)?) s")
"""Form of the time of a measurement."""

_TIME_ROUNDING = 1e-3
"""Part by which a time may be above the end of the motions: twice what rounding to four digits adds at most."""

_QUOTED_NAME = re.compile(r"'([^']*)'")
"""Name in the place of a measurement, such as q1 in "joint 'q1'"."""

_LIBRARY_MARK = " on "
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

_CODES_WITH_OBJECTS = ("export.left_out", "export.urdf_coupling", "export.urdf_loops")
"""Those whose message names all objects of their place."""


def check_repeated(
    rows: Sequence[JsonMapping], checks: Iterable[Check], tracks: Collection[str], ledger: Ledger
) -> None:
    """Compare the checks in proof.json with those of this audit that have the same name, file and counterpart.

    `rows` are the checks in proof.json, `checks` those of this audit, `tracks` the files with motions as tables.

    proof.json may have checks that this audit has not, if its writer made them or if they are against something: the
    export had the mechanism. This audit may have checks that proof.json has not:
    - against other files, where proof.json has the same against the mechanism, as "mass against the mechanism";
    - of drawn states, as "clip 'drawn joint states': position against the mechanism": an export does not draw them;
    - of joint values, as "clip 'swing': joint values against bars.xml": only without a mechanism they are compared;
    - of a motion against a stage, which names it otherwise than tracks and mechanism.
    Where and when a deviation is largest may differ: several places may have the same, up to rounding.
    """
    checks_by_key: dict[_CheckKey, list[Check]] = {}
    for check in checks:
        if check.file != ledger.file:
            checks_by_key.setdefault((check.check, check.file, check.against), []).append(check)
    stated: set[_CheckKey] = set()
    for row in rows:
        key = _key_of(row)
        stated.add(key)
        same_checks = checks_by_key.get(key, [])
        if not same_checks and row.get("tool") != WRITER and not key[2]:
            text = f"proof.json has the check '{key[0][:80]}' of '{key[1]}', which this audit does not have."
            ledger.wrong("proof.check", text, "checks", suggestion="export again")
        elif same_checks and not any(_repeats(row, check) for check in same_checks):
            check = same_checks[0]
            text = (
                f"the check '{check.check[:80]}' of {check.file} is stated as {_measurement_text(row)}; this audit has "
                f"{_measurement_text(check.as_dict())}."
            )
            ledger.wrong("proof.check", text, check.file, suggestion="export again")
    for name, file, against in checks_by_key:
        if name.startswith(f"clip '{CLIP}'") or ": joint values against " in name:
            continue
        if name.startswith("clip '") and against not in ("", MECHANISM, *tracks):
            continue
        with_mechanism = name.replace(against, MECHANISM) if against else name
        if (name, file, against) not in stated and (with_mechanism, file, MECHANISM) not in stated:
            text = f"proof.json lacks the check '{name[:80]}' of '{file}'."
            ledger.wrong("proof.check", text, "checks", suggestion="export again")


def _key_of(row: JsonMapping) -> _CheckKey:
    """Return the key of a check in proof.json; entries that are no texts are of no check of this audit."""
    return str(row.get("check")), str(row.get("file")), str(row.get("against", ""))


def _repeats(row: JsonMapping, check: Check) -> bool:
    """Return whether a stated check is one of this audit, within `_MAX_DIFFERENCE` of its tolerance."""
    if (
        row.get("unit") != check.unit
        or row.get("tool") != check.tool
        or not is_same_number(row.get("tolerance"), check.tolerance)
    ):
        return False
    # The version of a check on a library is that of the library, which another machine may have otherwise.
    is_of_format = check.tool.startswith("twin.") and _LIBRARY_MARK not in check.tool
    if is_of_format and row.get("version") != check.version:
        return False
    worst = row.get("worst")
    if check.worst is None or worst is None or check.tolerance is None:
        return (worst is None) == (check.worst is None)
    if not is_number(worst):
        return False
    if min(abs(worst), abs(check.worst)) > _ROUNDING:
        # A size has a place and a time in both, or in neither, and no other sign.
        if worst * check.worst < 0:
            return False
        if bool(row.get("where")) != bool(check.where) or bool(row.get("when")) != bool(check.when):
            return False
    return abs(worst - check.worst) <= _MAX_DIFFERENCE * check.tolerance + SAME_NUMBER_TOL * abs(check.worst)


def _measurement_text(row: JsonMapping) -> str:
    """Return the measurement of a check as text: size, tolerance, place, time and tool."""
    size = f"{row.get('worst')} {row.get('unit')} (tolerance {row.get('tolerance')})"
    place = f"at '{row.get('where')}', '{row.get('when')}'"
    return f"{size} {place} by {row.get('tool')} {row.get('version')}"


def check_places(proof: JsonMapping, contents: Sequence[Content], checks: Iterable[Check], ledger: Ledger) -> None:
    """Report checks in proof.json that are worst at a place that no file has, or at a time of no motion.

    Places are judged of the checks that this audit repeats, and of the writer's if there are tracks, which name all
    links and moving joints. The mechanism of the export may have parts that the formats in the folder cannot hold:
    checks against all other files are judged only if there is a stage, which holds all.
    """
    names = named_parts(contents)
    quoted_forms = set()
    moments = set()
    repeated = set()
    for check in checks:
        names.update(_names_in_place(check.where))
        quoted_forms.add(_QUOTED_NAME.sub("''", check.where))
        moments.add(check.when)
        repeated.add((check.check, check.file, check.against))
    has_tracks = any(content.is_track and content.clips for content in contents)
    end = 0.0
    for clip in proof["clips"]:
        if is_number(clip.get("duration_s")):
            end = max(end, clip["duration_s"])
    for row in proof["checks"]:
        subject = f"the check '{str(row.get('check'))[:80]}' of '{row.get('file')}' in proof.json"
        where = str(row.get("where"))
        form = _QUOTED_NAME.sub("''", where)
        is_known = names.issuperset(_names_in_place(where)) and ("'" not in where or form in quoted_forms)
        is_writers = row.get("tool") == WRITER and has_tracks
        is_repeated = _key_of(row) in repeated
        if row.get("against") == _OTHER_FILES:
            is_repeated = is_repeated and has_all_names(contents)
        if not is_known and (is_writers or is_repeated):
            text = f"{subject} is worst at '{where[:80]}', which no file has."
            ledger.wrong("proof.check", text, "where", suggestion="export again")
        when = str(row.get("when"))
        if when not in moments and not _is_time(when, end):
            text = f"{subject} is worst at '{when[:80]}'; the motions are from t = 0 s to t = {end:.6g} s."
            ledger.wrong("proof.check", text, "when", suggestion="export again")


def _names_in_place(where: str) -> list[str]:
    """Return the names in a place: those in quotes; without quotes, the last part of a path."""
    if "'" in where:
        return _QUOTED_NAME.findall(where)
    name = where.rsplit("/", 1)[-1]
    if not name:
        return []
    return [name]


def _is_time(when: str, end: float) -> bool:
    """Return whether a moment is a time from 0 to `end` in s, rounded to four digits."""
    time = _TIME.fullmatch(when)
    return time is not None and 0.0 <= float(time[1]) <= end * (1 + _TIME_ROUNDING)


def check_export_findings(rows: Sequence[JsonMapping], ledger: Ledger) -> None:
    """Report findings of the export itself with a code that twin has not, or a place that their message lacks."""
    for row in rows:
        code = str(row.get("code"))
        message = str(row.get("message"))
        if not code.startswith("export."):
            continue
        if code not in _EXPORT_CODES:
            ledger.wrong("proof.finding", f"proof.json has a finding with the code '{code[:80]}', which twin has not.")
        where = str(row.get("where"))
        if code in _CODES_WITH_OBJECTS and not (where and all(name in message for name in where.split(", "))):
            text = f"the finding '{message[:80]}…' in proof.json is at '{where[:80]}', which its message does not name."
            ledger.wrong("proof.finding", text, "where")
        if code in _CODES_WITH_OBJECTS:
            for key in ("when", "size", "unit", "limit", "cause"):
                if row.get(key):
                    text = f"the finding '{message[:80]}…' in proof.json has {key} '{str(row[key])[:80]}'; it has none."
                    ledger.wrong("proof.finding", text, key)
