"""A page of another site, in real Chromium, tries to press the start button of `twin machine`."""

from __future__ import annotations

import re
import threading
import time
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import pytest

import twin
from twin.api.machine import machine, machine_parts
from twin.simulation.machine.machine_server import Server

pytestmark = pytest.mark.browser

PAGE = """<!doctype html><title>trying</title>
<iframe name="away"></iframe>
<form id="form" method="post" enctype="text/plain" target="away" action="http://127.0.0.1:PORT/">
<textarea name="x">
start
</textarea></form>
<script>
const url = "http://127.0.0.1:PORT/";
const body = "\\nstart\\n";
const done = [];
const noted = (name) => { done.push(name); if (done.length === 5) document.title = "tried"; };
fetch(url, { method: "POST", mode: "no-cors", body }).finally(() => noted("fetch")).catch(() => {});
const sent = navigator.sendBeacon(url, body); noted("beacon");
const image = new Image(); image.onload = image.onerror = () => noted("image"); image.src = url + "%0Astart%0A";
const socket = new WebSocket("ws://127.0.0.1:PORT/"); socket.onclose = () => noted("socket");
document.getElementById("form").submit(); setTimeout(() => noted("form"), 500);
</script>"""


@pytest.fixture
def running():
    """A machine that nobody has started, in a thread."""
    arm = machine(machine_parts(twin.load("raven_left")))
    server = Server(arm)
    said: list[str] = []
    stop = threading.Event()
    thread = threading.Thread(target=server.run, kwargs={"tell": said.append, "ends": stop.is_set})
    thread.start()
    yield server, said
    stop.set()
    thread.join()
    server.close()


def test_a_page_of_another_site_presses_no_button(browser, running, tmp_path):
    server, said = running
    (tmp_path / "index.html").write_text(PAGE.replace("PORT", str(server.state_port)))
    handler = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as site:
        threading.Thread(target=site.serve_forever, daemon=True).start()
        page = browser.new_page()
        page.goto(f"http://127.0.0.1:{site.server_port}/")
        page.wait_for_function("document.title === 'tried'", timeout=60_000)
        page.close()
        site.shutdown()
    until = time.monotonic() + 60
    while not any("an HTTP request" in text for text in said) and time.monotonic() < until:
        time.sleep(0.05)
    refused = [text for text in said if "an HTTP request" in text]  # of requests in one tick, one is named
    assert refused
    assert {re.search(r"\((\w+)\)", text)[1] for text in refused} <= {"GET", "POST", "OPTIONS"}
    assert server.machine.plc.level.name == "E_STOP"
