"""The result of an audit: measurements (checks) and findings."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import NamedTuple, TypeVar

from twin.core import format
from twin.core.errors import BudgetError, SourceError
from twin.core.findings import Finding, Severity, Verdict, by_severity, finding, verdict
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.quantity import Quantity
from twin.core.result import Part, Result, TextTable

POSITION_TOL = 1e-6
"""Maximum distance in m between the positions of a link in two files that agree."""

ROTATION_TOL = 1e-4
"""Maximum angle in rad between the rotations of a link in two files that agree."""

MECHANISM = "the mechanism"
"""Name of the expected mechanism as a source of values."""

MOST_FINDINGS = 5
"""Maximum number of findings with the same code in one file; the last finding states how many were omitted."""


_CERTIFICATE_CHECKS = ("claim", "bound", "workspace", "protocol")
"""Checks of the certificates of `twin prove`, which are compared with nothing but what they claim."""


@dataclass(frozen=True)
class Check:
    """One measurement.

    Attributes:
        check: short description.
        file: path relative to the audited folder.
        tool, version: name and version of the checker or library that measured the deviation.
        worst: the maximum deviation in `unit`; None if nothing can be measured or, as JSON has no such number, if it is
            infinite or NaN.
        unit: unit of `worst` and `tolerance`.
        tolerance: limit of `worst` in `unit`; None if there is no limit.
        verdict: "agree", "disagree" or "unchecked".
        where: link, or other object, with the deviation `worst`.
        when: time at which the deviation is `worst`.
        against: what the file is compared with: "the mechanism", or the name of a file; "" for a check of one file.
    """

    check: str
    file: str
    tool: str
    version: str
    worst: float | None
    unit: str
    tolerance: float | None
    verdict: Verdict
    where: str = ""
    when: str = ""
    against: str = ""

    def as_dict(self) -> JsonObject:
        """Return the check as plain data for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class AuditReport(Result):
    """The result of `audit`.

    `files` contains the name, format and conventions (units, up axis, handedness, clips) of each file.
    """

    path: str
    files: list[JsonObject]
    checks: list[Check]
    findings: list[Finding]

    kind = "audit"

    def content(self) -> JsonObject:
        """Return the report as plain data for JSON."""
        return {"path": self.path, "files": self.files, "checks": list(map(Check.as_dict, self.checks))}

    @property
    def headline(self) -> str:
        """The verdict in one sentence; it states what could not be checked, and whether anything was compared."""
        if self.verdict == "disagree":
            return "FAIL: files are invalid or inconsistent with each other; see the findings"
        if self.verdict == "unchecked":
            causes = []
            for finding in self.findings:
                if finding.severity == "error":
                    causes.append(finding)
            text = f"UNCHECKED: {causes[0].message}"
            if len(causes) > 1:
                text += f" And {len(causes) - 1} more, see the findings."
            return text
        if any(check.against for check in self.checks):
            return "PASS: all files are valid and consistent with each other"
        names = {check.check for check in self.checks}
        if not names.isdisjoint(_CERTIFICATE_CHECKS):
            return "VALID: what the certificate claims holds wherever it was tried"
        return "VALID: the file is well formed; there is nothing to compare it with"

    def text(self, everything: bool = False) -> Iterator[Part]:
        """Yield the parts of the report: files, the worst check of each kind, all findings except notes.

        If `everything` is True, all checks and all findings are included.
        """
        yield f"{self.path}\n\n  {self.headline}\n"
        if self.files:
            titles = ("file", "units", "up", "handed", "links", "clips")
            yield TextTable(titles, list(map(_row_of_file, self.files)))
            yield ""
        checks = self.checks if everything else worst(self.checks)
        if checks:
            titles = ("check", "worst in", "worst", "tolerance", "where", "when", "")
            yield TextTable(titles, list(map(_row_of_check, checks)))
            yield ""
        shown_count = 0
        for reported in by_severity(self.findings):
            if everything or reported.severity != "info":
                shown_count += 1
                yield reported
        counts = self._counts(len(self.findings) - shown_count)
        if shown_count:
            counts = f"\n{counts}"
        yield counts

    def _counts(self, notes: int) -> str:
        """Return the last line of the text: counts of checks and findings, of which `notes` are not shown."""
        checks = format.count(len(self.checks), "check")
        findings = format.count(len(self.findings), "finding")
        if notes:
            findings += f", of which {format.count(notes, 'note')} (shown by --all)"
        position = f"{POSITION_TOL * 1e6:g} µm"
        rotation = f"{math.degrees(ROTATION_TOL):.3g} deg"
        return f"  {checks}, {findings}; tolerance of poses: {position} and {rotation}"


