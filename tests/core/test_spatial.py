"""SE(3) and SO(3): the axioms, the edges (identity, half a turn) and an independent library."""

from __future__ import annotations

from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from twin.core import spatial

EPS = 1e-15


def law(*strategies):
    """Hold for every example, the same ones in each run."""
    return lambda test: settings(max_examples=60, deadline=None, derandomize=True)(given(*strategies)(test))


def vectors(size: float, count: int = 3):
    return arrays(float, count, elements=st.floats(-size, size, allow_subnormal=False))


def directions():
    return vectors(1.0).filter(lambda v: np.linalg.norm(v) > 0.1).map(lambda v: v / np.linalg.norm(v))


def rotations():
    """Rotations whose vector is shorter than half a turn, by axis and angle."""
    return st.tuples(directions(), st.floats(0, np.pi)).map(lambda a: spatial.exp_so3(a[0] * a[1]))


def poses():
    return st.tuples(rotations(), vectors(2.0)).map(lambda a: spatial.pose(*a))


# -- rotations ---------------------------------------------------------------------------------------


@law(vectors(1e3, 4))
def test_length_is_the_norm_bit_for_bit(v):
    assert spatial.length(v) == np.linalg.norm(v)


@law(vectors(4.0), vectors(4.0))
def test_hat_is_the_cross_product_and_antisymmetric(a, b):
    assert np.array_equal(spatial.hat(a), -spatial.hat(a).T)
    assert np.allclose(spatial.hat(a) @ b, np.cross(a, b), rtol=0, atol=8 * EPS * (1 + np.abs(a).max() * 4))


@law(vectors(7.0))
def test_exp_is_orthonormal_right_handed_and_pinocchios(w):
    R = spatial.exp_so3(w)
    assert np.abs(R.T @ R - np.eye(3)).max() < 4 * EPS
    assert np.linalg.det(R) == pytest.approx(1, abs=4 * EPS)
    assert np.abs(R - pin.exp3(w)).max() < 8 * EPS


@law(directions(), st.floats(-12, 0))
def test_log_undoes_exp_near_the_identity_to_the_last_digit(axis, exponent):
    w = axis * 10.0**exponent
    assert np.abs(spatial.log_so3(spatial.exp_so3(w)) - w).max() < 3e-16


def test_tiny_rotations_are_not_flushed_to_zero():
    w = np.array([1e-12, -2e-12, 3e-12])
    assert np.allclose(spatial.log_so3(spatial.exp_so3(w)), w, rtol=1e-12, atol=0)
    assert spatial.rotation_angle(spatial.exp_so3([0, 0, 1e-9])) == pytest.approx(1e-9, rel=1e-12)
    assert np.array_equal(spatial.exp_so3(np.zeros(3)), np.eye(3))
    assert np.array_equal(spatial.log_so3(np.eye(3)), np.zeros(3))


def test_exp_and_log_are_continuous_where_the_series_takes_over():
    axis = np.array([2.0, -1.0, 2.0]) / 3
    for angle in np.nextafter(1e-8, [0, 1]):
        R = spatial.exp_so3(axis * angle)
        assert np.abs(R - np.eye(3) - spatial.hat(axis * angle)).max() < 1e-16
        assert np.allclose(spatial.log_so3(R), axis * angle, rtol=1e-12, atol=0)


@law(directions(), st.floats(-13, -1))
def test_log_is_accurate_just_below_half_a_turn(axis, exponent):
    w = axis * (np.pi - 10.0**exponent)
    back = spatial.log_so3(spatial.exp_so3(w))
    if back @ w < 0:  # within rounding of half a turn both signs mean the same rotation
        assert 10.0**exponent < 1e-12
        back = -back
    assert np.abs(back - w).max() < 4e-15


@pytest.mark.parametrize("axis", [*np.eye(3), [1, 1, 0], [-1, 2, 3], [1e-9, 0, 1]])
def test_half_a_turn_has_its_axis_and_length_pi(axis):
    axis = np.array(axis) / np.linalg.norm(axis)
    w = spatial.log_so3(2 * np.outer(axis, axis) - np.eye(3))
    assert np.linalg.norm(w) == pytest.approx(np.pi, abs=4 * EPS)
    assert abs(w @ axis) == pytest.approx(np.pi, abs=8 * EPS)


@law(directions(), st.floats(np.pi * 1.001, 2 * np.pi * 0.999))
def test_log_takes_the_short_way_of_a_rotation_beyond_half_a_turn(axis, angle):
    assert np.abs(spatial.log_so3(spatial.exp_so3(axis * angle)) - axis * (angle - 2 * np.pi)).max() < 1e-14


