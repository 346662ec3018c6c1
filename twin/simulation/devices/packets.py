"""Hands and pedals out of packets: what pens and other programs send, in a documented layout, however it arrives.

A packet is 84 bytes, little-endian: "TWNH", version (u8, 1), hand (u8: 0 right, 1 left), pedals (u8: 1 clutch, 2
camera), 0 (u8), number (u32, one more each time, for each hand), time of the sender (u64, us, not used), position in
{H} (3 float64, m), attitude (4 float64, unit quaternion, w first), gripper (float64, rad). Forces go back in 36 bytes:
"TWNF", version, hand, 0, 0 (u8 each), number of the packet that is answered (u32), force in {H} (3 float64, N).

Who owns the socket hands packets to `take`; nothing here knows a network. A packet that is late, twice there, broken or
has another layout changes nothing and is counted.
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
"""Largest coordinate in m and angle of a gripper in rad that are believed."""


def pack(
    hand: int, number: int, pose: Array, grip: float, clutch: bool = False, camera: bool = False, time: int = 0
) -> bytes:
    """Return the 84 bytes of a packet; pose (4, 4) in {H}, grip in rad, time in us."""
    q = spatial.quat_from_matrix_wxyz(pose[:3, :3])
    pedals = _CLUTCH * clutch + _CAMERA * camera
    return HAND.pack(_MAGIC, _VERSION, hand, pedals, 0, number % 2**32, time, *pose[:3, 3], *q, grip)


def unpack(data: bytes) -> HandState | None:
    """Return what a packet says; None if it has another layout, or numbers that no hand has."""
    if len(data) != HAND.size:
        return None
    magic, version, hand, pedals, zero, number, _, *numbers = HAND.unpack(data)
    p, q, grip = numbers[:3], numbers[3:7], numbers[7]
    if (magic, version, zero) != (_MAGIC, _VERSION, 0) or hand > 1 or pedals > _CLUTCH + _CAMERA:
        return None
    # NaN and infinity fail the comparisons.
    if not all(abs(x) <= _FAR for x in p) or not abs(grip) <= _OPEN or not abs(math.hypot(*q) - 1) <= 1e-3:
        return None
    pose = spatial.pose(spatial.matrix_from_quat_wxyz(q), p)
    return HandState(hand, bool(pedals & _CLUTCH), bool(pedals & _CAMERA), number, pose, grip)


class Packets(GivenHands):
    """Hands whose states come as packets; a packet that changes nothing is counted in `<device>.ignored`."""

    def take(self, data: bytes) -> int | None:
        """Take the bytes of one packet; return the hand if they have the layout, so that it can be answered."""
        state = unpack(data)
        if state is None:
            self._ignored += 1
            return None
        self.give(state)
        return state.hand

    def answer(self, hand: int, force: ArrayLike) -> bytes:
        """Return the packet that brings a force (3,) in {H} in N back to a hand."""
        last = self._last[hand]
        number = last.number if last else 0
        return FORCE.pack(_ANSWER, _VERSION, hand, 0, 0, number, *np.asarray(force, float))
