"""Seed faults into trajectories: wrong speed, late joints, displaced samples, a missed RCM, or changed limits."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from twin.analysis.mutation.fault import SeededFault, faults_in_turn
from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.planning.protocol import Protocol
from twin.planning.trajectory import PhaseSpan, Trajectory

KINDS = ("faster", "slower", "late joint", "bump", "stated speed", "RCM", "in motion", "planned", "shaft", "clock")
"""Kinds of faults in the order of seeding."""

_SCALED_LIMITS = ("tip_speed", "tip_acceleration", "rotation_speed", "rotation_acceleration")
"""Limits of a protocol that are multiplied by a factor."""

Planner = Callable[[Protocol], Trajectory]
"""Function that plans a protocol."""


TrajectoryFault = tuple[str, Callable[[], Trajectory]]
"""(what the fault changes, as text; function that returns the trajectory with the fault)."""


def faults(
    trajectory: Trajectory, protocol: Protocol, planner: Planner, rng: np.random.Generator, count: int
) -> Iterator[SeededFault]:
    """Yield faults of a trajectory; `planner` plans a protocol with the sample time of the trajectory."""
    kinds = list(KINDS)
    # without an RCM, nothing prescribes where the shaft passes
    if not _rcm_phases(trajectory):
        kinds.remove("RCM")
        kinds.remove("shaft")
    makers = {**_FAULT_OF_KIND, "planned": lambda _, rng: _planned_too_fast(protocol, planner, rng)}
    for kind, (what, make) in faults_in_turn(kinds, makers, subject=trajectory, rng=rng, count=count):
        yield SeededFault("timing", kind, what, trajectory=make)


def _rcm_phases(trajectory: Trajectory) -> list[PhaseSpan]:
    """Return the phases in which the shaft passes through an RCM."""
    rcm_phases = []
    for phase in trajectory.phases:
        if phase.rcm is not None:
            rcm_phases.append(phase)
    return rcm_phases


def _with_scaled_time(trajectory: Trajectory, factor: float) -> Trajectory:
    """Return the trajectory with all times multiplied, and its stated speeds unchanged."""
    phases = []
    for phase in trajectory.phases:
        phases.append(replace(phase, t0=factor * phase.t0, t1=factor * phase.t1))
    return replace(trajectory, t=factor * trajectory.t, phases=tuple(phases))


def _faster_motion(trajectory: Trajectory, rng: np.random.Generator) -> TrajectoryFault:
    """Shorten the motion, which then exceeds limits or contradicts its stated speeds."""
    factor = float(rng.uniform(0.6, 0.95))
    return f"motion shortened to {100 * factor:.0f} % of its time", lambda: _with_scaled_time(trajectory, factor)


def _slower_motion(trajectory: Trajectory, rng: np.random.Generator) -> TrajectoryFault:
    """Stretch the motion, which then contradicts its stated speeds."""
    factor = float(rng.uniform(1.1, 2.0))
    what = f"motion stretched to {100 * factor:.0f} % of its time, stated speeds unchanged"
    return what, lambda: _with_scaled_time(trajectory, factor)


def _late_joint(trajectory: Trajectory, rng: np.random.Generator) -> TrajectoryFault:
    """Delay one joint by a few samples."""
    joint = int(rng.integers(trajectory.q.shape[1]))
    lag = int(rng.integers(1, 5))
    step = float(trajectory.t[1] - trajectory.t[0])

    def late(values: Array) -> Array:
        shifted = values.copy()
        shifted[lag:, joint] = values[:-lag, joint]
        shifted[:lag, joint] = values[0, joint]
        return shifted

    def make() -> Trajectory:
        return replace(trajectory, q=late(trajectory.q), qd=late(trajectory.qd), qdd=late(trajectory.qdd))

    return f"joint {trajectory.joint_names[joint]} {1e3 * lag * step:.0f} ms late", make


def _inner_sample(trajectory: Trajectory, rng: np.random.Generator) -> int:
    """Return the index of a random sample inside a random phase, two samples from its ends where it is long enough."""
    phase: PhaseSpan = trajectory.phases[rng.integers(len(trajectory.phases))]
    first = phase.start + 2
    return int(rng.integers(first, max(phase.stop - 2, first + 1)))


def _displaced_sample(trajectory: Trajectory, rng: np.random.Generator) -> TrajectoryFault:
    """Displace one sample: of a joint, or of tool and moved frame."""
    sample = _inner_sample(trajectory, rng)
    size = rng.uniform(0.2, 1.0)
    time = f"t = {trajectory.t[sample]:.2f} s"
    if rng.integers(2):
        joint = int(rng.integers(trajectory.q.shape[1]))
        q = trajectory.q.copy()
        q[sample, joint] += size * MM  # m or rad
        what = f"joint {trajectory.joint_names[joint]} moved {size:.2f} mm or mrad at {time}"
        return what, lambda: replace(trajectory, q=q)
    direction = rng.normal(size=3)
    shift = size * MM * direction / np.linalg.norm(direction)
    tools = trajectory.Ts_base_tool.copy()
    tools[sample, :3, 3] += shift
    frames = trajectory.Ts_base_frame.copy()
    frames[sample, :3, 3] += shift
    return f"tool moved {size:.2f} mm at {time}", lambda: replace(trajectory, Ts_base_tool=tools, Ts_base_frame=frames)


def _wrong_stated_speed(trajectory: Trajectory, rng: np.random.Generator) -> TrajectoryFault:
    """Multiply the stated speeds of the joints or of the tip."""
    factor = float(rng.uniform(1.2, 2.0))
    if rng.integers(2):
        joint_speeds = factor * trajectory.qd
        return f"stated joint speeds multiplied by {factor:.2f}", lambda: replace(trajectory, qd=joint_speeds)
    tip_speeds = factor * trajectory.tip_velocity
    return f"stated tip speeds multiplied by {factor:.2f}", lambda: replace(trajectory, tip_velocity=tip_speeds)


def _moved_rcm(trajectory: Trajectory, rng: np.random.Generator) -> TrajectoryFault:
    """Move the RCM across the shaft, by 0.3 to 2 mm."""
    size = rng.uniform(0.3, 2.0) * MM
    direction = rng.normal(size=3)
    first = _rcm_phases(trajectory)[0]
    shaft = trajectory.Ts_base_frame[first.stop, :3, :3] @ trajectory.shaft_axis
    direction -= (direction @ shaft) * shaft  # a shift along the shaft would have no effect
    step = size * direction / np.linalg.norm(direction)
    phases = []
    for phase in trajectory.phases:
        if phase.rcm is not None:
            phase = replace(phase, rcm=phase.rcm + step)
        phases.append(phase)
    return f"RCM moved by {size / MM:.2f} mm", lambda: replace(trajectory, phases=tuple(phases))


def _start_in_motion(trajectory: Trajectory, rng: np.random.Generator) -> TrajectoryFault:
    """Remove the beginning of the first phase, so that the motion does not begin at rest."""
    first = trajectory.phases[0]
    cut = int(rng.integers(first.stop // 4 + 1, first.stop // 2 + 2))
    start = trajectory.t[cut]
    arrays = {}
    for name, values in vars(trajectory).items():
        if isinstance(values, np.ndarray) and len(values) == len(trajectory.t):
            arrays[name] = values[cut:]
    arrays["t"] = arrays["t"] - start  # the time begins at 0 again
    phases = []
    for phase in trajectory.phases:
        rows = {"start": max(phase.start - cut, 0), "stop": phase.stop - cut}
        times = {"t0": max(phase.t0 - start, 0.0), "t1": phase.t1 - start}
        phases.append(replace(phase, **rows, **times))
    waypoints = {}
    for name, rows in trajectory.waypoints.items():
        instants = np.array(rows, int)
        waypoints[name] = tuple((instants[instants >= cut] - cut).tolist())
    # reach and singularity are dictionaries of samples, which the loop over the arrays does not reach
    shortened = replace(
        trajectory,
        **arrays,
        reach=_without_beginning(trajectory.reach, cut),
        singularity=_without_beginning(trajectory.singularity, cut),
        phases=tuple(phases),
        waypoints=waypoints,
    )
    return f"first {start:.2f} s removed, so the motion does not begin at rest", lambda: shortened


def _without_beginning(values_of_name: Mapping[str, Array], cut: int) -> dict[str, Array]:
    """Return {name: its values (k,)} without the first `cut` values."""
    shortened = {}
    for name, values in values_of_name.items():
        shortened[name] = values[cut:]
    return shortened


def _planned_too_fast(protocol: Protocol, planner: Planner, rng: np.random.Generator) -> TrajectoryFault:
    """Plan the protocol with limits that are too high."""
    factor = float(rng.uniform(1.15, 2.0))
    limits = {}
    for kind, limit in protocol.limits.items():
        scaled = {}
        for name in _SCALED_LIMITS:
            scaled[name] = factor * getattr(limit, name)
        limits[kind] = replace(limit, **scaled)
    return f"planned with limits multiplied by {factor:.2f}", lambda: planner(replace(protocol, limits=limits))


def _turned_shaft(trajectory: Trajectory, rng: np.random.Generator) -> TrajectoryFault:
    """Rotate the moved frame about its origin, smoothly, in the time between first and last phase with an RCM."""
    size = rng.uniform(0.3, 1.0) * DEG
    rcm_phases = _rcm_phases(trajectory)
    first = rcm_phases[0].start
    last = rcm_phases[-1].stop
    progress = np.clip((np.arange(len(trajectory.t)) - first) / max(last - first, 1), 0, 1)
    angles = size * np.sin(np.pi * progress) ** 2  # at rest at both ends
    # the second left singular vector is perpendicular to the shaft
    turn_axis = np.linalg.svd(np.outer(trajectory.shaft_axis, trajectory.shaft_axis))[0][:, 1]

    def make() -> Trajectory:
        R = spatial.exp_so3(angles[:, None] * turn_axis)
        frames = trajectory.Ts_base_frame @ spatial.pose(R)
        # the frame is fixed to the tool, so that their first poses give the pose of one in the other
        T_frame_tool = spatial.inverse(trajectory.Ts_base_frame[0]) @ trajectory.Ts_base_tool[0]
        return replace(trajectory, Ts_base_frame=frames, Ts_base_tool=frames @ T_frame_tool)

    return f"shaft turned about its tip by up to {size / DEG:.2f} deg", make


def _late_sample(trajectory: Trajectory, rng: np.random.Generator) -> TrajectoryFault:
    """Shift the time of one sample."""
    sample = _inner_sample(trajectory, rng)
    share = float(rng.uniform(0.05, 0.5))
    times = trajectory.t.copy()
    times[sample] += share * (times[1] - times[0])
    what = f"time of the sample at t = {trajectory.t[sample]:.2f} s is {100 * share:.0f} % of a step late"
    return what, lambda: replace(trajectory, t=times)


_FAULT_OF_KIND: dict[str, Callable[[Trajectory, np.random.Generator], TrajectoryFault]] = {
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
