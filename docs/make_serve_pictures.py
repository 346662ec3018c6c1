"""Draw docs/pictures of the page of `twin serve` on a screen, as a headless Chromium shows it.

    python docs/make_serve_pictures.py [--only vsrs_by_hand]

No graphics card is needed; three minutes.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import time

from pages import draw
from playwright.sync_api import Browser, Page

PICTURES: dict[str, tuple[tuple[str, ...], str]] = {
    "vsrs_by_hand": (("vsrs",), "KeyQ"),
    "serve_cholecystectomy": (("vsrs", "--task", "cholecystectomy"), ""),
    "serve_pegboard": (("davinci", "--task", "pegboard"), ""),
}
"""By file: arguments of `twin serve`, and a key that is held for a while to move an instrument."""

HELD = 2.5
"""Time in s of the World for which the key is held."""

SHARP = "twin.app.world.renderer.getPixelRatio() === 1 && !twin.app.world.dirty"
"""Whether the page shows a picture of full quality."""


def until(page: Page, expression: str, seconds: float = 240.0) -> None:
    """Wait until an expression is true; the page forbids the evaluation that playwright's own waiting uses."""
    end = time.monotonic() + seconds
    while not page.evaluate(expression):
        if time.monotonic() > end:
            raise SystemExit(f"not within {seconds:g} s: {expression}")
        time.sleep(0.2)


def at_rest(page: Page, url: str, key: str) -> bytes:
    """Return the picture of a page at rest."""
    page.goto(url)
    until(page, "window.twin?.app.firstPicture > 0 && twin.app.loaded")
    if key:
        begin = page.evaluate("twin.app.model.time")
        page.keyboard.down(key)
        until(page, f"twin.app.model.time > {begin + HELD}")
        page.keyboard.up(key)
    time.sleep(8)
    until(page, SHARP)
    time.sleep(2)
    return page.screenshot()


def served(browser: Browser, name: str) -> bytes:
    """Return the picture of the page that a server of its own shows."""
    options, key = PICTURES[name]
    with socket.create_server(("127.0.0.1", 0)) as s:
        port = s.getsockname()[1]
    command = [sys.executable, "-m", "twin", "serve", *options, "--no-browser", "--port", str(port)]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        while True:
            with socket.socket() as s:
                if not s.connect_ex(("127.0.0.1", port)):
                    break
            time.sleep(0.2)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        picture = at_rest(page, f"http://127.0.0.1:{port}/", key)
        page.close()
    finally:
        server.terminate()
        server.wait(20)
    return picture


if __name__ == "__main__":
    draw(__doc__, PICTURES, served)
