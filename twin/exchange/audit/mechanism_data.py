"""Mechanism data of a file (links, joints, frames, gravity) in a common form for all formats.

A joint has a pose and lines, both in the parent's frame. The pose is the pose of the child at zero coordinates. The
child moves along or about the lines. Some formats split a joint into parts: a ball joint into three hinges with
auxiliary links, or a loop closure into two ties. A tie is a pair of coinciding points. `joints_between` joins the
parts, so that joints of different formats can be compared.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import TypeVar

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.poses import Array

_Value = TypeVar("_Value")

_SAME = 1e-5
"""Tolerance in m and in components of unit vectors, within which lines coincide or meet in a point."""

_SPANNING = 1e-3
"""Volume that three unit vectors must span to be in no common plane: in a plane, they cannot turn a body everywhere."""

_HELPER = 1e-4
"""Largest mass of a link that a format needs only to split a joint or to close a loop, as a part of the mass of all."""

_APART = 1e-3
"""Minimum distance in m between two tied points of a hinge: nearer points let it tilt like a ball joint.

Also the minimum distance of a third point from the axis of the hinge that fixes the joint."""

WORLD = "world"
"""Name of the base in many files, and of the fixed body that every MJCF has."""

TOOL = "(tool)"
"""Name of the tool frame for all formats, because tracks do not state its name."""


def renamed(names: Collection[str], new_names: Mapping[str, str]) -> tuple[str, ...]:
    """Return names after renaming by {old: new}; other names stay."""
    return tuple(new_names.get(name, name) for name in names)


def with_new_keys(values: Mapping[str, _Value], new_names: Mapping[str, str]) -> dict[str, _Value]:
    """Return values by name after renaming by {old: new}; other names stay."""
    renamed_values = {}
    for name, value in values.items():
        renamed_values[new_names.get(name, name)] = value
    return renamed_values


@dataclass(frozen=True)
class FileMass:
    """Mass properties of a link, in the frame of the link.

    Attributes:
        mass: in kg.
        center: centre of mass (3,) in m; None if not stated.
        inertia: inertia (3, 3) in kg m2 about the centre of mass; None if not stated.
    """

    mass: float
    center: Array | None = None
    inertia: Array | None = None


@dataclass(frozen=True)
class JointLine:
    """Line of a joint's motion, in the frame of the joint's parent: the child turns about it, or slides along it.

    Attributes:
        kind: "turn" or "slide".
        point: point (3,) on the line in m.
        direction: unit vector (3,).
    """

    kind: str
    point: Array
    direction: Array

    def transformed(self, T: Array, sign: float = 1.0) -> JointLine:
        """Return the line transformed by the pose T (4, 4), with its direction multiplied by `sign`."""
        return JointLine(self.kind, T[:3, :3] @ self.point + T[:3, 3], sign * T[:3, :3] @ self.direction)

    def motion(self, q: Array | float) -> Array:
        """Return the motion (..., 4, 4) of the child, in the parent's frame, for q (...) in m or rad."""
        if self.kind == "slide":
            return poses.pose(None, np.multiply.outer(q, self.direction))
        T_at_point = poses.pose(None, self.point)
        return T_at_point @ poses.pose(poses.about(self.direction, q)) @ poses.inverse(T_at_point)


@dataclass(frozen=True)
class FileDrive:
    """Limits and drive of a joint; None: the file does not state the value.

    Attributes:
        limits: (lower, upper) in m or rad; infinite without a limit.
        driven: whether an actuator moves the joint.
        stiffness: stiffness of the position drive in N/m or N m/rad.
        damping: damping of the position drive in N s/m or N m s/rad.
        effort: maximum effort in N or N m.
        speed: maximum speed in m/s or rad/s.
        passive: (stiffness, damping, friction, inertia) of springs, dampers, dry friction and rotors at the joint
            itself, in SI units.
        law: "force" if the drive's gains give a force, "acceleration" if they give an acceleration.
        breaks: force in N at which the joint breaks; infinite if it never breaks.
        cone: half angles in rad of the cone of a ball joint, about the two directions across its axis; infinite without
            a cone.
        cone_axis: unit vector (3,) of the axis of this cone, in the frame of the parent; None without a cone.
        soft: range (lower, upper) in m or rad in which a safety controller keeps the joint; the limits without one.
        acceleration: maximum acceleration in m/s2 or rad/s2.
        jerk: maximum jerk in m/s3 or rad/s3.
        control: range (lower, upper) in m or rad of the positions that a control can ask for; the limits where a format
            does not restrict it.
    """

    limits: tuple[float, float] | None = None
    driven: bool | None = None
    stiffness: float | None = None
    damping: float | None = None
    effort: float | None = None
    speed: float | None = None
    passive: tuple[float, float, float, float] | None = None
    law: str | None = None
    breaks: float | None = None
    cone: tuple[float, float] | None = None
    cone_axis: Array | None = None
    soft: tuple[float, float] | None = None
    control: tuple[float, float] | None = None
    acceleration: float | None = None
    jerk: float | None = None


