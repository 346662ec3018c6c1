"""Soft organs touched by instruments, simulated by MuJoCo.

`organs` steps the organs for given poses of the instruments' links, `plant` is the block of the World.
"""

from twin.simulation.plants.tissue.organs import Organs, Tool
from twin.simulation.plants.tissue.plant import Links, Tissues

__all__ = ["Links", "Organs", "Tissues", "Tool"]
