"""Generate the initial files of a new robot: a file for its equations, and a protocol with a motion near home."""

from __future__ import annotations

import numpy as np

from twin.core.assets import NO_EQUATIONS
from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.core.toml_text import one_line, toml
from twin.core.units import DEG, MM, display_unit
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel
from twin.reference.conditioning import conditioning
from twin.reference.loops import LENGTH_SCALE
from twin.reference.states import Assembly

_MIN_CONDITIONING = 1e-3
"""Conditioning (0: singular, 1: best) from which the initial protocol may start and pass; `validate` requires 1e-6."""

_START_DISTANCES = (0.1, 0.3, 0.6, 1.0)
"""Maximum distances of a start from a singular home, in rad; for slides, a tenth of these in m."""

_STARTS_AT_EACH_DISTANCE = 8
"""Number of starts drawn at each distance."""

_DISPLACEMENT = {"revolute": 5 * DEG, "prismatic": 10 * MM}
"""Displacement of the moved joint in the initial protocol, in rad (revolute) or m (prismatic)."""


def formula(mechanism: Mechanism) -> str:
    """Return the text of a formula.py that lists the driven joints of the mechanism, but has no equations yet."""
    names = []
    names_with_units = []
    for joint in mechanism.active:
        unit = "rad" if joint.is_angle else "m"
        names.append(joint.name)
        names_with_units.append(f"{joint.name} ({unit})")
    units = ", ".join(names_with_units) or "none yet"
    returned = ", ".join(names) or "..."
    return f'''"""Equations of {one_line(mechanism.name)}: write them here.

Driven joints, in the order of q: {units}.
`inverse` computes q from the pose T_base_tool (4, 4) of frame '{mechanism.tool}' in base '{mechanism.base}';
`forward` computes the pose from q. One of the two is enough. See docs/your-own-robot.md.

Every command that needs equations runs this file: it is code. Delete the last line when the equations are written.

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
    """Return a protocol that moves a driven joint by a small amount and back; all its numbers are ASSUMED.

    The protocol moves a joint instead of the tool, so that every mechanism can execute it. It starts at home or, if the
    mechanism is singular there, such as a stretched arm, at a state beside home at which it is not.
    """
    model = ReferenceModel(mechanism)
    start = _start_beside_singular_home(model)
    if start is None:
        start = model.home()
        place = "home"
        note = "The home position of the mechanism"
    else:
        place = "a pose beside home, where the mechanism is singular,"
        note = "Beside the home position, which is singular"
    home_values, near_values, difference = _home_and_near_values(model, start)
    waypoints = _waypoint("home", home_values, note) + _waypoint("near", near_values, "Near the start")
    return f"""# A first motion: the driven joints move from {place} to nearby values and back. {difference}
# Try it: twin plan, twin validate. To move the tool to a pose, use a phase of type "positioning" and a waypoint with
# position_mm and angles_deg; see docs/your-own-robot.md.
name = "first"
title = {toml(f"First motion of {mechanism.name}")}
source = "template of twin new"
robot = {toml(mechanism.name)}
frame = {toml(mechanism.tool)}
shaft_axis = [0, 0, 1] # in `frame`; used by insertions and pivots only
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
{_limits("joints")}{_limits("home")}{waypoints}
[[phases]]
type = "joints"
name = "go"
to = "near"

[[phases]]
type = "home"
name = "back"
"""


def _start_beside_singular_home(model: ReferenceModel) -> Assembly | None:
    """Return a state near home that is not singular; None if home is not, or if no such state was found."""
    home = model.home()
    if _smaller_conditioning(model, home) >= _MIN_CONDITIONING:
        return None
    rng = np.random.default_rng(0)  # the same robot gives the same protocol
    active = model.mechanism.active
    low, high = model.mechanism.limits.T
    is_angle = np.array([joint.is_angle for joint in active])
    scale = np.where(is_angle, 1.0, 0.1)  # a slide moves by a tenth of the number for an angle
    for distance_from_home in _START_DISTANCES:
        for _ in range(_STARTS_AT_EACH_DISTANCE):
            q = np.clip(home.q + distance_from_home * scale * rng.uniform(-1.0, 1.0, len(active)), low, high)
            try:
                state = model.solve(q, home)
            except TwinError:
                continue
            if _smaller_conditioning(model, state) >= _MIN_CONDITIONING:
                return state
    return None


def _smaller_conditioning(model: ReferenceModel, state: Assembly) -> float:
    """Return the smaller of the two measures of `conditioning` at a state; 0 where no joint moves the tool.

    Without driven joints it is infinite.
    """
    if not model.mechanism.active:
        return np.inf
    measures = conditioning(model, state.x[None], LENGTH_SCALE)
    moving = measures.type2[0]
    standing = np.nan_to_num(measures.type1[0])  # NaN where no joint moves the tool
    return float(min(standing, moving))


def _home_and_near_values(model: ReferenceModel, home: Assembly) -> tuple[dict[str, float], dict[str, float], str]:
    """Return (values at `home`, values near it, description of the difference) for the driven joints.

    Keys of the values are TOML keys: the name of a joint and its unit. Only one joint differs: the first driven joint
    that can move the tool within the joint limits. If no joint can, the first joint that can be moved at all differs.
    """
    mechanism = model.mechanism
    values = _values(mechanism, home.q)
    without_tool: tuple[dict[str, float], str] | None = None
    for number, joint in enumerate(mechanism.active):
        low, high = joint.limits or (-np.inf, np.inf)
        for step in (_DISPLACEMENT[joint.type], -_DISPLACEMENT[joint.type]):
            q = home.q.copy()
            q[number] += step
            # A joint at its upper limit can still move back: the second step is the negative one.
            if not low <= q[number] <= high:
                continue
            try:
                moved_state = model.solve(q, home)
            except TwinError:
                continue
            distance = f"{step / MM:g} mm"
            if joint.is_angle:
                distance = f"{step / DEG:g} degrees"
            how = f"Driven joint {joint.name} moves by {distance}"
            if np.abs(moved_state.T_base_tool - home.T_base_tool).max() > 1e-6:
                return values, _values(mechanism, q), f"{how}."
            if without_tool is None:
                without_tool = (_values(mechanism, q), f"{how}; the tool does not move.")
    if without_tool is not None:
        near_values, how = without_tool
        return values, near_values, how
    reason = "No joint is driven yet"
    if mechanism.active:
        reason = "No driven joint can be moved from home"
    how = f"{reason}: give `near` other values, as in joints = {{ NAME_deg = 5 }} or {{ NAME_mm = 10 }}."
    return values, values, how


def _values(mechanism: Mechanism, q: Array) -> dict[str, float]:
    values = {}
    for joint, value in zip(mechanism.active, q, strict=True):
        unit, scale = display_unit(joint.is_angle)
        values[f"{joint.name}_{unit}"] = float(value / scale)
    return values


def _limits(phase: str) -> str:
    return f"""
[limits.{phase}]
tip_speed_mm_s = 50
tip_acceleration_mm_s2 = 200
rotation_speed_deg_s = 20
rotation_acceleration_deg_s2 = 60
provenance = "ASSUMED"
note = "Slow; to be replaced."
"""


def _waypoint(name: str, values: dict[str, float], note: str) -> str:
    return f"""
[waypoints.{name}]
joints = {toml(values)} # joints that are not listed stay at home
provenance = "ASSUMED"
note = "{note}; to be replaced."
"""
