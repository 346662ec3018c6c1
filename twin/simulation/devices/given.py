"""Two hands and pedals as somebody outside gives them: the newest state of each counts, and silence stops both.

Who owns a socket or a page hands states to `give`; nothing here knows where they come from.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.simulation.world import Block, Signals

_LEAP = 1000
"""Largest gap in the sequence numbers of received states that counts as packet loss.

After a larger gap states are rejected until the device has been silent for a while."""


@dataclass(frozen=True)
class HandState:
    """What is said of one hand.

    Attributes:
        hand: 0 right, 1 left.
        clutch, camera: pedals, as this hand's message has them.
        number: one more each time.
        pose: W (4, 4) in {H}.
        grip: angle of the gripper in rad.
    """

    hand: int
    clutch: bool
    camera: bool
    number: int
    pose: Array
    grip: float


class GivenHands(Block):
    """Writes `<hand>.pose` (16,), `<hand>.grip`, `<hand>.lost`, and the pedals of both hands.

    The pedals are `<device>.clutch`, `<device>.camera`; `<device>.ignored` counts what changed nothing.
    `<device>.silent` is 1 while a hand has been silent for `patience`: nothing moves until it is heard again.
    """

    def __init__(
        self, device: str, hands: Sequence[str] = ("right", "left"), scale: float = 0.5, patience: float = 0.25
    ) -> None:
        """Wait for states.

        Args:
            device: name of the pedals.
            hands: names of the right and the left hand.
            scale: `<device>.scale` until `rescale` is called.
            patience: s without a state after which a hand is silent.

        Raises:
            WorldError: there are not two hands.
        """
        if len(hands) != 2:
            raise WorldError(f"device '{device}' has {len(hands)} hands; it needs two, right and left")
        self.device, self.hands, self.patience = device, tuple(hands), patience
        self._new: list[HandState] = []
        self._last: list[HandState | None] = [None, None]
        self._heard, self._lost, self._ignored, self._scale = [-math.inf] * 2, [0, 0], 0, scale
        self._left = False
        self.outputs = self._signals(0.0)

    def give(self, state: HandState) -> None:
        """Take the state of one hand."""
        self._new.append(state)

    def leave(self) -> None:
        """Take the hands away: they are silent in the next tick, whoever gives states then."""
        self._new.clear()
        self._heard, self._left = [-math.inf] * 2, True

    def rescale(self, scale: float) -> None:
        """Set the motion scale from the next tick on. One that is not finite and positive is ignored and counted."""
        if math.isfinite(scale) and scale > 0:
            self._scale = scale
        else:
            self._ignored += 1

    @property
    def heard(self) -> int:
        """Number of the state that was taken last for both hands; -1 before there is one."""
        return min(-1 if last is None else last.number for last in self._last)

    def silent(self, hand: int, t: float) -> bool:
        """Return whether a hand has been silent for longer than the patience, at t in s."""
        return t - self._heard[hand] > self.patience

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, ArrayLike]:
        """Write what was said last."""
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
        if last is not None:
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
        return out | {f"{device}.scale": self._scale, f"{device}.ignored": float(self._ignored)}
