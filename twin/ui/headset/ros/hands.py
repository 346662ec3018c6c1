"""Hands of a console that are moved by messages of ROS clients, as UDP packets move them (`packet_socket`)."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from twin.core.spatial import Array
from twin.simulation.devices.given import GivenHands, HandState

ROS = "ros"
"""Identifier of the owner of the hands if messages of ROS clients move them."""

_MOST = 256
"""Maximum number of waiting states; a flood of messages then does not delay the ticks."""

_SILENT = 5.0
"""Time in s without a message after which ROS clients no longer own the hands."""


@dataclass
class _Handle:
    """Newest values of one hand, and who sends them.

    Attributes:
        client: identifier of the client that controls the hand; None: no client yet.
        heard: time in s of the World at the last accepted pose.
        state: the newest state; its number is that of the next state.
    """

    client: str | None
    heard: float
    state: HandState


class RosHands:
    """Converts messages to hand states. Each pose of a hand gives a state, with the newest pedals and grip.

    The client that first sends a pose of a hand controls this hand, until it is silent for longer than
    `device.patience` s of the World.

    Attributes:
        device: the input device.
        holder: name of another device that controls the hands; None: no other. Then all messages are refused.
        refused: number of refused poses.
        time: function that returns the time in s of the World.
    """

    def __init__(self, device: GivenHands, time: Callable[[], float]) -> None:
        """Start without hands."""
        self.device = device
        self.holder: str | None = None
        self.refused = 0
        self.time = time
        self.clutch = False
        self.camera = False
        self._handles = []
        for hand in range(len(device.hands)):
            state = HandState(hand, False, False, 0, np.eye(4), 0.0)
            self._handles.append(_Handle(None, -math.inf, state))
        self._waiting: deque[HandState] = deque()

    def pose(self, client: str, hand: int, pose: Array) -> str:
        """Accept a pose (4, 4) of a handle in {H} from a client; return why it is refused, else ""."""
        refusal = self._refusal(client, hand)
        if refusal:
            self.refused += 1
            return refusal
        handle = self._handles[hand]
        state = replace(handle.state, clutch=self.clutch, camera=self.camera, pose=pose)
        handle.state = replace(state, number=(state.number + 1) % 2**32)
        if len(self._waiting) >= _MOST:
            self._waiting.popleft()
        self._waiting.append(state)
        handle.client = client
        handle.heard = self.time()
        return ""

    def _refusal(self, client: str, hand: int) -> str:
        side = self.device.hands[hand]
        owner = self.client(hand)
        if self.holder is not None:
            return f"{self.holder} controls the hands; release them there"
        if owner not in (None, client):
            return f"{owner} controls the {side} hand until it is silent for {self.device.patience:g} s"
        if owner is None and self.camera:
            return "the camera pedal was pressed with the first pose of the hand; release it once"
        return ""

    def grip(self, hand: int, angle: float) -> None:
        """Set the angle of a gripper in rad, from the next pose of the hand on."""
        handle = self._handles[hand]
        handle.state = replace(handle.state, grip=angle)

    def client(self, hand: int) -> str | None:
        """Return the client that controls a hand now; None: no client."""
        handle = self._handles[hand]
        if self.time() - handle.heard > self.device.patience:
            return None
        return handle.client

    def leave(self, client: str) -> None:
        """End the control of a client that has disconnected; its hands become silent."""
        for handle in self._handles:
            if handle.client == client:
                handle.client = None

    def pump(self, parts: int = 1) -> int:
        """Pass waiting states to the device; return their number. Each call passes 1 / `parts` of them.

        The ticks of a frame may be computed in several groups; `parts` is the number of remaining groups, including
        this one.
        """
        if self.holder is not None:  # another device has taken the hands since these messages arrived
            self._waiting.clear()
            return 0
        share = math.ceil(len(self._waiting) / parts)
        for _ in range(share):
            state = self._waiting.popleft()
            self.device.give(state)
        return share

    def silent(self, t: float) -> bool:
        """Return whether no pose was accepted in the last `_SILENT` s before time t in s."""
        latest = max(handle.heard for handle in self._handles)
        return t - latest > _SILENT

    def senders(self) -> dict[str, str | None]:
        """Return the client of each hand."""
        return {name: self.client(hand) for hand, name in enumerate(self.device.hands)}
