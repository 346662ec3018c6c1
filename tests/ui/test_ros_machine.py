"""`twin machine ROBOT --ros`: programs of ROS systems move and watch a machine by the protocol rosbridge."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus

import twin
from made.ros_client import connected, placed, stamped
from twin.api.machine import machine, machine_parts
from twin.cli import main
from twin.core import spatial
from twin.core.units import DEG, MM
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_link import Address, MachineLink
from twin.simulation.machine.machine_master import MachineMaster
from twin.simulation.machine.machine_server import HOST, Server
from twin.ui.access.rules import AccessRules
from twin.ui.headset.ros import machine_bridge
from twin.ui.headset.ros.bridge import RosBridge
from twin.ui.headset.ros.machine_bridge import MachineTopics

pytestmark = pytest.mark.slow


class Running:
    """A machine with real sockets in a thread, whose ticks follow the clock, and the bridge beside it."""

    def __init__(self, parts, start=True):
        self.parts = parts
        self.server = Server(machine(parts))
        self.ends = threading.Event()
        if start:
            self.server.machine.start()
        self.thread = threading.Thread(target=self.server.run, kwargs={"ends": self.ends.is_set})
        self.thread.start()
        self.link = MachineLink(Address(HOST, self.server.port, self.server.state_port), len(parts.home))
        self.topics = MachineTopics(parts.arm.mechanism.name, MachineMaster(self.link, parts))
        self.bridge = RosBridge(self.topics, AccessRules(HOST, 0, False, lambda token: None))

    def close(self):
        self.link.close()
        self.ends.set()
        self.thread.join()
        self.server.close()


class Line:
    """The parent's end of the pipe, which is open."""

    def __init__(self):
        self.closed = False

    def poll(self):
        return self.closed


@contextlib.asynccontextmanager
async def running(parts, **options):
    found = Running(parts, **options)
    line = Line()
    try:
        await found.bridge.start(HOST, 0)
        rounds = asyncio.ensure_future(machine_bridge._rounds(line, found.topics, found.bridge))
        yield found
        line.closed = True
        await rounds
    finally:
        await found.bridge.close()
        found.close()


async def until(condition, seconds=60):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        await asyncio.sleep(0.01)


@pytest.fixture(scope="module")
def parts():
    return machine_parts(twin.load("sils"))


async def servo(client, topic, T, condition):
    """Send a goal 50 times a second until a condition holds."""
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end
        await client.pose(topic, T)
        await asyncio.sleep(0.02)


def apart(link, parts, T):
    """Return the distance in m from a pose (4, 4) to that of the machine's encoders."""
    return float(np.linalg.norm(parts.kin.forward(link.state.q, T)[:3, 3] - T[:3, 3]))


def test_servo_cp_moves_the_platform_of_the_machine_and_topics_have_its_states(parts):
    async def move():
        async with running(parts) as m, connected(m.bridge.port) as client:
            await until(lambda: m.link.state and m.link.state.level == Level.PEDAL_UP)
            topics = (await client.call("/rosapi/topics"))["values"]
            for name, kind in zip(topics["topics"], topics["types"], strict=True):
                if name in m.topics.outputs:
                    await client.send("subscribe", topic=name, type=kind)
            await client.handled()
            start = placed(client.heard["/SILS/measured_cp"][-1])
            turn = spatial.exp_so3(np.array([0.0, 0.02, 0.01]))
            goal = spatial.pose(turn @ start[:3, :3], start[:3, 3] + np.array([4, -3, -5]) * MM)

            def told():
                """Whether the topics tell that the tool is there; after a pause they are later than the link."""
                poses = [placed(client.heard[f"/SILS/{kind}_cp"][-1]) for kind in ("measured", "setpoint")]
                return all(np.linalg.norm((T - goal)[:3, 3]) < 0.1 * MM for T in poses)

            await servo(client, "/SILS/servo_cp", goal, lambda: apart(m.link, parts, goal) < 0.05 * MM and told())
            await client.handled()
            asked = {name: messages[-1] for name, messages in client.heard.items()}
            words = [message["state"] for message in client.heard["/SILS/operating_state"]]
            # nobody sends goals any more: the pedal goes up
            await until(lambda: m.link.state.level == Level.PEDAL_UP)
            return goal, asked, words, client.statuses, topics, m.server.machine.reason

    # on a busy computer packets get lost, and the master begins again from where the machine is
    goal, heard, words, statuses, topics, reason = asyncio.run(move())
    assert not statuses
    assert reason == ""
    assert dict(zip(topics["topics"], topics["types"], strict=True))["/SILS/state_command"].endswith("/StringStamped")
    names = [joint.name for joint in parts.arm.mechanism.active]
    for kind in ("measured", "setpoint"):
        joints = heard[f"/SILS/{kind}_js"]
        assert joints["name"] == names
        # the reference model of the CAD, not the equations of the machine's software
        reference = twin.load("sils").reference()
        near = reference.solve(parts.home)
        T = reference.solve(np.array(joints["position"]), near).T_base_tool
        np.testing.assert_allclose(T[:3, 3], goal[:3, 3], atol=0.2 * MM)
        np.testing.assert_allclose(placed(heard[f"/SILS/{kind}_cp"])[:3, 3], goal[:3, 3], atol=0.2 * MM)
    assert {"PAUSED", "ENABLED"} <= set(words)
    assert {entry["child_frame_id"] for entry in heard["/tf"]["transforms"]} == {"sils/base", "sils/tool"}


