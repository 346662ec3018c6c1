"""The report in a browser: it fits the screen that it is read on."""

from __future__ import annotations

import shutil

import pytest

from made import reports
from twin.ui.report import render_html

pytestmark = pytest.mark.browser

WIDER = """[...document.querySelectorAll("body *")]
    .filter(e => e.getBoundingClientRect().right > innerWidth + 1 && !e.closest(".scroll"))
    .map(e => `${e.tagName}.${e.className}`)"""


@pytest.fixture(scope="module", params=["agree", "disagree"])
def page(request, tmp_path_factory):
    from playwright.sync_api import sync_playwright

    program = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chromium-browser")
    if program is None:
        pytest.skip("NO CHROMIUM: the report is not looked at. Install it (Debian: apt-get install chromium)")
    file = tmp_path_factory.mktemp("report") / "report.html"
    file.write_text(render_html(reports.make_report(request.param, 250)), "utf-8")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        page = browser.new_page()
        page.goto(file.as_uri())
        yield page
        browser.close()


@pytest.mark.parametrize("width", [320, 390, 768, 1280])
def test_nothing_but_wide_tables_scrolls_sideways(page, width):
    page.set_viewport_size({"width": width, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate(WIDER) == []
