"""Table of the trials of a study: a CSV file with one row for each attempt at a task, which `twin study` reads.

Answers that come before an attempt are written at once, to a row without a number, which the attempt completes. An
attempt does not complete such a row of an earlier command, unless this one has written answers to it as well.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Collection, Mapping
from pathlib import Path

from twin.core import atomic
from twin.core.errors import TwinError

USER = "user"
GROUP = "group"
TRIAL = "trial"
_NAMED = (USER, GROUP, TRIAL)
"""Columns that identify a trial."""

_FORBIDDEN = frozenset(',\r\n"')
"""Characters that a name must not have: other programs that read the table do not all know quotes."""


class TrialTable:
    """The trials of one user in one group, in a file that may have rows of others.

    Attributes:
        path: the file.
        user, group: name of the user, and of the group (the environment or condition) of these trials.
        trial: number of the newest trial of this user in this group; 0 before the first.
        other_groups: the other groups in which this user has trials.
    """

    def __init__(self, path: Path, user: str, group: str) -> None:
        """Open the table; the file is made with the first row.

        Raises:
            TwinError: the name of user or group is empty or has a comma or line break, or the file has another form.
        """
        for what, name in (("user", user), ("group", group)):
            if not name.strip() or not _FORBIDDEN.isdisjoint(name):
                raise TwinError(f"the name of the {what} is '{name}'; give text without commas, quotes and line breaks")
        self.path = path
        self.user = user.strip()
        self.group = group.strip()
        self._next: dict[str, float | None] = {}
        self.trial = 0
        self.other_groups: set[str] = set()
        for row in self._read()[1]:
            if self._is_own(row):
                self.trial = max(self.trial, _number(row, path))
            elif row[USER] == self.user:
                self.other_groups.add(row[GROUP])

    def add(self, measures: Mapping[str, float | None]) -> None:
        """Add a trial with {name with unit: value}; None: an empty cell.

        Raises:
            OutputError: the file cannot be written.
        """
        # read again: another program, or a person, may have changed the file since
        head, rows = self._read()
        trial = self.trial + 1
        row = self._begun(rows) if self._next else self._new(rows)
        row[TRIAL] = str(trial)
        self._fill(head, row, measures)
        self._fill(head, row, self._next)  # again, if the row was removed meanwhile
        self._write(head, rows)
        self.trial = trial  # an error above leaves the number to the next attempt
        self._next = {}

    def add_to_next(self, values: Mapping[str, float | None]) -> None:
        """Write {column: number} to the row of the next trial, which has no number until the trial is added.

        Raises:
            OutputError: the file cannot be written.
        """
        head, rows = self._read()
        self._fill(head, self._begun(rows), values)
        self._write(head, rows)
        self._next |= values

    def _begun(self, rows: list[dict[str, str]]) -> dict[str, str]:
        """Return the row of the next trial, which is appended to `rows` if there is none yet."""
        for row in rows:
            if self._is_own(row) and not row[TRIAL].strip():
                return row
        return self._new(rows)

    def _new(self, rows: list[dict[str, str]]) -> dict[str, str]:
        """Return a row without a number, which is appended to `rows`."""
        row = {USER: self.user, GROUP: self.group, TRIAL: ""}
        rows.append(row)
        return row

    def answer(self, answers: Mapping[str, float | None], trial: int | None = None) -> None:
        """Add answers {column: number} to a trial; None: to the newest one.

        Raises:
            TwinError: there is no such trial.
            OutputError: the file cannot be written.
        """
        number = self.trial if trial is None else trial
        head, rows = self._read()
        for row in reversed(rows):
            if number and self._is_own(row) and _number(row, self.path) == number:
                self._fill(head, row, answers)
                self._write(head, rows)
                return
        if number == 0:
            raise TwinError(f"{self.path}: {self.user} has no trial in group '{self.group}' yet; finish a trial first")
        raise TwinError(
            f"{self.path}: the row of trial {number} of {self.user} in group '{self.group}' is missing; put it back"
        )

    def has_values(self, columns: Collection[str]) -> bool:
        """Return whether the newest trial has a value in one of these columns."""
        for row in self._read()[1]:
            is_newest = self._is_own(row) and _number(row, self.path) == self.trial
            if self.trial and is_newest and any(map(row.get, columns)):
                return True
        return False

    def _is_own(self, row: Mapping[str, str]) -> bool:
        return row[USER] == self.user and row[GROUP] == self.group

    @staticmethod
    def _fill(head: list[str], row: dict[str, str], values: Mapping[str, float | None]) -> None:
        for name, value in values.items():
            if name not in head:
                head.append(name)
            row[name] = "" if value is None else f"{value:.9g}"

    def _read(self) -> tuple[list[str], list[dict[str, str]]]:
        """Return the names of the columns and the rows of the file; no row if there is no file."""
        if not self.path.exists():
            return list(_NAMED), []
        try:
            text = self.path.read_text(encoding="utf-8-sig")  # spreadsheets write a mark at the begin
        except (OSError, UnicodeDecodeError) as error:
            raise TwinError(f"{self.path}: cannot be read: {error}") from error
        try:
            # not `splitlines`, which also ends a line at characters that a name may have, such as U+2028
            lines = list(csv.reader(io.StringIO(text, newline=None)))
        except csv.Error as error:
            raise TwinError(f"{self.path}: is no table: {error}; correct the file, or give a new one") from error
        head = lines[0] if lines else []
        missing = [name for name in _NAMED if name not in head]
        if missing:
            raise TwinError(f"{self.path}:1: the header lacks {', '.join(missing)}: give a new file")
        for name in head:
            if head.count(name) > 1:
                raise TwinError(f"{self.path}:1: two columns are named '{name}'; rename one of them")
        rows = []
        for number, cells in enumerate(lines[1:], 2):
            if not cells:  # a blank line of an editor
                continue
            if len(cells) != len(head):
                raise TwinError(f"{self.path}:{number}: {len(cells)} cells; the header has {len(head)}")
            rows.append(dict(zip(head, cells, strict=True)))
        return list(head), rows

    def _write(self, head: list[str], rows: list[dict[str, str]]) -> None:
        text = io.StringIO()
        writer = csv.DictWriter(text, head, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        atomic.write_text(self.path, text.getvalue())


def _number(row: Mapping[str, str], path: Path) -> int:
    """Return the number of the trial of a row; 0: the trial is not made yet."""
    cell = row[TRIAL].strip()
    if not cell:
        return 0
    try:
        return int(cell)
    except ValueError:
        raise TwinError(f"{path}: the number of a trial is '{cell}'; give a whole number") from None