def test_a_goal_out_of_reach_is_held_and_the_next_one_is_reached(parts):
    async def move():
        async with running(parts) as m, connected(m.bridge.port) as client:
            await until(lambda: m.link.state and m.link.state.level == Level.PEDAL_UP)
            start = parts.kin.forward(m.link.state.q, parts.kin.forward(parts.home)).copy()
            # carriage 4 is at its limit at home: above it, the loops cannot follow
            far = spatial.pose(start[:3, :3], start[:3, 3] + np.array([0, 0, 60]) * MM)
            await servo(client, "/SILS/servo_cp", far, lambda: m.topics.master.held)
            await servo(client, "/SILS/servo_cp", far, lambda: client.statuses)
            stopped = apart(m.link, parts, start)
            near = spatial.pose(start[:3, :3], start[:3, 3] - np.array([0, 0, 3]) * MM)
            await servo(client, "/SILS/servo_cp", near, lambda: apart(m.link, parts, near) < 0.05 * MM)
            return stopped, client.statuses, m.server.machine.reason

    stopped, statuses, reason = asyncio.run(move())
    assert stopped < 59 * MM
    assert statuses[0][0] == "error"
    assert "holds this goal as out of reach" in statuses[0][1]
    assert reason == ""


def test_commands_press_the_buttons_and_one_client_leads(parts, monkeypatch):
    monkeypatch.setattr(machine_bridge, "GOAL_TIMEOUT", 100.0)

    async def use():
        async with (
            running(parts, start=False) as m,
            connected(m.bridge.port) as first,
            connected(m.bridge.port) as second,
        ):
            await until(lambda: m.link.state is not None)
            await first.send("subscribe", topic="/SILS/operating_state")
            await first.handled()
            goal = parts.kin.forward(parts.home)
            await first.pose("/SILS/servo_cp", goal)  # refused: E_STOP
            await first.publish("/SILS/state_command", {"string": "enable"})
            await until(lambda: m.link.state.level == Level.PEDAL_UP)
            await first.pose("/SILS/servo_cp", goal)
            await first.handled()
            await second.pose("/SILS/servo_cp", goal)  # refused: another client leads
            await second.publish("/SILS/state_command", {"string": "fly"})
            await second.handled()
            leads = m.topics.about()["from"]
            await second.publish("/SILS/state_command", {"string": "disable"})  # any client may stop it
            await until(lambda: m.link.state.level == Level.E_STOP)
            await until(lambda: first.heard["/SILS/operating_state"][-1]["state"] == "DISABLED")
            return leads, first, second

    leads, first, second = asyncio.run(use())
    assert leads == "ROS client 1"
    words = [message["state"] for message in first.heard["/SILS/operating_state"]]
    assert words[0] == words[-1] == "DISABLED"
    assert "FAULT" not in words
    assert "send enable to state_command" in first.statuses[0][1]
    assert "ROS client 1 moves the machine until it has been silent for 100 s" in second.statuses[0][1]
    assert "enable" in second.statuses[1][1]


def servo_text(p=(0.0, 0.0, 0.0), w=1.0):
    """Return a message with a goal; the rotation is none, or none at all with w = 0."""
    message = stamped(spatial.pose(np.eye(3), p))
    message["pose"]["orientation"]["w"] = w
    return json.dumps({"op": "publish", "topic": "/SILS/servo_cp", "msg": message})


HOSTILE = {
    "text": "hello",
    "an array": "[1]",
    "deep": "[" * 5000 + "]" * 5000,
    "unknown topic": '{"op": "publish", "topic": "/PSM1/servo_cp", "msg": {}}',
    "output": '{"op": "publish", "topic": "/SILS/measured_js", "msg": {}}',
    "another type": '{"op": "advertise", "topic": "/SILS/servo_cp", "type": "std_msgs/String"}',
    "no pose": '{"op": "publish", "topic": "/SILS/servo_cp", "msg": {"pose": {}}}',
    "not finite": servo_text().replace("0.0", "1e999", 1),
    "far": servo_text((9e9, 0.0, 0.0)),
    "no rotation": servo_text(w=0.0),
    "command": '{"op": "publish", "topic": "/SILS/state_command", "msg": {"string": "rm -rf"}}',
}


