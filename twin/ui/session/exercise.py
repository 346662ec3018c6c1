"""Data of an exercise at a console: task, condition, session file and report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from twin.model.task import ConsoleTask
    from twin.simulation.condition import Condition
    from twin.simulation.controllers.instrument_pivot import Fulcrum
    from twin.simulation.session.trial_table import TrialTable
    from twin.ui.session.forms import QuestionnaireForms
    from twin.ui.session.task_choice import TaskChoice

MakeReport = Callable[[str, str], bytes]
"""Function that takes the paths of session file and scene file, and returns the HTML page of the report.

The function must be at the top level of a module, because it runs in another process.
"""


@dataclass(frozen=True)
class Exercise:
    """An exercise at a console.

    Attributes:
        task: the task; None: no task. For a task with rings, the World has movable objects and contact; for a
            procedure, it has organs, vessels and clips.
        session: session file of the first attempt; for later attempts, a number is appended to the name of this file.
            None: a temporary file if a report is made, otherwise no file.
        report: function that makes the report of an attempt, in another process; None: no reports.
        condition: condition of the experiment, including whether the hands feel forces; None: the default of the
            scene.
        fulcrum: which end of the instruments the hands control at the start: the tips ("compensated") or the outer ends
            ("direct"); see `twin.simulation.controllers.instrument_pivot`.
        trials: table to which each attempt adds a row; None: no table.
        ended: function that is called when an attempt has ended, by its task or on the page; None: nothing is called.
        guided: whether other content follows at the same address, so that the page reloads itself.
        forms: questionnaires of the page, whose answers go to the table of trials; None: no questionnaires.
        choice: tasks that the page can start instead of this one; None: the server shows only this exercise.
    """

    task: ConsoleTask | None = None
    session: Path | None = None
    report: MakeReport | None = None
    condition: Condition | None = None
    fulcrum: Fulcrum = "compensated"
    trials: TrialTable | None = None
    forms: QuestionnaireForms | None = None
    ended: Callable[[], None] | None = None
    guided: bool = False
    choice: TaskChoice | None = None


NO_TASK = Exercise()
"""Exercise without a task, a session file and a report."""
