"""The World: a deterministic simulation of devices, controllers and plants, tick by tick.

`block` defines devices, controllers, plants and hazards; `signals` what they exchange; `engine` steps them;
`recording` stores the signals. Nothing here depends on a robot's equations, a device or a scene file.
"""

from twin.simulation.world.block import Block, Hazard
from twin.simulation.world.engine import Placed, World
from twin.simulation.world.recording import Recording, read_recording
from twin.simulation.world.signals import Signals

__all__ = ["Block", "Hazard", "Placed", "Recording", "Signals", "World", "read_recording"]
