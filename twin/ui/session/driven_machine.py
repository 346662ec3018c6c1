"""A machine whose tool follows that of a robot on a page, while somebody holds the robot (SILS paper, Fig. 3).

If the machine ends the connection, it is connected again when it answers. A hand that held the robot meanwhile, or
while the machine was stopped, moves it only after a new grab: at its start, the machine moves home, and the goal from
before may be far away.
"""

from __future__ import annotations

import threading

import numpy as np

from twin.core.errors import DeviceError, KinematicsError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_link import Address, MachineLink
from twin.simulation.machine.machine_master import MachineMaster
from twin.simulation.machine.machine_parts import Parts
from twin.simulation.machine.physics import TICK
from twin.simulation.machine.state_packets import State

_STANDING_TOLERANCE = 1e-5
"""Difference in m or rad up to which the robot of the page counts as standing where the machine stands."""


class DrivenMachine:
    """Packets and states of one machine.

    Attributes:
        master: sends the packets.
    """

    def __init__(self, address: Address, parts: Parts) -> None:
        """Connect to a machine of a robot with these compiled parts.

        Raises:
            DeviceError: nothing answers at this address.
            DescriptionError: the machine file does not say how fast the tool may be moved.
        """
        self._address = address
        self._parts = parts
        self._reconnection: Reconnection | None = None
        self._was_stopped = False  # whether the machine was stopped or disconnected since the last `advance`
        self._is_held_since_stop = False  # whether the robot is held since before that
        self._link = MachineLink(address, len(parts.home))
        try:
            self.master = MachineMaster(self._link, parts)
        except Exception:
            self._link.close()
            raise
        self._link.reader.heard = self._hear
        self._unsent_time = 0.0  # time in s for which no packet has been sent yet
        self._goal: Array | None = None

    def close(self) -> None:
        """End the connection; the machine's pedal goes up after its time-out."""
        if self._reconnection is not None:
            self._reconnection.close()
        self._link.close()

    def grabbed(self) -> None:
        """Follow the robot that a client has grabbed now, until the machine is stopped or disconnected."""
        self._was_stopped = False
        self._is_held_since_stop = False

    def advance(self, passed: float, goal: Array | None, is_held: bool) -> None:
        """Send the packets of `passed` s: towards a pose (4, 4) of the tool; None: the pedal is up.

        `is_held`: whether a client holds the robot. If the machine was stopped or disconnected meanwhile, the pedal
        stays up.
        After a pause of the page, packets are left out: if they were sent late and faster, so would the tool move.
        """
        if self._link.reader.problem:
            self._was_stopped = True
            self._reconnect()
        if self._was_stopped:
            self._was_stopped = False
            self._is_held_since_stop = True
        if not is_held:
            self._is_held_since_stop = False
        if self._is_held_since_stop:
            goal = None
        self._goal = goal
        if goal is None:
            self.master.rest()
        else:
            self.master.lead(goal)
        self._unsent_time += passed
        ticks = int(self._unsent_time / TICK)
        self._unsent_time -= ticks * TICK
        self.master.step(min(ticks, self._link.room))

    def _reconnect(self) -> None:
        """Replace a connection that has ended by a new one, as soon as the machine answers."""
        if self._reconnection is None:
            self._reconnection = Reconnection(self._address, len(self._parts.home))
        link = self._reconnection.take()
        if link is None:
            return
        self._reconnection = None
        self._link.close()
        self._link = link
        link.reader.heard = self._hear
        self.master = MachineMaster(link, self._parts)
        self._unsent_time = 0.0

    def _hear(self, state: State) -> None:
        """Take each state, in the thread that reads them: a stop and a new start may be shorter than a picture."""
        if state.level in (Level.E_STOP, Level.INIT):
            self._was_stopped = True

    def elsewhere(self, q: Array) -> Array | None:
        """Return the joint values (n,) of the machine if they are not q (n,); None: they are, or it does not answer."""
        state = self._link.state
        if state is None or np.abs(state.q - q).max() <= _STANDING_TOLERANCE:
            return None
        return state.q

    @property
    def problem(self) -> str:
        """Reason why the machine does not follow a held robot, and the way out; "" if it follows, or would."""
        if self._link.reader.problem:
            name = self._parts.arm.mechanism.name
            options = f"--start --port {self._address.port} --state-port {self._address.state_port}"
            return (
                f"the connection to the machine has ended: start the machine again (twin machine {name} {options}); "
                "this page then connects by itself"
            )
        if self._link.problem:
            return self._link.problem
        state = self._link.state
        if state is not None and state.level == Level.E_STOP:
            return "the machine is in E_STOP: press its start button (twin machine --start)"
        if self._is_held_since_stop:
            return "the machine was stopped or connected again: let the robot go, and hold it again"
        if self.master.held:
            return "the machine holds this pose as out of its reach"
        return ""

    def state(self) -> JsonObject:
        """Return run level of the machine, distance in m of its tool from the goal (None: no goal), and the problem."""
        state = self._link.state
        behind = None
        if state is not None and self._goal is not None:
            try:
                T = self.master.tool(state.q)
                behind = round(float(np.linalg.norm((T - self._goal)[:3, 3])), 6)
            except KinematicsError:
                behind = None
        return {
            "level": None if state is None else state.level.name,
            "behind": behind,
            "problem": self.problem or None,
        }


_CONNECTION_PAUSE = 0.5
"""Time in s before each attempt to connect."""


class Reconnection:
    """Attempts to connect to a machine, one after the other, until it answers."""

    def __init__(self, address: Address, n: int) -> None:
        """Begin the attempts to connect to a machine of n joints."""
        self._address = address
        self._joint_count = n
        self._link: MachineLink | None = None
        self._lock = threading.Lock()  # of `_link`, and of the decision that nobody takes it any more
        self._end_requested = threading.Event()
        threading.Thread(target=self._run, daemon=True).start()

    def take(self) -> MachineLink | None:
        """Return the new connection, which the caller closes from then on; None: the machine does not answer yet."""
        with self._lock:
            link = self._link
            self._link = None
        return link

    def close(self) -> None:
        """End the attempts, and close a connection that nobody has taken."""
        with self._lock:
            self._end_requested.set()
        link = self.take()
        if link is not None:
            link.close()

    def _run(self) -> None:
        while not self._end_requested.wait(_CONNECTION_PAUSE):
            try:
                link = MachineLink(self._address, self._joint_count)
            except DeviceError:
                continue
            with self._lock:
                is_wanted = not self._end_requested.is_set()
                if is_wanted:
                    self._link = link
            if not is_wanted:
                link.close()
            return
