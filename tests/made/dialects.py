"""Write a drawn robot as others write theirs: the same robot in many spellings of a format.

`drawn_robots` writes each number once and in one way. Here the elements of the mapping table (docs/usd-mapping.md) are
drawn too: xacro with macros, blocks, conditions, includes, arguments and expressions; the angles, Euler sequences,
default classes and frames of MJCF; the relative poses, expressed axes, nested and included models of SDF; the transform
operations, nested prims and joint frames of USD; names that are no identifiers, axes of any length, rotated inertial
frames, scaled meshes, links without body. The robot that is meant stays that of the drawing.
"""

from __future__ import annotations

import copy
import random
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import trimesh
from pxr import Gf, Usd, UsdGeom, UsdPhysics
from scipy.spatial.transform import Rotation

from made import drawn_robots
from made.drawn_robots import Link, Robot, frame, text
from twin.core import spatial

NAMES = ("link {}", "Arm-{}", "{}rd.part", "left/L{}", "Glied_ä{}", "UPPER_{}", "x{}", "link{}", "a:b{}", "it's {}")
"""Patterns of names of links; most are no identifiers."""


@dataclass
class Written:
    """A file, the robot that it means, and the arguments of a xacro.

    Attributes:
        path: the file.
        robot: the drawing.
        plain: the URDF that a xacro means; else None.
        arguments: arguments of a xacro, as for --arg.
        planar: {joint: (x in m, y in m, angle in rad)} of the planar joints, which the drawing has as fixed joints.
        tensors: {link: (mass in kg, centre (3,) in m, inertia about it (3, 3) in kg m2)}, in axes of the link.
    """

    path: Path
    robot: Robot
    plain: Path | None = None
    arguments: list[str] = field(default_factory=list)
    planar: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    tensors: dict[str, tuple[float, np.ndarray, np.ndarray]] = field(default_factory=dict)


def draw(seed: int, format: str) -> tuple[Robot, random.Random]:
    """Return a robot with unusual names, and the generator of its spelling; `format` may be "xacro"."""
    base = "urdf" if format == "xacro" else format
    robot = drawn_robots.draw(seed, base)
    rng = random.Random(f"dialect {format} {seed}")
    links = []
    for i, link in enumerate(robot.links):
        if base != "usd":  # a prim's name is an identifier
            link = replace(link, name=rng.choice(NAMES).format(i))
        if base == "urdf" and i and rng.random() < 0.2:
            link = replace(link, mass=0.0, shape="")
        links.append(link)
    return replace(robot, links=tuple(links)), rng


def write(robot: Robot, rng: random.Random, format: str, folder: Path) -> Written:
    """Write a drawn robot in a dialect of a format."""
    folder.mkdir(parents=True, exist_ok=True)
    return {"urdf": _urdf, "xacro": _xacro, "mjcf": _mjcf, "sdf": _sdf, "usd": _usd}[format](robot, rng, folder)


def spelled(rng: random.Random, values: Sequence[float] | np.ndarray) -> str:
    """Return numbers with all their digits, in one of many notations."""
    words = []
    for value in values:
        form = rng.choice([".17g", ".17g", ".17e", "+.17g"])
        words.append(format(float(value), form))
    return rng.choice([" ", "  ", "   "]).join(words)


def turned(rng: random.Random) -> np.ndarray:
    """Return a rotation (3, 3) drawn over all axes and angles."""
    return Rotation.from_rotvec([rng.uniform(-2, 2) for _ in range(3)]).as_matrix()


def rpy(R: np.ndarray) -> np.ndarray:
    """Return the angles (3,) in rad about the fixed axes x, y and z, in this order, of a rotation."""
    return np.array(spatial.euler_angles(R, "zyx")[::-1])


def mesh(link: Link, folder: Path, name: str, R: np.ndarray, scale: np.ndarray) -> None:
    """Write the box of a link as an STL whose axes are those of R in the link, divided by `scale`."""
    box = trimesh.creation.box(link.size)
    box.apply_translation(link.center)
    box.apply_transform(spatial.pose(R.T))
    box.vertices = box.vertices / scale
    box.export(folder / name)


