"""The guided run of the console's study: five phases (Fig. 8 of its paper), the task with forces in random order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from twin.core.errors import TwinError
from twin.model.scene import Scene
from twin.simulation.condition import RUNS, Condition, randomised

PHASES = 5
"""Number of phases; the third one has two runs."""

_REPEATED = "pegboard"
"""Task of the third phase, with and without forces on the hands."""

_ONCE = "camera"
"""Task of the fourth phase."""


@dataclass(frozen=True)
class GuidedPart:
    """A part of a guided run: a phase, or one of the runs of the third phase.

    Attributes:
        phase: number of the phase, from 1.
        name: name of the part, for files.
        title: what the participant does.
        task: name of the task; None: no task.
        condition: whether the hands feel forces, participant, and run.
        before, after: questionnaires that the page asks.
    """

    phase: int
    name: str
    title: str
    task: str | None
    condition: Condition
    before: Sequence[str] = ()
    after: Sequence[str] = ()

    @property
    def heading(self) -> str:
        """Number and title of the phase."""
        return f"phase {self.phase} of {PHASES}: {self.title}"


def guided_parts(scene: Scene, participant: int) -> list[GuidedPart]:
    """Return the parts of the run of a participant, in order; the order of the runs with and without forces is random.

    The same participant has the same order each time, see `twin.simulation.condition`.

    Raises:
        TwinError: the participant's number is not positive, or the scene lacks a task of the study.
    """
    for task in (_REPEATED, _ONCE):
        if task not in scene.tasks:
            raise TwinError(f"scene '{scene.name}' has no task '{task}', which the study of the console needs")
    first = randomised(participant, 1)  # its error names a wrong participant
    without = Condition(haptics=False, participant=participant)
    with_forces = Condition(haptics=True, participant=participant)
    parts = [
        GuidedPart(1, "before", "questionnaires before the experiment", None, without, before=["ssq"]),
        GuidedPart(2, "familiarization", "familiarization, 5 to 10 min", None, with_forces),
    ]
    for run in range(1, RUNS + 1):
        # which of the runs has forces is random, but the same each time for a participant
        condition = first if run == 1 else randomised(participant, run)
        title = f"peg board, run {run} of {RUNS}"
        parts.append(GuidedPart(3, f"pegboard-{run}", title, _REPEATED, condition))
    parts.append(GuidedPart(4, "camera", "camera movement", _ONCE, without))
    after = ["ssq", "ueq", "simtlx", "facevalidity"]
    parts.append(GuidedPart(5, "after", "questionnaires after the experiment", None, without, after=after))
    return parts
