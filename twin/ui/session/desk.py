"""The active robot: its state, moves and their limits, independent of viewer and headset.

The mechanism with its loops determines the link poses. The equations compute the joint values for a tool pose and are
compared with the mechanism. If a target cannot be reached, the robot stays at the last valid pose, and the reason is
stored.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from twin.api import Robot
from twin.core import spatial
from twin.core.errors import AssemblyError, KinematicsError, TwinError, unknown
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.kinematics import Kinematics, Pose, solve
from twin.kinematics.closed_loops.dragging import Bound, Dragged, Stop
from twin.kinematics.closed_loops.passive_limits import PassiveLimit
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.planning.protocol import Protocol
from twin.reference import ReferenceModel
from twin.reference.states import Assembly
from twin.ui.session.drag_solver import DragSolver

ENDOSCOPE = "endoscope_tip"
"""Name of the frame of a robot's endoscope camera; the camera looks along the z axis of this frame."""


@dataclass(frozen=True)
class MoveResult:
    """Result of a move request.

    Attributes:
        good: whether the robot has reached the target.
        reason: why the robot has not reached the target, with value and limit; "" if it has reached the target.
        seconds: solving time in s.
        more: whether the move stopped only because of its time limit; repeat the request to continue.
    """

    good: bool
    reason: str = ""
    seconds: float = 0.0
    more: bool = False


