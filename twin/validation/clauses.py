"""The result of judging a console: each clause (one requirement of its contract) with its measured value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.core.findings import Finding, by_severity, disagreement
from twin.core.quantity import Quantity
from twin.core.result import Line, Part, Result, Table

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Clause:
    """One clause (requirement) with its measured value.

    Attributes:
        name: dotted; the code of the finding is "console." + name.
        equation: the equation that is judged: "eq1", ...
        text: the requirement.
        value: measured, in `unit`.
        limit: largest value, in `unit`.
        holds: whether the value keeps the limit.
        said: if it does not hold: what happens instead.
        way: how to correct the equation.
    """

    name: str
    equation: str
    text: str
    value: float
    unit: str
    limit: float
    holds: bool
    said: str
    way: str

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        data = {k: getattr(self, k) for k in ("name", "equation", "text", "value", "unit", "limit")}
        return {**data, "holds": bool(self.holds)}


@dataclass(frozen=True)
class Contract(Result):
    """The result of judging a console.

    Attributes:
        console, title, source: name of the console, its description, source document.
        variants: reading of each equation.
        clauses: the clauses, in the order in which they were measured.
        path: positions (k, 3) in m of the tool while the hand goes round a closed loop.
        findings: one for each clause that does not hold.
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
        """One finding for each clause of the contract that does not hold."""
        return [_finding(c, self.variants) for c in self.clauses if not c.holds]

    def content(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "console": self.console,
            "title": self.title,
            "source": self.source,
            "variants": dict(self.variants),
            "clauses": [c.as_dict() for c in self.clauses],
        }

    def text(self) -> Iterator[Part]:
        """Yield the readings, a row for each clause, the clauses that do not hold, and the verdict."""
        yield f"{self.console}: {self.title}\n  {self.source}\n"
        yield "  " + ", ".join(f"{name}={reading}" for name, reading in self.variants.items()) + "\n"
        rows = [
            (
                "" if c.holds else "✖",
                _printed(c.equation),
                c.text,
                f"{number(c.value)} {c.unit}",
                f"{number(c.limit)} {c.unit}",
            )
            for c in self.clauses
        ]
        yield Table(("", "equation", "clause", "measured", "limit"), rows)
        yield ""
        yield from by_severity(self.findings)
        failed = len(self.findings)
        if failed:
            said = f"DISAGREE: {failed} of {len(self.clauses)} clauses do not hold (exit code {self.exit_code})"
        else:
            said = f"AGREE: all {len(self.clauses)} clauses hold (exit code {self.exit_code})"
        yield Line(f"\n  {said}", "bold")


def _finding(c: Clause, variants: Mapping[str, str]) -> Finding:
    reading = variants.get(c.equation, "")
    cause = f"{c.equation} ({reading})" if reading else c.equation
    size = Quantity(c.value, c.unit)
    place = f"eq. {_printed(c.equation)}"
    return disagreement(f"console.{c.name}", place, c.said, size, c.limit, c.way, cause=cause, word="")


def number(x: float) -> str:
    """Return a number with three decimals, or one digit and its power of ten."""
    return f"{x:.3f}" if 1e-3 <= abs(x) < 1e6 else f"{x:.1e}" if x else "0"


def _printed(equation: str) -> str:
    return f"({equation.removeprefix('eq')})"
