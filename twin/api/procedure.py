"""Procedure sessions: simulate a surgeon or replay a recorded session, and judge the procedure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from twin.api.scene_loading import as_scene, scene_of_session
from twin.api.scene_parts import anatomy_of, members_of, props_of, robots_at
from twin.core.atomic import Scratch
from twin.core.errors import TwinError
from twin.core.findings import Finding, by_severity, disagreement, warning
from twin.core.json_types import JsonObject
from twin.core.progress import Progress, silent
from twin.core.result import Part, Result, TextTable
from twin.core.units import MM
from twin.model.scene import Scene
from twin.model.task import ConsoleTask
from twin.model.tissue import Tissue
from twin.simulation import operating_scene, tissue_scene
from twin.simulation.session.session_file import NAME, read_session
from twin.simulation.session.session_run import SessionRun, task_of
from twin.simulation.setup import Setup
from twin.simulation.tasks.procedure import procedure_checks, procedure_run
from twin.simulation.tasks.procedure.procedure_checks import ProcedureMeasures
from twin.simulation.tasks.procedure.task import Mistake, ProcedureTable
from twin.simulation.world.signal_kinds import (
    ORGAN_DEPTH,
    ORGAN_FREED,
    ROBOT_CARRIES,
    ROBOT_HOLDS,
    ROBOT_PULL,
    ROBOT_TIP,
    VESSEL_SEEN,
)


@dataclass(frozen=True)
class ProcedureSession(Result):
    """Result of a procedure.

    Attributes:
        scene, task: the scene, and its task.
        source: the replayed file; "" for a new simulation.
        seed: random seed of a simulated surgeon; None: a person.
        mistake: the intended mistake of the simulated surgeon; "": no mistake, or unknown.
        organ: the organ to remove.
        lost: sentence that says what is missing at the end of a truncated file; "" if the file is complete.
        recorded: content of the session file of a simulated surgeon; None for a replayed file.
    """

    scene: Scene
    task: ConsoleTask
    source: str
    seed: int | None
    mistake: str
    run: SessionRun
    organ: Tissue
    lost: str = ""
    recorded: bytes | None = None

    kind = "procedure"

    @property
    def word(self) -> str:
        """The verdict as text."""
        if self.verdict == "agree":
            return "All stages are done"
        checks = self.measures.checks
        if self.measures.done or self.verdict != "disagree":  # the procedure itself gives no disagreement
            if self.run.difference is not None:
                return "The replay gives different bytes"
            return super().word
        failed = 0
        passed = 0
        for check in checks:
            failed += check.lost
            passed += check.done
        if failed:
            return f"{failed} of {len(checks)} checks failed"
        return f"Not finished: {passed} of {len(checks)} checks passed"

    @property
    def procedure(self) -> ProcedureTable:
        """Description of the procedure that the task asks for."""
        return operating_scene.procedure_of(self.scene, self.task)

    @cached_property
    def measures(self) -> ProcedureMeasures:
        """The checks and measures, from the signals of the World."""
        setup = Setup(self.scene, {}, self.task, organs=[self.organ])
        return procedure_checks.measure(self.run.recording, setup)

    @property
    def findings(self) -> Sequence[Finding]:
        """Findings: a check is not passed, the replay differs from the recording, or the file is truncated."""
        findings: list[Finding] = []
        for check in self.measures.checks:
            if not check.done:
                findings.append(disagreement(f"procedure.{check.name}", self.task.name, check.text))
        difference = self.run.difference
        if difference is not None:
            text = (
                "the replay gives other bytes than the recording, first between "
                f"{difference.t0:g} and {difference.t1:g} s"
            )
            suggestion = "replay with the twin version and the processor type of the recording"
            findings.append(disagreement("session.differs", difference.signal, text, suggestion=suggestion))
        if self.lost:
            findings.append(warning("session.interrupted", self.source, self.lost))
        return findings

    def content(self) -> JsonObject:
        """Return the checks and measures; the keys of quantities end with the unit."""
        measures = self.measures
        surgeon = "simulated"
        if self.seed is None:
            surgeon = "person"
        replay = None
        if self.source:
            replay = "same" if self.run.difference is None else "differs"
        checks = []
        for check in measures.checks:
            checks.append({"name": check.name, "done": check.done, "t_s": check.t, "text": check.text})
        paths_mm = {}
        for tool, path in measures.paths.items():
            paths_mm[tool] = path / MM
        return {
            "scene": self.scene.name,
            "task": self.task.name,
            "surgeon": surgeon,
            "seed": self.seed,
            "mistake": self.mistake or None,
            "replay": replay,
            "duration_s": self.run.duration,
            "time_s": measures.time,
            "checks": checks,
            "paths_mm": paths_mm,
            "clips": measures.clips,
            "energy_j": measures.energy,
            "largest_pull_n": measures.largest_pull,
            "slipped_mm": measures.slipped / MM,
            "given_up": list(self.run.missed),
        }

    def text(self) -> Iterator[Part]:
        """Yield the checks, the measures and the findings."""
        surgeon = f"a simulated surgeon, seed {self.seed} (its habits are ASSUMED)"
        if self.seed is None:
            surgeon = "a person"
        yield f"{self.scene.name} · {self.task.title} · {surgeon}\n"
        rows = []
        for check in self.measures.checks:
            outcome = "NOT DONE"
            if check.done:
                outcome = "done"
            time = ""
            if check.t is not None:
                time = f"{check.t:.1f} s"
            rows.append((check.name, outcome, time, check.text))
        yield TextTable(("check", "", "at", "measured"), rows)
        yield ""
        yield TextTable(("measure", "value"), self._measure_rows())
        yield ""
        yield from by_severity(self.findings)

    def _measure_rows(self) -> list[tuple[str, str]]:
        measures = self.measures
        rows = [("time", f"{measures.time:.1f} s of {self.run.duration:.1f} s")]
        for tool, path in measures.paths.items():
            path_mm = path / MM
            rows.append((f"path of {tool}", f"{path_mm:.0f} mm"))
        slipped_mm = measures.slipped / MM
        rows.append(("clips used", str(measures.clips)))
        rows.append(("energy into the organ's bed", f"{measures.energy:.0f} J"))
        rows.append(("largest pull of a grasper", f"{measures.largest_pull:.1f} N"))
        rows.append(("largest slip in the jaws", f"{slipped_mm:.1f} mm"))
        if self.source:
            replay = "different bytes"
            if self.run.difference is None:
                replay = "the same bytes"
            rows.append(("replay", replay))
        return rows

    def write(self, folder: Path) -> None:
        """Write procedure.csv (the signals that the checks use), and the session file of a simulated surgeon."""
        recording = self.run.recording
        procedure = self.procedure
        columns = {"t_s": recording.t, "seen": recording[VESSEL_SEEN.of(procedure.vessel)][:, 0]}
        columns["freed"] = recording[ORGAN_FREED.of(procedure.organ)].sum(axis=1)
        for organ in procedure.spare:
            columns[f"{organ}_depth_m"] = recording[ORGAN_DEPTH.of(organ)][:, 0]
        for robot in self.measures.paths:
            tips = recording[ROBOT_TIP.of(robot)]
            for k, axis in enumerate("xyz"):
                columns[f"{robot}_tip_{axis}_m"] = tips[:, k]
            columns[f"{robot}_carries"] = recording[ROBOT_CARRIES.of(robot)][:, 0]
            columns[f"{robot}_holds"] = recording[ROBOT_HOLDS.of(robot)][:, 0]
            columns[f"{robot}_pull_n"] = np.linalg.norm(recording[ROBOT_PULL.of(robot)], axis=1)
        body = np.column_stack(list(columns.values()))
        np.savetxt(folder / "procedure.csv", body, "%.6g", ",", header=",".join(columns), comments="")
        if self.recorded is not None:
            (folder / NAME).write_bytes(self.recorded)


def _setup(scene: Scene, task: ConsoleTask) -> Setup:
    """Return the robots that carry tools in a procedure, and the organs."""
    # which robots carry tools follows from scene and task: a setup without robots is enough to ask
    without_members = Setup(scene, {}, task)
    robots = robots_at(operating_scene.robots_of(without_members))
    organs = tissue_scene.tissues(scene, anatomy_of(scene))
    return Setup(scene, members_of(robots), task, organs=organs)


def operate_procedure(
    scene: Scene | str | Path,
    task: str | None = None,
    *,
    seed: int = 0,
    mistake: Mistake = "",
    progress: Progress = silent,
) -> ProcedureSession:
    """Simulate a surgeon who performs a procedure with the robots of a scene; the surgeon's habits are ASSUMED.

    Args:
        scene: a scene with organs, vessels and tools; or its name or path.
        task: a task with a procedure; default: the first task of the scene.
        seed: random seed; the same seed gives the same session.
        mistake: a mistake that the surgeon makes; "": none.
        progress: see `Progress`.

    Raises:
        TwinError: the scene has no such task, or the task is not a procedure.
        WorldError: there is no such mistake, no robot can carry a tool, or a link is inside an organ at the start.

    Examples:
        >>> import twin
        >>> session = twin.operate_procedure("vsrs", "cholecystectomy")
        >>> session.verdict
        'agree'
    """
    scene = as_scene(scene)
    chosen = task_of(scene, task)
    operating_scene.procedure_of(scene, chosen)
    progress("read CAD", 0.0)
    setup = _setup(scene, chosen)
    with Scratch() as folder:
        path = Path(folder) / NAME
        run = procedure_run.perform(setup, path, seed=seed, mistake=mistake, progress=progress)
        recorded = path.read_bytes()
    organ = operating_scene.organ_of(setup)
    return ProcedureSession(scene, chosen, "", seed, mistake, run, organ, recorded=recorded)


def replay_procedure(
    path: str | Path, scene: Scene | str | Path | None = None, progress: Progress = silent
) -> ProcedureSession:
    """Replay the session of a procedure in a new World; compare the replay with the recording bit by bit; judge it.

    The default scene is the built-in scene that the file names.

    Raises:
        WorldError: the file is damaged, or was recorded with another version of twin or in another scene.
        TwinError: there is no such scene, or the session is not of a procedure.

    Examples:
        >>> from pathlib import Path
        >>> import twin
        >>> session = twin.operate_procedure("vsrs", "cholecystectomy")
        >>> _ = Path("hands.session").write_bytes(session.recorded)
        >>> twin.replay_procedure("hands.session").verdict
        'agree'
    """
    path = Path(path)
    session = read_session(path)
    chosen_scene = scene_of_session(path, session.head.scene, scene)
    if session.head.task is None:
        raise TwinError(f"{path}: the session has no task")
    task = task_of(chosen_scene, session.head.task)
    progress("read CAD", 0.0)
    setup = replace(_setup(chosen_scene, task), props=props_of(chosen_scene), condition=session.head.condition)
    run = procedure_run.replay(session, path, setup, progress)
    organ = operating_scene.organ_of(setup)
    return ProcedureSession(chosen_scene, task, str(path), session.head.seed, "", run, organ, session.lost)


def is_procedure(path: str | Path, scene: str | Path | None = None) -> bool:
    """Return whether a session file is the recording of a procedure.

    Raises:
        WorldError: the file is damaged.
        TwinError: there is no such scene.
    """
    path = Path(path)
    head = read_session(path).head
    if head.task is None:
        return False
    task = scene_of_session(path, head.scene, scene).tasks.get(head.task)
    return task is not None and not task.kind.console
