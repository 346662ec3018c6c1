"""Base classes of phase types: table in the file, conditions on earlier phases, and path.

Each type is defined in one file in `phases`, with a table class and a phase class. There is no other list of types.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_args

import numpy as np
from pydantic import Field

from twin.core.errors import DescriptionError, ProtocolError, unknown
from twin.core.foreign.once import Read
from twin.core.foreign.text import read_text
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.planning.protocol.course import Course, Motion, RcmMode, RotationOrder
from twin.planning.protocol.waypoint import Waypoint
from twin.schema import Identifier, Key, Table, error_at

Trocar = Annotated[
    Identifier | None,
    Field(description="the entry of [trocars_mm] that the shaft passes through; required if there are several entries"),
]
JointValue = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*_(deg|mm)$")]


# -- tables in the file ------------------------------------------------------------------------------------------------


class Walk:
    """State of a protocol between two phases, used to check the order of phases.

    Attributes:
        trocars: names in [trocars_mm].
        home: name of the home waypoint.
        inside: whether an RCM is registered.
        here: name of the waypoint at which the robot is; None if the robot is not at a waypoint.
        goal: name of the waypoint at which the current phase ends; None if the phase does not end at a waypoint.
        stays: whether the current phase ends where it began.
        used: names of the waypoints used so far.
    """

    def __init__(
        self,
        path: str | Path,
        waypoints: Mapping[str, Any],
        trocars: Sequence[str],
        start: str,
        home: str,
        inside: bool,
        folder: Path,
        read: Read,
    ) -> None:
        """Begin at the waypoint `start` of the file at `path`.

        Args:
            path: the file, for messages.
            waypoints: {name: waypoint}.
            trocars: names in [trocars_mm].
            start: name of the waypoint at the start.
            home: name of the waypoint of `home` phases.
            inside: whether an RCM is already registered.
            folder: folder of the files that phases name.
            read: returns the bytes of a file.
        """
        self._folder = folder
        self._read = read
        self._path = path
        self._waypoints = waypoints
        self.trocars = trocars
        self.home = home
        self.inside = inside
        self.here: str | None = start
        self.used = {start, home}
        self._keys: tuple[Key, ...] = ()
        self.goal: str | None = None
        self.stays = False

    def follow(self, place: int, phase: PhaseTable) -> None:
        """Check the next phase, at index `place` in the file, and update the state.

        Raises:
            DescriptionError: the phase cannot follow the phases before it.
        """
        self._keys = ("phases", place)
        self.goal = None
        self.stays = False
        phase.follow(self)
        if not self.stays:
            self.here = self.goal

    def read(self, place: int, phase: PhaseTable) -> Phase:
        """Return the phase of a table at index `place` in the file, in SI units.

        Raises:
            DescriptionError: a file that the phase names is wrong.
        """
        self._keys = ("phases", place)
        return phase.phase(self)

    def beside(self, name: str) -> Path:
        """Return the path of a file in the folder of the protocol."""
        return self._folder / name

    def text(self, path: Path, kind: str) -> str:
        """Return the text of a file; the size is limited by the budget of this `kind` (`core.foreign.budget`).

        Raises:
            OSError, UnicodeDecodeError: the file cannot be read.
            BudgetError: the file is too large.
        """
        return read_text(path, kind, read=self._read)

    def wrong(self, key: Key | None, message: str) -> DescriptionError:
        """Return an error that points to a key of the current phase; with `key` None, to the phase itself."""
        keys = self._keys
        if key is not None:
            keys = (*keys, key)
        return error_at(self._path, keys, message)

    def outside(self, kind: str) -> None:
        """Raise an error for a phase of type `kind` if an RCM is registered."""
        if self.inside:
            raise self.wrong(
                "type", f"the instrument is still in the patient: add a retraction to depth 0 before this {kind}"
            )

    def registered(self, kind: str) -> None:
        """Raise an error for a phase of type `kind` if no RCM is registered."""
        if not self.inside:
            raise self.wrong("type", f"no RCM is registered yet: add an insertion before this {kind}")

    def through(self, trocar: str | None) -> None:
        """Register the trocar that the phase names, if any, as the RCM."""
        if trocar is not None and trocar not in self.trocars:
            raise self.wrong("trocar", f"{unknown('trocar', trocar, self.trocars)}: [trocars_mm] lists the trocars")
        self.inside = self.inside or trocar is not None

    def go(self, goal: str, why: str, *needs: Literal["position_mm", "depth_mm", "joints"], key: Key = "to") -> None:
        """Set the waypoint `goal` at which the phase ends, and check that this waypoint has one of the keys `needs`."""
        self.target(goal, (*self._keys, key), why, *needs)
        self.goal = goal
        self.used.add(goal)
        if goal == self.here:
            raise self.wrong(key, f"the phase has no length: it already begins at '{goal}'; remove the phase")

    def target(self, name: str, keys: tuple[Key, ...], why: str, *needs: str) -> None:
        """Check that the waypoint `name` exists and, if `needs` is not empty, has one of the keys in `needs`."""
        if name not in self._waypoints:
            raise error_at(self._path, keys, unknown("waypoint", name, self._waypoints))
        values = [getattr(self._waypoints[name], key) for key in needs]
        if needs and values.count(None) == len(needs):
            raise error_at(self._path, keys, f"waypoint '{name}' has no {' or '.join(needs)}, which {why} requires")

    def once(self, joints: Iterable[str], keys: tuple[Key, ...] | None = None) -> None:
        """Check that the keys `joints`, such as NAME_deg and NAME_mm, name no joint twice."""
        joint_names = [key.rsplit("_", 1)[0] for key in joints]
        for joint in joint_names:
            if joint_names.count(joint) > 1:
                text = f"joint '{joint}' is given twice, in deg and in mm"
                raise error_at(self._path, keys or (*self._keys, "joints"), text)


class PhaseTable(Table):
    """Base class of the table of a phase in the file; each phase type has a subclass with `type: Literal["..."]`."""

    name: Identifier

    rank: ClassVar[int]
    """Position of the type in lists of types."""

    in_patient: ClassVar[bool] = False
    """Whether the instrument is in the patient during the phase."""

    @abstractmethod
    def follow(self, walk: Walk) -> None:
        """Check that the phase can follow the phases before it, and set in `walk` the waypoint at the phase's end."""

    @abstractmethod
    def phase(self, walk: Walk) -> Phase:
        """Return the phase that this table describes, in SI units."""

    def leaves(self) -> bool:
        """Return whether the instrument is out of the patient after the phase."""
        return False

    def kind(self) -> str:
        """Return the type of the phase."""
        return type(self).kind_of()

    @classmethod
    def kind_of(cls) -> str:
        """Return the value of `type` in the file for phases of this class."""
        literal = cls.model_fields["type"].annotation
        return get_args(literal)[0]


