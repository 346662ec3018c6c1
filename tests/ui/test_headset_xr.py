"""The page of `twin serve` in AR and VR: IWER devices in headless Chromium.

No physical headset is used anywhere here.
"""

from __future__ import annotations

import numpy as np
import pytest

import twin
from twin.core.units import MM

pytestmark = pytest.mark.browser


from made import headset_page as headset

EYES = np.array([0.2, 1.6, 1.4])


@pytest.fixture(scope="module")
def robot():
    return twin.load("sils")


@pytest.fixture(scope="module")
def server():
    serving = headset.Serving("sils")
    yield serving
    serving.stop()


def device(browser, server, emulator, profile, room=False, query=""):
    """Yield the page with an emulated headset; it does not draw, and is small for when it is asked to."""
    eyes = ", ".join(map(str, EYES))
    start = f"emulate('{profile}', {str(room).lower()}); device.position.set({eyes})"
    return headset.shown(browser, server.url + query, size=(480, 374), scripts=(emulator, start), draws=False)


def look_at(page, target):
    """Turn the head to a point of the scene."""
    x, y, z, w = headset.looking(np.asarray(target) - EYES)
    page(f"device.quaternion.set({x}, {y}, {z}, {w})")
    page.pictures(3)


def guided(page, robot, kind, wanted, reachable=True):
    """Take the tool by hand or controller, move it by a step (3,) of the robot's world, and check what follows."""
    before = page.tool()
    handle = page.to_scene(before[:3, 3])
    start = EYES + np.array([0.25, -0.3, -0.2])
    page.aim(handle, kind=kind, start=start)
    page.select(True, kind=kind)
    page.until("twin.app.grab.held?.granted", "the grab")
    assert page("twin.app.grab.held.target") == "tool"
    step = page.to_scene(before[:3, 3] + wanted) - handle
    at = start
    for _ in range(5):
        at = at + step / 5
        page(f"device.{kind}.right.position.set({at[0]}, {at[1]}, {at[2]})")
        page.pictures(2)
    there = before[:3, 3] + wanted
    if reachable:
        headset.until(lambda: np.linalg.norm(page.tool()[:3, 3] - there) < 1 * MM, "the tool is where it was moved")
    else:
        page.until(
            "twin.app.model.refused && twin.app.model.status().text.startsWith('Target not reached: ')", "the refusal"
        )
        assert page("twin.app.grab.ghostHand.visible && twin.app.grab.label.sprite.visible")
        np.testing.assert_allclose(page("twin.app.grab.ghostHand.position.toArray()"), there, atol=2 * MM)
    np.testing.assert_allclose(page.tool()[:3, :3], before[:3, :3], atol=1e-5)  # moved, not turned
    page.select(False, kind=kind)
    page.until("twin.app.grab.held === null", "it is let go")
    headset.agrees(page, robot)  # the server has closed the loops


def test_ar_on_a_quest_places_plays_and_is_led(browser, server, emulator, robot, rng):
    with device(browser, server, emulator, "quest", room=True) as page:
        headset.ready(page, robot)
        assert page.id("enter").inner_text() == "Enter AR"
        page.enter()
        assert page("[twin.app.xr.mode, twin.app.xr.blend]") == ["immersive-ar", "alpha-blend"]
        assert page("twin.app.world.scene.background") is None  # the room is seen
        page.until("twin.app.xr.canPlace && twin.app.hands.count === 2", "hit test and controllers")
        np.testing.assert_allclose(page("twin.app.xr.viewer().toArray()"), EYES, atol=1e-6)

        # Placed where the ray of the controller meets the floor of the room.
        page.aim([0.5, 0.0, 0.2], start=EYES + np.array([0.2, -0.3, -0.1]))
        page.until("twin.app.place.reticle.visible", "the reticle")
        reticle = np.array(page("twin.app.place.reticle.matrix.elements.slice(12, 15)"))
        assert abs(reticle[1]) < 0.12  # the floor of that room, as it was captured
        np.testing.assert_allclose(reticle[[0, 2]], [0.5, 0.2], atol=0.08)
        page.select(True)
        page.select(False)
        assert page("twin.app.place.placing") is False
        np.testing.assert_allclose(page("twin.app.world.placement.position.toArray()"), reticle, atol=0.02)

        # Played from the floating panel.
        look_at(page, page("twin.app.xrPanel.group.position.toArray()"))
        page.press("play")
        page.until("twin.app.model.state.playing", "it plays")
        page.until("twin.app.clipTime() > 1", "time goes on")
        page.press("play")
        page.until("!twin.app.model.state.playing", "it stops")
        page.settled()
        headset.agrees(page, robot)

        # Every link's pixels, by rays through the CAD.
        look_at(page, page.to_scene(page.tool()[:3, 3]) + np.array([-0.1, 0.15, 0.0]))
        page.draws(True)
        right, total, missed = headset.probes(page, robot.mechanism, rng)
        page.draws(False)
        print(f"{right} of {total} pixel probes on the expected link")
        assert total >= 50
        assert right >= 0.95 * total, missed

        guided(page, robot, "controllers", np.array([15, 10, -20]) * MM)

        # Led out of reach: said, shown where the hand is, and the last good pose stays.
        guided(page, robot, "controllers", np.array([0, 0, 300]) * MM, reachable=False)

        # Half as large, by the two grips: it is the picture that shrinks, not the robot.
        scale = page("twin.app.place.scale")
        for side, x in (("left", -0.3), ("right", 0.3)):
            page(f"device.controllers.{side}.position.set({x}, 1.2, 1.0)")
        page.pictures(3)
        for side in ("left", "right"):
            page(f"device.controllers.{side}.updateButtonValue('squeeze', 1)")
        page.pictures(3)
        for side, x in (("left", -0.15), ("right", 0.15)):
            page(f"device.controllers.{side}.position.set({x}, 1.2, 1.0)")
        page.pictures(3)
        for side in ("left", "right"):
            page(f"device.controllers.{side}.updateButtonValue('squeeze', 0)")
        page.pictures(3)
        assert page("twin.app.place.scale") == pytest.approx(0.5 * scale, rel=1e-3)
        headset.agrees(page, robot)

        page("twin.app.xr.leave()")
        page.until("!twin.app.xr.presenting", "the session ends")
        assert page("twin.app.place.scale") == 1
        assert page.id("play").is_visible()


