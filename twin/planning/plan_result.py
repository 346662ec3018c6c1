"""Result of planning: the phases, the findings of the check, and files with the samples."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding, by_severity
from twin.core.format import quantity
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.result import Part, Result, TextTable, as_json
from twin.core.units import MM, display_unit
from twin.planning.rounds import SearchRounds
from twin.planning.space import PathCertificate
from twin.planning.trajectory import Trajectory

FILES = ("trajectory.csv", "trajectory.json")
"""Names of the files that `Planned.write` makes: the samples, and the content without them."""


@dataclass(frozen=True)
class Planned(Result):
    """A planned and checked trajectory.

    Attributes:
        trajectory: the trajectory.
    """

    kind: ClassVar[str] = "plan"
    trajectory: Trajectory

    @property
    def findings(self) -> Sequence[Finding]:
        """Findings of the check of every sample."""
        return self.trajectory.findings

    @property
    def rounds(self) -> Mapping[str, SearchRounds]:
        """{name of the phase: rounds of the search for its path}; phases without a search are missing."""
        rounds_of = {}
        for span in self.trajectory.phases:
            if span.rounds is not None:
                rounds_of[span.name] = span.rounds
        return rounds_of

    def content(self) -> JsonMapping:
        """Return the trajectory as plain data, without its samples."""
        return self.trajectory.as_dict(arrays=False)

    def as_dict(self) -> JsonObject:
        """Return plain data for JSON, with search times; files omit search times, which differ between runs."""
        search_times = {name: rounds.times() for name, rounds in self.rounds.items()}
        return {**super().as_dict(), "search_times": search_times}

    def text(self) -> Iterator[Part]:
        """Yield the phases and the findings."""
        trajectory = self.trajectory
        size = f"{trajectory.duration:.3f} s, {len(trajectory.t)} samples"
        yield f"{trajectory.robot} · {trajectory.protocol} · {size}\n"
        rows = []
        for span in trajectory.phases:
            start = f"{span.t0:.3f}"
            end = f"{span.t1:.3f}"
            solver = span.solver or "given"
            rows.append((span.name, span.type, start, end, span.waypoint or "", span.rcm_mode or "", solver))
        yield TextTable(("phase", "type", "from s", "to s", "ends at", "RCM", "timing"), rows)
        yield ""
        for table in self.tables():
            yield table
            yield ""
        yield from by_severity(self.findings)
        yield ""

    def tables(self) -> Iterator[TextTable]:
        """Yield the rounds of the searches, if there are any."""
        if self.rounds:
            yield searches(self.rounds)

    def write(self, folder: Path) -> None:
        """Write two files: the samples as CSV, and the trajectory without its samples as JSON."""
        table, content = FILES
        _write_csv(self.trajectory, folder / table)
        (folder / content).write_text(as_json(self.content()), encoding="utf-8")


def clearance_findings(certificate: PathCertificate, phase: str, who: str = "", scene: str = "") -> list[Finding]:
    """Return one finding with the proven clearance of a phase; an empty list if no pair of bodies is tested.

    Args:
        certificate: the certificate of the path of the phase.
        phase: name of the phase.
        who: names of the robots, if there are several.
        scene: name of the scene; "" without one.
    """
    if not np.isfinite(certificate.found):
        return []
    exceptions = [
        "bodies connected by a joint",
        "bodies of one robot that in the CAD are nearer than twice the required clearance",
    ]
    bodies = "all bodies"
    if who:
        bodies += f" of {who}"
    others = "each other"
    if scene:
        others += " and from the scene"
        exceptions.append(f"bodies that touch by design (`touching` of scene {scene})")
    excepted = ", ".join(exceptions[:-1]) + " and " + exceptions[-1]
    text = (
        f"{bodies} keep at least {certificate.proven / MM:.2f} mm from {others} at every moment and with any timing "
        f"(proven), except {excepted}; the smallest distance found is {certificate.found / MM:.2f} mm, between "
        f"{' and '.join(certificate.bodies)}"
    )
    return [Finding("clearance.proven", "info", text, phase, size=certificate.proven / MM, unit="mm")]


def searches(rounds_of: Mapping[str, SearchRounds]) -> TextTable:
    """Return a table with one row for each round of each search; `rounds_of` has them by name of the phase."""
    rows = []
    for name, search in rounds_of.items():
        for search_round in search.rounds:
            tree = _cost(search_round.tree, search.unit)
            best = _cost(search_round.best, search.unit)
            rows.append(
                (
                    name,
                    str(search_round.samples),
                    tree,
                    best,
                    f"{search_round.processor:.2f}",
                    f"{search_round.wall:.2f}",
                )
            )
    return TextTable(
        ("search for", "samples", "path of the tree", "with shortcuts", "processor s", "wall-clock s"), rows
    )


def _cost(value: float, unit: str) -> str:
    """Return the cost of a path as text."""
    if not math.isfinite(value):
        return "no path"
    return quantity(value, unit)


def _write_csv(trajectory: Trajectory, path: Path) -> None:
    """Write one row per sample, with units in the header.

    Its columns: time; joints, their rates and accelerations; position of the tool and quaternion, real part first.
    """
    units = []
    factors = []
    for is_angle in trajectory.revolute:
        unit, factor = display_unit(is_angle)
        units.append(unit)
        factors.append(factor)
    header = ["t_s"]
    columns = [trajectory.t[:, None]]
    for suffix, values in (("", trajectory.q), ("_s", trajectory.qd), ("_s2", trajectory.qdd)):
        for name, unit in zip(trajectory.joint_names, units, strict=True):
            header.append(f"{name}_{unit}{suffix}")
        columns.append(values / np.array(factors))
    Ts = trajectory.Ts_base_tool
    header += ["tool_x_mm", "tool_y_mm", "tool_z_mm", "tool_qw", "tool_qx", "tool_qy", "tool_qz"]
    columns += [Ts[:, :3, 3] / MM, spatial.quat_from_matrix_wxyz(Ts[:, :3, :3])]
    np.savetxt(path, np.hstack(columns), fmt="%.9g", delimiter=",", header=",".join(header), comments="")
