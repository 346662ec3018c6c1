"""Move a tool by a hand: start condition, control law, and jumps of the hand.

The control law is that of the da Vinci Research Kit: p = p0 + s (h - h0) and R = R_H A0. A0 = R_H0^T R0 is the constant
rotation between hand and tool since the hand was coupled (index 0). Here it is computed by eqs (1) and (2) of
`console`. The hand is coupled again after the clutch, when the motion scale or the frame of the view changes, and when
the hand jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.kinematics import Kinematics
from twin.simulation.controllers.console import Console, console
from twin.simulation.controllers.pedals import TOOLS
from twin.simulation.world import Block, Signals

SCALE = (0.05, 1.0)
"""Smallest and largest motion scale."""


@dataclass(frozen=True)
class Start:
    """Condition that must be met before a hand moves the tool.

    Attributes:
        attitude, again: largest angle in rad between hand and tool at the first start, and after a clutch.
        grip, roll: gripper travel in rad, or rotation of the handle about its axis in rad, that shows that a person
            holds the handle.
        together: if the sum of grip and roll travel exceeds this fraction of the sum of both thresholds, it also shows
            this.
    """

    attitude: float = 5 * DEG
    again: float = 2 * DEG
    grip: float = 40 * DEG
    roll: float = 4 * DEG
    together: float = 0.8

    def shown(self, grip: float, roll: float) -> bool:
        """Return whether the travels in rad of gripper and handle roll show that a person holds the handle."""
        return grip >= self.grip or roll >= self.roll or grip + roll > self.together * (self.grip + self.roll)


@dataclass(frozen=True)
class Pace:
    """Maximum speed of a tool, and threshold for jumps of a hand; ASSUMED: no console publishes them.

    Attributes:
        speed, turn: maximum speeds of the tool, in m/s and rad/s.
        jump, twist: largest hand motion in one tick, in m and rad; after a larger one, the hand is coupled again.
    """

    speed: float = 0.5
    turn: float = 10.0
    jump: float = 0.03
    twist: float = 0.5


class Following:
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
        start: Start | None = None,
        pace: Pace | None = None,
        laws: Console | None = None,
    ) -> None:
        """Start with the tool at rest.

        Args:
            tool: (4, 4) pose of the tool in {RB}.
            dt: duration of one tick in s.
            aligns: whether motors of the device align the handle with the tool; the tool then follows only after the
                alignment.
            start: the start condition; None: the defaults.
            pace: maximum speeds and thresholds of jumps; None: the defaults.
            laws: equations of the console; None: the correct reading.
        """
        self.goal, self.dt, self.aligns = np.array(tool, float), dt, aligns
        self.start, self.pace, self.laws = start or Start(), pace or Pace(), laws or console()
        self.started = self.follows = False
        self.jumps = 0
        self._wanted = self.goal
        self._hold: tuple[Array, Array, Array, float] | None = None
        self._hand: Array | None = None
        self._given: tuple[bytes, bytes, float, bool] | None = None
        self._seen: tuple[Array, float, float, float, float] | None = None

    def step(self, hand: Array, grip: float, tool: Array, T: Array, scale: float, coupled: bool = True) -> Array:
        """Return the commanded tool pose (4, 4) in {RB} after one tick.

        Args:
            hand: (4, 4) pose W of the handle in {H}.
            grip: angle of the gripper in rad.
            tool: (4, 4) current tool pose in {RB}.
            T: (4, 4) pose of {H} in {RB}.
            scale: tool motion per hand motion, limited to `SCALE`.
            coupled: whether the pedals connect this hand with this tool.
        """
        if self._rests(hand, T, scale, coupled):
            return self.goal
        if not _rigid(hand):  # ignore an invalid pose
            self.follows, self._hold, self._hand = False, None, None
            return self.goal
        hand, scale = np.array(hand, float), min(max(float(scale), SCALE[0]), SCALE[1])
        last, self._hand = self._hand, hand
        if not coupled:
            self.follows, self._hold = False, None
            return self.goal
        if not self.follows and not self._may_begin(hand, grip, tool, T):
            return self.goal
        if self._hold is None or last is None:
            self._wanted = self.goal = np.array(tool, float)
            self._hold = hand, self.goal, T, scale
        elif self._jumped(last, hand):
            self.jumps += 1
            self._hold = hand, self._wanted, T, scale
        elif scale != self._hold[3] or (self._hold[2] != T).any():
            self._hold = last, self._wanted, T, scale
        self.started = self.follows = True
        W_0, P_0, T, scale = self._hold
        self._wanted = self.laws.tool(P_0, W_0, hand, T, scale)
        self.goal = _towards(self.goal, self._wanted, self.pace.speed * self.dt, self.pace.turn * self.dt)
        return self.goal

    def _rests(self, hand: Array, T: Array, scale: float, coupled: bool) -> bool:
        """Return whether the input is unchanged and the goal already reached, so that the tick needs no computation."""
        given = (hand.tobytes(), T.tobytes(), scale, coupled)
        same, self._given = given == self._given, given
        return same and self.follows and self.goal is self._wanted

    def _may_begin(self, hand: Array, grip: float, tool: Array, T: Array) -> bool:
        apart = float(spatial.rotation_angle(T[:3, :3] @ hand[:3, :3] @ tool[:3, :3].T)) if self.aligns else 0.0
        if self.started:
            return apart < self.start.again
        roll = 0.0
        if self._seen is not None:
            turn = self._seen[0][:3, :3].T @ hand[:3, :3]
            roll = float(spatial.angle_about_z(turn))
        first, low, high, least, most = self._seen or (hand, grip, grip, roll, roll)
        self._seen = first, min(low, grip), max(high, grip), min(least, roll), max(most, roll)
        _, low, high, least, most = self._seen
        return apart < self.start.attitude and self.start.shown(high - low, most - least)

    def _jumped(self, last: Array, hand: Array) -> bool:
        way = hand[:3, 3] - last[:3, 3]
        if way @ way > self.pace.jump**2:
            return True
        # |R - R'|_F^2 = 4 (1 - cos angle): faster than a matrix logarithm
        apart = hand[:3, :3] - last[:3, :3]
        return float(np.sum(apart * apart)) > 4 * (1 - np.cos(self.pace.twist))


def _rigid(T: Array, tolerance: float = 1e-6) -> bool:
    """Return whether T (4, 4) is a rigid pose; much faster than `spatial.is_pose` for a single pose."""
    (a, b, c, x), (d, e, f, y), (g, h, i, z), last = np.asarray(T, float).tolist()
    off = (
        a * a + b * b + c * c - 1,
        d * d + e * e + f * f - 1,
        g * g + h * h + i * i - 1,
        a * d + b * e + c * f,
        a * g + b * h + c * i,
        d * g + e * h + f * i,
        0.0 * (x + y + z),  # NaN for NaN and infinity, which fails the comparison
    )
    right_handed = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) > 0
    return all(abs(o) < tolerance for o in off) and right_handed and last == [0.0, 0.0, 0.0, 1.0]


def _towards(T: Array, wanted: Array, way: float, turn: float) -> Array:
    """Return the pose reached from T towards `wanted`, by at most `way` in m and `turn` in rad."""
    step = wanted[:3, 3] - T[:3, 3]
    length = float(np.sqrt(step @ step))
    apart = wanted[:3, :3] - T[:3, :3]
    small = float(np.sum(apart * apart)) <= 4 * (1 - np.cos(min(turn, np.pi)))
    if length <= way and small:
        return wanted
    out = wanted.copy()
    if length > way:
        out[:3, 3] = T[:3, 3] + step * (way / length)
    if not small:
        rotation = spatial.log_so3(wanted[:3, :3] @ T[:3, :3].T)
        angle = float(np.linalg.norm(rotation))
        out[:3, :3] = spatial.exp_so3(rotation * (turn / angle)) @ T[:3, :3]
    return out


@dataclass(frozen=True)
class Arm:
    """An arm that a hand can control.

    Attributes:
        robot: name of the robot in the World.
        kin: the robot's equations.
        T_world_base: (4, 4) pose of the robot's base in the World.
    """

    robot: str
    kin: Kinematics
    T_world_base: Array


class HandToPose(Block):
    """Reads a hand, pedals and encoders; writes tool goals of arms, of which one at a time follows the hand.

    Reads `<hand>.pose` (16,), W in {H} row by row, `<hand>.grip` in rad, `<device>.scale`, `console.mode`,
    `console.taps`, `<robot>.encoder` of each arm and, for a movable camera, `<camera>.view` (16,) in the World. Writes
    `<robot>.goal` (16,), the tool pose in the robot's base, `<robot>.follows` (0 or 1), and `<robot>.jumps`, the number
    of jumps of the hand. A quick tap of the clutch selects the next arm.
    """

    def __init__(
        self,
        hand: str,
        device: str,
        arms: Sequence[Arm],
        q: Sequence[Array],
        T_view_hand: Array,
        *,
        view: Array | str,
        dt: float = 1e-3,
        aligns: bool = False,
        start: Start | None = None,
        pace: Pace | None = None,
    ) -> None:
        """Start with the first arm.

        Args:
            hand: name of the hand.
            device: name of the device of pedals and scale.
            arms: the arms, in the order in which taps select them.
            q: joint values (n,) of each arm at the start.
            T_view_hand: (4, 4) pose of {H} in the frame of the picture.
            view: (4, 4) frame of the picture in the World, or the name of the camera that writes this frame.
            dt: duration of one tick in s.
            aligns: see `Following`.
            start: see `Following`.
            pace: see `Following`.

        Raises:
            WorldError: there is no arm.
        """
        if not arms:
            raise WorldError(f"hand '{hand}' has no arm to control; give at least one")
        self.hand, self.device, self.arms, self.view = hand, device, tuple(arms), view
        self._T_view_hand, self._T_base_world = T_view_hand, [spatial.inverse(a.T_world_base) for a in arms]
        self._tools = [a.kin.forward(x) for a, x in zip(arms, q, strict=True)]
        self._laws = [Following(T, dt, aligns=aligns, start=start, pace=pace) for T in self._tools]
        self.outputs = {f"{a.robot}.goal": T.ravel() for a, T in zip(arms, self._tools, strict=True)}
        self.outputs |= {f"{a.robot}.{n}": 0.0 for a in arms for n in ("follows", "jumps")}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array | float]:
        """Move the selected arm; the other arms remain at rest."""
        pose, grip = signals[f"{self.hand}.pose"].reshape(4, 4), float(signals[f"{self.hand}.grip"][0])
        T_world_view = signals[f"{self.view}.view"].reshape(4, 4) if isinstance(self.view, str) else self.view
        tools = signals["console.mode"][0] == TOOLS
        active = int(signals["console.taps"][0]) % len(self.arms)
        scale = float(signals[f"{self.device}.scale"][0])
        out: dict[str, Array | float] = {}
        for i, (arm, law) in enumerate(zip(self.arms, self._laws, strict=True)):
            coupled = tools and i == active
            if coupled and not law.follows:  # the tool's current pose is used when the hand is coupled
                self._tools[i] = arm.kin.forward(signals[f"{arm.robot}.encoder"], self._tools[i])
            T = self._T_base_world[i] @ T_world_view @ self._T_view_hand
            out[f"{arm.robot}.goal"] = law.step(pose, grip, self._tools[i], T, scale, coupled).ravel()
            out[f"{arm.robot}.follows"], out[f"{arm.robot}.jumps"] = float(law.follows), float(law.jumps)
        return out
