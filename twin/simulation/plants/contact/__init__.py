"""Contact of movable objects with instruments and fixed parts, simulated by MuJoCo.

`plant` is the block of the World; `gripper` computes the poses of an instrument's links, `collision_shapes` creates the
shapes in MuJoCo, `contact_planes` finds the planes of which the hands feel forces, with `levers` of the shafts;
`grip_frame` measures the frame of closed jaws.
"""

from twin.simulation.plants.contact.collision_shapes import Solid
from twin.simulation.plants.contact.gripper import Gripper
from twin.simulation.plants.contact.plant import Contact

__all__ = ["Contact", "Gripper", "Solid"]
