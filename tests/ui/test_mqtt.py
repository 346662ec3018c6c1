"""The motion scale by MQTT, through a real broker and the real server."""

from __future__ import annotations

import asyncio
import gc
import logging
import time
from contextlib import asynccontextmanager, suppress

import aiomqtt
import numpy as np
import pytest

from made.broker import Broker
from made.streaming import joined, serving
from twin.core.errors import TwinError
from twin.ui.headset import mqtt, served_content
from twin.ui.headset.mqtt import ScaleTopic

TOPIC = "twin/davinci/scale"


@pytest.fixture
def broker():
    found = Broker().start()
    yield found
    found.stop()


class Tablet:
    """A client of the broker: what it is told, by topic, and when."""

    def __init__(self, client):
        self.client, self.heard = client, []
        self._reader = asyncio.ensure_future(self._read())

    async def _read(self):
        async for message in self.client.messages:
            self.heard.append((str(message.topic), message.payload.decode(), bool(message.retain)))

    async def set(self, payload, **more):
        await self.client.publish(f"{TOPIC}/set", payload, **more)

    def last(self, topic=TOPIC):
        return next((payload for t, payload, _ in reversed(self.heard) if t == topic), None)

    async def until(self, what, seconds=60.0):
        end = time.monotonic() + seconds
        while not what():
            assert time.monotonic() < end, self.heard[-5:]
            await asyncio.sleep(0.001)


@asynccontextmanager
async def tablet(port):
    async with aiomqtt.Client("127.0.0.1", port, socket_options=mqtt._NO_DELAY) as client:
        found = Tablet(client)
        for topic in (TOPIC, f"{TOPIC}/available"):
            await client.subscribe(topic, qos=1)
        yield found
        found._reader.cancel()


def console(loaded, port):
    return lambda: served_content.of_console(loaded, mqtt=("127.0.0.1", port))


@pytest.mark.slow
def test_a_tablet_sets_the_scale_and_sees_it(broker, bare_theatre):
    """From the tablet's message to the broker until the broker tells the tablet that the World has used it."""

    async def go():
        taken, seen = [], []
        async with (
            tablet(broker.port) as pad,
            serving(console(bare_theatre, broker.port)) as s,
            joined(s.port) as peer,
        ):
            await pad.until(lambda: pad.last() == "0.5" and pad.last(f"{TOPIC}/available") == "online")
            for k in range(15):
                value = 0.1 + 0.04 * (k % 5)
                begin = time.monotonic()
                await pad.set(repr(value))
                await pad.until(lambda: s.live.world.signals["pedals.scale"][0] == value)  # noqa: B023
                taken.append(time.monotonic() - begin)
                await pad.until(lambda: pad.last() == repr(value))  # noqa: B023
                seen.append(time.monotonic() - begin)
                await asyncio.sleep(0.02)
            await peer.until(lambda: peer.last("state")["console"]["scale"] == value)
            assert peer.last("state")["console"]["mqtt"] == {
                "broker": f"127.0.0.1:{broker.port}",
                "topic": TOPIC,
                "connected": True,
                "problem": None,
            }
            await peer.say("scale", value=0.75)  # a page sets it too
            await pad.until(lambda: pad.last() == "0.75")
        print("ms until applied, until seen:", *(np.round(1e3 * np.array(x), 1) for x in (taken, seen)))
        async with tablet(broker.port) as late:
            # whoever comes later sees it too, and that the server has ended
            await late.until(lambda: late.last() == "0.75" and late.last(f"{TOPIC}/available") == "offline")

    asyncio.run(go())


CONNACK, SUBACK = b"\x20\x02\0\0", b"\x90\x03\0\1\1"

WRONG = {
    "another protocol": [b"HTTP/1.1 400 Bad Request\r\n\r\n"],
    "no answer": [],
    "refused": [b"\x20\x02\0\5"],
    "a short CONNACK": [b"\x20\x01\0"],
    "an unknown packet": [CONNACK, b"\0\0"],
    "a short SUBACK": [CONNACK, b"\x90\0"],
    "the end after CONNACK": [CONNACK, None],
    "the end": [CONNACK, SUBACK, None],
    "a short PUBLISH": [CONNACK, SUBACK, b"\x30\1\0"],
    "a topic that is not UTF-8": [CONNACK, SUBACK, b"\x30\5\0\2\xff\xfe1"],
    "a length without end": [CONNACK, SUBACK, b"\x30" + b"\xff" * 6],
    "DISCONNECT": [CONNACK, SUBACK, b"\xe0\0"],
}
"""Answers of a broker that breaks the protocol, one for each packet; None closes the connection."""


