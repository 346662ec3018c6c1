"""The format-neutral model: bodies, joints and loops.

The tree connects every body to the base by exactly one path of joints. A joint that is not in the tree closes a loop:
it has two frames like every joint, but its coordinate follows from the other joints. All values are in SI units; all
objects are immutable.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NoReturn

import numpy as np

from twin.core import spatial, units
from twin.core.errors import MechanismError, unknown
from twin.core.foreign.budget import BODIES, FREEDOMS
from twin.core.provenance import Parameter
from twin.core.spatial import Array, Index
from twin.model.body import TOOL, Body, Finish, Frame, Material, Point
from twin.model.joint import FREE_AXES, Joint, reversed_joint
from twin.model.transmission import Actuator, Transmission, faults

_IDENTIFIER = re.compile(r"[a-z][a-z0-9_]*")

WORLD = "world"
"""Name of the base of a robot whose first link hangs on a wall or a ceiling, or floats: the world itself."""

_POINT_LENGTH = 1e-3
"""Length in m below which a link is a point: its joints are drawn at the same place."""

_POSE_TOLERANCE = 1e-6
"""Largest error of an entry of a rotation: files with seven digits are accepted."""

EARTH = (0.0, 0.0, -9.81)
"""Gravitational acceleration in m/s2 of a robot that states none."""


@dataclass(frozen=True)
class Coupling:
    """A belt, gear or cable: the sum of ratio times coordinate over its joints is constant.

    A coupling is a constraint between joints and has no motor; motors move joints through a `Transmission`.

    Attributes:
        name: identifier.
        joints: names of tree joints with one coordinate.
        ratios: one ratio for each joint, in the unit of the first joint's coordinate per unit of this joint's: without
            unit, m/rad or rad/m.
        total: the constant sum, in the unit of the first joint's coordinate, rad or m.
    """

    name: str
    joints: tuple[str, ...]
    ratios: tuple[float, ...]
    total: float = 0.0


@dataclass(frozen=True)
class Mechanism:
    """Bodies, joints and loops of one robot.

    The base frame is the world frame, z up. The pose of a robot that stands elsewhere is a joint from a base named
    `WORLD` to the robot's first link: a fixed joint for a mount on a wall or a ceiling, a free joint if the robot
    floats.

    Attributes:
        name: identifier.
        base: name of the fixed body; its frame is the base frame.
        bodies, joints, frames, points: in file order; the order of the joints decides which of them closes a loop.
        rest: T_base_body (4, 4) of every body as in the CAD or in the file; loop closure starts from these poses.
        postures: named values of the active joints in m or rad.
        tool: name of the tool frame of inverse and forward kinematics.
        parameters: the numbers of the description that are not in the CAD (limits, drives, densities), with provenance.
        actuators, transmissions: motors, and their transmissions to active joints; other active joints are driven
            directly.
        couplings: belts, gears and cables between joints.
        trocars: names of the joints between the base and a trocar; a trocar has the name of its joint.
        gravity: gravitational acceleration (x, y, z) in m/s2, in base.
        source: the file of the mechanism, for messages.
    """

    name: str
    base: str
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    frames: tuple[Frame, ...] = ()
    points: tuple[Point, ...] = ()
    rest: Mapping[str, Array] = field(default_factory=dict)
    postures: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    tool: str = TOOL
    parameters: tuple[Parameter, ...] = ()
    actuators: tuple[Actuator, ...] = ()
    transmissions: tuple[Transmission, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    trocars: tuple[str, ...] = ()
    gravity: tuple[float, float, float] = EARTH
    source: str = ""

    def __post_init__(self) -> None:
        _check(self)

    @cached_property
    def tree(self) -> tuple[Joint, ...]:
        """Joints that connect all bodies to the base without loops, parents first.

        The child of a joint is the body farther from the base; a joint with the opposite direction is reversed.
        File order is kept as far as possible: if two joints could reach a body, the earlier joint is used.
        """
        reached = {self.base}
        tree = []
        pending = list(self.joints)
        while pending:
            # from the beginning after each joint, so that an earlier joint that can now be used comes first
            for joint in pending:
                parent_reached = joint.parent in reached
                child_reached = joint.child in reached
                if parent_reached and not child_reached:
                    tree.append(joint)
                    reached.add(joint.child)
                elif child_reached and not parent_reached:
                    tree.append(reversed_joint(joint))
                    reached.add(joint.parent)
                else:
                    continue
                pending.remove(joint)
                break
            else:
                break
        return tuple(tree)

    @cached_property
    def loops(self) -> tuple[Joint, ...]:
        """Joints that close a loop, in file order."""
        spanning = _names(self.tree)
        loops = []
        for joint in self.joints:
            if joint.name not in spanning:
                loops.append(joint)
        return tuple(loops)

    @cached_property
    def active(self) -> tuple[Joint, ...]:
        """Active joints, in the order of q."""
        return tuple(joint for joint in self.joints if joint.active)

    @cached_property
    def auxiliary(self) -> tuple[Joint, ...]:
        """Active joints that cannot move the tool: the jaw of an instrument, another arm on the same base.

        A joint moves the tool if it is on the tree's path from the base to the tool. It also moves the tool if it
        shares a loop or a coupling with a joint that moves the tool. The loop of a closing joint is its fundamental
        cycle in the tree; joints between the base and that cycle are not part of the loop.
        """
        tool_body = None
        for frame in self.frames:
            if frame.name == self.tool:
                tool_body = frame.body
        if tool_body is None:
            return ()
        # by name, because joints of the tree can be reversed copies
        moving = _names(self.path(tool_body))
        # joints of a loop or a coupling move together
        groups: list[set[str]] = []
        for coupling in self.couplings:
            groups.append(set(coupling.joints))
        for closing in self.loops:
            cycle = _names(self.path(closing.parent)) ^ _names(self.path(closing.child))
            groups.append(cycle | {closing.name})
        has_grown = True
        while has_grown:
            has_grown = False
            for group in groups:
                if group & moving and not group <= moving:
                    moving |= group
                    has_grown = True
        others = []
        for joint in self.active:
            if joint.name not in moving:
                others.append(joint)
        if len(others) == len(self.active):
            return ()  # no active joint moves the tool: none is called auxiliary
        return tuple(others)

    def extra_joints(self, names: Iterable[str]) -> tuple[tuple[int, str, bool, float], ...]:
        """Return (index in q, name, whether an angle, drawn coordinate) of each auxiliary joint not in `names`."""
        given_names = set(names)
        extra = []
        for joint in self.auxiliary:
            if joint.name not in given_names:
                extra.append((self.active.index(joint), joint.name, joint.is_angle, self._drawn(joint)))
        return tuple(extra)

    def _drawn(self, joint: Joint) -> float:
        """Return the coordinate of a joint in m or rad in the first posture or, without postures, in the CAD."""
        if self.postures:
            first = next(iter(self.postures.values()))
            return float(first[joint.name])
        if not self.rest:
            return 0.0
        T_base_parent = self.rest.get(joint.parent, np.eye(4))
        T_base_child = self.rest.get(joint.child, np.eye(4))
        return float(joint.coordinate(T_base_parent, T_base_child))

    @cached_property
    def limits(self) -> Array:
        """Hard limits (n, 2) of the active joints in m or rad, infinite where a joint has no limit."""
        ranges = []
        for joint in self.active:
            ranges.append(joint.limits or (-np.inf, np.inf))
        return np.array(ranges, float).reshape(-1, 2)  # (0, 2) without active joints

    @cached_property
    def motor_names(self) -> tuple[str, ...]:
        """Names (n,) of the motors, in the order of q; the motor of a directly driven joint has the joint's name."""
        motors: dict[str, str] = {}
        for transmission in self.transmissions:
            # as many motors as joints; which motor moves which joint does not matter for the order
            motors |= zip(transmission.joints, transmission.actuators, strict=True)
        names = []
        for joint in self.active:
            names.append(motors.get(joint.name, joint.name))
        return tuple(names)

    @cached_property
    def motor_matrix(self) -> Array:
        """Matrix (n, n) from motor to joint coordinates, q = motor_matrix @ m; identity without transmissions."""
        matrix = np.eye(len(self.active))
        for transmission in self.transmissions:
            matrix[self._block(transmission)] = transmission.matrix
        return matrix

    @cached_property
    def _motor_rows(self) -> Array:
        """Inverse (n, n) of `motor_matrix`, computed block by block: the rows of directly driven joints stay exact."""
        matrix = np.eye(len(self.active))
        for transmission in self.transmissions:
            matrix[self._block(transmission)] = transmission.inverse
        return matrix

    def _block(self, transmission: Transmission) -> tuple[Index, ...]:
        """Return the index of the elements of a matrix (n, n) that belong to the joints of a transmission."""
        names = [joint.name for joint in self.active]
        rows = list(map(names.index, transmission.joints))
        return np.ix_(rows, rows)

    def motors(self, q: Array) -> Array:
        """Return motor values or rates (..., n), in the order of `motor_names`, for joint values or rates (..., n)."""
        return np.asarray(q, float) @ self._motor_rows.T

    def from_motors(self, m: Array) -> Array:
        """Return joint values or rates (..., n) for motor values or rates (..., n), in the order of `motor_names`."""
        return np.asarray(m, float) @ self.motor_matrix.T

    def motor_efforts(self, efforts: Array) -> Array:
        """Return the motor efforts (..., n) equivalent to joint efforts (..., n), in N m or N."""
        return np.asarray(efforts, float) @ self.motor_matrix

    @cached_property
    def passive(self) -> tuple[Joint, ...]:
        """Passive joints with one coordinate, of the tree and of the loops, in file order."""
        passive = []
        for joint in self.joints:
            if not joint.active and len(joint.free_axes) == 1:
                passive.append(joint)
        return tuple(passive)

    @cached_property
    def limited(self) -> tuple[Joint, ...]:
        """Passive joints with hard limits or a cone, of the tree and of the loops, in file order."""
        limited = []
        for joint in self.joints:
            has_limit = joint.limits is not None or joint.cone is not None
            if has_limit and not joint.active:
                limited.append(joint)
        return tuple(limited)

    @property
    def driven(self) -> tuple[list[tuple[str, bool]], Array, Array | None]:
        """(joints, T_base_tool, q): the active joints that move the tool, the tool pose, and the joint values.

        `joints`: (name, is_angle) of each joint. `T_base_tool` (4, 4): tool pose in the rest poses. `q` (n,): joint
        values in m or rad in the first posture; None if the mechanism has no posture.
        """
        tool = self.frame(self.tool)
        T_base_tool = self.rest.get(tool.body, np.eye(4)) @ tool.T_body_frame
        auxiliary = _names(self.auxiliary)
        joints = []
        values = []
        for joint in self.active:
            if joint.name in auxiliary:
                continue
            joints.append((joint.name, joint.is_angle))
            if self.postures:
                values.append(self._drawn(joint))
        q = None
        if self.postures:
            q = np.array(values)
        return joints, T_base_tool, q

    @cached_property
    def link_length(self) -> float | None:
        """Median length in m of the links (largest distance between two joints); None if all links are points."""
        places: dict[str, list[Array]] = {}
        for joint in self.joints:
            places.setdefault(joint.parent, []).append(joint.T_parent_joint[:3, 3])
            places.setdefault(joint.child, []).append(joint.T_child_joint[:3, 3])
        lengths = []
        for positions in places.values():
            origins = np.array(positions)
            distances = np.linalg.norm(origins[:, None] - origins[None], axis=2)
            length = float(distances.max())
            if length > _POINT_LENGTH:
                lengths.append(length)
        if not lengths:
            return None
        # The median: one long base or rail says little about the size of the links.
        return float(np.median(lengths))

    @cached_property
    def materials(self) -> dict[str, Material]:
        """{name of a mesh: its material}; all written formats use the names and finishes of these materials.

        The name of a `Material` consists of the part's material and the colour, such as `steel_8a8f96`. This name is
        the same for all robots and does not change with the drawing, so that a user's replacement material in another
        program stays assigned.
        """
        material_of: dict[tuple[tuple[float, ...], Finish], Material] = {}
        used_names: set[str] = set()
        material_of_mesh = {}
        for body in self.bodies:
            for mesh in body.meshes:
                key = (mesh.color_rgba, mesh.finish)
                if key not in material_of:
                    color = units.hex_digits(mesh.color_rgba)
                    made_of = mesh.finish.material.removesuffix(f"_{color}") or "color"
                    name = f"{made_of}_{color}"
                    number = 2
                    # A number is added if only the finish differs, or if different colours are equal in 8 bits.
                    while name in used_names:
                        name = f"{made_of}_{number}_{color}"
                        number += 1
                    used_names.add(name)
                    material_of[key] = Material(name, mesh.color_rgba, mesh.finish)
                material_of_mesh[mesh.name] = material_of[key]
        return material_of_mesh

    def body(self, name: str) -> Body:
        """Return the body called `name`, or raise a `MechanismError` that lists all names."""
        return _find("body", self.bodies, name)

    def joint(self, name: str) -> Joint:
        """Return the joint called `name`, or raise a `MechanismError` that lists all names."""
        return _find("joint", self.joints, name)

    def frame(self, name: str) -> Frame:
        """Return the frame called `name`, or raise a `MechanismError` that lists all names."""
        return _find("frame", self.frames, name)

    def frame_in_tool(self, name: str) -> Array:
        """Return T_tool_frame (4, 4) of a frame; raise `MechanismError` if the frame is not on the tool's body."""
        tool = self.frame(self.tool)
        frame = self.frame(name)
        if tool.body != frame.body:
            raise MechanismError(
                f"frame '{name}' is on body '{frame.body}', the tool is on '{tool.body}': it moves relative to the tool"
            )
        return spatial.inverse(tool.T_body_frame) @ frame.T_body_frame

    def actuator(self, name: str) -> Actuator:
        """Return the actuator called `name`, or raise a `MechanismError` that lists all names."""
        return _find("actuator", self.actuators, name)

    def transmission_of(self, joint: str) -> Transmission | None:
        """Return the transmission that moves a joint; None if the joint is driven directly, or passive."""
        for transmission in self.transmissions:
            if joint in transmission.joints:
                return transmission
        return None

    def point(self, name: str) -> Point:
        """Return the point called `name`, or raise a `MechanismError` that lists all names."""
        return _find("point", self.points, name)

    @property
    def home(self) -> Array | None:
        """Joint values (n,) of the posture "home"; None if there is no such posture."""
        if "home" not in self.postures:
            return None
        return self.posture("home")

    def path(self, body: str) -> tuple[Joint, ...]:
        """Return the joints of the tree from the base to a body, base first."""
        joints = []
        while body != self.base:
            joints.append(self._inward[body])
            body = joints[-1].parent
        return tuple(joints[::-1])

    @cached_property
    def _inward(self) -> dict[str, Joint]:
        """{name of a body: the tree joint whose child is this body}."""
        return {joint.child: joint for joint in self.tree}

    def posture(self, name: str) -> Array:
        """Return q (n,) of the posture called `name`, or raise a `MechanismError` that lists all names."""
        if name not in self.postures:
            raise MechanismError(f"{self.name}: {unknown('posture', name, self.postures)}")
        values = self.postures[name]
        return np.array([values[joint.name] for joint in self.active])

    def with_rest(self, rest: Mapping[str, Array]) -> Mechanism:
        """Return the same mechanism with other rest poses; `rest` is {body: T_base_body (4, 4)}."""
        return replace(self, rest=dict(rest))

    @property
    def trocar_places(self) -> dict[str, Array]:
        """{name of a trocar: position (3,) in base, in m}; empty if the mechanism has no trocar."""
        places = {}
        for name in self.trocars:
            places[name] = self.joint(name).T_parent_joint[:3, 3]
        return places

    def trocar_at(self, name: str = "") -> Array:
        """Return the position (3,) of a trocar in base, in m; for `name` and errors, see `trocar_named`."""
        return self.trocar_places[self.trocar_named(name)]

    def trocar_named(self, name: str = "") -> str:
        """Return the name of a trocar; "" means the only trocar.

        Raises:
            MechanismError: the trocar does not exist, or "" is given for a mechanism with several trocars; the message
            names the existing trocars.
        """
        if name in self.trocars:
            return name
        if name and self.trocars:
            raise MechanismError(f"{self.name}: {unknown('trocar', name, self.trocars)}")
        match self.trocars:
            case (only,):
                return only
            case ():
                raise MechanismError(f"{self.name}: no joint is a trocar")
        raise MechanismError(f"{self.name} has the trocars {', '.join(self.trocars)}: choose one by name")

    def with_trocar(self, p_base: Array, name: str = "") -> Mechanism:
        """Return the same mechanism with a trocar moved to p_base (3,) in m but not rotated; see `trocar_named`."""
        name = self.trocar_named(name)
        T = self.joint(name).T_parent_joint.copy()
        T[:3, 3] += np.asarray(p_base, float) - self.trocar_at(name)
        joints = []
        for joint in self.joints:
            if joint.name == name:
                joint = replace(joint, T_parent_joint=T)
            joints.append(joint)
        return replace(self, joints=tuple(joints))

    def with_trocars(self, places: Mapping[str, Array]) -> Mechanism:
        """Return the same mechanism with the trocars moved to `places`: {name: position (3,) in base, in m}."""
        mechanism = self
        for name, p_base in places.items():
            mechanism = mechanism.with_trocar(p_base, name)
        return mechanism

    def shaft_through(self, name: str = "") -> Frame | None:
        """Return the frame of the instrument with z along the shaft axis; None if no body slides in the trocar.

        The sliding joint is on the trocar's body, or on a body that revolute joints connect to it (a gimbal ring).
        """
        bodies = [self.joint(self.trocar_named(name)).child]
        # The list grows while it is read, so that rings on rings of a gimbal are searched too.
        for body in bodies:
            for joint in self.joints:
                ends = (joint.parent, joint.child)
                if body not in ends or self.base in ends:
                    continue
                outer = joint.parent
                T = joint.T_parent_joint
                if joint.parent == body:
                    outer = joint.child
                    T = joint.T_child_joint
                if joint.type in ("prismatic", "cylindrical"):
                    return Frame(f"shaft_in_{bodies[0]}", outer, T)
                if joint.type == "revolute" and outer not in bodies:
                    bodies.append(outer)
        return None


