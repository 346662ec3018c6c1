"""A protocol planned for playback, and its clock; independent of viewer and headset."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array

RATE = 60.0
"""Samples per second of a playback."""

HEARTBEAT = 6
"""Number of ticks since the last frame after which a stream sends a frame even if nothing has moved."""

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Available playback speeds."""


@dataclass(frozen=True)
class Playback:
    """A planned protocol, solved with the mechanism at `RATE` samples per second.

    Attributes:
        protocol, title: name and title of the protocol.
        t: times (k,) in s.
        x: configurations (k, nq) of the independent model; nq: number of the model's coordinates.
        q, qd, qdd: values (m or rad), speeds (m/s or rad/s) and accelerations (m/s2 or rad/s2) of the active joints,
            each (k, n).
        Ts_base_tool: planned tool poses (k, 4, 4).
        tip: origin (k, 3) of the frame that the protocol moves, in m in the base frame.
        shaft: unit vectors (k, 3) along the shaft towards the tip, in the base frame.
        rcm: RCM (k, 3) in m in the base frame; NaN while no RCM is registered.
        rcm_error: distance (k,) in m of the shaft axis from the RCM; NaN while no RCM is registered.
        depth: insertion depth (k,) in m; NaN while no RCM is registered.
        phases: (name, start in s, end in s) of each phase.
    """

    protocol: str
    title: str
    t: Array
    x: Array
    q: Array
    qd: Array
    qdd: Array
    Ts_base_tool: Array
    tip: Array
    shaft: Array
    rcm: Array
    rcm_error: Array
    depth: Array
    phases: tuple[tuple[str, float, float], ...]

    @property
    def duration(self) -> float:
        """Duration of the protocol in s."""
        return float(self.t[-1])

    def phase(self, t: float) -> str:
        """Return the name of the phase at a time in s."""
        return next((name for name, _, end in self.phases if t <= end), self.phases[-1][0])


def prepare(robot: str, protocol: str | None) -> Playback:
    """Plan a protocol (None: the robot's default protocol), and solve the mechanism at each sample.

    This function takes several seconds and should run in a separate process.

    Raises:
        TwinError: the protocol does not exist or cannot be planned, or the mechanism cannot follow it.
    """
    from twin import api

    loaded = api.load(robot)
    chosen = loaded.protocol(protocol)
    trajectory = api.plan(loaded, chosen)
    t = np.append(np.arange(0.0, trajectory.duration, 1 / RATE), trajectory.duration)
    q = trajectory.joints(t)
    x = trajectory.on(loaded.bound(chosen).reference(), t).x
    near = np.clip(np.searchsorted(trajectory.t, t), 0, len(trajectory.t) - 1)
    frames = trajectory.Ts_base_frame[near]
    axis = trajectory.shaft_axis / np.linalg.norm(trajectory.shaft_axis)
    return Playback(
        chosen.name,
        chosen.title,
        t,
        x,
        q,
        trajectory.qd[near],
        trajectory.qdd[near],
        trajectory.poses(t),
        frames[:, :3, 3],
        frames[:, :3, :3] @ axis,
        trajectory.rcm[near],
        trajectory.rcm_error[near],
        trajectory.depth[near],
        tuple((p.name, p.t0, p.t1) for p in trajectory.phases),
    )


class Clock:
    """Clock of a playback.

    Attributes:
        duration: duration in s; 0 without a playback.
        time: present time in s.
        speed: playback speed relative to real time.
        loop: whether the playback repeats.
        playing: whether the clock runs.
    """

    def __init__(self) -> None:
        self.duration, self.time, self.speed = 0.0, 0.0, 1.0
        self.loop, self.playing = True, False

    def play(self) -> None:
        """Start the clock at the present time, or at 0 if the present time is the end of the playback."""
        if self.time >= self.duration:
            self.time = 0.0
        self.playing = self.duration > 0

    def seek(self, t: float) -> None:
        """Set the time in s; a time outside 0 to `duration` is clipped."""
        self.time = float(np.clip(t, 0.0, self.duration))

    def advance(self, seconds: float) -> bool:
        """Advance the clock by an elapsed real time in s; return whether the clock was running."""
        if not self.playing or self.duration <= 0:
            return False
        ahead = self.time + seconds * self.speed
        if ahead < self.duration:
            self.time = ahead
        elif self.loop:
            self.time = ahead % self.duration
        else:
            self.time, self.playing = self.duration, False
        return True
