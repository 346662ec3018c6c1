"""How targets are touched: the simulated surgeon, and the targets that the tips touched in a session, and when.

The surgeon, with a random seed, touches the targets with both hands at once. The grippers open on the way and close at
the target. The motion of the hands is in `devices.surgeon_hands`.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import TwinError, WorldError
from twin.core.findings import Finding, disagreement
from twin.core.json_types import JsonObject
from twin.core.quantity import mm
from twin.core.result import Part, TextTable
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.task import ConsoleTask, required_goal
from twin.simulation import console_scene
from twin.simulation.devices.surgeon_hands import Habits, Seat, SurgeonHands
from twin.simulation.session.movement import runs
from twin.simulation.session.task_play import ArmPath, Play, TaskOutcome
from twin.simulation.setup import Setup
from twin.simulation.tasks.target.task import Targets
from twin.simulation.world import Recording
from twin.simulation.world.signal_kinds import SURGEON_TARGET


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
        for hand in table.hands:
            first_robot = getattr(table, hand)[0]
            tips[hand] = arms[first_robot].tip
        for target in required_goal(task, Targets).targets:
            for hand in target.p_world:
                if hand not in tips:
                    raise TwinError(
                        f"{setup.label}: target '{target.name}' is for the {hand} hand, but the "
                        f"console moves robots by the {' and the '.join(tips)} hand only"
                    )
        return TargetOutcome(touched(task, recording.t, tips), task.tolerance)


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


_STALLED = 12
"""Number of strokes without progress after which the surgeon gives up a target."""


class ScriptedSurgeon(SurgeonHands):
    """Writes `<hand>.pose` (16,) with tremor, `<hand>.grip`, the pedals, and `surgeon.target`.

    `surgeon.target` is the index of the target, -1 at the start. The surgeon sees the tips (from `<robot>.q`) in the
    picture (`<camera>.view`) only between two strokes (single hand motions). The device ends after the last target.

    Attributes:
        targets: (name, points) of each target; `points` is {hand: position (3,) for its tip in m in the World}.
        tolerance: largest distance in m of a tip from its point.
        hold: time in s for which the tips remain at a target.
        missed: names of the targets that the surgeon gave up.
    """

    def __init__(
        self,
        seat: Seat,
        targets: Sequence[tuple[str, Mapping[str, Array]]],
        tolerance: float,
        hold: float,
        habits: Habits | None = None,
    ) -> None:
        """Connect the surgeon to a console; for `targets`, `tolerance` and `hold`, see the class.

        Raises:
            WorldError: a target is for another hand.
        """
        arms = seat.arms
        for name, points in targets:
            if not points or not set(points) <= set(arms):
                named_hands = ", ".join(points) or "no hand"
                raise WorldError(f"target '{name}' is for {named_hands}, not for {', '.join(arms)}")
        self.targets = tuple(targets)
        self.tolerance = tolerance
        self.hold = hold
        self._target = -1
        super().__init__(seat, habits or Habits())

    def _output_signals(self, k: int) -> dict[str, ArrayLike]:
        values = super()._output_signals(k)
        values[SURGEON_TARGET.name] = float(self._target)
        return values

    def _missing(self, points: Mapping[str, Array]) -> dict[str, Array]:
        """Return the vector (3,) in m from the tip of each hand to its point, in the frame of the picture."""
        tips = {}
        for hand in points:
            T_world_tip = self._tool(hand) @ self.arms[hand].T_tool_tip
            tips[hand] = T_world_tip[:3, 3]
        points_seen = self._in_picture(points)
        tips_seen = self._in_picture(tips)
        missing = {}
        for hand in points:
            missing[hand] = points_seen[hand] - tips_seen[hand]
        return missing

    def _work(self) -> Iterator[None]:
        yield from self._rest(0.3)
        yield from self._show()
        for i, (name, points) in enumerate(self.targets):
            self._target = i
            yield from self._look(points)
            yield from self._turn_grip(dict.fromkeys(self.arms, self.habits.open))
            reached = yield from self._touch(points)
            if not reached:
                self.missed.append(name)
                continue
            yield from self._turn_grip(dict.fromkeys(self.arms, 0.0))
            yield from self._rest(self.hold)
        yield from self._rest(0.2)

    def _touch(self, points: Mapping[str, Array]) -> Generator[None, None, bool]:
        """Move the tips to their points; return whether they have reached the points."""
        least = np.inf
        stalled = 0
        while stalled < _STALLED:
            missing = self._missing(points)
            distance = max(float(np.linalg.norm(vector)) for vector in missing.values())
            if distance < 0.5 * self.tolerance:  # the rest of the tolerance is for tremor
                return True
            if distance < 0.98 * least:  # less than this is tremor, not progress
                least = distance
                stalled = 0
            else:
                stalled += 1
            strokes = {}
            for hand, vector in missing.items():
                strokes[hand] = self._misjudged(vector) / self.scale
            yield from self._stroke(strokes, self.habits.hand.pause)
        return False


PLAY = _TargetPlay()
