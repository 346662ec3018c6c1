"""Procedure sessions: simulate a surgeon or replay a recorded session, and judge the procedure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from twin.api.act import anatomy_of, members_of, props_of, robots_at
from twin.api.robot import Progress, silent
from twin.api.standing import load_scene
from twin.core.atomic import Scratch
from twin.core.errors import TwinError
from twin.core.findings import Finding, by_severity, disagreement, warning
from twin.core.json_types import JsonObject
from twin.core.result import Part, Result, Table
from twin.core.units import MM
from twin.model.procedure import ProcedureTable
from twin.model.scene import Scene
from twin.model.task import Task
from twin.model.tissue import Tissue
from twin.simulation import operating_scene, tissue_scene
from twin.simulation.devices.procedure_surgeon import Mistake
from twin.simulation.session import procedure_checks, procedure_run
from twin.simulation.session.file import NAME, read_session
from twin.simulation.session.procedure_checks import ProcedureMeasures
from twin.simulation.session.run import Ran, task_of
from twin.simulation.setup import Setup


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
    task: Task
    source: str
    seed: int | None
    mistake: str
    ran: Ran
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
        if self.measures.done or self.verdict != "disagree":
            return "The replay gives different bytes" if self.ran.difference is not None else super().word
        if failed := sum(c.lost for c in checks):
            return f"{failed} of {len(checks)} checks failed"
        return f"Not finished: {sum(c.done for c in checks)} of {len(checks)} checks passed"

    @property
    def procedure(self) -> ProcedureTable:
        """Description of the procedure that the task asks for."""
        return operating_scene.procedure_of(self.scene, self.task)

    @cached_property
    def measures(self) -> ProcedureMeasures:
        """The checks and measures, from the signals of the World."""
        return procedure_checks.measure(self.ran.kept, Setup(self.scene, {}, self.task, organs=[self.organ]))

    @property
    def findings(self) -> Sequence[Finding]:
        """Findings: a check is not passed, the replay differs from the recording, or the file is truncated."""
        out = [disagreement(f"procedure.{c.name}", self.task.name, c.text) for c in self.measures.checks if not c.done]
        if (d := self.ran.difference) is not None:
            out.append(
                disagreement(
                    "session.differs",
                    d.signal,
                    f"the replay gives other bytes than the recording, first between {d.t0:g} and {d.t1:g} s",
                    suggestion="replay with the twin version and the processor type of the recording",
                )
            )
        if self.lost:
            out.append(warning("session.interrupted", self.source, self.lost))
        return out

    def content(self) -> JsonObject:
        """Return the checks and measures; the keys of quantities end with the unit."""
        m = self.measures
        return {
            "scene": self.scene.name,
            "task": self.task.name,
            "surgeon": "person" if self.seed is None else "simulated",
            "seed": self.seed,
            "mistake": self.mistake or None,
            "replay": None if not self.source else "same" if self.ran.difference is None else "differs",
            "duration_s": self.ran.duration,
            "time_s": m.time,
            "checks": [{"name": c.name, "done": c.done, "t_s": c.t, "text": c.text} for c in m.checks],
            "paths_mm": {n: p / MM for n, p in m.paths.items()},
            "clips": m.clips,
            "energy_j": m.energy,
            "largest_pull_n": m.largest_pull,
            "slipped_mm": m.slipped / MM,
            "given_up": list(self.ran.missed),
        }

    def text(self) -> Iterator[Part]:
        """Yield the checks, the measures and the findings."""
        m = self.measures
        who = "a person" if self.seed is None else f"a simulated surgeon, seed {self.seed} (its habits are ASSUMED)"
        yield f"{self.scene.name} · {self.task.title} · {who}\n"
        rows = [
            (c.name, "done" if c.done else "NOT DONE", "" if c.t is None else f"{c.t:.1f} s", c.text) for c in m.checks
        ]
        yield Table(("check", "", "at", "measured"), rows, fit=True)
        yield ""
        measured = [("time", f"{m.time:.1f} s of {self.ran.duration:.1f} s")]
        measured += [(f"path of {n}", f"{p / MM:.0f} mm") for n, p in m.paths.items()]
        measured += [("clips used", str(m.clips)), ("energy into the organ's bed", f"{m.energy:.0f} J")]
        measured.append(("largest pull of a grasper", f"{m.largest_pull:.1f} N"))
        measured.append(("largest slip in the jaws", f"{m.slipped / MM:.1f} mm"))
        if self.source:
            measured.append(("replay", "the same bytes" if self.ran.difference is None else "different bytes"))
        yield Table(("measure", "value"), measured)
        yield ""
        yield from by_severity(self.findings)

    def write(self, folder: Path) -> None:
        """Write procedure.csv (the signals that the checks use), and the session file of a simulated surgeon."""
        kept, p = self.ran.kept, self.procedure
        columns = {"t_s": kept.t, "seen": kept[f"{p.vessel}.seen"][:, 0]}
        columns["freed"] = kept[f"{p.organ}.freed"].sum(axis=1)
        columns |= {f"{n}_depth_m": kept[f"{n}.depth"][:, 0] for n in p.spare}
        for n in self.measures.paths:
            columns |= {f"{n}_tip_{axis}_m": kept[f"{n}.tip"][:, k] for k, axis in enumerate("xyz")}
            columns |= {f"{n}_{what}": kept[f"{n}.{what}"][:, 0] for what in ("carries", "holds")}
            columns[f"{n}_pull_n"] = np.linalg.norm(kept[f"{n}.pull"], axis=1)
        body = np.column_stack([*columns.values()])
        np.savetxt(folder / "procedure.csv", body, "%.6g", ",", header=",".join(columns), comments="")
        if self.recorded is not None:
            (folder / NAME).write_bytes(self.recorded)


def _setup(scene: Scene, task: Task) -> Setup:
    members = members_of(robots_at(operating_scene.robots_of(Setup(scene, {}, task))))
    return Setup(scene, members, task, organs=tissue_scene.tissues(scene, anatomy_of(scene)))


def operate_procedure(
    scene: Scene,
    task: str | None = None,
    *,
    seed: int = 0,
    mistake: Mistake = "",
    progress: Progress = silent,
) -> ProcedureSession:
    """Simulate a surgeon who performs a procedure with the robots of a scene; the surgeon's habits are ASSUMED.

    Args:
        scene: a scene with organs, vessels and tools.
        task: a task with a procedure; default: the first task of the scene.
        seed: random seed; the same seed gives the same session.
        mistake: a mistake that the surgeon makes; "": none.
        progress: see `Progress`.

    Raises:
        TwinError: the scene has no such task, or the task is not a procedure.
        WorldError: there is no such mistake, no robot can carry a tool, or a link is inside an organ at the start.
    """
    chosen = task_of(scene, task)
    operating_scene.procedure_of(scene, chosen)
    progress("read CAD", 0.0)
    setup = _setup(scene, chosen)
    with Scratch() as folder:
        path = Path(folder) / NAME
        ran = procedure_run.perform(setup, path, seed=seed, mistake=mistake, progress=progress)
        recorded = path.read_bytes()
    organ = operating_scene.organ_of(setup)
    return ProcedureSession(scene, chosen, "", seed, mistake, ran, organ, recorded=recorded)


def replay_procedure(
    path: str | Path, scene: Scene | str | Path | None = None, progress: Progress = silent
) -> ProcedureSession:
    """Replay the session of a procedure in a new World; compare the replay with the recording bit by bit; judge it.

    The default scene is the built-in scene that the file names.

    Raises:
        WorldError: the file is damaged, or was recorded with another version of twin or in another scene.
        TwinError: there is no such scene, or the session is not of a procedure.
    """
    path = Path(path)
    session = read_session(path)
    placed = scene if isinstance(scene, Scene) else load_scene(scene or session.head.scene)
    if session.head.task is None:
        raise TwinError(f"{path}: the session has no task")
    task = task_of(placed, session.head.task)
    progress("read CAD", 0.0)
    setup = replace(_setup(placed, task), props=props_of(placed), condition=session.head.condition)
    ran, organ = procedure_run.replay(session, path, setup, progress), operating_scene.organ_of(setup)
    return ProcedureSession(placed, task, str(path), session.head.seed, "", ran, organ, session.lost)


def is_procedure(path: str | Path, scene: str | Path | None = None) -> bool:
    """Return whether a session file is the recording of a procedure.

    Raises:
        WorldError: the file is damaged.
        TwinError: there is no such scene.
    """
    head = read_session(Path(path)).head
    if head.task is None:
        return False
    found = load_scene(scene or head.scene).tasks.get(head.task)
    return found is not None and found.procedure is not None
