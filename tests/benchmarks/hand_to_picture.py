"""How long after a mouse drag the console's page in Chromium has drawn the instrument's motion.

    python tests/benchmarks/hand_to_picture.py [--moves 120] [--rounds 2] [--against FOLDER] [--without-drawing]

`twin serve davinci` and headless Chromium run as a user starts them. The mouse drags an instrument in steps of 6 pixels
with rests of 60 to 140 ms. The page notes five times of each step: the mouse's event, the message of the hands that
first says it, the arrival of the first frame in which a joint has moved, the end of the drawing of that frame,
after the graphics processor has finished (one pixel is read back), and the next display cycle of the browser, which
composes the page with this picture. Pictures of moving objects have a lower quality on slow graphics: the quality of
the pictures is printed. `--against` names another checkout of twin; rounds of both take turns, so that a busy moment of
the machine meets both. `--without-drawing` leaves out what a graphics processor would do: a machine without one does it
by its processor. Exit code 1 if the 95th percentile from mouse to picture is 50 ms or more. Not a test.
"""

from __future__ import annotations

import argparse
import os
import random
import sys
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(HERE / "tests"))

from made import headset_page

BAR_MS = 50.0

WATCH = """
(() => {
  const { app } = twin, gl = app.world.renderer.getContext(), pixel = new Uint8Array(4);
  const seen = () => app.model.robots.map((r) => [...r.frame.q].join()).join();
  const bench = (window.bench = { rest: '', newest: '', same: 0, now: null, done: [] });
  for (const type of ['pointermove', 'pointerrawupdate'])
    addEventListener(type, (e) => { if (bench.now && !bench.now.event) bench.now.event = e.timeStamp }, true);
  const tell = app.line.tell.bind(app.line);
  app.line.tell = (type, fields) => {
    const at = performance.now();
    const out = tell(type, fields);
    const x = type === 'hands' ? fields[app.console.chosen].pose[0] : NaN;
    if (type === 'hands' && bench.now?.event && !bench.now.sent && x !== bench.x) bench.now.sent = at;
    if (type === 'hands') bench.x = x;
    return out;
  };
  const render = app.console.views.render.bind(app.console.views);
  app.console.views.render = (moved) => {
    const begin = performance.now();
    const drawn = render(moved);
    const step = bench.now;
    if (drawn !== false && step?.sent && seen() !== bench.rest) {
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
      const share = app.world.renderer.getPixelRatio() / Math.min(devicePixelRatio, 2);
      const done = { ...step, begin, drawn: performance.now(), share, cycle: NaN };
      requestAnimationFrame(() => (done.cycle = performance.now()));
      bench.done.push(done);
      bench.now = null;
    }
    return drawn;
  };
  const socket = app.line.socket, hear = socket.onmessage;
  // Frames are read here as they come, before the page, which may draw them at once.
  socket.onmessage = (e) => {
    if (typeof e.data === 'string') return hear(e);
    const view = new DataView(e.data), q = [];
    for (let at = 32, i = view.getUint16(24, true); i > 0; i--) {
      const links = view.getUint16(at + 24, true), joints = view.getUint16(at + 26, true);
      q.push([...new Float32Array(e.data, at + 32 + 28 * links, joints)].join());
      at += 32 + 4 * (7 * links + joints);
    }
    bench.same = q.join() === bench.newest ? bench.same + 1 : 0;
    bench.newest = q.join();
    const step = bench.now;
    if (step?.sent && !step.came && bench.newest !== bench.rest) step.came = performance.now();
    hear(e);
  };
  bench.ready = () => bench.same > 0 && seen() === bench.newest;
  bench.begin = () => { bench.rest = bench.newest; bench.now = {} };
})()
"""


