"""Run a procedure with a simulated surgeon and write its session, or replay a session in a new World."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from twin.core.errors import WorldError
from twin.model.mechanism import Mechanism
from twin.model.scene import Place, Scene
from twin.model.task import Task
from twin.simulation import console_scene, operating_scene, procedure_scene, tissue_scene
from twin.simulation.console_scene import Member, start
from twin.simulation.devices.procedure_surgeon import Arm, Manner, Mistake, ProcedureSurgeon
from twin.simulation.devices.recorded import Recorded
from twin.simulation.procedure_scene import TICK
from twin.simulation.session import file
from twin.simulation.session.file import Session, SessionWriter
from twin.simulation.session.run import Keep, Progress, Ran, repeat
from twin.simulation.session.tape import Tape
from twin.simulation.world import Recording, World

_SAMPLE = 8e-3
"""Time in s between two kept rows, equal to the time between two steps of the organs."""

_STAGES = ("begin", "expose", "show", "clip", "cut", "remove")


def _arm(place: Place, member: Member) -> Arm:
    T = place.T_world_base @ member.kin.forward(start(place, member.mechanism))
    return Arm(place.name, operating_scene.port_of(place), T[:3, 3])


def surgeon(
    scene: Scene,
    members: Mapping[str, Member],
    task: Task,
    drawn: Mechanism | None,
    seed: int,
    mistake: Mistake = "",
    manner: Manner | None = None,
) -> ProcedureSurgeon:
    """Return the simulated surgeon of a procedure; `manner`: habits, None: the defaults.

    Raises:
        TwinError: the task is not a procedure, or an organ cannot be built.
        WorldError: there is no such mistake, or no robot can carry a required tool.
    """
    procedure = operating_scene.procedure_of(scene, task)
    *arms, camera = (_arm(p, members[p.name]) for p in operating_scene.robots_of(scene, procedure))
    organs = tissue_scene.tissues(scene, drawn)
    return ProcedureSurgeon(arms, camera, organs, scene.vessels, scene.tools, procedure, TICK, seed, mistake, manner)


def by_hand(session: Session) -> bool:
    """Return whether a procedure was performed by the hands at a console, and not by a simulated surgeon."""
    return any(s.name == f"{console_scene.PEDALS}.clutch" for s in session.head.device)


def keep_for(world: World, task: Task, sample: float = _SAMPLE) -> Keep:
    """Return a `Keep` of the signals for measures, every `sample` s, without the nodes of vessels and other organs."""
    assert task.procedure is not None
    own = f"{task.procedure.organ}.nodes"
    names = [n for n in world.signals.sizes if n == own or not n.endswith((".nodes", ".pose", ".goal", ".command"))]
    return Keep(world, names, sample)


def perform(
    scene: Scene,
    members: Mapping[str, Member],
    task: Task,
    drawn: Mechanism | None,
    path: Path,
    *,
    seed: int = 0,
    mistake: Mistake = "",
    progress: Progress,
) -> Ran:
    """Simulate a surgeon who performs a procedure, and write the session.

    Args:
        scene: a scene with organs.
        members: robots by the names of their places.
        task: a task with a procedure.
        drawn: mechanism whose bodies are the organs.
        path: the session file.
        seed: random seed of the surgeon.
        mistake: a mistake that the surgeon makes; "": none.
        progress: called with the name of the stage, and the fraction of stages done.

    Raises:
        OutputError: the file cannot be written.
        TwinError: the task is not a procedure, or an organ cannot be built.
        WorldError: there is no such mistake, no robot can carry a required tool, or a link is inside an organ at the
            start.
    """
    device, tape = surgeon(scene, members, task, drawn, seed, mistake), Tape()
    world = procedure_scene.world(scene, members, task, drawn, device, records=False, watch=[tape])
    sizes = world.signals.sizes
    own = {n: s for n, s in sizes.items() if n in device.outputs}
    identity = procedure_scene.identity(scene, members, task, tissue_scene.tissues(scene, drawn))
    writer = SessionWriter(path, file.head(scene.name, identity, world.dt, own, sizes, task.name, seed))
    keep = keep_for(world, task)
    try:
        while not world.ended and not writer.full:
            world.step(file.CHUNK // 4)
            rows = tape.take()
            writer.add(rows)
            keep.add(rows)
            stage = int(world.signals["surgeon.stage"][0])
            progress(_STAGES[stage], stage / len(_STAGES))
        writer.close()
    finally:
        writer.abandon()
    return Ran(keep.recording(), keep.ticks, world.dt, missed=tuple(device.missed))


def replay(
    session: Session,
    path: Path,
    scene: Scene,
    members: Mapping[str, Member],
    task: Task,
    drawn: Mechanism | None,
    progress: Progress,
    props: Mechanism | None = None,
) -> Ran:
    """Replay a session in a new World, and compare all signals of every tick.

    Args:
        session: the session.
        path: its file, for messages.
        scene: its scene.
        members: robots by the names of their places.
        task: its task.
        drawn: mechanism whose bodies are the organs.
        progress: called with "replay" and the fraction done.
        props: mechanism of the props; only needed for a session by hand, for the forces of contacts.

    Raises:
        WorldError: the session is of another scene, of one that has changed since, or of a World with other signals.
    """
    begin, tape = session.head, Tape()
    own, device = file.sizes(begin.device), session.device
    recorded = Recorded(Recording(begin.dt, own, device), *own)
    organs = tissue_scene.tissues(scene, drawn)
    if by_hand(session):
        haptics = None if begin.condition is None else begin.condition.haptics
        more = {"task": task, "props": props, "haptics": haptics, "organs": organs}
        identity = console_scene.identity(scene, members, **more)
        world = console_scene.world(scene, members, recorded, records=False, watch=[tape], **more)
    else:
        identity = procedure_scene.identity(scene, members, task, organs)
        world = procedure_scene.world(scene, members, task, drawn, recorded, records=False, watch=[tape])
    if begin.scene != scene.name or begin.identity != identity:
        raise WorldError(
            f"{path}: the session was recorded in scene '{begin.scene}'. This is another scene, or the scene has "
            "changed since: restore the earlier scene to replay the session"
        )
    if world.signals.sizes != file.sizes(begin.world) or not np.isclose(begin.dt, world.dt):
        raise WorldError(
            f"{path}: the session was written by twin {begin.twin}, whose World has other signals: replay it with that "
            "version"
        )
    keep = keep_for(world, task, console_scene.ORGANS if by_hand(session) else _SAMPLE)
    difference = repeat(session, world, tape, keep, progress)
    return Ran(keep.recording(), keep.ticks, begin.dt, difference)
