"""Compare groups of users by rank tests in each measure, with a correction for the number of tests.

The effect is the rank-biserial correlation, which equals Cliff's delta (N. Cliff, Psychological Bulletin 114(3), 1993):
the fraction of pairs with the larger value in the first group, minus the fraction of pairs with the smaller value in
the first group. The measure A of Vargha and Delaney (J. Educational and Behavioral Statistics 25(2), 2000) is
(effect + 1) / 2.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from twin.core.errors import DescriptionError
from twin.core.findings import Finding, info, warning
from twin.core.foreign.text import read_text
from twin.core.json_types import JsonObject
from twin.core.quantity import Quantity
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.validation.questionnaires import scored

_SIGNIFICANCE = 0.05
"""Usual level of significance."""

# columns that are not measures
_GROUP_COLUMN = "group"
_SESSION_COLUMN = "session"
_TRIAL_COLUMN = "trial"
_USER_COLUMN = "user"

_MEASURE_LABELS = {
    "time_s": "Time [s]",
    "clutches": "Clutch presses",
    "path_mm": "Path of the tip [mm]",
    "holes_touched": "Holes touched",
    "wrong_holes": "Wrong holes",
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

_UNIT_OF_SUFFIX = {
    "s": "s",
    "ms": "ms",
    "cm": "cm",
    "mm": "mm",
    "deg": "deg",
    "rad": "rad",
    "hz": "Hz",
    "percent": "%",
}
"""Units of measures, by the last part of the name of a measure; "n", "m" and "min" could be a number or a minimum."""


def label(measure: str) -> str:
    """Return the name of a measure for tables and plots, with its unit, such as "Path of psm1 [mm]"."""
    fixed_label = _MEASURE_LABELS.get(measure)
    if fixed_label:
        return fixed_label
    name, _, last = measure.rpartition("_")
    unit = _UNIT_OF_SUFFIX.get(last)
    if not name or not unit:
        return _words(measure)
    return f"{_words(name)} [{unit}]"


def _words(name: str) -> str:
    """Return the name of a measure without its unit as words, such as "Path of psm1"."""
    path, _, last = name.rpartition("_")
    if path and last == "path":
        return f"Path of {path}"
    words = name.replace("_", " ")
    if words == words.lower() and words not in _UNIT_OF_SUFFIX:
        return words[:1].upper() + words[1:]
    return words


@dataclass(frozen=True)
class Users:
    """A table of users or of their sessions.

    Attributes:
        file: name of the file.
        groups: (k,) group of each row.
        sessions: (k,) number of the session in each row; None: the table has no such column.
        repeated: whether rows with different session numbers belong to the same users.
        measures: values (k,) by measure; NaN: an empty cell.
        findings: findings on questionnaires, or on interrupted sessions.
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
        if self.repeated or self.sessions is None:
            return "users"
        return "sessions"

    def samples(self, measure: str) -> dict[str, Array]:
        """Return the values of a measure by group.

        If `repeated`, each group has two entries: the values of its first session and of its last session.
        """
        values = np.array(self.measures[measure], float)
        finite = np.isfinite(values)
        groups = np.array(self.groups)
        samples: dict[str, Array] = {}
        for group in dict.fromkeys(self.groups):
            in_group = groups == group
            if self.sessions is None or not self.repeated:
                samples[group] = values[in_group & finite]
                continue
            sessions = np.array(self.sessions)
            first = sessions[in_group].min()
            last = sessions[in_group].max()
            for number in sorted({first, last}):
                in_session = in_group & (sessions == number)
                samples[f"{group}, session {number:g}"] = values[in_session & finite]
        return samples

    def pairs(self, measure: str) -> list[tuple[str, str]]:
        """Return the pairs of groups to compare; the names are keys of the result of `samples`.

        The pairs are all pairs of groups. If `repeated`, the first session of each group is paired with its last
        session, and the last session of each group with the last session of every other group.
        """
        names = list(self.samples(measure))
        if not self.repeated:
            return list(combinations(names, 2))
        # `samples` names the entries of a group in the order of its sessions
        by_group: dict[str, list[str]] = {}
        for name in names:
            group = name.rpartition(", session ")[0]
            by_group.setdefault(group, []).append(name)
        learned: list[tuple[str, str]] = []
        last_sessions: list[str] = []
        for sessions in by_group.values():
            if len(sessions) > 1:
                learned.append((sessions[0], sessions[-1]))
            last_sessions.append(sessions[-1])
        return learned + list(combinations(last_sessions, 2))


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

    def cells(self) -> tuple[str, ...]:
        """Return the cells of the comparison's row in a table of text."""
        p = f"{self.p:.4f}"
        if not self.exact:
            p += "*"
        return (
            label(self.measure),
            " - ".join(self.groups),
            f"{self.counts[0]}, {self.counts[1]}",
            f"{self.medians[0]:.4g}, {self.medians[1]:.4g}",
            f"{self.u:g}",
            p,
            f"{self.holm:.4f}",
            f"{self.effect:+.2f}",
        )


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
        return {
            "file": self.file,
            "test": "Wilcoxon-Mann-Whitney",
            "comparisons": [vars(comparison) for comparison in self.comparisons],
        }

    def text(self) -> Iterator[Part]:
        """Yield a row per comparison, then the findings."""
        yield f"{self.file}: Wilcoxon-Mann-Whitney, two-sided; Holm for {len(self.comparisons)} comparisons\n"
        header = ("measure", "groups", self.users.counted, "medians", "U", "p", "p (Holm)", "effect")
        yield TextTable(header, [comparison.cells() for comparison in self.comparisons])
        yield "  effect: rank-biserial correlation = Cliff's delta = 2 A - 1, A of Vargha and Delaney"
        if not all(comparison.exact for comparison in self.comparisons):
            yield "  *: p by the normal approximation, because of ties; the other p-values are exact"
        yield ""
        yield from self.findings

    def write(self, folder: Path) -> None:
        """Write users.csv: one row per user or session, with scores instead of answers."""
        users = self.users
        sessions = users.sessions if users.repeated else None
        header = [_GROUP_COLUMN]
        if sessions is not None:
            header.append(_SESSION_COLUMN)
        header += users.measures
        with (folder / "users.csv").open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(header)
            for k, group in enumerate(users.groups):
                cells = [group]
                if sessions is not None:
                    cells.append(f"{sessions[k]:g}")
                for values in users.measures.values():
                    if math.isnan(values[k]):
                        cells.append("")
                    else:
                        cells.append(f"{values[k]:.9g}")
                rows.writerow(cells)


