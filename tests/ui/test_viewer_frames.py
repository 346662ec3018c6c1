"""Poses on viser's wire: whole frames, every move, and the last pose for who comes late."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import viser
import zstandard
from websockets.sync.client import ClientConnection, connect

TWIN = Path(__file__).parents[2] / "twin"
TIMEOUT = 60.0
"""Seconds that nothing here ever needs."""
PARTS = {"SetPositionMessage": "position", "SetOrientationMessage": "wxyz"}

Window = dict[tuple[str, str], tuple[float, ...]]
"""What one update carries: values by node name and part of the pose."""


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


class Client:
    """A viewer without a browser: connected, and the scene as it was at that moment is in `replay`."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket, self.replay = socket, {}
        done = False
        while not done:
            messages = self._messages()
            self.replay |= poses(messages)
            done = any(m["type"] == "ReplayDoneMessage" for m in messages)

    def _messages(self) -> list[dict[str, Any]]:
        data = self.socket.recv(timeout=TIMEOUT)
        assert isinstance(data, bytes)
        packed = data[16 : 16 + int.from_bytes(data[8:16], "little")]
        return msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(packed))["messages"]

    def window(self) -> Window:
        """Return the next update that carries poses."""
        while not (found := poses(self._messages())):
            pass
        return found


def poses(messages: list[dict[str, Any]]) -> Window:
    """Return the poses of links; viser has nodes of its own."""
    mine = [m for m in messages if m["type"] in PARTS and m["name"].startswith("/link")]
    return {(m["name"], PARTS[m["type"]]): tuple(m[PARTS[m["type"]]]) for m in mine}


@contextmanager
def viewer(server: viser.ViserServer) -> Iterator[Client]:
    protocol = f"viser-v{viser.__version__}"
    url = f"ws://127.0.0.1:{server.get_port()}"
    with connect(
        url, subprotocols=[protocol], compression=None, max_size=None, proxy=None, open_timeout=TIMEOUT
    ) as socket:
        yield Client(socket)


def links(server: viser.ViserServer, count: int) -> list[viser.FrameHandle]:
    return [server.scene.add_frame(f"/link{i}") for i in range(count)]


def frame(count: int, number: float) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and quaternions that all begin with the number of their frame; sent as given, unit or not."""
    return np.full((count, 3), float(number)), np.full((count, 4), float(number))


def frames_of(shown: Window) -> set[float]:
    return {value[0] for value in shown.values()}


def writer(server: viser.ViserServer, handles: list[viser.FrameHandle]):
    from twin.ui.viewer.pose_frames import FrameWriter  # here, or no test could say what viser lacks

    return FrameWriter(server, handles)


def test_every_micrometre_arrives(server):
    w = writer(server, links(server, 1))
    q = np.array([[1.0, 0, 0, 0]])
    steps = [0.5 + k * 1e-6 for k in range(50)]
    w.write(np.array([[steps[0], 0, 0]]), q)
    with viewer(server) as client:
        for x in steps[1:]:
            w.write(np.array([[x, 0, 0]]), q)
            assert client.window() == {("/link0", "position"): (x, 0, 0)}


@pytest.mark.parametrize(("count", "frames"), [(20, 200), (100, 50)])
def test_no_update_mixes_two_frames(server, count, frames):
    """Neither the update nor the scene after it, also if a frame is longer than viser's usual update of 128."""
    w = writer(server, links(server, count))
    w.write(*frame(count, 1))
    with viewer(server) as client:
        shown = client.replay
        for number in range(2, frames + 2):
            w.write(*frame(count, number))
        while max(frames_of(shown)) <= frames:
            shown |= client.window()
            assert len(shown) == 2 * count
            assert len(frames_of(shown)) == 1


def test_check_of_frames_sees_a_torn_one(server):
    handles = links(server, 20)
    writer(server, handles).write(*frame(20, 1))
    with viewer(server) as client:
        for handle in handles[:10]:
            handle.position = (2, 2, 2)
        shown = client.replay | client.window()
        assert frames_of(shown) == {1, 2}


