"""The page of `twin serve` in headless Chromium, without and with an emulated headset: numbers and pixels.

No physical headset is used anywhere here.
"""

from __future__ import annotations

import re
import time

import numpy as np
import pytest

import twin
from twin.core.units import MM

pytestmark = pytest.mark.browser


from made import headset_page as headset
from made import two_trocars

shown = headset.shown


@pytest.fixture(scope="module")
def robot():
    return twin.load("sils")


@pytest.fixture(scope="module")
def server():
    serving = headset.Serving("sils")
    yield serving
    serving.stop()


@pytest.fixture(scope="module")
def opened(browser, server):
    """The page without a headset; a page needs seconds to open, and the tests need not each have their own."""
    with shown(browser, server.url, draws=False) as page:
        yield page


@pytest.fixture
def desk(opened, robot):
    """The opened page with the protocol planned and the robot at home; it does not draw unless asked to."""
    opened.tab("Simulation")
    headset.ready(opened, robot)
    yield opened
    opened.page.mouse.up()
    opened.draws(False)


# -- the desk ------------------------------------------------------------------------------------------


def test_the_first_picture_comes_and_the_page_says_what_it_is(browser, server, robot):
    with shown(browser, server.url) as page:
        print(f"first picture of the robot after {page('twin.app.firstPicture') / 1000:.2f} s")
        page.until("twin.app.model.state.duration > 0", "the plan")
        assert page.page.locator("h1").first.inner_text() == robot.cad.description.title
        assert "No headset found" in page.id("xr").inner_text()
        assert page.id("enter").is_disabled()
        page.tab("Robot")
        assert "ASSUMED" in page.page.locator("h2", has_text="ASSUMED").inner_text().upper()
        outside = page("performance.getEntriesByType('resource').map(r => r.name)")
        assert all(name.startswith(server.url) for name in outside)


def test_a_protocol_is_played_and_scrubbed(desk, robot):
    desk.id("play").click()
    desk.until("twin.app.model.state.playing", "it plays")
    desk.until("twin.app.clipTime() > 0.5", "time goes on")
    desk.id("play").click()
    desk.until("!twin.app.model.state.playing", "it stops")
    phases = desk("twin.app.model.state.phases")
    assert len(phases) == 6
    name, begin, _ = phases[3]
    desk.page.locator(".phase", has_text=name).click()
    desk.until(f"Math.abs(twin.app.model.frame.clipTime - {begin}) < 0.02", "it stands at the phase")
    box = desk.id("time").bounding_box()
    desk.page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + box["height"] / 2)
    half = desk("twin.app.model.state.duration") / 2
    desk.until(f"Math.abs(twin.app.model.frame.clipTime - {half}) < 0.3", "it stands in the middle")
    headset.until(lambda: desk("twin.app.model.state.phase") in desk.id("phase").inner_text(), "the phase is named")
    headset.agrees(desk, robot)
    desk.id("faster").click()
    desk.until("twin.app.model.state.speed === 2", "it is faster")
    desk.id("speed").click()
    desk.until("twin.app.model.state.speed === 1", "it is as fast as it was")


def test_the_mouse_moves_the_platform(desk, robot):
    before = desk.tool()
    start = desk.pixel(desk.to_scene(before[:3, 3]))
    wanted = before[:3, 3] + np.array([0.0, 0.0, -25 * MM])
    desk.drag(start, desk.pixel(desk.to_scene(wanted)))
    desk.settled()
    after = desk.tool()
    assert 15 * MM < np.linalg.norm(after[:3, 3] - before[:3, 3]) < 60 * MM
    np.testing.assert_allclose(after[:3, :3], before[:3, :3], atol=1e-5)  # it is moved, not turned
    seen = desk.pixel(desk.to_scene(after[:3, 3]))
    np.testing.assert_allclose(seen, desk.pixel(desk.to_scene(wanted)), atol=1.5)  # it is where the mouse let go
    headset.agrees(desk, robot)
    assert desk("twin.app.grab.held === null && twin.app.model.state.holder === null")


