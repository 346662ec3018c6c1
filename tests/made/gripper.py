"""A gantry with a wrist and a jaw of two fingers, as a URDF, with its equations and a protocol."""

from __future__ import annotations

from pathlib import Path

from twin.exchange.read import read
from twin.exchange.read.closing import close
from twin.exchange.read.folder import write_folder

LINKS = {"base": 0.05, "x": 0.06, "y": 0.07, "z": 0.1, "yaw": 0.05, "pitch": 0.04, "hand": 0.04}

JOINTS = (  # kind, parent, child, origin in m, axis, lower and upper limit in m or rad
    ("q1", "prismatic", "base", "x", "0 0 0.1", "1 0 0", -0.5, 0.5),
    ("q2", "prismatic", "x", "y", "0 0 0.1", "0 1 0", -0.5, 0.5),
    ("q3", "prismatic", "y", "z", "0 0 0.25", "0 0 1", -0.3, 0.3),
    ("q4", "revolute", "z", "yaw", "0 0 0.2", "0 0 1", -3, 3),
    ("q5", "revolute", "yaw", "pitch", "0 0 0.05", "0 1 0", -1.4, 1.4),
    ("q6", "revolute", "pitch", "hand", "0 0 0.05", "1 0 0", -3, 3),
)

FORMULA = '''"""The arm alone: nothing here knows of the jaw."""

import numpy as np


def inverse(pose):
    R, p = pose[:3, :3], pose[:3, 3]
    q4 = np.arctan2(R[1, 0], R[0, 0])
    q5 = np.arctan2(-R[2, 0], np.sqrt(R[0, 0] ** 2 + R[1, 0] ** 2))
    q6 = np.arctan2(R[2, 1], R[2, 2])
    hand = p - 0.1 * R[:, 2]
    q1 = hand[0] - 0.05 * np.sin(q5) * np.cos(q4)
    q2 = hand[1] - 0.05 * np.sin(q5) * np.sin(q4)
    q3 = hand[2] - 0.05 * np.cos(q5) - 0.7
    return q1, q2, q3, q4, q5, q6
'''


def urdf() -> str:
    """Return the text of the file."""
    out = ['<robot name="gripper">']
    for name, length in LINKS.items():
        out.append(_link(name, length))
    out += [_link("left", 0.05), _link("right", 0.05), '<link name="tool"/>']
    for name, kind, parent, child, at, axis, low, high in JOINTS:
        limit = f'<limit lower="{low}" upper="{high}" velocity="2" effort="20"/>'
        out.append(_joint(name, kind, parent, child, at, f'<axis xyz="{axis}"/>{limit}'))
    limit = '<limit lower="0" upper="1" velocity="3" effort="5"/>'
    out.append(_joint("jaw", "revolute", "hand", "left", "0 0.01 0.05", f'<axis xyz="-1 0 0"/>{limit}'))
    limit = '<limit lower="-1" upper="0" velocity="3" effort="5"/><mimic joint="jaw" multiplier="-1"/>'
    out.append(_joint("follower", "revolute", "hand", "right", "0 -0.01 0.05", f'<axis xyz="-1 0 0"/>{limit}'))
    out.append(_joint("mount", "fixed", "hand", "tool", "0 0 0.1", ""))
    return "\n".join([*out, "</robot>"])


def folder(path: Path) -> Path:
    """Write the robot's folder with its equations."""
    source = path.with_suffix(".urdf")
    source.write_text(urdf())
    write_folder(close(read(source)), path.name, path, source)
    (path / "formula.py").write_text(FORMULA)
    return path


def _link(name: str, length: float) -> str:
    at = f'<origin xyz="0 0 {length / 2}"/>'
    shape = f'{at}<geometry><box size="0.02 0.01 {length}"/></geometry>'
    inertia = '<inertia ixx="2e-5" iyy="2e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/>'
    return (
        f'<link name="{name}"><visual>{shape}</visual><collision>{shape}</collision>'
        f'<inertial>{at}<mass value="0.02"/>{inertia}</inertial></link>'
    )


def _joint(name: str, kind: str, parent: str, child: str, at: str, more: str) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{at}"/><parent link="{parent}"/><child link="{child}"/>'
        f"{more}</joint>"
    )


PROTOCOL = """
name = "first"
title = "To a thing, take it, and away with it"
source = "made for tests"
robot = "gripper"
frame = "tool"
shaft_axis = [0, 0, 1]
rotation = "zyx"
start = "before"
no_patient = "a bench"

[tolerances]
rcm_mm = 0.1
rcm_alarm_mm = 1
straightness_mm = 0.1
waypoint_mm = 0.01
waypoint_deg = 0.01
provenance = "ASSUMED"
note = "as for a bench"
{limits}
{waypoints}
[[phases]]
type = "auxiliary"
name = "open"
joints = {{ jaw_deg = 40 }}

[[phases]]
type = "positioning"
name = "reach"
to = "at"

[[phases]]
type = "auxiliary"
name = "close"
joints = {{ jaw_deg = 5 }}

[[phases]]
type = "home"
name = "away"
"""

_LIMITS = """
[limits.{}]
tip_speed_mm_s = 50
tip_acceleration_mm_s2 = 200
rotation_speed_deg_s = 60
rotation_acceleration_deg_s2 = 240
provenance = "ASSUMED"
note = "unhurried"
"""

_WAYPOINT = """
[waypoints.{}]
position_mm = [{}, 60, 850]
angles_deg = [10, 30, 5]
provenance = "ASSUMED"
note = "within reach"
"""


def protocol(path: Path, text: str = PROTOCOL) -> Path:
    """Write a protocol of the gripper: it opens, reaches by 40 mm, closes, and goes back."""
    limits = "".join(map(_LIMITS.format, ("auxiliary", "positioning", "home")))
    path.write_text(text.format(limits=limits, waypoints=_WAYPOINT.format("before", 260) + _WAYPOINT.format("at", 300)))
    return path