def compare(path: Path) -> Ranks:
    """Test every pair of groups in every numeric column of a CSV file; empty cells are skipped.

    The file has a header, a column `group`, and one row per user or session. Columns ssq_1 to ssq_16 and ueq_1 to
    ueq_26 are answers to questionnaires, and are scored. With a column `trial`, rows are trials; the value of a user
    (column `user`) is the mean of their trials. With a column `session`, rows are sessions of the same users.
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
    tests: list[RankTest] = []
    for measure in users.measures:
        samples = users.samples(measure)
        for groups in users.pairs(measure):
            x = samples[groups[0]]
            y = samples[groups[1]]
            if len(x) and len(y):
                tests.append(_rank_test(measure, groups, x, y))
    source = source or users.file
    if not tests:
        raise DescriptionError(
            f"{source}: there is nothing to compare: give two groups with numbers in at least one column"
        )
    if all(test.counts == (1, 1) for test in tests):
        raise DescriptionError(
            f"{source}: every group has only one session or user, and a rank test needs several values in each group: "
            "give at least 4 in each group"
        )
    findings = [*users.findings, *_note_on_repeated_users(users), *_warnings_on_small_groups(tests, users.counted)]
    return Ranks(users, _with_holm_correction(tests), findings)


def _rank_test(measure: str, groups: tuple[str, str], x: Array, y: Array) -> RankTest:
    """Return the rank test of the values x (n,) and y (m,) of two groups, without a correction for other tests."""
    from scipy import stats

    # the exact distribution of U assumes that no two values are equal
    distinct = len(np.unique(np.concatenate([x, y])))
    exact = distinct == len(x) + len(y)
    method = "asymptotic"
    if exact:
        method = "exact"
    test = stats.mannwhitneyu(x, y, method=method)
    p = float(test.pvalue)
    if math.isnan(p):  # all values are equal: nothing speaks against equal groups
        p = 1.0
    u = float(test.statistic)
    superiority = u / (len(x) * len(y))
    effect = 2 * superiority - 1
    counts = (len(x), len(y))
    medians = (float(np.median(x)), float(np.median(y)))
    return RankTest(
        measure,
        groups,
        counts=counts,
        medians=medians,
        u=u,
        exact=exact,
        p=p,
        holm=p,
        effect=effect,
        superiority=superiority,
    )


def _note_on_repeated_users(users: Users) -> Iterator[Finding]:
    """Yield a note if sessions of the same users are compared, which the test treats as independent."""
    if users.repeated:
        yield info(
            "study.repeated",
            _SESSION_COLUMN,
            "the rank test treats the first and the last sessions as sessions of different users, but the sessions of "
            "one user are not independent",
        )


def _with_holm_correction(tests: Sequence[RankTest]) -> list[RankTest]:
    """Return the tests with p-values by Holm's step-down correction for the number of tests."""
    corrected = list(tests)
    by_p = sorted(range(len(tests)), key=lambda i: tests[i].p)
    largest = 0.0
    for rank, i in enumerate(by_p):
        p = min(1.0, tests[i].p * (len(tests) - rank))
        largest = max(largest, p)  # a corrected p is never below that of a smaller p
        corrected[i] = replace(tests[i], holm=largest)
    return corrected