def euler(R: np.ndarray, turns: str) -> np.ndarray | None:
    """Return the angles (3,) in rad of a rotation for a sequence of SciPy; None where they have not all digits."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of gimbal lock
        angles = Rotation.from_matrix(R).as_euler(turns)
    apart = np.abs(Rotation.from_euler(turns, angles).as_matrix() - R).max()
    return angles if apart < 1e-14 else None


# --- URDF ------------------------------------------------------------------------------------------


def _urdf(robot: Robot, rng: random.Random, folder: Path) -> Written:
    root, written = _urdf_tree(robot, rng, folder)
    head = rng.choice(["", '<?xml version="1.0"?>\n', '<?xml version="1.0" encoding="utf-8"?>\n<!-- drawn -->\n'])
    written.path.write_text(head + ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
    return written


def _origin(parent: Element, rng: random.Random, T: np.ndarray) -> None:
    """Add an <origin>, without what is zero in some cases."""
    zero = not np.any(T[:3, 3])
    straight = np.array_equal(T[:3, :3], np.eye(3))
    if zero and straight and rng.random() < 0.5:
        return
    origin = SubElement(parent, "origin")
    if not zero or rng.random() < 0.5:
        origin.set("xyz", spelled(rng, T[:3, 3]))
    if not straight or rng.random() < 0.5:
        angles = rpy(T[:3, :3])
        if rng.random() < 0.3:  # the second triple of angles of the same rotation
            angles = np.array([angles[0] + np.pi, np.pi - angles[1], angles[2] - np.pi])
        origin.set("rpy", spelled(rng, angles))


def _urdf_tree(robot: Robot, rng: random.Random, folder: Path) -> tuple[Element, Written]:
    root = Element("robot", name=rng.choice(["drawn", "Drawn Robot 2", "dräwn"]))
    written = Written(folder / "drawn.urdf", robot)
    elements = []
    for link in robot.links:
        elements.append(_urdf_link(link, rng, folder, written))
    if robot.stand != "origin":
        elements.append(Element("link", name="world"))
        stand = Element("joint", name="stand", type="fixed" if robot.stand == "mount" else "floating")
        SubElement(stand, "parent", link="world")
        SubElement(stand, "child", link=robot.links[0].name)
        _origin(stand, rng, robot.T_world_root)
        elements.append(stand)
    moved = []
    for link in robot.links:
        if link.parent < 0:
            moved.append(link)
            continue
        joint = _urdf_joint(robot, link, rng)
        if joint.get("type") == "planar":
            x, y, angle = (rng.uniform(-0.3, 0.3) for _ in range(3))
            written.planar[link.joint] = (x, y, angle)
            motion = spatial.pose(spatial.rotation_z(angle), [x, y, 0.0])
            link = replace(link, T=link.T @ motion)
        moved.append(link)
        elements.append(joint)
    written.robot = replace(robot, links=tuple(moved))
    if rng.random() < 0.6:  # a URDF has no order
        rng.shuffle(elements)
    root.extend(elements)
    return root, written


def _urdf_link(link: Link, rng: random.Random, folder: Path, written: Written) -> Element:
    element = Element("link", name=link.name)
    if link.mass:
        R = turned(rng) if rng.random() < 0.5 else np.eye(3)
        inertial = SubElement(element, "inertial")
        _origin(inertial, rng, spatial.pose(R, link.center))
        SubElement(inertial, "mass", value=f"{link.mass:.17g}")
        tensor = R.T @ np.diag(link.moments) @ R
        numbers = {}
        for key, (i, j) in TENSOR.items():
            numbers[key] = f"{tensor[i, j]:.17g}"
        SubElement(inertial, "inertia", numbers)
        written.tensors[link.name] = (link.mass, link.center, np.diag(link.moments))
    if link.shape:
        R = turned(rng) if rng.random() < 0.5 else np.eye(3)
        for use in ("visual", "collision"):
            shape = SubElement(element, use)
            if link.shape == "box":
                _origin(shape, rng, spatial.pose(p=link.center))
                SubElement(SubElement(shape, "geometry"), "box", size=spelled(rng, link.size))
                continue
            scale = np.array([rng.choice([0.001, 1.0, 2.5]) for _ in range(3)])
            name = f"m{len(list(folder.glob('*.stl')))}.stl"
            mesh(link, folder, name, R, scale)
            _origin(shape, rng, spatial.pose(R))
            SubElement(SubElement(shape, "geometry"), "mesh", filename=name, scale=spelled(rng, scale))
    return element


TENSOR = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
"""Places of the six numbers of an inertia."""


def _urdf_joint(robot: Robot, link: Link, rng: random.Random) -> Element:
    kind = {"hinge": "revolute", "slide": "prismatic", "fixed": "fixed"}[link.kind]
    if link.kind == "hinge" and link.limits is None and rng.random() < 0.8:
        kind = "continuous"
    heavy = bool(link.mass or link.shape)
    if link.kind == "fixed" and heavy and rng.random() < 0.2:
        kind = "planar"
    joint = Element("joint", name=link.joint, type=kind)
    SubElement(joint, "parent", link=robot.links[link.parent].name)
    SubElement(joint, "child", link=link.name)
    _origin(joint, rng, link.T)
    if kind == "planar":
        SubElement(joint, "axis", xyz="0 0 1")
        return joint
    if kind == "fixed":
        return joint
    axis = link.axis
    if not np.array_equal(axis, [1.0, 0.0, 0.0]) or rng.random() < 0.5:  # without <axis>, it is x
        SubElement(joint, "axis", xyz=spelled(rng, axis * rng.choice([1.0, 1.0, 2.0, 0.25, 30.0])))
    limit = {"effort": "1e5", "velocity": "2"}
    if kind != "continuous":
        low, high = link.limits or ((-100.0, 100.0) if link.kind == "hinge" else (-1000.0, 1000.0))
        limit |= {"lower": f"{low:.17g}", "upper": f"{high:.17g}"}
        if low == 0.0 and rng.random() < 0.5:
            del limit["lower"]  # it is zero then
    SubElement(joint, "limit", limit)
    if link.follows is not None:
        leader, multiplier, offset = link.follows
        mimic = SubElement(joint, "mimic", joint=robot.links[leader].joint)
        if multiplier != 1.0 or rng.random() < 0.5:
            mimic.set("multiplier", f"{multiplier:.17g}")
        if offset or rng.random() < 0.5:
            mimic.set("offset", f"{offset:.17g}")
    elements = list(joint)
    rng.shuffle(elements)
    joint[:] = elements
    return joint


# --- xacro -----------------------------------------------------------------------------------------

NUMBERS = {"xyz", "rpy", "value", "size", "lower", "upper", "multiplier", "offset", "scale", *TENSOR}
"""Attributes of a URDF that are numbers."""

XACRO = "http://www.ros.org/wiki/xacro"


def _xacro(robot: Robot, rng: random.Random, folder: Path) -> Written:
    root, written = _urdf_tree(robot, rng, folder)
    written.plain = written.path
    written.plain.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
    writer = _Xacro(rng, folder / "drawn_package/urdf")
    writer.folder.mkdir(parents=True)
    (folder / "drawn_package/package.xml").write_text("<package><name>drawn_package</name></package>")
    for file in folder.glob("*.stl"):
        file.rename(writer.folder / file.name)
    parts = []
    for element in root:
        parts.append(writer.part(element))
    namespace = f'xmlns:xacro="{XACRO}"'
    head = f"<robot name={_quoted(root.get('name', ''))} {namespace}>"
    written.path = writer.folder / rng.choice(["drawn.urdf.xacro", "drawn.xacro"])
    body = "\n".join([head, *writer.definitions, *parts, "</robot>"])
    written.path.write_text(body, encoding="utf-8")
    if writer.constants:
        lines = "".join(writer.constants)
        (writer.folder / "constants.xacro").write_text(f"<robot {namespace}>{lines}</robot>", encoding="utf-8")
    if writer.table:
        (writer.folder / "table.yaml").write_text("\n".join(writer.table) + "\n", encoding="utf-8")
    written.arguments = writer.arguments
    return written


def _quoted(value: str) -> str:
    escaped = value.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    return f'"{escaped}"'


class _Xacro:
    """Spells the elements of a URDF in xacro.

    `definitions` precede the parts; `constants` are lines of an included file with a namespace, `table` those of a
    YAML.
    """

    def __init__(self, rng: random.Random, folder: Path) -> None:
        self.rng = rng
        self.folder = folder
        self.definitions: list[str] = []
        self.constants: list[str] = []
        self.table: list[str] = []
        self.arguments: list[str] = []
        self.count = 0

    def fresh(self, stem: str) -> str:
        """Return a name that was not used."""
        self.count += 1
        return f"{stem}{self.count}"

    def number(self, word: str) -> str:
        """Return an expression whose value is the number, to its last digits."""
        rng = self.rng
        value = float(word)
        way = rng.randrange(14)
        name = self.fresh("p")
        if way == 0:
            self.definitions.append(f'<xacro:property name="{name}" value="{value!r}"/>')
            return f"${{{name}}}"
        if way == 1:
            return f"${{{2 * value!r} / 2}}"
        if way == 2:
            return f"${{-1 * {-value!r}}}"
        if way == 3:
            return f"${{radians({np.degrees(value)!r})}}".replace("np.float64(", "(")
        if way == 4:
            self.definitions.append(f'<xacro:property name="{name}" value="${{[0, {value!r}]}}"/>')
            return f"${{{name}[-1]}}"
        if way == 5:
            self.definitions.append(f'<xacro:property name="{name}" value="${{dict(a={value!r}, b=\'x\')}}"/>')
            return f"${{{name}['a']}}"
        if way == 6:
            stated = value
            if rng.random() < 0.5:
                self.arguments.append(f"{name}:={value!r}")
                stated = 77.0
            self.definitions.append(f'<xacro:arg name="{name}" default="{stated!r}"/>')
            return rng.choice([f"$(arg {name})", f"$(eval {name} + 0)"])
        if way == 7:
            if not self.constants:
                self.definitions.append('<xacro:include filename="constants.xacro" ns="fixed"/>')
            self.constants.append(f'<xacro:property name="{name}" value="{value!r}"/>')
            return f"${{fixed.{name}}}"
        if way == 8:
            if not self.table:
                self.definitions.append('<xacro:property name="table" value="${load_yaml(\'table.yaml\')}"/>')
            self.table.append(f"{name}: {value!r}")
            return f"${{table['{name}']}}"
        if way == 9:
            return f"${{{value!r} if 2 &gt; 1 else 5.0}}"
        if way == 10:  # lazy: the second property is stated before the first one that it needs
            self.definitions.append(f'<xacro:property name="{name}" value="${{{name}_half + {name}_half}}"/>')
            self.definitions.append(f'<xacro:property name="{name}_half" value="{value / 2!r}"/>')
            return f"${{{name}}}"
        if way == 11:
            return f"${{max({value!r}, {value!r}) * cos(0) + pi * 0}}"
        return word

    def attributes(self, element: Element, skip: Sequence[str] = ()) -> str:
        """Return the attributes of an element, numbers as expressions."""
        out = []
        for key, value in element.items():
            if key in skip:
                continue
            numeric = key in NUMBERS and _is_number(value.split()[0])
            if numeric and len(value.split()) > 1 and self.rng.random() < 0.15:
                name = self.fresh("v")
                self.definitions.append(f'<xacro:property name="{name}" value="{value}"/>')
                out.append(f' {key}="${{{name}}}"')
            elif numeric:
                words = [self.number(word) for word in value.split()]
                out.append(f' {key}="{" ".join(words)}"')
            else:
                out.append(f" {key}={_quoted(value)}")
        return "".join(out)

    def plain(self, element: Element, name: str | None = None) -> str:
        """Return an element and its children; `name` replaces the value of its attribute name."""
        skip = () if name is None else ("name",)
        stated = "" if name is None else f' name="{name}"'
        inner = "".join(self.plain(child) for child in element)
        return f"<{element.tag}{stated}{self.attributes(element, skip)}>{inner}</{element.tag}>"

    def part(self, element: Element) -> str:
        """Return a link or joint in one of the ways of xacro."""
        rng = self.rng
        way = rng.randrange(12)
        name = self.fresh("m")
        label = element.get("name", "")
        if way == 0:
            condition = rng.choice(["${1 &lt; 2}", "true", "1", "${not False}", "$(eval 3 == 3)"])
            absent = '<link name="absent" x="${not_defined}"/>'
            return (
                f'<xacro:if value="{condition}">{self.plain(element)}</xacro:if><xacro:if value="0">{absent}</xacro:if>'
            )
        if way == 1:
            return f'<xacro:unless value="${{len([]) > 0}}">{self.plain(element)}</xacro:unless>'.replace(
                "> 0", "&gt; 0"
            )
        if way in (2, 3, 4) and element.find("origin") is not None:
            shorter = copy.copy(element)
            origin = self.plain(_taken(shorter, "origin"))
            inside = self.plain(shorter, "${name}").replace(
                f"</{element.tag}>", f'<xacro:insert_block name="place"/></{element.tag}>'
            )
            inner = self.fresh("n")
            self.definitions.append(
                f'<xacro:macro name="{inner}" params="name *place unused:=\'a b\'">{inside}</xacro:macro>'
            )
            if way == 2:
                return f"<xacro:{inner} name={_quoted(label)}>{origin}</xacro:{inner}>"
            if way == 3:
                return f"<xacro:call macro=\"${{'{inner}'}}\" name={_quoted(label)}>{origin}</xacro:call>"
            outer = f'<xacro:{inner} name="${{label}}"><xacro:insert_block name="where"/></xacro:{inner}>'
            self.definitions.append(f'<xacro:macro name="{name}" params="label **where">{outer}</xacro:macro>')
            return f"<xacro:{name} label={_quoted(label)}><where>{origin}</where></xacro:{name}>"
        if way == 5:
            stem = f"part_{name}.xacro"
            content = f'<robot xmlns:xacro="http://ros.org/wiki/xacro">{self.plain(element)}</robot>'
            (self.folder / stem).write_text(content, encoding="utf-8")
            place = rng.choice([stem, f"$(find drawn_package)/urdf/{stem}", f"./{stem}"])
            return f'<xacro:include filename="{place}"/>'
        if way == 6:
            inner = "".join(self.plain(child) for child in element)
            self.definitions.append(f'<xacro:property name="{name}">{inner}</xacro:property>')
            block = f'<xacro:insert_block name="{name}"/>'
            return f"<{element.tag}{self.attributes(element)}>{block}</{element.tag}>"
        if way == 7:
            self.definitions.append(f'<xacro:property name="{name}" value={_quoted(label)}/>')
            inside = self.plain(element, "${label}")
            macro = self.fresh("n")
            self.definitions.append(f'<xacro:macro name="{macro}" params="label:=${{{name}}}">{inside}</xacro:macro>')
            return f"<xacro:{macro}/>"
        if way == 8:
            stated = "".join(self.plain(child) for child in element)
            attributes = self.attributes(element, ("name",))
            named = f'<xacro:attribute name="name" value={_quoted(label)}/>'
            return f"<{element.tag}{attributes}>{named}{stated}</{element.tag}>"
        if way == 9:
            macro = self.fresh("n")
            again = f'<xacro:if value="${{left &gt; 0}}"><xacro:{macro} left="${{left - 1}}"/></xacro:if>'
            here = f'<xacro:if value="${{left == 0}}">{self.plain(element)}</xacro:if>'
            self.definitions.append(f'<xacro:macro name="{macro}" params="left:=3">{again}{here}</xacro:macro>')
            return f"<xacro:{macro}/>"
        return self.plain(element)


def _taken(element: Element, tag: str) -> Element:
    """Remove the first child of a tag, and return it."""
    child = element.find(tag)
    assert child is not None
    element.remove(child)
    return child


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


# --- MJCF ------------------------------------------------------------------------------------------

SEQUENCES = ("xyz", "XYZ", "zyx", "ZYX", "xyx", "ZXZ", "xYz", "Zyx", "yXz", "YzX")
"""Euler sequences of MuJoCo: small letters turn with the body, capitals stay with the parent."""


def mjcf_euler(R: np.ndarray, sequence: str) -> np.ndarray | None:
    """Return the angles (3,) in rad of a rotation for a sequence of MuJoCo's compiler; None near its singular poses."""
    order: list[int] = []  # numbers of the letters, as factors of the product from left to right
    for i, letter in enumerate(sequence):
        if letter.islower():
            order.append(i)
        else:
            order.insert(0, i)
    turns = "".join(sequence[i].upper() for i in order)
    found = euler(R, turns)
    if found is None:
        return None
    angles = np.zeros(3)
    angles[order] = found
    return angles