EMPTY = (0.0, 0.0, 0.0, 0.0, 0.0)
"""`FilePhysics.medium` where nothing slows the robot down."""

FREE_JOINT = (0.0, 0.0, 0.0, 0.0)
"""`FileDrive.passive` of a joint without spring, damper, friction and rotor."""


@dataclass(frozen=True)
class FileMotor:
    """A motor with a transmission to joints; SI units, on the motor's side. None: the file does not state the value.

    Attributes:
        row: {joint: factor}; the motor's coordinate is the sum of factor times joint coordinate.
        kind: "angle" or "length", the kind of the motor's coordinate.
        limits: (lower, upper) in m or rad; infinite without a limit.
        effort: maximum effort in N or N m; infinite without a limit.
        speed: maximum speed in m/s or rad/s; infinite without a limit.
        inertia: inertia of the rotor in kg m2, or its mass in kg; 0 without a rotor.
        stiffness: stiffness of the position drive in N/m or N m/rad; 0 without a drive.
        damping: damping of the position drive in N s/m or N m s/rad; 0 without a drive.
        law: what the gains give, as in `FileDrive`.
    """

    row: Mapping[str, float] | None = None
    kind: str | None = None
    limits: tuple[float, float] | None = None
    effort: float | None = None
    speed: float | None = None
    inertia: float | None = None
    stiffness: float | None = None
    damping: float | None = None
    law: str | None = None

    def renamed(self, joints: Mapping[str, str]) -> FileMotor:
        """Return the motor after renaming joints by {old: new}."""
        if self.row is None:
            return self
        return replace(self, row=with_new_keys(self.row, joints))


def drive_of_motors(motors: Mapping[str, FileMotor], joint: str) -> tuple[float, float] | None:
    """Return (stiffness, damping) at a joint due to the drives of its motors; None if no motor moves the joint.

    All other joints are assumed to be fixed. Each motor contributes its stiffness and damping, both multiplied by the
    square of the motor's factor for the joint.
    """
    stiffness = 0.0
    damping = 0.0
    has_motor = False
    for motor in motors.values():
        if motor.row and joint in motor.row:
            # Virtual work: the motor turns by factor * q, and its effort acts at the joint multiplied by the factor
            # again.
            factor = motor.row[joint]
            stiffness += factor * factor * (motor.stiffness or 0.0)
            damping += factor * factor * (motor.damping or 0.0)
            has_motor = True
    if not has_motor:
        return None
    return stiffness, damping


