"""The page of a scene whose instruments pass ports, in Chromium: three windows; mouse, keys, gamepad lead every arm."""

from __future__ import annotations

import time

import numpy as np
import pytest

from made import headset_page as headset
from made.console_page import PAD, console, joints, let_go, rest, tips
from made.lanes import nightly

pytestmark = pytest.mark.browser
SCENE = "vsrs"


@pytest.fixture(scope="module")
def serving():
    server = headset.Serving(SCENE)
    yield server
    server.stop()


@pytest.fixture(scope="module")
def page(browser, serving):
    with console(browser, serving.url, size=(1200, 700), scripts=(PAD,), draws=False) as page:
        yield page


@pytest.fixture
def arms(page):
    """Names of the robots, in the order of the joints: of the right hand, of the left hand, of the camera."""
    let_go(page)
    hands = page("twin.app.console.info.hands")
    camera = page("twin.app.model.scene.cameras.find(c => c.name === twin.app.console.info.camera).robot")
    return {"right": hands["right"][0], "left": hands["left"][0], "camera": camera}


def moves(page, arms, what, do, undo=lambda: None):
    """Use an input until the arm has moved; the other arms must have rested."""
    names = page("twin.app.model.robots.map(r => r.info.name)")
    before = joints(page)

    def moved():
        return {n for n, a, b in zip(names, before, joints(page), strict=True) if np.abs(a - b).max() > 2e-3}

    def there():
        do()
        return arms[what] in moved()

    headset.until(there, f"{what} moves")
    undo()
    assert moved() == {arms[what]}


@pytest.mark.parametrize(("what", "keys"), nightly([("camera", "cd"), ("right", "l"), ("left", "d")], every=3))
def test_keys_lead_every_arm(page, arms, what, keys):
    for key in keys:
        page.page.keyboard.down(key)

    def lift():
        for key in reversed(keys):
            page.page.keyboard.up(key)

    moves(page, arms, what, lambda: None, lift)


@pytest.mark.parametrize(
    ("what", "button"), nightly([("left", "left"), ("right", "left"), ("camera", "right")], every=3)
)
def test_the_mouse_leads_every_arm(page, arms, what, button):
    mouse, k = page.page.mouse, 0
    x, y, _ = tips(page)["right" if what == "camera" else what]
    x, y = x + 3, y + 70  # below the heading of the page; the nearest instrument is meant
    mouse.move(x, y)
    mouse.down(button=button)

    def further():
        nonlocal k
        k += 1
        mouse.move(x - 2 * k % 80, y)

    moves(page, arms, what, further, lambda: mouse.up(button=button))


@pytest.mark.parametrize(
    ("what", "axes", "bumper"),
    nightly([("right", [0, 0, -0.9, 0], 0), ("left", [-0.9, 0, 0, 0], 0), ("camera", [0.9, 0, 0, 0], 1)], every=3),
)
def test_a_gamepad_leads_every_arm(page, arms, what, axes, bumper):
    page(f"window.pad.connected = true; window.pad.buttons[5] = {{pressed: {bumper} > 0, value: {bumper}}}")
    page(f"window.pad.axes = {axes}")
    stop = "window.pad.axes = [0, 0, 0, 0]; window.pad.buttons[5] = {pressed: false, value: 0}"
    moves(page, arms, what, lambda: None, lambda: page(stop))


def test_a_gamepad_unplugged_in_a_grip_stops_the_instruments_and_says_so(page, arms):
    page("window.pad.connected = true; window.pad.axes = [0, 0, -0.9, 0]")
    page("window.pad.buttons[7] = {pressed: true, value: 0.7}")
    page.until("twin.app.model.console.hands.right.follows && twin.app.console.pens.right.grip > 0.1", "a grip")
    page("window.pad.connected = false")
    page.until("twin.app.console.pad.name === ''", "the pad is gone")
    headset.until(lambda: "gamepad was disconnected" in page.id("status").inner_text(), "the message")
    grip = page("twin.app.console.pens.right.grip")
    before = rest(page)
    time.sleep(1.0)
    assert all(np.array_equal(a, b) for a, b in zip(before, joints(page), strict=True)), "nothing moves"
    assert page("twin.app.console.pens.right.grip") == grip, "the grip is kept"
    page("window.pad.buttons[7] = {pressed: false, value: 0}; window.pad.axes = [0, 0, 0, 0]")


