"""Mechanism data of a file (links, joints, frames, gravity) in a common form for all formats.

A joint has a pose and lines, both in the parent's frame. The pose is the pose of the child at zero coordinates. The
child moves along or about the lines. Some formats split a joint into parts: a ball joint into three hinges with
auxiliary links, or a loop closure into two ties. A tie is a pair of coinciding points. `reduced` joins the parts, so
that joints of different formats can be compared.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.poses import Array

_SAME = 1e-5
"""Tolerance in m and in components of unit vectors, within which lines coincide or meet in a point."""

_HELPER = 1e-4
"""Largest mass of a link that a format needs only to split a joint or to close a loop, as a part of the mass of all."""

_APART = 1e-3
"""Minimum distance in m between two tied points of a hinge: nearer points let it tilt like a ball joint."""

WORLD = "world"
"""Name of the base in many files, and of the fixed body that every MJCF has."""

TOOL = "(tool)"
"""Name of the tool frame for all formats, because tracks do not state its name."""


@dataclass(frozen=True)
class Mass:
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
class Line:
    """Line of a joint's motion, in the frame of the joint's parent: the child turns about it, or slides along it.

    Attributes:
        kind: "turn" or "slide".
        point: point (3,) on the line in m.
        direction: unit vector (3,).
    """

    kind: str
    point: Array
    direction: Array

    def seen(self, T: Array, sign: float = 1.0) -> Line:
        """Return the line transformed by the pose T (4, 4), with its direction multiplied by `sign`."""
        return Line(self.kind, T[:3, :3] @ self.point + T[:3, 3], sign * T[:3, :3] @ self.direction)

    def moved(self, q: Array | float) -> Array:
        """Return the motion (..., 4, 4) of the child, in the parent's frame, for q (...) in m or rad."""
        if self.kind == "slide":
            return poses.pose(None, np.multiply.outer(q, self.direction))
        there = poses.pose(None, self.point)
        return there @ poses.pose(poses.about(self.direction, q)) @ poses.inverse(there)


@dataclass(frozen=True)
class Drive:
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


FREE_JOINT = (0.0, 0.0, 0.0, 0.0)
"""`Drive.passive` of a joint without spring, damper, friction and rotor."""