@dataclass(frozen=True)
class FileJoint:
    """A joint between two links.

    Attributes:
        names: names of the joint's parts in the file; usually one.
        parent, child: names of the two links; "" if not stated.
        T: pose T_parent_child (4, 4) at zero coordinates; None if not stated.
        motions: lines along or about which the joint moves, in the parent's frame, from the parent outwards.
        drive: limits and drive of the joint.
        tied: for each tie, (point in the parent's frame, same point in the child's frame), both (3,) in m; empty
            unless the file states the joint only by ties (MJCF connect).
        stated_kind: kind of the joint, if the file states a kind but no axis (tracks, GLB); else "".
    """

    names: tuple[str, ...]
    parent: str
    child: str
    T: Array | None = None
    motions: tuple[JointLine, ...] = ()
    drive: FileDrive = FileDrive()
    tied: tuple[tuple[Array, Array], ...] = ()
    stated_kind: str = ""

    def renamed(self, links: Mapping[str, str], joints: Mapping[str, str]) -> FileJoint:
        """Return the joint after renaming links and joints by {old: new}."""
        parent, child = renamed((self.parent, self.child), links)
        return replace(self, names=renamed(self.names, joints), parent=parent, child=child)

    @property
    def kind(self) -> str:
        """Fixed, revolute, prismatic, cylindrical, spherical, free, "chain of ..." (other motions), or "" (unknown)."""
        if self.stated_kind:
            return self.stated_kind
        if self.tied:
            return _kind_of_ties(self.tied)
        if self.T is None:
            return ""
        return _kind(self.motions)

    def end(self, link: str) -> tuple[Array, Array | None] | None:
        """Return (point (3,) in m, direction (3,) or None for a ball) of the joint in the frame of one of its links.

        Return None if the file does not state the position of the joint. Files may exchange parent and child; therefore
        the direction is reversed if the child's name comes before the parent's in alphabetical order. The direction of
        a tie has no defined sign.
        """
        sign = 1.0 if self.parent < self.child else -1.0
        at_parent = link == self.parent
        if self.tied:
            points = []
            for on_parent, on_child in self.tied:
                points.append(on_parent if at_parent else on_child)
            if len(points) < 2:
                return points[0], None
            # Also of two points that nearly meet: the place of the ball is then compared across the line, as of a pin.
            first, second = _ends_of_ties(self.tied)
            return points[0], sign * unit(points[second] - points[first])
        if self.T is None or not self.motions:
            return None
        turns, _ = _turns_and_slides(self.motions)
        if self.kind == "spherical":
            center = meeting_point(turns)
            if not at_parent:
                center = _moved(center, poses.inverse(self.T))
            return center, None
        line = self.motions[-1]
        if turns:
            # In a cylindrical joint, both lines are the same; the axis of a turn has a place, that of a slide has none.
            line = turns[-1]
        if link == self.child:
            line = line.transformed(poses.inverse(self.T))
        return line.point, sign * line.direction

    def reversed(self) -> FileJoint:
        """Return the joint with parent and child exchanged; the signs of its coordinates do not change."""
        tied = []
        for on_parent, on_child in self.tied:
            tied.append((on_child, on_parent))
        drive = replace(self.drive, cone_axis=None)  # it is known in the frame of the other link
        exchanged = replace(self, parent=self.child, child=self.parent, tied=tuple(tied), drive=drive)
        if self.T is None:
            return exchanged
        T_child_parent = poses.inverse(self.T)
        motions = []
        for line in reversed(self.motions):
            # Seen from the child, the parent moves the other way: the same coordinate needs the opposite direction.
            motions.append(line.transformed(T_child_parent, -1.0))
        return replace(exchanged, T=T_child_parent, motions=tuple(motions))


@dataclass(frozen=True)
class FileFrame:
    """A named frame: the name of its link, and its pose T_link_frame (4, 4)."""

    link: str
    T: Array

    def renamed(self, links: Mapping[str, str]) -> FileFrame:
        """Return the frame after renaming links by {old: new}; its own name stays."""
        return FileFrame(links.get(self.link, self.link), self.T)


def _with_renamed_links(frames: Mapping[str, FileFrame], links: Mapping[str, str]) -> dict[str, FileFrame]:
    """Return frames by name after renaming their links by {old: new}; the names of the frames stay."""
    renamed_frames = {}
    for name, frame in frames.items():
        renamed_frames[name] = frame.renamed(links)
    return renamed_frames


