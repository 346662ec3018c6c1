"""Soft organs touched by instruments, simulated by MuJoCo.

`organs` steps the organs for given poses of the instruments' links, `plant` is the block of the World. `operating` is
its block with tools: `bed` is what holds the organ, `tubes` are the vessels, `sight` is what the endoscope sees.
"""

from twin.simulation.plants.tissue.operating import Instrument, Operating, clips_of
from twin.simulation.plants.tissue.organs import Organs, Tool
from twin.simulation.plants.tissue.plant import Links, Tissues
from twin.simulation.plants.tissue.sight import Sight

__all__ = ["Instrument", "Links", "Operating", "Organs", "Sight", "Tissues", "Tool", "clips_of"]