def _warnings_on_small_groups(tests: Sequence[RankTest], counted: str) -> Iterator[Finding]:
    """Yield a warning for each pair of groups that are too small for a significant result."""
    counts: dict[tuple[str, str], tuple[int, int]] = {}
    for test in tests:
        counts.setdefault(test.groups, test.counts)
    for (first, second), (n, m) in counts.items():
        smallest = 2 / math.comb(n + m, n)  # two-sided p if every value of one group is above the other group
        if smallest > _SIGNIFICANCE:
            yield warning(
                "study.small",
                f"{first} - {second}",
                f"{first} and {second} have {n} and {m} {counted}: with so few {counted}, p cannot be below "
                f"{smallest:.3f}",
                size=Quantity(smallest, "1"),
                limit=_SIGNIFICANCE,
                suggestion=f"add {counted}: with 4 {counted} in each group, p can be as low as 0.029",
                word="",
            )


@dataclass
class _ReadTable:
    """The rows of a table of users, and the line of each row in the file.

    Attributes:
        groups, names, lines: group, user ("" without a column) and line of each row (k).
        columns: numbers (k) by column, without group and user; NaN: an empty cell.
    """

    columns: dict[str, list[float]]
    groups: list[str] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)


def _read(path: Path) -> Users:
    """Return the table of a file; trials become means of users, and answers to questionnaires become scores.

    Raises:
        DescriptionError: as `compare`.
    """
    rows = _cells_of_file(path)
    head = _column_names(path, rows)
    table = _read_table(path, head, rows)
    sessions = table.columns.pop(_SESSION_COLUMN, None)
    trials = table.columns.pop(_TRIAL_COLUMN, None)
    if trials is None:
        measures, findings = scored(path, table.columns, table.lines)
        is_repeated = sessions is not None
        return Users(
            path.name, table.groups, sessions=sessions, repeated=is_repeated, measures=measures, findings=findings
        )
    if sessions is not None:
        raise DescriptionError(
            f"{path}:1: the header has '{_SESSION_COLUMN}' and '{_TRIAL_COLUMN}'; keep one of these columns"
        )
    if _USER_COLUMN not in head:
        raise DescriptionError(
            f"{path}:1: trials need a column '{_USER_COLUMN}': a user's value is the mean of their trials"
        )
    return _users_of_trials(path, table, trials)


def _column_names(path: Path, rows: list[list[str]]) -> list[str]:
    """Return the names of the columns.

    Raises:
        DescriptionError: the column `group` is missing, or a name is there twice.
    """
    head: list[str] = []
    if rows:
        head = [cell.strip() for cell in rows[0]]
    if _GROUP_COLUMN not in head:
        raise DescriptionError(
            f"{path}:1: the header needs a column '{_GROUP_COLUMN}', as in: {_GROUP_COLUMN},time_s,errors"
        )
    for name in head:
        if name and head.count(name) > 1:
            raise DescriptionError(f"{path}:1: the header has '{name}' twice")
    return head


