"""States that a machine sends by TCP, one per tick.

A state has 48 + 24 n bytes for n joints, little-endian:

| byte | type | what |
|---|---|---|
| 0 | 4 bytes | "TWNM" |
| 4 | 4 uint8 | version (1), run level (0 E_STOP, 1 INIT, 2 PEDAL_UP, 3 PEDAL_DN), pedal of the master (0, 1), n |
| 8 | uint64 | number of the tick |
| 16 | float64 | time of the machine in s |
| 24 | 3 uint32 | sequence number of the last packet, packets accepted, packets refused |
| 36 | 2 uint32 | packets whose target was out of reach, ticks that began more than one tick late |
| 44 | uint32 | 0 |
| 48 | n float64 | joint values that the encoders measure, rad or m |
| 48 + 8 n | n float64 | desired joint values |
| 48 + 16 n | n float64 | counts of the DAC |
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from twin.core.errors import DeviceError
from twin.core.spatial import Array
from twin.simulation.machine.levels import Level

HEAD = struct.Struct("<4s4BQd6I")

MAGIC = b"TWNM"
VERSION = 1

_ROWS = 3
"""Number of values of each joint in a state: measured joint value, desired joint value, counts of the DAC."""


@dataclass(frozen=True)
class State:
    """State of a machine with n joints.

    Attributes:
        level: run level.
        pedal: whether the pedal of the master is down.
        tick, t: number of the tick, and time of the machine in s.
        sequence: sequence number of the last packet.
        accepted, refused: number of packets so far.
        held: number of packets whose target was out of reach.
        late: number of ticks that began more than one tick late.
        q: (n,) joint values that the encoders measure, rad or m.
        wanted: (n,) desired joint values.
        dac: (n,) counts of the DAC.
    """

    level: Level
    pedal: bool
    tick: int
    t: float
    sequence: int
    accepted: int
    refused: int
    held: int
    late: int
    q: Array
    wanted: Array
    dac: Array


def pack(state: State) -> bytes:
    """Return a state as bytes."""
    counts = (state.sequence, state.accepted, state.refused, state.held, state.late, 0)
    uint32 = [count % 2**32 for count in counts]  # a long run counts from 0 again
    head = HEAD.pack(MAGIC, VERSION, state.level, state.pedal, len(state.q), state.tick, state.t, *uint32)
    rows = np.concatenate([state.q, state.wanted, state.dac])
    return head + rows.astype("<f8").tobytes()


def size(n: int) -> int:
    """Return the number of bytes of a state of n joints."""
    return HEAD.size + 8 * _ROWS * n


def unpack(data: bytes, n: int) -> State:
    """Return the state of a machine with n joints.

    Raises:
        DeviceError: length, first four bytes, version, number of joints, run level or a number is wrong; the message
            has value and limit.
    """
    if len(data) < HEAD.size:
        raise DeviceError(f"a state has {len(data)} bytes; {size(n)} are expected for {n} joints")
    magic, version, level, pedal, joints, tick, t, sequence, accepted, refused, held, late, _ = HEAD.unpack_from(data)
    if magic != MAGIC:
        raise DeviceError(f"a state begins with {magic!r}; it must begin with {MAGIC!r}: is this the port of states?")
    if version != VERSION:
        raise DeviceError(f"the states have version {version}; this twin reads version {VERSION}")
    if joints != n:
        raise DeviceError(f"the machine has {joints} joints; the robot has {n}")
    if len(data) != size(n):
        raise DeviceError(f"a state has {len(data)} bytes; {size(n)} are expected for {n} joints")
    if level > max(Level):
        raise DeviceError(f"the run level is {level}; it must be 0 to {max(Level).value}")
    numbers = np.frombuffer(data, "<f8", _ROWS * n, HEAD.size).astype(float)
    if not (np.isfinite(numbers).all() and np.isfinite(t)):
        raise DeviceError(f"a value in the state of tick {tick} is not finite")
    rows = numbers.reshape(_ROWS, n)
    return State(Level(level), bool(pedal), tick, t, sequence, accepted, refused, held, late, *rows)