@law(rotations())
def test_log_is_pinocchios_away_from_half_a_turn(R):
    w = spatial.log_so3(R)
    assert spatial.rotation_angle(R) == pytest.approx(np.linalg.norm(w), abs=EPS)
    if np.linalg.norm(w) < 3.1:
        assert np.abs(w - pin.log3(R)).max() < 1e-9  # its own formula loses digits towards half a turn


@law(st.floats(-3, 3), st.floats(-3, 3))
def test_rotations_about_z_add_and_commute(a, b):
    assert np.abs(spatial.rotation_z(a) @ spatial.rotation_z(b) - spatial.rotation_z(a + b)).max() < 4 * EPS
    assert np.abs(spatial.rotation_z(a)[:2, 0] - [np.cos(a), np.sin(a)]).max() < 2 * EPS


# -- quaternions -------------------------------------------------------------------------------------


@law(rotations())
def test_quaternions_are_unit_have_w_first_and_not_negative_and_are_pinocchios(R):
    q = spatial.quat_from_matrix_wxyz(R)
    assert np.linalg.norm(q) == pytest.approx(1, abs=2 * EPS)
    assert q[0] >= 0
    theirs_xyzw = pin.Quaternion(R).coeffs()
    theirs = np.roll(theirs_xyzw, 1)
    assert min(np.abs(q - theirs).max(), np.abs(q + theirs).max()) < 4 * EPS
    assert np.abs(spatial.matrix_from_quat_wxyz(q) - R).max() < 8 * EPS


@law(arrays(float, 4, elements=st.floats(-2, 2)).filter(lambda q: np.linalg.norm(q) > 1e-3))
def test_both_quaternions_of_a_rotation_give_it_whatever_their_length(q):
    R = spatial.matrix_from_quat_wxyz(q)
    assert np.abs(spatial.matrix_from_quat_wxyz(-3 * q) - R).max() < 4 * EPS
    unit = q / np.linalg.norm(q)
    assert np.abs(R - pin.Quaternion(*unit).matrix()).max() < 8 * EPS
    back = spatial.quat_from_matrix_wxyz(R)
    assert min(np.abs(back - unit).max(), np.abs(back + unit).max()) < 8 * EPS


@pytest.mark.parametrize("largest", range(4))
def test_each_branch_of_shepperds_method(largest):
    q = np.full(4, 0.1)
    q[largest] = 0.9
    q /= np.linalg.norm(q)
    assert np.abs(spatial.quat_from_matrix_wxyz(spatial.matrix_from_quat_wxyz(q)) - q).max() < 2 * EPS


# -- poses -------------------------------------------------------------------------------------------


@law(poses(), poses(), poses())
def test_poses_are_a_group(A, B, C):
    eye = np.eye(4)
    assert spatial.is_pose(A @ B, 1e-14)
    assert np.abs((A @ B) @ C - A @ (B @ C)).max() < 2e-14
    assert np.array_equal(A @ eye, A)
    assert np.array_equal(eye @ A, A)
    assert np.abs(A @ spatial.inverse(A) - eye).max() < 8 * EPS
    assert np.abs(spatial.inverse(A) @ A - eye).max() < 8 * EPS
    assert np.abs(spatial.inverse(A @ B) - spatial.inverse(B) @ spatial.inverse(A)).max() < 2e-14


@law(poses())
def test_inverse_is_pinocchios(T):
    assert np.abs(spatial.inverse(T) - pin.SE3(T).inverse().homogeneous).max() < 4 * EPS


def test_pose_has_defaults_and_broadcasts():
    assert np.array_equal(spatial.pose(), np.eye(4))
    R, p = spatial.rotation_z(np.linspace(0, 1, 5)), [1.0, 2.0, 3.0]
    T = spatial.pose(R, p)
    assert T.shape == (5, 4, 4)
    assert np.array_equal(T[:, :3, :3], R)
    assert np.array_equal(T[:, :3, 3], np.tile(p, (5, 1)))
    assert np.array_equal(T[:, 3], np.tile([0, 0, 0, 1.0], (5, 1)))


def test_all_functions_take_batches(rng):
    w, p = rng.normal(size=(4, 5, 3)), rng.normal(size=(4, 5, 3))
    R = spatial.exp_so3(w)
    T = spatial.pose(R, p)
    for i in np.ndindex(4, 5):
        assert np.array_equal(spatial.hat(w)[i], spatial.hat(w[i]))
        assert np.abs(R[i] - spatial.exp_so3(w[i])).max() < 4 * EPS
        assert np.abs(spatial.log_so3(R)[i] - spatial.log_so3(R[i])).max() < 4 * EPS
        assert np.abs(spatial.inverse(T)[i] - spatial.inverse(T[i])).max() < 4 * EPS
        q = spatial.quat_from_matrix_wxyz(R)[i]
        assert np.abs(q - spatial.quat_from_matrix_wxyz(R[i])).max() < 4 * EPS
    assert spatial.is_pose(T)


