"""Base class of phases: motions with a state of the robot at their start and at their end, in SI units.

Each type is defined in one file in `phases`, with a table class and a phase class. There is no other list of types.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from twin.core.errors import ProtocolError
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.planning.protocol.course import Course, Motion, RcmMode, RotationOrder
from twin.planning.protocol.waypoint import Waypoint


@dataclass(frozen=True)
class PhaseStart:
    """State at the start of a phase, with the data of the protocol that its end depends on.

    Attributes:
        protocol: name of the protocol, for messages.
        where: names of protocol and phase, for messages.
        waypoints: {name: waypoint} of the protocol.
        order: rotation axes of `angles`, in order.
        n_tool_shaft: (3,) unit vector along the shaft, in the tool frame.
        tolerance: largest accepted distance in m between shaft and RCM.
        by_mechanism: whether the mechanism determines the tool path; if False, waypoints with joint values have no
            known tool pose.
        angles: (3,) angles of the tool in rad, about the axes of `order`.
        tip: (3,) origin of the moved frame in m, in base.
        shaft: (3,) unit vector along the shaft, in base.
        rcm: (3,) registered RCM in m, in base, or None.
        rcm_mode: RCM mode of the previous phase, or None.
        depth: depth in m; NaN without RCM.
    """

    protocol: str
    where: str
    waypoints: Mapping[str, Waypoint]
    order: RotationOrder
    n_tool_shaft: Array
    tolerance: float
    by_mechanism: bool
    angles: Array
    tip: Array
    shaft: Array
    rcm: Array | None
    rcm_mode: RcmMode | None
    depth: float

    def pose_at(self, waypoint: str) -> tuple[Array, Array]:
        """Return angles (3,) in rad and position (3,) in m of a waypoint.

        If the waypoint has joint values and the mechanism determines the path, the current pose is returned: the
        mechanism replaces it.

        Raises:
            ProtocolError: the waypoint has no position.
        """
        if self.by_mechanism and self.waypoints[waypoint].joints is not None:
            return self.angles, self.tip
        return self.waypoints[waypoint].require_pose(self.protocol)

    def error(self, text: str) -> ProtocolError:
        """Return an error whose message begins with the names of protocol and phase."""
        return ProtocolError(f"{self.where}: {text}")


@dataclass(frozen=True)
class PhaseEnd:
    """State at the end of a phase.

    Attributes:
        angles, tip, rcm: as in `PhaseStart`. An RCM that the phase releases at its end is still that of the phase.
        waypoint: name of the waypoint at the end, or None.
        rcm_mode: RCM mode of the phase; None without RCM.
        depth: depth in m; NaN without RCM.
    """

    angles: Array
    tip: Array
    rcm: Array | None
    waypoint: str | None = None
    rcm_mode: RcmMode | None = None
    depth: float = np.nan


@dataclass(frozen=True)
class Phase(ABC):
    """A phase in SI units.

    Attributes:
        name: name of the phase in the protocol.
        type: value of `type` in the file.
        registers_rcm: whether the phase registers an RCM at its start.
        is_positioning: whether the phase is a straight motion to a waypoint `to`, outside the patient.
        by_joints: whether the phase is a motion in joint space if its waypoint has joint values.
        has_length: whether the end of the phase must differ from its start.
    """

    name: str
    type: ClassVar[str]
    registers_rcm: ClassVar[bool] = False
    is_positioning: ClassVar[bool] = False
    by_joints: ClassVar[bool] = False
    has_length: ClassVar[bool] = True

    @abstractmethod
    def end_after(self, start: PhaseStart) -> PhaseEnd:
        """Return the state at the end of the phase.

        Raises:
            ProtocolError: the phase cannot be carried out.
        """

    def motion(self, course: Course, s: Array) -> Motion:
        """Return the motion of the phase at s (k,): along a straight line, unless a type overrides this method."""
        return course.line(s)

    def depth_at(self, course: Course, s: float) -> float:
        """Return the insertion depth in m at the path parameter s; NaN if no RCM is registered."""
        return course.depth0 + s * (course.depth1 - course.depth0)

    def releases_rcm(self) -> bool:
        """Return whether the RCM is released at the end of the phase: the instrument has left the patient."""
        return False

    def parameters(self) -> Iterable[Parameter]:
        """Return each number of the phase, with its provenance."""
        return ()


@dataclass(frozen=True)
class WaypointPhase(Phase):
    """A phase that ends at the waypoint `to`, whose pose may follow from joint values; the RCM is unchanged."""

    to: str

    def end_after(self, start: PhaseStart) -> PhaseEnd:
        """Return the state at the end of the phase: the robot is at the waypoint `to`."""
        angles, tip = start.pose_at(self.to)
        return PhaseEnd(angles, tip, start.rcm, self.to)


def trocar_of(phase: Phase) -> str:
    """Return the name of the trocar that a phase uses; "" if the phase names no trocar."""
    return getattr(phase, "trocar", "")
