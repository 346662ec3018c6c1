"""The page of a console that UDP packets lead and whose motion scale comes by MQTT, in Chromium."""

from __future__ import annotations

import numpy as np
import pytest
from paho.mqtt.publish import single

from made import headset_page as headset
from made.broker import Broker
from made.pens import Pens, Streaming

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser():
    yield from headset.chromium()


@pytest.fixture(scope="module")
def broker():
    found = Broker().start()
    yield found
    found.stop()


@pytest.fixture(scope="module")
def page(browser, broker):
    port = headset.free_port()
    server = headset.Serving("davinci", None, "--packets", port, "--mqtt", f"127.0.0.1:{broker.port}")
    try:
        with headset.shown(browser, server.url, size=(1280, 900)) as page:
            page.until("twin.app.model.console?.packets.port", "the console's state")
            page.port = port
            yield page
    finally:
        server.stop()


def text(page, name):
    return page(f"document.querySelector('[data-id={name}]').textContent")


def status(page, said):
    headset.until(lambda: said in text(page, "status"), f"the page says: {said}")


def test_the_page_says_who_leads_what_is_lost_and_what_is_wrong(page):
    status(page, "Ready")
    q = np.array(page("[...twin.app.model.robots[0].frame.q]"))
    pens = Streaming(page.port)
    try:
        status(page, "UDP packets have the hands: roll a handle or open a gripper.")
        pens.roll()
        status(page, "UDP packets lead psm1 and psm2.")
        for _ in range(10):
            pens.p["right"] = pens.p["right"] + (2e-3, 0, 0)
            page.page.wait_for_timeout(50)
        headset.until(lambda: np.abs(page("[...twin.app.model.robots[0].frame.q]") - q).max() > 1e-2, "the tool moves")
        said = text(page, "packets")
        assert f"UDP packets: port {page.port}" in said
        assert f"right hand: from {pens.name}, " in said
        headset.until(lambda: page("twin.app.model.console.packets.lost.left") > 3, "its loss is shown")
        assert "0 packets ignored" in text(page, "packets")
        stranger = Pens(page.port)
        stranger.send(b"garbage")
        status(page, f"a packet from {stranger.name} is ignored: the length is 7 bytes; it must be 84")
        stranger.close()
        headset.until(lambda: "1 packets ignored" in text(page, "packets"), "it is counted")
    finally:
        pens.close()
    status(page, "No packets of the right and the left hand: nothing moves.")
    status(page, "Ready")


def test_a_tablet_moves_the_slider_and_the_page_says_when_the_broker_is_gone(page, broker):
    page.until("twin.app.model.console.mqtt.connected", "the broker is connected")
    assert f"Motion scale by MQTT: twin/davinci/scale/set at 127.0.0.1:{broker.port}" in text(page, "mqtt")
    to = {"topic": "twin/davinci/scale/set", "hostname": "127.0.0.1", "port": broker.port}
    single(payload="0.25", **to)
    page.until("twin.app.console.scale === 0.25", "the slider follows")
    single(payload="3", **to)
    status(page, "MQTT topic twin/davinci/scale/set: 3 is outside 0.05 to 1; the motion scale stays 0.25")
    broker.stop()
    status(page, f"MQTT broker 127.0.0.1:{broker.port} cannot be reached")
    assert "the motion scale stays 0.25" in text(page, "mqtt")
