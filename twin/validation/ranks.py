"""Compare groups of users by rank tests in each measure, with a correction for the number of tests.

The effect is the rank-biserial correlation, which equals Cliff's delta (N. Cliff, Psychological Bulletin 114(3), 1993):
the fraction of pairs with the larger value in the first group, minus the fraction of pairs with the smaller value in
the first group. The measure A of Vargha and Delaney (J. Educational and Behavioral Statistics 25(2), 2000) is
(effect + 1) / 2.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from twin.core.errors import DescriptionError
from twin.core.findings import Finding, info, warning
from twin.core.foreign.text import read_text
from twin.core.json_types import JsonObject
from twin.core.quantity import Quantity
from twin.core.result import Part, Result, Table
from twin.core.spatial import Array
from twin.validation.questionnaires import scored

_GROUP, _SESSION, _USER = "group", "session", "user"
"""Columns that are not measures: name of the group, number of the user's session, name of the user."""

_LABELS = {
    "time_s": "Time [s]",
    "clutches": "Clutch presses",
    "camera_moves": "Camera moves",
    "rings_transferred": "Rings transferred",
    "rings_dropped": "Rings dropped",
    "instrument_collisions": "Instrument collisions",
    "errors": "Errors",
    "steps_done": "Steps done",
    "wire_passed_percent": "Wire passed [%]",
    "wire_touches": "Ring touched the wire",
    "wire_touching_s": "Ring touched the wire [s]",
    "ring_dropped": "Ring dropped",
    "targets_touched": "Targets touched",
    "lens_path_mm": "Path of the lens [mm]",
    "align_err_deg": "AlignErr [deg]",
    "align_err_size_deg": "Size of AlignErr [deg]",
}
"""Labels of the measures of console sessions, as used on the scoreboards."""

_UNITS = {x.lower(): x for x in ("s", "ms", "cm", "mm", "deg", "rad", "Hz")} | {"percent": "%"}
"""Units of measures, by the last part of the name of a measure; "n", "m" and "min" could be a number or a minimum."""


def label(measure: str) -> str:
    """Return the name of a measure for tables and plots, with its unit, such as "Path of psm1 [mm]"."""
    if known := _LABELS.get(measure):
        return known
    name, _, last = measure.rpartition("_")
    unit = _UNITS.get(last) if name else None
    name = name if unit else measure
    path, _, what = name.rpartition("_")
    name = f"Path of {path}" if path and what == "path" else name.replace("_", " ")
    if name == name.lower() and name not in _UNITS:
        name = name[:1].upper() + name[1:]
    return f"{name} [{unit}]" if unit else name


@dataclass(frozen=True)
class Users:
    """A table of users or of their sessions.

    Attributes:
        file: name of the file.
        groups: (k,) group of each row.
        sessions: (k,) number of the session in each row; None: the table has no such column.
        repeated: whether rows with different session numbers belong to the same users.
        measures: values (k,) by measure; NaN: an empty cell.
        findings: findings on questionnaires.
    """

    file: str
    groups: Sequence[str]
    sessions: Sequence[float] | None
    repeated: bool
    measures: Mapping[str, Sequence[float]]
    findings: Sequence[Finding] = ()

    @property
    def counted(self) -> str:
        """What is counted in a group: "users", or "sessions" if the users are unknown."""
        return "users" if self.repeated or self.sessions is None else "sessions"

    def samples(self, measure: str) -> dict[str, Array]:
        """Return the values of a measure by group.

        If `repeated`, each group has two entries: the values of its first session and of its last session.
        """
        values, groups = np.array(self.measures[measure], float), np.array(self.groups)
        out = {}
        for group in dict.fromkeys(self.groups):
            mine = groups == group
            if self.sessions is None or not self.repeated:
                out[group] = values[mine]
                continue
            numbers = np.array(self.sessions)
            for n in sorted({numbers[mine].min(), numbers[mine].max()}):
                out[f"{group}, session {n:g}"] = values[mine & (numbers == n)]
        return {group: x[np.isfinite(x)] for group, x in out.items()}

    def pairs(self, measure: str) -> list[tuple[str, str]]:
        """Return the pairs of groups to compare; the names are keys of the result of `samples`.

        The pairs are all pairs of groups. If `repeated`, the first session of each group is paired with its last
        session, and the last session of each group with the last session of every other group.
        """
        names = list(self.samples(measure))
        if not self.repeated:
            return list(combinations(names, 2))
        by_group: dict[str, list[str]] = {}
        for name in names:
            by_group.setdefault(name.rpartition(", session ")[0], []).append(name)
        learned = [(x[0], x[-1]) for x in by_group.values() if len(x) > 1]
        return learned + list(combinations([x[-1] for x in by_group.values()], 2))


