"""How old a frame of `twin serve` is when it arrives: 8 clients at 60 Hz, alone, beside 10 hostile ones, beside a hand.

    python tests/benchmarks/stream.py [robot] [--seconds 60] [--clients 8]

The server is a process of its own, the clients are another, the hostile ones a third. Age is the time from the moment
for which the server owed the frame (in the frame) to its receipt, by the one monotonic clock of the machine; so a late
tick counts. Torn is a frame whose link poses are not all those of the one sample of the protocol that it names; the
protocol is planned here once more for that. Missed are numbers that a client did not get; left out are frames that
the server never made because it was late. Exit code 1 if a bar is broken: p95 < 50 ms, none torn. Not a test.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import numpy as np
from websockets.asyncio.client import connect

import twin
from twin.ui.headset.stream_frames import RobotFrame, sevens, unpack
from twin.ui.session.timeline import TICK_RATE, prepare

BAR_MS = 50.0

ELSEWHERE = "127.0.0.66"
"""Where the hostile ones come from: places and openings are counted by address, so theirs are not the good ones'."""


# ------------------------------------------------------------------------------------------------ good clients


async def listen(port: int, seconds: float, play: bool, drag: bool) -> list[tuple[float, bytes]]:
    """Return the frames with the times at which they came."""
    out: list[tuple[float, bytes]] = []
    async with connect(f"ws://127.0.0.1:{port}/ws", compression=None, max_size=None) as ws:
        hand = None
        if play:
            await ws.send('{"type":"play","on":true}')
        if drag:
            hand = asyncio.ensure_future(guide(ws))
        until = time.monotonic() + seconds
        try:
            async for message in ws:
                now = time.monotonic()
                if isinstance(message, bytes):
                    out.append((now, message))
                if now > until:
                    return out
        finally:
            if hand is not None:
                hand.cancel()
    raise SystemExit("the server has ended the connection of a good client")


async def guide(ws) -> None:
    """Drag the first joint to and fro, 90 times a second."""
    about = json.loads(os.environ["ABOUT"])
    await ws.send(json.dumps({"type": "grab", "target": "joint", "name": about["joint"]}))
    start = time.monotonic()
    while True:
        value = about["q"] + 0.01 * np.sin(2 * (time.monotonic() - start))
        await ws.send(json.dumps({"type": "drag", "value": value}))
        await asyncio.sleep(1 / 90)


async def clients(port: int, seconds: float, count: int, drag: bool) -> list[list[tuple[float, bytes]]]:
    """Return what each client got."""
    return await asyncio.gather(*(listen(port, seconds, n == 0 and not drag, n == 1 and drag) for n in range(count)))


# ------------------------------------------------------------------------------------------------ hostile clients


