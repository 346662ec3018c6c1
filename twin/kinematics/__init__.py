"""Solvers for compiled formulas, and the functions that authors of CasADi equations import.

Importing this package also imports CasADi. Import it only where equations are needed.
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