def test_keys_undo_a_drag_play_and_show_themselves(desk, robot):
    before = desk.tool()
    start = desk.pixel(desk.to_scene(before[:3, 3]))
    desk.drag(start, desk.pixel(desk.to_scene(before[:3, 3] + np.array([0.0, 0.0, -25 * MM]))))
    desk.settled()
    assert np.linalg.norm(desk.tool()[:3, 3] - before[:3, 3]) > 10 * MM
    desk.page.keyboard.press("Control+z")
    desk.until(f"Math.abs(twin.app.model.frame.q[0] - {robot.inverse(before)[0]}) < 1e-6", "the drag is undone")
    desk.settled()
    np.testing.assert_allclose(desk.tool(), before, atol=1e-6)
    desk.page.keyboard.press("Space")
    desk.until("twin.app.model.state.playing", "it plays")
    desk.page.keyboard.press("Space")
    desk.until("!twin.app.model.state.playing", "it stops")
    asked = "(() => { const { app } = twin; const { ask } = app; window.asked = [];"
    desk(f"{asked} app.ask = (what, more) => {{ window.asked.push(what); ask.call(app, what, more); }}; }})()")
    for _ in range(4):  # held down: the second and further ones repeat
        desk.page.keyboard.down("Space")
    desk.page.keyboard.up("Space")
    assert desk("window.asked") == ["play"]
    desk.page.keyboard.press("Space")
    desk.page.keyboard.press("?")
    assert "Ctrl-Z" in desk.page.locator("dialog.keys").inner_text()
    desk.page.keyboard.press("Control+z")
    assert desk("window.asked") == ["play", "play"]
    desk.page.keyboard.press("Escape")
    assert not desk.page.locator("dialog.keys").is_visible()
    assert "Nearest limit: q" in desk.page.locator(".headline").inner_text()


def test_what_cannot_be_reached_is_said_and_coloured(desk, robot):
    desk.draws(True)
    before = desk.tool()
    start = desk.pixel(desk.to_scene(before[:3, 3]))
    shot = desk.image()
    desk.drag(start, start + np.array([-40, -330]), release=False)
    desk.until("twin.app.model.refused && twin.app.model.state.reason", "the refusal")
    time.sleep(1.0)
    text = desk.id("status").inner_text()
    assert text.startswith("Target not reached: ")
    assert "limit" in text or "reach" in text
    red = np.all(np.abs(desk.image() - [216, 27, 42]) < 40, axis=2).sum()
    assert red > 60 + np.all(np.abs(shot - [216, 27, 42]) < 40, axis=2).sum()
    assert desk("twin.app.grab.ghostHand.visible")
    q = headset.agrees(desk, robot)  # the last good pose is one that closes the loops, within the limits
    limits = np.array([j.limits for j in robot.mechanism.active])
    assert ((q >= limits[:, 0] - 1e-6) & (q <= limits[:, 1] + 1e-6)).all()
    desk.page.mouse.up()
    desk.until("twin.app.grab.held === null", "it is let go")
    desk.until("!twin.app.model.refused && !twin.app.model.state.reason", "the refusal ends with the hand")
    desk.until("!twin.app.model.status().text.startsWith('Target not reached')", "the sentence too")


def test_what_is_wrong_is_red(desk, robot):
    """A shaft that misses its RCM is the alarm of this page; what is right is not red."""
    desk("twin.app.ask('seek', {t: 0.6 * twin.app.model.state.duration})")
    desk.until("twin.app.model.state.rcm_error_m !== null", "the RCM")
    for name in ("rcm", "residual"):  # a slow machine still shows the way there
        desk.until(f"document.querySelector('[data-id=measure-{name}]').dataset.tone === 'plain'", f"{name} is plain")
    assert desk.id("measure-gap").get_attribute("data-tone") == "plain"
    before = desk.tool()
    start = desk.pixel(desk.to_scene(before[:3, 3]))
    desk.drag(start, desk.pixel(desk.to_scene(before[:3, 3] + np.array([0.0, 25 * MM, 0.0]))))
    desk.settled()
    desk.until("twin.app.model.state.rcm_error_m > 1e-3", "the RCM is missed")
    desk.until("document.querySelector('[data-id=measure-rcm]').dataset.tone === 'bad'", "the alarm")
    colour = desk("getComputedStyle(document.querySelector('[data-id=measure-rcm]')).color")
    assert colour == "rgb(179, 16, 30)"
    assert desk.id("measure-residual").get_attribute("data-tone") == "plain"  # it goes where it is moved: they agree


def test_every_trocar_of_a_robot_is_drawn(browser, tmp_path):
    serving = headset.Serving(str(two_trocars.write(tmp_path / two_trocars.NAME)))
    try:
        with shown(browser, serving.url, draws=False) as page:
            page.until("twin.app.model.state.trocars.length === 2", "both trocars")
            page.until("twin.app.overlays.further.some((f) => f.ball.visible)", "the second one is drawn")
            balls = "[twin.app.overlays.rcmBall, ...twin.app.overlays.further.map((f) => f.ball)]"
            drawn = page(f"{balls}.map((b) => b.position.toArray())")
            np.testing.assert_allclose(drawn, list(two_trocars.PLACES.values()), atol=1e-8)
            page("twin.app.overlays.shows.rcm = false")
            page.until("!twin.app.overlays.further.some((f) => f.ball.visible)", "none is drawn")
    finally:
        serving.stop()


