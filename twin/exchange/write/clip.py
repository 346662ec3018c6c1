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
class Budget:
    """Maximum errors between keys: position of a point of a link in m, rotation of a link in rad, joint gap in m."""

    position: float = 100 * UM
    rotation: float = 0.05 * DEG
    joint_gap: float = 100 * UM


@dataclass(frozen=True)
class Between:
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
        named = {"between_position": self.position, "between_rotation": self.rotation, "joint_gap": self.joint_gap}
        return {name: float(f"{value:.6g}") for name, value in named.items()}

    def keeps(self, budget: Budget) -> bool:
        """Return whether no error exceeds the budget."""
        return (
            self.position <= budget.position and self.rotation <= budget.rotation and self.joint_gap <= budget.joint_gap
        )


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
    between: Between
    budget: Budget | None = None
    frame: str = ""
    shaft_axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    phase_rcm: tuple[Array | None, ...] = ()
    phase_rcm_enforced: tuple[bool, ...] = ()
    assumed: tuple[str, ...] = ()
    trocars: Mapping[str, Array] = field(default_factory=dict)

    @property
    def rcm(self) -> Array | None:
        """RCM (3,) in m, relative to the base frame, of the first phase with an RCM; None if no phase has an RCM."""
        return next((p for p in self.phase_rcm if p is not None), None)


