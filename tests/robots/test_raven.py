"""Both arms of the Raven-II: table and mechanism, the eight candidates of the inverse, the mirror image."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import twin
from twin.core.units import DEG
from twin.kinematics import compile_formula
from twin.robots import _raven, load_formula

ROOT = Path(__file__).parents[2]
DATA = tomllib.loads((ROOT / "tests/data/raven.toml").read_text())
COUNT = int(os.environ.get("TWIN_RAVEN_POSES", "500"))
"""Poses of the slow comparison; 20 000 for the figure in docs/raven.md."""
ARGUMENTS = ("alpha1", "alpha2", "alpha3", "offset1", "offset2", "theta3", "base_turn", "L_w", "shaft_long")
BESIDE = 0.03
"""Distance in m of the wrist from the RCM from which the inverse is unique."""


@pytest.fixture(scope="module", params=[n for n in twin.names() if n.startswith("raven_")])
def robot(request):
    return twin.load(request.param)


def postures(robot, count, seed=3):
    """Random values of the active joints over their ranges."""
    limits = np.array([j.limits for j in robot.mechanism.active])
    return np.random.default_rng(seed).uniform(limits[:, 0], limits[:, 1], (count, len(limits)))


def in_patient(q, shaft_long=0.47):
    """Return the rows of q with the wrist beyond the RCM, and not at it."""
    return q[q[:, 2] < shaft_long - BESIDE]


def turned(off):
    """Differences of joints; the roll modulo a turn, for its range is wider."""
    off[:, 3] = np.angle(np.exp(1j * off[:, 3]))
    return np.abs(off[:, :6])


def from_zero(kin):
    return np.array(ca.DM(_raven.from_zero(kin.parameters["base_turn"])))


def named(row):
    return f"{row['arm']} at {row['joints'][0]} deg"


@pytest.mark.parametrize("row", DATA["tip"], ids=named)
def test_the_tip_is_where_the_table_has_it(row):
    kin = compile_formula(load_formula(f"raven_{row['arm']}"))
    T = kin.forward(np.array(row["joints"]) * [DEG, DEG, 1, DEG, DEG, DEG])
    np.testing.assert_allclose(from_zero(kin).T @ T[:3, 3], row["p"], atol=1e-6)
    if "R" in row:
        np.testing.assert_allclose(from_zero(kin).T @ T[:3, :3], row["R"], atol=1e-6)


@pytest.mark.parametrize("count", [100, pytest.param(COUNT, marks=pytest.mark.slow)])
def test_equations_and_mechanism_agree_over_the_range(robot, count):
    kin = robot.kinematics()
    run = robot.reference().solve_many(postures(robot, count))
    T = kin.forward_many(run.q)
    assert np.abs(T - run.Ts_base_tool).max() <= 1e-9
    inside = run.q[:, 2] < 0.47 - BESIDE
    for name, values in kin.points_many(T, run.q).items():
        if name in run.points:
            assert np.abs(values - run.points[name])[inside].max() <= 1e-9, name


@pytest.mark.slow
def test_the_inverse_returns_all_joints(robot):
    """20 000 poses of the whole range with the wrist beyond the RCM."""
    kin = robot.kinematics()
    q = in_patient(postures(robot, 30_000))[:20_000]
    off = turned(kin.inverse_many(kin.forward_many(q)) - q)
    assert len(off) > 18_000
    assert off.max() < 1e-9


def test_all_candidates_reach_the_pose_and_one_is_within_the_ranges(robot):
    kin = robot.kinematics()
    values = [kin.parameters[n] for n in ARGUMENTS]
    T = ca.SX.sym("T", 4, 4)
    found = _raven.candidates(T, *values)
    arm = compile_formula(robot.formula)
    candidates = ca.Function(
        "candidates", [T], [ca.horzcat(*(q for q, _ in found)), ca.vertcat(*(e for _, e in found))]
    )
    outside = ca.Function("outside", [T], [ca.vertcat(*(_raven.outside(q) + e for q, e in found))])
    q = postures(robot, 4000, seed=4)
    Ts = kin.forward_many(q)
    unique, within = 0, 0
    for k, (generating, T_base_tool) in enumerate(zip(q, Ts, strict=True)):
        joints, excess = (np.array(x) for x in candidates(T_base_tool))
        exist = excess.ravel() < 1e-9
        assert turned(joints.T - generating[:6]).max(axis=1).min() < 1e-8
        if generating[2] < 0.47 - BESIDE:
            inside = int((np.array(outside(T_base_tool)).ravel() < 1e-9).sum())
            within, unique = within + 1, unique + (inside == 1)
        if k < 200:
            again = arm.forward_many(joints.T[exist])
            assert np.abs(again - T_base_tool).max() < 1e-8
    assert within > 2000
    assert unique == within


def test_the_right_arm_is_the_mirror_image_of_the_left():
    left, right = (compile_formula(load_formula(f"raven_{side}")) for side in ("left", "right"))
    q = np.random.default_rng(1).uniform(-1, 1, (2000, 6)) * [1, 1, 0.3, 2, 1, 1] + [0.7, 1.5, 0.4, 0, 0, 0]
    M = np.diag([1.0, -1.0, 1.0])
    A, B = left.forward_many(q), right.forward_many(q * [1, 1, 1, -1, 1, -1])
    A, B = (from_zero(kin).T @ T[:, :3] for kin, T in ((left, A), (right, B)))
    assert np.abs(B[:, :, :3] - M @ A[:, :, :3] @ M).max() < 1e-12
    assert np.abs(B[:, :, 3] - A[:, :, 3] @ M).max() < 1e-12


def test_both_arms_are_drawn_with_the_same_numbers():
    files = [(ROOT / f"cad/raven_{side}/dimensions.toml").read_bytes() for side in ("left", "right")]
    assert files[0] == files[1]


def test_the_shaft_passes_the_remote_centre(robot):
    frame = robot.mechanism.frame("shaft_end")
    model = robot.reference()
    T = model.link_poses(model.solve_many(postures(robot, 50)).x)[frame.body] @ frame.T_body_frame
    assert np.linalg.norm(np.cross(T[:, :3, 3], T[:, :3, 2]), axis=1).max() < 1e-12


def test_the_arcs_have_the_angles_that_others_print(robot):
    """From the drawn mechanism: the angle between shoulder and tool, and the axes of another publication."""
    model, axes = robot.reference(), {}
    witness = {n: np.array(DATA["axes"][n], float) for n in ("shoulder", "elbow", "tool")}
    for elbow, angle in zip(DATA["spread"]["elbow"], DATA["spread"]["angle"], strict=True):
        q = np.array([0.5, elbow * DEG, 0.4, 0, 0, 0, 0])
        at = model.solve(q).link_poses
        for joint, name in (("shoulder", "shoulder"), ("elbow", "elbow"), ("insertion", "tool")):
            j = robot.mechanism.joint(joint)
            axes[name] = (at[j.parent] @ j.T_parent_joint)[:3, 2]
        way = -1 if axes["elbow"] @ axes["tool"] > 0 else 1  # the source gives the angle in the table of the left arm
        assert np.degrees(np.arccos(way * axes["shoulder"] @ axes["tool"])) == pytest.approx(angle, abs=1e-3)
    for pair in (("shoulder", "elbow"), ("elbow", "tool")):
        printed = abs(witness[pair[0]] @ witness[pair[1]])
        assert abs(axes[pair[0]] @ axes[pair[1]]) == pytest.approx(printed, abs=1e-3)


def test_the_wrist_of_da_vinci_instruments_is_shorter(robot):
    """The variant with the shorter wrist disagrees with the drawn instrument by the 4 mm of its table."""
    q = in_patient(postures(robot, 200))
    kin, other = robot.kinematics(), robot.kinematics({"table": "davinci_tool", "inverse": "davinci_tool"})
    T = other.forward_many(q)
    off = np.linalg.norm(T[:, :3, 3] - kin.forward_many(q)[:, :3, 3], axis=1)
    np.testing.assert_allclose(off, 0.004, atol=1e-12)
    assert turned(other.inverse_many(T) - q).max() < 1e-9


def test_motors_and_joints(robot):
    """Ratios of the released software; yaw is half the difference of both jaws, the opening their sum."""
    one = robot.mechanism.motors(np.eye(7)).T
    want = np.diag([136.1963, 121.5221, 2158.59, 5.3952, 8.992, -8.992, 4.496])
    want[5, 6], want[6, 5] = 4.496, 8.992
    np.testing.assert_allclose(one, want, rtol=1e-6, atol=1e-9)
