"""Hands over UDP: the layout, loss, order, delay, silence and hostile packets, through a real socket."""

from __future__ import annotations

import math
import socket
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from made import consoles
from made.alone import Alone
from twin.core import spatial
from twin.core.errors import DeviceError, TwinError, WorldError
from twin.core.units import DEG, MM
from twin.simulation.controllers.pedals import CAMERA, FREE, Pedals
from twin.simulation.controllers.tool_following import HandPace
from twin.simulation.devices.packets import FORCE, HAND, Packets, pack, unpack
from twin.simulation.devices.recorded import Recorded
from twin.simulation.world import Signals, World
from twin.ui.headset.packet_socket import PacketSocket

NOTHING = Signals({"a.b": 0.0})
POSE = spatial.pose(spatial.exp_so3(np.array([0.1, -0.2, 0.3])), (0.01, 0.02, 0.03))


def take(device, data):
    """Pass a packet to a device; return why it is malformed, or None."""
    try:
        device.give(device.read(data))
    except DeviceError as error:
        return str(error)
    return None


def test_the_layout_is_the_documented_one():
    data = pack(1, 7, POSE, 0.4, clutch=True, camera=True, time=99)
    assert (HAND.size, FORCE.size, len(data)) == (84, 36, 84)
    assert data[:8] == b"TWNH\x01\x01\x03\x00"
    assert struct.unpack_from("<IQ", data, 8) == (7, 99)
    assert struct.unpack_from("<3d", data, 20) == pytest.approx((0.01, 0.02, 0.03))
    assert struct.unpack_from("<d", data, 76) == (0.4,)
    packet = unpack(data)
    assert np.allclose(packet.pose, POSE, atol=1e-15)
    assert (packet.hand, packet.number, packet.clutch, packet.camera, packet.grip) == (1, 7, True, True, 0.4)


def broken():
    good = pack(0, 1, POSE, 0.1)
    out = {"empty": b"", "short": good[:-1], "long": good + b"\0", "magic": b"XXXX" + good[4:]}
    for name, at, byte in (("version", 4, 2), ("hand", 5, 2), ("pedals", 6, 4), ("reserved", 7, 1)):
        out[name] = good[:at] + bytes([byte]) + good[at + 1 :]
    for name, at, value in (
        ("nan", 20, math.nan),
        ("infinite", 28, math.inf),
        ("far", 36, 1e300),
        ("quaternion", 44, 2.0),
        ("nan quaternion", 52, math.nan),
        ("gripper", 76, 1e9),
        ("nan gripper", 76, math.nan),
    ):
        out[name] = good[:at] + struct.pack("<d", value) + good[at + 8 :]
    return out


NAMED = {
    "empty": "the packet has 0 bytes; it must have 84",
    "short": "the packet has 83 bytes",
    "long": "the packet has 85 bytes",
    "magic": "they must be TWNH, version 1",
    "version": "they must be TWNH, version 1",
    "hand": "hand is 2; it must be 0 (right) or 1 (left)",
    "pedals": "pedals are 4",
    "reserved": "hand, pedals and 0",
    "nan": "position x is nan m; it must be within ±10 m",
    "infinite": "position y is inf m",
    "far": "position z is 1e+300 m",
    "quaternion": "the quaternion has length",
    "nan quaternion": "the quaternion has length nan; it must be 1 ± 0.001",
    "gripper": "gripper is 1e+09 rad; it must be within ±6.283 rad",
    "nan gripper": "gripper is nan rad",
}


@pytest.mark.parametrize("name", NAMED)
def test_a_broken_packet_changes_nothing_and_is_counted(name):
    device = Packets("pedals")
    take(device, pack(0, 0, POSE, 0.1))
    before = device.step(NOTHING, 0.0, 1e-3)
    assert NAMED[name] in take(device, broken()[name])
    after = device.step(NOTHING, 0.0, 1e-3)
    assert after["pedals.ignored"] == 1
    assert all(np.array_equal(after[k], before[k]) for k in before if k != "pedals.ignored")


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=100) | st.binary(min_size=76, max_size=76).map(lambda b: b"TWNH\x01\x00\x00\x00" + b))
def test_no_bytes_break_the_device(data):
    device = Packets("pedals")
    take(device, data)
    wrote = device.step(NOTHING, 0.0, 1e-3)
    assert all(np.isfinite(v).all() for v in wrote.values())
    assert spatial.is_pose(np.reshape(wrote["right.pose"], (4, 4)), 1e-9)


def numbers(*sent, t=0.0):
    """Return position x, lost and ignored after packets with these numbers, whose x is their number in um."""
    device = Packets("pedals")
    for n in sent:
        take(device, pack(0, n, spatial.pose(None, (n % 2**32 * 1e-10, 0, 0)), 0.0))
    wrote = device.step(NOTHING, t, 1e-3)
    return round(wrote["right.pose"][3] / 1e-10), wrote["right.lost"], wrote["pedals.ignored"]


