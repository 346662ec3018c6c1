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

_SLOW_PACE = 0.25
"""Speed after slowing down, as a fraction of the normal speed. ASSUMED."""

_LONGEST_HOMING = 3.0
"""Maximum time in s that the trainee waits for the arm after a restart. ASSUMED."""

_QUIET_TIME = 0.5
"""Time in s without a new event after which the trainee ends the session. ASSUMED."""

_PEDAL_LATENCY = 0.1
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
        self._reaction = reaction
        self.pace = 1.0
        self.pedal = True
        self.restarts = False
        self.done = False
        self.noticed: float | None = None
        self.responses: dict[Response, float] = {}
        # time in s of the next response, and the response; None: the trainee watches
        self._next_response: tuple[float, Response | Literal["decide"]] | None = None
        # times in s
        self._restart_time: float | None = None  # of the restart after which the trainee waits for the arm
        self._follows_from = 0.0  # from which the trainee expects the arm to follow
        self._quiet_end = float("inf")  # at which the session ends if nothing happens

    def step(self, t: float, felt: bool, level: Level) -> None:
        """React at t in s; `felt`: whether there is a force on the hand, `level`: run level that the machine shows.

        In each tick, the first of these applies: a planned response becomes due; the trainee waits for a restarted arm;
        there is a force or the arm does not follow, so that a response is planned; nothing has happened for long.
        """
        self.restarts = False
        is_wrong = felt or level != Level.PEDAL_DN
        if self._next_response is not None:
            due, response = self._next_response
            if t >= due:
                self._next_response = None
                self._act(t, response, is_wrong)
        elif self._restart_time is not None:
            self._await(t, level, self._restart_time)
        elif t >= self._follows_from and is_wrong:
            if self.noticed is None:
                self.noticed = t
            if felt:
                self._next_response = t + self._reaction.haptic, "slow down"
            else:
                self._next_response = t + self._reaction.visual, "release pedal"
        elif t > self._quiet_end:
            self._end(t)

    def _act(self, t: float, response: Response | Literal["decide"], is_wrong: bool) -> None:
        """Perform a response at t in s; `is_wrong`: whether there is a force, or the arm does not follow."""
        if response == "decide":
            if is_wrong:
                self._act(t, "release pedal", is_wrong)
            else:
                self._go_on(t)
            return
        # found out before the response is stored
        repeated = response in self.responses
        self.responses.setdefault(response, t)
        if response == "slow down":
            self.pace = _SLOW_PACE
            self._next_response = t + self._reaction.haptic, "decide"
        elif response == "release pedal":
            self.pedal = False
            self._next_response = t + self._reaction.troubleshoot, "troubleshoot"
        elif response == "troubleshoot":
            self._act(t, "convert" if repeated else "restart", is_wrong)
        elif response == "restart":
            self.restarts = True
            self._restart_time = t
        else:
            self._end(t)

    def _await(self, t: float, level: Level, restart_time: float) -> None:
        """Wait for the arm after a restart at a time in s; convert if it stops or takes too long."""
        patience = _LONGEST_HOMING
        if level == Level.E_STOP:
            patience = self._reaction.visual
        if level == Level.PEDAL_UP:
            self._go_on(t)
        elif t - restart_time > patience:
            self._act(t, "convert", is_wrong=True)

    def _go_on(self, t: float) -> None:
        """Press the pedal, and move the hand at its normal speed, from t in s on."""
        self.pace = 1.0
        self.pedal = True
        self._restart_time = None
        self._follows_from = t + _PEDAL_LATENCY
        self._quiet_end = t + _QUIET_TIME

    def _end(self, t: float) -> None:
        """Report, and end the session, at t in s."""
        self.done = True
        self.responses.setdefault("report", t)
