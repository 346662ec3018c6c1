"""Check the printed numbers of a user study with independent groups.

Such studies print means and standard deviations, but no values of single users. Therefore p-values of rank tests cannot
be recomputed. The checks answer these questions:

- Can a printed mean be a mean of integers?
- Is a standard deviation possible for the printed range?
- Which definition of the RMSE agrees with its components?
- Do the printed p-values remain significant after a correction for the number of tests?
- Do sentences of the text agree with the tables?
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from twin.core.findings import Finding, disagreement, info, warning
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.quantity import Quantity
from twin.core.result import TextTable
from twin.core.spatial import Array
from twin.schema import Table, Vector, at, load_toml

_LARGEST = 1e12  # of the numbers of a table; their squares and rounded multiples must not overflow
_ByGroup = dict[str, Annotated[float, Field(ge=-_LARGEST, le=_LARGEST)]]
_Std = Annotated[float, Field(ge=0, le=_LARGEST)]
_StdByGroup = dict[str, _Std]


class Group(Table):
    """A group of users, with its name and the number of users."""

    name: str
    users: int = Field(ge=2)


class ComparedPair(Table):
    """Two compared groups and the printed p-value (None if the paper only states "not significant")."""

    between: tuple[str, str]
    printed_p: Annotated[float, Field(ge=0, le=1)] | None = None


class GroupOutcome(Table):
    """Printed mean and standard deviation of one measure, per group.

    The value of a user is the mean of `items` integers; `items` is 0 if values do not come from integers.
    """

    name: str
    unit: str
    decimals: int = Field(ge=0, le=9)
    items: int = Field(default=0, ge=0)
    mean: _ByGroup
    std: _StdByGroup
    compared: list[ComparedPair] = Field(default_factory=list)


class PrintedRange(Table):
    """Printed mean and standard deviation of one measure per group, and its printed range (minimum, maximum)."""

    name: str
    unit: str
    mean: _ByGroup
    std: _StdByGroup
    lower: _ByGroup
    upper: _ByGroup


class Accuracy(Table):
    """Printed mean and standard deviation of the error along x, y, z, and the printed RMSE, in `unit`."""

    name: str
    unit: str
    mean: Vector
    std: tuple[_Std, _Std, _Std]
    rmse: float = Field(ge=0)
    decimals: int = Field(ge=0, le=9)


class AccuracyChain(Table):
    """Accuracy test of the paper's console.

    `displacements` is the number of displacements per axis, `resolution_mm` is the resolution of the haptic pen,
    `required_mm` is the largest accepted error, and `of` names the [[accuracy]] section with the printed results.
    """

    displacements: int = Field(ge=2)
    resolution_mm: float = Field(gt=0)
    required_mm: float = Field(gt=0)
    of: str


class AngleChain(Table):
    """Accuracy test of the paper's console with rotations.

    `rotations` is the number of rotations about each axis, `resolution_deg` is the resolution of the pen's gimbal,
    `provenance` and `note` say where it is from, and `of` names the [[accuracy]] section with the printed results.
    """

    rotations: int = Field(ge=2)
    resolution_deg: float = Field(gt=0, le=10)
    provenance: str
    note: str
    of: str


class Priced(Table):
    """A part with its printed price, and the number of pieces that the text requires."""

    name: str
    price: float = Field(ge=0, le=_LARGEST)
    pieces: int = Field(ge=1)


class PriceSum(Table):
    """A printed sum of prices; `unit` is the currency, and the sum is rounded to a multiple of `rounded_to`."""

    name: str
    unit: str
    printed: float = Field(ge=0, le=_LARGEST)
    rounded_to: float = Field(gt=0, le=_LARGEST)
    part: list[Priced] = Field(min_length=1)


class Above(Table):
    """A sentence of the paper with the claim that the means of the listed outcomes are above a number."""

    text: str
    outcomes: list[str]
    above: float


class Twice(Table):
    """Numbers that the paper prints in several places: one list of values for each place. The lists must be equal."""

    name: str
    where: list[str]
    values: list[list[float]]


class GroupTables(Table):
    """The file of a user study with independent groups."""

    title: str
    source: str
    significance: float = Field(default=0.05, gt=0, lt=1)
    printed_test: str
    group: list[Group] = Field(min_length=1)
    outcome: list[GroupOutcome] = Field(default_factory=list)
    range: list[PrintedRange] = Field(default_factory=list)
    accuracy: list[Accuracy] = Field(default_factory=list)
    chain: AccuracyChain | None = None
    angle_chain: AngleChain | None = None
    sum: list[PriceSum] = Field(default_factory=list)
    claim: list[Above] = Field(default_factory=list)
    twice: list[Twice] = Field(default_factory=list)

    @model_validator(mode="after")
    def _named(self) -> GroupTables:
        groups = {group.name for group in self.group}
        for i, outcome in enumerate(self.outcome):
            _require_groups(("outcome", i, "mean"), outcome.mean, groups)
            _require_groups(("outcome", i, "std"), outcome.std, groups)
        for i, printed in enumerate(self.range):
            _require_groups(("range", i, "mean"), printed.mean, groups)
            _require_groups(("range", i, "std"), printed.std, groups)
            _require_groups(("range", i, "lower"), printed.lower, groups)
            _require_groups(("range", i, "upper"), printed.upper, groups)
        for i, printed in enumerate(self.range):
            for group, lower in printed.lower.items():
                if lower > printed.upper[group]:
                    raise at(("range", i, "upper"), f"{group}: the range ends below its beginning")
        for i, twice in enumerate(self.twice):
            places = len(twice.where)
            lists = len(twice.values)
            if places != lists:
                plural = "s" if places > 1 else ""
                text = f"give one list of values for each place: {places} place{plural}, {lists} lists"
                raise at(("twice", i, "values"), text)
        for i, outcome in enumerate(self.outcome):
            for j, pair in enumerate(outcome.compared):
                if not set(pair.between) <= groups:
                    text = f"give the names of two groups; the groups are {', '.join(sorted(groups))}"
                    raise at(("outcome", i, "compared", j, "between"), text)
        self._check_outcomes_of_claims()
        self._check_accuracy_of_chain()
        return self

    def _check_outcomes_of_claims(self) -> None:
        outcomes = {outcome.name for outcome in self.outcome}
        for i, claim in enumerate(self.claim):
            unknown = set(claim.outcomes) - outcomes
            if unknown:
                listed = ", ".join(sorted(outcomes))
                text = f"there is no outcome '{min(unknown)}'; the outcomes are {listed}"
                raise at(("claim", i, "outcomes"), text)

    def _check_accuracy_of_chain(self) -> None:
        printed = [accuracy.name for accuracy in self.accuracy]
        for key, chain in (("chain", self.chain), ("angle_chain", self.angle_chain)):
            if chain is not None and chain.of not in printed:
                listed = ", ".join(printed) or "none"
                text = f"no [[accuracy]] section has the name '{chain.of}'; the names are {listed}"
                raise at((key, "of"), text)


def _require_groups(place: tuple[str | int, ...], numbers: Mapping[str, float], groups: set[str]) -> None:
    """Raise an error at a place of the file unless it has one number for each group."""
    if set(numbers) != groups:
        raise at(place, f"give one number for each group: {', '.join(sorted(groups))}")


@dataclass(frozen=True)
class Recomputed:
    """Result of checking a file: tables to print, plain data, findings."""

    tables: Sequence[TextTable]
    data: JsonMapping
    findings: Sequence[Finding]


SimulatedChain = Callable[[AccuracyChain], tuple[JsonMapping, Sequence[float]]]
"""Function that simulates an accuracy test; returns (plain data, standard deviation of the x, y and z error in mm)."""


def load(path: Path) -> GroupTables:
    """Read the file of a user study with groups.

    Raises:
        DescriptionError: the file is invalid; the message has file, line, key, value and the allowed values.
    """
    return load_toml(path, GroupTables)


SimulatedTurns = Callable[[AngleChain], tuple[JsonMapping, Sequence[float]]]
"""The same with rotations; the standard deviation is that of the error about x, y and z in degrees."""


def recompute(tables: GroupTables, run: SimulatedChain, turn: SimulatedTurns) -> Recomputed:
    """Check the printed numbers of a user study with groups; return tables, data and findings."""
    users = {group.name: group.users for group in tables.group}
    findings: list[Finding] = []
    for outcome in tables.outcome:
        findings += _integers(outcome, users)
    findings += _unpublished(tables)
    findings += _corrected(tables)
    for printed_range in tables.range:
        findings += _spans(printed_range, users)
    findings += _rmse(tables.accuracy)
    for claim in tables.claim:
        findings += _claim(claim, tables.outcome)
    for twice in tables.twice:
        findings += _twice(twice)
    comparisons, rows = _comparisons(tables, users)
    data: JsonObject = {"comparisons": comparisons, "accuracy": _errors(tables.accuracy)}
    shown = [TextTable(("", "between", f"printed p ({tables.printed_test})", "Welch t from mean, std, n"), rows)]
    if tables.accuracy:
        shown.append(_shown_errors(tables.accuracy))
    if tables.chain is not None:
        measured, stds = run(tables.chain)
        data["chain"] = dict(measured)
        shown.append(TextTable(("simulated accuracy test", ""), _measured_rows(measured)))
        printed = next(a for a in tables.accuracy if a.name == tables.chain.of)
        findings += _chain(tables.chain, printed, measured, stds)
    if tables.angle_chain is not None:
        measured, stds = turn(tables.angle_chain)
        data["angle_chain"] = dict(measured)
        shown.append(TextTable(("simulated accuracy test with rotations", ""), _measured_rows(measured)))
        printed = next(a for a in tables.accuracy if a.name == tables.angle_chain.of)
        findings += _angles(tables.angle_chain, printed, measured, stds)
    for priced in tables.sum:
        findings += _sum(priced)
    return Recomputed(shown, data, findings)


def _comparisons(
    tables: GroupTables, users: Mapping[str, int]
) -> tuple[list[JsonObject], list[tuple[str, str, str, str]]]:
    """Return (plain data, cells of a table) of the comparisons of groups, with the p-value of Welch's t-test."""
    data: list[JsonObject] = []
    rows: list[tuple[str, str, str, str]] = []
    for outcome in tables.outcome:
        for pair in outcome.compared:
            p = _welch(outcome, pair.between, users)
            between = list(pair.between)
            data.append({"name": outcome.name, "between": between, "printed_p": pair.printed_p, "welch_p": p})
            printed = "not significant"
            if pair.printed_p is not None:
                printed = f"{pair.printed_p:.4f}"
            rows.append((outcome.name, " - ".join(between), printed, f"{p:.4f}"))
    return data, rows


