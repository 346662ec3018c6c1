"""Forward kinematics of mechanisms with closed loops, compiled from the description of a mechanism."""

from twin.kinematics.closed_loops.solver import ClosedStates, LoopSolver

__all__ = ["ClosedStates", "LoopSolver"]
