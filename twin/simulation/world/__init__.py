"""The World: a deterministic simulation of devices, controllers and plants, tick by tick.

`block` defines the base classes of devices, controllers, plants and hazards; `signals` the values that they exchange;
`engine` the World, which steps them; `recording` the record of all signals. Nothing in this package depends on a
robot's equations, a particular device or a scene file.
"""

from twin.simulation.world.block import Block, Hazard
from twin.simulation.world.engine import Placed, World
from twin.simulation.world.recording import Recording, read_recording
from twin.simulation.world.signals import Signals

__all__ = ["Block", "Hazard", "Placed", "Recording", "Signals", "World", "read_recording"]
