"""The robots of `twin serve davinci` under UDP packets instead of a page: nothing moves by surprise."""

from __future__ import annotations

import asyncio
import json
import logging
import time

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from made.pens import SIDES, Pens
from made.streaming import joined, serving
from twin.cli import main
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.units import MM
from twin.simulation import console_scene
from twin.simulation.controllers.console_equations import LARGEST, STIFFNESS
from twin.simulation.controllers.tool_following import HandPace
from twin.simulation.devices.packets import pack
from twin.ui.headset import packet_socket, served_content
from twin.ui.headset.client_messages import RefusedError, parse_message
from twin.ui.headset.console_stream import ConsoleStream
from twin.ui.session import console_state, live_console
from twin.ui.session.timeline import TICK_RATE

WORLD = console_scene.world
ARMS = {"right": "psm1", "left": "psm2"}


class Running:
    """A stream of a console with a socket, pens that send to it, and the time that passes."""

    def __init__(self, op):
        self.op, self.tick, self.told = op, 0, []
        op.send = self.told.append
        op.listen("127.0.0.1", 0)
        op.frame(0, 0.0)
        self.pens = Pens(op.packets.socket.port)
        self.wait(1 / TICK_RATE, sends=False)  # the first ticks round the joints

    def wait(self, seconds, sends=True):
        """Let time pass; the pens send a packet each for every tick of the World."""
        for _ in range(round(seconds * TICK_RATE)):
            for _ in range(16 if sends else 0):
                self.pens.send()
            self.tick += 1
            self.op.frame(self.tick, 0.0)
        return self

    def start(self):
        self.wait(0.05)
        self.pens.roll()
        return self.wait(0.1)

    def move(self, side, way, seconds=0.4):
        steps = round(seconds * TICK_RATE)
        for _ in range(steps):
            self.pens.p[side] = self.pens.p[side] + np.array(way) / steps
            self.wait(1 / TICK_RATE)
        return self.wait(0.2)

    @property
    def state(self):
        return self.op.state()["console"]

    def q(self):
        return np.concatenate([self.op.world.signals[f"{n}.q"] for n in ("psm1", "psm2", "ecm")])

    def messages(self):
        return [d["message"] for d in self.told]


@pytest.fixture
def running(bare_theatre, monkeypatch):
    monkeypatch.setattr(live_console, "_STEPPING_TIME", np.inf)  # a busy machine does not make the World late
    found = Running(ConsoleStream(bare_theatre))
    yield found
    found.op.close()
    found.pens.close()


def page(client="c1", number=1, x=0.3):
    def hand(x):
        return {"pose": [x, 0.0, 0, 0, 0, 0, 1], "grip": 0.0}

    both = {"right": hand(x), "left": hand(-x)}
    text = json.dumps({"type": "hands", "number": number, **both, "clutch": False, "camera": False})
    return client, parse_message(text)


# -- motion by packets ------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_packets_move_both_instruments_and_the_page_says_so(running):
    q = running.q()
    running.start()
    assert np.allclose(running.q(), q, atol=1e-12), "the roll that shows that somebody is there moves nothing"
    T = {n: running.op.world.signals[f"{n}.goal"].reshape(4, 4) for n in ARMS.values()}
    for side in SIDES:
        running.move(side, (6 * MM, -4 * MM, 0))
    R_world_view = running.op.world.signals["ecm.view"].reshape(4, 4)[:3, :3]
    for name, before in T.items():
        way = (running.op.world.signals[f"{name}.goal"].reshape(4, 4) - before)[:3, 3]
        place = running.op._places[name].T_world_base[:3, :3]
        assert np.allclose(R_world_view.T @ place @ way, (3 * MM, -2 * MM, 0), atol=1e-6)
    state = running.state
    assert state["owner"] == "udp"
    assert [state["hands"][s]["follows"] for s in SIDES] == [True, True]
    assert state["packets"] == {
        "port": running.op.packets.socket.port,
        "from": dict.fromkeys(SIDES, running.pens.name),
        "lost": {"right": 0, "left": 0},
        "ignored": 0,
    }
    assert not running.told


