"""Access control of `twin view`: foreign names, pages and messages are refused; what a page may say is passed on."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import math
import os
import pty
import random
import socket
import time
import urllib.error
import urllib.request
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager, suppress
from pathlib import Path

import msgspec
import numpy as np
import pytest
import viser
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

import twin
from made.ports import free_port
from twin.cli.terminal import Terminal
from twin.core.errors import TwinError
from twin.core.foreign.consent import NO_CODE
from twin.simulation.machine import machine_server as machines
from twin.ui.access import rate_limits as limits
from twin.ui.access.rules import AccessRules
from twin.ui.session import recorded_session as session_files
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.recorded_session import RecordedSession
from twin.ui.viewer import admission, message_filter
from twin.ui.viewer import server as servers
from twin.ui.viewer.front import ShownRobot
from twin.ui.viewer.page import open_page
from twin.ui.viewer.server import serve

PROTOCOL = f"viser-v{viser.__version__}"
CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1, 0, 0, 0], "position": [1, 1, 1.0], "fov": 1.0, "near": 0.1,
    "far": 1000.0, "image_height": 90, "image_width": 160, "look_at": [0, 0, 0], "up_direction": [0, 0, 1],
}  # fmt: skip


def pack(type, **fields):
    return msgspec.msgpack.encode({"type": type, **fields})


@pytest.fixture(scope="module")
def hibou():
    return twin.load("hibou")


@contextmanager
def page_of(robot, host="127.0.0.1", **more):
    """A front, stepped by hand, with access rules for `host`; `.tokens` is filled if clients need one."""
    tokens: list[str] = []
    port = free_port()
    server = serve("access", "127.0.0.1", port, AccessRules(host, port, False, tokens.append))
    front = open_page("access", [ShownRobot(robot.name, robot.name, MovableRobot(robot))], None, server, **more)
    front.tokens = tokens  # type: ignore[attr-defined]
    try:
        yield front
    finally:
        front.close()


@pytest.fixture(scope="module")
def front(hibou):
    with page_of(hibou) as front:
        yield front


def element(front, label):
    """Return the handle of the page's element with a label."""
    return next(h for h in front.server.gui._gui_input_handle_from_uuid.values() if getattr(h, "label", "") == label)


def labels(front):
    return {getattr(h, "label", "") for h in front.server.gui._gui_input_handle_from_uuid.values()}


def filter_of(front):
    """Return the message filter of a front, which its server's notices go through."""
    return FILTERS[front.server]


FILTERS: dict[viser.ViserServer, message_filter.MessageFilter] = {}


@pytest.fixture(autouse=True, scope="module")
def _remember():
    patch = pytest.MonkeyPatch()
    set_server = message_filter.MessageFilter.set_server

    def remember(self, server):
        set_server(self, server)
        FILTERS[server] = self

    patch.setattr(message_filter.MessageFilter, "set_server", remember)
    yield
    patch.undo()


@asynccontextmanager
async def joined(front, **more):
    """A client as viser's own page is one."""
    where = f"ws://127.0.0.1:{front.server.get_port()}/"
    async with connect(where, subprotocols=[PROTOCOL], max_size=None, **more) as ws:  # type: ignore[list-item]
        reading = asyncio.ensure_future(_drain(ws))
        await ws.send(msgspec.msgpack.encode(CAMERA))
        try:
            yield ws
        finally:
            reading.cancel()


async def _drain(ws):
    with suppress(ConnectionClosed):
        async for _ in ws:
            pass


