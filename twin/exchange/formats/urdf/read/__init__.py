"""Read a URDF, with its loops from a closure YAML.

Joint frames are the frames in the URDF, rotated so that z is the axis. A link becomes a named frame on its parent if it
is fixed to the parent and has no shape and no mass. A planar joint becomes two slides and a hinge. Data that a
mechanism cannot hold cause a warning (friction, efforts, textures).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from twin.core import spatial
from twin.core.errors import SourceError, unknown
from twin.core.spatial import Array
from twin.exchange.formats.urdf.read.closures import Closures, read_closures
from twin.exchange.read.shapes import GREY, SIZES, Color, link_meshes, mesh_file, placed, shows_all, sized, stated_color
from twin.exchange.read.source import (
    Findings,
    Imported,
    Names,
    Options,
    along,
    assemble,
    limits,
    named_apart,
    possible,
    rpy,
)
from twin.exchange.read.start import moved
from twin.exchange.read.xml import Xml
from twin.model.body import Body, Frame, Mesh
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


def read_urdf(path: Path, closures: Path | None = None) -> Imported:
    """Read a URDF and, unless `closures` is None, the closure YAML at the path `closures`.

    Raises:
        SourceError: the file is invalid or unsupported; the message names file, element and fault.
    """
    return _Urdf(path, read_closures(closures) if closures else None, closures).read()


_UNSTATED = 1e6
"""Effort (N, N m) or speed (rad/s, m/s) from which a value counts as not stated. URDF requires numbers for both."""

_UNLIMITED = 1e3
"""Limits of a slide in m that count as none, if both are as far away as this. URDF requires limits of a slide."""


class _Urdf:
    def __init__(self, path: Path, closures: Closures | None, closure_file: Path | None) -> None:
        self.xml = Xml(path, "robot")
        self.path, self.closures, self.closure_file = path, closures, closure_file
        self.findings = Findings()
        self.efforts: dict[str, float] = {}

    def read(self) -> Imported:
        root, found = self.xml.root, self.findings
        self._strange(root, "robot", "robot")
        links = self._named(root, "link")
        joints = self._named(root, "joint")
        ends = {n: self._ends(n, j, links) for n, j in joints.items()}
        self.retyped = self._retyped(joints)
        base = self._base(links, ends)
        self.marks = self._marks(links, joints, ends, base)
        held = {c: (ends[j][0], _origin(self.xml, joints[j], f"joint '{j}'")) for c, j in self.marks.items()}
        inner = self._inner(links, joints, ends)
        held |= {a: (ends[j][1], spatial.inverse(_origin(self.xml, joints[j], j))) for a, j in inner.items()}
        closing = self._closing(links, joints, ends, held)
        held |= {a: (b, np.eye(4)) for a, b in closing.items()}
        # Only the base can be the world: in an MJCF, a body of this name is the world itself.
        reserved = () if base == WORLD else (WORLD,)
        body_names = Names("link", (n for n in links if n not in held), found, reserved)
        joint_names = Names("joint", (m for n, j in joints.items() for m in self._parts(n, j)), found)
        self.home = {n: (body_names[n], np.eye(4)) for n in links if n not in held}
        for _ in held:  # a link without body may be on another link without body
            for n, (other, T_other_n) in held.items():
                if other in self.home:
                    body, T = self.home[other]
                    self.home[n] = (body, T @ T_other_n)
        if self.closures is None:
            self._unclosed([*joints, *links])
        self._drop_mimics_of_fixed(joints)
        driven = self._driven(root, joints)
        self.crosses: list[Body] = []
        made: list[Joint] = []
        dropped = {*self.marks.values(), *inner.values()}
        tree = [n for n in joints if n not in dropped and ends[n][1] not in closing]
        loops = [n for n in joints if ends[n][1] in closing]
        for n in (*tree, *loops):
            if n in self.retyped:
                made += self._retype(n, joint_names, joints[n], ends[n], driven)
            elif joints[n].get("type") == _PLANAR:
                made += self._planar(n, joint_names, joints[n], ends[n])
            else:
                made.append(self._joint(n, joint_names[n], joints[n], ends[n], n in driven))
        visuals = _Visuals(self.xml, found)
        bodies: list[Body] = []
        for n, e in links.items():
            if n not in held:
                meshes = visuals.meshes(n, e)
                bodies.append(Body(body_names[n], tuple(meshes), self._inertia(n, e), shows_all(e, len(meshes))))
        bodies += self.crosses
        marked = [n for n in self.marks if n not in self._paired(ends)]  # the ends of loops are no frames of the robot
        frame_names = Names("frame", marked, found)
        frames = [Frame(frame_names[n], *self.home[n]) for n in marked]
        couplings = [self._mimic(n, joint_names, joints) for n in joints if joints[n].find("mimic") is not None]
        couplings += self._coupled(joint_names)
        made += self._loops(links, ends, joint_names, closing)
        geared = self._geared(root, joints, driven, joint_names)
        efforts = {joint_names[n]: e for n, e in self.efforts.items() if ends[n][1] not in self.marks}
        for text in self.xml.repaired:
            found.warn("xml", text, self.path.name)
        label = root.get("name") or self.path.stem
        out = assemble(self.path, label, body_names[base], bodies, made, frames, couplings, found, efforts=efforts)
        mechanism = replace(out.mechanism, actuators=geared[0], transmissions=geared[1])
        return self._posed(replace(out, mechanism=mechanism, posed=False), joint_names)

    def _posed(self, imported: Imported, names: Names) -> Imported:
        """Return the import at the posture `home` of the closure YAML, if there is one."""
        home = self.closures.home if self.closures else {}
        if not home:
            return imported
        for name in home:
            if name not in names:
                known = [n for n, _ in names.items()]
                raise SourceError(f"{self.closure_file}: home: {unknown('joint', name, known)}")
        values = {names[n]: q for n, q in home.items()}
        mechanism = replace(imported.mechanism, rest=moved(imported.mechanism, values))
        return replace(imported, mechanism=mechanism, keys={"home": values}, posed=True)

    # -- structure ------------------------------------------------------------------------------------

    def _named(self, root: Element, kind: str) -> dict[str, Element]:
        out = self.xml.named(root, kind)
        for name, element in out.items():
            self._strange(element, kind, f"{kind} '{name}'")
        if not out:
            raise SourceError(f"{self.path}: the file has no <{kind}>, so there is no mechanism")
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
        dynamics = element.find("dynamics") if kind == "joint" else None
        for key in ("damping", "friction"):
            if dynamics is not None and self.xml.number(where, key, dynamics.get(key), 0.0):
                self.findings.warn("friction", f"{where}: {key} {dynamics.get(key)} is not imported.", where)

    def _ends(self, name: str, joint: Element, links: dict[str, Element]) -> tuple[str, str]:
        out = []
        for end in ("parent", "child"):
            element = joint.find(end)
            link = element.get("link") if element is not None else None
            if link is None:
                self.xml.fail(f"joint '{name}'", f"the joint has no <{end} link>")
            if link not in links:
                self.xml.fail(f"joint '{name}', {end}", unknown("link", link, links))
            out.append(link)
        return out[0], out[1]

    def _base(self, links: dict[str, Element], ends: dict[str, tuple[str, str]]) -> str:
        above: dict[str, str] = {}
        for joint, (_, child) in ends.items():
            if child in above:
                text = (
                    f"the link is the child of two joints, '{above[child]}' and '{joint}', but a URDF is a tree. "
                    "Remove one of the joints, and close the loop in a YAML file given with --closures"
                )
                self.xml.fail(f"link '{child}'", text)
            above[child] = joint
        roots = [n for n in links if n not in above]
        if len(roots) != 1:
            found = ", ".join(roots) or "none: the joints form a cycle"
            raise SourceError(f"{self.path}: expected one root link, found {found}")
        return roots[0]

    def _marks(
        self, links: dict[str, Element], joints: dict[str, Element], ends: dict[str, tuple[str, str]], base: str
    ) -> dict[str, str]:
        """Return {link: the fixed joint to its parent} for the links that become named frames."""
        out = {}
        for joint, (_, child) in ends.items():
            element = links[child]
            if (
                "fixed" in (joints[joint].get("type"), self.retyped.get(joint, "").lower())
                and child != base
                and not self._has_body(child, element)
            ):
                out[child] = joint
                text = f"link '{child}' has no shape and no mass: it becomes a frame on its parent."
                self.findings.note("mark", text, child)
        return out

    def _inner(
        self, links: dict[str, Element], joints: dict[str, Element], ends: dict[str, tuple[str, str]]
    ) -> dict[str, str]:
        """Return {link: fixed joint} for links without body between a moving joint and the body fixed to them.

        Such a link is only the frame of the joint on this body.
        """
        out: dict[str, str] = {}
        above = {child: joint for joint, (_, child) in ends.items()}
        for name, element in links.items():
            below = [j for j, (parent, _) in ends.items() if parent == name]
            if name not in above or above[name] in self.retyped or self._has_body(name, element) or len(below) != 1:
                continue
            inner, outer = joints[above[name]], joints[below[0]]
            child = ends[below[0]][1]
            welded = self.retyped.get(below[0], str(outer.get("type"))).lower() == "fixed"
            if inner.get("type") != "fixed" and welded and self._has_body(child, links[child]):
                out[name] = below[0]
                text = f"link '{name}' has no shape and no mass: it becomes one body with '{child}', fixed to it."
                self.findings.note("mark", text, name)
        return out

    def _closing(
        self,
        links: dict[str, Element],
        joints: dict[str, Element],
        ends: dict[str, tuple[str, str]],
        held: Mapping[str, object],
    ) -> dict[str, str]:
        """Return {link: the link welded to it by a loop} for links without body at the end of a moving joint.

        The moving joint then closes the loop.
        """
        out: dict[str, str] = {}
        above = {child: joint for joint, (_, child) in ends.items()}
        parents = {parent for parent, _ in ends.values()}
        paired = self._paired(ends)
        for a, b, kind in self.closures.loops if self.closures else ():
            pair = [self._link(a, ends), self._link(b, ends)]
            for name, other in (pair, pair[::-1]):
                if kind != "fixed" or name not in above or other not in links or other in out:
                    continue
                joint = above[name]
                moving = joint not in self.retyped and joints[joint].get("type") in (
                    "revolute",
                    "continuous",
                    "prismatic",
                )
                leaf = name not in parents and name not in held and paired.count(name) == 1
                if moving and leaf and not self._has_body(name, links[name]):
                    out[name] = other
                    break
        return out

    def _paired(self, ends: dict[str, tuple[str, str]]) -> list[str]:
        """Return the links that the closure YAML joins, two for each loop."""
        out: list[str] = []
        for a, b, _ in self.closures.loops if self.closures else ():
            out += [self._link(a, ends), self._link(b, ends)]
        return out

    def _link(self, name: str, ends: dict[str, tuple[str, str]]) -> str:
        """Return the link that a closure means: a link of this name, or the child of the joint of this name."""
        return ends[name][1] if name in ends else name

    def _has_body(self, name: str, link: Element) -> bool:
        mass = link.find("inertial/mass")
        value = mass.get("value") if mass is not None else "0"
        heavy = self.xml.number(f"link '{name}'", "mass", value, 0.0) > _LIGHT
        return heavy or link.find("visual") is not None or link.find("collision") is not None

    def _unclosed(self, names: list[str]) -> None:
        """If there is no closure YAML, report pairs of names that look like the two ends of a cut loop."""
        ends = [
            n[:-1] for n in dict.fromkeys(names) if n.endswith("A") and f"{n[:-1]}B" in names and "loop" in n.lower()
        ]
        if ends:
            text = (
                f"{len(ends)} pairs such as '{ends[0]}A' and '{ends[0]}B' look like ends of cut loops, but there is no "
                "closure YAML, so the robot is read as a tree. Put the YAML file next to the URDF, or name the file "
                "with --closures."
            )
            self.findings.warn("closures", text, ends[0])

    def _retyped(self, joints: dict[str, Element]) -> dict[str, str]:
        """Return {joint: new type} for the joints whose type the closure YAML replaces."""
        retyped = self.closures.retyped if self.closures else {}
        leaders = {m.get("joint"): n for n, j in joints.items() if (m := j.find("mimic")) is not None}
        for name in retyped:
            where = f"{self.closure_file}: joint_name"
            if name not in joints:
                raise SourceError(f"{where}: {unknown('joint', name, joints)}")
            if joints[name].find("mimic") is not None or name in leaders:
                raise SourceError(f"{where}: joint '{name}' mimics a joint or is mimicked: its type cannot be changed")
        return retyped

    def _parts(self, name: str, joint: Element) -> list[str]:
        """Return the names of the joints made from one URDF joint.

        A universal joint becomes two hinges, a planar joint two slides and a hinge, each other joint one joint.
        """
        kind = self.retyped.get(name, "")
        if kind.startswith("UJOINT"):
            return [f"{name}_{a}" for a in kind[-2:]]
        if not kind and joint.get("type") == _PLANAR:
            return [f"{name}_{a}" for a in "xyz"]
        return [name]

    def _driven(self, root: Element, joints: dict[str, Element]) -> set[str]:
        """Return the driven joints: from the closure YAML, else from the transmissions, else all movable joints."""
        if self.closures is not None:
            for motor in self.closures.motors:
                known = {m: n for n, j in joints.items() for m in self._parts(n, j)}
                if motor not in known:
                    raise SourceError(f"{self.closure_file}: name_mot: {unknown('joint', motor, known)}")
                kind = self.retyped.get(known[motor], joints[known[motor]].get("type"))
                if kind not in ("revolute", "continuous", "prismatic") and not str(kind).startswith("UJOINT"):
                    raise SourceError(f"{self.closure_file}: name_mot: joint '{motor}' is {kind} and cannot be driven")
            return set(self.closures.motors)
        told = self._commanded(root, joints) or self._transmitted(root, joints)
        moving = {
            n
            for n, j in joints.items()
            if j.get("type") in ("revolute", "continuous", "prismatic") and j.find("mimic") is None
        }
        return told or moving

    def _drop_mimics_of_fixed(self, joints: dict[str, Element]) -> None:
        """Remove the <mimic> of each fixed joint, with a warning: tools that fix the joints of a hand often keep it."""
        for name, joint in joints.items():
            mimic = joint.find("mimic")
            if mimic is None or joint.get("type") != "fixed" or name in self.retyped:
                continue
            joint.remove(mimic)
            self.findings.warn("mimic", f"joint '{name}' is fixed, so its mimic has no effect.", name)

    def _transmitted(self, root: Element, joints: dict[str, Element]) -> set[str]:
        """Return the joints that transmissions move.

        Left out are joints that mimic another joint, which the other joint moves, and, with a warning, fixed joints and
        names of no joint: files of a part of a robot often keep the transmissions of the whole robot.
        """
        out = set()
        for transmission in root.findall("transmission"):
            label = str(transmission.get("name"))
            for joint in transmission.findall("joint"):
                name = str(joint.get("name"))
                if name not in joints:
                    text = f"transmission '{label}' moves nothing: {unknown('joint', name, joints)}"
                    self.findings.warn("gear", text, label)
                    continue
                if joints[name].get("type") == "fixed":
                    text = f"transmission '{label}': joint '{name}' is fixed, so the transmission moves nothing."
                    self.findings.warn("gear", text, label)
                    continue
                if joints[name].find("mimic") is not None:
                    text = f"joint '{name}' mimics another joint, so its transmission drives nothing."
                    self.findings.note("gear", text, name)
                    continue
                out.add(name)
        return out

    def _commanded(self, root: Element, joints: dict[str, Element]) -> set[str]:
        """Return the joints that have a command interface in a <ros2_control>; all other joints are then passive."""
        out = set()
        for system in root.findall("ros2_control"):
            for joint in system.findall("joint"):
                name = str(joint.get("name"))
                if joint.find("command_interface") is None or joint.find("mimic") is not None:
                    continue
                if name not in joints:
                    self.xml.fail("ros2_control", unknown("joint", name, joints))
                if joints[name].get("type") in ("revolute", "continuous", "prismatic"):
                    out.add(name)
        return {name for name in out if joints[name].find("mimic") is None}

    def _ratio(self, where: str, element: Element) -> float:
        """Return a mechanicalReduction; a text that is not a number counts as 1, with a warning."""
        try:
            return self.xml.number(where, element.tag, element.text, 1.0)
        except SourceError:
            shown = " ".join(str(element.text).split())[:80]
            self.findings.warn("gear", f"{where}: mechanicalReduction '{shown}' is not a number; 1 is used.", where)
            return 1.0

    def _geared(
        self, root: Element, joints: dict[str, Element], driven: set[str], names: Names
    ) -> tuple[tuple[Actuator, ...], tuple[Transmission, ...]]:
        """Return (motors, transmissions) of the joints whose gear ratio is not 1; other joints are driven directly."""
        found: dict[str, tuple[Element, float]] = {}
        for t in root.findall("transmission"):
            name, told = str(t.get("name")), [str(j.get("name")) for j in t.findall("joint")]
            where = f"transmission '{name}'"
            ratios = [self._ratio(where, r) for r in t.iter("mechanicalReduction")]
            offsets = [self.xml.number(where, o.tag, o.text, 0.0) for o in t.iter("offset")]
            if any(offsets):
                text = f"{where}: the offset is not imported; motor and joint get the same zero position."
                self.findings.warn("gear", text, name)
            single = len(told) == len(t.findall("actuator")) == len(ratios) == 1 and ratios[0] != 0
            if single and told[0] in driven - set(found) - set(self.retyped):
                if ratios[0] != 1 and TYPES.get(str(joints[told[0]].get("type"))) in ("revolute", "prismatic"):
                    found[told[0]] = t, ratios[0]
            elif told and all(joints[n].get("type") == "fixed" for n in told if n in joints):
                continue  # `_transmitted` has warned
            elif len(told) > 1 or any(r != 1 for r in ratios):
                what = (
                    f"mechanicalReduction {', '.join(f'{r:g}' for r in ratios)}"
                    if ratios
                    else "the assignment of motors to joints"
                )
                self.findings.warn("gear", f"{where}: {what} is not imported: the joints are driven directly.", name)
        motors = [(n, str(getattr(t.find("actuator"), "attrib", {}).get("name"))) for n, (t, _) in found.items()]
        motor = named_apart("motor", motors, {i for _, i in names.items()}, self.findings)
        label = named_apart("transmission", ((n, str(t.get("name"))) for n, (t, _) in found.items()), (), self.findings)
        return tuple(Actuator(n) for n in motor.values()), tuple(
            Transmission(label[n], (names[n],), (motor[n],), np.array([[1 / ratio]])) for n, (_, ratio) in found.items()
        )

    # -- parts ----------------------------------------------------------------------------------------

    def _joint(self, name: str, new: str, joint: Element, ends: tuple[str, str], active: bool) -> Joint:
        where, found = f"joint '{name}'", self.findings
        kind = joint.get("type")
        if kind not in TYPES:
            self.xml.fail(where, unknown("joint type", str(kind), (*TYPES, _PLANAR)))
        turn = np.eye(4)
        values: dict = {}
        if kind in ("revolute", "continuous", "prismatic"):
            element = joint.find("axis")
            turn = along(self.xml.axis(where, "axis", element.get("xyz") if element is not None else None, (1, 0, 0)))
            values = self._limits(where, name, kind, joint.find("limit"), joint.find("safety_controller"))
        if kind == "floating":
            found.warn("free", f"{where} is a floating joint: the robot is not fixed to the world.", name)
        body, T = self.home[ends[0]]
        outer, T_outer = self.home[ends[1]]
        return Joint(
            new,
            TYPES[kind],
            body,
            outer,
            T @ _origin(self.xml, joint, where) @ turn,
            T_outer @ turn,
            active=active,
            **values,
        )

    def _retype(
        self, name: str, names: Names, joint: Element, ends: tuple[str, str], driven: set[str]
    ) -> Iterator[Joint]:
        """Yield the joints that replace a URDF joint according to the closure YAML, in the frame of the URDF joint."""
        kind, where, (parent, T) = self.retyped[name], f"joint '{name}'", self.home[ends[0]]
        T = T @ _origin(self.xml, joint, where)
        child = self.home[ends[1]][0]
        text = f"{where}: the closure YAML sets the type {kind}, so the axis and limits of the URDF are not imported."
        self.findings.note("retyped", text, name)
        if not kind.startswith("UJOINT"):
            yield Joint(names[name], "spherical" if kind == "SPHERICAL" else "fixed", parent, child, T)
            return
        first, second = self._parts(name, joint)
        cross = self._inserted(f"{name}_cross")
        for part, a, b, at in ((first, parent, cross, T), (second, cross, child, np.eye(4))):
            turn = along(np.eye(3)["XYZ".index(part[-1])])
            yield Joint(names[part], "revolute", a, b, at @ turn, turn, active=part in driven)

    def _planar(self, name: str, names: Names, joint: Element, ends: tuple[str, str]) -> list[Joint]:
        """Return slides along x and y of the plane, and a hinge about its normal z, for a planar joint.

        As for a floating joint, no motor moves these joints. The limits of the URDF do not say which coordinate they
        limit, so they are not imported.
        """
        where, element = f"joint '{name}'", joint.find("axis")
        normal = self.xml.axis(where, "axis", element.get("xyz") if element is not None else None, (1, 0, 0))
        turn = along(normal)
        parent, T_parent_home = self.home[ends[0]]
        child, T_child_joint = self.home[ends[1]]
        first, second, third = self._parts(name, joint)
        moved_x, moved_y = self._inserted(f"{name}_moved_x"), self._inserted(f"{name}_moved_y")
        text = f"{where} is planar: it becomes the slides '{names[first]}' and '{names[second]}' and the hinge "
        self.findings.warn("planar", f"{text}'{names[third]}', which no motor drives.", name)
        limit = joint.find("limit")
        if limit is not None and (limit.get("lower") or limit.get("upper")):
            text = f"{where} is planar: the limits {limit.get('lower')} .. {limit.get('upper')} are not imported."
            self.findings.warn("limits", text, name)
        x_axis, y_axis = along(np.array([1.0, 0.0, 0.0])), along(np.array([0.0, 1.0, 0.0]))
        T_parent_plane = T_parent_home @ _origin(self.xml, joint, where) @ turn
        return [
            Joint(names[first], "prismatic", parent, moved_x, T_parent_plane @ x_axis, x_axis),
            Joint(names[second], "prismatic", moved_x, moved_y, y_axis, y_axis),
            Joint(names[third], "revolute", moved_y, child, np.eye(4), T_child_joint @ turn),
        ]

    def _inserted(self, name: str) -> str:
        """Insert a body without mass between two joints that replace one, and return its name: `name` if it is free."""
        body = identifier(name)
        while body in {b for b, _ in self.home.values()} | {b.name for b in self.crosses}:
            body += "_1"
        self.crosses.append(Body(body))
        return body

    def _limits(self, where: str, name: str, kind: str, limit: Element | None, safety: Element | None) -> dict:
        out: dict = {}

        def value(element: Element, key: str) -> float | None:
            return self.xml.number(where, key, element.get(key)) if element.get(key) is not None else None

        if limit is None:
            if kind != "continuous":
                self.findings.warn("limits", f"{where} has no <limit>: the joint is unlimited.", name)
        elif kind != "continuous":
            low, high = value(limit, "lower"), value(limit, "upper")
            if low is None and high is None:
                text = f"{where}: <limit> has neither lower nor upper: the joint is unlimited."
                self.findings.warn("limits", text, name)
            elif kind == "prismatic" and min(-(low or 0.0), high or 0.0) >= _UNLIMITED:
                pass
            else:
                # In URDF a missing limit means zero.
                out["limits"] = limits(self.path, low or 0.0, high or 0.0, name, self.findings)
        elif any(limit.get(k) is not None for k in ("lower", "upper")):
            self.findings.note("limits", f"{where} is continuous: the limits lower and upper are ignored.", name)
        if limit is not None:
            speed, effort = value(limit, "velocity"), value(limit, "effort")
            if speed is not None and speed < 0:
                self.xml.fail(where, f"velocity {speed:g} is negative")
            if speed and speed < _UNSTATED:
                out["max_speed"] = speed
            if effort and effort < _UNSTATED:
                self.efforts[name] = effort
        if safety is not None:
            low, high = value(safety, "soft_lower_limit"), value(safety, "soft_upper_limit")
            if low is not None and high is not None:
                out["soft_limits"] = limits(self.path, low, high, name, self.findings)
                self._within(out, name)
        return out

    def _within(self, out: dict, name: str) -> None:
        """Clip the soft limits to the hard limits, or remove the soft limits if the two intervals do not overlap."""
        if out.get("limits") is None or out["soft_limits"] is None:
            return
        (low, high), (first, last) = out["limits"], out["soft_limits"]
        if low <= first and last <= high:
            return
        out["soft_limits"] = (max(low, first), min(high, last))
        if not out["soft_limits"][0] < out["soft_limits"][1]:
            del out["soft_limits"]
        done = "clipped to the limits" if "soft_limits" in out else "left out"
        text = (
            f"joint '{name}': the soft limits {first:g} .. {last:g} exceed the limits {low:g} .. {high:g}; the soft "
            f"limits are {done}."
        )
        self.findings.note("soft_limits", text, name)

    def _mimic(self, name: str, names: Names, joints: dict[str, Element]) -> Coupling:
        where, mimic = f"joint '{name}', mimic", joints[name].find("mimic")
        assert mimic is not None
        leader = mimic.get("joint")
        if leader is None or leader not in joints:
            self.xml.fail(where, unknown("joint", str(leader), joints))
        if _PLANAR in (joints[name].get("type"), joints[leader].get("type")):
            self.xml.fail(where, "a planar joint has three coordinates, so it cannot mimic or be mimicked")
        ratio = self.xml.number(where, "multiplier", mimic.get("multiplier"), 1.0)
        if ratio == 0:
            self.xml.fail(where, "mimic multiplier is 0; use a fixed joint")
        total = self.xml.number(where, "offset", mimic.get("offset"), 0.0)
        return Coupling(f"{names[name]}_mimic", (names[name], names[leader]), (1.0, -ratio), total)

    def _coupled(self, names: Names) -> list[Coupling]:
        """Return the couplings of the closure YAML."""
        out = []
        for name, joints, ratios, total in self.closures.couplings if self.closures else ():
            for joint in joints:
                if joint not in names:
                    known = [n for n, _ in names.items()]
                    raise SourceError(f"{self.closure_file}: coupling: {unknown('joint', joint, known)}")
            out.append(Coupling(identifier(name), tuple(names[j] for j in joints), ratios, total))
        return out

    def _loops(
        self,
        links: dict[str, Element],
        ends: dict[str, tuple[str, str]],
        names: Names,
        closing: Collection[str],
    ) -> list[Joint]:
        """Return the joints that the closure YAML adds. If the YAML names a joint, its child link is meant."""
        out = []
        for i, (a, b, kind) in enumerate(self.closures.loops if self.closures else ()):
            sides = []
            for name in (a, b):
                link = self._link(name, ends)
                if link not in links:
                    known = [*ends, *links]
                    raise SourceError(f"{self.closure_file}: closed_loop: {unknown('joint or link', name, known)}")
                sides.append(self.home[link])
            if {self._link(a, ends), self._link(b, ends)} & set(closing):
                continue  # a moving joint closes this loop
            label = identifier(f"{_common(a, b)}") or f"loop{i + 1}"
            used = {j.name for j in out}
            label = label if label not in used and label not in names else f"loop{i + 1}_closure"
            (body_a, T_a), (body_b, T_b) = sides
            if body_a == body_b:
                raise SourceError(f"{self.closure_file}: closed_loop: '{a}' and '{b}' are on the same body, '{body_a}'")
            out.append(Joint(label, kind, body_a, body_b, T_a, T_b))
        return out

    def _inertia(self, name: str, link: Element) -> Inertia | None:
        where, element = f"link '{name}'", link.find("inertial")
        if element is None:
            return None
        T = _origin(self.xml, element, where)
        mass, tensor = element.find("mass"), element.find("inertia")
        if mass is None or tensor is None:
            lacking = "mass" if mass is None else "inertia"
            text = f"{where}: the <inertial> has no <{lacking}>: the link is imported without mass."
            self.findings.warn("inertia", text, name)
            return None
        kilograms = self.xml.number(where, "mass", mass.get("value"))
        R = T[:3, :3]
        I = R @ self.xml.tensor(where, tensor.get) @ R.T  # noqa: E741
        return possible(Inertia(kilograms, T[:3, 3], 0.5 * (I + I.T)), name, self.findings)


def _origin(xml: Xml, element: Element, where: str) -> Array:
    """Return the pose (4, 4) of an element's <origin>; the identity without <origin>."""
    found = element.find("origin")
    xyz, angles = (found.get("xyz"), found.get("rpy")) if found is not None else (None, None)
    p = xml.numbers(where, "origin xyz", xyz, 3, (0, 0, 0))
    return spatial.pose(rpy(xml.numbers(where, "origin rpy", angles, 3, (0, 0, 0))), p)