_MARKS = {"agree": "ok", "disagree": "WRONG", "unchecked": "?"}


def worst(checks: Sequence[Check]) -> list[Check]:
    """Return the worst check of each kind. Checks that differ only in clip, file and counts are of the same kind."""
    kinds: dict[str, Check] = {}
    for check in checks:
        kind = re.sub(r"clip '[^']*': | against [^,]*|, \d.*|\d+", "", check.check)
        first = kinds.setdefault(kind, check)
        if _severity_of_check(check) > _severity_of_check(first):
            kinds[kind] = check
    return list(kinds.values())


def _severity_of_check(check: Check) -> tuple[bool, float]:
    """Return what decides which of two checks of a kind is worse: first the verdict, then the deviation."""
    size = check.worst
    if size is None:
        # A disagreement without a number is infinite, or what should be measured is not there.
        size = math.inf if check.verdict == "disagree" else 0.0
    return check.verdict != "agree", size


def _row_of_file(file: JsonMapping) -> tuple[str, ...]:
    """Return a file's row in the table of files; without marked links, the number of its nodes."""
    links = str(file["links"])
    if file["links"] is None:
        links = f"{file['nodes']} nodes"
    clips = []
    for clip in file["clips"]:
        clips.append(f"{clip['name']} ({clip['keys']} keys, {clip['duration_s']:.3f} s)")
    units = str(file.get("units", ""))
    up = str(file.get("up_axis", ""))
    handedness = str(file.get("handedness", ""))
    return file["file"], units, up, handedness, links, ", ".join(clips) or "-"


def _row_of_check(check: Check) -> tuple[str, ...]:
    """Return a check's row in the table of checks."""
    size = _displayed(check.worst, check.unit)
    if format.is_exact(check.worst, check.unit, check.tolerance):
        size = format.EXACT
    tolerance = _displayed(check.tolerance, check.unit)
    return check.check, check.file, size, tolerance, check.where, check.when, _MARKS[check.verdict]


def _displayed(value: float | None, unit: str) -> str:
    """Return a value with three digits and its unit as a table shows it: angles in degrees, "" for None."""
    if value is None:
        return ""
    if unit == "rad":
        return f"{math.degrees(value):.3g} deg"
    if unit == "1":
        unit = ""
    return quantity(value, unit, 3).strip().replace("um", "µm")