def _errors(rows: Sequence[Accuracy]) -> list[JsonObject]:
    """Return the plain data of the printed errors, with the RMSE by each definition."""
    data: list[JsonObject] = []
    for accuracy in rows:
        readings = {}
        for name, span in rms_readings(accuracy).items():
            readings[name] = list(span)
        data.append({"name": accuracy.name, "printed_rmse": accuracy.rmse, "readings": readings})
    return data


def _measured_rows(measured: JsonMapping) -> list[tuple[str, str]]:
    """Return a row for each number of the simulated test; vectors have a row for each axis."""
    rows: list[tuple[str, str]] = []
    for name, value in measured.items():
        if not isinstance(value, list):
            rows.append((name, f"{value:.3g}"))
        elif len(value) == 1:
            rows.append((name, f"{value[0]:.3g}"))
        else:
            for axis, component in zip("xyz", value, strict=False):
                rows.append((f"{name} {axis}", f"{component:.3g}"))
    return rows


def _welch(outcome: GroupOutcome, between: tuple[str, str], users: Mapping[str, int]) -> float:
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


def _half(decimals: int) -> float:
    """Return half a unit of the last printed digit: how far a rounded number may be from the exact one."""
    return 0.5 * 10**-decimals


def _integers(outcome: GroupOutcome, users: Mapping[str, int]) -> Iterator[Finding]:
    """Yield a finding for each printed mean that is not the rounded mean of any set of integers."""
    if not outcome.items:
        return
    rounding = _half(outcome.decimals) * (1 + 1e-9)  # with a margin for means exactly between two printed numbers
    for group, mean in outcome.mean.items():
        n = users[group] * outcome.items
        total = round(mean * n)
        nearest = min((total - 1, total, total + 1), key=lambda candidate: abs(candidate / n - mean))
        distance = abs(nearest / n - mean)
        if distance <= rounding:
            continue
        yield disagreement(
            "study.integers",
            outcome.name,
            f"{outcome.name}, {group}: the printed mean {mean:.{outcome.decimals}f} {outcome.unit} is not the mean of "
            f"any {n} integers from {users[group]} users; the nearest possible mean is "
            f"{nearest / n:.{outcome.decimals + 1}f}",
            Quantity(distance, outcome.unit),
            rounding,
            "check how many users were counted",
            word="",
        )


