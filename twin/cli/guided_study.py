"""`twin serve SCENE --guided FOLDER`: the study of the console, phase by phase; Enter in the terminal continues."""

from __future__ import annotations

import argparse
import asyncio
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli import machines, scenes
from twin.core import assets
from twin.core.errors import TwinError

if TYPE_CHECKING:
    from twin.simulation.session.guided_parts import GuidedPart
    from twin.simulation.session.trial_table import TrialTable
    from twin.ui.headset.served_content import ServedContent
    from twin.ui.session.forms import QuestionnaireForms
    from twin.ui.session.loaded_scene import LoadedScene

TABLE = "questionnaires.csv"
"""Table of the answers, in the folder of the study: one row for each participant."""

UNFINISHED = ".part"
"""Suffix of the session file of an interrupted command."""

SET_ASIDE = "unfinished-"
"""First part of the name of a session that was ended by Ctrl-C before its task: its part is repeated."""

_INPUT_TIMEOUT = 0.2
"""Time in s in which the end of an input without lines, such as /dev/null, is seen."""

ServePart = Callable[[str, Callable[[], "ServedContent"], "Examiner"], None]
"""Function that serves one part of the run until the examiner continues, or until Ctrl-C."""


class Examiner:
    """Reads lines from the terminal; each line ends the present part of the run.

    While there are questionnaires to answer, the first line only warns, and the next one ends the part.

    Attributes:
        continued: whether a line, and not Ctrl-C, ended the last part.
        completed: whether an attempt at the task of the last part has ended, by its task or on the page.
        due: function that returns the number of questionnaires that the participant has not answered yet.
    """

    def __init__(self) -> None:
        """Begin to read in a thread of its own."""
        self.continued = False
        self.completed = False
        self.due: Callable[[], int] = partial(_unanswered_count, None)
        self._warned = False
        self._end: Callable[[], object] | None = None
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def require_input(self) -> None:
        """Check that lines can come.

        Raises:
            TwinError: the input of this command has ended, so that no part could be continued.
        """
        self._reader.join(_INPUT_TIMEOUT)
        if not self._reader.is_alive():
            raise TwinError("--guided is continued by Enter, and the input of this command has ended: use a terminal")

    def begin(self, stopping: asyncio.Event) -> None:
        """Set `stopping` at the next line; call this function in the event loop."""
        loop = asyncio.get_running_loop()
        self.continued = False
        self._warned = False
        self._end = lambda: loop.call_soon_threadsafe(stopping.set)

    def complete(self) -> None:
        """Note that an attempt at the task has ended."""
        self.completed = True

    def _read(self) -> None:
        if sys.stdin is None:
            return
        for _ in sys.stdin:
            end = self._end
            if end is None:  # a line between two parts
                continue
            count = self.due()
            if count and not self._warned:
                self._warned = True
                forms = "1 questionnaire is" if count == 1 else f"{count} questionnaires are"
                print(f"  {forms} not answered yet; press Enter again to continue without", flush=True)
                continue
            self._end = None
            self.continued = True
            end()
        if self._end is not None:
            print(
                "  the input has ended, so that Enter continues no part: end the run by Ctrl-C; the same command "
                "continues it",
                flush=True,
            )


def guide(args: argparse.Namespace, serve_part: ServePart) -> None:
    """Serve the parts of a participant's run one after the other; Ctrl-C ends the run.

    Sessions and answers go to the folder of `--guided`. A run that was ended is continued by the same command.

    Raises:
        TwinError: the scene has no console or no task of the study, the participant has taken part already, or Enter
            cannot be read.
    """
    from twin.model.scene import load_scene
    from twin.simulation.session.guided_parts import guided_parts
    from twin.simulation.session.trial_table import TrialTable

    file = scenes.find(args.robot)
    if file is None:
        raise TwinError(f"--guided requires a scene with a console, such as davinci; {args.robot} is a robot")
    if args.participant is None:
        raise TwinError("--guided requires --participant NUMBER, which determines the order of the conditions")
    scene = load_scene(file)
    parts = guided_parts(scene, args.participant)
    folder = Path(args.guided)
    assets.require_writable_file(folder / TABLE)
    table = TrialTable(folder / TABLE, str(args.participant), args.group or "all")
    if table.other_groups and not table.trial:
        group = min(table.other_groups)
        raise TwinError(
            f"{table.path}: participant {args.participant} is in group '{group}': add --group {group}, or give another "
            "number"
        )
    remaining = _remaining(parts, table, folder, args.participant)
    loaded = scenes.load(scene)
    examiner = Examiner()
    examiner.require_input()
    for part in remaining:
        forms = _forms(part, table)
        examiner.due = partial(_unanswered_count, forms)
        print(f"\n  {part.heading}; press Enter to continue", flush=True)
        examiner.completed = False
        serve_part(scene.name, _served(args, loaded, part, folder, forms, examiner), examiner)
        if not examiner.continued:
            print(f"  the run was ended in phase {part.phase}; the same command continues it")
            for file in _recorded(part, folder, args.participant):
                if examiner.completed:
                    print(f"  {file.name} is kept: to repeat this part, move the file to another folder")
                else:
                    print(f"  the task was not ended: {file.name} is now {_set_aside(file)}, and this part is repeated")
            return
    if examiner.due():
        print("\n  the run is over, but questionnaires are not answered: the same command asks them again")
    else:
        print(f"\n  the run is complete: {folder}")
    print(f"  twin study {folder / TABLE}")


