"""Two hands and pedals whose states come from outside the World; each tick uses the newest state of each hand.

The owner of a network connection or web page passes states to `give`; the origin of the states does not matter here.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import WorldError, unknown
from twin.core.spatial import Array
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import (
    DEVICE_CAMERA,
    DEVICE_CLUTCH,
    DEVICE_HAPTICS,
    DEVICE_IGNORED,
    DEVICE_SCALE,
    DEVICE_SILENT,
    HAND_GRIP,
    HAND_LOST,
    HAND_POSE,
)

_LARGEST_GAP = 1000
"""Largest gap in the sequence numbers of received states that counts as packet loss.

After a larger gap, the states of that hand are ignored until the hand has been silent."""

_SEQUENCE_COUNT = 2**32
"""Number of different sequence numbers: they have 32 bits, and begin again at 0."""


@dataclass(frozen=True)
class HandState:
    """State of one hand.

    Attributes:
        hand: 0 right, 1 left.
        clutch, camera: whether the clutch pedal and the camera pedal are pressed.
        number: sequence number, increased by one per state; 0 follows 2**32 - 1.
        pose: (4, 4) pose W of the handle in {H}, the frame of the handles.
        grip: angle of the gripper in rad.
    """

    hand: int
    clutch: bool
    camera: bool
    number: int
    pose: Array
    grip: float


class ReceivedHands(Block):
    """Writes `<hand>.pose` (16,), `<hand>.grip`, `<hand>.lost`, and the pedals for both hands.

    `<hand>.lost` counts the states of a hand that did not arrive: the gaps in the sequence numbers. `<device>.clutch`
    and `<device>.camera` are the pedals; a pedal is pressed if the last state of either hand says so. `<device>.scale`
    is the motion scale; `<device>.ignored` counts the hand states and motion scales that were ignored.
    `<device>.haptics` is 1 if the forces on the hands are switched on. `<device>.silent` is 1 if a hand that moves a
    robot has sent no state for `patience` seconds; nothing moves until that hand sends a state. The signals in
    `settings` are written under their own names.
    """

    def __init__(
        self,
        device: str,
        hands: Sequence[str] = ("right", "left"),
        scale: float = 0.5,
        patience: float = 0.25,
        settings: Mapping[str, float] | None = None,
        moving: Sequence[int] = (0, 1),
    ) -> None:
        """Prepare to receive states.

        Args:
            device: name of the device of the pedals.
            hands: names of the right and the left hand.
            scale: value of `<device>.scale` until `rescale` is called.
            patience: time in s without a state after which a hand counts as silent.
            settings: {name: initial value} of further signals, such as chosen tools; `set` changes a value.
            moving: the hands that move robots, 0 right and 1 left; the silence of another hand does not count.

        Raises:
            WorldError: the number of hands is not two.
        """
        if len(hands) != 2:
            raise WorldError(f"device '{device}' has {len(hands)} hands; it needs two, right and left")
        self.device = device
        self.hands = tuple(hands)
        self.patience = patience
        self.moving = tuple(moving)
        # filled by another thread; a number is that of a call of `leave`, whose states come after it
        self._arrived: deque[HandState | int] = deque()
        self._last_states: list[HandState | None] = [None, None]
        self._arrival_times = [-math.inf, -math.inf]  # in s, of the last state of each hand
        self._lost_counts = [0, 0]
        self._ignored = 0
        self._scale = scale
        self._leave_count = 0  # number of calls of `leave`
        self._last_leave = 0  # number of the last one that a tick has seen
        self._is_haptics_on = True
        self._settings = dict(settings or {})
        self.outputs = self._signals(0.0)

    def give(self, state: HandState) -> None:
        """Accept a new state of one hand; the state is used in the next tick."""
        self._arrived.append(state)

    def leave(self) -> None:
        """Disconnect the hands: they are silent in the next tick, even if new states arrive."""
        # Only `step` changes what is known of the hands: another thread may call it now.
        self._leave_count += 1
        self._arrived.clear()
        self._arrived.append(self._leave_count)

    def rescale(self, scale: float) -> None:
        """Set the motion scale from the next tick on; ignore and count a value that is not finite and positive."""
        if math.isfinite(scale) and scale > 0:
            self._scale = scale
        else:
            self._ignored += 1

    def feel(self, on: bool) -> None:
        """Switch the forces on the hands on or off from the next tick on."""
        self._is_haptics_on = on

    def set(self, name: str, value: float) -> None:
        """Set a signal of `settings` from the next tick on.

        Raises:
            WorldError: there is no such setting.
        """
        if name not in self._settings:
            raise WorldError(f"device '{self.device}': {unknown('setting', name, self._settings)}")
        self._settings[name] = float(value)

    @property
    def heard(self) -> int:
        """Earliest of the last received sequence numbers of the hands that move robots; -1 until all have sent one."""
        earliest = -1
        for hand in self.moving:
            last = self._last_states[hand]
            if last is None:
                return -1
            if earliest < 0 or _gap(earliest, last.number) < 0:
                earliest = last.number
        return earliest

    def any_silent(self, t: float) -> bool:
        """Return whether a hand that moves a robot is silent at time t in s."""
        return any(self.silent(hand, t) for hand in self.moving)

    def silent(self, hand: int, t: float) -> bool:
        """Return whether a hand has been silent for longer than `patience`, at time t in s."""
        has_left = self._last_leave < self._leave_count
        return has_left or t - self._arrival_times[hand] > self.patience

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, ArrayLike]:
        """Use the states that arrived since the last tick."""
        is_disconnected = False
        # Another thread may call `give` meanwhile: a state beyond the present number waits for the next tick.
        for _ in range(len(self._arrived)):
            try:
                arrived = self._arrived.popleft()
            except IndexError:  # another thread has called `leave`
                break
            if isinstance(arrived, HandState):
                self._accept(arrived, t)
                continue
            self._last_leave = max(self._last_leave, arrived)
            self._arrival_times = [-math.inf, -math.inf]
            is_disconnected = True
        values = self._signals(t)
        if is_disconnected:
            values[DEVICE_SILENT.of(self.device)] = 1.0
        return values

    def _accept(self, state: HandState, t: float) -> None:
        """Store a state, unless it is late or repeated; count the states that are missing before it."""
        hand = state.hand
        last = self._last_states[hand]
        # after `leave`, another sender starts with its own number
        if last is not None and self._arrival_times[hand] > -math.inf:
            gap = _gap(last.number, state.number)
            in_order = 0 < gap <= _LARGEST_GAP
            if not in_order and not self.silent(hand, t):
                self._ignored += 1
                return
            if in_order:
                self._lost_counts[hand] += gap - 1
        self._last_states[hand] = state
        self._arrival_times[hand] = t

    def _signals(self, t: float) -> dict[str, ArrayLike]:
        values: dict[str, ArrayLike] = {}
        is_clutch_down = False
        is_camera_down = False
        # without a state, a pedal counts as released; `<device>.silent` keeps the hands from moving anything
        for name, last, lost_count in zip(self.hands, self._last_states, self._lost_counts, strict=True):
            if last is None:
                values[HAND_POSE.of(name)] = np.eye(4).ravel()
                values[HAND_GRIP.of(name)] = 0.0
            else:
                values[HAND_POSE.of(name)] = last.pose.ravel()
                values[HAND_GRIP.of(name)] = last.grip
                is_clutch_down = is_clutch_down or last.clutch
                is_camera_down = is_camera_down or last.camera
            values[HAND_LOST.of(name)] = float(lost_count)
        values[DEVICE_CLUTCH.of(self.device)] = float(is_clutch_down)
        values[DEVICE_CAMERA.of(self.device)] = float(is_camera_down)
        values[DEVICE_SILENT.of(self.device)] = float(self.any_silent(t))
        values[DEVICE_HAPTICS.of(self.device)] = float(self._is_haptics_on)
        values.update(self._settings)
        values[DEVICE_SCALE.of(self.device)] = self._scale
        values[DEVICE_IGNORED.of(self.device)] = float(self._ignored)
        return values


def _gap(earlier: int, later: int) -> int:
    """Return by how many states the sequence number `later` follows `earlier`; negative if it comes before."""
    half = _SEQUENCE_COUNT // 2
    return (later - earlier + half) % _SEQUENCE_COUNT - half
