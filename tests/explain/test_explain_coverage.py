"""The rows that `explain` does not judge are listed with the reason."""

from __future__ import annotations

from pathlib import Path

import twin

ROOT = Path(__file__).parents[2]


def test_each_row_that_is_not_judged_has_a_reason():
    explanation = twin.explain("sils")
    notes = [note for note in explanation.notes if note.startswith("not judged: ")]
    assert len(notes) == explanation.rows_of_formula - explanation.judged
    for note in notes:
        row, _, reason = note.removeprefix("not judged: ").partition(": ")
        assert "." in row
        assert reason


def test_a_stage_with_equations_is_explained_without_a_stated_accuracy():
    stage = twin.load(ROOT / "usd/sils/sils.usda").with_formula(twin.load("sils").formula)
    assert twin.explain(stage, seconds=0.0).verdict == "agree"
