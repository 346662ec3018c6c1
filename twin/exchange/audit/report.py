"""What an audit hands back: rows of what was measured, and findings."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import Any

from twin.core.findings import EXIT_CODES, Finding, Severity, Verdict, by_severity, verdict

POSITION_TOL = 1e-6
"""Largest distance in m between two files' poses of one link that still agree."""

ROTATION_TOL = 1e-4
"""Largest angle in rad between them."""

MOST = 5
"""Findings of one code in one file; what is more is counted in the last of them."""


@dataclass(frozen=True)
class Check:
    """One thing that was measured.

    Attributes:
        check: what, in a few words.
        file: relative to what was audited.
        tool, version: what did the reading.
        worst: the largest deviation in `unit`, None if nothing can be measured there.
        tolerance: what it was compared with, in the same unit.
        verdict: agree, disagree, or unchecked.
        where, when: of the worst.
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

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class AuditReport:
    """The result of `audit`.

    Attributes:
        path: what was audited.
        files: for each file its format and the conventions found there (units, up axis, handedness, clips).
        checks: what was measured.
        findings: what is wrong, the gravest first.
    """

    path: str
    files: list[dict[str, Any]]
    checks: list[Check]
    findings: list[Finding]

    @property
    def verdict(self) -> Verdict:
        """agree, disagree, or unchecked if something could not be read."""
        return verdict(self.findings)

    @property
    def exit_code(self) -> int:
        """Exit code of the command line: 0, 1 or 2."""
        return EXIT_CODES[self.verdict]

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for JSON, without numbers that JSON lacks."""
        data = {
            "verdict": self.verdict,
            "path": self.path,
            "files": self.files,
            "checks": [c.as_dict() for c in self.checks],
            "findings": [f.as_dict() for f in self.findings],
        }
        return _plain(data)


@dataclass
class Ledger:
    """Collects rows and findings on one file while it is read.

    Attributes:
        file: shown name, relative to what is audited.
        tool, version: what reads it.
    """

    file: str
    tool: str = "twin.exchange.audit"
    version: str = ""
    checks: list[Check] = field(default_factory=list)
    found: list[Finding] = field(default_factory=list)
    _count: Counter = field(default_factory=Counter)

    def add(
        self,
        code: str,
        severity: Severity,
        message: str,
        *,
        where: str = "",
        when: str = "",
        size: float | None = None,
        unit: str = "",
        limit: float | None = None,
        suggestion: str = "",
    ) -> None:
        """Note a finding; the file's name comes before `where`. Of one code only the first `MOST` are kept."""
        self._count[code] += 1
        if self._count[code] > MOST:
            return
        place = f"{self.file}: {where}" if where and where != self.file else self.file
        size = None if size is None or not math.isfinite(size) else float(size)
        self.found.append(Finding(code, severity, message, place, when, size, unit, limit, suggestion))

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
    ) -> None:
        """Note a measurement; it agrees if it is within its tolerance, unless `fits` says otherwise."""
        if fits is None:
            fits = worst is None or tolerance is None or bool(worst <= tolerance)
        number = None if worst is None or not math.isfinite(worst) else float(worst)
        says: Verdict = "agree" if fits else "disagree"
        self.checks.append(Check(check, self.file, self.tool, self.version, number, unit, tolerance, says, where, when))

    @property
    def findings(self) -> list[Finding]:
        """What was found, with a note where a code was found too often to list."""
        out = list(self.found)
        for code, count in self._count.items():
            if count > MOST:
                last = max(i for i, f in enumerate(out) if f.code == code)
                more = f"{out[last].message} And {count - MOST} more of the kind."
                out[last] = Finding(**{**out[last].as_dict(), "message": more})
        return out


def finished(path: str, files: list[dict[str, Any]], ledgers: list[Ledger]) -> AuditReport:
    """Return the report of all ledgers."""
    found = by_severity(f for ledger in ledgers for f in ledger.findings)
    return AuditReport(path, files, [c for ledger in ledgers for c in ledger.checks], found)


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """Return a length in m, or what else, with a unit that keeps its digits few."""
    if unit == "m" and math.isfinite(value):
        factor, unit = next((f, u) for most, f, u in _LENGTHS if abs(value) < most)
        value *= factor
    return f"{value:.{digits}g} {unit}"


def told_apart(a: float, b: float) -> tuple[str, str]:
    """Return two numbers with as many digits as it takes to see that they differ, four at least."""
    for digits in range(4, 17):
        one, two = f"{a:.{digits}g}", f"{b:.{digits}g}"
        if one != two:
            break
    return one, two


_LENGTHS = ((1e-3, 1e6, "um"), (1.0, 1e3, "mm"), (math.inf, 1.0, "m"))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
