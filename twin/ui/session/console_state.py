"""Read the state of a console, as plain data, from the signals of its World; log new problems in the state."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence

import numpy as np

from twin.core import spatial
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.simulation import console_scene, operating_scene
from twin.simulation.console_scene import PEDALS
from twin.simulation.controllers.camera import CameraDrag
from twin.simulation.controllers.instrument_pivot import FULCRUMS
from twin.simulation.controllers.pedals import CAMERA, FREE, TOOLS
from twin.simulation.setup import Member, Setup
from twin.simulation.world import Block, Signals, World
from twin.simulation.world.signal_kinds import (
    CAMERA_AT,
    CONSOLE_MODE,
    DEVICE_SCALE,
    DEVICE_SILENT,
    HAND_FORCE,
    HAPTICS_ON,
    ROBOT_CARRIES,
    ROBOT_FOLLOWS,
    ROBOT_GOAL,
    ROBOT_HOLDS,
    ROBOT_JUMPS,
    ROBOT_OPENING,
    ROBOT_PEDAL,
    ROBOT_Q,
    ROBOT_TARGET,
    ROBOT_TIP,
    ROBOT_TOOL,
)

_STUCK_PEDAL_TIME = 30.0
"""Time in s after which a pedal that is still pressed is reported, because it may be stuck (ASSUMED)."""

_JOINT_LIMIT_TOLERANCE = 1e-6
"""Distance in rad or m from a limit up to which a joint is at it: solvers stop that near."""

_CAMERA_LIMIT_TOLERANCE = 1e-9
"""Distance in rad or m from a limit up to which the camera is at it: it is clipped, so only rounding remains."""

_REPORTED_DISTANCE = 0.5 * MM
"""A joint limit is reported if goal and tool are at least this distance in m apart, or `_REPORTED_ANGLE`."""

_REPORTED_ANGLE = 1 * DEG
"""A joint limit is reported if goal and tool differ by at least this angle in rad, or `_REPORTED_DISTANCE`."""


class ConsoleState:
    """Reader of the state of pedals, hands and camera in a World with a console."""

    def __init__(self, setup: Setup, world: World) -> None:
        """Set the World whose state `read` returns; the World must not have been stepped yet."""
        self._scene = setup.scene
        self._members = setup.members
        self._procedure = setup.procedure
        self._table = console_scene.console_of(setup.scene)
        self._world = world
        self._pressed = 0.0  # time in s since which a pedal is pressed

    def read(self, arms: Mapping[str, str]) -> JsonObject:
        """Return the present state; `arms` maps each hand to the name of the robot that this hand controls."""
        signals = self._world.signals
        mode = float(signals[CONSOLE_MODE.name][0])
        silent = bool(signals[DEVICE_SILENT.of(PEDALS)][0])
        fulcrum = None
        if self._table.instrument_mm:
            fulcrum = FULCRUMS[int(signals[console_scene.FULCRUM][0])]
        hands = {}
        for hand in self._table.hands:
            hands[hand] = self._hand(hand, arms[hand])
        return {
            "silent": silent,
            "mode": _mode_name(mode),
            "scale": float(signals[DEVICE_SCALE.of(PEDALS)][0]),
            "haptics": bool(signals[HAPTICS_ON.name][0]),
            "fulcrum": fulcrum,
            "hands": hands,
            "camera": self._camera_limit(mode),
            "pedal": self._stuck_pedal(mode, silent),
        }

    def _camera_limit(self, mode: float) -> str | None:
        """Return a text on the limit that the camera has reached; None while the hands do not move the camera."""
        if mode != CAMERA:
            return None
        robot = self._scene.cameras[self._table.camera].robot
        at = self._world.signals[CAMERA_AT.of(robot)]
        return camera_limit(at, console_scene.drag(self._table))

    def _stuck_pedal(self, mode: float, silent: bool) -> str | None:
        """Return a text on a pedal that has been pressed for a long time; None without one."""
        t = self._world.t
        if mode == TOOLS or silent:
            self._pressed = t
            return None
        if t - self._pressed < _STUCK_PEDAL_TIME:
            return None
        pedal = "camera" if mode == CAMERA else "clutch"
        return f"the {pedal} pedal has been pressed for {_STUCK_PEDAL_TIME:g} s: release it if it is stuck"

    def _hand(self, hand: str, arm: str) -> JsonObject:
        signals = self._world.signals
        follows = bool(signals[ROBOT_FOLLOWS.of(arm)][0])
        limit = None
        if follows:
            goal = signals[ROBOT_GOAL.of(arm)].reshape(4, 4)
            limit = arm_limit(self._members[arm], signals[ROBOT_Q.of(arm)], goal)
        moves_target = bool(signals[ROBOT_TARGET.of(arm)][0])
        jumps = 0
        for robot in getattr(self._table, hand):
            jumps += int(signals[ROBOT_JUMPS.of(robot)][0])
        state = {"robot": arm, "follows": follows or moves_target, "wall": limit, "jumps": jumps}
        if self._scene.tools:
            state |= self._tools(arm)
        return state

    def _tools(self, arm: str) -> JsonObject:
        """Return an arm's chosen tool; in a procedure also the mounted tool, and why the two tools still differ."""
        signals = self._world.signals
        names = list(self._scene.tools)
        tool = names[int(signals[ROBOT_TOOL.of(arm)][0])]
        if ROBOT_CARRIES.of(arm) not in signals or self._procedure is None:
            return {"tool": tool}
        carries = names[int(signals[ROBOT_CARRIES.of(arm)][0])]
        waits = None
        if carries != tool:
            title = self._scene.tools[tool].title
            waits = f"{title} is not taken yet: {self._before_change(arm, self._procedure.change_mm)}"
        pressed = bool(signals[ROBOT_PEDAL.of(arm)][0] > 0.5)
        opened = bool(signals[ROBOT_OPENING.of(arm)][0] > 0.5)
        active = pressed and self._scene.tools[carries].kind == "cautery"
        return {"tool": tool, "carries": carries, "waits": waits, "open": opened, "active": active}

    def _before_change(self, arm: str, change_mm: float) -> str:
        """Return a text on what the user must do before the tool of an arm is changed."""
        signals = self._world.signals
        if signals[ROBOT_HOLDS.of(arm)][0] >= 0:  # the number of the held object, or -1
            return "first release the held object"
        port = self._port(arm)
        distance = float(np.linalg.norm(signals[ROBOT_TIP.of(arm)] - port)) / MM
        return f"draw the tip back to at most {change_mm:g} mm from its port, now {distance:.0f} mm"

    def _port(self, arm: str) -> Array:
        """Return the port (3,) of an arm in m in the World."""
        for place in self._scene.places:
            if place.name == arm:
                return operating_scene.port_of(place)
        raise KeyError(arm)


