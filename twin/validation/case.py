"""The input of a validation, and its parts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from twin.cad.build import CadModel
from twin.kinematics import Kinematics
from twin.planning.protocol import Protocol
from twin.planning.trajectory import PathKinematics, Trajectory
from twin.validation.compare import Comparison
from twin.validation.motion import Measured
from twin.validation.result import PhaseSummary
from twin.validation.rows import Tolerances


@dataclass(frozen=True)
class Case:
    """The input of a validation.

    Attributes:
        kinematics: the equations, in the variants to judge; None: there are none yet, and everything else is checked.
        cad: the mechanism from the CAD, with the findings of reading it.
        protocol, trajectory: protocol and planned trajectory of the motion.
        stage: root layer of the USD stage that holds the same robot.
        tolerances: maximum deviations that count as agreement.
        paths: the robot's planning data; None: the trajectory's own findings are used for its limits.
        baked_for_it: whether the motion of the stage was made for this trajectory, and must match it.
    """

    kinematics: Kinematics | None
    cad: CadModel
    protocol: Protocol
    trajectory: Trajectory
    stage: Path
    tolerances: Tolerances
    paths: PathKinematics | None = None
    baked_for_it: bool = False

    @property
    def written(self) -> Path | None:
        """The layer with the protocol's baked motion, if it exists in the folder of the robot's stage."""
        path = self.stage.with_name(f"{self.stage.stem}_{self.trajectory.protocol}{self.stage.suffix}")
        return path if path.is_file() else None


Part = Literal["protocol", "equations", "stage", "motion"]
"""Parts of a validation that can run separately.

They check: timing and RCM of the samples; equations; stage; baked motion and clearances.
"""

PARTS: frozenset[Part] = frozenset(("protocol", "equations", "stage", "motion"))


@dataclass(frozen=True)
class Known:
    """Results of earlier checks of the same equations, mechanism and trajectory, for reuse."""

    comparison: Comparison | None = None
    measured: Measured | None = None


def summaries(trajectory: Trajectory) -> tuple[PhaseSummary, ...]:
    """Return the phases of a trajectory in the form of reports."""
    return tuple(
        PhaseSummary(
            p.name,
            p.type,
            p.t0,
            p.t1,
            None if p.rcm is None else (float(p.rcm[0]), float(p.rcm[1]), float(p.rcm[2])),
            p.rcm_mode or "",
        )
        for p in trajectory.phases
    )