def _find(kind: str, items, name: str):
    """Return the item with a name; the message of the error lists all names of this `kind` of items."""
    names = []
    for item in items:
        if item.name == name:
            return item
        names.append(item.name)
    raise MechanismError(unknown(kind, name, names))


def _names(items: Iterable[Body] | Iterable[Joint]) -> set[str]:
    """Return the names of bodies or joints."""
    return {item.name for item in items}


def _check(mechanism: Mechanism) -> None:
    """Raise `MechanismError` for the first inconsistency of a mechanism."""
    # Names first: the checks below find the parts by their names, and name them in their messages.
    _check_names(mechanism)
    _check_size(mechanism)
    _check_joints(mechanism)
    _check_motors(mechanism)
    _check_trocars(mechanism)
    _check_places(mechanism)
    _check_connections(mechanism)
    _check_postures(mechanism)


def _fail(mechanism: Mechanism, text: str) -> NoReturn:
    """Raise `MechanismError` with the name of the mechanism."""
    raise MechanismError(f"{mechanism.name or 'mechanism'}: {text}")


def _check_names(mechanism: Mechanism) -> None:
    """Check that each name is an identifier, and that no two entries of a kind have one name."""
    named = {
        "body": mechanism.bodies,
        "joint": mechanism.joints,
        "frame": mechanism.frames,
        "point": mechanism.points,
        "coupling": mechanism.couplings,
        "actuator": mechanism.actuators,
        "transmission": mechanism.transmissions,
    }
    for kind, items in named.items():
        names: set[str] = set()
        for item in items:
            if not _IDENTIFIER.fullmatch(item.name):
                _fail(mechanism, f"{kind} name '{item.name}' is not an identifier [a-z][a-z0-9_]*")
            if item.name in names:
                _fail(mechanism, f"two {kind} entries are named '{item.name}'")
            names.add(item.name)


