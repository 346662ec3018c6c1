"""The protocols of a robot, one of them planned for playback, and the clock of a playback, for viewer and headset."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.core.errors import TwinError
from twin.core.jobs import Call
from twin.core.spatial import Array

if TYPE_CHECKING:
    from twin.api import Robot

TICK_RATE = 60.0
"""Samples per second of a playback, and ticks per second of streams, recordings and replays."""

PLAYBACK_SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Available playback speeds, relative to real time; `web/src/sheet.ts` of the headset's page has the same."""

_SAME_TIME = 1e-9
"""Time in s from the end of a motion below which a sample is the end itself, but for rounding."""


@dataclass(frozen=True)
class Playback:
    """A planned protocol, solved with the mechanism at `TICK_RATE` samples per second.

    Configurations, joint values and tool poses are interpolated between the samples of the plan. Speeds, accelerations,
    tip, shaft, RCM and depth are those of the plan's next sample.

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
        for name, _, end in self.phases:
            if t <= end:
                return name
        return self.phases[-1][0]


def protocols_of(robot: Robot, given: str | None) -> dict[str, str]:
    """Return the argument of `Robot.protocol` for each protocol of the robot and for `given`, by protocol name.

    Args:
        robot: the robot.
        given: name, FOLDER/NAME or path of a further protocol; None: no further protocol.

    Raises:
        TwinError: the given protocol does not exist, is invalid, or has the name of another protocol of the robot.
    """
    files = {} if robot.files is None else robot.files.protocols()
    protocols = {name: name for name in files}
    if given is None:
        return protocols
    name = robot.protocol(given).name
    # the same file under another spelling is the same protocol, not a second one
    if name in files and given != name and Path(given).resolve() != files[name].resolve():
        raise TwinError(f"{given}: the robot already has a protocol named '{name}': rename the protocol in this file")
    protocols[name] = given
    return protocols


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
    t = _sample_times(trajectory.duration)
    model = loaded.bound(chosen).reference()
    next_sample = np.searchsorted(trajectory.t, t)
    # of what is not interpolated, the plan's next sample counts; the end of the motion is the last one
    sample = np.clip(next_sample, 0, len(trajectory.t) - 1)
    frames = trajectory.Ts_base_frame[sample]
    axis = trajectory.shaft_axis / np.linalg.norm(trajectory.shaft_axis)
    return Playback(
        protocol=chosen.name,
        title=chosen.title,
        t=t,
        x=trajectory.on(model, t).x,
        q=trajectory.joints(t),
        qd=trajectory.qd[sample],
        qdd=trajectory.qdd[sample],
        Ts_base_tool=trajectory.poses(t),
        tip=frames[:, :3, 3],
        shaft=frames[:, :3, :3] @ axis,
        rcm=trajectory.rcm[sample],
        rcm_error=trajectory.rcm_error[sample],
        depth=trajectory.depth[sample],
        phases=tuple((phase.name, phase.t0, phase.t1) for phase in trajectory.phases),
    )


def _sample_times(duration: float) -> Array:
    """Return the times (k,) in s of a playback: multiples of 1 / `TICK_RATE`, and the end of the motion."""
    times = np.arange(0.0, duration, 1 / TICK_RATE)
    return np.append(times[times < duration - _SAME_TIME], duration)


class Planner:
    """Planning of a protocol in a separate process; `answer` is the playback or an error text once `done` is True.

    Attributes:
        protocol: name or path of the protocol; None: the robot's default protocol.
    """

    def __init__(self, robot: str, protocol: str | None) -> None:
        self.protocol = protocol
        self._call = Call(prepare, robot, protocol, nice=5)

    @property
    def done(self) -> bool:
        """Whether planning has ended."""
        return self._call.done

    @property
    def answer(self) -> Playback | str | None:
        """The playback or the error text; None while the protocol is being planned."""
        if not self._call.done:
            return None
        try:
            return self._call.result()
        except TwinError as error:
            return str(error)

    def close(self) -> None:
        """End the process that plans the protocol."""
        self._call.close()


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
        self.duration = 0.0
        self.time = 0.0
        self.speed = 1.0
        self.loop = True
        self.playing = False

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
            self.time = self.duration
            self.playing = False
        return True