def _compared(tables: GroupTables) -> list[tuple[str, ComparedPair]]:
    """Return (name of the outcome, pair) of each comparison of two groups."""
    comparisons: list[tuple[str, ComparedPair]] = []
    for outcome in tables.outcome:
        for pair in outcome.compared:
            comparisons.append((outcome.name, pair))
    return comparisons


def _unpublished(tables: GroupTables) -> Iterator[Finding]:
    printed = 0
    for _, pair in _compared(tables):
        printed += pair.printed_p is not None
    if printed:
        yield info(
            "study.raw",
            "p",
            f"{printed} printed p-values are from {tables.printed_test}, which needs the rank of every user; "
            "they cannot be recomputed from means and standard deviations",
            suggestion="ask the authors for the raw data and run: twin study FILE.csv",
        )


def _corrected(tables: GroupTables) -> Iterator[Finding]:
    """Yield a finding if a printed p-value is not significant after Holm's correction."""
    comparisons = _compared(tables)
    printed: list[tuple[float, str, tuple[str, str]]] = []
    for name, pair in comparisons:
        if pair.printed_p is not None:
            printed.append((pair.printed_p, name, pair.between))
    printed.sort()
    level = tables.significance
    # Holm's step-down test: the first p-value above level / (number of remaining comparisons) ends it
    kept = 0
    while kept < len(printed) and printed[kept][0] * (len(comparisons) - kept) <= level:
        kept += 1
    if kept == len(printed):
        return
    p, name, between = printed[kept]
    corrected = min(1.0, p * (len(comparisons) - kept))
    yield warning(
        "study.multiple",
        "p",
        f"{len(comparisons)} comparisons use p < {level:g} without correction: {kept} of {len(printed)} significant "
        f"results remain significant after Holm's correction ({name}, {' - '.join(between)}: p = {p:g} becomes "
        f"{corrected:.3f})",
        Quantity(corrected, "1"),
        level,
        "correct for the number of comparisons, or state one primary comparison in advance",
        word="",
    )


