"""Plan a protocol for playback in a separate process."""

from __future__ import annotations

from twin.core.errors import TwinError
from twin.core.jobs import Call
from twin.ui.session.timeline import Playback, prepare


class Planner:
    """Planning of a protocol in a separate process; `answer` is the playback or an error text once `done` is True.

    Attributes:
        protocol: name or path of the protocol; None: the robot's default protocol.
    """

    def __init__(self, robot: str, protocol: str | None) -> None:
        self.protocol = protocol
        self._call = Call(prepare, robot, protocol, nice=5)

    @property
    def done(self) -> bool:
        """Whether planning has ended."""
        return self._call.done

    @property
    def answer(self) -> Playback | str | None:
        """The playback or the error text; None while the protocol is being planned."""
        if not self._call.done:
            return None
        try:
            return self._call.result()
        except TwinError as error:
            return str(error)

    def close(self) -> None:
        """End the process that plans the protocol."""
        self._call.close()
