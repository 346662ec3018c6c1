"""Check published material: tables from their printed rows, stated masses, equations of a surgeon's console."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from twin.api.robot import Progress, Robot, loaded, silent
from twin.core import assets
from twin.core.errors import TwinError, unknown
from twin.core.findings import Finding, by_severity, verdict
from twin.core.json_types import JsonObject
from twin.core.result import Part, Result, TextTable

if TYPE_CHECKING:
    from twin.validation.closed_form import JudgedForm
    from twin.validation.console_result import Contract
    from twin.validation.group_tables import GroupTables
    from twin.validation.groups import Recomputed
    from twin.validation.masses.mass_sources import MassSource
    from twin.validation.masses.physical_limits import JudgedInertia

_NEXT = "compare the numbers below with the document; if the document prints them, also cite the recomputed numbers"


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
            return _NEXT
        return ""

    def content(self) -> JsonObject:
        """Return the suggestion and the recomputed tables as plain data."""
        return {"what_to_do": self.what_to_do, **self.data}

    def text(self) -> Iterator[Part]:
        """Yield the verdict and the suggestion, the tables, and the findings."""
        disagreements = [finding for finding in self.findings if finding.severity == "disagreement"]
        count = len(disagreements)
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
        from twin.validation.ranks import compare

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
        if _grouped(path):
            printed, recomputed = _groups(path)
            findings += recomputed.findings
            data.append({"title": printed.title, "source": printed.source, **recomputed.data})
            titles.append((printed.title, printed.source))
            for _ in recomputed.tables[1:]:
                titles.append(("", ""))  # of the same document as the table before
            tables += recomputed.tables
            continue
        printed = study.load(path)
        rows, found = study.recompute(printed)
        findings += found
        data.append({"title": printed.title, "source": printed.source, "rows": [row.as_dict() for row in rows]})
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


def _grouped(path: Path) -> bool:
    """Return whether a study file compares independent groups; False for a malformed file, which the loader rejects."""
    import tomllib

    try:
        text = path.read_text("utf-8")
        return "group" in tomllib.loads(text)
    except (OSError, ValueError, RecursionError):
        return False


def _groups(path: Path) -> tuple[GroupTables, Recomputed]:
    from twin.core.units import DEG, MM
    from twin.simulation.controllers.console_equations import console as the_console
    from twin.validation import accuracy, group_tables, groups

    printed = group_tables.load(path)
    recomputed = groups.recompute(
        printed,
        lambda c: accuracy.measure(the_console(), c.displacements, c.resolution_mm * MM),
        lambda c: accuracy.measure_angles(the_console(), c.rotations, c.resolution_deg * DEG),
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
        masses = (f"{row.mass_printed:.3f}", f"{row.mass_negated:.3f}")
        lines.append((row.name, definite, f"{row.slack:.2g}", *masses))
        sum_printed += row.mass_printed
        sum_negated += row.mass_negated
    lines.append(("sum", "", "", f"{sum_printed:.2f}", f"{sum_negated:.2f}"))
    head = ("row", "positive definite", "triangle slack", "minimum mass [kg], as printed", "products negated")
    data = {"title": exhibit.title, "source": exhibit.source, "rows": [row.as_dict() for row in rows]}
    title = (exhibit.title, exhibit.source)
    table = TextTable(head, lines)
    return Study("the printed masses and inertias", (title,), (table,), data, tuple(findings))


@dataclass(frozen=True)
class Masses(Result):
    """Masses stated in a robot's CAD, stage and tables, and whether these masses are physically possible.

    Attributes:
        sources: the sources, each with its bodies and findings.
    """

    robot: str
    sources: tuple[MassSource, ...]

    kind = "inertia"

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on physically impossible and implausible masses."""
        findings: list[Finding] = []
        for source in self.sources:
            findings += source.all_findings
        return tuple(findings)

    def content(self) -> JsonObject:
        """Return the robot's name, and the bodies of each source, as plain data."""
        data = []
        for source in self.sources:
            bodies = [body.as_dict() for body in source.bodies]
            data.append({"title": source.title, "bodies": bodies})
        return {"name": self.robot, "sources": data}

    def text(self) -> Iterator[Part]:
        """Yield a table and the findings of each source."""
        for source in self.sources:
            yield f"{self.robot}: {source.title}"
            rows = [_body_row(body) for body in source.bodies]
            least = 0.0
            stated = 0.0
            for body in source.bodies:
                least += body.least
                stated += body.mass or 0.0
            sum_stated = "-"
            if stated:
                sum_stated = f"{stated:.4g}"
            rows.append(("sum", sum_stated, f"{least:.4g}", "", "", "", "", ""))
            head = (
                "body",
                "mass kg",
                "minimum kg",
                "triangle slack kg m2",
                "eigenvalue ratio",
                "kg/m3",
                "mass centre",
                "",
            )
            yield TextTable(head, rows)
            yield ""
            yield from by_severity(source.all_findings)
            if source.all_findings:
                yield ""


def _body_row(body: JudgedInertia) -> tuple[str, ...]:
    """Return the texts of one row of the table of bodies; "-" for what is not stated or not known."""
    mass = "-"
    if body.mass is not None:
        mass = f"{body.mass:.4g}"
    density = "-"
    if not math.isnan(body.density):
        density = f"{body.density:.0f}"
    if math.isnan(body.outside):
        centre = "-"
    elif body.outside == 0:
        centre = "inside"
    else:
        outside_mm = 1e3 * body.outside
        centre = f"{outside_mm:.1f} mm outside"
    if not body.findings:
        note = ""
    elif verdict(body.findings) == "agree":
        note = "warning"
    else:
        note = "FAILED"
    return (body.name, mass, f"{body.least:.4g}", f"{body.slack:.3g}", f"{body.definite:.1e}", density, centre, note)


