"""Seed faults into trajectories: wrong speed, late joints, displaced samples, a missed RCM, or changed limits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from twin.analysis.mutation.fault import Made, SeededFault, drawn
from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.planning.protocol import Protocol
from twin.planning.trajectory import PhaseSpan, Trajectory

KINDS = ("faster", "slower", "late joint", "bump", "stated speed", "RCM", "in motion", "planned", "shaft", "clock")
"""Kinds of faults in the order of seeding."""

_SCALED = ("tip_speed", "tip_acceleration", "rotation_speed", "rotation_acceleration")
"""Limits of a protocol that are multiplied by a factor."""

Planner = Callable[[Protocol], Trajectory]


def faults(
    trajectory: Trajectory, protocol: Protocol, planner: Planner, rng: np.random.Generator, count: int
) -> Iterator[SeededFault]:
    """Yield faults of a trajectory; `planner` plans a protocol with the sample time of the trajectory."""
    kinds = list(KINDS)
    if not _rcm_phases(trajectory):
        kinds.remove("RCM")
        kinds.remove("shaft")
    makers = {**_MAKERS, "planned": lambda _, rng: _planned_too_fast(protocol, planner, rng)}
    for kind, (what, make) in drawn(kinds, makers, subject=trajectory, rng=rng, count=count):
        yield SeededFault("timing", kind, what, trajectory=make)


def _rcm_phases(t: Trajectory) -> list[PhaseSpan]:
    """Return the phases in which the shaft passes through an RCM."""
    return [phase for phase in t.phases if phase.rcm is not None]


def _with_scaled_time(t: Trajectory, factor: float) -> Trajectory:
    """Return the trajectory with all times multiplied, and its stated speeds unchanged."""
    phases = []
    for phase in t.phases:
        phases.append(replace(phase, t0=factor * phase.t0, t1=factor * phase.t1))
    return replace(t, t=factor * t.t, phases=tuple(phases))


def _faster_motion(t: Trajectory, rng: np.random.Generator) -> Made:
    """Shorten the motion, which then exceeds limits or contradicts its stated speeds."""
    factor = float(rng.uniform(0.6, 0.95))
    return f"motion shortened to {100 * factor:.0f} % of its time", lambda: _with_scaled_time(t, factor)


def _slower_motion(t: Trajectory, rng: np.random.Generator) -> Made:
    """Stretch the motion, which then contradicts its stated speeds."""
    factor = float(rng.uniform(1.1, 2.0))
    return f"motion stretched to {100 * factor:.0f} % of its time, stated speeds unchanged", lambda: _with_scaled_time(
        t, factor
    )


def _late_joint(t: Trajectory, rng: np.random.Generator) -> Made:
    """Delay one joint by a few samples."""
    j = int(rng.integers(t.q.shape[1]))
    lag = int(rng.integers(1, 5))
    step = float(t.t[1] - t.t[0])

    def late(values: Array) -> Array:
        shifted = values.copy()
        shifted[lag:, j] = values[:-lag, j]
        shifted[:lag, j] = values[0, j]
        return shifted

    def make() -> Trajectory:
        return replace(t, q=late(t.q), qd=late(t.qd), qdd=late(t.qdd))

    return f"joint {t.joint_names[j]} {1e3 * lag * step:.0f} ms late", make


def _inner_sample(t: Trajectory, rng: np.random.Generator) -> int:
    """Return the index of a random sample inside a random phase, two samples from its ends where it is long enough."""
    phase: PhaseSpan = t.phases[rng.integers(len(t.phases))]
    first = phase.start + 2
    return int(rng.integers(first, max(phase.stop - 2, first + 1)))


def _displaced_sample(t: Trajectory, rng: np.random.Generator) -> Made:
    """Displace one sample: of a joint, or of tool and moved frame."""
    k = _inner_sample(t, rng)
    size = rng.uniform(0.2, 1.0)
    time = f"t = {t.t[k]:.2f} s"
    if rng.integers(2):
        j = int(rng.integers(t.q.shape[1]))
        q = t.q.copy()
        q[k, j] += size * MM  # m or rad
        return f"joint {t.joint_names[j]} moved {size:.2f} mm or mrad at {time}", lambda: replace(t, q=q)
    direction = rng.normal(size=3)
    shift = size * MM * direction / np.linalg.norm(direction)
    tools = t.Ts_base_tool.copy()
    tools[k, :3, 3] += shift
    frames = t.Ts_base_frame.copy()
    frames[k, :3, 3] += shift
    return f"tool moved {size:.2f} mm at {time}", lambda: replace(t, Ts_base_tool=tools, Ts_base_frame=frames)


def _wrong_stated_speed(t: Trajectory, rng: np.random.Generator) -> Made:
    """Multiply the stated speeds of the joints or of the tip."""
    factor = float(rng.uniform(1.2, 2.0))
    if rng.integers(2):
        return f"stated joint speeds multiplied by {factor:.2f}", lambda: replace(t, qd=factor * t.qd)
    return f"stated tip speeds multiplied by {factor:.2f}", lambda: replace(t, tip_velocity=factor * t.tip_velocity)


def _moved_rcm(t: Trajectory, rng: np.random.Generator) -> Made:
    """Move the RCM across the shaft, by 0.3 to 2 mm."""
    size = rng.uniform(0.3, 2.0) * MM
    direction = rng.normal(size=3)
    first = _rcm_phases(t)[0]
    shaft = t.Ts_base_frame[first.stop, :3, :3] @ t.shaft_axis
    direction -= (direction @ shaft) * shaft  # a shift along the shaft would have no effect
    step = size * direction / np.linalg.norm(direction)
    phases = []
    for phase in t.phases:
        if phase.rcm is not None:
            phase = replace(phase, rcm=phase.rcm + step)
        phases.append(phase)
    return f"RCM moved by {size / MM:.2f} mm", lambda: replace(t, phases=tuple(phases))


def _start_in_motion(t: Trajectory, rng: np.random.Generator) -> Made:
    """Remove the beginning of the first phase, so that the motion does not begin at rest."""
    first = t.phases[0]
    cut = int(rng.integers(first.stop // 4 + 1, first.stop // 2 + 2))
    start = t.t[cut]
    arrays = {}
    for name, values in vars(t).items():
        if isinstance(values, np.ndarray) and len(values) == len(t.t):
            arrays[name] = values[cut:]
    arrays["t"] = arrays["t"] - start
    phases = []
    for phase in t.phases:
        rows = {"start": max(phase.start - cut, 0), "stop": phase.stop - cut}
        times = {"t0": max(phase.t0 - start, 0.0), "t1": phase.t1 - start}
        phases.append(replace(phase, **rows, **times))
    waypoints = {}
    for name, rows in t.waypoints.items():
        waypoints[name] = tuple(row - cut for row in rows if row >= cut)
    made = replace(
        t,
        **arrays,
        reach={name: values[cut:] for name, values in t.reach.items()},
        singularity={name: values[cut:] for name, values in t.singularity.items()},
        phases=tuple(phases),
        waypoints=waypoints,
    )
    return f"first {start:.2f} s removed, so the motion does not begin at rest", lambda: made


def _planned_too_fast(protocol: Protocol, planner: Planner, rng: np.random.Generator) -> Made:
    """Plan the protocol with limits that are too high."""
    factor = float(rng.uniform(1.15, 2.0))
    limits = {}
    for kind, limit in protocol.limits.items():
        scaled = {name: factor * getattr(limit, name) for name in _SCALED}
        limits[kind] = replace(limit, **scaled)
    return f"planned with limits multiplied by {factor:.2f}", lambda: planner(replace(protocol, limits=limits))


def _turned_shaft(t: Trajectory, rng: np.random.Generator) -> Made:
    """Rotate the moved frame about its origin, smoothly, in the time between first and last phase with an RCM."""
    size = rng.uniform(0.3, 1.0) * DEG
    inside = _rcm_phases(t)
    first = inside[0].start
    last = inside[-1].stop
    progress = np.clip((np.arange(len(t.t)) - first) / max(last - first, 1), 0, 1)
    angles = size * np.sin(np.pi * progress) ** 2  # at rest at both ends
    # the second left singular vector is perpendicular to the shaft
    side = np.linalg.svd(np.outer(t.shaft_axis, t.shaft_axis))[0][:, 1]

    def make() -> Trajectory:
        R = spatial.exp_so3(angles[:, None] * side)
        frames = t.Ts_base_frame @ spatial.pose(R)
        T_frame_tool = spatial.inverse(t.Ts_base_frame[0]) @ t.Ts_base_tool[0]
        return replace(t, Ts_base_frame=frames, Ts_base_tool=frames @ T_frame_tool)

    return f"shaft turned about its tip by up to {size / DEG:.2f} deg", make


def _late_sample(t: Trajectory, rng: np.random.Generator) -> Made:
    """Shift the time of one sample."""
    k = _inner_sample(t, rng)
    share = float(rng.uniform(0.05, 0.5))
    times = t.t.copy()
    times[k] += share * (times[1] - times[0])
    what = f"time of the sample at t = {t.t[k]:.2f} s is {100 * share:.0f} % of a step late"
    return what, lambda: replace(t, t=times)


_MAKERS: dict[str, Callable[[Trajectory, np.random.Generator], Made]] = {
    "faster": _faster_motion,
    "slower": _slower_motion,
    "late joint": _late_joint,
    "bump": _displaced_sample,
    "stated speed": _wrong_stated_speed,
    "RCM": _moved_rcm,
    "in motion": _start_in_motion,
    "shaft": _turned_shaft,
    "clock": _late_sample,
}
