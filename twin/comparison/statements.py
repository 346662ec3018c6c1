"""The numbers of a URDF, MJCF or table that place joints, with file and line, and what another value would move.

The file is read here by itself, without the reader that made the side.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal
from xml.parsers import expat

import numpy as np

from twin.comparison.dh_edits import CellStatement, cells
from twin.comparison.side import Axis, RobotSide, plain
from twin.core import spatial
from twin.core.foreign.budget import MJCF_SUFFIXES
from twin.core.spatial import Array
from twin.core.units import DEG

Role = Literal["shift", "turn", "axis"]

_INCLUDES = 8
"""Depth of included files up to which they are read."""


@dataclass
class _Element:
    """An element of an XML file with the lines of its attributes."""

    tag: str
    attributes: dict[str, str]
    lines: dict[str, int]
    file: str
    children: list[_Element] = field(default_factory=list)

    def find(self, tag: str) -> _Element | None:
        for child in self.children:
            if child.tag == tag:
                return child
        return None


@dataclass(frozen=True)
class NumberStatement:
    """One attribute with numbers that place a joint or a link.

    Attributes:
        file, line: where it stands.
        what: element and attribute, such as "joint 'a' origin xyz".
        role: "shift" and "turn" place a link in its parent, "axis" is the direction of a joint.
        values: its numbers.
        kind: how a "turn" is written: "rpy", "euler:<sequence>", "quat"; else "".
        unit: size of an angle in rad.
        link: name of the link or body that it places, or on which the axis is.
        joints, links: names of all joints and links that it moves.
        R_parent_link: (3, 3), for a "shift": the rotation of the same element; its numbers are along the parent's axes.
    """

    file: str
    line: int
    what: str
    role: Role
    values: tuple[float, ...]
    kind: str
    unit: float
    link: str
    joints: frozenset[str]
    links: frozenset[str]
    R_parent_link: Array | None = None

    def applied(self, side: RobotSide, values: Sequence[float] | Array) -> RobotSide | None:
        """Return the side with other numbers here; None without this link in the side, or for an axis of length 0."""
        T_base_link = _frame(side, self.link)
        if T_base_link is None:
            return None
        if self.role == "axis":
            return self._turned(side, T_base_link, values)
        step = self._step(values)
        if step is None:
            return None
        W = T_base_link @ step @ spatial.inverse(T_base_link)
        axes = []
        for axis in side.axes:
            names = set(axis.parts or (plain(axis.name),))
            if names <= self.joints:
                axis = _moved_axis(axis, W)
            elif not names.isdisjoint(self.joints):
                return None  # it parts hinges that stand for a ball
            axes.append(axis)
        frames = {}
        for name, (group, T) in side.frames.items():
            frames[name] = (group, W @ T if plain(name) in self.links else T)
        return replace(side, axes=tuple(axes), frames=frames)

    def moves(self, axis: Axis) -> bool:
        """Return whether other numbers move the line of a joint of the side."""
        return not self.joints.isdisjoint(axis.parts or (plain(axis.name),))

    def _turned(self, side: RobotSide, T_base_link: Array, values: Sequence[float] | Array) -> RobotSide | None:
        length = float(np.linalg.norm(values))
        if not length > 1e-9:
            return None
        direction = T_base_link[:3, :3] @ (np.asarray(values, float) / length)
        axes = []
        for axis in side.axes:
            if plain(axis.name) in self.joints:
                axis = replace(axis, direction=direction)
            axes.append(axis)
        return replace(side, axes=tuple(axes))

    def _step(self, values: Sequence[float] | Array) -> Array | None:
        """Return the motion (4, 4) of the link in its own frame if the numbers change to `values`."""
        if self.role == "turn":
            old = self.rotation(self.values)
            new = self.rotation(values)
            if old is None or new is None:
                return None
            return spatial.pose(old.T @ new)
        shift = np.asarray(values, float) - np.asarray(self.values, float)
        if self.R_parent_link is not None:
            shift = self.R_parent_link.T @ shift
        return spatial.pose(p=shift)

    def own_rotation(self) -> Array | None:
        """Return the rotation (3, 3) that a "turn" states; None if its numbers are no rotation."""
        return self.rotation(self.values)

    def rotation(self, values: Sequence[float] | Array) -> Array | None:
        """Return the rotation (3, 3) that a "turn" would state with other numbers; None if they are no rotation."""
        if self.kind == "quat":
            if not np.linalg.norm(values) > 1e-9:
                return None
            return spatial.matrix_from_quat_wxyz(values)
        angles = np.asarray(values, float) * self.unit
        if self.kind == "rpy":
            return _product(angles[::-1], "zyx")
        return _product(angles, self.kind.removeprefix("euler:"))


@dataclass(frozen=True)
class PlaceStatement:
    """Position and rotation of one element, together.

    Attributes:
        shift, turn: the two.
        role: "place".
    """

    shift: NumberStatement
    turn: NumberStatement
    role: Literal["place"] = "place"

    @property
    def file(self) -> str:
        """Where it stands."""
        return self.shift.file

    @property
    def line(self) -> int:
        """The first of the lines."""
        return min(self.shift.line, self.turn.line)

    @property
    def what(self) -> str:
        """The element, such as "joint 'a' origin"."""
        return self.shift.what.rsplit(" ", 1)[0]

    @property
    def values(self) -> tuple[float, ...]:
        """Its numbers, those of the position first."""
        return (*self.shift.values, *self.turn.values)

    def moves(self, axis: Axis) -> bool:
        """Return whether another place moves the line of a joint of the side."""
        return self.shift.moves(axis)

    def applied(self, side: RobotSide, values: Sequence[float] | Array) -> RobotSide | None:
        """Return the side with another place here; None without this link in the side, or if it is no place."""
        turned = self.turn.applied(side, values[3:])
        R_parent_link = self.turn.rotation(values[3:])
        if turned is None or R_parent_link is None:
            return None
        return replace(self.shift, R_parent_link=R_parent_link).applied(turned, values[:3])


def places(known: Sequence[NumberStatement | CellStatement]) -> list[PlaceStatement]:
    """Return the elements that state position and rotation."""
    place_statements = []
    for shift, turn in itertools.pairwise(known):
        if isinstance(shift, NumberStatement) and isinstance(turn, NumberStatement):
            same = shift.what.rsplit(" ", 1)[0] == turn.what.rsplit(" ", 1)[0]
            if same and (shift.role, turn.role) == ("shift", "turn"):
                place_statements.append(PlaceStatement(shift, turn))
    return place_statements


def _product(angles: Array, sequence: str) -> Array:
    """Return the product (3, 3) of rotations about axes: lower case about moving axes, upper case about fixed axes."""
    axes = np.eye(3)[["xyz".index(letter) for letter in sequence.lower()]]
    steps = spatial.exp_so3(np.asarray(angles, float)[:, None] * axes)
    R = np.eye(3)
    for step, letter in zip(steps, sequence, strict=True):
        R = R @ step if letter.islower() else step @ R
    return R


def _moved_axis(axis: Axis, W: Array) -> Axis:
    point = W[:3, :3] @ axis.point + W[:3, 3]
    return replace(axis, point=point, direction=W[:3, :3] @ axis.direction)


def _frame(side: RobotSide, link: str) -> Array | None:
    for name, (_, T) in side.frames.items():
        if plain(name) == link:
            return T
    return None


def statements(side: RobotSide) -> Sequence[NumberStatement | CellStatement]:
    """Return the statements of a URDF, xacro, MJCF or table; [] for other files, and for files that cannot be read."""
    path = side.path
    if path is None:
        return []
    if side.rows:
        return cells(side)
    if side.text is not None:
        expanded = _parsed(path, side.text)
        if expanded is None:
            return []
        return _urdf(expanded, side.places)
    if path.suffix.lower() not in (".urdf", *MJCF_SUFFIXES):
        return []
    root = _parsed(path)
    if root is None:
        return []
    if root.tag == "robot":
        return _urdf(root, {})
    if root.tag == "mujoco":
        return _mjcf(root, path)
    return []


def _parsed(path: Path, data: bytes | None = None) -> _Element | None:
    """Return the root element of an XML file, or of `data`, with the lines of all attributes; None if it is no XML."""
    if data is None:
        try:
            data = path.read_bytes()
        except OSError:
            return None
    return _elements(data, path)


def _elements(data: bytes, path: Path) -> _Element | None:
    top = _Element("", {}, {}, str(path))
    stack = [top]
    parser = expat.ParserCreate()
    parser.buffer_text = True

    def start(tag: str, attributes: dict[str, str]) -> None:
        begin = parser.CurrentByteIndex
        end = data.find(b">", begin)
        text = data[begin : end if end > 0 else len(data)]
        lines = {}
        for name in attributes:
            match = re.search(rb"\s" + re.escape(name.encode()) + rb"\s*=", text)
            before = text[: match.end()] if match else b""
            lines[name] = parser.CurrentLineNumber + before.count(b"\n")
        element = _Element(tag, attributes, lines, str(path))
        stack[-1].children.append(element)
        stack.append(element)

    def stop(tag: str) -> None:
        stack.pop()

    parser.StartElementHandler = start
    parser.EndElementHandler = stop
    try:
        parser.Parse(data, True)
    except expat.ExpatError:
        return None
    return top.children[0]


def _numbers(text: str | None, count: int) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        values = tuple(float(word) for word in text.replace(",", " ").split())
    except ValueError:
        return None
    if len(values) != count:
        return None
    return values


# -- URDF ---------------------------------------------------------------------------------------------


def _urdf(root: _Element, places: Mapping[str, tuple[str, int]]) -> list[NumberStatement]:
    """Return the statements of a URDF; `places` are the places of its elements in the files of a xacro."""
    joints = [element for element in root.children if element.tag == "joint"]
    ends: dict[str, tuple[str, str]] = {}
    below: dict[str, list[str]] = {}
    for joint in joints:
        parent = joint.find("parent")
        child = joint.find("child")
        if parent is None or child is None:
            continue
        name = joint.attributes.get("name", "")
        ends[name] = (parent.attributes.get("link", ""), child.attributes.get("link", ""))
        below.setdefault(ends[name][0], []).append(name)
    statements = []
    for joint in joints:
        name = joint.attributes.get("name", "")
        if name not in ends:
            continue
        moved_joints, moved_links = _below(name, ends, below)
        names_of_joint = (plain(ends[name][1]), moved_joints, moved_links)
        origin = joint.find("origin")
        if origin is not None:
            _move(origin, places.get(f"joint/{name}/origin"))
            placed = _attribute(origin, f"joint '{name}' origin", "xyz", "shift", "", 1.0, names_of_joint)
            placed += _attribute(origin, f"joint '{name}' origin", "rpy", "turn", "rpy", 1.0, names_of_joint)
            statements += _with_rotation(placed)
        axis = joint.find("axis")
        if axis is not None:
            _move(axis, places.get(f"joint/{name}/axis"))
            alone = (names_of_joint[0], frozenset({plain(name)}), frozenset[str]())
            statements += _attribute(axis, f"joint '{name}' axis", "xyz", "axis", "", 1.0, alone)
    return statements


def _with_rotation(placed: Sequence[NumberStatement]) -> list[NumberStatement]:
    """Return the statements of one element, with its rotation in the one that states its position."""
    rotation: Array | None = None
    for statement in placed:
        if statement.role == "turn":
            rotation = statement.own_rotation()
    statements = []
    for statement in placed:
        if statement.role == "shift":
            statement = replace(statement, R_parent_link=rotation)
        statements.append(statement)
    return statements


def _move(element: _Element, place: tuple[str, int] | None) -> None:
    """State another file and line as the place of an element."""
    if place is not None:
        element.file = place[0]
        element.lines = dict.fromkeys(element.lines, place[1])


def _below(
    joint: str, ends: Mapping[str, tuple[str, str]], below: Mapping[str, Sequence[str]]
) -> tuple[frozenset[str], frozenset[str]]:
    """Return the plain names of a joint and all joints below it, and of the links below it."""
    joints = set()
    links = set()
    pending = [joint]
    while pending:
        name = pending.pop()
        if plain(name) in joints:
            continue
        joints.add(plain(name))
        child = ends[name][1]
        links.add(plain(child))
        pending += below.get(child, [])
    return frozenset(joints), frozenset(links)


def _attribute(
    element: _Element,
    what: str,
    attribute: str,
    role: Role,
    kind: str,
    unit: float,
    moved: tuple[str, frozenset[str], frozenset[str]],
) -> list[NumberStatement]:
    """Return the statement of one attribute as a list, or [] if the element does not have it."""
    count = 4 if kind == "quat" else 3
    values = _numbers(element.attributes.get(attribute), count)
    if values is None:
        return []
    line = element.lines[attribute]
    link, joints, links = moved
    return [NumberStatement(element.file, line, f"{what} {attribute}", role, values, kind, unit, link, joints, links)]


# -- MJCF ---------------------------------------------------------------------------------------------


def _mjcf(root: _Element, path: Path) -> list[NumberStatement]:
    _include(root, path, _INCLUDES)
    unit = DEG
    sequence = "xyz"
    for compiler in root.children:
        if compiler.tag == "compiler":
            if compiler.attributes.get("angle") == "radian":
                unit = 1.0
            sequence = compiler.attributes.get("eulerseq", sequence)
    statements: list[NumberStatement] = []
    for world in root.children:
        if world.tag == "worldbody":
            for body in world.children:
                if body.tag == "body":
                    _body(body, f"euler:{sequence}", unit, statements)
    return statements


def _include(element: _Element, path: Path, depth: int) -> None:
    """Replace each <include> by the children of the root of its file."""
    children: list[_Element] = []
    for child in element.children:
        if child.tag == "include" and depth > 0:
            included = _parsed(path.parent / child.attributes.get("file", ""))
            if included is not None:
                _include(included, path, depth - 1)
                children += included.children
            continue
        _include(child, path, depth)
        children.append(child)
    element.children = children


def _body(body: _Element, euler: str, unit: float, found: list[NumberStatement]) -> tuple[set[str], set[str]]:
    """Add the statements of a body and its children; return (joints, bodies) of all of them, as plain names."""
    name = body.attributes.get("name", "")
    joints: set[str] = set()
    bodies = {plain(name)}
    own_joints = [child for child in body.children if child.tag == "joint"]
    for child in body.children:
        if child.tag == "joint":
            joints.add(plain(child.attributes.get("name", "")))
        if child.tag == "body":
            joints_below, bodies_below = _body(child, euler, unit, found)
            joints |= joints_below
            bodies |= bodies_below
    if not name:
        return joints, bodies
    moved = (plain(name), frozenset(joints), frozenset(bodies))
    placed = []
    if not set(body.attributes) & {"axisangle", "xyaxes", "zaxis"}:  # rotations that are not read here
        placed += _attribute(body, f"body '{name}'", "pos", "shift", "", 1.0, moved)
    placed += _attribute(body, f"body '{name}'", "quat", "turn", "quat", 1.0, moved)
    placed += _attribute(body, f"body '{name}'", "euler", "turn", euler, unit, moved)
    found += _with_rotation(placed)
    for joint in own_joints:
        label = joint.attributes.get("name", "")
        alone = (plain(name), frozenset({plain(label)}), frozenset[str]())
        found += _attribute(joint, f"joint '{label}'", "axis", "axis", "", 1.0, alone)
    return joints, bodies
