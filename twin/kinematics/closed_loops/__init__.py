"""Forward kinematics of mechanisms with closed loops, compiled from the description of a mechanism."""

from twin.kinematics.closed_loops.solver import Closed, LoopSolver

__all__ = ["Closed", "LoopSolver"]
