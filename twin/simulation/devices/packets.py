"""Hands and pedals from packets, in a documented layout, sent by haptic pens or other programs over any connection.

A packet from a hand has 84 bytes, little-endian: "TWNH", version (u8, 1), hand (u8: 0 right, 1 left), pedals (u8: 1
clutch, 2 camera), 0 (u8), sequence number (u32, per hand), time of the sender (u64, us, not used), position in {H} (3
float64, m), orientation (4 float64, unit quaternion, w first), gripper (float64, rad). The answer with the force has 36
bytes: "TWNF", version, hand, 0, 0 (u8 each), sequence number of the answered packet (u32), force in {H} (3 float64, N).

The owner of the socket passes packets to `take`; this module does not use the network. A packet that is late, repeated,
damaged or in another layout is ignored and counted.
"""

from __future__ import annotations

import math
import struct

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.spatial import Array
from twin.simulation.devices.given import GivenHands, HandState

HAND, FORCE = struct.Struct("<4sBBBBIQ8d"), struct.Struct("<4sBBBBI3d")
_MAGIC, _ANSWER, _VERSION = b"TWNH", b"TWNF", 1
_CLUTCH, _CAMERA = 1, 2

_FAR, _OPEN = 10.0, 2 * math.pi
"""Largest accepted coordinate in m and gripper angle in rad."""


def pack(
    hand: int, number: int, pose: Array, grip: float, clutch: bool = False, camera: bool = False, time: int = 0
) -> bytes:
    """Return the 84 bytes of a packet; pose (4, 4) of the handle in {H}, grip in rad, time in us."""
    q = spatial.quat_from_matrix_wxyz(pose[:3, :3])
    pedals = _CLUTCH * clutch + _CAMERA * camera
    return HAND.pack(_MAGIC, _VERSION, hand, pedals, 0, number % 2**32, time, *pose[:3, 3], *q, grip)


def unpack(data: bytes) -> HandState | None:
    """Return the hand state in a packet; None if the layout is wrong or a number is implausible."""
    if len(data) != HAND.size:
        return None
    magic, version, hand, pedals, zero, number, _, *numbers = HAND.unpack(data)
    p, q, grip = numbers[:3], numbers[3:7], numbers[7]
    if (magic, version, zero) != (_MAGIC, _VERSION, 0) or hand > 1 or pedals > _CLUTCH + _CAMERA:
        return None
    # NaN and infinity fail these comparisons.
    if not all(abs(x) <= _FAR for x in p) or not abs(grip) <= _OPEN or not abs(math.hypot(*q) - 1) <= 1e-3:
        return None
    pose = spatial.pose(spatial.matrix_from_quat_wxyz(q), p)
    return HandState(hand, bool(pedals & _CLUTCH), bool(pedals & _CAMERA), number, pose, grip)


class Packets(GivenHands):
    """Hands whose states arrive as packets; ignored packets are counted in `<device>.ignored`."""

    def take(self, data: bytes) -> int | None:
        """Process the bytes of one packet; return the hand (0 or 1) to answer, or None if the layout is wrong."""
        state = unpack(data)
        if state is None:
            self._ignored += 1
            return None
        self.give(state)
        return state.hand

    def answer(self, hand: int, force: ArrayLike) -> bytes:
        """Return the packet with a force (3,) in {H} in N, to be sent to a hand."""
        last = self._last[hand]
        number = last.number if last else 0
        return FORCE.pack(_ANSWER, _VERSION, hand, 0, 0, number, *np.asarray(force, float))
