"""The panel of machines in `twin view`: its buttons ask the console, and it says what the console reads."""

from __future__ import annotations

from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

import twin
from twin.simulation.controllers.trainer import Mode
from twin.ui.viewer.trainer_panel import TrainerPanel

NAMES = ("raven_left", "raven_right")


@pytest.fixture
def panel():
    robots = {n: {"level": "PEDAL_UP", "phase": "teleoperate", "why": None, "problem": None} for n in NAMES}
    reading = {"machines": {"view": "real", "mode": "rehearse", "robots": robots}}
    members = {n: SimpleNamespace(mechanism=twin.load(n).mechanism) for n in NAMES}
    console, gui, pens, buttons = MagicMock(), MagicMock(), MagicMock(), {}
    console.reading, console.members, console.scene = reading, members, twin.load_scene("raven")
    apart = np.array([0, 0.1, 0, 0, 0, 0, 0])
    console.deviations.return_value = {n: {"tip": 2e-3, "joints": apart, "cue": 0.0} for n in NAMES}
    made = TrainerPanel(gui, console, pens, lambda button, label, do: buttons.update({label: do}))
    return made, console, pens, buttons


def test_buttons_ask_the_console(panel):
    _, console, pens, buttons = panel
    for label, mode in (("Engage", Mode.TELEOPERATE), ("Rehearse", Mode.REHEARSE), ("Judge", Mode.JUDGE)):
        buttons[label]("anna")
        console.train.assert_called_with("anna", mode)
    pens.use.assert_not_called()
    buttons["Run"]("anna")
    console.train.assert_called_with("anna", Mode.REPLAY)
    pens.use.assert_called_once_with("anna")
    buttons["stop"]("anna")
    console.press.assert_called_with("anna", "stop")


def test_the_panel_says_what_the_console_reads_and_keeps_the_hands_in_a_replay(panel):
    made, console, pens, _ = panel
    robot = console.reading["machines"]["robots"]["raven_right"]
    robot["why"] = "there is no record of raven_right: rehearse first"
    made.show(1.0)
    said = made._html.content
    assert "raven_left: PEDAL_UP, teleoperate" in said
    assert "Deviation of the tips: 2.00 mm. Largest joint difference: elbow 5.73°" in said
    assert robot["why"] in said
    pens.use.assert_not_called()
    robot["phase"], pens.client = "replay", "anna"
    made.show(1.01)
    pens.use.assert_called_once_with("anna")
    assert "replay" not in made._html.content  # the next point of the curve is not due yet
