"""Turns of more than 180 deg between two waypoints are named with the shorter turn; the path stays as written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from made.arm import arm
from twin.core.errors import AssemblyError, ProtocolError
from twin.planning.path_kinematics import PathKinematics
from twin.planning.plan import plan
from twin.planning.protocol import Positioning, Waypoint, load_protocol
from twin.reference import ReferenceModel
from twin.reference.follower import Follower

ROOT = Path(__file__).parents[2]
GANTRY = PathKinematics(
    joint_names=("x", "y", "z"),
    inverse=lambda Ts: Ts[:, :3, 3].copy(),
    reach=lambda Ts: {},
    singularity=lambda Ts, q: {},
    singularity_alarm={},
    lower=np.full(3, -9.0),
    upper=np.full(3, 9.0),
    soft_lower=np.full(3, -9.0),
    soft_upper=np.full(3, 9.0),
    max_speed=np.full(3, 1.0),
    max_acceleration=np.full(3, 3.0),
)
"""Three rails that move the tool, and a wrist that takes every orientation and is not described."""


def turning(*angles):
    """Return a protocol that moves from one orientation (3,) in deg to the next; the positions are 0, 100, ... mm."""
    read = load_protocol(ROOT / "trajectories/pa10/circle.toml")
    waypoints = {
        f"w{k}": Waypoint(f"w{k}", np.deg2rad(a), np.array([0.1 * k, 0, 0]), None, "", "ASSUMED", "test")
        for k, a in enumerate(angles)
    }
    phases = tuple(Positioning(f"to_{name}", name) for name in list(waypoints)[1:])
    return replace(read, start="w0", waypoints=waypoints, phases=phases)


def found(*angles, kinematics=GANTRY):
    made = plan(turning(*angles), kinematics, T_tool_frame=np.eye(4))
    return made, [f for f in made.findings if f.code == "protocol.long_turn"]


def test_a_long_turn_is_a_warning_with_the_shorter_turn_and_the_path_is_as_written():
    made, (said,) = found((0, 0, 180), (0, 10, -164.1))
    assert said.severity == "warning"
    assert said.message == "angle 3 (about x) turns by 344.1°, from 180 to -164.1 deg"
    assert said.suggestion == (
        "if the shorter turn of 15.9° is meant, write 195.9 instead of -164.1 in angles_deg of waypoint 'w1'"
    )
    assert (said.where, said.when, said.size) == ("waypoint 'w1'", "phase 'to_w1'", pytest.approx(344.1))
    turned = np.linalg.norm(made.angular_velocity, axis=1).sum() * made.step
    assert np.degrees(turned) == pytest.approx(344.1, abs=1)


def test_what_the_warning_proposes_is_the_same_orientation_and_causes_no_warning():
    made, none = found((0, 0, 180), (0, 10, 195.9))
    assert none == []
    long, _ = found((0, 0, 180), (0, 10, -164.1))
    np.testing.assert_allclose(made.Ts_base_tool[-1], long.Ts_base_tool[-1], atol=1e-9)
    assert found((0, 0, 0), (0, 0, 180), (0, 0, 0), (-180, 0, 0))[1] == [], "half a turn has no shorter way"


def test_a_phase_that_fails_names_its_long_turn():
    with pytest.raises(ProtocolError, match=r"upper limit.* write 195\.9 instead of -164\.1"):
        found((0, 0, 180), (0, 10, -164.1), kinematics=replace(GANTRY, upper=np.full(3, 0.05)))


def test_a_mechanism_that_cannot_follow_says_where_it_stops_and_how_much_is_left():
    follower = Follower(lambda: ReferenceModel(arm()))
    state, _ = follower.drawn()
    T = follower.carry(np.zeros((1, 3)), state)[1][0]
    Ts = np.repeat(T[None], 5, axis=0)
    Ts[:, 0, 3] += np.linspace(0.0, 0.2, 5)  # the arm is stretched along x: it cannot go further
    with pytest.raises(AssemblyError, match="cannot follow") as told:
        follower.follow(Ts, np.arange(6) < 2, np.zeros(3), state)
    assert "The tool stops 50 mm and 0 deg before 25 % of the path, 200 mm and 0 deg before its end" in str(told.value)
