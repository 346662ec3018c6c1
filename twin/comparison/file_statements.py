"""The statements of a URDF, xacro, MJCF or table: its numbers that place joints and links, with their lines.

The file is read here by itself, without the reader that made the side.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.parsers import expat

from twin.comparison.dh_statements import CellStatement, table_cells
from twin.comparison.side import RobotSide, plain_name
from twin.comparison.statements import NumberStatement, Role
from twin.core.foreign.budget import MJCF_SUFFIXES
from twin.core.spatial import Array
from twin.core.units import DEG

_MAX_INCLUDE_DEPTH = 8
"""Depth of included files up to which they are read."""

_UNREAD_ROTATIONS = frozenset({"axisangle", "xyaxes", "zaxis"})
"""Attributes with rotations that are not read here: a position beside them is along unknown axes."""


@dataclass
class _Element:
    """An element of an XML file with the lines of its attributes."""

    tag: str
    attributes: dict[str, str]
    lines: dict[str, int]
    file: str
    children: list[_Element] = field(default_factory=list)

    def find(self, tag: str) -> _Element | None:
        """Return the first child with a tag; None if there is none."""
        for child in self.children:
            if child.tag == tag:
                return child
        return None

    def find_all(self, tag: str) -> list[_Element]:
        """Return the children with a tag."""
        with_tag = []
        for child in self.children:
            if child.tag == tag:
                with_tag.append(child)
        return with_tag


def statements(side: RobotSide) -> Sequence[NumberStatement | CellStatement]:
    """Return the statements of a URDF, xacro, MJCF or table; [] for other files, and for files that cannot be read."""
    path = side.path
    if path is None:
        return []
    if side.dh_rows:
        return table_cells(side)
    if side.text is not None:
        expanded = _root_of_file(path, side.text)
        if expanded is None:
            return []
        return _urdf_statements(expanded, side.xacro_places)
    if path.suffix.lower() not in (".urdf", *MJCF_SUFFIXES):
        return []
    root = _root_of_file(path)
    if root is None:
        return []
    if root.tag == "robot":
        return _urdf_statements(root, {})
    if root.tag == "mujoco":
        return _mjcf_statements(root, path)
    return []


def _root_of_file(path: Path, data: bytes | None = None) -> _Element | None:
    """Return the root element of an XML file, or of `data`, with the lines of all attributes; None if it is no XML."""
    if data is None:
        try:
            data = path.read_bytes()
        except OSError:
            return None
    return _root_of_text(data, path)


def _root_of_text(data: bytes, path: Path) -> _Element | None:
    """Return the root element of a text, which stands in the file `path`; None if it is no XML."""
    top = _Element("", {}, {}, str(path))
    stack = [top]
    parser = expat.ParserCreate()
    parser.buffer_text = True

    def start(tag: str, attributes: dict[str, str]) -> None:
        begin = parser.CurrentByteIndex
        end = data.find(b">", begin)
        if end < 0:
            end = len(data)
        text = data[begin:end]
        lines = {}
        for name in attributes:
            # expat tells the line of an element, not those of its attributes
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


def _parsed_numbers(text: str | None, count: int) -> tuple[float, ...] | None:
    """Return `count` numbers of a text; None if it does not have them."""
    if text is None:
        return None
    try:
        values = tuple(map(float, text.replace(",", " ").split()))
    except ValueError:
        return None
    if len(values) != count:
        return None
    return values


@dataclass(frozen=True)
class _MovedNames:
    """What a number moves: the link that it places or on which its axis is, and the joints and links behind it."""

    link: str
    joints: frozenset[str]
    links: frozenset[str]

    def alone(self, joint: str) -> _MovedNames:
        """Return what the axis of a joint moves: only this joint."""
        return _MovedNames(self.link, frozenset({plain_name(joint)}), frozenset())


@dataclass(frozen=True)
class _JointLinks:
    """The names of the links that a joint of a URDF connects."""

    parent: str
    child: str


def _urdf_statements(root: _Element, places: Mapping[str, tuple[str, int]]) -> list[NumberStatement]:
    """Return the statements of a URDF; `xacro_places` are the places of its elements in the files of a xacro."""
    joints = root.find_all("joint")
    ends: dict[str, _JointLinks] = {}
    below: dict[str, list[str]] = {}  # {link: joints of which it is the parent}
    for joint in joints:
        parent = joint.find("parent")
        child = joint.find("child")
        if parent is None or child is None:
            continue
        name = joint.attributes.get("name", "")
        links = _JointLinks(parent.attributes.get("link", ""), child.attributes.get("link", ""))
        ends[name] = links
        below.setdefault(links.parent, []).append(name)
    statements: list[NumberStatement] = []
    for joint in joints:
        name = joint.attributes.get("name", "")
        if name not in ends:
            continue
        moved = _names_moved_by(name, ends, below)
        origin = joint.find("origin")
        if origin is not None:
            _set_place(origin, places.get(f"joint/{name}/origin"))
            placed = _attribute_statements(origin, f"joint '{name}' origin", "xyz", "shift", moved)
            placed += _attribute_statements(origin, f"joint '{name}' origin", "rpy", "turn", moved, "rpy")
            statements += _with_rotation(placed)
        axis = joint.find("axis")
        if axis is not None:
            _set_place(axis, places.get(f"joint/{name}/axis"))
            statements += _attribute_statements(axis, f"joint '{name}' axis", "xyz", "axis", moved.alone(name))
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


def _set_place(element: _Element, place: tuple[str, int] | None) -> None:
    """State another file and line as the place of an element."""
    if place is not None:
        element.file = place[0]
        element.lines = dict.fromkeys(element.lines, place[1])


def _names_moved_by(joint: str, ends: Mapping[str, _JointLinks], below: Mapping[str, Sequence[str]]) -> _MovedNames:
    """Return what the origin of a joint moves: its child, and all joints and links behind it."""
    joints = set()
    links = set()
    pending = [joint]
    while pending:
        name = pending.pop()
        if plain_name(name) in joints:
            continue
        joints.add(plain_name(name))
        child = ends[name].child
        links.add(plain_name(child))
        pending += below.get(child, [])
    return _MovedNames(plain_name(ends[joint].child), frozenset(joints), frozenset(links))


def _attribute_statements(
    element: _Element,
    what: str,
    attribute: str,
    role: Role,
    moved: _MovedNames,
    kind: str = "",
    unit: float = 1.0,
) -> list[NumberStatement]:
    """Return the statement of one attribute as a list, or [] if the element does not have it.

    Arguments as the attributes of `statements.NumberStatement`.
    """
    count = 4 if kind == "quat" else 3
    values = _parsed_numbers(element.attributes.get(attribute), count)
    if values is None:
        return []
    return [
        NumberStatement(
            file=element.file,
            line=element.lines[attribute],
            what=f"{what} {attribute}",
            role=role,
            values=values,
            kind=kind,
            unit=unit,
            link=moved.link,
            joints=moved.joints,
            links=moved.links,
        )
    ]


def _mjcf_statements(root: _Element, path: Path) -> list[NumberStatement]:
    """Return the statements of an MJCF, which is in the file `path`."""
    _expand_includes(root, path, _MAX_INCLUDE_DEPTH)
    unit = DEG
    sequence = "xyz"
    for compiler in root.find_all("compiler"):
        if compiler.attributes.get("angle") == "radian":
            unit = 1.0
        sequence = compiler.attributes.get("eulerseq", sequence)
    statements: list[NumberStatement] = []
    for world in root.find_all("worldbody"):
        for body in world.find_all("body"):
            _add_body_statements(body, f"euler:{sequence}", unit, statements)
    return statements


def _expand_includes(element: _Element, path: Path, depth: int) -> None:
    """Replace each <include> by the children of the root of its file."""
    children: list[_Element] = []
    for child in element.children:
        if child.tag == "include" and depth > 0:
            included = _root_of_file(path.parent / child.attributes.get("file", ""))
            if included is not None:
                _expand_includes(included, path, depth - 1)
                children += included.children
            continue
        _expand_includes(child, path, depth)
        children.append(child)
    element.children = children


def _add_body_statements(
    body: _Element, euler: str, unit: float, statements: list[NumberStatement]
) -> tuple[set[str], set[str]]:
    """Add the statements of a body and its children; return (joints, bodies) of all of them, as plain names.

    `euler` is the kind of a turn by Euler angles, as in `statements.NumberStatement`, and `unit` their unit in rad.
    """
    name = body.attributes.get("name", "")
    joints: set[str] = set()
    bodies = {plain_name(name)}
    own_joints = body.find_all("joint")
    for joint in own_joints:
        joints.add(plain_name(joint.attributes.get("name", "")))
    for child in body.find_all("body"):
        joints_below, bodies_below = _add_body_statements(child, euler, unit, statements)
        joints |= joints_below
        bodies |= bodies_below
    if not name:
        return joints, bodies
    moved = _MovedNames(plain_name(name), frozenset(joints), frozenset(bodies))
    placed: list[NumberStatement] = []
    if _UNREAD_ROTATIONS.isdisjoint(body.attributes):
        placed += _attribute_statements(body, f"body '{name}'", "pos", "shift", moved)
    placed += _attribute_statements(body, f"body '{name}'", "quat", "turn", moved, "quat")
    placed += _attribute_statements(body, f"body '{name}'", "euler", "turn", moved, euler, unit)
    statements += _with_rotation(placed)
    for joint in own_joints:
        label = joint.attributes.get("name", "")
        statements += _attribute_statements(joint, f"joint '{label}'", "axis", "axis", moved.alone(label))
    return joints, bodies
