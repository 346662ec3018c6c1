"""The cholecystectomy in a headset: a bare hand grasps the gallbladder and lifts it, and keeps it when it is lost."""

from __future__ import annotations

import numpy as np
import pytest

from made import headset_page as headset
from made.console_page import console
from made.player import Player
from test_headset_xr_console import EYES, Tracked
from twin.core.units import MM

pytestmark = pytest.mark.long

SEE = """
window.player = {
  tip: (side) => twin.app.fields.group.worldToLocal(twin.app.console.tip(side)).toArray(),
  off: (side, goal) => {
    const c = twin.app.console, tip = c.tip(side), to = tip.clone().fromArray(goal);
    c.views.scope.updateWorldMatrix(true, false);
    twin.app.fields.group.localToWorld(to);
    return c.views.scope.worldToLocal(to).sub(c.views.scope.worldToLocal(tip)).toArray();
  },
};
"""
"""Script of a page: where a tip is in the World, and a way from it in the picture: right, up, towards the lens."""


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    emulator = headset.bundled_emulator(tmp_path_factory.mktemp("emulator"))
    server = headset.Serving("vsrs", None, "--task", "cholecystectomy")
    start = f"emulate('vr', false); device.position.set({', '.join(map(str, EYES))})"
    for browser in headset.chromium():
        with console(browser, server.url, size=(320, 240), scripts=(emulator, start, SEE)) as page:
            page.until("twin.app.loaded && twin.app.fields.vertices('cystic_duct').length > 0", "the vessels")
            page.until("twin.app.xr.vr", "VR")
            page.draws(False)
            page.enter()
            page.until("twin.app.hands.count === 2", "controllers")
            yield page
    server.stop()


def lead(hands, side, goal, near=1.5 * MM):
    """Move a hand until the tip that it leads is at a place (3,) in the World in m, as a person who looks."""
    page = hands.page

    def there():
        off = np.array(page(f"player.off('{side}', {np.asarray(goal).tolist()})"))
        if np.linalg.norm(off) < near:
            return True
        way = 0.8 * off / page("twin.app.console.scale")
        hands.move(way * min(1.0, 0.02 / np.linalg.norm(way)), side)
        return False

    headset.until(there, f"the tip reaches {goal}", 120)


def test_a_bare_hand_grasps_and_lifts_the_gallbladder_and_a_lost_one_keeps_it(opened):
    page, hands = opened, Tracked(opened, "hands")
    seen = Player(page, {})
    before = seen.vertices("gallbladder")
    hands.take("left")
    hands.grip("left", 1.0)
    page.until("twin.app.model.console.hands.left.open", "the jaws are open")
    root = seen.line("cystic_duct")[0]
    high = before[before[:, 2] > np.quantile(before[:, 2], 0.8)]
    end = high[np.argmax(np.linalg.norm(high - root, axis=1))]
    lead(hands, "left", end + np.array([0, 0, 12 * MM]), 3 * MM)
    lead(hands, "left", end)
    hands.grip("left", 0.0)
    page.until("twin.app.model.console.task.events.some(e => e[2].includes('holds the'))", "it is held")
    lead(hands, "left", seen.tip("left") + np.array([-0.010, -0.006, 0.022]))
    page.until("twin.app.model.console.task.stages[0][1] === 'done'", "exposed")
    assert np.linalg.norm(seen.vertices("gallbladder") - before, axis=1).max() > 8 * MM

    page("device.hands.left.connected = false")
    page.until("twin.app.model.console.silent", "the server hears nothing")
    assert "The left hand is not tracked" in page("twin.app.model.status().text")
    still = seen.tip("left")
    hands.to("left", hands.at["left"] + [0, 0.2, 0])
    hands.page.pictures(5)
    np.testing.assert_array_equal(seen.tip("left"), still)
    assert not page("twin.app.model.console.task.events.some(e => e[2].includes('released'))")
    assert seen.stages()["Expose the organ"] == "done"
