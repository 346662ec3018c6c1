"""The console's page under fingers, in Chromium with a touch screen, and its stereo pictures on a screen."""

from __future__ import annotations

import numpy as np
import pytest

from made import headset_page as headset
from made.console_page import ARMS, JAW, console, joints, let_go, moved, rest, seen, tips

pytestmark = pytest.mark.browser

SCALE = 0.5
"""Pixels of the screen by those of the page: a processor draws them."""


@pytest.fixture(scope="module")
def opened(browser):
    server = headset.Serving("davinci")
    with console(browser, server.url, size=(900, 520), draws=False, scale=SCALE) as page:
        yield page
    server.stop()


@pytest.fixture
def page(opened):
    let_go(opened)
    return opened


class Fingers:
    """A touch screen."""

    def __init__(self, page):
        self.page, self.session = page, page.page.context.new_cdp_session(page.page)

    def touch(self, *points):
        """Put fingers down, move them, or lift them all."""
        kind = "touchEnd" if not points else "touchMove" if self.down == len(points) else "touchStart"
        self.down = len(points)
        fingers = [{"x": float(x), "y": float(y), "id": i} for i, (x, y) in enumerate(points)]
        self.session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": fingers})

    down = 0

    def drag(self, start, end, until, steps=12):
        """Drag fingers (k, 2) to where they end, to and fro until something has happened."""
        start, end = np.array(start, float), np.array(end, float)
        for k in range(1, len(start) + 1):
            self.touch(*start[:k])
        k = 0

        def step():
            nonlocal k
            k += 1
            self.touch(*(start + min(1, k / steps) * (end - start) + (0, k % 2)))
            return until()

        headset.until(step, "the fingers have an effect")
        self.touch()


@pytest.fixture
def fingers(page):
    return Fingers(page)


@pytest.mark.parametrize("side", ARMS)
def test_a_finger_moves_the_nearest_instrument(page, fingers, side):
    before, (x, y, _) = joints(page), tips(page)[side]
    fingers.drag([(x, y)], [(x + 40, y)], lambda: tips(page)[side][0] > x + 12)
    assert moved(before, rest(page)) == {ARMS[side]}


def test_two_fingers_pan_zoom_and_roll_the_camera(page, fingers):
    middle = np.mean([t[:2] for t in tips(page).values()], axis=0)
    for name, end, sign in (
        ("pan", [(-60, 0), (20, 0)], lambda b, a: b[0] - a[0]),
        ("zoom", [(-90, 0), (90, 0)], lambda b, a: b[2] - a[2]),  # what is seen comes nearer
        ("roll", [(-30, -26), (30, 26)], lambda b, a: a[1] - b[1]),  # clockwise: what is right goes down
    ):
        before, tip = rest(page), seen(page, "right") * (1, 1, -1)
        start = middle + np.array([(-40, 0), (40, 0)])
        effect = lambda before=before: moved(before, joints(page)) == {"ecm"}  # noqa: E731
        fingers.drag(start, middle + np.array(end), effect)
        assert moved(before, rest(page)) == {"ecm"}, name
        assert sign(tip, seen(page, "right") * (1, 1, -1)) != 0
        page.until("!twin.app.console.pens.camera", "the pedal is released")


def test_fingers_that_leave_the_picture_fast_move_the_camera_only(page, fingers):
    middle = np.mean([t[:2] for t in tips(page).values()], axis=0)
    before = rest(page)
    fingers.drag(
        middle + np.array([(-40, 0), (40, 0)]), middle + np.array([(-200, 0), (200, 0)]), lambda: True, steps=1
    )
    assert moved(before, rest(page)) <= {"ecm"}


def test_a_finger_left_of_two_moves_nothing(page, fingers):
    x, y, _ = tips(page)["right"]
    page("addEventListener('pointerdown', (e) => (window.second = e.pointerId), {capture: true})")
    fingers.touch((x, y))
    fingers.touch((x, y), (x - 60, y))
    page.until("twin.app.console.pens.camera", "two fingers are the camera")
    before = rest(page)
    # DevTools lifts all fingers or none
    page(
        "twin.app.world.renderer.domElement.dispatchEvent("
        "new PointerEvent('pointerup', {pointerId: second, pointerType: 'touch', bubbles: true}))"
    )
    page.until("!twin.app.console.pens.camera", "one finger is not")
    for k in range(8):
        fingers.touch((x + 6 * k, y), (x - 60, y))
    assert moved(before, rest(page)) == set()
    fingers.touch()


def test_buttons_of_the_page_are_pedals_and_jaws(page, fingers):
    page.id("clutch").click()
    page.until("twin.app.model.console.mode === 'nothing'", "clutch")
    before, (x, y, _) = rest(page), tips(page)["right"]
    fingers.touch((x, y))
    for k in range(8):
        fingers.touch((x + 6 * k, y))
    fingers.touch()
    assert moved(before, rest(page)) == set()
    page.id("clutch").click()
    page.until("twin.app.model.console.mode === 'instruments'", "no clutch")
    page.id("jaw-left").click()
    headset.until(lambda: joints(page)[1][JAW] > 0.2, "the left jaw opens")
    page.id("jaw-left").click()
    headset.until(lambda: joints(page)[1][JAW] < 0.1, "the left jaw shuts")


