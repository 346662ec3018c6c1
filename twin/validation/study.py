"""Recompute a published user study from its printed rows: means, p-values, and claims in the text.

If the paper does not name the test of a p-value, all usual tests are computed. The printed p-value agrees if one of
these tests gives it within the rounding of p and of the printed cells. Claims in the text are compared with the tables
where possible.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from twin.core.findings import Finding, disagreement, warning
from twin.core.json_types import JsonObject
from twin.core.quantity import Quantity
from twin.core.spatial import Array
from twin.schema import Table, at, load_toml

_PValue = Annotated[float, Field(ge=0, le=1)]
_MeanStd = tuple[float, Annotated[float, Field(ge=0)]]
_SIGNIFICANCE = 0.05
"""Level of significance of the claim "every_p_below_0.05"."""

_HALF_DIGIT = 0.005
"""Half a unit of the last printed digit, for table cells and p-values."""


_RANK_TESTS = ("Mann-Whitney", "Mann-Whitney, exact", "Wilcoxon", "Wilcoxon, asymptotic")
"""Tests of ranks: rounding moves their p-values only if it changes the order, and printed order counts as right."""


class StudyMeasure(Table):
    """One measure: a value of each user in both environments, and the printed means and p-value over all users."""

    name: str
    unit: str
    physical: list[float] = Field(min_length=2)
    simulation: list[float] = Field(min_length=2)
    printed_mean: tuple[float, float]
    printed_p: _PValue

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
    printed_p: _PValue


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
    """One table row: printed and recomputed p-values, and means.

    Attributes:
        name: name of the row.
        printed_p: the printed p-value.
        tests: {test: p-value recomputed from the printed cells}.
        reach: {test: how far the rounding of the printed cells can move its p-value}.
        means: {source: (physical, simulation)}.
    """

    name: str
    printed_p: float
    tests: dict[str, float]
    reach: dict[str, float]
    means: dict[str, tuple[float, float]]

    def limit(self, test: str) -> float:
        """Return how far the p-value of a test may be from the printed one: p and the cells are rounded."""
        return _HALF_DIGIT + self.reach[test]

    def test(self) -> str:
        """Return the test whose p-value is nearest to the printed value; "" if no test agrees within rounding."""
        nearest = ""
        smallest = np.inf
        for name, p in self.tests.items():
            difference = abs(p - self.printed_p)
            if difference <= self.limit(name) and difference < smallest:
                nearest = name
                smallest = difference
        return nearest

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


def _p_value(result: object) -> float:
    """Return the p-value of a test's result, whose attributes scipy defines at run time."""
    p = float(getattr(result, "pvalue"))  # noqa: B009
    if np.isnan(p):  # 0 / 0: equal means without any deviation; nothing speaks against equal groups
        return 1.0
    return p


def recompute(tables: Tables) -> tuple[list[StudyRow], list[Finding]]:
    """Return (recomputed rows, findings on the printed values)."""
    rows: list[StudyRow] = []
    findings: list[Finding] = []
    for measure in tables.measure:
        row = _measure_row(measure)
        rows.append(row)
        findings += _findings_on_means(measure, row)
        findings += _findings_on_p_value(row)
    for rating in tables.rating:
        row = _rating_row(rating, tables.users)
        rows.append(row)
        findings += _findings_on_p_value(row)
    for claim in tables.claim:
        findings += _findings_on_claim(claim, tables)
    return rows, findings


def _measure_row(measure: StudyMeasure) -> StudyRow:
    """Return the row of a measure, recomputed from the values of the users."""
    physical = np.array(measure.physical)
    simulation = np.array(measure.simulation)
    users = len(physical)
    tests, reach = _p_values_with_reach(
        lambda cells: _p_values_of_users(cells[:users], cells[users:]), np.append(physical, simulation)
    )
    means = (float(physical.mean()), float(simulation.mean()))
    return StudyRow(
        measure.name,
        measure.printed_p,
        tests=tests,
        reach=reach,
        means={"printed": measure.printed_mean, "of the rows": means},
    )


def _p_values_with_reach(
    compute: Callable[[Array], dict[str, float]], cells: Array
) -> tuple[dict[str, float], dict[str, float]]:
    """Return (p-values of the tests, how far each can move if every cell (n,) is off by half of its last digit)."""
    tests = compute(cells)
    reach = dict.fromkeys(tests, 0.0)
    for i in range(len(cells)):
        step = np.zeros(len(cells))
        step[i] = _HALF_DIGIT
        above = compute(cells + step)
        below = compute(cells - step)
        for test, p in tests.items():
            if test in _RANK_TESTS:
                continue
            reach[test] += max(abs(above.get(test, p) - p), abs(below.get(test, p) - p))
    return tests, reach


