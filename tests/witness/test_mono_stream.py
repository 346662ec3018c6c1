"""The StreamClient of the Unity package on mono, with real sockets: against a server that misbehaves, and our own."""

from __future__ import annotations

import asyncio
import json
import struct
import time
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from websockets.asyncio.server import serve
from websockets.datastructures import Headers
from websockets.http11 import Response

from made.cloth import Cloth
from made.lanes import nightly
from made.ports import free_port
from unity import mono

ROOT = Path(__file__).parents[2]
LINKS = ["base", "arm", "tool_link"]
ROBOT = {
    "schema": "twin-robot",
    "version": 1,
    "name": "model",
    "frame": "z-up right-handed",
    "links": LINKS,
    "joints": [{"name": "q1", "lower": None, "upper": None, "index": None}],
    "tool": {"link": "tool_link", "T_link_tool": [0, 0, 0, 0, 0, 0, 1]},
    "postures": [],
}

pytestmark = pytest.mark.witness

PATIENCE = 60.0
"""Time in s within which a state must come, also on a busy computer."""


def frame(seq: int, x: float = 0.0, links: int = 3, magic: bytes = b"TWN1") -> bytes:
    """A frame of the stream whose last link is at (x, 2, 3)."""
    poses = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] * (links - 1) + [x, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]
    return struct.pack(f"<4sIddHHI{7 * links + 1}f", magic, seq, time.monotonic(), 0.5, links, 1, 2, *poses, 0.25)


class MonoHangsError(TimeoutError):
    """The program has ended and its client has closed, but the process of Mono goes on; seen once in a hundred runs."""


class Listener:
    """The program Listen: what it prints, and orders to it."""

    def __init__(self, process) -> None:
        self.process, self.said = process, []
        self._reader = asyncio.ensure_future(self._read())

    async def _read(self) -> None:
        while line := await self.process.stdout.readline():
            self.said.append(json.loads(line))

    def order(self, *words: object) -> None:
        self.process.stdin.write((" ".join(map(str, words)) + "\n").encode())

    async def until(self, what):
        """Return the first line for which something holds."""
        end = time.monotonic() + PATIENCE
        while not (found := [s for s in self.said if what(s)]):
            assert time.monotonic() < end, self.said[-3:]
            assert self.process.returncode is None, await self.process.stderr.read()
            await asyncio.sleep(0.01)
        return found[0]

    async def shows(self, sequence: int):
        return await self.until(lambda s: s["what"] == "frame" and s["sequence"] == sequence)


@asynccontextmanager
async def listening(folder: Path, address: str, links, robot: str = ""):
    command = ["mono", str(folder / "Listen.exe"), address, *([f"--robot={robot}"] if robot else []), *links]
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(
        *command, stdin=pipe, stdout=pipe, stderr=pipe, env=mono.surroundings()
    )
    listener = Listener(process)
    try:
        yield listener
        process.stdin.close()  # its thread that reads orders ends, which otherwise can delay the end of the program
        try:
            await asyncio.wait_for(process.wait(), 30)
            assert process.returncode == 0, await process.stderr.read()
        except TimeoutError:
            assert listener.said[-1]["what"] == "end", listener.said[-3:]
            raise MonoHangsError from None
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
        await listener._reader
        process._transport.close()


class Station:
    """A server of the stream that says what a test tells it to."""

    def __init__(self, port: int) -> None:
        self.port, self.heard, self.lines, self.asked = port, [], [], []
        self.answers = True

    async def __aenter__(self):
        self._server = await serve(
            self._client, "127.0.0.1", self.port, process_request=self._page, ping_interval=None, close_timeout=0.2
        )
        return self

    async def __aexit__(self, *_):
        self._server.close()
        await self._server.wait_closed()

    def _page(self, connection, request):
        self.asked.append(request.path)
        if request.path == "/robot.json":
            body = json.dumps(ROBOT).encode()
            return Response(200, "OK", Headers({"Content-Length": str(len(body)), "Connection": "close"}), body)
        return None

    async def _client(self, ws):
        await ws.send('{"type":"hello","protocol":1,"client":"c1","robot":"model","resume":"again"}')
        self.lines.append(ws)
        async for text in ws:
            message = json.loads(text)
            self.heard.append(message)
            if message["type"] == "ping" and self.answers:
                await ws.send(json.dumps({"type": "pong", "t": message["t"]}))

    async def line(self, number: int):
        """Return the nth connection as soon as it is there."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if len(self.lines) >= number:
                return self.lines[number - 1]
            await asyncio.sleep(0.01)
        raise AssertionError("nobody connected")

    async def hears(self, count: int) -> list[dict]:
        """Return the first messages that are no pings."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            found = [m for m in self.heard if m["type"] != "ping"]
            if len(found) >= count:
                return found
            await asyncio.sleep(0.01)
        raise AssertionError(self.heard)


