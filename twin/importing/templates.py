"""The first formula and protocol of a new robot, to be filled in."""

from __future__ import annotations

from twin.mechanism import Mechanism


def formula(mechanism: Mechanism) -> str:
    """Return a formula.py with the joints of the mechanism; its equations are to be written."""
    joints = ", ".join(f'ActiveJoint("{j.name}", "{j.type}")' for j in mechanism.active)
    names = ", ".join(j.name for j in mechanism.active)
    outputs = ", ".join(f'"{j.name}"' for j in mechanism.active)
    return f'''"""Equations of {mechanism.name}: fill in `inverse` and move this file to formula.py, beside cad/.

Running `twin` on the folder runs this file. See docs/your-own-robot.md; twin/robots/sils.py is an example.
"""

import numpy as np

from twin.kinematics.contract import ZYX, ActiveJoint, Equation, Formula


def inverse(X_E, Y_E, Z_E, psi, theta, phi):
    """Return {names} in m and rad: the pose of frame '{mechanism.tool}' in the base to the joints."""
    raise NotImplementedError("write the equations: pose -> {names}")


FORMULA = Formula(
    name="{mechanism.name}",
    title="{mechanism.name}",
    source="",
    parameters=(),
    joints=({joints},),
    coordinates=ZYX,
    equations=(
        Equation("eq1", "pose -> joints", "", "inverse", ({outputs},), {{"printed": inverse}}, default="printed"),
    ),
    characteristic_length=lambda: 0.1,
    seeds=(tuple(np.zeros(6)),),
)
'''


def protocol(mechanism: Mechanism) -> str:
    """Return a protocol that goes from home to a place nearby and back; its numbers are ASSUMED."""
    tool = mechanism.frame(mechanism.tool)
    x, y, z = (float(v) * 1e3 for v in (mechanism.rest[tool.body] @ tool.T_body_frame)[:3, 3])
    limits = "\n".join(
        f"""
[limits.{phase}]
tip_speed_mm_s = 50
tip_acceleration_mm_s2 = 200
rotation_speed_deg_s = 20
rotation_acceleration_deg_s2 = 60
provenance = "ASSUMED"
note = "Unhurried; to be replaced."
"""
        for phase in ("positioning", "home")
    )
    return f'''# The tool rests at {x:.6g}, {y:.6g}, {z:.6g} mm in the base. Fill in the phases, then move this file to
# trajectories/first.toml; it can be carried out once formula.py is there.
name = "first"
title = "A first motion of {mechanism.name}"
source = "template"
robot = "{mechanism.name}"
frame = "{mechanism.tool}"
shaft_axis = [0, 0, 1]
rotation = "zyx"
start = "home"
home = "home"
{limits}'''
