"""Tasks of a scene that a page can start: a request ends the present content, and the next one follows."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from twin.core.errors import TwinError, unknown
from twin.core.json_types import JsonObject
from twin.model.task import ConsoleTask

EXERCISE_OPTIONS = ("session", "trials", "participant", "guided", "record", "replay", "machine", "ros")
"""Options of `twin serve` that determine the exercise, so that a page cannot start another one."""


class TaskChoice:
    """The task that a server shows, and the one that a page has asked for.

    Attributes:
        tasks: the tasks that can be started, by name.
        present: name of the task that is shown; None: no task, the hands only move the robots.
        problem: why the last task that was asked for cannot be shown; "" without a problem.
    """

    def __init__(self, tasks: Mapping[str, ConsoleTask], present: str | None) -> None:
        """Begin with the task `present`; None: no task."""
        self.tasks = dict(tasks)
        self.present = present
        self.problem = ""
        self._before: str | None = present
        self._asked = False
        self._stopping: asyncio.Event | None = None

    @property
    def task(self) -> ConsoleTask | None:
        """The task that is shown; None: no task."""
        return None if self.present is None else self.tasks[self.present]

    @property
    def asked(self) -> bool:
        """Whether a page has asked for other content, which has not begun yet."""
        return self._asked

    def begin(self, stopping: asyncio.Event) -> None:
        """Begin to show the present task; `stopping` ends it. Call this function in the event loop."""
        self._asked = False
        self._stopping = stopping

    def ask(self, name: str | None) -> None:
        """End the present content; the task `name` follows (None: no task).

        Raises:
            TwinError: there is no such task, nothing is shown, or another task was asked for and has not begun yet.
        """
        if name is not None and name not in self.tasks:
            raise TwinError(unknown("task", name, self.tasks))
        if self._stopping is None:
            raise TwinError("no content is shown: a task can be started while the page is served")
        if self._asked:  # `_before` is then the content that is shown, to which `refuse` returns
            raise TwinError("another task is being prepared: wait until the page shows it")
        self._before = self.present
        self.present = name
        self.problem = ""
        self._asked = True
        self._stopping.set()

    def refuse(self, reason: str) -> bool:
        """Return to the content before, because the task cannot be shown; return False if there is none before."""
        if self.present == self._before:
            return False
        self.present = self._before
        self.problem = reason
        return True

    def about(self) -> JsonObject:
        """Return the tasks for a page: name and title of each, and the name of the present one."""
        tasks = [[name, task.title] for name, task in self.tasks.items()]
        return {"tasks": tasks, "present": self.present}


def judged(tasks: Mapping[str, ConsoleTask]) -> dict[str, ConsoleTask]:
    """Return the tasks that a page judges while they are performed, by name."""
    judged_tasks = {}
    for name, task in tasks.items():
        if task.kind.judged:
            judged_tasks[name] = task
    return judged_tasks