@dataclass
class FilePhysics:
    """Mechanism data of a file.

    Attributes:
        links: names of all links.
        masses: {link: mass properties}.
        shown: {link: whether it has a mesh}, for formats that show a link by meshes alone.
        collides: {link: whether its meshes collide}: True where a file has a shape of the link that collides, False
            where it shows a mesh whose collider is disabled, and nothing else of the link collides.
        assumed: links whose mass is unknown: the file states an assumed mass, because the format requires a mass.
        partly_shown: links whose shapes do not show the whole link, as the file states or because they are for display
            only or not all read: their masses are not judged by them.
        frames: {name: named frame}.
        points: {name: named point}, as frames with the axes of the link. A frame may have the name of a point.
        fully_listed: "frame", "point": those of which `frames` or `points` contains all that the robot has.
        gravity: (3,) in m/s2 in a world with z up; None if not stated.
        medium: (density in kg/m3, viscosity in Pa s, wind x, y, z in m/s) of what the robot moves in; zeros where no
            force acts on it, as in formats that cannot hold a medium; None if not stated.
        self_collision: whether links of the robot may collide with each other; None if not stated.
        fixed_to_world: links that a joint fixes directly to the world; None if the format cannot state that a link is
            fixed.
        tool: name of the frame that protocols move; "" if not stated.
        trocars: names of the trocar joints; the protocol determines their positions.
        couplings: {name: ({joint: factor}, constant)}; the sum of factor times joint coordinate is the constant. None
            if the format cannot state couplings.
        couples_pairs: whether the file can state couplings of two joints only: others are not missing in it.
        motors: {name: motor with a transmission}; None if not stated.
        reductions: {joint: motor coordinate / joint coordinate} of the transmissions of one joint; None if a file has
            no transmissions.
        all_motors: whether `motors` contains all motors with transmissions.
        weight_shares: {link: share of its weight that is compensated}, 0 without compensation; None if not stated.
        opening: length in m (angle in rad) by which the loops open if gravity pulls at them; None if not stated.
        robot: name of the robot; "" if not stated.
        postures: {name: {driven joint: coordinate in m or rad}}; None if not stated.
        home_posture: the coordinates of the posture "home" in a table of a file without other postures; None without.
        home: {joint: coordinate in m or rad} of the assembled pose that a file names home, also of passive joints; None
            if not stated. The posture "home" may be another pose.
        further: {object: {field: value as text}} of what a file declares of the motion beside all of the above, with
            another value than where nothing is written; {} without such declarations, None if not known.
        contact: the same for contacts and look.
        programs: the same for what a single program reads, such as the calibration of a joint, or gravity in Gazebo.
        complete: whether `joints` contains all joints, each with its links; without this, a missing joint is not found.
    """

    links: tuple[str, ...] = ()
    masses: dict[str, FileMass] = field(default_factory=dict)
    shown: Mapping[str, bool] = field(default_factory=dict)
    collides: Mapping[str, bool] = field(default_factory=dict)
    assumed: frozenset[str] = frozenset()
    partly_shown: frozenset[str] = frozenset()
    joints: list[FileJoint] = field(default_factory=list)
    frames: dict[str, FileFrame] = field(default_factory=dict)
    points: dict[str, FileFrame] = field(default_factory=dict)
    fully_listed: frozenset[str] = frozenset()
    gravity: Array | None = None
    medium: tuple[float, ...] | None = None
    self_collision: bool | None = None
    fixed_to_world: frozenset[str] | None = None
    tool: str = ""
    trocars: frozenset[str] = frozenset()
    couplings: Mapping[str, tuple[Mapping[str, float], float]] | None = None
    couples_pairs: bool = False
    motors: Mapping[str, FileMotor] | None = None
    all_motors: bool = False
    reductions: Mapping[str, float] | None = None
    weight_shares: Mapping[str, float] | None = None
    opening: float | None = None
    robot: str = ""
    postures: Mapping[str, Mapping[str, float]] | None = None
    home_posture: Mapping[str, float] | None = None
    home: Mapping[str, float] | None = None
    further: Mapping[str, Mapping[str, str]] | None = None
    contact: Mapping[str, Mapping[str, str]] | None = None
    programs: Mapping[str, Mapping[str, str]] | None = None
    complete: bool = False

    def rename(self, links: Mapping[str, str], joints: Mapping[str, str]) -> None:
        """Rename links and joints by {old: new}; other names stay, as do the texts of what is declared beside them."""
        self.links = renamed(self.links, links)
        self.masses = with_new_keys(self.masses, links)
        self.shown = with_new_keys(self.shown, links)
        self.collides = with_new_keys(self.collides, links)
        self.assumed = frozenset(renamed(self.assumed, links))
        self.partly_shown = frozenset(renamed(self.partly_shown, links))
        for number, joint in enumerate(self.joints):
            self.joints[number] = joint.renamed(links, joints)
        self.frames = _with_renamed_links(self.frames, links)
        self.points = _with_renamed_links(self.points, links)
        if self.fixed_to_world is not None:
            self.fixed_to_world = frozenset(renamed(self.fixed_to_world, links))
        self.trocars = frozenset(renamed(self.trocars, joints))
        if self.couplings is not None:
            couplings: dict[str, tuple[Mapping[str, float], float]] = {}
            for name, (row, total) in self.couplings.items():
                couplings[name] = (with_new_keys(row, joints), total)
            self.couplings = couplings
        if self.motors is not None:
            motors = {}
            for name, motor in self.motors.items():
                motors[name] = motor.renamed(joints)
            self.motors = motors
        if self.reductions is not None:
            self.reductions = with_new_keys(self.reductions, joints)
        if self.weight_shares is not None:
            self.weight_shares = with_new_keys(self.weight_shares, links)
        if self.postures is not None:
            postures = {}
            for name, coordinates in self.postures.items():
                postures[name] = with_new_keys(coordinates, joints)
            self.postures = postures
        if self.home_posture is not None:
            self.home_posture = with_new_keys(self.home_posture, joints)
        if self.home is not None:
            self.home = with_new_keys(self.home, joints)

    def immobile_links(self, known_links: Collection[str]) -> frozenset[str] | None:
        """Return the known links that cannot move in the world; None if the format cannot state it.

        They are the links of `fixed_to_world`, and all links that fixed joints connect with them. A link named "world"
        is not among them: some formats have it as a link of its own, MJCF has it as the world itself.
        """
        if self.fixed_to_world is None:
            return None
        fixed = []
        for joint in self.joints_between({WORLD, *known_links}):
            if joint.kind == "fixed":
                fixed.append({joint.parent, joint.child})
        immobile_links = {WORLD, *self.fixed_to_world}
        has_grown = True
        while has_grown:
            has_grown = False
            for ends in fixed:
                if ends & immobile_links and not ends <= immobile_links:
                    immobile_links |= ends
                    has_grown = True
        return frozenset(immobile_links & set(known_links)) - {WORLD}

    def joints_between(self, known_links: Collection[str]) -> list[FileJoint]:
        """Return the joints between known links.

        An unknown link with two joints is removed, and its two joints become one joint; if the pose of one of them is
        not stated, both are removed with the link. An unknown link with one joint is removed together with the joint.
        An unknown link with three or more joints remains.
        If a file states joints by ties (`FileJoint.tied`), all ties between the same two links become one joint.
        """
        joints = []
        for joint in self.joints:
            if not joint.tied:
                joints.append(joint)
        # Files attach a joint of the ground to the world or to the base fixed to it: one of both must be chosen.
        if WORLD not in known_links:
            joints = _onto_base(joints)
        pending: list[str] = []
        for joint in joints:
            for link in (joint.parent, joint.child):
                if link and link not in known_links and link not in pending:
                    pending.append(link)
        while pending:
            link = _next_removed(pending, joints)
            if link is None:
                break
            pending.remove(link)
            joints = _without(link, joints)
        return joints + self._joined_ties()

    def _joined_ties(self) -> list[FileJoint]:
        """Return one joint for all ties between the same two links."""
        ties: dict[tuple[str, str], list[FileJoint]] = {}
        for joint in self.joints:
            if joint.tied:
                ties.setdefault((joint.parent, joint.child), []).append(joint)
        joined = []
        for group in ties.values():
            names: list[str] = []
            points: list[tuple[Array, Array]] = []
            for joint in group:
                names += joint.names
                points += joint.tied
            joined.append(replace(group[0], names=tuple(names), tied=tuple(points)))
        return joined

    def added_joints(self, known_links: Collection[str]) -> list[FileJoint]:
        """Return the movable joints of unknown links that are heavier than a helper and have no other joint.

        `joints_between` leaves out the joints of all links with one joint, because some formats need helpers: links
        almost without mass that only split a joint or close a loop. A heavier link is none, so that its joint is an
        addition.
        """
        added: list[FileJoint] = []
        for joint in self._of_heavy_ends(known_links).values():
            if joint.names and joint.kind not in ("", "fixed"):
                added.append(joint)
        return added

    def load_links(self, known_links: Collection[str]) -> list[str]:
        """Return the unknown links that are a load: fixed to one other link, with a mass, or without any joint.

        Where a format divides a link, the masses of its parts are those of no link of the others either.
        """
        loads: list[str] = []
        if self.complete and self.joints:
            for link in self.links:
                if link not in known_links and not _joints_of(link, self.joints):
                    loads.append(link)
        for link, joint in self._of_heavy_ends(known_links).items():
            if joint.kind == "fixed":
                loads.append(link)
        return loads

    def _of_heavy_ends(self, known_links: Collection[str]) -> dict[str, FileJoint]:
        """Return {link: its joint} of the unknown links that are heavier than a helper and have one joint."""
        total_mass = 0.0
        for mass in self.masses.values():
            total_mass += mass.mass
        end_joints: dict[str, FileJoint] = {}
        for link, mass in self.masses.items():
            if link in known_links or not mass.mass > _HELPER * total_mass:
                continue
            joints = _joints_of(link, self.joints)
            if len(joints) == 1:
                end_joints[link] = joints[0]
        return end_joints


