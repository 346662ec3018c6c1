"""Equations (1) to (7) of the paper on an affordable console for robotic surgery training, in several readings.

A hand (frame {H}) moves a tool (robot base {RB}). T is the pose of {H} in {RB}, W the pose of the handle in {H}, P the
pose of the tool in {RB}, each (4, 4) in m; index 0 is before the motion, index 1 after it. Two hands turn the camera:
p_R, p_L (3,) in m, n (3,) the unit vector out of the picture. A reading is an interpretation of an equation. "paper" is
the equation as printed. "conjugate" uses a change of frame in eq. (2). "decoupled", the correct reading, moves the
tool's origin by the motion of the handle's origin, and rotates the tool about its own origin.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from numpy import arctan2, cross

from twin.core.errors import KinematicsError, unknown
from twin.core.spatial import Array
from twin.formula.contract import Equation
from twin.formula.equations import Equations
from twin.formula.functions import if_else, inverse, pose

PAPER = "A novel affordable user interface for robotic surgery training"

STIFFNESS, DAMPING, LARGEST = 600.0, 10.0, 3.3
"""Stiffness in N/m and damping in N s/m of a surface, and largest force in N of the pen.

The printed numbers 0.6 and 0.01 have no unit; N/mm and N s/mm are ASSUMED. The largest force is ASSUMED as well, from
the manufacturer of the pen.
"""

equation = Equations(PAPER, variant="decoupled")


@equation(
    "forward",
    "motion of the hand -> motion of the tool",
    gives="dW",
    source=f"{PAPER}, eq. (2)",
    why="rotations change frame by R_T alone, translations by R_T and scale; each body rotates about its own origin",
)
def eq2(W_0, W_1, T, scale):
    """Return the tool motion (4, 4) in the base frame {RB}, translation in m; eq. (1) applies this motion."""
    R = T[:3, :3]
    dW = pose(R @ W_1[:3, :3] @ W_0[:3, :3].T @ R.T, scale * R @ (W_1[:3, 3] - W_0[:3, 3]))
    return dW


@equation.variant("paper", of=eq2, why="as printed: T on the left only, not its inverse on the right; no scale")
def eq2_paper(W_0, W_1, T):
    """Return the motion (4, 4) of the tool by eq. (2) as printed."""
    dW = T @ (W_1 @ inverse(W_0))
    return dW


@equation.variant("conjugate", of=eq2, why="a change of frame, but the tool rotates about the hand's origin; no scale")
def eq2_conjugate(W_0, W_1, T):
    """Return the motion (4, 4) of the tool: the hand motion W_1 W_0^-1, expressed in {RB} by T."""
    dW = T @ (W_1 @ inverse(W_0)) @ inverse(T)
    return dW


@equation(
    "forward",
    "motion and pose of the tool -> its next pose",
    gives="P_1",
    source=f"{PAPER}, eq. (1)",
    why="the tool rotates about its own origin",
)
def eq1(dW, P_0):
    """Return the tool pose (4, 4) in {RB} after the motion dW (4, 4) from the pose P_0 (4, 4)."""
    P_1 = pose(dW[:3, :3] @ P_0[:3, :3], dW[:3, 3] + P_0[:3, 3])
    return P_1


@equation.variant("paper", of=eq1, why="as printed, one product: the tool rotates about the origin of {RB}")
def eq1_paper(dW, P_0):
    """Return the tool pose (4, 4) in {RB} by eq. (1) as printed: P_1 = dW P_0."""
    P_1 = dW @ P_0
    return P_1


# In the reading "conjugate", only eq. (2) differs from the printed equations.
equation.variant("conjugate", of=eq1, why="as printed")(eq1_paper.change)


@equation(
    "forward",
    "positions of a hand -> its displacement",
    gives="d_R d_L",
    source=f"{PAPER}, eq. (3)",
    variant="paper",
)
def eq3(p_R0, p_R1, p_L0, p_L1):
    """Return the displacements (3,) of the right and the left hand in m."""
    d_R = p_R1 - p_R0
    d_L = p_L1 - p_L0
    return d_R, d_L


@equation(
    "forward",
    "positions of both hands -> camera roll, computed for each hand",
    gives="turn_R turn_L",
    source=f"{PAPER}, eq. (4)",
    variant="corrected",
    why="the rotation of the line between the hands about the line of sight, which does not depend on the origin",
)
def eq4(p_R0, p_L0, d_R, d_L, n):
    """Return the camera roll about n in rad, counter-clockwise positive, computed for the right and the left hand."""
    v = p_R0 - p_L0
    w = v + d_R - d_L
    turn_R = arctan2(cross(v, w) @ n, v @ w - (v @ n) * (w @ n))
    turn_L = turn_R
    return turn_R, turn_L


@equation.variant("paper", of=eq4, why="as printed: p_1 x p_0 of each hand, in m^2, about the origin of the frame")
def eq4_paper(p_R0, p_L0, d_R, d_L, n):
    """Return the component along n of the cross product of each hand, as printed: (right, left), in m2."""
    turn_R = cross(p_R0 + d_R, p_R0) @ n
    turn_L = cross(p_L0 + d_L, p_L0) @ n
    return turn_R, turn_L


@equation(
    "forward",
    "depth in a surface and its rate -> force",
    gives="F",
    source=f"{PAPER}, eq. (5)",
    variant="corrected",
    why="SI units, zero outside the surface, never pulling inwards, limited to the device's maximum",
)
def eq5(x, v, stiffness=STIFFNESS, damping=DAMPING, largest=LARGEST):
    """Return the force in N along the inward normal of the surface; x in m and v in m/s, positive inwards."""
    push = if_else(x > 0, stiffness * x + damping * v, 0.0)
    push = if_else(push > 0, push, 0.0)
    F = -if_else(push < largest, push, largest)
    return F


@equation.variant("paper", of=eq5, why="as printed: 0.6 and 0.01 without units; read as N/mm, the only plausible units")
def eq5_paper(x, v):
    """Return the force in N by eq. (5) as printed; x in m and v in m/s, positive inwards."""
    F = -STIFFNESS * x - DAMPING * v
    return F


@equation(
    "forward",
    "motions of hand and tool -> error of the console",
    gives="err",
    source=f"{PAPER}, eqs (6), (7)",
    why="displacements are compared with the motion of the hand, not with eq. (2)",
)
def eq7(P_0, P_1, W_0, W_1, T, scale):
    """Return the error (4, 4) of a tool motion from P_0 to P_1: rotation, and translation in m."""
    R = T[:3, :3]
    wanted = R @ W_1[:3, :3] @ W_0[:3, :3].T @ R.T
    error = P_1[:3, 3] - P_0[:3, 3] - scale * R @ (W_1[:3, 3] - W_0[:3, 3])
    err = pose(P_1[:3, :3] @ P_0[:3, :3].T @ wanted.T, error)
    return err


@equation.variant("paper", of=eq7, why="as printed: the tool's motion is compared with eq. (2) itself")
def eq7_paper(P_0, P_1, W_0, W_1, T):
    """Return the error (4, 4) of the console by eqs (6) and (7) as printed."""
    err = (P_1 @ inverse(P_0)) @ inverse(T @ (W_1 @ inverse(W_0)))
    return err


EQUATIONS: Mapping[str, Equation] = {e.name: e for e in equation}
"""{name: equation}, in the order of this file."""

READINGS: Mapping[str, Mapping[str, str]] = {
    "paper": {"eq1": "paper", "eq2": "paper", "eq4": "paper", "eq5": "paper", "eq7": "paper"},
    "conjugate": {"eq1": "conjugate", "eq2": "conjugate"},
    "decoupled": {},
}
"""{name of a reading of the console: {equation: variant}}; equations that are not listed have the correct variant."""


@dataclass(frozen=True)
class Console:
    """The equations of a console, each in one reading.

    Attributes:
        name, title, source: name, title and source document of the console.
        variants: {equation: its reading}.
        laws: {equation: its function}; tests may replace functions.
        force_model: name of the force model of eq. (5).
        force_units: units of stiffness and damping; "" if not printed.
        turn_unit: unit of the result of eq. (4).
    """

    name: str
    title: str
    source: str
    variants: Mapping[str, str]
    laws: Mapping[str, Callable[..., Any]]
    force_model: str
    force_units: str
    turn_unit: str

    def tool(self, P_0: Array, W_0: Array, W_1: Array, T: Array, scale: float) -> Array:
        """Return the next tool pose (4, 4) in {RB}, by eqs (2) and (1)."""
        dW = self.laws["eq2"](W_0, W_1, T, scale)
        return self.laws["eq1"](dW, P_0)

    def turns(self, p_R0: Array, p_R1: Array, p_L0: Array, p_L1: Array, n: Array) -> tuple[float, float]:
        """Return the camera roll in `turn_unit`, by eqs (3) and (4): (from the right hand, from the left hand)."""
        d_R, d_L = self.laws["eq3"](p_R0, p_R1, p_L0, p_L1)
        right, left = self.laws["eq4"](p_R0, p_L0, d_R, d_L, n)
        return float(right), float(left)

    def force(self, depth: float, rate: float) -> float:
        """Return the force in N of a surface by eq. (5), negative if it pushes outwards; depth in m, rate in m/s."""
        return float(self.laws["eq5"](depth, rate))

    def error(self, P_0: Array, P_1: Array, W_0: Array, W_1: Array, T: Array, scale: float) -> Array:
        """Return the error (4, 4) of a tool motion by eq. (7)."""
        return self.laws["eq7"](P_0, P_1, W_0, W_1, T, scale)


def console(variants: Mapping[str, str] | None = None) -> Console:
    """Return the paper's console.

    Args:
        variants: {equation: name of its variant}; for the other equations, the correct variant is used.

    Raises:
        KinematicsError: there is no equation or variant of this name.
    """
    chosen = {name: e.default for name, e in EQUATIONS.items()}
    for name, reading in (variants or {}).items():
        if name not in EQUATIONS:
            raise KinematicsError(unknown("equation", name, EQUATIONS))
        if reading not in EQUATIONS[name].variants:
            raise KinematicsError(f"{name}: {unknown('variant', reading, EQUATIONS[name].variants)}")
        chosen[name] = reading
    # the printed numbers of eq. (5) have no units, so that none can be stated for them
    printed = chosen["eq5"] == "paper"
    return Console(
        name="davinci",
        title="Console with two haptic pens and two pedals for da Vinci instruments",
        source=PAPER,
        variants=chosen,
        laws={name: EQUATIONS[name].variants[reading] for name, reading in chosen.items()},
        force_model="mass-spring-damper" if printed else "spring-damper",
        force_units="" if printed else "N/m, N s/m",
        turn_unit="m^2" if chosen["eq4"] == "paper" else "rad",
    )
