"""What the C# file of a robot is written from: mechanism, equations, and limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from twin.kinematics.closed_loops.bounds import Bound, bounds_of
from twin.kinematics.compile import Kinematics
from twin.model.mechanism import Mechanism


@dataclass(frozen=True)
class DeviceModel:
    """A robot for the device.

    Attributes:
        mechanism: the mechanism.
        equations: the compiled equations, or None.
        gaps: (lower joint, upper joint, minimum distance in m) of joints on one rail.
    """

    mechanism: Mechanism
    equations: Kinematics | None
    gaps: Sequence[tuple[str, str, float]] = ()

    @property
    def bounds(self) -> tuple[Bound, ...]:
        """Limits of active joints, of motors, and of gaps on rails."""
        return bounds_of(self.mechanism, self.gaps)
