"""What players show between keys, and how far it is from the motion of the mechanism.

Players interpolate positions linearly, and rotations spherically (slerp: glTF, USD) or by components (nlerp: Unity).
Interpolation errors are differences from the exact poses at the samples between keys: position of any point of a link,
rotation of a link, and joint gaps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array, Index
from twin.exchange.write.clip import InterpolationErrors
from twin.model.body import Body
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism

_SMALL_SINE = 1e-9
"""Sine of half the rotation between two keys up to which slerp is linear: its quotient would be 0 / 0."""


def key_rows(count: int, stride: int) -> Index:
    """Return the indices of the keys among `count` samples: every stride-th, and the last."""
    rows = np.arange(0, count, stride)
    last = count - 1
    # A key twice at one time would be an interval without a duration, which players reject.
    if rows[-1] == last:
        return rows
    return np.append(rows, last)


def extreme_points(mechanism: Mechanism) -> dict[str, Array]:
    """Return {body: points (n, 3) in m, in the body's frame, whose convex hull contains the body}."""
    points = {}
    for body in mechanism.bodies:
        points[body.name] = _extreme_points_of(mechanism, body)
    return points


def _extreme_points_of(mechanism: Mechanism, body: Body) -> Array:
    """Return points (n, 3) in m, in a body's frame, such that the convex hull of the points contains the body.

    The points are the corners of the meshes' bounding box, named frames, named points, and the origin. The position
    error of a body has its maximum at one of the points.
    """
    points = [np.zeros((1, 3))]
    meshes = [mesh.vertices for mesh in body.meshes if len(mesh.vertices)]
    if meshes:
        vertices = np.concatenate(meshes)
        ranges = zip(vertices.min(axis=0), vertices.max(axis=0), strict=True)
        corners = np.array(np.meshgrid(*ranges))
        points.append(corners.reshape(3, -1).T)
    for frame in mechanism.frames:
        if frame.body == body.name:
            points.append(frame.T_body_frame[None, :3, 3])
    for point in mechanism.points:
        if point.body == body.name:
            points.append(point.p_body[None])
    return np.concatenate(points)


def interpolation_errors(
    mechanism: Mechanism, times: Array, links: Mapping[str, Array], rows: Index, points: Mapping[str, Array]
) -> InterpolationErrors:
    """Return the maximum interpolation errors of players, measured at the samples between keys.

    The larger of the errors with both interpolations of rotations is returned.

    Args:
        mechanism: the robot; the gaps of its joints between keys are measured too.
        times: times (k,) of the samples in s.
        links: {body: exact T_world_body (k, 4, 4)}.
        rows: indices of the keys among the samples, as from `key_rows`.
        points: {body: points (n, 3) in m from `extreme_points`}; position errors are measured at these points.
    """
    moving = []
    for name, Ts in links.items():
        if np.any(Ts != Ts[0]):
            moving.append(name)
    exact_gaps: dict[str, Array] = {}
    for joint in mechanism.joints:
        exact_gaps[joint.name] = _gaps(joint, links)
    zero = (0.0, ("", 0.0))
    worst = {"position": zero, "rotation": zero, "joint_gap": zero}

    def note(quantity: str, name: str, error: Array) -> None:
        """Keep the largest error (k,) of a quantity, with the name of the link or joint, and the time."""
        k = int(np.argmax(error))
        if worst[quantity] is zero or error[k] > worst[quantity][0]:
            worst[quantity] = (float(error[k]), (name, float(times[k])))

    for interpolate in (slerp, nlerp):
        shown = dict(links)
        for name in moving:
            shown[name] = interpolated_poses(times, links[name], rows, interpolate)
            difference = shown[name] - links[name]
            note("position", name, largest_position_error(difference, points[name]))
            # The Frobenius norm of R - R' is 2 sqrt(2) sin(angle / 2): accurate for small angles, and fast.
            sine = np.linalg.norm(difference[:, :3, :3], axis=(1, 2)) / np.sqrt(8)
            note("rotation", name, 2 * np.arcsin(np.minimum(sine, 1.0)))
        for joint in mechanism.joints:
            if joint.parent in moving or joint.child in moving:
                gap_change = _gaps(joint, shown) - exact_gaps[joint.name]
                note("joint_gap", joint.name, np.linalg.norm(gap_change, axis=1))
    position, position_at = worst["position"]
    rotation, rotation_at = worst["rotation"]
    joint_gap, joint_gap_at = worst["joint_gap"]
    return InterpolationErrors(position, rotation, joint_gap, position_at, rotation_at, joint_gap_at)


def interpolated_poses(
    times: Array, Ts: Array, rows: Index, interpolate: Callable[[Array, Array, Array], Array]
) -> Array:
    """Return the poses (k, 4, 4) that a player shows at times (k,) in s, interpolated between the poses `Ts[rows]`.

    `Ts` (k, 4, 4) are the exact poses; `interpolate` is `slerp` or `nlerp`.
    """
    after_each = np.searchsorted(rows, np.arange(len(times)), side="right")
    # Of the last key, no interval begins: its sample belongs to the last interval.
    before = np.clip(after_each - 1, 0, max(len(rows) - 2, 0))
    after = np.minimum(before + 1, len(rows) - 1)
    start = times[rows[before]]
    end = times[rows[after]]
    duration = np.where(end > start, end - start, 1.0)
    share = np.where(end > start, (times - start) / duration, 0.0)
    p = Ts[rows, :3, 3]
    xyzw = quaternions_xyzw(Ts[rows])
    shown_xyzw = interpolate(xyzw[before], xyzw[after], share)
    R = spatial.matrix_from_quat_wxyz(np.roll(shown_xyzw, 1, axis=-1))
    return spatial.pose(R, p[before] + share[:, None] * (p[after] - p[before]))


def largest_position_error(difference: Array, points: Array) -> Array:
    """Return the maximum distance (k,) in m by which points (n, 3) of a link are off.

    `difference` (k, 4, 4) are the shown poses less the exact ones.
    """
    turned = difference[:, None, :3, :3] @ points[None, :, :, None]
    shifts = turned[..., 0] + difference[:, None, :3, 3]
    return np.linalg.norm(shifts, axis=-1).max(axis=1)


def _gaps(joint: Joint, links: Mapping[str, Array]) -> Array:
    """Return the gaps (k, n) in m of a joint along its n locked directions."""
    locked = [i for i in range(3) if i not in joint.free_axes]
    T = joint.relative(links[joint.parent], links[joint.child])
    return T[:, locked, 3]


def quaternions_xyzw(Ts: Array) -> Array:
    """Return unit quaternions (k, 4), x y z w, of poses (k, 4, 4), without sign changes between poses.

    The first quaternion has w >= 0. Many players interpolate the four numbers; a change of sign would appear as a
    rotation by up to 180 degrees.
    """
    wxyz = spatial.continuous_signs(spatial.quat_from_matrix_wxyz(Ts[:, :3, :3]))
    return np.roll(wxyz, -1, axis=1)


def slerp(first: Array, second: Array, share: Array) -> Array:
    """Return quaternions (k, 4), interpolated spherically from `first` to `second` (k, 4) at fractions `share` (k,)."""
    # An arc tangent of the chord is accurate for small rotations between keys; an arc cosine is not.
    angle = 2 * np.arctan2(np.linalg.norm(second - first, axis=1), np.linalg.norm(second + first, axis=1))
    sine = np.sin(angle)
    is_small = sine < _SMALL_SINE
    divisor = np.where(is_small, 1.0, sine)
    weight_first = np.where(is_small, 1 - share, np.sin((1 - share) * angle) / divisor)
    weight_second = np.where(is_small, share, np.sin(share * angle) / divisor)
    return weight_first[:, None] * first + weight_second[:, None] * second


def nlerp(first: Array, second: Array, share: Array) -> Array:
    """Return unit quaternions (k, 4), interpolated by components from `first` to `second` at fractions `share` (k,)."""
    q = first + share[:, None] * (second - first)
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def poses_between_keys(keys: Array, Ts: Array, times: Array) -> Array:
    """Return the poses (n, 4, 4) of a link that a player shows at any times (n,) in s, not only at samples.

    Before the first key, a player shows the first pose; after the last key, it shows the last pose. `keys` (k,) are the
    times of the keys in s, `Ts` (k, 4, 4) are the poses at the keys. Rotations are interpolated spherically.
    """
    from scipy.spatial.transform import Rotation, Slerp

    if len(keys) == 1:
        return np.broadcast_to(Ts[0], (len(times), 4, 4))
    shown_times = np.clip(times, keys[0], keys[-1])
    T = np.broadcast_to(np.eye(4), (len(times), 4, 4)).copy()
    rotations = Slerp(keys, Rotation.from_matrix(Ts[:, :3, :3]))
    T[:, :3, :3] = rotations(shown_times).as_matrix()
    for axis in range(3):
        T[:, axis, 3] = np.interp(shown_times, keys, Ts[:, axis, 3])
    return T
