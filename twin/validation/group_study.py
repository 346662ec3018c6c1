"""Check the printed numbers of a user study with independent groups (`group_tables`).

Such studies print means and standard deviations, but no values of single users. Therefore p-values of rank tests cannot
be recomputed. The checks answer these questions:

- Can a printed mean be a mean of integers?
- Is a standard deviation possible for the printed range?
- Which definition of the RMSE agrees with its components (`printed_accuracy`)?
- Do the printed p-values remain significant after a correction for the number of tests?
- Do sentences of the text agree with the tables?
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.findings import Finding, disagreement, info, warning
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.quantity import Quantity
from twin.core.result import TextTable
from twin.validation import printed_accuracy
from twin.validation.group_tables import (
    AccuracyChain,
    AngleChain,
    ComparedPair,
    GroupOutcome,
    GroupTables,
    PriceSum,
    PrintedRange,
    RepeatedNumbers,
    StatedMinimum,
    half_digit,
)

_STD_ROUNDING = 0.05
"""Half a unit of the last digit of printed standard deviations, of which ranges are printed with one decimal."""


@dataclass(frozen=True)
class CheckedTables:
    """Result of checking the tables of a study.

    Attributes:
        tables: tables to print.
        data: the same numbers as plain data.
        findings: what cannot be right in the printed numbers.
    """

    tables: Sequence[TextTable]
    data: JsonMapping
    findings: Sequence[Finding]


SimulatedChain = Callable[[AccuracyChain], tuple[JsonMapping, Sequence[float]]]
"""Function that simulates an accuracy test; returns (plain data, standard deviation of the x, y and z error in mm)."""


SimulatedTurns = Callable[[AngleChain], tuple[JsonMapping, Sequence[float]]]
"""The same with rotations; the standard deviation is that of the error about x, y and z in degrees."""


def check_tables(tables: GroupTables, run: SimulatedChain, turn: SimulatedTurns) -> CheckedTables:
    """Check the printed numbers of a user study with groups.

    Args:
        tables: the printed numbers.
        run: simulates the accuracy test with displacements; called only if the study has one.
        turn: simulates the accuracy test with rotations; called only if the study has one.
    """
    users = {group.name: group.users for group in tables.group}
    findings: list[Finding] = []
    for outcome in tables.outcome:
        findings += _check_integer_means(outcome, users)
    findings += _note_unpublished_values(tables)
    findings += _check_multiple_tests(tables)
    for printed_range in tables.range:
        findings += _check_ranges(printed_range, users)
    findings += printed_accuracy.check_rmse(tables.accuracy)
    for claim in tables.claim:
        findings += _check_claim(claim, tables.outcome)
    for twice in tables.twice:
        findings += _check_repeated_numbers(twice)
    comparisons, rows = _comparison_rows(tables, users)
    data: JsonObject = {"comparisons": comparisons, "accuracy": printed_accuracy.errors_as_data(tables.accuracy)}
    text_tables = [TextTable(("", "between", f"printed p ({tables.printed_test})", "Welch t from mean, std, n"), rows)]
    if tables.accuracy:
        text_tables.append(printed_accuracy.error_table(tables.accuracy))
    if tables.chain is not None:
        measured, stds = run(tables.chain)
        data["chain"] = dict(measured)
        text_tables.append(TextTable(("simulated accuracy test", ""), printed_accuracy.measured_rows(measured)))
        printed = tables.accuracy_of(tables.chain)
        findings += printed_accuracy.check_displacements(tables.chain, printed, measured, stds)
    if tables.angle_chain is not None:
        measured, stds = turn(tables.angle_chain)
        data["angle_chain"] = dict(measured)
        text_tables.append(
            TextTable(("simulated accuracy test with rotations", ""), printed_accuracy.measured_rows(measured))
        )
        printed = tables.accuracy_of(tables.angle_chain)
        findings += printed_accuracy.check_rotations(tables.angle_chain, printed, measured, stds)
    for priced in tables.sum:
        findings += _check_price_sum(priced)
    return CheckedTables(text_tables, data, findings)


def _comparison_rows(
    tables: GroupTables, users: Mapping[str, int]
) -> tuple[list[JsonObject], list[tuple[str, str, str, str]]]:
    """Return (plain data, cells of a table) of the comparisons of groups, with the p-value of Welch's t-test."""
    data: list[JsonObject] = []
    rows: list[tuple[str, str, str, str]] = []
    for outcome in tables.outcome:
        for pair in outcome.compared:
            p = _welch_p_value(outcome, pair.between, users)
            between = list(pair.between)
            data.append({"name": outcome.name, "between": between, "printed_p": pair.printed_p, "welch_p": p})
            printed = "not significant"
            if pair.printed_p is not None:
                printed = f"{pair.printed_p:.4f}"
            rows.append((outcome.name, " - ".join(between), printed, f"{p:.4f}"))
    return data, rows


