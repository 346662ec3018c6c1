"""Result of planning several arms at once: phases with proven clearances, and a file with the samples of each arm."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from twin.core.findings import Finding, by_severity
from twin.core.result import Part, Result, Table
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.planning.planned import searches
from twin.planning.proven import clearance
from twin.planning.rounds import Rounds
from twin.planning.space import Certificate


@dataclass(frozen=True)
class CommonPhase:
    """A phase of all arms; the arms are at rest at its start and at its end.

    Attributes:
        name: names of the phases of the arms, joined.
        t0, t1: times in s at the start and at the end of the phase.
        seen: minimum distance between bodies of the arms and of the scene along the whole phase.
        rounds: rounds of the search for each arm's path, by name of the arm; empty if no arm needed a search. For
            arms planned after the first, the path length includes the progress of the arms planned before.
    """

    name: str
    t0: float
    t1: float
    seen: Certificate
    rounds: Mapping[str, Rounds] = field(default_factory=dict)


@dataclass(frozen=True)
class PlannedTogether(Result):
    """A common plan of several arms.

    Attributes:
        scene: name of the scene.
        joints: (name, whether an angle) of the driven joints of each arm, by name of the arm.
        order: names of the arms in the order of priority.
        t: (k,) times in s, one series for all arms.
        q: (k, n) joint values of each arm in m or rad, by name of the arm.
        phases: the phases.
        checked: findings of the check of every sample of each arm, by name of the arm.
    """

    kind: ClassVar[str] = "plan-together"
    scene: str
    joints: Mapping[str, Sequence[tuple[str, bool]]]
    order: Sequence[str]
    t: Array
    q: Mapping[str, Array]
    phases: Sequence[CommonPhase]
    checked: Mapping[str, Sequence[Finding]]

    @property
    def findings(self) -> Sequence[Finding]:
        """The proven clearance of each phase, and the findings of the check of every sample of each arm."""
        who = " and ".join(self.order)
        proven = [finding for p in self.phases for finding in clearance(p.seen, p.name, who, self.scene)]
        return proven + [
            replace(f, message=f"{name}: {f.message}") for name, found in self.checked.items() for f in found
        ]

    @property
    def rounds(self) -> Mapping[str, Rounds]:
        """Rounds of all searches, by arm and phase."""
        return {f"{arm}, {p.name}": rounds for p in self.phases for arm, rounds in p.rounds.items()}

    def content(self) -> Mapping[str, Any]:
        """Return the plan as plain data, without its samples."""
        return {
            "scene": self.scene,
            "order": list(self.order),
            "duration_s": float(self.t[-1]),
            "samples": len(self.t),
            "phases": [
                {
                    "name": p.name,
                    "t0_s": p.t0,
                    "t1_s": p.t1,
                    "proven_mm": p.seen.proven / MM,
                    "found_mm": p.seen.found / MM,
                    "bodies": list(p.seen.bodies),
                    "rounds": {arm: rounds.as_dict() for arm, rounds in p.rounds.items()},
                }
                for p in self.phases
            ],
        }

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for JSON, with search times; files omit search times, which differ between runs."""
        return {**super().as_dict(), "search_times": {name: r.times() for name, r in self.rounds.items()}}

    def text(self) -> Iterator[Part]:
        """Yield the phases and the findings."""
        yield f"{self.scene} · {', then '.join(self.order)} · {self.t[-1]:.3f} s, {len(self.t)} samples\n"
        rows = [(p.name, f"{p.t0:.3f}", f"{p.t1:.3f}", *_nearest(p.seen)) for p in self.phases]
        yield Table(("phase", "from s", "to s", "clearance mm", "nearest"), rows)
        yield ""
        if self.rounds:
            yield searches(self.rounds)
            yield ""
        yield from by_severity(self.findings)
        yield ""

    def files(self) -> list[str]:
        """Return the names of the files that `write` makes."""
        return [f"{name}.csv" for name in self.order]

    def write(self, folder: Path) -> None:
        """Write a CSV file for each arm: columns for time and the arm's joints, with units in the header."""
        for name in self.order:
            units = ["deg" if angle else "mm" for _, angle in self.joints[name]]
            values = self.q[name] / np.array([DEG if unit == "deg" else MM for unit in units])
            header = ["t_s", *(f"{j}_{unit}" for (j, _), unit in zip(self.joints[name], units, strict=True))]
            table = np.column_stack([self.t, values])
            path = folder / f"{name}.csv"
            np.savetxt(path, table, fmt="%.9g", delimiter=",", header=",".join(header), comments="")


def _nearest(seen: Certificate) -> tuple[str, str]:
    """Return proven clearance in mm and nearest bodies as text."""
    if not np.isfinite(seen.found):
        return "", "no bodies to test"
    return f"{seen.proven / MM:.2f}", " and ".join(seen.bodies)
