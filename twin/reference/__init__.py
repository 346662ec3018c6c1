"""The independent model of a mechanism: Pinocchio on the spanning tree, loops closed by damped Gauss-Newton.

The model is built from a `Mechanism` alone, and shares no code with the equations that it checks.
"""

from twin.reference.mobility import Mobility
from twin.reference.model import ReferenceModel
from twin.reference.states import Assembly, SolvedSamples

__all__ = ["Assembly", "Mobility", "ReferenceModel", "SolvedSamples"]
