"""Solvers on a compiled formula; what an author of CasADi equations imports is named here as well.

Importing this package imports CasADi; nothing above it should do so before it needs an equation.
"""

from twin.formula import symbolic
from twin.formula.contract import (
    ActiveJoint,
    Aspect,
    Coordinates,
    Equation,
    Formula,
    Measure,
    check_formula,
)
from twin.kinematics.compile import Kinematics, compile_formula
from twin.kinematics.solve import Joints, Pose, Solution, Task, Tip, Trocar, solve

__all__ = [
    "ActiveJoint",
    "Aspect",
    "Coordinates",
    "Equation",
    "Formula",
    "Joints",
    "Kinematics",
    "Measure",
    "Pose",
    "Solution",
    "Task",
    "Tip",
    "Trocar",
    "check_formula",
    "compile_formula",
    "solve",
    "symbolic",
]
