"""A gantry with a wrist and a jaw of two fingers, as a URDF, with its equations and a protocol."""

from __future__ import annotations

from pathlib import Path

from made import protocols
from made import urdf as made

_MIMIC = '<mimic joint="jaw" multiplier="-1"/>'

LINKS = {  # link: length of its box in m
    "base": 0.05,
    "x": 0.06,
    "y": 0.07,
    "z": 0.1,
    "yaw": 0.05,
    "pitch": 0.04,
    "hand": 0.04,
    "left": 0.05,
    "right": 0.05,
}

JOINTS = (  # name, kind, parent, child, origin in m, axis, lower and upper limit in m or rad, effort in N or N m
    ("q1", "prismatic", "base", "x", "0 0 0.1", "1 0 0", -0.5, 0.5, 20),
    ("q2", "prismatic", "x", "y", "0 0 0.1", "0 1 0", -0.5, 0.5, 20),
    ("q3", "prismatic", "y", "z", "0 0 0.25", "0 0 1", -0.3, 0.3, 20),
    ("q4", "revolute", "z", "yaw", "0 0 0.2", "0 0 1", -3, 3, 20),
    ("q5", "revolute", "yaw", "pitch", "0 0 0.05", "0 1 0", -1.4, 1.4, 20),
    ("q6", "revolute", "pitch", "hand", "0 0 0.05", "1 0 0", -3, 3, 20),
    ("jaw", "revolute", "hand", "left", "0 0.01 0.05", "-1 0 0", 0, 1, 5),
    ("follower", "revolute", "hand", "right", "0 -0.01 0.05", "-1 0 0", -1, 0, 5, _MIMIC),
)

_ROWS = """    return x, y, z - 0.7, yaw, q5, q6
"""


def urdf() -> str:
    """Return the text of the URDF."""
    links = (made.link(n, 0.02, (0.02, 0.01, length), (0, 0, length / 2)) for n, length in LINKS.items())
    return made.robot("gripper", [*links, *(made.joint(*j) for j in JOINTS)])


def folder(path: Path) -> Path:
    """Write the robot's folder with its equations."""
    return made.folder(urdf(), path, "The arm alone: nothing here knows of the jaw.", _ROWS)


PROTOCOL = protocols.text(
    {
        "name": "first",
        "title": "To a thing, take it, and away with it",
        "robot": "gripper",
        "start": "before",
        "no_patient": "a bench",
    },
    "",
    dict.fromkeys(("auxiliary", "positioning", "home"), (50, 200, 60, 240)),
    [
        protocols.waypoint("before", (10, 30, 5), position_mm=[260, 60, 850]),
        protocols.waypoint("at", (10, 30, 5), position_mm=[300, 60, 850]),
        protocols.phase(type="auxiliary", name="open", joints="{ jaw_deg = 40 }"),
        protocols.phase(type="positioning", name="reach", to="at"),
        protocols.phase(type="auxiliary", name="close", joints="{ jaw_deg = 5 }"),
        protocols.phase(type="home", name="away"),
    ],
)
"""The gripper opens, reaches by 40 mm, closes, and goes back."""


def protocol(path: Path, text: str = PROTOCOL) -> Path:
    """Write a protocol of the gripper."""
    path.write_text(text)
    return path
