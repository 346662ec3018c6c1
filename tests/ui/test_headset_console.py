"""The robots of a scene under hands that come through the stream: they move it, and nothing else moves by surprise."""

from __future__ import annotations

import asyncio
import json
import logging
import re
import time
from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from made.scene_text import refused
from made.streaming import joined, serving
from twin.cli import main
from twin.core import spatial
from twin.core.errors import DescriptionError, TwinError, WorldError
from twin.core.units import DEG, MM
from twin.model.scene import load_scene
from twin.simulation import console_scene
from twin.simulation.controllers.camera import at_of_view, view
from twin.simulation.setup import Setup
from twin.ui.headset import console_stream, served_content, server
from twin.ui.headset import stream_frames as wire
from twin.ui.headset.client_messages import (
    DragMessage,
    GrabMessage,
    PlayMessage,
    RefusedError,
    ScaleMessage,
    parse_message,
)
from twin.ui.headset.console_stream import ConsoleStream
from twin.ui.headset.scene_frame import pack_scene, unpack_scene
from twin.ui.session import live_console
from twin.ui.session.timeline import TICK_RATE

SIDES = ("right", "left")


class Hands:
    """A client: its hands, what it is told, and the time that passes."""

    def __init__(self, op, client="c1"):
        self.op, self.client, self.number, self.tick = op, client, 0, 0
        self.p = {"right": np.array([0.08, 0, 0]), "left": np.array([-0.08, 0, 0])}
        self.R = {side: np.eye(3) for side in SIDES}
        self.grip = dict.fromkeys(SIDES, 0.0)
        self.clutch = self.camera = False
        self.told = []
        op.send = self.told.append

    def message(self):
        def hand(side):
            pose = wire.sevens(spatial.pose(self.R[side], self.p[side])).tolist()
            return {"pose": pose, "grip": self.grip[side]}

        hands = {side: hand(side) for side in SIDES}
        self.number += 1
        return {"type": "hands", "number": self.number, **hands, "clutch": self.clutch, "camera": self.camera}

    def say(self, **instead):
        self.op.ask(self.client, parse_message(json.dumps(self.message() | instead)))

    def wait(self, seconds, speaks=True):
        """Let time pass, saying where the hands are; return the last frame."""
        for _ in range(round(seconds * TICK_RATE)):
            if speaks:
                self.say()
            self.tick += 1
            frame = self.op.frame(self.tick, 0.0) or None
        return frame

    def start(self, *sides):
        """Roll the handle, as the start rule wants it."""
        self.wait(0.05)
        for side in sides or SIDES:
            self.R[side] = self.R[side] @ spatial.rotation_z(5 * DEG)
        self.wait(0.1)
        return self

    def move(self, side, way, seconds=0.4):
        steps = round(seconds * TICK_RATE)
        for _ in range(steps):
            self.p[side] = self.p[side] + np.array(way) / steps
            self.wait(1 / TICK_RATE)
        self.wait(0.2)

    def state(self):
        return self.op.state()["console"]

    def q(self):
        return {n: self.op.world.signals[f"{n}.q"] for n in ("psm1", "psm2", "ecm")}

    def seen(self, name):
        """Return the pose (4, 4) of a tool in the picture."""
        place, member = self.op._places[name], self.op.members[name]
        T_world_view = self.op.world.signals["ecm.view"].reshape(4, 4)
        return spatial.inverse(T_world_view) @ place.T_world_base @ member.kin.forward(self.q()[name])


@pytest.fixture
def hands(bare_theatre, monkeypatch):
    monkeypatch.setattr(live_console, "_STEPPING_TIME", np.inf)  # a busy machine does not make the World late
    op = ConsoleStream(bare_theatre)
    op.frame(0, 0.0)
    return Hands(op)


def moved(before, after):
    return {n for n, q in after.items() if not np.allclose(q, before[n], atol=1e-12, rtol=0)}


# -- motion by hands --------------------------------------------------------------------------------------------------


def test_the_scene_begins_with_both_tips_in_the_picture_before_the_lens(hands):
    for name, x in (("psm1", 15), ("psm2", -15)):
        p = hands.seen(name)[:3, 3] / MM
        assert abs(p[0] - x) < 3
        assert abs(p[1]) < 10
        assert -95 < p[2] < -65
    ups = hands.op.world.signals["ecm.view"].reshape(4, 4)[:3, 1]
    assert ups[2] > 0.4, "up in the picture is up in the room"


