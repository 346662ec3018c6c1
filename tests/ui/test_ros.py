"""The robots of `twin serve davinci --ros`: programs of ROS systems move and watch them by the protocol rosbridge."""

from __future__ import annotations

import asyncio
import json
from contextlib import asynccontextmanager

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from made.pens import Pens
from made.ros_client import RosPens, connected, placed, stamped
from twin.core import spatial
from twin.core.units import MM
from twin.ui.access.rules import AccessRules
from twin.ui.headset.console_stream import ConsoleStream
from twin.ui.session import live_console
from twin.ui.session.exercise import Exercise
from twin.ui.session.timeline import TICK_RATE


class Running:
    """A stream of a console with a bridge, and the time that passes."""

    def __init__(self, op):
        self.op = op
        self.tick = 0
        self.told = []
        op.send = self.told.append
        self.bridge = op.bridge(AccessRules("127.0.0.1", 0, False, lambda token: None))

    async def start(self):
        await self.bridge.start("127.0.0.1", 0)
        self.op.frame(0, 0.0)
        await self.wait(1 / TICK_RATE)

    async def wait(self, seconds, send=None):
        """Let time pass; `send` sends the messages of a tick of the World."""
        for _ in range(round(seconds * TICK_RATE)):
            for _ in range(16 if send else 0):
                await send()
            self.tick += 1
            self.op.frame(self.tick, 0.0)

    @property
    def state(self):
        return self.op.state()["console"]


@asynccontextmanager
async def running(scene, exercise=None):
    op = ConsoleStream(scene) if exercise is None else ConsoleStream(scene, exercise)
    found = Running(op)
    try:
        await found.start()
        yield found
    finally:
        await found.bridge.close()
        op.close()


@pytest.fixture
def scene(bare_theatre, monkeypatch):
    monkeypatch.setattr(live_console, "_STEPPING_TIME", np.inf)  # a busy machine does not make the World late
    return bare_theatre


SCRIPT = ((0.05, 0.0, False), (0.1, 0.0, True), (0.4, 10 * MM, False), (0.2, 0.0, False))
"""(seconds, way of the right hand along x, whether the hands roll first)."""


async def moved_by_ros(scene, exercise=None):
    """Play `SCRIPT` by ROS messages; return (way of the goal of psm1 in the picture, state)."""
    async with running(scene, exercise) as console, connected(console.bridge.port) as client:
        pens = RosPens(client)

        async def send():
            await pens.send()
            await client.handled()

        before = console.op.world.signals["psm1.goal"].reshape(4, 4)
        for seconds, way, rolls in SCRIPT:
            if rolls:
                pens.roll()
            steps = round(seconds * TICK_RATE)
            for _ in range(steps):
                pens.p["right"] = pens.p["right"] + np.array((way, 0, 0)) / steps
                await console.wait(1 / TICK_RATE, send)
        return picture_way(console.op, before), console.state, client


def picture_way(op, before):
    way = (op.world.signals["psm1.goal"].reshape(4, 4) - before)[:3, 3]
    R_world_view = op.world.signals["ecm.view"].reshape(4, 4)[:3, :3]
    return R_world_view.T @ op._places["psm1"].T_world_base[:3, :3] @ way


def moved_by_udp(scene, exercise):
    """Play `SCRIPT` by UDP packets; return the way of the goal of psm1 in the picture."""
    op = ConsoleStream(scene, exercise)
    op.send = lambda document: None
    op.listen("127.0.0.1", 0)
    pens = Pens(op.packets.socket.port)
    op.frame(0, 0.0)
    op.frame(1, 0.0)
    tick = 1
    before = op.world.signals["psm1.goal"].reshape(4, 4)
    for seconds, way, rolls in SCRIPT:
        if rolls:
            pens.roll()
        steps = round(seconds * TICK_RATE)
        for _ in range(steps):
            pens.p["right"] = pens.p["right"] + np.array((way, 0, 0)) / steps
            for _ in range(16):
                pens.send()
            tick += 1
            op.frame(tick, 0.0)
    found = picture_way(op, before)
    op.close()
    pens.close()
    return found


def test_ten_millimetres_at_scale_one_half_are_five_and_the_session_has_the_bytes_of_packets(scene, tmp_path):
    way, state, client = asyncio.run(moved_by_ros(scene, Exercise(session=tmp_path / "ros.session")))
    assert way == pytest.approx([5 * MM, 0, 0], abs=1e-9)
    assert state["owner"] == "ros"
    assert state["ros"]["from"] == {"right": "ROS client 1", "left": "ROS client 1"}
    assert state["ros"]["ignored"] == 0
    assert not client.statuses
    assert moved_by_udp(scene, Exercise(session=tmp_path / "udp.session")) == pytest.approx(way, abs=1e-12)
    assert (tmp_path / "ros.session").read_bytes() == (tmp_path / "udp.session").read_bytes()


