"""Run a World with a simulated surgeon and write its session, or replay a session in a new World."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twin.core.errors import TwinError, WorldError, unknown
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.model.scene import Scene
from twin.model.task import Task
from twin.simulation import console_scene, contact_scene
from twin.simulation.condition import Condition
from twin.simulation.console_scene import HANDS, PEDALS
from twin.simulation.devices.camera_surgeon import CameraSurgeon
from twin.simulation.devices.guiding_surgeon import GuidingSurgeon
from twin.simulation.devices.recorded import Recorded
from twin.simulation.devices.ring_surgeon import Ring, RingSurgeon
from twin.simulation.devices.surgeon import ScriptedSurgeon
from twin.simulation.devices.surgeon_hands import Eye, Seat
from twin.simulation.machine.machine import Parts
from twin.simulation.plants.contact.gripper import grip_frame
from twin.simulation.session import file
from twin.simulation.session.file import Session, SessionWriter
from twin.simulation.session.guiding import STEPS
from twin.simulation.session.tape import Tape
from twin.simulation.setup import Setup
from twin.simulation.ways import Ways
from twin.simulation.world import Block, Recording, World

SAMPLE = 5e-3
"""Time in s between two kept rows of signals."""

_KEPT = (".q", ".follows", ".jaw", ".grip", ".pose", ".at", ".holder", ".touches", ".meets", ".rubs", ".force")
_KEPT += (".deviation", ".apart", ".phase", ".run", ".cue")
_KEPT_OF = ("console.", f"{PEDALS}.", "surgeon.", "haptics.")
"""Prefixes of signal names. A signal is kept if its name has one of these prefixes, or ends with an item of `_KEPT`."""

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Difference:
    """First chunk (one second) of a session in which the replay differs from the recording.

    Attributes:
        t0, t1: start and end of this chunk in s.
        signal: signal with the largest difference at t1; "" if all signals are equal again at t1.
        size: difference of `signal` at t1, in the unit of the signal.
    """

    t0: float
    t1: float
    signal: str
    size: float


@dataclass(frozen=True)
class Ran:
    """Signals of a session that was performed or replayed.

    Attributes:
        kept: the signals that measures and exports use, one row every `kept.dt` seconds.
        ticks: number of all ticks.
        dt: duration of a tick in s.
        difference: see `Difference`; None if the replay gave the same bytes, or if there was no replay.
        missed: names of the targets that a simulated surgeon gave up.
        condition: condition of the session; None: the World has no forces on the hands.
    """

    kept: Recording
    ticks: int
    dt: float
    difference: Difference | None = None
    missed: tuple[str, ...] = ()
    condition: Condition | None = None

    @property
    def duration(self) -> float:
        """Duration of the session in s."""
        return self.ticks * self.dt


class Keep:
    """Collects the values that signals with given names have at every n-th tick."""

    def __init__(self, world: World, names: Sequence[str], sample: float = SAMPLE) -> None:
        """Begin with no row; `sample`: time in s between two rows."""
        self._dt, self._every, self._next = world.dt, max(1, round(sample / world.dt)), 0
        all_sizes = world.signals.sizes
        self._sizes = {n: all_sizes[n] for n in names}
        ends = dict(zip(all_sizes, np.cumsum([*all_sizes.values()]).tolist(), strict=True))
        self._columns = np.concatenate([np.arange(ends[n] - all_sizes[n], ends[n]) for n in names])
        self._rows: list[Array] = []
        self.ticks = 0

    def add(self, rows: Array) -> None:
        """Add rows (k, m) of all signals."""
        self._rows.append(rows[self._next :: self._every, self._columns])
        self._next = (self._next - len(rows)) % self._every
        self.ticks += len(rows)

    def recording(self) -> Recording:
        """Return the kept rows."""
        return Recording(self._every * self._dt, self._sizes, np.concatenate(self._rows))


def kept(world: World) -> list[str]:
    """Return the names of the signals that measures and exports use."""
    return [n for n in world.signals.sizes if n.endswith(_KEPT) or n.startswith(_KEPT_OF)]


def task_of(scene: Scene, name: str | None) -> Task:
    """Return a task of a scene by name; None: the first one.

    Raises:
        TwinError: the scene has no such task.
    """
    if not scene.tasks:
        raise TwinError(f"scene '{scene.name}' has no task: add a section [task.NAME] to {scene.file.name}")
    if name is not None and name not in scene.tasks:
        raise TwinError(f"{scene.name}: {unknown('task', name, scene.tasks)}")
    return scene.tasks[name or next(iter(scene.tasks))]


def surgeon(
    setup: Setup, seed: int = 0, scale: float | None = None, mistake: str = ""
) -> ScriptedSurgeon | RingSurgeon | GuidingSurgeon | CameraSurgeon:
    """Return the simulated surgeon of a task, who controls the first arm of each hand.

    Args:
        setup: a scene with a console, its robots, and a task that is not a procedure.
        seed: random seed.
        scale: motion scale; None: the motion scale of the console.
        mistake: a mistake to make in a task with a ring to guide, "": none.
    """
    scene, task, seat = setup.scene, setup.task, seat_of(setup, seed, scale)
    if task is None:
        raise TwinError(f"scene '{scene.name}': the simulated surgeon needs a task")
    if task.transfers:
        pegs, objects = contact_scene.pegs(scene, setup.props, task), {o.name: o for o in scene.objects}
        rings = [
            Ring(t.ring, objects[t.ring].size[0], objects[t.ring].size[1], t.peg, pegs[t.peg].end, pegs[t.peg].foot)
            for t in task.transfers
        ]
        return RingSurgeon(seat, rings)
    if task.guide is not None:
        ring = next(o for o in scene.objects if o.name == task.guide.ring)
        grips = {h: replace(e, T_tool_tip=grip_frame(setup.members[e.robot].mechanism)) for h, e in seat.arms.items()}
        course = contact_scene.course(scene, setup.props, task)
        return GuidingSurgeon(replace(seat, arms=grips), ring, course, task.guide.first, Ways(setup), mistake)
    if (a := task.alignment) is not None:
        return CameraSurgeon(seat, task.name, a.upper, a.line)
    targets = [(t.name, t.p_world) for t in task.targets]
    return ScriptedSurgeon(seat, targets, task.tolerance, task.hold)


def seat_of(setup: Setup, seed: int, scale: float | None) -> Seat:
    """Return the seat of a simulated surgeon, who controls the first arm of each hand; for `scale`, see `surgeon`."""
    table, arms = console_scene.console_of(setup.scene), {}
    for hand in HANDS:
        name = getattr(table, hand)[0]
        member = setup.members[name]
        T_tool_tip = member.mechanism.frame_in_tool(table.tip or member.mechanism.tool)
        arms[hand] = Eye(name, member.kin, setup.places[name].T_world_base, T_tool_tip)
    camera = setup.scene.cameras[table.camera]
    scale = table.scale if scale is None else scale
    return Seat(PEDALS, arms, camera.robot, camera.view_deg * DEG, scale, seed=seed)


def perform(
    setup: Setup,
    path: Path,
    *,
    seed: int = 0,
    scale: float | None = None,
    mistake: str = "",
    progress: Progress,
) -> Ran:
    """Simulate a surgeon who performs a task, and write the session; the surgeon does not react to forces.

    Args:
        setup: see `surgeon`.
        path: the session file.
        seed: random seed of the surgeon.
        scale: motion scale; None: the motion scale of the console.
        mistake: a mistake to make in a task with a ring to guide, "": none.
        progress: called with the name of the target or ring, and the fraction of targets or rings done.

    Raises:
        OutputError: the file cannot be written.
        TwinError: the scene has no console, or there is no task.
    """
    device, tape = surgeon(setup, seed, scale, mistake), Tape()
    world = console_scene.world(setup, device, records=False, watch=[tape])
    keep, task = Keep(world, kept(world)), setup.task
    assert task is not None, "the surgeon has a task"
    names = [*(t.name for t in task.targets), *(t.ring for t in task.transfers)]
    names = names or [*(STEPS if task.guide else ()), task.name]
    with SessionWriter(path, head_of(setup, world, device, seed)) as writer:
        while not world.ended and not writer.full:
            world.step(file.CHUNK)
            rows = tape.take()
            writer.add(rows)
            keep.add(rows)
            i = min(max(int(world.signals["surgeon.target"][0]), 0), len(names) - 1)
            progress(names[i], i / len(names))
    return Ran(keep.recording(), keep.ticks, world.dt, missed=tuple(device.missed), condition=setup.condition)


def head_of(
    setup: Setup, world: World, device: Block, seed: int | None = None, identity: str | None = None
) -> file.Head:
    """Return the first line of the session file of a World with a device.

    `seed`: random seed of a simulated surgeon; `identity`: hash of the inputs; None: the hash for a World at a console.
    """
    sizes, name = world.signals.sizes, None if setup.task is None else setup.task.name
    own = {n: s for n, s in sizes.items() if n in device.outputs}
    identity = identity or console_scene.identity(setup, world.dt)
    return file.head(setup.scene.name, identity, world.dt, own, sizes, name, seed, setup.condition)


def require_scene(session: Session, path: Path, setup: Setup) -> None:
    """Check that a session was recorded in this scene, and that the scene has not changed since.

    Raises:
        WorldError: the session is of another scene, or of a scene that has changed since.
    """
    head, name = session.head, setup.scene.name
    if head.scene != name:
        raise WorldError(f"{path}: the session was recorded in scene '{head.scene}', not in '{name}'")
    if head.identity != console_scene.identity(setup, head.dt):
        raise WorldError(
            f"{path}: scene '{name}' has changed since this session (places, limits, frames or the console), "
            f"or the first line of the file has (a tick of {head.dt:g} s): restore the earlier scene or file to replay "
            "the session"
        )


def replay(session: Session, setup: Setup, progress: Progress, parts: Mapping[str, Parts] | None = None) -> Ran:
    """Replay a session in a new World, and compare all signals of every tick.

    Args:
        session: the session; see `require_scene`.
        setup: scene, robots, task and condition of the session.
        progress: called with "replay" and the fraction done.
        parts: compiled parts of the machines of the scene; the states of the machines are read from the session.

    Raises:
        WorldError: the signals of the World are not those of the session.
    """
    start = session.head
    own, device = file.sizes(start.device), session.device
    recorded = Recorded(Recording(start.dt, own, device), *own)
    tape = Tape()
    world = console_scene.world(setup, recorded, start.dt, records=False, watch=[tape], parts=parts)
    if world.signals.sizes != file.sizes(start.world):
        raise WorldError(
            f"the session was written by twin {start.twin}, whose World has other signals: replay it with that version"
        )
    return repeat(session, world, tape, Keep(world, kept(world)), progress)


def repeat(session: Session, world: World, tape: Tape, keep: Keep, progress: Progress) -> Ran:
    """Step a World by the recorded device to the end of a session; compare the signals of the World with the recording.

    Args:
        session: the session.
        world: the World, at its start.
        tape: receives the rows of the World.
        keep: collects the signals that measures and exports use.
        progress: called with "replay" and the fraction done.
    """
    difference, t = None, 0.0
    for chunk in session.chunks:
        world.step(len(chunk.device))
        rows = tape.take()
        keep.add(rows)
        t1 = t + len(rows) * session.head.dt
        if difference is None and file.digest(rows) != chunk.digest:
            difference = _difference(t, t1, rows[-1], chunk.last, world)
        t = t1
        progress("replay", keep.ticks / len(session.device))
    return Ran(keep.recording(), keep.ticks, session.head.dt, difference, condition=session.head.condition)


def _difference(t0: float, t1: float, row: Array, last: Array, world: World) -> Difference:
    """Compare the rows after a chunk that lasts from t0 to t1 in s: `row` of the replay, `last` of the recording."""
    off = np.abs(row - last)
    k = int(np.argmax(off))
    if off[k] == 0:
        return Difference(t0, t1, "", 0.0)
    ends = np.cumsum([*world.signals.sizes.values()])
    name = [*world.signals.sizes][int(np.searchsorted(ends, k, side="right"))]
    return Difference(t0, t1, name, float(off[k]))
