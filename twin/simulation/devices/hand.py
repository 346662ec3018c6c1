"""A simulated operator, with a random seed, who performs a task with a handle and a clutch pedal.

The hand moves with minimum jerk (Flash and Hogan, J. Neurosci. 5(7), 1985) to reduce the remaining error, and has
tremor in the physiological frequency band. When the handle leaves its comfortable range, the operator uses the clutch:
pedal up, handle back to the middle, pedal down. Speeds, pauses and tremor are ASSUMED: the paper publishes results of
its users, but no hand motions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import KinematicsError
from twin.core.progress import Progress
from twin.core.spatial import Array, near_coordinates
from twin.kinematics import Kinematics
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import HAND_GOAL, HAND_HANDLE, HAND_PEDAL, ROBOT_Q

_LARGEST_STALLS = 12
"""Number of strokes (single hand motions) without progress after which the operator gives up."""

_PROGRESS = 0.98
"""Largest ratio of the remaining motion to the least one before that counts as progress; less may be tremor only."""

_LEAST_STROKE = 0.05
"""Share of a stroke within the range of the handle below which the handle is moved back with the pedal up; ASSUMED."""

_MOVE_BACK = 0.6
"""Time in s in which the handle is moved back to its middle; ASSUMED."""

_PRESS_PAUSE = 0.15
"""Time in s between the press of the pedal after that and the next stroke; ASSUMED."""

_SHORTEST_STROKE = 0.35
"""Shortest duration of a stroke in s; ASSUMED."""

_GOAL_ANGLE = 2e-3
"""Largest angle in rad of the tool from a goal at which the goal is reached; ASSUMED."""

_BLOCK_SIZE = 256
"""Number of tremor outputs in a block; a block is computed ten times as fast as the same outputs one by one."""

_SINE_COUNT = 24
"""Number of sines of a tremor."""


@dataclass(frozen=True)
class HandMotion:
    """Parameters of the hand motion, SI; all ASSUMED.

    Attributes:
        reach: comfortable range of the handle on either side of its middle, in m and rad.
        speed: mean speed of a stroke, in m/s and rad/s.
        pause: time in s after a stroke until the operator sees the tool's motion.
        tremor: rms amplitude in m.
        tremor_band: frequency band of the tremor in Hz.
        misjudge: standard deviation of the error of a stroke, as a fraction of the stroke's length.
    """

    reach: tuple[float, float] = (0.05, 0.9)
    speed: tuple[float, float] = (0.06, 0.4)
    pause: float = 0.6
    tremor: float = 50e-6
    tremor_band: tuple[float, float] = (8.0, 12.0)
    misjudge: float = 0.03


@dataclass(frozen=True)
class Goal:
    """A goal of the tool: name, pose T_base_tool (4, 4), tolerance in m, and whether the goal ends an insertion."""

    name: str
    T_base_tool: Array
    tolerance: float
    inserts: bool = False


def minimum_jerk(s: Array) -> Array:
    """Return the fraction of the path (k,) at fractions s (k,) of the time in [0, 1]: 10 s^3 - 15 s^4 + 6 s^5."""
    return s**3 * (10 - 15 * s + 6 * s**2)


class Tremor:
    """Tremor in m: sum of sines with random phases, in the frequency band of the hand."""

    def __init__(self, rng: np.random.Generator, hand: HandMotion, period: float) -> None:
        """Draw frequencies and phases; `period` is the time in s between two outputs."""
        self._angular_rates = 2 * np.pi * rng.uniform(*hand.tremor_band, (_SINE_COUNT, 3))
        self._phases = rng.uniform(0, 2 * np.pi, (_SINE_COUNT, 3))
        self._amplitude = hand.tremor * np.sqrt(2 / _SINE_COUNT / 3)
        self._period = period
        self._block_start = -_BLOCK_SIZE
        self._block = np.zeros((_BLOCK_SIZE, 3))

    def at(self, t: Array) -> Array:
        """Return the displacements (k, 3) in m at times (k,) in s."""
        return self._amplitude * np.sin(self._angular_rates * t[:, None, None] + self._phases).sum(axis=1)

    def output(self, k: int) -> Array:
        """Return the displacement (3,) in m at k periods after the start; displacements are computed in blocks."""
        is_in_block = 0 <= k - self._block_start < _BLOCK_SIZE  # false for the first output, by the start value
        if not is_in_block:
            self._block_start = k
            self._block = self.at(np.arange(k, k + _BLOCK_SIZE, dtype=float) * self._period)
        return self._block[k - self._block_start]


class ScriptedHand(Block):
    """Writes `hand.handle` (n,) with tremor, `hand.pedal` (0 or 1), and `hand.goal` (index of the goal; -1 at first).

    The operator sees the tool pose (from `<robot>.q`) only between two strokes (single hand motions). The device ends
    when the last goal is reached, or when the operator gives up a goal.

    Attributes:
        missed: name of the goal that the operator gave up; "" if there is none.
    """

    def __init__(
        self,
        robot: str,
        kin: Kinematics,
        goals: Sequence[Goal],
        scale: ArrayLike,
        period: float,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> None:
        """Connect to a robot.

        Args:
            robot: name of the robot in the World.
            kin: the robot's equations; the handle moves in their coordinates.
            goals: the goals, in order.
            scale: tool motion divided by handle motion, as assumed by the operator; (n,) or one number.
            period: time in s between two outputs.
            seed: seed of tremor and errors.
            progress: called with the name of each goal and the fraction of goals done.

        Raises:
            KinematicsError: a goal pose cannot be expressed in the robot's coordinates.
        """
        self.robot = robot
        self.kin = kin
        self.goals = goals
        self.period = period
        self.hand = HandMotion()
        self._rng = np.random.default_rng(seed)
        self._tremor = Tremor(self._rng, self.hand, period)
        self._progress = progress or (lambda name, part: None)
        units = kin.formula.coordinates.units
        self._is_angle = np.array([unit == "rad" for unit in units])
        self._length_axes = np.flatnonzero([unit == "m" for unit in units])
        self._scale = np.broadcast_to(np.asarray(scale, float), len(units))
        self._goal_coordinates = [self._coordinates(goal) for goal in goals]
        self._handle = np.zeros(len(units))
        self._goal = -1
        self._output_count = 0
        self._T_base_tool: Array | None = None
        self.missed = ""
        self._pedal_states = self._work()
        self.outputs = {HAND_HANDLE.name: self._handle, HAND_PEDAL.name: 0.0, HAND_GOAL.name: -1.0}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, ArrayLike] | None:
        """Return the signals of this tick; None after the last goal."""
        self._signals = signals
        pedal = next(self._pedal_states, None)
        if pedal is None:
            return None
        handle = self._handle.copy()
        axes = self._length_axes[:3]  # only translations tremble
        handle[axes] += self._tremor.output(self._output_count)[: len(axes)]
        self._output_count += 1
        return {HAND_HANDLE.name: handle, HAND_PEDAL.name: float(pedal), HAND_GOAL.name: float(self._goal)}

    def _coordinates(self, goal: Goal) -> Array:
        program = self.kin.program
        coordinates = program.coordinates_of_pose.one(goal.T_base_tool.ravel())
        expressed = program.pose_of_coordinates.one(coordinates)
        # fewer coordinates than six cannot express every pose
        if np.linalg.norm(expressed - goal.T_base_tool) > 1e-6:
            raise KinematicsError(f"{self.kin.formula.name}: the robot's coordinates cannot express goal '{goal.name}'")
        return coordinates

    def _tool_coordinates(self) -> Array:
        self._T_base_tool = self.kin.forward(self._signals[ROBOT_Q.of(self.robot)], self._T_base_tool)
        return self.kin.program.coordinates_of_pose.one(self._T_base_tool.ravel())

    def _missing(self, goal: Array) -> Array:
        """Return the motion (n,) of the handle that brings the tool to coordinates (n,), by the shorter turns."""
        difference = goal - self._tool_coordinates()
        return near_coordinates(difference, 0.0, self._is_angle) / self._scale

    def _work(self) -> Iterator[bool]:
        """Do the task; yield the state of the pedal once per period."""
        reach = np.where(self._is_angle, self.hand.reach[1], self.hand.reach[0])
        yield from self._hold(0.2, False)
        for i, goal in enumerate(self.goals):
            self._progress(goal.name, i / len(self.goals))
            self._goal = i
            least_remaining = np.inf
            stalled = 0
            while stalled < _LARGEST_STALLS:
                # the tool is measured anew before each stroke, as an operator looks again
                missing = self._missing(self._goal_coordinates[i])
                remaining = float(np.linalg.norm(missing / reach))
                if remaining < _PROGRESS * least_remaining:
                    least_remaining = remaining
                    stalled = 0
                else:
                    stalled += 1
                if self._is_reached(goal, missing):
                    break
                yield from self._approach(missing, reach)
            else:
                self.missed = goal.name
                return

    def _is_reached(self, goal: Goal, missing: Array) -> bool:
        """Return whether the tool is at a goal; `missing` (n,): remaining motion of the handle."""
        is_angle = self._is_angle
        angle = np.abs(missing[is_angle]).max(initial=0.0)
        distance = np.linalg.norm((missing * self._scale)[~is_angle])
        return bool(angle < _GOAL_ANGLE / self._scale[is_angle].max(initial=1.0) and distance < goal.tolerance)

    def _approach(self, missing: Array, reach: Array) -> Iterator[bool]:
        """Make one stroke to reduce the remaining motion (n,) of the handle, or move the handle back to its middle."""
        is_angle = self._is_angle
        hand = self.hand
        space = np.where(missing > 0, reach - self._handle, reach + self._handle)
        lengths = np.abs(missing)
        possible_share = np.where(lengths > 1e-12, space / np.maximum(lengths, 1e-12), 1.0).min()
        # From its middle, the handle makes a stroke also if this is a small share of a long way.
        if possible_share < _LEAST_STROKE and self._handle.any():  # the handle is at the end of its range
            yield from self._move(np.zeros_like(self._handle), _MOVE_BACK, False)
            yield from self._hold(_PRESS_PAUSE, True)
            return
        stroke = min(possible_share, 1.0) * missing * (1 + hand.misjudge * self._rng.normal())
        # the slower of translation and rotation determines the time
        linear_time = float(np.linalg.norm(stroke[~is_angle])) / hand.speed[0]
        angular_time = float(np.abs(stroke[is_angle]).max(initial=0.0)) / hand.speed[1]
        yield from self._move(self._handle + stroke, max(_SHORTEST_STROKE, linear_time, angular_time), True)
        yield from self._hold(hand.pause, True)

    def _move(self, to: Array, seconds: float, pedal: bool) -> Iterator[bool]:
        """Move the handle with minimum jerk to `to` (n,) in `seconds`; yield `pedal` once per period."""
        start = self._handle.copy()
        k = max(1, round(seconds / self.period))
        for s in minimum_jerk(np.arange(1, k + 1) / k):
            self._handle = start + s * (to - start)
            yield pedal

    def _hold(self, seconds: float, pedal: bool) -> Iterator[bool]:
        """Hold the handle at rest for `seconds`; yield `pedal` once per period."""
        for _ in range(round(seconds / self.period)):
            yield pedal
