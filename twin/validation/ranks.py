"""Compare groups of users by rank tests in each column of a CSV file, with a correction for the number of tests."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from twin.core.errors import DescriptionError
from twin.core.findings import Finding, warning
from twin.core.foreign.text import read_text
from twin.core.quantity import Quantity
from twin.core.result import Part, Result, Table

_GROUP = "group"


@dataclass(frozen=True)
class Comparison:
    """Rank test of two groups in one measure.

    Attributes:
        measure, groups: names of the measure and of the two groups.
        counts, medians: number of users and median of each group.
        u: Mann-Whitney U of the first group.
        p: two-sided p-value; exact without ties, normal approximation with ties.
        holm: p-value with Holm's correction for all comparisons.
        effect: rank-biserial correlation; 1 if every value of the first group is above every value of the second.
    """

    measure: str
    groups: tuple[str, str]
    counts: tuple[int, int]
    medians: tuple[float, float]
    u: float
    p: float
    holm: float
    effect: float


@dataclass(frozen=True)
class Ranks(Result):
    """Rank tests of all groups of users.

    Attributes:
        file: name of the CSV file.
        comparisons: one per pair of groups and measure.
        findings: warnings about groups too small for a significant result.
    """

    file: str
    comparisons: Sequence[Comparison]
    findings: Sequence[Finding]

    kind = "study"
    judges = False

    def content(self) -> dict[str, Any]:
        """Return plain data."""
        return {"file": self.file, "test": "Wilcoxon-Mann-Whitney", "comparisons": [vars(c) for c in self.comparisons]}

    def text(self) -> Iterator[Part]:
        """Yield a row per comparison, then the findings."""
        yield f"{self.file}: Wilcoxon-Mann-Whitney, two-sided; Holm for {len(self.comparisons)} comparisons\n"
        rows = [
            (
                c.measure,
                " - ".join(c.groups),
                f"{c.counts[0]}, {c.counts[1]}",
                f"{c.medians[0]:.4g}, {c.medians[1]:.4g}",
                f"{c.u:g}",
                f"{c.p:.4f}",
                f"{c.holm:.4f}",
                f"{c.effect:+.2f}",
            )
            for c in self.comparisons
        ]
        yield Table(("measure", "groups", "users", "medians", "U", "p", "p (Holm)", "effect"), rows)
        yield ""
        yield from self.findings


def compare(path: Path) -> Ranks:
    """Test every pair of groups in every numeric column of a CSV file; empty cells are skipped.

    Args:
        path: CSV file with a header, a column `group`, and one row per user.

    Raises:
        DescriptionError: the column is missing, there is only one group, or a cell is not a number (with its line
            number).
    """
    from scipy import stats

    columns = _read(path)
    found: list[Comparison] = []
    for measure, groups in columns.items():
        for a, b in combinations(groups, 2):
            x, y = np.array(groups[a]), np.array(groups[b])
            if not len(x) or not len(y):
                continue
            ties = len(np.unique(np.concatenate([x, y]))) < len(x) + len(y)
            test = stats.mannwhitneyu(x, y, method="asymptotic" if ties else "exact")
            u, medians = float(test.statistic), (float(np.median(x)), float(np.median(y)))
            p = 1.0 if math.isnan(test.pvalue) else float(test.pvalue)
            effect = 2 * u / (len(x) * len(y)) - 1
            found.append(Comparison(measure, (a, b), (len(x), len(y)), medians, u, p, p, effect))
    if not found:
        raise DescriptionError(
            f"{path}: there is nothing to compare: give two groups with numbers in at least one column"
        )
    return Ranks(path.name, _holm(found), [*_small(found)])


def _holm(found: Sequence[Comparison]) -> list[Comparison]:
    order, most, out = sorted(range(len(found)), key=lambda i: found[i].p), 0.0, list(found)
    for rank, i in enumerate(order):
        most = max(most, min(1.0, found[i].p * (len(found) - rank)))
        out[i] = replace(found[i], holm=most)
    return out


def _small(found: Sequence[Comparison]) -> Iterator[Finding]:
    for pair in dict.fromkeys(c.groups for c in found):
        n, m = next(c.counts for c in found if c.groups == pair)
        smallest = 2 / math.comb(n + m, n)
        if smallest > 0.05:
            yield warning(
                "study.small",
                " - ".join(pair),
                f"{pair[0]} and {pair[1]} have {n} and {m} users: with so few users, p cannot be below {smallest:.3f}",
                Quantity(smallest, "1"),
                0.05,
                "add users: with 4 users in each group, p can be as low as 0.029",
                word="",
            )


def _read(path: Path) -> Mapping[str, Mapping[str, list[float]]]:
    """Return the values by column and group, both in the order of the file."""
    try:
        rows = list(csv.reader(read_text(path, "CSV", "utf-8-sig").splitlines()))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DescriptionError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if not rows or _GROUP not in (head := [h.strip() for h in rows[0]]):
        raise DescriptionError(f"{path}:1: the header needs a column '{_GROUP}', as in: {_GROUP},time_s,errors")
    at = head.index(_GROUP)
    measures = [(i, h) for i, h in enumerate(head) if i != at and h]
    out: dict[str, dict[str, list[float]]] = {h: {} for _, h in measures}
    for line, row in enumerate(rows[1:], 2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(head):
            raise DescriptionError(f"{path}:{line}: {len(row)} cells; the header has {len(head)}")
        group = row[at].strip()
        for i, measure in measures:
            cell, values = row[i].strip(), out[measure].setdefault(group, [])
            if not cell:
                continue
            try:
                value = float(cell)
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                raise DescriptionError(f"{path}:{line}: {measure} is '{cell}'; give a finite number, or leave it empty")
            values.append(value)
    return out