def _read_table(path: Path, head: list[str], rows: list[list[str]]) -> _ReadTable:
    """Return the rows below the header; empty rows are skipped.

    Raises:
        DescriptionError: a row has too many or too few cells, no group, or a cell that is not a number.
    """
    measured = [name for name in head if name not in (_GROUP_COLUMN, _USER_COLUMN, "")]
    table = _ReadTable({name: [] for name in measured})
    for line, row in enumerate(rows[1:], 2):
        cells = [cell.strip() for cell in row]
        if not any(cells):
            continue
        if len(cells) != len(head):
            raise DescriptionError(f"{path}:{line}: {len(cells)} cells; the header has {len(head)}")
        cell_of = dict(zip(head, cells, strict=True))
        group = cell_of[_GROUP_COLUMN]
        if not group:
            raise DescriptionError(f"{path}:{line}: {_GROUP_COLUMN} is empty; give the name of the user's group")
        table.groups.append(group)
        table.names.append(cell_of.get(_USER_COLUMN, ""))
        table.lines.append(line)
        for name, values in table.columns.items():
            values.append(_number_in_cell(cell_of[name], f"{path}:{line}: {name}", name != _SESSION_COLUMN))
    return table


def _users_of_trials(path: Path, table: _ReadTable, trials: Sequence[float]) -> Users:
    """Return a table whose rows are trials, with their numbers `trials` (k), as a table of users."""
    # a row without a number has answers before a trial that was not made
    numbered = np.flatnonzero(np.isfinite(trials))
    owners: list[tuple[str, str]] = []
    lines: list[int] = []
    for k in numbered:
        owners.append((table.groups[k], table.names[k]))
        lines.append(table.lines[k])
    columns: dict[str, list[float]] = {}
    for name, values in table.columns.items():
        columns[name] = [values[k] for k in numbered]
    measures, findings = scored(path, columns, lines)
    groups, measures = _means_of_users(owners, measures)
    text = f"a value of a user is the mean of the user's trials: {len(numbered)} trials of {len(groups)} users"
    left_out = len(trials) - len(numbered)
    if left_out:
        text += f"; rows without a number in the column '{_TRIAL_COLUMN}', which do not count: {left_out}"
    note = info("study.trials", _TRIAL_COLUMN, text)
    return Users(path.name, groups, sessions=None, repeated=False, measures=measures, findings=[*findings, note])


def _means_of_users(
    owners: Sequence[tuple[str, str]], measures: Mapping[str, Sequence[float]]
) -> tuple[list[str], dict[str, list[float]]]:
    """Return the group of each user, and the mean of each measure over the user's trials; empty cells do not count.

    `owners` has (group, user) of each row; a user in two groups counts in each of them.
    """
    users = list(dict.fromkeys(owners))
    means: dict[str, list[float]] = {}
    for name, values in measures.items():
        means[name] = []
        for user in users:
            values_of_user = []
            for value, owner in zip(values, owners, strict=True):
                if owner == user and math.isfinite(value):
                    values_of_user.append(value)
            mean = math.nan
            if values_of_user:
                mean = float(np.mean(values_of_user))
            means[name].append(mean)
    return [group for group, _ in users], means


def _cells_of_file(path: Path) -> list[list[str]]:
    """Return the cells of all lines of a CSV file, the header first.

    Raises:
        DescriptionError: the file cannot be read, or is not UTF-8.
    """
    try:
        text = read_text(path, "CSV", "utf-8-sig")
        # not `splitlines`, which also ends a line at characters that a name may have, such as U+2028
        return list(csv.reader(io.StringIO(text, newline=None)))
    except UnicodeDecodeError as error:
        raise DescriptionError(f"{path}: not UTF-8 text at byte {error.start}; save the file as UTF-8") from None
    except (OSError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise DescriptionError(f"{path}: cannot be read: {reason}") from error


def _number_in_cell(cell: str, where: str, optional: bool) -> float:
    """Return the number in a cell; NaN if it is empty and optional."""
    if not cell and optional:
        return math.nan
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if math.isfinite(value):
        return value
    if optional:
        raise DescriptionError(f"{where} is '{cell}'; give a finite number, or leave it empty")
    raise DescriptionError(f"{where} is '{cell}'; give the number of the session")