def test_nothing_is_drawn_while_nothing_moves(desk, robot):
    desk.draws(True)
    time.sleep(7.0)  # a sentence that is said goes after six seconds
    for _ in range(8):  # a slow machine is still drawing what it was told before
        first, frames = desk("twin.app.world.renderer.info.render.frame"), desk("twin.app.line.frames")
        time.sleep(3.0)
        if desk("twin.app.world.renderer.info.render.frame") == first:
            break
    else:
        pytest.fail("the page draws although nothing moves")
    assert desk("twin.app.line.frames") > frames + 10  # the stream goes on
    desk("twin.app.ask('posture', {name: 'insertion'})")
    # a machine that needs seconds for one picture draws the whole move in one
    desk.until(f"twin.app.world.renderer.info.render.frame > {first}", "a picture of what has moved")


CONTRAST = """(() => {
  const light = (text) => {
    const [r, g, b] = text.match(/[\\d.]+/g).slice(0, 3).map((v) => v / 255)
      .map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const found = {};
  for (const node of document.querySelectorAll('button:hover')) {
    const style = getComputedStyle(node);
    const solid = !style.backgroundColor.startsWith('rgba(0, 0, 0, 0');
    const [a, b] = [light(style.color), solid ? light(style.backgroundColor) : 1].sort((x, y) => x - y);
    found[node.dataset.id ?? node.textContent] = (b + 0.05) / (a + 0.05);
  }
  return found;
})()"""


def test_every_button_can_be_read_under_the_mouse(desk):
    """WCAG 2.2, 1.4.3: 4.5 to 1, whether pressed or not."""
    desk.page.mouse.move(5, 400)
    looked = {}
    for tab in ("Simulation", "Interaction", "Scene", "Robot"):
        desk.tab(tab)
        for button in desk.page.locator("button:visible:enabled").all():
            button.hover()
            looked |= desk(CONTRAST)
    desk.id("play").click()  # the mouse rests on what is now Pause
    desk.until("twin.app.model.state.playing", "it plays")
    time.sleep(0.5)
    looked |= {f"{name}, pressed": value for name, value in desk(CONTRAST).items()}
    assert "play, pressed" in looked
    assert {name: value for name, value in looked.items() if value < 4.5} == {}


CUT = """[...document.querySelectorAll('.side .tab')].filter((tab) => {
  const { right } = tab.getBoundingClientRect(), edge = document.querySelector('.side').getBoundingClientRect().right;
  return tab.scrollWidth > tab.clientWidth || right > edge;
}).map((tab) => tab.textContent)"""
"""Headings of the controls that are cut off."""


@pytest.mark.parametrize("size", [(1280, 800), (844, 390), (390, 844)])
def test_all_headings_of_the_controls_are_whole_folded_or_not(desk, size):
    with desk.sized(*size):
        assert desk(CUT) == []
        fold = desk.id("fold")
        if min(size) < 500:
            # the page is told of its new size some time after that
            headset.until(lambda: fold.get_attribute("aria-expanded") == "false", "a small screen begins folded")
        before = fold.get_attribute("aria-expanded")
        fold.click()
        headset.until(lambda: fold.get_attribute("aria-expanded") != before, "it is folded, or unfolded")
        assert desk(CUT) == []
        fold.click()
        headset.until(lambda: fold.get_attribute("aria-expanded") == before, "it is as before")


def test_a_joint_is_led_by_its_slider_and_by_its_link(desk, robot):
    desk.tab("Interaction")
    q = headset.agrees(desk, robot)
    bar = desk.id("joint-q2")
    bar.focus()
    bar.press("ArrowLeft")
    desk.until(f"Math.abs(twin.app.model.joint('q2') - {q[1]}) > 1e-4", "the joint moves")
    desk.settled()
    q = headset.agrees(desk, robot)
    desk.id("mode-joint").click()
    start = desk.pixel_of_link("carriage2")
    desk.drag(start, start + np.array([0, 40]))
    desk.settled()
    after = headset.agrees(desk, robot)
    moved = np.abs(after - q)
    assert moved[1] > 10 * MM  # the carriage runs along its rail
    assert np.delete(moved, 1).max() < 1e-6  # and no other joint
    desk.id("mode-auto").click()


def test_a_dimension_is_changed_and_set_back(desk):
    desk.tab("Interaction")
    names = desk("twin.app.model.info.distances.map((d) => d.name)")
    index = next(i for i, name in enumerate(names) if name.startswith("strut1:"))
    desk.id("distance").select_option(str(index))
    before = desk.state()[1]
    bar = desk.id("distance-value")
    bar.focus()
    bar.press("ArrowRight")
    desk.until("twin.app.model.state.distances.length === 1", "the distance is changed")
    changed, value = desk("twin.app.model.state.distances[0]")
    assert changed == index
    assert value > desk(f"twin.app.model.info.distances[{index}].drawn")
    desk.until("document.querySelector('[data-id=changed]').innerText.includes('strut1')", "the change is named")
    headset.until(lambda: max(np.abs(desk.state()[1][n] - T).max() for n, T in before.items()) > 1e-5, "links move")
    desk.id("as-drawn").click()
    desk.until("twin.app.model.state.distances.length === 0", "as drawn")
    headset.until(lambda: max(np.abs(desk.state()[1][n] - T).max() for n, T in before.items()) < 1e-5, "links return")


