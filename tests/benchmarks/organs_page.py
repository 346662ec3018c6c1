"""How often frames with all organs arrive while rods press them and Chromium draws them, and who takes the processor.

    python tests/benchmarks/organs_page.py [--seconds 10] [--pages 1] [--without-drawing]

The server is a process of its own; so are the pages of headless Chromium, and a client that only receives. Age is the
time from the moment for which the server owed the frame to its receipt by that client. Without a graphics processor, a
program draws for Chromium; `--without-drawing` leaves out the pictures of the scene, not the composition of the page.
Exit code 1 if the client gets fewer than 59 frames a second, or the 95th percentile of the age is 50 ms or more. Not a
test.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import subprocess
import sys
import time
from collections import defaultdict
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from websockets.asyncio.client import connect

HERE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(HERE / "tests"))

from made import headset_page, organs, streaming
from twin import api
from twin.cli import scenes
from twin.ui.headset import served_content
from twin.ui.headset.scene_frame import unpack_scene
from twin.ui.headset.server_files import page_files
from ui.test_tissue_pages import Pressed

BAR_HZ, BAR_MS = 59.0, 50.0

WAITED = 10
"""Number of frames that may have waited while the client did not read, and are not counted."""

TICKS = os.sysconf("SC_CLK_TCK")


async def serve() -> None:
    """Serve the scene with its organs under rods, and print the port; end with the input.

    For each line of input, it prints the time in s and the number of steps that the organs have done.
    """
    feed = Pressed()
    shown = served_content.of_scene(replace(scenes.load(api.load_scene("vsrs")), feed=feed), False)
    streaming.PAGE.update(page_files(HERE / "twin/ui/headset/web/dist", shown.preload) | dict(shown.late))
    async with streaming.serving(lambda: shown, plans=False) as s:
        print(s.port, flush=True)
        while await asyncio.to_thread(sys.stdin.readline):
            print(time.monotonic(), feed.organs._steps, flush=True)


async def listen(port: int, seconds: float) -> None:
    """Receive frames, and print rate, size, age and torn frames as JSON; they are read only afterwards."""
    times: list[float] = []
    raw: list[bytes] = []
    async with connect(f"ws://127.0.0.1:{port}/ws", compression=None) as ws:
        await asyncio.sleep(1.0)
        print("begins", flush=True)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if isinstance(message := await ws.recv(), bytes):
                times.append(time.monotonic())
                raw.append(message)
        print("ends", flush=True)
    times, raw = times[WAITED:], raw[WAITED:]
    frames = [unpack_scene(r) for r in raw]
    age = 1e3 * (np.array(times) - [f.server_time for f in frames])
    found = {
        "hz": (len(times) - 1) / (times[-1] - times[0]),
        "bytes": float(np.mean([len(r) for r in raw])),
        "torn": sum(organs.torn(f) for f in frames),
    }
    print(json.dumps(found | {f"p{p}": float(np.percentile(age, p)) for p in (50, 95)}))


def stepped(server: subprocess.Popen[str]) -> np.ndarray:
    """Return the time in s and the number of steps that the organs of the server have done."""
    assert server.stdin is not None
    assert server.stdout is not None
    server.stdin.write("\n")
    server.stdin.flush()
    return np.array(server.stdout.readline().split(), float)


def used(server: int) -> dict[str, float]:
    """Return the s of processor time that each kind of process has used."""
    out: dict[str, float] = defaultdict(float)
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            fields = (process / "stat").read_text().rpartition(")")[2].split()
            command = (process / "cmdline").read_text()
            if process.name == str(server):
                kind = "server"
            elif "chrom" in command:
                kind = "Chromium, drawing" if "--type=gpu" in command else "Chromium, pages"
            else:
                continue
            out[kind] += (int(fields[11]) + int(fields[12])) / TICKS
    user, nice, system, idle, *_ = (int(x) / TICKS for x in Path("/proc/stat").read_text().split(maxsplit=5)[1:5])
    return out | {"idle": idle, "others": user + nice + system - sum(out.values())}


def main() -> int:
    """Measure, and print what was found."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--pages", type=int, default=1)
    parser.add_argument("--without-drawing", action="store_true")
    parser.add_argument("--role", default="")
    parser.add_argument("--port", type=int, default=0)
    args = parser.parse_args()
    if args.role:
        asyncio.run(serve() if args.role == "serve" else listen(args.port, args.seconds))
        return 0
    me = [sys.executable, __file__]
    # Each program in a session of its own, as from terminals of their own: Linux shares the processors among sessions.
    apart = {"text": True, "start_new_session": True}
    server = subprocess.Popen([*me, "--role", "serve"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, **apart)
    assert server.stdin is not None
    assert server.stdout is not None
    port = int(server.stdout.readline())
    try:
        for browser in headset_page.chromium():
            pages = [headset_page.Page(browser, f"http://127.0.0.1:{port}/") for _ in range(args.pages)]
            for page in pages:
                page.until("twin.app.loaded", "the scene")
                page.draws(not args.without_drawing)
            client = [*me, "--role", "listen", "--port", str(port), "--seconds", str(args.seconds)]
            with subprocess.Popen(client, stdout=subprocess.PIPE, **apart) as listener:
                assert listener.stdout is not None
                listener.stdout.readline()
                first = stepped(server)
                before, counts, start = used(server.pid), [p("twin.app.line.frames") for p in pages], time.monotonic()
                listener.stdout.readline()
                passed, after = time.monotonic() - start, used(server.pid)
                took, steps = stepped(server) - first
                rates = [(p("twin.app.line.frames") - n) / passed for p, n in zip(pages, counts, strict=True)]
                found = json.loads(listener.stdout.read())
    finally:
        server.stdin.close()
        server.wait(20)
    rate = found["hz"] * found["bytes"] / 1e6
    print(f"client: {found['hz']:.1f} Hz, {found['bytes']:.0f} bytes a frame, {rate:.2f} MB/s, {found['torn']} torn")
    print(f"organs: {steps / took:.2f} steps a second")
    print(f"age: p50 {found['p50']:.1f} ms, p95 {found['p95']:.1f} ms")
    print(f"pages: {', '.join(f'{r:.1f}' for r in rates)} frames/s received")
    shares = {kind: 100 * (after[kind] - before[kind]) / passed for kind in after}
    print("processor: " + ", ".join(f"{kind} {share:.0f} %" for kind, share in sorted(shares.items())))
    return 0 if found["hz"] >= BAR_HZ and found["p95"] < BAR_MS and not found["torn"] else 1


if __name__ == "__main__":
    sys.exit(main())