# -- phases as paths ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Begin:
    """State at the start of a phase.

    Attributes:
        where: names of protocol and phase, for messages.
        waypoints: {name: waypoint} of the protocol.
        order: rotation axes of `angles`, in order.
        n_tool_shaft: (3,) unit vector along the shaft, in the tool frame.
        tolerance: largest accepted distance in m between shaft and RCM.
        by_mechanism: whether the mechanism determines the tool path; if False, waypoints with joint values have no
            known tool pose.
        angles, tip: (3,) orientation in rad and (3,) position in m of the moved frame.
        shaft: (3,) unit vector along the shaft in base.
        rcm: (3,) registered RCM in m, in base, or None.
        depth: depth in m; NaN without RCM.
        mode: RCM mode of the previous phase, or None.
    """

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
    depth: float
    mode: RcmMode | None

    def pose(self, name: str) -> tuple[Array, Array]:
        """Return angles (3,) in rad and position (3,) in m of a waypoint.

        If the waypoint has joint values and the mechanism determines the path, the current pose is returned.

        Raises:
            ProtocolError: the waypoint has no position.
        """
        if self.by_mechanism and self.waypoints[name].joints is not None:
            return self.angles, self.tip
        return pose_of(self.waypoints, name, self.where.partition(":")[0])

    def refuse(self, text: str) -> ProtocolError:
        """Return an error whose message begins with the names of protocol and phase."""
        return ProtocolError(f"{self.where}: {text}")


def pose_of(waypoints: Mapping[str, Waypoint], name: str, protocol: str) -> tuple[Array, Array]:
    """Return angles (3,) in rad and position (3,) in m of a waypoint.

    Raises:
        ProtocolError: the waypoint has no position.
    """
    waypoint = waypoints[name]
    if waypoint.position is None:
        text = "no position"
        if waypoint.joints is not None:
            text = "joint values, which require the mechanism"
        raise ProtocolError(f"{protocol}: waypoint '{name}' has {text}")
    return waypoint.angles, waypoint.position


@dataclass(frozen=True)
class End:
    """State at the end of a phase; `angles`, `tip`, `rcm` and `mode` are those of `Begin`, but at the end.

    `waypoint` is the name of the waypoint at the end, or None. `depth1` is the depth in m at the end. `depth0` is the
    depth in m at the start if the phase registers an RCM there; None: the depth there is `Begin.depth`.
    """

    angles: Array
    tip: Array
    rcm: Array | None
    waypoint: str | None = None
    mode: RcmMode | None = None
    depth1: float = np.nan
    depth0: float | None = None


@dataclass(frozen=True)
class Phase(ABC):
    """A phase in SI.

    Attributes:
        type: value of `type` in the file.
        registers: whether the phase registers an RCM at its start.
        places: whether the phase is a straight motion to a waypoint `to`, outside the patient.
        by_joints: whether the phase is a motion in joint space if its waypoint has joint values.
        has_length: whether the end of the phase must differ from its start.
    """

    name: str
    type: ClassVar[str]
    registers: ClassVar[bool] = False
    places: ClassVar[bool] = False
    by_joints: ClassVar[bool] = False
    has_length: ClassVar[bool] = True

    @abstractmethod
    def end_after(self, at: Begin) -> End:
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

    def leaves(self) -> bool:
        """Return whether the RCM is released at the end of the phase."""
        return False

    def parameters(self) -> Iterable[Parameter]:
        """Return each number of the phase, with its provenance."""
        return ()


@dataclass(frozen=True)
class Reaching(Phase):
    """A phase that ends at the waypoint `to`, whose pose may follow from joint values; the RCM is unchanged."""

    to: str

    def end_after(self, at: Begin) -> End:
        """Return the state at the end of the phase: the robot is at the waypoint `to`."""
        return End(*at.pose(self.to), at.rcm, self.to)


def trocar_of(phase: Phase) -> str:
    """Return the name of the trocar that a phase uses; "" if the phase names no trocar."""
    return getattr(phase, "trocar", "")
