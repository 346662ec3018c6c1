"""Functions that a plain `formula.py` may import besides NumPy: parameters with units, conditions, rotations."""

from twin.core.provenance import Parameter
from twin.formula.functions import if_else, pose, rotation_x, rotation_y, rotation_z
from twin.formula.quantities import deg, m, mm, number, rad

__all__ = [
    "Parameter",
    "deg",
    "if_else",
    "m",
    "mm",
    "number",
    "pose",
    "rad",
    "rotation_x",
    "rotation_y",
    "rotation_z",
]
