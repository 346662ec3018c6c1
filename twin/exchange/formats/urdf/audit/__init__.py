"""Read a URDF: compute link poses from the joint values of a track, and check limits and mesh files.

A URDF contains the tree, inertias and limits of a mechanism; it cannot contain loops, named frames or gravity. A
closure YAML of the same name contains the loops (`closures`).
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from twin.core.foreign.admit import admit
from twin.core.foreign.text import DoctypeError
from twin.core.foreign.text import parse_xml as read_xml
from twin.exchange.audit import poses
from twin.exchange.audit.chain import ChainStep, along, fit
from twin.exchange.audit.colors import Palette, Rgba, linear
from twin.exchange.audit.context import Context, played
from twin.exchange.audit.meshes import check_mesh, joined, read_obj
from twin.exchange.audit.motion import Content, FileClip, LinkShape
from twin.exchange.audit.physics import FileDrive, FileJoint, FileMass, FileMotor, FilePhysics, JointLine, unit
from twin.exchange.audit.physics import along as lines_of
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Ledger, Measured, ReadError
from twin.exchange.formats.urdf.audit.closures import CLOSED, PLAYED, Closures, check_gap, read_closures
from twin.exchange.xacro import SUFFIX, Expanded, expand, is_xacro

KINDS = {"revolute": "turn", "continuous": "turn", "prismatic": "slide", "fixed": "fixed", "floating": "free"}

NO_LIMIT = 1000.0
"""Limit in m from which a slide counts as unlimited. URDF requires a limit, even for a slide without limits."""

NO_BOUND = 1e6
"""Effort (N, N m) or speed (m/s, rad/s) from which a value counts as unknown. URDF requires a number for both."""


@dataclass(frozen=True)
class UrdfJoint:
    """A joint of a URDF.

    Attributes:
        parent, child: names of the two links.
        link: pose of the joint in the parent's frame, kind of motion, and axis.
        limits: (lower, upper) in rad or m; None if not stated.
        effort: maximum effort in N or N m; None if not stated.
        speed: maximum speed in m/s or rad/s; None if not stated.
        damping, friction: of <dynamics>, in N s/m or N m s/rad, and N or N m; 0 if not stated.
        mimic: (leader, multiplier, offset) if the joint follows the joint `leader`, else None.
    """

    name: str
    parent: str
    child: str
    link: ChainStep
    limits: tuple[float, float] | None
    effort: float | None
    speed: float | None
    mimic: tuple[str, float, float] | None
    damping: float = 0.0
    friction: float = 0.0

    def values(self, clip: FileClip) -> Array | None:
        """Return the values (k,) in rad or m of the joint in a track; None if the track lacks the values.

        Values of a joint with `mimic` are computed from the leader's values.
        """
        if self.mimic is None or self.mimic[0] not in clip.joints:
            return clip.joints.get(self.name)
        leader, multiplier, offset = self.mimic
        return multiplier * clip.joints[leader] + offset


class Urdf:
    """A URDF, or an expanded xacro, with its tree of joints."""

    def __init__(self, path: Path, ledger: Ledger, expanded: Expanded | None = None) -> None:
        self._ledger = ledger
        root = parse_xml(path, None if expanded is None else expanded.data)
        if root.tag != "robot":
            raise ReadError(f"the root element is <{root.tag}>, expected <robot>")
        links = [e.get("name", "") for e in root.findall("link")]
        if twice := {n for n in links if links.count(n) > 1}:
            ledger.wrong("urdf.duplicate_name", f"two links are named '{min(twice)}'.", min(twice))
        self.above: dict[str, UrdfJoint] = {}
        for element in root.findall("joint"):
            joint = _joint(element, links, ledger)
            if joint is None:
                continue
            if joint.child in self.above:
                two = f"{self.above[joint.child].name} and {joint.name}"
                text = f"link '{joint.child}' is the child of two joints, {two}, but a URDF must be a tree."
                ledger.wrong("urdf.tree", text, joint.child)
                continue
            self.above[joint.child] = joint
        roots = [n for n in links if n not in self.above]
        if len(roots) != 1:
            raise ReadError(f"the file has {len(roots)} root links ({', '.join(roots[:3])}), expected one")
        for link in links:
            self._way(link, roots[0])
        self.root, self.links = roots[0], links
        self.content = Content(ledger, "urdf")
        self.content.facts = {"units": "m (URDF)", "up_axis": "Z (URDF)", "handedness": "right (URDF)"}
        self.content.rest = dict.fromkeys(links, np.eye(4))
        self.content.shapes, self.content.colors = _shapes(root, path, ledger)
        masses = {e.get("name", ""): _inertial(e) for e in root.findall("link")}
        known = {n: mass for n, mass in masses.items() if mass is not None}
        joints = {j.name for j in self.above.values()}
        beside = path.with_suffix(".yaml")
        read = read_closures(beside, links, joints, ledger) if beside.is_file() else None
        self.closures = read or Closures()
        moving = _moving(root)
        if read and moving != read.driven:
            apart = ", ".join(sorted(moving ^ read.driven))
            text = f"the transmissions and 'name_mot' of {beside.name} do not name the same driven joints: {apart}."
            ledger.wrong("urdf.driven", text, apart)
        ends = {link for a, b, _ in self.closures.pairs for link in (a, b)}
        bodies = [n for n in links if n not in ends or n in self.content.shapes]
        self.content.physics = _tree_physics(bodies, known, self.above.values(), moving)
        self.content.physics.joints += self.closures.joints()
        if self.closures.couplings is not None:
            mimics = {j.name: j.mimic for j in self.above.values() if j.mimic is not None}
            follow = {f"{n}_mimic": ({n: 1.0, leader: -m}, total) for n, (leader, m, total) in mimics.items()}
            self.content.physics.couplings = follow | dict(self.closures.couplings)
        self.content.physics.assumed = assumed_masses(path)
        self.content.physics.partly = partly_shown(path) | _partly_read(root)
        self.content.physics.motors = _motors(root)
        self.content.physics.reductions = _reductions(root, moving)
        _check_transmissions(root, {j.name for j in self.above.values()}, ledger)
        self._check_home(beside.name)

    def _check_home(self, name: str) -> None:
        """Report loops that are open, and joints outside their limits, at `home` of the closure YAML `name`."""
        home = self.closures.home
        if not home:
            return
        for joint in self.above.values():
            if joint.name in home and joint.limits is not None:
                low, high = joint.limits
                if not low - 1e-6 <= home[joint.name] <= high + 1e-6:
                    text = (
                        f"{name}: joint '{joint.name}' is at {home[joint.name]:g} at home, outside its limits "
                        f"{low:g} .. {high:g}."
                    )
                    self._ledger.wrong("urdf.limits", text, joint.name)
        for pair in self.closures.pairs:
            T_a, T_b = (self._at(link, home) for link in pair[:2])
            check_gap(pair, T_a, T_b, f"{name}, home", CLOSED, self._ledger)

    def _at(self, link: str, values: Mapping[str, float]) -> Array:
        """Return the pose (1, 4, 4) of a link in the frame of the root at joint values; other joints are at zero."""
        way = self._way(link, self.root)
        q = [None if j.link.kind == "fixed" else np.array([values.get(j.name, 0.0)]) for j in way]
        return along([j.link for j in way], q, 1)

    def _way(self, link: str, stop: str) -> list[UrdfJoint]:
        """Return the joints on the path from the ancestor `stop` to the link `link`, starting at `stop`."""
        out: list[UrdfJoint] = []
        while link != stop:
            if link not in self.above or len(out) > len(self.above):
                raise ReadError(f"link '{link}' is its own ancestor")
            out.append(self.above[link])
            link = out[-1].parent
        return out[::-1]

    def play(self, clip: FileClip) -> FileClip:
        """Return a clip of the link poses T_world_link (k, 4, 4), computed from the joint values of `clip`."""
        count = len(clip.times)
        placed: dict[str, Array] = {}
        T_root = clip.links.get(self.root)
        placed[self.root] = np.broadcast_to(np.eye(4), (count, 4, 4)) if T_root is None else T_root
        for name in self._parents_first():
            if name not in clip.links or name == self.root:
                continue
            upper, way = self.above[name].parent, [self.above[name]]
            while upper not in placed:
                way.append(self.above[upper])
                upper = self.above[upper].parent
            way.reverse()
            if any(j.link.kind == "free" for j in way):  # every pose of the link is a pose of the joint
                placed[name] = clip.links[name]
                continue
            given = [j.values(clip) for j in way]
            if any(g is None and j.link.kind != "fixed" for g, j in zip(given, way, strict=True)):
                known = clip.links.get(upper, placed[upper])
                given = fit([j.link for j in way], given, poses.inverse(known) @ clip.links[name])
            placed[name] = placed[upper] @ along([j.link for j in way], given, count)
        for pair in self.closures.pairs:
            self._close(pair, placed, clip)
        return FileClip(clip.name, clip.times, {n: T for n, T in placed.items() if n in clip.links})

    def _close(self, pair: tuple[str, str, str], placed: Mapping[str, Array], clip: FileClip) -> None:
        """Report a loop that is open at a key of a clip; `placed` contains the poses of links in this clip.

        Joint values that the clip lacks are those that close the loop best.
        """
        ways: list[tuple[str, list[UrdfJoint]]] = []
        for link in pair[:2]:
            upper, way = link, []
            while upper not in placed:
                way.insert(0, self.above[upper])
                upper = way[0].parent
            ways.append((upper, way))
        ways.sort(key=lambda at: sum(j.link.kind != "fixed" for j in at[1]))
        (still, fixed), (upper, way) = ways
        count = len(clip.times)
        T_still = placed[still] @ along([j.link for j in fixed], [j.values(clip) for j in fixed], count)
        given = [j.values(clip) for j in way]
        given = fit([j.link for j in way], given, poses.inverse(placed[upper]) @ T_still)
        T_other = placed[upper] @ along([j.link for j in way], given, count)
        check_gap(pair, T_still, T_other, f"clip '{clip.name}'", PLAYED, self._ledger)

    def _parents_first(self) -> list[str]:
        return sorted(self.links, key=lambda n: len(self._way(n, self.root)))

    def check_limits(self, name: str, low: Mapping[str, float], high: Mapping[str, float]) -> None:
        """Compare the joint limits of the file with the joint limits in a track.

        `name` is the file name of the track. `low` and `high` map joints to their limits in the track, in m or rad.
        """
        for joint in self.above.values():
            if joint.name not in low or joint.limits is None:
                continue
            its = (low[joint.name], high[joint.name])
            ends = zip(joint.limits, its, strict=True)
            off = max((abs(a - b) for a, b in ends if abs(b) < 1e29), default=0.0)  # a slide may have no limit
            if off > 1e-6:
                text = (
                    f"joint '{joint.name}' has limits {joint.limits[0]:g} .. {joint.limits[1]:g}; in {name} they are "
                    f"{its[0]:g} .. {its[1]:g}."
                )
                self._ledger.wrong("urdf.limits", text, joint.name, size=off)


def parse_xml(path: Path, data: bytes | None = None) -> ET.Element:
    """Return the root element of an XML file or, if given, of the XML `data` that was made from it.

    Raises:
        ReadError: the text is not XML, or declares entities, which could expand without limit.
    """
    try:
        return read_xml(path, data)
    except DoctypeError as error:
        raise ReadError(f"{error}") from error
    except (ET.ParseError, LookupError, ValueError) as error:
        raise ReadError(f"the file is not XML: {error}") from error


def assumed_masses(path: Path) -> frozenset[str]:
    """Return the names of links whose mass is unknown, as a comment in the file states."""
    stated = re.findall(
        r"<!--[^>]*?the mass of ([^>]*?) is unknown", path.read_text(encoding="utf-8", errors="replace")
    )
    return frozenset(n for names in stated for n in names.split(", "))


def partly_shown(path: Path) -> frozenset[str]:
    """Return the names of links whose shapes do not show the whole link, as a comment in the file states."""
    stated = re.findall(r"<!--[^>]*?the shapes of ([^>]*?) are for display", path.read_text("utf-8", errors="replace"))
    return frozenset(n for names in stated for n in names.split(", "))


def _partly_read(root: ET.Element) -> frozenset[str]:
    """Return the names of links that have no collision shape, or a visual shape that is not a mesh and is not read."""
    out = set()
    for link in root.findall("link"):
        visuals = link.findall("visual")
        if link.find("collision") is None or any(v.find("geometry/mesh") is None for v in visuals):
            out.add(link.get("name", ""))
    return frozenset(out)


def numbers(text: str | None, n: int, default: tuple[float, ...]) -> Array:
    """Return n finite numbers from the text of an attribute; the default if the text is None.

    Raises:
        ReadError: the text does not consist of n finite numbers.
    """
    if text is None:
        return np.array(default, float)
    try:
        out = np.array(text.split(), float)
    except ValueError as error:
        raise ReadError(f"'{text[:40]}' is not a list of numbers") from error
    if out.shape != (n,) or not np.all(np.isfinite(out)):
        raise ReadError(f"'{text[:40]}' is not a list of {n} finite numbers")
    return out


def _joint(element: ET.Element, links: list[str], ledger: Ledger) -> UrdfJoint | None:
    name, kind = element.get("name", ""), element.get("type", "")
    ends = [(e.get("link", "") if e is not None else "") for e in (element.find("parent"), element.find("child"))]
    for end in ends:
        if end not in links:
            raise ReadError(f"joint '{name}' names link '{end}', which does not exist")
    if kind not in KINDS:
        ledger.add("urdf.joint", "warning", f"joint '{name}' of type '{kind}' is not supported.", name)
        return None
    origin, axis = element.find("origin"), element.find("axis")
    T = _origin(origin)
    a = numbers(None if axis is None else axis.get("xyz"), 3, (1, 0, 0))
    if abs(np.linalg.norm(a) - 1) > 1e-6 and KINDS[kind] not in ("fixed", "free"):
        text = f"the axis of joint '{name}' has length {np.linalg.norm(a):.6g}, not 1."
        ledger.wrong("urdf.axis", text, name, size=Measured(float(np.linalg.norm(a)), 1.0))
    limit = element.find("limit")
    limits = None
    effort, speed = (
        None if limit is None or limit.get(k) is None else float(numbers(limit.get(k), 1, ())[0])
        for k in ("effort", "velocity")
    )
    if limit is not None and {"lower", "upper"} & set(limit.keys()) and kind != "continuous":
        limits = (float(limit.get("lower", "0")), float(limit.get("upper", "0")))
        if not limits[0] <= limits[1]:
            text = f"joint '{name}': lower limit {limits[0]:g} is above upper limit {limits[1]:g}."
            ledger.wrong("urdf.limits", text, name, suggestion="exchange the limits")
    follows, mimic = element.find("mimic"), None
    if follows is not None:
        factor, offset = (float(numbers(follows.get(k), 1, (d,))[0]) for k, d in (("multiplier", 1.0), ("offset", 0.0)))
        mimic = (follows.get("joint", ""), factor, offset)
    dynamics = element.find("dynamics")
    damping, friction = (
        0.0 if dynamics is None else float(numbers(dynamics.get(k), 1, (0.0,))[0]) for k in ("damping", "friction")
    )
    link = ChainStep(T, KINDS[kind], a, name)
    return UrdfJoint(name, ends[0], ends[1], link, limits, effort, speed, mimic, damping, friction)


def _origin(element: ET.Element | None) -> Array:
    if element is None:
        return np.eye(4)
    R = poses.rpy(numbers(element.get("rpy"), 3, (0, 0, 0)))
    return poses.pose(R, numbers(element.get("xyz"), 3, (0, 0, 0)))


def _shapes(root: ET.Element, path: Path, ledger: Ledger) -> tuple[dict[str, LinkShape], dict[str, dict[Rgba, float]]]:
    out = {}
    named = {m.get("name"): m.find("color") for m in root.findall("material")}
    palette = Palette()
    checked: dict[str, tuple[Array, Array] | None] = {}
    for link in root.findall("link"):
        parts = []
        for visual in link.findall("visual"):
            mesh = visual.find("geometry/mesh")
            if mesh is None:
                continue
            scale = numbers(mesh.get("scale"), 3, (1, 1, 1))
            got = named_mesh(path, mesh.get("filename", ""), scale, checked, ledger, "urdf")
            if got is not None:
                T = _origin(visual.find("origin"))
                parts.append(check_mesh(Ledger(""), "", got[0] @ T[:3, :3].T + T[:3, 3], got[1], None, "urdf"))
                material = visual.find("material")
                color = None if material is None else material.find("color")
                if color is None and material is not None:
                    color = named.get(material.get("name"))
                if color is not None and parts[-1] is not None:
                    rgba = numbers(color.get("rgba"), 4, (1, 1, 1, 1))
                    shown = (*linear(rgba[:3]).tolist(), float(rgba[3]))
                    palette.add(link.get("name", ""), shown, parts[-1].area)
        shape = joined(p for p in parts if p is not None)
        if shape is not None:
            out[link.get("name", "")] = shape
    return out, palette.shares()


def named_mesh(
    path: Path, name: str, scale: Array, checked: dict[str, tuple[Array, Array] | None], ledger: Ledger, code: str
) -> tuple[Array, Array] | None:
    """Return (points (n, 3) in m, triangles (m, 3)) of a mesh file; None if the file cannot be read.

    A mesh file that several links use is read and checked once.

    `name` is the path of the mesh file relative to the robot's file `path`. `scale` (3,) converts the mesh's units to
    m. `checked` stores the meshes already read. `code` is the first part of the codes of the findings.
    """
    key = f"{name} {scale.tolist()}"
    if key in checked:
        return checked[key]
    checked[key] = None
    folder = path.resolve().parent
    file = (folder / name.removeprefix("package://").removeprefix("file://")).resolve()
    # the expansion of a xacro replaces the package of a mesh by its folder, which is not below the file
    of_package = path.suffix == SUFFIX and name.startswith("file:///")
    if not name or not (of_package or file.is_relative_to(folder)) or not file.is_file():
        ledger.wrong(f"{code}.mesh", f"mesh file '{name}' does not exist.", name)
        return None
    if file.suffix.lower() != ".obj":
        ledger.add(f"{code}.mesh", "info", f"mesh '{name}' is not an .obj file and is not read.", name)
        return None
    try:
        vertices, triangles = read_obj(file)
    except ReadError as error:
        ledger.wrong(f"{code}.mesh", f"mesh {error}.", name)
        return None
    vertices = vertices * scale
    if float(np.prod(scale)) < 0:
        ledger.wrong(f"{code}.mirrored", f"mesh '{name}' is mirrored by a negative scale.", name)
    check_mesh(ledger, name, vertices, triangles, None, code)
    checked[key] = (vertices, triangles)
    return checked[key]


def _inertial(element: ET.Element) -> FileMass | None:
    """Return the mass properties of a <link>; None if it has no <inertial>."""
    here = element.find("inertial")
    if here is None:
        return None
    mass, tensor, T = here.find("mass"), here.find("inertia"), _origin(here.find("origin"))
    value = {k: float(numbers(None if tensor is None else tensor.get(k), 1, (0.0,))[0]) for k in _PARTS}
    xx, xy, xz, yy, yz, zz = (value[k] for k in _PARTS)
    own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    R = T[:3, :3]
    return FileMass(float(numbers(None if mass is None else mass.get("value"), 1, (0.0,))[0]), T[:3, 3], R @ own @ R.T)


_PARTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def _moving(root: ET.Element) -> frozenset[str]:
    """Return the names of the joints in transmissions, or with a command interface of ros2_control: the driven joints.

    If no joint is named, the file does not state which joints are driven.
    """
    out = {str(e.get("name")) for t in root.findall("transmission") for e in t.findall("joint")}
    for element in (e for control in root.findall("ros2_control") for e in control.findall("joint")):
        if element.find("command_interface") is not None:
            out.add(str(element.get("name")))
    return frozenset(out)


def _tree_physics(
    links: Iterable[str], masses: dict[str, FileMass], joints: Iterable[UrdfJoint], moving: Collection[str]
) -> FilePhysics:
    out = FilePhysics(tuple(links), masses)
    for j in joints:
        T, axis = j.link.fixed, j.link.axis
        motions: tuple[JointLine, ...] = ()
        if j.link.kind == "free":
            motions = lines_of("free", T)
        elif j.link.kind != "fixed" and axis is not None:
            motions = (JointLine(j.link.kind, T[:3, 3], unit(T[:3, :3] @ axis)),)
        low, high = j.limits or (-np.inf, np.inf)
        if j.link.kind == "slide" and max(abs(low), abs(high)) >= NO_LIMIT:
            low, high = -np.inf, np.inf
        effort, speed = (None if b is None or b >= NO_BOUND else b for b in (j.effort, j.speed))
        driven = j.name in moving if moving else None
        drive = FileDrive()
        if len(motions) == 1:
            drive = FileDrive((low, high), driven, None, None, effort, speed, (0.0, j.damping, j.friction, 0.0))
        out.joints.append(FileJoint((j.name,), j.parent, j.child, T, motions, drive))
    return out


def _check_transmissions(root: ET.Element, names: Collection[str], ledger: Ledger) -> None:
    """Report transmissions of one joint whose joint does not exist, or whose actuator is named as another joint."""
    for t in root.findall("transmission"):
        joints, actuators = ([str(e.get("name")) for e in t.findall(k)] for k in ("joint", "actuator"))
        own = str(t.get("name"))
        if len(joints) != 1 or len(actuators) != 1:
            continue
        if joints[0] not in names:
            text = f"transmission '{own}' names joint '{joints[0]}', which does not exist."
            ledger.wrong("urdf.transmission", text, own)
        elif actuators[0] != joints[0] and actuators[0] in names:
            text = f"transmission '{own}': actuator '{actuators[0]}' drives '{joints[0]}', not the joint of its name."
            advice = "let the actuator drive the joint of its name, or rename it"
            ledger.wrong("urdf.transmission", text, joints[0], suggestion=advice)


def _reductions(root: ET.Element, moving: Collection[str]) -> dict[str, float] | None:
    """Return {joint: reduction} of the transmissions with one joint; None if no transmission names a joint."""
    out = {}
    for t in root.findall("transmission"):
        joints = [str(e.get("name")) for e in t.findall("joint")]
        if len(joints) == 1:
            reductions = [float(numbers(r.text, 1, ())[0]) for r in t.iter("mechanicalReduction")]
            out[joints[0]] = float(np.prod(reductions))  # without one, it is 1
    return out if moving else None


def _motors(root: ET.Element) -> dict[str, FileMotor]:
    """Return the motors of <transmission> elements with one joint.

    A motor with the same name as its joint is omitted, because it represents the joint's drive.
    """
    out = {}
    for t in root.findall("transmission"):
        joints, names = ([str(e.get("name")) for e in t.findall(k)] for k in ("joint", "actuator"))
        reductions = [float(numbers(r.text, 1, ())[0]) for r in t.iter("mechanicalReduction")]
        if len(joints) == len(names) == len(reductions) == 1 and names != joints:
            out[names[0]] = FileMotor({joints[0]: reductions[0]})
    return out


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a URDF with its poses along the tracks, and report its faults."""
    admit(path)
    ledger.tool, ledger.version = "twin.exchange.audit urdf", "1"
    expanded: Expanded | None = None
    if is_xacro(path):
        expanded = expand(path, context.xacro)
        for text in expanded.omitted:
            ledger.add("urdf.xacro", "warning", text, path.name)
    return played(Urdf(path, ledger, expanded), path, ledger, context)
