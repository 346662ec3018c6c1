"""The first formula and protocol of a new robot: a formula without equations, and a motion near home."""

from __future__ import annotations

import numpy as np

from twin.assets import NO_EQUATIONS
from twin.errors import TwinError
from twin.importing.text import number, one_line, string, zyx
from twin.mechanism import Mechanism
from twin.reference import ReferenceModel
from twin.spatial import Array
from twin.units import DEG, MM

_STEP = {"revolute": 5 * DEG, "prismatic": 10 * MM}
"""How far the first protocol moves a driven joint, where its limits leave room."""


def formula(mechanism: Mechanism) -> str:
    """Return a formula.py with the driven joints of the mechanism, which waits for its equations."""
    names = [j.name for j in mechanism.active]
    units = ", ".join(f"{j.name} ({'rad' if j.is_angle else 'm'})" for j in mechanism.active) or "none yet"
    returned = ", ".join(names) or "..."
    return f'''"""Equations of {one_line(mechanism.name)}: yours are to be written here.

Driven joints, in the order of q: {units}.
`inverse` leads from the pose T_base_tool (4, 4) of frame '{mechanism.tool}' in base '{mechanism.base}' to them,
`forward` from them to the pose. One of the two is enough. See docs/your-own-robot.md.

Every command that needs equations runs this file: it is code. Take the last line out when they are there.

import numpy as np

from twin.formula import mm

PARAMETERS = {{"length": mm(100, "ASSUMED", "where the number comes from")}}


def inverse(pose, length):
    x, y, z = pose[:3, 3]
    return {returned}
"""

{NO_EQUATIONS}
'''


def protocol(mechanism: Mechanism) -> str:
    """Return a protocol from home to a place nearby and back; every number of it is ASSUMED."""
    tool = mechanism.frame(mechanism.tool)
    home = mechanism.rest[tool.body] @ tool.T_body_frame
    near, how = _near(mechanism)
    return f"""# A first motion: from home to a place nearby and straight back. {how}
# It can be planned as soon as formula.py holds equations: twin plan, twin validate.
name = "first"
title = {string(f"First motion of {mechanism.name}")}
source = "template of twin new"
robot = {string(mechanism.name)}
frame = {string(mechanism.tool)}
shaft_axis = [0, 0, 1] # in `frame`; it matters to insertions and pivots only
rotation = "zyx"
start = "home"
home = "home"

[tolerances]
rcm_mm = 0.1
rcm_alarm_mm = 1
straightness_mm = 0.1
waypoint_mm = 0.01
waypoint_deg = 0.01
provenance = "ASSUMED"
note = "To be replaced."
{_limits("positioning")}{_limits("home")}{_waypoint("home", home)}{_waypoint("near", home if near is None else near)}
[[phases]]
type = "positioning"
name = "go"
to = "near"

[[phases]]
type = "home"
name = "back"
"""


def _near(mechanism: Mechanism) -> tuple[Array | None, str]:
    """Return the tool's pose with the first driven joint that can be moved a little, and how."""
    model = ReferenceModel(mechanism)
    home = model.home()
    for i, joint in enumerate(mechanism.active):
        low, high = joint.limits or (-np.inf, np.inf)
        for step in (_STEP[joint.type], -_STEP[joint.type]):
            q = home.q.copy()
            q[i] += step
            if not low <= q[i] <= high:
                continue
            try:
                moved = model.solve(q, home)
            except TwinError:
                continue
            if np.abs(moved.T_base_tool - home.T_base_tool).max() > 1e-6:
                by = f"{step / DEG:g} degrees" if joint.is_angle else f"{step / MM:g} mm"
                return moved.T_base_tool, f"There, driven joint {joint.name} has moved by {by}."
    return None, "No driven joint moves the tool there: `near` is where home is. Move it."


def _limits(phase: str) -> str:
    return f"""
[limits.{phase}]
tip_speed_mm_s = 50
tip_acceleration_mm_s2 = 200
rotation_speed_deg_s = 20
rotation_acceleration_deg_s2 = 60
provenance = "ASSUMED"
note = "Unhurried; to be replaced."
"""


def _waypoint(name: str, T: Array) -> str:
    position = ", ".join(number(v) for v in T[:3, 3] / MM)
    angles = ", ".join(number(v) for v in zyx(T[:3, :3]) / DEG)
    return f"""
[waypoints.{name}]
position_mm = [{position}]
angles_deg = [{angles}] # Rz Ry Rx
provenance = "ASSUMED"
note = "As the mechanism stands; to be replaced."
"""
