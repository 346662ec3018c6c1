"""Questionnaires of a study: on the page in Chromium, and their answers in the table of trials."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import twin
from made import headset_page as headset
from made.console_page import console as shown_console
from made.pens import Pens
from twin.cli import scenes
from twin.core.errors import TwinError
from twin.simulation.devices.packets import pack
from twin.simulation.session.trial_table import TrialTable
from twin.ui.headset.client_messages import RefusedError, parse_message
from twin.ui.headset.console_stream import ConsoleStream
from twin.ui.headset.packet_socket import UDP_OWNER
from twin.ui.session.exercise import Exercise
from twin.ui.session.forms import QuestionnaireForms
from twin.ui.session.timeline import TICK_RATE
from twin.validation.rank_tests import compare


@pytest.fixture
def forms(tmp_path):
    return QuestionnaireForms(TrialTable(tmp_path / "t.csv", "1", "simulation"), ["ssq"], ["nasatlx", "facevalidity"])


def cells(path):
    head, *rows = [line.split(",") for line in path.read_text().splitlines()]
    return [dict(zip(head, row, strict=True)) for row in rows]


def test_names_with_other_line_ends_stay_in_their_cells(tmp_path):
    for user, group in (("Ann\u2028Lee", "VR"), ("Bo\x85b", "bo\x0bx")):
        TrialTable(tmp_path / "t.csv", user, group).add({"time_s": 30.0})
        TrialTable(tmp_path / "t.csv", user + "2", group).add({"time_s": 40.0})
    assert TrialTable(tmp_path / "t.csv", "Ann\u2028Lee", "VR").trial == 1
    assert set(compare(tmp_path / "t.csv").users.groups) == {"VR", "bo\x0bx"}


def test_answers_before_go_to_the_next_trial_and_answers_after_to_the_last(forms, tmp_path):
    table = forms._trials
    assert forms.state() == {"when": "before", "name": "ssq", "left": 1}
    forms.answer("before", "ssq", [1] * 16, None)
    assert forms.state() is None
    table.add({"time_s": 40.0})
    forms.finish()
    assert forms.state() == {"when": "after", "name": "nasatlx", "left": 2}
    forms.answer("after", "nasatlx", [80, 20, 60, 40, 50, 30], [5, 0, 4, 1, 3, 2])
    forms.answer("after", "facevalidity", [5, 4, 3, 4, None, None, None, None], None)
    table.add({"time_s": 42.0})
    (first, second) = cells(tmp_path / "t.csv")
    assert (first["before_ssq_16"], first["nasatlx_1"], first["nasatlx_w6"]) == ("1", "80", "2")
    assert (first["facevalidity_4"], first["facevalidity_5"]) == ("4", "")
    assert (second["before_ssq_1"], second["nasatlx_1"], second["time_s"]) == ("", "", "42")
    for user in ("1", "2"):
        TrialTable(tmp_path / "t.csv", user, "physical").add({"time_s": 30.0})
    found = compare(tmp_path / "t.csv").users.measures
    # by hand: 890 / 15 weighted, 280 / 6 raw; seven items of 1 each for the disorientation before
    assert found["nasatlx_weighted"][0] == pytest.approx(890 / 15)
    assert found["nasatlx_raw"][0] == pytest.approx(280 / 6)
    assert found["before_ssq_disorientation"][0] == pytest.approx(7 * 13.92)
    assert found["time_s"] == [41, 30, 30]


@pytest.mark.parametrize(
    ("name", "answers", "weights", "said"),
    [
        ("nasatlx", [50] * 6, None, "'ssq' before the task is asked now, not 'nasatlx' before"),
        ("ssq", [math.inf] * 16, None, "ssq_1 is inf; give an integer, 0 to 3"),
        ("ssq", [0] * 15, None, "16 items; 15 answers"),
        ("ssq", [4] * 16, None, "ssq_1 is 4; give an integer, 0 to 3"),
        ("ssq", [0.5] * 16, None, "ssq_1 is 0.5; give an integer"),
        ("ssq", [0] * 16, [1] * 16, "0 weights; 16 are given"),
    ],
)
def test_answers_that_are_not_allowed_are_refused_and_asked_again(forms, name, answers, weights, said):
    with pytest.raises(TwinError, match=said):
        forms.answer("before", name, answers, weights)
    assert forms.state() == {"when": "before", "name": "ssq", "left": 1}


def test_weights_are_those_of_all_comparisons(forms):
    forms.answer("before", "ssq", [0] * 16, None)
    with pytest.raises(TwinError, match="no questionnaire is asked now"):
        forms.answer("after", "nasatlx", [0] * 6, None)
    forms._trials.add({"time_s": 1.0})
    forms.finish()
    with pytest.raises(TwinError, match="have the sum 14; it must be 15"):
        forms.answer("after", "nasatlx", [0] * 6, [5, 4, 3, 2, 0, 0])
    with pytest.raises(TwinError, match="nasatlx_w1 is 6; give an integer, 0 to 5"):
        forms.answer("after", "nasatlx", [0] * 6, [6, 4, 3, 2, 0, 0])
    with pytest.raises(TwinError, match="nasatlx_w1 is nan; give an integer, 0 to 5"):
        forms.answer("after", "nasatlx", [0] * 6, [math.nan, 4, 3, 2, 0, 0])
    forms.restart()
    assert forms.state() is None


def test_a_late_answer_before_goes_to_the_first_trial_and_a_second_click_to_no_form(tmp_path):
    forms = QuestionnaireForms(TrialTable(tmp_path / "t.csv", "1", "simulation"), ["ssq"], ["ssq"])
    table = forms._trials
    table.add({"time_s": 40.0})  # the attempt is ended before the questionnaire is answered
    forms.finish()
    forms.restart()
    forms.answer("before", "ssq", [1] * 16, None)
    table.add({"time_s": 42.0})
    forms.finish()
    with pytest.raises(TwinError, match="'ssq' after the task is asked now, not 'ssq' before the task"):
        forms.answer("before", "ssq", [1] * 16, None)
    forms.answer("after", "ssq", [2] * 16, None)
    (first, second) = cells(tmp_path / "t.csv")
    assert (first["before_ssq_1"], first["ssq_1"]) == ("1", "")
    assert (second["before_ssq_1"], second["ssq_1"]) == ("", "2")


def test_answers_before_an_attempt_that_was_not_made_are_no_user_and_belong_to_no_later_attempt(tmp_path):
    path = tmp_path / "t.csv"
    for user in ("1", "left"):
        QuestionnaireForms(TrialTable(path, user, "simulation"), ["ssq"], []).answer("before", "ssq", [1] * 16, None)
    later = TrialTable(path, "1", "simulation")  # another command, without --before
    later.add({"time_s": 40.0})
    for user in ("1", "2"):
        TrialTable(path, user, "physical").add({"time_s": 30.0})
    rows = cells(path)
    assert [(row["user"], row["trial"], row["before_ssq_1"]) for row in rows[:3]] == [
        ("1", "", "1"),
        ("left", "", "1"),
        ("1", "1", ""),
    ]
    found = compare(path)
    assert found.users.groups == ["simulation", "physical", "physical"]
    assert found.users.measures["time_s"] == [40, 30, 30]
    assert math.isnan(found.users.measures["before_ssq_total"][0])
    (note,) = [finding for finding in found.findings if finding.code == "study.trials"]
    assert "3 trials of 3 users" in note.message
    assert "which do not count: 2" in note.message
    again = QuestionnaireForms(TrialTable(path, "1", "simulation"), ["ssq"], [])
    again.answer("before", "ssq", [2] * 16, None)  # the row that waits is that of this command now
    again._trials.add({"time_s": 41.0})
    assert [(row["trial"], row["before_ssq_1"]) for row in cells(path)[:1]] == [("2", "2")]


def test_a_table_with_no_attempt_has_nothing_to_compare(tmp_path):
    forms = QuestionnaireForms(TrialTable(tmp_path / "t.csv", "1", "simulation"), ["ssq"], [])
    forms.answer("before", "ssq", [1] * 16, None)
    with pytest.raises(TwinError, match="nothing to compare"):
        compare(tmp_path / "t.csv")


@pytest.fixture(scope="module")
def loaded():
    return scenes.load(twin.load_scene("sher_phantom"))


def test_no_hand_moves_a_robot_while_a_questionnaire_is_due(loaded, tmp_path):
    table = TrialTable(tmp_path / "t.csv", "1", "simulation")
    forms = QuestionnaireForms(table, ["ssq"], [])
    console = ConsoleStream(loaded, Exercise(forms=forms))
    console.listen("127.0.0.1", 0)
    pen = Pens(console.packets.socket.port)
    said = []
    console.send = said.append
    try:
        pen.send(pack(0, 1, np.eye(4), 0.0, False))
        for tick in range(3):
            console.frame(float(tick), tick / TICK_RATE)
        assert console.owner is None
        (refusal,) = [document["message"] for document in said if document["type"] == "error"]
        assert "a questionnaire, which is due on the page, controls the hands" in refusal
        hand = {"pose": [0, 0, 0, 0, 0, 0, 1], "grip": 0.0}
        hands = {"type": "hands", "number": 1, "right": hand, "left": hand, "clutch": False, "camera": False}
        with pytest.raises(RefusedError, match="Answer the questionnaire on the page first"):
            console.ask("c1", parse_message(json.dumps(hands)))
        form = {"type": "form", "when": "before", "name": "ssq", "answers": [1] * 16}
        console.ask("c1", parse_message(json.dumps(form)))
        console.ask("c1", parse_message(json.dumps(hands)))
        assert console.owner == "c1"
        with pytest.raises(RefusedError, match="no questionnaire is asked now"):
            console.ask("c2", parse_message(json.dumps(form)))
        pen.send(pack(0, 2, np.eye(4), 0.0, False))
        console.release("c1")
        console.frame(3.0, 3 / TICK_RATE)
        assert console.owner == UDP_OWNER
    finally:
        pen.close()
        console.close()


def test_an_unknown_questionnaire_is_named_with_those_that_there_are(tmp_path):
    with pytest.raises(TwinError, match=r"sus.*nasatlx"):
        QuestionnaireForms(TrialTable(tmp_path / "t.csv", "1", "x"), ["sus"], [])


CHOOSE = """
((name, value) => {
  const all = [...document.querySelectorAll(`[data-id=form] input[name='${name}']`)];
  const one = all.find((o) => o.value === value);
  one.checked = true;
  one.dispatchEvent(new Event('change'));
})
"""
SLIDE = """
((name, value) => {
  const slider = document.querySelector(`[data-id=form] [data-id='${name}']`);
  slider.value = value;
  slider.dispatchEvent(new Event('input'));
})
"""
COUNT = """
{
  const ask = twin.app.ask.bind(twin.app);
  window.sent = 0;
  twin.app.ask = (...of) => {
    window.sent += 1;
    return ask(...of);
  };
}
"""
"""Script that counts the requests of the page."""
ENTER = """
(() => {
  const { left, right, top, bottom } = document.querySelector('[data-id=enter]').getBoundingClientRect();
  return document.elementFromPoint((left + right) / 2, (top + bottom) / 2).dataset.id;
})()
"""
"""What a press on the middle of the button that enters a headset meets."""
DONE = "document.querySelector('[data-id=form-done]').click()"


@pytest.mark.slow
@pytest.mark.browser
def test_the_page_asks_before_and_after_and_the_table_has_the_scores_by_hand(browser, tmp_path):
    file = tmp_path / "study.csv"
    options = ("--task", "phantom", "--trials", file, "--before", "ssq", "--after", "nasatlx")
    server = headset.Serving("sher_phantom", None, *options)
    ratings, order = [80, 20, 60, 40, 50, 30], [0, 2, 4, 5, 3, 1]  # weights 5, 0, 4, 1, 3, 2
    try:
        with shown_console(browser, server.url, size=(1000, 760), draws=False) as page:
            page.until("!document.querySelector('[data-id=form]').hidden", "the questionnaire before")
            page("twin.app.xr.vr = true, twin.app.refresh()")  # as with a headset, in which the form can be answered
            page.page.set_viewport_size({"width": 800, "height": 600})
            page.until(f"{ENTER} === 'enter'", "the form leaves the button free that enters the headset")
            page("twin.app.xr.vr = false, twin.app.refresh()")
            page.page.set_viewport_size({"width": 1000, "height": 760})
            for k in range(16):
                page(f"{CHOOSE}('item-{k}', '{k % 4}')")
            page(
                "window.keys = []; for (const k of ['keydown', 'keyup']) addEventListener(k, () => window.keys.push(k))"
            )
            page.page.focus("[data-id=form] input")
            page.page.keyboard.press("KeyI")
            # a key that was pressed before the form had the focus is released by this
            assert page("window.keys") == ["keyup"]
            page(DONE)
            page.until("document.querySelector('[data-id=form]').hidden", "no questionnaire")
            page("twin.app.ask('task', {do: 'end'})")
            page.until("!document.querySelector('[data-id=form]').hidden", "the questionnaire after")
            page.page.screenshot(path=str(tmp_path / "form.png"))
            for k, value in enumerate(ratings):
                page(f"{SLIDE}('item-{k}', {value})")
            items = page("twin.app.console.info.questionnaires.find(k => k.name === 'nasatlx').items")
            pairs = [(i, j) for i in range(6) for j in range(i + 1, 6)]
            for k, pair in enumerate(pairs[:-1]):
                page(f"{CHOOSE}('pair-{k}', '{items[min(pair, key=order.index)]}')")
            page(DONE)
            page.until(
                "document.querySelector('[data-id=form] .wrong').textContent.includes('1 of 15')", "one is missing"
            )
            page(f"{CHOOSE}('pair-14', '{items[min(pairs[-1], key=order.index)]}')")
            page(DONE)
            page.until("document.querySelector('[data-id=form]').hidden", "no questionnaire")
    finally:
        server.stop()
    (row,) = cells(file)
    assert [row[f"nasatlx_w{k}"] for k in range(1, 7)] == ["5", "0", "4", "1", "3", "2"]
    assert [row[f"nasatlx_{k}"] for k in range(1, 7)] == [str(r) for r in ratings]
    assert [row[f"before_ssq_{k}"] for k in range(1, 17)] == [str(k % 4) for k in range(16)]
    assert (row["time_s"], row["holes_touched"]) == ("", "0")  # the task was ended before a hole
