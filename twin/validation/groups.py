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
from twin.core.result import Table as Shown
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
    claim: list[Above] = Field(default_factory=list)
    twice: list[Twice] = Field(default_factory=list)

    @model_validator(mode="after")
    def _named(self) -> GroupTables:
        names = {g.name for g in self.group}
        for key, rows in (("outcome", self.outcome), ("range", self.range)):
            for i, row in enumerate(rows):
                for field in ("mean", "std", "lower", "upper"):
                    cells = getattr(row, field, None)
                    if cells is not None and set(cells) != names:
                        raise at((key, i, field), f"give one number for each group: {', '.join(sorted(names))}")
        for i, row in enumerate(self.range):
            if below := [g for g in row.lower if row.lower[g] > row.upper[g]]:
                raise at(("range", i, "upper"), f"{below[0]}: the range ends below its beginning")
        for i, twice in enumerate(self.twice):
            if (places := len(twice.where)) != (lists := len(twice.values)):
                text = f"give one list of values for each place: {places} place{'s' * (places > 1)}, {lists} lists"
                raise at(("twice", i, "values"), text)
        for i, row in enumerate(self.outcome):
            for j, pair in enumerate(row.compared):
                if not set(pair.between) <= names:
                    text = f"give the names of two groups; the groups are {', '.join(sorted(names))}"
                    raise at(("outcome", i, "compared", j, "between"), text)
        known = {o.name for o in self.outcome}
        for i, claim in enumerate(self.claim):
            if unknown := set(claim.outcomes) - known:
                raise at(
                    ("claim", i, "outcomes"),
                    f"there is no outcome '{min(unknown)}'; the outcomes are {', '.join(sorted(known))}",
                )
        printed = [a.name for a in self.accuracy]
        if self.chain is not None and self.chain.of not in printed:
            text = (
                f"no [[accuracy]] section has the name '{self.chain.of}'; the names are {', '.join(printed) or 'none'}"
            )
            raise at(("chain", "of"), text)
        return self


@dataclass(frozen=True)
class Recomputed:
    """Result of checking a file: tables to print, plain data, findings."""

    tables: Sequence[Shown]
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


def recompute(tables: GroupTables, run: SimulatedChain) -> Recomputed:
    """Check the printed numbers of a user study with groups; return tables, data and findings."""
    users = {g.name: g.users for g in tables.group}
    outcomes, rows = [], []
    findings: list[Finding] = []
    for o in tables.outcome:
        findings += _integers(o, users)
        for pair in o.compared:
            p = _welch(o, pair.between, users)
            outcomes.append(
                {"name": o.name, "between": list(pair.between), "printed_p": pair.printed_p, "welch_p": p},
            )
            said = f"{pair.printed_p:.4f}" if pair.printed_p is not None else "not significant"
            rows.append((o.name, " - ".join(pair.between), said, f"{p:.4f}"))
    findings += _unpublished(tables)
    findings += _corrected(tables)
    for span in tables.range:
        findings += _spans(span, users)
    errors = []
    for a in tables.accuracy:
        readings = rms_readings(a)
        errors.append({"name": a.name, "printed_rmse": a.rmse, "readings": {n: list(v) for n, v in readings.items()}})
    findings += _rmse(tables.accuracy)
    for claim in tables.claim:
        findings += _claim(claim, tables.outcome)
    for twice in tables.twice:
        findings += _twice(twice)
    data: JsonObject = {"comparisons": outcomes, "accuracy": errors}
    shown = [Shown(("", "between", f"printed p ({tables.printed_test})", "Welch t from mean, std, n"), rows)]
    if tables.accuracy:
        shown.append(_shown_errors(tables.accuracy))
    if tables.chain is not None:
        measured, stds = run(tables.chain)
        data["chain"] = dict(measured)
        shown.append(Shown(("simulated accuracy test", ""), [(k, f"{v:.3g}") for k, v in _flat(measured)]))
        printed = next(a for a in tables.accuracy if a.name == tables.chain.of)
        findings += _chain(tables.chain, printed, measured, stds)
    return Recomputed(shown, data, findings)