def measure(browser, tree: Path, moves: int, draws: bool) -> np.ndarray:
    """Return event, message, arrival, begin and end of drawing, and cycle (moves, 6), in ms of the page's clock."""
    headset_page.ROOT = tree
    os.environ["PYTHONPATH"] = str(tree)
    serving = headset_page.Serving("davinci")
    chance = random.Random(0)
    try:
        with headset_page.shown(browser, serving.url, size=(1280, 800)) as page:
            page.until("twin.app.model.console !== null && twin.app.console.tip('right')", "the console")
            x, y = page(
                "(() => { const c = twin.app.console, v = c.views.project(c.tip('right'), 'scope');"
                " return [v.x, v.y] })()"
            )
            mouse = page.page.mouse
            mouse.move(x, y)
            mouse.down()
            for k in range(200):  # until the hand moves
                mouse.move(x + k % 3, y)
                time.sleep(0.05)
                if page("twin.app.model.console.hands.right.follows"):
                    break
            time.sleep(1.0)
            page(WATCH)
            page.draws(draws)
            for k in range(moves):
                page.until("bench.ready()", "the instrument rests")
                time.sleep(chance.uniform(0.06, 0.14))
                page("bench.begin()")
                mouse.move(x + (6 if k % 2 else 12), y)
                with suppress(AssertionError):  # a page that draws for 0.25 s is silent, and its hands take hold anew
                    page.until("bench.now === null", "a picture of the motion", 3)
            mouse.up()
            page.until("bench.done.at(-1)?.cycle > 0", "the next display cycle")
            rows = page("bench.done.map((s) => [s.event, s.sent, s.came, s.begin, s.drawn, s.cycle])")
            shares = page("bench.done.map((s) => Math.round(100 * s.share))")
            quality = page("twin.app.world.pace?.text() ?? ''")
            rate = page("twin.app.model.console.rate")
            print(f"  {tree.name}: {len(rows)} of {moves} steps seen, World at {rate} x real time", flush=True)
            drawn = ", ".join(f"{n} with {share} %" for share, n in sorted(Counter(shares).items()))
            print(f"  pixels along each axis: {drawn} of full quality. {quality}", flush=True)
            return np.array(rows, float)
    finally:
        serving.stop()


PARTS = (("event to message", 0, 1), ("message to frame", 1, 2), ("frame to drawing", 2, 3), ("drawing", 3, 4))
WHOLE = (
    ("mouse to frame", 0, 2),
    ("message to picture", 1, 4),
    ("mouse to picture", 0, 4),
    ("mouse to next cycle", 0, 5),
)


def report(name: str, rows: np.ndarray) -> float:
    """Print median and 95th percentile of each part; return that of mouse to picture, in ms."""
    print(f"{name}: {len(rows)} steps")
    for what, a, b in (*PARTS, *WHOLE):
        times = rows[:, b] - rows[:, a]
        p50, p95 = np.nanpercentile(times, [50, 95])
        print(f"  {what:20s} median {p50:6.1f} ms   p95 {p95:6.1f} ms   max {np.nanmax(times):6.1f} ms")
    return float(np.nanpercentile(rows[:, 4] - rows[:, 0], 95))


def main() -> int:
    """Measure, print, compare."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--moves", type=int, default=120, help="steps of the mouse in a round")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--against", type=Path, help="another checkout of twin")
    parser.add_argument("--without-drawing", action="store_true")
    args = parser.parse_args()
    trees = [HERE, *([args.against.resolve()] if args.against else [])]
    found: dict[Path, list[np.ndarray]] = {t: [] for t in trees}
    print(f"load average {os.getloadavg()[0]:.1f} on {len(os.sched_getaffinity(0))} processors")
    for _ in range(args.rounds):
        for tree in trees:
            for browser in headset_page.chromium():
                found[tree].append(measure(browser, tree, args.moves, not args.without_drawing))
    p95 = [report(str(t), np.concatenate(found[t])) for t in trees]
    return int(p95[0] >= BAR_MS)


if __name__ == "__main__":
    sys.exit(main())
