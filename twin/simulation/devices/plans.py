"""Planned motions of the arms of a console, as an input of the World: states of the arms, and poses to follow.

A plan is made outside of the World. The World receives states and poses tick by tick, so that a recorded session is
replayed without planning again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.core.errors import WorldError, unknown
from twin.core.spatial import Array
from twin.core.units import MM
from twin.kinematics import Kinematics
from twin.simulation.controllers.pedals import FREE
from twin.simulation.controllers.plan_states import AIM, HELD, OFF, RUN
from twin.simulation.controllers.trainer_states import TrainerPhase
from twin.simulation.devices.machine_states import ANSWERS, LEVEL
from twin.simulation.machine.levels import Level
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import (
    CONSOLE_MODE,
    DEVICE_SILENT,
    ROBOT_ENCODER,
    ROBOT_MODEL,
    ROBOT_PHASE,
    ROBOT_PLANNED,
    ROBOT_RUN,
)

_LONGEST_DELAY = 0.5
"""Largest delay in s of a tip behind its plan: the tip is compared with the newest poses over this time."""

_LARGEST_DEVIATION = 3 * MM
"""Largest distance of a tip from its path in m; above it, the motion is stopped (ASSUMED)."""

_LONGEST_START = 1.5
"""Largest time in s until a machine is in PEDAL_DN (ASSUMED)."""

_LONGEST_ARRIVAL = 1.0
"""Largest time in s from the last pose until the tip has arrived (ASSUMED)."""

_LONGEST_SILENCE = 1.0
"""Maximum time in s for which the hands may be silent in a motion, as in a replay (ASSUMED)."""

_ARRIVAL_DISTANCE = 0.2 * MM
"""Largest distance in m of a tip from the end of its path at which the tip has arrived."""


@dataclass(frozen=True)
class PlannedArm:
    """An arm that can follow a plan: its equations, and whether it is a machine with run levels."""

    kin: Kinematics
    machine: bool = False


class Plans(Block):
    """Writes `<robot>.planned` (17,) of all arms: a state of `controllers.plan_states`, and a pose in base row by row.

    Reads `<robot>.encoder`; for a machine, also the run levels in `<robot>.run` (machine) and `<robot>.model` (model).
    A machine's motion begins when machine and model are in PEDAL_DN. The clutch and silence of the hands end a motion.

    Attributes:
        robot: name of the arm whose motion is planned or executed; "": none.
        state: state of this arm, see `controllers.plan_states`.
        why: reason why the last motion was stopped; "" if it was not stopped.
        arrived: whether the last motion ended at the end of its path.
        off: largest distance in m between tip and path in the last motion.
    """

    def __init__(self, device: str, arms: Mapping[str, PlannedArm]) -> None:
        """Connect to `arms`, {name of a place: its arm}, and to `device`, the name of the device of the pedals."""
        self._arms = dict(arms)
        self._silent_signal = DEVICE_SILENT.of(device)
        self._last_heard = 0.0  # time at which the hands were heard last, in a motion
        self.robot = ""
        self.state = OFF
        self.why = ""
        self.arrived = False
        self.off = 0.0
        self._poses = np.zeros((0, 4, 4))
        self._next_pose = 0
        self._last_pose_time = 0.0  # time of the last pose
        self.outputs = {ROBOT_PLANNED.of(robot): _values(OFF) for robot in arms}
        self._new_values: dict[str, Array] = {}

    @property
    def fraction(self) -> float:
        """Fraction of the poses that have been written, 0 to 1."""
        return self._next_pose / len(self._poses) if len(self._poses) else 0.0

    def aim(self, robot: str) -> None:
        """From the next tick on, the hand moves the target of an arm, and all arms are at rest.

        Raises:
            WorldError: the console has no such arm.
        """
        if robot not in self._arms:
            raise WorldError(unknown("arm", robot, self._arms))
        self._set(robot, AIM)
        self.why = ""
        self.arrived = False

    def hold(self) -> None:
        """Keep all arms at rest; the target no longer follows the hand."""
        self._set(self.robot, HELD)

    def run(self, Ts: Array) -> None:
        """Let the arm chosen by `aim` follow tool poses (k, 4, 4) in base, one per tick; other arms do not move.

        Raises:
            WorldError: there is no arm, there are no poses, or a pose is not finite.
        """
        Ts = np.asarray(Ts, float)
        if not self.robot:
            raise WorldError(f"there is no arm for a motion of {len(Ts)} poses: call `aim` first")
        if not len(Ts):
            raise WorldError(f"the motion of {self.robot} has 0 poses; give at least 1")
        is_finite = np.isfinite(Ts.reshape(len(Ts), -1)).all(axis=1)
        if not is_finite.all():
            raise WorldError(f"the motion of {self.robot}: pose {int(np.argmin(is_finite))} of {len(Ts)} is not finite")
        self._poses = Ts
        self._next_pose = 0
        self._last_pose_time = np.nan  # the first tick of the motion sets the time
        self.off = 0.0
        self._set(self.robot, RUN)
        self._new_values[ROBOT_PLANNED.of(self.robot)] = _values(RUN, Ts[0])

    def stop(self, why: str = "") -> None:
        """End planning or motion: the arm stays where it is, and the hands move all arms again."""
        self.why = why
        self._set("", OFF)

    def _set(self, robot: str, state: float) -> None:
        self.robot = robot
        self.state = state
        resting = HELD if state != OFF else OFF
        self._new_values = {}
        for name in self._arms:
            state_of_arm = state if name == robot else resting
            self._new_values[ROBOT_PLANNED.of(name)] = _values(state_of_arm)

    def step(self, signals: Signals, t: float, dt: float) -> Mapping[str, Array]:
        """Write the states and, while an arm moves, the next pose."""
        if self.state == RUN:
            self._follow(signals, t, dt)
        new = self._new_values
        self._new_values = {}
        return new

    def _follow(self, signals: Signals, t: float, dt: float) -> None:
        """Write the next pose, or end the motion."""
        robot = self.robot
        arm = self._arms[robot]
        if np.isnan(self._last_pose_time):
            self._last_pose_time = t
            self._last_heard = t
        is_silent = signals[self._silent_signal][0] > 0.5
        if not is_silent:
            self._last_heard = t
        if t - self._last_heard > _LONGEST_SILENCE:
            silence = f"no state of the hands was received for {_LONGEST_SILENCE:g} s"
            return self.stop(f"The motion of {robot} was stopped: {silence}; plan again")
        if not is_silent and signals[CONSOLE_MODE.name][0] == FREE:
            return self.stop(f"The motion of {robot} was stopped by the clutch; plan again")
        if arm.machine and not self._is_down(signals, t):
            return
        tip = arm.kin.forward(signals[ROBOT_ENCODER.of(robot)])[:3, 3]
        newest = min(self._next_pose, len(self._poses) - 1)
        # the tip follows its goal with a delay, so that it is near one of the latest poses, not at the newest one
        oldest = max(0, newest - round(_LONGEST_DELAY / dt))
        path = self._poses[oldest : newest + 1, :3, 3]
        deviation = float(np.sqrt(((path - tip) ** 2).sum(axis=1).min()))
        self.off = max(self.off, deviation)
        if deviation > _LARGEST_DEVIATION:
            return self.stop(
                f"The motion was stopped: the tip of {robot} was {deviation / MM:.1f} mm from its path "
                f"(limit {_LARGEST_DEVIATION / MM:g} mm); find the cause before the next motion"
            )
        if self._next_pose == len(self._poses):
            return self._settle(tip, t)
        self._new_values[ROBOT_PLANNED.of(robot)] = _values(RUN, self._poses[self._next_pose])
        self._next_pose += 1
        self._last_pose_time = t
        return None

    def _settle(self, tip: Array, t: float) -> None:
        """End the motion after its last pose, when the tip (3,) in base has arrived or is too late."""
        distance = float(np.linalg.norm(self._poses[-1, :3, 3] - tip))
        if distance <= _ARRIVAL_DISTANCE:
            self.stop()
            self.arrived = True
        elif t - self._last_pose_time > _LONGEST_ARRIVAL:
            limit = f"limit {_ARRIVAL_DISTANCE / MM:g} mm"
            self.stop(
                f"{self.robot} did not arrive: {_LONGEST_ARRIVAL:g} s after the last pose, its tip is "
                f"{distance / MM:.2f} mm from the end of its path ({limit}); find the cause before the next motion"
            )

    def _is_down(self, signals: Signals, t: float) -> bool:
        """Return whether machine and model are in PEDAL_DN; end the motion if they leave it or reach it too late.

        In a rehearsal of the trainer, only the model counts.
        """
        name = self.robot
        run = signals[ROBOT_RUN.of(name)]
        level = signals[ROBOT_MODEL.of(name)][0]
        uses_machine = signals[ROBOT_PHASE.of(name)][0] != TrainerPhase.REHEARSE
        is_silent = uses_machine and run[ANSWERS] < 0.5
        if is_silent:
            level = Level.E_STOP
        elif uses_machine:
            level = min(level, run[LEVEL])
        if level >= Level.PEDAL_DN:
            return True
        has_begun = self._next_pose > 0
        if level < Level.PEDAL_UP or has_begun or t - self._last_pose_time > _LONGEST_START:
            ended = "was stopped" if has_begun else "did not begin"
            if is_silent:
                reason = f"{name} does not answer; wait until it does"
            else:
                level_name = Level(int(level)).name
                reason = f"{name} is in {level_name}, not in PEDAL_DN; press its start button, wait for PEDAL_UP"
            self.stop(f"The motion {ended}: {reason}, and plan again")
        return False


def _values(state: float, T: Array | None = None) -> Array:
    """Return the values (17,) of `<robot>.planned`: a state, and the pose T (4, 4); None: the identity."""
    pose = np.eye(4) if T is None else T
    return np.concatenate([[state], pose.ravel()])
