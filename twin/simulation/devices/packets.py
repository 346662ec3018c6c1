"""Hands and pedals from packets, in a documented layout, sent by haptic pens or other programs over any connection.

A packet from a hand has 84 bytes, little-endian: "TWNH", version (u8, 1), hand (u8: 0 right, 1 left), pedals (u8: 1
clutch, 2 camera), 0 (u8), sequence number (u32, per hand), time of the sender (u64, µs, not used), position in {H} (3
float64, m), orientation (4 float64, unit quaternion, w first), gripper (float64, rad). The answer with the force has 36
bytes: "TWNF", version, hand, 0, 0 (u8 each), sequence number of the answered packet (u32), force in {H} (3 float64, N).

The owner of the socket passes packets to `read`; this module does not use the network. A packet that is late, repeated,
damaged or in another layout is ignored and counted.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from enum import IntFlag

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import DeviceError
from twin.core.spatial import Array
from twin.simulation.devices.received_hands import HandState, ReceivedHands

HAND = struct.Struct("<4sBBBBIQ8d")
FORCE = struct.Struct("<4sBBBBI3d")
_MAGIC = b"TWNH"
_ANSWER = b"TWNF"
_VERSION = 1


class _Pedal(IntFlag):
    """Pedals that are pressed."""

    CLUTCH = 1
    CAMERA = 2


_LARGEST_COORDINATE = 10.0
"""Largest accepted coordinate in m."""

_LARGEST_GRIP = 2 * math.pi
"""Largest accepted angle of a gripper in rad."""

_QUATERNION_TOLERANCE = 1e-3
"""Largest accepted deviation of a quaternion's length from 1."""


def pack(
    hand: int, number: int, pose: Array, grip: float, clutch: bool = False, camera: bool = False, time: int = 0
) -> bytes:
    """Return the 84 bytes of a packet; pose (4, 4) of the handle in {H}, grip in rad, time in µs."""
    q = spatial.quat_from_matrix_wxyz(pose[:3, :3])
    pedals = _Pedal.CLUTCH * clutch + _Pedal.CAMERA * camera
    return HAND.pack(_MAGIC, _VERSION, hand, pedals, 0, number % 2**32, time, *pose[:3, 3], *q, grip)


def unpack(data: bytes) -> HandState:
    """Return the hand state in a packet.

    Raises:
        DeviceError: the layout is wrong or a number is implausible; the message names the field, its value and limit.
    """
    if len(data) != HAND.size:
        raise DeviceError(f"the packet has {len(data)} bytes; it must have {HAND.size}")
    magic, version, hand, pedals, zero, number, _, *numbers = HAND.unpack(data)
    p = numbers[:3]
    q = numbers[3:7]
    grip = numbers[7]
    if (magic, version, zero) != (_MAGIC, _VERSION, 0):
        raise DeviceError(
            f"the first 8 bytes are {data[:8]!r}; they must be TWNH, version {_VERSION}, hand, pedals and 0"
        )
    if hand > 1:
        raise DeviceError(f"hand is {hand}; it must be 0 (right) or 1 (left)")
    if pedals > _Pedal.CLUTCH + _Pedal.CAMERA:
        raise DeviceError(
            f"pedals are {pedals}; they must be the sum of {_Pedal.CLUTCH:d} (clutch) and {_Pedal.CAMERA:d} (camera)"
        )
    pose = handle_pose(p, q)
    clutch = bool(pedals & _Pedal.CLUTCH)
    camera = bool(pedals & _Pedal.CAMERA)
    return HandState(hand, clutch, camera, number, pose, grip_angle(grip))


def handle_pose(p: Sequence[float], q: Sequence[float]) -> Array:
    """Return the pose (4, 4) of a handle in {H} from its position p (3,) in m and quaternion q (4,), w first.

    Raises:
        DeviceError: a number is implausible; the message names the field, its value and its limit.
    """
    # NaN and infinity fail these comparisons.
    for axis, x in zip("xyz", p, strict=True):
        # `not <=` instead of `>`: NaN must be refused as well
        if not abs(x) <= _LARGEST_COORDINATE:
            raise DeviceError(f"position {axis} is {x:g} m; it must be within ±{_LARGEST_COORDINATE:g} m")
    length = math.hypot(*q)
    if not abs(length - 1) <= _QUATERNION_TOLERANCE:
        raise DeviceError(f"the quaternion has length {length:g}; it must be 1 ± {_QUATERNION_TOLERANCE:g}")
    return spatial.pose(spatial.matrix_from_quat_wxyz(q), p)


def grip_angle(grip: float) -> float:
    """Return the angle of a gripper in rad.

    Raises:
        DeviceError: the angle is implausible.
    """
    if not abs(grip) <= _LARGEST_GRIP:
        raise DeviceError(f"gripper is {grip:g} rad; it must be within ±{_LARGEST_GRIP:.4g} rad")
    return grip


class Packets(ReceivedHands):
    """Hands whose states arrive as packets, in addition to states that are passed to `give`."""

    def read(self, data: bytes) -> HandState:
        """Return the hand state in a packet, to be passed to `give`; count a malformed packet in `<device>.ignored`.

        Raises:
            DeviceError: the packet is malformed, see `unpack`.
        """
        try:
            return unpack(data)
        except DeviceError:
            self._ignored += 1
            raise

    def answer(self, hand: int, force: ArrayLike) -> bytes:
        """Return the packet with a force (3,) in {H} in N, to be sent to a hand."""
        last = self._last_states[hand]
        number = last.number if last else 0
        return FORCE.pack(_ANSWER, _VERSION, hand, 0, 0, number, *np.asarray(force, float))