def test_nothing_moves_until_somebody_shows_to_be_there(hands):
    before = hands.q()
    hands.wait(0.05)
    hands.move("right", (0.02, 0, 0))
    assert not moved(before, hands.q())
    assert not hands.state()["hands"]["right"]["follows"]
    hands.start("right")
    assert not moved(before, hands.q()), "the roll that shows it moves nothing"
    assert [hands.state()["hands"][s]["follows"] for s in SIDES] == [True, False]


@pytest.mark.slow
@pytest.mark.parametrize(("side", "robot"), [("right", "psm1"), ("left", "psm2")])
def test_a_tool_goes_in_the_picture_as_its_hand_does_and_turns_with_it(hands, side, robot):
    hands.start(side)
    before, T = hands.q(), hands.seen(robot)
    way = np.array([6, -4, 5]) * MM
    hands.move(side, way)
    assert moved(before, hands.q()) == {robot}
    assert np.allclose(hands.seen(robot)[:3, 3] - T[:3, 3], 0.5 * way, atol=1e-6)
    assert np.allclose(hands.seen(robot)[:3, :3], T[:3, :3], atol=1e-6)
    turn = spatial.exp_so3(np.array([0.0, 0.1, 0.2]))
    hands.R[side] = turn @ hands.R[side]
    hands.wait(0.3)
    assert np.allclose(hands.seen(robot)[:3, :3], turn @ T[:3, :3], atol=1e-6)
    hands.op.ask("c1", ScaleMessage(type="scale", value=0.1))
    hands.wait(0.1)
    p = hands.seen(robot)[:3, 3]
    hands.move(side, way)
    assert np.allclose(hands.seen(robot)[:3, 3] - p, 0.1 * way, atol=1e-6)
    assert hands.state()["scale"] == 0.1


def test_a_gripper_moves_its_jaw(hands):
    hands.start()
    before = hands.q()
    hands.grip["left"] = 30 * DEG
    hands.wait(1.5)
    assert hands.q()["psm2"][-1] == pytest.approx(30 / 60 * 80 * DEG, abs=1e-6)
    assert moved(before, hands.q()) == {"psm2"}


def test_the_camera_pedal_drags_the_picture_and_the_clutch_wins(hands):
    hands.start()
    before = hands.q()
    hands.camera = True
    for side in SIDES:
        hands.move(side, (0.02, 0.01, 0.01), 0.2)
    assert moved(before, hands.q()) == {"ecm"}
    assert hands.state()["mode"] == "camera"
    after, hands.clutch = hands.q(), True
    hands.wait(0.1)
    after = hands.q()
    hands.move("right", (0.02, 0.01, 0.01))
    assert not moved(after, hands.q())
    assert hands.state()["mode"] == "nothing"


def test_frames_show_where_the_links_are(hands, bare_theatre):
    hands.start()
    hands.move("right", (0.02, 0, 0))
    frame = unpack_scene(hands.op.frame(hands.tick + 10, 0.0))
    for place, part in zip(bare_theatre.scene.places, frame.robots, strict=True):
        links = bare_theatre.robots[place.name].reference().solve(hands.q()[place.name]).link_poses
        for body, pose in zip(bare_theatre.robots[place.name].mechanism.bodies, part.poses, strict=True):
            assert np.allclose(wire.pose_of(pose), links[body.name], atol=1e-6)
    assert hands.op.frame(hands.tick + 11, 0.0) is None, "what stands still is sent ten times a second"


# -- nothing by surprise --------------------------------------------------------------------------------------------


def test_a_silent_hand_stops_everything_and_takes_hold_anew(hands, caplog):
    hands.start()
    hands.move("right", (0.01, 0, 0))
    before = hands.q()
    with caplog.at_level(logging.WARNING):
        hands.wait(0.4, speaks=False)
    assert "no state of the hands was received for 0.25 s: nothing moves" in caplog.text
    assert hands.state()["silent"]
    assert hands.state()["mode"] == "nothing"
    hands.p["right"] = hands.p["right"] + (0.01, 0.02, 0)
    hands.wait(0.3)
    assert not hands.state()["silent"]
    assert all(np.allclose(q, before[n], atol=1e-9) for n, q in hands.q().items())
    hands.move("right", (0.01, 0, 0))
    assert moved(before, hands.q()) == {"psm1"}