@pytest.mark.parametrize(
    ("sent", "found"),
    [
        ((1, 2, 3), (3, 0, 0)),
        ((1, 4), (4, 2, 0)),
        ((1, 3, 2), (3, 1, 1)),
        ((5, 5), (5, 0, 1)),
        ((2**32 - 1, 0), (0, 0, 0)),
        ((1, 5000, 2), (2, 0, 1)),
    ],
    ids=["in order", "lost", "late", "twice", "wraps", "a number far ahead does not lock the hand out"],
)
def test_numbers_tell_loss_and_order(sent, found):
    assert numbers(*sent) == found


def test_a_silent_hand_is_told_until_it_is_heard_again():
    device = Packets("pedals", patience=0.25)
    assert device.outputs["pedals.silent"] == 1, "nobody is there yet"
    for hand in (0, 1):
        take(device, pack(hand, 10, POSE, 0.1))
    assert [device.step(NOTHING, t, 1e-3)["pedals.silent"] for t in (1.0, 1.25, 1.26)] == [0, 0, 1]
    for hand in (0, 1):  # a program that was started anew counts from 0 again
        take(device, pack(hand, 0, POSE, 0.1))
    assert device.step(NOTHING, 1.3, 1e-3)["pedals.silent"] == 0


def test_silence_is_no_tap_of_the_clutch():
    """A gap of 0.3 s, before which and in which the clutch is down, changes no arm; a tap afterwards does."""
    block = Alone(Pedals("pedals"), pedals__clutch=0, pedals__camera=1, pedals__silent=0)
    modes = []
    script = [(0, 1)] * 5 + [(0, 0)] * 5 + [(0, 1)] * 5 + [(1, 0)] * 2 + [(1, 1)] * 2 + [(1, 0)] * 2 + [(0, 0)] * 2
    for k, (clutch, silent) in enumerate([*script, (1, 0), (0, 0)]):
        wrote = block.step(0.01 * k, 0.01, pedals__clutch=clutch, pedals__silent=silent)
        modes.append((wrote["console.mode"], wrote["console.taps"]))
    assert [m for m, _ in modes[:16]] == [FREE] * 5 + [CAMERA] * 5 + [FREE] * 6
    assert [t for _, t in modes] == [0] * (len(modes) - 1) + [1]


@pytest.mark.parametrize("scale", [math.nan, math.inf, 0.0, -1.0])
def test_a_scale_that_is_none_is_ignored(scale):
    device = Packets("pedals", scale=0.3)
    device.rescale(scale)
    wrote = device.step(NOTHING, 0.0, 1e-3)
    assert (wrote["pedals.scale"], wrote["pedals.ignored"]) == (0.3, 1)
    device.rescale(0.7)
    assert device.step(NOTHING, 0.0, 1e-3)["pedals.scale"] == 0.7


def test_two_hands_are_needed():
    with pytest.raises(WorldError, match="'pedals' has 1 hands"):
        Packets("pedals", ("right",))


# -- real sockets ---------------------------------------------------------------------------------------------------


@pytest.fixture
def sender():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        s.settimeout(5)
        yield s


def test_a_force_comes_back_to_who_sent(sender):
    device = Packets("pedals")
    with PacketSocket(device) as packet_socket:
        sender.sendto(pack(1, 42, POSE, 0.0), ("127.0.0.1", packet_socket.port))
        while not packet_socket.pump(0.0):
            pass
        device.step(NOTHING, 0.0, 1e-3)
        packet_socket.answer(0, (9, 9, 9), 0.0)
        packet_socket.answer(1, (9, 9, 9), 1.0)  # it has been silent since
        packet_socket.answer(1, (0.5, -1.0, 2.0), 0.0)
        data, _ = sender.recvfrom(100)
    assert FORCE.unpack(data) == (b"TWNF", 1, 1, 0, 0, 42, 0.5, -1.0, 2.0)


def test_another_address_cannot_take_a_hand_over(sender):
    device = Packets("pedals")
    with PacketSocket(device) as packet_socket, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        told = []
        packet_socket.reports.tell = told.append
        here, there = (f"127.0.0.1:{s.getsockname()[1]}" for s in (sender, other))
        for s, n in ((sender, 1), (other, 2), (other, 3)):
            s.sendto(pack(0, n, POSE, 0.0), ("127.0.0.1", packet_socket.port))
        assert packet_socket.pump(0.0) == 1, "also of those that come at the same time"
        assert packet_socket.refused == 2
        assert told == [
            f"packets from {there} are ignored: {here} controls the right hand until it is silent for 0.25 s"
        ]
        device.step(NOTHING, 0.0, 1e-3)
        other.sendto(pack(0, 3, POSE, 0.0), ("127.0.0.1", packet_socket.port))
        assert packet_socket.pump(1.0) == 1
        assert packet_socket.refused == 2


def test_a_hand_does_not_begin_with_a_camera_pedal_that_is_pressed(sender):
    told = []
    with PacketSocket(Packets("pedals")) as packet_socket:
        packet_socket.reports.tell = told.append
        for number, camera in enumerate((True, True, False, True)):
            sender.sendto(pack(1, number, POSE, 0.0, camera=camera), ("127.0.0.1", packet_socket.port))
        assert packet_socket.pump(0.0) == 2
    assert len(told) == 1
    assert "the camera pedal was pressed in the first packet; release it once" in told[0]