async def until(condition, what, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, what
        await asyncio.sleep(0.01)


def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def get(front, path="/", **headers):
    """Return status, headers and body of a request."""
    request = urllib.request.Request(f"http://127.0.0.1:{front.server.get_port()}{path}", headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, dict(answer.headers), answer.read()
    except urllib.error.HTTPError as error:
        return error.code, dict(error.headers), error.read()


# ------------------------------------------------------------------------------------------------------- the rules


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Origin": "https://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": "http://127.0.0.1:1"}, 403),
        ({"Host": "evil.example"}, 421),
        ({"Host": "evil.example", "Origin": "http://evil.example"}, 421),  # DNS rebinding
        ({"Host": "127.0.0.1.evil.example"}, 421),
        ({"Host": ""}, 421),
    ],
)
def test_foreign_names_and_pages_are_refused(front, headers, status):
    assert get(front, **headers)[0] == status

    async def go():
        port = front.server.get_port()
        with socket.create_connection(("127.0.0.1", port)) as s:
            lines = {"Host": f"127.0.0.1:{port}", "Upgrade": "websocket", "Connection": "Upgrade", **headers}
            lines |= {"Sec-WebSocket-Key": "x3JJHMbDL1EzLkh9GBhXDw==", "Sec-WebSocket-Version": "13"}
            lines["Sec-WebSocket-Protocol"] = PROTOCOL
            s.sendall(("GET / HTTP/1.1\r\n" + "".join(f"{k}: {v}\r\n" for k, v in lines.items()) + "\r\n").encode())
            assert s.recv(100).split()[1] == str(status).encode()

    asyncio.run(go())


def test_its_own_page_comes_in_and_may_speak_with_nobody_else(front):
    status, headers, body = get(front)
    assert status == 200
    assert b"<html" in body
    policy = headers["Content-Security-Policy"]
    assert "connect-src 'self' data: blob:;" in policy  # `?websocket=ws://evil.example` leads nowhere
    assert "frame-ancestors 'none'" in policy
    assert get(front, "/../../../etc/passwd")[0] == 404
    assert get(front, "/index.html")[0] == 404

    async def go():
        async with joined(front, origin=f"http://127.0.0.1:{front.server.get_port()}"):
            await until(front.server.get_clients, "the client")

    asyncio.run(go())


def test_who_has_no_token_stays_outside_when_it_is_open(hibou):
    with page_of(hibou, "0.0.0.0", local=False) as front:
        assert get(front)[0] == 403
        assert get(front, "/?token=guess")[0] == 403

        async def refused(**more):
            with pytest.raises(InvalidStatus) as error:
                async with joined(front, **more):
                    pass
            return error.value.response.status_code

        assert asyncio.run(refused()) == 403
        token = front.tokens[-1]
        status, headers, _ = get(front, f"/?token={token}")
        assert status == 200
        assert get(front, f"/?token={token}")[0] == 403  # it opened once
        cookie = headers["Set-Cookie"].partition(";")[0]
        assert {"HttpOnly", "SameSite=Strict"} <= set(headers["Set-Cookie"].split("; "))
        assert get(front, Cookie=cookie)[0] == 200
        assert asyncio.run(refused(additional_headers={"Cookie": cookie}, origin="http://evil.example")) == 403

        async def go():
            async with joined(front, additional_headers={"Cookie": cookie}):
                await until(front.server.get_clients, "the client")

        asyncio.run(go())


def test_nothing_is_written_from_the_network(hibou):
    with page_of(hibou, "0.0.0.0", local=False, terminal=Answers(True)) as front:
        assert {"Load a session", "● Record"} <= labels(front)
        assert not labels(front) & {"Save the session", "as a posture", "as the protocol's last phase", "name"}


def test_a_viser_that_opens_its_socket_by_itself_is_stopped(monkeypatch):
    @contextmanager
    def nothing(access):
        yield

    monkeypatch.setattr(servers, "_opening", nothing)
    with pytest.raises(TwinError, match="without access control"):
        serve("access", "127.0.0.1", 0)


# --------------------------------------------------------------------------------------------------- the terminal


class Answers:
    """In place of a terminal: says the same to everything."""

    def __init__(self, yes):
        self.yes, self.asked = yes, []

    def ask(self, question, then):
        self.asked.append(question)
        then(self.yes)

    def poll(self):
        pass


