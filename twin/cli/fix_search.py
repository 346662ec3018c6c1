"""Search for a few seconds for the edit that fixes a disagreement, as in `twin explain`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from twin.core.errors import TwinError
from twin.core.progress import Progress

if TYPE_CHECKING:
    from twin.api.robot import Robot
    from twin.validation.explain.explanation import Explanation
    from twin.validation.explain.explanation_data import Reading
    from twin.validation.result import Report

SEARCH_SECONDS = 5.0
"""Time limit in s of the search for a fix; `twin explain` can search longer.

See `Deadline`.
"""

_SEARCH_SHARE = 0.6
"""Fraction of `SEARCH_SECONDS` for the search itself; the rest of the time is for poses and checks."""


class _LateError(BaseException):
    """Exception that stops a search; a `BaseException`, so that the search does not treat it as an error of an edit."""


class FixSearch:
    """Search for fixes of a robot's equations, which remembers them: a fix depends on variants and trocars alone."""

    def __init__(self, robot: Robot, seconds: float = SEARCH_SECONDS) -> None:
        self.robot = robot
        self.seconds = seconds
        self._known: dict[tuple[object, ...], str] = {}

    def with_fix(self, report: Report, protocol: str | Path | None, progress: Progress) -> Report:
        """Add a fix to a report if the report's first cause is in the equations and a fix is found."""
        causes = report.causes
        # a report shows the fix of its first cause; an edit of equations fixes no other
        if not causes or causes[0].side != "equations" or causes[0].head.severity != "disagreement":
            return report
        robot = self.robot.bound(self.robot.protocol(protocol))
        trocars = [tuple(position) for position in robot.mechanism.trocar_places.values()]
        key = (*sorted(report.variants.items()), *trocars)
        if key not in self._known:
            self._known[key] = self._search(robot, report, progress)
        return replace(report, cure=self._known[key])

    def _search(self, robot: Robot, report: Report, progress: Progress) -> str:
        """Return the text of a fix; "" if none is found in time."""
        from twin.validation.explain.deadline import Deadline
        from twin.validation.explain.explain import ExplainOptions, explain
        from twin.validation.explain.row_deviations import Tolerance

        deadline = Deadline(self.seconds)

        def bounded(label: str, fraction: float) -> None:
            # `explain` limits only its search for edits: its other steps are stopped where they report progress
            if deadline.passed:
                raise _LateError
            progress(f"search for a correction: {label}", fraction)

        kin = robot.kinematics(dict(report.variants))
        try:
            explanation = explain(
                robot.name,
                robot.formula,
                robot.reference(),
                dict(report.variants),
                parameters=kin.parameters,
                options=ExplainOptions(Tolerance(*tolerance(report)), _SEARCH_SHARE * self.seconds, Path.cwd()),
                progress=bounded,
            )
        except (_LateError, TwinError):  # the report is valid without an explanation
            return ""
        return text(explanation, report.commands.get("explain", ""))


def tolerance(report: Report) -> tuple[float, float]:
    """Return the tolerances of a report: (position in m, rotation in rad)."""
    from twin.validation.residual_rows import Tolerances

    tolerances = {"m": Tolerances().position, "rad": Tolerances().rotation}
    for row in report.residuals:
        if row.pair != "A-B" or row.quantity not in ("point", "driven", "passive", "tool"):
            continue
        if row.tolerance and row.unit in tolerances:
            tolerances[row.unit] = row.tolerance
    return tolerances["m"], tolerances["rad"]


def text(explanation: Explanation, command: str) -> str:
    """Return one line of text on the fix of the equation rows that disagree with the mechanism; "" without a fix.

    `command` is a command line that shows details; where necessary, the text refers to this command.
    """
    parts = [*_edits(explanation, command), *_numbers(explanation)]
    for convention in explanation.conventions:
        if convention.message not in parts:  # one convention can change several rows
            parts.append(convention.message)
    if not parts:
        return ""
    if explanation.explained:
        parts.append("every row then agrees")
    else:
        parts.append(f"other rows still disagree, see {command}")
    return "; ".join(parts)