def test_a_hand_that_jumps_is_told_and_moves_nothing(hands, caplog):
    hands.start()
    before = hands.q()
    hands.p["left"] = hands.p["left"] + (0.05, 0, 0)
    with caplog.at_level(logging.WARNING):
        hands.wait(0.2)
    assert all(np.allclose(q, before[n], atol=1e-9) for n, q in hands.q().items())
    (told,) = hands.told
    assert told["type"] == "error"
    assert told["message"] == "the left hand jumped: psm2 ignores the jump and follows from the new pose"
    assert told["message"] in caplog.text


def broken(change):
    message = {"type": "hands", "number": 1, "clutch": False, "camera": False}
    message |= {side: {"pose": [0.0, 0, 0, 0, 0, 0, 1], "grip": 0.0} for side in SIDES}
    change(message)
    return json.dumps(message)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda m: m["right"]["pose"].__setitem__(0, float("nan")), "hands.right.pose.0"),
        (lambda m: m["right"]["pose"].__setitem__(0, float("inf")), "hands.right.pose.0"),
        (lambda m: m["left"]["pose"].__setitem__(2, 11.0), "hands.left.pose.2"),
        (lambda m: m["left"]["pose"].__setitem__(6, 0.5), "quaternion x y z w must have length 1"),
        (lambda m: m["left"]["pose"].pop(), "hands.left.pose"),
        (lambda m: m["left"].__setitem__("grip", 7.0), "hands.left.grip: Input should be less than or equal to 6.28"),
        (lambda m: m["left"].__setitem__("grip", float("nan")), "hands.left.grip"),
        (lambda m: m.__setitem__("middle", m["left"]), "hands.middle"),
        (lambda m: m.pop("left"), "hands.left"),
        (lambda m: m.__setitem__("clutch", 1), "hands.clutch"),
        (lambda m: m.__setitem__("number", -1), "hands.number"),
    ],
)
def test_a_broken_message_is_refused_by_name(change, text):
    with pytest.raises(RefusedError) as found:
        parse_message(broken(change))
    assert found.value.code == "invalid"
    assert text in str(found.value)


@pytest.mark.parametrize(
    "message",
    [
        PlayMessage(type="play", on=True),
        GrabMessage(type="grab", target="tool", robot="psm1"),
        DragMessage(type="drag", value=1.0, robot="psm1"),
    ],
)
def test_nothing_else_moves_what_the_hands_move(hands, message):
    with pytest.raises(RefusedError, match="only the hands of the console control"):
        hands.op.ask("c1", message)


def test_one_client_has_the_hands_until_it_lets_go_or_is_silent(hands):
    hands.start()
    other = Hands(hands.op, "c2")
    other.p["right"] = np.array([0.3, 0.3, 0.3])
    with pytest.raises(RefusedError, match="c1 controls the hands"):
        other.say()
    with pytest.raises(RefusedError, match="c1 controls the hands"):
        hands.op.ask("c2", ScaleMessage(type="scale", value=0.1))
    before = hands.q()
    hands.op.release("c1")
    hands.op.ask("c2", ScaleMessage(type="scale", value=0.1))
    assert hands.op.owner is None, "who sets the scale has not taken the hands"
    other.tick = hands.tick
    other.wait(0.3)  # in the very next tick another one speaks: its hands are elsewhere
    assert other.state()["owner"] == "c2"
    assert all(np.allclose(q, before[n], atol=1e-9) for n, q in other.q().items())
    other.wait(0.4, speaks=False)
    hands.tick = other.tick
    hands.wait(0.1)
    assert hands.state()["owner"] == "c1"
    assert all(np.allclose(q, before[n], atol=1e-9) for n, q in hands.q().items())


@pytest.mark.slow
def test_an_arm_at_its_limit_is_told_and_comes_back(hands, caplog):
    hands.start("right")
    before = hands.seen("psm1")
    with caplog.at_level(logging.WARNING):
        hands.move("right", (0, 0, 0.2), 0.8)  # out of the patient
    wall = hands.state()["hands"]["right"]["wall"]
    assert wall is not None
    assert "is at its limit" in wall
    assert f"psm1: {wall}" in caplog.text
    hands.move("right", (0, 0, -0.2), 0.8)
    assert hands.state()["hands"]["right"]["wall"] is None
    assert np.allclose(hands.seen("psm1"), before, atol=1e-6)


