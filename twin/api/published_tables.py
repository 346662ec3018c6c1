"""Recompute published tables from their printed rows, and say which of their values do not follow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from twin.api.robot import Robot
from twin.api.robot_loading import loaded
from twin.core import assets
from twin.core.errors import TwinError
from twin.core.findings import Finding, by_severity
from twin.core.json_types import JsonObject
from twin.core.result import Part, Result, TextTable

if TYPE_CHECKING:
    from twin.validation.group_study import CheckedTables
    from twin.validation.group_tables import GroupTables

_ADVICE = "compare the numbers below with the document; if the document prints them, also cite the recomputed numbers"


@dataclass(frozen=True)
class Study(Result):
    """Published tables, recomputed from their printed rows.

    Attributes:
        what: description of the printed values, such as "the printed means, p-values and claims".
        titles: for each table, (title, source) of its document; ("", "") if the table before is of the same document.
        tables: tables of the documents.
        data: the tables as plain data.
        findings: values that do not follow from the printed rows.
    """

    what: str
    titles: tuple[tuple[str, str], ...]
    tables: tuple[TextTable, ...]
    data: JsonObject
    findings: tuple[Finding, ...]

    kind = "study"

    @property
    def what_to_do(self) -> str:
        """What to do about values that do not follow from the printed rows, in one line; "" if all values follow."""
        if self.verdict == "disagree":
            return _ADVICE
        return ""

    def content(self) -> JsonObject:
        """Return the suggestion and the recomputed tables as plain data."""
        return {"what_to_do": self.what_to_do, **self.data}

    def text(self) -> Iterator[Part]:
        """Yield the verdict and the suggestion, the tables, and the findings."""
        severities = [finding.severity for finding in self.findings]
        count = severities.count("disagreement")
        noun = "inconsistency"
        if count > 1:
            noun = "inconsistencies"
        words = {
            "agree": f"AGREE: {self.what} are consistent",
            "disagree": f"DISAGREE: {count} {noun} in {self.what}",
            "unchecked": f"UNCHECKED: some of {self.what} could not be checked",
        }
        yield f"  {words[self.verdict]} (exit code {self.exit_code})"
        if self.what_to_do:
            yield f"  WHAT TO DO: {self.what_to_do}"
        yield ""
        for (title, source), table in zip(self.titles, self.tables, strict=True):
            if title:
                yield f"{title}\n  {source}\n"
            yield table
            yield ""
        yield from by_severity(self.findings)


def study(source: Robot | str | Path) -> Result:
    """Recompute the published tables of a robot, a console or a study file, or compare groups of users.

    `source` is a robot (or the name or folder of a robot), the name of a study, or the path of a study file (.toml) or
    of a table of users (.csv with a column `group`).

    Raises:
        TwinError: there is nothing to recompute, or a file is malformed.

    Examples:
        >>> import twin
        >>> twin.study("sher").verdict
        'disagree'
    """
    if isinstance(source, Robot):
        return _study_of_robot(source)
    path = Path(source)
    if path.suffix == ".toml":
        return _users([path])
    if path.suffix == ".csv":
        from twin.validation.rank_tests import compare

        return compare(path)
    # studies of what is not a robot, such as a console
    study_files = assets.studies(str(source))
    if study_files:
        return _users(study_files)
    robot = loaded(source)
    return _study_of_robot(robot)


def _study_of_robot(robot: Robot) -> Study:
    """Recompute the study files of a robot or, if it has none, its published inertia tables."""
    if robot.files is not None:
        folder = robot.files.trajectories / "study"
        study_files = sorted(folder.glob("*.toml"))
        if study_files:
            return _users(study_files)
        exhibit = robot.files.cad / "exhibit.toml"
        if exhibit.is_file():
            return _inertias(exhibit)
    raise TwinError(
        f"{robot.name} has no study file and no published inertia tables (cad/exhibit.toml); give the path "
        "of a study file"
    )


def _users(paths: Sequence[Path]) -> Study:
    from twin.validation import study

    titles: list[tuple[str, str]] = []
    tables: list[TextTable] = []
    data: list[JsonObject] = []
    findings: list[Finding] = []
    for path in paths:
        if _has_groups(path):
            printed, recomputed = _recomputed_groups(path)
            findings += recomputed.findings
            data.append({"title": printed.title, "source": printed.source, **recomputed.data})
            titles.append((printed.title, printed.source))
            for _ in recomputed.tables[1:]:
                titles.append(("", ""))  # of the same document as the table before
            tables += recomputed.tables
            continue
        printed = study.load(path)
        rows, findings_of_file = study.recompute(printed)
        findings += findings_of_file
        rows_as_data = [row.as_dict() for row in rows]
        data.append({"title": printed.title, "source": printed.source, "rows": rows_as_data})
        titles.append((printed.title, printed.source))
        lines = []
        for row in rows:
            agreeing_test = row.test()
            for test, p in row.tests.items():
                note = ""
                if test == agreeing_test:
                    note = "agrees with the printed p"
                lines.append((row.name, f"{row.printed_p:.2f}", f"{p:.3f}", test, note))
        tables.append(TextTable(("", "printed p", "p", "test", ""), lines))
    what = "the printed means, p-values and claims"
    return Study(what, tuple(titles), tuple(tables), {"studies": data}, tuple(findings))


def _has_groups(path: Path) -> bool:
    """Return whether a study file compares independent groups; False for a malformed file, which the loader rejects."""
    import tomllib

    try:
        text = path.read_text("utf-8")
        return "group" in tomllib.loads(text)
    except (OSError, ValueError, RecursionError):
        return False


def _recomputed_groups(path: Path) -> tuple[GroupTables, CheckedTables]:
    """Return the printed tables of independent groups, and what follows from their rows."""
    from twin.core.units import DEG, MM
    from twin.simulation.controllers.console_equations import console as console_with
    from twin.validation import group_study, group_tables, simulated_accuracy

    # `validation` knows no console: it gets functions that measure one with the published equations
    printed = group_tables.load(path)
    recomputed = group_study.check_tables(
        printed,
        lambda claim: simulated_accuracy.measure(console_with(), claim.displacements, claim.resolution_mm * MM),
        lambda claim: simulated_accuracy.measure_angles(console_with(), claim.rotations, claim.resolution_deg * DEG),
    )
    return printed, recomputed


def _inertias(path: Path) -> Study:
    from twin.validation.masses import published_moments

    exhibit = published_moments.load(path)
    rows, findings = published_moments.recompute(exhibit)
    lines = []
    sum_printed = 0.0
    sum_negated = 0.0
    for row in rows:
        definite = "NO"
        if row.definite:
            definite = "yes"
        # CAD programs print products of inertia with one sign or the other: both readings are shown
        masses = (f"{row.mass_printed:.3f}", f"{row.mass_negated:.3f}")
        lines.append((row.name, definite, f"{row.slack:.2g}", *masses))
        sum_printed += row.mass_printed
        sum_negated += row.mass_negated
    lines.append(("sum", "", "", f"{sum_printed:.2f}", f"{sum_negated:.2f}"))
    head = ("row", "positive definite", "triangle slack", "minimum mass [kg], as printed", "products negated")
    rows_as_data = [row.as_dict() for row in rows]
    data = {"title": exhibit.title, "source": exhibit.source, "rows": rows_as_data}
    title = (exhibit.title, exhibit.source)
    table = TextTable(head, lines)
    return Study("the printed masses and inertias", (title,), (table,), data, tuple(findings))