def _joints_of(link: str, joints: Collection[FileJoint]) -> list[FileJoint]:
    """Return the joints of a link."""
    joints_of_link = []
    for joint in joints:
        if link in (joint.parent, joint.child):
            joints_of_link.append(joint)
    return joints_of_link


def _next_removed(links: Collection[str], joints: Collection[FileJoint]) -> str | None:
    """Return the first of the links with at most two joints; None if there is none."""
    for link in links:
        if len(_joints_of(link, joints)) <= 2:
            return link
    return None


def _without(link: str, joints: list[FileJoint]) -> list[FileJoint]:
    """Return joints without a link: if two joints have it, they become one, with the motions of both.

    Two joints, of which one has no stated pose, cannot become one: both are left out.
    """
    joined: list[FileJoint] = []
    others: list[FileJoint] = []
    for joint in joints:
        if link in (joint.parent, joint.child):
            joined.append(joint)
        else:
            others.append(joint)
    if len(joined) != 2:
        return others
    first, second = joined
    if first.T is None or second.T is None:
        return others
    if first.child != link:
        first = first.reversed()
    if second.parent != link:
        second = second.reversed()
    return [*others, _chained(first, second)]


def _onto_base(joints: list[FileJoint]) -> list[FileJoint]:
    """Return joints on the link that is fixed to the world instead of on the world; others are unchanged."""
    mount = _mount(joints)
    if mount is None:
        return joints
    base = mount.reversed()
    mounted_joints = []
    for joint in joints:
        if joint is mount:
            continue
        if joint.parent == WORLD and joint.T is not None:
            mounted_joints.append(_chained(base, joint))
        else:
            mounted_joints.append(joint)
    return mounted_joints


