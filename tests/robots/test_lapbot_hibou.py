"""Lapbot and Hibou on their ASSUMED tables: closed forms, trocar, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from made.trocars import TROCAR, lapbot_poses, targets
from twin.core import spatial
from twin.core.errors import KinematicsError
from twin.kinematics import compile_formula
from twin.robots import load_formula

POSES = 10_000


def row(alpha, d, theta, r):
    """One row of the table, written apart from the equations; theta and r may be arrays (k,)."""
    theta, r = np.broadcast_arrays(np.asarray(theta, float), np.asarray(r, float))
    o = np.zeros_like(theta)
    Rx = spatial.pose(spatial.exp_so3([np.radians(alpha), 0, 0]))
    Rz = spatial.pose(spatial.exp_so3(np.stack([o, o, theta], -1)), np.stack([o, o, r], -1))
    return Rx @ spatial.pose(p=[d, 0, 0]) @ Rz


def lapbot_chain(q):
    q1, q2, q3, q4, q5, q6, q7, q8, q9 = q
    T = row(0, 0, 0, q1) @ row(0, 0, q2, 0) @ row(0, 0.3, q3, 0) @ row(0, 0.3, q4, 0)
    T = T @ row(90, 0, np.pi / 2 + q5, 0) @ row(90, 0, -np.pi / 2 + q6, 0) @ row(90, 0, q7, 0.35)
    return T @ row(90, 0, np.pi / 2 + q8, 0) @ row(90, 0, np.pi / 2 + q9, 0) @ row(90, 0, 0, 0.02), T


def hibou_chain(q):
    q1, q2, q3, q4, q5, q6, q7 = q
    T = row(0, 0, q1, 0.35) @ row(-90, 0, q2, 0) @ row(0, 0.3, q3, 0) @ row(0, 0.3, q4, 0)
    T = T @ row(90, 0, np.pi / 2 + q5, 0) @ row(90, 0, q6, 0.30)
    return T @ row(-90, 0, q7, 0) @ row(90, 0, 0, 0.03), T


def test_published_zero_poses():
    """facts: Lapbot W (0.6, 0, 0.6), P_in (0.6, 0, 0.25), tip (0.6, 0, 0.23); Hibou camera (0.93, 0, 0.35)."""
    tool, inner = lapbot_chain([0.6, 0, 0, 0, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(inner[:3, 3], [0.6, 0, 0.25], atol=1e-15)
    np.testing.assert_allclose(tool[:3, 3], [0.6, 0, 0.23], atol=1e-15)
    np.testing.assert_allclose(tool[:3, 2], [0, 0, -1], atol=1e-15)
    tool, end = hibou_chain(np.zeros(7))
    np.testing.assert_allclose(end[:3, 3], [0.9, 0, 0.35], atol=1e-15)
    np.testing.assert_allclose(tool[:3, 3], [0.93, 0, 0.35], atol=1e-15)


@pytest.mark.slow
def test_lapbot_reaches_what_is_within_its_arm():
    kin = compile_formula(load_formula("lapbot"))
    Ts = lapbot_poses(POSES, 3)
    q = kin.inverse_many(Ts)
    fine = np.isfinite(q).all(axis=1)
    assert fine.mean() > 0.98
    reach = kin.reach(Ts=Ts)
    assert (np.stack(list(reach.values()))[:, ~fine] < 0).any(axis=0).all()  # refused for a reason that is named
    passive = kin.passive_many(Ts=Ts[fine])
    full = [*q[fine, :3].T, *(passive[n] for n in ("q4", "q5", "q6")), *q[fine, 3:].T]
    tool, shaft = lapbot_chain(full)
    assert np.abs(tool - Ts[fine]).max() < 1e-12
    assert spatial.point_to_line(TROCAR, shaft[:, :3, 3], shaft[:, :3, 2]).max() < 1e-12
    assert np.abs(full[1] + full[2] + full[3]).max() < 1e-14
    np.testing.assert_allclose(kin.forward_many(q[fine]), Ts[fine], atol=1e-11)


def test_hibou_reaches_every_point_below_its_trocar():
    kin = compile_formula(load_formula("hibou"))
    rng, inner, u = targets(POSES, 4, (0.05, 0.18))
    W = inner + 0.30 * u
    rr, zz = np.hypot(W[:, 0], W[:, 1]), W[:, 2] - 0.35
    q3 = np.arccos((rr**2 + zz**2 - 0.18) / 0.18)
    q2 = np.arctan2(-zz, rr) - np.arctan2(0.3 * np.sin(q3), 0.3 + 0.3 * np.cos(q3))
    tip = rng.uniform([-3, -0.7], [3, 0.7], (POSES, 2))
    want = np.column_stack([np.arctan2(W[:, 1], W[:, 0]), q2, q3, tip])
    Ts = kin.forward_many(want)
    assert np.isfinite(Ts).all()
    q = kin.inverse_many(Ts)
    np.testing.assert_allclose(q, want, atol=1e-11)
    passive = kin.passive_many(Ts=Ts)
    tool, shaft = hibou_chain([*q[:, :3].T, passive["q4"], passive["q5"], *q[:, 3:].T])
    assert np.abs(tool - Ts).max() < 1e-12
    np.testing.assert_allclose(shaft[:, :3, 3], inner, atol=1e-12)
    assert spatial.point_to_line(TROCAR, shaft[:, :3, 3], shaft[:, :3, 2]).max() < 1e-12


def test_hibou_refuses_a_turn_that_it_has_no_joint_for():
    kin = compile_formula(load_formula("hibou"))
    T = kin.forward(np.array([0.1, -1.0, 1.5, 0.2, 0.3]))
    R = spatial.exp_so3(0.01 * T[:3, 0])
    with pytest.raises(KinematicsError, match="five joints"):
        kin.inverse(spatial.pose(R @ T[:3, :3], T[:3, 3] + 0.03 * (R - np.eye(3)) @ T[:3, 2]))


@pytest.mark.parametrize("name", ["lapbot", "hibou"])
def test_a_trocar_beyond_the_shaft_is_refused(name):
    kin = compile_formula(load_formula(name))
    T = kin.program.pose_of_coordinates.one(np.array(kin.formula.seeds[0]))
    far = spatial.pose(T[:3, :3], T[:3, 3] - np.array([0, 0, 0.25]))
    with pytest.raises(KinematicsError, match="shaft"):
        kin.inverse(far)


@pytest.mark.parametrize("name", ["lapbot", "hibou"])
def test_the_trocar_is_a_parameter(name):
    formula = load_formula(name)
    kin = compile_formula(formula, parameters={"trocar_x": 0.42, "trocar_y": 0.02})
    T = kin.program.pose_of_coordinates.one(np.array(formula.seeds[0]))
    if name == "hibou":  # its direction follows from the trocar
        T = kin.forward(np.array([0.05, -1.05, 1.6, 0.0, 0.0]))
    points = kin.points_many(Ts=T[None])
    outer, inner = points["outer"][0], points["inner"][0]
    assert spatial.point_to_line(np.array([0.42, 0.02, 0.30]), inner[None], (outer - inner)[None])[0] < 1e-12


def test_tip_to_the_right_is_outer_point_to_the_left():
    kin = compile_formula(load_formula("lapbot"))
    T = kin.program.pose_of_coordinates.one(np.array([0.40, 0.0, 0.13, 0.0, np.pi, 0.0]))
    right = T.copy()
    right[1, 3] += 0.02
    W = kin.points_many(Ts=np.stack([T, right]))["outer"]
    assert W[1, 1] < W[0, 1] - 0.01
