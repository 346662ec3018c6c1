"""Move a tool by a hand: start condition, control law, and jumps of the hand.

The control law is that of the da Vinci Research Kit: p = p0 + s (h - h0) and R = R_H A0. A0 = R_H0^T R0 is the rotation
between hand and tool at the time when the hand was coupled (index 0); A0 stays constant. Here, the law is computed by
eqs (1) and (2) of `console`. The hand is coupled again after the clutch, when the motion scale or the frame of the view
changes, and when the hand jumps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.kinematics import Kinematics
from twin.simulation.controllers.console_equations import Console, console
from twin.simulation.controllers.hand_step import HandPace, HandStep
from twin.simulation.controllers.instrument_pivot import InstrumentPivot
from twin.simulation.controllers.pedals import TOOLS
from twin.simulation.controllers.plan_states import AIM, OFF, RUN
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import (
    CAMERA_VIEW,
    CONSOLE_MODE,
    CONSOLE_TAPS,
    DEVICE_FULCRUM,
    DEVICE_SCALE,
    HAND_GRIP,
    HAND_POSE,
    ROBOT_ENCODER,
    ROBOT_FOLLOWS,
    ROBOT_GOAL,
    ROBOT_JUMPS,
    ROBOT_PLANNED,
    ROBOT_TARGET,
)

SCALE_RANGE = (0.05, 1.0)
"""Smallest and largest motion scale."""


_START_ANGLE = 5 * DEG
"""Largest angle in rad between hand and tool at the first start."""

_RESTART_ANGLE = 2 * DEG
"""The same when the hand starts again after the clutch."""

_HELD_GRIP = 40 * DEG
_HELD_ROLL = 4 * DEG
"""Gripper travel and rotation of the handle about its axis in rad; either shows that a person holds the handle."""

_COMBINED_SHARE = 0.8
"""Smaller motions also suffice if their sum exceeds this part of the sum of `_HELD_GRIP` and `_HELD_ROLL`."""


def is_held(grip: float, roll: float) -> bool:
    """Return whether gripper travel and handle roll, both in rad, show that a person holds the handle."""
    return grip >= _HELD_GRIP or roll >= _HELD_ROLL or grip + roll > _COMBINED_SHARE * (_HELD_GRIP + _HELD_ROLL)


class FollowingControl:
    """Control law that moves the tool of one arm by a hand, tick by tick.

    Attributes:
        goal: (4, 4) commanded pose of the tool in {RB}.
        started: whether the start condition was met.
        follows: whether the tool currently follows the hand.
        jumps: number of jumps of the hand so far.
    """

    def __init__(
        self,
        tool: Array,
        dt: float,
        *,
        aligns: bool = False,
        pace: HandPace | None = None,
        laws: Console | None = None,
    ) -> None:
        """Start with the tool at rest.

        Args:
            tool: (4, 4) pose of the tool in {RB}.
            dt: duration of one tick in s.
            aligns: whether motors of the device align the handle with the tool; the tool then follows only after the
                alignment.
            pace: maximum speeds and thresholds of jumps; None: the defaults.
            laws: equations of the console; None: the correct reading.
        """
        self.goal = np.array(tool, float)
        self.aligns = aligns
        self.started = False
        self.follows = False
        self.jumps = 0
        self._hand_step = HandStep(laws or console(), pace or HandPace(), dt)
        self._wanted = self.goal
        self._coupling: tuple[Array, float] = np.eye(4), 1.0  # pose of {H} and scale since the hand was coupled
        self._travel: _Travel | None = None

    def release(self) -> None:
        """Stop following the hand; the goal remains."""
        self.follows = False

    def step(self, hand: Array, grip: float, tool: Array, T: Array, scale: float) -> Array:
        """Return the commanded tool pose (4, 4) in {RB} after one tick.

        Args:
            hand: (4, 4) pose W of the handle in {H}.
            grip: angle of the gripper in rad.
            tool: (4, 4) current tool pose in {RB}.
            T: (4, 4) pose of {H} in {RB}.
            scale: tool motion divided by hand motion, limited to `SCALE_RANGE`.
        """
        hand_step = self._hand_step
        hand_step(hand, self.goal)
        if not hand_step.rigid:  # ignore an invalid pose
            self.follows = False
            return self.goal
        scale = min(max(scale, SCALE_RANGE[0]), SCALE_RANGE[1])
        if not self.follows:
            if not self._may_begin(hand, grip, tool, T):
                return self.goal
            self.goal = np.array(tool, float)
            self._couple(hand, self.goal, T, scale, hand)
            self.started = True
            self.follows = True
        elif hand_step.jumped:
            self.jumps += 1
            self._couple(hand, self._wanted, *self._coupling, hand)
        elif self._has_other_coupling(T, scale):
            self._couple(hand_step.last.copy(), self._wanted, T, scale, hand)
        self._wanted = hand_step.wanted
        self.goal = hand_step.goal
        hand_step.last[...] = hand
        return self.goal

    def _has_other_coupling(self, T: Array, scale: float) -> bool:
        """Return whether pose T (4, 4) of {H} in {RB}, or the scale, are not those with which the hand was coupled."""
        T_coupled, scale_coupled = self._coupling
        if scale != scale_coupled:
            return True
        return T is not T_coupled and bool((T_coupled != T).any())  # the same array is the usual case

    def _couple(self, W_0: Array, P_0: Array, T: Array, scale: float, hand: Array) -> None:
        """Couple the hand at W_0 with the tool at P_0, each (4, 4); then repeat this tick with the pose `hand`."""
        self._coupling = T, scale
        self._hand_step.couple(W_0, P_0, T, scale)
        self._hand_step(hand, self.goal)

    def _may_begin(self, hand: Array, grip: float, tool: Array, T: Array) -> bool:
        angle = 0.0  # without motors, handle and tool need not be aligned
        if self.aligns:
            angle = float(spatial.rotation_angle(T[:3, :3] @ hand[:3, :3] @ tool[:3, :3].T))
        if self.started:
            return angle < _RESTART_ANGLE
        if self._travel is None:
            self._travel = _Travel(hand[:3, :3].copy(), grip)
        else:
            self._travel.add(hand[:3, :3], grip)
        return angle < _START_ANGLE and is_held(self._travel.grip, self._travel.roll)


class _Travel:
    """Ranges of the gripper angle and of the roll of the handle since the first pose, both in rad."""

    def __init__(self, R: Array, grip: float) -> None:
        """Start at the orientation R (3, 3) of the handle and an angle of the gripper in rad."""
        self._R = R
        self._grips = [grip, grip]
        self._rolls = [0.0, 0.0]

    def add(self, R: Array, grip: float) -> None:
        """Add an orientation R (3, 3) of the handle and an angle of the gripper in rad."""
        roll = float(spatial.angle_about_z(self._R.T @ R))
        self._grips = [min(self._grips[0], grip), max(self._grips[1], grip)]
        self._rolls = [min(self._rolls[0], roll), max(self._rolls[1], roll)]

    @property
    def grip(self) -> float:
        """Travel of the gripper in rad."""
        return self._grips[1] - self._grips[0]

    @property
    def roll(self) -> float:
        """Range of the roll in rad."""
        return self._rolls[1] - self._rolls[0]


@dataclass(frozen=True)
class FollowingArm:
    """An arm that a hand can control.

    Attributes:
        robot: name of the robot in the World.
        kin: the robot's equations.
        T_world_base: (4, 4) pose of the robot's base in the World.
        pivot: the instrument in its port; None: the hand controls the tool, and the mechanism keeps the instrument in
            the port.
    """

    robot: str
    kin: Kinematics
    T_world_base: Array
    pivot: InstrumentPivot | None = None


class HandToPose(Block):
    """Moves the tools of the arms of one hand; one arm at a time follows the hand.

    Reads `<hand>.pose` (16,), W in {H} row by row, `<hand>.grip` in rad, `<device>.scale`, `console.mode`,
    `console.taps`, `<robot>.encoder` of each arm and, for a movable camera, `<camera>.view` (16,) in the World. Writes
    `<robot>.goal` (16,), the tool pose in the robot's base, `<robot>.follows` (0 or 1), and `<robot>.jumps`, the number
    of jumps of the hand. A quick tap of the clutch selects the next arm. If the device writes `<device>.fulcrum`, the
    value 1 means that the hand controls the outer end of an instrument with a pivot.

    With `plans`, this block also reads `<robot>.planned` of `devices.plans`, and writes `<robot>.target` (17,): 1
    while the hand moves the target of a plan, else 0; then the pose (16,) of the target. While the hand moves a target,
    the tool is at rest; afterwards, the tool follows the plan.
    """

    def __init__(
        self,
        hand: str,
        device: str,
        arms: Sequence[FollowingArm],
        q: Sequence[Array],
        T_view_hand: Array,
        *,
        view: Array | str,
        dt: float = 1e-3,
        plans: bool = False,
    ) -> None:
        """Start with the first arm.

        Args:
            hand: name of the hand.
            device: name of the device of pedals and scale.
            arms: the arms, in the order in which taps select them.
            q: joint values (n,) of each arm at the start.
            T_view_hand: (4, 4) pose of {H} in the frame of the picture.
            view: (4, 4) frame of the picture in the World, or the name of the movable camera that writes this frame.
            dt: duration of one tick in s.
            plans: whether a device writes planned motions of the arms.

        Raises:
            WorldError: there is no arm.
        """
        if not arms:
            raise WorldError(f"hand '{hand}' has no arm to control; give at least one")
        self.hand = hand
        self.device = device
        self.arms = tuple(arms)
        self.view = view
        self._T_view_hand = T_view_hand
        self._view_and_poses: tuple[bytes, list[Array]] = b"", []
        self._is_direct = False
        self._plans = plans
        self._states = [OFF] * len(self.arms)
        self._T_base_world = []
        self._tools = []
        self._laws = []
        self.outputs = {}
        for arm, x in zip(arms, q, strict=True):
            T_base_tool = arm.kin.forward(x)
            self._T_base_world.append(spatial.inverse(arm.T_world_base))
            self._tools.append(T_base_tool)
            self._laws.append(FollowingControl(T_base_tool, dt))
            self.outputs[ROBOT_GOAL.of(arm.robot)] = T_base_tool.ravel()
            self.outputs[ROBOT_FOLLOWS.of(arm.robot)] = 0.0
            self.outputs[ROBOT_JUMPS.of(arm.robot)] = 0.0
            if plans:
                self.outputs[ROBOT_TARGET.of(arm.robot)] = [0, *T_base_tool.ravel()]

    def attach(self, signals: Signals, memory: Mapping[str, Array]) -> None:
        """Store views of the signals that this block reads."""
        now = signals.now
        self._hand_pose = now[HAND_POSE.of(self.hand)].reshape(4, 4)
        self._read_grip = now[HAND_GRIP.of(self.hand)].item
        self._read_scale = now[DEVICE_SCALE.of(self.device)].item
        self._read_mode = now[CONSOLE_MODE.name].item
        self._read_taps = now[CONSOLE_TAPS.name].item
        self._read_fulcrum = None
        if DEVICE_FULCRUM.of(self.device) in signals:
            self._read_fulcrum = now[DEVICE_FULCRUM.of(self.device)].item
        if isinstance(self.view, str):
            self._view_values = now[CAMERA_VIEW.of(self.view)]
        else:
            self._view_values = self.view
        self._outputs_of_arms = []
        self._planned = []
        self._target_flags = []
        self._targets = []
        for arm in self.arms:
            goal = memory[ROBOT_GOAL.of(arm.robot)].reshape(4, 4)
            self._outputs_of_arms.append((goal, memory[ROBOT_FOLLOWS.of(arm.robot)], memory[ROBOT_JUMPS.of(arm.robot)]))
            if self._plans:
                target = memory[ROBOT_TARGET.of(arm.robot)]
                self._planned.append(now[ROBOT_PLANNED.of(arm.robot)])
                self._target_flags.append(target[:1])
                self._targets.append(target[1:].reshape(4, 4))

    def step(self, signals: Signals, t: float, dt: float) -> None:
        """Move the selected arm; the other arms remain at rest."""
        is_direct = self._read_fulcrum is not None and self._read_fulcrum() > 0.5
        if is_direct is not self._is_direct:
            self._is_direct = is_direct
            for law in self._laws:
                law.release()  # the hand is coupled again, with the other end of the instrument
        active = -1  # no arm
        if self._read_mode() == TOOLS:
            active = int(self._read_taps()) % len(self._laws)
        for i, (law, (goal, follows, jumps)) in enumerate(zip(self._laws, self._outputs_of_arms, strict=True)):
            state = self._state(i, signals) if self._plans else OFF
            if i == active and state == OFF:
                if not law.follows:  # the tool's current pose is used when the hand is coupled
                    self._tools[i] = self._present_tool(i, signals)
                self._move(i, law, goal)
            elif i == active and state == AIM:
                if not law.follows:
                    self._tools[i] = self._targets[i].copy()
                self._move(i, law, self._targets[i])
            else:
                law.release()
            if state == RUN:
                goal[...] = self._planned[i][1:].reshape(4, 4)
            follows[0] = law.follows and state == OFF
            jumps[0] = law.jumps
            if self._plans:
                self._target_flags[i][0] = law.follows and state == AIM

    def _present_tool(self, i: int, signals: Signals) -> Array:
        """Return the present pose (4, 4) of the tool of an arm."""
        return self.arms[i].kin.forward(signals[ROBOT_ENCODER.of(self.arms[i].robot)], self._tools[i])

    def _state(self, i: int, signals: Signals) -> float:
        """Return the state of an arm's plan (`controllers.plan_states`); if it has changed, couple the hand again."""
        state = self._planned[i].item(0)
        previous = self._states[i]
        if state != previous:
            self._states[i] = state
            law = self._laws[i]
            law.release()
            if state == AIM and previous == OFF:
                self._targets[i][...] = self._present_tool(i, signals)
            if state == AIM:
                law.goal = self._targets[i].copy()
            else:
                law.goal = self._outputs_of_arms[i][0].copy()
        return state

    def _move(self, i: int, law: FollowingControl, goal: Array) -> None:
        """Write the goal (4, 4) of an arm that the hand moves."""
        T_base_hand = self._poses_of_hand()[i]
        pivot = self.arms[i].pivot
        controlled = self._tools[i]  # pose that the hand controls: of the tool, or of the instrument's outer end
        if pivot is None:
            goal[...] = law.step(self._hand_pose, self._read_grip(), controlled, T_base_hand, self._read_scale())
            return
        if self._is_direct and not law.follows:
            controlled = pivot.outer(controlled)
        controlled = law.step(self._hand_pose, self._read_grip(), controlled, T_base_hand, self._read_scale())
        if law.follows:
            goal[...] = pivot.tool(controlled, self._is_direct)

    def _poses_of_hand(self) -> list[Array]:
        """Return the pose (4, 4) of {H} in the base of each arm; recompute the poses only if the view has moved."""
        view = self._view_values.tobytes()
        if view != self._view_and_poses[0]:
            T_world_hand = self._view_values.reshape(4, 4) @ self._T_view_hand
            self._view_and_poses = view, [T @ T_world_hand for T in self._T_base_world]
        return self._view_and_poses[1]
