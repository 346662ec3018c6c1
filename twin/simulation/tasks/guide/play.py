"""How a ring is guided along a wire: the simulated surgeon, the referee, and the steps done in a session."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from twin.core.findings import Finding, disagreement
from twin.core.json_types import JsonObject
from twin.core.quantity import Quantity
from twin.core.result import Part, TextTable
from twin.core.spatial import Array
from twin.model.task import ConsoleTask, required_goal
from twin.simulation import contact_scene
from twin.simulation.devices.surgeon_hands import Seat, SurgeonHands
from twin.simulation.operating_scene import plain
from twin.simulation.plants.contact.grip_frame import grip_frame
from twin.simulation.session.task_play import ArmPath, Play, TaskOutcome
from twin.simulation.setup import Setup
from twin.simulation.tasks.guide.arm_paths import ArmPaths
from twin.simulation.tasks.guide.guiding_referee import GuideMeasures, GuidingReferee
from twin.simulation.tasks.guide.guiding_surgeon import GuidingSurgeon
from twin.simulation.tasks.guide.task import GuideTable
from twin.simulation.world import Recording


@dataclass(frozen=True)
class GuideOutcome(TaskOutcome):
    """Measures of the guided ring; `wire` (k, 3) is the centre line of the wire in m in the World."""

    guided: GuideMeasures
    wire: Array

    success = "The ring was guided along the wire"
    failure = "Not all steps of the task are done"

    def findings(self) -> Iterator[Finding]:
        """Yield findings on steps that are not done, and on errors that exceed their limits."""
        for step in self.guided.missed:
            text = f"the step is not done; the ring passed along {self.guided.passed:.0%} of the wire"
            yield disagreement("task.missed", step, text)
        for what, value, most, unit in self.guided.exceeded:
            text = f"more {what} than allowed"
            yield disagreement("task.errors", what, text, Quantity(value, unit), most, word="allowed")

    def content(self) -> JsonObject:
        """Return the measures."""
        return {"guided": self.guided.content()}

    def text(self) -> Iterator[Part]:
        """Yield a row for every step, then the measures."""
        rows = []
        for name, t in self.guided.steps.items():
            rows.append((name, "-" if t is None else f"{t:.1f} s"))
        yield TextTable(("step", "done at"), rows)
        yield ""
        yield TextTable((), self.guided.rows())


class _GuidePlay(Play):
    def surgeon(self, setup: Setup, task: ConsoleTask, seat: Seat, mistake: str) -> SurgeonHands:
        guide = required_goal(task, GuideTable)
        ring = next(item for item in setup.scene.objects if item.name == guide.ring)
        course = contact_scene.course(setup.scene, setup.props, task)
        # this surgeon guides the place between the jaws, not the tip
        grips = {}
        for hand, arm in seat.arms.items():
            T_tool_grip = grip_frame(setup.members[arm.robot].mechanism)
            grips[hand] = replace(arm, T_tool_tip=T_tool_grip)
        return GuidingSurgeon(replace(seat, arms=grips), ring, course, guide.first, ArmPaths(setup), mistake)

    def referee(self, setup: Setup, task: ConsoleTask, period: float) -> GuidingReferee:
        return GuidingReferee.of(setup, period)

    def outcome(
        self, setup: Setup, task: ConsoleTask, recording: Recording, arms: Mapping[str, ArmPath]
    ) -> GuideOutcome:
        referee = self.referee(setup, task, recording.dt)
        referee.see_all(recording)
        return GuideOutcome(referee.measures(), referee.course.wire)

    def identity(self, setup: Setup, task: ConsoleTask) -> list[object]:
        course = contact_scene.course(setup.scene, setup.props, task)
        return [required_goal(task, GuideTable).model_dump(), plain(course.wire), plain(course.dome)]


PLAY = _GuidePlay()
