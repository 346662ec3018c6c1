"""Hands of a console that move its tools to poses: each step of a tool becomes a motion of the hand that controls it.

The pose of a handle is in {H}, the axes of the endoscope's picture. A displacement of a tool, divided by the motion
scale, is the displacement of its handle; the rotations of both are equal. The handle moves there in steps that are too
small to count as jumps, and only while its tool follows.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.simulation.console_scene import HANDS
from twin.simulation.controllers.tool_following import SCALE_RANGE
from twin.simulation.devices.received_hands import HandState
from twin.ui.session.live_console import HeldError, LiveConsole
from twin.ui.session.plan_mode import RESTING_PHASES

MAX_TRANSLATION = 0.02
"""Maximum translation in m of a handle from one sent state to the next; the console could ignore more as a jump."""

MAX_ROTATION = 0.3
"""Maximum rotation in rad of a handle from one sent state to the next; see `MAX_TRANSLATION`."""

HOLD_ROTATION = 5 * DEG
"""Rotation in rad of a handle about its axis, which shows the console that the handle is held (minimum: 4 deg)."""

IDLE_TIMEOUT = 5.0
"""Time in s without a request after which a client's hands are released for other clients."""

_FIRST_DISTANCE = 0.08
"""Distance in m of each handle, at the start, from the middle between both."""


@dataclass
class ServoHandle:
    """One handle.

    Attributes:
        position, attitude: requested position (3,) in m and attitude (3, 3) in {H}.
        sent_position, sent_attitude: position (3,) in m and attitude (3, 3) last sent to the console.
        is_used: whether a request has moved the handle since the client took the hands.
        hold_rotation_number: number of the last state in which the handle was rotated by `HOLD_ROTATION`; -1 before the
            first one.
    """

    position: Array
    attitude: Array = field(default_factory=lambda: np.eye(3))
    sent_position: Array = field(default_factory=lambda: np.zeros(3))
    sent_attitude: Array = field(default_factory=lambda: np.eye(3))
    is_used: bool = False
    hold_rotation_number: int = -1

    def __post_init__(self) -> None:
        self.sent_position = self.position.copy()

    @property
    def has_arrived(self) -> bool:
        """Whether the requested motion of this handle has been sent to the console completely."""
        is_at_position = np.array_equal(self.position, self.sent_position)
        return is_at_position and np.array_equal(self.attitude, self.sent_attitude)

    def cancel(self) -> None:
        """Cancel the part of the requested motion that has not been sent to the console."""
        self.position = self.sent_position.copy()
        self.attitude = self.sent_attitude.copy()

    def advance(self) -> None:
        """Set the state to send next: nearer to the request, by at most `MAX_TRANSLATION` and `MAX_ROTATION`."""
        displacement = self.position - self.sent_position
        length = float(np.linalg.norm(displacement))
        if length <= MAX_TRANSLATION:
            self.sent_position = self.position.copy()
        else:
            self.sent_position = self.sent_position + displacement * (MAX_TRANSLATION / length)
        rotation = spatial.log_so3(self.attitude @ self.sent_attitude.T)
        angle = float(np.linalg.norm(rotation))
        if angle <= MAX_ROTATION:
            self.sent_attitude = self.attitude.copy()
        else:
            self.sent_attitude = spatial.exp_so3(rotation * (MAX_ROTATION / angle)) @ self.sent_attitude


