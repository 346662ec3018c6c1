"""Helpers for tests of the stream: a server on a free port, and clients that store all messages they receive."""

from __future__ import annotations

import asyncio
import json
import time
from contextlib import asynccontextmanager, suppress
from types import SimpleNamespace

from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from made.ports import free_port
from twin.ui.access.responses import File
from twin.ui.access.rules import AccessRules
from twin.ui.headset import served_content
from twin.ui.headset import stream_frames as wire
from twin.ui.headset.recording import StreamRecording
from twin.ui.headset.scene_frame import MAGIC, SceneFrame, unpack_scene
from twin.ui.headset.server import StreamServer

PAGE = {
    "/": File(b"<html>a page for the test</html>" * 40, "text/html; charset=utf-8"),
    "/app.js": File(b"let a = 1;", "text/javascript; charset=utf-8"),
}


def unpack_any(data: bytes) -> wire.RobotFrame | SceneFrame:
    """Return the frame of a robot or of a scene in a binary message."""
    if data[:4] == MAGIC.to_bytes(4, "little"):
        return unpack_scene(data)
    return wire.unpack(data)


class Planned:
    """Replacement of a planner; its job is done at once, without a plan."""

    playback = None

    def __init__(self, robot, protocol):
        self.done, self.answer = True, self.playback

    def close(self):
        pass


@asynccontextmanager
async def serving(robot, host="127.0.0.1", source=None, record=None, plans=True, context=None):
    """Yield a server on a free port, with the attributes `server`, `port`, `twin`, `live`, `tokens` and `rules`."""
    shown = robot() if callable(robot) else served_content.of_robot(robot, robot.name, None, plans)
    of, recording = shown.live, None
    if record is not None:
        recording = StreamRecording(record, shown.name, shown.model_hash, of.links, of.joints, of.version)
    port = free_port()
    tokens: list[str] = []
    rules = AccessRules(host, port, context is not None, tokens.append)
    server = StreamServer(source or of, shown.hello, PAGE | shown.files, rules, recording)
    await server.start("127.0.0.1", port, context)
    running = asyncio.ensure_future(server.run())
    try:
        first = next(iter(getattr(of, "twins", {}).values()), None)  # a console has none
        yield SimpleNamespace(server=server, port=server.port, twin=first, live=of, tokens=tokens, rules=rules)
    finally:
        server.stopping.set()
        await running
        of.close()


class Peer:
    """A client that stores all messages it receives: `frames`, `raw`, `documents`, and `times` of the frames in s."""

    def __init__(self, ws):
        self.ws, self.frames, self.raw, self.documents = ws, [], [], []
        self.times = []
        self._reader = asyncio.ensure_future(self._read())

    async def _read(self):
        with suppress(ConnectionClosed):
            async for m in self.ws:
                if isinstance(m, bytes):
                    self.times.append(time.monotonic())
                    self.raw.append(m)
                    self.frames.append(unpack_any(m))
                else:
                    self.documents.append(json.loads(m))

    async def say(self, type, **fields):
        await self.ws.send(json.dumps({"type": type, **fields}))

    async def ask(self, type, **fields):
        """Return the answer to a request."""
        id = len(self.documents) + 1000
        await self.say(type, id=id, **fields)
        return await self.until(lambda: next((d for d in self.documents if d.get("id") == id), None))

    async def until(self, what, seconds=60.0):
        """Call `what` until its result is true, and return the result; fail after a time limit in s.

        `last` without a message of its type counts as not true yet.
        """
        end = time.monotonic() + seconds
        while not (found := _result(what)):
            assert time.monotonic() < end, (self.documents[-3:], self.frames[-1:])
            assert not self._reader.done() or time.monotonic() < end - seconds + 0.2, "the line was closed"
            await asyncio.sleep(0.005)
        return found

    async def state(self, **wanted):
        def found():
            states = [d for d in self.documents if d["type"] == "state"]
            return states and all(states[-1][k] == v for k, v in wanted.items()) and states[-1]

        return await self.until(found)

    def last(self, type):
        return next(d for d in reversed(self.documents) if d["type"] == type)


def _result(what):
    try:
        return what()
    except StopIteration:
        return None


@asynccontextmanager
async def joined(port, query="", **options):
    options.setdefault("compression", None)
    async with connect(f"ws://127.0.0.1:{port}/ws{query}", **options) as ws:
        peer = Peer(ws)
        await peer.until(lambda: any(d["type"] == "hello" for d in peer.documents) and peer.frames)
        yield peer


async def http(port, request, host=None):
    """Send a raw HTTP request; return (status, headers, body)."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    if isinstance(request, str):
        request = f"{request}\r\nHost: {host or f'127.0.0.1:{port}'}\r\n".encode()
    writer.write(request + b"\r\n")
    answer = await asyncio.wait_for(reader.read(), 60)
    writer.close()
    head, _, body = answer.partition(b"\r\n\r\n")
    lines = head.decode().split("\r\n")
    fields = {k.lower(): v for k, _, v in (line.partition(": ") for line in lines[1:])}
    return int(lines[0].split()[1]) if lines[0] else 0, fields, body
