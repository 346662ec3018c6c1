"""One robot in hand: where it stands, how it is moved, and what stops it. Knows nothing of any browser.

The mechanism's loops decide where the links are; the equations are asked for the joints of a tool pose and are
measured against it. Whatever cannot be reached leaves the last good pose and a reason.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from twin import spatial
from twin.api import Robot
from twin.errors import AssemblyError, KinematicsError, TwinError, unknown
from twin.kinematics import Kinematics, Pose, solve
from twin.mechanism import Joint, Mechanism
from twin.protocol import Protocol
from twin.reference import ReferenceModel
from twin.reference.follow import follow
from twin.reference.states import Assembly
from twin.spatial import Array
from twin.units import DEG, MM

ENDOSCOPE = "endoscope_tip"
"""The frame at which a robot's own endoscope looks out, along z."""


@dataclass(frozen=True)
class Moved:
    """What became of a request.

    Attributes:
        good: whether the robot went where it was asked to go.
        reason: why not, with value and limit; empty if it did.
        seconds: what solving took.
    """

    good: bool
    reason: str = ""
    seconds: float = 0.0


class Desk:
    """A robot that can be taken by its tool, its joints or any point of a link.

    Attributes:
        robot: with its equations; `mechanism` and `model` may be a design that differs from the robot's own.
        kin: its equations, or None (a bare USD stage).
        assembly: where it stands.
        asked: (4, 4) the tool pose last asked for, or None after another kind of move.
        lock: held while it is being solved; readers take `assembly`, which is replaced as a whole.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.mechanism: Mechanism = robot.mechanism
        self.model: ReferenceModel = robot.reference()
        self.kin: Kinematics | None = _equations(robot)
        self.parameters: dict[str, float] = {}
        self.variants: dict[str, str] = {}
        self.lock = threading.RLock()
        self.assembly: Assembly = self._first()
        self.asked: Array | None = None
        self.moved = Moved(True)
        self._kept: dict[str, Array] = {}
        self._frame, self._axis = self.mechanism.tool, np.array([0.0, 0.0, 1.0])
        if robot.files is not None and robot.files.protocols():
            self.speak_of(robot.protocol())

    def _first(self) -> Assembly:
        if "home" in self.mechanism.postures:
            return self.model.solve(self.mechanism.posture("home"))
        return self.model.home()

    def shaft(self) -> tuple[Array, Array]:
        """Return the tip (3,) and the direction (3,) of the shaft towards it, in base.

        Those of the protocol last spoken of; without one, the tool's origin and its z axis.
        """
        frame = self.mechanism.frame(self._frame)
        T = self.assembly.link_poses[frame.body] @ frame.T_body_frame
        return T[:3, 3], T[:3, :3] @ self._axis

    def speak_of(self, protocol: Protocol) -> None:
        """Take tip and shaft to be those of a protocol; at first they are those of the default protocol."""
        self._frame, self._axis = protocol.frame, protocol.shaft_axis / np.linalg.norm(protocol.shaft_axis)

    def camera(self) -> tuple[Array, Array, Array]:
        """Return where an endoscope looks from, a point ahead and one above, each (3,) in base.

        It stands at the frame `endoscope_tip` and looks along its z with -y up; without one, at the tip of the shaft.
        """
        frame = next((f for f in self.mechanism.frames if f.name == ENDOSCOPE), self.mechanism.frame(self._frame))
        T = self.assembly.link_poses[frame.body] @ frame.T_body_frame
        ahead = T[:3, 2] if frame.name == ENDOSCOPE else T[:3, :3] @ self._axis
        above = -T[:3, 1] if abs(ahead @ T[:3, 1]) < 0.9 else T[:3, 0]
        return T[:3, 3], T[:3, 3] + 0.1 * ahead, T[:3, 3] + 0.1 * above

    @property
    def joints(self) -> tuple[Joint, ...]:
        """Active joints, in the order of q."""
        return self.mechanism.active

    @property
    def bounds(self) -> Array:
        """Hard limits (n, 2) in m or rad, infinite where there is none."""
        return np.array([j.limits or (-np.inf, np.inf) for j in self.joints], float).reshape(-1, 2)

    # -- moving ---------------------------------------------------------------------------------------

    def move_tool(self, T_base_tool: Array) -> Moved:
        """Bring the tool to a pose (4, 4), by the equations where there are some.

        A robot that cannot hold the orientation (five joints) follows with the tool's origin.
        """

        def go() -> Assembly:
            try:
                q = self._joints_of(T_base_tool)
            except KinematicsError:
                if len(self.joints) >= 6 and not self.mechanism.trocar:
                    raise
                held.append(T_base_tool)
                return follow(self.model, self.assembly, *self._tool_point(), T_base_tool[:3, 3])
            return self._assembled(q) if q is not None else self.model.solve_pose(T_base_tool, self.assembly)

        held: list[Array] = []
        out = self._try(go, T_base_tool)
        if held:  # the orientation asked for was given up: it is no measure of anything
            self.asked = None
            return self._behind(out, *self._tool_point(), T_base_tool[:3, 3])
        return out

    def move_joint(self, joint: int, value: float) -> Moved:
        """Bring one active joint to a value in m or rad; it stops at its limit, and says so."""
        low, high = self.bounds[joint]
        held = float(np.clip(value, low, high))

        def go() -> Assembly:
            q = self.assembly.q.copy()
            q[joint] = held
            return self.model.solve(q, self.assembly)

        out = self._try(go)
        if out.good and held != value:
            out = self.moved = Moved(False, _beyond(self.joints[joint], value, low, high), out.seconds)
        return out

    def move_joints(self, q: Array) -> Moved:
        """Bring all active joints (n,) to values in m or rad."""
        return self._try(lambda: self._assembled(np.asarray(q, float)))

    def move_point(self, body: str, p_body: Array, target: Array) -> Moved:
        """Lead a point (3,) of a body towards a target (3,) in base, in m; the loops follow."""

        def go() -> Assembly:
            return follow(self.model, self.assembly, body, p_body, target)

        return self._behind(self._try(go), body, p_body, target)

    def go(self, posture: str) -> Moved:
        """Go to a named posture of the robot, or one kept with `keep`."""
        if posture in self._kept:
            return self.move_joints(self._kept[posture])
        if posture not in self.mechanism.postures:
            raise TwinError(f"{self.robot.name}: {unknown('posture', posture, self.postures)}")
        return self._try(lambda: self.model.solve(self.mechanism.posture(posture)))

    def keep(self, name: str) -> None:
        """Remember where the joints are, for `go`."""
        self._kept[name] = self.assembly.q.copy()

    def show(self, assembly: Assembly, asked: Array | None = None) -> None:
        """Stand where an assembly of the same model stands (a sample of a protocol, whose tool pose was `asked`)."""
        with self.lock:
            self.assembly, self.asked, self.moved = assembly, asked, Moved(True)

    @property
    def edited(self) -> bool:
        """Whether equations or mechanism differ from the robot's own."""
        return bool(self.variants or self.parameters) or self.mechanism is not self.robot.mechanism

    @property
    def postures(self) -> tuple[str, ...]:
        """Names that `go` knows."""
        return (*self.mechanism.postures, *(n for n in self._kept if n not in self.mechanism.postures))

    # -- changing what is moved -----------------------------------------------------------------------

    def bind(self, robot: Robot) -> None:
        """Take the same robot with its trocar elsewhere."""
        with self.lock:
            self.robot, self.mechanism, self.model = robot, robot.mechanism, robot.reference()
            self.kin = self._compiled()
            self.assembly = self._first()

    def change(self, variants: Mapping[str, str] | None = None, parameters: Mapping[str, float] | None = None) -> None:
        """Use other variants or parameters (SI) of the equations, besides those changed before; the robot's undo.

        Raises:
            KinematicsError: no such variant or parameter; nothing is changed.
        """
        with self.lock:
            before, own = (self.variants, self.parameters), self.robot.kinematics()
            chosen, values = {**self.variants, **(variants or {})}, {**self.parameters, **(parameters or {})}
            self.variants = {n: v for n, v in chosen.items() if v != own.variants.get(n)}
            self.parameters = {n: v for n, v in values.items() if v != own.parameters.get(n)}
            try:
                self.kin = self._compiled()
            except TwinError:
                self.variants, self.parameters = before
                raise

    def redesign(self, mechanism: Mechanism) -> None:
        """Take another design of the mechanism, standing as near as it can to where the robot stands.

        Raises:
            AssemblyError: it cannot be assembled with these joints; nothing is changed.
        """
        with self.lock:
            model = ReferenceModel(mechanism)
            assembly = model.solve(self.assembly.q)
            self.mechanism, self.model, self.assembly = mechanism, model, assembly

    def _compiled(self) -> Kinematics | None:
        if _equations(self.robot) is None:
            return None
        if not self.variants and not self.parameters:
            return self.robot.kinematics()
        return self.robot.kinematics(self.variants or None, self.parameters)

    # -- inside ---------------------------------------------------------------------------------------

    def _joints_of(self, T: Array) -> Array | None:
        """Return q (n,) by the equations, within the limits; None if there are no equations."""
        if self.kin is None:
            return None
        if len(self.joints) > 6:  # a freedom to spare: the nearest of many postures
            return solve(self.kin, Pose(T), self.assembly.q, self.bounds, starts=1, any_branch=True).q
        return self.kin.inverse(T, self.assembly.q)

    def _assembled(self, q: Array) -> Assembly:
        for joint, value, (low, high) in zip(self.joints, q, self.bounds, strict=True):
            if not low - 1e-9 <= value <= high + 1e-9:
                raise KinematicsError(_beyond(joint, float(value), low, high))
        return self.model.solve(q, self.assembly)

    def _tool_point(self) -> tuple[str, Array]:
        tool = self.mechanism.frame(self.mechanism.tool)
        return tool.body, tool.T_body_frame[:3, 3]

    def _behind(self, out: Moved, body: str, p_body: Array, target: Array) -> Moved:
        """Say by how much, and why, a point that was led did not come along."""
        left = float(np.linalg.norm((self.assembly.link_poses[body] @ np.append(p_body, 1.0))[:3] - target))
        if out.good and left > 0.05 * MM:
            stops = self._at_limits()
            why = f": {', '.join(stops)}" if stops else ": the mechanism gives way no further in that direction"
            out = self.moved = Moved(False, f"{body} stays {left / MM:.1f} mm behind the hand{why}", out.seconds)
        return out

    def _at_limits(self) -> list[str]:
        out = []
        for joint, value, (low, high) in zip(self.joints, self.assembly.q, self.bounds, strict=True):
            if min(value - low, high - value) < 1e-6:
                out.append(f"{joint.name} is at its limit of {_shown(joint, float(value))}")
        return out

    def _try(self, go: Callable[[], Assembly], asked: Array | None = None) -> Moved:
        with self.lock:
            start = time.perf_counter()
            try:
                if asked is not None and not spatial.is_pose(asked, 1e-6):
                    raise KinematicsError("the pose asked for is not rigid")
                found = go()
            except (KinematicsError, AssemblyError) as error:
                self.moved = Moved(False, str(error), time.perf_counter() - start)
            else:
                self.assembly, self.asked = found, asked
                self.moved = Moved(True, "", time.perf_counter() - start)
            return self.moved


def _equations(robot: Robot) -> Kinematics | None:
    if robot.files is None or not robot.files.has_equations:
        return None
    return robot.kinematics()


def _shown(joint: Joint, value: float) -> str:
    return f"{value / DEG:.3f}°" if joint.is_angle else f"{value / MM:.3f} mm"


def _beyond(joint: Joint, value: float, low: float, high: float) -> str:
    side = low if value < low else high
    return f"{joint.name} = {_shown(joint, value)} is beyond its limit of {_shown(joint, side)}"
