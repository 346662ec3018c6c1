"""A scripted operator: a seeded hand that works a robot through a task by handle and pedal.

The hand moves by minimum jerk (Flash and Hogan, J. Neurosci. 5(7), 1985) towards what it sees is still missing,
trembles in the physiological band, and clutches when the handle leaves its comfortable range: pedal up, handle
back to the middle, pedal down. Speeds, pauses and tremor are ASSUMED: the paper gives its users' results, not how
their hands moved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.kinematics import Kinematics
from twin.simulation.control.teleoperation import Teleoperation
from twin.simulation.control.velocity import Limits, Solver, pose_error, step

INNER = 5
"""Ticks of the joint velocity loop for each tick of the teleoperation (1 kHz to 200 Hz, ASSUMED)."""

_STALLED = 12
"""Strokes and clutches without gain after which a hand gives up."""


@dataclass(frozen=True)
class Hand:
    """How the hand moves, SI; all ASSUMED.

    Attributes:
        reach: comfortable range of the handle about its middle: m, and rad for its turns.
        speed: mean speed of a stroke in m/s, and rad/s of a turn.
        pause: rest after a stroke in s, until what the tool does is seen.
        tremor: rms amplitude in m; tremor_band in Hz.
        misjudge: standard deviation of each stroke as a part of its length.
    """

    reach: tuple[float, float] = (0.05, 0.9)
    speed: tuple[float, float] = (0.06, 0.4)
    pause: float = 0.6
    tremor: float = 50e-6
    tremor_band: tuple[float, float] = (8.0, 12.0)
    misjudge: float = 0.03


@dataclass(frozen=True)
class Goal:
    """A pose to bring the tool to: name, T_base_tool (4, 4), how near it must come in m, and whether it inserts."""

    name: str
    T_base_tool: Array
    tolerance: float
    inserts: bool = False


@dataclass
class Record:
    """What happened, one row each tick of the teleoperation.

    Attributes:
        t: (k,) s. handle: (k, n). pedal: (k,) bool. q: (k, n). Ts_base_tool: (k, 4, 4).
        spans: first and last row of each goal, by name.
        missed: the goal that the hand gave up, and with it the trial; "" if none.
    """

    t: Array
    handle: Array
    pedal: np.ndarray
    q: Array
    Ts_base_tool: Array
    spans: dict[str, tuple[int, int]] = field(default_factory=dict)
    missed: str = ""


def minimum_jerk(s: Array) -> Array:
    """Return the part of the way (k,) at parts of the time s (k,) in [0, 1]: 10 s^3 - 15 s^4 + 6 s^5."""
    return s**3 * (10 - 15 * s + 6 * s**2)


def tremor(rng: np.random.Generator, hand: Hand, lines: int = 24) -> Callable[[float], Array]:
    """Return tremor (3,) in m as a function of time: sines of random phase in the band, of the hand's rms."""
    f = rng.uniform(*hand.tremor_band, (lines, 3))
    phase = rng.uniform(0, 2 * np.pi, (lines, 3))
    amplitude = hand.tremor * np.sqrt(2 / lines / 3)
    return lambda t: amplitude * np.sin(2 * np.pi * f * t + phase).sum(axis=0)


def operate(
    kin: Kinematics,
    q: Array,
    limits: Limits,
    controller: Teleoperation,
    goals: Sequence[Goal],
    seed: int = 0,
    hand: Hand | None = None,
    solver: Solver = "damped",
    progress: Callable[[str, float], None] | None = None,
) -> Record:
    """Return the record of one trial from joints q (n,), goal after goal.

    Raises:
        KinematicsError: a goal is no pose that the robot's coordinates describe.
    """
    hand = hand or Hand()
    rng = np.random.default_rng(seed)
    rig = _Rig(kin, np.asarray(q, float), limits, controller, solver, tremor(rng, hand))
    angular = np.array([u == "rad" for u in kin.formula.coordinates.units])
    scale = np.broadcast_to(np.asarray(controller.gains.scale, float), len(angular))
    reach = np.where(angular, hand.reach[1], hand.reach[0])
    spans, missed = {}, ""
    rig.hold(0.2, False)
    for i, goal in enumerate(goals):
        if progress is not None:
            progress(goal.name, i / len(goals))
        wanted, first = kin.program.coordinates_of_pose.one(goal.T_base_tool.ravel()), len(rig.rows)
        if np.linalg.norm(kin.program.pose_of_coordinates.one(wanted) - goal.T_base_tool) > 1e-6:
            raise KinematicsError(f"{kin.formula.name}: goal '{goal.name}' is not within the robot's freedoms")
        best, stalled = np.inf, 0
        while stalled < _STALLED:
            missing = (wanted - rig.coordinates) / scale
            left = float(np.linalg.norm(missing / reach))
            best, stalled = (left, 0) if left < 0.98 * best else (best, stalled + 1)
            near = np.abs(missing[angular]).max(initial=0.0) < 2e-3 / scale[angular].max(initial=1.0)
            if near and np.linalg.norm((missing * scale)[~angular]) < goal.tolerance:
                break
            room = np.where(missing > 0, reach - rig.handle, reach + rig.handle)
            part = float(np.min(np.where(np.abs(missing) > 1e-12, room / np.maximum(np.abs(missing), 1e-12), 1.0)))
            if part < 0.05:  # the handle is at the end of its range
                rig.move(np.zeros_like(rig.handle), 0.6, False)
                rig.hold(0.15, True)
                continue
            stroke = min(part, 1.0) * missing * (1 + hand.misjudge * rng.normal())
            way = float(np.linalg.norm(stroke[~angular])) / hand.speed[0]
            turn = float(np.abs(stroke[angular]).max(initial=0.0)) / hand.speed[1]
            rig.move(rig.handle + stroke, max(0.35, way, turn), True)
            rig.hold(hand.pause, True)
        else:
            missed = goal.name
        spans[goal.name] = (first, len(rig.rows) - 1)
        if missed:
            break
    if progress is not None:
        progress("measure", 1.0)
    t, handle, pedal, joints, poses = (np.array(c) for c in zip(*rig.rows, strict=True))
    return Record(t, handle, pedal, joints, poses, spans, missed)


