"""Read a URDF, with its loops from a closure YAML.

Joint frames are the frames in the URDF, rotated so that z is the axis. A link becomes a named frame on its parent if it
is fixed to the parent and has no shape and no mass. A planar joint becomes two slides and a hinge. Data that a
mechanism cannot hold cause a warning (friction, efforts, textures).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from os.path import commonprefix
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from twin.core import spatial
from twin.core.errors import NoMechanismError, SourceError, unknown
from twin.core.spatial import Array
from twin.exchange.formats.urdf.read.bounds import JointBounds, read_bounds
from twin.exchange.formats.urdf.read.closures import Closures, read_closures
from twin.exchange.formats.urdf.read.gears import MOVING, read_gears
from twin.exchange.formats.urdf.read.visuals import Visuals, origin
from twin.exchange.read.shapes import shows_all
from twin.exchange.read.source import (
    Findings,
    Imported,
    Names,
    Options,
    along,
    assemble,
    named_apart,
    possible,
)
from twin.exchange.read.start import moved
from twin.exchange.read.xml import Xml
from twin.exchange.xacro import SUFFIX, Expanded, XacroSettings, expand, is_xacro
from twin.model.body import Body, Frame
from twin.model.inertia import Inertia
from twin.model.joint import Joint, JointType
from twin.model.mechanism import WORLD, Coupling
from twin.model.transmission import Actuator, Transmission
from twin.usd.read.names import identifier

TYPES: dict[str, JointType] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
    "floating": "free",
}
"""Joint types of URDF that become one joint of a mechanism."""

_PLANAR = "planar"
"""Joint type of URDF that becomes three joints: slides along x and y of the plane, and a hinge about its normal z."""

_UNUSED = ("calibration", "joint_properties")
"""Elements of a joint that have no effect on the mechanism."""

_KNOWN = {
    "robot": {"link", "joint", "material", "transmission", "gazebo", "ros2_control"},
    "joint": {"origin", "parent", "child", "axis", "limit", "mimic", "dynamics", "safety_controller", *_UNUSED},
    "link": {"visual", "collision", "inertial"},
}

_LIGHT = 1e-6
"""Maximum mass in kg of a link without shape that becomes a frame instead of a body."""


def read_urdf(path: Path, closures: Path | None = None, settings: XacroSettings | None = None) -> Imported:
    """Read a URDF and, unless `closures` is None, the closure YAML at the path `closures`.

    A xacro is expanded first, with `settings`.

    Raises:
        SourceError: the file is invalid or unsupported; the message names file, element and fault.
    """
    expanded: Expanded | None = None
    try:
        if is_xacro(path):
            expanded = expand(path, settings or XacroSettings())
    except OSError as error:
        raise SourceError(f"{path}: cannot be read ({error.strerror or error})") from error
    if expanded is None and settings is not None and settings.arguments:
        raise SourceError(f"{path}: this is a URDF without expressions of xacro: omit --arg")
    content = None if closures is None else read_closures(closures)
    imported = _Urdf(path, content, closures, expanded).read()
    if expanded is not None:
        imported.places = dict(expanded.places)
    return imported


class _Urdf:
    def __init__(
        self, path: Path, closures: Closures | None, closure_file: Path | None, expanded: Expanded | None
    ) -> None:
        self.xml = Xml(path, "robot", None if expanded is None else expanded.data)
        self.path = path
        self.closures = closures
        self.closure_file = closure_file
        self.findings = Findings()
        if expanded is not None:
            for text in expanded.omitted:
                self.findings.warn("xacro", text, path.name)
        self.efforts: dict[str, float] = {}
        self.crosses: list[Body] = []
        self.home: dict[str, tuple[str, Array]] = {}
        self.ends: dict[str, tuple[str, str]] = {}
        self.above: dict[str, str] = {}

    def read(self) -> Imported:
        root = self.xml.root
        found = self.findings
        self._strange(root, "robot", "robot")
        self.links = self._named("link")
        self.joints = self._named("joint")
        for name, joint in self.joints.items():
            self.ends[name] = self._ends(name, joint)
        self.retyped = self._retyped()
        base = self._base()
        self.marks = self._marks(base)
        held: dict[str, tuple[str, Array]] = {}
        for link, joint in self.marks.items():
            held[link] = (self.ends[joint][0], origin(self.xml, self.joints[joint], f"joint '{joint}'"))
        inner = self._inner()
        for link, joint in inner.items():
            T_link_body = origin(self.xml, self.joints[joint], joint)
            held[link] = (self.ends[joint][1], spatial.inverse(T_link_body))
        closing = self._closing(held)
        for link, other in closing.items():
            held[link] = (other, np.eye(4))
        # Only the base can be the world: in an MJCF, a body of this name is the world itself.
        reserved = () if base == WORLD else (WORLD,)
        body_names = Names("link", (n for n in self.links if n not in held), found, reserved)
        parts: list[str] = []
        for name in self.joints:
            parts += self._parts(name)
        names = Names("joint", parts, found)
        self._place(body_names, held)
        if self.closures is None:
            self._unclosed([*self.joints, *self.links])
        self._drop_mimics_of_fixed()
        driven = self._driven(root)
        joints = self._made(names, {*self.marks.values(), *inner.values()}, closing, driven)
        bodies = self._bodies(body_names, held)
        frames = self._frames()
        couplings: list[Coupling] = []
        for name, joint in self.joints.items():
            if joint.find("mimic") is not None:
                couplings.append(self._mimic(name, names))
        couplings += self._coupled(names)
        joints += self._loops(names, closing)
        actuators, transmissions = self._geared(driven, names)
        efforts: dict[str, float] = {}
        for name, effort in self.efforts.items():
            if self.ends[name][1] not in self.marks:
                efforts[names[name]] = effort
        for text in self.xml.repaired:
            found.warn("xml", text, self.path.name)
        label = root.get("name") or self.path.stem
        out = assemble(self.path, label, body_names[base], bodies, joints, frames, couplings, found, efforts=efforts)
        mechanism = replace(out.mechanism, actuators=actuators, transmissions=transmissions)
        unlimited = set()
        for name, joint in self.joints.items():
            if joint.get("type") == "continuous" and name in names:
                unlimited.add(names[name])
        out = replace(out, mechanism=mechanism, posed=False, unlimited=frozenset(unlimited))
        return self._posed(out, names)

    def _place(self, body_names: Names, held: Mapping[str, tuple[str, Array]]) -> None:
        """Set `home`: {link: (its body, T_body_link)}. `held` are the links without body, each with its pose on one."""
        for link in self.links:
            if link not in held:
                self.home[link] = (body_names[link], np.eye(4))
        for _ in held:  # a link without body may be on another link without body
            for link, (other, T_other_link) in held.items():
                if other in self.home and link not in self.home:
                    body, T_body_other = self.home[other]
                    self.home[link] = (body, T_body_other @ T_other_link)

    def _made(
        self, names: Names, dropped: Collection[str], closing: Collection[str], driven: Collection[str]
    ) -> list[Joint]:
        """Return the joints of the mechanism: first those of the tree, then those that close loops."""
        tree: list[str] = []
        loops: list[str] = []
        for name in self.joints:
            if self.ends[name][1] in closing:
                loops.append(name)
            elif name not in dropped:
                tree.append(name)
        joints: list[Joint] = []
        for name in (*tree, *loops):
            if name in self.retyped:
                joints += self._retype(name, names, driven)
            elif self.joints[name].get("type") == _PLANAR:
                joints += self._planar(name, names)
            else:
                joints.append(self._joint(name, names[name], name in driven))
        return joints

    def _bodies(self, body_names: Names, held: Collection[str]) -> list[Body]:
        visuals = Visuals(self.xml, self.findings)
        bodies: list[Body] = []
        for name, link in self.links.items():
            if name not in held:
                meshes = visuals.meshes(name, link)
                inertia = self._inertia(name, link)
                bodies.append(Body(body_names[name], tuple(meshes), inertia, shows_all(link, len(meshes))))
        return bodies + self.crosses

    def _frames(self) -> list[Frame]:
        paired = self._paired()
        marked = [link for link in self.marks if link not in paired]  # the ends of loops are no frames of the robot
        names = Names("frame", marked, self.findings)
        frames = []
        for link in marked:
            body, T_body_link = self.home[link]
            frames.append(Frame(names[link], body, T_body_link))
        return frames

    def _posed(self, imported: Imported, names: Names) -> Imported:
        """Return the import at the posture `home` of the closure YAML, if there is one."""
        home = self.closures.home if self.closures else {}
        if not home:
            return imported
        values: dict[str, float] = {}
        for name, value in home.items():
            if name not in names:
                raise SourceError(f"{self.closure_file}: home: {unknown('joint', name, names.known())}")
            values[names[name]] = value
        mechanism = replace(imported.mechanism, rest=moved(imported.mechanism, values))
        return replace(imported, mechanism=mechanism, keys={"home": values}, posed=True)

    # -- structure ------------------------------------------------------------------------------------

    def _named(self, kind: str) -> dict[str, Element]:
        out = self.xml.named(self.xml.root, kind)
        for name, element in out.items():
            self._strange(element, kind, f"{kind} '{name}'")
        if not out:
            text = f"{self.path}: the file has no <{kind}>, so there is no mechanism"
            if kind == "link" and self.xml.root.find("joint") is not None:
                raise SourceError(text)
            raise NoMechanismError(text)
        return out

    def _strange(self, element: Element, kind: str, where: str) -> None:
        """Report the unsupported child elements of an element, each tag once."""
        for tag in dict.fromkeys(str(child.tag) for child in element):
            if tag not in _KNOWN[kind]:
                self.findings.warn("unread", f"{where}: <{tag}> is not read.", where)
            elif tag in _UNUSED:
                self.findings.note("unread", f"{where}: <{tag}> is not imported.", where)
            elif tag == "gazebo":
                self.findings.warn("unread", f"{where}: <gazebo> is not imported: plug-ins are not supported.", where)
        dynamics = element.find("dynamics")
        if kind != "joint" or dynamics is None:
            return
        for key in ("damping", "friction"):
            text = dynamics.get(key)
            if self.xml.number(where, key, text, 0.0):
                self.findings.warn("friction", f"{where}: {key} {text} is not imported.", where)

    def _ends(self, name: str, joint: Element) -> tuple[str, str]:
        ends = []
        for end in ("parent", "child"):
            element = joint.find(end)
            link = None if element is None else element.get("link")
            if link is None:
                self.xml.fail(f"joint '{name}'", f"the joint has no <{end} link>")
            if link not in self.links:
                self.xml.fail(f"joint '{name}', {end}", unknown("link", link, self.links))
            ends.append(link)
        parent, child = ends
        return parent, child

    def _base(self) -> str:
        """Return the root link, and set `above`: {link: the joint of which it is the child}."""
        for joint, (_, child) in self.ends.items():
            if child in self.above:
                text = (
                    f"the link is the child of two joints, '{self.above[child]}' and '{joint}', but a URDF is a tree. "
                    "Remove one of the joints, and close the loop in a YAML file given with --closures"
                )
                self.xml.fail(f"link '{child}'", text)
            self.above[child] = joint
        roots = [link for link in self.links if link not in self.above]
        if len(roots) != 1:
            found = ", ".join(roots) or "none: the joints form a cycle"
            raise SourceError(f"{self.path}: expected one root link, found {found}")
        return roots[0]

    def _marks(self, base: str) -> dict[str, str]:
        """Return {link: the fixed joint to its parent} for the links that become named frames."""
        marks = {}
        for joint, (_, child) in self.ends.items():
            fixed = self.joints[joint].get("type") == "fixed" or self.retyped.get(joint) == "FIXED"
            if fixed and child != base and not self._has_body(child):
                marks[child] = joint
                text = f"link '{child}' has no shape and no mass: it becomes a frame on its parent."
                self.findings.note("mark", text, child)
        return marks

    def _inner(self) -> dict[str, str]:
        """Return {link: fixed joint} for links without body between a moving joint and the body fixed to them.

        Such a link is only the frame of the joint on this body.
        """
        out: dict[str, str] = {}
        for name in self.links:
            inner = self.above.get(name)
            if inner is None or inner in self.retyped or self._has_body(name):
                continue
            below = [joint for joint, (parent, _) in self.ends.items() if parent == name]
            if len(below) != 1:
                continue
            outer = below[0]
            child = self.ends[outer][1]
            kind = self.retyped.get(outer, str(self.joints[outer].get("type")))
            moving = self.joints[inner].get("type") != "fixed"
            if moving and kind.lower() == "fixed" and self._has_body(child):
                out[name] = outer
                text = f"link '{name}' has no shape and no mass: it becomes one body with '{child}', fixed to it."
                self.findings.note("mark", text, name)
        return out

    def _closing(self, held: Collection[str]) -> dict[str, str]:
        """Return {link: the link welded to it by a loop} for links without body at the end of a moving joint.

        The moving joint then closes the loop.
        """
        out: dict[str, str] = {}
        if self.closures is None:
            return out
        parents = {parent for parent, _ in self.ends.values()}
        paired = self._paired()
        for a, b, kind in self.closures.loops:
            if kind != "fixed":
                continue
            first = self._link(a)
            second = self._link(b)
            for name, other in ((first, second), (second, first)):
                if name not in self.above or other not in self.links or other in out:
                    continue
                joint = self.above[name]
                moving = joint not in self.retyped and self.joints[joint].get("type") in MOVING
                leaf = name not in parents and name not in held and paired.count(name) == 1
                if moving and leaf and not self._has_body(name):
                    out[name] = other
                    break
        return out

    def _paired(self) -> list[str]:
        """Return the links that the closure YAML joins, two for each loop."""
        out: list[str] = []
        if self.closures is not None:
            for a, b, _ in self.closures.loops:
                out += [self._link(a), self._link(b)]
        return out

    def _link(self, name: str) -> str:
        """Return the link that a closure means: a link of this name, or the child of the joint of this name."""
        return self.ends[name][1] if name in self.ends else name

    def _has_body(self, name: str) -> bool:
        link = self.links[name]
        mass = link.find("inertial/mass")
        value = "0" if mass is None else mass.get("value")
        kilograms = self.xml.number(f"link '{name}'", "mass", value, 0.0)
        return kilograms > _LIGHT or link.find("visual") is not None or link.find("collision") is not None

    def _unclosed(self, names: list[str]) -> None:
        """If there is no closure YAML, report pairs of names that look like the two ends of a cut loop."""
        stems: list[str] = []
        for name in dict.fromkeys(names):
            stem = name[:-1]
            if name.endswith("A") and f"{stem}B" in names and "loop" in name.lower():
                stems.append(stem)
        if stems:
            first = stems[0]
            text = (
                f"{len(stems)} pairs such as '{first}A' and '{first}B' look like ends of cut loops, but there is no "
                "closure YAML, so the robot is read as a tree. Put the YAML file next to the URDF, or name the file "
                "with --closures."
            )
            self.findings.warn("closures", text, first)

    def _retyped(self) -> dict[str, str]:
        """Return {joint: new type} for the joints whose type the closure YAML replaces."""
        if self.closures is None:
            return {}
        leaders: set[str | None] = set()
        for joint in self.joints.values():
            mimic = joint.find("mimic")
            if mimic is not None:
                leaders.add(mimic.get("joint"))
        for name in self.closures.retyped:
            where = f"{self.closure_file}: joint_name"
            if name not in self.joints:
                raise SourceError(f"{where}: {unknown('joint', name, self.joints)}")
            if self.joints[name].find("mimic") is not None or name in leaders:
                raise SourceError(f"{where}: joint '{name}' mimics a joint or is mimicked: its type cannot be changed")
        return self.closures.retyped

    def _parts(self, name: str) -> list[str]:
        """Return the names of the joints made from one URDF joint.

        A universal joint becomes two hinges, a planar joint two slides and a hinge, each other joint one joint.
        """
        kind = self.retyped.get(name, "")
        if kind.startswith("UJOINT"):
            return [f"{name}_{axis}" for axis in kind[-2:]]
        if not kind and self.joints[name].get("type") == _PLANAR:
            return [f"{name}_x", f"{name}_y", f"{name}_z"]
        return [name]

    def _driven(self, root: Element) -> set[str]:
        """Return the driven joints: from the closure YAML, else from the transmissions, else all movable joints."""
        if self.closures is not None:
            self._check_motors(self.closures.motors)
            return set(self.closures.motors)
        stated = self._commanded(root) or self._transmitted(root)
        if stated:
            return stated
        moving: set[str] = set()
        for name, joint in self.joints.items():
            if joint.get("type") in MOVING and joint.find("mimic") is None:
                moving.add(name)
        return moving

    def _check_motors(self, motors: Sequence[str]) -> None:
        """Raise `SourceError` if the closure YAML names a driven joint that does not exist or cannot be driven."""
        where = f"{self.closure_file}: name_mot"
        owners: dict[str, str] = {}
        for name in self.joints:
            for part in self._parts(name):
                owners[part] = name
        for motor in motors:
            if motor not in owners:
                raise SourceError(f"{where}: {unknown('joint', motor, owners)}")
            name = owners[motor]
            kind = self.retyped.get(name, self.joints[name].get("type"))
            if kind not in MOVING and not str(kind).startswith("UJOINT"):
                raise SourceError(f"{where}: joint '{motor}' is {kind} and cannot be driven")

    def _drop_mimics_of_fixed(self) -> None:
        """Remove the <mimic> of each fixed joint, with a warning: tools that fix the joints of a hand often keep it."""
        for name, joint in self.joints.items():
            mimic = joint.find("mimic")
            if mimic is None or joint.get("type") != "fixed" or name in self.retyped:
                continue
            joint.remove(mimic)
            self.findings.warn("mimic", f"joint '{name}' is fixed, so its mimic has no effect.", name)

    def _transmitted(self, root: Element) -> set[str]:
        """Return the joints that transmissions move.

        Left out are joints that mimic another joint, which the other joint moves, and, with a warning, fixed joints and
        names of no joint: files of a part of a robot often keep the transmissions of the whole robot.
        """
        out = set()
        for transmission in root.findall("transmission"):
            label = str(transmission.get("name"))
            for element in transmission.findall("joint"):
                name = str(element.get("name"))
                joint = self.joints.get(name)
                if joint is None:
                    text = f"transmission '{label}' moves nothing: {unknown('joint', name, self.joints)}"
                    self.findings.warn("gear", text, label)
                elif joint.get("type") == "fixed":
                    text = f"transmission '{label}': joint '{name}' is fixed, so the transmission moves nothing."
                    self.findings.warn("gear", text, label)
                elif joint.find("mimic") is not None:
                    text = f"joint '{name}' mimics another joint, so its transmission drives nothing."
                    self.findings.note("gear", text, name)
                else:
                    out.add(name)
        return out

    def _commanded(self, root: Element) -> set[str]:
        """Return the joints that have a command interface in a <ros2_control>; all other joints are then passive."""
        out = set()
        for system in root.findall("ros2_control"):
            for element in system.findall("joint"):
                name = str(element.get("name"))
                if element.find("command_interface") is None or element.find("mimic") is not None:
                    continue
                if name not in self.joints:
                    self.xml.fail("ros2_control", unknown("joint", name, self.joints))
                joint = self.joints[name]
                if joint.get("type") in MOVING and joint.find("mimic") is None:
                    out.add(name)
        return out

    def _geared(self, driven: Collection[str], names: Names) -> tuple[tuple[Actuator, ...], tuple[Transmission, ...]]:
        """Return (motors, transmissions) of the joints whose gear ratio is not 1; other joints are driven directly."""
        gears = read_gears(self.xml, self.joints, self.retyped, driven, self.findings)
        wanted = [(name, gear.motor) for name, gear in gears.items()]
        motors = named_apart("motor", wanted, set(names.values()), self.findings)
        wanted = [(name, gear.transmission) for name, gear in gears.items()]
        labels = named_apart("transmission", wanted, (), self.findings)
        transmissions: list[Transmission] = []
        for name, gear in gears.items():
            matrix = np.array([[1 / gear.ratio]])
            transmissions.append(Transmission(labels[name], (names[name],), (motors[name],), matrix))
        return tuple(map(Actuator, motors.values())), tuple(transmissions)

    # -- parts ----------------------------------------------------------------------------------------

    def _axis(self, where: str, joint: Element) -> Array:
        element = joint.find("axis")
        text = None if element is None else element.get("xyz")
        return self.xml.axis(where, "axis", text, (1, 0, 0))  # x is the default of URDF

    def _joint(self, name: str, new: str, active: bool) -> Joint:
        """Return the joint called `new` for a URDF joint with one coordinate, none, or six."""
        where = f"joint '{name}'"
        joint = self.joints[name]
        kind = joint.get("type")
        if kind not in TYPES:
            self.xml.fail(where, unknown("joint type", str(kind), (*TYPES, _PLANAR)))
        turn = np.eye(4)
        bounds = JointBounds()
        if kind in MOVING:
            turn = along(self._axis(where, joint))
            bounds = read_bounds(self.xml, name, joint, self.findings)
            if bounds.max_effort is not None:
                self.efforts[name] = bounds.max_effort
        if kind == "floating":
            self.findings.warn("free", f"{where} is a floating joint: the robot is not fixed to the world.", name)
        parent, child = self.ends[name]
        inner, T_inner_parent = self.home[parent]
        outer, T_outer_child = self.home[child]
        return Joint(
            new,
            TYPES[kind],
            inner,
            outer,
            T_inner_parent @ origin(self.xml, joint, where) @ turn,
            T_outer_child @ turn,
            active=active,
            limits=bounds.limits,
            soft_limits=bounds.soft_limits,
            max_speed=bounds.max_speed,
        )

    def _retype(self, name: str, names: Names, driven: Collection[str]) -> list[Joint]:
        """Return the joints that replace a URDF joint according to the closure YAML, in the frame of the URDF joint."""
        where = f"joint '{name}'"
        kind = self.retyped[name]
        parent, T_parent_link = self.home[self.ends[name][0]]
        T = T_parent_link @ origin(self.xml, self.joints[name], where)
        child, _ = self.home[self.ends[name][1]]
        text = f"{where}: the closure YAML sets the type {kind}, so the axis and limits of the URDF are not imported."
        self.findings.note("retyped", text, name)
        if kind == "SPHERICAL":
            return [Joint(names[name], "spherical", parent, child, T)]
        if kind == "FIXED":
            return [Joint(names[name], "fixed", parent, child, T)]
        first, second = self._parts(name)
        cross = self._inserted(f"{name}_cross")
        joints = []
        for part, inner, outer, at in ((first, parent, cross, T), (second, cross, child, np.eye(4))):
            turn = along(np.eye(3)["XYZ".index(part[-1])])
            joints.append(Joint(names[part], "revolute", inner, outer, at @ turn, turn, active=part in driven))
        return joints

    def _planar(self, name: str, names: Names) -> list[Joint]:
        """Return slides along x and y of the plane, and a hinge about its normal z, for a planar joint.

        As for a floating joint, no motor moves these joints. The limits of the URDF do not say which coordinate they
        limit, so they are not imported.
        """
        where = f"joint '{name}'"
        joint = self.joints[name]
        turn = along(self._axis(where, joint))
        parent, T_parent_home = self.home[self.ends[name][0]]
        child, T_child_joint = self.home[self.ends[name][1]]
        first, second, third = self._parts(name)
        moved_x = self._inserted(f"{name}_moved_x")
        moved_y = self._inserted(f"{name}_moved_y")
        text = f"{where} is planar: it becomes the slides '{names[first]}' and '{names[second]}' and the hinge "
        self.findings.warn("planar", f"{text}'{names[third]}', which no motor drives.", name)
        limit = joint.find("limit")
        if limit is not None and (limit.get("lower") or limit.get("upper")):
            text = f"{where} is planar: the limits {limit.get('lower')} .. {limit.get('upper')} are not imported."
            self.findings.warn("limits", text, name)
        x_axis = along(np.array([1.0, 0.0, 0.0]))
        y_axis = along(np.array([0.0, 1.0, 0.0]))
        T_parent_plane = T_parent_home @ origin(self.xml, joint, where) @ turn
        return [
            Joint(names[first], "prismatic", parent, moved_x, T_parent_plane @ x_axis, x_axis),
            Joint(names[second], "prismatic", moved_x, moved_y, y_axis, y_axis),
            Joint(names[third], "revolute", moved_y, child, np.eye(4), T_child_joint @ turn),
        ]

    def _inserted(self, name: str) -> str:
        """Insert a body without mass between two joints that replace one, and return its name: `name` if it is free."""
        taken = {body for body, _ in self.home.values()}
        taken.update(cross.name for cross in self.crosses)
        body = identifier(name)
        while body in taken:
            body += "_1"
        self.crosses.append(Body(body))
        return body

    def _mimic(self, name: str, names: Names) -> Coupling:
        where = f"joint '{name}', mimic"
        mimic = self.joints[name].find("mimic")
        assert mimic is not None
        leader = mimic.get("joint")
        if leader is None or leader not in self.joints:
            self.xml.fail(where, unknown("joint", str(leader), self.joints))
        if _PLANAR in (self.joints[name].get("type"), self.joints[leader].get("type")):
            self.xml.refuse(where, "a planar joint has three coordinates, so it cannot mimic or be mimicked")
        ratio = self.xml.number(where, "multiplier", mimic.get("multiplier"), 1.0)
        if ratio == 0:
            self.xml.refuse(where, "mimic multiplier is 0; use a fixed joint")
        total = self.xml.number(where, "offset", mimic.get("offset"), 0.0)
        return Coupling(f"{names[name]}_mimic", (names[name], names[leader]), (1.0, -ratio), total)

    def _coupled(self, names: Names) -> list[Coupling]:
        """Return the couplings of the closure YAML."""
        out: list[Coupling] = []
        if self.closures is None:
            return out
        for name, joints, ratios, total in self.closures.couplings:
            for joint in joints:
                if joint not in names:
                    raise SourceError(f"{self.closure_file}: coupling: {unknown('joint', joint, names.known())}")
            coupled = tuple(names[joint] for joint in joints)
            out.append(Coupling(identifier(name), coupled, ratios, total))
        return out

    def _loops(self, names: Names, closing: Collection[str]) -> list[Joint]:
        """Return the joints that the closure YAML adds. If the YAML names a joint, its child link is meant."""
        out: list[Joint] = []
        if self.closures is None:
            return out
        for i, (a, b, kind) in enumerate(self.closures.loops):
            first = self._link(a)
            second = self._link(b)
            for name, link in ((a, first), (b, second)):
                if link not in self.links:
                    known = [*self.ends, *self.links]
                    raise SourceError(f"{self.closure_file}: closed_loop: {unknown('joint or link', name, known)}")
            if first in closing or second in closing:
                continue  # a moving joint closes this loop
            # The common part of the two names, such as `closedloop1` of `closedloop1_A` and `closedloop1_B`.
            common = commonprefix((a, b))  # noqa: RUF071 - of characters, not of folders
            label = identifier(common.rstrip("_-"))
            used = {joint.name for joint in out}
            if label in used or label in names:
                label = f"loop{i + 1}_closure"
            body_a, T_a = self.home[first]
            body_b, T_b = self.home[second]
            if body_a == body_b:
                raise SourceError(f"{self.closure_file}: closed_loop: '{a}' and '{b}' are on the same body, '{body_a}'")
            out.append(Joint(label, kind, body_a, body_b, T_a, T_b))
        return out

    def _inertia(self, name: str, link: Element) -> Inertia | None:
        where = f"link '{name}'"
        element = link.find("inertial")
        if element is None:
            return None
        T = origin(self.xml, element, where)
        mass = element.find("mass")
        tensor = element.find("inertia")
        if mass is None or tensor is None:
            lacking = "mass" if mass is None else "inertia"
            text = f"{where}: the <inertial> has no <{lacking}>: the link is imported without mass."
            self.findings.warn("inertia", text, name)
            return None
        kilograms = self.xml.number(where, "mass", mass.get("value"))
        R = T[:3, :3]
        I = R @ self.xml.tensor(where, tensor.get) @ R.T  # noqa: E741
        # The mean with the transpose is symmetric in all digits, which rotations by rounded matrices are not.
        return possible(Inertia(kilograms, T[:3, 3], 0.5 * (I + I.T)), name, self.findings)


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of a URDF, with the loops in its closure YAML; see `read_urdf`."""
    closures = options.closures
    beside = path.with_suffix(".yaml")
    # the folder of a xacro has YAML files of parameters, whose names mean other things
    if closures is None and path.suffix.lower() != SUFFIX and beside.is_file():
        closures = beside
    return read_urdf(path, closures, options.xacro)
