"""The page of a console that UDP packets control and whose motion scale comes by MQTT, in Chromium."""

from __future__ import annotations

import numpy as np
import pytest
from paho.mqtt.publish import single

from made import headset_page as headset
from made.broker import Broker
from made.pens import Pens, Streaming
from made.ports import free_port

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def broker():
    found = Broker().start()
    yield found
    found.stop()


@pytest.fixture(scope="module")
def page(browser, broker):
    port = free_port()
    server = headset.Serving("davinci", None, "--packets", port, "--mqtt", f"127.0.0.1:{broker.port}")
    try:
        with headset.shown(browser, server.url, size=(1280, 900), draws=False) as page:
            page.until("twin.app.model.console?.packets.port", "the console's state")
            page.port = port
            yield page
    finally:
        server.stop()


def text(page, name):
    if name == "status":  # a busy page draws so seldom that it would not be seen for its 6 s
        return page("twin.app.model.status().text")
    return page(f"document.querySelector('[data-id={name}]').textContent")


def says(page, name, said):
    headset.until(lambda: said in text(page, name), f"the page says: {said}")


def test_the_page_says_who_controls_it_what_is_lost_and_what_is_wrong(page):
    says(page, "status", "Ready")
    q = np.array(page("[...twin.app.model.robots[0].frame.q]"))
    pens = Streaming(page.port)
    try:
        says(page, "packets", f"UDP packets: port {page.port}, in control of the hands")
        says(page, "hand-right", "Right instrument is at rest")
        pens.roll()
        for side, arm in (("right", "Right instrument"), ("left", "Left instrument")):
            says(page, f"hand-{side}", f"{arm} follows the hand")
        for _ in range(10):
            pens.p["right"] = pens.p["right"] + (2e-3, 0, 0)
            page.page.wait_for_timeout(50)
        headset.until(lambda: np.abs(page("[...twin.app.model.robots[0].frame.q]") - q).max() > 1e-2, "the tool moves")
        assert f"right hand: from {pens.name}, " in text(page, "packets")
        headset.until(lambda: page("twin.app.model.console.packets.lost.left") > 3, "its loss is shown")
        assert "0 packets ignored" in text(page, "packets")
        stranger = Pens(page.port)
        stranger.send(b"garbage")
        says(page, "status", f"a packet from {stranger.name} is ignored: the packet has 7 bytes; it must have 84")
        stranger.close()
        says(page, "packets", "1 packets ignored")
        says(
            page, "status", "UDP packets control the right instrument and the left instrument"
        )  # a note about a packet hides it for 6 s
    finally:
        pens.close()
    says(page, "status", "No packets of the right and the left hand: nothing moves.")
    says(page, "status", "Ready")


def test_a_tablet_moves_the_slider_and_the_page_says_when_the_broker_is_gone(page, broker):
    page.until("twin.app.model.console.mqtt.connected", "the broker is connected")
    assert f"Motion scale by MQTT: twin/davinci/scale/set at 127.0.0.1:{broker.port}" in text(page, "mqtt")
    to = {"topic": "twin/davinci/scale/set", "hostname": "127.0.0.1", "port": broker.port}
    single(payload="0.25", **to)
    page.until("twin.app.console.scale === 0.25", "the slider follows")
    single(payload="3", **to)
    says(page, "status", "MQTT topic twin/davinci/scale/set: 3 is outside 0.05 to 1; the motion scale stays 0.25")
    broker.stop()
    says(page, "status", f"MQTT broker 127.0.0.1:{broker.port} cannot be reached")
    says(page, "mqtt", "the motion scale stays 0.25; trying again every 2 s")