def make_clip(
    mechanism: Mechanism,
    trajectory: Trajectory,
    title: str = "",
    budget: Budget | None = None,
    assumed: tuple[str, ...] = (),
    moved: Callable[[Array], LinkMotion] | None = None,
) -> Clip:
    """Return the clip of a planned motion, at the lowest key rate of `RATES` whose errors are within the budget.

    If the errors exceed the budget at every rate, the highest rate is used. `mechanism` has the trocar positions of the
    protocol. If `title` is "", the title is the name of the protocol. `assumed` contains one text "name: reason" for
    each assumed number of the protocol. `moved` returns the motion at times (k,) in s; None: the joint values of the
    trajectory drive the compiled loops of the mechanism.

    Raises:
        AssemblyError: the loops of the mechanism cannot be closed.
    """
    moved = moved or _by_plan(mechanism, trajectory)
    budget = budget or Budget()
    reaches = {b.name: extremes(mechanism, b) for b in mechanism.bodies}
    bad = ""  # link with the largest error at the previous rate; tested first, because it usually exceeds the budget
    for grid in _GRIDS:
        times = key_times(trajectory.duration, grid)
        motion = moved(times)
        links = rounded(motion.links)
        for rate in (r for r in RATES if _first_grid(r) == grid):
            keys = key_rows(len(times), grid // rate)
            if bad and rate != RATES[-1]:
                off = draw(times, links[bad], keys, slerp) - links[bad]
                if _furthest(off, reaches[bad]).max() > budget.position:
                    continue
            found = measure_between(mechanism, times, links, keys, reaches)
            if found.keeps(budget) or rate == RATES[-1]:
                return Clip(
                    trajectory.protocol,
                    title or trajectory.protocol,
                    times[keys],
                    {n: T[keys] for n, T in links.items()},
                    rounded({n: v[keys] for n, v in motion.joints.items()}),
                    tuple(trajectory.joint_names),
                    tuple((p.name, float(p.t0), float(p.t1)) for p in trajectory.phases),
                    float(rate),
                    found,
                    budget,
                    trajectory.frame,
                    np.asarray(trajectory.shaft_axis, float),
                    tuple(None if p.rcm is None else np.asarray(p.rcm, float) for p in trajectory.phases),
                    tuple(p.rcm_mode == "enforced" for p in trajectory.phases),
                    assumed,
                    mechanism.trocar_places,
                )
            bad = found.position_at[0]
    raise AssertionError("no sample rate is suitable for the highest key rate")


def _by_plan(mechanism: Mechanism, trajectory: Trajectory) -> Callable[[Array], LinkMotion]:
    """Return the function `moved` of `make_clip` for a trajectory without equations."""
    from twin.kinematics.closed_loops import LoopSolver

    loops = LoopSolver(mechanism)
    return lambda times: link_motion(loops, trajectory, times, None)


def _first_grid(rate: int) -> int:
    """Return the lowest sample rate in Hz that is a multiple of a key rate and at least `_LOOKS` times as high."""
    return next(g for g in _GRIDS if g % rate == 0 and g >= _LOOKS * rate)


def key_rows(count: int, stride: int) -> Index:
    """Return the indices of the keys among `count` samples: every stride-th, and the last."""
    rows = np.arange(0, count, stride)
    return rows if rows[-1] == count - 1 else np.append(rows, count - 1)


def extremes(mechanism: Mechanism, body: Body) -> Array:
    """Return points (n, 3) in m, in a body's frame, such that the convex hull of the points contains the body.

    The points are the corners of the meshes' bounding box, named frames, named points, and the origin. The position
    error of a body has its maximum at one of the points.
    """
    points = [np.zeros((1, 3))]
    if meshes := [m.vertices for m in body.meshes if len(m.vertices)]:
        low = np.min([v.min(axis=0) for v in meshes], axis=0)
        high = np.max([v.max(axis=0) for v in meshes], axis=0)
        points.append(np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T)
    points += [f.T_body_frame[None, :3, 3] for f in mechanism.frames if f.body == body.name]
    points += [p.p_body[None] for p in mechanism.points if p.body == body.name]
    return np.concatenate(points)


def measure_between(
    mechanism: Mechanism, times: Array, links: Mapping[str, Array], keys: Index, reaches: Mapping[str, Array]
) -> Between:
    """Return the maximum interpolation errors of players, measured at the samples between keys.

    Players interpolate positions linearly. They interpolate rotations by slerp (glTF, USD) or by components (Unity).
    The larger of the two rotation errors is returned.

    Args:
        mechanism: the robot; the gaps of its joints between keys are measured too.
        times: times (k,) of the samples in s.
        links: {body: exact T_world_body (k, 4, 4)}.
        keys: indices of the keys among the samples.
        reaches: {body: points (n, 3) in m from `extremes`}; position errors are measured at these points.
    """
    still = {n for n, Ts in links.items() if np.all(Ts == Ts[0])}
    true = {j.name: _apart(j, links) for j in mechanism.joints}
    worst: dict[str, tuple[float, tuple[str, float]]] = {}

    def note(what: str, name: str, error: Array) -> None:
        k = int(np.argmax(error))
        if what not in worst or error[k] > worst[what][0]:
            worst[what] = (float(error[k]), (name, float(times[k])))

    for blend in (slerp, nlerp):
        drawn = dict(links)
        for name in links.keys() - still:
            drawn[name] = draw(times, links[name], keys, blend)
        for name, Ts in links.items():
            if name in still:
                continue
            off = drawn[name] - Ts
            note("position", name, _furthest(off, reaches[name]))
            # The Frobenius norm of R - R' is 2 sqrt(2) sin(angle / 2): accurate for small angles, and fast.
            chord = np.linalg.norm(off[:, :3, :3], axis=(1, 2)) / np.sqrt(8)
            note("rotation", name, 2 * np.arcsin(np.minimum(chord, 1.0)))
        for joint in mechanism.joints:
            if joint.parent not in still or joint.child not in still:
                note("joint_gap", joint.name, np.linalg.norm(_apart(joint, drawn) - true[joint.name], axis=1))
    zero = (0.0, ("", 0.0))
    (p, p_at), (r, r_at), (g, g_at) = (worst.get(k, zero) for k in ("position", "rotation", "joint_gap"))
    return Between(p, r, g, p_at, r_at, g_at)


def draw(times: Array, Ts: Array, keys: Index, blend: Callable[[Array, Array, Array], Array]) -> Array:
    """Return the poses (k, 4, 4) that a player shows at times (k,), interpolated between the poses `Ts[keys]`."""
    row = np.clip(np.searchsorted(keys, np.arange(len(times)), side="right") - 1, 0, max(len(keys) - 2, 0))
    after = np.minimum(row + 1, len(keys) - 1)
    t0, t1 = times[keys[row]], times[keys[after]]
    share = np.where(t1 > t0, (times - t0) / np.where(t1 > t0, t1 - t0, 1.0), 0.0)
    q, p = quaternions_xyzw(Ts[keys]), Ts[keys, :3, 3]
    R = spatial.matrix_from_quat_wxyz(np.roll(blend(q[row], q[after], share), 1, axis=-1))
    return spatial.pose(R, p[row] + share[:, None] * (p[after] - p[row]))


def _furthest(off: Array, reach: Array) -> Array:
    """Return the maximum position error (k,) in m of the points `reach` (n, 3) for pose errors `off` (k, 4, 4)."""
    moved = off[:, None, :3, :3] @ reach[None, :, :, None]
    return np.linalg.norm(moved[..., 0] + off[:, None, :3, 3], axis=-1).max(axis=1)


def _apart(joint: Joint, links: Mapping[str, Array]) -> Array:
    """Return the gaps (k, n) in m of a joint along its n locked directions."""
    locked = [i for i in range(3) if i not in joint.free_axes]
    return joint.relative(links[joint.parent], links[joint.child])[:, locked, 3]


def quaternions_xyzw(Ts: Array) -> Array:
    """Return unit quaternions (k, 4), x y z w, of poses (k, 4, 4), without sign changes between poses.

    The first quaternion has w >= 0. Many players interpolate the four numbers; a change of sign would appear as a
    rotation by up to 180 degrees.
    """
    return np.roll(spatial.continuous_signs(spatial.quat_from_matrix_wxyz(Ts[:, :3, :3])), -1, axis=1)


def slerp(a: Array, b: Array, share: Array) -> Array:
    """Return quaternions (k, 4), interpolated spherically from a (k, 4) to b (k, 4) at fractions `share` (k,), 0..1."""
    cosine = np.clip(np.sum(a * b, axis=1), -1.0, 1.0)
    # An arc tangent of the chord is accurate for small rotations between keys; an arc cosine is not.
    angle = 2 * np.arctan2(np.linalg.norm(b - a, axis=1), np.linalg.norm(b + a, axis=1))
    sine = np.sin(angle)
    small = (sine < 1e-9) | (np.abs(cosine) > 1 - 1e-18)
    safe = np.where(small, 1.0, sine)
    x = np.where(small, 1 - share, np.sin((1 - share) * angle) / safe)
    y = np.where(small, share, np.sin(share * angle) / safe)
    return x[:, None] * a + y[:, None] * b


def nlerp(a: Array, b: Array, share: Array) -> Array:
    """Return unit quaternions (k, 4), interpolated by components from a to b (k, 4) at fractions `share` (k,), 0..1."""
    q = a + share[:, None] * (b - a)
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def home_poses(mechanism: Mechanism) -> dict[str, Array]:
    """Return T_world_body (4, 4) of every body at home with closed loops: the rest pose of every format."""
    from twin.reference import ReferenceModel

    return rounded(ReferenceModel(mechanism).home().link_poses)


def rounded(arrays: Mapping[str, Array]) -> dict[str, Array]:
    """Return arrays rounded to 1e-13, so that exported files do not depend on the processor."""
    return {name: np.round(a, 13) + 0.0 for name, a in arrays.items()}


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
        limits = None if joint.limits is None else numbers(joint.limits)
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
    at = np.clip(times, keys[0], keys[-1])
    out = np.broadcast_to(np.eye(4), (len(times), 4, 4)).copy()
    out[:, :3, :3] = Slerp(keys, Rotation.from_matrix(Ts[:, :3, :3]))(at).as_matrix()
    for i in range(3):
        out[:, i, 3] = np.interp(at, keys, Ts[:, i, 3])
    return out
