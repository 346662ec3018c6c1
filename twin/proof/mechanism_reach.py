"""Where a mechanism can be assembled: at given joint values, or at given poses of its tool.

Nothing here is taken from the equations. The bodies start in the poses of the CAD and are led to each state in small
steps, with closed loops. At the end, Krawczyk's operator shows that there is an assembly, and the limits and cones of
all joints are looked at. A state at which this fails is unknown: it need not be out of reach.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.model.body import Body
from twin.model.joint import Joint, JointType
from twin.model.mechanism import Mechanism
from twin.proof.degree import Truths
from twin.proof.motion.closure import enclosed
from twin.proof.motion.linkage import Linkage, rotation_of, supported
from twin.proof.motion.prediction import solved
from twin.proof.motion.taylor import TaylorModel, constant

_STEPS = 8
"""Number of steps from the poses of the CAD to a state."""

_ITERATIONS = 3
"""Largest number of Newton steps after each of them."""

_LAST_ITERATIONS = 12
"""The same at the state itself."""

_LONGEST_STEP = 0.5
"""Largest change in m or rad of a passive coordinate by a Newton step."""

_GAP = 1e-9
"""Largest gap in m of a closed loop, by the numbers of the CAD."""

_WITHIN = 1e-6
"""Distance in m or rad from its limits by which a joint is certainly within them."""

_DIRECTIONS = ("x", "y", "z")


@dataclass(frozen=True)
class MechanismStates:
    """What is known of k states.

    Attributes:
        closed: (k,) whether there is an assembly, proved by Krawczyk's operator.
        within: (k,) whether all joints of it are within their limits and cones as well, by more than a micrometre.
    """

    closed: Truths
    within: Truths


def at_joints(mechanism: Mechanism, joints: list[str], q: Array) -> MechanismStates:
    """Return what is known of a mechanism at values q (k, n) of driven joints, in m or rad.

    Driven joints that are not in `joints`, as those of a jaw, are as in the CAD.

    Raises:
        TwinError: the mechanism has a driven joint that closes a loop, or a free one; or a joint is not driven.
    """
    why = supported(mechanism)
    if why:
        raise TwinError(f"{mechanism.name}: where it can be assembled is unknown: {why}")
    linkage = Linkage(mechanism)
    values, balls = _rest_coordinates(linkage, len(q))
    targets = values[:, linkage.driven]
    names = [joint.name for joint in mechanism.active]
    for column, name in enumerate(joints):
        if name not in names:
            raise TwinError(f"{mechanism.name}: where it can be assembled is unknown: joint {name} is not driven")
        targets[:, names.index(name)] = q[:, column]
    return _assembled(linkage, mechanism, values, balls, targets)


def at_poses(mechanism: Mechanism, T_base_tool: Array) -> MechanismStates:
    """Return what is known of a mechanism at tool poses (k, 4, 4), with the joint values that close its loops.

    Raises:
        TwinError: see `at_joints`.
    """
    why = supported(mechanism)
    if why:
        raise TwinError(f"{mechanism.name}: where it can be assembled is unknown: {why}")
    linkage = Linkage(_with_driven_tool(mechanism))
    values, balls = _rest_coordinates(linkage, len(T_base_tool))
    tool = mechanism.frame(mechanism.tool)
    T_rest = mechanism.rest.get(tool.body, np.eye(4)) @ tool.T_body_frame
    R = T_rest[:3, :3].T @ T_base_tool[:, :3, :3]
    pitch = np.arcsin(np.clip(-R[:, 2, 0], -1.0, 1.0))
    yaw = np.arctan2(R[:, 1, 0], R[:, 0, 0])
    roll = np.arctan2(R[:, 2, 1], R[:, 2, 2])
    targets = np.column_stack([T_base_tool[:, :3, 3] - T_rest[:3, 3], yaw, pitch, roll])
    return _assembled(linkage, mechanism, values, balls, targets)


def _with_driven_tool(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism whose tool is moved by six driven joints from the base; its own joints follow.

    The six joints are zero in the rest poses: shifts along x, y and z of the base, then turns about z, y and x of the
    tool.
    """
    tool = mechanism.frame(mechanism.tool)
    T_rest = mechanism.rest.get(tool.body, np.eye(4)) @ tool.T_body_frame
    T_base_rest = np.eye(4)
    T_base_rest[:3, 3] = T_rest[:3, 3]
    bodies = list(mechanism.bodies)
    joints = []
    rest_poses = dict(mechanism.rest)
    parent = mechanism.base
    before = T_base_rest  # pose of the carried frame in base, then in the frame of the body before
    moves: tuple[tuple[JointType, tuple[int, ...]], ...] = (("prismatic", (0, 1, 2)), ("revolute", (2, 1, 0)))
    for kind, axes in moves:
        motion = "shift" if kind == "prismatic" else "turn"
        for axis in axes:
            T_body_joint = _z_along(axis)
            name = f"tool_{motion}_{_DIRECTIONS[axis]}"
            bodies.append(Body(name))
            joints.append(Joint(name, kind, parent, name, before @ T_body_joint, T_body_joint, active=True))
            parent = name
            before = np.eye(4)
            rest_poses[name] = T_base_rest
            if kind == "prismatic" and axis == 2:
                # after the last shift, the turns are about the axes of the tool at rest
                before[:3, :3] = T_rest[:3, :3]
                T_base_rest = T_rest
    # the six bodies stand in the tool frame at rest; the last one holds the tool
    for joint in mechanism.joints:
        joints.append(replace(joint, active=False, drive=None))
    joints.append(Joint("tool_held", "fixed", parent, tool.body, np.eye(4), tool.T_body_frame))
    return replace(
        mechanism,
        bodies=tuple(bodies),
        joints=tuple(joints),
        rest=rest_poses,
        postures={},
        actuators=(),
        transmissions=(),
    )