def _welch_p_value(outcome: GroupOutcome, between: tuple[str, str], users: Mapping[str, int]) -> float:
    """Return the p-value of Welch's t-test of two groups, which needs only mean, standard deviation and users."""
    from scipy import stats

    a, b = between
    test = stats.ttest_ind_from_stats(
        outcome.mean[a],
        outcome.std[a],
        users[a],
        outcome.mean[b],
        outcome.std[b],
        users[b],
        equal_var=False,
    )
    return float(test.pvalue)


def _check_integer_means(outcome: GroupOutcome, users: Mapping[str, int]) -> Iterator[Finding]:
    """Yield a finding for each printed mean that is not the rounded mean of any set of integers."""
    if not outcome.items:
        return
    rounding = half_digit(outcome.decimals) * (1 + 1e-9)  # with a margin for means exactly between two printed numbers
    for group, mean in outcome.mean.items():
        count = users[group] * outcome.items
        total = round(mean * count)
        # the rounded total is not always the nearest one in floating point
        nearest = min((total - 1, total, total + 1), key=lambda candidate: abs(candidate / count - mean))
        distance = abs(nearest / count - mean)
        if distance <= rounding:
            continue
        yield disagreement(
            "study.integers",
            outcome.name,
            f"{outcome.name}, {group}: the printed mean {mean:.{outcome.decimals}f} {outcome.unit} is not the mean of "
            f"any {count} integers from {users[group]} users; the nearest possible mean is "
            f"{nearest / count:.{outcome.decimals + 1}f}",
            size=Quantity(distance, outcome.unit),
            limit=rounding,
            suggestion="check how many users were counted",
            word="",
        )


def _comparisons_of_groups(tables: GroupTables) -> list[tuple[str, ComparedPair]]:
    """Return (name of the outcome, pair) of each comparison of two groups."""
    comparisons: list[tuple[str, ComparedPair]] = []
    for outcome in tables.outcome:
        for pair in outcome.compared:
            comparisons.append((outcome.name, pair))
    return comparisons


def _note_unpublished_values(tables: GroupTables) -> Iterator[Finding]:
    """Yield a note if p-values are printed: they are from a rank test, which needs the data of every user."""
    count = 0
    for _, pair in _comparisons_of_groups(tables):
        if pair.printed_p is not None:
            count += 1
    if count:
        yield info(
            "study.raw",
            "p",
            f"{count} printed p-values are from {tables.printed_test}, which needs the rank of every user; "
            "they cannot be recomputed from means and standard deviations",
            suggestion="ask the authors for the raw data and run: twin study FILE.csv",
        )


def _check_multiple_tests(tables: GroupTables) -> Iterator[Finding]:
    """Yield a finding if a printed p-value is not significant after Holm's correction."""
    comparisons = _comparisons_of_groups(tables)
    printed: list[tuple[float, str, tuple[str, str]]] = []
    for name, pair in comparisons:
        if pair.printed_p is not None:
            printed.append((pair.printed_p, name, pair.between))
    printed.sort()
    level = tables.significance
    # Holm's step-down test: the first p-value above level / (number of remaining comparisons) ends it
    significant_count = 0
    while (
        significant_count < len(printed)
        and printed[significant_count][0] * (len(comparisons) - significant_count) <= level
    ):
        significant_count += 1
    if significant_count == len(printed):
        return
    p, name, between = printed[significant_count]
    corrected = min(1.0, p * (len(comparisons) - significant_count))
    yield warning(
        "study.multiple",
        "p",
        f"{len(comparisons)} comparisons use p < {level:g} without correction: {significant_count} of "
        f"{len(printed)} significant results remain significant after Holm's correction "
        f"({name}, {' - '.join(between)}: p = {p:g} becomes {corrected:.3f})",
        size=Quantity(corrected, "1"),
        limit=level,
        suggestion="correct for the number of comparisons, or state one primary comparison in advance",
        word="",
    )