def test_the_hands_have_one_owner_at_a_time(running):
    running.start()
    with pytest.raises(RefusedError, match="udp controls the hands of the console"):
        running.op.ask(*page())
    running.wait(0.3, sends=False)
    q = running.q()
    for k in range(12):
        running.op.ask(*page(number=k))
        running.wait(1 / TICK_RATE, sends=k > 2)
    assert running.state["owner"] == "c1"
    assert running.messages() == [
        f"packets from {running.pens.name} are ignored: c1 controls the hands; release them there"
    ], "told once, not for each packet"
    assert running.state["packets"]["ignored"] == 2 * 9 * 16
    assert running.state["packets"]["from"] == {"right": None, "left": None}
    assert running.state["packets"]["lost"] == {"right": 0, "left": 0}
    running.op.release("c1")
    running.wait(0.1)
    assert running.state["owner"] == "udp"
    assert np.allclose(running.q(), q, atol=1e-9), "which hands are in control changes nothing"
    assert running.state["packets"]["lost"] == {"right": 0, "left": 0}, "each counts from its own number"


# -- nothing by surprise --------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_silence_stops_everything_and_hands_take_hold_anew(running, monkeypatch, caplog):
    monkeypatch.setattr(packet_socket, "_SILENCE_TIMEOUT", 1.0)
    running.start().move("right", (0.01, 0, 0))
    with caplog.at_level(logging.WARNING):
        running.wait(0.4, sends=False)
    assert "no state of the hands was received for 0.25 s: nothing moves" in caplog.text
    assert running.state["silent"]
    q = running.q()
    running.pens.p["right"] = running.pens.p["right"] + (0, 0.05, 0)
    running.wait(0.3)
    assert not running.state["silent"]
    assert np.allclose(running.q(), q, atol=1e-9)
    running.wait(1.2, sends=False)
    assert running.state["owner"] is None, "a program that has ended leaves the hands"


def test_one_hand_alone_moves_nothing(running):
    q = running.q()
    for k in range(30):
        running.pens.p["right"][0] += 1e-3
        running.pens.R["right"] = spatial.rotation_z(0.02 * k)
        running.pens.send(running.pens.packets()[0])
        running.wait(1 / TICK_RATE, sends=False)
    assert np.array_equal(running.q(), q)
    assert running.state["silent"]
    assert running.state["packets"]["from"] == {"right": running.pens.name, "left": None}


def test_a_pose_that_jumps_is_told_and_moves_nothing(running):
    running.start()
    q = running.q()
    running.pens.p["left"] = running.pens.p["left"] + (0.05, 0, 0)
    running.wait(0.2)
    assert np.allclose(running.q(), q, atol=1e-9)
    assert running.messages() == ["the left hand jumped: psm2 ignores the jump and follows from the new pose"]


def test_a_malformed_packet_is_told_by_what_is_wrong_and_changes_nothing(running, caplog):
    running.start()
    q = running.q()
    nan = spatial.pose(None, (np.nan, 0, 0))
    with caplog.at_level(logging.WARNING):
        for _ in range(10):
            running.pens.send(pack(0, 10**6, nan, 0.0), b"garbage")
            running.wait(1 / TICK_RATE)
    told = f"a packet from {running.pens.name} is ignored: position x is nan m; it must be within ±10 m"
    assert running.messages() == [told]
    assert told in caplog.text
    assert running.state["packets"]["ignored"] == 20
    assert np.array_equal(running.q(), q)


def test_a_gripper_out_of_range_is_told(running):
    running.start()
    running.pens.send(pack(1, 10**6, np.eye(4), 7.0))
    running.wait(1 / TICK_RATE)
    assert running.messages()[0].endswith("gripper is 7 rad; it must be within ±6.283 rad")


def test_a_camera_pedal_that_is_stuck_at_the_start_moves_nothing(running):
    q, running.pens.camera = running.q(), True
    running.move("right", (0.02, 0.01, 0), 0.1)
    assert np.array_equal(running.q(), q)
    assert len(running.told) == 1
    assert "the camera pedal was pressed in the first packet; release it once" in running.messages()[0]
    running.pens.camera = False
    running.start()
    running.pens.camera = True
    running.move("right", (0.02, 0.01, 0), 0.1)
    assert running.state["mode"] == "camera"
    assert not np.array_equal(running.q(), q)


@pytest.mark.slow
@pytest.mark.parametrize("pedal", ["clutch", "camera"])
def test_a_pedal_that_stays_pressed_is_told(running, monkeypatch, caplog, pedal):
    monkeypatch.setattr(console_state, "_STUCK_PEDAL_TIME", 0.3)
    running.start()
    setattr(running.pens, pedal, True)
    with caplog.at_level(logging.WARNING):
        running.wait(0.25)
        assert running.state["pedal"] is None
        running.wait(0.2)
    said = f"the {pedal} pedal has been pressed for 0.3 s: release it if it is stuck"
    assert running.state["pedal"] == said
    assert caplog.text.count(said) == 1
    setattr(running.pens, pedal, False)
    running.wait(0.1)
    assert running.state["pedal"] is None


