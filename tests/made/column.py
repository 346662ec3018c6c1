"""A turning column with a lift, a beam that reaches out, and a wrist, as a URDF, with its equations and a protocol."""

from __future__ import annotations

import re
from pathlib import Path

from made import protocols, urdf
from twin.model.mechanism import Mechanism

LINKS = {  # link: mass in kg, edges of its box in m, centre of the box in m
    "base": (10.0, (0.2, 0.2, 0.1), (0, 0, 0.05)),
    "turret": (4.0, (0.1, 0.1, 0.2), (0, 0.01, 0.1)),
    "carriage": (2.0, (0.1, 0.08, 0.1), (0.05, 0, 0.05)),
    "beam": (1.5, (0.3, 0.04, 0.04), (-0.05, 0.01, 0)),
    "yaw": (0.6, (0.05, 0.05, 0.05), (0, 0, 0.02)),
    "pitch": (0.5, (0.04, 0.06, 0.05), (0, 0.005, 0.02)),
    "hand": (0.4, (0.03, 0.03, 0.1), (0, 0, 0.05)),
}

JOINTS = (  # name, kind, parent, child, origin in m, axis, lower and upper limit in m or rad, effort in N or N m
    ("q1", "revolute", "base", "turret", "0 0 0.1", "0 0 1", -2.5, 2.5, 60),
    ("q2", "prismatic", "turret", "carriage", "0 0 0.2", "0 0 1", -0.15, 0.3, 200),
    ("q3", "prismatic", "carriage", "beam", "0.2 0 0.1", "1 0 0", -0.1, 0.3, 120),
    ("q4", "revolute", "beam", "yaw", "0.1 0 0.05", "0 0 1", -3, 3, 10),
    ("q5", "revolute", "yaw", "pitch", "0 0 0.05", "0 1 0", -1.4, 1.4, 10),
    ("q6", "revolute", "pitch", "hand", "0 0 0.05", "1 0 0", -3, 3, 10),
)

_ROWS = """
    q1 = np.arctan2(y, x)
    return q1, z - 0.5, np.sqrt(x**2 + y**2) - 0.3, yaw - q1, q5, q6
"""


def _text() -> str:
    return urdf.robot("column", [*(urdf.link(n, *v) for n, v in LINKS.items()), *(urdf.joint(*j) for j in JOINTS)])


def mechanism(path: Path) -> Mechanism:
    """Write the URDF to a path; return the mechanism read from it."""
    return urdf.mechanism(_text(), path)


def folder(path: Path) -> Path:
    """Write the robot's folder with its equations and a protocol: around the column, outwards, and back."""
    urdf.folder(_text(), path, "A column, a lift and a beam bring the wrist to its place.", _ROWS)
    head = {"name": "first", "title": "Round the column", "robot": "column", "start": "before", "no_patient": "a bench"}
    quick = (600, 2500, 180, 900)  # so fast that the dynamic coupling of the joints is noticeable
    places = (("before", (300, 60, 700), 30), ("there", (380, -120, 620), 45), ("round", (220, 200, 760), 15))
    parts = [protocols.waypoint(n, (10, turn, 5), position_mm=list(at)) for n, at, turn in places]
    parts += [
        protocols.phase(type="positioning", name="reach", to="there"),
        protocols.phase(type="positioning", name="swing", to="round"),
        protocols.phase(type="home", name="away"),
    ]
    (path / "trajectories").mkdir(exist_ok=True)
    text = protocols.text(head, "", {"positioning": quick, "home": quick}, parts)
    (path / "trajectories/first.toml").write_text(text)
    return path


MATRIX = ((0.02, 0.0), (-0.01, 0.02))
"""Motion of lift and beam in m per rad of the two motors: the cable of the beam runs over the drum of the lift."""


def with_motors(path: Path) -> Path:
    """Replace the drives of lift and beam in a robot's folder by two motors with cables; return the folder."""
    text = (path / "cad/column.toml").read_text("utf-8")
    for joint in ("q2", "q3"):
        text, found = re.subn(rf'\[\[drive\]\]\njoints = \["{joint}"\]\n.*?\n\n', "", text, flags=re.S)
        assert found == 1
    (path / "cad/column.toml").write_text(text + _MOTORS.format(*map(list, MATRIX)))
    return path


_MOTORS = """
[[actuator]]
name = "m1"
limits_deg = [-3000, 3000]
max_speed_deg_s = 8000
max_effort = 3.0
rotor_inertia = 2e-4
stiffness = 3.0
damping = 0.1
provenance = "ASSUMED"
note = "made"

[[actuator]]
name = "m2"
limits_deg = [-3000, 3000]
max_speed_deg_s = 8000
max_effort = 2.0
rotor_inertia = 1e-4
stiffness = 2.0
damping = 0.1
provenance = "ASSUMED"
note = "made"

[[transmission]]
name = "cables"
joints = ["q2", "q3"]
actuators = ["m1", "m2"]
matrix = [{}, {}]
provenance = "ASSUMED"
note = "radii of drums"
"""
