"""Read one model of an SDF file. If two joints have the same child link, the second joint closes a loop.

Poses are resolved with `relative_to` and the frames of the model. Nested models and includes are part of the model.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from twin.core import spatial
from twin.core.errors import MechanismError, NoMechanismError, SourceError, UnsupportedError, unknown
from twin.core.identifiers import identifier
from twin.core.spatial import Array
from twin.exchange.formats.sdf.read.flat_model import robot_of
from twin.exchange.formats.sdf.read.left_out import find_left_out
from twin.exchange.formats.sdf.read.poses import ModelPoses
from twin.exchange.read.imported_robot import (
    Findings,
    Imported,
    Names,
    Options,
    assemble,
    limits,
    pose_along,
    possible_inertia,
    stated_gravity,
)
from twin.exchange.read.shapes import (
    SIZE_ATTRIBUTES,
    Color,
    link_meshes,
    mesh_file,
    placed_mesh,
    shows_all,
    sized_primitive,
    stated_color,
)
from twin.exchange.read.xml_file import Xml
from twin.model.body import Body, Frame, Mesh
from twin.model.inertia import Inertia
from twin.model.joint import Joint, JointType
from twin.model.mechanism import EARTH, WORLD, Coupling, Mechanism

TYPES: dict[str, JointType] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "ball": "spherical",
    "fixed": "fixed",
}
"""Joint types of SDF that a mechanism can express."""

_OTHER_TYPES = ("revolute2", "universal", "screw", "gearbox", "piston")
"""Joint types of SDF that a mechanism cannot express."""

_UNLIMITED = 1e16
"""Magnitude in m or rad from which a limit means "no limit" in SDF."""

_POSE_ROUNDING = 1e-12
"""Difference of equal poses, in m and in entries of rotation matrices, that is only rounding."""


def read_sdf(path: Path, root: str | None = None) -> Imported:
    """Read an SDF file.

    If several models have joints, `root` is the name of the model to read.

    Raises:
        SourceError: the file is invalid or unsupported; the message names file, element and fault.
    """
    return _Sdf(path, root).read()


class _Sdf:
    """Reader of one model of a file.

    Attributes:
        model: the model to read, flat: with the content of nested models and includes.
        links, elements: {name: element} of the links, and of links, joints and frames.
        poses: the poses of these elements in the model.
        efforts: {joint: maximum effort in N or N m}.
        shape_counts: {name of the first mesh of a link: number of meshes that have it, without or with a number}.
    """

    def __init__(self, path: Path, root: str | None) -> None:
        self.xml = Xml(path, "sdf")
        self.path = path
        self.findings = Findings()
        self.efforts: dict[str, float] = {}
        self.shape_counts: dict[str, int] = {}
        self.model = robot_of(self.xml, root, self.findings)

    def read(self) -> Imported:
        links = self.xml.named(self.model, "link")
        joints = self.xml.named(self.model, "joint")
        frame_elements = self.xml.named(self.model, "frame")
        if not links:
            text = f"{self.path}: the model has no <link>, so there is no mechanism"
            if joints:
                raise SourceError(text)
            raise NoMechanismError(text)
        self.links = links
        # before SDF 1.7, a joint may have the name of a link: where a pose refers to the name, it is the link
        self.elements = {**frame_elements, **joints, **links}
        self.poses = ModelPoses(self.xml, self.model, links, self.elements, self.findings)
        body_names = Names("link", links, self.findings, reserved=(WORLD,))
        joint_names = Names("joint", joints, self.findings)
        mechanism_joints: list[Joint] = []
        for name, element in joints.items():
            mechanism_joints.append(self._joint(name, joint_names[name], element, body_names))
        parents = {joint.parent for joint in mechanism_joints}
        is_grounded = WORLD in parents
        if is_grounded and WORLD in links:
            self.xml.fail("link 'world'", "the name 'world' is reserved for the world")
        base = WORLD
        if not is_grounded:
            root = self._base(mechanism_joints, body_names)
            mount = self._mount(root, body_names, set(joint_names.values()))
            if mount is None:
                base = root
            else:
                # First, so that it is in the tree: a loop of the model must not be closed at its mount.
                mechanism_joints.insert(0, mount)
                is_grounded = True
        bodies: list[Body] = []
        if is_grounded:
            bodies.append(Body(WORLD))
        for name, link in links.items():
            bodies.append(self._body(name, body_names[name], link))
        frames = self._frames(frame_elements, body_names)
        couplings: list[Coupling] = []
        for name, joint in joints.items():
            coupling = self._mimic(name, joint, joint_names)
            if coupling is not None:
                couplings.append(coupling)
        followers = {coupling.joints[0] for coupling in couplings}
        mechanism_joints = self._with_driven_joints(mechanism_joints, base, followers, joint_names)
        self.findings += find_left_out(self.model, self.xml)
        for text in self.xml.repaired:
            self.findings.warn("xml", text, self.path.name)
        efforts: dict[str, float] = {}
        for name, effort in self.efforts.items():
            efforts[joint_names[name]] = effort
        robot = self.model.get("name") or self.path.stem
        imported = assemble(
            self.path, robot, base, bodies, mechanism_joints, frames, couplings, self.findings, efforts=efforts
        )
        mechanism = replace(imported.mechanism, gravity=self._gravity())
        unlimited = set()
        for name, joint in joints.items():
            if joint.get("type") == "continuous":
                unlimited.add(joint_names[name])
        return replace(imported, mechanism=mechanism, unlimited=frozenset(unlimited))

    def _body(self, name: str, body: str, link: Element) -> Body:
        """Return the body of a link, with the identifier `body`."""
        meshes = link_meshes(name, link, self._shapes, self.findings)
        inertia = self._inertia(name, link)
        return Body(body, tuple(meshes), inertia, shows_all(link, len(meshes)))

    def _frames(self, frame_elements: dict[str, Element], body_names: Names) -> list[Frame]:
        """Return the frames of the model. Frames that only mark a merged model are hidden, so they are left out."""
        visible_frames = [name for name, element in frame_elements.items() if not element.get("hidden")]
        names = Names("frame", visible_frames, self.findings)
        frames: list[Frame] = []
        for frame in visible_frames:
            link = self.poses.carrier(frame)
            T_link_frame = spatial.inverse(self.poses.in_model(link)) @ self.poses.in_model(frame)
            frames.append(Frame(names[frame], body_names[link], T_link_frame))
        return frames

    def _gravity(self) -> tuple[float, float, float]:
        """Return the gravity of the world in m/s2; that of the earth if the file states none."""
        text = self.xml.root.findtext("world/gravity")
        return stated_gravity(self.xml.numbers("world", "gravity", text, 3, EARTH), self.findings)

    def _mount(self, root: str, names: Names, taken_names: set[str]) -> Joint | None:
        """Return the joint from the world to the link `root`, in a model without a joint to the world.

        The model floats, unless it is static. None for a static model whose link `root` is at the origin of the
        world. `taken_names` are the names of the other joints.
        """
        link_of = {names[link]: link for link in self.links}
        T_world_link = self.poses.T_world_model @ self.poses.in_model(link_of[root])
        is_static = (self.model.findtext("static") or "").strip() in ("true", "1")
        # A product of poses has rounding errors of about 1e-16.
        if is_static and np.allclose(T_world_link, np.eye(4), rtol=0.0, atol=_POSE_ROUNDING):
            return None
        kind: JointType = "fixed" if is_static else "free"
        suffix = "mount" if is_static else "free"
        name = f"{root}_{suffix}"
        while name in taken_names:
            name += "_1"
        if not is_static:
            text = f"no joint fixes link '{root}' to the world: the robot floats, by joint '{name}'."
            self.findings.warn("free", text, root)
        return Joint(name, kind, WORLD, root, T_world_link)

    def _with_driven_joints(self, joints: list[Joint], base: str, followers: set[str], names: Names) -> list[Joint]:
        """Return the joints, with `active` set to True for the driven joints.

        If plug-ins name driven joints, only these joints are driven. Otherwise, all joints are driven except followers
        (`mimic`) and joints that close a loop.
        """
        plugin_joints = self._plugin_joints(names)
        closing_joints = self._loop_closing_joints(joints, base)
        driven = plugin_joints
        if not plugin_joints:
            driven = {joint.name for joint in joints} - closing_joints
        joints_with_drives: list[Joint] = []
        for joint in joints:
            active = joint.active and joint.name in driven and joint.name not in followers
            if active and joint.name in closing_joints:
                fault = "the joint is driven, but closes a loop: list it before the passive joints"
                self.xml.refuse(f"joint '{joint.name}'", fault)
            joints_with_drives.append(replace(joint, active=active))
        if closing_joints and not plugin_joints:
            listed = ", ".join(sorted(closing_joints))
            text = f"no plug-in names a driven joint: all joints are driven except {listed}, which close loops."
            self.findings.warn("driven", text, base)
        return joints_with_drives

    def _plugin_joints(self, names: Names) -> set[str]:
        """Return the joints that plug-ins of the model drive."""
        plugged: set[str] = set()
        for plugin in self.model.iter("plugin"):
            for element in plugin.iter("joint_name"):
                joint = (element.text or "").strip()
                if joint and joint in names:
                    plugged.add(names[joint])
        return plugged

    def _loop_closing_joints(self, joints: list[Joint], base: str) -> set[str]:
        """Return the joints that close loops of the mechanism made of these joints, if none of them is driven."""
        # A dictionary keeps the order in which bodies occur first: the order decides which joints close the loops.
        bodies = {base: Body(base)}
        passive: list[Joint] = []
        for joint in joints:
            bodies.setdefault(joint.parent, Body(joint.parent))
            bodies.setdefault(joint.child, Body(joint.child))
            passive.append(replace(joint, active=False))
        try:
            mechanism = Mechanism("m", base, tuple(bodies.values()), tuple(passive))
            return {joint.name for joint in mechanism.loops}
        except MechanismError as error:
            raise SourceError(f"{self.path}: {error}") from error

    def _mimic(self, name: str, joint: Element, names: Names) -> Coupling | None:
        """Return the coupling of a joint that follows another: q = multiplier (leader - reference) + offset."""
        where = f"joint '{name}', mimic"
        element = joint.find("axis/mimic")
        if element is None:
            return None
        leader = element.get("joint") or ""
        if leader not in names:
            joints = [name for name in self.elements if name in names]
            self.xml.fail(where, unknown("joint", leader, joints))
        if leader == name:
            self.xml.fail(where, "the joint mimics itself: name another joint, or remove the mimic")
        if element.get("axis", "axis") != "axis":
            self.xml.refuse(where, "the joint mimics a second axis, which is not supported")
        ratio = self.xml.number(where, "multiplier", element.findtext("multiplier"), 1.0)
        offset = self.xml.number(where, "offset", element.findtext("offset"), 0.0)
        reference = self.xml.number(where, "reference", element.findtext("reference"), 0.0)
        if ratio == 0:
            self.xml.refuse(where, "mimic multiplier is 0; use a fixed joint")
        total = offset - ratio * reference
        follower = names[name]
        return Coupling(f"{follower}_mimic", (follower, names[leader]), (1.0, -ratio), total)

    def _base(self, joints: list[Joint], names: Names) -> str:
        children = {joint.child for joint in joints}
        roots: list[str] = []
        for link in self.links:
            body = names[link]
            if body not in children:
                roots.append(body)
        if not roots:
            raise SourceError(f"{self.path}: expected one base link, found none: the joints form a cycle")
        if len(roots) > 1:  # bodies of a SDF need no joint
            raise UnsupportedError(f"{self.path}: expected one base link, found {', '.join(roots)}")
        return roots[0]

    def _joint(self, name: str, label: str, joint: Element, names: Names) -> Joint:
        where = f"joint '{name}'"
        kind = joint.get("type")
        if kind in _OTHER_TYPES:
            self.xml.refuse(where, unknown("joint type", str(kind), TYPES))
        if kind not in TYPES:
            self.xml.fail(where, unknown("joint type", str(kind), TYPES))
        parent = self._end_link(where, joint, "parent")
        child = self._end_link(where, joint, "child")
        if child == "world":
            self.xml.fail(where, "the child of the joint is the world: exchange parent and child")
        T_model_joint = self.poses.of_joint(name, joint)
        values: dict = {}
        if kind in ("revolute", "continuous", "prismatic"):
            T_model_joint, values = self._axis(name, where, kind, joint, T_model_joint)
        T_parent_joint = spatial.inverse(self.poses.in_model(parent)) @ T_model_joint
        T_child_joint = spatial.inverse(self.poses.in_model(child)) @ T_model_joint
        parent_body = parent if parent == "world" else names[parent]
        return Joint(label, TYPES[kind], parent_body, names[child], T_parent_joint, T_child_joint, **values)

    def _end_link(self, where: str, joint: Element, end: str) -> str:
        """Return the link at an end of a joint, `parent` or `child`; "world" is the world."""
        link = (joint.findtext(end) or "").strip()
        if link == "world":
            return link
        if link not in self.elements:
            self.xml.fail(f"{where}, {end}", unknown("link", link, self.links))
        return self.poses.carrier(link)

    def _axis(self, name: str, where: str, kind: str, joint: Element, T: Array) -> tuple[Array, dict]:
        axis = joint.find("axis")
        if axis is None:
            axis = Element("axis")
        xyz = axis.find("xyz")
        components = None
        expressed = None
        if xyz is not None:
            # Not `findtext`: for an element without text it returns "", and the default would not be used.
            components = xyz.text
            expressed = xyz.get("expressed_in")
        direction = self.xml.axis(where, "axis xyz", components, (0, 0, 1))
        if expressed:
            R_joint_model = T[:3, :3].T
            direction = R_joint_model @ self.poses.in_model(expressed)[:3, :3] @ direction
        values: dict = {"active": True}
        low = None
        high = None
        if kind != "continuous":
            low = self._bound(where, axis, "lower")
            high = self._bound(where, axis, "upper")
        values["limits"] = limits(self.path, low, high, name, self.findings)
        speed = self.xml.number(where, "velocity", axis.findtext("limit/velocity"), 0.0)
        effort = self.xml.number(where, "effort", axis.findtext("limit/effort"), 0.0)
        # SDF: a negative speed or effort is not enforced; 0, as templates have it, would lock the joint.
        if 0 < speed < _UNLIMITED:
            values["max_speed"] = speed
        if 0 < effort < _UNLIMITED:
            self.efforts[name] = effort
        return T @ pose_along(direction), values

    def _bound(self, where: str, axis: Element, key: str) -> float | None:
        """Return the limit `lower` or `upper` of an axis in rad or m; None if the axis is unlimited on this side."""
        text = axis.findtext(f"limit/{key}")
        if text is None:
            return None
        magnitude = text.strip().lstrip("-+").lower()
        # `Xml.number` refuses numbers that are not finite.
        if magnitude in ("inf", "infinity"):
            return None
        value = self.xml.number(where, key, text)
        return value if abs(value) < _UNLIMITED else None

    def _inertia(self, name: str, link: Element) -> Inertia | None:
        where = f"link '{name}'"
        element = link.find("inertial")
        if element is None:
            return None
        if element.get("auto") in ("true", "1"):
            text = f"{where}: its mass is to be computed from its colliders (auto): the link is imported without mass."
            self.findings.warn("inertia", text, name)
            return None
        pose = element.find("pose")
        if pose is not None and pose.get("relative_to"):
            frame = pose.get("relative_to")
            text = f"{where}: the pose of its <inertial> is read in the link, although it is relative to '{frame}'."
            self.findings.warn("pose", text, name)
        T_link_com = self.poses.stated(element, where)
        # The defaults of the SDF specification: a mass of 1 kg, and 1 kg m2 about each axis.
        tensor = self.xml.tensor(where, lambda key: element.findtext(f"inertia/{key}"), np.eye(3))
        mass = self.xml.number(where, "mass", element.findtext("mass"), 1.0)
        R = T_link_com[:3, :3]
        inertia = Inertia(mass, T_link_com[:3, 3], R @ tensor @ R.T)
        return possible_inertia(inertia, name, self.findings)

    def _shapes(self, name: str, elements: list[Element]) -> list[Mesh]:
        """Return the shapes that can be read of the <visual> or <collision> elements of a link."""
        where = f"link '{name}'"
        meshes: list[Mesh] = []
        for element in elements:
            geometry = element.find("geometry")
            if geometry is None or not len(geometry):
                self.xml.fail(where, f"a <{element.tag}> has no shape in a <geometry>")
            shape = geometry[0]
            triangle_mesh = None
            if shape.tag == "mesh":
                scale = self.xml.numbers(where, "mesh scale", shape.findtext("scale"), 3, (1, 1, 1))
                uri = (shape.findtext("uri") or "").strip()
                triangle_mesh = mesh_file(uri, self.path.parent, scale, name, self.findings)
                if shape.find("submesh") is not None:
                    text = f"{where}: the whole mesh {uri} is shown, although only its <submesh> is stated."
                    self.findings.warn("shape", text, name)
            elif shape.tag in SIZE_ATTRIBUTES:
                triangle_mesh = sized_primitive(self.xml, where, shape.tag, shape.findtext, self.findings)
            else:
                self.findings.warn("shape", f"{where}: a <{shape.tag}> is not shown.", name)
            if triangle_mesh is None:
                continue
            vertices, triangles = triangle_mesh
            stem = identifier(f"{name}_shape")
            # Counted over all links, because different names of links may become the same identifier.
            number = self.shape_counts.get(stem, 0) + 1
            self.shape_counts[stem] = number
            label = stem if number == 1 else f"{stem}_{number}"
            color = self._color(element, where)
            meshes.append(placed_mesh(label, vertices, triangles, self.poses.in_link(name, element), color))
        return meshes

    def _color(self, element: Element, where: str) -> Color:
        """Return the colour of a <visual>; its transparency reduces the alpha."""
        red, green, blue, alpha = stated_color(element.findtext("material/diffuse"), where, self.findings)
        transparency = self.xml.number(where, "transparency", element.findtext("transparency"), 0.0)
        alpha *= 1.0 - transparency
        return (red, green, blue, min(max(alpha, 0.0), 1.0))


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of an SDF file; see `read_sdf`."""
    return read_sdf(path, options.root)