class _MjcfStyle:
    """The settings of the compiler that one file has."""

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng
        self.degrees = rng.random() < 0.6
        self.sequence = rng.choice(SEQUENCES)
        self.classes: list[str] = []
        self.assets: list[str] = []

    def angle(self, values: Sequence[float] | np.ndarray) -> np.ndarray:
        return np.degrees(values) if self.degrees else np.asarray(values)

    def place(self, T: np.ndarray) -> str:
        """Return the attributes that state a pose."""
        rng = self.rng
        R = T[:3, :3]
        angles = mjcf_euler(R, self.sequence)
        way = rng.randrange(4)
        if way == 0 or angles is None:
            turn = f'quat="{spelled(rng, spatial.quat_from_matrix_wxyz(R) * rng.choice([1, -1, 3.0]))}"'
        elif way == 1:
            vector = Rotation.from_matrix(R).as_rotvec()
            size = float(np.linalg.norm(vector))
            axis = vector / size if size else np.array([0.0, 0.0, 1.0])
            turn = f'axisangle="{spelled(rng, axis * 2)} {spelled(rng, self.angle([size]))}"'
        elif way == 2:
            turn = f'xyaxes="{spelled(rng, R[:, 0] * 0.5)} {spelled(rng, R[:, 1] * 2 + 0.3 * R[:, 0])}"'
        else:
            turn = f'euler="{spelled(rng, self.angle(angles))}"'
        return f'pos="{spelled(rng, T[:3, 3])}" {turn}'

    def joint(self, link: Link) -> str:
        """Return the joint of a link; some of its attributes are those of a default class."""
        rng = self.rng
        scale = self.angle if link.kind == "hinge" else np.asarray
        attributes = {
            "type": link.kind,
            "pos": spelled(rng, link.pivot),
            "axis": spelled(rng, link.axis * rng.choice([1.0, 2.0, 0.1])),
            "ref": spelled(rng, scale([link.ref])),
        }
        if link.limits is None:
            attributes["limited"] = "false"
        else:
            attributes["range"] = spelled(rng, scale(link.limits))
            attributes["limited"] = "true"
        named = ""
        if rng.random() < 0.5:
            moved = {}
            for key in rng.sample(sorted(attributes), 3):
                moved[key] = attributes.pop(key)
            name = f"c{len(self.classes)}"
            listed = " ".join(f'{k}="{v}"' for k, v in moved.items())
            inner = f'<default class="{name}"><joint {listed}/></default>'
            unused = (
                '<joint axis="0.1 0.2 0.3" range="-0.5 0.25" pos="9 9 9"/>'  # the inner class and the joint override it
            )
            other = f'<default class="{name}_outer">{unused}{inner}</default>'
            self.classes.append(rng.choice([inner, other]))
            named = f'class="{name}"'
        listed = " ".join(f'{k}="{v}"' for k, v in attributes.items())
        return f"<joint name={_quoted(link.joint)} {named} {listed}/>"


