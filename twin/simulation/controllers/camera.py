"""Move the camera by both hands: their midpoint changes pan, tilt and zoom, the line between them changes roll.

Equations (3) and (4) of `console` are used in their corrected reading. The camera rotates about its remote centre:
T = Ry(pan) Rx(tilt) Tz(-depth) Rz(roll), with the view along -z, x to the right and y up in the picture. The scene
moves with the hands, so the camera moves in the opposite direction.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array, length
from twin.core.units import DEG, MM
from twin.formula import symbolic
from twin.formula.evaluator import Evaluator
from twin.formula.symbol import from_sx, to_sx
from twin.simulation.controllers.console_equations import console
from twin.simulation.controllers.pedals import CAMERA
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import CAMERA_AT, CAMERA_VIEW, CONSOLE_MODE, HAND_POSE, ROBOT_GOAL

X, Y, Z = np.eye(3)


@dataclass(frozen=True)
class CameraDrag:
    """Parameters of the camera motion by both hands.

    Attributes:
        scale: motion of the scene divided by motion of the hands' midpoint (0.2 as in the da Vinci Research Kit).
        lever: distance in m from the lens to the scene (ASSUMED). The lens is at the distance `depth` from the remote
            centre.
        lower, upper: limits of pan, tilt, depth and roll in rad and m.
        rate: largest rates of pan, tilt, depth and roll in rad/s and m/s.
    """

    scale: float = 0.2
    lever: float = 0.05
    lower: tuple[float, float, float, float] = (-90 * DEG, -65 * DEG, 0.0, -88 * DEG)
    upper: tuple[float, float, float, float] = (90 * DEG, 44 * DEG, 0.255, 88 * DEG)
    rate: tuple[float, float, float, float] = (30 * DEG, 30 * DEG, 0.06, 30 * DEG)


class CameraDragging:
    """Control law that moves a camera by two hands, tick by tick.

    Attributes:
        at: (4,) current pan (rad), tilt (rad), depth (m) and roll (rad).
    """

    def __init__(self, at: Array, dt: float, drag: CameraDrag | None = None) -> None:
        """Start at pan, tilt, depth and roll `at` (4,) in rad and m; `dt` is the duration of a tick in s."""
        self.at = np.array(at, float)
        self.drag = drag or CameraDrag()
        # The attributes below are views into the inputs of the compiled function.
        z, self._step = _compile(self.drag, dt).bind()
        self._hands, self._start_hands, self._start_at, self._at = np.split(z, (6, 12, 16))
        self._is_coupled = False

    def release(self) -> None:
        """End the motion; the next step starts a new one."""
        self._is_coupled = False

    def step(self, right: Array, left: Array) -> Array:
        """Return pan, tilt, depth, roll (4,) in rad and m after one tick.

        Args:
            right: (3,) position of the right hand in m in the axes of the picture, from any fixed origin.
            left: (3,) position of the left hand in m, in the same axes.
        """
        self._hands[:3] = right
        self._hands[3:] = left
        self._at[:] = self.at
        if not self._is_coupled:
            self._start_hands[:] = self._hands
            self._start_at[:] = self.at
            self._is_coupled = True
        self.at = self._step()
        return self.at


def _compile(drag: CameraDrag, dt: float) -> Evaluator:
    """Compile the function of one tick; its result is the camera's next pan, tilt, depth and roll (4).

    Its arguments are the positions of both hands (6) now and at the start of the motion, then the camera's pan, tilt,
    depth and roll (4) at the start of the motion and now.
    """
    z = ca.SX.sym("z", 20)
    right, left, right_0, left_0, at_0, at = ca.vertsplit(z, (0, 3, 6, 9, 12, 16, 20))
    laws = console().laws
    d_R, d_L = laws["eq3"](from_sx(right_0), from_sx(right), from_sx(left_0), from_sx(left))
    turn = to_sx(laws["eq4"](from_sx(right_0), from_sx(left_0), d_R, d_L, Z)[0])
    # of the midpoint of the hands, scaled, in the axes of the picture
    scene_motion = drag.scale * ((right + left) - (right_0 + left_0)) / 2
    # the axes of pan and tilt do not roll with the picture
    roll = at_0[3] - turn
    along = scene_motion[0] * ca.cos(roll) - scene_motion[1] * ca.sin(roll)
    across = scene_motion[1] * ca.cos(roll) + scene_motion[0] * ca.sin(roll)
    scene_distance = at_0[2] + drag.lever  # from the remote centre
    target = at_0 + ca.vertcat(along / scene_distance, -across / scene_distance, scene_motion[2], -turn)
    target = ca.fmin(ca.fmax(target, ca.DM(drag.lower)), ca.DM(drag.upper))
    largest_step = ca.DM(drag.rate) * dt
    change = ca.fmin(ca.fmax(target - at, -largest_step), largest_step)
    return Evaluator("drag_camera", z, at + change)


def view(at: Array) -> Array:
    """Return the pose (4, 4) of the picture in the remote centre's frame; `at`: pan, tilt, depth, roll in rad and m."""
    return np.array(ca.DM(_view(ca.DM(at))))