def test_tools_are_chosen_for_each_instrument_and_say_what_they_do(page, arms):
    tools = page("twin.app.console.info.tools")
    assert len(tools) >= 5
    for side in ("left", "right"):
        for tool in (tools[-1], tools[0]):
            button = page.id(f"tool-{side}-{tool['name']}")
            button.click()
            page.until(f"twin.app.model.console.hands.{side}.tool === '{tool['name']}'", "the tool")
            headset.until(lambda b=button: b.get_attribute("aria-pressed") == "true", "the chosen tool is marked")
            assert button.locator("svg path").count() == 1
            # in an operation, a tool is changed outside of the body; until then, it is said what to do
            said = page.id("tools").inner_text()
            assert tool["does"] in said or f"{tool['title']} is not taken yet: draw the tip back" in said


def test_the_fulcrum_is_switched_by_button_and_key_and_turns_the_motion_round(page, arms):
    def goes(fulcrum):
        page.until(f"twin.app.model.console.fulcrum === '{fulcrum}'", fulcrum)
        rest(page)  # on a busy machine the tip still follows the key of before
        x = tips(page)["left"][0]
        page.page.keyboard.down("d")
        try:
            headset.until(lambda: abs(tips(page)["left"][0] - x) > 4, "the tip moves")
        finally:
            page.page.keyboard.up("d")
        return np.sign(tips(page)["left"][0] - x)

    assert goes("compensated") > 0, "the hand goes right, the tip goes right"
    page.id("fulcrum-window").click()
    assert goes("direct") < 0, "the hand goes right, the tip goes left"
    headset.until(lambda: "against the hand" in page.id("fulcrum-window").inner_text(), "it is said")
    page.page.keyboard.press("g")
    page.until("twin.app.model.console.fulcrum === 'compensated'", "compensated again")


def test_three_windows_are_on_the_page_and_do_not_overlap(page, arms):
    assert "abdomen" in page.id("heading").inner_text()
    boxes = [page.id(n).bounding_box() for n in ("inset", "tools", "heading")]
    assert all(b["width"] > 100 for b in boxes)
    for i, a in enumerate(boxes):
        for b in boxes[i + 1 :]:
            apart = a["x"] + a["width"] <= b["x"] or b["x"] + b["width"] <= a["x"]
            assert apart or a["y"] + a["height"] <= b["y"] or b["y"] + b["height"] <= a["y"]
    page.id("inset").click()
    headset.until(lambda: page.id("heading").inner_text() == "Patient and robots", "the pictures are swapped")
    page.page.keyboard.press("v")


def test_a_phone_has_the_window_of_tools_too(page, arms):
    before = page.page.viewport_size
    page.page.set_viewport_size({"width": 390, "height": 844})
    try:
        headset.until(lambda: page.id("tools").bounding_box()["x"] == page.id("inset").bounding_box()["x"], "above it")
        tools, inset = (page.id(n).bounding_box() for n in ("tools", "inset"))
        assert tools["width"] > 300
        assert tools["y"] + tools["height"] <= inset["y"]
        page.id("tool-left-scissors").click()
        page.until("twin.app.model.console.hands.left.tool === 'scissors'", "the tool is chosen")
        page.id("tool-left-clip_applier").click()
    finally:
        page.page.set_viewport_size(before)


def test_the_organs_are_streamed_beside_the_hands(page, arms):
    """Frames with organs arrive while an instrument presses the liver; benchmarks/organs_page.py has the rate."""
    page.page.keyboard.down("q")
    page.until("twin.app.model.console.hands.left.follows", "the hand moves")
    assert page("twin.app.model.scene.fields.length") >= 1
    before = page("twin.app.line.frames")
    page.until(f"twin.app.line.frames >= {before + 80}", "80 frames")
    assert page("twin.app.model.console.hands.left.follows"), "the hand is led all the while"
    page.page.keyboard.up("q")
    assert page.errors == []
