"""What a file says of a mechanism, in words that every format can be translated into: links, joints, frames, gravity.

A joint is the pose of its child in its parent with all coordinates zero, and lines in the parent along or about which
it moves. Formats split joints differently (a ball as three turns over small links, a loop as two ties): `reduced`
leaves only the links that others know, so that joints can be compared whatever they were split into.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.poses import Array

_SAME = 1e-5
"""Distance in m, and part of a unit vector, below which two lines are one and three lines meet."""


@dataclass(frozen=True)
class Mass:
    """Mass in kg, its centre (3,) in m and the inertia (3, 3) in kg m2 about it, in the frame of the link."""

    mass: float
    center: Array | None = None
    inertia: Array | None = None


@dataclass(frozen=True)
class Line:
    """A motion: "turn" about or "slide" along a direction (3,) through a point (3,) in m, in the parent's frame."""

    kind: str
    point: Array
    direction: Array

    def seen(self, T: Array, sign: float = 1.0) -> Line:
        """Return the line in the frame that T (4, 4) leads to."""
        return Line(self.kind, T[:3, :3] @ self.point + T[:3, 3], sign * T[:3, :3] @ self.direction)


@dataclass(frozen=True)
class Drive:
    """What drives a joint; None is what the file does not say. SI per m or per rad.

    Attributes:
        limits: in m or rad; infinite where there is none.
        driven: whether an actuator moves it.
        stiffness, damping: of a position drive.
        effort: the largest, N or N m.
        speed: the largest, m/s or rad/s.
    """

    limits: tuple[float, float] | None = None
    driven: bool | None = None
    stiffness: float | None = None
    damping: float | None = None
    effort: float | None = None
    speed: float | None = None


@dataclass(frozen=True)
class Motor:
    """A motor that a transmission leads to joints; None is what the file does not say. SI of its side.

    Attributes:
        row: its coordinate is the sum of these factors times the coordinates of these joints.
        kind: "angle" or "length".
        limits: in m or rad; infinite where there is none.
        effort, speed: the largest; infinite where there is no bound.
        inertia: of its rotor in kg m2 or kg; 0 where there is none.
        stiffness, damping: of its position drive; 0 where there is none.
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
    """Return stiffness and damping that the drives of motors have at a joint, the others held; None if none moves it.

    Each motor that turns by its factor for every rad or m of the joint works back with the same factor.
    """
    moving = [(m, m.row[joint]) for m in motors.values() if m.row and joint in m.row]
    if not moving:
        return None
    return sum(c * c * (m.stiffness or 0.0) for m, c in moving), sum(c * c * (m.damping or 0.0) for m, c in moving)


@dataclass(frozen=True)
class Joint:
    """A joint between two links.

    Attributes:
        names: of the parts that it is made of in the file; one, mostly.
        parent, child: links.
        T: pose (4, 4) of the child in the parent at zero.
        motions: lines in the parent's frame, from the parent outwards.
        drive: see `Drive`.
        tied: points (3,) of the parent and of the child that coincide, if that is all the file says (MJCF connect).
        kind_said: where a format names the kind without saying how it lies (tracks, GLB), else "".
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
        """Fixed, revolute, prismatic, cylindrical, spherical, free, or what else its motions are; "" if unsaid."""
        if self.kind_said:
            return self.kind_said
        if self.tied:
            return {1: "spherical", 2: "revolute"}.get(len(self.tied), "fixed")
        return "" if self.T is None else _kind(self.motions)

    def end(self, link: str) -> tuple[Array, Array | None] | None:
        """Return a point (3,) and the direction (3,), None for a ball, of the joint in the frame of one of its links.

        The direction is that of the joint seen from the link whose name comes first; ties know it up to sign.
        """
        flip = 1.0 if self.parent < self.child else -1.0
        if self.tied:
            points = [pair[0 if link == self.parent else 1] for pair in self.tied]
            return points[0], None if len(points) < 2 else flip * _unit(points[1] - points[0])
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
        """Return the same joint with parent and child exchanged; its coordinates keep their signs."""
        tied = tuple((b, a) for a, b in self.tied)
        if self.T is None:
            return replace(self, parent=self.child, child=self.parent, tied=tied)
        back = poses.inverse(self.T)
        motions = tuple(m.seen(back, -1.0) for m in self.motions[::-1])
        return replace(self, parent=self.child, child=self.parent, T=back, motions=motions, tied=tied)


@dataclass(frozen=True)
class Frame:
    """A named frame: its link and its pose (4, 4) there."""

    link: str
    T: Array


@dataclass
class Physics:
    """What a file says of a mechanism.

    Attributes:
        links: all that it names.
        masses: by link.
        joints: in the order of the file.
        frames: named ones.
        gravity: (3,) in m/s2 in a world with z up, None if the file does not say.
        held: links that are fixed to the world, None if the format has no word for it.
        tool: name of the frame that is moved, "" if unsaid.
        trocars: names of joints that hold to a place which protocols choose.
        couplings: ratios by joint and their sum, by name; None if the format has no word for them.
        motors: that transmissions lead to joints, by name; None if the format or the file has no word for them.
        all_motors: whether one that is not listed does not exist.
        complete: whether a joint that is not listed does not exist.
    """

    links: tuple[str, ...] = ()
    masses: dict[str, Mass] = field(default_factory=dict)
    joints: list[Joint] = field(default_factory=list)
    frames: dict[str, Frame] = field(default_factory=dict)
    gravity: Array | None = None
    held: frozenset[str] | None = None
    tool: str = ""
    trocars: frozenset[str] = frozenset()
    couplings: Mapping[str, tuple[Mapping[str, float], float]] | None = None
    motors: Mapping[str, Motor] | None = None
    all_motors: bool = False
    complete: bool = False

    def reduced(self, known: Collection[str]) -> list[Joint]:
        """Return the joints between known links; chains over other links become one joint, ties of a pair as well."""
        joints = [j for j in self.joints if not j.tied]
        pending = [n for n in dict.fromkeys(n for j in joints for n in (j.parent, j.child)) if n and n not in known]
        while pending:
            ready = [n for n in pending if sum(n in (j.parent, j.child) for j in joints) <= 2]
            if not ready:
                break
            pending.remove(ready[0])
            at = [j for j in joints if ready[0] in (j.parent, j.child)]
            joints = [j for j in joints if j not in at]
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
    """Return the point (3,) that is nearest to all lines."""
    projectors = [np.eye(3) - np.outer(m.direction, m.direction) for m in lines]
    b = np.sum([P @ m.point for P, m in zip(projectors, lines, strict=True)], axis=0)
    return np.linalg.lstsq(np.sum(projectors, axis=0), b, rcond=None)[0]


def _moved(p: Array, T: Array) -> Array:
    return T[:3, :3] @ p + T[:3, 3]


def _unit(v: Array) -> Array:
    size = float(np.linalg.norm(v))
    return v / size if size > 0 else v


def along(kind: str, T: Array, axis: int = 2) -> tuple[Line, ...]:
    """Return the motions of a joint of a kind whose frame in its parent is T (4, 4), along or about one of its axes."""
    point, directions = T[:3, 3], T[:3, :3].T
    own = directions[axis]
    return {
        "revolute": (Line("turn", point, own),),
        "prismatic": (Line("slide", point, own),),
        "cylindrical": (Line("slide", point, own), Line("turn", point, own)),
        "spherical": tuple(Line("turn", point, d) for d in directions),
        "free": tuple(Line(k, point, d) for k in ("slide", "turn") for d in directions),
    }.get(kind, ())
