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
from twin.exchange.audit.file_drives import FileDrive, FileMotor, JointDynamics
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.mechanism_data import FileMass, FileMechanism
from twin.exchange.audit.mesh_files import mesh_path, named_mesh, placed_shape
from twin.exchange.audit.meshes import joined
from twin.exchange.audit.motion_lines import JointLine, motion_lines, unit
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

_LIMIT_ROUNDING = 1e-6
"""Difference of limits and joint values in rad or m that is only rounding: files state about seven digits."""

_AXIS_ROUNDING = 1e-6
"""Difference from 1 of the length of an axis that is only rounding."""

_NO_MASS = 1.5e-6
"""Mass in kg up to which a link is a frame: simulators require a mass of links behind joints that move."""

_TRACK_UNLIMITED = 1e29
"""Absolute value from which a limit in a track means none: JSON has no infinity, so tracks state 1e30."""


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
        # A leader that the track lacks gives nothing to compute from; the track may state the joint itself.
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
        _report_duplicates("links", links, ledger)
        joint_names = [element.get("name", "") for element in root.findall("joint")]
        _report_duplicates("joints", joint_names, ledger)
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
        self._links_with_collision: set[str] = set()
        self._has_visual: dict[str, bool] = {}
        for link in root.findall("link"):
            name = str(link.get("name"))
            self._has_visual[name] = link.find("visual") is not None
            if link.find("collision") is not None:
                self._links_with_collision.add(name)
        self.content.shapes, self.content.colors = _shapes(root, path, ledger)
        check_collisions(root, ledger, lambda name: mesh_path(path, name), _scale_and_pose)
        masses = _masses(root)
        joints = {joint.name for joint in self.above.values()}
        driven = _driven_joints(root)
        closure_file = path.with_suffix(".yaml")
        self.closures = self._read_closures(closure_file, joints, driven)
        self._check_order(closure_file.name, _driven_in_order(root))
        self.content.mechanism = self._mechanism(masses, driven, closure_file.is_file())
        self.content.mechanism.robot = root.get("name", "")
        self.content.mechanism.assumed = assumed_masses(path)
        self.content.mechanism.partly_shown = partly_shown(path) | _partly_read(root)
        self.content.mechanism.motors = _motors(root)
        self.content.mechanism.reductions = _reductions(root, driven)
        self.content.mechanism.program_settings = program_settings(root)
        _check_transmissions(root, joints, ledger)
        self._check_home(closure_file.name)
        if closure_file.is_file():
            self._check_loop_ends(closure_file.name)

    def _attach(self, joint: UrdfJoint) -> None:
        first = self.above.get(joint.child)
        if first is None:
            self.above[joint.child] = joint
            return
        text = (
            f"link '{joint.child}' is the child of two joints, {first.name} and {joint.name}, but a URDF must be a "
            "tree."
        )
        self._ledger.wrong("urdf.tree", text, joint.child)

    def _read_closures(self, file: Path, joints: Collection[str], driven: frozenset[str]) -> FileClosures:
        """Return the content of a closure YAML, if there is one; its driven joints must be the joints `driven`."""
        closures = None
        if file.is_file():
            closures = read_closures(file, self.links, joints, self._ledger)
        if closures is None:
            return FileClosures()
        driven_in_yaml = frozenset(closures.driven)
        if driven != driven_in_yaml:
            differing = ", ".join(sorted(driven ^ driven_in_yaml))
            text = f"the transmissions and 'name_mot' of {file.name} do not name the same driven joints: {differing}."
            self._ledger.wrong("urdf.driven", text, differing)
        return closures

    def _check_order(self, name: str, listed: Sequence[str]) -> None:
        """Report driven joints that the closure YAML `name` has in another order than the transmissions, `listed`.

        Readers of the YAML count the values of the motors in this order.
        """
        # Joints that only one of the two has are reported by `_read_closures`.
        order = [joint for joint in self.closures.driven if joint in listed]
        expected = [joint for joint in listed if joint in order]
        if order == expected:
            return
        start = 0  # the first place that differs
        while order[start : start + 1] == expected[start : start + 1]:
            start += 1
        text = (
            f"'name_mot' of {name} has the driven joints in another order than the transmissions: "
            f"{', '.join(order[start:])}, expected {', '.join(expected[start:])}."
        )
        self._ledger.wrong("urdf.driven_order", text, order[start], suggestion="export the URDF and its YAML together")

    def _mechanism(self, masses: dict[str, FileMass], driven: Collection[str], has_closure_file: bool) -> FileMechanism:
        loop_ends: set[str] = set()
        for first, second, _ in self.closures.pairs:
            loop_ends.update((first, second))
        # The ends of loops are frames, unless they have a shape: they are no links of the mechanism.
        bodies = [link for link in self.links if link not in loop_ends or link in self.content.shapes]
        mechanism = _tree_mechanism(bodies, masses, self.above.values(), driven)
        shown: dict[str, bool] = {}
        for link in bodies:
            shown[link] = self._has_visual[link]
        mechanism.shown = shown
        mechanism.collides = dict.fromkeys(self._links_with_collision & set(bodies), True)
        mechanism.joints += self.closures.joints()
        couplings: dict[str, tuple[Mapping[str, float], float]] = {}
        for joint in self.above.values():
            if joint.mimic is not None:
                leader, multiplier, offset = joint.mimic
                couplings[f"{joint.name}_mimic"] = ({joint.name: 1.0, leader: -multiplier}, offset)
        if self.closures.couplings is not None:
            couplings |= dict(self.closures.couplings)
        mechanism.couplings = couplings
        mechanism.home = self.closures.home or None
        mechanism.couples_pairs = not has_closure_file  # a mimic couples two joints; the YAML any number
        return mechanism

    def _check_home(self, name: str) -> None:
        """Report loops that are open, and joints outside their limits, at `home` of the closure YAML `name`."""
        home = self.closures.home
        if not home:
            return
        for joint in self.above.values():
            if joint.name in home and joint.limits is not None:
                low, high = joint.limits
                if not low - _LIMIT_ROUNDING <= home[joint.name] <= high + _LIMIT_ROUNDING:
                    text = (
                        f"{name}: joint '{joint.name}' is at {home[joint.name]:g} at home, outside its limits "
                        f"{low:g} .. {high:g}."
                    )
                    self._ledger.wrong("urdf.limits", text, joint.name)
        for pair in self.closures.pairs:
            T_first = self._link_pose(pair[0], home)
            T_second = self._link_pose(pair[1], home)
            check_gap(pair, T_first, T_second, f"{name}, home", CLOSED, self._ledger)

    def _check_loop_ends(self, name: str) -> None:
        """Report two links that look like the ends <joint>_a and <joint>_b of a loop, but of none in the YAML `name`.

        Only a YAML whose loops all have such ends is judged: others may name links in any way.
        """
        ends: set[str] = set()
        for first, second, _ in self.closures.pairs:
            if not first.endswith("_a") or second != f"{first.removesuffix('_a')}_b":
                return
            ends.update((first, second))
        parents = {joint.parent for joint in self.above.values()}
        for first in self.links:
            second = f"{first.removesuffix('_a')}_b"
            if not first.endswith("_a") or second not in self.links or {first, second} & (ends | parents):
                continue
            if self._is_part(first) or self._is_part(second):
                continue
            text = f"{name} closes no loop between links '{first}' and '{second}', which have no other purpose."
            advice = "add the two links to 'closed_loop', and their type; or remove them from the URDF"
            self._ledger.wrong("urdf.loop_missing", text, first.removesuffix("_a"), suggestion=advice)

    def _is_part(self, link: str) -> bool:
        """Return whether a link has a shape, or more mass than the 1 mg that stands for none."""
        masses = {} if self.content.mechanism is None else self.content.mechanism.masses
        return link in self.content.shapes or (link in masses and masses[link].mass > _NO_MASS)

    def _link_pose(self, link: str, values: Mapping[str, float]) -> Array:
        """Return the pose (1, 4, 4) of a link in the frame of the root at joint values; other joints are at zero."""
        path = self._path(link, self.root)
        path_values: list[Array] = []
        for joint in path:
            path_values.append(np.array([values.get(joint.name, 0.0)]))
        return chain_end(_steps(path), path_values, 1)

    def _path(self, link: str, stop: str) -> list[UrdfJoint]:
        """Return the joints on the path from the ancestor `stop` to the link `link`, starting at `stop`."""
        upwards: list[UrdfJoint] = []
        while link != stop:
            if link not in self.above or len(upwards) > len(self.above):
                raise ReadError(f"link '{link}' is its own ancestor")
            upwards.append(self.above[link])
            link = upwards[-1].parent
        return upwards[::-1]

    def play(self, clip: FileClip) -> FileClip:
        """Return a clip of the link poses T_world_link (k, 4, 4), computed from the joint values of `clip`."""
        count = len(clip.times)
        link_poses: dict[str, Array] = {}
        link_poses[self.root] = clip.links.get(self.root, np.broadcast_to(np.eye(4), (count, 4, 4)))
        for name in self._parents_first():
            if name not in clip.links or name == self.root:
                continue
            ancestor, path = self._path_from(name, link_poses)
            if any(joint.link.kind == "free" for joint in path):  # every pose of the link is a pose of the joint
                link_poses[name] = clip.links[name]
                continue
            # Values that the track lacks are computed from the pose of the link in the track.
            goal = poses.inverse(clip.links.get(ancestor, link_poses[ancestor])) @ clip.links[name]
            values = solve_chain(_steps(path), _values(path, clip), goal)
            link_poses[name] = link_poses[ancestor] @ chain_end(_steps(path), values, count)
        for pair in self.closures.pairs:
            self._check_loop(pair, link_poses, clip)
        # The root and links in between may have no pose in the clip, and then nothing is compared with theirs.
        links = {link: T for link, T in link_poses.items() if link in clip.links}
        return FileClip(clip.name, clip.times, links)

    def _path_from(self, link: str, placed: Collection[str]) -> tuple[str, list[UrdfJoint]]:
        """Return (nearest ancestor in `placed`, joints on the path from it to the link)."""
        path: list[UrdfJoint] = []
        while not path or link not in placed:
            path.append(self.above[link])
            link = path[-1].parent
        return link, path[::-1]

    def _check_loop(self, pair: tuple[str, str, str], link_poses: Mapping[str, Array], clip: FileClip) -> None:
        """Report a loop that is open at a key of a clip; `link_poses` contains poses (k, 4, 4) of links in this clip.

        Joint values that the clip lacks are those that close the loop best.
        """
        ends: list[tuple[str, list[UrdfJoint]]] = []
        for link in pair[:2]:
            if link in link_poses:
                ends.append((link, []))
            else:
                ends.append(self._path_from(link, link_poses))
        # The end with more joints is fitted to the other one, because it has more values to choose.
        ends.sort(key=_moving_joints)
        (goal_link, goal_path), (ancestor, path) = ends
        count = len(clip.times)
        T_goal = link_poses[goal_link] @ chain_end(_steps(goal_path), _values(goal_path, clip), count)
        values = solve_chain(_steps(path), _values(path, clip), poses.inverse(link_poses[ancestor]) @ T_goal)
        T_fitted = link_poses[ancestor] @ chain_end(_steps(path), values, count)
        check_gap(pair, T_goal, T_fitted, f"clip '{clip.name}'", PLAYED, self._ledger)

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
            difference = 0.0
            for limit, track_limit in ((lower, low[joint.name]), (upper, high[joint.name])):
                if abs(track_limit) < _TRACK_UNLIMITED:
                    difference = max(difference, abs(limit - track_limit))
            if difference > _LIMIT_ROUNDING:
                text = (
                    f"joint '{joint.name}' has limits {lower:g} .. {upper:g}; in {name} they are "
                    f"{low[joint.name]:g} .. {high[joint.name]:g}."
                )
                self._ledger.wrong("urdf.limits", text, joint.name, size=difference)


