"""Check published material: tables from their printed rows, stated masses, equations of a surgeon's console."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from twin.api.robot import Progress, Robot, load, silent
from twin.core import assets
from twin.core.errors import TwinError, unknown
from twin.core.findings import Finding, by_severity, verdict
from twin.core.json_types import JsonObject
from twin.core.result import Part, Result, Table

if TYPE_CHECKING:
    from twin.validation.clauses import Contract
    from twin.validation.closed_form import JudgedForm
    from twin.validation.groups import GroupTables, Recomputed
    from twin.validation.masses.collect import MassSource

_NEXT = "compare the numbers above with the document; if the document prints them, also cite the recomputed numbers"


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
    tables: tuple[Table, ...]
    data: JsonObject
    findings: tuple[Finding, ...]

    kind = "study"

    @property
    def what_to_do(self) -> str:
        """What to do about values that do not follow from the printed rows, in one line; "" if all values follow."""
        return _NEXT if self.verdict == "disagree" else ""

    def content(self) -> JsonObject:
        """Return the suggestion and the recomputed tables as plain data."""
        return {"what_to_do": self.what_to_do, **self.data}

    def text(self) -> Iterator[Part]:
        """Yield the tables, the findings, the verdict and the suggestion."""
        for (title, source), table in zip(self.titles, self.tables, strict=True):
            if title:
                yield f"{title}\n  {source}\n"
            yield table
            yield ""
        yield from by_severity(self.findings)
        n = sum(f.severity == "disagreement" for f in self.findings)
        words = {
            "agree": f"AGREE: {self.what} are consistent",
            "disagree": f"DISAGREE: {n} {'inconsistencies' if n > 1 else 'inconsistency'} in {self.what}",
            "unchecked": f"UNCHECKED: some of {self.what} could not be checked",
        }
        yield f"\n  {words[self.verdict]} (exit code {self.exit_code})"
        if self.what_to_do:
            yield f"  what to do: {self.what_to_do}"


def study(source: Robot | str | Path) -> Result:
    """Recompute the published tables of a robot, a console or a study file, or compare groups of users.

    `source` is a robot (or the name or folder of a robot), the name of a study, or the path of a study file (.toml) or
    of a table of users (.csv with a column `group`).

    Raises:
        TwinError: there is nothing to recompute, or a file is malformed.
    """
    if not isinstance(source, Robot) and Path(source).suffix == ".toml":
        return _users([Path(source)])
    if not isinstance(source, Robot) and Path(source).suffix == ".csv":
        from twin.validation.ranks import compare

        return compare(Path(source))
    if not isinstance(source, Robot) and (paths := assets.studies(str(source))):
        return _users(paths)
    robot = source if isinstance(source, Robot) else load(source)
    paths = sorted((robot.files.trajectories / "study").glob("*.toml")) if robot.files is not None else []
    if paths:
        return _users(paths)
    if robot.files is None or not (robot.files.cad / "exhibit.toml").is_file():
        raise TwinError(
            f"{robot.name} has no study file and no published inertia tables (cad/exhibit.toml); give the path "
            "of a study file"
        )
    return _inertias(robot.files.cad / "exhibit.toml")


def _users(paths: Sequence[Path]) -> Study:
    from twin.validation import study

    titles, tables, data, findings = [], [], [], []
    for path in paths:
        if _grouped(path):
            printed, made = _groups(path)
            findings += made.findings
            data.append({"title": printed.title, "source": printed.source, **made.data})
            titles += [(printed.title, printed.source), *(("", "") for _ in made.tables[1:])]
            tables += made.tables
            continue
        printed = study.load(path)
        rows, found = study.recompute(printed)
        findings += found
        data.append({"title": printed.title, "source": printed.source, "rows": [r.as_dict() for r in rows]})
        titles.append((printed.title, printed.source))
        lines = [
            (r.name, f"{r.printed_p:.2f}", f"{p:.3f}", name, "agrees with the printed p" if name == r.test() else "")
            for r in rows
            for name, p in r.tests.items()
        ]
        tables.append(Table(("", "printed p", "p", "test", ""), lines))
    what = "the printed means, p-values and claims"
    return Study(what, tuple(titles), tuple(tables), {"studies": data}, tuple(findings))


def _grouped(path: Path) -> bool:
    """Return whether a study file compares independent groups; False for a malformed file, which the loader rejects."""
    import tomllib

    try:
        return "group" in tomllib.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return False


def _groups(path: Path) -> tuple[GroupTables, Recomputed]:
    from twin.core.units import MM
    from twin.simulation.controllers.console import console as the_console
    from twin.validation import accuracy, groups

    printed = groups.load(path)
    made = groups.recompute(printed, lambda c: accuracy.measure(the_console(), c.displacements, c.resolution_mm * MM))
    return printed, made


def _inertias(path: Path) -> Study:
    from twin.validation.masses import audit

    exhibit = audit.load(path)
    rows, findings = audit.recompute(exhibit)
    lines = [
        (r.name, "yes" if r.definite else "NO", f"{r.slack:.2g}", f"{r.mass_printed:.3f}", f"{r.mass_negated:.3f}")
        for r in rows
    ]
    plain, negated = sum(r.mass_printed for r in rows), sum(r.mass_negated for r in rows)
    lines.append(("sum", "", "", f"{plain:.2f}", f"{negated:.2f}"))
    head = ("row", "positive definite", "triangle slack", "minimum mass [kg], as printed", "products negated")
    data = {"title": exhibit.title, "source": exhibit.source, "rows": [r.as_dict() for r in rows]}
    title = (exhibit.title, exhibit.source)
    return Study("the printed masses and inertias", (title,), (Table(head, lines),), data, tuple(findings))


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
        return tuple(f for s in self.sources for f in s.all_findings)

    def content(self) -> JsonObject:
        """Return the robot's name, and the bodies of each source, as plain data."""
        data = [{"title": s.title, "bodies": [b.as_dict() for b in s.bodies]} for s in self.sources]
        return {"name": self.robot, "sources": data}

    def text(self) -> Iterator[Part]:
        """Yield a table and the findings of each source."""
        for source in self.sources:
            yield f"{self.robot}: {source.title}"
            rows = [
                (
                    b.name,
                    "-" if b.mass is None else f"{b.mass:.4g}",
                    f"{b.least:.4g}",
                    f"{b.slack:.3g}",
                    f"{b.definite:.1e}",
                    "-" if math.isnan(b.density) else f"{b.density:.0f}",
                    "-"
                    if math.isnan(b.outside)
                    else "inside"
                    if b.outside == 0
                    else f"{1e3 * b.outside:.1f} mm outside",
                    "" if not b.findings else "FAILED" if verdict(b.findings) != "agree" else "warning",
                )
                for b in source.bodies
            ]
            least = sum(b.least for b in source.bodies)
            stated = sum(b.mass or 0.0 for b in source.bodies)
            rows.append(("sum", f"{stated:.4g}" if stated else "-", f"{least:.4g}", "", "", "", "", ""))
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
            yield Table(head, rows)
            yield ""
            yield from by_severity(source.all_findings)
            if source.all_findings:
                yield ""


