"""SILS with two instruments: each moves about its own remote centre, and the platform does not notice."""

from __future__ import annotations

from itertools import product

import coal
import numpy as np
import pytest

import twin
from twin.core import spatial
from twin.core.units import DEG, MM
from twin.reference.clearance import Shape

KINDS = ("lean", "swing", "depth")
AZIMUTH = {1: 120 * DEG, 2: -120 * DEG}
TILT = 12 * DEG
OFFSET, DROP = 11 * MM, 200 * MM
"""Of cad/sils_instruments/dimensions.toml, written again: RCM sideways of the endoscope, and below the platform."""


@pytest.fixture(scope="module")
def robot():
    return twin.load("sils_instruments")


def joints(robot, q6, values):
    """Return q (12,) from carriages (6,) and {joint of an instrument: value in rad or m}."""
    names = [joint.name for joint in robot.mechanism.active]
    q = np.zeros(len(names))
    q[:6] = q6
    for name, value in values.items():
        q[names.index(name)] = value
    return q


def expected_tip(T_base_platform, n, lean, swing, depth):
    """Return tip, direction of the shaft, and RCM (3,) in base, by hand: rotations about the RCM, then the depth."""
    a = AZIMUTH[n]
    out, side = np.array([np.cos(a), np.sin(a), 0]), np.array([-np.sin(a), np.cos(a), 0])
    up = np.sin(TILT) * out + np.cos(TILT) * np.array([0, 0, 1])
    rcm = OFFSET * side - DROP * np.array([0, 0, 1])
    across = np.cross(side, up)
    # lean is about the sideways axis; swing about the axis across, which the lean has turned, and against it
    R = spatial.exp_so3(lean * side) @ spatial.exp_so3(swing * across)
    shaft = R @ -up  # towards the patient
    p = rcm + depth * shaft
    T = T_base_platform
    return T[:3, :3] @ p + T[:3, 3], T[:3, :3] @ shaft, T[:3, :3] @ rcm + T[:3, 3]


def test_the_shafts_turn_about_their_remote_centres_at_all_joint_values(robot):
    mechanism, reference = robot.mechanism, robot.reference()
    frames = {frame.name: frame for frame in mechanism.frames}
    limits = {joint.name: np.array(joint.limits) for joint in mechanism.active}
    rng = np.random.default_rng(0)
    near = None
    for _ in range(6):
        values = {}
        for name in [f"{kind}{n}" for n in (1, 2) for kind in KINDS]:
            values[name] = rng.uniform(*limits[name])
        near = reference.solve(joints(robot, mechanism.posture("home")[:6] + rng.uniform(-2, 2, 6) * MM, values), near)
        for n in (1, 2):
            frame = frames[f"instrument{n}_tip"]
            T = near.link_poses[frame.body] @ frame.T_body_frame
            tip, shaft, rcm = expected_tip(near.T_base_tool, n, *(values[f"{kind}{n}"] for kind in KINDS))
            np.testing.assert_allclose(T[:3, 3], tip, atol=1e-9)
            np.testing.assert_allclose(T[:3, 2], shaft, atol=1e-9)
            assert spatial.point_to_line(rcm, T[:3, 3], T[:3, 2]) < 1e-9


def test_the_instruments_are_auxiliary_and_the_equations_are_those_of_sils(robot):
    plain = twin.load("sils")
    assert [joint.name for joint in robot.mechanism.auxiliary] == [f"{k}{n}" for n in (1, 2) for k in KINDS]
    T = plain.kinematics().forward(plain.mechanism.posture("insertion"))
    q = robot.inverse(T)
    np.testing.assert_array_equal(q[:6], plain.inverse(T))
    np.testing.assert_array_equal(q[6:], 0)
    limbs = [joint for joint in plain.mechanism.joints if joint.child != "platform"]
    both = {joint.name: joint for joint in robot.mechanism.joints}
    for joint in limbs:
        np.testing.assert_array_equal(both[joint.name].T_parent_joint, joint.T_parent_joint)
        np.testing.assert_array_equal(both[joint.name].T_child_joint, joint.T_child_joint)


@pytest.mark.slow
def test_no_instrument_touches_anything_above_the_lowered_patient(robot):
    """At the ends of all its joints, with the platform before and after the insertion of lowered_patient."""
    mechanism, reference = robot.mechanism, robot.reference()
    moving = [f"{kind}{n}" for kind in ("cradle", "guide", "instrument") for n in (1, 2)]
    shapes = {body.name: Shape(body.name, body.name, body.meshes) for body in mechanism.bodies if body.meshes}
    mated = {frozenset((joint.parent, joint.child)) for joint in mechanism.joints}
    pairs = []
    for a, b in product(moving, shapes):
        if a != b and frozenset((a, b)) not in mated:
            pairs.append((a, b))
    limits = {joint.name: joint.limits for joint in mechanism.active}
    near = None
    least = np.inf
    for height in (310, 210):
        q6 = robot.inverse(spatial.pose(np.eye(3), np.array([480, 320, height]) * MM))[:6]
        for ends in product((0, 1), repeat=3):
            values = {}
            for (kind, end), n in product(zip(KINDS, ends, strict=True), (1, 2)):
                values[f"{kind}{n}"] = limits[f"{kind}{n}"][end]
            near = reference.solve(joints(robot, q6, values), near)
            at = {name: coal.Transform3s(T[:3, :3].copy(), T[:3, 3].copy()) for name, T in near.link_poses.items()}
            for a, b in pairs:
                found = coal.DistanceResult()
                distance = coal.distance(shapes[a].model, at[a], shapes[b].model, at[b], coal.DistanceRequest(), found)
                least = min(least, distance)
    assert least > 2 * MM
