"""Packets of the Interoperable Telerobotics Protocol, as the software of the Raven-II receives them.

A packet has 124 bytes, little-endian, without gaps; where a field has two parts, the first is for arm 0, the second for
arm 1:

| byte | type | what |
|---|---|---|
| 0, 4, 8 | uint32 | sequence number, packet type, version |
| 12, 20, 28 | 2 int32 each | increments of the tool's position along x, y, z of base, µm |
| 36, 52, 68, 84 | 2 float64 each | x, y, z, w of the quaternion of the tool's rotation in base; all 0: no rotation |
| 100 | 2 int32 | buttons, not used |
| 108 | 2 int32 | increments of the opening of the jaws |
| 116 | int32 | surgeon mode: 1 pedal down, 0 up |
| 120 | int32 | checksum: surgeon mode + all six increments + both buttons + sequence number, modulo 2^32 |

Layout and checksum are those of uw-biorobotics/raven2. The checksum covers neither quaternions nor jaws, and the
released software does not check it. ASSUMED: increments are along the axes of {base}.
"""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

import numpy as np

from twin.core.errors import DeviceError
from twin.core.spatial import Array

PACKET = struct.Struct("<3I6i8d6i")
"""Layout of a packet: 23 numbers in 124 bytes, in the order of the table."""

_SEQUENCE_FIELD = struct.Struct("<I")
"""Layout of its first number, the sequence number."""

FIELDS = ("x", "y", "z", "qw", "qx", "qy", "qz", "grasp", "pedal")
"""Names of the numbers of `Packet.values`."""

_INT32_RANGE = 2**31
"""A signed 32-bit number is from minus this number to this number, less one."""

_CYCLE = 2**32 - 1
"""Number of sequence numbers in a cycle: 1 to 2^32 - 1, then 1 again; 0 is left out, because it asks for an answer."""

_QUATERNION_TOLERANCE = 1e-3
"""Largest accepted difference of a quaternion's length from 1."""


class Packet(NamedTuple):
    """The part of a packet that concerns one arm.

    Attributes:
        sequence: sequence number.
        values: (9,) see `FIELDS`: increments in µm, quaternion, increment of the jaws, pedal.
    """

    sequence: int
    values: Array


def checksum(numbers: tuple[float, ...]) -> int:
    """Return the checksum of a packet, computed from its first 22 numbers, as a signed 32-bit number."""
    sequence = numbers[0]
    increments = numbers[3:9]
    buttons = numbers[17:19]
    surgeon_mode = numbers[21]
    total = int(surgeon_mode + sum(increments) + sum(buttons) + sequence)
    return (total + _INT32_RANGE) % (2 * _INT32_RANGE) - _INT32_RANGE


def pack(sequence: int, arm: int, values: Array, version: int = 0) -> bytes:
    """Return the 124 bytes of a packet with the values (9,) of one arm; the other arm gets no increments."""
    x, y, z, qw, qx, qy, qz, grasp, pedal = values
    # One row a field, one column an arm: the packet interleaves the arms, and its quaternion ends in w.
    increments = np.zeros((3, 2))
    increments[:, arm] = x, y, z
    quaternions = np.zeros((4, 2))
    quaternions[:, arm] = qx, qy, qz, qw
    quaternions[3, 1 - arm] = 1.0  # w of the other arm: no rotation
    jaws = [0, 0]
    jaws[arm] = int(grasp)
    steps = map(int, increments.ravel())
    numbers = (sequence, 0, version, *steps, *quaternions.ravel().tolist(), 0, 0, *jaws, int(pedal))
    return PACKET.pack(*numbers, checksum(numbers))


def number_of(count: int) -> int:
    """Return the sequence number of the `count`-th packet of a sender; `count` is 1, 2, ... without limit."""
    return (count - 1) % _CYCLE + 1


def ahead(sequence: int, previous: int) -> int:
    """Return how many packets `sequence` comes after `previous`; the result is negative if it comes before `previous`.

    As in serial number arithmetic (RFC 1982), the shorter way around the cycle counts: 1 is one packet after 2^32 - 1.
    """
    half = _CYCLE // 2
    return (sequence - previous + half) % _CYCLE - half


def sequence_of(data: bytes) -> int:
    """Return the sequence number of a packet without checking the packet; 0 if the packet is too short to have one."""
    if len(data) < _SEQUENCE_FIELD.size:
        return 0
    return _SEQUENCE_FIELD.unpack_from(data)[0]


def renumbered(data: bytes, sequence: int) -> bytes:
    """Return the packet with another sequence number (modulo 2^32) and the matching checksum."""
    numbers = (sequence % 2**32, *PACKET.unpack(data)[1:22])
    return PACKET.pack(*numbers, checksum(numbers))


def unpack(data: bytes, arm: int, version: int) -> Packet:
    """Return the part of a packet for one arm (0 or 1).

    Raises:
        DeviceError: length, version, checksum, pedal or a quaternion is wrong; the message has value and limit.
    """
    if len(data) != PACKET.size:
        raise DeviceError(f"the packet has {len(data)} bytes; it must have {PACKET.size}")
    numbers = PACKET.unpack(data)
    if numbers[2] != version:
        raise DeviceError(f"the version is {numbers[2]}; it must be {version}")
    expected = checksum(numbers)
    if numbers[22] != expected:
        raise DeviceError(f"the checksum is {numbers[22]}; it must be {expected}")
    surgeon_mode = numbers[21]
    if surgeon_mode not in (0, 1):
        raise DeviceError(f"the surgeon mode is {surgeon_mode}; it must be 0 (pedal up) or 1 (pedal down)")
    increments = numbers[3 + arm : 9 : 2]  # every other number is for this arm
    x, y, z, w = numbers[9 + arm : 17 : 2]
    length = math.hypot(x, y, z, w)
    if length == 0:
        w = 1.0  # all 0: no rotation
        length = 1.0
    elif not abs(length - 1) <= _QUATERNION_TOLERANCE:
        raise DeviceError(
            f"the quaternion of arm {arm} has length {length:g}; it must be 1 ± {_QUATERNION_TOLERANCE:g}, or all 0"
        )
    quat_wxyz = (w / length, x / length, y / length, z / length)
    jaws = numbers[19 + arm]
    return Packet(numbers[0], np.array([*increments, *quat_wxyz, jaws, surgeon_mode], float))