ADVICE: Mapping[str, str] = {
    "audit.no_checks": "audit an export of the same robot in another format with these files, or use --robot NAME",
    "claims.between_position": "measure the error between keys again",
    "claims.between_rotation": "measure the error between keys again",
    "claims.joint_gap": "measure the error between keys again",
    "compare.between": "use LINEAR interpolation between the keys",
    "compare.joint": "write joint values in radians and metres",
    "compare.model_hash": "export all files again, together",
    "compare.pose": "find out which file is wrong: `twin audit --robot NAME` computes the correct poses",
    "compare.shape": "check units, mirroring and the link of each mesh",
    "compare.times": "check the rate, and the units of time",
    "gltf.duplicate_name": "give each node a unique name",
    "gltf.matrix": "write translation, rotation and scale instead of a matrix",
    "gltf.quaternion": "normalise the quaternion; the order of components in glTF is x, y, z, w",
    "gltf.scale": "scale the mesh points instead",
    "index": "number the points from 0 to their count minus 1",
    "mjcf.loop": "check the anchors of the equality constraints, and the zero positions of the joints",
    "name": "use only letters, digits and underscores, which every format allows",
    "normals_against": "reverse the normals or the winding",
    "proof.hash": "export again; the measured values belong to the original file",
    "quaternion": "normalise the quaternion",
    "quaternion_sign": "negate quaternions so that successive quaternions have a positive dot product",
    "step": "write more keys",
    "usd.joint_gap": "check the joint's frames and the poses of its bodies",
    "usdz.alignment": "pad the extra field of the file's zip header",
    "winding": "reverse the faces of the mesh, so that they are counter-clockwise seen from outside",
    "winding_mixed": "orient all faces counter-clockwise seen from outside",
}
"""Suggestion for each finding code. A code without a format, such as "step", applies to all formats ("gltf.step")."""


class ReadError(Exception):
    """A fault that prevents further reading of a file. `code` is the code of the finding; "" means the default code."""

    def __init__(self, message: str, code: str = "") -> None:
        super().__init__(message)
        self.code = code


class Measured(NamedTuple):
    """A measured value and its limit, both in `unit`; None means unknown."""

    value: float | None
    limit: float | None = None
    unit: str = ""


def um(value: float, limit: float | None = None) -> Measured:
    """Convert a length and its limit from m to micrometres."""
    if limit is not None:
        limit *= 1e6
    return Measured(value * 1e6, limit, "um")


@dataclass
class Ledger:
    """Collection of checks and findings on one file, filled while the file is read.

    `file` is the name of the file as shown in reports, relative to the audited folder. `placed` is whether geometry
    of the file (poses of links, positions of joints) has been compared with the mechanism. `code` is the first word of
    the code of the finding that the file cannot be read.
    """

    file: str
    tool: str = "twin.exchange.audit"
    version: str = ""
    code: str = "usd"
    checks: list[Check] = field(default_factory=list)
    found: list[Finding] = field(default_factory=list)
    placed: bool = False
    _count: Counter = field(default_factory=Counter)

    def add(
        self,
        code: str,
        severity: Severity,
        message: str,
        where: str = "",
        *,
        size: Measured | float | None = None,
        when: str = "",
        suggestion: str = "",
    ) -> None:
        """Add a finding, with the file's name before `where`; of each code, only the first `MOST_FINDINGS` are kept."""
        self._count[code] += 1
        if self._count[code] > MOST_FINDINGS:
            return
        place = self.file
        if where and where != self.file:
            place = f"{self.file}: {where}"
        value, limit, unit = size if isinstance(size, Measured) else Measured(size)
        measured = None
        if value is not None and math.isfinite(value):
            measured = Quantity(float(value), unit)
        bound = None
        if limit is not None:
            bound = Quantity(limit, unit)
        # A suggestion of the caller is the most exact one; then that of the code, then that of all formats.
        advice = suggestion or ADVICE.get(code) or ADVICE.get(code.partition(".")[2], "")
        self.found.append(finding(severity, code, place, message, measured, bound, advice, when=when, word=""))

    def wrong(
        self,
        code: str,
        message: str,
        where: str = "",
        *,
        size: Measured | float | None = None,
        when: str = "",
        suggestion: str = "",
    ) -> None:
        """Add a finding of severity "disagreement"; for the arguments see `add`."""
        self.add(code, "disagreement", message, where, size=size, when=when, suggestion=suggestion)

    def row(
        self,
        check: str,
        worst: float | None,
        unit: str = "",
        tolerance: float | None = None,
        *,
        where: str = "",
        when: str = "",
        fits: bool | None = None,
        against: str = "",
    ) -> None:
        """Add a check; its verdict is "agree" or "disagree"; for the arguments see `Check`.

        If `fits` is given, the verdict is "agree" if `fits` is True. Otherwise, the verdict is "agree" if `worst` is at
        most `tolerance`, or if one of these two values is None.
        """
        if fits is None:
            fits = worst is None or tolerance is None or bool(worst <= tolerance)
        number = None  # JSON has no number for an infinite deviation
        if worst is not None and math.isfinite(worst):
            number = float(worst)
        check_verdict: Verdict = "disagree"
        if fits:
            check_verdict = "agree"
        source = (self.file, self.tool, self.version)
        self.checks.append(Check(check, *source, number, unit, tolerance, check_verdict, where, when, against))

    @property
    def findings(self) -> list[Finding]:
        """Return the findings, at most `MOST_FINDINGS` with the same code; the last states how many were omitted."""
        findings = list(self.found)
        for code, count in self._count.items():
            if count > MOST_FINDINGS:
                last = 0
                for i, recorded in enumerate(findings):
                    if recorded.code == code:
                        last = i
                message = f"{findings[last].message} And {count - MOST_FINDINGS} more of this kind."
                findings[last] = replace(findings[last], message=message)
        return findings