@pytest.mark.parametrize("yes", [True, False])
def test_a_posture_is_written_if_the_terminal_says_yes(tmp_path, yes):
    import shutil

    shutil.copytree(twin.core.assets.data_folder() / "cad/hibou", tmp_path / "hibou/cad")
    shutil.copytree(twin.core.assets.data_folder() / "trajectories/hibou", tmp_path / "hibou/trajectories")
    robot = twin.load(tmp_path / "hibou")
    assert robot.files is not None
    before = robot.files.description.read_bytes()
    terminal = Answers(yes)
    with page_of(robot, terminal=terminal) as front:

        async def go(name):
            async with joined(front) as ws:
                await ws.send(pack("GuiUpdateMessage", uuid=element(front, "name")._impl.uuid, updates={"value": name}))
                await until(lambda: element(front, "name").value == name, "the name")
                button = element(front, "as a posture")._impl.uuid
                await ws.send(pack("GuiUpdateMessage", uuid=button, updates={"value": True}))
                await until(lambda: front.has_requests("save"), "the wish")
            # viser warns of a notice to a browser that leaves at that moment
            await until(lambda: not front.server.get_clients(), "the end of the connection")

        asyncio.run(go("\x1b[2Jevil"))
        front.step()
        assert not terminal.asked  # no name of a posture, nor for a terminal
        asyncio.run(go("from_the_page"))
        assert robot.files.description.read_bytes() == before
        front.step()
        front.step()
    assert len(terminal.asked) == 1
    assert str(robot.files.description) in terminal.asked[0]
    assert (b"[posture.from_the_page]" in robot.files.description.read_bytes()) == yes
    assert (robot.files.description.read_bytes() == before) != yes


def test_without_a_terminal_there_is_no_button_that_writes_a_robot(front):
    assert not labels(front) & {"as a posture", "as the protocol's last phase"}
    assert "Save the session" in labels(front)


@pytest.mark.parametrize(("typed", "yes"), [(b"y\n", True), (b"yes\n", True), (b"n\n", False), (b"\n", False)])
def test_the_terminal_waits_for_an_answer_that_comes_after_the_question(typed, yes, monkeypatch):
    ours, theirs = pty.openpty()
    answers: list[bool] = []
    try:
        terminal = Terminal(theirs)
        monkeypatch.setattr(terminal, "_in_front", lambda: True)
        os.write(ours, b"y\n")  # typed before anything was asked
        terminal.ask("Write it?", answers.append)
        terminal.poll()
        assert answers == []
        with pytest.raises(TwinError, match="answer the open question"):
            terminal.ask("And this?", answers.append)
        os.write(ours, typed)
        end = time.monotonic() + 60
        while not answers and time.monotonic() < end:
            terminal.poll()
        assert answers == [yes]
        monkeypatch.setattr("twin.cli.terminal.PATIENCE", -1.0)
        terminal.ask("Write it?", answers.append)
        terminal.poll()
        assert answers == [yes, False]  # no answer is a no
    finally:
        os.close(ours)
        os.close(theirs)


# --------------------------------------------------------------------------------------------------- the messages


