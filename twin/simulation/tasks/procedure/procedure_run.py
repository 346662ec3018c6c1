"""Run a procedure with a simulated surgeon and write its session, or replay a session in a new World."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twin.core.errors import WorldError
from twin.core.progress import Progress
from twin.simulation import console_scene, operating_scene, procedure_scene
from twin.simulation.devices.recorded import Recorded
from twin.simulation.session import session_file
from twin.simulation.session.session_file import Session, SessionWriter
from twin.simulation.session.session_run import Keep, SessionRun, head_of, repeat
from twin.simulation.session.tape import Tape
from twin.simulation.setup import Setup
from twin.simulation.tasks.procedure.procedure_surgeon import ProcedureSurgeon
from twin.simulation.tasks.procedure.task import Mistake, ProcedureTable
from twin.simulation.world import Recording, World
from twin.simulation.world.signal_kinds import DEVICE_CLUTCH, ORGAN_NODES, SURGEON_STAGE

_SAMPLE = 8e-3
"""Time in s between two kept rows, equal to the time between two steps of the organs."""

_STAGES = ("begin", "expose", "show", "clip", "cut", "remove")


def by_hand(session: Session) -> bool:
    """Return whether a procedure was performed at a console by hand; otherwise, a simulated surgeon performed it."""
    return DEVICE_CLUTCH.of(console_scene.PEDALS) in session_file.sizes(session.head.device)


def keep_for(world: World, procedure: ProcedureTable, sample: float = _SAMPLE) -> Keep:
    """Return a `Keep` of the measures' signals, with the nodes of the removed organ only; one row every `sample` s."""
    nodes = ORGAN_NODES.of(procedure.organ)
    unused = (".nodes", ".pose", ".goal", ".command")
    names = []
    for name in world.signals.sizes:
        if name == nodes or not name.endswith(unused):
            names.append(name)
    return Keep(world, names, sample)


def perform(setup: Setup, path: Path, *, seed: int = 0, mistake: Mistake = "", progress: Progress) -> SessionRun:
    """Simulate a surgeon who performs a procedure, and write the session.

    Args:
        setup: a scene with organs, its robots, and a task with a procedure.
        path: the session file.
        seed: random seed of the surgeon.
        mistake: a mistake that the surgeon makes; "": none.
        progress: called with the name of the stage, and the fraction of stages done.

    Raises:
        OutputError: the file cannot be written.
        TwinError: the task is not a procedure, or an organ is missing.
        WorldError: there is no such mistake, no robot can carry a required tool, or a link is inside an organ at the
            start.
    """
    device = ProcedureSurgeon(setup, seed, mistake)
    tape = Tape()
    world = procedure_scene.world(setup, device, records=False, watch=[tape])
    keep = keep_for(world, operating_scene.procedure_of(setup.scene, setup.task))
    head = head_of(setup, world, device, seed, procedure_scene.identity(setup))
    with SessionWriter(path, head) as writer:
        while not world.ended and not writer.full:
            world.step(session_file.CHUNK // 4)
            rows = tape.take()
            writer.add(rows)
            keep.add(rows)
            stage = int(world.signals[SURGEON_STAGE.name][0])
            progress(_STAGES[stage], stage / len(_STAGES))
    return SessionRun(keep.recording(), keep.ticks, world.dt, missed=tuple(device.missed))


def replay(session: Session, path: Path, setup: Setup, progress: Progress) -> SessionRun:
    """Replay a session in a new World, and compare all signals of every tick.

    Args:
        session: the session.
        path: file of the session, for messages.
        setup: scene, robots, task, condition and organs of the session; the props are only needed for a session
            that was performed at a console.
        progress: called with "replay" and the fraction done.

    Raises:
        WorldError: the session is of another scene, the scene has changed since, or the World has other signals.
    """
    head = session.head
    kind = console_scene if by_hand(session) else procedure_scene
    if head.scene != setup.scene.name or head.identity != kind.identity(setup):
        raise WorldError(
            f"{path}: the session was recorded in scene '{head.scene}'. This is another scene, or the scene has "
            "changed since: restore the earlier scene to replay the session"
        )
    sizes = session_file.sizes(head.device)
    recorded = Recorded(Recording(head.dt, sizes, session.device), *sizes)
    tape = Tape()
    world = kind.world(setup, recorded, records=False, watch=[tape])
    # in their order as well: rows are compared number by number
    has_same_signals = list(world.signals.sizes.items()) == list(session_file.sizes(head.world).items())
    if not has_same_signals or not np.isclose(head.dt, world.dt):
        raise WorldError(
            f"{path}: the session was written by twin {head.twin}, whose World has other signals: replay it with that "
            "version"
        )
    procedure = operating_scene.procedure_of(setup.scene, setup.task)
    sample = console_scene.ORGANS if by_hand(session) else _SAMPLE
    keep = keep_for(world, procedure, sample)
    return repeat(session, world, tape, keep, progress)
