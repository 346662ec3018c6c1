"""The rest pose of the bodies, which is the same in every format."""

from __future__ import annotations

from twin.core.spatial import Array
from twin.exchange.write.clip import rounded
from twin.model.mechanism import Mechanism


def home_poses(mechanism: Mechanism) -> dict[str, Array]:
    """Return T_world_body (4, 4) of every body at home with closed loops, rounded as clips are."""
    from twin.reference import ReferenceModel

    return rounded(ReferenceModel(mechanism).home().link_poses)
