"""A robot that a user moves: its state, its moves and their limits, independent of viewer and headset.

The mechanism with its loops determines the link poses. The equations compute the joint values for a tool pose and are
compared with the mechanism. If a target cannot be reached, the robot stays at the last valid pose, and the reason is
stored.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from twin.api import Robot
from twin.cad.build import joint_values
from twin.core import spatial
from twin.core.errors import AssemblyError, KinematicsError, TwinError, unknown
from twin.core.spatial import Array
from twin.core.units import MM
from twin.kinematics import Kinematics, Pose, solve
from twin.kinematics.closed_loops.dragging import Dragged
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.planning.protocol import Protocol
from twin.reference import ReferenceModel
from twin.reference.states import Assembly
from twin.ui.session import stop_reasons as reasons
from twin.ui.session.drag_solver import DragSolver

_Value = TypeVar("_Value")

START_POSTURE = "start"
"""Name in the list of postures of the joint values at which the pages open."""

MAX_UNDOS = 50
"""Maximum number of moves that can be undone."""

_BISECTIONS = 10
"""Number of halvings in the search for the last reachable pose on the way to a target: 1024 parts of the way."""

_LIMIT_ROUNDING = 1e-9
"""Excess of a limit in m or rad that counts as rounding."""

_JOINT_TOLERANCE = 1e-12
"""Difference in m or rad between a joint and its target up to which the joint has arrived."""

_POINT_TOLERANCE = 0.05 * MM
"""Distance in m between a dragged point and its target up to which the target is reached: too small to be seen."""

_POSE_TOLERANCE = 1e-6
"""Tolerance of `spatial.is_pose` for requested poses, which clients send as rounded numbers."""

_STEEP_COSINE = 0.9
"""Cosine of the angle to the view from which the y axis of the camera is too steep to be the upward direction."""

_VIEW_DISTANCE = 0.1
"""Distance in m from the camera to the points ahead of it and above it."""

ENDOSCOPE_FRAME = "endoscope_tip"
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


class MovableRobot:
    """State of a robot that can be moved by its tool, its joints or any point of a link.

    Attributes:
        robot: the robot as it was loaded.
        mechanism, model: the mechanism and its independent model; after `redesign`, both are those of the new design.
        solver: moves joints and points within all limits.
        kin: equations of the robot; None for a robot without equations.
        parameters: {parameter of the equations that was changed: its value in SI units}.
        variants: {equation whose variant was changed: the chosen variant}.
        assembly: the present state.
        requested_pose: the last requested tool pose (4, 4); None after a different kind of move.
        last_move: result of the last move; without a reason after `clear_message`.
        lock: lock that is held during a move; reading `assembly` does not require the lock, because
            a move replaces `assembly` in one step.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.mechanism: Mechanism = robot.mechanism
        self.model: ReferenceModel = robot.reference()
        self.solver = _drag_solver(robot, self.model)
        self.kin: Kinematics | None = _unchanged_equations(robot)
        self.parameters: dict[str, float] = {}
        self.variants: dict[str, str] = {}
        self.lock = threading.RLock()
        self.assembly: Assembly = _opening_state(robot, self.model)
        self.requested_pose: Array | None = None
        self.last_move = MoveResult(True)
        self._kept_states: dict[str, Array] = {}
        self._undo_states: list[Array] = []  # joint values stored by `remember`, the newest last
        if start_of(robot):
            self.keep(START_POSTURE)
        self._tip_frame = self.mechanism.tool
        self._shaft_axis = np.array([0.0, 0.0, 1.0])
        if robot.files is not None and robot.files.protocols():
            self.use_tool_frame_of(robot.protocol())

    def shaft(self) -> tuple[Array, Array]:
        """Return (tip (3,) in m, unit vector (3,) along the shaft towards the tip) in the base frame.

        The last used protocol defines tip and shaft; without a protocol, they are the tool's origin and z axis.
        """
        frame = self.mechanism.frame(self._tip_frame)
        T = self.assembly.link_poses[frame.body] @ frame.T_body_frame
        return T[:3, 3], T[:3, :3] @ self._shaft_axis

    @property
    def tip_body(self) -> str:
        """Name of the body to which the tip belongs; see `shaft`."""
        return self.mechanism.frame(self._tip_frame).body

    def use_tool_frame_of(self, protocol: Protocol) -> None:
        """Use the tip frame and the shaft axis of a protocol from now on."""
        self._tip_frame = protocol.frame
        self._shaft_axis = protocol.shaft_axis / np.linalg.norm(protocol.shaft_axis)

    def camera(self) -> tuple[Array, Array, Array]:
        """Return (position, point ahead, point above) of an endoscope camera, each (3,) in m in the base frame.

        The camera is at the origin of the frame `endoscope_tip`, looks along the z axis of this frame, and its upward
        direction is -y. Without this frame, the camera is at the tip of the shaft.
        """
        frame = self.mechanism.frame(self._tip_frame)
        for candidate in self.mechanism.frames:
            if candidate.name == ENDOSCOPE_FRAME:
                frame = candidate
                break
        T = self.assembly.link_poses[frame.body] @ frame.T_body_frame
        lens = T[:3, 3]
        if frame.name == ENDOSCOPE_FRAME:
            ahead = T[:3, 2]
        else:
            ahead = T[:3, :3] @ self._shaft_axis
        # an upward direction that is almost along the view would leave the roll of the picture undefined
        if abs(ahead @ T[:3, 1]) < _STEEP_COSINE:
            above = -T[:3, 1]
        else:
            above = T[:3, 0]
        return lens, lens + _VIEW_DISTANCE * ahead, lens + _VIEW_DISTANCE * above

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
            if q is not None:
                return self._checked_assembly(q)
            return self.model.solve_pose(T_base_tool, self.assembly)

        with self.lock:
            result = self._apply_move(go, T_base_tool)
            if result.good or self._sets_pose or not spatial.is_pose(T_base_tool, _POSE_TOLERANCE):
                return result
            # The orientation is not reached, so `requested_pose` must not be set: it is used in comparisons.
            tool = self.mechanism.frame(self.mechanism.tool)
            return self.move_point(tool.body, tool.T_body_frame[:3, 3], T_base_tool[:3, 3])

    @property
    def _sets_pose(self) -> bool:
        """Whether the tool can take any position and orientation, within limits: six joints and no trocar."""
        arm_joints = len(self.joints) - len(self.mechanism.auxiliary)
        return arm_joints >= 6 and not self.mechanism.trocars

    def drag_tool(self, T_base_tool: Array) -> MoveResult:
        """Move the tool towards a pose T_base_tool (4, 4); at a limit, move along it instead of staying behind.

        A target beyond a limit is approached on the straight way as far as that goes, then along each axis of the base
        frame. The result states the remaining distance, and the limit that the target exceeds.
        """
        with self.lock:
            result = self.move_tool(T_base_tool)
            if result.good or not self._sets_pose or not spatial.is_pose(T_base_tool, _POSE_TOLERANCE):
                return result
            begin = time.perf_counter()
            self._approach(T_base_tool)
            for axis in range(3):
                T = self.assembly.T_base_tool.copy()
                T[axis, 3] = T_base_tool[axis, 3]
                self._approach(T)
            distance = float(np.linalg.norm(self.assembly.T_base_tool[:3, 3] - T_base_tool[:3, 3]))
            text = f"the tool stops {distance / MM:.1f} mm short of the target: {result.reason}"
            self.last_move = MoveResult(False, text, result.seconds + time.perf_counter() - begin)
            return self.last_move

    def _approach(self, T_target: Array) -> None:
        """Move the tool on the straight way towards a pose (4, 4) as far as it goes."""
        T_begin = self.assembly.T_base_tool.copy()
        w = spatial.log_so3(T_begin[:3, :3].T @ T_target[:3, :3])
        displacement = T_target[:3, 3] - T_begin[:3, 3]
        reached = 0.0
        step = 1.0
        # bisection: a step that fails is tried again with half its length
        for _ in range(_BISECTIONS):
            fraction = reached + step
            R = T_begin[:3, :3] @ spatial.exp_so3(fraction * w)
            p = T_begin[:3, 3] + fraction * displacement
            if self.move_tool(spatial.pose(R, p)).good:
                reached = fraction
            if reached == 1.0:
                return
            step /= 2

    def move_joint(self, joint: int, value: float) -> MoveResult:
        """Move an active joint towards a value in m or rad; if the joint stops before, the result states the reason."""
        with self.lock:
            q = self.assembly.q.copy()
            q[joint] = value
            drags: list[Dragged] = []

            def go() -> Assembly:
                assembly, dragged = self.solver.joints(self.assembly, q)
                drags.append(dragged)
                return assembly

            result = self._apply_move(go)
            if not result.good:
                return result
            if drags[0].more:
                text = f"{self.joints[joint].name} is still moving"
                self.last_move = MoveResult(False, text, result.seconds, True)
            elif abs(self.assembly.q[joint] - value) > _JOINT_TOLERANCE:
                self.last_move = replace(result, good=False, reason=self._joint_reason(joint, value, drags[0]))
            return self.last_move

    def move_joints(self, q: Array) -> MoveResult:
        """Move all active joints to values (n,) in m or rad."""
        return self._apply_move(lambda: self._checked_assembly(np.asarray(q, float)))

    def move_point(self, body: str, p_body: Array, target: Array) -> MoveResult:
        """Move the point `p_body` of a body towards `target`, in the same assembly mode.

        `p_body` (3,) is in m in the frame of the body, `target` (3,) in m in the base frame. The result states the
        remaining distance, and the reason, if the target was not reached.
        """
        drags: list[Dragged] = []

        def go() -> Assembly:
            assembly, dragged = self.solver.point(self.assembly, body, p_body, target)
            drags.append(dragged)
            return assembly

        with self.lock:
            result = self._apply_move(go)
            if not result.good:
                return result
            position = (self.assembly.link_poses[body] @ np.append(p_body, 1.0))[:3]
            distance = float(np.linalg.norm(position - target))
            if drags[0].more:
                text = f"{body} is still moving, {distance / MM:.1f} mm short of the target"
                self.last_move = MoveResult(False, text, result.seconds, True)
            elif distance > _POINT_TOLERANCE:
                coordinates = " ".join(f"{v:.1f}" for v in position / MM)
                text = f"{body} stops {distance / MM:.1f} mm short of the target, at [{coordinates}] mm"
                why = reasons.of_point(self.mechanism, drags[0])
                self.last_move = replace(result, good=False, reason=f"{text}: {why}")
            return self.last_move

    def clear_message(self) -> None:
        """Clear the message about an unreached target, after the user has released the robot."""
        with self.lock:
            self.last_move = MoveResult(True)

    def go_to_posture(self, posture: str) -> MoveResult:
        """Move to a named posture of the robot, or to a state stored by `keep`.

        A state stored by `keep` is checked against the limits. A posture of the description is not: it is taken as the
        description states it.

        Raises:
            TwinError: there is no posture or state of this name.
        """
        if posture in self._kept_states:
            return self.move_joints(self._kept_states[posture])
        if posture not in self.mechanism.postures:
            raise TwinError(f"{self.robot.name}: {unknown('posture', posture, self.postures)}")
        return self._apply_move(lambda: self.model.solve(self.mechanism.posture(posture)))

    def remember(self) -> None:
        """Store the present joint values, so that `undo` can return to them."""
        with self.lock:
            newest = self._undo_states[1 - MAX_UNDOS :]
            self._undo_states = [*newest, self.assembly.q.copy()]

    def undo(self) -> MoveResult:
        """Move back to the joint values that `remember` stored last, and that differ from the present ones."""
        with self.lock:
            while self._undo_states and self._is_at(self._undo_states[-1]):
                self._undo_states.pop()
            if not self._undo_states:
                self.last_move = MoveResult(False, "nothing to undo: no drag has moved the robot")
                return self.last_move
            return self.move_joints(self._undo_states.pop())

    def _is_at(self, q: Array) -> bool:
        """Return whether the active joints have the values q (n,)."""
        return bool(np.abs(q - self.assembly.q).max(initial=0.0) < _LIMIT_ROUNDING)

    def keep(self, name: str) -> None:
        """Store the present joint values under a name, so that `go_to_posture` can move there."""
        self._kept_states[name] = self.assembly.q.copy()

    def show(self, assembly: Assembly, requested_pose: Array | None = None) -> None:
        """Set the state to an assembly of the same model, such as a protocol's sample; its tool pose was requested."""
        with self.lock:
            self.assembly = assembly
            self.requested_pose = requested_pose
            self.last_move = MoveResult(True)

    def follow_sample(self, x: Array, T_base_tool: Array) -> MoveResult:
        """Show a sample of a plan for the robot as it was loaded: configuration x (nq,) and tool pose (4, 4).

        The configuration is no state of an edited robot: its loops would be open. It follows the tool pose instead; if
        joints are redundant, a tool pose has no single state, and the joint values are followed.
        """
        if self.edited and not self.model.redundant:
            return self.move_tool(T_base_tool)
        self.show(self.model.state(x), T_base_tool)
        return self.last_move

    @property
    def edited(self) -> bool:
        """Whether equations or mechanism have been changed, so that they differ from those of `robot`."""
        return bool(self.variants or self.parameters) or self.mechanism is not self.robot.mechanism

    @property
    def postures(self) -> tuple[str, ...]:
        """Names that `go_to_posture` accepts: the robot's postures, then the states stored by `keep`."""
        names = list(self.mechanism.postures)
        for name in self._kept_states:
            if name not in self.mechanism.postures:
                names.append(name)
        return tuple(names)

    # -- changes of the robot -------------------------------------------------------------------------

    def bind(self, robot: Robot) -> None:
        """Replace the robot by the same robot with different trocar positions, and move to its first state.

        A design of `redesign` remains, with its trocars moved. The last request is forgotten: it was for the old
        trocars.

        Raises:
            TwinError: the mechanism cannot be assembled with these trocars, or the equations do not accept them;
                nothing is changed.
        """
        with self.lock:
            if self.mechanism is self.robot.mechanism:
                model = robot.reference()
            else:
                model = ReferenceModel(self.mechanism.with_trocars(robot.trocars))
            kin = self._compiled_equations(robot)
            assembly = _opening_state(robot, model)
            solver = _drag_solver(robot, model)
            # nothing is replaced before all of the new robot exists
            self.robot = robot
            self.mechanism = model.mechanism
            self.model = model
            self.kin = kin
            self.solver = solver
            self.show(assembly)

    def change(self, variants: Mapping[str, str] | None = None, parameters: Mapping[str, float] | None = None) -> None:
        """Change variants or parameters (in SI units) of the equations; earlier changes remain.

        Raises:
            KinematicsError: the variant or parameter does not exist; nothing is changed.
        """
        with self.lock:
            published = self.robot.kinematics()
            old_variants = self.variants
            old_parameters = self.parameters
            self.variants = _changed_values({**self.variants, **(variants or {})}, published.variants)
            self.parameters = _changed_values({**self.parameters, **(parameters or {})}, published.parameters)
            try:
                self.kin = self._compiled_equations(self.robot)
            except TwinError:
                self.variants = old_variants
                self.parameters = old_parameters
                raise

    def reset_parameter(self, name: str) -> None:
        """Set a parameter of the equations to its published value.

        Raises:
            KinematicsError: the parameter does not exist, or the equations cannot be compiled; nothing is changed.
        """
        published = self.robot.kinematics().parameters
        if name not in published:
            raise KinematicsError(unknown("parameter", name, published))
        self.change(parameters={name: published[name]})

    def redesign(self, mechanism: Mechanism) -> None:
        """Replace the mechanism by a different design, at the present joint values.

        Raises:
            AssemblyError: the design cannot be assembled at the present joints; nothing is changed.
        """
        with self.lock:
            model = ReferenceModel(mechanism)
            assembly = model.solve(self.assembly.q)
            solver = _drag_solver(self.robot, model)
            self.mechanism = mechanism
            self.model = model
            self.assembly = assembly
            self.solver = solver

    def _compiled_equations(self, robot: Robot) -> Kinematics | None:
        """Return the equations of a robot with the chosen variants and parameters; None if it has no equations."""
        if _unchanged_equations(robot) is None:
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
            limits = self.mechanism.limits
            return solve(self.kin, Pose(T), self.assembly.q, limits, starts=1, any_branch=True).q
        return self.kin.inverse(T, self.assembly.q)

    def _checked_assembly(self, q: Array) -> Assembly:
        """Return the state at q (n,) in m or rad.

        Raises:
            KinematicsError: a joint, a motor, a gap on a rail or a passive joint would be beyond its limit.
            AssemblyError: the loops cannot be closed there.
        """
        self._check_limits(q)
        assembly = self.model.solve(q, self.assembly)
        for joint in self.mechanism.limited:
            old_excess = _limit_excess(joint, self.assembly)
            excess = _limit_excess(joint, assembly)
            # a robot that is beyond a limit already may move, but not farther beyond it
            if excess > max(0.0, old_excess) + _LIMIT_ROUNDING:
                limits = reasons.limit_range(joint)
                text = f"{joint.name} would exceed its limits of {limits} by {reasons.shown(joint, excess)}"
                raise KinematicsError(text)
        return assembly

    def _check_limits(self, q: Array) -> None:
        """Check q (n,) in m or rad against the limits of joints and motors, and the gaps on rails.

        Raises:
            KinematicsError: a limit is exceeded; the message names it.
        """
        for joint, value, (low, high) in zip(self.joints, q, self.mechanism.limits, strict=True):
            if not low - _LIMIT_ROUNDING <= value <= high + _LIMIT_ROUNDING:
                raise KinematicsError(reasons.beyond(joint, float(value), low, high))
        for bound in self.solver.bounds:
            slack = bound.slack(q)
            # a robot that is beyond a limit already may move, but not farther beyond it
            if slack >= min(0.0, bound.slack(self.assembly.q)) - _LIMIT_ROUNDING:
                continue
            if bound.kind == "motor":
                limits = reasons.motor_limits(self.mechanism, bound)
                excess = f"{-slack:.3g} {reasons.motor_unit(self.mechanism, bound)}"
                raise KinematicsError(f"motor {bound.name} would exceed its limits of {limits} by {excess}")
            if bound.kind == "gap":
                lower, upper = bound.name.split()
                least = bound.least / MM
                gap = (slack + bound.least) / MM
                raise KinematicsError(f"{upper} - {lower} = {gap:.3f} mm is below its minimum of {least:.3f} mm")

    def _joint_reason(self, number: int, value: float, dragged: Dragged) -> str:
        """Return why active joint `number` did not reach a value in m or rad."""
        return reasons.of_joint(self.mechanism, self.solver.bounds, self.assembly.q, number, value, dragged)

    def _apply_move(self, go: Callable[[], Assembly], requested_pose: Array | None = None) -> MoveResult:
        with self.lock:
            start = time.perf_counter()
            try:
                if requested_pose is not None and not spatial.is_pose(requested_pose, _POSE_TOLERANCE):
                    raise KinematicsError("the requested pose is not rigid")
                assembly = go()
            except (KinematicsError, AssemblyError) as error:
                self.last_move = MoveResult(False, str(error), time.perf_counter() - start)
            else:
                self.assembly = assembly
                self.requested_pose = requested_pose
                self.last_move = MoveResult(True, "", time.perf_counter() - start)
            return self.last_move