def test_topics_of_crtk_are_published_with_the_values_of_the_world(scene):
    async def watch():
        async with running(scene) as console, connected(console.bridge.port) as client:
            topics = (await client.call("/rosapi/topics"))["values"]
            types = dict(zip(topics["topics"], topics["types"], strict=True))
            outputs = [name for name in types if name in console.bridge.topics.outputs]
            for name in outputs:
                await client.send("subscribe", topic=name, type=types[name])
            await client.handled()
            pens = RosPens(client)

            async def send():
                await pens.send()
                await client.handled()

            await console.wait(0.05, send)
            pens.roll()
            await console.wait(0.1, send)
            for _ in range(12):
                pens.p["right"] = pens.p["right"] + np.array((0.5 * MM, 0, 0))
                await console.wait(1 / TICK_RATE, send)
            await client.handled()
            return console, client.heard, types

    console, heard, types = asyncio.run(watch())
    assert types["/PSM1/measured_cp"] == "geometry_msgs/msg/PoseStamped"
    assert types["/PSM1/servo_cp"] == "geometry_msgs/msg/PoseStamped"
    assert types["/footpedals/clutch"] == "sensor_msgs/msg/Joy"
    signals = console.op.world.signals
    member = console.op.members["psm1"]
    joints = heard["/PSM1/measured_js"][-1]
    jaw = heard["/PSM1/jaw/measured_js"][-1]
    values = dict(zip(joints["name"] + jaw["name"], joints["position"] + jaw["position"], strict=True))
    names = [joint.name for joint in member.mechanism.active]
    np.testing.assert_array_equal([values[name] for name in names], signals["psm1.encoder"])
    assert len(jaw["name"]) == 1
    goal = signals["psm1.goal"].reshape(4, 4)
    np.testing.assert_allclose(placed(heard["/PSM1/setpoint_cp"][-1]), goal, atol=1e-12)
    np.testing.assert_allclose(placed(heard["/PSM1/measured_cp"][-1]), goal, atol=1e-6)
    stamp = joints["header"]["stamp"]
    assert stamp["sec"] + 1e-9 * stamp["nanosec"] == pytest.approx(console.op.world.t, abs=1e-9)
    assert [message["state"] for message in heard["/PSM1/operating_state"]][-1] == "ENABLED"
    assert heard["/PSM1/operating_state"][0]["state"] == "PAUSED"
    assert heard["/PSM1/operating_state"][-1]["is_busy"]
    assert heard["/console/teleop/scale"][-1] == {"data": 0.5}
    assert set(heard["/MTMR/body/servo_cf"][-1]["wrench"]["force"]) == {"x", "y", "z"}
    frames = {entry["child_frame_id"]: entry for entry in heard["/tf"][-1]["transforms"]}
    tip = next(frame for frame in member.mechanism.frames if frame.name == member.mechanism.tool)
    W = frames[f"psm1/{tip.body}"]["transform"]
    expected = console.op.world.link_poses()["psm1"][tip.body]
    expected = console.op.place("psm1") @ expected
    assert [W["translation"][axis] for axis in "xyz"] == pytest.approx(expected[:3, 3], abs=1e-12)


def test_servo_cp_moves_the_tool_to_the_pose(scene):
    async def servo():
        async with running(scene) as console, connected(console.bridge.port) as client:
            goal = console.op.world.signals["psm1.goal"].reshape(4, 4)
            target = goal @ spatial.pose(spatial.exp_so3(np.array([0.02, 0.05, -0.03])), np.array([4, -3, 2]) * MM)

            async def send():
                return None

            for k in range(90):
                way = min(1.0, k / 45)
                turn = spatial.exp_so3(way * spatial.log_so3(target[:3, :3] @ goal[:3, :3].T)) @ goal[:3, :3]
                T = spatial.pose(turn, goal[:3, 3] + way * (target - goal)[:3, 3])
                await client.pose("/PSM1/servo_cp", T)
                await client.handled()
                await console.wait(1 / TICK_RATE)
            return console.op.world.signals["psm1.goal"].reshape(4, 4), target, client.statuses, console.state

    reached, target, statuses, state = asyncio.run(servo())
    assert not statuses
    assert state["owner"] == "ROS client 1 by servo_cp"
    np.testing.assert_allclose(reached, target, atol=1e-5)


