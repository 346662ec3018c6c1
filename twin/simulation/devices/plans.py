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
from twin.simulation.controllers.planned import AIM, HELD, OFF, RUN
from twin.simulation.controllers.trainer import Phase
from twin.simulation.devices.machine_states import ANSWERS, LEVEL
from twin.simulation.machine.levels import Level
from twin.simulation.world import Block, Signals

_BEHIND = 0.5
"""Largest delay in s of a tip behind its plan: the tip is compared with the newest poses over this time."""

_DEVIATION = 3 * MM
"""Largest distance of a tip from its path in m; above it, the motion is stopped (ASSUMED)."""

_READY, _SETTLE = 1.5, 1.0
"""Largest times in s: until a machine is in PEDAL_DN; from the last pose until the tip has arrived (ASSUMED)."""

_SILENCE = 1.0
"""Maximum time in s for which the hands may be silent in a motion, as in a replay (ASSUMED)."""

_THERE = 0.2 * MM
"""Largest distance in m of a tip from the end of its path at which the tip has arrived."""


@dataclass(frozen=True)
class PlannedArm:
    """An arm that can follow a plan: its equations, and whether it is a machine with run levels."""

    kin: Kinematics
    machine: bool = False


class Plans(Block):
    """Writes `<robot>.planned` (17,) of all arms: a state of `controllers.planned`, and a pose in base row by row.

    Reads `<robot>.encoder`; for a machine, also the run levels in `<robot>.run` (machine) and `<robot>.model` (model).
    A machine's motion begins when machine and model are in PEDAL_DN. The clutch and silence of the hands end a motion.

    Attributes:
        robot: name of the arm whose motion is planned or executed; "": none.
        state: state of this arm, see `controllers.planned`.
        why: reason why the last motion was stopped; "" if it was not stopped.
        arrived: whether the last motion ended at the end of its path.
        off: largest distance in m between tip and path in the last motion.
    """

    def __init__(self, device: str, arms: Mapping[str, PlannedArm]) -> None:
        """Connect to `arms`, {name of a place: its arm}, and to `device`, the name of the device of the pedals."""
        self._arms, self._silent, self._heard = dict(arms), f"{device}.silent", 0.0
        self.robot, self.state, self.why, self.arrived, self.off = "", OFF, "", False, 0.0
        self._Ts, self._k, self._since = np.zeros((0, 4, 4)), 0, 0.0
        self.outputs = {f"{n}.planned": _values(OFF) for n in arms}
        self._new: dict[str, Array] = {}

    @property
    def fraction(self) -> float:
        """Fraction of the poses that have been written, 0 to 1."""
        return self._k / len(self._Ts) if len(self._Ts) else 0.0

    def aim(self, robot: str) -> None:
        """From the next tick on, the hand moves the target of an arm, and all arms are at rest.

        Raises:
            WorldError: the console has no such arm.
        """
        if robot not in self._arms:
            raise WorldError(unknown("arm", robot, self._arms))
        self._set(robot, AIM)
        self.why, self.arrived = "", False

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
        finite = np.isfinite(Ts.reshape(len(Ts), -1)).all(axis=1)
        if not finite.all():
            raise WorldError(f"the motion of {self.robot}: pose {int(np.argmin(finite))} of {len(Ts)} is not finite")
        self._Ts, self._k, self._since, self.off = Ts, 0, np.nan, 0.0
        self._set(self.robot, RUN)
        self._new[f"{self.robot}.planned"] = _values(RUN, Ts[0])

    def stop(self, why: str = "") -> None:
        """End planning or motion: the arm stays where it is, and the hands move all arms again."""
        self.why = why
        self._set("", OFF)

    def _set(self, robot: str, state: float) -> None:
        self.robot, self.state = robot, state
        resting = HELD if state else OFF
        self._new = {f"{n}.planned": _values(state if n == robot else resting) for n in self._arms}

    def step(self, signals: Signals, t: float, dt: float) -> Mapping[str, Array]:
        """Write the states and, while an arm moves, the next pose."""
        if self.state == RUN:
            self._follow(signals, t, dt)
        new, self._new = self._new, {}
        return new

    def _follow(self, signals: Signals, t: float, dt: float) -> None:
        """Write the next pose, or end the motion."""
        robot, arm = self.robot, self._arms[self.robot]
        if np.isnan(self._since):
            self._since = self._heard = t
        silent = signals[self._silent][0] > 0.5
        self._heard = self._heard if silent else t
        if t - self._heard > _SILENCE:
            return self.stop(
                f"The motion of {robot} was stopped: no state of the hands was received for {_SILENCE:g} s; plan again"
            )
        if not silent and signals["console.mode"][0] == FREE:
            return self.stop(f"The motion of {robot} was stopped by the clutch; plan again")
        if arm.machine and not self._is_down(signals, t):
            return
        at, k = arm.kin.forward(signals[f"{robot}.encoder"])[:3, 3], min(self._k, len(self._Ts) - 1)
        path = self._Ts[max(0, k - round(_BEHIND / dt)) : k + 1, :3, 3]
        off = float(np.sqrt(((path - at) ** 2).sum(axis=1).min()))
        self.off = max(self.off, off)
        if off > _DEVIATION:
            return self.stop(
                f"The motion was stopped: the tip of {robot} was {off / MM:.1f} mm from its path "
                f"(limit {_DEVIATION / MM:g} mm); find the cause before the next motion"
            )
        if self._k == len(self._Ts):
            left = float(np.linalg.norm(self._Ts[-1, :3, 3] - at))
            if left <= _THERE:
                self.stop()
                self.arrived = True
            elif t - self._since > _SETTLE:
                self.stop(
                    f"{robot} did not arrive: {_SETTLE:g} s after the last pose, its tip is {left / MM:.2f} mm from "
                    f"the end of its path (limit {_THERE / MM:g} mm); find the cause before the next motion"
                )
            return None
        self._new[f"{robot}.planned"] = _values(RUN, self._Ts[self._k])
        self._k += 1
        self._since = t
        return None

    def _is_down(self, signals: Signals, t: float) -> bool:
        """Return whether machine and model are in PEDAL_DN; end the motion if they leave it or reach it too late.

        In a rehearsal of the trainer, only the model counts.
        """
        name = self.robot
        run, level = signals[f"{name}.run"], signals[f"{name}.model"][0]
        uses_machine = signals[f"{name}.phase"][0] != Phase.REHEARSE
        silent = uses_machine and run[ANSWERS] < 0.5
        if silent:
            level = Level.E_STOP
        elif uses_machine:
            level = min(level, run[LEVEL])
        if level >= Level.PEDAL_DN:
            return True
        began = self._k > 0
        if level < Level.PEDAL_UP or began or t - self._since > _READY:
            ended = "was stopped" if began else "did not begin"
            if silent:
                now = f"{name} does not answer; wait until it does"
            else:
                level_name = Level(int(level)).name
                now = f"{name} is in {level_name}, not in PEDAL_DN; press its start button, wait for PEDAL_UP"
            self.stop(f"The motion {ended}: {now}, and plan again")
        return False


def _values(state: float, T: Array | None = None) -> Array:
    return np.concatenate([[state], (np.eye(4) if T is None else T).ravel()])
