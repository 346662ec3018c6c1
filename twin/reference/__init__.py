"""The independent model: Pinocchio on the spanning tree, loops closed by damped Gauss-Newton.

Built from a `Mechanism` alone, it shares no code with the equations it judges.
"""

from twin.reference.mobility import Mobility
from twin.reference.model import ReferenceModel
from twin.reference.states import Assembly, Run

__all__ = ["Assembly", "Mobility", "ReferenceModel", "Run"]
