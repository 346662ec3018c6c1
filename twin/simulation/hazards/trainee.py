"""A simulated trainee, who reacts to a force or to a stop of the arm after a reaction time, in a fixed order of steps.

The responses are those of Table 1 and section 3.2.1 of "Surgeon Training in Telerobotic Surgery via a
Hardware-in-the-Loop Simulator". If there is a force on the hand, the trainee slows down; if the force remains, the
trainee releases the pedal. If the arm does not follow, the trainee releases the pedal. Then the trainee troubleshoots,
restarts the system, and presses the pedal again. If the arm fails a second time, or does not restart, the trainee
converts the procedure (continues without the robot). At the end, the trainee reports. This order is ASSUMED; the
reaction times are those of the campaign file.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from twin.simulation.machine.levels import Level

Response = Literal["slow down", "release pedal", "troubleshoot", "restart", "convert", "report"]

_SLOW = 0.25
"""Speed after slowing down, as a fraction of the normal speed. ASSUMED."""

_HOMING = 3.0
"""Maximum time in s that the trainee waits for the arm after a restart. ASSUMED."""

_WATCH = 0.5
"""Time in s without a new event after which the trainee ends the session. ASSUMED."""

_LATENCY = 0.1
"""Time in s after pressing the pedal in which the trainee does not expect the arm to follow. ASSUMED."""


@dataclass(frozen=True)
class Reaction:
    """Reaction times of one trainee in s: to a force; to a visible stop of the arm; for finding the error."""

    haptic: float
    visual: float
    troubleshoot: float


class HazardTrainee:
    """Reacts to the force and the run level of the machine, tick by tick.

    Attributes:
        pace, pedal: relative speed of the hand, and whether the pedal is down; see `Hand.packet`.
        restarts: whether the trainee presses the stop and start buttons in this tick.
        done: whether the session is over.
        noticed: time in s of the first force or stop that the trainee can notice; None: there was none.
        responses: time in s of the first response of each kind; the keys are the kinds.
    """

    def __init__(self, reaction: Reaction) -> None:
        self._times = reaction
        self.pace = 1.0
        self.pedal = True
        self.restarts = False
        self.done = False
        self.noticed: float | None = None
        self.responses: dict[Response, float] = {}
        # time in s of the next response, and the response
        self._next: tuple[float, Response | Literal["decide"]] | None = None
        self._waits: float | None = None  # time in s of the restart after which the trainee waits for the arm
        self._works = 0.0  # time in s from which the trainee expects the arm to follow
        self._quiet = float("inf")  # time in s at which the session ends if nothing happens

    def step(self, t: float, felt: bool, level: Level) -> None:
        """React at t in s; `felt`: whether there is a force on the hand, `level`: run level that the machine shows."""
        self.restarts = False
        wrong = felt or level != Level.PEDAL_DN
        if self._next is not None:
            due, response = self._next
            if t >= due:
                self._next = None
                self._act(t, response, wrong)
        elif self._waits is not None:
            self._await(t, level, self._waits)
        elif t >= self._works and wrong:
            if self.noticed is None:
                self.noticed = t
            if felt:
                self._next = t + self._times.haptic, "slow down"
            else:
                self._next = t + self._times.visual, "release pedal"
        elif t > self._quiet:
            self._end(t)

    def _act(self, t: float, response: Response | Literal["decide"], wrong: bool) -> None:
        """Perform a response at t in s; `wrong`: whether there is a force, or the arm does not follow."""
        if response == "decide":
            if wrong:
                self._act(t, "release pedal", wrong)
            else:
                self._go_on(t)
            return
        # found out before the response is stored
        repeated = response in self.responses
        self.responses.setdefault(response, t)
        if response == "slow down":
            self.pace = _SLOW
            self._next = t + self._times.haptic, "decide"
        elif response == "release pedal":
            self.pedal = False
            self._next = t + self._times.troubleshoot, "troubleshoot"
        elif response == "troubleshoot":
            self._act(t, "convert" if repeated else "restart", wrong)
        elif response == "restart":
            self.restarts = True
            self._waits = t
        else:
            self._end(t)

    def _await(self, t: float, level: Level, restarted: float) -> None:
        """Wait for the arm after the restart at `restarted` in s; convert if it stops or takes too long."""
        longest = self._times.visual if level == Level.E_STOP else _HOMING
        if level == Level.PEDAL_UP:
            self._go_on(t)
        elif t - restarted > longest:
            self._act(t, "convert", True)

    def _go_on(self, t: float) -> None:
        self.pace = 1.0
        self.pedal = True
        self._waits = None
        self._works = t + _LATENCY
        self._quiet = t + _WATCH

    def _end(self, t: float) -> None:
        self.done = True
        self.responses.setdefault("report", t)