def _spans(s: PrintedRange, users: Mapping[str, int]) -> Iterator[Finding]:
    """Yield a finding for each standard deviation below the minimum that is possible for the printed range and mean."""
    for group, n in users.items():
        mean = s.mean[group]
        low = s.lower[group]
        high = s.upper[group]
        smallest = smallest_std(mean, low, high, n)
        if s.std[group] + 0.05 < smallest:
            yield disagreement(
                "study.range",
                s.name,
                f"{s.name}, {group}: {mean:g} +- {s.std[group]:g} {s.unit} is printed with the range {low:g} to "
                f"{high:g}; {n} users with this mean and this range have a standard deviation of at least "
                f"{smallest:.1f} {s.unit}",
                Quantity(smallest, s.unit),
                s.std[group],
                "check whether the range belongs to another group or to all users",
                word="",
            )
    ranges = {(s.lower[group], s.upper[group]) for group in users}
    if len(ranges) == 1 and len(users) > 1:
        low, high = next(iter(ranges))
        yield warning(
            "study.range_repeated",
            s.name,
            f"{s.name}: the same range, {low:g} to {high:g} {s.unit}, is printed for all {len(users)} groups",
            suggestion="state the range of each group",
        )


def smallest_std(mean: float, low: float, high: float, n: int) -> float:
    """Return the minimum standard deviation (divisor n) of n values with this mean that include `low` and `high`."""
    if n == 2:
        return float(np.std([low, high]))
    # it is smallest if the other n - 2 values are equal
    rest = (n * mean - low - high) / (n - 2)
    variance = ((low - mean) ** 2 + (high - mean) ** 2 + (n - 2) * (rest - mean) ** 2) / n
    return float(np.sqrt(variance))