@pytest.mark.filterwarnings(
    "ignore::pytest.PytestUnraisableExceptionWarning"
)  # aiomqtt leaves sockets to its keep-alive
@pytest.mark.parametrize("answers", WRONG.values(), ids=WRONG.keys())
def test_a_broker_that_breaks_the_protocol_is_reported_and_nothing_else_is_logged(answers, monkeypatch):
    monkeypatch.setattr(mqtt, "_RETRY_PAUSE", 0.01)
    monkeypatch.setattr(mqtt, "_TIMEOUT", 0.3)
    connections, logged, told = [], [], []
    gc.freeze()  # the two searches for garbage, below, leave out what earlier tests made

    async def answered(reader, writer):
        connections.append(writer)
        with suppress(ConnectionError):
            for answer in answers:
                await reader.read(4096)
                if answer is None:
                    writer.close()
                    return
                writer.write(answer)
            while await reader.read(4096):  # until the client leaves
                pass
        writer.close()

    async def go():
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: logged.append(context["message"]))
        server = await asyncio.start_server(answered, "127.0.0.1", 0)
        topic = ScaleTopic("127.0.0.1", server.sockets[0].getsockname()[1], "a", (0.05, 1.0), 0.5, told.append)
        topic.reports.tell = told.append
        running = asyncio.ensure_future(topic.run())
        end = time.monotonic() + 60
        while len(connections) < 3:  # it has tried again, twice
            assert time.monotonic() < end
            assert not running.done()
            await asyncio.sleep(0.01)
        while not running.done():  # `asyncio.wait_for` of Python 3.11 may lose a cancellation
            running.cancel()
            await asyncio.wait((running,), timeout=0.1)
        server.close()
        for writer in connections:
            writer.close()
        await asyncio.sleep(0.05)
        gc.collect()  # asyncio logs an error that nothing has retrieved when its future is deleted

    asyncio.run(go())
    gc.collect()
    assert "the motion scale stays 0.5; trying again every" in told[0]
    assert [text for text in logged if "never retrieved" in text] == []


REFUSED = {
    "2": "2 is outside 0.05 to 1",
    "0.04": "0.04 is outside 0.05 to 1",
    "-1": "-1 is outside 0.05 to 1",
    "nan": "nan is outside 0.05 to 1",
    "inf": "inf is outside 0.05 to 1",
    "": "'' is not a number; send 0.05 to 1",
    "half": "'half' is not a number; send 0.05 to 1",
    "0_1": "'0_1' is not a number",
    b"\xff\xfe": "is not a number",
    "0.3 " * 10_000: "is not a number",
    '{"scale": 0.3}': "is not a number",
}


def test_what_is_no_scale_is_refused_by_name(broker, bare_theatre, monkeypatch, caplog):
    monkeypatch.setattr(mqtt, "_REPORT_PAUSE", 0.0)

    async def go():
        async with (
            tablet(broker.port) as pad,
            serving(console(bare_theatre, broker.port)) as s,
            joined(s.port) as peer,
        ):
            await pad.until(lambda: pad.last() == "0.5" and pad.last(f"{TOPIC}/available") == "online")
            for payload, text in REFUSED.items():
                pad.heard.clear()
                await pad.set(payload)
                await pad.until(lambda: pad.last() == "0.5")  # the tablet's slider goes back
                await pad.until(lambda: text in (s.live.tablet.problem or ""))  # noqa: B023
                problem = s.live.tablet.problem
                assert problem.startswith(f"MQTT topic {TOPIC}/set: ")
                assert problem.endswith("; the motion scale stays 0.5")
                await peer.until(lambda: said(peer, problem))  # noqa: B023
                assert problem in caplog.text
            await pad.set("0.3")
            await peer.until(lambda: s.live.world.signals["pedals.scale"][0] == 0.3)
            assert s.live.tablet.problem is None

    with caplog.at_level(logging.WARNING):
        asyncio.run(go())


def said(peer, text):
    return any(d.get("message") == text for d in peer.documents)


