"""Resolve the poses of an SDF: each is stated relative to another element, and needed in the frame of the model.

A <pose relative_to="x"> is T_x_element, so that T_model_element = T_model_x @ T_x_element, and so on up to the model.
"""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree.ElementTree import Element

import numpy as np

from twin.core import spatial
from twin.core.errors import SourceError, unknown
from twin.core.spatial import Array
from twin.exchange.read.imported_robot import Findings, rpy
from twin.exchange.read.xml_file import Xml
from twin.model.mechanism import WORLD

_SHORTEST_QUATERNION = 1e-9
"""Length up to which a quaternion is zero, and so no rotation."""


class ModelPoses:
    """The poses of the links, joints and frames of one model.

    Attributes:
        T_world_model: pose (4, 4) of the model in the world.
    """

    def __init__(
        self,
        xml: Xml,
        model: Element,
        links: Mapping[str, Element],
        elements: Mapping[str, Element],
        findings: Findings,
    ) -> None:
        """Take the model, its links by name, and its links, joints and frames by name, `elements`."""
        self._xml = xml
        self._model = model
        self._links = links
        self._elements = elements
        self._findings = findings
        self._known: dict[str, Array] = {}  # poses in the model that have been resolved
        self.T_world_model = self._model_pose()

    def _model_pose(self) -> Array:
        """Return T_world_model (4, 4), the pose of the model in the world."""
        where = f"model '{self._model.get('name')}'"
        pose = self._model.find("pose")
        relative = ""
        if pose is not None:
            relative = pose.get("relative_to") or ""
        if relative not in ("", "world"):
            text = f"{where}: its pose relative to '{relative}' is not read; the model is placed at the origin."
            self._findings.warn("pose", text, where)
            return np.eye(4)
        T_world_placed = self.stated(self._model, where)
        T_model_placed = self.in_model(self._model.get("placement_frame") or "", (WORLD,))
        return T_world_placed @ spatial.inverse(T_model_placed)

    def stated(self, element: Element, where: str) -> Array:
        """Return the pose (4, 4) that the <pose> of an element states, in whatever frame; the identity without one."""
        pose = element.find("pose")
        if pose is None or not (pose.text or "").strip():
            return np.eye(4)
        notation = pose.get("rotation_format", "euler_rpy")
        if notation == "quat_xyzw":
            values = self._xml.numbers(where, "pose", pose.text, 7, None)
            x, y, z, w = values[3:]
            length = float(np.linalg.norm(values[3:]))
            if not length > _SHORTEST_QUATERNION:
                self._xml.fail(where, f"pose: the quaternion {x:g} {y:g} {z:g} {w:g} has length 0")
            # Normalised, because the few digits of a file leave a length that is not exactly 1.
            return spatial.pose(spatial.matrix_from_quat_wxyz(np.array([w, x, y, z]) / length), values[:3])
        if notation != "euler_rpy":
            self._xml.fail(where, f"pose: rotation_format '{notation}' is unknown: use euler_rpy or quat_xyzw")
        values = self._xml.numbers(where, "pose", pose.text, 6, None)
        angles = values[3:]
        if pose.get("degrees") in ("true", "1"):
            angles = angles * (np.pi / 180)
        return spatial.pose(rpy(angles), values[:3])

    def in_model(self, name: str, visited: tuple[str, ...] = ()) -> Array:
        """Return T_model_x (4, 4) for x, the link, joint or frame with the given name.

        `visited` are the names whose poses wait for this one.

        Raises:
            SourceError: there is no such name, or the pose is relative to itself.
        """
        if name in ("__model__", ""):
            return np.eye(4)
        if name == WORLD:
            if WORLD in visited:  # `_model_pose` asks, which is about to compute the pose in the world
                self._xml.fail("placement_frame", "the frame that places the model is itself placed in the world")
            return spatial.inverse(self.T_world_model)
        if name in self._known:
            return self._known[name]
        if name not in self._elements:
            raise SourceError(
                f"{self._xml.path}: pose, relative_to: {unknown('link, joint or frame', name, self._elements)}"
            )
        if name in visited:
            self._xml.fail(f"'{name}'", f"the pose is relative to itself: {' -> '.join((*visited, name))}")
        element = self._elements[name]
        T_model_relative = self.in_model(_relative_to(element), (*visited, name))
        T_relative_x = self.stated(element, f"{element.tag} '{name}'")
        self._known[name] = T_model_relative @ T_relative_x
        return self._known[name]

    def of_joint(self, name: str, joint: Element) -> Array:
        """Return T_model_joint (4, 4), also of a joint that has the name of a link."""
        if self._elements[name] is joint:
            return self.in_model(name)
        return self.in_model(_relative_to(joint)) @ self.stated(joint, f"joint '{name}'")

    def in_link(self, link: str, element: Element) -> Array:
        """Return T_link_element (4, 4) of a <visual> or <collision> of the link with the given name.

        Raises:
            SourceError: its pose is relative to a frame that does not exist, or has not the right numbers.
        """
        T_stated = self.stated(element, f"link '{link}'")
        pose = element.find("pose")
        if pose is None or not pose.get("relative_to"):
            return T_stated
        T_model_relative = self.in_model(pose.get("relative_to", ""))
        return spatial.inverse(self.in_model(link)) @ T_model_relative @ T_stated

    def carrier(self, name: str, visited: tuple[str, ...] = ()) -> str:
        """Return the link that carries the link, joint or frame with the given name.

        `visited` are the names that the search has passed.

        Raises:
            SourceError: there is no such name, or a frame is attached to itself.
        """
        if name in self._links:
            return name
        if name in visited:
            raise SourceError(f"{self._xml.path}: frame '{name}' is attached to itself")
        element = self._elements.get(name)
        if element is None:
            raise SourceError(f"{self._xml.path}: frame '{name}' does not exist")
        if element.tag == "joint":
            carrier = element.findtext("child")
        else:
            carrier = element.get("attached_to")
        carrier = (carrier or "").strip()
        if carrier in ("", "__model__"):
            # A frame without `attached_to` belongs to the model, whose frame is that of its canonical link.
            carrier = self._model.get("canonical_link") or next(iter(self._links))
        return self.carrier(carrier, (*visited, name))


def _relative_to(element: Element) -> str:
    """Return the name of the frame in which a link, joint or frame states its pose; "" for that of the model."""
    relative = ""
    pose = element.find("pose")
    if pose is not None:
        relative = pose.get("relative_to") or ""
    # Without `relative_to`, a joint is relative to its child link, and a frame to the link that carries it.
    if not relative and element.tag == "joint":
        relative = (element.findtext("child") or "").strip()
    if not relative and element.tag == "frame":
        relative = element.get("attached_to") or ""
    return relative
