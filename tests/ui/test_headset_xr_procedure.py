"""The cholecystectomy in a headset: a controller and a bare hand grasp and lift the gallbladder; lost, they keep it."""

from __future__ import annotations

import numpy as np
import pytest

from made import headset_page as headset
from made.console_page import console, let_go, rest
from made.player import SEE, Player
from twin.core.units import MM
from ui.test_headset_xr_console import EYES, Tracked

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def opened(browser, emulator):
    server = headset.Serving("vsrs", None, "--task", "cholecystectomy")
    start = f"emulate('vr', false); device.position.set({', '.join(map(str, EYES))})"
    with console(browser, server.url, size=(320, 240), scripts=(emulator, start, SEE), draws=False) as page:
        page.until("twin.app.loaded && twin.app.fields.vertices('cystic_duct').length > 0", "the vessels")
        page.until("twin.app.xr.vr", "VR")
        page.enter()
        page.until("twin.app.hands.count === 2", "controllers")
        yield page
    server.stop()


def guide(hands, side, goal, near=1.5 * MM):
    """Move a hand until the tip that it moves rests at a place (3,) in the World in m, as a person who looks."""
    page = hands.page
    for _ in range(30):
        off = np.array(page(f"player.off('{side}', {np.asarray(goal).tolist()}).toArray()"))
        if np.linalg.norm(off) < near:
            return
        way = off / page("twin.app.console.scale")
        hands.move(way * min(1.0, 0.04 / np.linalg.norm(way)), side)
        page.until(f"twin.app.model.console.heard >= {page('twin.app.console.pens.number')}", "the motion is heard")
        rest(page)
    raise AssertionError(f"the tip is still {off / MM} mm from {goal}")


def grasp_and_lift(hands):
    """Grasp the gallbladder at its end away from the duct, and lift it, with the left hand."""
    page, seen = hands.page, Player(hands.page, {})
    before = seen.vertices("gallbladder")
    hands.take("left")
    hands.grip("left", 1.0)
    page.until("twin.app.model.console.hands.left.open", "the jaws are open")
    guide(hands, "left", seen.fundus("cystic_duct") + np.array([0, 0, 12 * MM]), 3 * MM)
    guide(hands, "left", seen.fundus("cystic_duct"))
    at = seen.tip("left")
    hands.grip("left", 0.0)
    page.until("twin.app.model.console.task.events.some(e => e[2].includes('holds the'))", "it is held", 20)
    assert np.linalg.norm(seen.tip("left") - at) < 0.3 * MM, "fingers that close the jaws do not move the instrument"
    guide(hands, "left", seen.tip("left") + np.array([-0.010, -0.006, 0.022]))
    page.until("twin.app.model.console.task.stages[0][1] === 'done'", "exposed")
    assert np.linalg.norm(seen.vertices("gallbladder") - before, axis=1).max() > 8 * MM
    return seen


@pytest.mark.nightly
def test_a_controller_grasps_and_lifts_the_gallbladder(opened):
    grasp_and_lift(Tracked(opened, "controllers"))
    let_go(opened)
    attempt = opened("twin.app.model.console.task.attempt")
    opened("twin.app.ask('task', {do: 'restart'})")
    opened.until(f"twin.app.model.console.task.attempt === {attempt + 1}", "a new attempt")


def test_a_bare_hand_grasps_and_lifts_the_gallbladder_and_a_lost_one_keeps_it(opened):
    page, hands = opened, Tracked(opened, "hands")
    seen = grasp_and_lift(hands)
    page("device.hands.left.connected = false")
    page.until("twin.app.model.status().text.includes('The left hand is not tracked')", "the page names the hand")
    page.until("twin.app.model.console.silent", "the server hears nothing")
    still = seen.tip("left")
    hands.to("left", hands.at["left"] + [0, 0.2, 0])
    hands.page.pictures(5)
    np.testing.assert_array_equal(seen.tip("left"), still)
    assert not page("twin.app.model.console.task.events.some(e => e[2].includes('released'))")
    assert seen.stages()["Expose the organ"] == "done"