@dataclass(frozen=True)
class RankTest:
    """Rank test of two groups in one measure.

    Attributes:
        measure, groups: names of the measure and of the two groups.
        counts, medians: number of users or sessions, and median, of each group.
        u: Mann-Whitney U of the first group.
        exact: whether p is exact. If values are tied, p is not exact, but a normal approximation with correction for
            ties and continuity.
        p: two-sided p-value.
        holm: p-value with Holm's correction for all comparisons.
        effect: rank-biserial correlation; 1 if every value of the first group is above every value of the second.
        superiority: measure A of Vargha and Delaney, the probability that a value of the first group exceeds a value
            of the second; ties count half.
    """

    measure: str
    groups: tuple[str, str]
    counts: tuple[int, int]
    medians: tuple[float, float]
    u: float
    exact: bool
    p: float
    holm: float
    effect: float
    superiority: float


@dataclass(frozen=True)
class Ranks(Result):
    """Rank tests of all groups of users.

    Attributes:
        comparisons: one per pair of groups and measure.
        findings: warnings about groups that are too small for a significant result, and notes on questionnaires.
    """

    users: Users
    comparisons: Sequence[RankTest]
    findings: Sequence[Finding]

    kind = "study"
    judges = False

    @property
    def file(self) -> str:
        """Name of the file with the users."""
        return self.users.file

    def content(self) -> JsonObject:
        """Return the rank tests as plain data."""
        return {"file": self.file, "test": "Wilcoxon-Mann-Whitney", "comparisons": [vars(c) for c in self.comparisons]}

    def text(self) -> Iterator[Part]:
        """Yield a row per comparison, then the findings."""
        yield f"{self.file}: Wilcoxon-Mann-Whitney, two-sided; Holm for {len(self.comparisons)} comparisons\n"
        rows = [
            (
                label(c.measure),
                " - ".join(c.groups),
                f"{c.counts[0]}, {c.counts[1]}",
                f"{c.medians[0]:.4g}, {c.medians[1]:.4g}",
                f"{c.u:g}",
                f"{c.p:.4f}{'' if c.exact else '*'}",
                f"{c.holm:.4f}",
                f"{c.effect:+.2f}",
            )
            for c in self.comparisons
        ]
        yield Table(("measure", "groups", self.users.counted, "medians", "U", "p", "p (Holm)", "effect"), rows)
        yield "  effect: rank-biserial correlation = Cliff's delta = 2 A - 1, A of Vargha and Delaney"
        if not all(c.exact for c in self.comparisons):
            yield "  *: p by the normal approximation, because of ties; the other p-values are exact"
        yield ""
        yield from self.findings

    def write(self, folder: Path) -> None:
        """Write users.csv: one row per user or session, with scores instead of answers."""
        u = self.users
        with (folder / "users.csv").open("w", encoding="utf-8", newline="") as file:
            out = csv.writer(file, lineterminator="\n")
            numbered = u.sessions if u.repeated else None
            out.writerow([_GROUP, *([] if numbered is None else [_SESSION]), *u.measures])
            for k, group in enumerate(u.groups):
                numbers = [] if numbered is None else [f"{numbered[k]:g}"]
                cells = ["" if math.isnan(v[k]) else f"{v[k]:.9g}" for v in u.measures.values()]
                out.writerow([group, *numbers, *cells])


def compare(path: Path) -> Ranks:
    """Test every pair of groups in every numeric column of a CSV file; empty cells are skipped.

    The file has a header, a column `group`, and one row per user or session. Columns ssq_1 to ssq_16 and ueq_1 to
    ueq_26 are answers to questionnaires, and are scored. With a column `session`, rows are sessions of the same users.
    In this case, the last sessions of all groups are compared with each other, and the first session of each group is
    compared with its last session.

    Raises:
        DescriptionError: the column `group` is missing, there is only one group, every group has only one value, or a
            cell is not a number (with its line number).
    """
    return compare_users(_read(path), str(path))


