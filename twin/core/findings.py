"""Results of a check: findings with severities, and the verdict computed from them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Literal

from twin.core.format import EXACT, is_exact
from twin.core.json_types import JsonObject
from twin.core.quantity import Quantity

Severity = Literal["info", "warning", "disagreement", "error"]
SEVERITIES: tuple[Severity, ...] = ("info", "warning", "disagreement", "error")

Verdict = Literal["agree", "disagree", "unchecked"]


@dataclass(frozen=True)
class Finding:
    """One result of a check.

    Attributes:
        code: dotted, constant identifier for scripts ("rcm.missed", "cad.meeting", ...).
        severity: "info", "warning", "disagreement" (two values differ) or "error" (the check could not be made).
        message: one sentence with the subject, the value and the limit.
        where: name of the point, joint, loop, prim or file.
        when: pose, phase or time.
        size: the measured value, in `unit`; None if there is none.
        unit: unit of `size` and `limit`: "mm", "um", "deg", "s", ...
        limit: the limit of `size`; None if there is none.
        suggestion: how to fix the fault.
        cause: name of the cause ("eq1 (printed)"), identical in all findings with this cause; "" if unknown.
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

    def as_dict(self) -> JsonObject:
        """Return the finding as plain data for JSON."""
        return asdict(self)


def finding(
    severity: Severity,
    code: str,
    where: str,
    what: str,
    size: Quantity | None = None,
    limit: Quantity | float | None = None,
    suggestion: str = "",
    *,
    when: str = "",
    cause: str = "",
    word: str = "limit",
) -> Finding:
    """Return a finding whose message is "<what>: <size> (limit <limit>)".

    The functions `info`, `warning`, `disagreement` and `error` call this function with their severity. `what` is the
    subject and its fault, without the number. If `limit` is a plain number, its unit is that of `size`. `word` is the
    word before the limit in the message ("required", "CAD"). If `word` is "", the message is `what` alone, and `what`
    must contain all numbers. Without a size, the message is `what` alone too. If `word` is "tolerance", a size within
    the limit that is a rounding error is shown as `EXACT`. For the other arguments see `Finding`.

    Raises:
        ValueError: size and limit have different units.
    """
    if limit is not None and not isinstance(limit, Quantity):
        limit = Quantity(limit, size.unit if size is not None else "")
    if size is not None and limit is not None and size.unit != limit.unit:
        raise ValueError(f"finding {code}: size in {size.unit!r}, limit in {limit.unit!r}; give both in one unit")
    message = what
    if size is not None and word:
        text = str(size)
        # only a tolerance is sure to bound a difference; a small value of another meaning is no rounding error
        if word == "tolerance" and limit is not None and is_exact(size.value, size.unit, limit.value):
            text = EXACT
        message += f": {text}"
        if limit is not None:
            message += f" ({word} {limit})"
    unit = ""
    value = None
    bound = None
    if limit is not None:
        unit = limit.unit
        bound = float(limit.value)
    if size is not None:
        unit = size.unit
        value = float(size.value)
    return Finding(code, severity, message, where, when, value, unit, bound, suggestion, cause)


@dataclass(frozen=True)
class Kind:
    """A kind of finding: the fields that all findings with one code share.

    Call a kind with the other fields to get a finding. If the call has a suggestion, it replaces the suggestion of the
    kind. For the fields see `Finding` and `finding`.
    """

    code: str
    severity: Severity
    suggestion: str = ""
    word: str = "limit"

    def __call__(
        self,
        where: str,
        what: str,
        size: Quantity | None = None,
        limit: Quantity | float | None = None,
        suggestion: str = "",
        *,
        when: str = "",
        cause: str = "",
    ) -> Finding:
        """Return the finding; for the arguments see the function `finding`."""
        way_out = suggestion or self.suggestion
        return finding(
            self.severity, self.code, where, what, size, limit, way_out, when=when, cause=cause, word=self.word
        )


info = partial(finding, "info")
warning = partial(finding, "warning")
disagreement = partial(finding, "disagreement")
error = partial(finding, "error")


def verdict(findings: Iterable[Finding]) -> Verdict:
    """Return "unchecked" if any finding is an error, else "disagree" if any is a disagreement, else "agree"."""
    severities = {finding.severity for finding in findings}
    if "error" in severities:
        return "unchecked"
    if "disagreement" in severities:
        return "disagree"
    return "agree"


EXIT_CODES: dict[Verdict, int] = {"agree": 0, "disagree": 1, "unchecked": 2}
"""Exit code of the command line for each verdict."""


def by_severity(findings: Iterable[Finding]) -> list[Finding]:
    """Return the findings, most severe first; findings of the same severity keep their order."""
    return sorted(findings, key=lambda finding: -SEVERITIES.index(finding.severity))