def nonsense(front):
    """Yield messages that no page of ours sends."""
    name, box = element(front, "curve")._impl.uuid, element(front, "loop")._impl.uuid
    button = element(front, "▶ Play")._impl.uuid
    slider = front.panels.move.sliders[0]._impl.uuid
    upload = element(front, "Load a session")._impl.uuid
    yield "text"
    yield b""
    yield b"\xc1"
    yield b"\x91" * 5000  # nested lists
    yield b"\x81\xa1a" * 5000
    yield msgspec.msgpack.encode([1, 2])
    yield pack("NoSuchMessage")
    for kind in ("ShareUrlRequest", "ShareUrlDisconnect"):  # a tunnel through the firewall
        yield pack(kind)
    yield pack("GuiFormSubmitMessage", uuid=name)
    yield pack("CommandTriggerMessage", uuid=name)
    yield pack("RunJavascriptMessage", source="alert(1)")
    yield pack("SetCameraPositionMessage", position=[0, 0, 0])
    yield pack("GuiUpdateMessage", uuid=name, updates={"update_cb": []})
    yield pack("GuiUpdateMessage", uuid=name, updates={"value": "speed", "removed": True})
    yield pack("GuiUpdateMessage", uuid=name, updates={"value": "no such curve"})
    yield pack("GuiUpdateMessage", uuid=name, updates={"value": 3})
    yield pack("GuiUpdateMessage", uuid=box, updates={"value": "yes"})
    yield pack("GuiUpdateMessage", uuid=slider, updates={"value": True})
    for value in (math.nan, math.inf, 1e300, "1", [1], None, {}):
        yield pack("GuiUpdateMessage", uuid=slider, updates={"value": value})
    yield pack("GuiUpdateMessage", uuid=upload, updates={"value": {"name": "x", "content": b"y" * 1000}})
    yield pack("GuiUpdateMessage", uuid=name, updates={"value": "x" * (message_filter.MAX_ORDINARY_BYTES - 200)})
    yield pack("GuiUpdateMessage", uuid=button, updates={"value": ["x"] * 1000})
    yield msgspec.msgpack.encode({**CAMERA, "fov": "wide"})
    yield msgspec.msgpack.encode({**CAMERA, "fov": math.nan})
    yield msgspec.msgpack.encode({**CAMERA, "wxyz": [0, 0, 0, 0]})
    yield msgspec.msgpack.encode({**CAMERA, "position": [0, 0]})
    yield msgspec.msgpack.encode({**CAMERA, "more": 1})
    yield pack("TransformControlsUpdateMessage", name="/tool", wxyz=[0, 0, 0, 0], position=[0, 0, 0])
    yield pack("TransformControlsUpdateMessage", name="/tool", wxyz=[1, 0, 0, 0], position=[1e300, 0, 0])
    yield pack("FileTransferStartUpload", source_component_uuid=box, transfer_uuid="t", filename="f", mime_type="",
               part_count=1, size_bytes=1)  # fmt: skip
    yield pack("FileTransferStartUpload", source_component_uuid=upload, transfer_uuid="t", filename="f", mime_type="",
               part_count=-1, size_bytes=1)  # fmt: skip
    yield pack("GetRenderResponseMessage", payload=b"no picture", render_uuid="x")
    bomb = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + (60000).to_bytes(4, "big") * 2
    yield pack("GetRenderResponseMessage", payload=bomb, render_uuid="x")


class Someone:
    was_cut = False

    def cut(self):
        self.was_cut = True


def test_nonsense_is_not_passed_on(front):
    reader = filter_of(front)
    messages = list(nonsense(front))
    for message in messages:
        with pytest.raises((message_filter.NonsenseError, message_filter.StaleError)):
            reader.check(message, Someone(), 0.0)
    assert len(messages) >= 40


def test_what_pages_send_is_passed_on(front):
    reader = filter_of(front)
    for handle in front.server.gui._gui_input_handle_from_uuid.values():
        if isinstance(handle, viser.GuiUploadButtonHandle) or not hasattr(handle, "value"):
            continue
        message = pack("GuiUpdateMessage", uuid=handle._impl.uuid, updates={"value": handle.value})
        if getattr(handle, "disabled", False):
            with pytest.raises(message_filter.StaleError):
                reader.check(message, Someone(), 0.0)
        else:
            reader.check(message, Someone(), 0.0)
    reader.check(msgspec.msgpack.encode(CAMERA), Someone(), 0.0)
    drag = {"instance_index": None, "start_position": [0, 0, 0], "start_screen_pos": [0, 0], "end_position": [0, 0, 1],
            "end_screen_pos": [0, 1], "button": "left", "modifier": "shift"}  # fmt: skip
    for phase in ("start", "update", "end"):
        reader.check(pack("SceneNodeDragMessage", phase=phase, name="/a", **drag), Someone(), 0.0)


