"""The report in a browser: it fits the screen that it is read on."""

from __future__ import annotations

from dataclasses import replace

import pytest

from made import reports
from twin.ui.report import render_html

pytestmark = pytest.mark.browser

WIDER = """[...document.querySelectorAll("body *")]
    .filter(e => e.getBoundingClientRect().right > innerWidth + 1 && !e.closest(".scroll, figure"))
    .map(e => `${e.tagName}.${e.className}`)"""


@pytest.fixture(scope="module", params=["agree", "disagree"])
def page(request, browser, tmp_path_factory):
    file = tmp_path_factory.mktemp("report") / "report.html"
    report = reports.make_report(request.param, 250)
    twice = [replace(f, where="s2") for f in report.findings if f.code == "point.differs"]  # a list in a finding
    file.write_text(render_html(replace(report, findings=(*report.findings, *twice))), "utf-8")
    page = browser.new_page()
    page.goto(file.as_uri())
    yield page
    page.close()


@pytest.mark.parametrize("width", [320, 390, 768, 1280])
def test_only_wide_tables_and_figures_scroll_sideways(page, width):
    page.set_viewport_size({"width": width, "height": 844})
    page.evaluate("document.querySelectorAll('details').forEach(list => { list.open = true; })")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate(WIDER) == []


def test_a_column_of_sentences_is_wide_enough_on_a_phone(page):
    page.set_viewport_size({"width": 390, "height": 844})
    widths = page.evaluate("[...document.querySelectorAll('#variants tbody td:last-child')].map(e => e.offsetWidth)")
    assert widths
    assert min(widths) >= 200
