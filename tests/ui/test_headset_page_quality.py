"""The quality of the page's pictures: lower on slow graphics while something moves, full at rest, never wrong."""

from __future__ import annotations

import time

import pytest

from made import headset_page as headset
from made.console_page import console, let_go, tips

pytestmark = pytest.mark.browser

PIXELS = """
(level) => {
  const { world, console } = twin.app, { pace, renderer } = world, gl = renderer.getContext();
  pace.step(level);
  pace.begin(true);
  for (let k = 0; k < 3; k++) console.views.draw('scope');  // from the second on, the surroundings are a copy
  const { drawingBufferWidth: w, drawingBufferHeight: h } = gl, all = new Uint8Array(4 * w * h);
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, all);
  return all;
}
"""
"""Pixels of the endoscope's picture, with all pixels, at a level of quality."""

COMPARE = f"""
(() => {{
  const pixels = {PIXELS}, direct = pixels(0), copied = pixels(1);
  let different = 0, colors = new Set();
  for (let i = 0; i < direct.length; i += 4) {{
    if (Math.max(...[0, 1, 2].map((c) => Math.abs(direct[i + c] - copied[i + c]))) > 2) different++;
    colors.add(direct[i] << 16 | direct[i + 1] << 8 | direct[i + 2]);
  }}
  return [different / (direct.length / 4), colors.size];
}})()
"""


SIZES = """
(() => {
  const gl = twin.app.world.renderer.getContext();
  window.sizes = [];
  let last = gl.drawingBufferWidth * gl.drawingBufferHeight;
  (function look() {
    requestAnimationFrame(look);  // after the page's own callback, before the display shows the canvas
    const { drawingBufferWidth: w, drawingBufferHeight: h } = gl, row = new Uint8Array(4 * w);
    if (w * h === last) return;
    last = w * h;
    gl.readPixels(0, h >> 1, w, 1, gl.RGBA, gl.UNSIGNED_BYTE, row);
    sizes.push(row.some((value) => value > 0));
  })();
})()
"""
"""Note for each new size of the canvas whether it has a picture when it is shown with this size."""


@pytest.fixture(scope="module")
def page(browser):
    serving = headset.Serving("davinci")
    try:
        with console(browser, serving.url, size=(700, 450)) as opened:
            let_go(opened)
            opened.draws(True)
            yield opened
    finally:
        serving.stop()


def test_surroundings_drawn_once_are_the_same_picture(page):
    different, colors = page(COMPARE)
    assert colors > 500, "a picture of something"
    assert different < 1e-3
    # an instrument remains, before nothing
    page("(twin.app.surroundings.props.visible = false, twin.app.drawn.show(false, false))")
    without, fewer = page(COMPARE)
    page("(twin.app.surroundings.props.visible = true, twin.app.drawn.show(true, true))")
    assert without < 1e-3
    assert fewer < colors, "the copy follows what is shown"


def test_quality_goes_down_on_a_slow_renderer_and_is_full_at_rest(page):
    full = page("Math.min(devicePixelRatio, 2)")
    assert "full quality" in page("(twin.app.world.pace.step(0), twin.app.world.pace.text())")
    x, y, _ = tips(page)["right"]
    mouse = page.page.mouse
    mouse.move(x, y)
    mouse.down()
    # This renderer is a program, which needs more than the time of a picture for all pixels of this page.
    steps = iter(range(1_000_000))

    def fewer():
        mouse.move(x + 20 * (next(steps) % 2), y)
        return page(f"twin.app.world.renderer.getPixelRatio() < {full}")

    headset.until(fewer, "pictures have fewer pixels")
    assert "reduction" in page("twin.app.lineText()")
    assert page("document.documentElement.hasAttribute('data-slow')")
    mouse.up()
    page.until(f"twin.app.world.renderer.getPixelRatio() === {full} && !twin.app.world.dirty", "a full picture at rest")
    assert page("twin.app.world.pace.slow"), "and motion is again drawn with fewer pixels"


def test_the_canvas_is_never_shown_empty(page):
    page(SIZES)
    for k in range(24):
        page(f"(twin.app.world.pace.step({2 + k % 3}), twin.app.world.moved = performance.now(), twin.app.refresh())")
        if k % 2:
            page.page.set_viewport_size({"width": 700 - 10 * (k % 5), "height": 450})
        time.sleep(0.04)
    page.page.set_viewport_size({"width": 700, "height": 450})
    seen = page("sizes")
    assert len(seen) > 15, "quality and window change"
    assert all(seen)


def test_quality_goes_up_when_pictures_are_drawn_fast(page):
    """Judge given times in one call: pictures of the page itself must not come between."""
    levels = page(
        """(() => {
          const { pace } = twin.app.world, levels = [];
          const judge = (...times) => { for (const took of times) pace.judge(took); levels.push(pace.level) };
          pace.step(4);
          pace.proof = 30;
          judge(...Array(30).fill(2));
          judge(2);
          judge(...Array(3 * 31).fill(2));
          judge(30, 2, 30, 2, 30);
          judge(30, 30);
          judge(...Array(31).fill(2));
          judge(...Array(30).fill(2));
          return levels;
        })()"""
    )
    assert levels[:3] == [4, 3, 0], "a step after 31 fast pictures"
    assert levels[3] == 0, "a single slow picture changes nothing"
    assert levels[4:] == [1, 1, 0], "after a reduction, twice as many are required"
