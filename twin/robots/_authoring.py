"""Functions for the equations of several robots: rows of a Denavit-Hartenberg table, parameters, pose coordinates."""

from __future__ import annotations

from collections.abc import Sequence

from casadi import vertcat

from twin.core.provenance import Parameter, Provenance
from twin.core.units import MM
from twin.formula import symbolic
from twin.formula.contract import ActiveJoint, Coordinates

# Sources that several robots name.
PAPER = "Design and Modeling of PA-10 Virtual Surgery Robot"
ASSUMED = "ASSUMED: not published"
DERIVED = f"DERIVED for the table {ASSUMED}"


def row(alpha, d, theta, r):
    """Return Rx(alpha) Tx(d) Rz(theta) Tz(r), (4, 4): one row of a modified Denavit-Hartenberg table."""
    R = symbolic.rotation_x(alpha) @ symbolic.rotation_z(theta)
    return symbolic.pose(R, vertcat(d, 0, 0) + R @ vertcat(0, 0, r))


def mm(name: str, mm: float, provenance: Provenance, note: str) -> Parameter:
    """Return a length, given in mm, as a parameter with a provenance and a note."""
    return Parameter(name, mm * MM, "mm", mm, provenance, note)


def active_joints(names: str, slides: str = "") -> tuple[ActiveJoint, ...]:
    """Return the driven joints with the names in a text, separated by spaces: slides if in `slides`, else hinges."""
    joints = []
    for name in names.split():
        kind = "prismatic" if name in slides.split() else "revolute"
        joints.append(ActiveJoint(name, kind))
    return tuple(joints)


def place_names(points: Sequence[str]) -> list[str]:
    """Return the names of the quantities that are the positions of points in base: "at_tip" of "tip"."""
    return [f"at_{point}" for point in points]


def trocar(x: float, y: float, z: float) -> tuple[Parameter, ...]:
    """Return the trocar's coordinates in frame 0, given in mm, as parameters; a protocol may change them."""
    note = "trocar in frame 0, as in the CAD; a protocol may place it elsewhere (trocar_mm)"
    return (
        mm("trocar_x", x, "ASSUMED", note),
        mm("trocar_y", y, "ASSUMED", note),
        mm("trocar_z", z, "ASSUMED", note),
    )


ZYX = Coordinates(
    names=("x", "y", "z", "psi", "theta", "phi"),
    units=("m", "m", "m", "rad", "rad", "rad"),
    to_pose=lambda x, y, z, psi, theta, phi: symbolic.pose(symbolic.rotation_zyx(psi, theta, phi), vertcat(x, y, z)),
    from_pose=lambda T: (T[0, 3], T[1, 3], T[2, 3], *symbolic.angles_zyx(T)),
)
"""Pose coordinates: position of the tool in frame 0, and angles of R_base_tool = Rz(psi) Ry(theta) Rx(phi)."""
