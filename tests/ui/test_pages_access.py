"""Accessibility of all pages as axe-core finds it, and controls outside of the window: three widths, light and dark."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path

import pytest

import twin
from made import reports
from made.headset_page import BLIND, WAIT, Serving, npm_environment, until
from made.lanes import nightly
from twin.ui.report import render_html

pytestmark = pytest.mark.browser

ROOT = Path(__file__).parents[2]
SCHEMES = ("light", "dark")
DESKS = ((1280, 800), (1920, 1080))
PHONE = (390, 844)

VIEWER = ("twin", "view", "--no-browser")
SERVER = ("twin", "serve", "--no-browser")

PAGES = {
    # command, its robot, further options, tabs
    "view": (VIEWER, "sils", (), ("Play", "Move", "Design", "Scene")),
    "serve": (SERVER, "sils", (), ("Simulation", "Interaction", "Scene", "Robot")),
    "faces": (VIEWER, ROOT / "cad/hibou/hibou.step", (), ()),
    "console": (SERVER, "davinci", (), ("Console", "Scene", "Robot")),
    "procedure": (SERVER, "vsrs", ("--task", "cholecystectomy"), ("Console", "Scene")),
    "task": (SERVER, "raven_dome", (), ("Console", "Robot")),
}

CHECK = """async () => {
  const { violations, passes } = await axe.run(document);
  const found = [];
  for (const { id, impact, nodes } of violations)
    if (/serious|critical/.test(impact)) found.push(`${id}: ${nodes.map((n) => n.target.join(" ")).join()}`);
  return [found, passes.length];
}"""

OUTSIDE = """() => {
  const scrolls = (node) => {
    for (let at = node.parentElement; at; at = at.parentElement)
      if (/auto|scroll/.test(getComputedStyle(at).overflowX) && at.scrollWidth > at.clientWidth) return true;
    return false;
  };
  const found = [];
  for (const node of document.querySelectorAll('button, select, summary, [role=tab], input:not([type=hidden])')) {
    const { left, right, width, height } = node.getBoundingClientRect();
    if (!width || !height || node.closest('.twin-unseen, [aria-hidden=true]') || scrolls(node)) continue;
    if (right > innerWidth + 1 || left < -1) found.push(node.textContent || node.outerHTML.slice(0, 80));
  }
  return found;
}"""
"""Controls that are cut off by an edge of the window, and cannot be scrolled to."""


@pytest.fixture(scope="module")
def axe():
    """The script of axe-core."""
    return (npm_environment("axe") / "node_modules/axe-core/axe.min.js").read_text("utf-8")


@contextmanager
def opened(browser, url, size, *, drawn):
    """Yield a page that may run scripts of tests; with `drawn` False, its graphics draw nothing."""
    touch = size == PHONE
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]}, has_touch=touch, is_mobile=touch, bypass_csp=True
    )
    page = context.new_page()
    page.set_default_timeout(1000 * WAIT)
    if not drawn:
        page.add_init_script(BLIND % "true")
    page.goto(url)
    yield page
    context.close()


def problems(page, axe, sizes):
    """Return what is wrong with a page at each size and scheme."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(axe)
    found = []
    for width, height in sizes:
        page.set_viewport_size({"width": width, "height": height})
        for scheme in SCHEMES:
            page.emulate_media(color_scheme=scheme)
            page.wait_for_timeout(700)  # colours change gradually
            serious, passed = page.evaluate(CHECK)
            assert passed > 10, "axe has looked at the page"
            for problem in [*serious, *page.evaluate(OUTSIDE)]:
                found.append(f"{width} px, {scheme}: {problem}")
    return found


def show(page, tab):
    """Open a tab, or unfold the panel of a phone to reach it."""
    heading = page.locator('.twin-sheet [style*="cursor: pointer"]')
    tabs = page.get_by_role("tab", name=tab)
    if heading.count() and not tabs.first.is_visible():
        heading.first.click()
    tabs.first.click(force=True)


@pytest.mark.parametrize("name", nightly(PAGES, 3))
def test_axe_finds_nothing_serious_and_no_control_is_cut_off(browser, axe, name):
    command, robot, options, tabs = PAGES[name]
    server = Serving(robot, None, *options, command=command)
    try:
        found = []
        for sizes in (DESKS, (PHONE,)):
            with opened(browser, server.url, sizes[0], drawn=False) as page:
                page.locator("[role=tab], .twin-cube").first.wait_for(state="attached")
                page.wait_for_timeout(3000)  # the panel of a phone folds itself
                if not tabs:
                    found += problems(page, axe, sizes)
                for tab in tabs:
                    show(page, tab)
                    found += [f"{tab}, {problem}" for problem in problems(page, axe, sizes)]
    finally:
        server.stop()
    assert found == []


def test_axe_finds_what_is_wrong(browser, axe):
    """The check itself: a button without a name, grey text, and a button that is cut off, are found."""
    wrong = "<html lang=en><title>t</title><main><h1>t</h1>" + "<p>text</p>" * 12
    wrong += "<button></button><p style='color:#bbb'>grey</p>"
    wrong += "<button style='position:absolute;left:380px;width:50px'>cut</button><a href=#>a</a><ul><li>b</ul>"
    page = browser.new_page()
    page.set_content(wrong)
    found = " ".join(problems(page, axe, [PHONE]))
    for what in ("button-name", "color-contrast", "cut"):
        assert what in found
    page.close()


@pytest.mark.parametrize("verdict", ["agree", "disagree"])
def test_axe_finds_nothing_serious_in_a_report(browser, axe, verdict, tmp_path):
    page_of_report = tmp_path / "report.html"
    page_of_report.write_text(render_html(reports.make_report(verdict, 250), None, None), encoding="utf-8")
    assert checked(browser, axe, page_of_report) == []


def test_axe_finds_nothing_serious_in_the_page_of_a_workspace(browser, axe, tmp_path):
    from twin.ui.report.report_folder import write_result

    write_result(twin.workspace("sils", count=20_000), tmp_path, "sils")
    pages = list(tmp_path.rglob("*.html"))
    assert len(pages) == 1
    assert checked(browser, axe, pages[0]) == []


def checked(browser, axe, file):
    """Return what is wrong with a page that is a file, with all of its parts unfolded."""
    found = []
    for sizes in (DESKS, (PHONE,)):
        with opened(browser, file.as_uri(), sizes[0], drawn=True) as page:
            until(lambda page=page: page.evaluate("document.readyState") == "complete", "the page is loaded")
            page.evaluate("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
            found += problems(page, axe, sizes)
    return found