def _steps(path: Iterable[UrdfJoint]) -> list[ChainStep]:
    return [joint.link for joint in path]


def _values(path: Iterable[UrdfJoint], clip: FileClip) -> list[Array | None]:
    """Return the values (k,) in a clip of each joint on a path; None for joints without values."""
    return [joint.values(clip) for joint in path]


def _report_duplicates(kind: str, names: Sequence[str], ledger: Ledger) -> None:
    """Report the alphabetically first name that several elements have; `kind` is their plural noun."""
    duplicates = {name for name in names if names.count(name) > 1}
    if duplicates:
        name = min(duplicates)
        ledger.wrong("urdf.duplicate_name", f"two {kind} are named '{name}'.", name)


def _moving_joints(end: tuple[str, list[UrdfJoint]]) -> int:
    """Return the number of joints that can move on the path to an end of a loop."""
    _, path = end
    count = 0
    for joint in path:
        if joint.link.kind != "fixed":
            count += 1
    return count


def _partly_read(root: ET.Element) -> frozenset[str]:
    """Return the names of links that have no collision shape, or a visual shape that is not a mesh and is not read."""
    names = set()
    for link in root.findall("link"):
        is_partly_read = link.find("collision") is None
        for visual in link.findall("visual"):
            if visual.find("geometry/mesh") is None:
                is_partly_read = True
        if is_partly_read:
            names.add(link.get("name", ""))
    return frozenset(names)


