"""The page of a scene with a console, in Chromium: mouse, keys and a gamepad move both instruments and the camera."""

from __future__ import annotations

import time

import numpy as np
import pytest

from made import headset_page as headset
from made.console_page import ARMS, PAD, console, joints, let_go, moved, rest, tips

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def serving():
    server = headset.Serving("davinci")
    yield server
    server.stop()


@pytest.fixture(scope="module")
def opened(browser, serving):
    with console(browser, serving.url, size=(900, 520), scripts=(PAD,), draws=False) as page:
        yield page


@pytest.fixture
def page(opened):
    """The page at rest, its hands let go."""
    let_go(opened)
    return opened


def drag(page, start, way, until, button="left"):
    """Drag to and fro until something has happened: a busy machine is slow."""
    mouse, k = page.page.mouse, 0
    mouse.move(*start)
    mouse.down(button=button)
    end = time.monotonic() + headset.WAIT
    while not until():
        assert time.monotonic() < end, "the drag has no effect"
        k += 1
        mouse.move(*(np.asarray(start) + min(1.0, k / 20) * np.asarray(way)))
        mouse.move(*(np.asarray(start) + min(1.0, k / 20) * np.asarray(way) + (0, 1)))
    mouse.up(button=button)


@pytest.mark.parametrize("side", ARMS)
def test_the_mouse_moves_the_instrument_beside_it(page, side):
    before, (x, y, _) = joints(page), tips(page)[side]
    drag(page, (x + 4, y + 4), (70, 0), lambda: tips(page)[side][0] > x + 15)
    assert moved(before, rest(page)) == {ARMS[side]}
    assert page("twin.app.console.chosen") == side
    there = tips(page)[side]
    assert abs(there[1] - y) < 15, "it goes in the picture as the mouse does"


def test_the_wheel_moves_it_deeper_and_shift_turns_it(page):
    before, (x, y, depth) = joints(page), tips(page)["left"]
    page.page.mouse.move(x, y)

    def deeper():
        page.page.mouse.wheel(0, -100)
        return tips(page)["left"][2] > depth + 0.002

    headset.until(deeper, "the instrument goes deeper")
    assert moved(before, rest(page)) == {"psm2"}
    before, (x, y, _) = joints(page), tips(page)["left"]
    page.page.keyboard.down("Shift")
    drag(page, (x, y), (40, 0), lambda: np.abs(joints(page)[1] - before[1])[3:6].max() > 0.05)
    page.page.keyboard.up("Shift")
    assert moved(before, rest(page)) == {"psm2"}


def test_the_right_button_drags_the_camera(page):
    before, (x, y, _) = joints(page), tips(page)["right"]
    # The scene goes with the mouse.
    drag(page, (x, y + 60), (-80, 0), lambda: tips(page)["right"][0] < x - 5, button="right")
    assert moved(before, rest(page)) == {"ecm"}


def hold(page, keys, until):
    for key in keys:
        page.page.keyboard.down(key)
    try:
        headset.until(until, f"{keys} have an effect")
    finally:
        for key in reversed(keys):
            page.page.keyboard.up(key)
    return rest(page)


@pytest.mark.parametrize(("keys", "name"), [("d", "psm2"), ("l", "psm1"), ("q", "psm2"), ("u", "psm1"), ("cd", "ecm")])
def test_keys_move_each_hand_and_the_camera(page, keys, name):
    before = joints(page)
    after = hold(page, keys, lambda: name in moved(before, joints(page)))
    assert moved(before, after) == {name}


def test_the_clutch_lets_nothing_move_and_is_said(page):
    before = joints(page)
    after = hold(page, [" ", "d"], lambda: "Clutch" in page.id("status").inner_text())
    assert moved(before, after) == set()


@pytest.mark.parametrize(("key", "k"), [("f", 1), ("h", 0)])
def test_a_key_opens_a_jaw_and_shuts_it(page, key, k):
    jaw = lambda: joints(page)[k][6]  # noqa: E731
    first = jaw()

    def press_until(condition, what):
        page.page.keyboard.press(key)
        headset.until(condition, what)

    press_until(lambda: jaw() > first + 0.2, "the jaw opens")
    press_until(lambda: jaw() < 0.1, "the jaw shuts")


