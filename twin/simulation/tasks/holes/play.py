"""How holes are touched: the simulated operator, the referee of the page, and the measures of a session.

The operator is the one of `twin operate ROBOT`, with the signals of a console.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.findings import Finding, disagreement
from twin.core.json_types import JsonObject
from twin.core.quantity import mm
from twin.core.result import Part, TextTable
from twin.core.spatial import Array
from twin.core.units import MM
from twin.kinematics import Kinematics
from twin.model.console import ConsoleTable
from twin.model.task import ConsoleTask
from twin.simulation import rate_console
from twin.simulation.controllers.pedals import TOOLS
from twin.simulation.controllers.teleoperation import scales_of
from twin.simulation.devices.hand import ScriptedHand
from twin.simulation.devices.surgeon_hands import Seat, SimulatedHands
from twin.simulation.operating_scene import plain
from twin.simulation.rate_console import HAND
from twin.simulation.session.task_play import ArmPath, Play, TaskOutcome
from twin.simulation.setup import Setup
from twin.simulation.tasks.holes.geometry import hole_goals
from twin.simulation.tasks.holes.referee import HoleJudge, HoleReferee
from twin.simulation.trial import INNER
from twin.simulation.world import Recording, Signals
from twin.simulation.world.signal_kinds import (
    CONSOLE_MODE,
    DEVICE_CAMERA,
    DEVICE_CLUTCH,
    DEVICE_SCALE,
    HAND_GOAL,
    HAND_GRIP,
    HAND_HANDLE,
    HAND_PEDAL,
    HAND_POSE,
    SURGEON_TARGET,
)


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


class ScriptedPen(SimulatedHands):
    """Writes `<hand>.handle` (n,) and `<hand>.pedal` of a `ScriptedHand`, and what a report reads of a console.

    `<hand>.pose` (16,) is the handle as a pose in {H}, `<hand>.grip` is 0; the pedal is also `<device>.clutch`.
    """

    def __init__(self, hand: str, operator: ScriptedHand, seat: Seat, R_base_hand: Array, R_start: Array) -> None:
        """Connect an operator to a console.

        Args:
            hand: name of the hand.
            operator: the operator.
            seat: the console.
            R_base_hand: (3, 3) rotation of {H}, the frame of the hands, in the robot's base.
            R_start: (3, 3) rotation of the tool at the start, the attitude of an unrotated handle.
        """
        self.hand = hand
        self.operator = operator
        self.period = operator.period
        self.missed: list[str] = []
        self._kin: Kinematics = operator.kin
        self._device = seat.device
        self._scale = seat.scale
        self._R_base_hand = R_base_hand
        self._R_start = R_start
        handle = operator.outputs[HAND_HANDLE.name]
        self.outputs = self._signals(np.asarray(handle, float), 0.0, -1.0)

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, ArrayLike] | None:
        """Return the signals of this tick; None after the last goal."""
        values = self.operator.step(signals, t, dt)
        if self.operator.missed:
            self.missed = [self.operator.missed]
        if values is None:
            return None
        handle = np.asarray(values[HAND_HANDLE.name], float)
        pedal = float(np.asarray(values[HAND_PEDAL.name]))
        goal = float(np.asarray(values[HAND_GOAL.name]))
        return self._signals(handle, pedal, goal)

    def _signals(self, handle: Array, pedal: float, goal: float) -> dict[str, ArrayLike]:
        T = self._kin.program.pose_of_coordinates.one(handle)
        turn = T[:3, :3] @ self._R_start.T
        R_hand_base = self._R_base_hand.T
        pose = spatial.pose(R_hand_base @ turn @ self._R_base_hand, R_hand_base @ T[:3, 3])
        return {
            HAND_HANDLE.of(self.hand): handle,
            HAND_PEDAL.of(self.hand): pedal,
            HAND_POSE.of(self.hand): pose.ravel(),
            HAND_GRIP.of(self.hand): 0.0,
            DEVICE_CLUTCH.of(self._device): pedal,
            DEVICE_CAMERA.of(self._device): 0.0,
            DEVICE_SCALE.of(self._device): self._scale,
            SURGEON_TARGET.name: goal,
        }


PLAY = _HolePlay()