def masses(robot: Robot | str | Path, progress: Progress = silent) -> Masses:
    """Check the masses and inertias stated in a robot's CAD, stage and tables.

    Raises:
        TwinError: no mass is stated anywhere.

    Examples:
        >>> import twin
        >>> twin.masses("hibou").verdict
        'agree'
    """
    from twin.validation.masses import mass_sources

    robot = loaded(robot)

    sources = []
    progress("compute masses", 0.0)
    if robot.files is None:
        sources.append(mass_sources.of_mechanism(robot.mechanism, "stage"))
    else:
        cad = robot.weighed().cad
        weighed = cad.mechanism
        computed = mass_sources.of_mechanism(weighed, "computed from the CAD")
        # why a body of the CAD has no mass
        reasons = [finding for finding in cad.findings if finding.code in ("cad.open_mesh", "cad.no_material")]
        sources.append(replace(computed, findings=(*computed.findings, *reasons)))
        if robot.files.stage.is_file():
            from twin.usd.read import read_stage

            progress("USD stage", 0.0)
            on_stage = read_stage(robot.files.stage)
            sources.append(mass_sources.of_mechanism(on_stage, f"stage {robot.files.stage.name}"))
        if (robot.files.cad / "inertia.toml").is_file():
            sources.append(mass_sources.of_table(robot.files.cad, weighed))
        exhibit = robot.files.cad / "exhibit.toml"
        if exhibit.is_file():
            sources.append(mass_sources.of_exhibit(exhibit))
    if not any(source.bodies for source in sources):
        raise TwinError(f"{robot.name}: no mass is stated; give materials with densities, or an inertia.toml")
    return Masses(robot.name, tuple(sources))


@dataclass(frozen=True)
class PublishedMotion(Result):
    """Published equations of motion, compared with the dynamics of the mechanism.

    Attributes:
        source: document of the equations.
        states: number of random states.
        judged: row of each compared term, cause of the differences, and findings.
    """

    robot: str
    source: str
    states: int
    judged: JudgedForm

    kind = "motion"

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on terms that differ between equations and mechanism, and on properties that are violated."""
        return tuple(self.judged.findings)

    def content(self) -> JsonObject:
        """Return the compared rows, the cause of the differences, and the violated properties, as plain data."""
        rows = []
        for row in self.judged.rows:
            rows.append({"term": row.term, "worst": row.worst, "unit": row.unit, "limit": row.limit})
        return {
            "name": self.robot,
            "source": self.source,
            "states": self.states,
            "cause": self.judged.cause,
            "rows": rows,
            "power_balance": self.judged.balance,
            "smallest_eigenvalue": self.judged.least,
        }

    def text(self) -> Iterator[Part]:
        """Yield a row for each compared term, the findings, the cause of the differences, and the verdict."""
        judged = self.judged
        yield f"{self.robot}: equations of motion against the mechanism, {self.states} random states"
        yield f"  {self.source}\n"
        rows = []
        for row in judged.rows:
            outcome = "DIFFERS"
            if row.agrees:
                outcome = "ok"
            rows.append((row.term, f"{row.worst:.2e} {row.unit}", f"{row.limit:g}", outcome))
        yield TextTable(("term", "largest difference", "limit", ""), rows)
        yield f"\n  power balance {judged.balance:.1e} (relative); smallest eigenvalue of M {judged.least:.3g}\n"
        yield from by_severity(self.findings)
        if judged.cause:
            yield f"  one edit explains all differences: {judged.cause}"
        yield self.word


def equations_of_motion(robot: Robot | str | Path, states: int = 200) -> PublishedMotion:
    """Compare a robot's published equations of motion with the dynamics of its mechanism.

    The masses are those of inertia.toml; the comparison uses `states` random states.

    Raises:
        TwinError: the robot has no published equations of motion, or no masses.

    Examples:
        >>> import twin
        >>> twin.equations_of_motion("raven_left", states=20).verdict
        'agree'
    """
    from twin.reference import inertia
    from twin.simulation.dynamics.arm import arm
    from twin.validation.closed_form import judge

    robot = loaded(robot)
    form = robot.formula.motion
    if form is None or robot.files is None:
        raise TwinError(
            f"{robot.name} has no published equations of motion; of the built-in robots, raven_left and raven_right do"
        )
    masses_of_bodies = inertia.of_robot(robot.files.cad)
    dynamics = arm(robot.mechanism, masses_of_bodies).dynamics()
    judged = judge(form, dynamics, states)
    return PublishedMotion(robot.name, form.source, states, judged)


def console(
    name: str = "davinci", variants: str | Mapping[str, str] | None = None, progress: Progress = silent
) -> Contract:
    """Check the published equations of a surgeon's console, separately for each clause (requirement).

    `variants` is one variant for all equations ("paper", "conjugate", "decoupled"), or {equation: variant}.

    Raises:
        TwinError: there is no such console, equation or variant.

    Examples:
        >>> import twin
        >>> twin.console("davinci", "paper").verdict
        'disagree'
    """
    from twin.simulation.controllers import console_equations as equations
    from twin.validation.console_clauses import judge

    if name != "davinci":
        raise TwinError(unknown("console", name, ("davinci",)))
    if isinstance(variants, str):
        if variants not in equations.READINGS:
            raise TwinError(f"--variant: {unknown('variant', variants, equations.READINGS)}")
        variants = equations.READINGS[variants]
    return judge(equations.console(variants), progress)