def _mjcf(robot: Robot, rng: random.Random, folder: Path) -> Written:
    style = _MjcfStyle(rng)
    robot = _stacked(robot, rng)
    written = Written(folder / "drawn.xml", robot)
    body = _mjcf_body(robot, 0, style, folder, written)
    lines = []
    gravity = "" if robot.gravity is None else f'<option gravity="{text(robot.gravity)}"/>'
    compiler = f'<compiler angle="{"degree" if style.degrees else "radian"}" eulerseq="{style.sequence}"'
    if style.degrees and rng.random() < 0.5:  # the default of MuJoCo
        compiler = f'<compiler eulerseq="{style.sequence}"'
    lines.append(f'<mujoco model="drawn">{compiler} meshdir="meshes"/>{gravity}')
    defaults = f"<default>{''.join(style.classes)}</default>" if style.classes else ""
    if defaults and rng.random() < 0.4:
        (folder / "defaults.xml").write_text(f"<mujoco>{defaults}</mujoco>")
        defaults = '<include file="defaults.xml"/>'
    lines.append(defaults)
    lines.append(f"<asset>{''.join(style.assets)}</asset><worldbody>{body}</worldbody><equality>")
    for link in robot.links:
        if link.follows is not None:
            leader, multiplier, offset = link.follows
            first = robot.links[leader]
            shift = offset + multiplier * first.ref - link.ref
            ends = f"joint1={_quoted(link.joint)} joint2={_quoted(first.joint)}"
            lines.append(f'<joint {ends} polycoef="{shift:.17g} {multiplier:.17g} 0 0 0"/>')
    lines.append("</equality></mujoco>")
    written.path.write_text("\n".join(lines), encoding="utf-8")
    return written