def test_a_world_that_fails_stops_and_says_why(hands, monkeypatch, caplog):
    def fail(ticks):
        raise WorldError("signal 'psm1.q' is not finite at t = 1.000 s")

    monkeypatch.setattr(hands.op.world, "step", fail)
    hands.wait(0.1)
    assert "psm1.q" in hands.state()["stopped"]
    assert "psm1.q" in caplog.text


# -- through the server ---------------------------------------------------------------------------------------------


def hands_of(x, roll, number):
    right = wire.sevens(spatial.pose(spatial.rotation_z(roll), (x, 0, 0))).tolist()
    left = wire.sevens(spatial.pose(None, (-0.08, 0, 0))).tolist()
    hands = {"right": {"pose": right, "grip": 0.0}, "left": {"pose": left, "grip": 0.0}}
    return {"number": number, **hands, "clutch": False, "camera": False}


def test_hands_come_through_the_stream_and_end_with_it(bare_theatre):
    async def go():
        async with serving(lambda: served_content.of_console(bare_theatre)) as s:
            async with joined(s.port) as peer:
                assert peer.last("hello")["protocol"] == 2
                await peer.until(lambda: len(peer.frames) > 3)  # the first tick may round joint values by 1e-16
                start, other = (r.q for r in peer.frames[-1].robots[:2])
                end = asyncio.get_running_loop().time() + 60
                for n in count():  # until it moves: a busy machine is slow, and silent hands have to roll again
                    assert asyncio.get_running_loop().time() < end, "no frame shows the motion"
                    roll = 5 * DEG * ((n > 10) + n // 200)
                    await peer.say("hands", **hands_of(0.08 + 1e-4 * min(n, 1000), roll, n))
                    await asyncio.sleep(0.01)
                    if n > 50 and np.abs(peer.frames[-1].robots[0].q - start).max() > 1e-3:
                        break
                console = peer.last("state")["console"]
                assert console["owner"] == peer.last("hello")["client"]
                assert np.abs(peer.frames[-1].robots[0].q - start).max() > 1e-3
                assert np.array_equal(peer.frames[-1].robots[1].q, other)
                answer = await peer.ask("hands", **hands_of(float("nan"), 0.0, 1000))
                assert (answer["type"], answer["code"]) == ("error", "invalid")
            # the page is closed in mid-drag
            async with joined(s.port) as watcher:
                await watcher.until(
                    lambda: watcher.documents[-1]["type"] == "state" and watcher.last("state")["console"]["silent"]
                )
                seen = len(watcher.frames)  # the frame of that state comes after it
                await watcher.until(lambda: len(watcher.frames) > seen + 2)
                q = [r.q for r in watcher.frames[-1].robots]
                await asyncio.sleep(0.2)
                assert all(np.array_equal(a, r.q) for a, r in zip(q, watcher.frames[-1].robots, strict=True))

    asyncio.run(go())


def test_what_hands_change_is_sent_before_the_next_tick(bare_theatre, monkeypatch):
    """With ticks that are 1000 s apart, only messages of the hands bring frames."""
    for module in (server, console_stream):
        monkeypatch.setattr(module, "TICK_RATE", 0.001)
    monkeypatch.setattr(live_console, "_STEPPING_TIME", np.inf)

    async def go():
        async with serving(lambda: served_content.of_console(bare_theatre)) as s, joined(s.port) as peer:
            start = peer.frames[-1].robots[0].q
            end = asyncio.get_running_loop().time() + 60
            for n in count():
                await peer.say("hands", **hands_of(0.08 + 1e-4 * min(n, 1000), 5 * DEG * (n > 10), n))
                await asyncio.sleep(0.01)
                if np.abs(peer.frames[-1].robots[0].q - start).max() > 1e-3:
                    break
                assert asyncio.get_running_loop().time() < end, "no frame shows the motion"

    asyncio.run(go())


# -- the scene's file -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('camera = "endoscope"', 'camera = "endoscop"', "there is no camera 'endoscop'. Did you mean 'endoscope'?"),
        ('right = ["psm1"]', 'right = ["psm3"]', "there is no robot 'psm3'"),
        ('right = ["psm1"]', 'right = ["psm2"]', "already moves 'psm2'"),
        ('right = ["psm1"]', 'right = ["ecm"]', "already moves 'ecm'"),
        ('right = ["psm1"]', "right = []", "console.right"),
        ("scale = 0.5", "scale = 2", "console.scale"),
    ],
)
def test_a_wrong_console_is_named(bare_theatre, tmp_path, old, new, text):
    assert re.search(text.replace("?", r"\?"), refused(bare_theatre.scene, tmp_path, old, new))


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("q3 = 141.94", "q3 = 1419.4", "start: q3 is 1419.4 mm, outside 0 .. 240 mm"),
        ("q3 = 141.94", "q33 = 141.94", "there is no active joint 'q33'"),
        ('frame = "tool"', 'frame = "base"', "a console can move only a camera on scope"),
    ],
)
def test_a_console_that_does_not_fit_its_robots_is_named(bare_theatre, tmp_path, old, new, text):
    body = bare_theatre.scene.file.read_text(encoding="utf-8").replace('props = "theatre.toml"\n', "")
    (tmp_path / "scene.toml").write_text(body.replace(old, new), encoding="utf-8")
    with pytest.raises(TwinError, match=text):
        ConsoleStream(replace(bare_theatre, scene=load_scene(tmp_path / "scene.toml")))