def masses(robot: Robot, progress: Progress = silent) -> Masses:
    """Check the masses and inertias stated in a robot's CAD, stage and tables.

    Raises:
        TwinError: no mass is stated anywhere.
    """
    from twin.validation.masses import collect

    sources = []
    progress("compute masses", 0.0)
    if robot.files is None:
        sources.append(collect.of_mechanism(robot.mechanism, "stage"))
    else:
        cad = robot.weighed().cad
        weighed = cad.mechanism
        computed = collect.of_mechanism(weighed, "computed from the CAD")
        reasons = tuple(f for f in cad.findings if f.code in ("cad.open_mesh", "cad.no_material"))
        sources.append(replace(computed, findings=(*computed.findings, *reasons)))
        if robot.files.stage.is_file():
            from twin.usd.read import read_stage

            progress("USD stage", 0.0)
            sources.append(collect.of_mechanism(read_stage(robot.files.stage), f"stage {robot.files.stage.name}"))
        if (robot.files.cad / "inertia.toml").is_file():
            sources.append(collect.of_table(robot.files.cad, weighed))
        if (robot.files.cad / "exhibit.toml").is_file():
            sources.append(collect.of_exhibit(robot.files.cad / "exhibit.toml"))
    if not any(s.bodies for s in sources):
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
        j = self.judged
        rows = [{"term": r.term, "worst": r.worst, "unit": r.unit, "limit": r.limit} for r in j.rows]
        about = {"name": self.robot, "source": self.source, "states": self.states, "cause": j.cause}
        return {**about, "rows": rows, "power_balance": j.balance, "smallest_eigenvalue": j.least}

    def text(self) -> Iterator[Part]:
        """Yield a row for each compared term, the findings, the cause of the differences, and the verdict."""
        j = self.judged
        yield f"{self.robot}: equations of motion against the mechanism, {self.states} random states"
        yield f"  {self.source}\n"
        yield Table(
            ("term", "largest difference", "limit", ""),
            [(r.term, f"{r.worst:.2e} {r.unit}", f"{r.limit:g}", "ok" if r.agrees else "DIFFERS") for r in j.rows],
        )
        yield f"\n  power balance {j.balance:.1e} (relative); smallest eigenvalue of M {j.least:.3g}\n"
        yield from by_severity(self.findings)
        if j.cause:
            yield f"  one edit explains all differences: {j.cause}"
        yield self.word


def equations_of_motion(robot: Robot, states: int = 200) -> PublishedMotion:
    """Compare a robot's published equations of motion with the dynamics of its mechanism.

    The masses are those of inertia.toml; the comparison uses `states` random states.

    Raises:
        TwinError: the robot has no published equations of motion, or no masses.
    """
    from twin.reference import inertia
    from twin.simulation.dynamics.arm import arm
    from twin.validation.closed_form import judge

    form = robot.formula.motion if robot.formula is not None else None
    if form is None or robot.files is None:
        raise TwinError(
            f"{robot.name} has no published equations of motion; of the built-in robots, raven_left and raven_right do"
        )
    dynamics = arm(robot.mechanism, inertia.of_robot(robot.files.cad)).dynamics()
    return PublishedMotion(robot.name, form.source, states, judge(form, dynamics, states))


def console(
    name: str = "davinci", variants: str | Mapping[str, str] | None = None, progress: Progress = silent
) -> Contract:
    """Check the published equations of a surgeon's console, separately for each clause (requirement).

    `variants` is one variant for all equations ("paper", "conjugate", "decoupled"), or {equation: variant}.

    Raises:
        TwinError: there is no such console, equation or variant.
    """
    from twin.simulation.controllers import console as equations
    from twin.validation.console import judge

    if name != "davinci":
        raise TwinError(unknown("console", name, ("davinci",)))
    if isinstance(variants, str):
        if variants not in equations.READINGS:
            raise TwinError(f"--variant: {unknown('variant', variants, equations.READINGS)}")
        variants = equations.READINGS[variants]
    return judge(equations.console(variants), progress)