class ServoHands:
    """Both handles, with pedals that are not pressed and closed grippers; one client at a time uses them.

    Attributes:
        client: identifier of the client that uses the handles; None: no client.
        handles: the handles, by hand ("right" or "left").
    """

    def __init__(self, console: LiveConsole) -> None:
        """Place the handles side by side; no client uses them yet."""
        self._console = console
        self.client: str | None = None
        self.handles: dict[str, ServoHandle] = {}
        for hand, x in zip(HANDS, (_FIRST_DISTANCE, -_FIRST_DISTANCE), strict=True):
            self.handles[hand] = ServoHandle(np.array([x, 0.0, 0.0]))
        self._next_number = 0  # of the next state
        self._first_number = 0  # of the first state of the present client
        self._idle_time = 0.0  # in s, since the last request

    def use(self, client: str) -> None:
        """Give the handles to a client; each call restarts `IDLE_TIMEOUT`, after which the handles are released.

        Raises:
            HeldError: another client controls the hands.
        """
        if self.client not in (None, client):
            self._console.require_free(client)
            self.release()
        if self.client is None:
            self._console.require_free(client)
            self.client = client
            self._first_number = self._next_number
            for handle in self.handles.values():
                handle.is_used = False
                handle.hold_rotation_number = -1
        self._idle_time = 0.0

    def release(self) -> None:
        """Release the hands; cancel motions that have not been sent to the console."""
        if self.client is not None:
            self._console.release(self.client)
        self.client = None
        for handle in self.handles.values():
            handle.cancel()

    def move(self, client: str, hand: str, T_old: Array, T_new: Array) -> None:
        """Move a hand so that its tool moves by the displacement from T_old to T_new, both (4, 4) in the World.

        Raises:
            HeldError: another client controls the hands.
        """
        self.use(client)
        R_picture_world = self._console.view[:3, :3].T
        displacement = R_picture_world @ (T_new[:3, 3] - T_old[:3, 3])
        rotation = R_picture_world @ T_new[:3, :3] @ T_old[:3, :3].T @ R_picture_world.T
        scale = float(np.clip(self._console.reading["scale"], *SCALE_RANGE))
        handle = self.handles[hand]
        handle.is_used = True
        handle.position = handle.position + displacement / scale
        # Conversion to a quaternion and back keeps the matrix orthonormal.
        attitude_wxyz = spatial.quat_from_matrix_wxyz(rotation @ handle.attitude)
        handle.attitude = spatial.matrix_from_quat_wxyz(attitude_wxyz)

    def send(self, passed: float) -> None:
        """Send the state of both hands to the console; `passed` is the time in s since the last call.

        The hands are released `IDLE_TIMEOUT` s after the last request.
        """
        if self.client is None:
            return
        self._idle_time += passed
        if self._idle_time > IDLE_TIMEOUT and all(handle.has_arrived for handle in self.handles.values()):
            self.release()
            return
        for hand, handle in self.handles.items():
            self._advance(hand, handle)
        states = []
        for k, hand in enumerate(HANDS):
            handle = self.handles[hand]
            pose = spatial.pose(handle.sent_attitude, handle.sent_position)
            states.append(HandState(k, False, False, self._next_number, pose, 0.0))
        self._next_number = (self._next_number + 1) % 2**32  # the number has 32 bits in a packet
        try:
            self._console.give(self.client, *states)
        except HeldError:  # another device has taken the hands
            self.release()

    def _advance(self, hand: str, handle: ServoHandle) -> None:
        """Set the state of a handle that is sent next.

        A handle whose tool does not follow yet does not move. It is rotated about its axis, which is how the console
        notices that a hand holds it; each rotation waits until the console has received the one before.
        """
        reading = self._console.reading
        follows = bool(reading["hands"][hand]["follows"])
        is_resting = self._console.planning.phase in RESTING_PHASES
        if follows or is_resting or not handle.is_used:
            handle.advance()
            return
        controls_tools = reading["owner"] == self.client and not reading["silent"] and reading["mode"] == "instruments"
        if controls_tools and reading["heard"] >= max(self._first_number, handle.hold_rotation_number):
            # The tool keeps its attitude when it starts to follow, so this rotation does not move the tool.
            R = spatial.rotation_z(HOLD_ROTATION)
            handle.hold_rotation_number = self._next_number
            handle.sent_attitude = handle.sent_attitude @ R
            handle.attitude = handle.attitude @ R
