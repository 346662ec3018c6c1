"""The independent model: Pinocchio on the spanning tree, loops closed by damped Gauss-Newton.

Built from a `Mechanism` alone, it shares no code with the equations it judges.
"""

from twin.reference.model import Assembly, ReferenceModel, Run

__all__ = ["Assembly", "ReferenceModel", "Run"]