def numbers(text: str | None, n: int, default: tuple[float, ...]) -> Array:
    """Return n finite numbers from the text of an attribute; the default if the text is None.

    Raises:
        ReadError: the text does not consist of n finite numbers.
    """
    if text is None:
        return np.array(default, float)
    try:
        values = np.array(text.split(), float)
    except ValueError as error:
        raise ReadError(f"'{text[:40]}' is not a list of numbers") from error
    if values.shape != (n,) or not np.all(np.isfinite(values)):
        raise ReadError(f"'{text[:40]}' is not a list of {n} finite numbers")
    return values


def _joint(element: ET.Element, links: list[str], ledger: Ledger) -> UrdfJoint | None:
    name = element.get("name", "")
    kind = element.get("type", "")
    ends: list[str] = []
    for tag in ("parent", "child"):
        link = _text(element.find(tag), "link") or ""
        if link not in links:
            raise ReadError(f"joint '{name}' names link '{link}', which does not exist")
        ends.append(link)
    if kind not in KINDS:  # a planar joint, for example, moves along two axes
        ledger.add("urdf.joint", "warning", f"joint '{name}' of type '{kind}' is not supported.", name)
        return None
    T = _origin(element.find("origin"))
    axis = numbers(_text(element.find("axis"), "xyz"), 3, (1, 0, 0))
    length = float(np.linalg.norm(axis))
    if abs(length - 1) > _AXIS_ROUNDING and KINDS[kind] not in ("fixed", "free"):
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
    mimic_element = element.find("mimic")
    if mimic_element is not None:
        multiplier = _number(mimic_element, "multiplier", 1.0)
        offset = _number(mimic_element, "offset", 0.0)
        mimic = (mimic_element.get("joint", ""), multiplier, offset)
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
    low = _bound(safety, "soft_lower_limit")
    high = _bound(safety, "soft_upper_limit")
    if low is None or high is None:
        return None
    if limits is not None:
        low = max(low, limits[0])
        high = min(high, limits[1])
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
    """Return ({link: its shape}, {link: {colour: share of its surface}}) of the visual meshes; report missing ones."""
    shapes: dict[str, LinkShape] = {}
    materials = _materials(root)
    palette = Palette()
    meshes: dict[str, tuple[Array, Array] | None] = {}  # links may share mesh files, which are read once
    for link in root.findall("link"):
        name = link.get("name", "")
        parts: list[LinkShape] = []
        for visual in link.findall("visual"):
            mesh = visual.find("geometry/mesh")
            if mesh is None:
                continue
            scale = numbers(mesh.get("scale"), 3, (1, 1, 1))
            triangles = named_mesh(path, mesh.get("filename", ""), scale, meshes, ledger, "urdf")
            if triangles is None:
                continue
            part = placed_shape(triangles, _origin(visual.find("origin")), "urdf")
            color = _color(name, visual.find("material"), materials, ledger)
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


