"""Data types of a validation: its input, the names of its parts, and results of earlier checks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

from twin.cad.build import CadModel
from twin.kinematics import Kinematics
from twin.planning.link_motion import LinkMotion
from twin.planning.path_kinematics import PathKinematics
from twin.planning.protocol import Protocol
from twin.planning.trajectory import Trajectory
from twin.reference import ReferenceModel
from twin.validation.baked_motion import MeasuredMotion
from twin.validation.equations_comparison import EquationsComparison
from twin.validation.residual_rows import SampleClock, Tolerances
from twin.validation.result import PhaseSummary


@dataclass(frozen=True)
class Case:
    """Input of a validation.

    Attributes:
        kinematics: the equations, in the variants to judge; None if the robot has no equations. Checks of equations
            are then skipped.
        cad: the mechanism read from the CAD, with the findings of the CAD reader.
        protocol, trajectory: the protocol, and the trajectory planned for this protocol.
        stage: root layer of the robot's USD stage.
        tolerances: largest deviations that count as agreement.
        paths: the robot's planning data, used to check the limits again; None: the findings of the trajectory are
            reused.
        baked_for_it: whether the stage's motion was baked from this trajectory. If true, a difference between this
            motion and the mechanism is a disagreement, otherwise a warning.
        motion: motion of all links at the times of a baked motion, by equations and compiled loops; it is baked and
            judged. None: the motion of the reference model is baked, and only writing and reading are judged.
    """

    kinematics: Kinematics | None
    cad: CadModel
    protocol: Protocol
    trajectory: Trajectory
    stage: Path
    tolerances: Tolerances
    paths: PathKinematics | None = None
    baked_for_it: bool = False
    motion: LinkMotion | None = None

    @cached_property
    def model(self) -> ReferenceModel:
        """The reference model of the mechanism from the CAD."""
        return ReferenceModel(self.cad.mechanism)

    @cached_property
    def clock(self) -> SampleClock:
        """Times and phases of the samples of the trajectory."""
        return SampleClock(self.trajectory.t, phase_summaries(self.trajectory))

    @property
    def written(self) -> Path | None:
        """USD file with the baked motion of the protocol, in the folder of the stage; None if it does not exist."""
        path = self.stage.with_name(f"{self.stage.stem}_{self.trajectory.protocol}{self.stage.suffix}")
        return path if path.is_file() else None


Part = Literal["protocol", "equations", "stage", "motion"]
"""Parts of a validation that can run separately.

"protocol": timing and RCM of the samples; "equations": equations and mechanism; "stage": USD stage; "motion": baked
motion and clearances.
"""

PARTS: frozenset[Part] = frozenset(("protocol", "equations", "stage", "motion"))


@dataclass(frozen=True)
class KnownResults:
    """Results of earlier checks of the same equations, mechanism and trajectory, to be reused; None: not available."""

    comparison: EquationsComparison | None = None
    measured: MeasuredMotion | None = None


def phase_summaries(trajectory: Trajectory) -> tuple[PhaseSummary, ...]:
    """Return the phases of a trajectory as summaries for the report."""
    summaries = []
    for phase in trajectory.phases:
        rcm = None
        if phase.rcm is not None:
            x, y, z = phase.rcm
            rcm = (float(x), float(y), float(z))
        summaries.append(
            PhaseSummary(
                phase.name,
                phase.type,
                t0=phase.t0,
                t1=phase.t1,
                rcm=rcm,
                rcm_mode=phase.rcm_mode or "",
                rounds=phase.rounds,
                solver=phase.solver or "",
            )
        )
    return tuple(summaries)
