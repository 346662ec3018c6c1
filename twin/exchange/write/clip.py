"""A motion as players take it: poses of every link at keys, at the lowest rate that keeps an error budget.

A player draws a straight line between two keys. What that costs is measured against the mechanism itself, at
quarter points of every interval or closer: how far any point of any link is off, how far it is turned, and how
far the two sides of a joint come apart to the eye.
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
from twin.model.mechanism import Body, Joint, Mechanism
from twin.planning.trajectory import key_times

if TYPE_CHECKING:
    from twin.planning.trajectory import Trajectory

RATES = (10, 12, 15, 20, 24, 30, 40, 60, 120)
"""Key rates in Hz to choose from: those of 10 and more whose keys all lie on ticks of 1/120 s."""

_LOOKS = 4
"""Looks at the mechanism in each interval between keys, at least."""

_GRIDS = (120, 240, 480)
"""Rates in Hz of those looks: the finer, the longer it takes; the lowest key rates are tried on the coarsest."""


@dataclass(frozen=True)
class Budget:
    """What may go wrong between keys: a point of a link in m, its rotation in rad, an open joint in m."""

    position: float = 100 * UM
    rotation: float = 0.05 * DEG
    joint_gap: float = 100 * UM


@dataclass(frozen=True)
class Between:
    """What does go wrong between keys: worst point of any link in m, rotation in rad, open joint in m; and where."""

    position: float
    rotation: float
    joint_gap: float
    position_at: tuple[str, float] = ("", 0.0)
    rotation_at: tuple[str, float] = ("", 0.0)
    joint_gap_at: tuple[str, float] = ("", 0.0)

    def keeps(self, budget: Budget) -> bool:
        """Return whether nothing is above its budget."""
        return (
            self.position <= budget.position and self.rotation <= budget.rotation and self.joint_gap <= budget.joint_gap
        )


@dataclass(frozen=True)
class Clip:
    """A motion at keys, SI, world = base frame, z up.

    Attributes:
        name, title: of the protocol.
        times: (k,) s, from 0, every 1 / rate, and the end.
        links: T_world_body (k, 4, 4) by body.
        joints: (k,) m or rad by joint with a single coordinate, active and passive, tree and loop alike.
        active: names of the driven ones, in the order of q.
        phases: name, start and end in s.
        rate: Hz.
        between: worst errors between keys, for a player that draws lines and turns evenly or by components.
        budget: what the rate was chosen by; None: the keys are those of a file, nothing was chosen.
        frame: name of the frame that the protocol moves.
        phase_rcm: for each phase the RCM (3,) in base in m, or None.
        phase_rcm_enforced: for each phase whether the shaft must go through its RCM; without, it is only watched.
        assumed: "name: reason" of numbers that the protocol assumes.
        trocars: where the mechanism's trocars are, (3,) in base in m, by name.
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
    phase_rcm: tuple[Array | None, ...] = ()
    phase_rcm_enforced: tuple[bool, ...] = ()
    assumed: tuple[str, ...] = ()
    trocars: Mapping[str, Array] = field(default_factory=dict)

    @property
    def between_position(self) -> float:
        """Worst error in m of any point of a link between keys."""
        return self.between.position

    @property
    def between_rotation(self) -> float:
        """Worst error in rad of any link between keys."""
        return self.between.rotation

    @property
    def joint_gap(self) -> float:
        """Worst distance in m by which a joint opens between keys."""
        return self.between.joint_gap

    @property
    def rcm(self) -> Array | None:
        """The first RCM (3,) in base in m that is registered, or None."""
        return next((p for p in self.phase_rcm if p is not None), None)


def make_clip(
    mechanism: Mechanism,
    trajectory: Trajectory,
    title: str = "",
    budget: Budget | None = None,
    assumed: tuple[str, ...] = (),
) -> Clip:
    """Return a planned motion at the lowest of `RATES` that keeps the budget, or else at the highest.

    Args:
        mechanism: with its trocar where the protocol has it.
        trajectory: as planned.
        title: of the protocol.
        budget: default `Budget()`.
        assumed: "name: reason" of numbers that the protocol assumes.

    Raises:
        AssemblyError: the mechanism cannot take the tool poses.
    """
    from twin.reference import ReferenceModel

    budget = budget or Budget()
    model = ReferenceModel(mechanism)
    reaches = {b.name: extremes(mechanism, b) for b in mechanism.bodies}
    bad = ""  # the link that was furthest off at the rate before: it decides most of the next ones alone
    for grid in _GRIDS:
        times = key_times(trajectory.duration, grid)
        run = trajectory.on(model, times)
        links = {n: np.round(T, 13) + 0.0 for n, T in model.link_poses(run.x).items()}
        values = {n: run.q[:, i] for i, n in enumerate(trajectory.joint_names)} | run.q_passive
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
                    {n: np.round(v[keys], 13) + 0.0 for n, v in values.items()},
                    tuple(trajectory.joint_names),
                    tuple((p.name, float(p.t0), float(p.t1)) for p in trajectory.phases),
                    float(rate),
                    found,
                    budget,
                    trajectory.frame,
                    tuple(None if p.rcm is None else np.asarray(p.rcm, float) for p in trajectory.phases),
                    tuple(p.rcm_mode == "enforced" for p in trajectory.phases),
                    assumed,
                    mechanism.trocar_places,
                )
            bad = found.position_at[0]
    raise AssertionError("the last grid holds the last rate")