def _color(
    link: str, material: ET.Element | None, materials: Mapping[str | None, ET.Element | None], ledger: Ledger
) -> ET.Element | None:
    """Return the <color> of a visual shape of a link: its own, or that of its material's name in `materials`."""
    if material is None:
        return None
    color = material.find("color")
    if color is not None:
        return color
    name = material.get("name")
    if name in materials:
        return materials[name]
    text = f"link '{link}' has the material '{name}', which the file does not define."
    advice = "define the material: readers such as urdfdom refuse the file"
    ledger.wrong("urdf.material", text, link, suggestion=advice)
    return None


def _materials(root: ET.Element) -> dict[str | None, ET.Element | None]:
    """Return {name: its colour} of all materials that a file defines; None for one that has only a texture."""
    materials: dict[str | None, ET.Element | None] = {}
    for material in root.iter("material"):
        if material.find("color") is not None or material.find("texture") is not None:
            materials.setdefault(material.get("name"), material.find("color"))
    return materials


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
    """Return mass, centre of mass and inertia tensor about it, both in the frame of the link."""
    T_link_com = _origin(inertial.find("origin"))
    tensor = inertial.find("inertia")
    xx = _number(tensor, "ixx", 0.0)
    xy = _number(tensor, "ixy", 0.0)
    xz = _number(tensor, "ixz", 0.0)
    yy = _number(tensor, "iyy", 0.0)
    yz = _number(tensor, "iyz", 0.0)
    zz = _number(tensor, "izz", 0.0)
    stated = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    # URDF states the tensor along the axes of <origin>; files of other formats have it along those of the link.
    R = T_link_com[:3, :3]
    return FileMass(_number(inertial.find("mass"), "value", 0.0), T_link_com[:3, 3], R @ stated @ R.T)