def test_two_pages_see_the_same_and_one_holds_it(browser, server, desk):
    with shown(browser, server.url, draws=False) as other:
        start = desk.pixel(desk.to_scene(desk.tool()[:3, 3]))
        desk.drag(start, start + np.array([10, 8]), release=False)
        holder = desk("twin.app.model.client")
        other.until("twin.app.model.heldByOther", "the other page hears of it")
        other.until(
            f"document.querySelector('[data-id=status]').innerText.includes('{holder} holds')",
            "it is said who holds it",
        )
        at = other.pixel(other.to_scene(other.tool()[:3, 3]))
        other.page.mouse.move(*at)
        other.page.mouse.down()
        other.until("twin.app.grab.held === null", "the other hand is refused")
        other.page.mouse.up()
        desk.settled()
        other.settled()
        np.testing.assert_array_equal(other.state()[0], desk.state()[0])
        desk.page.mouse.up()
        other.until("!twin.app.model.heldByOther", "it is free")


def test_a_lost_line_is_told_and_taken_up_again(browser):
    serving = headset.Serving("sils")
    try:
        with shown(browser, serving.url, draws=False) as page:
            serving.stop()
            page.until("twin.app.model.line === 'reconnecting'", "the loss")
            page.until(
                "document.querySelector('[data-id=status]').innerText.includes('reconnecting')", "the loss is told"
            )
            notice = page.page.locator(".toast")
            notice.wait_for(state="visible")
            assert 'run "twin serve sils" again' in notice.inner_text()
            assert page("twin.app.robot !== null")
            frames = page("twin.app.line.frames")
            serving.start()
            page.until("twin.app.model.line === 'open'", "the line is back")
            page.until(f"twin.app.line.frames > {frames}", "frames come again")
            assert page("twin.app.line.reconnects") >= 1
            notice.wait_for(state="hidden")
            page.errors[:] = [e for e in page.errors if "WebSocket" not in e and "ERR_" not in e]
    finally:
        serving.stop()


def test_ghost_workspace_and_surroundings_are_shown(desk):
    desk.tab("Scene")
    desk.id("variant").select_option("eq1=printed")
    desk.until("twin.app.overlays.ghostText.includes('magnified ×')", "the ghost")  # enlarged, and that is said
    assert re.search(r": \d[\d.]* (µm|mm), ", desk.id("ghost").inner_text())  # its size depends on the pose
    assert desk("twin.app.overlays.ghost.visible")
    desk.id("variant").select_option("")
    desk.id("show-workspace").click()
    desk.until("twin.app.overlays.cloudCount > 100", "the workspace")
    desk.id("show-workspace").click()
    desk.until("twin.app.overlays.cloudCount === 0", "the workspace is forgotten")


def test_the_patient_is_that_of_the_protocol_or_it_is_said_why_there_is_none(desk):
    desk.tab("Scene")
    desk.id("show-scenery").click()
    desk.until(
        "twin.app.overlays.sceneryText(twin.app.model.robot).includes('RCM at the platform')", "why there is none"
    )
    assert not desk("twin.app.overlays.scenery.visible")
    desk("twin.app.ask('protocol', {name: 'lowered_patient'})")
    desk.until("twin.app.model.state.protocol === 'lowered_patient'", "the protocol with a patient")
    desk.until("twin.app.overlays.scenery.children.length > 0", "the patient")
    shown = desk("twin.app.overlays.scenery.children.map(c => c.name)")
    assert {"abdomen", "table", "pedestal", "gel_cap"} <= set(shown)
    assert desk("twin.app.overlays.scenery.visible")
    assert "ASSUMED" in desk.id("patient").inner_text()
    desk.id("show-scenery").click()
    desk.until("!twin.app.overlays.scenery.visible", "the patient is hidden")
    desk("twin.app.ask('protocol', {name: 'table2'})")
    desk.until("twin.app.model.state.protocol === 'table2'", "the protocol as before")


def test_the_self_test_passes_on_a_desk(browser, server):
    with shown(browser, server.url + "?selftest", draws=False) as page:
        page("globalThis.blind = false")  # for the picture that it judges
        page.id("selftest").click()
        page.until("twin.test.done", "the self-test ends")
        results = {r["name"]: r["verdict"] for r in page("twin.test.results")}
        assert results.pop("headset") == "not here"
        assert set(results.values()) == {"pass"}, results
        assert "0 failed, 1 not here" in page.id("verdict").inner_text()
