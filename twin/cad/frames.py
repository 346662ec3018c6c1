"""Poses of bodies, joints and named frames in drawn coordinates, computed from the measured faces of each body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from twin.cad import features
from twin.cad.description import BodySpec, Description, FrameSpec
from twin.cad.features import MeasuredFeature
from twin.core import spatial
from twin.core.errors import CadError
from twin.core.spatial import Array
from twin.model.body import Frame, Point
from twin.model.mechanism import Mechanism

Faces = Mapping[str, Mapping[str, MeasuredFeature]]
"""{body: {name: measured feature}}, in drawn coordinates."""


@dataclass(frozen=True)
class DrawnFrames:
    """Frames (4, 4) in drawn coordinates.

    Attributes:
        on: {joint: (frame on the parent, frame on the child)}.
        named: {name of a frame: frame}.
        bodies: {body: its frame}: the named frame that the description selects; otherwise, the child frame of the first
            joint whose child is the body.
    """

    on: Mapping[str, tuple[Array, Array]]
    named: Mapping[str, Array]
    bodies: Mapping[str, Array]

    def on_parent(self, joint: str, body: str) -> Array:
        """Return T_body_joint (4, 4) of a joint's frame on its parent."""
        return spatial.inverse(self.bodies[body]) @ self.on[joint][0]

    def on_child(self, joint: str, body: str) -> Array:
        """Return T_body_joint (4, 4) of a joint's frame on its child."""
        return spatial.inverse(self.bodies[body]) @ self.on[joint][1]


GivenFrames = Mapping[tuple[str, str], Array]
"""{(joint, body): frame (4, 4) in drawn coordinates}; replaces the frames that the description gives by numbers."""


def drawn(description: Description, faces: Faces, given_frames: GivenFrames | None = None) -> DrawnFrames:
    """Return all frames of the description, computed from the measured faces; `given_frames` replaces those of joints.

    Raises:
        CadError: a feature is unknown, or features do not define a frame.
    """
    given_frames = given_frames or {}
    joint_frames: dict[str, tuple[Array, Array]] = {}
    for joint in description.joint:
        parent = _frame(
            description, faces, joint.parent, joint.on_parent, f"joint '{joint.name}' on body '{joint.parent}'"
        )
        child = _frame(description, faces, joint.child, joint.on_child, f"joint '{joint.name}' on body '{joint.child}'")
        parent = given_frames.get((joint.name, joint.parent), parent)
        child = given_frames.get((joint.name, joint.child), child)
        joint_frames[joint.name] = (parent, child)
    named = {}
    for name, spec in description.frame.items():
        named[name] = _frame(description, faces, spec.body, spec.at, f"frame '{name}' on body '{spec.body}'")
    bodies = {}
    for name, spec in description.body.items():
        bodies[name] = _body(description, name, spec, joint_frames, named)
    return DrawnFrames(joint_frames, named, bodies)


def frames(description: Description, drawn_frames: DrawnFrames) -> tuple[Frame, ...]:
    """Return the named frames, each relative to its body."""
    built = []
    for name, spec in description.frame.items():
        built.append(Frame(name, spec.body, spatial.inverse(drawn_frames.bodies[spec.body]) @ drawn_frames.named[name]))
    return tuple(built)


def points(description: Description, drawn_frames: DrawnFrames, faces: Faces) -> tuple[Point, ...]:
    """Return the named points, in m, each in the frame of its body."""
    built = []
    for name, spec in description.point.items():
        point = features.point(spec, faces.get(spec.body, {}))
        built.append(Point(name, spec.body, into(drawn_frames.bodies[spec.body], point)))
    return tuple(built)


def rest(description: Description, drawn_frames: DrawnFrames) -> dict[str, Array]:
    """Return T_base_body (4, 4) of every body as in the CAD."""
    T_base_drawn = spatial.inverse(drawn_frames.bodies[description.base])
    poses: dict[str, Array] = {}
    for body, T_drawn_body in drawn_frames.bodies.items():
        poses[body] = T_base_drawn @ T_drawn_body
    return poses


def moved(
    mechanism: Mechanism, description: Description, faces: Faces, given_frames: GivenFrames | None = None
) -> Mechanism:
    """Return the mechanism with joints, frames and points computed from `faces`, without meshes and masses.

    Raises:
        CadError: the faces do not define a frame.
    """
    drawn_frames = drawn(description, faces, given_frames)
    joints = []
    for joint in mechanism.joints:
        T_parent_joint = drawn_frames.on_parent(joint.name, joint.parent)
        T_child_joint = drawn_frames.on_child(joint.name, joint.child)
        joints.append(replace(joint, T_parent_joint=T_parent_joint, T_child_joint=T_child_joint))
    # Meshes and masses belong to the frames as drawn; with moved faces, they would stand beside their joints.
    bodies = [replace(body, meshes=(), inertia=None) for body in mechanism.bodies]
    return replace(
        mechanism,
        bodies=tuple(bodies),
        joints=tuple(joints),
        frames=frames(description, drawn_frames),
        points=points(description, drawn_frames, faces),
        rest=rest(description, drawn_frames),
    )


def into(T_drawn_body: Array, points: Array) -> Array:
    """Convert points (..., 3) from drawn coordinates to the body frame."""
    return (points - T_drawn_body[:3, 3]) @ T_drawn_body[:3, :3]


def _frame(description: Description, faces: Faces, body: str, spec: FrameSpec, where: str) -> Array:
    try:
        return features.frame(spec, faces.get(body, {}))
    except CadError as error:
        raise CadError(f"{description.name}: {where}: {error}") from error


def _body(
    description: Description,
    body: str,
    spec: BodySpec,
    joint_frames: Mapping[str, tuple[Array, Array]],
    named: Mapping[str, Array],
) -> Array:
    if spec.frame is not None:
        return named[spec.frame]
    for joint in description.joint:
        if joint.child == body:
            _, on_child = joint_frames[joint.name]
            return on_child
    # A body that is the child of no joint, as the base: its frame is that of the drawing.
    return np.eye(4)