def test_random_bytes_and_mutants_raise_nothing_else(front):
    """Whatever comes, the server's loop lives on."""
    reader, rng = filter_of(front), random.Random(17)
    seeds = [m for m in nonsense(front) if isinstance(m, bytes)] + [msgspec.msgpack.encode(CAMERA)]
    for _ in range(3000):
        message = bytearray(rng.choice(seeds)[:600] or b"\0")
        for _ in range(rng.randint(1, 4)):
            message[rng.randrange(len(message))] = rng.randrange(256)
        with suppress(message_filter.NonsenseError, message_filter.StaleError):
            reader.check(bytes(message), Someone(), 0.0)


def test_who_sends_nonsense_again_and_again_is_cut_and_moves_nothing(front, caplog):
    q = front.active.movable.assembly.q.copy()

    async def go():
        async with joined(front) as other:
            async with joined(front) as ws:
                with suppress(ConnectionClosed):
                    for message in nonsense(front):
                        await ws.send(message)
                await asyncio.wait_for(ws.wait_closed(), 60)
            await until(lambda: len(front.server.get_clients()) == 1, "the other one, alone")
            await other.ping()

    with caplog.at_level(logging.WARNING):
        asyncio.run(go())
    front.step()
    np.testing.assert_array_equal(front.active.movable.assembly.q, q)
    assert not caplog.records


# ------------------------------------------------------------------------------------------------------ the pages


class Page(Someone):
    def __init__(self, address="a", heard=0.0):
        self.address = address
        self.heard = heard


def test_a_page_is_admitted_after_a_valid_message_and_its_place_is_given_back():
    admission_of_pages = admission.Admission()
    mute = [Page() for _ in range(admission.MAX_WAITING_OF_ADDRESS + 3)]
    for page_client in mute:
        admission_of_pages.wait(page_client)
    assert [page_client.was_cut for page_client in mute] == [True] * 3 + [False] * admission.MAX_WAITING_OF_ADDRESS
    assert not admission_of_pages.admit(mute[0], 0.0)
    good = [Page(heard=float(k)) for k in range(admission.MAX_PAGES_OF_ADDRESS)]
    for page_client in good:
        admission_of_pages.wait(page_client)
        assert admission_of_pages.admit(page_client, page_client.heard)
        assert admission_of_pages.admit(page_client, page_client.heard), "a page stays admitted"
    assert not any(page_client.was_cut for page_client in good)
    late, other = Page(heard=30.0), Page("b", heard=30.0)
    admission_of_pages.wait(late)
    admission_of_pages.wait(other)
    assert not admission_of_pages.admit(late, admission.IDLE_TIME), "nobody is idle"
    assert admission_of_pages.admit(other, admission.IDLE_TIME), "another address has a number of its own"
    assert admission_of_pages.admit(late, admission.IDLE_TIME + 0.5), "the first one is idle now"
    assert [page_client.was_cut for page_client in good] == [True] + [False] * (admission.MAX_PAGES_OF_ADDRESS - 1)
    admission_of_pages.remove(good[1])
    last = Page(heard=30.0)
    admission_of_pages.wait(last)
    assert admission_of_pages.admit(last, admission.IDLE_TIME + 0.6)
    assert not any(page_client.was_cut for page_client in good[1:])
    for k in range(admission.MAX_PAGES):
        page_client = Page(f"c{k}", heard=30.0)
        admission_of_pages.wait(page_client)
        assert admission_of_pages.admit(page_client, 21.0) == (
            k < admission.MAX_PAGES - admission.MAX_PAGES_OF_ADDRESS - 1
        )