def test_who_comes_late_sees_the_last_pose(server):
    handles = links(server, 3)
    w = writer(server, handles)
    p, q = np.arange(9.0).reshape(3, 3) / 7, np.arange(12.0).reshape(3, 4) / 7
    for k in range(5):
        w.write(p + k * 1e-7, q)
    with viewer(server) as client:
        for i, handle in enumerate(handles):
            assert client.replay[f"/link{i}", "position"] == tuple(p[i] + 4e-7) == tuple(handle.position)
            assert client.replay[f"/link{i}", "wxyz"] == tuple(q[i]) == tuple(handle.wxyz)


def test_only_what_changed_is_sent_in_one_block_with_one_flush(server, monkeypatch):
    handles = links(server, 3)
    w = writer(server, handles)
    p, q = frame(3, 1)
    w.write(p, q)
    p[0] = 5  # the writer keeps no hold on what it was given
    assert handles[0].position[0] == 1
    p[0] = 1
    calls = []
    atomic, flush = server.atomic, server.flush
    monkeypatch.setattr(server, "atomic", lambda: calls.append("atomic") or atomic())
    monkeypatch.setattr(server, "flush", lambda: calls.append("flush") or flush())
    with viewer(server) as client:
        w.write(p, q)
        p[1, 2] = np.nextafter(1, 2)
        w.write(p, q)
        assert client.window() == {("/link1", "position"): tuple(p[1])}
        handles[1].position = (7, 7, 7)  # moved by somebody else: writing the pose again puts it back
        assert client.window() == {("/link1", "position"): (7, 7, 7)}
        w.write(p, q)
        assert client.window() == {("/link1", "position"): tuple(p[1])}
    assert calls == ["atomic", "flush"] * 3


@pytest.mark.parametrize(("p", "q"), [((2, 3), (3, 4)), ((3, 3), (3, 3)), ((1, 3), (1, 4)), ((3,), (4,))])
def test_poses_of_other_shapes_are_refused(server, p, q):
    with pytest.raises(ValueError, match=r"3 nodes must be \(3, 3\) and \(3, 4\)"):
        writer(server, links(server, 3)).write(np.zeros(p), np.zeros(q))


@pytest.mark.parametrize(
    "path",
    [
        "_impl.name",
        "_impl.position",
        "_impl.wxyz",
        "_impl.api._queue_scene_message",
        "_impl.api._websock_interface.get_message_buffer",
    ],
)
def test_viser_has_the_private_names(server, path):
    thing: Any = server.scene.add_frame("/link")
    for name in path.split("."):
        assert hasattr(thing, name), (
            f"viser {viser.__version__} has no {path}: adapt _Node in twin/ui/viewer/pose_frames.py"
        )
        thing = getattr(thing, name)


def test_viser_has_the_messages_and_the_size_of_an_update(server):
    told = f"of viser {viser.__version__}: adapt _Node in twin/ui/viewer/pose_frames.py"
    messages = import_module("viser._messages")
    for kind, part in PARTS.items():
        assert hasattr(messages, kind), f"no {kind} in the messages {told}"
        taken = getattr(messages, kind)("/link", (0.0, 1.0))
        assert (taken.name, getattr(taken, part, None)) == ("/link", (0.0, 1.0)), f"other fields in {kind} {told}"
    buffer = server.scene.add_frame("/link")._impl.api._websock_interface.get_message_buffer()
    assert isinstance(getattr(buffer, "max_window_size", None), int), f"no max_window_size in the buffer {told}"


def test_no_nodes_are_a_frame_as_well(server):
    writer(server, []).write(np.zeros((0, 3)), np.zeros((0, 4)))


def test_private_names_are_where_they_are_guarded():
    """Batched poses, access control before the socket, the messages that come in: each refuses a viser that differs."""
    words = ("viser._", "from viser import _", "_queue_scene_message", "_websock")
    found = {p.relative_to(TWIN).as_posix() for p in TWIN.rglob("*.py") if any(w in p.read_text() for w in words)}
    assert found == {"ui/viewer/pose_frames.py", "ui/viewer/server.py", "ui/viewer/message_filter.py"}