def _check_size(mechanism: Mechanism) -> None:
    """Check the numbers of bodies, joints and degrees of freedom against what files of others may ask for."""
    for kind, count in (("bodies", len(mechanism.bodies)), ("joints", len(mechanism.joints))):
        if count > BODIES:
            _fail(mechanism, f"{count} {kind}; the limit is {BODIES}")
    freedoms = 0
    for joint in mechanism.joints:
        freedoms += len(FREE_AXES.get(joint.type, ()))
    if freedoms > FREEDOMS:
        _fail(mechanism, f"all joints together have {freedoms} degrees of freedom; the limit is {FREEDOMS}")


def _check_joints(mechanism: Mechanism) -> None:
    """Check the base, and the bodies, frames, limits and drive of each joint."""
    names = _names(mechanism.bodies)
    if mechanism.base not in names:
        _fail(mechanism, f"base: {unknown('body', mechanism.base, names)}")
    for joint in mechanism.joints:
        for end, body in (("parent", joint.parent), ("child", joint.child)):
            if body not in names:
                _fail(mechanism, f"joint '{joint.name}', {end}: {unknown('body', body, names)}")
        if joint.parent == joint.child:
            _fail(mechanism, f"joint '{joint.name}' connects body '{joint.parent}' to itself")
        if joint.type not in FREE_AXES:
            _fail(mechanism, f"joint '{joint.name}': {unknown('joint type', joint.type, FREE_AXES)}")
        for label, T in (("parent", joint.T_parent_joint), ("child", joint.T_child_joint)):
            if not spatial.is_pose(T, _POSE_TOLERANCE):
                _fail(mechanism, f"joint '{joint.name}': the frame on its {label} is not a rigid pose")
        for label, limits in (("limits", joint.limits), ("soft limits", joint.soft_limits)):
            if limits is not None and not limits[0] < limits[1]:
                _fail(mechanism, f"joint '{joint.name}': {label} {limits[0]:g} .. {limits[1]:g} are not ordered")
        if joint.active and len(joint.free_axes) != 1:
            _fail(mechanism, f"active joint '{joint.name}' must have one coordinate; a {joint.type} joint does not")


