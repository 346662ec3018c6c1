"""Draw docs/pictures of the page of `twin serve` on a screen, as a headless Chromium shows it.

    python docs/make_serve_pictures.py [--only vsrs_by_hand]

No graphics card is needed; five minutes.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Literal

from pages import draw, sheet
from playwright.sync_api import Browser, Page

HELD = 2.5
"""Time in s of the World for which a key is held."""

SHARP = "twin.app.world.renderer.getPixelRatio() === 1 && !twin.app.world.dirty"
"""Whether the page shows a picture of full quality."""


def until(page: Page, expression: str, seconds: float = 240.0) -> None:
    """Wait until an expression is true; the page forbids the evaluation that playwright's own waiting uses."""
    end = time.monotonic() + seconds
    while not page.evaluate(expression):
        if time.monotonic() > end:
            raise SystemExit(f"not within {seconds:g} s: {expression}")
        time.sleep(0.2)


def nothing(page: Page) -> None:
    """Leave the page as it opens."""


def room(page: Page) -> None:
    """Show the room in the large view."""
    until(page, "twin.app.drawn.any")
    page.evaluate("twin.app.console.views.swap()")


def instrument(page: Page) -> None:
    """Move an instrument by a key."""
    begin = page.evaluate("twin.app.model.time")
    page.keyboard.down("KeyQ")
    until(page, f"twin.app.model.time > {begin + HELD}")
    page.keyboard.up("KeyQ")


def inserted(page: Page) -> None:
    """Seek to the deepest insertion of the protocol."""
    until(page, "twin.app.model.state.duration > 0")
    page.evaluate("twin.app.ask('seek', { t: 9.57 })")


def rehearsed(page: Page) -> None:
    """Rehearse a motion of the left arm in its model; the machine holds."""
    state = "twin.app.machines.state.robots.raven_left"
    until(page, f"twin.app.machines.state !== null && {state}.level === 'PEDAL_UP'")
    while page.evaluate(f"{state}.level") != "PEDAL_DN":
        page.evaluate("twin.app.console.move('left', 0.0005, 0, 0)")
        time.sleep(0.05)
    page.locator("[data-id=rehearse]").click()
    until(page, f"{state}.phase === 'rehearse' && {state}.level === 'PEDAL_UP'")
    for _ in range(60):
        page.evaluate("twin.app.console.move('left', 0.001, -0.0005, 0)")
        time.sleep(0.05)


PICTURES: dict[str, tuple[tuple[str, ...], Callable[[Page], None]]] = {
    "serve": (("sils",), inserted),
    "vsrs_by_hand": (("vsrs",), instrument),
    "serve_cholecystectomy": (("vsrs", "--task", "cholecystectomy"), nothing),
    "serve_pegboard": (("davinci", "--task", "pegboard"), nothing),
    "raven_trainer": (("raven",), rehearsed),
    "serve_raven_dome": (("raven_dome",), nothing),
    "serve_dark": (("davinci",), room),
    "serve_sizes": (("sils",), nothing),
}
"""By file: arguments of `twin serve`, and what is done with the page before its picture is taken."""

DARK = {"serve_dark"}
"""Pictures of the page on a system with dark colours."""

SHEETS = {"serve_sizes"}
"""Pictures that show the page on a phone, a small and a large screen, with light and with dark colours."""


def at_rest(page: Page, url: str, prepare: Callable[[Page], None]) -> bytes:
    """Return the picture of a page at rest."""
    page.goto(url)
    until(page, "window.twin?.app.firstPicture > 0 && twin.app.loaded")
    prepare(page)
    time.sleep(8)
    until(page, SHARP)
    time.sleep(2)
    return page.screenshot()


def served(browser: Browser, name: str) -> bytes:
    """Return the picture of the page that a server of its own shows."""
    options, prepare = PICTURES[name]
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
        url = f"http://127.0.0.1:{port}/"

        def page_of(width: int, height: int, scheme: Literal["light", "dark"]) -> bytes:
            page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
            picture = at_rest(page, url, prepare)
            page.close()
            return picture

        if name in SHEETS:
            picture = sheet(page_of)
        else:
            picture = page_of(1280, 800, "dark" if name in DARK else "light")
    finally:
        server.terminate()
        server.wait(20)
    return picture


if __name__ == "__main__":
    draw(__doc__, PICTURES, served)
