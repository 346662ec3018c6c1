"""Search for a few seconds for the edit that fixes a disagreement, as in `twin explain`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from twin.core.errors import TwinError

if TYPE_CHECKING:
    from twin.api.robot import Robot
    from twin.validation.explain.result import Explanation, Reading
    from twin.validation.result import Report

SECONDS = 5.0
"""Time limit in s of the search for a fix; `twin explain` can search longer.

See `Deadline`.
"""

_SEARCH = 0.6
"""Fraction of `SECONDS` for the search itself; the rest of the time is for poses and checks."""

Progress = Callable[[str, float], None]


class _LateError(BaseException):
    """Exception that stops a search; a `BaseException`, so that the search does not treat it as an error of an edit."""


class Cures:
    """Cache of the fixes of a robot's equations; a fix depends only on the variants and the trocar positions."""

    def __init__(self, robot: Robot, seconds: float = SECONDS) -> None:
        self.robot, self.seconds = robot, seconds
        self._known: dict[tuple[object, ...], str] = {}

    def of(self, report: Report, protocol: str | Path | None, progress: Progress) -> Report:
        """Add a fix to a report if the report's first cause is in the equations and a fix is found."""
        causes = report.causes
        if not causes or causes[0].side != "equations" or causes[0].head.severity != "disagreement":
            return report
        robot = self.robot.bound(self.robot.protocol(protocol))
        key = (*sorted(report.variants.items()), *(tuple(p) for p in robot.mechanism.trocar_places.values()))
        if key not in self._known:
            self._known[key] = self._look(robot, report, progress)
        return replace(report, cure=self._known[key])

    def _look(self, robot: Robot, report: Report, progress: Progress) -> str:
        from twin.validation.explain.deadline import Deadline
        from twin.validation.explain.explain import explain
        from twin.validation.explain.judge import Tolerance

        deadline = Deadline(self.seconds)

        def bounded(label: str, fraction: float) -> None:
            if deadline.passed:
                raise _LateError
            progress(f"search for a correction: {label}", fraction)

        kin = robot.kinematics(dict(report.variants))
        try:
            found = explain(
                robot.name,
                robot.formula,
                robot.reference(),
                dict(report.variants),
                parameters=kin.parameters,
                tolerance=Tolerance(*tolerance(report)),
                progress=bounded,
                budget=_SEARCH * self.seconds,
                root=Path.cwd(),
            )
        except (_LateError, TwinError):  # the report is valid without an explanation
            return ""
        return text(found, report.commands.get("explain", ""))


def tolerance(report: Report) -> tuple[float, float]:
    """Return the tolerances of a report: (position in m, rotation in rad)."""
    from twin.validation.rows import Tolerances

    judged = [r for r in report.residuals if r.pair == "A-B" and r.quantity in ("point", "driven", "passive", "tool")]
    default = {"m": Tolerances().position, "rad": Tolerances().rotation}
    used = default | {r.unit: r.tolerance for r in judged if r.tolerance and r.unit in default}
    return used["m"], used["rad"]


def text(found: Explanation, command: str) -> str:
    """Return one line of text on the fix of the equation rows that disagree with the mechanism; "" without a fix.

    `command` is a command line that shows details; where necessary, the text refers to this command.
    """
    parts = [*_edits(found, command), *_numbers(found), *dict.fromkeys(c.message for c in found.conventions)]
    if not parts:
        return ""
    rest = "every row then agrees" if found.explained else f"other rows still disagree, see {command}"
    return f"{'; '.join(parts)}; {rest}"


def _edits(found: Explanation, command: str) -> list[str]:
    """Return one text for each edit, even if an edit changes several rows; of equivalent edits, only the first."""
    rows: dict[tuple[str, ...], list[str]] = {}
    lines: dict[tuple[str, ...], set[int]] = {}
    tied: set[tuple[str, ...]] = set()
    for repair in found.repairs:
        readings = [r for cure in repair.cures for r in cure]
        if not readings:
            continue
        first = readings[0]
        key = (repair.rows[0].partition(".")[0], first.changes[0].file, _words(first))
        rows.setdefault(key, []).extend(r.partition(".")[2] for r in repair.rows)
        lines.setdefault(key, set()).update(c.line for c in first.changes)
        tied |= {key} if len(readings) > 1 else set()
    return [
        f"in {key[0]}, {', '.join(symbols)}: replace {key[2]} ({key[1]}:{', '.join(map(str, sorted(lines[key])))})"
        + (f" or an equivalent edit, see {command}" if key in tied else "")
        for key, symbols in rows.items()
    ]


def _words(reading: Reading) -> str:
    return " and ".join(c.edit.replace(" -> ", " by ") for c in reading.changes)


def _numbers(found: Explanation) -> list[str]:
    fit = found.identified
    if fit is None or not fit.exact or not fit.moved:
        return []
    values = [f"{m.name} = {m.fitted:.9g} {m.unit} instead of {m.formula:.9g} {m.unit}" for m in fit.moved]
    return [f"set {(' or ' if fit.alternatives else ', ').join(values)}"]
