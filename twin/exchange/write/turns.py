"""Coordinates of joints that have several: without them no table says where the links of a URDF behind a ball are.

A ball s has s_x, s_y, s_z: turns about x, then y, then z of its frame on the parent as it lies at home.
A cylindrical joint c has c_slide and c: along and about z.
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
    """One column of a track: values (k,) in m or rad of a "prismatic" or "revolute" joint."""

    name: str
    type: str
    values: Array


def tree_coordinates(mechanism: Mechanism, links: Mapping[str, Array]) -> list[Coordinate]:
    """Return the coordinates that link poses T_world_body (k, 4, 4) give the balls and cylindrical joints of the tree.

    Args:
        mechanism: as the URDF is written from it: at its home all turns of a ball are zero.
        links: poses of its bodies.

    Raises:
        AssemblyError: the mechanism cannot be assembled as drawn.
    """
    joints = [j for j in spanning(mechanism).tree if j.type in ("spherical", "cylindrical")]
    if not joints:
        return []
    from twin.reference import ReferenceModel

    home = ReferenceModel(mechanism).home().link_poses
    out = []
    for joint in joints:
        T = joint.relative(links[joint.parent], links[joint.child])
        if joint.type == "cylindrical":
            out.append(Coordinate(f"{joint.name}_slide", "prismatic", T[:, 2, 3]))
            out.append(Coordinate(joint.name, "revolute", np.unwrap(spatial.angle_about_z(T))))
            continue
        R = joint.relative(home[joint.parent], home[joint.child])[:3, :3].T @ T[:, :3, :3]
        turns = spatial.euler_angles(R, "xyz").T
        out += [Coordinate(f"{joint.name}_{a}", "revolute", np.unwrap(v)) for a, v in zip("xyz", turns, strict=True)]
    return out
