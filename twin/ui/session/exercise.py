"""What a person does at a console, and what is kept of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from twin.model.task import Task
    from twin.simulation.condition import Condition
    from twin.simulation.controllers.pivot import Fulcrum

MakeReport = Callable[[str, str], bytes]
"""Function at the top level of a module: (session file, scene file) -> page of the report, HTML."""


@dataclass(frozen=True)
class Exercise:
    """A task at a console, its condition, its recording and its report.

    Attributes:
        task: the task; None: no task. If it has rings, the World has movable objects and contact; if it is a procedure,
            organs, vessels and clips.
        session: session file; the files of later attempts have its name with a number. None: no file, or a temporary
            one if a report is made.
        report: makes the report of an attempt, in another process; None: no reports.
        condition: condition of the session, with the switch of the forces; None: the default of the scene.
        fulcrum: end of the instruments that the hands control at the start: "compensated" the tips, "direct" the outer
            ends (see `twin.simulation.controllers.pivot`).
    """

    task: Task | None = None
    session: Path | None = None
    report: MakeReport | None = None
    condition: Condition | None = None
    fulcrum: Fulcrum = "compensated"


NO_TASK = Exercise()
"""No task, recording or report."""
