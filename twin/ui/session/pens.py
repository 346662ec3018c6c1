"""Two handles that a page moves by gizmos and sliders; a `LiveConsole` uses the handles as hands.

The pose of a handle is in {H}, the axes of the endoscope's picture. A page requests a displacement of the tool, an
opening of the gripper, or a position of the camera. This module converts these requests to handle motions that the
console accepts: the steps are too small to count as jumps, and a handle moves only while its tool follows.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.simulation.console_scene import HANDS, drag
from twin.simulation.controllers import camera
from twin.simulation.controllers.jaw import TRAVEL
from twin.simulation.controllers.tool_following import SCALE
from twin.simulation.devices.received_hands import HandState
from twin.ui.session.live_console import HeldError, LiveConsole
from twin.ui.session.plan_view import RESTING_PHASES

MAX_TRANSLATION = 0.02
"""Maximum translation in m of a handle in one call of `say`. The console could ignore a larger motion as a jump."""

MAX_ROTATION = 0.3
"""Maximum rotation in rad of a handle in one call of `say`; see `MAX_TRANSLATION`."""

GRIP_SPEED = 4.0
"""Largest angular speed of a gripper in rad/s."""

HOLD_ROTATION = 5 * DEG
"""Rotation in rad of a handle about its axis, which shows the console that the handle is held (minimum: 4 deg)."""

IDLE_TIMEOUT = 5.0
"""Time in s without a request after which a client's hands are released for other clients."""


@dataclass
class Pen:
    """One handle.

    Attributes:
        p, R: requested position (3,) in m and attitude (3, 3) in {H}.
        grip: requested angle of the gripper in rad.
        at, turned, gripped: position (3,) in m, attitude (3, 3) and gripper angle in rad last sent to the console.
        used: whether a request has moved the handle since the client took the hands.
        rolled: number of the last state in which the handle was rotated by `HOLD_ROTATION`; -1 before the first one.
    """

    p: Array
    R: Array = field(default_factory=lambda: np.eye(3))
    grip: float = 0.0
    at: Array = field(default_factory=lambda: np.zeros(3))
    turned: Array = field(default_factory=lambda: np.eye(3))
    gripped: float = 0.0
    used: bool = False
    rolled: int = -1

    def __post_init__(self) -> None:
        self.at = self.p.copy()

    @property
    def arrived(self) -> bool:
        """Whether the requested motion of this handle has been sent to the console completely."""
        is_unmoved = np.array_equal(self.p, self.at) and np.array_equal(self.R, self.turned)
        return is_unmoved and self.grip == self.gripped

    def rest(self) -> None:
        """Cancel the part of the requested motion that has not been sent to the console."""
        self.p = self.at.copy()
        self.R = self.turned.copy()
        self.grip = self.gripped

    def next(self, seconds: float) -> None:
        """Compute the next state to send; `seconds` is the time in s since the last state.

        Position, attitude and gripper angle change towards the requested values by at most `MAX_TRANSLATION`,
        `MAX_ROTATION` and `GRIP_SPEED` * `seconds`.
        """
        displacement = self.p - self.at
        length = float(np.linalg.norm(displacement))
        if length <= MAX_TRANSLATION:
            self.at = self.p.copy()
        else:
            self.at = self.at + displacement * (MAX_TRANSLATION / length)
        rotation = spatial.log_so3(self.R @ self.turned.T)
        angle = float(np.linalg.norm(rotation))
        if angle <= MAX_ROTATION:
            self.turned = self.R.copy()
        else:
            self.turned = spatial.exp_so3(rotation * (MAX_ROTATION / angle)) @ self.turned
        opening = self.grip - self.gripped
        largest = GRIP_SPEED * seconds
        if abs(opening) <= largest:
            self.gripped = self.grip
        else:
            self.gripped += float(np.copysign(largest, opening))


@dataclass
class _Aim:
    """Requested camera coordinates, and the camera coordinates and hand positions when the pedal took effect."""

    wanted: Array
    at: Array | None = None
    right: Array = field(default_factory=lambda: np.zeros(3))
    left: Array = field(default_factory=lambda: np.zeros(3))