def _p_values_of_users(physical: Array, simulation: Array) -> dict[str, float]:
    """Return {test: p-value} for the values (users,) with the robot and with the simulation."""
    from scipy import stats

    tests = {
        "paired t": _p_value(stats.ttest_rel(physical, simulation)),
        "Student t": _p_value(stats.ttest_ind(physical, simulation)),
        "Welch t": _p_value(stats.ttest_ind(physical, simulation, equal_var=False)),
        "Mann-Whitney": _p_value(stats.mannwhitneyu(physical, simulation, method="asymptotic")),
    }
    if len(np.unique(np.append(physical, simulation))) == 2 * len(physical):  # the exact test requires distinct values
        tests["Mann-Whitney, exact"] = _p_value(stats.mannwhitneyu(physical, simulation, method="exact"))
    differing = physical != simulation
    if differing.all():  # the exact test requires differences other than zero
        tests["Wilcoxon"] = _p_value(stats.wilcoxon(physical, simulation, method="exact"))
    if differing.any():
        tests["Wilcoxon, asymptotic"] = _p_value(stats.wilcoxon(physical, simulation, method="asymptotic"))
    return tests


def _findings_on_means(measure: StudyMeasure, row: StudyRow) -> list[Finding]:
    """Return a finding for each printed mean that is not the mean of the printed rows."""
    findings: list[Finding] = []
    means = row.means["of the rows"]
    for where, printed, mean in zip(("physical", "simulation"), measure.printed_mean, means, strict=True):
        difference = abs(printed - mean)
        if difference > 2 * _HALF_DIGIT:  # both the cells and their mean are rounded
            findings.append(
                disagreement(
                    "study.mean",
                    measure.name,
                    f"{measure.name}, {where}: the paper prints a mean of {printed:.2f} {measure.unit}; the printed "
                    f"rows of the users give {mean:.2f}; difference",
                    size=Quantity(difference, measure.unit),
                    limit=2 * _HALF_DIGIT,
                    word="rounding",
                )
            )
    return findings


def _rating_row(rating: Rating, users: int) -> StudyRow:
    """Return the row of a rating, recomputed from its printed means and standard deviations."""
    mean_1, std_1 = rating.physical
    mean_2, std_2 = rating.simulation
    cells = np.array([mean_1, std_1, mean_2, std_2])
    tests, reach = _p_values_with_reach(lambda cells: _p_values_of_ratings(cells, users), cells)
    return StudyRow(rating.name, rating.printed_p, tests=tests, reach=reach, means={"printed": (mean_1, mean_2)})


def _p_values_of_ratings(cells: Array, users: int) -> dict[str, float]:
    """Return {test: p-value} for cells (4,): mean and deviation with the robot, and those with the simulation."""
    from scipy import stats

    mean_1, std_1, mean_2, std_2 = (float(cell) for cell in cells)
    # a cell below its rounding would be negative
    std_1 = max(std_1, 0.0)
    std_2 = max(std_2, 0.0)
    tests: dict[str, float] = {}
    # the printed standard deviation may have the divisor n (population) or n - 1 (sample)
    for reading, factor in (("population", np.sqrt(users / (users - 1))), ("sample", 1.0)):
        for name, equal in (("Student t", True), ("Welch t", False)):
            result = stats.ttest_ind_from_stats(
                mean_1, std_1 * factor, users, mean_2, std_2 * factor, users, equal_var=equal
            )
            tests[f"{name}, +- as {reading} std"] = _p_value(result)
    return tests


def _findings_on_p_value(row: StudyRow) -> list[Finding]:
    """Return a finding if no test gives the printed p-value of a row."""
    if row.test():
        return []
    recomputed = [f"{test} {p:.3f}" for test, p in row.tests.items()]
    # nearest by its own limit: tests differ in how far the rounding can move them
    nearest = min(row.tests, key=lambda test: abs(row.tests[test] - row.printed_p) - row.limit(test))
    return [
        disagreement(
            "study.p",
            row.name,
            f"{row.name}: p = {row.printed_p:.2f} is printed; no test gives this value from the printed rows "
            f"({', '.join(recomputed)})",
            size=Quantity(abs(row.tests[nearest] - row.printed_p), "1"),
            limit=row.limit(nearest),
            suggestion="single trials are not published; a test of the single trials may give the printed value",
            word="",
        )
    ]


def _findings_on_claim(claim: Claim, tables: Tables) -> list[Finding]:
    """Return a warning if the printed numbers contradict a claim of the text."""
    exceptions: list[str] = []
    if claim.holds == "simulation_above_physical":
        for rating in tables.rating:
            if rating.simulation[0] <= rating.physical[0]:
                exceptions.append(rating.name)
        text = f"the statement '{claim.text}' is false for {', '.join(exceptions)}"
    else:
        for rating in tables.rating:
            if rating.printed_p >= _SIGNIFICANCE:
                exceptions.append(f"{rating.name} {rating.printed_p:.2f}")
        text = (
            f"'{claim.text}': these p-values are printed as 0.05 or more ({', '.join(exceptions)}), so the sign should "
            f"be >=. With {tables.users} users, such values do not prove equality"
        )
    if not exceptions:
        return []
    return [warning("study.claim", "prose", text)]