def test_ar_on_additive_glasses_with_hands_only(browser, server, emulator, robot):
    with device(browser, server, emulator, "lens") as page:
        headset.ready(page, robot)
        page.enter()
        assert page("[twin.app.xr.mode, twin.app.xr.blend]") == ["immersive-ar", "additive"]
        page.until("twin.app.hands.count === 2", "the hands")
        assert page("[...twin.app.xr.session.inputSources].every(s => s.hand)")
        assert page("twin.app.world.look") == "additive"
        look_at(page, page("twin.app.xrPanel.group.position.toArray()"))
        page.draws(True)
        page.pictures(4)
        panel = page("(() => { const p = twin.app.xrPanel; return [[.02, .02], [.98, .98]].map(([x, y]) =>"
                     " p.pointAt({x, y}).toArray()) })()")  # fmt: skip
        (x0, y1), (x1, y0) = (page.pixel(p) for p in panel)
        image = page.image()
        page.draws(False)
        card = image[int(y0) + 12 : int(y1) - 12, int(x0) + 12 : int(x1) - 12]
        assert card.max(axis=2).min() > 120  # nothing on the panel is nearly black: there it would be a hole
        colors = page("twin.app.robot.targets().map(m => m.material.color.getHSL({h: 0, s: 0, l: 0}).l)")
        assert min(colors) > 0.2
        guided(page, robot, "hands", np.array([-15, 10, -20]) * MM)
        page.press("tab-scene", kind="hands")
        page.pictures(8)
        page.press("look", kind="hands")
        page.until("twin.app.world.look === 'normal'", "the look is switched")


def test_a_finger_that_touches_takes_the_tool(browser, server, emulator, robot):
    with device(browser, server, emulator, "lens") as page:
        headset.ready(page, robot)
        page.enter()
        page.until("twin.app.hands.count === 2", "the hands")
        look_at(page, page.to_scene(page.tool()[:3, 3]))
        page("device.hands.right.updatePinchValue(0)")
        # Where the finger tips will be, seen from the hand, is only known with the hand there.
        handle = page.to_scene(page.tool()[:3, 3])
        page.aim(handle, kind="hands", start=handle + np.array([0.0, 0.0, 0.3]))
        tips = np.array(page("twin.app.hands.hands.find(h => h.source?.handedness === 'right').pinch().toArray()"))
        at = handle + np.array([0.0, 0.0, 0.3]) + handle - tips
        page(f"device.hands.right.position.set({at[0]}, {at[1]}, {at[2]})")
        page.pictures(3)
        page.select(True, kind="hands")
        page.until("twin.app.grab.held?.granted", "the grab")
        assert page("[twin.app.grab.held.target, twin.app.hands.hands.some(h => h.near)]") == ["tool", True]
        page.select(False, kind="hands")
        page.until("twin.app.grab.held === null", "it is let go")
        headset.agrees(page, robot)


def test_without_hand_or_controller_a_long_look_presses(browser, server, emulator, robot):
    with device(browser, server, emulator, "quest") as page:
        headset.ready(page, robot)
        page("for (const c of Object.values(device.controllers)) c.connected = false")
        page.enter()
        page.until("twin.app.hands.count === 0", "no hands")
        page.until("twin.app.xrPanel.whereIs('loop') !== null", "the panel is drawn")
        loop = page("twin.app.model.state.loop")
        look_at(page, page("twin.app.xrPanel.pointAt(twin.app.xrPanel.whereIs('loop')).toArray()"))
        page.until(f"twin.app.model.state.loop === {str(not loop).lower()}", "the long look")


def test_vr_where_there_is_no_ar(browser, server, emulator, robot):
    with device(browser, server, emulator, "vr") as page:
        headset.ready(page, robot)
        assert page.id("enter").inner_text() == "Enter VR"
        assert "VR is available, AR is not" in page.id("xr").inner_text()
        page.enter()
        assert page("[twin.app.xr.mode, twin.app.xr.blend]") == ["immersive-vr", "opaque"]
        assert page("twin.app.world.scene.background !== null && twin.app.world.floor.visible")
        assert page("[twin.app.xr.canPlace, twin.app.place.placing]") == [False, False]
        headset.agrees(page, robot)


def test_the_self_test_passes_in_a_session(browser, server, emulator):
    with device(browser, server, emulator, "quest", room=True, query="?selftest") as page:
        page("globalThis.blind = false")  # for the picture that it judges
        page.until("twin.test && twin.app.xr.ar", "the page")
        page.id("selftest").click()
        page.until("twin.test.done", "the self-test ends")
        results = {r["name"]: (r["verdict"], r["said"]) for r in page("twin.test.results")}
        verdicts = {n: v for n, (v, _) in results.items()}
        assert verdicts.pop("pictures") in ("pass", "FAIL")  # a processor draws few
        assert verdicts.pop("eyes") in ("pass", "not here")  # the emulator was asked for one
        assert set(verdicts.values()) == {"pass"}, results
        assert "immersive-ar" in results["session"][1]
