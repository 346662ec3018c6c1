"""The page of `twin serve raven` in Chromium: rehearse in the model, judge, run on a machine process; its refusal."""

from __future__ import annotations

import re
import time

import pytest

from made import headset_page as headset
from made.console_page import console

pytestmark = [pytest.mark.browser, pytest.mark.alone]  # machine processes in real time: nothing else may run


@pytest.fixture(scope="module")
def page(browser):
    server = headset.Serving("raven")
    # With few pictures in a second, a hand would move in steps, which are too fast for the machine.
    with console(browser, server.url, size=(900, 520), draws=False) as opened:
        yield opened
    server.stop()


MACHINE = "twin.app.model.robots[0].frame.q"
STATE = "twin.app.machines.state"


def phase(page):
    return page(f"{STATE}.robots.raven_left.phase")


def lead(page, x, y, seconds=2.0):
    """Move the left hand for a time, as a person does: a little in each picture."""
    end, k = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        k += 1
        page(f"twin.app.console.move('left', {0.05 * x / 40}, {0.05 * y / 40}, 0)" if k <= 40 else "0")
        time.sleep(seconds / 60)


def follows(page):
    """Lead the left hand until its arm follows, and the machine has its pedal down."""
    end = time.monotonic() + headset.WAIT
    while page(f"{STATE}.robots.raven_left.level") != "PEDAL_DN":
        assert time.monotonic() < end
        page("twin.app.console.move('left', 0.0005, 0, 0)")
        time.sleep(0.05)


TIPS = """
(() => {
  const covers = [...document.querySelectorAll('header, .side, .foot, .inset, .machines')];
  const boxes = covers.map((o) => o.getBoundingClientRect()), c = twin.app.console;
  return ['left', 'right'].map((side) => {
    const { x, y } = c.views.project(c.tip(side), 'scope');
    const inside = x > 20 && x < innerWidth - 20 && y > 0 && y < innerHeight;
    return inside && boxes.every((b) => x < b.left - 20 || x > b.right + 20 || y < b.top - 20 || y > b.bottom + 20);
  });
})()
"""
"""Whether each tip is in the picture, 20 pixels or more beside everything that covers it."""


BUTTONS = """
[...document.querySelectorAll('.machines button')].every((button) => {
  const b = button.getBoundingClientRect();
  return document.elementFromPoint((b.left + b.right) / 2, (b.top + b.bottom) / 2) === button;
})
"""
"""Whether a press on the middle of each button of the machine meets this button."""


@pytest.mark.parametrize("size", [(1280, 800), (1024, 768), (900, 520), (390, 844)])
def test_no_panel_covers_a_tip_or_a_button(page, size):
    """With the instruments where they are at the start; and the buttons, however long the message is."""
    page.until(f"{STATE} !== null && {STATE}.robots.raven_left.level === 'PEDAL_UP'", "the machine is at home")
    page.page.set_viewport_size({"width": size[0], "height": size[1]})
    try:
        page.until(f"{TIPS}.every((free) => free)", "both tips are seen")
        page.until(BUTTONS, "all buttons are free")
        long = "twin.app.machines.apart.textContent = 'joint '.repeat(200)"
        why = f"{STATE}.robots.raven_left.why"
        # The page gets a new state only if it has changed: the long message stays until it is taken back below.
        free = page(
            f"(() => {{ {why} = 'too fast '.repeat(80); twin.app.machines.refresh(); const first = {BUTTONS.strip()};"
            f"{long}; twin.app.machines.place(); return [first, {BUTTONS.strip()}, ...{TIPS.strip()}]; }})()"
        )
        assert free == [True] * 4, "neither a long message nor long deviations push a button out or cover a tip"
    finally:
        page(f"(() => {{ {STATE}.robots.raven_left.why = null; twin.app.machines.refresh(); }})()")
        page.page.set_viewport_size({"width": 900, "height": 520})


LATE = re.compile("no state of raven_left was received|raven_left (does not answer|is not ready|is in PEDAL_UP)")


def until_the_machine_was_in_time(attempt):
    """Repeat an attempt, which returns the reason why its motion was stopped, or "".

    A computer that is busy for half a second stops a motion of the machine, as it must. This is no fault of the page.
    """
    end = time.monotonic() + headset.WAIT
    while why := attempt():
        assert LATE.search(why), why
        assert time.monotonic() < end, why