class _Rig:
    """Handle, pedal, controller and robot, advanced tick by tick."""

    def __init__(
        self,
        kin: Kinematics,
        q: Array,
        limits: Limits,
        controller: Teleoperation,
        solver: Solver,
        shake: Callable[[float], Array],
    ) -> None:
        self.kin, self.q, self.limits, self.controller, self.shake = kin, q, limits, controller, shake
        self.solver: Solver = solver
        units = kin.formula.coordinates.units
        self.handle, self.linear = np.zeros(len(units)), np.flatnonzero([u == "m" for u in units])[:3]
        self.rows: list[tuple] = []
        self.T = kin.forward(q)

    @property
    def coordinates(self) -> Array:
        """Where the tool is, in the coordinates of the equations."""
        return self.kin.program.coordinates_of_pose.one(self.T.ravel())

    def move(self, to: Array, seconds: float, pedal: bool) -> None:
        """Move the handle by minimum jerk."""
        start, k = self.handle.copy(), max(1, round(seconds / self.controller.dt))
        for s in minimum_jerk(np.arange(1, k + 1) / k):
            self.handle = start + s * (to - start)
            self._tick(pedal)

    def hold(self, seconds: float, pedal: bool) -> None:
        """Keep the handle."""
        for _ in range(round(seconds / self.controller.dt)):
            self._tick(pedal)

    def _tick(self, pedal: bool) -> None:
        dt = self.controller.dt
        t = len(self.rows) * dt
        felt = self.handle.copy()
        felt[self.linear] += self.shake(t)[: len(self.linear)]
        x = self.coordinates
        u = self.controller.step(felt, x, pedal)
        if np.abs(u).max() > 0:
            for j in range(1, INNER + 1):
                T = self.kin.program.pose_of_coordinates.one(x + u * dt * j / INNER)
                self.q = step(self.kin, self.q, T, dt / INNER, self.limits, self.solver, seed=self.T).q
                self.T = self.kin.forward(self.q, self.T)
        self.rows.append((t, felt, pedal, self.q, self.T))


@dataclass(frozen=True)
class Measures:
    """The paper's measures of one trial.

    Attributes:
        time: s, from the first press to the end.
        presses: how often the pedal went from 0 to 1.
        path: m, length of the tip's way; tremor included.
        contacts: by insertion, whether the tip touched: within `contact` of its axis, and as near to its end.
        nearest: by insertion, how near the tip came to the end in m.
        aside: by insertion, how far the tip went from the axis in m.
    """

    time: float
    presses: int
    path: float
    contacts: dict[str, bool]
    nearest: dict[str, float]
    aside: dict[str, float]

    @property
    def success(self) -> bool:
        """Whether every insertion touched."""
        return bool(self.contacts) and all(self.contacts.values())


def measure(
    record: Record, goals: Sequence[Goal], T_tool_tip: Array, shaft: Array, contact: float = 0.5e-3
) -> Measures:
    """Return the measures of a record.

    Args:
        record: what happened.
        goals: what was asked for.
        T_tool_tip: (4, 4) the tip in the tool.
        shaft: (3,) unit vector along the shaft, out of the tip, in the frame of the tip.
        contact: m; ASSUMED: what a hole of 1 mm and a foil behind it would tell.
    """
    tip = (record.Ts_base_tool @ T_tool_tip)[:, :3, 3]
    pressed = np.flatnonzero(np.diff(np.concatenate([[False], record.pedal]).astype(int)) == 1)
    contacts, nearest, aside = {}, {}, {}
    for goal in goals:
        if not goal.inserts:
            continue
        if goal.name not in record.spans:
            contacts[goal.name] = False
            continue
        first, last = record.spans[goal.name]
        end = goal.T_base_tool @ T_tool_tip
        off = tip[first : last + 1] - end[:3, 3]
        axis = end[:3, :3] @ shaft
        along = off @ axis
        beside = np.linalg.norm(off - along[:, None] * axis, axis=1)
        contacts[goal.name] = bool(((beside <= contact) & (along >= -contact)).any())
        nearest[goal.name] = float(np.linalg.norm(off, axis=1).min())
        aside[goal.name] = float(beside.max())
    start = record.t[pressed[0]] if len(pressed) else record.t[0]
    path = float(np.linalg.norm(np.diff(tip, axis=0), axis=1).sum())
    return Measures(float(record.t[-1] - start), len(pressed), path, contacts, nearest, aside)


def remaining(record: Record, goals: Sequence[Goal]) -> Array:
    """Return the distance (k,) in m from the tool to the goal of its time."""
    out = np.full(len(record.t), np.nan)
    for goal in goals:
        first, last = record.spans.get(goal.name, (0, -1))
        for k in range(first, last + 1):
            out[k] = np.linalg.norm(pose_error(record.Ts_base_tool[k], goal.T_base_tool)[:3])
    return out