def _view(at: ca.SX | ca.DM) -> ca.SX:
    """Return the pose of `view` as an expression."""
    R = symbolic.rotation_y(at[0]) @ symbolic.rotation_x(at[1])
    return symbolic.pose(R @ symbolic.rotation_z(at[3]), -at[2] * R[:, 2])


def at_of_view(T: Array) -> Array:
    """Return pan, tilt, depth and roll (4,) for a pose T (4, 4) of the picture: the inverse of `view`.

    Raises:
        WorldError: the line of sight does not pass through the remote centre.
    """
    z = T[:3, 2]  # opposite to the line of sight
    pan = np.arctan2(z[0], z[2])
    tilt = -np.arcsin(np.clip(z[1], -1, 1))
    depth = -float(T[:3, 3] @ z)
    R_roll = (spatial.exp_so3(pan * Y) @ spatial.exp_so3(tilt * X)).T @ T[:3, :3]
    at = np.array([pan, tilt, depth, spatial.angle_about_z(R_roll)])
    if not np.allclose(view(at), T, atol=1e-6):
        distance = length(view(at)[:3, 3] - T[:3, 3])
        raise WorldError(
            f"the camera's line of sight passes {distance / MM:.3g} mm from its remote centre; correct its pose"
        )
    return at


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
        law: CameraDragging,
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
            T_world_base: (4, 4) pose of the base of the camera's arm; None: the World's origin.
            T_view_tool: (4, 4) tool pose of the camera's arm in the frame of the picture; None: identity.
        """
        self.camera = camera
        self.law = law
        self._right = HAND_POSE.of(right)
        self._left = HAND_POSE.of(left)
        self._R_view_hand = T_view_hand[:3, :3]
        T_base_world = spatial.inverse(np.eye(4) if T_world_base is None else T_world_base)
        if T_view_tool is None:
            T_view_tool = np.eye(4)
        at = ca.SX.sym("at", 4)
        T_world_view = ca.DM(T_world_centre) @ _view(at)
        T_base_tool = ca.DM(T_base_world) @ T_world_view @ ca.DM(T_view_tool)
        poses = ca.vertcat(symbolic.flat(T_world_view), symbolic.flat(T_base_tool))
        self._z, self._poses = Evaluator("camera_poses", at, poses).bind()
        self._at = CAMERA_AT.of(camera)
        self._view = CAMERA_VIEW.of(camera)
        self._goal = ROBOT_GOAL.of(camera)
        self.outputs = self._signals()

    def attach(self, signals: Signals, memory: Mapping[str, Array]) -> None:
        """Store a view of the signal `console.mode`."""
        self._mode = signals.now[CONSOLE_MODE.name].item

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Move the camera while the camera pedal is pressed."""
        if self._mode() != CAMERA:
            self.law.release()
            return {}
        right = self._R_view_hand @ signals[self._right].reshape(4, 4)[:3, 3]
        left = self._R_view_hand @ signals[self._left].reshape(4, 4)[:3, 3]
        self.law.step(right, left)
        return self._signals()

    def _signals(self) -> dict[str, Array]:
        self._z[:] = self.law.at
        poses = self._poses()
        return {self._at: self.law.at, self._view: poses[:16], self._goal: poses[16:]}


class FixedCamera(Block):
    """Writes the signals of a camera that does not move: `<camera>.view` (16,) and `<camera>.at` (4,), which is 0."""

    def __init__(self, camera: str, T_world_view: Array) -> None:
        """Name the camera's robot; `T_world_view` (4, 4) is the pose of the picture in the World."""
        self.outputs = {CAMERA_VIEW.of(camera): T_world_view.ravel(), CAMERA_AT.of(camera): np.zeros(4)}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Write nothing: the first values remain."""
        return {}
