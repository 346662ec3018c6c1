"""Result of judging a console: each clause (one requirement) with its measured value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.core.findings import Finding, by_severity, disagreement
from twin.core.json_types import JsonObject
from twin.core.quantity import Quantity
from twin.core.result import Line, Part, Result, TextTable

Array = NDArray[np.float64]
"""Array of numbers; not that of `core.spatial`, because the judge of a console shares no code with its equations."""


@dataclass(frozen=True)
class Clause:
    """One clause (requirement on the console) with its measured value.

    Attributes:
        name: dotted name; the code of its finding is "console." + name.
        equation: name of the judged equation: "eq1", ...
        text: the requirement.
        value: measured value, in `unit`.
        limit: limit of the value, in `unit`.
        holds: whether the value respects the limit.
        violation: message for a violation of the requirement.
        advice: how to correct the equation.
    """

    name: str
    equation: str
    text: str
    value: float
    unit: str
    limit: float
    holds: bool
    violation: str
    advice: str

    def as_dict(self) -> JsonObject:
        """Return the clause as plain data."""
        return {
            "name": self.name,
            "equation": self.equation,
            "text": self.text,
            "value": self.value,
            "unit": self.unit,
            "limit": self.limit,
            "holds": bool(self.holds),
        }

    def cells(self) -> tuple[str, ...]:
        """Return the cells of the clause's row in a table of text."""
        symbol = ""
        if not self.holds:
            symbol = "✖"
        measured = f"{shown_number(self.value)} {self.unit}"
        limit = f"{shown_number(self.limit)} {self.unit}"
        return symbol, _printed_number(self.equation), self.text, measured, limit


@dataclass(frozen=True)
class ConsoleResult(Result):
    """Result of judging a console.

    Attributes:
        console, title, source: name and title of the console, and its source document.
        variants: variant in use, by name of the equation.
        clauses: the clauses, in the order of measurement.
        path: (k, 3) in m, tool positions in the frame of the robot's base, while the hand moves along a closed path.
        findings: one finding per violated clause.
    """

    console: str
    title: str
    source: str
    variants: Mapping[str, str]
    clauses: Sequence[Clause]
    path: Array

    kind = "console"

    @property
    def findings(self) -> Sequence[Finding]:
        """One finding per violated clause."""
        findings = []
        for clause in self.clauses:
            if not clause.holds:
                findings.append(_finding(clause, self.variants))
        return findings

    def content(self) -> JsonObject:
        """Return the result as plain data, without `path`."""
        return {
            "console": self.console,
            "title": self.title,
            "source": self.source,
            "variants": dict(self.variants),
            "clauses": [c.as_dict() for c in self.clauses],
        }

    def text(self) -> Iterator[Part]:
        """Yield the variants, a row per clause, the violated clauses, and the verdict."""
        yield f"{self.console}: {self.title}\n  {self.source}\n"
        variants = ", ".join(f"{equation}={variant}" for equation, variant in self.variants.items())
        yield f"  {variants}\n"
        yield TextTable(("", "equation", "clause", "measured", "limit"), [clause.cells() for clause in self.clauses])
        yield ""
        yield from by_severity(self.findings)
        count = len(self.clauses)
        failed = len(self.findings)
        if failed:
            line = f"DISAGREE: {failed} of {count} clauses do not hold (exit code {self.exit_code})"
        else:
            line = f"AGREE: all {count} clauses hold (exit code {self.exit_code})"
        yield Line(f"\n  {line}", "bold")


def _finding(clause: Clause, variants: Mapping[str, str]) -> Finding:
    """Return the finding on a violated clause; its cause is the equation, with the variant in use."""
    cause = clause.equation
    variant = variants.get(clause.equation, "")
    if variant:
        cause = f"{clause.equation} ({variant})"
    size = Quantity(clause.value, clause.unit)
    place = f"eq. {_printed_number(clause.equation)}"
    return disagreement(
        f"console.{clause.name}",
        place,
        clause.violation,
        size=size,
        limit=clause.limit,
        suggestion=clause.advice,
        cause=cause,
        word="",
    )


def shown_number(x: float) -> str:
    """Return a number as text: with three decimals, or in scientific notation if |x| < 0.001 or |x| >= 1e6.

    Unlike `core.format`, it rounds to decimals, not to digits, and keeps the unit: measured value and limit of a clause
    stand beside each other.
    """
    if x == 0:
        return "0"
    if 1e-3 <= abs(x) < 1e6:  # three decimals show at least one digit that is not zero
        return f"{x:.3f}"
    return f"{x:.1e}"


def _printed_number(equation: str) -> str:
    """Return the number of an equation as the paper prints it, such as "(2)" for "eq2"."""
    return f"({equation.removeprefix('eq')})"