def _mount(joints: list[FileJoint]) -> FileJoint | None:
    """Return the first joint that fixes a link to the world; None if there is none."""
    for joint in joints:
        if joint.parent == WORLD and joint.kind == "fixed" and joint.T is not None:
            return joint
    return None


def _chained(first: FileJoint, second: FileJoint) -> FileJoint:
    """Return two joints as one; it has the drive of the one that moves, and none if both or neither do."""
    assert first.T is not None
    assert second.T is not None
    drive = FileDrive()
    if first.motions and not second.motions:
        drive = first.drive
    elif second.motions and not first.motions:
        drive = replace(second.drive, cone_axis=None)  # the parent is another one
    motions = list(first.motions)
    for line in second.motions:
        motions.append(line.transformed(first.T))
    names = first.names + second.names
    return FileJoint(names, first.parent, second.child, first.T @ second.T, tuple(motions), drive)


def _kind_of_ties(tied: tuple[tuple[Array, Array], ...]) -> str:
    """Return the kind of a joint of tied points: points in one place are a ball, on one line a hinge, others fixed."""
    first, second = _ends_of_ties(tied)
    origin, _ = tied[first]
    end, _ = tied[second]
    if not np.linalg.norm(end - origin) > _APART:
        return "spherical"
    axis = unit(end - origin)
    for point, _ in tied:
        if np.linalg.norm(np.cross(axis, point - origin)) > _APART:
            return "fixed"
    return "revolute"


