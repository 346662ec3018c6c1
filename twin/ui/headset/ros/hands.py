"""Hands of a console that are moved by messages of ROS clients, as UDP packets move them (`packet_socket`)."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from twin.core.spatial import Array
from twin.simulation.devices.received_hands import HandState, ReceivedHands

ROS_OWNER = "ros"
"""Identifier of the owner of the hands if messages of ROS clients move them."""

_MAX_WAITING_STATES = 256
"""Maximum number of waiting states; a flood of messages then does not delay the ticks."""

_SILENCE_TIMEOUT = 5.0
"""Time in s without a message after which ROS clients no longer own the hands."""


@dataclass
class _HandControl:
    """Control of one hand.

    Attributes:
        client: identifier of the client that controls the hand; None: no client yet.
        heard: time in s of the World at the last accepted pose.
        number: number of the next state.
    """

    client: str | None = None
    heard: float = -math.inf
    number: int = 0


@dataclass
class _ClientInputs:
    """What a client has sent beside poses: its pedals, and the angle of each gripper in rad."""

    clutch: bool = False
    camera: bool = False
    grips: dict[int, float] = field(default_factory=dict)


class RosHands:
    """Converts messages to hand states. Each pose of a hand gives a state, with the newest pedals and grip.

    The client that first sends a pose of a hand controls this hand, until it is silent for longer than
    `device.patience` s of the World. Pedals belong to the console: any client may press them, and a client that
    disconnects releases its own.

    Attributes:
        device: the input device.
        holder: name of another device that controls the hands; None: no other device. While a name is set, all poses
            are refused; pedals and grips are still stored.
        refused: number of refused poses.
        time: function that returns the time in s of the World.
        ended: function that returns why the World is at rest, or "".
    """

    def __init__(self, device: ReceivedHands, time: Callable[[], float], ended: Callable[[], str]) -> None:
        """Start without hands."""
        self.device = device
        self.holder: str | None = None
        self.refused = 0
        self.time = time
        self.ended = ended
        self._controls = [_HandControl() for _ in device.hands]
        self._client_inputs: dict[str, _ClientInputs] = {}
        self._waiting: deque[tuple[str, HandState]] = deque()
        self._last_pump_time = -math.inf

    def pose(self, client: str, hand: int, pose: Array) -> str:
        """Accept a pose (4, 4) of a handle in {H} from a client; return why it is refused, else ""."""
        refusal = self._refusal(client, hand)
        if refusal:
            self.refused += 1
            return refusal
        handle = self._controls[hand]
        sender = self._inputs_of(client)
        grip = sender.grips.get(hand, 0.0)
        state = HandState(hand, self.clutch, self.camera, handle.number, pose, grip)
        handle.number = (handle.number + 1) % 2**32
        if len(self._waiting) >= _MAX_WAITING_STATES:
            self._waiting.popleft()
        self._waiting.append((client, state))
        handle.client = client
        handle.heard = self.time()
        return ""

    def _refusal(self, client: str, hand: int) -> str:
        side = self.device.hands[hand]
        owner = self.client(hand)
        ended = self.ended()
        if ended:
            return ended
        if self.holder is not None:
            return f"{self.holder} controls the hands; release them there"
        if owner not in (None, client):
            return f"{owner} controls the {side} hand until it is silent for {self.device.patience:g} s"
        if owner is None and self.camera:
            return "the camera pedal was pressed with the first pose of the hand; release it once"
        return ""

    def _inputs_of(self, client: str) -> _ClientInputs:
        return self._client_inputs.setdefault(client, _ClientInputs())

    @property
    def clutch(self) -> bool:
        """Whether a client presses the clutch."""
        return any(sender.clutch for sender in self._client_inputs.values())

    @property
    def camera(self) -> bool:
        """Whether a client presses the camera pedal."""
        return any(sender.camera for sender in self._client_inputs.values())

    def press(self, client: str, *, clutch: bool | None = None, camera: bool | None = None) -> None:
        """Press (True) or release (False) the pedals of a client; None: the pedal is unchanged."""
        sender = self._inputs_of(client)
        if clutch is not None:
            sender.clutch = clutch
        if camera is not None:
            sender.camera = camera

    def grip(self, client: str, hand: int, angle: float) -> None:
        """Set the angle of a gripper in rad, from the next pose on that the same client sends of the hand."""
        self._inputs_of(client).grips[hand] = angle

    def client(self, hand: int) -> str | None:
        """Return the client that controls a hand now; None: no client."""
        handle = self._controls[hand]
        # A new attempt at a task begins at time 0.
        if not 0 <= self.time() - handle.heard <= self.device.patience:
            return None
        return handle.client

    def leave(self, client: str) -> None:
        """Forget a client that has disconnected: other clients can control its hands, and its pedals are released.

        `silent` still counts its last pose.
        """
        self._client_inputs.pop(client, None)
        self._waiting = deque(waiting for waiting in self._waiting if waiting[0] != client)
        for handle in self._controls:
            if handle.client == client:
                handle.client = None

    def pump(self, parts: int = 1) -> int:
        """Pass waiting states to the device; return their number. Each call passes 1 / `parts` of them.

        The ticks of a frame may be computed in several groups; `parts` is the number of remaining groups, including
        this one. States are dropped if another device has taken the hands since, or a new attempt has begun.
        """
        now = self.time()
        if self.holder is not None or now < self._last_pump_time:
            self._waiting.clear()
        self._last_pump_time = now
        share = math.ceil(len(self._waiting) / parts)
        for _ in range(share):
            _, state = self._waiting.popleft()
            self.device.give(state)
        return share

    def silent(self, t: float) -> bool:
        """Return whether no pose was accepted in the last `_SILENCE_TIMEOUT` s before time t in s."""
        latest = max(handle.heard for handle in self._controls)
        return not 0 <= t - latest <= _SILENCE_TIMEOUT

    def senders(self) -> dict[str, str | None]:
        """Return the client of each hand."""
        return {name: self.client(hand) for hand, name in enumerate(self.device.hands)}