def _first_grid(rate: int) -> int:
    """Return the coarsest grid that has the keys of a rate on it and looks often enough between them."""
    return next(g for g in _GRIDS if g % rate == 0 and g >= _LOOKS * rate)


def key_rows(count: int, stride: int) -> Index:
    """Return which of `count` samples are keys: every stride-th, and the last."""
    rows = np.arange(0, count, stride)
    return rows if rows[-1] == count - 1 else np.append(rows, count - 1)


def extremes(mechanism: Mechanism, body: Body) -> Array:
    """Return points (n, 3) in the body's frame whose hull holds the body: nothing in it can be further off than they.

    They are the corners of the box around its meshes, its named frames and points, and its origin.
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
    """Return what players show between keys, by the samples that lie there.

    Positions are drawn linearly; rotations once evenly (slerp: glTF, USD) and once by components (Unity), of which
    the worse counts.

    Args:
        mechanism: whose joints are looked at.
        times: (k,) s.
        links: T_world_body (k, 4, 4) by body, as they are.
        keys: rows that a player is given.
        reaches: points (n, 3) of each body, see `extremes`.
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
            # |R - R'| is 2 sqrt(2) times the sine of half the angle: exact where the angle is small, and quick.
            chord = np.linalg.norm(off[:, :3, :3], axis=(1, 2)) / np.sqrt(8)
            note("rotation", name, 2 * np.arcsin(np.minimum(chord, 1.0)))
        for joint in mechanism.joints:
            if joint.parent not in still or joint.child not in still:
                note("joint_gap", joint.name, np.linalg.norm(_apart(joint, drawn) - true[joint.name], axis=1))
    zero = (0.0, ("", 0.0))
    (p, p_at), (r, r_at), (g, g_at) = (worst.get(k, zero) for k in ("position", "rotation", "joint_gap"))
    return Between(p, r, g, p_at, r_at, g_at)


def draw(times: Array, Ts: Array, keys: Index, blend: Callable[[Array, Array, Array], Array]) -> Array:
    """Return the poses (k, 4, 4) that a player shows at times (k,) if it knows only those of `Ts` at rows `keys`."""
    row = np.clip(np.searchsorted(keys, np.arange(len(times)), side="right") - 1, 0, max(len(keys) - 2, 0))
    after = np.minimum(row + 1, len(keys) - 1)
    t0, t1 = times[keys[row]], times[keys[after]]
    share = np.where(t1 > t0, (times - t0) / np.where(t1 > t0, t1 - t0, 1.0), 0.0)
    q, p = quaternions_xyzw(Ts[keys]), Ts[keys, :3, 3]
    R = spatial.matrix_from_quat_wxyz(np.roll(blend(q[row], q[after], share), 1, axis=-1))
    return spatial.pose(R, p[row] + share[:, None] * (p[after] - p[row]))


def _furthest(off: Array, reach: Array) -> Array:
    """Return how far (k,) the furthest of points (n, 3) is off, by differences of poses (k, 4, 4)."""
    moved = off[:, None, :3, :3] @ reach[None, :, :, None]
    return np.linalg.norm(moved[..., 0] + off[:, None, :3, 3], axis=-1).max(axis=1)


def _apart(joint: Joint, links: Mapping[str, Array]) -> Array:
    """Return how far (k, locked) the two sides of a joint are apart in the directions that it locks."""
    locked = [i for i in range(3) if i not in joint.free_axes]
    return joint.relative(links[joint.parent], links[joint.child])[:, locked, 3]


def quaternions_xyzw(Ts: Array) -> Array:
    """Return unit quaternions (k, 4) of poses (k, 4, 4), x y z w, with signs that never jump.

    The first has w >= 0. Many players interpolate the four numbers: a jump of sign is a half turn to them.
    """
    return np.roll(spatial.continuous_signs(spatial.quat_from_matrix_wxyz(Ts[:, :3, :3])), -1, axis=1)


def slerp(a: Array, b: Array, share: Array) -> Array:
    """Return quaternions (k, 4) that turn evenly from a (k, 4) to b (k, 4); share (k,) 0..1."""
    cosine = np.clip(np.sum(a * b, axis=1), -1.0, 1.0)
    # The angle from its chord is exact for the small turns between keys, the arc cosine is not.
    angle = 2 * np.arctan2(np.linalg.norm(b - a, axis=1), np.linalg.norm(b + a, axis=1))
    sine = np.sin(angle)
    small = (sine < 1e-9) | (np.abs(cosine) > 1 - 1e-18)
    safe = np.where(small, 1.0, sine)
    x = np.where(small, 1 - share, np.sin((1 - share) * angle) / safe)
    y = np.where(small, share, np.sin(share * angle) / safe)
    return x[:, None] * a + y[:, None] * b


def nlerp(a: Array, b: Array, share: Array) -> Array:
    """Return quaternions (k, 4) interpolated by components from a (k, 4) to b (k, 4), normalised; share (k,)."""
    q = a + share[:, None] * (b - a)
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def home_poses(mechanism: Mechanism) -> dict[str, Array]:
    """Return T_world_body (4, 4) of every body with the loops closed as drawn, the rest pose of every format."""
    from twin.reference import ReferenceModel

    poses = ReferenceModel(mechanism).home().link_poses
    return {n: np.round(T, 13) + 0.0 for n, T in poses.items()}


def model_hash(mechanism: Mechanism) -> str:
    """Return "sha256:..." over what a player must agree on: bodies with meshes, joints with frames and limits, frames.

    Two files with the same hash show the same robot. Numbers count to 1e-9, so that another processor's last bits
    do not matter.
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