def test_garbage_takes_no_place_of_a_page(front):
    """More clients than pages are admitted send nothing, or nonsense; then as many pages as are admitted come."""

    async def go():
        async with AsyncExitStack() as stack:
            where = f"ws://127.0.0.1:{front.server.get_port()}/"
            for k in range(admission.MAX_WAITING_OF_ADDRESS + 4):
                other = connect(where, subprotocols=[PROTOCOL], max_size=None)  # type: ignore[list-item]
                ws = await stack.enter_async_context(other)
                if k % 2:
                    with suppress(ConnectionClosed):
                        await ws.send(b"nonsense")
            pages = [await stack.enter_async_context(joined(front)) for _ in range(admission.MAX_PAGES_OF_ADDRESS)]
            await until(lambda: _admitted(front) == admission.MAX_PAGES_OF_ADDRESS, "the pages are admitted")
            for page in pages:
                await (await page.ping())
            async with joined(front) as late:
                await asyncio.wait_for(late.wait_closed(), 60)
                assert late.close_code == 1013
            await pages.pop().close()
            async with joined(front) as late:
                await until(lambda: _admitted(front) == admission.MAX_PAGES_OF_ADDRESS, "another page is admitted")
                await (await late.ping())
            assert all(page.close_code is None for page in pages)

    asyncio.run(go())


def _admitted(front):
    """Return the number of clients whose camera is known."""
    return sum(client.camera._state.update_timestamp > 0 for client in front.server.get_clients().values())


# ------------------------------------------------------------------------------------------------------ the files


def start(front, size, parts, transfer="t"):
    upload = element(front, "Load a session")._impl.uuid
    return pack("FileTransferStartUpload", source_component_uuid=upload, transfer_uuid=transfer,
                filename="session.json", mime_type="application/json", part_count=parts, size_bytes=size)  # fmt: skip


def part(front, index, content, transfer="t"):
    upload = element(front, "Load a session")._impl.uuid
    return pack("FileTransferPart", source_component_uuid=upload, transfer_uuid=transfer, part_index=index,
                content=content)  # fmt: skip


def test_a_session_is_loaded_and_the_longest_one_fits(front, tmp_path):
    movable = front.active.movable
    session = RecordedSession.of(movable.mechanism)
    rng = np.random.default_rng(3)
    for k in range(3):
        session.add(
            k + rng.random(),
            movable.assembly.q + 1e-6 * rng.random(len(movable.assembly.q)),
            movable.assembly.T_base_tool,
        )
    session.save(tmp_path / "session.json")
    content = (tmp_path / "session.json").read_bytes()
    moments = content[content.index(b'"moments"') :]
    assert session_files.MAX_MOMENTS * len(moments) / 3 * 8 / 5 < message_filter.MAX_UPLOAD_BYTES  # with eight joints

    async def go():
        async with joined(front) as ws:
            await ws.send(start(front, len(content), 2))
            await ws.send(part(front, 0, content[:100]))
            await ws.send(part(front, 1, content[100:]))
            await until(lambda: front.has_requests("open"), "the file")

    asyncio.run(go())
    front.step()
    assert front.panels.move.record.session is not None
    assert len(front.panels.move.record.session.moments) == 3


def test_an_upload_is_one_at_a_time_in_order_and_no_larger_than_it_said(front):
    reader, a, b = filter_of(front), Someone(), Someone()
    told: list[str] = []
    before, reader.notify = reader.notify, told.append
    try:
        with pytest.raises(message_filter.StaleError, match="too large"):
            reader.check(start(front, message_filter.MAX_UPLOAD_BYTES + 1, 33), a, 100.0)
        assert "at most 16.8 MB" in told[0]
        with pytest.raises(message_filter.StaleError, match="no upload was started"):
            reader.check(part(front, 0, b"x" * 500_000), a, 100.0)
        for wrong in ([(1, 5)], [(0, 5), (0, 5)], [(0, 11)], [(0, 5), (1, 4)], [(0, 10)]):
            a.was_cut = False
            reader.check(start(front, 10, 2), a, 100.0)
            *good, bad = wrong
            for index, size in good:
                reader.check(part(front, index, b"x" * size), a, 100.0)
            with pytest.raises(message_filter.NonsenseError):
                reader.check(part(front, bad[0], b"x" * bad[1]), a, 100.0)
            assert a.was_cut
        a.was_cut = False
        reader.check(start(front, 10, 2), a, 200.0)
        with pytest.raises(message_filter.StaleError, match="another upload"):
            reader.check(start(front, 10, 2, "u"), b, 201.0)
        with pytest.raises(message_filter.StaleError):
            reader.check(part(front, 0, b"xxxxx"), b, 201.0)
        reader.check(
            start(front, 10, 2, "u"), b, 200.0 + message_filter.UPLOAD_TIMEOUT + 1
        )  # the first one never ended
        assert a.was_cut
        reader.forget(b)
        reader.check(start(front, 10, 2, "v"), a, 500.0)
        reader.forget(a)
    finally:
        reader.notify = before


