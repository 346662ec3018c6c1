"""How holes are touched: the simulated operator, the referee of the page, and the measures of a session."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from twin.core.errors import TwinError
from twin.core.findings import Finding, disagreement
from twin.core.json_types import JsonObject
from twin.core.quantity import mm
from twin.core.result import Part, TextTable
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.console import ConsoleTable
from twin.model.task import ConsoleTask
from twin.simulation import rate_console
from twin.simulation.controllers.pedals import TOOLS
from twin.simulation.controllers.teleoperation import scales_of
from twin.simulation.devices.hand import ScriptedHand
from twin.simulation.devices.surgeon_hands import Seat
from twin.simulation.operating_scene import plain
from twin.simulation.rate_console import HAND
from twin.simulation.session.task_play import ArmPath, Play, TaskOutcome
from twin.simulation.setup import Setup
from twin.simulation.tasks.holes.geometry import hole_goals
from twin.simulation.tasks.holes.operator import ScriptedPen
from twin.simulation.tasks.holes.referee import HoleJudge, HoleReferee
from twin.simulation.trial import INNER
from twin.simulation.world import Recording
from twin.simulation.world.signal_kinds import CONSOLE_MODE


@dataclass(frozen=True)
class HoleOutcome(TaskOutcome):
    """The judge after the last sample of a session."""

    judge: HoleJudge

    success = "All holes were touched"
    failure = "Not all holes were touched"

    def findings(self) -> Iterator[Finding]:
        """Yield a finding on the first hole that was not touched; the order of the holes is part of the task."""
        judge = self.judge
        if judge.complete:
            return
        hole = judge.holes[len(judge.touched)]
        yield disagreement(
            "task.missed",
            hole.name,
            f"{len(judge.touched)} of {len(judge.holes)} holes were touched; smallest distance of the tip from the "
            f"bottom of {hole.name}",
            mm(judge.nearest),
            mm(judge.limit),
            word="required",
        )

    def content(self) -> JsonObject:
        """Return the measures and the time of each touch."""
        times: dict[str, float | None] = {}
        for k, hole in enumerate(self.judge.holes):
            times[hole.name] = self.judge.touched[k] if k < len(self.judge.touched) else None
        return {"holes": {**self.judge.measures(), "touched_s": times}}

    def text(self) -> Iterator[Part]:
        """Yield the measures, and a row for every hole."""
        judge = self.judge
        yield (
            f"  {judge.time:.1f} s since the first press · {judge.presses} presses of the pedal · path "
            f"{judge.path / MM:.1f} mm · {judge.wrong} wrong holes"
        )
        rows = []
        for k, hole in enumerate(judge.holes):
            when = f"{judge.touched[k]:.1f} s" if k < len(judge.touched) else "not touched"
            rows.append((hole.name, when))
        yield TextTable(("hole", "touched at"), rows)


class _HolePlay(Play):
    def start(self, setup: Setup, task: ConsoleTask) -> Mapping[str, Array]:
        goals = hole_goals(setup, task)
        return {goals.robot: goals.start}

    def surgeon(self, setup: Setup, task: ConsoleTask, seat: Seat, mistake: str) -> ScriptedPen:
        table = _console(setup, task)
        goals = hole_goals(setup, task)
        kin = setup.members[goals.robot].kin
        R_world_view = rate_console.fixed_view(setup, table)[:3, :3]
        # {H} is parallel to the picture, and the operator's strokes are in the base of the robot
        R_base_hand = setup.places[goals.robot].T_world_base[:3, :3].T @ R_world_view
        scales = scales_of(kin, seat.scale)
        operator = ScriptedHand(goals.robot, kin, goals.goals, scales, INNER * seat.dt, seat.seed)
        return ScriptedPen(HAND, operator, seat, R_base_hand, kin.forward(goals.start)[:3, :3])

    def referee(self, setup: Setup, task: ConsoleTask, period: float) -> HoleReferee:
        _console(setup, task)
        goals = hole_goals(setup, task)
        kin = setup.members[goals.robot].kin
        return HoleReferee(goals, HAND, kin, setup.places[goals.robot].T_world_base, period)

    def marks(self, setup: Setup, task: ConsoleTask) -> list[tuple[str, Array]]:
        marks = []
        for k, hole in enumerate(hole_goals(setup, task).holes):
            marks.append((str(k + 1), hole.before))
        return marks

    def outcome(
        self, setup: Setup, task: ConsoleTask, recording: Recording, arms: Mapping[str, ArmPath]
    ) -> HoleOutcome:
        goals = hole_goals(setup, task)
        judge = HoleJudge(goals.holes, goals.contact, recording.dt)
        pressed = recording[CONSOLE_MODE.name][:, 0] == TOOLS
        for tip, down in zip(arms[goals.robot].tip, pressed, strict=True):
            judge.see(tip, bool(down))
        return HoleOutcome(judge)

    def identity(self, setup: Setup, task: ConsoleTask) -> list[object]:
        goals = hole_goals(setup, task)
        holes = []
        for hole in goals.holes:
            holes.append([hole.name, plain(hole.bottom), plain(hole.axis)])
        return [goals.robot, plain(goals.start), holes, plain(goals.contact)]


def _console(setup: Setup, task: ConsoleTask) -> ConsoleTable:
    """Return the console of a scene whose robot a hand moves by rates.

    Raises:
        TwinError: the scene has no such console.
    """
    table = setup.scene.console
    if table is None or table.teleoperation is None:
        raise TwinError(f"{setup.label}: holes need a console with teleoperation: add [console.teleoperation]")
    return table


PLAY = _HolePlay()
