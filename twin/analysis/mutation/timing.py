"""Seed faults into trajectories: wrong speed, late joints, displaced samples, a missed RCM, or changed limits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from twin.analysis.mutation.fault import Fault, Made, drawn
from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.planning.protocol import Protocol
from twin.planning.trajectory import PhaseSpan, Trajectory

KINDS = ("faster", "slower", "late joint", "bump", "stated speed", "RCM", "in motion", "planned", "shaft", "clock")

_SCALED = ("tip_speed", "tip_acceleration", "rotation_speed", "rotation_acceleration")
"""Limits of a protocol that are multiplied by a factor."""

Planner = Callable[[Protocol], Trajectory]


def faults(
    trajectory: Trajectory, protocol: Protocol, planner: Planner, rng: np.random.Generator, count: int
) -> Iterator[Fault]:
    """Yield faults of a trajectory; `planner` plans a protocol with the sample time of the trajectory."""
    about = any(s.rcm is not None for s in trajectory.phases)
    kinds = [k for k in KINDS if about or k not in ("RCM", "shaft")]
    makers = {**_MAKERS, "planned": lambda _, rng: _planned(protocol, planner, rng)}
    for kind, (what, make) in drawn(kinds, makers, trajectory, rng, count):
        yield Fault("timing", kind, what, trajectory=make)


def _scaled(t: Trajectory, factor: float) -> Trajectory:
    spans = tuple(replace(s, t0=factor * s.t0, t1=factor * s.t1) for s in t.phases)
    return replace(t, t=factor * t.t, phases=spans)


def _faster(t: Trajectory, rng: np.random.Generator) -> Made:
    factor = float(rng.uniform(0.6, 0.95))
    return f"motion shortened to {100 * factor:.0f} % of its time", lambda: _scaled(t, factor)


def _slower(t: Trajectory, rng: np.random.Generator) -> Made:
    factor = float(rng.uniform(1.1, 2.0))
    return f"motion stretched to {100 * factor:.0f} % of its time, stated speeds unchanged", lambda: _scaled(t, factor)


def _late(t: Trajectory, rng: np.random.Generator) -> Made:
    j, lag = int(rng.integers(t.q.shape[1])), int(rng.integers(1, 5))
    step = float(t.t[1] - t.t[0])

    def make() -> Trajectory:
        def late(x: Array) -> Array:
            out = x.copy()
            out[lag:, j], out[:lag, j] = x[:-lag, j], x[0, j]
            return out

        return replace(t, q=late(t.q), qd=late(t.qd), qdd=late(t.qdd))

    return f"joint {t.joint_names[j]} {1e3 * lag * step:.0f} ms late", make


def _inner(t: Trajectory, rng: np.random.Generator) -> int:
    span: PhaseSpan = t.phases[rng.integers(len(t.phases))]
    return int(rng.integers(span.start + 2, max(span.stop - 2, span.start + 3)))


def _bump(t: Trajectory, rng: np.random.Generator) -> Made:
    k, size = _inner(t, rng), rng.uniform(0.2, 1.0)
    if rng.integers(2):
        j = int(rng.integers(t.q.shape[1]))
        q = t.q.copy()
        q[k, j] += size * MM  # m or rad
        return f"joint {t.joint_names[j]} moved {size:.2f} mm or mrad at t = {t.t[k]:.2f} s", lambda: replace(t, q=q)
    tools, frames = t.Ts_base_tool.copy(), t.Ts_base_frame.copy()
    direction = rng.normal(size=3)
    for Ts in (tools, frames):
        Ts[k, :3, 3] += size * MM * direction / np.linalg.norm(direction)
    made = replace(t, Ts_base_tool=tools, Ts_base_frame=frames)
    return f"tool moved {size:.2f} mm at t = {t.t[k]:.2f} s", lambda: made


def _stated(t: Trajectory, rng: np.random.Generator) -> Made:
    factor = float(rng.uniform(1.2, 2.0))
    if rng.integers(2):
        return f"stated joint speeds multiplied by {factor:.2f}", lambda: replace(t, qd=factor * t.qd)
    return f"stated tip speeds multiplied by {factor:.2f}", lambda: replace(t, tip_velocity=factor * t.tip_velocity)


def _moved_rcm(t: Trajectory, rng: np.random.Generator) -> Made:
    size, direction = rng.uniform(0.3, 2.0) * MM, rng.normal(size=3)
    span = next(s for s in t.phases if s.rcm is not None)
    shaft = t.Ts_base_frame[span.stop, :3, :3] @ t.shaft_axis
    direction -= (direction @ shaft) * shaft  # a shift along the shaft would have no effect
    step = size * direction / np.linalg.norm(direction)
    spans = tuple(s if s.rcm is None else replace(s, rcm=s.rcm + step) for s in t.phases)
    return f"RCM moved by {size / MM:.2f} mm", lambda: replace(t, phases=spans)


def _in_motion(t: Trajectory, rng: np.random.Generator) -> Made:
    first = t.phases[0]
    cut = int(rng.integers(first.stop // 4 + 1, first.stop // 2 + 2))
    rows = slice(cut, None)
    arrays = {n: v[rows] for n, v in vars(t).items() if isinstance(v, np.ndarray) and len(v) == len(t.t)}
    arrays["t"] = arrays["t"] - t.t[cut]
    spans = [
        replace(s, start=max(s.start - cut, 0), stop=s.stop - cut, t0=max(s.t0 - t.t[cut], 0.0), t1=s.t1 - t.t[cut])
        for s in t.phases
    ]
    points = {n: tuple(k - cut for k in rows_ if k >= cut) for n, rows_ in t.waypoints.items()}
    scalars = {
        "reach": {n: v[rows] for n, v in t.reach.items()},
        "singularity": {n: v[rows] for n, v in t.singularity.items()},
    }
    made = replace(t, **arrays, **scalars, phases=tuple(spans), waypoints=points)
    return f"first {t.t[cut]:.2f} s removed, so the motion does not begin at rest", lambda: made


def _planned(protocol: Protocol, planner: Planner, rng: np.random.Generator) -> Made:
    factor = float(rng.uniform(1.15, 2.0))
    limits = {
        kind: replace(l, **{name: factor * getattr(l, name) for name in _SCALED})
        for kind, l in protocol.limits.items()  # noqa: E741
    }
    return f"planned with limits multiplied by {factor:.2f}", lambda: planner(replace(protocol, limits=limits))


def _shaft(t: Trajectory, rng: np.random.Generator) -> Made:
    """Rotate the moved frame about its origin, smoothly, in the time between first and last phase with an RCM."""
    size = rng.uniform(0.3, 1.0) * DEG
    inside = [s for s in t.phases if s.rcm is not None]
    first, last = inside[0].start, inside[-1].stop
    s = np.clip((np.arange(len(t.t)) - first) / max(last - first, 1), 0, 1)
    angle = size * np.sin(np.pi * s) ** 2
    side = np.linalg.svd(np.outer(t.shaft_axis, t.shaft_axis))[0][:, 1]

    def make() -> Trajectory:
        R = spatial.exp_so3(angle[:, None] * side)
        frames = t.Ts_base_frame @ spatial.pose(R)
        T_frame_tool = spatial.inverse(t.Ts_base_frame[0]) @ t.Ts_base_tool[0]
        return replace(t, Ts_base_frame=frames, Ts_base_tool=frames @ T_frame_tool)

    return f"shaft turned about its tip by up to {size / DEG:.2f} deg", make


def _clock(t: Trajectory, rng: np.random.Generator) -> Made:
    k, part = _inner(t, rng), float(rng.uniform(0.05, 0.5))
    times = t.t.copy()
    times[k] += part * (times[1] - times[0])
    return f"time of the sample at t = {t.t[k]:.2f} s is {100 * part:.0f} % of a step late", lambda: replace(t, t=times)


_MAKERS: dict[str, Callable[[Trajectory, np.random.Generator], Made]] = {
    "faster": _faster,
    "slower": _slower,
    "late joint": _late,
    "bump": _bump,
    "stated speed": _stated,
    "RCM": _moved_rcm,
    "in motion": _in_motion,
    "shaft": _shaft,
    "clock": _clock,
}