@pytest.mark.slow
def test_a_limit_is_felt_as_a_surface(running):
    running.start()
    running.pens.forces()
    forces = running.move("right", (0, 0, 0.004), 0.1).pens.forces()
    assert 90 < len(forces) / 2 < 130, "one for each tick"
    assert {hand for hand, _ in forces} == {0, 1}
    assert not any(force.any() for _, force in forces), "nothing is felt where the tools follow"
    running.move("right", (0, 0, -0.23), 0.4)  # into the patient
    assert running.state["hands"]["right"]["wall"] == "q3 is at its limit, 240 mm"
    running.pens.forces()  # the oldest ones: the buffer of the socket is full
    last = dict(running.wait(0.05).pens.forces())
    signals, place, member = running.op.world.signals, running.op._places["psm1"], running.op.members["psm1"]
    beyond = signals["psm1.goal"].reshape(4, 4) - member.kin.forward(signals["psm1.q"])
    R_world_view = signals["ecm.view"].reshape(4, 4)[:3, :3]
    way = R_world_view.T @ place.T_world_base[:3, :3] @ beyond[:3, 3]
    depth = np.linalg.norm(way)
    assert depth > 1 * MM
    assert np.allclose(last[0], -min(STIFFNESS * depth, LARGEST) * way / depth, atol=1e-6), "back to where the tool is"
    assert not last[1].any()
    running.move("right", (0, 0, 0.23), 0.4).pens.forces()
    assert not dict(running.wait(0.05).pens.forces())[0].any()


@pytest.mark.slow
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.binary(max_size=100)
        | st.binary(min_size=76, max_size=76).map(lambda b: b"TWNH\x01\x00\x00\x00" + b)
        | st.builds(
            lambda n, x: pack(n % 2, n, spatial.pose(None, (x, 0, 0)), x), st.integers(0, 2**32), st.floats(width=64)
        ),
        max_size=20,
    )
)
def test_no_packets_of_strangers_move_anything(running, packets):
    if running.tick == 0:
        running.start()
    stranger = Pens(running.op.packets.socket.port)
    before, ignored = running.q(), running.state["packets"]["ignored"]
    stranger.send(*packets) if packets else None
    stranger.close()
    running.wait(2 / TICK_RATE)
    assert np.array_equal(running.q(), before)
    assert running.state["packets"]["ignored"] == ignored + len(packets)
    assert running.state["packets"]["from"]["right"] == running.pens.name


# -- figures --------------------------------------------------------------------------------------------------------


def session(running, ticks=700, delay=100, lost=0.05):
    """Move both tools at 1 kHz for some ticks: 5 % are lost, all come 100 ms late, out of order by up to 7 ms.

    Return how many packets of each hand never came in time.
    """
    rng, pens = np.random.default_rng(4), running.start().pens
    first, begin = pens.number, running.tick
    due: dict[int, list[bytes]] = {}
    start = {side: pens.p[side].copy() for side in SIDES}
    for k in range(ticks):
        t = k * 1e-3
        for side in SIDES:
            pens.p[side] = start[side] + 30 * MM * np.array([np.sin(12 * t), np.cos(12 * t) - 1, 0.5 * np.sin(6 * t)])
            pens.R[side] = spatial.rotation_z(0.1 + 0.3 * np.sin(5 * t))
        for data in pens.packets():
            if rng.random() >= lost:
                due.setdefault(k + delay + int(rng.integers(0, 8)), []).append(data)
    came = [data for k in sorted(due) for data in due[k]]
    for k in range(ticks + delay + 8):
        if k in due:
            pens.send(*due[k])
        if (tick := begin + int((k + 1) * 1e-3 * TICK_RATE)) > running.tick:
            running.tick = tick
            running.op.frame(tick, 0.0)
    running.wait(3 / TICK_RATE, sends=False)
    missed = []
    for hand in (0, 1):
        numbers = [int.from_bytes(data[8:12], "little") for data in came if data[5] == hand]
        newest = np.maximum.accumulate(numbers)
        missed.append(int(newest[-1] - first - len(np.unique(newest))))
    return missed


