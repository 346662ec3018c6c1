"""Read one model of an SDF file. If two joints have the same child link, the second joint closes a loop.

Poses are resolved with `relative_to` and the frames of the model. Nested models and includes are part of the model.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from twin.core import spatial
from twin.core.errors import MechanismError, SourceError, unknown
from twin.core.spatial import Array
from twin.exchange.formats.sdf.read.world import robot_of
from twin.exchange.read.shapes import SIZES, Color, mesh_file, placed, served, shows_all, sized, stated_color
from twin.exchange.read.source import (
    Findings,
    Imported,
    Names,
    Options,
    along,
    assemble,
    limits,
    possible,
    rpy,
    stated_gravity,
)
from twin.exchange.read.xml import Xml
from twin.model.body import Body, Frame, Mesh
from twin.model.inertia import Inertia
from twin.model.joint import Joint, JointType
from twin.model.mechanism import EARTH, WORLD, Coupling, Mechanism
from twin.usd.read.names import identifier

TYPES: dict[str, JointType] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "ball": "spherical",
    "fixed": "fixed",
}
"""Joint types of SDF that a mechanism can express."""

_ENDLESS = 1e16
"""Magnitude in m or rad from which a limit means "no limit" in SDF."""


_READ = {
    "model": {"link", "joint", "frame", "pose"},
    "link": {"visual", "collision", "inertial", "pose"},
    "joint": {"parent", "child", "axis", "pose"},
    "axis": {"xyz", "limit", "mimic", "initial_position"},
    "limit": {"lower", "upper", "velocity", "effort"},
    "visual": {"geometry", "material", "pose", "transparency"},
    "material": {"diffuse"},
}
"""{name of a parent element: names of the child elements that are read}."""

_HARMLESS = {"static", "self_collide", "allow_auto_disable", "enable_wind", "gravity", "cast_shadows", "ambient"}
_HARMLESS |= {"specular", "emissive", "lighting", "laser_retro", "meta", "must_be_base_link", "physics", "kinematic"}
"""Elements that affect only simulation or lighting; they are reported as notes, not as warnings."""

_EMPTY = ("0", "0.0", "-1", "inf", "1e+16", "1e16", "")
"""Texts for which an element has no effect; an unread element with one of these texts is not reported."""


def read_sdf(path: Path, root: str | None = None) -> Imported:
    """Read an SDF file.

    If several models have joints, `root` is the name of the model to read.

    Raises:
        SourceError: the file is invalid or unsupported; the message names file, element and fault.
    """
    return _Sdf(path, root).read()


class _Sdf:
    def __init__(self, path: Path, root: str | None) -> None:
        self.xml, self.path = Xml(path, "sdf"), path
        self.findings = Findings()
        self.efforts: dict[str, float] = {}
        self.model = robot_of(self.xml, root, self.findings)

    def read(self) -> Imported:
        links, joints, marks = (self.xml.named(self.model, k) for k in ("link", "joint", "frame"))
        if not links:
            raise SourceError(f"{self.path}: the model has no <link>, so there is no mechanism")
        self.links, self.elements = links, {**links, **joints, **marks}
        self.poses: dict[str, Array] = {}
        self.T_world_model = self._placed()
        body_names = Names("link", links, self.findings, reserved=(WORLD,))
        joint_names = Names("joint", joints, self.findings)
        made = [self._joint(n, joint_names[n], e, body_names) for n, e in joints.items()]
        grounded = any(j.parent == "world" for j in made)
        if grounded and "world" in links:
            self.xml.fail("link 'world'", "the name 'world' is reserved for the world")
        base = WORLD
        if not grounded:
            root = self._base(made, body_names)
            mount = self._mount(root, body_names, set(joint_names.values()))
            made = [*mount, *made]
            grounded = bool(mount)
            if not mount:
                base = root
        bodies = [Body(WORLD)] if grounded else []
        for n, e in links.items():
            meshes = self._meshes(n, e)
            bodies.append(Body(body_names[n], tuple(meshes), self._inertia(n, e), shows_all(e, len(meshes))))
        frames = []
        shown = (n for n, e in marks.items() if not e.get("hidden"))
        for old, new in Names("frame", shown, self.findings).items():
            link = self._attached(old)
            frames.append(Frame(new, body_names[link], spatial.inverse(self._at(link)) @ self._at(old)))
        name = self.model.get("name") or self.path.stem
        couplings = [c for n, e in joints.items() for c in self._mimic(n, e, joint_names)]
        made = self._drive(made, base, {c.joints[0] for c in couplings}, joint_names)
        self.findings += _left_out(self.model, self.xml)
        for text in self.xml.repaired:
            self.findings.warn("xml", text, self.path.name)
        efforts = {joint_names[n]: e for n, e in self.efforts.items()}
        out = assemble(self.path, name, base, bodies, made, frames, couplings, self.findings, efforts=efforts)
        return replace(out, mechanism=replace(out.mechanism, gravity=self._gravity()))

    def _placed(self) -> Array:
        """Return T_world_model (4, 4), the pose of the model in the world."""
        where = f"model '{self.model.get('name')}'"
        pose = self.model.find("pose")
        relative = (pose.get("relative_to") or "") if pose is not None else ""
        if relative not in ("", "world"):
            text = f"{where}: its pose relative to '{relative}' is not read; the model is placed at the origin."
            self.findings.warn("pose", text, where)
            return np.eye(4)
        T_world_placed = self._pose(self.model, where)
        return T_world_placed @ spatial.inverse(self._at(self.model.get("placement_frame") or ""))

    def _gravity(self) -> tuple[float, float, float]:
        """Return the gravity of the world in m/s2; that of the earth if the file states none."""
        text = self.xml.root.findtext("world/gravity")
        return stated_gravity(self.xml.numbers("world", "gravity", text, 3, EARTH), self.findings)

    def _mount(self, root: str, names: Names, taken: set[str]) -> list[Joint]:
        """Return the joint from the world to the link `root`, in a model without a joint to the world.

        The model floats, unless it is static. The list is empty for a static model whose link `root` is at the origin
        of the world. `taken` are the names of the other joints.
        """
        link = next(n for n in self.links if names[n] == root)
        T_world_link = self.T_world_model @ self._at(link)
        static = (self.model.findtext("static") or "").strip() in ("true", "1")
        if static and np.allclose(T_world_link, np.eye(4), rtol=0.0, atol=1e-12):
            return []
        name = f"{root}_mount" if static else f"{root}_free"
        while name in taken:
            name += "_1"
        if not static:
            text = f"no joint fixes link '{root}' to the world: the robot floats, by joint '{name}'."
            self.findings.warn("free", text, root)
        return [Joint(name, "fixed" if static else "free", WORLD, root, T_world_link)]

    def _drive(self, joints: list[Joint], base: str, followers: set[str], names: Names) -> list[Joint]:
        """Return the joints, with `active` set to True for the driven joints.

        If plug-ins name driven joints, only these joints are driven. Otherwise, all joints are driven except followers
        (`mimic`) and joints that close a loop.
        """
        told = {t for p in self.model.iter("plugin") for e in p.iter("joint_name") if (t := (e.text or "").strip())}
        told = {names[t] for t in told if t in names}
        bare = [replace(j, active=False) for j in joints]
        bodies = dict.fromkeys([base, *(b for j in joints for b in (j.parent, j.child))])
        try:
            closing = {j.name for j in Mechanism("m", base, tuple(map(Body, bodies)), tuple(bare)).loops}
        except MechanismError as error:
            raise SourceError(f"{self.path}: {error}") from error
        out = []
        for j in joints:
            active = j.active and j.name not in followers and j.name in (told or {k.name for k in joints} - closing)
            if active and j.name in closing:
                self.xml.fail(
                    f"joint '{j.name}'", "the joint is driven, but closes a loop: list it before the passive joints"
                )
            out.append(replace(j, active=active))
        if not told and closing:
            text = (
                f"no plug-in names a driven joint: all joints are driven except {', '.join(sorted(closing))}, which "
                "close loops."
            )
            self.findings.warn("driven", text, base)
        return out

    def _mimic(self, name: str, joint: Element, names: Names) -> Iterator[Coupling]:
        """Yield the coupling of a joint that follows another: q = multiplier (leader - reference) + offset."""
        where, element = f"joint '{name}', mimic", joint.find("axis/mimic")
        if element is None:
            return
        leader = element.get("joint") or ""
        if leader not in names:
            self.xml.fail(where, unknown("joint", leader, [e for e in self.elements if e in names]))
        if element.get("axis", "axis") != "axis":
            self.xml.fail(where, "the joint mimics a second axis, which is not supported")
        ratio, offset, reference = (
            self.xml.number(where, key, element.findtext(key), default)
            for key, default in (("multiplier", 1.0), ("offset", 0.0), ("reference", 0.0))
        )
        if ratio == 0:
            self.xml.fail(where, "mimic multiplier is 0; use a fixed joint")
        total = offset - ratio * reference
        yield Coupling(f"{names[name]}_mimic", (names[name], names[leader]), (1.0, -ratio), total)

    def _base(self, joints: list[Joint], names: Names) -> str:
        children = {j.child for j in joints}
        roots = [names[n] for n in self.links if names[n] not in children]
        if len(roots) != 1:
            found = ", ".join(roots) or "none: the joints form a cycle"
            raise SourceError(f"{self.path}: expected one base link, found {found}")
        return roots[0]

    # -- poses ----------------------------------------------------------------------------------------

    def _pose(self, element: Element, where: str) -> Array:
        pose = element.find("pose")
        if pose is None or not (pose.text or "").strip():
            return np.eye(4)
        if pose.get("rotation_format", "euler_rpy") != "euler_rpy":
            self.xml.fail(where, "pose: only rotation_format euler_rpy is supported")
        v = self.xml.numbers(where, "pose", pose.text, 6, None)
        turn = v[3:] * (np.pi / 180 if pose.get("degrees") in ("true", "1") else 1.0)
        return spatial.pose(rpy(turn), v[:3])

    def _at(self, name: str, seen: tuple[str, ...] = ()) -> Array:
        """Return T_model_x (4, 4) for x, the link, joint or frame with the given name."""
        if name in ("__model__", ""):
            return np.eye(4)
        if name == WORLD:
            return spatial.inverse(self.T_world_model)
        if name in self.poses:
            return self.poses[name]
        if name not in self.elements:
            raise SourceError(f"{self.path}: pose, relative_to: {unknown('link, joint or frame', name, self.elements)}")
        if name in seen:
            self.xml.fail(f"'{name}'", f"the pose is relative to itself: {' -> '.join((*seen, name))}")
        element = self.elements[name]
        pose = element.find("pose")
        relative = (pose.get("relative_to") if pose is not None else None) or ""
        if not relative and element.tag == "joint":
            relative = (element.findtext("child") or "").strip()
        if not relative and element.tag == "frame":
            relative = element.get("attached_to") or ""
        out = self._at(relative, (*seen, name)) @ self._pose(element, f"{element.tag} '{name}'")
        self.poses[name] = out
        return out

    def _attached(self, name: str, seen: tuple[str, ...] = ()) -> str:
        if name in self.links:
            return name
        element = self.elements.get(name)
        if element is None or name in seen:
            why = "is attached to itself" if name in seen else "does not exist"
            raise SourceError(f"{self.path}: frame '{name}' {why}")
        on = element.findtext("child") if element.tag == "joint" else element.get("attached_to")
        return self._attached((on or "").strip() or next(iter(self.links)), (*seen, name))

    # -- parts ----------------------------------------------------------------------------------------

    def _joint(self, name: str, new: str, joint: Element, names: Names) -> Joint:
        where, kind = f"joint '{name}'", joint.get("type")
        if kind not in TYPES:
            self.xml.fail(where, unknown("joint type", str(kind), TYPES))
        ends = []
        for end in ("parent", "child"):
            link = (joint.findtext(end) or "").strip()
            if link != "world" and link not in self.elements:
                self.xml.fail(f"{where}, {end}", unknown("link", link, self.links))
            ends.append(link if link == "world" else self._attached(link))
        if ends[1] == "world":
            self.xml.fail(where, "the child of the joint is the world: exchange parent and child")
        T = self._at(name)
        values: dict = {}
        if kind in ("revolute", "continuous", "prismatic"):
            T, values = self._axis(name, where, kind, joint, T)
        T_parent = self._at(ends[0])
        return Joint(
            new,
            TYPES[kind],
            "world" if ends[0] == "world" else names[ends[0]],
            names[ends[1]],
            spatial.inverse(T_parent) @ T,
            spatial.inverse(self._at(ends[1])) @ T,
            **values,
        )

    def _axis(self, name: str, where: str, kind: str, joint: Element, T: Array) -> tuple[Array, dict]:
        axis = joint.find("axis")
        axis = Element("axis") if axis is None else axis
        xyz = axis.find("xyz")
        direction = self.xml.axis(where, "axis xyz", None if xyz is None else xyz.text, (0, 0, 1))
        if xyz is not None and (expressed := xyz.get("expressed_in")):
            direction = T[:3, :3].T @ self._at(expressed)[:3, :3] @ direction
        values: dict = {"active": True}
        bounds = []
        for key in ("lower", "upper"):
            text = axis.findtext(f"limit/{key}") if kind != "continuous" else None
            value = None
            if text is not None and text.strip().lstrip("-+").lower() not in ("inf", "infinity"):
                value = self.xml.number(where, key, text)
            bounds.append(None if value is None or abs(value) >= _ENDLESS else value)
        values["limits"] = limits(self.path, bounds[0], bounds[1], name, self.findings)
        most = {key: self.xml.number(where, key, axis.findtext(f"limit/{key}"), 0.0) for key in ("velocity", "effort")}
        if 0 < most["velocity"] < _ENDLESS:
            values["max_speed"] = most["velocity"]
        if 0 < most["effort"] < _ENDLESS:
            self.efforts[name] = most["effort"]
        return T @ along(direction), values

    def _inertia(self, name: str, link: Element) -> Inertia | None:
        element, where = link.find("inertial"), f"link '{name}'"
        if element is None:
            return None
        T = self._pose(element, where)
        tensor = self.xml.tensor(where, lambda key: element.findtext(f"inertia/{key}"), np.eye(3))
        mass = self.xml.number(where, "mass", element.findtext("mass"), 1.0)
        return possible(Inertia(mass, T[:3, 3], T[:3, :3] @ tensor @ T[:3, :3].T), name, self.findings)

    def _meshes(self, name: str, link: Element) -> list[Mesh]:
        """Return the visual shapes of a link; if there are none, or none can be read, its collision shapes."""
        visuals, collisions = link.findall("visual"), link.findall("collision")
        out = self._shapes(name, visuals or collisions)
        if visuals and collisions and not out:
            out = self._shapes(name, collisions)
            served(out, name, self.findings)
        return out

    def _shapes(self, name: str, elements: list[Element]) -> list[Mesh]:
        """Return the shapes that can be read of the <visual> or <collision> elements of a link."""
        where, out = f"link '{name}'", []
        for element in elements:
            geometry = element.find("geometry")
            if geometry is None or not len(geometry):
                self.xml.fail(where, f"a <{element.tag}> has no shape in a <geometry>")
            shape = geometry[0]
            solid = None
            if shape.tag == "mesh":
                scale = self.xml.numbers(where, "mesh scale", shape.findtext("scale"), 3, (1, 1, 1))
                solid = mesh_file((shape.findtext("uri") or "").strip(), self.path.parent, scale, name, self.findings)
            elif shape.tag in SIZES:
                solid = sized(self.xml, where, shape.tag, shape.findtext, self.findings)
            else:
                self.findings.warn("shape", f"{where}: a <{shape.tag}> is not shown.", name)
            if solid is not None:
                r, g, b, a = stated_color(element.findtext("material/diffuse"), where, self.findings)
                a *= 1.0 - self.xml.number(where, "transparency", element.findtext("transparency"), 0.0)
                color: Color = (r, g, b, min(max(a, 0.0), 1.0))
                label = identifier(f"{name}_shape") + (f"_{len(out) + 1}" if out else "")
                out.append(placed(label, *solid, self._pose(element, where), color))
        return out


def _left_out(model: Element, xml: Xml) -> Findings:
    found = Findings()
    if xml.root.find("world") is not None:
        others = sorted({str(e.tag) for w in xml.root.findall("world") for e in w} - {"model", "gravity"})
        if others:
            found.note("unread", f"the elements {', '.join(others)} of the world are not read.", "world")
    _walk(model, "model", f"model '{model.get('name')}'", found)
    return found


def _walk(element: Element, kind: str, where: str, found: Findings) -> None:
    for child in element:
        tag = str(child.tag)
        named = f"{where}, {tag} '{child.get('name')}'" if child.get("name") else f"{where}, {tag}"
        if tag == "collision" and element.find("visual") is not None:
            found.note("collision", f"{named} is not imported: the visual meshes are used for collision.", where)
        elif tag not in _READ[kind]:
            _tell(child, tag, where, found)
        elif tag in _READ:
            short = f"{tag} '{child.get('name')}'" if tag in ("link", "joint") else named
            _walk(child, tag, short, found)


def _tell(child: Element, tag: str, where: str, found: Findings) -> None:
    if tag in ("dynamics", "stiffness", "dissipation"):
        values = [f"{e.tag} {(e.text or '').strip()}" for e in (child.iter() if len(child) else [child]) if _says(e)]
        if values:
            found.warn("friction", f"{where}: {', '.join(values)} is not imported.", where)
    elif tag == "plugin" and child.find(".//joint_name") is not None:
        text = f"{where}: of <plugin> '{child.get('name', '')}', only the names of the driven joints are read."
        found.note("unread", text, where)
    elif tag in _HARMLESS:
        found.note("unread", f"{where}: <{tag}> is not imported.", where)
    else:
        found.warn("unread", f"{where}: <{tag}> is not read.", where)


def _says(element: Element) -> bool:
    return not len(element) and (element.text or "").strip() not in _EMPTY


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of an SDF file; see `read_sdf`."""
    return read_sdf(path, options.root)