def _driven_joints(root: ET.Element) -> frozenset[str]:
    """Return the names of the joints in transmissions, or with a command interface of ros2_control: the driven joints.

    If no joint is named, the file does not state which joints are driven.
    """
    names: set[str] = set()
    for transmission in root.findall("transmission"):
        names.update(_names(transmission, "joint"))
    for control in root.findall("ros2_control"):
        for joint in control.findall("joint"):
            if joint.find("command_interface") is not None:
                names.add(str(joint.get("name")))
    return frozenset(names)


def _driven_in_order(root: ET.Element) -> list[str]:
    """Return the joints of the transmissions with one joint, in the order of the file, each once."""
    names: dict[str, None] = {}
    for transmission in root.findall("transmission"):
        joints = _names(transmission, "joint")
        if len(joints) == 1:
            names[joints[0]] = None
    return list(names)


def _names(parent: ET.Element, tag: str) -> list[str]:
    """Return the names of the child elements with a tag."""
    return [str(element.get("name")) for element in parent.findall(tag)]


def _tree_mechanism(
    links: Iterable[str], masses: dict[str, FileMass], joints: Iterable[UrdfJoint], driven: Collection[str]
) -> FileMechanism:
    """Return links, masses and joints of the tree; `driven` is empty if the file does not state what is driven."""
    mechanism = FileMechanism(tuple(links), masses)
    for joint in joints:
        kind = joint.link.kind
        T_parent_joint = joint.link.fixed
        axis = joint.link.axis
        motions: tuple[JointLine, ...] = ()
        if kind == "free":
            motions = motion_lines("free", T_parent_joint)
        elif kind != "fixed" and axis is not None:
            motions = (JointLine(kind, T_parent_joint[:3, 3], unit(T_parent_joint[:3, :3] @ axis)),)
        drive = FileDrive()
        if len(motions) == 1:
            limits = joint.limits or (-np.inf, np.inf)
            if kind == "slide" and max(map(abs, limits)) >= NO_LIMIT:
                limits = (-np.inf, np.inf)
            is_driven = joint.name in driven if driven else None
            effort = _known_bound(joint.effort)
            speed = _known_bound(joint.speed)
            joint_dynamics = JointDynamics(damping=joint.damping, friction=joint.friction)
            control = limits if is_driven else None
            drive = FileDrive(
                limits=limits,
                driven=is_driven,
                effort=effort,
                speed=speed,
                joint_dynamics=joint_dynamics,
                soft=joint.soft,
                control=control,
            )
        mechanism.joints.append(FileJoint((joint.name,), joint.parent, joint.child, T_parent_joint, motions, drive))
    return mechanism


def _known_bound(bound: float | None) -> float | None:
    return None if bound is None or bound >= NO_BOUND else bound


def _check_transmissions(root: ET.Element, names: Collection[str], ledger: Ledger) -> None:
    """Report transmissions of one joint whose joint does not exist, or whose actuator is named as another joint."""
    for transmission in root.findall("transmission"):
        joints = _names(transmission, "joint")
        actuators = _names(transmission, "actuator")
        label = str(transmission.get("name"))
        if len(joints) != 1 or len(actuators) != 1:
            continue
        if joints[0] not in names:
            text = f"transmission '{label}' names joint '{joints[0]}', which does not exist."
            ledger.wrong("urdf.transmission", text, label)
        elif actuators[0] != joints[0] and actuators[0] in names:
            text = f"transmission '{label}': actuator '{actuators[0]}' drives '{joints[0]}', not the joint of its name."
            advice = "let the actuator drive the joint of its name, or rename it"
            ledger.wrong("urdf.transmission", text, joints[0], suggestion=advice)


def _reductions(root: ET.Element, driven: Collection[str]) -> dict[str, float] | None:
    """Return {joint: reduction} of the transmissions with one joint; None if the file states no driven joint."""
    if not driven:
        return None
    reductions: dict[str, float] = {}
    for transmission in root.findall("transmission"):
        joints = _names(transmission, "joint")
        if len(joints) == 1:
            reductions[joints[0]] = float(np.prod(_stated_reductions(transmission)))  # without one, it is 1
    return reductions


def _stated_reductions(transmission: ET.Element) -> list[float]:
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
    motors: dict[str, FileMotor] = {}
    for transmission in root.findall("transmission"):
        joints = _names(transmission, "joint")
        actuators = _names(transmission, "actuator")
        reductions = _stated_reductions(transmission)
        if len(joints) == len(actuators) == len(reductions) == 1 and actuators != joints:
            motors[actuators[0]] = FileMotor({joints[0]: reductions[0]})
    return motors


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