@pytest.mark.slow
def test_a_bad_network_makes_no_tool_jump_and_its_loss_is_shown(bare_theatre, monkeypatch):
    monkeypatch.setattr(live_console.console_scene, "world", lambda *a, **k: WORLD(*a, **{**k, "records": True}))
    monkeypatch.setattr(live_console, "_STEPPING_TIME", np.inf)
    running = Running(ConsoleStream(bare_theatre))
    lost = session(running)
    state, recording = running.state, running.op.world.recording()
    running.op.close()
    running.pens.close()
    assert list(state["packets"]["lost"].values()) == lost
    assert min(lost) > 45, "5 % and those that come too late"
    for name in ARMS.values():
        kin, goals = bare_theatre.robots[name].kinematics(), recording[f"{name}.goal"].reshape(-1, 4, 4)
        tool = np.array([kin.forward(q)[:3, 3] for q in recording[f"{name}.q"]])
        wanted, reached = (np.linalg.norm(np.diff(p, axis=0), axis=1).max() / 1e-3 for p in (goals[:, :3, 3], tool))
        limit = HandPace().speed * (1 + 1e-9)
        assert 0.9 * limit < wanted < limit, "packets that come together are faster than the limit"
        assert reached < limit
        assert np.linalg.norm(tool - tool[0], axis=1).max() > 5 * MM, "and yet it follows"
        assert not recording[f"{name}.jumps"].any()


def test_through_the_server(bare_theatre):
    """A program at 1 kHz moves the hands through the running server; a page watches, and takes over when it ends."""

    async def go():
        async with serving(lambda: served_content.of_console(bare_theatre, packets=("127.0.0.1", 0))) as s:
            pens = Pens(s.live.packets.socket.port)
            async with joined(s.port) as peer:
                start = peer.frames[-1].robots[0].q
                begin, sent = time.monotonic(), 0
                while sent < 60_000:  # until it moves and the page knows it: a busy machine is slow
                    while sent < 1000 * (time.monotonic() - begin):
                        sent += 1
                        pens.p["right"] = np.array([0.08 + 0.02 * np.sin(5e-3 * sent), 0, 0])
                        if sent == 300:
                            pens.roll()
                        packets = pens.packets()
                        if sent % 20:
                            pens.send(*packets)
                    await asyncio.sleep(0.001)
                    moved = np.abs(peer.frames[-1].robots[0].q - start).max() > 1e-2
                    console = peer.last("state")["console"]
                    lost = min(console["packets"]["lost"].values())
                    if sent > 1000 and moved and console["hands"]["right"]["follows"] and lost > 20:
                        break
                console = peer.last("state")["console"]
                assert console["owner"] == "udp"
                assert console["hands"]["right"]["follows"]
                assert console["packets"]["from"]["right"] == pens.name
                assert min(console["packets"]["lost"].values()) > 20
                assert len(pens.forces()) > 50
                _, hands = page()
                said = {**json.loads(hands.model_dump_json(exclude={"id", "type"}))}
                pens.send(*pens.packets())
                answer = await peer.ask("hands", **said)
                assert (answer["type"], answer["code"]) == ("error", "held")
                await peer.until(lambda: peer.last("state")["console"]["silent"])
                pens.close()
                await peer.say("hands", **said)
                await peer.until(lambda: peer.last("state")["console"]["owner"] == peer.last("hello")["client"])

    asyncio.run(go())


# -- the command ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_port_that_is_taken_is_told(running, capsys):
    port = running.op.packets.socket.port
    assert main(["serve", "davinci", "--no-browser", "--port", "0", "--packets", str(port)]) == 2
    assert f"cannot listen for packets on 127.0.0.1:{port}: Address already in use" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["davinci", "--packets", "70000"], "70000 is not a port"),
        (["davinci", "--mqtt", ":1883"], "has no host"),
        (["davinci", "--mqtt", "localhost:x"], "x is not a port"),
        (["davinci", "--mqtt", "localhost:0"], "port 0 is not the port of a broker"),
        (["davinci", "--mqtt", "::1"], "give an address of IPv6 in brackets, as [::1]"),
        (["davinci", "--mqtt-topic", "a"], "--mqtt-topic requires --mqtt"),
        (["davinci", "--mqtt", "localhost", "--mqtt-topic", "a/#"], "--mqtt-topic 'a/#' is not a valid topic"),
        (["sils", "--packets", "9870"], "--packets requires a scene with a console, such as davinci; sils is a robot"),
        (["vsrs", "--protocols", "--mqtt", "localhost"], "--mqtt and --protocols cannot be combined"),
        (["davinci", "--packets", "9870", "--replay", "x.json"], "--packets and --replay cannot be combined"),
    ],
)
def test_wrong_options_are_named(arguments, text, capsys):
    assert main(["serve", *arguments, "--no-browser", "--port", "0"]) == 2
    assert text in capsys.readouterr().err


def test_an_operation_that_cannot_listen_leaves_nothing_open(bare_theatre, running):
    with pytest.raises(TwinError, match="cannot listen for packets"):
        served_content.of_console(bare_theatre, packets=("127.0.0.1", running.op.packets.socket.port))
