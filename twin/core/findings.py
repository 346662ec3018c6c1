"""What a check has to say: findings, their severities, and the verdict that follows from them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Literal

Severity = Literal["info", "warning", "disagreement", "error"]
SEVERITIES: tuple[Severity, ...] = ("info", "warning", "disagreement", "error")

Verdict = Literal["agree", "disagree", "unchecked"]


@dataclass(frozen=True)
class Finding:
    """One thing that a check found.

    Attributes:
        code: dotted and stable, so that scripts can look for it ("rcm.missed", "cad.meeting", ...).
        severity: "info", "warning", "disagreement" (the two sides differ), "error" (could not check).
        message: one sentence for a person: the thing, the value, the limit.
        where: named point, joint, loop, prim or file.
        when: pose, phase or time.
        size: the number, in `unit`; with `limit` in the same unit.
        unit: "mm", "um", "deg", "s", ...
        limit: what the size was compared with.
        suggestion: the way out.
        cause: what it is put down to, the same text in all findings of one cause ("eq1 (printed)"); "" if it stands
            for itself.
    """

    code: str
    severity: Severity
    message: str
    where: str = ""
    when: str = ""
    size: float | None = None
    unit: str = ""
    limit: float | None = None
    suggestion: str = ""
    cause: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return asdict(self)


def verdict(findings: Iterable[Finding]) -> Verdict:
    """Return "unchecked" if anything could not be checked, else "disagree" if anything differs, else "agree"."""
    severities = {f.severity for f in findings}
    if "error" in severities:
        return "unchecked"
    return "disagree" if "disagreement" in severities else "agree"


EXIT_CODES: dict[Verdict, int] = {"agree": 0, "disagree": 1, "unchecked": 2}
"""Exit code of the command line for each verdict."""


def by_severity(findings: Iterable[Finding]) -> list[Finding]:
    """Return the findings, the gravest first, otherwise in their order."""
    return sorted(findings, key=lambda f: -SEVERITIES.index(f.severity))