def _bent(change):
    T = spatial.pose(spatial.exp_so3([0.1, 0.2, 0.3]), [1.0, 2.0, 3.0])
    change(T)
    return T


def _set(index, value):
    def change(T):
        T[index] = value

    return change


@pytest.mark.parametrize(
    "T",
    [
        _bent(_set((0, 3), np.nan)),
        _bent(_set((0, 3), np.inf)),
        _bent(_set((3, 0), 1e-12)),
        _bent(_set((3, 3), 2.0)),
        np.diag([1.0, 1.0, -1.0, 1.0]),
        np.diag([1.0, 1.0, 1.0 + 1e-8, 1.0]),
        np.zeros((4, 4)),
        np.eye(3),
        np.stack([np.eye(4), np.diag([-1.0, 1, 1, 1])]),
    ],
    ids=["nan", "inf", "sheared", "scaled w", "mirror", "stretched", "zero", "3x3", "one of two"],
)
def test_is_pose_rejects(T):
    assert not spatial.is_pose(T)


def test_is_pose_keeps_to_its_tolerance():
    T = np.diag([1.0, 1.0, 1.0 + 1e-7, 1.0])
    assert spatial.is_pose(T, 1e-6)
    assert not spatial.is_pose(T, 1e-7)


# -- frames and lines --------------------------------------------------------------------------------


@law(directions(), directions())
def test_frame_from_axes_keeps_z_and_the_half_plane_of_x(z, x):
    if np.linalg.norm(np.cross(z, x)) < 1e-3:
        return
    R = spatial.frame_from_axes(5 * z, 0.2 * x)
    assert np.abs(R.T @ R - np.eye(3)).max() < 1e-12
    assert np.linalg.det(R) == pytest.approx(1, abs=1e-12)
    assert np.abs(R[:, 2] - z).max() < 4 * EPS
    assert R[:, 0] @ x > 0
    assert abs(R[:, 1] @ x) < 1e-12


@pytest.mark.parametrize("x", [[0, 0, 3], [0, 0, -1], [0, 0, 0], [1e-12, 0, 1]])
def test_frame_from_axes_refuses_parallel_axes(x):
    with pytest.raises(ValueError, match="parallel"):
        spatial.frame_from_axes([0, 0, 2], x)


def test_frame_from_axes_refuses_a_vanishing_z():
    with pytest.raises(ValueError, match="z"):
        spatial.frame_from_axes([0, 0, 0], [1, 0, 0])


@law(vectors(2.0), directions(), st.floats(-3, 3), st.floats(0, 2), st.floats(0.01, 100))
def test_point_to_line_whatever_the_length_of_its_direction(origin, direction, along, away, length):
    side = np.cross(direction, [1.0, 0, 0] if abs(direction[0]) < 0.8 else [0, 1.0, 0])
    point = origin + along * direction + away * side / np.linalg.norm(side)
    assert spatial.point_to_line(point, origin, length * direction) == pytest.approx(away, abs=1e-14)


def test_point_to_line_in_batches():
    points = np.array([[0.0, 3.0, 4.0], [1.0, 0.0, 0.0], [9.0, -1.0, 0.0]])
    assert np.array_equal(spatial.point_to_line(points, np.zeros(3), [2.0, 0, 0]), [5.0, 0.0, 1.0])


@pytest.mark.parametrize("order", ["".join(o) for o in product("xyz", repeat=3) if o[0] != o[1] and o[1] != o[2]])
def test_angles_of_every_sequence_turn_back(order, rng):
    angles = rng.uniform(-np.pi, np.pi, (200, 3))
    straight = 0.0 if order[0] == order[2] else np.pi / 2
    angles[::4, 1] = straight  # the first and the last turn about one line
    angles[1::4, 1] = straight + 1e-11
    axes = np.eye(3)["xyz".index(order[0])], np.eye(3)["xyz".index(order[1])], np.eye(3)["xyz".index(order[2])]

    def turned(a):
        R = np.eye(3)
        for i, axis in enumerate(axes):
            R = R @ spatial.exp_so3(a[..., i, None] * axis)
        return R

    R = turned(angles)
    found = spatial.euler_angles(R, order)
    assert np.abs(turned(found) - R).max() < 2e-12
    assert (found[::4, 0] == 0).all()
    assert (spatial.euler_angles(R[::4], order, 0.3)[:, 0] == 0.3).all()


def test_the_difference_of_two_poses_is_a_distance_and_an_angle():
    T = spatial.pose(spatial.exp_so3([0.3, -0.2, 0.1]), [1.0, 2.0, 3.0])
    moved = T @ spatial.pose(spatial.exp_so3([0.0, 0.0, 0.5]), [0.0, 0.3, 0.4])
    assert spatial.pose_difference(T, moved) == pytest.approx((0.5, 0.5), abs=1e-14)
