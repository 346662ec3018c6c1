"""A pen in a hand as the handle of eqs (5) to (7): its coordinates, the pedal, and what a page shows of the robot."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array, length, near_coordinates
from twin.kinematics import Kinematics
from twin.simulation.controllers.pedals import FREE, TOOLS
from twin.simulation.controllers.teleoperation import Teleoperation
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import (
    CONSOLE_MODE,
    CONSOLE_TAPS,
    DEVICE_CLUTCH,
    DEVICE_SILENT,
    HAND_HANDLE,
    HAND_JUMPS,
    HAND_PEDAL,
    HAND_POSE,
    ROBOT_ENCODER,
    ROBOT_FOLLOWS,
    ROBOT_GOAL,
    ROBOT_JUMPS,
    ROBOT_TARGET,
)

LARGEST_MOTION = (0.03, 0.5)
"""Motion of a hand in m and rad in one tick above which the hand has jumped, as at the other consoles (`HandPace`)."""


class PenToHandle(Block):
    """Reads `<hand>.pose` (16,), `<device>.clutch` and `<device>.silent`; writes handle, pedal and jumps of the hand.

    `<hand>.handle` (n,) are the coordinates of the pen in the form of the robot's equations: the pen's position in the
    axes of the base, and its direction as that of a tool which has, for an unrotated pen, the direction at the start.
    `<hand>.pedal` is 1 while the pedal is pressed. It is 0 while the device is silent, and for `period` s after a jump
    of the hand, so that the law takes the next position as a new reference. `<hand>.jumps` counts the jumps.
    """

    def __init__(self, hand: str, device: str, kin: Kinematics, q: Array, R_base_hand: Array, period: float) -> None:
        """Connect a hand to a robot.

        Args:
            hand: name of the hand.
            device: name of the device of the pedals.
            kin: the robot's equations.
            q: (n,) joint values at the start.
            R_base_hand: (3, 3) rotation of {H}, the frame of the hands, in the robot's base.
            period: time in s between two steps of the law.
        """
        self.hand = hand
        self.device = device
        self.kin = kin
        self._R_base_hand = R_base_hand
        self._R_start = kin.forward(q)[:3, :3]
        self._period = period
        self._last_pose = np.eye(4)
        self._free_until = 0.0
        self._was_silent = True  # until the first state of the hand
        self._jumps = 0
        self._is_angle = np.array([unit == "rad" for unit in kin.formula.coordinates.units])
        self._handle: Array | None = None
        self.outputs = {
            HAND_HANDLE.of(hand): self._coordinates(np.eye(4)),
            HAND_PEDAL.of(hand): 0.0,
            HAND_JUMPS.of(hand): 0.0,
        }

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array | float]:
        """Convert the pen's pose of this tick."""
        pose = signals[HAND_POSE.of(self.hand)].reshape(4, 4)
        silent_signal = DEVICE_SILENT.of(self.device)
        is_silent = silent_signal in signals and signals.now[silent_signal][0] > 0.5
        has_jumped = self._has_jumped(pose)
        self._last_pose = pose
        is_pressed = signals.now[DEVICE_CLUTCH.of(self.device)][0] > 0.5
        if is_silent or has_jumped:
            self._free_until = t + self._period
        is_heard = not is_silent and not self._was_silent  # after a silence, a hand may be anywhere
        if has_jumped and is_pressed and is_heard:
            self._jumps += 1
        self._was_silent = is_silent
        is_engaged = is_pressed and t >= self._free_until
        return {
            HAND_HANDLE.of(self.hand): self._coordinates(pose),
            HAND_PEDAL.of(self.hand): float(is_engaged),
            HAND_JUMPS.of(self.hand): float(self._jumps),
        }

    def _has_jumped(self, pose: Array) -> bool:
        """Return whether the hand is farther from its last pose than a hand moves in one tick."""
        distance = length(pose[:3, 3] - self._last_pose[:3, 3])
        angle = spatial.rotation_angle(pose[:3, :3] @ self._last_pose[:3, :3].T)
        largest_distance, largest_angle = LARGEST_MOTION
        return bool(distance > largest_distance or angle > largest_angle)

    def _coordinates(self, pose: Array) -> Array:
        """Return the coordinates (n,) of the pen at `pose` (4, 4) in {H}, with angles nearest to the last ones."""
        turn = self._R_base_hand @ pose[:3, :3] @ self._R_base_hand.T
        T = spatial.pose(turn @ self._R_start, self._R_base_hand @ pose[:3, 3])
        coordinates = self.kin.program.coordinates_of_pose.one(T.ravel())
        if self._handle is not None:
            coordinates = near_coordinates(coordinates, self._handle, self._is_angle)
        self._handle = coordinates
        return coordinates


class PedalFollowing(Block):
    """Writes what pages and reports read of a robot that follows a handle while the pedal is pressed.

    `console.mode` is `TOOLS` while the pedal is pressed, otherwise `FREE`; `<robot>.follows` is 1 or 0 likewise.
    `<robot>.goal` (16,) is the tool pose to which the law moves, or the present pose while the pedal is up.
    `<robot>.jumps` are the jumps of the hand. One robot and no plans: `console.taps` and `<robot>.target` stay 0.
    """

    def __init__(self, robot: str, hand: str, kin: Kinematics, q: Array, law: Teleoperation) -> None:
        """Start at joint values q (n,); `law` is the law of the robot's `HandToTool`, which has stepped before."""
        self.robot = robot
        self.hand = hand
        self.kin = kin
        self.law = law
        self.period = law.dt
        self._T_base_tool = kin.forward(q)
        self._jumps = HAND_JUMPS.of(hand)
        self.outputs = {
            CONSOLE_MODE.name: FREE,
            CONSOLE_TAPS.name: 0.0,
            ROBOT_FOLLOWS.of(robot): 0.0,
            ROBOT_GOAL.of(robot): self._T_base_tool.ravel(),
            ROBOT_JUMPS.of(robot): 0.0,
            ROBOT_TARGET.of(robot): np.zeros(17),
        }

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array | float]:
        """Read handle and pedal of this tick."""
        is_engaged = signals.now[HAND_PEDAL.of(self.hand)][0] > 0.5
        if is_engaged:
            goal = self.kin.program.pose_of_coordinates.one(self.law.goal(signals[HAND_HANDLE.of(self.hand)]))
        else:
            self._T_base_tool = self.kin.forward(signals[ROBOT_ENCODER.of(self.robot)], self._T_base_tool)
            goal = self._T_base_tool
        jumps = 0.0
        if self._jumps in signals:  # a simulated hand does not jump
            jumps = float(signals.now[self._jumps][0])
        return {
            CONSOLE_MODE.name: TOOLS if is_engaged else FREE,
            ROBOT_FOLLOWS.of(self.robot): float(is_engaged),
            ROBOT_GOAL.of(self.robot): goal.ravel(),
            ROBOT_JUMPS.of(self.robot): jumps,
        }