class Pens:
    """Both handles and the pedals of one page.

    Attributes:
        clutch, camera: whether each pedal is pressed.
        client: identifier of the client that uses the handles; None: no client.
        pens: the handles, by hand ("right" or "left").
    """

    def __init__(self, console: LiveConsole) -> None:
        """Place the handles side by side; no client uses them yet."""
        self.console = console
        self.clutch = False
        self.camera = False
        self.client: str | None = None
        self.pens: dict[str, Pen] = {}
        for hand, x in zip(HANDS, (0.08, -0.08), strict=True):
            self.pens[hand] = Pen(np.array([x, 0.0, 0.0]))
        self._number = 0  # of the next state
        self._first = 0  # number of the first state of the present client
        self._idle = 0.0
        self._aim: _Aim | None = None
        self._drag = drag(console.table)

    # -- requests of clients --------------------------------------------------------------------------

    def use(self, client: str) -> None:
        """Give the handles to a client; each call restarts `IDLE_TIMEOUT`, after which the handles are released.

        Raises:
            HeldError: another client controls the hands.
        """
        if self.client not in (None, client):
            self.console.require_free(client)
            self.release()
        if self.client is None:
            self.console.require_free(client)
            self.client = client
            self._first = self._number
            for pen in self.pens.values():
                pen.used = False
                pen.rolled = -1
        self._idle = 0.0

    def release(self) -> None:
        """Release the hands and the pedals; cancel motions that have not been sent to the console."""
        if self.client is not None:
            self.console.release(self.client)
        self.client = None
        self.clutch = False
        self.camera = False
        self.rest()

    def rest(self) -> None:
        """Cancel the motions of both handles and of the camera that have not been sent to the console."""
        self._aim = None
        for pen in self.pens.values():
            pen.rest()

    def press(self, client: str, *, clutch: bool | None = None, camera: bool | None = None) -> None:
        """Press (True) or release (False) the pedals; None: the pedal is unchanged.

        Raises:
            HeldError: another client controls the hands.
        """
        self.use(client)
        self._aim = None
        if clutch is not None:
            self.clutch = clutch
        if camera is not None:
            self.camera = camera

    def move(self, client: str, hand: str, T_old: Array, T_new: Array) -> None:
        """Move a hand so that its tool moves by the displacement from T_old to T_new, both (4, 4) in the World.

        While the camera pedal is pressed, both hands move, so that the scene moves by this displacement in the picture.

        Raises:
            HeldError: another client controls the hands.
        """
        self.use(client)
        self._aim = None
        self._shift(hand, T_old, T_new)

    def squeeze(self, client: str, hand: str, part: float) -> None:
        """Open a gripper to a fraction of the jaw's range, 0 (closed) to 1.

        Raises:
            HeldError: another client controls the hands.
        """
        self.use(client)
        pen = self.pens[hand]
        pen.used = True
        pen.grip = TRAVEL * float(np.clip(part, 0, 1))

    def aim(self, client: str, coordinate: int, value: float) -> None:
        """Move one coordinate of the camera by both hands; the other coordinates do not change.

        `coordinate` is 0 pan, 1 tilt, 2 depth or 3 roll; `value` is in rad or m and is clipped to the limits.

        Raises:
            HeldError: another client controls the hands.
        """
        self.use(client)
        if self._aim is None:
            self._aim = _Aim(self.console.camera_at.copy())
        low = self._drag.lower[coordinate]
        high = self._drag.upper[coordinate]
        self._aim.wanted[coordinate] = np.clip(value, low, high)

    # -- states for the console -----------------------------------------------------------------------

    @property
    def settled(self) -> bool:
        """Whether all requested motions of handles and camera have been sent to the console."""
        return self._aim is None and all(p.arrived for p in self.pens.values())

    def say(self, passed: float) -> None:
        """Send the state of hands and pedals to the console; `passed` is the time in s since the last call.

        The hands are released `IDLE_TIMEOUT` s after the last request, unless a pedal is pressed.
        """
        if self.client is None:
            return
        self._idle += passed
        if self._idle > IDLE_TIMEOUT and self.settled and not (self.clutch or self.camera):
            self.release()
            return
        reading = self.console.reading
        if self._aim is not None:
            self._towards_aim(self._aim, reading["mode"])
        controls_tools = reading["owner"] == self.client and not reading["silent"] and reading["mode"] == "instruments"
        at_rest = self.console.planning.phase in RESTING_PHASES
        camera_pedal = self.camera or self._aim is not None
        for hand, pen in self.pens.items():
            follows = bool(reading["hands"][hand]["follows"])
            if self.clutch or camera_pedal or follows or at_rest or not pen.used:
                pen.next(passed)
            elif controls_tools and reading["heard"] >= max(self._first, pen.rolled):
                # The tool keeps its attitude when it starts to follow, so this rotation does not move the tool.
                roll = spatial.rotation_z(HOLD_ROTATION)
                pen.rolled = self._number
                pen.turned = pen.turned @ roll
                pen.R = pen.R @ roll
        states = []
        for k, hand in enumerate(HANDS):
            pen = self.pens[hand]
            pose = spatial.pose(pen.turned, pen.at)
            states.append(HandState(k, self.clutch, camera_pedal, self._number, pose, pen.gripped))
        self._number = (self._number + 1) % 2**32  # the number has 32 bits in a packet
        try:
            self.console.give(self.client, *states)
        except HeldError:  # another device has taken the hands
            self.release()

    def settle(self, hand: str) -> None:
        """If a tool could not reach its goal, move the handle back to the tool; the tool then follows the next motion.

        In planning mode, the handle is not moved, because the arm is at rest.
        """
        if self.client is None or self.console.planning.phase != "off":
            return
        if not self.console.reading["hands"][hand]["follows"]:
            return
        goal = self.console.goal(hand)
        tool = self.console.tool(hand)
        if not np.allclose(goal, tool, rtol=0, atol=1e-9):
            self._shift(hand, goal, tool)

    def _shift(self, hand: str, T_old: Array, T_new: Array) -> None:
        R = self.console.view[:3, :3]
        displacement = R.T @ (T_new[:3, 3] - T_old[:3, 3])
        turn = R.T @ T_new[:3, :3] @ T_old[:3, :3].T @ R
        if self.camera and not self.clutch:
            self._shift_both(displacement, turn)
            return
        pen = self.pens[hand]
        scale = float(np.clip(self.console.reading["scale"], *SCALE))
        pen.used = True
        pen.p = pen.p + displacement / scale
        # Conversion to a quaternion and back keeps the matrix orthonormal.
        pen.R = spatial.matrix_from_quat_wxyz(spatial.quat_from_matrix_wxyz(turn @ pen.R))

    def _shift_both(self, displacement: Array, turn: Array) -> None:
        """Move both hands so that the scene moves by `displacement` (3,) and by the part of `turn` about z."""
        right = self.pens["right"]
        left_pen = self.pens["left"]
        middle = (right.p + left_pen.p) / 2 + displacement / self._drag.scale
        half = (right.p - left_pen.p) / 2
        half = spatial.rotation_z(spatial.angle_about_z(turn)) @ half
        right.p = middle + half
        left_pen.p = middle - half

    def _towards_aim(self, aim: _Aim, mode: str) -> None:
        right = self.pens["right"]
        left_pen = self.pens["left"]
        camera_pose = self.console.camera_at
        if aim.at is None:
            if mode != "camera":
                for pen in (right, left_pen):
                    pen.rest()  # the hands do not move until the pedal has taken effect
                return
            aim.at = camera_pose.copy()
            aim.right = right.at.copy()
            aim.left = left_pen.at.copy()
        right.p, left_pen.p = camera.hands(aim.at, aim.wanted, aim.right, aim.left, self._drag)
        if np.allclose(camera_pose, aim.wanted, rtol=0, atol=1e-7):
            self._aim = None
            for pen in (right, left_pen):
                pen.rest()