def _stacked(robot: Robot, rng: random.Random) -> Robot:
    """Return the robot, with the frames of some links in those of their parents: MJCF has both joints in one body."""
    links = list(robot.links)
    for i, link in enumerate(links):
        if link.parent < 1 or link.kind == "fixed" or links[link.parent].kind == "fixed":
            continue
        alone = sum(other.parent == link.parent for other in links) == 1
        if alone and rng.random() < 0.4:
            links[i] = replace(link, T=np.eye(4))
    return replace(robot, links=tuple(links))


def _mjcf_body(robot: Robot, i: int, style: _MjcfStyle, folder: Path, written: Written) -> str:
    rng = style.rng
    link = robot.links[i]
    T = robot.T_world_root if i == 0 else link.T
    joints = []
    if i == 0 and robot.stand == "floating":
        joints.append(rng.choice(['<freejoint name="stand"/>', '<joint name="stand" type="free" limited="false"/>']))
    while True:
        if link.kind != "fixed":
            joints.append(style.joint(link))
        below = [n for n, k in enumerate(robot.links) if k.parent == i]
        stacked = i > 0 and len(below) == 1 and np.array_equal(robot.links[below[0]].T, np.eye(4))
        if not stacked or link.kind == "fixed" or robot.links[below[0]].kind == "fixed":
            break
        i = below[0]
        link = robot.links[i]
    frame = spatial.pose(turned(rng), [rng.uniform(-1, 1) for _ in range(3)])
    framed = rng.random() < 0.4 and not (i == 0 and robot.stand == "floating")
    if framed:
        T = spatial.inverse(frame) @ T
    lines = [f"<body name={_quoted(link.name)} {style.place(T)}>", *joints]
    R = turned(rng)
    tensor = R @ np.diag(link.moments) @ R.T
    written.tensors[link.name] = (link.mass, link.center, tensor)
    if rng.random() < 0.5:
        full = [tensor[place] for place in TENSOR.values()]
        lines.append(f'<inertial pos="{text(link.center)}" mass="{link.mass:.17g}" fullinertia="{text(full)}"/>')
    else:
        at = style.place(spatial.pose(R, link.center))
        lines.append(f'<inertial {at} mass="{link.mass:.17g}" diaginertia="{text(link.moments)}"/>')
    if link.shape == "box":
        box = style.place(spatial.pose(p=link.center))
        lines.append(f'<geom type="box" {box} size="{text(np.divide(link.size, 2))}"/>')
    elif link.shape:
        scale = np.array([rng.choice([0.001, 1.0, 2.5]) for _ in range(3)])
        (folder / "meshes").mkdir(exist_ok=True)
        mesh(link, folder / "meshes", f"m{i}.stl", R, scale)
        style.assets.append(f'<mesh name="m{i}" file="m{i}.stl" scale="{text(scale)}"/>')
        lines.append(f'<geom type="mesh" mesh="m{i}" {style.place(spatial.pose(R))}/>')
    for n, other in enumerate(robot.links):
        if other.parent == i:
            lines.append(_mjcf_body(robot, n, style, folder, written))
    out = "".join([*lines, "</body>"])
    return f"<frame {style.place(frame)}>{out}</frame>" if framed else out


# --- SDF -------------------------------------------------------------------------------------------


OLD = ("1.4", "1.5", "1.6")
"""Versions without `relative_to`; they have `use_parent_model_frame`, or (1.4) all axes in the frame of the model."""


