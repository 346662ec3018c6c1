"""Soft organs touched by instruments, simulated by MuJoCo.

`organs` steps the organs for given poses of the instruments' links; `plant` is the block of the World without tools,
`operating` the block with tools. `bed` simulates the bed that holds the organ, `tubes` the vessels; `sight` computes
how much of a vessel the endoscope sees.
"""

from twin.simulation.plants.tissue.operating import Operating, OperatingRobot, clips_of
from twin.simulation.plants.tissue.organs import Organs, Tool
from twin.simulation.plants.tissue.plant import Links, Tissues
from twin.simulation.plants.tissue.sight import Sight

__all__ = ["Links", "Operating", "OperatingRobot", "Organs", "Sight", "Tissues", "Tool", "clips_of"]
