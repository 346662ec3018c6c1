"""The page of a task with rings, in Chromium: rings, scoreboard, end, restart, and a gamepad that is unplugged."""

from __future__ import annotations

import numpy as np
import pytest
from playwright.sync_api import Error

import twin
from made import headset_page as headset
from made.console_page import JAW, console, joints, let_go

pytestmark = pytest.mark.browser
PAD = """
window.pad = {id: 'a pad of the test', connected: false, mapping: 'standard', axes: [0, 0, 0, 0],
  buttons: Array.from({length: 17}, () => ({pressed: false, value: 0}))};
navigator.getGamepads = () => [window.pad];
"""

COVERED = """
(() => {
  const said = [...document.querySelectorAll('.score tr, .rings li')];
  const board = document.querySelector('.score').getBoundingClientRect();
  const out = said.filter((o) => !o.offsetHeight || o.getBoundingClientRect().bottom > board.bottom);
  if (said.length !== 9) out.push(said.length);
  const panels = ['header', '.side', '.score', '.inset', '.foot'].map((s) => document.querySelector(s));
  const boxes = panels.map((o) => o.getBoundingClientRect());
  for (const node of twin.app.objects.nodes) {
    const middle = node.position.clone().setFromMatrixPosition(node.matrixWorld);
    const { x, y } = twin.app.console.views.project(middle, 'scope');
    if (boxes.some((b) => x > b.left && x < b.right && y > b.top && y < b.bottom)) out.push([x, y]);
  }
  return out.map(String);
})()
"""


PANEL = """
((names) => {
  const panel = twin.app.xrPanel;
  panel.group.visible = true;
  for (const late of [1000, 2000]) {
    panel.refresh();
    panel.update(performance.now() + late);
  }
  panel.group.visible = false;
  return names.map((name) => panel.whereIs(name)?.y ?? null);
})
"""


@pytest.fixture(scope="module")
def serving():
    server = headset.Serving("davinci", None, "--task", "pegboard")
    yield server
    server.stop()


@pytest.fixture(scope="module")
def page(browser, serving):
    with console(browser, serving.url, size=(1000, 640), scripts=(PAD,), draws=False) as page:
        page.until("twin.app.loaded", "the scene")
        yield page


def test_rings_are_drawn_where_the_scene_has_them_and_every_page_has_the_scoreboard(page, browser, serving):
    for item in twin.load_scene("davinci").objects:
        page.until(f"twin.app.objects.at('{item.name}').length > 0", "the rings")
        at = page(f"twin.app.objects.at('{item.name}')")
        np.testing.assert_allclose(at, item.T_world_object[:3, 3], atol=1e-3)  # they swing a little at first
    headset.until(lambda: "Rings transferred" in page.id("score").inner_text(), "the scoreboard")
    assert "0 of 4" in page.id("score").inner_text()
    with headset.shown(browser, serving.url, size=(844, 390), draws=False) as other:  # a phone on its side
        other.until("twin.app.model.console?.task !== undefined", "the task")
        assert other("JSON.stringify(twin.app.model.console.task.rings)") == page(
            "JSON.stringify(twin.app.model.console.task.rings)"
        )
        other.until("twin.app.loaded", "the scene")
        headset.until(lambda: other(COVERED) == [], "the board has all its rows, and no panel covers a ring")


def test_the_panel_of_a_headset_has_the_task_below_the_pedals(page):
    """The controls of planning mode are between them, and hidden while the mode is off."""
    clutch, accept, end = page(f"{PANEL}(['clutch', 'plan-accept', 'task-end'])")
    assert accept is None
    assert end < clutch < 0.3


def test_the_numbers_of_the_scoreboard_are_at_the_rings_in_the_endoscope_picture(page):
    headset.until(lambda: "ring 1: not on its peg" in page.id("score").inner_text(), "the scoreboard")
    numbers = "twin.app.objects.nodes.map(n => n.children.filter(c => c.isSprite && c.visible).map(c => c.name))"
    page.until(f"{numbers}.every(n => n.length === 1)", "every ring has one number")
    assert page(numbers) == [[f"number {k}"] for k in (1, 2, 3, 4)]
    seen = "twin.app.objects.nodes.every(n => n.children.filter(c => c.isSprite).every(c => {0}.layers.test(c.layers)))"
    assert page(seen.format("twin.app.console.views.scope"))
    assert not page(seen.format("twin.app.world.camera")), "not in the small picture of the room"