HEAD = '{"schema": "twin-session", "version": 1, "robot": "hibou", "joints": [], "moments": ['


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (HEAD + "{}," * 2_000_000 + "{}]}", "values, more than the maximum"),
        (
            HEAD + "{" + ",".join(f'"{k}": 1' for k in range(100_000)) + "}]}",
            "keys; an object of a session has at most",
        ),
        (HEAD + "{}," * 1_000_000 + "{}]}", "time_s: Field required"),
        ("[" * 1_000_000, "not JSON"),
        (HEAD + '{"time_s": ' + "9" * 100_000 + "}]}", "digits"),
    ],
    ids=["values", "keys", "moments", "depth", "digits"],
)
def test_a_file_that_would_grow_when_it_is_read_is_refused_before(hibou, tmp_path, text, why):
    (tmp_path / "session.json").write_text(text)
    before = resident()
    with pytest.raises(TwinError, match=why):
        RecordedSession.load(tmp_path / "session.json", hibou.mechanism)
    assert resident() - before < 250


@pytest.mark.slow
def test_memory_stays_when_large_files_come(front):
    """16 clients of 100 MB each, honest and dishonest about it, and the server has what it had before."""
    room = b"\0" * 500_000

    async def attack(honest):
        with suppress(ConnectionClosed, OSError, TimeoutError, InvalidStatus):
            async with asyncio.timeout(20), joined(front) as ws:
                await ws.send(start(front, 100_000_000 if honest else message_filter.MAX_UPLOAD_BYTES, 200))
                for k in range(200):
                    await ws.send(part(front, k, room))

    async def go():
        for _ in range(2):
            await asyncio.gather(*(attack(k % 2 == 0) for k in range(8)))

    asyncio.run(attack(True))
    before = resident()
    asyncio.run(go())
    print(f"memory grew by {resident() - before:.1f} MB")
    assert resident() - before < 60
    assert not front.server.gui._current_file_upload_states


def test_what_security_says_is_so():
    from twin.ui.headset import recording

    text = " ".join((Path(twin.__file__).parents[1] / "SECURITY.md").read_text(encoding="utf-8").split())
    for figure in (
        f"at most {message_filter.MAX_UPLOAD_BYTES / 1e6:.1f} MB",
        f"{session_files.MAX_MOMENTS:,} moments are read".replace(",", " "),
        f"{recording.MAX_DURATION // 60} minutes and {recording.MAX_SIZE / 1e6:.0f} MB each",
        f"admits {admission.MAX_PAGES} pages, {admission.MAX_PAGES_OF_ADDRESS} of them from one address",
        f"up to {admission.MAX_WAITING_OF_ADDRESS} clients of one address wait, "
        f"each for at most {admission.FIRST_MESSAGE_TIMEOUT:g} s",
        f"silent for {admission.IDLE_TIME:g} s",
        f"accepts {limits.MAX_WEBSOCKETS} WebSockets, {limits.MAX_WEBSOCKETS_OF_ADDRESS} from one address",
        f"{recording.MAX_RECORDINGS} files and {recording.MAX_TOTAL_SIZE / 1e9:.0f} GB for one start", NO_CODE,
    ):  # fmt: skip
        assert figure in text, figure
    assert f"at most {machines.READERS} connections" in text
    assert ipaddress.ip_address(machines.HOST).is_loopback  # whoever changes this adds a token to the buttons
    assert "eleven kinds" in text
    assert len(message_filter._ORDINARY_MESSAGES) + len(message_filter._LONG_MESSAGES) == 11
