"""What is judged, and what of it."""

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
    """What is judged.

    Attributes:
        kinematics: the equations, in the variants to judge; None: there are none yet, and all else is judged.
        cad: the mechanism from the CAD and what reading it found.
        protocol, trajectory: along what.
        stage: root layer of the USD stage that holds the same robot.
        tolerances: what counts as agreement.
        paths: the robot as planning knows it; None: the trajectory's own findings are taken for its limits.
        baked_for_it: a motion that lies beside the stage was made for this very trajectory, and has to be it.
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
        """The stage with the protocol's motion baked in it, if there is one beside the robot's."""
        path = self.stage.with_name(f"{self.stage.stem}_{self.trajectory.protocol}{self.stage.suffix}")
        return path if path.is_file() else None


Part = Literal["protocol", "equations", "stage", "motion"]
"""What can be judged by itself: timing and RCM of the samples; equations; stage; baked motion and clearances."""

PARTS: frozenset[Part] = frozenset(("protocol", "equations", "stage", "motion"))


@dataclass(frozen=True)
class Known:
    """What earlier judgements of the same equations, mechanism and trajectory have given; need not be done again."""

    comparison: Comparison | None = None
    measured: Measured | None = None


def summaries(trajectory: Trajectory) -> tuple[PhaseSummary, ...]:
    """Return the phases of a trajectory as reports have them."""
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
