"""A protocol made ready for playing, and the clock that plays it. Knows nothing of any browser."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array

RATE = 60.0
"""Samples a second: what a display shows."""

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Speeds that are offered."""


@dataclass(frozen=True)
class Playback:
    """A planned protocol, solved by the mechanism, at `RATE`.

    Attributes:
        protocol, title: of the file.
        t: (k,) s.
        x: (k, nq) configurations of the independent model.
        q, qd, qdd: (k, n) active joints, their rates and accelerations, in m or rad.
        Ts_base_tool: (k, 4, 4) as planned.
        tip: (k, 3) origin of the moved frame in base. shaft: (k, 3) unit vectors along the shaft towards it.
        rcm: (k, 3) in base; NaN where none is registered.
        rcm_error, depth: (k,) m; NaN likewise.
        phases: name, start and end in s.
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
        """Length in s."""
        return float(self.t[-1])

    def phase(self, t: float) -> str:
        """Return the name of the phase at a time in s."""
        return next((name for name, _, end in self.phases if t <= end), self.phases[-1][0])


def prepare(robot: str, protocol: str | None) -> Playback:
    """Plan a protocol of a robot and let the mechanism follow it. Takes seconds: for a process of its own.

    Raises:
        TwinError: no such protocol, or it cannot be planned or followed.
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
    """Time of a playback: running or held, slow or fast, once or in a loop.

    Attributes:
        duration: s; 0 while there is nothing to play.
        time: where it stands, in s.
        speed: seconds played for each that passes.
        loop: whether it begins again at the end.
        playing: whether it runs.
    """

    def __init__(self) -> None:
        self.duration, self.time, self.speed = 0.0, 0.0, 1.0
        self.loop, self.playing = True, False

    def play(self) -> None:
        """Run; from the beginning if it stood at the end."""
        if self.time >= self.duration:
            self.time = 0.0
        self.playing = self.duration > 0

    def seek(self, t: float) -> None:
        """Stand at a time in s, held within the duration."""
        self.time = float(np.clip(t, 0.0, self.duration))

    def advance(self, seconds: float) -> bool:
        """Let real seconds pass; return whether the time has changed."""
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