def rms_readings(a: Accuracy) -> dict[str, tuple[float, float]]:
    """Return {definition of the RMSE: (minimum, maximum) of the RMSE}, from the rounding of the printed components."""
    half = _half(a.decimals)
    mean = np.abs(np.array(a.mean))
    std = np.array(a.std)
    low = np.hypot(np.maximum(mean - half, 0), np.maximum(std - half, 0))
    high = np.hypot(mean + half, std + half)
    return {
        "root mean square of the axes": (_root_mean_square(low), _root_mean_square(high)),
        "length of the vector": (float(np.linalg.norm(low)), float(np.linalg.norm(high))),
        "worst axis": (float(np.max(low)), float(np.max(high))),
    }


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _fits(a: Accuracy) -> list[str]:
    """Return the definitions of the RMSE that agree with the printed RMSE."""
    half = _half(a.decimals)
    fitting: list[str] = []
    for definition, (low, high) in rms_readings(a).items():
        if low <= a.rmse + half and a.rmse - half <= high:
            fitting.append(definition)
    return fitting


def _rmse(rows: Sequence[Accuracy]) -> Iterator[Finding]:
    """Yield a finding for each printed RMSE that agrees with no definition."""
    for a in rows:
        if _fits(a):
            continue
        definitions: list[str] = []
        distances: list[float] = []
        for definition, (low, high) in rms_readings(a).items():
            definitions.append(f"{definition} {low:.{a.decimals}f} to {high:.{a.decimals}f}")
            distances.append(max(low - a.rmse, a.rmse - high))
        yield disagreement(
            "study.rmse",
            a.name,
            f"{a.name}: the printed RMSE of {a.rmse:.{a.decimals}f} {a.unit} does not follow from the printed mean "
            f"and std by any definition ({', '.join(definitions)})",
            Quantity(min(distances), a.unit),
            _half(a.decimals),
            "compare axis by axis: mean and std, not RMSE",
            word="",
        )


def _shown_errors(rows: Sequence[Accuracy]) -> TextTable:
    definitions = list(rms_readings(rows[0]))
    lines: list[list[str]] = []
    for a in rows:
        cells = [a.name, f"{a.rmse:.{a.decimals}f} {a.unit}"]
        for low, high in rms_readings(a).values():
            cells.append(f"{low:.{a.decimals}f} .. {high:.{a.decimals}f}")
        cells.append(", ".join(_fits(a)))
        lines.append(cells)
    return TextTable(("", "printed RMSE", *definitions, "agrees with"), lines)


def _claim(claim: Above, outcomes: Sequence[GroupOutcome]) -> Iterator[Finding]:
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
            Quantity(min(means), units[0]),
            claim.above,
            "name the exceptions",
            word="",
        )


def _twice(t: Twice) -> Iterator[Finding]:
    if all(values == t.values[0] for values in t.values):
        return
    places: list[str] = []
    for where, values in zip(t.where, t.values, strict=True):
        numbers = " to ".join(f"{value:+g}" for value in values)
        places.append(f"{where}: {numbers}")
    yield disagreement(
        "study.twice",
        t.name,
        f"{t.name} is printed with several values ({'; '.join(places)})",
        suggestion="correct the wrong values",
    )