def _check_ranges(printed: PrintedRange, users: Mapping[str, int]) -> Iterator[Finding]:
    """Yield a finding for each standard deviation below the minimum that is possible for the printed range and mean."""
    for group, n in users.items():
        mean = printed.mean[group]
        low = printed.lower[group]
        high = printed.upper[group]
        smallest = smallest_std(mean, low, high, n)
        if printed.std[group] + _STD_ROUNDING < smallest:
            yield disagreement(
                "study.range",
                printed.name,
                f"{printed.name}, {group}: {mean:g} +- {printed.std[group]:g} {printed.unit} is printed with the "
                f"range {low:g} to {high:g}; {n} users with this mean and this range have a standard deviation of at "
                f"least {smallest:.1f} {printed.unit}",
                size=Quantity(smallest, printed.unit),
                limit=printed.std[group],
                suggestion="check whether the range belongs to another group or to all users",
                word="",
            )
    # equal ranges of several groups are possible but unlikely: the range is probably that of all users
    ranges = {(printed.lower[group], printed.upper[group]) for group in users}
    if len(ranges) == 1 and len(users) > 1:
        low, high = next(iter(ranges))
        yield warning(
            "study.range_repeated",
            printed.name,
            f"{printed.name}: the same range, {low:g} to {high:g} {printed.unit}, is printed for all "
            f"{len(users)} groups",
            suggestion="state the range of each group",
        )


def smallest_std(mean: float, low: float, high: float, n: int) -> float:
    """Return the minimum standard deviation (divisor n) of n values with this mean that include `low` and `high`."""
    if n == 2:
        return float(np.std([low, high]))
    # it is smallest if the other n - 2 values are equal
    equal_value = (n * mean - low - high) / (n - 2)
    variance = ((low - mean) ** 2 + (high - mean) ** 2 + (n - 2) * (equal_value - mean) ** 2) / n
    return float(np.sqrt(variance))


def _check_claim(claim: StatedMinimum, outcomes: Sequence[GroupOutcome]) -> Iterator[Finding]:
    """Yield a finding if a mean is not above the number that a sentence of the paper states."""
    exceptions: list[str] = []
    means: list[float] = []
    units: list[str] = []
    for outcome in outcomes:
        if outcome.name not in claim.outcomes:
            continue
        for group, mean in outcome.mean.items():
            if mean <= claim.above:
                exceptions.append(f"{group} {outcome.name} {mean:.{outcome.decimals}f}")
                means.append(mean)
                units.append(outcome.unit)
    if exceptions:
        yield warning(
            "study.claim",
            "prose",
            f"the statement '{claim.text}' is false for {', '.join(exceptions)}",
            size=Quantity(min(means), units[0]),
            limit=claim.above,
            suggestion="name the exceptions",
            word="",
        )


def _check_repeated_numbers(repeated: RepeatedNumbers) -> Iterator[Finding]:
    """Yield a finding if numbers that the paper prints in several places differ between these places."""
    differing = [values for values in repeated.values if values != repeated.values[0]]
    if not differing:
        return
    places: list[str] = []
    for where, values in zip(repeated.where, repeated.values, strict=True):
        numbers = " to ".join(f"{value:+g}" for value in values)
        places.append(f"{where}: {numbers}")
    yield disagreement(
        "study.twice",
        repeated.name,
        f"{repeated.name} is printed with several values ({'; '.join(places)})",
        suggestion="correct the wrong values",
    )


def _check_price_sum(price_sum: PriceSum) -> Iterator[Finding]:
    """Yield a finding on a printed sum of prices: each price once, or as often as pieces are needed."""
    rounding = price_sum.rounded_to / 2
    prices: list[float] = []
    prices_of_pieces: list[float] = []
    several: list[str] = []
    for part in price_sum.part:
        prices.append(part.price)
        prices_of_pieces.append(part.price * part.pieces)
        if part.pieces > 1:
            several.append(f"{part.pieces} × {part.name}")
    # exactly rounded: a printed sum may be just within its rounding
    sum_of_prices = math.fsum(prices)
    needed = math.fsum(prices_of_pieces)
    if abs(price_sum.printed - needed) <= rounding:
        return
    text = f"the printed prices have the sum {sum_of_prices:,.0f} {price_sum.unit} if each is counted once"
    if several:
        text += f", and {needed:,.0f} {price_sum.unit} with {' and '.join(several)}"
    if abs(price_sum.printed - sum_of_prices) <= rounding:
        yield warning(
            "study.sum",
            price_sum.name,
            f"{text}; the paper prints {price_sum.printed:,.0f} {price_sum.unit}, right only if the prices are those "
            "of all pieces",
            size=Quantity(needed, price_sum.unit),
            limit=price_sum.printed,
            suggestion="state whether the prices are for one piece or for all",
            word="printed",
        )
        return
    yield disagreement(
        "study.sum",
        price_sum.name,
        f"{text}; printed",
        size=Quantity(price_sum.printed, price_sum.unit),
        limit=needed,
        suggestion="correct the prices or their sum",
        word="sum",
    )
