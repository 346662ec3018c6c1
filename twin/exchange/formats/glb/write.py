"""Write <robot>.glb: glTF 2.0 in one file, written without a library so that the file is reproducible byte by byte.

glTF is y up. The root node rotates the robot to y up. Link nodes are children of the root node. Poses of link nodes are
relative to the robot's base frame (z up), which is the world frame of a mechanism, so that link poses from a track or a
stream can be assigned to the nodes unchanged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from twin.core.findings import Finding
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.exchange.formats.glb.document import GltfDocument
from twin.exchange.write.clip import Clip
from twin.exchange.write.home_poses import home_poses
from twin.exchange.write.model_hash import model_hash
from twin.exchange.write.order import Order
from twin.exchange.write.player_interpolation import quaternions_xyzw
from twin.model.body import Body
from twin.model.deformable import Bend
from twin.model.mechanism import Mechanism

UP_XYZW = (-float(np.sqrt(0.5)), 0.0, 0.0, float(np.sqrt(0.5)))
"""Rotation of the root node as a quaternion: -90 degrees about x, from z up to y up."""

_POSE_ROUNDING = 1e-10
"""Maximum change of a pose (in m, and in entries of the rotation matrix) that is not animated."""


def write_glb(mechanism: Mechanism, clips: Sequence[Clip], path: Path) -> Path:
    """Write a robot at home with its clips as a .glb file, and return the path of the file."""
    path.write_bytes(glb_bytes(mechanism, clips))
    return path


def glb_bytes(mechanism: Mechanism, clips: Sequence[Clip] = (), link_poses: Mapping[str, Array] | None = None) -> bytes:
    """Return the content of a .glb file; each clip becomes an animation with its name, unless no clip moves a link.

    `link_poses` contains T_world_body (4, 4) of every body at rest; None: the poses at home with closed loops.
    """
    rest_poses = home_poses(mechanism) if link_poses is None else link_poses
    document = GltfDocument()
    root, frames = node_names(mechanism, clips)
    children: list[int] = []
    nodes: list[JsonObject] = [{"name": root, "rotation": list(UP_XYZW), "children": children}]
    node_of_body = {}
    for body in mechanism.bodies:
        node_of_body[body.name] = len(nodes)
        children.append(len(nodes))
        node: JsonObject = {
            "name": body.name,
            **_translation_and_rotation(rest_poses[body.name]),
            "extras": _link_extras(mechanism, body),
        }
        mesh = document.mesh(body, mechanism.materials)
        if mesh is not None:
            node["mesh"] = mesh
        nodes.append(node)
    for frame in mechanism.frames:
        if frame.name not in frames:
            continue
        link = nodes[node_of_body[frame.body]]
        link.setdefault("children", []).append(len(nodes))
        nodes.append(
            {
                "name": frames[frame.name],
                **_translation_and_rotation(frame.T_body_frame),
                "extras": {"frame": frame.name},
            }
        )
    moving = moving_paths(clips, rest_poses)
    animations = []
    if moving:
        for clip in clips:
            animations.append(document.animation(clip, node_of_body, moving))
    asset_extras = {
        "schema": "twin-glb",
        "version": 1,
        "robot": mechanism.name,
        "model_hash": model_hash(mechanism),
        "units": "m, kg, s",
        "frame": "links below the root node: z-up right-handed",
    }
    return document.packed(mechanism.name, asset_extras, nodes, animations)


def _link_extras(mechanism: Mechanism, body: Body) -> JsonObject:
    """Return the data of a link that glTF cannot express: mass, and names of the joints that move it."""
    extras: JsonObject = {"link": body.name}
    if body.inertia is not None:
        extras["mass"] = float(f"{body.inertia.mass:.9g}")
    if not body.whole:
        extras["whole"] = False
    extras["joints"] = [joint.name for joint in mechanism.joints if joint.child == body.name]
    return extras


def bends_glb(name: str, bends: Sequence[Bend]) -> bytes:
    """Return a .glb file of moving deformables, such as organs; each deformable is a mesh with morph targets.

    The only animation is `motion`. Vertices are relative to the World frame (z up); the root node rotates the meshes to
    y up.
    """
    document = GltfDocument()
    children: list[int] = []
    nodes: list[JsonObject] = [{"name": name, "rotation": list(UP_XYZW), "children": children}]
    channels: list[JsonObject] = []
    samplers: list[JsonObject] = []
    for bend in bends:
        shapes, factors = bend.shapes()
        node = len(nodes)
        children.append(node)
        nodes.append({"name": bend.name, "mesh": document.bending(bend, shapes)})
        if len(shapes):
            keys = bend.changes()
            channels.append({"sampler": len(samplers), "target": {"node": node, "path": "weights"}})
            samplers.append(document.keys(bend.times[keys], factors[keys].reshape(-1, 1), "SCALAR"))
    asset_extras = {"schema": "twin-deformables", "version": 1, "units": "m, kg, s"}
    animations: list[JsonObject] = []
    if channels:
        animations.append({"name": "motion", "channels": channels, "samplers": samplers})
    return document.packed(name, asset_extras, nodes, animations)


def node_names(mechanism: Mechanism, clips: Sequence[Clip]) -> tuple[str, dict[str, str]]:
    """Return (name of the root node, {frame: name of its node}). Link nodes have the names of their bodies.

    All names are unique, because Unity and three.js address nodes by name only.
    """
    used_names = {body.name for body in mechanism.bodies}

    def unused_name(name: str) -> str:
        """Return a name with as many _ behind it as make it another than those in use."""
        while name in used_names:
            name += "_"
        used_names.add(name)
        return name

    root = unused_name(mechanism.name)
    frames_of_clips = {mechanism.tool}
    frames_of_clips.update(clip.frame for clip in clips)
    names = {}
    for frame in mechanism.frames:
        if frame.name in frames_of_clips:
            names[frame.name] = unused_name(f"frame_{frame.name}")
    return root, names


def moving_paths(clips: Sequence[Clip], rest_poses: Mapping[str, Array]) -> set[tuple[str, str]]:
    """Return (link, "translation" or "rotation") for each link property that changes in at least one clip.

    Every clip animates all these properties. Otherwise, if a clip did not animate a property, players would keep the
    value from the clip before.
    """
    moving = set()
    for clip in clips:
        for name, Ts in clip.links.items():
            change = np.abs(Ts - rest_poses[name])
            if change[:, :3, 3].max() > _POSE_ROUNDING:
                moving.add((name, "translation"))
            if change[:, :3, :3].max() > _POSE_ROUNDING:
                moving.add((name, "rotation"))
    return moving


def _translation_and_rotation(T: Array) -> JsonObject:
    """Return a node's pose as translation and rotation, because glTF cannot animate nodes with a matrix."""
    xyzw = quaternions_xyzw(T[None])[0]
    return {"translation": (T[:3, 3] + 0.0).tolist(), "rotation": (xyzw + 0.0).tolist()}


def write(order: Order, folder: Path) -> list[Finding]:
    """Write one file with the shapes and all motions of a robot into `folder`."""
    write_glb(order.mechanism, order.clips, folder / f"{order.mechanism.name}.glb")
    return []


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    content = "shapes and all motions, y up" if order.clips else "shapes, y up"
    return [(f"{order.mechanism.name}.glb", content)]