class _Sdf:
    """Spells a robot as SDF: the pose of each element is stated relative to another one.

    `poses` are {element: T_model_element (4, 4)} of the model in which the elements are, where all joints are at zero.
    """

    def __init__(self, robot: Robot, rng: random.Random, folder: Path, version: str) -> None:
        self.robot = robot
        self.rng = rng
        self.folder = folder
        self.version = version
        self.old = version in OLD
        self.tensors: dict[str, tuple[float, np.ndarray, np.ndarray]] = {}

    def pose(self, T: np.ndarray, relative_to: str | None = None) -> str:
        """Return a <pose>: angles in rad or degrees, or a quaternion."""
        rng = self.rng
        attributes = "" if relative_to is None else f" relative_to={_quoted(relative_to)}"
        angles = rpy(T[:3, :3])
        way = 0 if self.old else rng.randrange(4)
        if way == 1:
            attributes += rng.choice([' degrees="true"', ' degrees="true" rotation_format="euler_rpy"'])
            angles = np.degrees(angles)
        elif way == 2:
            attributes += ' rotation_format="quat_xyzw"'
            angles = Rotation.from_matrix(T[:3, :3]).as_quat() * rng.choice([1, -1])
        return f"<pose{attributes}>{spelled(rng, T[:3, 3])} {spelled(rng, angles)}</pose>"

    def placed(self, name: str, poses: dict[str, np.ndarray], usual: str | None) -> str:
        """Return the pose of an element relative to the usual element, or to one of those that have a pose.

        None is the model: without `relative_to`, links and frames are relative to it.
        """
        rng = self.rng
        T = poses[name]
        known = [other for other in poses if other != name]
        if self.old or not known or rng.random() < 0.3:
            T_usual = np.eye(4) if usual is None else poses[usual]
            return self.pose(spatial.inverse(T_usual) @ T)
        other = rng.choice([*known, "__model__"])
        T_other = np.eye(4) if other == "__model__" else poses[other]
        return self.pose(spatial.inverse(T_other) @ T, other)

    def link(self, link: Link, name: str, poses: dict[str, np.ndarray]) -> str:
        rng = self.rng
        lines = [f"<link name={_quoted(name)}>{self.placed(name, poses, None)}"]
        if link.mass:
            R = turned(rng)
            self.tensors[link.name] = (link.mass, link.center, R @ np.diag(link.moments) @ R.T)
            xx, yy, zz = link.moments
            tensor = f"<ixx>{xx:.17g}</ixx><iyy>{yy:.17g}</iyy><izz>{zz:.17g}</izz>"
            at = self.pose(spatial.pose(R, link.center))
            lines.append(f"<inertial>{at}<mass>{link.mass:.17g}</mass><inertia>{tensor}</inertia></inertial>")
        if link.shape == "box":
            at = self.pose(spatial.pose(p=link.center))
            shape = f"<geometry><box><size>{text(link.size)}</size></box></geometry>"
            lines.append(f'<visual name="v">{at}{shape}</visual>')
        elif link.shape:
            R = turned(rng)
            scale = np.array([rng.choice([0.001, 1.0, 2.5]) for _ in range(3)])
            file = f"m{self.robot.links.index(link)}.stl"
            mesh(link, self.folder, file, R, scale)
            uri = f"<mesh><uri>{file}</uri><scale>{text(scale)}</scale></mesh>"
            lines.append(f'<visual name="v">{self.pose(spatial.pose(R))}<geometry>{uri}</geometry></visual>')
        return "".join([*lines, "</link>"])

    def joint(self, link: Link, ends: tuple[str, str], poses: dict[str, np.ndarray]) -> str:
        """Return the joint of a link between the elements `ends`, parent and child."""
        rng = self.rng
        parent, child = ends
        T_joint_axis = spatial.pose(turned(rng), link.pivot) if rng.random() < 0.6 else spatial.pose(p=link.pivot)
        poses[link.joint] = poses[child] @ T_joint_axis
        kind = {"hinge": "revolute", "slide": "prismatic", "fixed": "fixed"}[link.kind]
        if link.kind == "hinge" and link.limits is None and not self.old:
            kind = "continuous"
        lines = [f"<joint name={_quoted(link.joint)} type={_quoted(kind)}>", self.placed(link.joint, poses, child)]
        lines.append(f"<parent>{_escaped(parent)}</parent><child>{_escaped(child)}</child>")
        if kind != "fixed":
            lines.append(f"<axis>{self.direction(link, child, poses)}")
            if kind != "continuous":
                low, high = link.limits or (-1e16, 1e16)
                lines.append(f"<limit><lower>{low:.17g}</lower><upper>{high:.17g}</upper></limit>")
            if link.follows is not None:
                leader, multiplier, offset = link.follows
                reference = rng.choice([0.0, 0.2])
                shifted = offset + multiplier * reference
                numbers = f"<multiplier>{multiplier:.17g}</multiplier><offset>{shifted:.17g}</offset>"
                numbers += f"<reference>{reference:.17g}</reference>"
                lines.append(f"<mimic joint={_quoted(self.robot.links[leader].joint)}>{numbers}</mimic>")
            lines.append("</axis>")
        return "".join([*lines, "</joint>"])

    def direction(self, link: Link, child: str, poses: dict[str, np.ndarray]) -> str:
        """Return the <xyz> of an axis, in the axes of the joint, of the model or of another element."""
        rng = self.rng
        size = rng.choice([1.0, 2.0, 0.1])
        direction = poses[child][:3, :3] @ link.axis * size  # in the model
        attribute = ""
        after = ""
        R = poses[link.joint][:3, :3]
        if self.version == "1.4":
            R = np.eye(3)
        elif self.old and rng.random() < 0.5:
            R = np.eye(3)
            after = "<use_parent_model_frame>1</use_parent_model_frame>"
        elif self.old:
            after = rng.choice(["", "<use_parent_model_frame>0</use_parent_model_frame>"])
        elif rng.random() < 0.5:
            other = rng.choice([*poses, "__model__"])
            R = np.eye(3) if other == "__model__" else poses[other][:3, :3]
            attribute = f" expressed_in={_quoted(other)}"
        return f"<xyz{attribute}>{spelled(rng, R.T @ direction)}</xyz>{after}"


def _escaped(value: str) -> str:
    return value.replace("&", "&amp;").replace("<", "&lt;")


def _sdf(robot: Robot, rng: random.Random, folder: Path) -> Written:
    version = rng.choice([*OLD, "1.9", "1.9", "1.9", "1.10", "1.10", "1.11", "1.11"])
    old = version in OLD
    inner = frozenset() if old else _inner(robot, rng)
    links = list(robot.links)
    way = rng.choice(["nested", "include", "merge"])
    if way != "merge":
        for i in inner:
            links[i] = replace(links[i], name=f"hand::{links[i].name}")
    robot = replace(robot, links=tuple(links))
    writer = _Sdf(robot, rng, folder, version)
    T_model_root = spatial.pose(turned(rng), [0.05, 0.0, 0.02])
    T_world_model = robot.T_world_root @ spatial.inverse(T_model_root)
    T_world_link = robot.poses({k.joint: 0.0 for k in robot.driven})
    for link in robot.links:  # a follower is not at zero where its leader is: the file has the poses of zero
        if link.parent < 0:
            T_world_link[link.name] = robot.T_world_root
        else:
            T_world_link[link.name] = T_world_link[robot.links[link.parent].name] @ link.pose(0.0)
    outer: dict[str, np.ndarray] = {}
    parts = []
    T_model_world = spatial.inverse(T_world_model)
    for i, link in enumerate(robot.links):
        if i in inner:
            continue
        outer[link.name] = T_model_world @ T_world_link[link.name]
        parts.append(writer.link(link, link.name, outer))
        if not old and rng.random() < 0.3:
            mark = f"mark {i}"
            outer[mark] = outer[link.name] @ spatial.pose(turned(rng), [0.1, 0.2, 0.3])
            parts.append(f"<frame name={_quoted(mark)} attached_to={_quoted(link.name)}>")
            parts.append(f"{writer.placed(mark, outer, link.name)}</frame>")
    if inner:
        parts.append(_nested(writer, inner, way, T_model_world, T_world_link, outer))
    for i, link in enumerate(robot.links):
        first = i == min(inner, default=-1)
        if link.parent >= 0 and (i not in inner or first):
            parts.append(writer.joint(link, (robot.links[link.parent].name, link.name), outer))
    if robot.stand == "mount":
        ends = f"<parent>world</parent><child>{_escaped(robot.links[0].name)}</child>"
        parts.append(f'<joint name="stand" type="fixed">{ends}</joint>')
    static = "<static>true</static>" if robot.stand == "origin" else ""
    model = f'<model name="drawn">{static}{writer.pose(T_world_model)}{"".join(parts)}</model>'
    if robot.gravity is not None:
        model = f'<world name="w"><gravity>{text(robot.gravity)}</gravity>{model}</world>'
    path = folder / "drawn.sdf"
    path.write_text(f'<sdf version="{version}">{model}</sdf>', encoding="utf-8")
    return Written(path, robot, tensors=writer.tensors)


