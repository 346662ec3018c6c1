"""Questionnaires on the page of a console, before the first attempt at a task and after each attempt."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from twin.core.errors import TwinError, unknown
from twin.core.json_types import JsonObject
from twin.simulation.session.trial_table import TrialTable
from twin.validation.questionnaires import BEFORE_PREFIX, QuestionnaireKey, keys

When = Literal["before", "after"]


def unanswered(trials: TrialTable, when: When, names: Sequence[str]) -> list[str]:
    """Return those of the questionnaires that have no answer in the newest row of the user.

    A questionnaire of which all items were left open has no answer.
    """
    columns = {}
    for key in keys():
        columns[key.name] = [_prefix(when) + column for column in key.columns]
    return [name for name in names if not trials.has_values(columns[name])]


def _prefix(when: When) -> str:
    """Return the first letters of the columns of the answers in the table of trials."""
    return BEFORE_PREFIX if when == "before" else ""


class QuestionnaireForms:
    """The questionnaires of a study; answers go to the row of the newest trial, those of "before" to the first one.

    The first trial is the next one of the table when the questionnaires are prepared: answers of "before" are
    written to its row at once, and late answers still go to it.

    Attributes:
        due: the forms to answer now, in order, as (when, key).
    """

    def __init__(self, trials: TrialTable, before: Sequence[str], after: Sequence[str], one_row: bool = False) -> None:
        """Prepare the questionnaires with these names.

        `one_row`: all answers go to one row, which the first answer writes if the user has none yet.

        Raises:
            TwinError: there is no such questionnaire.
        """
        questionnaires = {key.name: key for key in keys()}
        for name in (*before, *after):
            if name not in questionnaires:
                raise TwinError(unknown("questionnaire", name, questionnaires))
        self._trials = trials
        self._one_row = one_row
        self._first_trial = trials.trial + 1
        self._forms_after = [questionnaires[name] for name in after]
        self._forms_by_key = {name: questionnaires[name] for name in (*before, *after)}
        self.due: list[tuple[When, QuestionnaireKey]] = []
        for name in before:
            self.due.append(("before", questionnaires[name]))

    def finish(self) -> None:
        """Ask for the questionnaires after an attempt."""
        for key in self._forms_after:
            self.due.append(("after", key))

    def restart(self) -> None:
        """Forget what was not answered after the last attempt."""
        unanswered_before: list[tuple[When, QuestionnaireKey]] = []
        for when, key in self.due:
            if when == "before":
                unanswered_before.append((when, key))
        self.due = unanswered_before

    def answer(self, when: When, name: str, answers: Sequence[float | None], weights: Sequence[float] | None) -> None:
        """Store the answers of the form that is due; None: an item without an answer.

        Raises:
            TwinError: another form is due, or none, or an answer is not allowed.
            OutputError: the table cannot be written.
        """
        if not self.due:
            raise TwinError(f"no questionnaire is asked now; '{name}' comes before or after an attempt at the task")
        asked_when, key = self.due[0]
        if (asked_when, key.name) != (when, name):
            raise TwinError(
                f"the questionnaire '{key.name}' {asked_when} the task is asked now, not '{name}' {when} the task"
            )
        key.check(answers, weights)
        prefix = _prefix(when)
        cells = {}
        for column, value in zip(key.columns, answers, strict=True):
            cells[prefix + column] = value
        if weights is not None:
            for column, value in zip(key.weight_columns, weights, strict=True):
                cells[prefix + column] = value
        self._store_answers(when, cells)
        self.due.pop(0)

    def _store_answers(self, when: When, cells: Mapping[str, float | None]) -> None:
        trials = self._trials
        if self._one_row:
            if trials.trial == 0:
                trials.add(cells)
            else:
                trials.answer(cells)
        elif when == "after":
            trials.answer(cells)
        elif trials.trial < self._first_trial:
            trials.add_to_next(cells)
        else:  # the first attempt was ended before this form was answered
            trials.answer(cells, self._first_trial)

    def about(self) -> list[JsonObject]:
        """Return the questionnaires for the page: title, items, ends and steps of the scale, comparisons of pairs."""
        forms = []
        for key in self._forms_by_key.values():
            form: JsonObject = {
                "name": key.name,
                "title": key.title,
                "items": [item.name for item in key.item],
                "low": key.low,
                "high": key.high,
                "step": key.step,
                "ends": list(key.ends),
                "pairs": key.weighted is not None,
            }
            forms.append(form)
        return forms

    def state(self) -> JsonObject | None:
        """Return the form to answer now, as (when, name); None: there is none."""
        if not self.due:
            return None
        when, key = self.due[0]
        return {"when": when, "name": key.name, "left": len(self.due)}