class Desk:
    """State of a robot that can be moved by its tool, its joints or any point of a link.

    Attributes:
        robot: the robot as it was loaded.
        mechanism, model: the mechanism and its independent model; after `redesign`, both are those of the new design.
        kin: equations of the robot; None for a robot without equations.
        assembly: the present state.
        asked: the last requested tool pose (4, 4); None after a different kind of move.
        lock: lock that is held during a move; reading `assembly` does not require the lock, because
            a move replaces `assembly` in one step.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.mechanism: Mechanism = robot.mechanism
        self.model: ReferenceModel = robot.reference()
        self.solver = _solver(robot, self.model)
        self.kin: Kinematics | None = _equations(robot)
        self.parameters: dict[str, float] = {}
        self.variants: dict[str, str] = {}
        self.lock = threading.RLock()
        self.assembly: Assembly = _first(self.model)
        self.asked: Array | None = None
        self.moved = MoveResult(True)
        self._kept: dict[str, Array] = {}
        self._frame, self._axis = self.mechanism.tool, np.array([0.0, 0.0, 1.0])
        if robot.files is not None and robot.files.protocols():
            self.speak_of(robot.protocol())

    def shaft(self) -> tuple[Array, Array]:
        """Return (tip (3,) in m, unit vector (3,) along the shaft towards the tip) in the base frame.

        The last used protocol defines tip and shaft; without a protocol, they are the tool's origin and z axis.
        """
        frame = self.mechanism.frame(self._frame)
        T = self.assembly.link_poses[frame.body] @ frame.T_body_frame
        return T[:3, 3], T[:3, :3] @ self._axis

    @property
    def tip_body(self) -> str:
        """Name of the body to which the tip belongs; see `shaft`."""
        return self.mechanism.frame(self._frame).body

    def speak_of(self, protocol: Protocol) -> None:
        """Use the tip frame and the shaft axis of a protocol from now on."""
        self._frame, self._axis = protocol.frame, protocol.shaft_axis / np.linalg.norm(protocol.shaft_axis)

    def camera(self) -> tuple[Array, Array, Array]:
        """Return (position, point ahead, point above) of an endoscope camera, each (3,) in m in the base frame.

        The camera is at the origin of the frame `endoscope_tip`, looks along the z axis of this frame, and its upward
        direction is -y. Without this frame, the camera is at the tip of the shaft.
        """
        frame = next((f for f in self.mechanism.frames if f.name == ENDOSCOPE), self.mechanism.frame(self._frame))
        T = self.assembly.link_poses[frame.body] @ frame.T_body_frame
        ahead = T[:3, 2] if frame.name == ENDOSCOPE else T[:3, :3] @ self._axis
        above = -T[:3, 1] if abs(ahead @ T[:3, 1]) < 0.9 else T[:3, 0]
        return T[:3, 3], T[:3, 3] + 0.1 * ahead, T[:3, 3] + 0.1 * above

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The active joints, in the order of q."""
        return self.mechanism.active

    # -- moving ---------------------------------------------------------------------------------------

    def move_tool(self, T_base_tool: Array) -> MoveResult:
        """Move the tool to a pose T_base_tool (4, 4); if the robot has equations, they compute the joint values.

        If a robot with trocars, or with fewer than six degrees of freedom, cannot reach the pose, only the origin of
        the tool is moved towards the target.
        """

        def go() -> Assembly:
            q = self._joints_of(T_base_tool)
            return self._assembled(q) if q is not None else self.model.solve_pose(T_base_tool, self.assembly)

        weak = len(self.joints) - len(self.mechanism.auxiliary) < 6 or bool(self.mechanism.trocars)
        with self.lock:
            out = self._try(go, T_base_tool)
            if out.good or not weak or not spatial.is_pose(T_base_tool, 1e-6):
                return out
            # The orientation is not reached, so `asked` must not be set: it is used in comparisons.
            tool = self.mechanism.frame(self.mechanism.tool)
            return self._led(tool.body, tool.T_body_frame[:3, 3], T_base_tool[:3, 3])

    def move_joint(self, joint: int, value: float) -> MoveResult:
        """Move an active joint towards a value in m or rad; if the joint stops before, the result states the reason."""
        with self.lock:
            q = self.assembly.q.copy()
            q[joint] = value
            dragged: list[Dragged] = []

            def go() -> Assembly:
                found, how = self.solver.joints(self.assembly, q)
                dragged.append(how)
                return found

            out = self._try(go)
            if out.good and dragged[0].more:
                out = self.moved = MoveResult(False, f"{self.joints[joint].name} is still moving", out.seconds, True)
            elif out.good and abs(self.assembly.q[joint] - value) > 1e-12:
                out = self.moved = replace(out, good=False, reason=self._stopped(joint, value, dragged[0]))
            return out

    def move_joints(self, q: Array) -> MoveResult:
        """Move all active joints to values (n,) in m or rad."""
        return self._try(lambda: self._assembled(np.asarray(q, float)))

    def move_point(self, body: str, p_body: Array, target: Array) -> MoveResult:
        """Move the point `p_body` of a body towards `target`, in the same assembly mode.

        `p_body` (3,) is in m in the frame of the body, `target` (3,) in m in the base frame.
        """
        return self._led(body, p_body, target)

    def let_go(self) -> None:
        """Clear the message about an unreached target, after the user has released the robot."""
        with self.lock:
            self.moved = MoveResult(True)

    def go(self, posture: str) -> MoveResult:
        """Move to a named posture of the robot, or to a state stored by `keep`.

        Raises:
            TwinError: there is no posture or state of this name.
        """
        if posture in self._kept:
            return self.move_joints(self._kept[posture])
        if posture not in self.mechanism.postures:
            raise TwinError(f"{self.robot.name}: {unknown('posture', posture, self.postures)}")
        return self._try(lambda: self.model.solve(self.mechanism.posture(posture)))

    def keep(self, name: str) -> None:
        """Store the present joint values under a name, so that `go` can move there."""
        self._kept[name] = self.assembly.q.copy()

    def show(self, assembly: Assembly, asked: Array | None = None) -> None:
        """Set the state to an assembly of the same model, such as a protocol's sample; `asked`: requested tool pose."""
        with self.lock:
            self.assembly, self.asked, self.moved = assembly, asked, MoveResult(True)

    @property
    def edited(self) -> bool:
        """Whether equations or mechanism have been changed, so that they differ from those of `robot`."""
        return bool(self.variants or self.parameters) or self.mechanism is not self.robot.mechanism

    @property
    def postures(self) -> tuple[str, ...]:
        """Names that `go` accepts: the robot's postures, then the states stored by `keep`."""
        return (*self.mechanism.postures, *(n for n in self._kept if n not in self.mechanism.postures))

    # -- changes of the robot -------------------------------------------------------------------------

    def bind(self, robot: Robot) -> None:
        """Replace the robot by the same robot with different trocar positions.

        Raises:
            TwinError: the mechanism cannot be assembled with these trocars, or the equations do not accept them;
                nothing is changed.
        """
        with self.lock:
            model, kin = robot.reference(), self._compiled(robot)
            assembly, solver = _first(model), _solver(robot, model)
            self.robot, self.mechanism, self.model = robot, robot.mechanism, model
            self.kin, self.assembly, self.solver = kin, assembly, solver

    def change(self, variants: Mapping[str, str] | None = None, parameters: Mapping[str, float] | None = None) -> None:
        """Change variants or parameters (in SI units) of the equations; earlier changes remain.

        Raises:
            KinematicsError: the variant or parameter does not exist; nothing is changed.
        """
        with self.lock:
            before, own = (self.variants, self.parameters), self.robot.kinematics()
            chosen, values = {**self.variants, **(variants or {})}, {**self.parameters, **(parameters or {})}
            self.variants = {n: v for n, v in chosen.items() if v != own.variants.get(n)}
            self.parameters = {n: v for n, v in values.items() if v != own.parameters.get(n)}
            try:
                self.kin = self._compiled(self.robot)
            except TwinError:
                self.variants, self.parameters = before
                raise

    def redesign(self, mechanism: Mechanism) -> None:
        """Replace the mechanism by a different design, at the present joint values.

        Raises:
            AssemblyError: the design cannot be assembled at the present joints; nothing is changed.
        """
        with self.lock:
            model = ReferenceModel(mechanism)
            assembly = model.solve(self.assembly.q)
            solver = _solver(self.robot, model)
            self.mechanism, self.model, self.assembly, self.solver = mechanism, model, assembly, solver

    def _compiled(self, robot: Robot) -> Kinematics | None:
        """Return the equations of a robot with the chosen variants and parameters; None if it has no equations."""
        if _equations(robot) is None:
            return None
        if not self.variants and not self.parameters:
            return robot.kinematics()
        return robot.kinematics(self.variants or None, self.parameters)

    # -- internal functions ---------------------------------------------------------------------------

    def _joints_of(self, T: Array) -> Array | None:
        """Return q (n,) computed by the equations for a tool pose (4, 4); None if there are no equations."""
        if self.kin is None:
            return None
        if self.model.redundant:  # use the solution nearest to the present q
            return solve(self.kin, Pose(T), self.assembly.q, self.mechanism.limits, starts=1, any_branch=True).q
        return self.kin.inverse(T, self.assembly.q)

    def _assembled(self, q: Array) -> Assembly:
        for joint, value, (low, high) in zip(self.joints, q, self.mechanism.limits, strict=True):
            if not low - 1e-9 <= value <= high + 1e-9:
                raise KinematicsError(_beyond(joint, float(value), low, high))
        for bound in self.solver.bounds:
            beyond = bound.slack(q) < min(0.0, bound.slack(self.assembly.q)) - 1e-9
            if bound.kind == "motor" and beyond:
                by = f"{-bound.slack(q):.3g} {self._unit(bound)}"
                raise KinematicsError(f"motor {bound.name} would exceed its limits of {self._limits(bound)} by {by}")
            if bound.kind == "gap" and beyond:
                lower, upper = bound.name.split()
                least, left = bound.least / MM, (bound.slack(q) + bound.least) / MM
                raise KinematicsError(f"{upper} - {lower} = {left:.3f} mm is below its minimum of {least:.3f} mm")
        found = self.model.solve(q, self.assembly)
        for joint in self.mechanism.limited:
            now, then = (
                float(joint.beyond(a.link_poses[joint.parent], a.link_poses[joint.child]))
                for a in (self.assembly, found)
            )
            if then > max(0.0, now) + 1e-9:
                by = _shown(joint, then)
                raise KinematicsError(f"{joint.name} would exceed its limits of {_range(joint)} by {by}")
        return found

    def _led(self, body: str, p_body: Array, target: Array) -> MoveResult:
        """Move a point; the result states the remaining distance and the reason if the target was not reached."""
        dragged: list[Dragged] = []

        def go() -> Assembly:
            found, how = self.solver.point(self.assembly, body, p_body, target)
            dragged.append(how)
            return found

        with self.lock:
            out = self._try(go)
            if not out.good:
                return out
            p = (self.assembly.link_poses[body] @ np.append(p_body, 1.0))[:3]
            left = float(np.linalg.norm(p - target))
            if dragged[0].more:
                text = f"{body} is still moving, {left / MM:.1f} mm short of the target"
                out = self.moved = MoveResult(False, text, out.seconds, True)
            elif left > 0.05 * MM:
                where = " ".join(f"{v:.1f}" for v in p / MM)
                text = f"{body} stops {left / MM:.1f} mm short of the target, at [{where}] mm: {self._why(dragged[0])}"
                out = self.moved = replace(out, good=False, reason=text)
            return out

    def _why(self, dragged: Dragged) -> str:
        """Return a text that states why the motion stopped."""
        reasons = [self._bound(b) for b in dragged.stops]
        if dragged.singular:
            reasons.append(_ended(dragged.singular))
        return ", ".join(reasons) or "no joint motion brings the point nearer"

    def _bound(self, bound: Stop) -> str:
        if isinstance(bound, PassiveLimit):
            joint, low, high = bound.joint, *(bound.joint.limits or (0.0, 0.0))
            ends = {"lower": _shown(joint, low), "upper": _shown(joint, high)}
            return f"{joint.name} is at a limit ({ends.get(bound.kind, _range(joint))})"
        if bound.kind == "gap":
            lower, upper = bound.name.split()
            return f"{upper} - {lower} is at its minimum of {bound.least / MM:.3f} mm ({self._rail(lower, upper)})"
        if bound.kind == "motor":
            return f"motor {bound.name} is at a limit ({self._limits(bound)})"
        joint = self.mechanism.joint(bound.name)
        return (
            f"{joint.name} is at its limit of {_shown(joint, bound.least if bound.kind == 'lower' else -bound.least)}"
        )

    def _limits(self, bound: Bound) -> str:
        limits = self.mechanism.actuator(bound.name).limits or ()
        return f"{' .. '.join(f'{v:.3g}' for v in limits)} {self._unit(bound)}"

    def _unit(self, bound: Bound) -> str:
        return "rad" if self.mechanism.actuator(bound.name).is_angle else "m"

    def _stopped(self, number: int, value: float, dragged: Dragged) -> str:
        """Return a text that states why a joint did not reach a value in m or rad."""
        joint, (low, high) = self.joints[number], self.mechanism.limits[number]
        q = self.assembly.q.copy()
        q[number] = value
        reasons = [] if low <= value <= high else [_beyond(joint, value, low, high)]
        for bound in (b for b in self.solver.bounds if b.kind == "gap" and b.slack(q) < -1e-9):
            lower, upper = bound.name.split()
            if joint.name in (lower, upper):
                other, side = (upper, "below") if joint.name == lower else (lower, "above")
                at = _shown(joint, float(q[[j.name for j in self.joints].index(other)]))
                least = f"at least {bound.least / MM:.3f} mm {side} {other} = {at} ({self._rail(lower, upper)})"
                reasons.append(f"{joint.name} = {_shown(joint, value)} must stay {least}")
        reasons += [self._bound(b) for b in dragged.stops if isinstance(b, PassiveLimit) or b.kind == "motor"]
        at = f"{joint.name} stops at {_shown(joint, float(self.assembly.q[number]))}"
        if dragged.singular:
            reasons.append(f"{at}: {_ended(dragged.singular)}")
        elif len(reasons) != 1 or low <= value <= high:
            reasons.append(at)
        return "; ".join(reasons)

    def _rail(self, lower: str, upper: str) -> str:
        return " and ".join(self.mechanism.joint(n).child for n in (lower, upper)) + " share a rail"

    def _try(self, go: Callable[[], Assembly], asked: Array | None = None) -> MoveResult:
        with self.lock:
            start = time.perf_counter()
            try:
                if asked is not None and not spatial.is_pose(asked, 1e-6):
                    raise KinematicsError("the requested pose is not rigid")
                found = go()
            except (KinematicsError, AssemblyError) as error:
                self.moved = MoveResult(False, str(error), time.perf_counter() - start)
            else:
                self.assembly, self.asked = found, asked
                self.moved = MoveResult(True, "", time.perf_counter() - start)
            return self.moved


