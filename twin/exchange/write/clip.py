"""A motion for players: poses of every link at keys. The key rate is the lowest that meets the error budget.

A player interpolates between two keys. Interpolation errors are differences from the motion of the mechanism: position
of any point of a link, rotation of a link, and joint gaps. They are measured at three or more times between two keys.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array, Index
from twin.core.units import DEG, UM
from twin.model.body import Body
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.planning.link_motion import LinkMotion, link_motion
from twin.planning.trajectory import key_times

if TYPE_CHECKING:
    from twin.planning.trajectory import Trajectory

RATES = (10, 12, 15, 20, 24, 30, 40, 60, 120)
"""Available key rates in Hz; with each rate, the key times are multiples of 1/120 s."""

_LOOKS = 4
"""Minimum ratio of sample rate to key rate."""

_GRIDS = (120, 240, 480)
"""Sample rates in Hz at which interpolation errors are computed.

The sample rate for a key rate is the lowest of these rates that is a multiple of the key rate and at least `_LOOKS`
times as high.
"""


@dataclass(frozen=True)
class ClipAccuracy:
    """Maximum errors between keys: position of a point of a link in m, rotation of a link in rad, joint gap in m."""

    position: float = 100 * UM
    rotation: float = 0.05 * DEG
    joint_gap: float = 100 * UM


@dataclass(frozen=True)
class InterpolationErrors:
    """Measured maximum errors between keys.

    Attributes:
        position: position error in m of any point of a link.
        rotation: rotation error in rad of a link.
        joint_gap: gap in m of a joint.
        position_at, rotation_at, joint_gap_at: (name of the link or joint, time in s) of the three maximum errors.
    """

    position: float
    rotation: float
    joint_gap: float
    position_at: tuple[str, float] = ("", 0.0)
    rotation_at: tuple[str, float] = ("", 0.0)
    joint_gap_at: tuple[str, float] = ("", 0.0)

    def numbers(self) -> dict[str, float]:
        """Return {name in exported files: error in m or rad}, rounded to six significant digits."""
        return {
            # Digits beyond the sixth differ between processors; the files are the same everywhere.
            "between_position": float(f"{self.position:.6g}"),
            "between_rotation": float(f"{self.rotation:.6g}"),
            "joint_gap": float(f"{self.joint_gap:.6g}"),
        }

    def keeps(self, budget: ClipAccuracy) -> bool:
        """Return whether no error exceeds the budget."""
        poses_fit = self.position <= budget.position and self.rotation <= budget.rotation
        return poses_fit and self.joint_gap <= budget.joint_gap


@dataclass(frozen=True)
class Clip:
    """A motion at keys, in SI units; the world is the base frame, z up.

    Attributes:
        times: (k,) in s: 0, then every 1 / rate, and the end.
        links: {body: T_world_body (k, 4, 4)}.
        joints: {joint: coordinates (k,) in m or rad}, for all joints with a single coordinate: active and passive, of
            the tree and of loops.
        active: names of the driven joints, in the order of q.
        phases: (name, start in s, end in s) of each phase.
        rate: key rate in Hz.
        between: maximum errors between keys, for players that interpolate positions linearly and rotations by slerp or
            by components.
        budget: the error budget for which the rate was chosen; None if the keys are the samples of a file.
        frame: name of the frame that the protocol moves.
        shaft_axis: (3,) unit vector along the shaft in `frame`.
        phase_rcm: RCM (3,) in m of each phase, relative to the base frame; None for a phase without an RCM.
        phase_rcm_enforced: for each phase, whether the shaft must pass through the RCM (True), or the RCM is only
            monitored (False).
        assumed: one text "name: reason" for each assumed number of the protocol.
        trocars: {trocar: position (3,) in m, relative to the base frame}.
    """

    name: str
    title: str
    times: Array
    links: Mapping[str, Array]
    joints: Mapping[str, Array]
    active: tuple[str, ...]
    phases: tuple[tuple[str, float, float], ...]
    rate: float
    between: InterpolationErrors
    budget: ClipAccuracy | None = None
    frame: str = ""
    shaft_axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    phase_rcm: tuple[Array | None, ...] = ()
    phase_rcm_enforced: tuple[bool, ...] = ()
    assumed: tuple[str, ...] = ()
    trocars: Mapping[str, Array] = field(default_factory=dict)

    @property
    def rcm(self) -> Array | None:
        """RCM (3,) in m, relative to the base frame, of the first phase with an RCM; None if no phase has an RCM."""
        for rcm in self.phase_rcm:
            if rcm is not None:
                return rcm
        return None


def make_clip(
    mechanism: Mechanism,
    trajectory: Trajectory,
    title: str = "",
    budget: ClipAccuracy | None = None,
    assumed: tuple[str, ...] = (),
    motion_at: Callable[[Array], LinkMotion] | None = None,
) -> Clip:
    """Return the clip of a planned motion, at the lowest key rate of `RATES` whose errors are within the budget.

    If the errors exceed the budget at every rate, the highest rate is used. `mechanism` has the trocar positions of the
    protocol. If `title` is "", the title is the name of the protocol. `assumed` contains one text "name: reason" for
    each assumed number of the protocol. `motion_at` returns the motion at times (k,) in s; None: the joint values of
    the trajectory drive the compiled loops of the mechanism.

    Raises:
        AssemblyError: the loops of the mechanism cannot be closed.
    """
    motion_at = motion_at or _by_plan(mechanism, trajectory)
    budget = budget or ClipAccuracy()
    reaches = extreme_points(mechanism)
    worst_link = ""  # link with the largest error at the previous rate; tested first, as it usually exceeds the budget
    for grid in _GRIDS:
        times = key_times(trajectory.duration, grid)
        motion = motion_at(times)
        links = rounded(motion.links)
        for rate in RATES:
            if _first_grid(rate) != grid:
                continue
            keys = key_rows(len(times), grid // rate)
            is_last_rate = rate == RATES[-1]
            if worst_link and not is_last_rate:
                error = draw(times, links[worst_link], keys, slerp) - links[worst_link]
                if _furthest(error, reaches[worst_link]).max() > budget.position:
                    continue
            between = measure_between(mechanism, times, links, keys, reaches)
            if between.keeps(budget) or is_last_rate:
                phases = []
                rcms = []
                enforced = []
                for phase in trajectory.phases:
                    phases.append((phase.name, float(phase.t0), float(phase.t1)))
                    rcms.append(_position(phase.rcm))
                    enforced.append(phase.rcm_mode == "enforced")
                return Clip(
                    trajectory.protocol,
                    title or trajectory.protocol,
                    times[keys],
                    _at_keys(links, keys),
                    rounded(_at_keys(motion.joints, keys)),
                    tuple(trajectory.joint_names),
                    tuple(phases),
                    float(rate),
                    between,
                    budget,
                    trajectory.frame,
                    np.asarray(trajectory.shaft_axis, float),
                    tuple(rcms),
                    tuple(enforced),
                    assumed,
                    mechanism.trocar_places,
                )
            worst_link, _ = between.position_at
    raise AssertionError("no sample rate is suitable for the highest key rate")


def _at_keys(arrays: Mapping[str, Array], keys: Index) -> dict[str, Array]:
    at_keys = {}
    for name, values in arrays.items():
        at_keys[name] = values[keys]
    return at_keys


def _position(rcm: Array | None) -> Array | None:
    if rcm is None:
        return None
    return np.asarray(rcm, float)


def _by_plan(mechanism: Mechanism, trajectory: Trajectory) -> Callable[[Array], LinkMotion]:
    """Return the function `motion_at` of `make_clip` for a trajectory without equations."""
    from twin.kinematics.closed_loops import LoopSolver

    loops = LoopSolver(mechanism)
    return lambda times: link_motion(loops, trajectory, times, None)


def _first_grid(rate: int) -> int:
    """Return the lowest sample rate in Hz that is a multiple of a key rate and at least `_LOOKS` times as high."""
    for grid in _GRIDS:
        if grid % rate == 0 and grid >= _LOOKS * rate:
            return grid
    raise AssertionError(f"no sample rate is suitable for the key rate {rate} Hz")


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
    extremes = {}
    for body in mechanism.bodies:
        extremes[body.name] = _extremes(mechanism, body)
    return extremes


def _extremes(mechanism: Mechanism, body: Body) -> Array:
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


def measure_between(
    mechanism: Mechanism, times: Array, links: Mapping[str, Array], keys: Index, reaches: Mapping[str, Array]
) -> InterpolationErrors:
    """Return the maximum interpolation errors of players, measured at the samples between keys.

    Players interpolate positions linearly. They interpolate rotations by slerp (glTF, USD) or by components (Unity).
    The larger of the two rotation errors is returned.

    Args:
        mechanism: the robot; the gaps of its joints between keys are measured too.
        times: times (k,) of the samples in s.
        links: {body: exact T_world_body (k, 4, 4)}.
        keys: indices of the keys among the samples.
        reaches: {body: points (n, 3) in m from `extreme_points`}; position errors are measured at these points.
    """
    moving = []
    for name, Ts in links.items():
        if np.any(Ts != Ts[0]):
            moving.append(name)
    gaps: dict[str, Array] = {}
    for joint in mechanism.joints:
        gaps[joint.name] = _gaps(joint, links)
    zero = (0.0, ("", 0.0))
    worst = {"position": zero, "rotation": zero, "joint_gap": zero}

    def note(quantity: str, name: str, error: Array) -> None:
        """Keep the largest error (k,) of a quantity, with the name of the link or joint, and the time."""
        k = int(np.argmax(error))
        if worst[quantity] is zero or error[k] > worst[quantity][0]:
            worst[quantity] = (float(error[k]), (name, float(times[k])))

    for blend in (slerp, nlerp):
        interpolated = dict(links)
        for name in moving:
            interpolated[name] = draw(times, links[name], keys, blend)
            error = interpolated[name] - links[name]
            note("position", name, _furthest(error, reaches[name]))
            # The Frobenius norm of R - R' is 2 sqrt(2) sin(angle / 2): accurate for small angles, and fast.
            chord = np.linalg.norm(error[:, :3, :3], axis=(1, 2)) / np.sqrt(8)
            note("rotation", name, 2 * np.arcsin(np.minimum(chord, 1.0)))
        for joint in mechanism.joints:
            if joint.parent in moving or joint.child in moving:
                gap_change = _gaps(joint, interpolated) - gaps[joint.name]
                note("joint_gap", joint.name, np.linalg.norm(gap_change, axis=1))
    position, position_at = worst["position"]
    rotation, rotation_at = worst["rotation"]
    joint_gap, joint_gap_at = worst["joint_gap"]
    return InterpolationErrors(position, rotation, joint_gap, position_at, rotation_at, joint_gap_at)


def draw(times: Array, Ts: Array, keys: Index, blend: Callable[[Array, Array, Array], Array]) -> Array:
    """Return the poses (k, 4, 4) that a player shows at times (k,), interpolated between the poses `Ts[keys]`."""
    after_each = np.searchsorted(keys, np.arange(len(times)), side="right")
    # Of the last key, no interval begins: its sample belongs to the last interval.
    before = np.clip(after_each - 1, 0, max(len(keys) - 2, 0))
    after = np.minimum(before + 1, len(keys) - 1)
    start = times[keys[before]]
    end = times[keys[after]]
    duration = np.where(end > start, end - start, 1.0)
    share = np.where(end > start, (times - start) / duration, 0.0)
    p = Ts[keys, :3, 3]
    q = quaternions_xyzw(Ts[keys])
    blended = blend(q[before], q[after], share)
    R = spatial.matrix_from_quat_wxyz(np.roll(blended, 1, axis=-1))
    return spatial.pose(R, p[before] + share[:, None] * (p[after] - p[before]))


def _furthest(error: Array, points: Array) -> Array:
    """Return the maximum position error (k,) in m of points (n, 3) for pose errors (k, 4, 4)."""
    turned = error[:, None, :3, :3] @ points[None, :, :, None]
    shifts = turned[..., 0] + error[:, None, :3, 3]
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
    is_small = sine < 1e-9
    safe = np.where(is_small, 1.0, sine)
    x = np.where(is_small, 1 - share, np.sin((1 - share) * angle) / safe)
    y = np.where(is_small, share, np.sin(share * angle) / safe)
    return x[:, None] * first + y[:, None] * second


def nlerp(first: Array, second: Array, share: Array) -> Array:
    """Return unit quaternions (k, 4), interpolated by components from `first` to `second` at fractions `share` (k,)."""
    q = first + share[:, None] * (second - first)
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def home_poses(mechanism: Mechanism) -> dict[str, Array]:
    """Return T_world_body (4, 4) of every body at home with closed loops: the rest pose of every format."""
    from twin.reference import ReferenceModel

    return rounded(ReferenceModel(mechanism).home().link_poses)


def rounded(arrays: Mapping[str, Array]) -> dict[str, Array]:
    """Return arrays rounded to 1e-13, so that exported files do not depend on the processor."""
    rounded_arrays = {}
    for name, array in arrays.items():
        rounded_arrays[name] = np.round(array, 13) + 0.0  # adding 0.0 removes negative zeros
    return rounded_arrays


def model_hash(mechanism: Mechanism) -> str:
    """Return the hash "sha256:..." of the data that players show: bodies, meshes, joints with limits, frames.

    Two files with the same hash show the same robot. Numbers are rounded to 1e-9, so that the hash does not depend on
    the processor.
    """
    digest = hashlib.sha256()

    def add(value: Any) -> None:
        digest.update(json.dumps(value, separators=(",", ":")).encode())

    def numbers(values: Any) -> list[float]:
        return (np.round(np.asarray(values, float).ravel(), 9) + 0.0).tolist()

    add([mechanism.name, mechanism.base, mechanism.tool])
    for body in mechanism.bodies:
        add(["body", body.name])
        for mesh in body.meshes:
            add([mesh.name, numbers(mesh.color_rgba)])
            digest.update(np.ascontiguousarray(np.round(mesh.vertices, 9) + 0.0, "<f8").tobytes())
            digest.update(np.ascontiguousarray(mesh.triangles, "<i4").tobytes())
    for joint in mechanism.joints:
        limits: list[float] | None = None
        if joint.limits is not None:
            limits = numbers(joint.limits)
        add([joint.name, joint.type, joint.parent, joint.child, joint.active, limits])
        add([numbers(joint.T_parent_joint), numbers(joint.T_child_joint)])
    for frame in mechanism.frames:
        add([frame.name, frame.body, numbers(frame.T_body_frame)])
    return f"sha256:{digest.hexdigest()}"


def between_keys(keys: Array, Ts: Array, times: Array) -> Array:
    """Return the poses (n, 4, 4) of a link that a player shows at times (n,) in s.

    Before the first key, a player shows the first pose; after the last key, it shows the last pose. `keys` (k,) are the
    times of the keys in s, `Ts` (k, 4, 4) are the poses at the keys.
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