def test_keys_change_the_motion_scale(page):
    before = page("twin.app.console.scale")
    page.page.keyboard.press("-")
    page.until(f"twin.app.console.scale < {before - 0.04}", "a smaller scale")
    page.page.keyboard.press("+")
    page.until(f"twin.app.console.scale > {before - 0.01}", "the scale of before")


def test_a_gamepad_moves_both_hands_pedals_and_jaws_and_rumbles_at_a_wall(page):
    page("window.pad.connected = true")
    page.until("twin.app.console.pad.name !== ''", "the pad is seen")
    before = joints(page)
    page("window.pad.axes = [-0.8, 0, 0.8, 0]")
    headset.until(lambda: moved(before, joints(page)) == {"psm1", "psm2"}, "both sticks move an arm")
    page("window.pad.axes = [0.05, 0, -0.05, 0.1]")  # at rest a stick is never quite at zero
    before = rest(page)
    page("window.pad.buttons[5] = {pressed: true, value: 1}; window.pad.axes = [0.8, 0, 0, 0]")
    headset.until(lambda: moved(before, joints(page)) == {"ecm"}, "the bumper and a stick move the camera")
    page("window.pad.buttons[4] = {pressed: true, value: 1}")
    page.until("twin.app.model.console.mode === 'nothing'", "the other bumper is the clutch")
    page("for (const k of [4, 5]) window.pad.buttons[k] = {pressed: false, value: 0}; window.pad.axes = [0, 0, 0, 0]")
    before = rest(page)
    page("window.pad.buttons[7] = {pressed: true, value: 0.8}")
    headset.until(lambda: joints(page)[0][6] > before[0][6] + 0.2, "a trigger opens the jaw")
    # On a busy machine the sticks moved an arm to one of its limits, which was felt, too.
    page("window.pad.buttons[7] = {pressed: false, value: 0}; twin.app.console.walls = () => 0")
    page.until("twin.app.console.pad.walls === 0", "no wall")
    page("window.felt = []; twin.app.console.walls = () => 1")
    page.until("window.felt.length > 0", "the wall is felt")
    time.sleep(0.5)  # some pictures, in each of which it could be felt again
    felt = page("[...window.felt]")
    page("delete twin.app.console.walls")  # an arm may be at one of its limits, which would be felt from now on
    assert felt == ["dual-rumble"], "a wall is felt once"
    page("window.pad.connected = false")
    page.until("twin.app.console.pad.name === ''", "the pad is gone")


def test_a_page_that_loses_the_focus_in_mid_drag_lets_go(page):
    before, (x, y, _) = joints(page), tips(page)["right"]
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + 2, y)
    page.until("twin.app.model.console.owner === twin.app.model.client", "the hands are taken")
    page("window.dispatchEvent(new Event('blur'))")
    page.until("twin.app.model.console.owner === null", "the hands are let go")
    page.page.mouse.up()
    assert page("twin.app.console.pens.active") is False
    assert "psm2" not in moved(before, rest(page))


def test_another_page_watches_and_is_told_who_controls_the_hands(page, browser, serving):
    with headset.shown(browser, serving.url, size=(700, 420)) as other:
        page.page.keyboard.down("d")
        other.until("twin.app.model.console.owner !== null && !twin.app.model.console.silent", "a page has the hands")
        other("twin.app.refresh()")
        headset.until(lambda: "controls the hands" in other.id("status").inner_text(), "who controls the hands")
        page.page.keyboard.up("d")


def test_the_pictures_swap(page):
    assert page("twin.app.console.views.large") == "scope"
    page.id("inset").click()
    assert page("twin.app.console.views.large") == "room"
    page.draws(True)
    page("twin.app.world.touch()")
    page.until("!twin.app.world.dirty", "a picture")
    page.page.keyboard.press("v")
    assert page("twin.app.console.views.large") == "scope"
