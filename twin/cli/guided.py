"""`twin serve SCENE --guided FOLDER`: the study of the console, phase by phase; Enter in the terminal continues."""

from __future__ import annotations

import argparse
import asyncio
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli import machines
from twin.cli import scene as scenes
from twin.core import assets
from twin.core.errors import TwinError

if TYPE_CHECKING:
    from twin.simulation.session.guided import GuidedPart
    from twin.simulation.session.trial_table import TrialTable
    from twin.ui.headset.served import Served
    from twin.ui.session.loaded_scene import LoadedScene

TABLE = "questionnaires.csv"
"""Table of the answers, in the folder of the study: one row for each participant."""

ServePart = Callable[[str, Callable[[], "Served"], "Examiner"], None]
"""Function that serves one part of the run until the examiner continues, or until Ctrl-C."""


class Examiner:
    """Reads lines from the terminal; each line ends the present part of the run.

    Attributes:
        continued: whether a line, and not Ctrl-C, ended the last part.
    """

    def __init__(self) -> None:
        """Begin to read in a thread of its own."""
        self.continued = False
        self._end: Callable[[], object] | None = None
        threading.Thread(target=self._read, daemon=True).start()

    def begin(self, stopping: asyncio.Event) -> None:
        """Set `stopping` at the next line; call this function in the event loop."""
        loop = asyncio.get_running_loop()
        self.continued = False
        self._end = lambda: loop.call_soon_threadsafe(stopping.set)

    def _read(self) -> None:
        for _ in sys.stdin:
            end = self._end
            if end is not None:
                self._end = None
                self.continued = True
                end()


def guide(args: argparse.Namespace, serve_part: ServePart) -> None:
    """Serve the parts of a participant's run one after the other; Ctrl-C ends the run.

    Sessions and answers go to the folder of `--guided`.

    Raises:
        TwinError: the scene has no console or no task of the study, or the participant has taken part already.
    """
    from twin.model.scene import load_scene
    from twin.simulation.session.guided import guided_parts
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
    if table.trial:
        raise TwinError(f"{folder / TABLE}: participant {args.participant} is in group '{table.group}' already")
    loaded = scenes.load(scene)
    examiner = Examiner()
    for part in parts:
        print(f"\n  {part.heading}; press Enter to continue", flush=True)
        serve_part(scene.name, _served(args, loaded, part, folder, table), examiner)
        if not examiner.continued:
            print(f"  the run was ended in phase {part.phase}")
            return
    print(f"\n  the run is complete: {folder}\n  twin study {folder / TABLE}")


def _served(
    args: argparse.Namespace, loaded: LoadedScene, part: GuidedPart, folder: Path, table: TrialTable
) -> Callable[[], Served]:
    """Return the function that creates the content of a part."""
    from twin.cli.commands.session import report
    from twin.ui.headset import served
    from twin.ui.session.exercise import Exercise
    from twin.ui.session.forms import QuestionnaireForms

    scene = replace(loaded.scene, title=part.heading)
    task = None
    session = None
    if part.task is not None:
        task = scene.tasks[part.task]
        session = folder / f"{args.participant}-{part.name}.session"
    forms = None
    if part.before or part.after:
        forms = QuestionnaireForms(table, part.before, part.after)
    if part.after:  # the row of the participant; the answers from before go to it too
        table.add({})
        assert forms is not None
        forms.finish()
    shown = scenes.with_organs(replace(loaded, scene=scene), task)
    exercise = Exercise(task, session, report, part.condition, forms=forms, guided=True)
    return lambda: served.of_console(machines.connected(shown, []), exercise, args.packets, args.mqtt, args.mqtt_topic)