def _ends_of_ties(tied: tuple[tuple[Array, Array], ...]) -> tuple[int, int]:
    """Return the indices of the two tied points that are farthest apart, the lower one first; (0, 0) of one point."""
    ends = (0, 0)
    largest = -1.0
    for first, second in combinations(range(len(tied)), 2):
        distance = float(np.linalg.norm(tied[second][0] - tied[first][0]))
        if distance > largest:
            ends = (first, second)
            largest = distance
    return ends


_KINDS = {(0, 0): "fixed", (1, 0): "revolute", (0, 1): "prismatic", (3, 3): "free"}
"""Kinds of joints that the numbers of their turns and slides determine."""


def _kind(motions: tuple[JointLine, ...]) -> str:
    turns, slides = _turns_and_slides(motions)
    count = (len(turns), len(slides))
    if count in _KINDS:
        return _KINDS[count]
    if count == (1, 1):
        sine = np.linalg.norm(np.cross(turns[0].direction, slides[0].direction))
        if sine < _SAME:
            return "cylindrical"
    if count == (3, 0) and _meet(turns):
        return "spherical"
    return f"chain of {len(turns)} turns and {len(slides)} slides"


def _turns_and_slides(motions: tuple[JointLine, ...]) -> tuple[list[JointLine], list[JointLine]]:
    turns = []
    slides = []
    for line in motions:
        if line.kind == "turn":
            turns.append(line)
        else:
            slides.append(line)
    return turns, slides


def _meet(turns: list[JointLine]) -> bool:
    """Return whether three lines, which are not in one plane, meet in a point."""
    directions = [line.direction for line in turns]
    if not abs(np.linalg.det(directions)) > _SPANNING:
        return False
    point = meeting_point(turns)
    for line in turns:
        moment = np.cross(line.direction, point - line.point)
        if not np.linalg.norm(moment) < _SAME:
            return False
    return True


def meeting_point(lines: Collection[JointLine]) -> Array:
    """Return the point (3,) in m with the minimum sum of squared distances from the lines."""
    # normal equations of the sum of |P (x - p)|^2, with the projector P across each line and a point p on it
    A = np.zeros((3, 3))
    b = np.zeros(3)
    for line in lines:
        projector = np.eye(3) - np.outer(line.direction, line.direction)  # onto the plane normal to the line
        A += projector
        b += projector @ line.point
    # Parallel lines leave A singular; of all nearest points, least squares gives that nearest to the origin.
    solution, *_ = np.linalg.lstsq(A, b, rcond=None)
    return solution


def _moved(p: Array, T: Array) -> Array:
    return T[:3, :3] @ p + T[:3, 3]


def unit(v: Array) -> Array:
    """Return the unit vector of v (3,); a zero vector is unchanged."""
    size = float(np.linalg.norm(v))
    if size > 0:
        return v / size
    return v


def motion_lines(kind: str, T: Array, axis: int = 2) -> tuple[JointLine, ...]:
    """Return the lines along or about which a joint moves, in the parent's frame; () if `kind` has no lines.

    T (4, 4) is the pose T_parent_joint of the joint's frame; `axis` 0, 1 or 2 is the x, y or z axis of this frame.
    """
    point = T[:3, 3]
    axes = T[:3, :3].T
    if kind in ("revolute", "prismatic", "cylindrical"):
        axes = axes[axis, None]  # the only axis, as rows (1, 3)
    lines: list[JointLine] = []
    # Slides before turns: after a turn, the lines of the slides would be rotated by it.
    if kind in ("prismatic", "cylindrical", "free"):
        for direction in axes:
            lines.append(JointLine("slide", point, direction))
    if kind in ("revolute", "cylindrical", "spherical", "free"):
        for direction in axes:
            lines.append(JointLine("turn", point, direction))
    return tuple(lines)
