"""Result of judging a console: each clause (one requirement) with its measured value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.core.findings import Finding, by_severity, disagreement
from twin.core.json_types import JsonObject
from twin.core.quantity import Quantity
from twin.core.result import Line, Part, Result, Table

Array = NDArray[np.float64]


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
        said: message for a violation of the requirement.
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

    def as_dict(self) -> JsonObject:
        """Return the clause as plain data."""
        data = {k: getattr(self, k) for k in ("name", "equation", "text", "value", "unit", "limit")}
        return {**data, "holds": bool(self.holds)}


@dataclass(frozen=True)
class Contract(Result):
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
        return [_finding(c, self.variants) for c in self.clauses if not c.holds]

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
    """Return a number as text: with three decimals, or in scientific notation if |x| < 0.001 or |x| >= 1e6."""
    return f"{x:.3f}" if 1e-3 <= abs(x) < 1e6 else f"{x:.1e}" if x else "0"


def _printed(equation: str) -> str:
    return f"({equation.removeprefix('eq')})"