def test_many_messages_of_servo_cp_in_a_picture_are_one_goal(scene):
    """A constant goal 4 mm away, said eight times a picture: the tool goes there and stays."""

    async def servo():
        async with running(scene) as console, connected(console.bridge.port) as client:
            goal = console.op.world.signals["psm1.goal"].reshape(4, 4)
            target = goal @ spatial.pose(np.eye(3), np.array([4, 0, 0]) * MM)
            ways = []
            for _ in range(60):
                for _ in range(8):
                    await client.pose("/PSM1/servo_cp", target)
                await client.handled()
                await console.wait(1 / TICK_RATE)
                now = console.op.world.signals["psm1.goal"].reshape(4, 4)
                ways.append(float(np.linalg.norm((now - goal)[:3, 3])))
            held = console.state["owner"]
        await asyncio.sleep(0)
        return ways, held

    ways, held = asyncio.run(servo())
    assert held == "ROS client 1 by servo_cp"
    assert max(ways) < 4.01 * MM
    assert ways[-20:] == pytest.approx([4 * MM] * 20, abs=1e-6)


def test_pedals_and_goals_of_a_client_end_with_it(scene):
    async def leave():
        async with running(scene) as console:
            async with connected(console.bridge.port) as first:
                await first.publish("/footpedals/clutch", {"buttons": [1]})
                await first.publish("/footpedals/camera", {"buttons": [1]})
                goal = console.op.world.signals["psm1.goal"].reshape(4, 4)
                await first.pose("/PSM1/servo_cp", goal)
                await first.handled()
                hands = console.bridge.topics.hands
                pressed = (hands.clutch, hands.camera)
            async with connected(console.bridge.port) as second:
                while hands.clutch:
                    await asyncio.sleep(0.01)
                pens = RosPens(second)
                await pens.send()
                await second.handled()
                await console.wait(1 / TICK_RATE)
                return pressed, (hands.clutch, hands.camera), second.statuses, console.state["owner"]

    pressed, after, statuses, owner = asyncio.run(leave())
    assert pressed == (True, True)
    assert after == (False, False)
    assert not statuses
    assert owner == "ros"


def test_hands_are_refused_after_an_error_of_the_world(scene):
    async def stopped():
        async with running(scene) as console, connected(console.bridge.port) as client:
            console.op._world_error = "psm1.q is not finite"
            await RosPens(client).send()
            await client.handled()
            return client.statuses

    ((level, text), *_) = asyncio.run(stopped())
    assert level == "error"
    assert "The World has stopped: psm1.q is not finite" in text


def test_two_subscriptions_of_a_topic_end_one_by_one(scene):
    async def watch():
        async with running(scene) as console, connected(console.bridge.port) as client:
            for name in ("a", "b"):
                await client.send("subscribe", topic="/PSM1/measured_js", id=name)
            await client.send("unsubscribe", topic="/PSM1/measured_js", id="a")
            await client.handled()
            await console.wait(2 / TICK_RATE)
            await client.handled()
            with_one = len(client.heard["/PSM1/measured_js"])
            await client.send("unsubscribe", topic="/PSM1/measured_js", id="b")
            await client.handled()
            await console.wait(2 / TICK_RATE)
            await client.handled()
            return with_one, len(client.heard["/PSM1/measured_js"])

    with_one, after = asyncio.run(watch())
    assert with_one >= 3
    assert after == with_one


def test_pedals_scale_and_grip(scene):
    async def use():
        async with running(scene) as console, connected(console.bridge.port) as client:
            pens = RosPens(client)

            async def send():
                await pens.send()
                await client.handled()

            await client.publish("/console/teleop/set_scale", {"data": 0.25})
            await client.publish("/MTMR/gripper/measured_js", {"name": ["gripper"], "position": [0.4]})
            await client.publish("/MTML/gripper/angle", {"data": 0.2})
            await client.publish("/footpedals/clutch", {"axes": [], "buttons": [1]})
            await console.wait(0.1, send)
            signals = console.op.world.signals
            return [float(signals[name][0]) for name in ("pedals.scale", "right.grip", "left.grip", "pedals.clutch")]

    assert asyncio.run(use()) == [0.25, 0.4, 0.2, 1.0]