def _opening_state(robot: Robot, model: ReferenceModel) -> Assembly:
    """Return the state at which the pages open: `start` of the description, else the posture home."""
    values = start_of(robot)
    if values:
        return model.solve(np.array([values[joint.name] for joint in model.mechanism.active]))
    home = model.mechanism.home
    if home is None:
        return model.home()
    return model.solve(home)


def start_of(robot: Robot) -> dict[str, float]:
    """Return the joint values in m or rad at which the pages open; {}: the robot's description has none."""
    if robot.files is None:
        return {}
    return joint_values(robot.source.description.start)


def _drag_solver(robot: Robot, model: ReferenceModel) -> DragSolver:
    return DragSolver(model.mechanism, model, robot.gaps)


def _unchanged_equations(robot: Robot) -> Kinematics | None:
    if robot.files is None or not robot.files.has_equations:
        return None
    return robot.kinematics()


def _changed_values(values: Mapping[str, _Value], published: Mapping[str, _Value]) -> dict[str, _Value]:
    """Return the values that differ from the published ones."""
    changes = {}
    for name, value in values.items():
        if value != published.get(name):
            changes[name] = value
    return changes


def _limit_excess(joint: Joint, assembly: Assembly) -> float:
    """Return by how much a passive joint is beyond its limits, in rad or m; negative within the limits."""
    return float(joint.beyond(assembly.link_poses[joint.parent], assembly.link_poses[joint.child]))
