"""Where the pages open: how far the tool can go before a limit stops it, and what happens at the limit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import twin
from twin.cad import description, references
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.units import MM
from twin.robots import names
from twin.ui.session.movable_robot import START_POSTURE, MovableRobot

ROOM = 50.0
"""Travel in mm that is wanted in each of the six directions."""

LESS = {"raven_left": 35.0, "raven_right": 35.0, "sher": 30.0}
"""Travel in mm of the robots that have less. The carriages of SHER move 100 mm in all, and the best posture found in a
search leaves 37 mm. The insertion of the Raven is near an end at its home."""

STEP = 5 * MM
SILS = Path(__file__).parents[2] / "cad/sils/sils.toml"


def travel(movable, direction, most):
    """Return how far the tool gets along a direction, in m, in steps as a hand makes them."""
    begin = movable.assembly
    T_begin = begin.T_base_tool.copy()
    reached = 0.0
    while reached < most:
        T = T_begin.copy()
        T[:3, 3] += (reached + STEP) * direction
        for _ in range(200):
            if not movable.drag_tool(T).more:
                break
        if np.linalg.norm(movable.assembly.T_base_tool[:3, 3] - T[:3, 3]) > 1 * MM:
            break
        reached += STEP
    movable.show(begin)
    return reached


@pytest.mark.parametrize("name", [n if n == "sils" else pytest.param(n, marks=pytest.mark.slow) for n in names()])
def test_the_tool_has_room_where_the_page_opens(name):
    movable = MovableRobot(twin.load(name))
    wanted = LESS.get(name, ROOM) * MM
    rooms = {}
    for axis in range(3):
        for sign in (1, -1):
            rooms[f"{'+' if sign > 0 else '-'}{'xyz'[axis]}"] = travel(movable, sign * np.eye(3)[axis], wanted)
    print(name, {way: round(room / MM) for way, room in rooms.items()})
    assert min(rooms.values()) >= wanted - 1e-9, rooms


def test_a_tool_beyond_a_limit_goes_along_it():
    movable = MovableRobot(twin.load("sils"))
    T = movable.assembly.T_base_tool.copy()
    T[:3, 3] += [0.2, 0.02, 0.0]  # x ends after 73 mm, y does not
    moved = movable.drag_tool(T)
    reached = movable.assembly.T_base_tool
    assert not moved.good
    assert "short of the target" in moved.reason
    assert 0.07 < reached[0, 3] - (T[0, 3] - 0.2) < 0.08
    assert abs(reached[1, 3] - T[1, 3]) < 0.1 * MM
    assert spatial.rotation_angle(reached[:3, :3].T @ T[:3, :3]) < 1e-7
    low, high = movable.mechanism.limits.T
    assert np.all((low - 1e-9 <= movable.assembly.q) & (movable.assembly.q <= high + 1e-9))
    assert movable.assembly.worst_gap < 1e-9
    # asked again, it does not creep on
    again = movable.assembly.T_base_tool[:3, 3]
    movable.drag_tool(T)
    assert np.linalg.norm(movable.assembly.T_base_tool[:3, 3] - again) < 0.5 * MM


def test_the_start_is_found_again():
    movable = MovableRobot(twin.load("sils"))
    q = movable.assembly.q.copy()
    assert movable.go_to_posture("home").good
    assert movable.go_to_posture(START_POSTURE).good
    assert np.abs(movable.assembly.q - q).max() < 1e-12


def test_the_last_drag_is_undone():
    movable = MovableRobot(twin.load("sils"))
    q = movable.assembly.q.copy()
    T = movable.assembly.T_base_tool.copy()
    T[2, 3] -= 20 * MM
    movable.remember()
    movable.remember()  # a click that moves nothing
    assert movable.drag_tool(T).good
    assert movable.undo().good
    assert np.abs(movable.assembly.q - q).max() < 1e-12
    assert "nothing to undo" in movable.undo().reason


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("q6_mm = 518.5\n", "", "active joint 'q6' is missing; write q6_mm"),
        ("q6_mm = 518.5\n", "q6_deg = 5\n", "joint 'q6' is prismatic; write q6_mm"),
        ("q6_mm = 518.5\n", "q7_mm = 5\n", "active joint 'q7'"),
    ],
)
def test_a_wrong_start_names_what_to_write(tmp_path, old, new, message):
    (tmp_path / "cad").mkdir()
    text = SILS.read_text("utf-8")
    assert old in text
    path = tmp_path / "cad/sils.toml"
    path.write_text(text.replace(old, new, 1), "utf-8")
    with pytest.raises(TwinError, match=message):
        references.check(path, description.load(path))
