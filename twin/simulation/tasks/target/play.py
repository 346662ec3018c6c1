"""How targets are touched: the simulated surgeon, and the targets that the tips touched in a session."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

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
from twin.simulation.session.task_play import ArmPath, Play, TaskOutcome
from twin.simulation.setup import Setup
from twin.simulation.tasks.target.surgeon import ScriptedSurgeon
from twin.simulation.tasks.target.task import Targets
from twin.simulation.tasks.target.touch import Touched, touched
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
