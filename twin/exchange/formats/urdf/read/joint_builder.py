"""Make the joints and couplings of a mechanism from those of a URDF and of its closure YAML.

URDF states the axis of a joint in the frame of the joint; a joint of a mechanism moves along or about its z:

    T_parent_joint = T_parent_urdf @ T_urdf_axis,    T_child_joint = T_child_urdf @ T_urdf_axis

with T_urdf_axis, which turns z to the axis. `T_child_urdf` is the identity for a link that is a body.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from os.path import commonprefix
from xml.etree.ElementTree import Element

import numpy as np

from twin.core.errors import SourceError, unknown
from twin.core.identifiers import identifier
from twin.core.spatial import Array
from twin.exchange.formats.urdf.read.bounds import JointBounds, read_bounds
from twin.exchange.formats.urdf.read.gears import MOVING
from twin.exchange.formats.urdf.read.link_structure import PLANAR, LinkStructure
from twin.exchange.formats.urdf.read.visuals import origin
from twin.exchange.read.imported_robot import Names, pose_along
from twin.model.body import Body
from twin.model.joint import Joint, JointType
from twin.model.mechanism import Coupling

TYPES: dict[str, JointType] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
    "floating": "free",
}
"""Joint types of URDF that become one joint of a mechanism."""


class JointBuilder:
    """Builder of the joints and couplings of a mechanism.

    Attributes:
        structure: the links and joints of the file.
        names: identifiers of the joints and parts of joints.
        body_of_link: {link: (body that carries it, T_body_link)}; a link that is a body carries itself.
        efforts: {joint of the URDF: maximum effort in N or N m}, filled as joints are made.
        inserted_bodies: bodies without mass between the joints that replace one URDF joint, filled likewise.
    """

    def __init__(self, structure: LinkStructure, names: Names, body_of_link: Mapping[str, tuple[str, Array]]) -> None:
        self.structure = structure
        self.names = names
        self.body_of_link = body_of_link
        self.efforts: dict[str, float] = {}
        self.inserted_bodies: list[Body] = []

    def tree_and_loop_joints(
        self, dropped: Collection[str], loop_closers: Collection[str], driven: Collection[str]
    ) -> list[Joint]:
        """Return the joints of the mechanism: first those of the tree, then those that close loops."""
        tree: list[str] = []
        loops: list[str] = []
        for name in self.structure.joints:
            if self.structure.joint_links[name][1] in loop_closers:
                loops.append(name)
            elif name not in dropped:
                tree.append(name)
        joints: list[Joint] = []
        for name in (*tree, *loops):
            if name in self.structure.retyped:
                joints += self._replacement_joints(name, driven)
            elif self.structure.joints[name].get("type") == PLANAR:
                joints += self._planar_joints(name)
            else:
                joints.append(self._joint(name, self.names[name], name in driven))
        return joints

    def _joint(self, name: str, label: str, active: bool) -> Joint:
        """Return the joint called `label` for a URDF joint with one coordinate, none, or six."""
        where = f"joint '{name}'"
        joint = self.structure.joints[name]
        kind = joint.get("type")
        if kind not in TYPES:
            self.structure.xml.fail(where, unknown("joint type", str(kind), (*TYPES, PLANAR)))
        # URDF states an axis in the frame of the joint; a joint of a mechanism moves along its z.
        T_joint_axis = np.eye(4)
        bounds = JointBounds()
        if kind in MOVING:
            T_joint_axis = pose_along(self._axis(where, joint))
            bounds = read_bounds(self.structure.xml, name, joint, self.structure.findings)
            if bounds.max_effort is not None:
                self.efforts[name] = bounds.max_effort
        if kind == "floating":
            self.structure.findings.warn(
                "free", f"{where} is a floating joint: the robot is not fixed to the world.", name
            )
        parent, child = self.structure.joint_links[name]
        inner, T_inner_parent = self.body_of_link[parent]
        outer, T_outer_child = self.body_of_link[child]
        return Joint(
            label,
            TYPES[kind],
            inner,
            outer,
            T_inner_parent @ origin(self.structure.xml, joint, where) @ T_joint_axis,
            T_outer_child @ T_joint_axis,
            active=active,
            limits=bounds.limits,
            soft_limits=bounds.soft_limits,
            max_speed=bounds.max_speed,
        )

    def _axis(self, where: str, joint: Element) -> Array:
        element = joint.find("axis")
        text = None if element is None else element.get("xyz")
        return self.structure.xml.axis(where, "axis", text, (1, 0, 0))  # x is the default of URDF

    def _replacement_joints(self, name: str, driven: Collection[str]) -> list[Joint]:
        """Return the joints that replace a URDF joint according to the closure YAML, in the frame of the URDF joint."""
        where = f"joint '{name}'"
        kind = self.structure.retyped[name]
        parent, T_parent_link = self.body_of_link[self.structure.joint_links[name][0]]
        T_parent_joint = T_parent_link @ origin(self.structure.xml, self.structure.joints[name], where)
        # The child is a body, so its pose on the body is the identity: `find_joint_frames` keeps such a link as one.
        child, _ = self.body_of_link[self.structure.joint_links[name][1]]
        text = f"{where}: the closure YAML sets the type {kind}, so the axis and limits of the URDF are not imported."
        self.structure.findings.note("retyped", text, name)
        if kind == "SPHERICAL":
            return [Joint(self.names[name], "spherical", parent, child, T_parent_joint)]
        if kind == "FIXED":
            return [Joint(self.names[name], "fixed", parent, child, T_parent_joint)]
        first, second = self.structure.part_names(name)
        cross = self._insert_body(f"{name}_cross")
        joints = []
        for part, inner, outer, T_inner in ((first, parent, cross, T_parent_joint), (second, cross, child, np.eye(4))):
            axis = np.eye(3)["XYZ".index(part[-1])]  # the names of the parts end with their axis
            T_joint_axis = pose_along(axis)
            is_driven = part in driven
            joints.append(
                Joint(
                    self.names[part], "revolute", inner, outer, T_inner @ T_joint_axis, T_joint_axis, active=is_driven
                )
            )
        return joints

    def _planar_joints(self, name: str) -> list[Joint]:
        """Return slides along x and y of the plane, and a hinge about its normal z, for a planar joint.

        As for a floating joint, no motor moves these joints. The limits of the URDF do not say which coordinate they
        limit, so they are not imported.
        """
        where = f"joint '{name}'"
        joint = self.structure.joints[name]
        T_joint_normal = pose_along(self._axis(where, joint))
        parent, T_parent_link = self.body_of_link[self.structure.joint_links[name][0]]
        child, T_child_joint = self.body_of_link[self.structure.joint_links[name][1]]
        first, second, third = self.structure.part_names(name)
        x_carriage = self._insert_body(f"{name}_moved_x")
        y_carriage = self._insert_body(f"{name}_moved_y")
        text = (
            f"{where} is planar: it becomes the slides '{self.names[first]}' and '{self.names[second]}' and the hinge "
        )
        self.structure.findings.warn("planar", f"{text}'{self.names[third]}', which no motor drives.", name)
        limit = joint.find("limit")
        if limit is not None and (limit.get("lower") or limit.get("upper")):
            text = f"{where} is planar: the limits {limit.get('lower')} .. {limit.get('upper')} are not imported."
            self.structure.findings.warn("limits", text, name)
        x_axis = pose_along(np.array([1.0, 0.0, 0.0]))
        y_axis = pose_along(np.array([0.0, 1.0, 0.0]))
        T_parent_plane = T_parent_link @ origin(self.structure.xml, joint, where) @ T_joint_normal
        return [
            Joint(self.names[first], "prismatic", parent, x_carriage, T_parent_plane @ x_axis, x_axis),
            Joint(self.names[second], "prismatic", x_carriage, y_carriage, y_axis, y_axis),
            Joint(self.names[third], "revolute", y_carriage, child, np.eye(4), T_child_joint @ T_joint_normal),
        ]

    def _insert_body(self, name: str) -> str:
        """Insert a body without mass between two joints that replace one, and return its name: `name` if it is free."""
        taken_names: set[str] = set()
        for carrier, _ in self.body_of_link.values():
            taken_names.add(carrier)
        for inserted in self.inserted_bodies:
            taken_names.add(inserted.name)
        body = identifier(name)
        while body in taken_names:
            body += "_1"
        self.inserted_bodies.append(Body(body))
        return body

    def mimic_coupling(self, name: str) -> Coupling:
        """Return the coupling of a joint with <mimic>: joint value = multiplier * leader value + offset."""
        where = f"joint '{name}', mimic"
        mimic = self.structure.joints[name].find("mimic")
        assert mimic is not None  # the caller asks only for joints with one
        leader = mimic.get("joint")
        if leader is None or leader not in self.structure.joints:
            self.structure.xml.fail(where, unknown("joint", str(leader), self.structure.joints))
        if leader == name:
            self.structure.xml.fail(where, "the joint mimics itself: name another joint, or remove the mimic")
        if PLANAR in (self.structure.joints[name].get("type"), self.structure.joints[leader].get("type")):
            self.structure.xml.refuse(where, "a planar joint has three coordinates, so it cannot mimic or be mimicked")
        ratio = self.structure.xml.number(where, "multiplier", mimic.get("multiplier"), 1.0)
        if ratio == 0:
            self.structure.xml.refuse(where, "mimic multiplier is 0; use a fixed joint")
        offset = self.structure.xml.number(where, "offset", mimic.get("offset"), 0.0)
        # joint = ratio * leader + offset, written as the sum of a coupling: 1 * joint - ratio * leader = offset
        return Coupling(f"{self.names[name]}_mimic", (self.names[name], self.names[leader]), (1.0, -ratio), offset)

    def closure_couplings(self) -> list[Coupling]:
        """Return the couplings of the closure YAML."""
        couplings: list[Coupling] = []
        if self.structure.closures is None:
            return couplings
        for name, joints, ratios, total in self.structure.closures.couplings:
            coupled: list[str] = []
            for joint in joints:
                if joint not in self.names:
                    raise SourceError(
                        f"{self.structure.closure_file}: coupling: {unknown('joint', joint, self.names.known())}"
                    )
                coupled.append(self.names[joint])
            couplings.append(Coupling(identifier(name), tuple(coupled), ratios, total))
        return couplings

    def closure_joints(self, loop_closers: Collection[str]) -> list[Joint]:
        """Return the joints that the closure YAML adds. If the YAML names a joint, its child link is meant."""
        closure_joints: list[Joint] = []
        if self.structure.closures is None:
            return closure_joints
        for index, (first_name, second_name, kind) in enumerate(self.structure.closures.loops):
            first_link = self.structure.link_of(first_name)
            second_link = self.structure.link_of(second_name)
            for name, link in ((first_name, first_link), (second_name, second_link)):
                if link not in self.structure.links:
                    known_names = [*self.structure.joint_links, *self.structure.links]
                    raise SourceError(
                        f"{self.structure.closure_file}: closed_loop: {unknown('joint or link', name, known_names)}"
                    )
            if first_link in loop_closers or second_link in loop_closers:
                continue  # a moving joint closes this loop
            # The common part of the two names, such as `closedloop1` of `closedloop1_A` and `closedloop1_B`.
            common = commonprefix((first_name, second_name))  # noqa: RUF071 - of characters, not of folders
            label = identifier(common.rstrip("_-"))
            used_names = {joint.name for joint in closure_joints}
            if label in used_names or label in self.names:
                label = f"loop{index + 1}_closure"
            first_body, T_first = self.body_of_link[first_link]
            second_body, T_second = self.body_of_link[second_link]
            if first_body == second_body:
                text = f"'{first_name}' and '{second_name}' are on the same body, '{first_body}'"
                raise SourceError(f"{self.structure.closure_file}: closed_loop: {text}")
            closure_joints.append(Joint(label, kind, first_body, second_body, T_first, T_second))
        return closure_joints
