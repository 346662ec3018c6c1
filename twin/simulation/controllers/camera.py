"""Move the camera by both hands: pan, tilt, zoom by their midpoint, roll by the line between them, eqs (3), (4).

The equations are used in their corrected reading. The camera turns about its remote centre: T = Ry(pan) Rx(tilt)
Tz(-depth) Rz(roll), with the view along -z, x to the right and y up in the picture. The scene moves with the hands, so
the camera moves in the opposite direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.simulation.controllers.console import Console, console
from twin.simulation.controllers.pedals import CAMERA
from twin.simulation.world import Block, Signals

X, Y, Z = np.eye(3)


@dataclass(frozen=True)
class Drag:
    """Parameters of the camera motion by both hands.

    Attributes:
        scale: scene motion per motion of the hands' midpoint (0.2 as in the da Vinci Research Kit).
        lever: distance in m from the lens to the scene; the lens is at `depth` from the remote centre (ASSUMED).
        lower, upper: limits of pan, tilt, depth and roll in rad and m.
        rate: largest rates of pan, tilt, depth and roll in rad/s and m/s.
    """

    scale: float = 0.2
    lever: float = 0.05
    lower: tuple[float, float, float, float] = (-90 * DEG, -65 * DEG, 0.0, -88 * DEG)
    upper: tuple[float, float, float, float] = (90 * DEG, 44 * DEG, 0.255, 88 * DEG)
    rate: tuple[float, float, float, float] = (30 * DEG, 30 * DEG, 0.06, 30 * DEG)


class Dragging:
    """Control law that moves a camera by two hands, tick by tick.

    Attributes:
        at: (4,) current pan, tilt in rad, depth in m, roll in rad.
    """

    def __init__(self, at: Array, dt: float, drag: Drag | None = None, laws: Console | None = None) -> None:
        """Start at `at` (4,): pan, tilt, depth, roll; dt is the duration of a tick in s."""
        self.at, self.dt, self.drag, self.laws = np.array(at, float), dt, drag or Drag(), laws or console()
        self._hold: tuple[Array, Array, Array] | None = None

    def step(self, right: Array, left: Array, coupled: bool) -> Array:
        """Return pan, tilt, depth, roll (4,) in rad and m after one tick.

        Args:
            right: (3,) position of the right hand in m in the axes of the picture, from any fixed origin.
            left: (3,) position of the left hand in m, in the same axes.
            coupled: whether the hands move the camera (camera pedal pressed).
        """
        if not coupled:
            self._hold = None
            return self.at
        if self._hold is None:
            self._hold = np.array(right, float), np.array(left, float), self.at
        right_0, left_0, at = self._hold
        turn = self.laws.turns(right_0, right, left_0, left, Z)[0]
        d = self.drag.scale * ((right + left) - (right_0 + left_0)) / 2
        rho = at[3] - turn
        along = d[0] * np.cos(rho) - d[1] * np.sin(rho)  # the axes of pan and tilt do not roll with the picture
        across = d[1] * np.cos(rho) + d[0] * np.sin(rho)
        reach = at[2] + self.drag.lever
        wanted = at + np.array([along / reach, -across / reach, d[2], -turn])
        wanted = np.minimum(np.maximum(wanted, self.drag.lower), self.drag.upper)
        most = np.array(self.drag.rate) * self.dt
        self.at = self.at + np.minimum(np.maximum(wanted - self.at, -most), most)
        return self.at


def view(at: Array) -> Array:
    """Return the pose (4, 4) of the picture about the remote centre; at: pan, tilt, depth, roll in rad and m."""
    R = spatial.exp_so3(at[0] * Y) @ spatial.exp_so3(at[1] * X)
    return spatial.pose(R @ spatial.exp_so3(at[3] * Z), -at[2] * R[:, 2])


def looking(T: Array) -> Array:
    """Return pan, tilt, depth and roll (4,) for a picture at T (4, 4) about the remote centre: inverse of `view`.

    Raises:
        WorldError: the line of sight does not pass through the remote centre.
    """
    R, z = T[:3, :3], T[:3, 2]
    pan, tilt, depth = np.arctan2(z[0], z[2]), -np.arcsin(np.clip(z[1], -1, 1)), -float(T[:3, 3] @ z)
    R_roll = (spatial.exp_so3(pan * Y) @ spatial.exp_so3(tilt * X)).T @ R
    at = np.array([pan, tilt, depth, spatial.angle_about_z(R_roll)])
    if not np.allclose(view(at), T, atol=1e-6):
        off = float(np.linalg.norm(view(at)[:3, 3] - T[:3, 3]))
        raise WorldError(
            f"the camera does not look along a line through its remote centre: {off / MM:.3g} mm beside it"
        )
    return at


def hands(at: Array, wanted: Array, right: Array, left: Array, drag: Drag) -> tuple[Array, Array]:
    """Return where both hands (3,) drag the camera from `at` to `wanted`: inverse of `Dragging.step`.

    Args:
        at: (4,) pan, tilt, depth, roll when the hands were coupled, in rad and m.
        wanted: (4,) pan, tilt, depth, roll to reach, within the limits of `drag`.
        right: (3,) position of the right hand when it was coupled, in m in the axes of the picture.
        left: (3,) position of the left hand, likewise.
        drag: parameters of the camera motion.
    """
    reach, rho = at[2] + drag.lever, wanted[3]
    along, across = (wanted[0] - at[0]) * reach, (at[1] - wanted[1]) * reach
    way = np.array(
        [
            along * np.cos(rho) + across * np.sin(rho),
            across * np.cos(rho) - along * np.sin(rho),
            wanted[2] - at[2],
        ]
    )
    middle, half = (right + left) / 2 + way / drag.scale, spatial.exp_so3((at[3] - rho) * Z) @ (right - left) / 2
    return middle + half, middle - half


class HandsToCamera(Block):
    """Reads `<right>.pose`, `<left>.pose` (16,) and `console.mode`; moves a camera.

    Writes `<camera>.at` (4,): pan, tilt, depth and roll; `<camera>.view` (16,): pose of the picture in the World; and
    `<camera>.goal` (16,): tool pose in the base of the camera's arm.
    """

    def __init__(
        self,
        camera: str,
        right: str,
        left: str,
        law: Dragging,
        T_view_hand: Array,
        T_world_centre: Array,
        T_world_base: Array | None = None,
        T_view_tool: Array | None = None,
    ) -> None:
        """Connect two hands to a camera.

        Args:
            camera: name of the camera and of its arm in the World.
            right: name of the right hand.
            left: name of the left hand.
            law: control law with the start values.
            T_view_hand: (4, 4) pose of {H} in the frame of the picture.
            T_world_centre: (4, 4) frame of the remote centre: the picture's frame at pan, tilt, depth and roll 0.
            T_world_base: (4, 4) base of the camera's arm; None: the World's origin.
            T_view_tool: (4, 4) tool of the camera's arm in the frame of the picture; None: identity.
        """
        self.camera, self.right, self.left, self.law = camera, right, left, law
        self._R, self._T_world_centre = T_view_hand[:3, :3], T_world_centre
        self._T_base_world = spatial.inverse(np.eye(4) if T_world_base is None else T_world_base)
        self._T_view_tool = np.eye(4) if T_view_tool is None else T_view_tool
        self.outputs = self._signals()

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Move the camera while the camera pedal is pressed."""
        right, left = (self._R @ signals[f"{n}.pose"].reshape(4, 4)[:3, 3] for n in (self.right, self.left))
        before = self.law.at
        return (
            {} if self.law.step(right, left, bool(signals["console.mode"][0] == CAMERA)) is before else self._signals()
        )

    def _signals(self) -> dict[str, Array]:
        T = self._T_world_centre @ view(self.law.at)
        at, goal = self.law.at, self._T_base_world @ T @ self._T_view_tool
        return {f"{self.camera}.at": at, f"{self.camera}.view": T.ravel(), f"{self.camera}.goal": goal.ravel()}
