"""Read a URDF: compute link poses from the joint values of a track, and check limits and mesh files.

A URDF contains the tree, inertias and limits of a mechanism; it cannot contain loops, named frames or gravity. A
closure YAML of the same name contains the loops (`closures`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from twin.core.errors import BudgetError, SourceError, TwinError
from twin.core.foreign.admit import admit
from twin.exchange.audit import poses
from twin.exchange.audit.chain_poses import ChainStep, chain_end, solve_chain
from twin.exchange.audit.colors import Palette, Rgba, linear
from twin.exchange.audit.comment_statements import assumed_masses, partly_shown
from twin.exchange.audit.file_content import Content, FileClip, LinkShape
from twin.exchange.audit.mechanism_data import FileDrive, FileJoint, FileMass, FileMotor, FilePhysics, JointLine, unit
from twin.exchange.audit.mechanism_data import motion_lines as lines_of
from twin.exchange.audit.mesh_files import mesh_path, named_mesh, placed_shape
from twin.exchange.audit.meshes import joined
from twin.exchange.audit.poses import Array
from twin.exchange.audit.reader_context import Context, played
from twin.exchange.audit.report import Ledger, Measured, ReadError
from twin.exchange.audit.xml_root import parse_xml
from twin.exchange.formats.urdf.audit.closures import CLOSED, PLAYED, FileClosures, check_gap, read_closures
from twin.exchange.formats.urdf.audit.collisions import check_collisions
from twin.exchange.formats.urdf.audit.elements import check_elements
from twin.exchange.formats.urdf.audit.program_settings import program_settings
from twin.exchange.xacro import Expanded, expand, is_xacro

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
        soft: (lower, upper) of <safety_controller> in rad or m, within the limits; None without one.
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
    soft: tuple[float, float] | None = None

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
        links = [element.get("name", "") for element in root.findall("link")]
        twice = {link for link in links if links.count(link) > 1}
        if twice:
            ledger.wrong("urdf.duplicate_name", f"two links are named '{min(twice)}'.", min(twice))
        joint_names = [element.get("name", "") for element in root.findall("joint")]
        twice = {joint for joint in joint_names if joint_names.count(joint) > 1}
        if twice:
            ledger.wrong("urdf.duplicate_name", f"two joints are named '{min(twice)}'.", min(twice))
        check_elements(root, ledger)
        self.links = links
        self.above: dict[str, UrdfJoint] = {}
        for element in root.findall("joint"):
            joint = _joint(element, links, ledger)
            if joint is not None:
                self._attach(joint)
        roots = [link for link in links if link not in self.above]
        if len(roots) != 1:
            raise ReadError(f"the file has {len(roots)} root links ({', '.join(roots[:3])}), expected one")
        self.root = roots[0]
        for link in links:
            self._path(link, self.root)  # raises an error for a cycle
        self.content = Content(ledger, "urdf")
        self.content.facts = {"units": "m (URDF)", "up_axis": "Z (URDF)", "handedness": "right (URDF)"}
        self.content.rest = dict.fromkeys(links, np.eye(4))
        self._colliding = {str(link.get("name")) for link in root.findall("link") if link.find("collision") is not None}
        self._shown = {str(link.get("name")): link.find("visual") is not None for link in root.findall("link")}
        self.content.shapes, self.content.colors = _shapes(root, path, ledger)
        check_collisions(root, ledger, lambda name: mesh_path(path, name), _scale_and_pose)
        masses = _masses(root)
        joints = {joint.name for joint in self.above.values()}
        moving = _moving(root)
        beside = path.with_suffix(".yaml")
        self.closures = self._read_closures(beside, joints, moving)
        self._check_order(beside.name, _in_order(root))
        self.content.physics = self._physics(masses, moving)
        self.content.physics.robot = root.get("name", "")
        self.content.physics.assumed = assumed_masses(path)
        self.content.physics.partly_shown = partly_shown(path) | _partly_read(root)
        self.content.physics.motors = _motors(root)
        self.content.physics.reductions = _reductions(root, moving)
        self.content.physics.programs = program_settings(root)
        _check_transmissions(root, joints, ledger)
        self._check_home(beside.name)

    def _attach(self, joint: UrdfJoint) -> None:
        other = self.above.get(joint.child)
        if other is None:
            self.above[joint.child] = joint
            return
        text = (
            f"link '{joint.child}' is the child of two joints, {other.name} and {joint.name}, but a URDF must be a "
            "tree."
        )
        self._ledger.wrong("urdf.tree", text, joint.child)

    def _read_closures(self, file: Path, joints: Collection[str], moving: frozenset[str]) -> FileClosures:
        """Return the content of a closure YAML, if there is one; its driven joints must be the joints `moving`."""
        closures = None
        if file.is_file():
            closures = read_closures(file, self.links, joints, self._ledger)
        if closures is None:
            return FileClosures()
        driven = frozenset(closures.driven)
        if moving != driven:
            apart = ", ".join(sorted(moving ^ driven))
            text = f"the transmissions and 'name_mot' of {file.name} do not name the same driven joints: {apart}."
            self._ledger.wrong("urdf.driven", text, apart)
        return closures

    def _check_order(self, name: str, listed: Sequence[str]) -> None:
        """Report driven joints that the closure YAML `name` has in another order than the transmissions, `listed`.

        Readers of the YAML count the values of the motors in this order.
        """
        own = [joint for joint in self.closures.driven if joint in listed]
        expected = [joint for joint in listed if joint in own]
        if own == expected:
            return
        place = 0
        while own[place : place + 1] == expected[place : place + 1]:
            place += 1
        text = (
            f"'name_mot' of {name} has the driven joints in another order than the transmissions: "
            f"{', '.join(own[place:])}, expected {', '.join(expected[place:])}."
        )
        self._ledger.wrong("urdf.driven_order", text, own[place], suggestion="export the URDF and its YAML together")

    def _physics(self, masses: dict[str, FileMass], moving: Collection[str]) -> FilePhysics:
        ends: set[str] = set()
        for a, b, _ in self.closures.pairs:
            ends.update((a, b))
        # The ends of loops are frames, unless they have a shape: they are no links of the mechanism.
        bodies = [link for link in self.links if link not in ends or link in self.content.shapes]
        physics = _tree_physics(bodies, masses, self.above.values(), moving)
        physics.shown = {link: self._shown[link] for link in bodies}
        physics.collides = dict.fromkeys(self._colliding & set(bodies), True)
        physics.joints += self.closures.joints()
        couplings: dict[str, tuple[Mapping[str, float], float]] = {}
        for joint in self.above.values():
            if joint.mimic is not None:
                leader, multiplier, offset = joint.mimic
                couplings[f"{joint.name}_mimic"] = ({joint.name: 1.0, leader: -multiplier}, offset)
        if self.closures.couplings is not None:
            couplings |= dict(self.closures.couplings)
        physics.couplings = couplings
        physics.couples_pairs = self.closures.couplings is None  # a mimic couples two joints
        return physics

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
            T_a = self._at(pair[0], home)
            T_b = self._at(pair[1], home)
            check_gap(pair, T_a, T_b, f"{name}, home", CLOSED, self._ledger)

    def _at(self, link: str, values: Mapping[str, float]) -> Array:
        """Return the pose (1, 4, 4) of a link in the frame of the root at joint values; other joints are at zero."""
        path = self._path(link, self.root)
        q = [np.array([values.get(joint.name, 0.0)]) for joint in path]
        return chain_end(_steps(path), q, 1)

    def _path(self, link: str, stop: str) -> list[UrdfJoint]:
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
        placed[self.root] = clip.links.get(self.root, np.broadcast_to(np.eye(4), (count, 4, 4)))
        for name in self._parents_first():
            if name not in clip.links or name == self.root:
                continue
            upper, path = self._path_from(name, placed)
            kinds = [joint.link.kind for joint in path]
            if "free" in kinds:  # every pose of the link is a pose of the joint
                placed[name] = clip.links[name]
                continue
            values: list[Array | None] = [joint.values(clip) for joint in path]
            # Values that the track lacks are computed from the pose of the link in the track.
            goal = poses.inverse(clip.links.get(upper, placed[upper])) @ clip.links[name]
            values = solve_chain(_steps(path), values, goal)
            placed[name] = placed[upper] @ chain_end(_steps(path), values, count)
        for pair in self.closures.pairs:
            self._close(pair, placed, clip)
        links = {link: T for link, T in placed.items() if link in clip.links}
        return FileClip(clip.name, clip.times, links)

    def _path_from(self, link: str, placed: Collection[str]) -> tuple[str, list[UrdfJoint]]:
        """Return (nearest ancestor in `placed`, joints on the path from it to the link)."""
        path: list[UrdfJoint] = []
        while not path or link not in placed:
            path.append(self.above[link])
            link = path[-1].parent
        return link, path[::-1]

    def _close(self, pair: tuple[str, str, str], placed: Mapping[str, Array], clip: FileClip) -> None:
        """Report a loop that is open at a key of a clip; `placed` contains the poses of links in this clip.

        Joint values that the clip lacks are those that close the loop best.
        """
        ends: list[tuple[str, list[UrdfJoint]]] = []
        for link in pair[:2]:
            ends.append((link, []) if link in placed else self._path_from(link, placed))
        ends.sort(key=_moving_joints)
        (still, fixed), (upper, path) = ends
        count = len(clip.times)
        T_still = placed[still] @ chain_end(_steps(fixed), [joint.values(clip) for joint in fixed], count)
        goal = poses.inverse(placed[upper]) @ T_still
        values = solve_chain(_steps(path), [joint.values(clip) for joint in path], goal)
        T_other = placed[upper] @ chain_end(_steps(path), values, count)
        check_gap(pair, T_still, T_other, f"clip '{clip.name}'", PLAYED, self._ledger)

    def _parents_first(self) -> list[str]:
        return sorted(self.links, key=lambda link: len(self._path(link, self.root)))

    def check_limits(self, name: str, low: Mapping[str, float], high: Mapping[str, float]) -> None:
        """Compare the joint limits of the file with the joint limits in a track.

        `name` is the file name of the track. `low` and `high` map joints to their limits in the track, in m or rad.
        """
        for joint in self.above.values():
            if joint.name not in low or joint.limits is None:
                continue
            lower, upper = joint.limits
            off = 0.0
            for limit, track_limit in ((lower, low[joint.name]), (upper, high[joint.name])):
                if abs(track_limit) < 1e29:  # a slide may have no limit
                    off = max(off, abs(limit - track_limit))
            if off > 1e-6:
                text = (
                    f"joint '{joint.name}' has limits {lower:g} .. {upper:g}; in {name} they are "
                    f"{low[joint.name]:g} .. {high[joint.name]:g}."
                )
                self._ledger.wrong("urdf.limits", text, joint.name, size=off)


def _steps(path: Iterable[UrdfJoint]) -> list[ChainStep]:
    return [joint.link for joint in path]


def _moving_joints(end: tuple[str, list[UrdfJoint]]) -> int:
    """Return the number of joints that can move on the path to an end of a loop."""
    _, path = end
    return len([joint for joint in path if joint.link.kind != "fixed"])


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
    name = element.get("name", "")
    kind = element.get("type", "")
    ends: list[str] = []
    for tag in ("parent", "child"):
        link = _text(element.find(tag), "link") or ""
        if link not in links:
            raise ReadError(f"joint '{name}' names link '{link}', which does not exist")
        ends.append(link)
    if kind not in KINDS:
        ledger.add("urdf.joint", "warning", f"joint '{name}' of type '{kind}' is not supported.", name)
        return None
    T = _origin(element.find("origin"))
    axis = numbers(_text(element.find("axis"), "xyz"), 3, (1, 0, 0))
    length = float(np.linalg.norm(axis))
    if abs(length - 1) > 1e-6 and KINDS[kind] not in ("fixed", "free"):
        text = f"the axis of joint '{name}' has length {length:.6g}, not 1."
        ledger.wrong("urdf.axis", text, name, size=Measured(length, 1.0))
    limit = element.find("limit")
    effort = _bound(limit, "effort")
    speed = _bound(limit, "velocity")
    limits = None
    if limit is not None and kind in ("revolute", "prismatic"):
        # Readers such as urdfdom take 0 for a limit that is not stated.
        limits = (float(limit.get("lower", "0")), float(limit.get("upper", "0")))
        if not limits[0] <= limits[1]:
            text = f"joint '{name}': lower limit {limits[0]:g} is above upper limit {limits[1]:g}."
            ledger.wrong("urdf.limits", text, name, suggestion="exchange the limits")
    mimic = None
    follows = element.find("mimic")
    if follows is not None:
        multiplier = _number(follows, "multiplier", 1.0)
        offset = _number(follows, "offset", 0.0)
        mimic = (follows.get("joint", ""), multiplier, offset)
    dynamics = element.find("dynamics")
    damping = _number(dynamics, "damping", 0.0)
    friction = _number(dynamics, "friction", 0.0)
    step = ChainStep(T, KINDS[kind], axis, name)
    soft = _soft_limits(element.find("safety_controller"), limits)
    if soft is not None and soft[0] >= soft[1]:
        text = f"joint '{name}': its soft limits and its limits have no range in common."
        ledger.wrong("urdf.limits", text, name, suggestion="write soft limits within the limits")
        soft = None
    return UrdfJoint(name, ends[0], ends[1], step, limits, effort, speed, mimic, damping, friction, soft)


def _soft_limits(safety: ET.Element | None, limits: tuple[float, float] | None) -> tuple[float, float] | None:
    """Return the soft limits of a joint, cut at its limits; None if it has none."""
    low, high = _bound(safety, "soft_lower_limit"), _bound(safety, "soft_upper_limit")
    if low is None or high is None:
        return None
    if limits is not None:
        low, high = max(low, limits[0]), min(high, limits[1])
    return low, high


def _text(element: ET.Element | None, key: str) -> str | None:
    return None if element is None else element.get(key)


def _number(element: ET.Element | None, key: str, default: float) -> float:
    return float(numbers(_text(element, key), 1, (default,))[0])


def _bound(limit: ET.Element | None, key: str) -> float | None:
    text = _text(limit, key)
    return None if text is None else float(numbers(text, 1, ())[0])


def _origin(element: ET.Element | None) -> Array:
    if element is None:
        return np.eye(4)
    R = poses.rpy(numbers(element.get("rpy"), 3, (0, 0, 0)))
    return poses.pose(R, numbers(element.get("xyz"), 3, (0, 0, 0)))


def _scale_and_pose(shape: ET.Element) -> tuple[Array, Array]:
    """Return scale (3,) and pose (4, 4) in the link of an element <visual> or <collision> with a mesh."""
    mesh = shape.find("geometry/mesh")
    return numbers(_text(mesh, "scale"), 3, (1, 1, 1)), _origin(shape.find("origin"))


def _shapes(root: ET.Element, path: Path, ledger: Ledger) -> tuple[dict[str, LinkShape], dict[str, dict[Rgba, float]]]:
    shapes: dict[str, LinkShape] = {}
    named = _materials(root)
    palette = Palette()
    checked: dict[str, tuple[Array, Array] | None] = {}
    for link in root.findall("link"):
        name = link.get("name", "")
        parts: list[LinkShape] = []
        for visual in link.findall("visual"):
            mesh = visual.find("geometry/mesh")
            if mesh is None:
                continue
            scale = numbers(mesh.get("scale"), 3, (1, 1, 1))
            solid = named_mesh(path, mesh.get("filename", ""), scale, checked, ledger, "urdf")
            if solid is None:
                continue
            part = placed_shape(solid, _origin(visual.find("origin")), "urdf")
            material = visual.find("material")
            color = None
            if material is not None:
                color = material.find("color")
                known = material.get("name") in named
                if color is None and known:
                    color = named[material.get("name")]
                if color is None and not known:
                    text = f"link '{name}' has the material '{material.get('name')}', which the file does not define."
                    advice = "define the material: readers such as urdfdom refuse the file"
                    ledger.wrong("urdf.material", text, name, suggestion=advice)
            if color is not None and part is not None:
                rgba = numbers(color.get("rgba"), 4, (1, 1, 1, 1))
                red, green, blue = linear(rgba[:3]).tolist()
                palette.add(name, (red, green, blue, float(rgba[3])), part.area)
            if part is not None:
                parts.append(part)
        shape = joined(parts)
        if shape is not None:
            shapes[name] = shape
    return shapes, palette.shares()


def _materials(root: ET.Element) -> dict[str | None, ET.Element | None]:
    """Return {name: its colour} of all materials that a file defines; None for one that has only a texture."""
    named: dict[str | None, ET.Element | None] = {}
    for material in root.iter("material"):
        if material.find("color") is not None or material.find("texture") is not None:
            named.setdefault(material.get("name"), material.find("color"))
    return named


def _masses(root: ET.Element) -> dict[str, FileMass]:
    """Return {link: mass properties} of the links with <inertial>."""
    masses: dict[str, FileMass] = {}
    for link in root.findall("link"):
        inertial = link.find("inertial")
        if inertial is None:
            masses.pop(link.get("name", ""), None)  # of two links with one name, the last counts
        else:
            masses[link.get("name", "")] = _mass(inertial)
    return masses


def _mass(inertial: ET.Element) -> FileMass:
    T = _origin(inertial.find("origin"))
    tensor = inertial.find("inertia")
    xx, xy, xz, yy, yz, zz = (_number(tensor, key, 0.0) for key in _PARTS)
    own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    R = T[:3, :3]
    return FileMass(_number(inertial.find("mass"), "value", 0.0), T[:3, 3], R @ own @ R.T)


_PARTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def _moving(root: ET.Element) -> frozenset[str]:
    """Return the names of the joints in transmissions, or with a command interface of ros2_control: the driven joints.

    If no joint is named, the file does not state which joints are driven.
    """
    names: set[str] = set()
    for transmission in root.findall("transmission"):
        names.update(_named(transmission, "joint"))
    for control in root.findall("ros2_control"):
        for joint in control.findall("joint"):
            if joint.find("command_interface") is not None:
                names.add(str(joint.get("name")))
    return frozenset(names)


def _in_order(root: ET.Element) -> list[str]:
    """Return the joints of the transmissions with one joint, in the order of the file, each once."""
    names: dict[str, None] = {}
    for transmission in root.findall("transmission"):
        joints = _named(transmission, "joint")
        if len(joints) == 1:
            names[joints[0]] = None
    return list(names)


def _named(parent: ET.Element, tag: str) -> list[str]:
    return [str(element.get("name")) for element in parent.findall(tag)]


def _tree_physics(
    links: Iterable[str], masses: dict[str, FileMass], joints: Iterable[UrdfJoint], moving: Collection[str]
) -> FilePhysics:
    out = FilePhysics(tuple(links), masses)
    for j in joints:
        T = j.link.fixed
        axis = j.link.axis
        motions: tuple[JointLine, ...] = ()
        if j.link.kind == "free":
            motions = lines_of("free", T)
        elif j.link.kind != "fixed" and axis is not None:
            motions = (JointLine(j.link.kind, T[:3, 3], unit(T[:3, :3] @ axis)),)
        low, high = j.limits or (-np.inf, np.inf)
        if j.link.kind == "slide" and max(abs(low), abs(high)) >= NO_LIMIT:
            low, high = -np.inf, np.inf
        drive = FileDrive()
        if len(motions) == 1:
            driven = j.name in moving if moving else None
            effort = _known_bound(j.effort)
            speed = _known_bound(j.speed)
            passive = (0.0, j.damping, j.friction, 0.0)
            limits = (low, high)
            control = limits if driven else None
            drive = FileDrive(limits, driven, None, None, effort, speed, passive, soft=j.soft, control=control)
        out.joints.append(FileJoint((j.name,), j.parent, j.child, T, motions, drive))
    return out


def _known_bound(bound: float | None) -> float | None:
    return None if bound is None or bound >= NO_BOUND else bound


def _check_transmissions(root: ET.Element, names: Collection[str], ledger: Ledger) -> None:
    """Report transmissions of one joint whose joint does not exist, or whose actuator is named as another joint."""
    for t in root.findall("transmission"):
        joints = _named(t, "joint")
        actuators = _named(t, "actuator")
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
    if not moving:
        return None
    out: dict[str, float] = {}
    for t in root.findall("transmission"):
        joints = _named(t, "joint")
        if len(joints) == 1:
            out[joints[0]] = float(np.prod(_reduction(t)))  # without one, it is 1
    return out


def _reduction(transmission: ET.Element) -> list[float]:
    reductions = []
    for element in transmission.iter("mechanicalReduction"):
        text = (element.text or "").strip()
        if text:  # an empty one is reported by `check_elements`
            reductions.append(float(numbers(text, 1, ())[0]))
    return reductions


def _motors(root: ET.Element) -> dict[str, FileMotor]:
    """Return the motors of <transmission> elements with one joint.

    A motor with the same name as its joint is omitted, because it represents the joint's drive.
    """
    out: dict[str, FileMotor] = {}
    for t in root.findall("transmission"):
        joints = _named(t, "joint")
        actuators = _named(t, "actuator")
        reductions = _reduction(t)
        if len(joints) == len(actuators) == len(reductions) == 1 and actuators != joints:
            out[actuators[0]] = FileMotor({joints[0]: reductions[0]})
    return out


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a URDF with its poses along the tracks, and report its faults."""
    admit(path)
    ledger.tool = "twin.exchange.audit urdf"
    ledger.version = "1"
    expanded: Expanded | None = None
    if is_xacro(path):
        try:
            expanded = expand(path, context.xacro)
        except (BudgetError, SourceError):
            raise
        except TwinError as error:
            # No consent, or no package `xacro`: only this file cannot be read, and the audit of a folder goes on.
            raise ReadError(f"{error}", "urdf.xacro") from error
        for text in expanded.omitted:
            ledger.add("urdf.xacro", "warning", text, path.name)
    return played(Urdf(path, ledger, expanded), path, ledger, context)
