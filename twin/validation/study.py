"""Recompute a published user study from its printed rows: means, p-values, and claims in the text.

If the paper does not name the test of a p-value, all usual tests are computed. The printed p-value agrees if one of
these tests gives the same digits. Claims in the text are compared with the tables where possible.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from twin.core.findings import Finding, disagreement, warning
from twin.core.json_types import JsonObject
from twin.core.quantity import Quantity
from twin.schema import Table, at, load_toml

_P = Annotated[float, Field(ge=0, le=1)]
_MeanStd = tuple[float, Annotated[float, Field(ge=0)]]
_HALF_DIGIT = 0.005
"""Half a unit of the last printed digit, for table cells and p-values."""


class StudyMeasure(Table):
    """One measure: a value of each user in both environments, and the printed means and p-value over all users."""

    name: str
    unit: str
    physical: list[float] = Field(min_length=2)
    simulation: list[float] = Field(min_length=2)
    printed_mean: tuple[float, float]
    printed_p: _P

    @model_validator(mode="after")
    def _paired(self) -> StudyMeasure:
        if len(self.physical) != len(self.simulation):
            raise at(
                "simulation",
                f"{len(self.simulation)} values, but `physical` has {len(self.physical)}; give one per user",
            )
        return self


class Rating(Table):
    """One questionnaire item: mean and standard deviation of the ratings of both environments."""

    name: str
    physical: _MeanStd
    simulation: _MeanStd
    printed_p: _P


class Claim(Table):
    """A claim in the text about the ratings, expressed as a rule."""

    text: str
    holds: Literal["simulation_above_physical", "every_p_below_0.05"]


class Tables(Table):
    """The file of a user study."""

    title: str
    source: str
    users: int = Field(ge=2)
    measure: list[StudyMeasure] = Field(default_factory=list)
    rating: list[Rating] = Field(default_factory=list)
    claim: list[Claim] = Field(default_factory=list)


@dataclass(frozen=True)
class StudyRow:
    """One table row: printed p-value, recomputed p-values by test, and (physical, simulation) means."""

    name: str
    printed_p: float
    tests: dict[str, float]
    means: dict[str, tuple[float, float]]

    def test(self) -> str:
        """Return the test whose p-value is nearest to the printed value; "" if no test agrees within rounding."""
        near = [n for n, p in self.tests.items() if abs(p - self.printed_p) <= 2 * _HALF_DIGIT]
        return min(near, key=lambda n: abs(self.tests[n] - self.printed_p)) if near else ""

    def as_dict(self) -> JsonObject:
        """Return the row as plain data."""
        return {
            "name": self.name,
            "printed_p": self.printed_p,
            "tests": self.tests,
            "means": self.means,
            "reproduced_by": self.test(),
        }


def load(path: Path) -> Tables:
    """Read a study file.

    Raises:
        DescriptionError: the file is invalid; the message has file, line, key, value and the allowed values.
    """
    return load_toml(path, Tables)


def _p_value(result: Any) -> float:
    """Return the p-value of a test's result, whose attributes scipy defines at run time."""
    return float(result.pvalue)


def recompute(tables: Tables) -> tuple[list[StudyRow], list[Finding]]:
    """Return (recomputed rows, findings on the printed values)."""
    from scipy import stats

    rows: list[StudyRow] = []
    found: list[Finding] = []
    for m in tables.measure:
        a, b = np.array(m.physical), np.array(m.simulation)
        tests = {
            "paired t": _p_value(stats.ttest_rel(a, b)),
            "Student t": _p_value(stats.ttest_ind(a, b)),
            "Welch t": _p_value(stats.ttest_ind(a, b, equal_var=False)),
            "Mann-Whitney": _p_value(stats.mannwhitneyu(a, b, method="asymptotic")),
        }
        if (a != b).all():  # the exact test requires differences other than zero
            tests["Wilcoxon"] = _p_value(stats.wilcoxon(a, b, method="exact"))
        means = (float(a.mean()), float(b.mean()))
        row = StudyRow(m.name, m.printed_p, tests, {"printed": m.printed_mean, "of the rows": means})
        rows.append(row)
        for where, printed, mean in zip(("physical", "simulation"), m.printed_mean, means, strict=True):
            if abs(printed - mean) > 2 * _HALF_DIGIT:  # both the cells and their mean are rounded
                found.append(
                    disagreement(
                        "study.mean",
                        m.name,
                        f"{m.name}, {where}: the paper prints a mean of {printed:.2f} {m.unit}; the printed rows "
                        f"of the users give {mean:.2f}; difference",
                        Quantity(abs(printed - mean), m.unit),
                        2 * _HALF_DIGIT,
                        word="rounding",
                    )
                )
        found += _unreproduced(row)
    for r in tables.rating:
        tests = {}
        for reading, inflate in (("population", np.sqrt(tables.users / (tables.users - 1))), ("sample", 1.0)):
            (m1, s1), (m2, s2) = r.physical, r.simulation
            for name, equal in (("Student t", True), ("Welch t", False)):
                value = stats.ttest_ind_from_stats(
                    m1, s1 * inflate, tables.users, m2, s2 * inflate, tables.users, equal_var=equal
                ).pvalue
                tests[f"{name}, +- as {reading} std"] = float(value)
        rows.append(StudyRow(r.name, r.printed_p, tests, {"printed": (r.physical[0], r.simulation[0])}))
        found += _unreproduced(rows[-1])
    for claim in tables.claim:
        found += _claim(claim, tables)
    return rows, found


def _unreproduced(row: StudyRow) -> list[Finding]:
    if row.test():
        return []
    made = ", ".join(f"{n} {p:.3f}" for n, p in row.tests.items())
    return [
        disagreement(
            "study.p",
            row.name,
            f"{row.name}: p = {row.printed_p:.2f} is printed; no test gives this value from the printed rows ({made})",
            Quantity(min(abs(p - row.printed_p) for p in row.tests.values()), "1"),
            2 * _HALF_DIGIT,
            "single trials are not published; a test of the single trials may give the printed value",
            word="",
        )
    ]


def _claim(claim: Claim, tables: Tables) -> list[Finding]:
    if claim.holds == "simulation_above_physical":
        against = [r.name for r in tables.rating if r.simulation[0] <= r.physical[0]]
        text = f"the statement '{claim.text}' is false for {', '.join(against)}"
    else:
        against = [f"{r.name} {r.printed_p:.2f}" for r in tables.rating if r.printed_p >= 0.05]
        text = (
            f"'{claim.text}': these p-values are printed as 0.05 or more ({', '.join(against)}), so the sign should be "
            f">=. With {tables.users} users, such values do not prove equality"
        )
    return [warning("study.claim", "prose", text)] if against else []
