"""Symbolic maths against numpy, and its derivatives at the points where naive forms give NaN."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.core import spatial
from twin.formula import symbolic as sym

angle = st.floats(-3.1, 3.1)
vector = st.tuples(*(st.floats(-1.7, 1.7),) * 3).map(np.array)
small = st.tuples(*(st.sampled_from([0.0, 1e-12, 1e-9, 1e-7, 9.9e-4, 1.01e-3, 0.1]),) * 3).map(np.array)
many = settings(max_examples=60, deadline=None)


def compiled(function, *sizes):
    args = [ca.SX.sym(f"x{i}", n) for i, n in enumerate(sizes)]
    f = ca.Function("f", args, [ca.densify(ca.SX(function(*args)))])
    return lambda *values: f(*values).full()


EXP = compiled(sym.exp_so3, 3)
LOG = compiled(lambda v: sym.log_so3(sym.unflat(v, 3, 3)), 9)
ZYX = compiled(lambda v: sym.rotation_zyx(v[0], v[1], v[2]), 3)
ANGLES = compiled(lambda v: ca.vertcat(*sym.angles_zyx(sym.unflat(v, 3, 3))), 9)
QUATERNION = compiled(lambda v: sym.quaternion_wxyz(sym.unflat(v, 3, 3)), 9)


@many
@given(vector | small)
def test_exp_is_that_of_numpy(w):
    np.testing.assert_allclose(EXP(w), spatial.exp_so3(w), rtol=0, atol=1e-14)


@many
@given(vector | small)
def test_log_undoes_exp(w):
    # Within a turn the logarithm is unique; 1.7 sqrt(3) < pi.
    np.testing.assert_allclose(LOG(spatial.exp_so3(w).ravel()).ravel(), w, rtol=0, atol=1e-12)


@pytest.mark.parametrize("gap", [0.0, 1e-12, 1e-9, 1e-6, 1e-3])
@pytest.mark.parametrize("axis", np.vstack([np.eye(3), [[1, 1, 1]], [[1, -2, 0.5]]]))
def test_log_near_pi(axis, gap):
    w = (np.pi - gap) * axis / np.linalg.norm(axis)
    R = spatial.exp_so3(w)
    np.testing.assert_allclose(spatial.exp_so3(LOG(R.ravel()).ravel()), R, rtol=0, atol=1e-12)


@many
@given(angle, st.floats(-1.5, 1.5), angle)
def test_angles_undo_rotation(psi, theta, phi):
    R = ZYX([psi, theta, phi])
    want = spatial.exp_so3([0, 0, psi]) @ spatial.exp_so3([0, theta, 0]) @ spatial.exp_so3([phi, 0, 0])
    np.testing.assert_allclose(R, want, rtol=0, atol=1e-13)
    np.testing.assert_allclose(ANGLES(R.ravel()).ravel(), [psi, theta, phi], rtol=0, atol=1e-11)


@pytest.mark.parametrize("theta", [np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9])
def test_pitch_keeps_its_digits_near_a_right_angle(theta):
    assert ANGLES(ZYX([0, theta, 0]).ravel()).ravel()[1] == pytest.approx(theta, abs=1e-12)


@many
@given(vector | small)
def test_quaternion_is_that_of_numpy(w):
    R = spatial.exp_so3(w)
    np.testing.assert_allclose(QUATERNION(R.ravel()).ravel(), spatial.quat_from_matrix_wxyz(R), rtol=0, atol=1e-13)


def gradient(function, at):
    x = ca.SX.sym("x", len(at))
    return ca.Function("g", [x], [ca.jacobian(function(x), x)])(at).full()


def test_naive_norm_has_no_gradient_at_zero_and_ours_has():
    assert np.isnan(gradient(ca.norm_2, np.zeros(3))).all()
    np.testing.assert_array_equal(gradient(sym.norm, np.zeros(3)), np.zeros((1, 3)))
    np.testing.assert_allclose(gradient(sym.norm, [3, 4, 0]), [[0.6, 0.8, 0]])


def test_guarded_root_unit_and_their_gradients():
    assert gradient(sym.sqrt, [0.0]) == 0
    assert gradient(sym.sqrt, [4.0]) == 0.25
    assert compiled(sym.sqrt, 1)(-1.0) == 0
    np.testing.assert_array_equal(compiled(sym.unit, 3)(np.zeros(3)).ravel(), 0)
    np.testing.assert_allclose(compiled(sym.unit, 3)([0, 3, 4]).ravel(), [0, 0.6, 0.8])
    assert np.isfinite(gradient(sym.unit, np.zeros(3))).all()


def test_logarithm_is_differentiable_at_exact_coincidence():
    T = spatial.pose(spatial.exp_so3([0.3, -0.2, 0.5]), [0.1, 0.2, 0.3])
    J = gradient(lambda xi: sym.pose_residual(sym.retract(ca.SX(T), xi), ca.SX(T)), np.zeros(6))
    want = np.zeros((6, 6))
    want[:3, :3] = want[3:, 3:] = T[:3, :3].T
    np.testing.assert_allclose(J, want, atol=1e-12)
    G = gradient(lambda w: sym.log_so3(sym.exp_so3(w)), np.zeros(3))
    np.testing.assert_allclose(G, np.eye(3), atol=1e-12)


@many
@given(vector, vector)
def test_derivative_of_log_by_finite_differences(w, direction):
    def f(x):
        return spatial.log_so3(spatial.exp_so3(0.5 * x))

    J = gradient(lambda x: sym.log_so3(sym.exp_so3(0.5 * x)), w)
    step = 1e-6
    want = (f(w + step * direction) - f(w - step * direction)) / (2 * step)
    np.testing.assert_allclose(J @ direction, want, rtol=0, atol=1e-8)


def test_memory_order_is_that_of_numpy():
    M = np.arange(12.0).reshape(3, 4)
    np.testing.assert_array_equal(compiled(lambda v: sym.flat(sym.unflat(v, 3, 4)), 12)(M.ravel()).ravel(), M.ravel())
    np.testing.assert_array_equal(compiled(lambda v: sym.unflat(v, 3, 4), 12)(M.ravel()), M)
