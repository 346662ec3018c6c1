"""The checks and findings on one file, which its readers and the comparisons add to its ledger."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import NamedTuple, TypeVar

from twin.core.errors import BudgetError, SourceError
from twin.core.findings import Finding, Severity, Verdict, finding
from twin.core.json_types import JsonObject
from twin.core.quantity import Quantity
from twin.exchange.audit.advice import ADVICE

MECHANISM = "the mechanism"
"""Name of the expected mechanism as a source of values."""

MOST_FINDINGS = 5
"""Maximum number of findings with the same code in one file; the last finding states how many were omitted."""


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
