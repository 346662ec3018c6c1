"""Compute the coordinates of ball joints and cylindrical joints. URDF players need the coordinates as joint values.

A ball joint s has the coordinates s_x, s_y, s_z: rotations from home about the x axis, then the y axis, then the z axis
of the joint's frame on the child. A cylindrical joint c has the coordinates c_slide and c: displacement along z and
rotation about z.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.usd.write.spanning import spanning


class Coordinate(NamedTuple):
    """One column of a track: the values (k,) of a coordinate, in m (`type` "prismatic") or rad (`type` "revolute")."""

    name: str
    type: str
    values: Array


def tree_coordinates(mechanism: Mechanism, links: Mapping[str, Array]) -> list[Coordinate]:
    """Return the coordinates of the ball joints and cylindrical joints of the tree, computed from link poses.

    At the home of the mechanism all coordinates of ball joints are zero. `links` maps bodies to T_world_body (k, 4, 4).

    Raises:
        AssemblyError: the loops of the mechanism cannot be closed.
    """
    joints = [joint for joint in spanning(mechanism).tree if joint.type in ("spherical", "cylindrical")]
    if not joints:
        return []
    # Solving for home takes long, and most robots have no such joint.
    from twin.reference import ReferenceModel

    home = ReferenceModel(mechanism).home().link_poses
    coordinates = []
    for joint in joints:
        T = joint.relative(links[joint.parent], links[joint.child])
        if joint.type == "cylindrical":
            coordinates.append(Coordinate(f"{joint.name}_slide", "prismatic", T[:, 2, 3]))
            coordinates.append(Coordinate(joint.name, "revolute", np.unwrap(spatial.angle_about_z(T))))
            continue
        R_home = joint.relative(home[joint.parent], home[joint.child])[:3, :3]
        angles = spatial.euler_angles(R_home.T @ T[:, :3, :3], "xyz")
        for axis, axis_angles in zip("xyz", angles.T, strict=True):
            # Without unwrapping, a player would turn the joint back by a whole turn between two keys.
            coordinates.append(Coordinate(f"{joint.name}_{axis}", "revolute", np.unwrap(axis_angles)))
    return coordinates