def run(scenario) -> None:
    asyncio.run(asyncio.wait_for(scenario, 300))


async def newest_only(folder: Path) -> None:
    """A burst comes while the scene loads: the last frame is shown, and none of those before."""
    async with Station(free_port()) as station, listening(folder, f"http://127.0.0.1:{station.port}/", LINKS) as seen:
        ws = await station.line(1)
        await ws.send(frame(1, 0.5))
        first = await seen.shows(1)
        assert first["last"] == [-0.5, 2.0, 3.0]
        seen.order("pause", 600)
        await asyncio.sleep(0.2)
        for i in range(2, 302):
            await ws.send(frame(i, i / 100))
        last = await seen.shows(301)
        assert last["last"][0] == pytest.approx(-3.01, abs=1e-6)
        assert last["received"] == 301
        assert last["skipped"] >= 290
        assert sum(s["what"] == "frame" for s in seen.said) <= 10
        assert 0.0 <= last["age"] < 2.0


async def nothing_torn(folder: Path) -> None:
    """What is not a whole frame of this robot, or an old one, changes nothing and ends nothing."""
    async with Station(free_port()) as station, listening(folder, f"http://127.0.0.1:{station.port}/", LINKS) as seen:
        ws = await station.line(1)
        await ws.send(frame(10, 1.0))
        await seen.shows(10)
        bad = frame(12)
        infinite = frame(12)[:-4] + struct.pack("<f", float("inf"))
        for message in (b"", b"x", bad[:-1], bad + b"\0", frame(12, magic=b"TWN2"), frame(12, links=4), infinite):
            await ws.send(message)
        await ws.send(frame(9, 7.0))
        await ws.send(frame(10, 7.0))
        await ws.send('{"type":"cloud","points":"' + "A" * 300_000 + '","done":true}')
        await ws.send([frame(11, 2.0)[:40], frame(11, 2.0)[40:]])  # one message in two fragments
        last = await seen.shows(11)
        assert last["last"] == [-2.0, 2.0, 3.0]
        assert last["refused"] == 9
        assert [s["sequence"] for s in seen.said if s["what"] == "frame"] == [10, 11]
        assert last["connects"] == 1


async def comes_back(folder: Path) -> None:
    """The server ends and another begins on its port, counting from zero; the client comes back as itself."""
    port = free_port()
    async with listening(folder, f"http://127.0.0.1:{port}/", LINKS) as seen:
        await asyncio.sleep(0.5)  # there is no server at first
        async with Station(port) as station:
            ws = await station.line(1)
            await ws.send(frame(5000, 1.0))
            await seen.shows(5000)
        await seen.until(lambda s: s["state"] == "Waiting")
        async with Station(port) as station:
            ws = await station.line(1)
            assert "/ws?resume=again" in station.asked
            await ws.send(frame(3, 4.0))
            again = await seen.shows(3)
            assert again["last"] == [-4.0, 2.0, 3.0]
            assert again["connects"] == 2


async def silence(folder: Path) -> None:
    """A line that is half open: after five silent seconds a new one is made."""
    async with Station(free_port()) as station, listening(folder, f"http://127.0.0.1:{station.port}/", LINKS) as seen:
        station.answers = False
        ws = await station.line(1)
        began = time.monotonic()
        await ws.send(frame(1, 1.0))
        await seen.shows(1)
        second = await station.line(2)
        assert time.monotonic() - began > 4.0, "a line that is silent for a moment is kept"
        await second.send(frame(1, 2.0))
        await seen.until(lambda s: s["what"] == "frame" and s["connects"] == 2)