def test_an_unplugged_gamepad_moves_nothing_and_is_told(page):
    page("window.pad.connected = true")
    page.until("twin.app.console.pad.name !== ''", "the pad is seen")
    page("window.pad.buttons[7] = {pressed: true, value: 1}; window.pad.buttons[4] = {pressed: true, value: 1}")
    page.until("twin.app.console.pens.clutch", "the bumper is the clutch")
    page("window.pad.buttons[4] = {pressed: false, value: 0}")
    headset.until(lambda: joints(page)[0][JAW] > 0.3, "the trigger opens the jaw")
    page("window.pad.buttons[7] = {pressed: false, value: 0}")
    headset.until(lambda: joints(page)[0][JAW] < 0.05, "the jaw is closed")
    page("window.pad.axes = [0, 0, 0.5, 0]; window.pad.buttons[4] = {pressed: true, value: 1}")
    page.until("twin.app.console.pens.clutch", "the clutch")
    page("window.pad.connected = false")
    page.until("twin.app.console.pad.name === ''", "the pad is gone")
    assert page("twin.app.console.pens.clutch") is False, "a pedal of the pad is no longer pressed"
    headset.until(lambda: "gamepad was disconnected" in page.id("status").inner_text(), "it is told")
    before = let_go(page)
    assert before[0][JAW] < 0.05
    page("window.pad.axes = [0, 0, 0, 0]; window.pad.buttons[4] = {pressed: false, value: 0}")


def test_the_instrument_moves_a_ring_that_it_meets(page):
    """Down in the picture and deeper, the left instrument sweeps over the floor; upwards it comes to the rings."""
    first = page("JSON.stringify(twin.app.objects.nodes.map((node) => node.position.toArray()))")
    page.page.keyboard.down("w")
    page.page.keyboard.down("q")
    try:
        page.until(
            "(() => { const first = " + first + "; return twin.app.objects.nodes.some((node, i) =>"
            " Math.hypot(...node.position.toArray().map((x, k) => x - first[i][k])) > 0.002); })()",
            "a ring is pushed",
        )
    finally:
        page.page.keyboard.up("q")
        page.page.keyboard.up("w")
    page.until("parseFloat(twin.app.model.console.task.rows[0][1]) > 0.5", "the time runs")


def test_the_end_shows_the_result_and_restart_begins_again(page):
    page.page.keyboard.down("w")
    try:
        page.until("twin.app.model.console.owner !== null", "a hand moves")
        page.id("task-end").click()
        page.id("result").get_by_text("The task was ended.").wait_for()
        page.until("twin.app.model.said.includes('Restart the task')", "the server refuses the hand")
        text = "The task was ended. Press Restart to begin again."
        headset.until(lambda: page.id("status").inner_text() == text, "it is said")
        assert page.id("status").get_attribute("data-tone") == "plain", "the end of a task is no warning"
    finally:
        page.page.keyboard.up("w")
    assert "Rings transferred" in page.id("result").inner_text()
    page.until("twin.app.model.console.task.report !== null", "a report is made")
    page.id("again").click()
    page.until(
        "twin.app.model.console.task.attempt === 2 && twin.app.model.console.task.over === null", "a new attempt"
    )
    headset.until(lambda: not page.id("result").is_visible(), "the result is gone")
    assert not page.errors


def test_another_task_is_started_on_the_page(page):
    """The server ends the present content and shows the next one at the same address; the page reloads itself."""
    assert page("twin.app.console.info.choice.present") == "pegboard"
    page.tab("Console")
    page.id("start-camera").click()

    def shown():
        try:
            return page("window.twin?.app.console?.info.choice.present === 'camera' && twin.app.loaded")
        except Error:  # the page reloads itself at this moment
            return False

    headset.until(shown, "the camera task")
    page.until("twin.app.model.console?.task?.next?.includes('grey line')", "what to do now")
    assert "Camera moves" in page.id("score").inner_text()
    page.errors.clear()  # the browser tells of the connections that the closed server refused