@pytest.mark.parametrize("command", ["run", "view"])
def test_a_scene_without_protocols_is_not_played(command, tmp_path, capsys):
    more = ["--html", str(tmp_path / "page.html")] if command == "view" else ["--out", str(tmp_path / "out")]
    assert main([command, "davinci", *more]) == 2
    said = capsys.readouterr().err
    assert "scene.toml has no protocol for psm1, psm2, ecm" in said
    assert "`twin serve davinci` or `twin view davinci`" in said


def test_a_robot_without_a_protocol_needs_a_console(bare_theatre, tmp_path):
    body = bare_theatre.scene.file.read_text(encoding="utf-8").replace('props = "theatre.toml"\n', "")
    (tmp_path / "scene.toml").write_text(body[: body.index("[console]")], encoding="utf-8")
    with pytest.raises(DescriptionError, match="this robot has no protocol"):
        load_scene(tmp_path / "scene.toml")


def test_a_scene_without_a_console_is_refused(bare_theatre):
    with pytest.raises(TwinError, match=r"scene 'davinci' has no console: add a section \[console\]"):
        console_scene.world(Setup(replace(bare_theatre.scene, console=None), {}), None)


@settings(max_examples=50, deadline=None)
@given(
    st.tuples(st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(0, 0.3), st.floats(-3, 3))  # pan, tilt, depth, roll
)
def test_where_a_camera_looks_is_the_inverse_of_its_view(at):
    assert np.allclose(view(at_of_view(view(np.array(at)))), view(np.array(at)), atol=1e-12)


def test_a_camera_beside_its_remote_centre_is_refused():
    with pytest.raises(WorldError, match="passes 5 mm from its remote centre"):
        at_of_view(spatial.pose(None, (0.005, 0, -0.1)))


class Slow:
    """A source whose frames take 30 ms, as on a slow machine; it notes the numbers of the hands."""

    replays, version, frames = False, wire.SCENE_VERSION, 0

    def __init__(self):
        self.heard, self.send = [], lambda document: None

    def frame(self, tick, server_time):
        time.sleep(0.03)
        self.frames += 1
        return pack_scene(self.frames, server_time, 0.0, 0, [], [])

    def ask(self, client, message):
        self.heard.append(message.number)

    def state(self):
        return {"type": "state", "robots": []}

    def welcome(self):
        return []

    def holds(self, client):
        return True

    def release(self, client):
        pass

    def close(self):
        pass


@pytest.mark.slow
def test_hands_are_heard_at_once_where_a_frame_takes_longer_than_the_time_between_two_messages(bare_theatre):
    slow = Slow()

    async def go():
        async with serving(lambda: served_content.of_console(bare_theatre), source=slow) as s, joined(s.port) as peer:
            pose = {"pose": [0, 0, 0, 0, 0, 0, 1], "grip": 0}
            for number in range(150):
                await peer.say("hands", number=number, right=pose, left=pose, clutch=False, camera=False)
                await asyncio.sleep(0.005)
            before = slow.frames
            await peer.until(lambda: slow.heard[-1:] == [149])
            assert slow.frames - before <= 10, "a frame for each message would be 150"
            assert len(peer.frames) >= 3, "the stream went on meanwhile"

    asyncio.run(go())
