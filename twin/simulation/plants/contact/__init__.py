"""Contact of movable objects with instruments and fixed parts, simulated by MuJoCo.

`gripper` computes the poses of an instrument's links, `shapes` creates the collision shapes; `plant` is the block of
the World.
"""

from twin.simulation.plants.contact.collision_shapes import Solid
from twin.simulation.plants.contact.gripper import Gripper
from twin.simulation.plants.contact.plant import Contact

__all__ = ["Contact", "Gripper", "Solid"]
