"""The rows that `explain` does not judge are listed with the reason."""

from __future__ import annotations

import twin


def test_each_row_that_is_not_judged_has_a_reason():
    explanation = twin.explain("sils")
    notes = [note for note in explanation.notes if note.startswith("not judged: ")]
    assert len(notes) == explanation.rows_of_formula - explanation.judged
    for note in notes:
        row, _, reason = note.removeprefix("not judged: ").partition(": ")
        assert "." in row
        assert reason
