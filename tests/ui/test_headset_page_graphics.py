"""How the page looks: dark with the system, drawn parts, a person for scale, tasks listed once, sizes for fingers."""

from __future__ import annotations

import numpy as np
import pytest

from made import headset_page as headset

pytestmark = pytest.mark.browser

SMALL = """(() => {
  const small = [];
  for (const e of document.querySelectorAll('button, select, input, summary, a[href], [role=tab]')) {
    if (!e.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
    const { width, height } = e.getBoundingClientRect();
    if (width && height && (width < 40 || height < 40)) small.push([e.outerHTML.slice(0, 80), width, height]);
  }
  return small;
})()"""
"""Visible controls that are smaller than 40 px in one direction."""


@pytest.fixture(scope="module")
def sils():
    serving = headset.Serving("sils")
    yield serving
    serving.stop()


@pytest.fixture(scope="module")
def davinci():
    serving = headset.Serving("davinci")
    yield serving
    serving.stop()


def adorned(page):
    page.until("twin.app.drawn.any", "the drawn parts are loaded")


def test_background_and_floor_are_dark_if_the_system_is(browser, sils):
    with headset.shown(browser, sils.url, scale=0.5) as page:
        adorned(page)
        for scheme, dark in (("dark", True), ("light", False), ("dark", True)):
            page.page.emulate_media(color_scheme=scheme)
            page.until(f"(twin.app.world.sky.getHSL({{h: 0, s: 0, l: 0}}).l < 0.3) === {str(dark).lower()}", scheme)
            page.until(
                "!twin.app.world.dirty && !twin.app.world.pace.busy && !twin.app.world.pace.reduced", "a picture"
            )
            corner = page.image()[-120:-100, 20:60].reshape(-1, 3).mean(axis=0)
            sky = page.image()[60:80, 250:300].reshape(-1, 3).mean(axis=0)
            assert (sky.max() < 90) == dark, (scheme, sky)
            assert (corner.max() < 120) == dark, (scheme, corner)


def test_drawn_parts_follow_the_links_and_change_no_box(browser, sils):
    with headset.shown(browser, sils.url, draws=False) as page:
        adorned(page)
        # the robot's own links, which are judged, have the same box with and without
        box = "JSON.stringify(twin.app.robot.box())"
        with_parts = page(box)
        carriers = page(
            "(() => { const out = []; twin.app.world.robotWorld.traverse((o) => {"
            " if (/^drawn/.test(o.name)) out.push(o.parent.userData.twinLink ?? o.parent.name); }); return out; })()"
        )
        assert {"limb1", "limb2", "limb3", "carriage1", "carriage6"} <= set(carriers)
        # one call draws all that a link carries, and none for shadows
        assert len(carriers) == len(set(carriers)) == page("twin.app.drawn.parts.filter((o) => o.isMesh).length")
        assert not page("twin.app.drawn.parts.some((o) => o.castShadow)")
        cable = "[...twin.app.drawn.cables[0].mesh.geometry.getAttribute('position').array]"
        before = np.array(page(cable))
        page.until("twin.app.model.state.duration > 0", "the plan")
        page("twin.app.ask('seek', { t: 8.0 })")
        page.until("Math.abs(twin.app.model.frame.clipTime - 8.0) < 0.02", "another posture")
        headset.until(lambda: np.abs(np.array(page(cable)) - before).max() > 1e-3, "the cable follows")
        page.tab("Scene")
        page.id("drawn").click()
        page.until("!twin.app.drawn.on", "they are hidden")
        page("twin.app.ask('seek', { t: 0.0 })")
        page.until("Math.abs(twin.app.model.frame.clipTime) < 0.02", "back")
        assert page("twin.app.drawn.parts.every((o) => !o.visible)")
        page.id("drawn").click()
        page.until("twin.app.drawn.parts.every((o) => o.visible)", "they are shown again")
        headset.until(lambda: "not measured (ASSUMED)" in page.id("drawn-notes").inner_text(), "the note is shown")
        assert with_parts.count("Infinity") == page(box).count("Infinity") == 0


def test_a_person_of_the_stated_size_stands_on_the_floor_beside_the_robot(browser, sils):
    with headset.shown(browser, sils.url, draws=False) as page:
        adorned(page)
        page.tab("Scene")
        page.id("person").click()
        page.until("twin.app.drawn.person.visible", "the person is shown")
        low, high = page("(() => { const b = twin.app.drawn.box(); return [b.min.toArray(), b.max.toArray()]; })()")
        assert high[2] - low[2] == pytest.approx(1.75, abs=0.01)
        robot_low, _ = page("(() => { const b = twin.app.member.box(); return [b.min.toArray(), b.max.toArray()]; })()")
        assert low[2] == pytest.approx(robot_low[2], abs=0.003)
        page.id("person").click()
        page.until("!twin.app.drawn.person.visible", "the person is gone")


def test_edges_are_drawn_on_request_and_by_themselves_only_with_a_graphics_processor(browser, sils):
    with headset.shown(browser, sils.url, draws=False) as page:
        adorned(page)
        lines = "twin.app.robot.edges.filter((o) => o.visible).length"
        assert page(lines) == 0  # software draws this page
        page.tab("Scene")
        page.id("rich").click()
        page.until(f"{lines} > 10", "the edges")
        assert page("twin.app.world.scene.environment !== null")
        page.id("rich").click()
        page.until(f"{lines} === 0", "no edges")
        assert page("twin.app.world.scene.environment === null")


def test_a_task_is_listed_once(browser, davinci):
    with headset.shown(browser, davinci.url, draws=False) as page:
        page.until("twin.app.console?.info.choice", "the tasks are known")
        title = page("twin.app.console.info.choice.tasks[0][1]")
        seen = [
            node
            for node in page.page.locator("button", has_text=title[1:]).all()
            if node.is_visible()
        ]  # fmt: skip
        assert len(seen) == 1


@pytest.mark.parametrize("name", ["sils", "davinci"])
def test_controls_are_large_enough_for_fingers(browser, sils, davinci, name):
    serving = sils if name == "sils" else davinci
    context = browser.new_context(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    page = context.new_page()
    page.goto(serving.url)
    headset.until(lambda: page.evaluate("Boolean(window.twin?.app.firstPicture > 0)"), "the page")
    headset.until(lambda: page.locator("[role=tab]").count() > 2, "the tabs")
    assert page.evaluate(SMALL) == []
    for tab in page.locator("[role=tab]").all():
        tab.click()
        assert page.evaluate(SMALL) == [], tab.inner_text()
    context.close()