def _flat(measured: JsonMapping) -> Iterator[tuple[str, float]]:
    for key, value in measured.items():
        values = value if isinstance(value, list) else [value]
        yield from ((key if len(values) == 1 else f"{key} {'xyz'[i]}", x) for i, x in enumerate(values))


def _welch(o: GroupOutcome, between: tuple[str, str], users: Mapping[str, int]) -> float:
    from scipy import stats

    a, b = between
    return float(
        stats.ttest_ind_from_stats(o.mean[a], o.std[a], users[a], o.mean[b], o.std[b], users[b], equal_var=False).pvalue
    )


def _integers(o: GroupOutcome, users: Mapping[str, int]) -> Iterator[Finding]:
    """Yield a finding for each printed mean that is not the rounded mean of any set of integers."""
    if not o.items:
        return
    for group, mean in o.mean.items():
        n = users[group] * o.items
        k = round(mean * n)
        half = 0.5 * 10**-o.decimals * (1 + 1e-9)
        near = min((k - 1, k, k + 1), key=lambda s: abs(s / n - mean))
        if abs(near / n - mean) <= half:
            continue
        yield disagreement(
            "study.integers",
            o.name,
            f"{o.name}, {group}: the printed mean {mean:.{o.decimals}f} {o.unit} is not the mean of any {n} integers "
            f"from {users[group]} users; the nearest possible mean is {near / n:.{o.decimals + 1}f}",
            Quantity(abs(near / n - mean), o.unit),
            half,
            "check how many users were counted",
            word="",
        )


def _unpublished(tables: GroupTables) -> Iterator[Finding]:
    printed = [p for o in tables.outcome for p in o.compared if p.printed_p is not None]
    if printed:
        yield info(
            "study.raw",
            "p",
            f"{len(printed)} printed p-values are from {tables.printed_test}, which needs the rank of every user; "
            "they cannot be recomputed from means and standard deviations",
            suggestion="ask the authors for the raw data and run: twin study FILE.csv",
        )


def _corrected(tables: GroupTables) -> Iterator[Finding]:
    """Yield a finding if a printed p-value is not significant after Holm's correction."""
    pairs = [(o.name, p) for o in tables.outcome for p in o.compared]
    printed = sorted((p.printed_p, name, p.between) for name, p in pairs if p.printed_p is not None)
    level, left = tables.significance, len(pairs)
    kept = 0
    for p, _, _ in printed:
        if p * (left - kept) > level:
            break
        kept += 1
    if kept == len(printed):
        return
    p, name, between = printed[kept]
    corrected = min(1.0, p * (left - kept))
    yield warning(
        "study.multiple",
        "p",
        f"{len(pairs)} comparisons use p < {level:g} without correction: {kept} of {len(printed)} significant results "
        f"remain significant after Holm's correction ({name}, {' - '.join(between)}: p = {p:g} becomes "
        f"{corrected:.3f})",
        Quantity(corrected, "1"),
        level,
        "correct for the number of comparisons, or state one primary comparison in advance",
        word="",
    )


def _spans(s: PrintedRange, users: Mapping[str, int]) -> Iterator[Finding]:
    """Yield a finding for each standard deviation below the minimum that is possible for the printed range and mean."""
    for group, n in users.items():
        mean, low, high = s.mean[group], s.lower[group], s.upper[group]
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
    ranges = {(s.lower[g], s.upper[g]) for g in users}
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
    rest = (n * mean - low - high) / (n - 2)
    return float(np.sqrt(((low - mean) ** 2 + (high - mean) ** 2 + (n - 2) * (rest - mean) ** 2) / n))


