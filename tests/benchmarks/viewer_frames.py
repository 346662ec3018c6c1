"""20 links at 60 Hz to one viewer client in a process of its own: viser's setters, the same in atomic(), FrameWriter.

    python tests/benchmarks/viewer_frames.py

Contenders take turns in one run on one server. Per frame: time in the call, CPU of the whole server process (all its
threads, the pauses of the loop included), and latency from the call until the client has every link at that frame or
a later one. Torn are windows after which links stand at different frames; dropped are frames that came without
their move of 1 um. Not a test.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable
from multiprocessing.connection import Connection

import msgspec
import numpy as np
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from twin.ui.viewer.pose_frames import FrameWriter

ROUNDS, FRAMES, LINKS, RATE = 3, 240, 20, 60.0
ANGLE = 1e-3
"""Half-angle in rad from frame to frame: setters see it, and all frames of a run differ."""
UM = 1e-6

Poses = tuple[np.ndarray, np.ndarray]
Window = tuple[float, list[tuple[str, tuple[float, ...]]]]


def poses(frame: int, step: int) -> Poses:
    """Return poses that tell their frame in z and in the half-angle, but for the last link: `step` um in x, no turn."""
    p, q = np.zeros((LINKS, 3)), np.zeros((LINKS, 4))
    p[:, 0], p[:-1, 2] = 0.5, frame
    p[-1, 0] += step * UM
    q[:, 0], q[:-1, 0], q[:-1, 3] = 1, np.cos(frame * ANGLE), np.sin(frame * ANGLE)
    return p, q


def client(port: int, out: Connection) -> None:
    """Note when which poses came, until the server stops; the first word says that the client is there."""
    windows: list[Window] = []
    unzip, protocol = zstandard.ZstdDecompressor(), f"viser-v{viser.__version__}"
    with connect(
        f"ws://127.0.0.1:{port}", subprotocols=[protocol], compression=None, max_size=None, proxy=None
    ) as socket:
        try:
            for data in socket:
                inner = msgspec.msgpack.decode(unzip.decompress(data[16 : 16 + int.from_bytes(data[8:16], "little")]))
                now, found = time.perf_counter(), []
                for m in inner["messages"]:
                    if m["type"] == "ReplayDoneMessage":
                        out.send("there")
                    elif m["type"] in ("SetPositionMessage", "SetOrientationMessage") and m["name"].startswith("/link"):
                        found.append((m["name"], tuple(m["position"] if "position" in m else m["wxyz"])))
                if found:
                    windows.append((now, found))
        except ConnectionClosed:
            pass
    out.send(windows)


def run(write: Callable[[np.ndarray, np.ndarray], None], first: int) -> tuple[list[float], list[float], float]:
    """Show the frames of one turn; return when each was given (s), the time in each call (s), and CPU per frame (s)."""
    given, spent = [], []
    cpu, start = time.process_time(), time.perf_counter()
    for k in range(FRAMES):
        p, q = poses(first + k, k)
        time.sleep(max(0.0, start + k / RATE - time.perf_counter()))
        given.append(time.perf_counter())
        write(p, q)
        spent.append(time.perf_counter() - given[-1])
    time.sleep(0.2)
    return given, spent, (time.process_time() - cpu) / FRAMES


def judge(windows: list[Window], first: int, given: list[float]) -> tuple[list[float], int, int, int]:
    """Return the latencies (s) of a turn, its torn windows, all its windows, and its dropped moves."""
    z, angle = np.full(LINKS - 1, first - 1), np.full(LINKS - 1, first - 1)
    latency, torn, frames, steps = [], 0, set(), set()
    done = first - 1
    for now, found in windows:
        for name, value in found:
            i = int(name.removeprefix("/link"))
            if i == LINKS - 1:
                steps.add(value[0])
            elif len(value) == 3:
                z[i] = value[2]
                frames.add(int(value[2]))
            else:
                angle[i] = round(np.arctan2(value[3], value[0]) % (2 * np.pi) / ANGLE)
        oldest = int(min(z.min(), angle.min()))
        torn += oldest != max(z.max(), angle.max())
        latency += [now - given[k - first] for k in range(done + 1, oldest + 1)]
        done = max(done, oldest)
    dropped = sum(poses(k, k - first)[0][-1, 0] not in steps for k in frames if k > first)
    return latency, torn, len(windows), dropped


def main() -> None:
    """Race, and print one line per contender."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    handles = [server.scene.add_frame(f"/link{i}") for i in range(LINKS)]
    writer = FrameWriter(server, handles)

    def setters(p: np.ndarray, q: np.ndarray) -> None:
        for handle, position, wxyz in zip(handles, p, q, strict=True):
            handle.position, handle.wxyz = position, wxyz

    def atomic(p: np.ndarray, q: np.ndarray) -> None:
        with server.atomic():
            setters(p, q)

    contenders = {"setters": setters, "setters in atomic()": atomic, "FrameWriter": writer.write}
    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=client, args=(server.get_port(), there))
    process.start()
    here.recv()
    turns, first = [], 1
    for _ in range(ROUNDS):
        for name, write in contenders.items():
            writer.write(*poses(first - 1, -1))
            time.sleep(0.2)
            turns.append((name, first, time.perf_counter(), *run(write, first)))
            first += FRAMES + 1
    server.stop()
    windows = here.recv()
    process.join()

    print(f"{'':22s}{'call us':>9s}{'CPU us':>9s}{'median ms':>11s}{'p95 ms':>9s}{'torn':>9s}{'dropped':>12s}")
    base = None
    for name in contenders:
        mine = [t for t in turns if t[0] == name]
        found = [
            judge([w for w in windows if start < w[0] < given[-1] + 0.2], first, given)
            for _, first, start, given, _, _ in mine
        ]
        call = float(np.median([s for t in mine for s in t[4]])) * 1e6
        cpu = float(np.median([t[5] for t in mine])) * 1e6
        latency = np.array([s for f in found for s in f[0]]) * 1e3
        torn, count, dropped = (sum(f[i] for f in found) for i in (1, 2, 3))
        median, p95 = np.median(latency), np.percentile(latency, 95)
        base = base or (call, cpu, median)
        print(
            f"{name:22s}{call:9.0f}{cpu:9.0f}{median:11.2f}{p95:9.2f}{torn / count:9.1%}"
            f"{dropped:6d}/{ROUNDS * (FRAMES - 1)}   x {call / base[0]:.2f} call, {cpu / base[1]:.2f} CPU, "
            f"{median / base[2]:.2f} latency   {len(latency)} frames in {count} windows"
        )


if __name__ == "__main__":
    main()
