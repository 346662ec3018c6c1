"""State of the robot between two phases of a protocol file, to check that each phase can follow those before it."""

from __future__ import annotations

from twin.core.errors import unknown
from twin.planning.protocol.protocol_file import ProtocolFile, WaypointKey
from twin.schema import Key


class ProtocolState:
    """Where the robot is after some phases, and whether an RCM is registered there.

    The table of each phase changes the state to that at its end, and requires what it needs of the state before it. The
    errors of all methods point to the table of this phase.

    Attributes:
        protocol_file: the protocol file, at the current phase.
        has_rcm: whether an RCM is registered: the instrument is in the patient.
        waypoint: name of the waypoint at which the robot is; None if it is at none. During a phase: that at its end.
        used_waypoints: names of all waypoints used so far.
    """

    def __init__(self, protocol_file: ProtocolFile, start: str, has_rcm: bool) -> None:
        """Begin at the waypoint `start`; `has_rcm`: whether an RCM is already registered."""
        self.protocol_file = protocol_file
        self.has_rcm = has_rcm
        self.waypoint: str | None = start
        self.used_waypoints = {start, protocol_file.home}
        self._phase_start: str | None = start

    def begin_phase(self, index: int) -> None:
        """Begin the phase at `index` in the file; unless its table sets a waypoint, it ends at none."""
        self.protocol_file = self.protocol_file.at_phase(index)
        self._phase_start = self.waypoint
        self.waypoint = None

    def end_at(self, waypoint: str, purpose: str, *alternatives: WaypointKey, key: Key = "to") -> None:
        """Set the waypoint at the end of the phase, which the table names at `key`.

        For `purpose` and `alternatives`, see `ProtocolFile.require_waypoint`.

        Raises:
            DescriptionError: the waypoint is not suitable, or the phase already begins there.
        """
        self.protocol_file.require_waypoint(waypoint, key, purpose, *alternatives)
        self.waypoint = waypoint
        self.used_waypoints.add(waypoint)
        if waypoint == self._phase_start:
            text = f"the phase has no length: it already begins at '{waypoint}'; remove the phase"
            raise self.protocol_file.error(key, text)

    def end_at_start(self) -> None:
        """Set as end of the phase the place where it begins, also if that is no waypoint."""
        self.waypoint = self._phase_start

    def register_trocar(self, trocar: str | None) -> None:
        """Register the trocar that the table names as RCM; None, if it names none, changes nothing.

        Raises:
            DescriptionError: [trocars_mm] has no such trocar.
        """
        if trocar is None:
            return
        if trocar not in self.protocol_file.trocars:
            text = unknown("trocar", trocar, self.protocol_file.trocars)
            raise self.protocol_file.error("trocar", f"{text}: [trocars_mm] lists the trocars")
        self.has_rcm = True

    def require_rcm(self, kind: str) -> None:
        """Check that an RCM is registered, for a phase of type `kind`.

        Raises:
            DescriptionError: there is none.
        """
        if not self.has_rcm:
            raise self.protocol_file.error("type", f"no RCM is registered yet: add an insertion before this {kind}")

    def require_no_rcm(self, kind: str) -> None:
        """Check that no RCM is registered, for a phase of type `kind` outside the patient.

        Raises:
            DescriptionError: there is one.
        """
        if self.has_rcm:
            text = f"the instrument is still in the patient: add a retraction to depth 0 before this {kind}"
            raise self.protocol_file.error("type", text)