def _mode_name(mode: float) -> str:
    if mode == FREE:
        return "nothing"
    if mode == CAMERA:
        return "camera"
    return "instruments"


def arm_limit(member: Member, q: Array, goal: Array) -> str | None:
    """Return a text on the joint limit that keeps an arm, now at q (n,), from its goal T_base_tool (4, 4), or None."""
    T = member.kin.forward(q, goal)
    distance = float(np.linalg.norm(goal[:3, 3] - T[:3, 3]))
    angle = float(spatial.rotation_angle(goal[:3, :3] @ T[:3, :3].T))
    if distance < _REPORTED_DISTANCE and angle < _REPORTED_ANGLE:
        return None
    for k, joint in enumerate(member.mechanism.active):
        if member.kin.auxiliary[k]:  # the gripper is moved by its own input, not by the goal
            continue
        low, high = joint.limits or (-np.inf, np.inf)
        if _at_limit(q[k], low, high, _JOINT_LIMIT_TOLERANCE):
            return f"{joint.name} is at its limit, {_length_or_angle(q[k], joint.is_angle)}"
    return None


def camera_limit(at: Array, drag: CameraDrag) -> str | None:
    """Return a text on the limit that the camera has reached, or None; `at` (4,): see `LiveConsole.camera_at`."""
    for k, name in enumerate(("pan", "tilt", "depth", "roll")):
        if _at_limit(at[k], drag.lower[k], drag.upper[k], _CAMERA_LIMIT_TOLERANCE):
            is_angle = name != "depth"
            return f"{name} is at its limit, {_length_or_angle(at[k], is_angle)}"
    return None


def _at_limit(value: float, low: float, high: float, tolerance: float) -> bool:
    return value - low < tolerance or high - value < tolerance


def _length_or_angle(value: float, is_angle: bool) -> str:
    if is_angle:
        return f"{value / DEG:.0f}°"
    return f"{value / MM:.0f} mm"


def log_changes(old: JsonMapping, new: JsonMapping, patience: float) -> list[str]:
    """Log silence, a stuck pedal, jumps and limits that are in the state `new` but not yet in the state `old`.

    Return the messages about jumps, because the pages do not show jumps otherwise. `patience` is the time in s after
    which hands whose states are no longer received count as silent.
    """
    log = logging.getLogger(__name__)
    messages = []
    if new["silent"] and not old["silent"] and new["owner"] is not None:  # not after a release
        log.warning("no state of the hands was received for %g s: nothing moves", patience)
    if new["pedal"] and not old["pedal"]:
        log.warning("%s", new["pedal"])
    for hand, after in new["hands"].items():
        before = old["hands"][hand]
        robot = after["robot"]
        if after["jumps"] > before["jumps"]:
            message = f"the {hand} hand jumped: {robot} ignores the jump and follows from the new pose"
            messages.append(message)
            log.warning("%s", message)
        if after["wall"] and after["wall"] != before["wall"]:
            log.warning("%s: %s", robot, after["wall"])
    return messages


class ForcePeaks(Block):
    """Block of a World, without outputs: stores the largest `<hand>.force` (3,) in N since the last call of `take`.

    A page reads the forces once for each picture; a pulse between two pictures would be lost without this block.
    """

    def __init__(self, hands: Sequence[str]) -> None:
        """Watch the forces on the hands with these names."""
        self.outputs = {}
        self._peaks = {hand: np.zeros(3) for hand in hands}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Update the largest forces with the forces of this tick."""
        for hand, peak in self._peaks.items():
            force = signals.now[HAND_FORCE.of(hand)]
            if force @ force > peak @ peak:
                self._peaks[hand] = force.copy()
        return {}

    def take(self) -> dict[str, Array]:
        """Return, for each hand, the largest force (3,) in N since the last call, in {H}, the axes of the picture."""
        peaks = self._peaks
        self._peaks = {hand: np.zeros(3) for hand in peaks}
        return peaks