def compare_users(users: Users, source: str = "") -> Ranks:
    """Test the pairs of groups of a table in every measure; `source` is the name of the table in messages.

    Raises:
        DescriptionError: there is only one group, or every group has only one value.
    """
    from scipy import stats

    found: list[RankTest] = []
    for measure in users.measures:
        samples = users.samples(measure)
        for a, b in users.pairs(measure):
            x, y = samples[a], samples[b]
            if not len(x) or not len(y):
                continue
            ties = len(np.unique(np.concatenate([x, y]))) < len(x) + len(y)
            test = stats.mannwhitneyu(x, y, method="asymptotic" if ties else "exact")
            u, medians = float(test.statistic), (float(np.median(x)), float(np.median(y)))
            p = 1.0 if math.isnan(test.pvalue) else float(test.pvalue)
            part = u / (len(x) * len(y))
            counts = (len(x), len(y))
            found.append(RankTest(measure, (a, b), counts, medians, u, not ties, p, p, 2 * part - 1, part))
    source = source or users.file
    if not found:
        raise DescriptionError(
            f"{source}: there is nothing to compare: give two groups with numbers in at least one column"
        )
    if all(c.counts == (1, 1) for c in found):
        raise DescriptionError(
            f"{source}: every group has only one session or user, and a rank test needs several values in each group: "
            "give at least 4 in each group"
        )
    return Ranks(users, _holm(found), [*users.findings, *_repeated(users), *_small(found, users.counted)])


def _repeated(users: Users) -> Iterator[Finding]:
    if users.repeated:
        yield info(
            "study.repeated",
            _SESSION,
            "the rank test treats the first and the last sessions as sessions of different users, but the sessions of "
            "one user are not independent",
        )


def _holm(found: Sequence[RankTest]) -> list[RankTest]:
    order, most, out = sorted(range(len(found)), key=lambda i: found[i].p), 0.0, list(found)
    for rank, i in enumerate(order):
        most = max(most, min(1.0, found[i].p * (len(found) - rank)))
        out[i] = replace(found[i], holm=most)
    return out


def _small(found: Sequence[RankTest], counted: str) -> Iterator[Finding]:
    for pair in dict.fromkeys(c.groups for c in found):
        n, m = next(c.counts for c in found if c.groups == pair)
        smallest = 2 / math.comb(n + m, n)
        if smallest > 0.05:
            yield warning(
                "study.small",
                " - ".join(pair),
                f"{pair[0]} and {pair[1]} have {n} and {m} {counted}: with so few {counted}, p cannot be below "
                f"{smallest:.3f}",
                Quantity(smallest, "1"),
                0.05,
                f"add {counted}: with 4 {counted} in each group, p can be as low as 0.029",
                word="",
            )


def _read(path: Path) -> Users:
    try:
        rows = list(csv.reader(read_text(path, "CSV", "utf-8-sig").splitlines()))
    except UnicodeDecodeError as error:
        raise DescriptionError(f"{path}: not UTF-8 text at byte {error.start}; save the file as UTF-8") from None
    except (OSError, csv.Error) as error:
        raise DescriptionError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if not rows or _GROUP not in (head := [h.strip() for h in rows[0]]):
        raise DescriptionError(f"{path}:1: the header needs a column '{_GROUP}', as in: {_GROUP},time_s,errors")
    if twice := next((h for h in head if h and head.count(h) > 1), None):
        raise DescriptionError(f"{path}:1: the header has '{twice}' twice")
    at = head.index(_GROUP)
    numbers = [(i, h) for i, h in enumerate(head) if h not in (_GROUP, _USER, "")]
    columns: dict[str, list[float]] = {h: [] for _, h in numbers}
    groups: list[str] = []
    lines: list[int] = []
    for line, row in enumerate(rows[1:], 2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(head):
            raise DescriptionError(f"{path}:{line}: {len(row)} cells; the header has {len(head)}")
        if not (group := row[at].strip()):
            raise DescriptionError(f"{path}:{line}: {_GROUP} is empty; give the name of the user's group")
        groups.append(group)
        lines.append(line)
        for i, measure in numbers:
            columns[measure].append(_number(row[i].strip(), f"{path}:{line}: {measure}", measure != _SESSION))
    sessions = columns.pop(_SESSION, None)
    measures, findings = scored(path, columns, lines)
    return Users(path.name, groups, sessions, sessions is not None, measures, findings)


def _number(cell: str, where: str, optional: bool) -> float:
    """Return the number in a cell; NaN if it is empty and optional."""
    if not cell and optional:
        return math.nan
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        way_out = "a finite number, or leave it empty" if optional else "the number of the session"
        raise DescriptionError(f"{where} is '{cell}'; give {way_out}")
    return value
