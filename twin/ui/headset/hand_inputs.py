"""Hand states from outside the page: from UDP packets, and from clients of ROS systems."""

from __future__ import annotations

from twin.simulation.world.signal_kinds import HAND_FORCE
from twin.ui.headset.packet_socket import UDP_OWNER, PacketHands
from twin.ui.headset.ros.hands import ROS_OWNER, RosHands
from twin.ui.session.live_console import LiveConsole

_QUESTIONNAIRE_HOLDER = "a questionnaire, which is due on the page,"
"""Name of the holder of the hands, in messages to other devices, while a questionnaire is due."""


def receive_hands(console: LiveConsole, packets: PacketHands | None, ros_hands: RosHands | None, parts: int) -> None:
    """Receive hand states by UDP, then from ROS clients, for the next steps of the World.

    Args:
        console: the console, whose owner becomes `UDP_OWNER` or `ROS_OWNER` if hand states are accepted.
        packets: receiver of UDP packets; None: there is none.
        ros_hands: hand states of ROS clients; None: there is no server for them.
        parts: number of remaining groups of steps, among which the waiting hand states are spread.
    """
    accepted_packets = False
    if packets is not None:
        accepted_packets = _receive_packets(console, packets, parts)
    if ros_hands is not None:
        _receive_from_ros(console, ros_hands, parts, accepted_packets)


def _receive_packets(console: LiveConsole, packets: PacketHands, parts: int) -> bool:
    """Receive UDP packets, and answer with the forces on the hands; return whether a packet was accepted."""
    t = console.world.t
    is_owner = console.owner == UDP_OWNER
    packets.socket.holder = None
    if console.asks:
        packets.socket.holder = _QUESTIONNAIRE_HOLDER
    elif not is_owner and not console.silent:
        packets.socket.holder = console.owner
    accepted = packets.socket.pump(t, parts) > 0
    if accepted:
        console.own(UDP_OWNER)
    elif is_owner and packets.silent(t):
        console.release(UDP_OWNER)
    if console.owner == UDP_OWNER:
        forces = [console.world.signals[HAND_FORCE.of(hand)] for hand in console.table.hands]
        packets.answer(forces, t)
    return accepted


def _receive_from_ros(console: LiveConsole, hands: RosHands, parts: int, accepted_packets: bool) -> None:
    """Receive hand states of ROS clients, unless UDP packets have just been accepted."""
    is_owner = console.owner == ROS_OWNER
    hands.holder = None
    if console.asks:
        hands.holder = _QUESTIONNAIRE_HOLDER
    elif accepted_packets:
        hands.holder = UDP_OWNER
    elif not is_owner and not console.silent:
        hands.holder = console.owner
    if hands.pump(parts):
        console.own(ROS_OWNER)
    elif is_owner and hands.silent(console.world.t):
        console.release(ROS_OWNER)