def replayed(page):
    """Rehearse, judge and replay a motion; return the reason why the replay was stopped, "" if it was completed."""
    page.until(f"{STATE} !== null && {STATE}.robots.raven_left.level === 'PEDAL_UP'", "the machine is at home")
    page.id("teleoperate").click()
    page.until(f"{STATE}.robots.raven_left.phase === 'teleoperate'", "teleoperation")
    follows(page)
    page.id("rehearse").click()
    page.until(f"{STATE}.robots.raven_left.phase === 'rehearse'", "the rehearsal")
    page.until(f"{STATE}.robots.raven_left.level === 'PEDAL_UP'", "the machine holds")
    at = page(f"[...{MACHINE}]")
    lead(page, 1, 1)
    time.sleep(1.0)
    assert page(f"[...{MACHINE}]") == pytest.approx(at, abs=2e-3)
    page.until("twin.app.machines.points.at(-1).tips[0] > 0.004", "the model has moved away")
    page.id("judge").click()
    page.until(f"{STATE}.robots.raven_left.phase === 'judged'", "the record is judged")
    assert page(f"{STATE}.robots.raven_left.why") is None, "a good record"
    page.id("replay").click()
    page.until(f"['done', 'stopped'].includes({STATE}.robots.raven_left.phase)", "the replay has ended")
    if phase(page) == "done":
        assert page(f"[...{MACHINE}]") != pytest.approx(at, abs=5e-3)
        return ""
    return page(f"{STATE}.robots.raven_left.why")


def test_a_motion_is_rehearsed_judged_and_run_on_the_machine(page):
    page.id("machines").wait_for()
    until_the_machine_was_in_time(lambda: replayed(page))
    page.id("teleoperate").click()
    page.until(f"{STATE}.mode === 'teleoperate'", "teleoperation")
    page.id("replay").click()
    said = "document.querySelector('[data-id=machine-said]').textContent"
    text = "mm from where the record begins (limit 2): move it to the start"
    page.until(f"{said}.includes('{text}')", "the second run is refused")


def test_the_camera_pedal_changes_which_is_solid(page):
    veiled = "twin.app.members.map((m) => m.robot.veiled)"
    names = page("twin.app.members.map((m) => m.model.info.name)")
    ghosts = lambda: {n for n, on in zip(names, page(veiled), strict=True) if on}  # noqa: E731
    assert ghosts() == {"raven_left_model", "raven_right_model"}
    for _ in range(2):  # a tap
        page("twin.app.console.toggle('camera')")
        time.sleep(0.1)
    page.until(f"{STATE}.view === 'virtual'", "the other view")
    page.until("twin.app.machines.board.dataset.view === 'virtual'", "the panel shows it")
    assert ghosts() == {"raven_left", "raven_right"}


def planned(page):
    """Plan a motion and let the machine make it; return why it was stopped, "" if it arrived."""
    page.until(f"{STATE}.robots.raven_left.level === 'PEDAL_UP'", "the machine holds")
    page.id("teleoperate").click()
    page.until(f"{STATE}.robots.raven_left.phase === 'teleoperate'", "teleoperation")
    follows(page)
    page("twin.app.console.chosen = 'left'")
    page.id("plan").click()
    page.until("twin.app.console.plan.phase === 'aim' && twin.app.console.plan.state.ready", "the hand moves it")
    page.until(f"{STATE}.robots.raven_left.level === 'PEDAL_UP'", "the machine holds")
    at = page(f"[...{MACHINE}]")
    lead(page, 1, -1)
    page.id("plan-find").click()
    page.until("twin.app.console.plan.phase === 'preview'", "the preview")
    assert page(f"[...{MACHINE}]") == pytest.approx(at, abs=2e-3)
    page.id("plan-accept").click()
    page.until("twin.app.console.plan.phase === 'off'", "the motion has ended")
    text = "twin.app.model.status().text"
    page.until(f"/raven_left has arrived|The motion/.test({text})", "a result")
    if "raven_left has arrived" not in page(text):
        return page(text)
    assert page(f"[...{MACHINE}]") != pytest.approx(at, abs=5e-3)
    assert 0 < float(page(f"{text}.match(/at most ([0-9.]+) mm/)[1]")) < 3
    return ""


def test_a_planned_motion_is_made_by_machine_and_model(page):
    until_the_machine_was_in_time(lambda: planned(page))


def test_the_stop_button_stops_the_machine(page):
    page.id("machine-stop").click()
    page.until(f"{STATE}.robots.raven_left.level === 'E_STOP'", "the machine stops")
    page.id("machine-start").click()
    page.until(f"{STATE}.robots.raven_left.level === 'PEDAL_UP'", "the machine is at home again")
    assert phase(page) in ("teleoperate", "stopped")