def _unanswered_count(forms: QuestionnaireForms | None) -> int:
    """Return the number of questionnaires of a part that have no answer yet."""
    if forms is None:
        return 0
    return len(forms.due)


def _remaining(parts: Sequence[GuidedPart], table: TrialTable, folder: Path, participant: int) -> list[GuidedPart]:
    """Return the parts that the participant has not done yet, each with the questionnaires without an answer.

    A part with a task is done if its session is in the folder; see `SET_ASIDE`. Once a task is done, it is too late for
    what comes before the tasks.

    Raises:
        TwinError: the participant has done all parts, or a session was interrupted.
    """
    from twin.ui.session.forms import unanswered

    files: list[Path] = []
    for part in parts:
        files += _recorded(part, folder, participant)
    for file in files:
        if file.suffix == UNFINISHED:
            raise TwinError(
                f"{file} is left from a session that was interrupted: move it to another folder, and this command "
                "repeats its part"
            )
    remaining = []
    omitted = []
    for part in parts:
        before = unanswered(table, "before", part.before)
        after = unanswered(table, "after", part.after)
        if part.task is not None:
            is_done = bool(_recorded(part, folder, participant))
        elif part.after:
            is_done = not after
            if is_done:
                raise TwinError(
                    f"{table.path}: participant {participant} has taken part already: the questionnaires after the "
                    "experiment are answered; give another number"
                )
        else:
            is_done = bool(files) or (bool(part.before) and not before)
        if is_done:
            omitted.append(part)
        else:
            remaining.append(replace(part, before=before, after=after))
    if omitted:
        print(f"  the run of participant {participant} is continued without:")
        for part in omitted:
            print(f"    {part.heading}")
        print("  to repeat a part, end the run by Ctrl-C and move the session of the part to another folder")
    return remaining


def _recorded(part: GuidedPart, folder: Path, participant: int) -> list[Path]:
    """Return the session files of a part: of each attempt, complete ones and those of an interrupted command."""
    if part.task is None:
        return []
    session = _session(part, folder, participant)
    files = []
    for suffix in (session.suffix, session.suffix + UNFINISHED):
        files += folder.glob(f"{session.stem}{suffix}")
        files += folder.glob(f"{session.stem}-*{suffix}")
    return sorted(files)


def _set_aside(session: Path) -> str:
    """Rename a session so that its part is not done; return its new name, which no other file has."""
    new = session.with_name(SET_ASIDE + session.name)
    number = 2
    while new.exists():
        new = session.with_name(f"{SET_ASIDE}{number}-{session.name}")
        number += 1
    session.rename(new)
    return new.name


def _session(part: GuidedPart, folder: Path, participant: int) -> Path:
    """Return the file into which the session of a part is recorded."""
    return folder / f"{participant}-{part.name}.session"


def _forms(part: GuidedPart, table: TrialTable) -> QuestionnaireForms | None:
    """Return the questionnaires of a part, whose answers go to the participant's row; None: there are none."""
    from twin.ui.session.forms import QuestionnaireForms

    if not part.before and not part.after:
        return None
    forms = QuestionnaireForms(table, part.before, part.after, one_row=True)
    if part.after:
        forms.finish()
    return forms


def _served(
    args: argparse.Namespace,
    loaded: LoadedScene,
    part: GuidedPart,
    folder: Path,
    forms: QuestionnaireForms | None,
    examiner: Examiner,
) -> Callable[[], ServedContent]:
    """Return the function that creates the content of a part; the examiner is told when an attempt has ended."""
    from twin.cli.commands.session import report
    from twin.ui.headset import served_content
    from twin.ui.session.exercise import Exercise

    scene = replace(loaded.scene, title=part.heading)
    task = None
    session = None
    if part.task is not None:
        task = scene.tasks[part.task]
        session = _session(part, folder, args.participant)
    scene_with_organs = scenes.with_organs(replace(loaded, scene=scene), task)
    exercise = Exercise(task, session, report, part.condition, forms=forms, ended=examiner.complete, guided=True)
    return lambda: served_content.of_console(
        machines.connected(scene_with_organs, []), exercise, args.packets, args.mqtt, args.mqtt_topic
    )