@dataclass(frozen=True)
class Motor:
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
    """

    row: Mapping[str, float] | None = None
    kind: str | None = None
    limits: tuple[float, float] | None = None
    effort: float | None = None
    speed: float | None = None
    inertia: float | None = None
    stiffness: float | None = None
    damping: float | None = None


def felt(motors: Mapping[str, Motor], joint: str) -> tuple[float, float] | None:
    """Return (stiffness, damping) at a joint due to the drives of its motors; None if no motor moves the joint.

    All other joints are assumed to be fixed. Each motor contributes its stiffness and damping, both multiplied by the
    square of the motor's factor for the joint.
    """
    moving = [(m, m.row[joint]) for m in motors.values() if m.row and joint in m.row]
    if not moving:
        return None
    return sum(c * c * (m.stiffness or 0.0) for m, c in moving), sum(c * c * (m.damping or 0.0) for m, c in moving)


@dataclass(frozen=True)
class Joint:
    """A joint between two links.

    Attributes:
        names: names of the joint's parts in the file; usually one.
        parent, child: names of the two links; "" if not stated.
        T: pose T_parent_child (4, 4) at zero coordinates; None if not stated.
        motions: lines along or about which the joint moves, in the parent's frame, from the parent outwards.
        drive: limits and drive of the joint.
        tied: for each tie, (point in the parent's frame, same point in the child's frame), both (3,) in m; empty
            unless the file states the joint only by ties (MJCF connect).
        kind_said: kind of the joint, if the file states a kind but no axis (tracks, GLB); else "".
    """

    names: tuple[str, ...]
    parent: str
    child: str
    T: Array | None = None
    motions: tuple[Line, ...] = ()
    drive: Drive = Drive()
    tied: tuple[tuple[Array, Array], ...] = ()
    kind_said: str = ""

    @property
    def kind(self) -> str:
        """Fixed, revolute, prismatic, cylindrical, spherical, free, "chain of ..." (other motions), or "" (unknown)."""
        if self.kind_said:
            return self.kind_said
        if self.tied:
            first = self.tied[0][0]
            others = [point for point, _ in self.tied[1:] if np.linalg.norm(point - first) > _APART]
            return {0: "spherical", 1: "revolute"}.get(len(others), "fixed")
        return "" if self.T is None else _kind(self.motions)

    def end(self, link: str) -> tuple[Array, Array | None] | None:
        """Return (point (3,) in m, direction (3,) or None for a ball) of the joint in the frame of one of its links.

        Return None if the file does not state the position of the joint. Files may exchange parent and child; therefore
        the direction is reversed if the child's name comes before the parent's in alphabetical order. The direction of
        a tie has no defined sign.
        """
        flip = 1.0 if self.parent < self.child else -1.0
        if self.tied:
            points = [pair[0 if link == self.parent else 1] for pair in self.tied]
            return points[0], None if len(points) < 2 else flip * unit(points[1] - points[0])
        if self.T is None or not self.motions:
            return None
        turns = [m for m in self.motions if m.kind == "turn"]
        line = (turns or list(self.motions))[-1]
        if link == self.child:
            line = line.seen(poses.inverse(self.T))
        if self.kind == "spherical":
            return meeting(turns) if link == self.parent else _moved(meeting(turns), poses.inverse(self.T)), None
        return line.point, flip * line.direction

    def turned(self) -> Joint:
        """Return the joint with parent and child exchanged; the signs of its coordinates do not change."""
        tied = tuple((b, a) for a, b in self.tied)
        if self.T is None:
            return replace(self, parent=self.child, child=self.parent, tied=tied)
        back = poses.inverse(self.T)
        motions = tuple(m.seen(back, -1.0) for m in self.motions[::-1])
        return replace(self, parent=self.child, child=self.parent, T=back, motions=motions, tied=tied)


@dataclass(frozen=True)
class Frame:
    """A named frame: the name of its link, and its pose T_link_frame (4, 4)."""

    link: str
    T: Array


@dataclass
class Physics:
    """Mechanism data of a file.

    Attributes:
        links: names of all links.
        masses: {link: mass properties}.
        shown: {link: whether it has a mesh}, for formats that show a link by meshes alone.
        assumed: links whose mass is unknown: the file states an assumed mass, because the format requires a mass.
        partly: links whose shapes do not show the whole link, as the file states or because they are for display only
            or not all read: their masses are not judged by them.
        frames: {name: named frame}.
        points: {name: named point}, as frames with the axes of the link. A frame may have the name of a point.
        marks: "frame", "point": those of which `frames` or `points` contains all that the robot has.
        gravity: (3,) in m/s2 in a world with z up; None if not stated.
        held: links that a joint fixes directly to the world; None if the format cannot state that a link is fixed.
        tool: name of the frame that protocols move; "" if not stated.
        trocars: names of the trocar joints; the protocol determines their positions.
        couplings: {name: ({joint: factor}, constant)}; the sum of factor times joint coordinate is the constant. None
            if the format cannot state couplings.
        motors: {name: motor with a transmission}; None if not stated.
        reductions: {joint: motor coordinate / joint coordinate} of the transmissions of one joint; None if a file has
            no transmissions.
        all_motors: whether `motors` contains all motors with transmissions.
        floats: {link: share of its weight that is compensated}, 0 without compensation; None if not stated.
        opening: length in m (angle in rad) by which the loops open if gravity pulls at them; None if not stated.
        complete: whether `joints` contains all joints, each with its links; without this, a missing joint is not found.
    """

    links: tuple[str, ...] = ()
    masses: dict[str, Mass] = field(default_factory=dict)
    shown: Mapping[str, bool] = field(default_factory=dict)
    assumed: frozenset[str] = frozenset()
    partly: frozenset[str] = frozenset()
    joints: list[Joint] = field(default_factory=list)
    frames: dict[str, Frame] = field(default_factory=dict)
    points: dict[str, Frame] = field(default_factory=dict)
    marks: frozenset[str] = frozenset()
    gravity: Array | None = None
    held: frozenset[str] | None = None
    tool: str = ""
    trocars: frozenset[str] = frozenset()
    couplings: Mapping[str, tuple[Mapping[str, float], float]] | None = None
    motors: Mapping[str, Motor] | None = None
    all_motors: bool = False
    reductions: Mapping[str, float] | None = None
    floats: Mapping[str, float] | None = None
    opening: float | None = None
    complete: bool = False

    def still(self, known: Collection[str]) -> frozenset[str] | None:
        """Return the links of `known` that cannot move in the world; None if the format cannot state it.

        They are the links of `held`, and all links that fixed joints connect with them. A link named "world" is not
        among them: some formats have it as a link of its own, MJCF has it as the world itself.
        """
        if self.held is None:
            return None
        out = {WORLD, *self.held}
        fixed = [{j.parent, j.child} for j in self.reduced({WORLD, *known}) if j.kind == "fixed"]
        grown = True
        while grown:
            beside = {n for ends in fixed if ends & out for n in ends} - out
            out |= beside
            grown = bool(beside)
        return frozenset(out & set(known)) - {WORLD}

    def reduced(self, known: Collection[str]) -> list[Joint]:
        """Return the joints between links of `known`.

        A link outside `known` with two joints is removed, and its two joints become one joint. A link outside `known`
        with one joint is removed together with the joint. A link outside `known` with three or more joints remains.
        If a file states joints by ties (`Joint.tied`), all ties between the same two links become one joint.
        """
        joints = [j for j in self.joints if not j.tied]
        if WORLD not in known:
            joints = _onto_base(joints)
        pending = [n for n in dict.fromkeys(n for j in joints for n in (j.parent, j.child)) if n and n not in known]
        while pending:
            ready = [n for n in pending if sum(n in (j.parent, j.child) for j in joints) <= 2]
            if not ready:
                break
            pending.remove(ready[0])
            at = [j for j in joints if ready[0] in (j.parent, j.child)]
            joints = [j for j in joints if ready[0] not in (j.parent, j.child)]
            if len(at) == 2 and all(j.T is not None for j in at):
                first, second = at
                first = first if first.child == ready[0] else first.turned()
                second = second if second.parent == ready[0] else second.turned()
                joints.append(_chained(first, second))
        ties: dict[tuple[str, str], list[Joint]] = {}
        for j in (j for j in self.joints if j.tied):
            ties.setdefault((j.parent, j.child), []).append(j)
        for group in ties.values():
            names = tuple(n for j in group for n in j.names)
            joints.append(replace(group[0], names=names, tied=tuple(t for j in group for t in j.tied)))
        return joints

    def added(self, known: Collection[str]) -> list[Joint]:
        """Return the movable joints of links outside `known` that have a mass and no other joint.

        `reduced` leaves them out together with the links, because some formats need such links: they are almost
        without mass.
        """
        whole = sum(m.mass for m in self.masses.values())
        out: list[Joint] = []
        for link, m in self.masses.items():
            if link in known or not m.mass > _HELPER * whole:
                continue
            joints = [j for j in self.joints if link in (j.parent, j.child)]
            if len(joints) == 1 and joints[0].names and joints[0].kind not in ("", "fixed"):
                out.append(joints[0])
        return out


def _onto_base(joints: list[Joint]) -> list[Joint]:
    """Return joints on the link that is fixed to the world instead of on the world; others are unchanged."""
    mounts = [j for j in joints if j.parent == WORLD and j.kind == "fixed" and j.T is not None]
    if not mounts:
        return joints
    mount = mounts[0]
    base = mount.turned()
    others = (j for j in joints if j is not mount)
    return [_chained(base, j) if j.parent == WORLD and j.T is not None else j for j in others]


def _chained(first: Joint, second: Joint) -> Joint:
    assert first.T is not None
    assert second.T is not None
    drives = [j.drive for j in (first, second) if j.motions]
    return Joint(
        first.names + second.names,
        first.parent,
        second.child,
        first.T @ second.T,
        first.motions + tuple(m.seen(first.T) for m in second.motions),
        drives[0] if len(drives) == 1 else Drive(),
    )


def _kind(motions: tuple[Line, ...]) -> str:
    turns, slides = ([m for m in motions if m.kind == k] for k in ("turn", "slide"))
    count = (len(turns), len(slides))
    if count in ((0, 0), (1, 0), (0, 1), (3, 3)):
        return {(0, 0): "fixed", (1, 0): "revolute", (0, 1): "prismatic", (3, 3): "free"}[count]
    if count == (1, 1) and np.linalg.norm(np.cross(turns[0].direction, slides[0].direction)) < _SAME:
        return "cylindrical"
    if count == (3, 0) and abs(np.linalg.det([t.direction for t in turns])) > 1e-3:
        point = meeting(turns)
        if all(np.linalg.norm(np.cross(t.direction, point - t.point)) < _SAME for t in turns):
            return "spherical"
    return f"chain of {count[0]} turns and {count[1]} slides"


def meeting(lines: Collection[Line]) -> Array:
    """Return the point (3,) in m with the minimum sum of squared distances from the lines."""
    projectors = [np.eye(3) - np.outer(m.direction, m.direction) for m in lines]
    b = np.sum([P @ m.point for P, m in zip(projectors, lines, strict=True)], axis=0)
    return np.linalg.lstsq(np.sum(projectors, axis=0), b, rcond=None)[0]


def _moved(p: Array, T: Array) -> Array:
    return T[:3, :3] @ p + T[:3, 3]


def unit(v: Array) -> Array:
    """Return the unit vector of v (3,); a zero vector is unchanged."""
    size = float(np.linalg.norm(v))
    return v / size if size > 0 else v


def along(kind: str, T: Array, axis: int = 2) -> tuple[Line, ...]:
    """Return the lines along or about which a joint moves, in the parent's frame; () if `kind` has no lines.

    T (4, 4) is the pose T_parent_joint of the joint's frame; `axis` 0, 1 or 2 is the x, y or z axis of this frame.
    """
    point, directions = T[:3, 3], T[:3, :3].T
    own = directions[axis]
    return {
        "revolute": (Line("turn", point, own),),
        "prismatic": (Line("slide", point, own),),
        "cylindrical": (Line("slide", point, own), Line("turn", point, own)),
        "spherical": tuple(Line("turn", point, d) for d in directions),
        "free": tuple(Line(k, point, d) for k in ("slide", "turn") for d in directions),
    }.get(kind, ())