async def settled(m):
    """Return the desired joint values once they stay: a level starts from the measured ones, while the arm may sag."""
    await until(lambda: m.link.state and m.link.state.level == Level.PEDAL_UP)
    while True:
        before = m.link.state
        await until(lambda: m.link.state.tick >= before.tick + 300)  # noqa: B023
        after = m.link.state
        if after.level == Level.PEDAL_UP and np.array_equal(after.wanted, before.wanted):
            return after.wanted


def test_hostile_messages_are_refused_and_move_nothing(parts):
    async def attack():
        async with running(parts) as m:
            before = await settled(m)
            for name, text in HOSTILE.items():
                async with connected(m.bridge.port) as client:
                    await client.ws.send(text)
                    await client.handled()
                    assert client.statuses, name
                    assert client.statuses[0][0] == "error", name
            async with connected(m.bridge.port) as client:
                assert not (await client.call("/rosapi/delete"))["result"]
            with pytest.raises(InvalidStatus):  # a page of a browser, which has another origin
                async with connected(m.bridge.port, origin="http://evil.example"):
                    pass
            assert m.link.state.level == Level.PEDAL_UP
            return np.abs(m.link.state.wanted - before).max(), m.server.machine.receiver.accepted

    moved, accepted = asyncio.run(attack())
    assert moved == 0
    assert accepted == 0


def test_a_machine_without_tool_speeds_is_refused(parts):
    from dataclasses import replace

    number = parts.settings.number.model_copy(update={"tool_speed": None})
    poor = replace(parts, settings=parts.settings.model_copy(update={"number": number}))
    with pytest.raises(twin.TwinError, match=r"machine.toml needs \[number.tool_speed\]"):
        MachineMaster(None, poor)


@pytest.mark.parametrize(
    ("given", "said"), [("99999", "is not a port"), ("203.0.113.1:0", "the host is not an address of this computer")]
)
def test_an_impossible_port_is_named(given, said, capsys):
    try:
        code = main(["machine", "sils", "--ros", given, "--duration", "1"])
    except SystemExit as error:
        code = error.code
    assert code == 2
    assert said in capsys.readouterr().err


def test_an_open_port_prints_an_address_with_a_token_beside_the_result():
    command = [sys.executable, "-m", "twin", "machine", "raven_left", "--quiet", "--json", "--ros", "0.0.0.0:0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stderr is not None
        lines = [""]
        while "token=" not in lines[-1]:
            lines.append(process.stderr.readline())
            assert lines[-1], "the command has ended"
        process.send_signal(signal.SIGINT)
        out, rest = process.communicate(timeout=30)
    finally:
        process.kill()
        process.communicate()
    assert "without TLS" in "".join(lines)
    assert "//0.0.0.0" not in "".join(lines) + rest
    assert "rosbridge for ROS clients" not in rest  # an address without a token would be refused
    assert json.loads(out)["robot"] == "raven_left"


@pytest.mark.parametrize("robot", ["raven_left", "sils"])
def test_the_command_serves_its_machine_to_ros_clients(robot):
    """The whole command: two processes, all sockets on 127.0.0.1; the tool moves by 3 mm."""
    command = [sys.executable, "-m", "twin", "machine", robot, "--quiet", "--start", "--ros", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        url = ""
        while "rosbridge for ROS clients: ws://127.0.0.1:" not in url:
            url = process.stdout.readline()
            assert url, "the command has ended"
        port = int(url.rsplit(":", 1)[1])
        name = f"/{robot.upper()}"

        async def move():
            async with connected(port) as client:
                await client.send("subscribe", topic=f"{name}/measured_cp")
                await client.send("subscribe", topic=f"{name}/operating_state")
                await until(lambda: client.heard.get(f"{name}/operating_state", [{}])[-1].get("is_homed"), 60)
                start = placed(client.heard[f"{name}/measured_cp"][-1])
                goal = spatial.pose(start[:3, :3], start[:3, 3] + np.array([0, 0, -3]) * MM)

                def arrived():
                    T = placed(client.heard[f"{name}/measured_cp"][-1])
                    turned = spatial.log_so3(T[:3, :3] @ goal[:3, :3].T)
                    return np.linalg.norm((T - goal)[:3, 3]) < 0.3 * MM and np.linalg.norm(turned) < 1 * DEG

                await servo(client, f"{name}/servo_cp", goal, arrived)
                return client.statuses

        assert not asyncio.run(move())
    finally:
        process.kill()
        process.communicate()