def test_both_lenses_are_shown_side_by_side_and_in_red_and_cyan(opened):
    page = opened
    page.draws(True)
    page("document.querySelector('.coach').remove()")  # the hint where to drag is over the picture
    page("twin.app.console.views.swap(), twin.app.console.views.swap()")
    pictures = {}
    for mode in ("side", "red-cyan", "one"):
        page.id("stereo").select_option(mode)
        page("twin.app.world.touch()")
        # a picture at rest that is finished: while it is drawn, the canvas of a slow renderer can be empty
        page.until(
            "!twin.app.world.dirty && !twin.app.world.pace.busy && !twin.app.world.pace.reduced", "a finished picture"
        )
        pictures[mode] = page.image()
    right, bottom = (int(SCALE * v) for v in page("twin.app.world.free()"))
    half = right // 2
    name = page("document.querySelector('header').getBoundingClientRect().bottom")
    middle = slice(int(SCALE * name) + 6, bottom - int(SCALE * 130))  # neither the name nor beside the small picture
    side = pictures["side"][middle]
    a, b = side[:, :half], side[:, half : 2 * half]
    apart = np.abs(a - b).max(axis=2)
    assert 0.005 < (apart > 40).mean() < 0.3, "two pictures that are alike and not the same"
    box = pictures["red-cyan"][middle, :right]
    red, green, blue = np.moveaxis(box, 2, 0)
    assert np.abs(green - blue).max() <= 2
    assert 0.002 < (np.abs(red - green) > 30).mean() < 0.4, "coloured edges where the eyes see apart"
    _, green, blue = np.moveaxis(pictures["one"][middle, :right], 2, 0)
    assert (np.abs(green - blue) > 20).mean() > 0.03, "in one picture skin and pegs have their colours"


def picture(page, mode):
    """Return the finished picture at rest in a mode of stereo."""
    page.id("stereo").first.select_option(mode)  # in halves, its copy has the same name
    page("twin.app.world.touch()")
    page.until(
        "!twin.app.world.dirty && !twin.app.world.pace.busy && !twin.app.world.pace.reduced", "a finished picture"
    )
    return page.image()


ONE_EYE = """((name) => {
  const { eyes } = twin.app.console.views;
  eyes.follows ??= eyes.follow;
  eyes.follow = name === 'both' ? eyes.follows : function (middle) {
    this.follows(middle);
    for (const each of [this.left, this.right]) {
      each.matrixWorld.copy(this[name].matrixWorld);
      each.matrixWorldInverse.copy(this[name].matrixWorldInverse);
      each.projectionMatrix.copy(this[name].projectionMatrix);
    }
  };
})"""
"""Script that gives both rows, or both halves, the camera of one eye, for pictures to compare with."""


def test_even_rows_are_for_the_left_eye_and_odd_rows_for_the_right(opened):
    page = opened
    page.draws(True)
    pictures = {}
    for eye in ("left", "right", "both"):
        page(f"{ONE_EYE}('{eye}')")
        pictures[eye] = picture(page, "rows")
    right, bottom = (int(SCALE * v) for v in page("twin.app.world.free()"))
    area = np.s_[int(SCALE * 120) : bottom - int(SCALE * 130), : right - 4]  # no control lies above it
    left, other, rows = (pictures[eye][area] for eye in ("left", "right", "both"))
    first = area[0].start % 2  # parity of the area's first row, counted from the top of the screen
    even = slice(first, None, 2)
    odd = slice(1 - first, None, 2)
    assert (np.abs(left - other).max(axis=2) > 40).mean() > 0.005, "the eyes see different pictures"
    assert np.abs(rows[even] - left[even]).max() <= 2
    assert np.abs(rows[odd] - other[odd]).max() <= 2
    page.id("swap-rows").click()
    swapped = picture(page, "rows")[area]
    assert np.abs(swapped[odd] - left[odd]).max() <= 2
    assert np.abs(swapped[even] - other[even]).max() <= 2
    page.id("swap-rows").click()
    picture(page, "one")


def test_both_halves_have_the_whole_window_and_the_controls(opened):
    page = opened
    page.draws(True)
    halves = picture(page, "halves")
    page.until("twin.app.console.views.halves.copy.childElementCount > 0", "the copy")
    page("twin.app.console.views.halves.copied = -1e9, twin.app.world.touch()")
    halves = picture(page, "halves")
    width = halves.shape[1] // 2
    a = halves[:, :width]
    b = halves[:, width : 2 * width]
    side = page(
        "(() => { const r = twin.app.dom.side.getBoundingClientRect(); return [r.left, r.right, r.top, r.bottom]; })()"
    )
    x0, x1, y0, y1 = (int(SCALE * v) for v in side)
    assert x1 <= width, "the controls are in the left half"
    bar = page(
        "(() => { const r = twin.app.dom.foot.getBoundingClientRect(); return [r.left, r.right, r.top, r.bottom]; })()"
    )
    for left, stop, top, bottom in ((x0, x1, y0, y1), [int(SCALE * v) for v in bar]):
        controls = np.s_[top + 4 : bottom - 4, left + 4 : stop - 4]
        apart = np.abs(a[controls] - b[controls]).max(axis=2)
        assert (apart > 60).mean() < 0.02, "and their copy in the right half"
    middle = np.s_[int(SCALE * 120) : int(SCALE * 300), 4 : x0 - 4]
    assert 0.003 < (np.abs(a[middle] - b[middle]).max(axis=2) > 40).mean() < 0.4, "each eye has its picture"
    picture(page, "one")
    assert page("document.querySelector('.copy') === null")
    assert page.errors == []