HOSTILE = {
    "text": "hello",
    "not an object": "[1]",
    "no operation": "{}",
    "unknown operation": '{"op": "shutdown"}',
    "deep": "[" * 5000 + "]" * 5000,
    "png": '{"op": "subscribe", "topic": "/PSM1/measured_js", "compression": "png"}',
    "unknown topic": '{"op": "publish", "topic": "/PSM9/servo_cp", "msg": {}}',
    "output": '{"op": "publish", "topic": "/PSM1/measured_js", "msg": {}}',
    "another type": '{"op": "advertise", "topic": "/PSM1/servo_cp", "type": "std_msgs/String"}',
    "missing field": '{"op": "publish", "topic": "/MTMR/measured_cp", "msg": {"pose": {}}}',
    "far": json.dumps(
        {"op": "publish", "topic": "/MTMR/measured_cp", "msg": stamped(spatial.pose(np.eye(3), [99, 0, 0]))}
    ),
    "no rotation": json.dumps(
        {
            "op": "publish",
            "topic": "/MTMR/measured_cp",
            "msg": {"pose": {"position": {"x": 0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 0.5}}},
        }
    ),
    "not a number": '{"op": "publish", "topic": "/console/teleop/set_scale", "msg": {"data": NaN}}',
    "infinite": '{"op": "publish", "topic": "/console/teleop/set_scale", "msg": {"data": 1e999}}',
    "scale": '{"op": "publish", "topic": "/console/teleop/set_scale", "msg": {"data": 50}}',
    "many joints": json.dumps(
        {"op": "publish", "topic": "/MTMR/gripper/measured_js", "msg": {"position": [0.1] * 500}}
    ),
    "service": '{"op": "subscribe", "topic": "/rosapi/topics"}',
}


def test_hostile_messages_are_refused_with_a_reason_and_nothing_moves(scene):
    async def attack():
        async with running(scene) as console:
            before = console.op.state_row()
            texts = {}
            for name, text in HOSTILE.items():
                async with connected(console.bridge.port) as client:
                    await client.ws.send(text)
                    await client.handled()
                    texts[name] = client.statuses
            async with connected(console.bridge.port) as client:
                answer = await client.call("/rosapi/delete_param")
                assert answer["result"] is False
                assert "there is no service /rosapi/delete_param" in answer["values"]
            await console.wait(0.1)
            np.testing.assert_array_equal(console.op.state_row(), before)
            return texts

    texts = asyncio.run(attack())
    for name, statuses in texts.items():
        assert len(statuses) == 1, (name, statuses)
        assert statuses[0][0] == "error"
    assert "position x is 99 m; it must be within ±10 m" in texts["far"][0][1]
    assert "quaternion has length 0.5" in texts["no rotation"][0][1]
    assert "/PSM9/servo_cp: there is no such topic here; known: /MTML" in texts["unknown topic"][0][1]
    assert "the scale 50 is outside" in texts["scale"][0][1]
    assert "geometry_msgs/msg/PoseStamped, not std_msgs/String" in texts["another type"][0][1]


def test_floods_long_messages_and_pages_of_others_are_cut_off(scene):
    async def attack():
        async with running(scene) as console:
            port = console.bridge.port
            async with connected(port) as client:
                await client.ws.send("x" * 20_000)
                await client.ws.wait_closed()
                with pytest.raises(ConnectionClosed):
                    await client.ws.send("x")
            async with connected(port) as client:
                for _ in range(100):
                    await client.ws.send("no JSON")
                await client.ws.wait_closed()
            with pytest.raises(InvalidStatus) as refused:
                async with connected(port, additional_headers={"Origin": "https://example.org"}):
                    pass
            assert refused.value.response.status_code == 403

    asyncio.run(attack())


def test_a_hand_has_one_client_at_a_time(scene):
    async def use():
        async with running(scene) as console:
            port = console.bridge.port
            async with connected(port) as one, connected(port) as other:
                first = RosPens(one)
                second = RosPens(other)

                async def send():
                    await first.send()
                    await one.handled()

                await console.wait(0.05, send)
                await second.send()
                await other.handled()
                refused = [text for _, text in other.statuses]
                await console.wait(0.3)  # the first one is silent

                async def send_second():
                    await second.send()
                    await other.handled()

                await console.wait(0.05, send_second)
                return refused, console.state["ros"]

    refused, state = asyncio.run(use())
    assert "ROS client 1 controls the right hand until it is silent for 0.25 s" in refused[0]
    assert state["from"] == {"right": "ROS client 2", "left": "ROS client 2"}
    assert state["ignored"] == 2


def test_cbor_and_throttled_subscriptions(scene):
    async def watch():
        async with running(scene) as console, connected(console.bridge.port) as client:
            await client.send("subscribe", topic="/PSM1/measured_js", compression="cbor")
            await client.send("subscribe", topic="/PSM2/measured_js", throttle_rate=3_600_000)
            await client.handled()
            for _ in range(5):
                await console.wait(1 / TICK_RATE)
                await client.handled()
            await client.send("unsubscribe", topic="/PSM1/measured_js")
            await client.handled()
            count = len(client.heard["/PSM1/measured_js"])
            await console.wait(0.1)
            await client.handled()
            return client, count

    client, count = asyncio.run(watch())
    assert client.binary == count == len(client.heard["/PSM1/measured_js"]) == 6
    assert len(client.heard["/PSM2/measured_js"]) == 1
    assert client.heard["/PSM1/measured_js"][0]["name"][0] == client.heard["/PSM2/measured_js"][0]["name"][0]