async def orders(folder: Path) -> None:
    """Grab, drag and release arrive in order, as the server reads them."""
    from twin.ui.headset.client_messages import parse_message

    async with Station(free_port()) as station, listening(folder, f"http://127.0.0.1:{station.port}/", LINKS) as seen:
        ws = await station.line(1)
        await ws.send(frame(1, 0.5))
        await seen.shows(1)
        heard: list[dict] = []
        for words in ("tool 0 0 0", "move 0.1 0 0", "end", "joint q1", "value 0.25", "end", "link arm 0 0 0", "end"):
            seen.order(words)
            heard = await station.hears(len(heard) + 1)
        kinds = ["grab", "drag", "release", "grab", "drag", "release", "grab", "release"]
        assert [m["type"] for m in heard] == kinds
        # The hand went to +x of Unity, which is -x of the robot: the model's own root is not turned here.
        assert heard[1]["pose"] == pytest.approx([0.4, 2.0, 3.0, 0, 0, 0, 1], abs=1e-6)
        assert heard[3] == {"type": "grab", "target": "joint", "name": "q1"}
        assert heard[4] == {"type": "drag", "value": 0.25}
        for message in station.heard:
            parse_message(json.dumps(message))
        end = time.monotonic() + PATIENCE
        while not any(m["type"] == "ping" for m in station.heard):
            assert time.monotonic() < end, "no ping"
            await asyncio.sleep(0.05)


async def a_scene(folder: Path) -> None:
    """`twin serve vsrs` with a field: a client follows one of the robots, holds that one and no other."""
    from twin.cli import scenes
    from twin.model.scene import load_scene
    from twin.ui.access.rules import AccessRules
    from twin.ui.headset import served_content
    from twin.ui.headset.server import StreamServer

    scene = load_scene(scenes.find("vsrs"))
    name = scene.places[1].name
    port, cloth = free_port(), Cloth(n=5)
    shown = served_content.of_scene(replace(scenes.load(scene), props=None, feed=cloth), False)
    server = StreamServer(shown.live, shown.hello, shown.files, AccessRules("127.0.0.1", port, False, lambda t: None))
    await server.start("127.0.0.1", port)
    running = asyncio.ensure_future(server.run())
    own = shown.live.twins[name]
    try:
        async with listening(folder, f"http://127.0.0.1:{port}/", own.links, name) as seen:
            before = await seen.until(lambda s: s["what"] == "frame")
            x, y, z = own.movable.assembly.link_poses[own.links[-1]][:3, 3]
            assert before["last"] == pytest.approx([-x, y, z], abs=1e-6)  # in its base, mirrored as glTFast does
            # The last vertex of the field, in the scene's world and not mirrored.
            assert before["vertex"] == pytest.approx(cloth.at(0.0).fields["cloth"][-1].tolist(), abs=1e-4)
            count, *rest = before["mesh"]
            assert count == len(cloth.at(0.0).fields["cloth"])
            vx, vy, vz = before["vertex"]
            assert rest[:3] == pytest.approx([-vx, vy, vz], abs=1e-7)  # drawn mirrored, as the robots are
            (surface,) = cloth.surfaces.values()
            assert rest[3:] == surface.triangles[:, ::-1].ravel().tolist()  # and its faces look outwards again
            seen.order("tool 0 0 0")
            await seen.until(lambda s: s["holding"])
            end = time.monotonic() + PATIENCE
            while own.holder is None and time.monotonic() < end:
                await asyncio.sleep(0.05)
            assert [t.holder is not None for t in shown.live.twins.values()] == [n == name for n in shown.live.twins]
            seen.order("end")
            await seen.until(lambda s: not s["holding"])
    finally:
        server.stopping.set()
        await running


SCENARIOS = {f.__name__: f for f in (newest_only, nothing_torn, comes_back, silence, orders, a_scene)}


@pytest.mark.parametrize("name", SCENARIOS)
def test_stream(build, name):
    try:
        run(SCENARIOS[name](build.folder))
    except MonoHangsError:  # a thread that the client leaves behind would do so again
        run(SCENARIOS[name](build.folder))


