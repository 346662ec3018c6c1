"""Check whether the masses stated in a robot's CAD, stage and tables are physically possible."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from twin.api.robot import Robot
from twin.api.robot_loading import loaded
from twin.core.errors import TwinError
from twin.core.findings import Finding, by_severity, verdict
from twin.core.json_types import JsonObject
from twin.core.progress import Progress, silent
from twin.core.result import Part, Result, TextTable

if TYPE_CHECKING:
    from twin.validation.masses.mass_sources import MassSource
    from twin.validation.masses.physical_limits import JudgedInertia


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
            rows = []
            minimum_mass = 0.0
            stated_mass = 0.0
            for body in source.bodies:
                rows.append(_body_row(body))
                minimum_mass += body.least
                stated_mass += body.mass or 0.0
            sum_stated = "-"
            if stated_mass:
                sum_stated = f"{stated_mass:.4g}"
            rows.append(("sum", sum_stated, f"{minimum_mass:.4g}", "", "", "", "", ""))
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


_REASONS_WITHOUT_MASS = ("cad.open_mesh", "cad.inverted_mesh", "cad.no_material")
"""Codes of findings on the CAD that say why a body has no mass."""


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
    if robot.files is None:  # the stage or file is the only source: there is no CAD to weigh
        sources.append(mass_sources.of_mechanism(robot.mechanism, "stage"))
    else:
        cad = robot.weighed().cad
        weighed = cad.mechanism
        computed = mass_sources.of_mechanism(weighed, "computed from the CAD")
        reasons = []
        for finding in cad.findings:
            if finding.code in _REASONS_WITHOUT_MASS:
                reasons.append(finding)
        sources.append(replace(computed, findings=(*computed.findings, *reasons)))
        if robot.files.stage.is_file():
            from twin.usd.read import read_stage

            progress("USD stage", 0.0)
            on_stage = read_stage(robot.files.stage)
            sources.append(mass_sources.of_mechanism(on_stage, f"stage {robot.files.stage.name}"))
        # a table states masses without shapes: its bodies are judged with the shapes of the CAD
        if (robot.files.cad / "inertia.toml").is_file():
            sources.append(mass_sources.of_table(robot.files.cad, weighed))
        exhibit = robot.files.cad / "exhibit.toml"
        if exhibit.is_file():
            sources.append(mass_sources.of_exhibit(exhibit))
    has_masses = any(source.bodies for source in sources)
    if not has_masses:
        raise TwinError(f"{robot.name}: no mass is stated; give materials with densities, or an inertia.toml")
    return Masses(robot.name, tuple(sources))
