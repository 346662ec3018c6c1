"""The World: a deterministic simulation of devices, controllers and plants, tick by tick.

`block` defines the base classes of devices, controllers, plants and hazards; `signals` stores the values that blocks
exchange; `engine` has the World, which steps the blocks; `recording` stores all signals of all ticks. Nothing in this
package depends on a robot's equations, a particular device or a scene file.
"""

from twin.simulation.world.block import Block, Hazard
from twin.simulation.world.engine import Placed, World
from twin.simulation.world.recording import Recording, read_recording
from twin.simulation.world.signals import Signals

__all__ = ["Block", "Hazard", "Placed", "Recording", "Signals", "World", "read_recording"]