def test_packets_are_shared_out_among_the_parts_of_a_step(sender):
    with PacketSocket(Packets("pedals")) as packet_socket:
        for number in range(10):
            sender.sendto(pack(0, number, POSE, 0.0), ("127.0.0.1", packet_socket.port))
        assert [packet_socket.pump(0.0, parts) for parts in (4, 3, 2, 1, 1)] == [3, 3, 2, 2, 0]


def test_a_flood_is_read_in_bounded_time_and_told_once(sender):
    told = []
    with PacketSocket(Packets("pedals")) as packet_socket:
        packet_socket.reports.tell = told.append
        for k in range(1000):
            sender.sendto(b"x" * (k % 200), ("127.0.0.1", packet_socket.port))
        read = []
        while packet_socket.device._ignored not in read:
            read.append(packet_socket.device._ignored)
            packet_socket.pump(0.0)
    assert max(np.diff(read)) <= 256
    assert len(told) == 1


def test_a_taken_port_is_told():
    with (
        PacketSocket(Packets("pedals")) as packet_socket,
        pytest.raises(TwinError, match=rf"127\.0\.0\.1:{packet_socket.port}.*0 for any"),
    ):
        PacketSocket(Packets("other"), packet_socket.port)


def through_the_network(hostile: bool, ticks=420, delay=100, lost=0.05):
    """Return two hands at 1 kHz through a socket, and how many packets of the right one never came in time.

    5 % are lost, all come 100 ms late and out of order, with garbage between them if asked.
    """
    rng = np.random.default_rng(4)
    due: dict[int, list[bytes]] = {}
    for k in range(ticks):
        t = k * 1e-3
        way = 40 * MM * np.array([np.sin(6 * t), np.cos(6 * t) - 1, np.sin(3 * t)])
        grip = 50 * DEG * np.sin(np.pi * min(t, 0.1) / 0.1)
        for hand in (0, 1):
            T = spatial.pose(spatial.rotation_z(0.3 * np.sin(5 * t)), np.add(consoles.START, way))
            if rng.random() >= lost:
                due.setdefault(k + delay + int(rng.integers(0, 8)), []).append(pack(hand, k, T, grip))
    device = Packets("pedals", scale=1.0)
    world: World = consoles.world(device)
    udp = socket.AF_INET, socket.SOCK_DGRAM
    with PacketSocket(device) as packet_socket, socket.socket(*udp) as s, socket.socket(*udp) as other:
        bad = list(broken().values())
        for k in range(ticks):
            for data in due.get(k, []):
                s.sendto(data, ("127.0.0.1", packet_socket.port))
            if hostile and k > delay + 20:  # garbage from the hand's own address, poses from another
                s.sendto(bad[k % len(bad)], ("127.0.0.1", packet_socket.port))
                s.sendto(pack(k % 2, k + 2**20, spatial.pose(None, (5, 5, 5)), 0.0), ("127.0.0.1", packet_socket.port))
                other.sendto(pack(k % 2, k + 5, spatial.pose(None, (5, 5, 5)), 0.0), ("127.0.0.1", packet_socket.port))
            packet_socket.pump(world.t)
            world.step()
        assert (packet_socket.refused > 250) == hostile
    came = [unpack(data) for k in sorted(due) if k < ticks for data in due[k]]
    order = [p.number for p in came if p.hand == 0]
    newest = np.maximum.accumulate(order)
    return world.recording(), int(newest[-1] - newest[0] + 1 - len(np.unique(newest)))


@pytest.fixture(scope="module", params=[False, True], ids=["bad network", "hostile"])
def received(request):
    return request.param, *through_the_network(request.param)


def test_no_jump_above_the_speed_limit(received):
    recording = received[1]
    for arm in ("one", "two"):
        goals = recording[f"{arm}.goal"].reshape(-1, 4, 4)
        assert recording[f"{arm}.follows"].any()
        assert np.linalg.norm(np.diff(goals[:, :3, 3], axis=0), axis=1).max() <= HandPace().speed * 1e-3 + 1e-12
        assert np.linalg.norm(goals[-1, :3, 3] - goals[0, :3, 3]) > 5 * MM, "and yet it follows"


def test_loss_and_hostile_packets_are_shown(received):
    hostile, recording, lost = received
    assert recording["right.lost"][-1, 0] == lost > 15
    assert (recording["pedals.ignored"][-1, 0] > 450) == hostile
    assert recording["pedals.silent"][:90].all(), "nobody is there before the first packet"
    assert not recording["pedals.silent"][200:].any()
    assert not recording["console.taps"].any(), "and that is no tap of the clutch"


def test_what_came_over_the_network_happens_again(received):
    hostile, recording, _ = received
    if not hostile:
        return  # the same, with less in it
    again = consoles.world(Recorded(recording, "right", "left", "pedals")).run()
    assert again.to_bytes() == recording.to_bytes()
