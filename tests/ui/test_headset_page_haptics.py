"""A gamepad pushes an instrument into the board in the real page: arrow, rumble and text show the force, T ends it."""

from __future__ import annotations

import pytest

from made import headset_page as headset
from made.console_page import console, let_go

pytestmark = pytest.mark.browser
PAD = """
window.felt = [];
window.pad = {id: 'a pad of the test', connected: true, mapping: 'standard', axes: [0, 0, 0, 0],
  buttons: Array.from({length: 17}, () => ({pressed: false, value: 0})),
  vibrationActuator: {playEffect: (kind, how) => { window.felt.push(how); return Promise.resolve('complete'); }}};
navigator.getGamepads = () => [null, window.pad];
"""
NOW = "twin.app.console.forces.now.right.length()"


@pytest.fixture(scope="module")
def page(browser):
    server = headset.Serving("davinci")
    with console(browser, server.url, size=(1000, 600), scripts=(PAD,), draws=False) as page:
        yield page
    server.stop()


def test_the_force_of_the_board_is_seen_and_felt(page):
    page.until("twin.app.console.pad.name !== ''", "the pad")
    assert page("twin.app.console.haptics")
    assert not page("twin.app.console.forces.arrows.right.visible")
    page("window.pad.axes = [0, 0, 0, 0.55]; window.pad.buttons[3] = {pressed: true, value: 1}")
    page.until(f"{NOW} > 0.5", "a force")
    page("window.pad.axes = [0, 0, 0, 0]; window.pad.buttons[3] = {pressed: false, value: 0}")
    page.until("window.felt.length > 3", "a rumble that lasts")
    page.until("twin.app.console.forces.arrows.right.visible", "an arrow")
    # one reading of both: at the first contact, the force can be zero for a moment
    same = f"{NOW} > 0.5 && Math.abs(window.felt.at(-1).strongMagnitude - Math.min(1, {NOW} / 3.3)) < 0.1"
    page.until(same, "a rumble as strong as the force")
    assert page("window.felt.at(-1).duration") < 200
    up = page(
        "(() => {const a = twin.app.console.forces.arrows.right, v = a.position.clone().set(0, 1, 0);"
        " return v.applyQuaternion(a.quaternion).y})()"
    )
    assert up > 0.95, "the board pushes upwards"
    tip = page("twin.app.console.tip('right').distanceTo(twin.app.console.forces.arrows.right.position)")
    assert tip < 1e-6
    assert page("twin.app.console.forces.now.left.length()") == 0
    page.until("twin.app.console.forces.text().includes('right')", "a text")
    page.page.keyboard.press("t")
    page.until("!twin.app.console.haptics", "the switch")
    page.until(f"{NOW} === 0", "no force")
    page.until("!twin.app.console.forces.arrows.right.visible", "no arrow")
    count = page("window.felt.length")
    page("new Promise(done => setTimeout(done, 300))")
    assert page("window.felt.length") <= count + 1
    let_go(page)
    page.page.keyboard.press("t")
    page.until("twin.app.console.haptics", "the switch")
