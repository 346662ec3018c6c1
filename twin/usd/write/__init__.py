"""Write a mechanism as USD: `<robot>.usda` with the sublayers physics.usda and geometry.usdc; and baked motions.

    layers           metadata of every layer, unique leaf names
    geometry         geometry.usdc: rest poses, meshes, materials, named frames and points
    physics_layer    physics.usda: masses, colliders, joints, drives, joint states
    spanning         which joints form the tree, and which close loops
    motion_layer     motion/<protocol>.usdc and the root layer that plays it
    deformables      the layer of the organs of a scene, with their motion

The files are reproducible byte by byte: they contain no time stamps and no absolute paths.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from twin.core import spatial
from twin.core.errors import StageError, unknown
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.usd.write.geometry import RESERVED_NAMES, write_geometry
from twin.usd.write.layers import root_layer
from twin.usd.write.motion_layer import BakedMotion, MotionFiles, write_motion
from twin.usd.write.physics_layer import write_physics

__all__ = ["BakedMotion", "MotionFiles", "StageFiles", "write_motion", "write_stage"]


@dataclass(frozen=True)
class StageFiles:
    """Paths of the files of a robot."""

    root: Path
    physics: Path
    geometry: Path


def write_stage(
    mechanism: Mechanism,
    folder: Path,
    link_poses: Mapping[str, Array],
    q_full: Mapping[str, float],
    *,
    efforts: Mapping[str, float] | None = None,
) -> StageFiles:
    """Write the layers of `mechanism` into `folder`, which the caller moves to its final place.

    Args:
        mechanism: the robot.
        folder: created if it is missing; files with the same names are replaced.
        link_poses: T_world_body (4, 4) of every body in a state with closed loops, world z up.
        q_full: coordinate in m or rad, at these poses, of every tree joint with a single coordinate; also of loop
            joints, if known.
        efforts: effort in N or N m that balances gravity at these poses, by driven joint; drive targets are offset so
            that a simulated robot does not sag.

    Raises:
        StageError: a pose is missing or not rigid, a name is reserved, or UsdPhysics cannot hold the data of a joint.
    """
    folder = Path(folder)
    bodies = sorted(body.name for body in mechanism.bodies)
    for name in bodies:
        if name in RESERVED_NAMES:
            raise StageError(f"{mechanism.name}: a body cannot have the name '{name}', which is reserved for a scope")
    for name in bodies:
        if name not in link_poses:
            raise StageError(f"{mechanism.name}: link_poses lacks body '{name}'")
        if not spatial.is_pose(link_poses[name], 1e-6):
            raise StageError(f"{mechanism.name}: the pose of body '{name}' is not rigid")
    joints = [joint.name for joint in mechanism.joints]
    for name in q_full:
        if name not in joints:
            raise StageError(f"{mechanism.name}, q_full: {unknown('joint', name, joints)}")
    folder.mkdir(parents=True, exist_ok=True)
    geometry = write_geometry(mechanism, folder / "geometry.usdc", link_poses)
    physics = write_physics(mechanism, folder / "physics.usda", link_poses, q_full, efforts or {})
    root = root_layer(
        folder / f"{mechanism.name}.usda",
        mechanism.name,
        ["./physics.usda", "./geometry.usdc"],
        0.0,
        f"{mechanism.name}: physics over geometry. Z up, metres, kilograms; UsdPhysics angles are degrees.",
    )
    return StageFiles(root, physics, geometry)