def _check_motors(mechanism: Mechanism) -> None:
    """Check transmissions, which connect actuators to active joints, and couplings."""
    active = []
    with_drive = []
    joints = []
    single: set[str] = set()  # couplings connect joints with one coordinate only
    for joint in mechanism.joints:
        joints.append(joint.name)
        if joint.active:
            active.append(joint.name)
        if joint.drive:
            with_drive.append(joint.name)
        if len(joint.free_axes) == 1:
            single.add(joint.name)
    for *_, text in faults(mechanism.actuators, mechanism.transmissions, active, joints, with_drive):
        _fail(mechanism, text)
    for coupling in mechanism.couplings:
        for name in coupling.joints:
            if name not in single:
                _fail(mechanism, f"coupling '{coupling.name}': {unknown('joint with one coordinate', name, single)}")
        if len(coupling.ratios) != len(coupling.joints) or not all(coupling.ratios):
            _fail(mechanism, f"coupling '{coupling.name}' needs one nonzero ratio for each of its joints")
        if not np.all(np.isfinite([*coupling.ratios, coupling.total])):
            _fail(mechanism, f"coupling '{coupling.name}': its ratios and its sum must be finite")


def _check_trocars(mechanism: Mechanism) -> None:
    """Check that each trocar is a joint on the base, listed once."""
    joints = _names(mechanism.joints)
    for name in mechanism.trocars:
        if name not in joints or mechanism.joint(name).parent != mechanism.base:
            _fail(mechanism, f"trocar: the parent of joint '{name}' must be the base '{mechanism.base}'")
        if mechanism.trocars.count(name) > 1:
            _fail(mechanism, f"trocar '{name}' is listed twice")


