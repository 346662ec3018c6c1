"""Conversions between numpy and the types Gf and Vt of OpenUSD.

Three differences between numpy and OpenUSD are handled only in this module. Gf matrices act on row vectors, so numpy
poses must be transposed (otherwise the translation is lost and no error is raised). The constructor of `Gf.Quat*`
expects w first, but `Vt.Quat*Array` uses x, y, z, w in conversions from and to numpy. Gf types require Python floats,
not numpy scalars.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from pxr import Gf, Vt

from twin.core import spatial
from twin.core.spatial import Array


def affine(M: Gf.Matrix4d) -> Array:
    """Return the affine matrix (4, 4) (column vectors) of a Gf matrix, including scale and shear."""
    return np.array(M, float).T.copy()


def vec3d(v: ArrayLike) -> Gf.Vec3d:
    """Return v (3,) as a Gf vector in double precision."""
    return Gf.Vec3d(*_flat(v, 3))


def vec3f(v: ArrayLike) -> Gf.Vec3f:
    """Return v (3,) as a Gf vector rounded to single precision."""
    return Gf.Vec3f(*_flat(v, 3))


def quatf(R: ArrayLike) -> Gf.Quatf:
    """Return the single precision Gf quaternion (w >= 0) of a rotation R (3, 3)."""
    return Gf.Quatf(*_flat(spatial.quat_from_matrix_wxyz(R), 4))


def quatd(R: ArrayLike) -> Gf.Quatd:
    """Return the double precision Gf quaternion (w >= 0) of a rotation R (3, 3)."""
    return Gf.Quatd(*_flat(spatial.quat_from_matrix_wxyz(R), 4))


def quat_wxyz(q) -> Array:
    """Return a Gf quaternion of any precision as float64 (4,), w first, not normalised."""
    return np.array([q.GetReal(), *q.GetImaginary()], float)


def rotation(q) -> Array:
    """Return the rotation (3, 3) of a Gf quaternion; the quaternion is normalised first.

    Raises:
        ValueError: the quaternion is zero or not finite.
    """
    wxyz = quat_wxyz(q)
    if not (np.all(np.isfinite(wxyz)) and np.linalg.norm(wxyz) > 1e-9):
        raise ValueError(f"quaternion (w, x, y, z) = {wxyz.tolist()} is not a rotation")
    return spatial.matrix_from_quat_wxyz(wxyz)


def vec3d_array(v: ArrayLike) -> Vt.Vec3dArray:
    """Return vectors v (n, 3) as a Vt array in double precision."""
    return Vt.Vec3dArray.FromNumpy(_rows(v, 3, np.float64))


def vec3f_array(v: ArrayLike) -> Vt.Vec3fArray:
    """Return vectors v (n, 3) as a Vt array rounded to single precision."""
    return Vt.Vec3fArray.FromNumpy(_rows(v, 3, np.float32))


def int_array(v: ArrayLike) -> Vt.IntArray:
    """Return integers v of any shape as a flat Vt array."""
    return Vt.IntArray.FromNumpy(np.ascontiguousarray(v, dtype=np.int32).ravel())


def quatd_array(wxyz: ArrayLike) -> Vt.QuatdArray:
    """Return quaternions (n, 4), w first, as a Vt array in double precision, without changing their signs."""
    xyzw = _rows(wxyz, 4, np.float64)[:, [1, 2, 3, 0]]
    return Vt.QuatdArray.FromNumpy(np.ascontiguousarray(xyzw))


def quat_array_wxyz(quaternions) -> Array:
    """Return a Vt quaternion array, or a list of Gf quaternions of one type, as float64 (n, 4), w first."""
    if isinstance(quaternions, list):
        # one call for all quaternions: numpy would query each of them
        if isinstance(quaternions[0], Gf.Quatd):
            quaternions = Vt.QuatdArray(quaternions)
        else:
            quaternions = Vt.QuatfArray(quaternions)
    xyzw = np.array(quaternions, float).reshape(-1, 4)
    return xyzw[:, [3, 0, 1, 2]]


def _flat(v: ArrayLike, count: int) -> list[float]:
    """Return v (n,) as Python floats, which Gf requires.

    Raises:
        ValueError: v has another shape.
    """
    values = np.asarray(v, float)
    if values.shape != (count,):
        raise ValueError(f"expected ({count},), not {values.shape}")
    return values.tolist()


def _rows(v: ArrayLike, count: int, dtype: type) -> np.ndarray:
    """Return v (k, n) as a contiguous array, which Vt requires.

    Raises:
        ValueError: v has another shape.
    """
    values = np.ascontiguousarray(v, dtype=dtype)
    if values.ndim != 2 or values.shape[1] != count:
        raise ValueError(f"the shape must be (n, {count}), not {values.shape}")
    return values
