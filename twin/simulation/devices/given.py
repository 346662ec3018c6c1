"""Two hands and pedals whose states come from outside the World; each tick uses the newest state of each hand.

The owner of a network connection or web page passes states to `give`; the origin of the states does not matter here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import WorldError, unknown
from twin.core.spatial import Array
from twin.simulation.world import Block, Signals

_LEAP = 1000
"""Largest gap in the sequence numbers of received states that counts as packet loss.

After a larger gap, states are rejected until the device has been silent."""


@dataclass(frozen=True)
class HandState:
    """State of one hand.

    Attributes:
        hand: 0 right, 1 left.
        clutch, camera: whether the clutch pedal and the camera pedal are pressed.
        number: sequence number, increased by one per state.
        pose: (4, 4) pose W of the handle in {H}, the frame of the handles.
        grip: angle of the gripper in rad.
    """

    hand: int
    clutch: bool
    camera: bool
    number: int
    pose: Array
    grip: float


class GivenHands(Block):
    """Writes `<hand>.pose` (16,), `<hand>.grip`, `<hand>.lost`, and the pedals for both hands.

    `<hand>.lost` counts the states of a hand that did not arrive: the gaps in the sequence numbers. `<device>.clutch`
    and `<device>.camera` are the pedals; `<device>.ignored` counts the hand states and motion scales that were ignored.
    `<device>.haptics` is 1 if the forces on the hands are switched on. `<device>.silent` is 1 if a hand has sent no
    state for `patience` seconds; nothing moves until that hand sends a state.
    """

    def __init__(
        self,
        device: str,
        hands: Sequence[str] = ("right", "left"),
        scale: float = 0.5,
        patience: float = 0.25,
        settings: Mapping[str, float] | None = None,
    ) -> None:
        """Prepare to receive states.

        Args:
            device: name of the device of the pedals.
            hands: names of the right and the left hand.
            scale: value of `<device>.scale` until `rescale` is called.
            patience: time in s without a state after which a hand counts as silent.
            settings: {name: initial value} of further signals, such as chosen tools; `set` changes a value.

        Raises:
            WorldError: the number of hands is not two.
        """
        if len(hands) != 2:
            raise WorldError(f"device '{device}' has {len(hands)} hands; it needs two, right and left")
        self.device, self.hands, self.patience = device, tuple(hands), patience
        self._new: list[HandState] = []
        self._last: list[HandState | None] = [None, None]
        self._heard, self._lost, self._ignored, self._scale = [-math.inf] * 2, [0, 0], 0, scale
        self._left, self._haptics = False, True
        self._settings = dict(settings or {})
        self.outputs = self._signals(0.0)

    def give(self, state: HandState) -> None:
        """Accept a new state of one hand; the state is used in the next tick."""
        self._new.append(state)

    def leave(self) -> None:
        """Disconnect the hands: they are silent in the next tick, even if new states arrive."""
        self._new.clear()
        self._heard, self._left = [-math.inf] * 2, True

    def rescale(self, scale: float) -> None:
        """Set the motion scale from the next tick on; ignore and count a value that is not finite and positive."""
        if math.isfinite(scale) and scale > 0:
            self._scale = scale
        else:
            self._ignored += 1

    def feel(self, on: bool) -> None:
        """Switch the forces on the hands on or off from the next tick on."""
        self._haptics = on

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
        """Smaller of the two hands' last received sequence numbers; -1 until both hands have sent a state."""
        return min(-1 if last is None else last.number for last in self._last)

    def silent(self, hand: int, t: float) -> bool:
        """Return whether a hand has been silent for longer than `patience`, at time t in s."""
        return t - self._heard[hand] > self.patience

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, ArrayLike]:
        """Use the states that arrived since the last tick."""
        new, self._new = self._new, []
        for state in new:
            self._order(state, t)
        out = self._signals(t)
        if self._left:
            self._left, out[f"{self.device}.silent"] = False, 1.0
        return out

    def _order(self, state: HandState, t: float) -> None:
        hand, last = state.hand, self._last[state.hand]
        silent = self.silent(hand, t)
        if (
            last is not None and self._heard[hand] > -math.inf
        ):  # after `leave`, another sender starts with its own number
            ahead = (state.number - last.number + 2**31) % 2**32 - 2**31
            if not silent and not 0 < ahead <= _LEAP:
                self._ignored += 1
                return
            if 0 < ahead <= _LEAP:
                self._lost[hand] += ahead - 1
        self._last[hand], self._heard[hand] = state, t

    def _signals(self, t: float) -> dict[str, ArrayLike]:
        out: dict[str, ArrayLike] = {}
        for name, last, lost in zip(self.hands, self._last, self._lost, strict=True):
            out[f"{name}.pose"] = last.pose.ravel() if last else np.eye(4).ravel()
            out[f"{name}.grip"], out[f"{name}.lost"] = last.grip if last else 0.0, float(lost)
        device, known = self.device, [last for last in self._last if last]
        out[f"{device}.clutch"] = float(any(last.clutch for last in known))
        out[f"{device}.camera"] = float(any(last.camera for last in known))
        out[f"{device}.silent"] = float(any(self.silent(hand, t) for hand in (0, 1)))
        out[f"{device}.haptics"] = float(self._haptics)
        return out | self._settings | {f"{device}.scale": self._scale, f"{device}.ignored": float(self._ignored)}
