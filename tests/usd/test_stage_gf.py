"""numpy <-> Gf: order, precision and shape of every conversion, by property."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pxr import Gf, Vt

from twin.core import spatial
from twin.usd import gf

FLOAT32_TOL = 1e-7
"""Rounding of unit quaternions to single precision."""

numbers = st.floats(-10, 10, allow_subnormal=False)
vectors = arrays(float, 3, elements=numbers)
poses = st.builds(lambda w, p: spatial.pose(spatial.exp_so3(w), p), vectors, vectors)
quick = settings(max_examples=60, deadline=None)


def matrix(T):
    return Gf.Matrix4d(*T.T.ravel().tolist())


@quick
@given(poses)
def test_a_pose_survives_exactly(T):
    assert np.array_equal(gf.affine(matrix(T)), T)


@quick
@given(poses, vectors)
def test_a_pose_moves_points_like_usd_does(T, p):
    assert np.allclose(matrix(T).Transform(gf.vec3d(p)), T[:3, :3] @ p + T[:3, 3], atol=1e-12)


@quick
@given(poses, poses)
def test_products_turn_round(A, B):
    assert np.allclose(gf.affine(matrix(B) * matrix(A)), A @ B, atol=1e-11)


@quick
@given(vectors)
def test_quaternions_keep_the_rotation(w):
    R = spatial.exp_so3(w)
    assert np.allclose(gf.rotation(gf.quatd(R)), R, atol=1e-14)
    assert spatial.rotation_angle(gf.rotation(gf.quatf(R)).T @ R) < 4 * FLOAT32_TOL
    assert gf.quatd(R).GetReal() >= 0
    turned = Gf.Rotation(gf.quatd(R)).TransformDir(Gf.Vec3d(1, 2, 3))
    assert np.allclose(turned, R @ [1, 2, 3], atol=1e-13)


@quick
@given(arrays(float, (5, 4), elements=st.floats(-1, 1, width=32)))
def test_quaternion_arrays_are_w_first_on_our_side(wxyz):
    array = gf.quatd_array(wxyz)
    for row, q in zip(wxyz, array, strict=True):
        assert [q.GetReal(), *q.GetImaginary()] == row.tolist()
    assert np.array_equal(gf.quat_array_wxyz(array), wxyz)
    assert np.array_equal(gf.quat_array_wxyz(list(array)), wxyz)
    assert np.array_equal(gf.quat_array_wxyz([Gf.Quatd(1, 2, 3, 1 / 3)]), [[1, 2, 3, 1 / 3]])
    assert np.array_equal(gf.quat_array_wxyz(Vt.QuatdArray([Gf.Quatd(1, 2, 3, 4)])), [[1, 2, 3, 4]])


@quick
@given(arrays(float, (4, 3), elements=st.floats(-1e3, 1e3)))
def test_vector_arrays(rows):
    assert np.array_equal(np.array(gf.vec3d_array(rows)), rows)
    assert np.array_equal(np.array(gf.vec3f_array(rows)), rows.astype(np.float32))


def test_integers_are_flattened():
    assert list(gf.int_array([[1, 2], [3, 4]])) == [1, 2, 3, 4]


def test_non_contiguous_input():
    rows = np.arange(12.0).reshape(3, 4).T
    assert np.array_equal(np.array(gf.vec3d_array(rows)), rows)
    assert np.array_equal(np.array(gf.vec3d_array(np.ones((5, 6))[:, ::2])), np.ones((5, 3)))


@pytest.mark.parametrize(
    ("convert", "bad"),
    [
        (gf.vec3d, [1, 2]),
        (gf.vec3f, np.eye(3)),
        (gf.vec3d_array, np.ones(3)),
        (gf.vec3f_array, np.ones((2, 4))),
        (gf.quatd_array, np.ones((2, 3))),
    ],
)
def test_wrong_shapes_raise(convert, bad):
    with pytest.raises(ValueError):
        convert(bad)


@pytest.mark.parametrize("q", [Gf.Quatf(0, 0, 0, 0), Gf.Quatd(float("nan"), 0, 0, 0)])
def test_a_quaternion_without_direction_raises(q):
    with pytest.raises(ValueError, match="is not a rotation"):
        gf.rotation(q)


def test_a_quaternion_that_is_not_unit_is_normalised():
    assert np.allclose(gf.rotation(Gf.Quatd(2, 0, 0, 2)), spatial.rotation_z(np.pi / 2))