def dial(port: int, window: int | None = None, upgrade: bool = True) -> socket.socket:
    """Return a socket, a WebSocket if that is wanted."""
    s = socket.socket()
    if window is not None:
        s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, window)
    s.settimeout(5.0)
    s.bind((ELSEWHERE, 0))
    s.connect(("127.0.0.1", port))
    if upgrade:
        s.sendall(
            f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
    return s


def masked(payload: bytes, opcode: int = 1) -> bytes:
    """Return a client's frame."""
    n = len(payload)
    size = bytes([0x80 | n]) if n < 126 else bytes([0x80 | 126]) + n.to_bytes(2, "big")
    return bytes([0x80 | opcode]) + size + b"\0\0\0\0" + payload


def pour(data: bytes, pause: float, window: int | None = None):
    """Return one who sends the same again and again, reads nothing, and comes back when he is thrown out."""

    def act(port: int) -> None:
        with dial(port, window) as s:
            while True:
                s.sendall(data)
                time.sleep(pause)

    return act


def half_open(port: int) -> None:
    """Open a dozen connections and say nothing."""
    held = [dial(port, upgrade=False) for _ in range(12)]
    time.sleep(4.0)
    for s in held:
        s.close()


def slow_reader(port: int) -> None:
    """Read a few bytes now and then, through a tiny window."""
    with dial(port, 2048) as s:
        while s.recv(64):
            time.sleep(0.05)


def never_reads(port: int) -> None:
    """Read nothing at all, through a tiny window."""
    with dial(port, 2048):
        time.sleep(20.0)


def churn(port: int) -> None:
    """Come and go."""
    for _ in range(20):
        dial(port).close()
        time.sleep(0.01)


HOSTILE = {
    "garbage": pour(masked(b"{garbage"), 0.002),
    "binary garbage": pour(masked(os.urandom(100), 2), 0.002),
    "flood of good requests": pour(masked(b'{"type":"ping","t":1}') * 20, 0.005),
    "flood of pings": pour(masked(b"", 9) * 200, 0.005),
    "oversized": pour(masked(b"x" * 60_000), 0.01),
    "half open": half_open,
    "slow reader": slow_reader,
    "never reads": never_reads,
    "drags without a grab": pour(masked(b'{"type":"drag","value":1}'), 0.004),
    "comes and goes": churn,
}


def hostile(port: int, seconds: float) -> None:
    """Let all of them act, and print how often each was thrown out."""
    thrown: Counter[str] = Counter()
    until = time.monotonic() + seconds

    def act(name: str) -> None:
        while time.monotonic() < until:
            with suppress(OSError):
                HOSTILE[name](port)
            thrown[name] += 1
            time.sleep(0.05)

    for name in HOSTILE:
        threading.Thread(target=act, args=(name,), daemon=True).start()
    time.sleep(seconds)
    print(json.dumps(thrown))


# ------------------------------------------------------------------------------------------------ measuring


def used(pid: int) -> tuple[float, float]:
    """Return the s of processor time and the MB that a command of twin has used; `pid` is the supervising process."""
    command = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()[0]
    fields = Path(f"/proc/{command}/stat").read_text().rpartition(")")[2].split()
    pages = int(Path(f"/proc/{command}/statm").read_text().split()[1])
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"), pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def judge(title: str, got: list[list[tuple[float, bytes]]], truth, seconds: float) -> bool:
    """Print what came of a run; return whether it keeps the bars."""
    ages, torn, missed, most = [], 0, 0, 0
    checked: dict[int, bool] = {}
    for rows in got:
        frames = [(t, unpack(data)) for t, data in rows]
        ages += [t - f.server_time for t, f in frames]
        seqs = [f.seq for _, f in frames]
        missed += seqs[-1] - seqs[0] + 1 - len(seqs)
        most = max(most, seqs[-1] - seqs[0] + 1)
        for _, f in frames:
            if truth is not None and f.seq not in checked:
                checked[f.seq] = whole(f, *truth)
            torn += not checked.get(f.seq, True)
    ages_ms = 1e3 * np.array(ages)
    p50, p95, p99 = np.percentile(ages_ms, [50, 95, 99])
    left = max(0, round(seconds * TICK_RATE) - most)
    print(f"{title}: {len(got)} clients, {len(ages)} frames, {most / seconds:.1f} Hz")
    print(f"  age p50 {p50:.2f} ms, p95 {p95:.2f} ms, p99 {p99:.2f} ms, worst {ages_ms.max():.1f} ms")
    shown = f"torn {torn} of {len(ages)}" if truth is not None else "torn: not checked (no protocol plays)"
    print(f"  {shown}, missed {missed}, left out by the server {left}")
    return bool(p95 < BAR_MS and torn == 0)


def whole(f, t: np.ndarray, poses: np.ndarray) -> bool:
    """Return whether a frame is the one sample that it names."""
    k = int(np.argmin(np.abs(t - f.clip_time)))
    own = poses[k].copy()
    own[np.sum(own[:, 3:] * f.poses[:, 3:], axis=1) < 0, 3:] *= -1  # q and -q are one rotation
    return bool(t[k] == f.clip_time and np.allclose(own, f.poses, atol=1e-7, rtol=0))


def bites(t: np.ndarray, poses: np.ndarray) -> bool:
    """Return whether a frame is seen to be torn that has one link of the sample before, and another is not."""
    k = len(t) // 4
    mixed = poses[k].copy()
    moving = int(np.argmax(np.abs(poses[k] - poses[k - 1]).max(axis=1)))
    mixed[moving] = poses[k - 1, moving]
    frames = [RobotFrame(0, 0.0, float(t[k]), p.astype(np.float32), np.zeros(0), 0) for p in (poses[k], mixed)]
    return whole(frames[0], t, poses) and not whole(frames[1], t, poses)


def part(role: str, port: int, seconds: float, count: int, **environment: str) -> subprocess.Popen:
    """Start this file in another process, in another role."""
    command = [sys.executable, __file__, "--role", role, "--port", str(port)]
    command += ["--seconds", str(seconds), "--clients", str(count)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, env={**os.environ, **environment})


def main() -> int:
    """Run the three measurements."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robot", nargs="?", default="sils")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--clients", type=int, default=8)
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--role", default="")
    args = parser.parse_args()
    if args.role == "hostile":
        hostile(args.port, args.seconds)
        return 0
    if args.role:
        got = asyncio.run(clients(args.port, args.seconds, args.clients, args.role == "hand"))
        sys.stdout.buffer.write(pickle.dumps(got))
        return 0

    robot = twin.load(args.robot)
    playback = prepare(args.robot, None)
    model = robot.bound(robot.protocol()).reference()
    links = model.link_poses(playback.x)
    truth = playback.t, np.stack([sevens(links[b.name]) for b in robot.mechanism.bodies], axis=1)
    assert bites(*truth)
    active = robot.mechanism.active[0]
    about = json.dumps({"joint": active.name, "q": float(playback.q[len(playback.q) // 2, 0])})
    command = [sys.executable, "-m", "twin", "serve", args.robot, "--port", "0", "--no-browser"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert server.stdout is not None
    port = int(server.stdout.readline().split("127.0.0.1:")[1].split("/")[0])
    asyncio.run(planned(port))
    good = True
    try:
        for title, with_hostile, role in (
            ("alone", False, "good"), ("beside 10 hostile clients", True, "good"), ("while one drags", False, "hand"),
        ):  # fmt: skip
            before = used(server.pid)
            others = part("hostile", port, args.seconds + 3.0, 0) if with_hostile else None
            time.sleep(1.0 if others else 0.0)
            listeners = part(role, port, args.seconds, args.clients, ABOUT=about)
            got = pickle.loads(listeners.communicate()[0])
            after = used(server.pid)
            good &= judge(title, got, truth if role == "good" else None, args.seconds)
            print(f"  server: {100 * (after[0] - before[0]) / args.seconds:.0f} % of a core, {after[1]:.0f} MB")
            if others is not None:
                thrown = json.loads(others.communicate()[0])
                print("  thrown out: " + ", ".join(f"{n} {c}" for n, c in thrown.items()))
            assert server.poll() is None, "the server has ended"
    finally:
        start = time.monotonic()
        server.send_signal(signal.SIGINT)
        code = server.wait(20)
        print(f"Ctrl-C: ended with {code} after {time.monotonic() - start:.2f} s")
    return 0 if good and code == 0 else 1


async def planned(port: int) -> None:
    """Wait until the protocol can be played."""
    async with connect(f"ws://127.0.0.1:{port}/ws", compression=None) as ws:
        async for message in ws:
            if isinstance(message, str) and json.loads(message).get("duration"):
                return


if __name__ == "__main__":
    sys.exit(main())