_MALFORMED_INPUT_ERRORS = (
    KeyError,
    IndexError,
    TypeError,
    ValueError,
    AttributeError,
    OverflowError,
    RecursionError,
    MemoryError,
)
"""Exceptions that the readers may raise for malformed input."""

Read = TypeVar("Read")


def guarded(read: Callable[[Path, Ledger], Read], path: Path, ledger: Ledger) -> Read | None:
    """Call `read` for a file or folder and return the result; if `read` fails, add a finding and return None."""
    try:
        return read(path, ledger)
    except ReadError as error:
        ledger.add(error.code or f"{ledger.code}.unreadable", "error", f"{error}.")
    except (BudgetError, SourceError) as error:
        ledger.add("file.budget", "error", f"{error}")
    except OSError as error:
        ledger.add("file.unreadable", "error", f"the file cannot be read: {error.strerror or error}.")
    except _MALFORMED_INPUT_ERRORS as error:
        # The message of an exception may quote the whole file.
        text = f"the file is malformed: {type(error).__name__}, {str(error)[:120]}."
        ledger.add("file.malformed", "error", text)
    return None


def finished(path: str, files: list[JsonObject], ledgers: list[Ledger]) -> AuditReport:
    """Return the report with the checks and findings of all ledgers."""
    checks: list[Check] = []
    findings: list[Finding] = []
    for ledger in ledgers:
        checks += ledger.checks
        findings += ledger.findings
    if verdict(findings) == "agree" and not _has_content(files, checks):  # "agree" would be false
        none = Ledger(path)
        none.add("audit.no_checks", "error", "the files have nothing that can be checked.")
        findings += none.findings
    return AuditReport(path, files, checks, by_severity(findings))


def _has_content(files: list[JsonObject], checks: list[Check]) -> bool:
    """Return whether something was checked, and one of the files, if there are any, has links or nodes."""
    if not checks:
        return False
    if not files:
        return True  # a certificate has no links
    return any(file["links"] or file["nodes"] for file in files)


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """Return a value with its unit as text, such as "1.5 mm"; values in m are converted to um, mm or m."""
    if unit == "m" and abs(value) < 1e-3:
        value *= 1e6
        unit = "um"
    elif unit == "m" and abs(value) < 1.0:
        value *= 1e3
        unit = "mm"
    return f"{value:.{digits}g} {unit}"


def distinguishable(a: float, b: float) -> tuple[str, str]:
    """Return two numbers as text with enough digits, at least four, to show that they differ."""
    digits = 4
    while digits < 16 and f"{a:.{digits}g}" == f"{b:.{digits}g}":
        digits += 1
    return f"{a:.{digits}g}", f"{b:.{digits}g}"
