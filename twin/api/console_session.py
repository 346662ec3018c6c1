"""A session at a surgeon's console as a result: its measures, findings, tables and files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from twin.api.session_files import SessionFiles
from twin.core.extras import EXTRAS
from twin.core.findings import Finding, by_severity, disagreement, info, warning
from twin.core.json_types import JsonObject
from twin.core.quantity import Quantity, mm
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.console import ConsoleTable
from twin.model.scene import Scene
from twin.model.task import ConsoleTask
from twin.simulation import console_scene
from twin.simulation.session import measures
from twin.simulation.session.forces import ForceMeasures
from twin.simulation.session.measures import ArmMeasures, ConsoleMeasures
from twin.simulation.session.session_file import NAME as FILE
from twin.simulation.session.session_run import Difference, SessionRun
from twin.simulation.session.task_play import ArmPath, TaskOutcome
from twin.simulation.session.training import Training

INTERRUPTED = "session.interrupted"
"""Code of the finding on a session whose file ends too early."""


@dataclass(frozen=True)
class ConsoleSession(Result):
    """Measures of a session at a console.

    Attributes:
        scene: the scene with the console and its robots.
        source: the replayed file; "" for a new simulation.
        seed: random seed of a simulated surgeon; None: a person.
        task: the task; None: no task.
        run: what was simulated: the kept signals, ticks and forces, and the difference of a replay from its recording.
        arms: {name of a place: arm} of all robots that the console moves.
        lost: sentence that says what is missing at the end of a truncated file; "" if the file is complete.
        recorded: content of the session file of a simulated surgeon; None for a replayed file.
        outcome: measures of the task; None: no task.
        training: measures of each machine: deviation of the machine from its model, cues (forces on the hands), stops.
    """

    scene: Scene
    source: str
    seed: int | None
    task: ConsoleTask | None
    run: SessionRun
    arms: Mapping[str, ArmPath]
    lost: str = ""
    recorded: bytes | None = None
    outcome: TaskOutcome | None = None
    training: Sequence[Training] = ()

    kind = "session"

    @property
    def word(self) -> str:
        """The verdict as text."""
        if self.verdict == "agree":
            if self.source:
                return "The replay gives the same bytes"
            return self._success
        codes = set()
        for finding in self.findings:
            if finding.severity == "disagreement":
                codes.add(finding.code)
        # a missed task says most about a session; of the rest, the first that applies
        if "task.missed" in codes and self.outcome is not None:
            return self.outcome.failure
        if "task.errors" in codes:
            return "More errors than allowed"
        if "session.differs" in codes:
            return "The replay gives different bytes"
        return super().word

    @property
    def _success(self) -> str:
        """What was done in a session without disagreements, in words."""
        if self.training:
            return "The machine followed its model"
        if self.outcome is not None:
            return self.outcome.success
        return "Nothing disagrees"  # a session without a task

    @property
    def t(self) -> Array:
        """Times (k,) in s of the samples."""
        return self.run.recording.t

    @cached_property
    def arm_measures(self) -> Sequence[ArmMeasures]:
        """Measures of the motion of every arm that a hand moves."""
        return measures.of_arms(self.run.recording, self._table, self._tips)

    @cached_property
    def console(self) -> ConsoleMeasures:
        """Measures of pedals and camera."""
        return measures.of_console(self.run.recording, self._table, self.camera, self.run.duration)

    @property
    def forces(self) -> ForceMeasures | None:
        """Measures of the forces on the hands; None for a session without forces."""
        return self.run.forces

    @property
    def camera(self) -> str:
        """Name of the robot that holds the camera."""
        return self.scene.cameras[self._table.camera].robot

    @property
    def _table(self) -> ConsoleTable:
        """The console as the scene describes it."""
        return console_scene.console_of(self.scene)

    @property
    def _tips(self) -> dict[str, Array]:
        """{name of a place: tip positions (k, 3) in m in the world frame}."""
        return {name: arm.tip for name, arm in self.arms.items()}

    @property
    def findings(self) -> Sequence[Finding]:
        """Findings on the replay, a truncated file, an idle session, the task, the machines, and missing libraries."""
        findings: list[Finding] = []
        difference = self.run.difference
        if difference is not None:
            findings.append(_replay_finding(difference))
        if self.lost:
            findings.append(warning(INTERRUPTED, self.source, self.lost))
        if self.console.time == 0:  # all measures of hands are then zero, which looks like a fault of twin
            text = "no arm followed a hand: the condition to start following (docs/console-reference.md) was never met"
            findings.append(warning("session.idle", "", text))
        if self.outcome is not None:
            findings += self.outcome.findings()
        for machine in self.training:
            findings += machine.findings()
        if self.run.lag:
            text = (
                f"the simulation remained {self.run.lag:.1f} s behind real time, because this computer is too slow or "
                "busy: the machines wait for packets, so that they deviate further from their models. End other "
                "programs, and repeat the session"
            )
            findings.append(warning("session.late", "", text))
        if find_spec("mcap") is None or find_spec("mcap_ros2") is None:
            text = f"session.mcap or session-ros2.mcap is not written: pip install 'twin-robotics[{EXTRAS['mcap']}]'"
            findings.append(info("session.no_mcap", "", text))
        return findings

    def content(self) -> JsonObject:
        """Return the measures; the keys of quantities end with the unit."""
        surgeon = "simulated"
        if self.seed is None:
            surgeon = "person"
        replay = None
        if self.source:
            replay = "same" if self.run.difference is None else "differs"
        task = None
        if self.task is not None:
            task = self.task.name
        condition = None
        if self.run.condition is not None:
            condition = self.run.condition.model_dump()
        forces_on_hands = None
        if self.forces is not None:
            forces_on_hands = {
                "on": self.forces.on,
                "felt_s": dict(self.forces.felt),
                "largest_n": dict(self.forces.largest),
            }
        console = self.console
        content: JsonObject = {
            "scene": self.scene.name,
            "surgeon": surgeon,
            "seed": self.seed,
            "replay": replay,
            "ticks": self.run.ticks,
            "duration_s": console.duration,
            "time_s": console.time,
            "hands": list(map(_arm_content, self.arm_measures)),
            "clutches": console.clutches,
            "clutched_s": console.clutched,
            "camera_moves": console.camera_moves,
            "camera_s": console.camera_time,
            "silent_s": console.silent,
            "taps": console.taps,
            "scale": list(console.scale),
            "task": task,
            # the outcome of a task replaces the key of its kind: each kind of task has one
            "targets": [],
            "alignment": None,
            "condition": condition,
            "forces": forces_on_hands,
            "guided": None,
            "machines": [machine.content() for machine in self.training],
            "board": None,
        }
        if self.outcome is not None:
            content |= self.outcome.content()
        return content

    def text(self) -> Iterator[Part]:
        """Yield the measures of hands and console, the targets, the result of the replay, and the findings."""
        surgeon = f"a simulated surgeon, seed {self.seed} (its habits are ASSUMED)"
        if self.seed is None:
            surgeon = "a person"
        yield f"{self.scene.name} · session of {surgeon}\n"
        header = ("hand", "arm", "path", "movements", "moving", "idle", "economy", "SPARC", "grasps")
        yield TextTable(header, list(map(_arm_row, self.arm_measures)))
        yield ""
        yield TextTable((), self._console_rows())
        yield from self._task_text()
        for machine in self.training:
            yield f"\n  {machine.robot}: machine compared with its model"
            header = ("phase", "duration", "max distance to the model", "max distance to the rehearsed path", "reason")
            yield TextTable(header, list(machine.rows()))
        if self.source and self.run.difference is None:
            yield f"\n  replay: the same bytes in all {self.run.ticks} ticks"
        yield ""
        yield from by_severity(self.findings)

    def _console_rows(self) -> list[tuple[str, str]]:
        """Return the measures of pedals, camera and forces, and the run of a study, as rows of text."""
        console = self.console
        smallest, largest = console.scale
        scale = f"{smallest:g}"
        if smallest != largest:
            scale = f"{smallest:g} to {largest:g}"
        rows = [
            ("time since an arm first followed a hand", f"{console.time:.1f} s of {console.duration:.1f} s"),
            ("clutch presses", f"{console.clutches}, for {console.clutched:.1f} s; quick taps: {console.taps}"),
            ("camera moves", f"{console.camera_moves}, for {console.camera_time:.1f} s"),
            ("device silent", f"{console.silent:.1f} s"),
            ("motion scale", scale),
        ]
        felt = self.forces
        if felt is not None:
            texts = []
            for hand in self._table.hands:
                texts.append(f"{hand} {felt.felt[hand]:.1f} s, at most {felt.largest[hand]:.2f} N")
            percent = 100 * felt.on
            rows.append(("forces on the hands", f"on {percent:.0f} % of the time; {'; '.join(texts)}"))
        condition = self.run.condition
        if condition is not None and condition.participant is not None:
            rows.append(("study", f"participant {condition.participant}, run {condition.run}"))
        return rows

    def _task_text(self) -> Iterator[Part]:
        """Yield the title of the task and the outcome of each of its parts."""
        if self.task is not None:
            yield f"\n  {self.task.name}: {self.task.title}"
        if self.outcome is not None:
            yield from self.outcome.text()

    def write(self, folder: Path) -> None:
        """Write the motions of the session (see `SessionFiles`), and for a simulated surgeon its session file."""
        if self.recorded is not None:
            (folder / FILE).write_bytes(self.recorded)
        SessionFiles(self.scene, self.run.recording, self.arms, self.forces is not None).write(folder)


def _replay_finding(difference: Difference) -> Finding:
    """Return the finding on a replay that differs from its recording."""
    if difference.signal:
        extent = f"the largest difference is {difference.size:.3g} in {difference.signal}"
    else:
        extent = f"at {difference.t1:g} s, all signals are equal again"
    return disagreement(
        "session.differs",
        difference.signal,
        "the replay gives other bytes than the recording, first between "
        f"{difference.t0:g} and {difference.t1:g} s; {extent}",
        suggestion="replay with the twin version and the processor type of the recording",
        when=f"{difference.t0:g} .. {difference.t1:g} s",
    )


def _arm_content(arm: ArmMeasures) -> JsonObject:
    return {
        "hand": arm.hand,
        "robot": arm.robot,
        "path_mm": arm.path / MM,
        "movements": arm.movements,
        "moving_s": arm.moving,
        "idle_s": arm.idle,
        "economy": arm.economy,
        "smoothness_sparc": arm.smoothness,
        "grasps": arm.grasps,
    }


def _arm_row(arm: ArmMeasures) -> tuple[str, ...]:
    return (
        arm.hand,
        arm.robot,
        str(mm(arm.path)),
        str(arm.movements),
        f"{arm.moving:.1f} s",
        f"{arm.idle:.1f} s",
        _number(arm.economy),
        _number(arm.smoothness),
        str(arm.grasps),
    )


def _number(value: float) -> str:
    if not np.isfinite(value):  # an arm that never moved has no economy and no smoothness
        return "-"
    return str(Quantity(value))
