"""Result of planning several arms at once: phases with proven clearances, and a scene that plays the motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from twin.core.findings import Finding, by_severity
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.result import Part, Result, TextTable, as_json
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.scene import Scene
from twin.planning.arm_distances import ArmDistances, Nearest
from twin.planning.plan_files import SCENE, RobotSamples, protocol_files, write_plan_scene
from twin.planning.plan_result import clearance_findings, searches
from twin.planning.rounds import SearchRounds
from twin.planning.space import PathCertificate

FILE = "plan.json"
"""File with the content of the result."""


KINDS = {"between_arms": "between arms", "inside_arm": "inside one arm", "to_scene": "to the scene"}
"""Kinds of pairs of bodies, with their names in texts."""


@dataclass(frozen=True)
class CommonPhase:
    """A phase of all arms; the arms are at rest at its start and at its end.

    Attributes:
        name: names of the phases of the arms, joined.
        t0, t1: times in s at the start and at the end of the phase.
        nearest_pairs: minimum distance for each kind of pair in `KINDS` (two different arms, one arm, arm and scene);
            kinds without bodies to test are missing.
        solver: solver of the timing: "passes" or "toppra".
        rounds: {name of the arm: rounds of the search for its path}; empty if no arm needed a search. The
            path of a later arm is searched over the arm's joint values and the progress of the earlier arms; path
            lengths in `rounds` include both.
    """

    name: str
    t0: float
    t1: float
    nearest_pairs: Mapping[str, Nearest]
    solver: str
    rounds: Mapping[str, SearchRounds] = field(default_factory=dict)

    @property
    def certificate(self) -> PathCertificate:
        """Minimum distance along the whole phase, over all tested pairs of bodies; infinite if no pair is tested."""
        every_kind = [Nearest(np.inf, np.inf, ("", ""), self.t0), *self.nearest_pairs.values()]
        smallest = min(every_kind, key=lambda nearest: nearest.found)
        # the proven bound and the smallest distance may be those of different kinds
        proven = min(nearest.proven for nearest in every_kind)
        return replace(smallest, proven=proven)

    def as_dict(self) -> JsonObject:
        """Return plain data; the keys of quantities end with the unit."""
        clearances = {}
        for kind, nearest in self.nearest_pairs.items():
            clearances[kind] = nearest.as_dict()
        rounds_of_arms = {}
        for arm, rounds in self.rounds.items():
            rounds_of_arms[arm] = rounds.as_dict()
        certificate = self.certificate
        return {
            "name": self.name,
            "t0_s": self.t0,
            "t1_s": self.t1,
            "proven_mm": certificate.proven / MM,
            "found_mm": certificate.found / MM,
            "bodies": list(certificate.bodies),
            "clearances": clearances,
            "solver": self.solver,
            "rounds": rounds_of_arms,
        }


@dataclass(frozen=True)
class PlannedTogether(Result):
    """A common plan of several arms.

    Attributes:
        scene: the scene.
        required: required clearance in m.
        robots: all robots with their samples, by the robot's name in the scene; the robots in `order` come first.
        order: names of the arms in the order of priority.
        t: (k,) times in s, one series for all arms.
        phases: the phases.
        checked: {name of the arm: findings of the check of every sample}.
        arm_distances: distances of each pair of arms over time.
    """

    kind: ClassVar[str] = "plan-together"
    scene: Scene
    required: float
    robots: Mapping[str, RobotSamples]
    order: Sequence[str]
    t: Array
    phases: Sequence[CommonPhase]
    checked: Mapping[str, Sequence[Finding]]
    arm_distances: ArmDistances

    @property
    def q(self) -> Mapping[str, Array]:
        """Joint values (k, n) of each arm in m or rad, by name of the arm."""
        return {name: self.robots[name].q for name in self.order}

    @property
    def findings(self) -> Sequence[Finding]:
        """The proven clearances of each phase, and the findings of the check of every sample of each arm."""
        arms = " and ".join(self.order)
        findings = []
        for phase in self.phases:
            findings += _between_arms(phase, arms)
            findings += clearance_findings(phase.certificate, phase.name, arms, self.scene.name)
        for name, checked in self.checked.items():
            for finding in checked:
                findings.append(replace(finding, message=f"{name}: {finding.message}"))
        return findings

    @property
    def rounds(self) -> Mapping[str, SearchRounds]:
        """Rounds of all searches, by arm and phase."""
        rounds_of_searches = {}
        for phase in self.phases:
            for arm, rounds in phase.rounds.items():
                rounds_of_searches[f"{arm}, {phase.name}"] = rounds
        return rounds_of_searches

    @property
    def nearest_pairs(self) -> Mapping[str, tuple[Nearest, str]]:
        """For each kind of pair in `KINDS`: the nearest bodies of the whole plan, and the name of their phase."""
        nearest_of_kind = {}
        for phase in self.phases:
            for kind, nearest in phase.nearest_pairs.items():
                if kind in nearest_of_kind and nearest_of_kind[kind][0].found <= nearest.found:
                    continue
                nearest_of_kind[kind] = (nearest, phase.name)
        return {kind: nearest_of_kind[kind] for kind in KINDS if kind in nearest_of_kind}  # in the order of the kinds

    def content(self) -> JsonMapping:
        """Return the plan as plain data, without its samples."""
        clearances = {}
        for kind, (nearest, phase_name) in self.nearest_pairs.items():
            clearances[kind] = {**nearest.as_dict(), "phase": phase_name}
        return {
            "scene": self.scene.name,
            "order": list(self.order),
            "duration_s": float(self.t[-1]),
            "samples": len(self.t),
            "required_mm": self.required / MM,
            "clearances": clearances,
            "phases": [phase.as_dict() for phase in self.phases],
        }

    def as_dict(self) -> JsonObject:
        """Return plain data for JSON, with search times; files omit search times, which differ between runs."""
        times = {name: rounds.times() for name, rounds in self.rounds.items()}
        return {**super().as_dict(), "search_times": times}

    def text(self) -> Iterator[Part]:
        """Yield the phases, the minimum clearances and the findings."""
        yield f"{self.scene.name} · {', then '.join(self.order)} · {self.t[-1]:.3f} s, {len(self.t)} samples\n"
        phases = []
        for phase in self.phases:
            phases.append((phase.name, f"{phase.t0:.3f}", f"{phase.t1:.3f}", phase.solver))
        yield TextTable(("phase", "from s", "to s", "timing"), phases)
        yield ""
        rows = []
        for kind, (nearest, phase_name) in self.nearest_pairs.items():
            smallest = f"{nearest.found / MM:.2f}"
            proven = f"{nearest.proven / MM:.2f}"
            bodies = " and ".join(nearest.bodies)
            rows.append((KINDS[kind], smallest, proven, f"{nearest.t:.3f}", phase_name, bodies))
        yield TextTable(("minimum clearance", "found mm", "proven mm", "at s", "phase", "nearest bodies"), rows)
        yield f"  required: {self.required / MM:g} mm"
        yield ""
        if self.rounds:
            yield searches(self.rounds)
            yield ""
        yield from by_severity(self.findings)
        yield ""

    def files(self) -> list[str]:
        """Return the names of the files that `write` makes, without the props."""
        names = [SCENE, FILE]
        for robot, protocol in protocol_files(self.robots, self.scene).items():
            names += [f"{robot}.csv", protocol]
        return names

    def write(self, folder: Path) -> None:
        """Write plan.json, and a scene that plays the motion (`plan_files.write_plan_scene`)."""
        (folder / FILE).write_text(as_json(super().as_dict()), encoding="utf-8")
        write_plan_scene(self.scene, self.robots, self.t, self.required, folder)


def _between_arms(phase: CommonPhase, who: str) -> list[Finding]:
    """Return a finding on the proven clearance between the arms in a phase; empty if no bodies are tested."""
    nearest = phase.nearest_pairs.get("between_arms")
    if nearest is None:
        return []
    text = (
        f"{who} keep at least {nearest.proven / MM:.2f} mm from each other (proven); the smallest distance found "
        f"is {nearest.found / MM:.2f} mm, between {' and '.join(nearest.bodies)}, at {nearest.t:.3f} s"
    )
    return [Finding("clearance.between_arms", "info", text, phase.name, size=nearest.proven / MM, unit="mm")]
