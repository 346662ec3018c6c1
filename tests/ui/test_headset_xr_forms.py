"""Questionnaires on the panel in an emulated headset: items with a button each, items with a slider, pairs."""

from __future__ import annotations

import csv

import pytest

from made import headset_page as headset
from made.console_page import console

pytestmark = pytest.mark.browser


def test_a_questionnaire_is_answered_on_the_panel_and_the_page_shows_the_same_answers(browser, emulator, tmp_path):
    table = tmp_path / "t.csv"
    options = ("--task", "phantom", "--trials", table, "--before", "ssq,nasatlx")
    server = headset.Serving("sher_phantom", None, *options)
    start = "emulate('vr', false); device.position.set(0, 1.6, 1.4)"
    with console(browser, server.url, size=(320, 240), scripts=(emulator, start), draws=False) as page:
        page.until("twin.app.xr.vr", "VR")
        page.enter()
        page.until("twin.app.hands.count === 2", "controllers")
        # not before the panel, which stands at the left
        page(
            "device.controllers.right.position.set(0.2, 1.25, 1.05), device.controllers.left.position.set(0.5, 1, 1.05)"
        )

        def on_panel(control):
            page.until(f"twin.app.xrPanel.whereIs('{control}') !== null", control)

        def scroll_and_press(control):
            while page(f"twin.app.xrPanel.whereIs('{control}') === null"):
                page.press("scroll-down")
            page.press(control)

        def chosen(item):
            return page(f"twin.app.console.forms.answers[{item}]")

        on_panel("item-0-next")
        assert "questionnaire on the panel" in page("twin.app.model.status().text")
        for answer in (0, 1):  # from no answer on
            page.press("item-0-next")
            page.until(f"twin.app.console.forms.answers[0] === {answer}", f"{answer}")
        page.press("item-0-previous")
        page.until("twin.app.console.forms.answers[0] === 0", "one less")
        assert chosen(1) is None
        page.press("item-1-next")
        # the page has the same answers, also after the headset is taken off
        page("twin.app.xr.session.end()")
        page.until("!twin.app.xr.presenting", "the page")
        page.until("document.querySelector('[name=item-0][value=\"0\"]').checked", "the answer on the page")
        assert page("document.querySelectorAll('[name=item-2]:checked').length") == 0
        page.enter()
        page.until("twin.app.hands.count === 2", "controllers")
        scroll_and_press("form-done")
        page.until("twin.app.model.console.form?.name === 'nasatlx'", "the next questionnaire")
        on_panel("item-0")
        page.press("item-0")  # in the middle
        page.until("twin.app.console.forms.answers[0] === 50", "the middle of a slider")
        scroll_and_press("pair-0-1")
        scroll_and_press("form-done")
        page.until("twin.app.console.forms.wrong !== ''", "a pair alone is not enough")
        assert page("twin.app.console.forms.wrong") == "14 of 15 pairs are not compared yet: compare all or none."
        page("for (const p of twin.app.console.forms.pairs) p.chosen = p.items[0]")
        scroll_and_press("form-done")
        page.until("twin.app.model.console.form === null", "no questionnaire is left")
        page.until("twin.app.xrPanel.whereIs('item-0') === null", "the panel has its first tab again")
        on_panel("tab-console")
    server.stop()
    (row,) = csv.DictReader(table.read_text().splitlines())
    assert (row["trial"], row["before_ssq_1"], row["before_ssq_2"], row["before_ssq_3"]) == ("", "0", "0", "")
    assert (row["before_nasatlx_1"], row["before_nasatlx_w1"], row["before_nasatlx_w6"]) == ("50", "5", "0")