def _inner(robot: Robot, rng: random.Random) -> frozenset[int]:
    """Return the links of a subtree that becomes a nested model, or none: no joint in it follows one outside."""
    if len(robot.links) < 3 or rng.random() < 0.4:
        return frozenset()
    subtree = {rng.randrange(1, len(robot.links))}
    for i, link in enumerate(robot.links):
        if link.parent in subtree:
            subtree.add(i)
    root = min(subtree)
    for i, link in enumerate(robot.links):
        if link.follows is not None and ((i in subtree - {root}) or link.follows[0] in subtree - {root}):
            return frozenset()
    return frozenset(subtree)


def _nested(writer, inner, way, T_model_world, T_world_link, outer) -> str:
    """Return the nested or included model of the links `inner`; their poses are added to `outer`."""
    rng = writer.rng
    T_world_hand = T_world_link[writer.robot.links[min(inner)].name] @ spatial.pose(turned(rng), [0.1, -0.2, 0.3])
    poses: dict[str, np.ndarray] = {}
    parts = []
    for i in sorted(inner):
        link = writer.robot.links[i]
        name = link.name.removeprefix("hand::")
        poses[name] = spatial.inverse(T_world_hand) @ T_world_link[link.name]
        parts.append(writer.link(link, name, poses))
    for i in sorted(inner - {min(inner)}):
        link = writer.robot.links[i]
        short = replace(link, name=link.name.removeprefix("hand::"))
        parent = writer.robot.links[link.parent].name.removeprefix("hand::")
        parts.append(writer.joint(short, (parent, short.name), poses))
    outer_before = dict(outer)
    T_model_hand = T_model_world @ T_world_hand
    outer_before["hand"] = T_model_hand
    pose = writer.placed("hand", outer_before, None)
    for i in inner:
        name = writer.robot.links[i].name
        outer[name] = T_model_world @ T_world_link[name]
    if way == "nested":
        return f'<model name="hand">{pose}{"".join(parts)}</model>'
    place = writer.folder / "gripper"
    place.mkdir(exist_ok=True)
    for file in writer.folder.glob("m*.stl"):
        (place / file.name).write_bytes(file.read_bytes())
    own = writer.pose(spatial.pose(turned(rng), [1.0, 2.0, 3.0]))  # the pose of the <include> replaces it
    text_of = f'<sdf version="1.9"><model name="gripper">{own}{"".join(parts)}</model></sdf>'
    (place / "model.sdf").write_text(text_of, encoding="utf-8")
    merge = ' merge="true"' if way == "merge" else ""
    uri = rng.choice(["model://gripper", "gripper", "gripper/model.sdf"])
    return f"<include{merge}><uri>{uri}</uri><name>hand</name>{pose}</include>"


# --- USD -------------------------------------------------------------------------------------------