def _check_places(mechanism: Mechanism) -> None:
    """Check gravity, frames, points and rest poses."""
    names = _names(mechanism.bodies)
    if len(mechanism.gravity) != 3 or not np.all(np.isfinite(mechanism.gravity)):
        _fail(mechanism, f"gravity {mechanism.gravity} is not three finite numbers in m/s2")
    for item in (*mechanism.frames, *mechanism.points):
        if item.body not in names:
            _fail(mechanism, f"'{item.name}': {unknown('body', item.body, names)}")
    for frame in mechanism.frames:
        if not spatial.is_pose(frame.T_body_frame, _POSE_TOLERANCE):
            _fail(mechanism, f"frame '{frame.name}' is not a rigid pose")
    for point in mechanism.points:
        if np.shape(point.p_body) != (3,) or not np.all(np.isfinite(point.p_body)):
            _fail(mechanism, f"point '{point.name}' is not three finite numbers")
    for name, T in mechanism.rest.items():
        if name in names and not spatial.is_pose(T, _POSE_TOLERANCE):
            _fail(mechanism, f"body '{name}': its rest pose is not rigid")


def _check_connections(mechanism: Mechanism) -> None:
    """Check that joints connect each body to the base."""
    unconnected = _names(mechanism.bodies) - {mechanism.base}
    for joint in mechanism.tree:
        unconnected.discard(joint.child)
    if unconnected:
        listed = ", ".join(sorted(unconnected))
        advice = "Add joints, or move these bodies to the props of a scene."
        _fail(mechanism, f"no joints connect base '{mechanism.base}' to: {listed}. {advice}")


def _check_postures(mechanism: Mechanism) -> None:
    """Check that each posture has a value for each active joint, and that no active joint closes a loop."""
    active = _names(mechanism.active)
    for posture, values in mechanism.postures.items():
        wrong = sorted(set(values) ^ active)  # names without a value, and values of no active joint
        if wrong:
            listed = ", ".join(wrong)
            _fail(mechanism, f"posture '{posture}' must have exactly one value for each active joint; check: {listed}")
        for name, value in values.items():
            if not np.isfinite(value):
                _fail(mechanism, f"posture '{posture}': {name} = {value} is not finite")
    for joint in mechanism.loops:
        if joint.active:
            text = "would close a loop; list it before the passive joints of its loop"
            _fail(mechanism, f"active joint '{joint.name}' {text}")
