"""What twin adds to the page of viser, without a robot: keys, and the notice when the server has gone."""

from __future__ import annotations

import pytest

from twin.ui.viewer.server import with_additions

pytestmark = pytest.mark.browser

PAGE = """<!doctype html><meta name=viewport content=width=device-width><title>twin</title>
<body><div id='root'></div><button>▶ Play</button></body>""".encode()
COMMAND = "twin view 'robots/my </script><b>robot'"
QUICK = """
const every = window.setInterval.bind(window);
window.setInterval = (act, ms) => every(act, 20);
window.pressed = 0;
addEventListener('DOMContentLoaded', () => {
  const button = document.querySelector('button');
  button.addEventListener('click', () => window.pressed++);
});
"""


@pytest.fixture
def page(browser):
    page = browser.new_page()
    gone = []

    def answer(route):
        if route.request.method == "HEAD" and gone:
            route.abort()
        else:
            route.fulfill(body=with_additions(PAGE, COMMAND), content_type="text/html; charset=utf-8")

    page.route("http://twin.test/**", answer)
    page.add_init_script(QUICK)
    page.goto("http://twin.test/")
    yield page, gone
    page.close()


def test_a_held_key_acts_once_and_a_server_that_is_gone_is_told_with_the_command(page):
    page, gone = page
    for _ in range(4):  # the second and further ones repeat
        page.keyboard.down("Space")
    page.keyboard.up("Space")
    assert page.evaluate("window.pressed") == 1
    for _ in range(3):
        page.keyboard.down("?")
    assert page.locator(".twin-keys").is_visible()
    page.keyboard.press("Escape")
    assert not page.locator(".twin-gone").is_visible()
    gone.append(True)
    page.wait_for_selector(".twin-gone:not([hidden])")
    assert f"run {COMMAND} again" in page.locator(".twin-gone").inner_text()
    assert page.locator("b").count() == 0


def test_a_slider_is_high_enough_for_a_finger(browser):
    slider = b'<div class="mantine-Slider-root"><div class="mantine-Slider-trackContainer">-</div></div>'
    context = browser.new_context(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    page = context.new_page()
    page.set_content(with_additions(PAGE.replace(b"<button>", slider + b"<button>"), COMMAND).decode())
    assert page.locator(".mantine-Slider-trackContainer").bounding_box()["height"] >= 40
    context.close()


SHEET = b"""<div class="mantine-Paper-root" style="position: fixed; bottom: 0; height: 60%">
<div style="cursor: pointer">twin</div></div>"""
ARRIVING = """
const links = [], fits = [];
window.fits = fits;
window.twinTools = { meshes: () => links, fit: () => fits.push(links.length) };
for (const ms of [100, 900, 1700]) setTimeout(() => links.push(ms), ms);
"""


def test_a_phone_shows_the_whole_robot_although_its_links_come_one_after_the_other(browser):
    page = browser.new_page(viewport={"width": 390, "height": 844})
    page.add_init_script(ARRIVING)
    page.route("http://twin.test/**", lambda route: route.fulfill(body=with_additions(PAGE + SHEET, COMMAND)))
    page.goto("http://twin.test/")
    page.wait_for_function("window.fits.at(-1) === 3")
    assert page.evaluate("window.fits[0]") < 3
    assert page.locator(".twin-sheet").bounding_box()["width"] == 390
    page.close()
