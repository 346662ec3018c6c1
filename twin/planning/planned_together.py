"""Result of planning several arms at once: phases with proven clearances, and a file with the samples of each arm."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from twin.core.findings import Finding
from twin.core.result import Part, Result, Table
from twin.core.spatial import Array
from twin.core.units import DEG, MM


@dataclass(frozen=True)
class CommonPhase:
    """A phase of all arms, which begin and end it at rest together.

    Attributes:
        name: names of the arms' phases.
        t0, t1: times in s of its start and its end.
        proven: lower bound in m of the distance between bodies of the arms and of the scene along the whole phase.
        found: smallest distance in m at the tested places.
        bodies: names of the two bodies with this distance.
    """

    name: str
    t0: float
    t1: float
    proven: float
    found: float
    bodies: tuple[str, str]


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
    """

    kind: ClassVar[str] = "plan-together"
    scene: str
    joints: Mapping[str, Sequence[tuple[str, bool]]]
    order: Sequence[str]
    t: Array
    q: Mapping[str, Array]
    phases: Sequence[CommonPhase]

    @property
    def findings(self) -> Sequence[Finding]:
        """The proven clearance of each phase."""
        return [
            Finding(
                "clearance.proven",
                "info",
                f"all bodies of {' and '.join(self.order)} keep at least {p.proven / MM:.2f} mm from each other and "
                f"from the scene at every moment and with any timing (proven); the smallest distance found is "
                f"{p.found / MM:.2f} mm, between {' and '.join(p.bodies)}",
                p.name,
                size=p.proven / MM,
                unit="mm",
            )
            for p in self.phases
            if np.isfinite(p.found)
        ]

    def content(self) -> Mapping[str, Any]:
        """Return the plan without its samples."""
        return {
            "scene": self.scene,
            "order": list(self.order),
            "duration_s": float(self.t[-1]),
            "samples": len(self.t),
            "phases": [
                {"name": p.name, "t0_s": p.t0, "t1_s": p.t1, "proven_mm": p.proven / MM, "found_mm": p.found / MM,
                 "bodies": list(p.bodies)}
                for p in self.phases
            ],
        }  # fmt: skip

    def text(self) -> Iterator[Part]:
        """Yield the phases and the findings."""
        yield f"{self.scene} · {', then '.join(self.order)} · {self.t[-1]:.3f} s, {len(self.t)} samples\n"
        rows = [
            (p.name, f"{p.t0:.3f}", f"{p.t1:.3f}", f"{p.proven / MM:.2f}", " and ".join(p.bodies)) for p in self.phases
        ]
        yield Table(("phase", "from s", "to s", "clearance mm", "nearest"), rows)
        yield ""
        yield from self.findings
        yield ""

    def files(self) -> list[str]:
        """Return the names of the files of `write`."""
        return [f"{name}.csv" for name in self.order]

    def write(self, folder: Path) -> None:
        """Write the samples of each arm: time, then its joints, with units in the header."""
        for name in self.order:
            units = ["deg" if angle else "mm" for _, angle in self.joints[name]]
            values = self.q[name] / np.array([DEG if unit == "deg" else MM for unit in units])
            header = ["t_s", *(f"{j}_{unit}" for (j, _), unit in zip(self.joints[name], units, strict=True))]
            table = np.column_stack([self.t, values])
            path = folder / f"{name}.csv"
            np.savetxt(path, table, fmt="%.9g", delimiter=",", header=",".join(header), comments="")
