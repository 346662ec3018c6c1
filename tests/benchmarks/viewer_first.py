"""From the command to the robot on the screen: `twin view`, a Chromium that is open already, median of some runs.

    python tests/benchmarks/viewer_first.py [robot]

Imports are warm after the first run, which is not counted. Without a graphics card the browser's share is far larger
than on a desk. Not a test.
"""

from __future__ import annotations

import shutil
import signal
import socket
import subprocess
import sys
import time

import numpy as np
from playwright.sync_api import Page, sync_playwright

import twin

RUNS = 5
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage"]


WATCH = """(() => {
  window.seen = 0;
  let corners = 0;
  for (const name of ["drawElements", "drawArrays"]) {
    const draw = WebGL2RenderingContext.prototype[name];
    WebGL2RenderingContext.prototype[name] = function (...a) {
      corners += name === "drawArrays" ? a[2] : a[1];
      return draw.apply(this, a);
    };
  }
  const frame = () => {
    if (corners > 3 * TRIANGLES && !window.seen) requestAnimationFrame(() => (window.seen = Date.now() / 1000));
    corners = 0;
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
})()"""
"""Notes when the frame after one with so many triangles begins: the robot is on the screen."""


def once(robot: str, page: Page) -> tuple[float, float]:
    """Return s until the server says where it is, and until the robot is on the screen."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    start = time.time()
    command = [sys.executable, "-m", "twin", "view", robot, "--port", str(port), "--no-browser"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    process.stdout.readline()
    served = time.time() - start
    page.goto(f"http://127.0.0.1:{port}", wait_until="commit")
    while not (seen := page.evaluate("window.seen")):
        time.sleep(0.05)
    page.goto("about:blank")
    process.send_signal(signal.SIGINT)
    process.wait(30)
    return served, seen - start


def main() -> None:
    """Measure and print."""
    robot = sys.argv[1] if len(sys.argv) > 1 else "sils"
    program = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        page = playwright.chromium.launch(executable_path=program, args=FLAGS).new_page()
        triangles = sum(len(m.triangles) for b in twin.load(robot).mechanism.bodies for m in b.meshes)
        page.add_init_script(WATCH.replace("TRIANGLES", str(triangles // 2)))
        runs = np.array([once(robot, page) for _ in range(RUNS + 1)])[1:]
    served, seen = np.median(runs, axis=0)
    print(f"{robot}: served after {served:.2f} s, on the screen after {seen:.2f} s (median of {RUNS})")


if __name__ == "__main__":
    main()
