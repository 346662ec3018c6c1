"""How targets are touched: the simulated surgeon, and the targets that the tips touched in a session, and when."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.findings import Finding, disagreement
from twin.core.json_types import JsonObject
from twin.core.quantity import mm
from twin.core.result import Part, TextTable
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.task import ConsoleTask, required_goal
from twin.simulation import console_scene
from twin.simulation.console_scene import HANDS
from twin.simulation.devices.surgeon_hands import Seat, SurgeonHands
from twin.simulation.session.movement import runs
from twin.simulation.session.task_play import ArmPath, Play, TaskOutcome
from twin.simulation.setup import Setup
from twin.simulation.tasks.target.surgeon import ScriptedSurgeon
from twin.simulation.tasks.target.task import Targets
from twin.simulation.world import Recording


@dataclass(frozen=True)
class TargetOutcome(TaskOutcome):
    """For every target of the task, when it was touched and how near the tips came; `tolerance` in m."""

    touched: Sequence[Touched]
    tolerance: float

    success = "All targets were touched"
    failure = "Not all targets were touched"

    def findings(self) -> Iterator[Finding]:
        """Yield a finding on every target that no tip touched."""
        for target in self.touched:
            if target.t is not None:
                continue
            yield disagreement(
                "task.missed",
                target.name,
                "the target was not touched; minimum distance between the target and the tips",
                mm(target.nearest),
                mm(self.tolerance),
                word="required",
            )

    def content(self) -> JsonObject:
        """Return the result of every target."""
        targets = []
        for target in self.touched:
            targets.append({"name": target.name, "t_s": target.t, "nearest_mm": target.nearest / MM})
        return {"targets": targets}

    def text(self) -> Iterator[Part]:
        """Yield a row for every target."""
        rows = []
        for target in self.touched:
            when = "not touched" if target.t is None else f"{target.t:.1f} s"
            rows.append((target.name, when, str(mm(target.nearest))))
        yield TextTable(("target", "touched at", "smallest distance"), rows)


class _TargetPlay(Play):
    def surgeon(self, setup: Setup, task: ConsoleTask, seat: Seat, mistake: str) -> SurgeonHands:
        targets = [(target.name, target.p_world) for target in required_goal(task, Targets).targets]
        return ScriptedSurgeon(seat, targets, task.tolerance, task.hold)

    def outcome(
        self, setup: Setup, task: ConsoleTask, recording: Recording, arms: Mapping[str, ArmPath]
    ) -> TargetOutcome:
        table = console_scene.console_of(setup.scene)
        tips: dict[str, Array] = {}
        for hand in HANDS:
            first_robot = getattr(table, hand)[0]
            tips[hand] = arms[first_robot].tip
        return TargetOutcome(touched(task, recording.t, tips), task.tolerance)


PLAY = _TargetPlay()


@dataclass(frozen=True)
class Touched:
    """Result of one target.

    Attributes:
        name: name of the target.
        t: time in s at which the touch was complete; None: the target was not touched.
        nearest: smallest error in m since the previous touch was complete. The error is the distance between a tip and
            its point; if there are two tips, the larger distance.
    """

    name: str
    t: float | None
    nearest: float


def touched(task: ConsoleTask, t: Array, tips: Mapping[str, Array]) -> list[Touched]:
    """Return the result of every target of a task, in order; a touch counts only after the previous touch is complete.

    Args:
        task: the task.
        t: (k,) times in s, evenly spaced.
        tips: {hand: positions (k, 3) of its tip in m in the World}.
    """
    dt = float(t[1] - t[0]) if len(t) > 1 else np.inf
    results = []
    begin = 0
    for target in required_goal(task, Targets).targets:
        distances = []
        for hand, p in target.p_world.items():
            distances.append(np.linalg.norm(tips[hand][begin:] - p, axis=1))
        error = np.max(distances, axis=0)
        nearest = float(error.min()) if len(error) else np.nan
        first = _first_touch(error, task, dt)
        if first is None:
            results.append(Touched(target.name, None, nearest))
            continue
        begin += first + round(task.hold / dt)
        results.append(Touched(target.name, float(t[begin]), nearest))
    return results


def _first_touch(error: Array, task: ConsoleTask, dt: float) -> int | None:
    """Return the first sample of the first touch that is long enough; error (k,) in m, every dt in s."""
    shortest = task.hold - 1e-9  # rounding of the times
    for first, last in runs(error <= task.tolerance):
        if (last - first) * dt >= shortest:
            return first
    return None