def _z_along(axis: int) -> Array:
    """Return a pose (4, 4) without a shift whose z is along x, y or z, by its number."""
    T = np.eye(4)
    T[:3, :3] = np.roll(np.eye(3), axis + 1, axis=0)
    return T


def _rest_coordinates(linkage: Linkage, count: int) -> tuple[Array, dict[str, Array]]:
    """Return coordinates (count, m) and rotations (count, 3, 3) of the balls in the poses of the CAD."""
    mechanism = linkage.mechanism
    poses = {}
    for body in mechanism.bodies:
        T_base_body = mechanism.rest.get(body.name, np.eye(4))
        poses[body.name] = np.asarray(T_base_body)[None]
    values, balls = linkage.coordinates_at(poses)
    rotations = {}
    for name, R in balls.items():
        rotations[name] = np.repeat(R, count, axis=0)
    return np.repeat(values, count, axis=0), rotations


def _assembled(
    linkage: Linkage, mechanism: Mechanism, values: Array, balls: dict[str, Array], targets: Array
) -> MechanismStates:
    """Return what is known of a mechanism at some states.

    Args:
        linkage: the coordinates; those of the mechanism, or of one whose tool is held.
        mechanism: the mechanism, with its motors.
        values: coordinates (k, m) to start from.
        balls: rotations {ball joint: (k, 3, 3)} to start from.
        targets: values of the driven coordinates (k, n) at the states.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        values, rotations = _moved_to_targets(linkage, values, balls, targets)
        prediction = TaylorModel(values[None], np.zeros(values.shape))
        if linkage.closes:
            enclosure = enclosed(linkage, prediction, rotations)
            placed = enclosure.placed
            closed = enclosure.closed & (enclosure.gap < _GAP)
        else:
            placed = linkage.place(prediction, rotations)
            closed = np.ones(len(values), bool)
        poses = {}
        for name, frame in placed.frames.items():
            poses[name] = spatial.pose(frame.R.c[0], frame.p.c[0])
        within = closed.copy()
        for joint in linkage.mechanism.joints:
            within &= joint.beyond(poses[joint.parent], poses[joint.child]) <= -_WITHIN
        within &= _motors_within(mechanism, linkage, values)
    return MechanismStates(closed, within)


def _motors_within(mechanism: Mechanism, linkage: Linkage, values: Array) -> Truths:
    """Return where (k,) all motors certainly are within their limits, at coordinates (k, m)."""
    columns = [linkage.index(joint.name) for joint in mechanism.active]
    positions = dict(zip(mechanism.motor_names, mechanism.motors(values[:, columns]).T, strict=True))
    within = np.ones(len(values), bool)
    for actuator in mechanism.actuators:
        if actuator.limits is not None and actuator.name in positions:
            low, high = actuator.limits
            position = positions[actuator.name]
            within &= (position >= low + _WITHIN) & (position <= high - _WITHIN)
    return within


def _moved_to_targets(
    linkage: Linkage, values: Array, balls: dict[str, Array], targets: Array
) -> tuple[Array, dict[str, TaylorModel]]:
    """Return coordinates (k, m) and rotations of balls after small steps to the states; see `_assembled`."""
    start = values[:, linkage.driven].copy()
    if linkage.closes:
        # one step could end in another assembly, or in none
        for step in range(1, _STEPS + 1):
            values[:, linkage.driven] = start + step / _STEPS * (targets - start)
            iterations = _ITERATIONS
            if step == _STEPS:
                iterations = _LAST_ITERATIONS
            values, balls = solved(linkage, values, balls, iterations, _LONGEST_STEP)
    values[:, linkage.driven] = targets
    rotations = {}
    for name, R in balls.items():
        rotations[name] = rotation_of(constant(spatial.quat_from_matrix_wxyz(R), 0))
    return values, rotations
