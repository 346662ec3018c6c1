"""Draw docs/pictures/view_*.png: the page of `twin view` as a headless Chromium shows it.

    python docs/make_viewer_pictures.py [--only play]

No graphics card is needed; three minutes.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from pages import draw
from playwright.sync_api import Browser, Page

import twin
from twin.core.units import MM
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.viewer.front import Front, ShownRobot
from twin.ui.viewer.page import open_page
from twin.ui.viewer.server import serve


def tab(page: Page, name: str) -> None:
    """Open a tab."""
    page.get_by_role("tab", name=name).click(force=True)


def play(front: Front, page: Page) -> None:
    """SHER inside the eye: instruments and curves of the sclerotomy, close to the shaft."""
    front.ask("load", lambda: front.load(front.active, "sclerotomy"))
    while front.active.playback is None:
        time.sleep(0.2)
    front.ask("seek", lambda: (front.clock.seek(8.3), front.move_to_clock(), setattr(front.gizmo, "visible", False)))
    tab(page, "Curves")


def printed(front: Front, page: Page) -> None:
    """SILS with equation (1) as printed: the platform is stretched, the readout red."""
    tab(page, "Design")
    page.locator("xpath=//label[contains(., 'eq1')]/following::input[not(@type='hidden')][1]").first.click()
    page.get_by_role("option", name="printed").click()
    front.ask("axes", lambda: (front.nodes["sils"].axes(True), setattr(front.gizmo, "visible", False)))
    tip, _ = front.active.movable.shaft()
    at = tip + np.array([0, 0, 120]) * MM
    for client in front.server.get_clients().values():
        with client.atomic():
            client.camera.position = at + np.array([0.45, -0.35, 0.42])
            client.camera.look_at = at


def instruments(front: Front, page: Page) -> None:
    """SILS with its two instruments at work in the port, beside the endoscope."""
    front.ask("load", lambda: front.load(front.active, "instruments"))
    while front.active.playback is None:
        time.sleep(0.2)
    front.ask("seek", lambda: (front.clock.seek(15.0), front.move_to_clock(), setattr(front.gizmo, "visible", False)))
    at = np.array([480, 320, 180]) * MM
    for client in front.server.get_clients().values():
        with client.atomic():
            client.camera.position = at + np.array([0.62, 0.05, 0.12])
            client.camera.look_at = at


def workspace(front: Front, page: Page) -> None:
    """SILS with the set that its tool can reach as it is turned now."""
    tab(page, "Design")
    field = page.locator("xpath=//label[contains(., 'half edge')]/following::input[not(@type='hidden')][1]").first
    field.fill("260")
    field.press("Enter")
    page.get_by_role("button", name="Compute workspace").click()
    while not page.locator("text=/1 000 000 poses,/").count():
        time.sleep(0.5)
    page.get_by_role("button", name="Compute workspace").scroll_into_view_if_needed()


PICTURES: dict[str, tuple[str, Callable[[Any, Page], None]]] = {
    "instruments": ("sils_instruments", instruments),
    "play": ("sher", play),
    "printed": ("sils", printed),
    "workspace": ("sils", workspace),
}


def opened(name: str) -> Front:
    """Return the page of a robot."""
    server = serve(name, "127.0.0.1", 0)
    return open_page(f"twin · {name}", [ShownRobot(name, name, MovableRobot(twin.load(name)))], None, server)


def shown(browser: Browser, name: str) -> bytes:
    """Return the picture of a page after its preparation."""
    robot, prepare = PICTURES[name]
    front = opened(robot)
    thread = threading.Thread(target=front.run)
    thread.start()
    page = browser.new_page(viewport={"width": 1500, "height": 900})
    page.set_default_timeout(300_000)  # in ms: without a graphics card pictures are slow
    page.goto(f"http://127.0.0.1:{front.server.get_port()}")
    page.get_by_text(front.title).first.wait_for()
    time.sleep(5)
    page.add_style_tag(content="[class*='mantine-Notification']{display:none!important}")
    prepare(front, page)
    time.sleep(20)
    picture = page.screenshot()
    page.close()
    front.stop()
    thread.join(30)
    return picture


if __name__ == "__main__":
    draw(__doc__, PICTURES, shown, "view_")