MUTATIONS = {
    "the oldest frame is kept": (
        "newest_only",
        "StreamConnection.cs",
        "                if (robot == null ||",
        "                if (fresh)\n                {\n                    return;\n                }\n\n"
        "                if (robot == null ||",
    ),
    "old frames are shown": (
        "nothing_torn",
        "StreamConnection.cs",
        "!first && !StreamFrame.IsNewer(incoming.Sequence, sequence)",
        "false",
    ),
    "torn frames are shown": ("nothing_torn", "StreamFrame.cs", "if (count != size)", "if (count < size)"),
    "another server's count is kept": ("comes_back", "StreamConnection.cs", "first = true;", ""),
    "one try only": (
        "comes_back",
        "StreamConnection.cs",
        "while (!stop.IsCancellationRequested)\n            {\n                heard = false;",
        "while (Connects == 0 && !stop.IsCancellationRequested)\n            {\n                heard = false;",
    ),
    "nobody watches the silence": (
        "silence",
        "StreamConnection.cs",
        "private const double SilentSeconds = 5.0;",
        "private const double SilentSeconds = 500.0;",
    ),
    "another robot of the scene is shown": (
        "a_scene",
        "StreamFrame.cs",
        "mine = i == robot ? at : mine;",
        "mine = at;",
    ),
    "all fields are at the corner of their box": (
        "a_scene",
        "StreamFrame.cs",
        "box[i % 3] + box[3 + i % 3] * U16(data, next + 2 * i)",
        "box[i % 3]",
    ),
    "deformables are not mirrored": (
        "a_scene",
        "DeformableMesh.cs",
        "Frames.ToUnity(new Vector3(points[3 * i], points[3 * i + 1], points[3 * i + 2]), convention)",
        "new Vector3(points[3 * i], points[3 * i + 1], points[3 * i + 2])",
    ),
    "the faces of deformables look inwards": (
        "a_scene",
        "DeformableMesh.cs",
        "corners[i - i % 3 + 2 - i % 3]",
        "corners[i]",
    ),
    "requests name no robot": ("a_scene", "StreamConnection.cs", "Requests.Of(door.Robot, json)", "json"),
    "no release": ("orders", "Grab.cs", "Send(Requests.Release(), false);", ""),
}
"""Name: scenario that must fail, file of the runtime, text that is there once, what takes its place."""


@pytest.mark.parametrize("name", nightly(MUTATIONS, every=3))
def test_a_mistake_is_seen(build, tmp_path, name, monkeypatch):
    monkeypatch.setitem(globals(), "PATIENCE", 10.0)  # what a mistake prevents never comes
    scenario, *change = MUTATIONS[name]
    assert build.mutant(tmp_path / "mutant", *change) == ""
    with pytest.raises((AssertionError, TimeoutError)):
        run(SCENARIOS[scenario](tmp_path / "mutant"))


async def our_own(folder: Path) -> None:
    """`twin serve`, open to the network: in by its token, grab the tool, and the loops follow."""
    import twin
    from twin.ui.access.responses import File
    from twin.ui.access.rules import AccessRules
    from twin.ui.headset import served_content
    from twin.ui.headset.server import StreamServer

    port, tokens = free_port(), []
    shown = served_content.of_robot(twin.load("sils"), "sils", None, plans=False)
    about = shown.live.twins["sils"].description
    pages = {"/": File(b"<html></html>", "text/html; charset=utf-8")} | shown.files
    server = StreamServer(shown.live, shown.hello, pages, AccessRules("0.0.0.0", port, False, tokens.append))
    await server.start("127.0.0.1", port)
    running = asyncio.ensure_future(server.run())
    try:
        address = f"http://127.0.0.1:{port}/?token={tokens[0]}"
        async with listening(folder, address, about["links"]) as seen:
            before = await seen.until(lambda s: s["what"] == "frame")
            seen.order("tool 0 0 0")
            await seen.until(lambda s: s["holding"])
            seen.order("move -0.01 0 0")
            moved = await seen.until(
                lambda s: s["what"] == "frame" and abs(s["last"][0] - before["last"][0] + 0.01) < 1e-4
            )
            assert moved["last"][1:] == pytest.approx(before["last"][1:], abs=1e-4)
            assert moved["refusal"] == ""
            assert len(tokens) == 2  # the first is spent, the next is announced
            seen.order("end")
    finally:
        server.stopping.set()
        await running


def test_our_own_server_is_followed(build):
    run(our_own(build.folder))