def _edits(explanation: Explanation, command: str) -> list[str]:
    """Return one text for each edit, even if an edit changes several rows; of equivalent edits, only the first."""
    symbols: dict[tuple[str, str, str], list[str]] = {}
    lines: dict[tuple[str, str, str], set[int]] = {}
    ambiguous: set[tuple[str, str, str]] = set()
    for repair in explanation.repairs:
        readings: list[Reading] = []
        for cure in repair.cures:
            readings += cure
        if not readings:
            continue
        first = readings[0]
        equation, _, _ = repair.rows[0].partition(".")
        edit = (equation, first.changes[0].file, _words(first))
        of_edit = symbols.setdefault(edit, [])
        for row in repair.rows:
            _, _, symbol = row.partition(".")
            of_edit.append(symbol)
        lines_of_edit = lines.setdefault(edit, set())
        for change in first.changes:
            lines_of_edit.add(change.line)
        if len(readings) > 1:
            ambiguous.add(edit)
    texts: list[str] = []
    for edit, symbols_of_edit in symbols.items():
        equation, file, replacement = edit
        names = ", ".join(symbols_of_edit)
        line_numbers = ", ".join(map(str, sorted(lines[edit])))
        text = f"in {equation}, {names}: {replacement} ({file}:{line_numbers})"
        if edit in ambiguous:
            text += f" or an equivalent edit, see {command}"
        texts.append(text)
    return texts


_LONGEST_CALL = 60
"""Largest number of characters of a call that is written twice, before and after an edit."""


def _words(reading: Reading) -> str:
    """Return the edits of a reading as orders: "replace a by b", "insert `+ a`" or "delete `2 *`".

    An edit whose place in its line is not clear from these words is given with the call around it, "replace sin(a) by
    sin(-a)".
    """
    if len(reading.changes) == 1:
        with_call = _with_call(reading.changes[0].edit, reading.diff)
        if with_call:
            return with_call
    orders: list[str] = []
    for change in reading.changes:
        old, arrow, new = change.edit.partition(" -> ")
        if arrow:
            orders.append(f"replace {old} by {new}")
        else:
            orders.append(change.edit)
    return " and ".join(orders)


def _with_call(edit: str, diff: str) -> str:
    """Return an edit of one line with the call around it; "" if its own words are clear, or without a short call."""
    removed = []
    added = []
    for line in diff.splitlines():
        if line.startswith(("---", "+++")):  # the names of the files
            continue
        if line.startswith("-"):
            removed.append(line[1:])
        elif line.startswith("+"):
            added.append(line[1:])
    if len(removed) != 1 or len(added) != 1:
        return ""
    old = removed[0]
    new = added[0]
    replaced, arrow, _ = edit.partition(" -> ")
    if arrow and old.count(replaced) == 1:
        return ""
    begin = _common_length(old, new)
    # behind the common beginning, so that the two common parts do not overlap, as in "aa" and "aaa"
    same_at_end = _common_length(old[begin:][::-1], new[begin:][::-1])
    span = _call_around(old, begin, len(old) - same_at_end)
    if span is None:
        return ""
    start, end = span
    return f"replace {old[start:end]} by {new[start : len(new) - (len(old) - end)]}"


def _common_length(first: str, second: str) -> int:
    """Return the number of characters with which both texts begin."""
    count = 0
    for first_character, second_character in zip(first, second, strict=False):
        if first_character != second_character:
            break
        count += 1
    return count


def _call_around(line: str, begin: int, end: int) -> tuple[int, int] | None:
    """Return the range of the innermost call in a line around the range from `begin` to `end`; None: no short one."""
    # to the left up to the opening bracket that is not closed before the range, then the same to the right
    depth = 0
    start = begin - 1
    while start >= 0 and not (line[start] == "(" and depth == 0):
        depth += {")": 1, "(": -1}.get(line[start], 0)
        start -= 1
    depth = 0
    stop = end
    while stop < len(line) and not (line[stop] == ")" and depth == 0):
        depth += {"(": 1, ")": -1}.get(line[stop], 0)
        stop += 1
    if start < 0 or stop == len(line):
        return None
    # the name of the function before the bracket, as in np.linalg.norm(
    while start > 0 and (line[start - 1].isalnum() or line[start - 1] in "._"):
        start -= 1
    if stop + 1 - start > _LONGEST_CALL:
        return None
    return start, stop + 1


def _numbers(explanation: Explanation) -> list[str]:
    """Return one text on the numbers of the equations that differ from those of the mechanism; [] without any."""
    fit = explanation.identified
    if fit is None or not fit.exact or not fit.moved:  # a fit that is only close would hide another fault
        return []
    values: list[str] = []
    for number in fit.moved:
        old = f"{number.formula:.9g} {number.unit}"
        new = f"{number.fitted:.9g} {number.unit}"
        value = f"{number.name} = {new} instead of {old}"
        if number.note:
            value += f" ({number.note})"
        values.append(value)
    conjunction = " or " if fit.alternatives else ", "
    texts = conjunction.join(values)
    return [f"set {texts}"]