def _chain(c: AccuracyChain, printed: Accuracy, measured: JsonMapping, stds: Sequence[float]) -> Iterator[Finding]:
    exact = measured["largest_error_unquantised_mm"]
    if exact >= 1e-6:
        yield disagreement(
            "study.chain",
            "chain",
            "the equations have an error even with an exact pen (no quantisation): largest error",
            Quantity(exact, "mm"),
            1e-6,
            "judge the equations of the console: twin console davinci",
        )
    largest = measured["largest_error_mm"]
    if largest > c.required_mm:
        yield disagreement(
            "study.required",
            "chain",
            "largest error in the simulated accuracy test",
            Quantity(largest, "mm"),
            c.required_mm,
            f"measure with a pen of finer resolution than {c.resolution_mm:g} mm",
            word="required",
        )
    percentile = _percentile(c.displacements)
    beyond: list[str] = []
    for axis, printed_std, std in zip("xyz", printed.std, stds, strict=True):
        if printed_std > percentile * std:
            beyond.append(f"{axis} {printed_std:.3f}")
    if beyond:
        largest_std = max(stds)
        limit = float(percentile * largest_std)
        yield warning(
            "study.quantised",
            printed.name,
            f"in {c.displacements} displacements, a pen with a resolution of {c.resolution_mm:g} mm causes a standard "
            f"deviation of {largest_std:.4f} mm on average, and of at most {limit:.3f} mm (99th percentile); "
            f"the paper prints {', '.join(beyond)} mm",
            Quantity(max(printed.std), "mm"),
            limit,
            "look for other sources of error than the resolution of the pen",
            word="",
        )


def _percentile(samples: int) -> float:
    """Return the 99th percentile of the standard deviation of a sample, relative to that of the population."""
    from scipy import stats

    freedom = samples - 1
    return float(np.sqrt(stats.chi2.ppf(0.99, freedom) / freedom))


def _angles(c: AngleChain, printed: Accuracy, measured: JsonMapping, stds: Sequence[float]) -> Iterator[Finding]:
    exact = measured["largest_error_unquantised_deg"]
    if exact >= 1e-6:
        yield disagreement(
            "study.chain",
            "angle_chain",
            "the equations have an error even with an exact gimbal (no quantisation): largest error",
            Quantity(exact, "deg"),
            1e-6,
            "judge the equations of the console: twin console davinci",
        )
    percentile = _percentile(c.rotations)
    axes = zip("xyz", printed.std, stds, strict=True)
    beyond = [f"{axis} {printed_std:.3f}" for axis, printed_std, std in axes if printed_std > percentile * std]
    mean_std = float(np.mean(stds))
    typical = f"a standard deviation of {mean_std:.4f} deg on average, and of at most {percentile * mean_std:.3f} deg"
    gimbal = f"in {c.rotations} rotations, a gimbal with a resolution of {c.resolution_deg:g} deg ({c.provenance})"
    if beyond:
        yield warning(
            "study.quantised",
            printed.name,
            f"{gimbal} causes {typical} (99th percentile); the paper prints {', '.join(beyond)} deg",
            Quantity(max(printed.std), "deg"),
            percentile * mean_std,
            "look for other sources of error than the resolution of the gimbal",
            word="",
        )
    else:
        text = f"{gimbal} causes {typical}: the resolution explains the printed ones"
        yield info("study.explained", printed.name, text)


def _sum(s: PriceSum) -> Iterator[Finding]:
    """Yield a finding on a printed sum of prices: each price once, or as often as pieces are needed."""
    once = sum(part.price for part in s.part)
    needed = sum(part.price * part.pieces for part in s.part)
    half = s.rounded_to / 2
    several = [f"{part.pieces} × {part.name}" for part in s.part if part.pieces > 1]
    is_once = abs(s.printed - once) <= half
    if abs(s.printed - needed) <= half:
        return
    text = f"the printed prices have the sum {once:,.0f} {s.unit} if each is counted once"
    if several:
        text += f", and {needed:,.0f} {s.unit} with {' and '.join(several)}"
    if is_once:
        yield warning(
            "study.sum",
            s.name,
            f"{text}; the paper prints {s.printed:,.0f} {s.unit}, right only if the prices are those of all pieces",
            Quantity(needed, s.unit),
            s.printed,
            "state whether the prices are for one piece or for all",
            word="printed",
        )
        return
    yield disagreement(
        "study.sum",
        s.name,
        f"{text}; printed",
        Quantity(s.printed, s.unit),
        needed,
        "correct the prices or their sum",
        word="sum",
    )