def _first(model: ReferenceModel) -> Assembly:
    """Return the state at the home posture."""
    home = model.mechanism.home
    return model.home() if home is None else model.solve(home)


def _solver(robot: Robot, model: ReferenceModel) -> DragSolver:
    return DragSolver(model.mechanism, model, robot.gaps)


def _equations(robot: Robot) -> Kinematics | None:
    if robot.files is None or not robot.files.has_equations:
        return None
    return robot.kinematics()


def _ended(singular: str) -> str:
    """Return a text on the singularity that stopped the motion."""
    if singular == "tool":
        return "the robot is at a singularity; the target is in another assembly mode"
    return f"{singular} is at a singularity and cannot move further in this assembly mode"


def _shown(joint: Joint, value: float) -> str:
    return f"{value / DEG:.3f}°" if joint.is_angle or joint.cone is not None else f"{value / MM:.3f} mm"


def _range(joint: Joint) -> str:
    if joint.cone is not None:
        return f"a cone of {_shown(joint, joint.cone)}"
    return " .. ".join(_shown(joint, value) for value in joint.limits or ())


def _beyond(joint: Joint, value: float, low: float, high: float) -> str:
    side = low if value < low else high
    return f"{joint.name} = {_shown(joint, value)} is beyond its limit of {_shown(joint, side)}"