class _Visuals:
    """Reader of the links' meshes in one URDF. Links may refer to colours that the URDF defines once, by name."""

    def __init__(self, xml: Xml, findings: Findings) -> None:
        self.xml, self.findings = xml, findings
        self.path = xml.path
        self.taken: dict[str, int] = {}
        self.colors: dict[str, Color] = {}
        for m in xml.root.findall("material"):
            where = f"material '{m.get('name')}'"
            self._texture(m, where)
            if m.find("color") is not None:
                self.colors[m.get("name", "")] = self._color(m, where)

    def _texture(self, material: Element, where: str) -> None:
        texture = material.find("texture")
        if texture is not None:
            self.findings.warn("texture", f"{where}: texture {texture.get('filename')} is not imported.", where)

    def _color(self, material: Element | None, where: str) -> Color:
        color = material.find("color") if material is not None else None
        if color is None:
            return self.colors.get(material.get("name", ""), GREY) if material is not None else GREY
        return stated_color(color.get("rgba"), where, self.findings)

    def _scale(self, mesh: Element, where: str) -> Array:
        """Return the scale (3,) of a mesh; of more numbers, the first three, with a warning."""
        text = mesh.get("scale")
        words = (text or "").split()
        if len(words) > 3:
            self.findings.warn(
                "shape", f"{where}: of the mesh scale '{text}', the first three numbers are used.", where
            )
            text = " ".join(words[:3])
        return self.xml.numbers(where, "mesh scale", text, 3, (1, 1, 1))

    def meshes(self, name: str, link: Element) -> list[Mesh]:
        """Return the visual shapes of a link; if there are none, or none can be read, its collision shapes."""
        ignored = f"link '{name}': its <collision> shapes are not imported; the visual meshes are used for collision."
        return link_meshes(name, link, self._shapes, self.findings, ignored)

    def _shapes(self, name: str, elements: list[Element]) -> list[Mesh]:
        """Return the shapes that can be read of the <visual> or <collision> elements of a link."""
        where, out = f"link '{name}'", []
        for element in elements:
            geometry = element.find("geometry")
            shape = geometry[0] if geometry is not None and len(geometry) else None
            if shape is None:
                self.xml.fail(where, f"a <{element.tag}> has no shape in a <geometry>")
            if shape.tag == "mesh":
                scale = self._scale(shape, where)
                solid = mesh_file(shape.get("filename", ""), self.path.parent, scale, name, self.findings)
            elif shape.tag in SIZES:
                solid = sized(self.xml, where, shape.tag, shape.get, self.findings)
            else:
                self.xml.fail(where, unknown("shape", str(shape.tag), (*SIZES, "mesh")))
            if solid is not None:
                stem = identifier(f"{name}_shape")
                self.taken[stem] = self.taken.get(stem, 0) + 1
                label = stem if self.taken[stem] == 1 else f"{stem}_{self.taken[stem]}"
                material = element.find("material")
                if material is not None:
                    self._texture(material, where)
                color = self._color(material, where)
                out.append(placed(label, *solid, _origin(self.xml, element, where), color))
        return out


def _common(a: str, b: str) -> str:
    """Return the common prefix of two names, such as `closedloop1` for `closedloop1_A` and `closedloop1_B`."""
    n = next((i for i, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))
    return a[:n].rstrip("_-")


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of a URDF, with the loops in its closure YAML; see `read_urdf`."""
    beside = path.with_suffix(".yaml")
    return read_urdf(path, options.closures or (beside if beside.is_file() else None))