def rms_readings(a: Accuracy) -> dict[str, tuple[float, float]]:
    """Return {definition of the RMSE: (minimum, maximum) of the RMSE}, from the rounding of the printed components."""
    half = 0.5 * 10**-a.decimals
    mean, std = np.abs(np.array(a.mean)), np.array(a.std)
    low = np.hypot(np.maximum(mean - half, 0), np.maximum(std - half, 0))
    high = np.hypot(mean + half, std + half)
    return {
        name: (float(of(low)), float(of(high)))
        for name, of in (
            ("root mean square of the axes", lambda r: np.sqrt(np.mean(r**2))),
            ("length of the vector", np.linalg.norm),
            ("worst axis", np.max),
        )
    }


def _fits(a: Accuracy) -> list[str]:
    half = 0.5 * 10**-a.decimals
    return [n for n, (low, high) in rms_readings(a).items() if low <= a.rmse + half and a.rmse - half <= high]


def _rmse(rows: Sequence[Accuracy]) -> Iterator[Finding]:
    """Yield a finding for each printed RMSE that agrees with no definition."""
    for a in rows:
        if _fits(a):
            continue
        made = ", ".join(
            f"{n} {low:.{a.decimals}f} to {high:.{a.decimals}f}" for n, (low, high) in rms_readings(a).items()
        )
        half = 0.5 * 10**-a.decimals
        yield disagreement(
            "study.rmse",
            a.name,
            f"{a.name}: the printed RMSE of {a.rmse:.{a.decimals}f} {a.unit} does not follow from the printed mean "
            f"and std by any definition ({made})",
            Quantity(min(max(low - a.rmse, a.rmse - high) for low, high in rms_readings(a).values()), a.unit),
            half,
            "compare axis by axis: mean and std, not RMSE",
            word="",
        )


def _shown_errors(rows: Sequence[Accuracy]) -> Shown:
    names = list(rms_readings(rows[0]))
    lines = []
    for a in rows:
        r, d = rms_readings(a), a.decimals
        lines.append(
            (
                a.name,
                f"{a.rmse:.{d}f} {a.unit}",
                *(f"{r[n][0]:.{d}f} .. {r[n][1]:.{d}f}" for n in names),
                ", ".join(_fits(a)),
            )
        )
    return Shown(("", "printed RMSE", *names, "agrees with"), lines)


def _claim(claim: Above, outcomes: Sequence[GroupOutcome]) -> Iterator[Finding]:
    cells = [(o, g, m) for o in outcomes if o.name in claim.outcomes for g, m in o.mean.items() if m <= claim.above]
    if cells:
        against = ", ".join(f"{g} {o.name} {m:.{o.decimals}f}" for o, g, m in cells)
        yield warning(
            "study.claim",
            "prose",
            f"the statement '{claim.text}' is false for {against}",
            Quantity(min(m for _, _, m in cells), cells[0][0].unit),
            claim.above,
            "name the exceptions",
            word="",
        )


def _twice(t: Twice) -> Iterator[Finding]:
    if len({tuple(v) for v in t.values}) > 1:
        said = "; ".join(f"{w}: {' to '.join(f'{x:+g}' for x in v)}" for w, v in zip(t.where, t.values, strict=True))
        yield disagreement(
            "study.twice",
            t.name,
            f"{t.name} is printed with several values ({said})",
            suggestion="correct the wrong values",
        )


def _chain(c: AccuracyChain, printed: Accuracy, measured: JsonMapping, stds: Sequence[float]) -> Iterator[Finding]:
    from scipy import stats

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
    k = c.displacements - 1
    high = np.sqrt(stats.chi2.ppf(0.99, k) / k)
    beyond = [f"{axis} {s:.3f}" for axis, s, q in zip("xyz", printed.std, stds, strict=True) if s > high * q]
    if beyond:
        yield warning(
            "study.quantised",
            printed.name,
            f"in {c.displacements} displacements, a pen with a resolution of {c.resolution_mm:g} mm causes a standard "
            f"deviation of {max(stds):.4f} mm on average, and of at most {high * max(stds):.3f} mm (99th percentile); "
            f"the paper prints {', '.join(beyond)} mm",
            Quantity(max(printed.std), "mm"),
            float(high * max(stds)),
            "look for other sources of error than the resolution of the pen",
            word="",
        )