@pytest.mark.slow
def test_a_broker_that_goes_away_is_told_and_found_again(broker, bare_theatre, monkeypatch, caplog):
    monkeypatch.setattr(mqtt, "_RETRY_PAUSE", 0.1)

    async def go():
        broker.stop()
        async with serving(console(bare_theatre, broker.port)) as s, joined(s.port) as peer:
            await peer.until(lambda: s.live.tablet.problem is not None)
            why = f"MQTT broker 127.0.0.1:{broker.port} cannot be reached"
            assert s.live.tablet.problem.startswith(why)
            assert "the motion scale stays 0.5; trying again every 0.1 s" in s.live.tablet.problem
            await peer.until(lambda: why in (peer.last("state")["console"]["mqtt"]["problem"] or ""))
            broker.start()
            await peer.until(lambda: peer.last("state")["console"]["mqtt"]["connected"])
            async with tablet(broker.port) as pad:
                await pad.set("0.2")
                await pad.until(lambda: pad.last() == "0.2")
            broker.stop()
            await peer.until(lambda: not peer.last("state")["console"]["mqtt"]["connected"])
            assert peer.last("state")["console"]["scale"] == 0.2
            broker.start()
            await peer.until(lambda: peer.last("state")["console"]["mqtt"]["connected"])
            async with tablet(broker.port) as pad:  # a broker that has forgotten all is told anew
                await pad.until(lambda: pad.last() == "0.2" and pad.last(f"{TOPIC}/available") == "online")
                await pad.set("0.4", retain=True)
                await pad.until(lambda: pad.last() == "0.4")
            messages = [d["message"] for d in peer.documents if d["type"] == "error"]
            assert sum(why in m for m in messages) <= 1, "told once, not for each attempt"
            assert (
                sum(f"127.0.0.1:{broker.port} has disconnected: the motion scale stays 0.2" in m for m in messages) == 1
            )
            assert sum("is connected again" in m for m in messages) == 2

    with caplog.at_level(logging.WARNING):
        asyncio.run(go())
    assert "is connected again" in caplog.text


def test_a_retained_command_is_old_and_changes_nothing(broker, bare_theatre):
    async def go():
        async with tablet(broker.port) as pad:
            await pad.set("0.9", retain=True)
            async with serving(console(bare_theatre, broker.port)) as s:
                await pad.until(lambda: s.live.tablet.problem is not None)
                assert "a retained message is ignored" in s.live.tablet.problem
                assert s.live.world.signals["pedals.scale"][0] == 0.5
                await pad.set("0.9")
                await pad.until(lambda: pad.last() == "0.9")

    asyncio.run(go())


@pytest.mark.parametrize("host", ["no-such-host.invalid", "a..b", "x" * 300])
def test_a_broker_that_is_none_is_told(host):
    async def go():
        found, told = ScaleTopic(host, 1883, TOPIC, (0.05, 1.0), 0.5, print), []
        found.reports.tell = told.append
        task = asyncio.ensure_future(found.run())
        while not told:
            assert not task.done()
            await asyncio.sleep(0.01)
        task.cancel()
        assert told[0].startswith(f"MQTT broker {host}:1883 cannot be reached (")

    asyncio.run(go())


def test_another_server_in_place_of_a_broker_is_told(monkeypatch):
    monkeypatch.setattr(mqtt, "_TIMEOUT", 0.5)

    async def greet(reader, writer):
        writer.write(b"220 this is no broker\r\n" * 100)

    async def go():
        server = await asyncio.start_server(greet, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        found, told = ScaleTopic("127.0.0.1", port, TOPIC, (0.05, 1.0), 0.5, print), []
        found.reports.tell = told.append
        task = asyncio.ensure_future(found.run())
        while not told:
            assert not task.done()
            await asyncio.sleep(0.01)
        task.cancel()
        server.close()
        assert told[0].startswith(f"MQTT broker 127.0.0.1:{port} cannot be reached (")

    asyncio.run(go())


@pytest.mark.parametrize("topic", ["", "a/#", "a/+/b", "/a", "a/", "a\0b", "x" * 201])
def test_what_is_no_topic_is_refused(topic):
    with pytest.raises(TwinError, match="is not a valid topic: use 1 to 200 characters without"):
        ScaleTopic("127.0.0.1", 1883, topic, (0.05, 1.0), 0.5, print)