def _usd(robot: Robot, rng: random.Random, folder: Path) -> Written:
    """Write a stage whose prims are nested, moved by drawn operations, and scaled evenly by their parents."""
    path = folder / "drawn.usda"
    stage = Usd.Stage.CreateNew(str(path))
    meters = rng.choice([1.0, 0.01, 0.001, 0.0254])
    UsdGeom.SetStageUpAxis(stage, robot.up)
    UsdGeom.SetStageMetersPerUnit(stage, meters)
    R_stage = drawn_robots.R_STAGE_WORLD[robot.up]
    root = UsdGeom.Xform.Define(stage, "/drawn")
    stage.SetDefaultPrim(root.GetPrim())
    UsdPhysics.ArticulationRootAPI.Apply(root.GetPrim())
    T_stage_root = spatial.pose(turned(rng), [0.3, 0.1, -0.2])
    _operations(root, rng, T_stage_root, meters, 1.0)
    group = UsdGeom.Xform.Define(stage, "/drawn/parts")
    T_root_group = spatial.pose(turned(rng), [-0.3, 0.2, 0.1])
    scale = rng.choice([1.0, 1.0, 0.01, 2.0])
    _operations(group, rng, T_root_group, meters, scale)
    still = robot.poses({})
    paths: list[str] = []
    for i, link in enumerate(robot.links):
        T_stage_link = spatial.pose(R_stage) @ still[link.name]
        parent = "/drawn/parts"
        T_stage_parent = T_stage_root @ T_root_group
        reset = rng.random() < 0.15
        if reset:
            T_stage_parent = np.eye(4)
        own = 1.0 if reset else scale
        paths.append(f"{parent}/{link.name}")
        body = UsdGeom.Xform.Define(stage, paths[i])
        _operations(body, rng, spatial.inverse(T_stage_parent) @ T_stage_link, meters * own, 1.0)
        body.SetResetXformStack(reset)
        UsdPhysics.RigidBodyAPI.Apply(body.GetPrim())
        unit = meters * own
        if link.mass:
            mass = UsdPhysics.MassAPI.Apply(body.GetPrim())
            mass.CreateMassAttr(link.mass)
            mass.CreateCenterOfMassAttr(Gf.Vec3f(*(link.center / unit).tolist()))
            mass.CreateDiagonalInertiaAttr(Gf.Vec3f(*(link.moments / meters**2).tolist()))
        if link.shape:
            box = trimesh.creation.box(link.size)
            R = turned(rng)
            shape = UsdGeom.Mesh.Define(stage, f"{paths[i]}/{link.name}_shape")
            _operations(shape, rng, spatial.pose(R, [0.1, 0.0, 0.2]), unit, 0.5)
            T_shape_link = spatial.inverse(spatial.pose(R, [0.1, 0.0, 0.2]))
            points = (box.vertices + link.center) @ T_shape_link[:3, :3].T + T_shape_link[:3, 3]
            shape.CreatePointsAttr([Gf.Vec3f(*p) for p in (points / unit / 0.5).tolist()])
            shape.CreateFaceVertexCountsAttr([3] * len(box.faces))
            shape.CreateFaceVertexIndicesAttr(box.faces.ravel().tolist())
        if link.parent < 0 and robot.stand != "floating":
            anchor = UsdPhysics.FixedJoint.Define(stage, "/drawn/stand")
            anchor.CreateBody1Rel().SetTargets([paths[i]])
            T_root_link = spatial.inverse(T_stage_root) @ T_stage_link
            if rng.random() < 0.5:
                anchor.CreateBody0Rel().SetTargets(["/drawn"])
                frame(anchor, 0, T_root_link, meters)
            else:
                frame(anchor, 0, T_stage_link, meters)
        if link.parent >= 0:
            reset_parent = UsdGeom.Xformable(stage.GetPrimAtPath(paths[link.parent])).GetResetXformStack()
            units = (meters * (1.0 if reset_parent else scale), unit)
            _joint(stage, robot, link, (paths[link.parent], paths[i]), units, rng, meters)
    if robot.gravity is not None:
        scene = UsdPhysics.Scene.Define(stage, "/scene")
        size = float(np.linalg.norm(robot.gravity))
        down = R_stage @ (np.array(robot.gravity) / size if size else np.array([0.0, 0.0, -1.0]))
        scene.CreateGravityDirectionAttr(Gf.Vec3f(*down.tolist()))
        scene.CreateGravityMagnitudeAttr(size / meters)
    stage.GetRootLayer().Save()
    return Written(path, replace(robot, meters=meters))


def _joint(stage, robot: Robot, link: Link, paths, units, rng: random.Random, meters: float) -> None:
    """Write a joint whose axis is X, Y or Z of a turned frame; the first body of some fixed joints is the child."""
    schemas = {"hinge": UsdPhysics.RevoluteJoint, "slide": UsdPhysics.PrismaticJoint, "fixed": UsdPhysics.FixedJoint}
    joint = schemas[link.kind].Define(stage, f"/drawn/{link.joint}")
    letter = rng.choice("XYZ")
    unit_axis = np.eye(3)["XYZ".index(letter)]
    aligned = Rotation.align_vectors([link.axis], [unit_axis])
    T_link_joint = spatial.pose(aligned[0].as_matrix(), link.pivot)
    frames = [link.T @ T_link_joint, T_link_joint]
    swapped = link.kind == "fixed" and rng.random() < 0.5
    ends = [0, 1] if not swapped else [1, 0]
    joint.CreateBody0Rel().SetTargets([paths[ends[0]]])
    joint.CreateBody1Rel().SetTargets([paths[ends[1]]])
    frame(joint, 0, frames[ends[0]], units[ends[0]])
    frame(joint, 1, frames[ends[1]], units[ends[1]])
    if link.kind == "fixed":
        return
    joint.CreateAxisAttr(letter)
    if link.limits is not None:
        unit = np.pi / 180 if link.kind == "hinge" else meters
        joint.CreateLowerLimitAttr(link.limits[0] / unit)
        joint.CreateUpperLimitAttr(link.limits[1] / unit)


def _operations(prim: UsdGeom.Xformable, rng: random.Random, T: np.ndarray, unit: float, scale: float) -> None:
    """Add operations whose product is the pose T, with lengths in `unit` m, and an even scale."""
    p = Gf.Vec3d(*(T[:3, 3] / unit).tolist())
    double = UsdGeom.XformOp.PrecisionDouble
    way = rng.randrange(5)
    if way == 0:
        matrix = np.eye(4)
        matrix[:3, :3] = T[:3, :3] * scale
        matrix[:3, 3] = T[:3, 3] / unit
        prim.AddTransformOp().Set(Gf.Matrix4d(*matrix.T.ravel().tolist()))
        return
    prim.AddTranslateOp(double).Set(p)
    R = T[:3, :3]
    angles = euler(R, "xyz")
    reverse = euler(R, "zyx")
    if way == 1 or angles is None or reverse is None:
        x, y, z, w = Rotation.from_matrix(R).as_quat().tolist()
        prim.AddOrientOp(double).Set(Gf.Quatd(w, x, y, z))
    elif way == 2:
        prim.AddRotateXYZOp(double).Set(Gf.Vec3d(*np.degrees(angles).tolist()))
    elif way == 3:
        z, y, x = np.degrees(reverse).tolist()
        prim.AddRotateZYXOp(double).Set(Gf.Vec3d(x, y, z))
    else:
        pivot = np.array([0.4, -0.2, 0.1])
        # the rotation about the pivot moves the origin; the translation before it takes it back
        back = R @ pivot - pivot
        prim.AddTranslateOp(double, "back").Set(Gf.Vec3d(*back.tolist()))
        prim.AddTranslateOp(double, "pivot").Set(Gf.Vec3d(*pivot.tolist()))
        x, y, z = np.degrees(angles).tolist()
        prim.AddRotateZOp(double).Set(z)
        prim.AddRotateYOp(double).Set(y)
        prim.AddRotateXOp(double).Set(x)
        prim.AddTranslateOp(double, "pivot", True)
    if scale != 1.0:
        prim.AddScaleOp(double).Set(Gf.Vec3d(scale, scale, scale))
