"""Run a World with a simulated surgeon and write its session, or replay a session in a new World."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.core.errors import TwinError, WorldError, unknown
from twin.core.progress import Progress
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.model.scene import Scene
from twin.model.task import ConsoleTask
from twin.simulation import console_scene
from twin.simulation.condition import Condition
from twin.simulation.console_scene import HANDS, PEDALS
from twin.simulation.devices.recorded import Recorded
from twin.simulation.devices.surgeon_hands import Seat, SeenArm, SimulatedHands
from twin.simulation.machine.machine_parts import Parts
from twin.simulation.session import session_file
from twin.simulation.session.forces import ForceMeasures, ForceMeter
from twin.simulation.session.session_file import Session, SessionWriter
from twin.simulation.session.tape import Tape
from twin.simulation.session.task_play import play_of
from twin.simulation.setup import Setup
from twin.simulation.world import Block, Recording, World
from twin.simulation.world.signal_kinds import (
    CAMERA_AT,
    HAND_FORCE,
    HAND_GRIP,
    HAND_POSE,
    OBJECT_HOLDER,
    OBJECT_POSE,
    OBJECT_RUBS,
    ROBOT_APART,
    ROBOT_CUE,
    ROBOT_DEVIATION,
    ROBOT_FOLLOWS,
    ROBOT_JAW,
    ROBOT_MEETS,
    ROBOT_PHASE,
    ROBOT_Q,
    ROBOT_RUN,
    ROBOT_TOUCHES,
    SURGEON_TARGET,
)
from twin.simulation.world.signals import columns

SAMPLE = 5e-3
"""Time in s between two kept rows of signals."""

_KEPT_KINDS = (
    ROBOT_Q,
    ROBOT_FOLLOWS,
    ROBOT_JAW,
    ROBOT_TOUCHES,
    ROBOT_MEETS,
    ROBOT_DEVIATION,
    ROBOT_APART,
    ROBOT_PHASE,
    ROBOT_RUN,
    ROBOT_CUE,
    HAND_GRIP,
    HAND_POSE,
    HAND_FORCE,
    CAMERA_AT,
    OBJECT_POSE,
    OBJECT_HOLDER,
    OBJECT_RUBS,
)
"""Kinds of signals that are kept, with others of the same name, such as the force on an organ."""

_KEPT_OF = ("console.", f"{PEDALS}.", "surgeon.", "haptics.")
"""Prefixes of the names of signals that are kept."""


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
class SessionRun:
    """Signals of a session that was performed or replayed.

    Attributes:
        recording: the signals that measures and exports use, one row every `recording.dt` seconds.
        ticks: number of all ticks.
        dt: duration of a tick in s.
        difference: see `Difference`; None if the replay gave the same bytes, or if there was no replay.
        missed: names of the targets that a simulated surgeon gave up.
        condition: condition of the session; None: the World has no forces on the hands.
        forces: measures of the forces on the hands, of all ticks; None: the World has no forces on the hands.
        lag: time in s by which a World with real machines remained behind real time.
    """

    recording: Recording
    ticks: int
    dt: float
    difference: Difference | None = None
    missed: tuple[str, ...] = ()
    condition: Condition | None = None
    forces: ForceMeasures | None = None
    lag: float = 0.0

    @property
    def duration(self) -> float:
        """Duration of the session in s."""
        return self.ticks * self.dt


class Keep:
    """Collects the values that signals with given names have at every n-th tick; measures the forces in every tick."""

    def __init__(self, world: World, names: Sequence[str], sample: float = SAMPLE) -> None:
        """Begin with no row; `sample`: time in s between two rows."""
        self._dt = world.dt
        self._every = max(1, round(sample / world.dt))
        self._next = 0  # index of the next kept row among the rows to be added
        all_sizes = world.signals.sizes
        self._sizes = {name: all_sizes[name] for name in names}
        column_of = columns(all_sizes)
        kept_columns = []
        for name in names:
            columns_of_signal = column_of[name]
            kept_columns.append(np.arange(columns_of_signal.start, columns_of_signal.stop))
        self._columns = np.concatenate(kept_columns)
        self._rows: list[Array] = []
        hands_with_forces = [hand for hand in HANDS if HAND_FORCE.of(hand) in all_sizes]
        self.forces = ForceMeter(all_sizes, world.dt, hands_with_forces)
        self.ticks = 0

    def add(self, rows: Array) -> None:
        """Add rows (k, m) of all signals."""
        self.forces.add(rows)
        self._rows.append(rows[self._next :: self._every, self._columns])
        self._next = (self._next - len(rows)) % self._every
        self.ticks += len(rows)

    def recording(self) -> Recording:
        """Return the kept rows."""
        return Recording(self._every * self._dt, self._sizes, np.concatenate(self._rows))


def kept(world: World) -> list[str]:
    """Return the names of the signals that measures and exports use."""
    endings = tuple(f".{kind.what}" for kind in _KEPT_KINDS)
    names = []
    for name in world.signals.sizes:
        if name.endswith(endings) or name.startswith(_KEPT_OF):
            names.append(name)
    return names


def task_of(scene: Scene, name: str | None) -> ConsoleTask:
    """Return a task of a scene by name; None: the first one.

    Raises:
        TwinError: the scene has no such task.
    """
    if not scene.tasks:
        raise TwinError(f"scene '{scene.name}' has no task: add a section [task.NAME] to {scene.file.name}")
    if name is not None and name not in scene.tasks:
        raise TwinError(f"{scene.name}: {unknown('task', name, scene.tasks)}")
    return scene.tasks[name or next(iter(scene.tasks))]


def surgeon(setup: Setup, seed: int = 0, scale: float | None = None, mistake: str = "") -> SimulatedHands:
    """Return the simulated surgeon of a task, who controls the first arm of each hand.

    Args:
        setup: a scene with a console, its robots, and a task that is not a procedure.
        seed: random seed.
        scale: motion scale; None: the motion scale of the console.
        mistake: a mistake to make in a task with a ring to guide, "": none.
    """
    seat = seat_of(setup, seed, scale)
    task = setup.task
    if task is None:
        raise TwinError(f"scene '{setup.scene.name}': the simulated surgeon needs a task")
    return play_of(task).surgeon(setup, task, seat, mistake)


def seat_of(setup: Setup, seed: int, scale: float | None) -> Seat:
    """Return the seat of a simulated surgeon, who controls the first arm of each hand; for `scale`, see `surgeon`."""
    table = console_scene.console_of(setup.scene)
    arms = {}
    for hand in table.hands:
        name = getattr(table, hand)[0]
        member = setup.members[name]
        T_tool_tip = member.mechanism.frame_in_tool(table.tip or member.mechanism.tool)
        arms[hand] = SeenArm(name, member.kin, setup.places[name].T_world_base, T_tool_tip)
    camera = setup.scene.cameras[table.camera]
    if scale is None:
        scale = table.scale
    return Seat(PEDALS, arms, camera.robot, camera.view_deg * DEG, scale, seed=seed)


def perform(
    setup: Setup,
    path: Path,
    *,
    seed: int = 0,
    scale: float | None = None,
    mistake: str = "",
    progress: Progress,
) -> SessionRun:
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
    device = surgeon(setup, seed, scale, mistake)
    tape = Tape()
    # without records: an hour of all signals would not fit into the memory; the tape is emptied every second
    world = console_scene.world(setup, device, records=False, watch=[tape])
    keep = Keep(world, kept(world))
    assert setup.task is not None, "the surgeon has a task"
    names = setup.task.steps
    with SessionWriter(path, head_of(setup, world, device, seed)) as writer:
        while not world.ended and not writer.full:
            world.step(session_file.CHUNK)
            rows = tape.take()
            writer.add(rows)
            keep.add(rows)
            target = int(world.signals[SURGEON_TARGET.name][0])
            i = min(max(target, 0), len(names) - 1)
            progress(names[i], i / len(names))
    return SessionRun(
        keep.recording(),
        keep.ticks,
        world.dt,
        missed=tuple(device.missed),
        condition=setup.condition,
        forces=keep.forces.measures(),
    )


def head_of(
    setup: Setup, world: World, device: Block, seed: int | None = None, identity: str | None = None
) -> session_file.Head:
    """Return the first line of the session file of a World with a device.

    `seed`: random seed of a simulated surgeon; `identity`: hash of the inputs; None: the hash for a World at a console.
    """
    sizes = world.signals.sizes
    device_sizes = {}
    for name, size in sizes.items():  # in the order of the World, as rows of the device are written
        if name in device.outputs:
            device_sizes[name] = size
    task = None
    if setup.task is not None:
        task = setup.task.name
    identity = identity or console_scene.identity(setup, world.dt)
    return session_file.head(setup.scene.name, identity, world.dt, device_sizes, sizes, task, seed, setup.condition)


def require_scene(session: Session, path: Path, setup: Setup) -> None:
    """Check that a session was recorded in this scene, and that the scene has not changed since.

    Raises:
        WorldError: the session is of another scene, or of a scene that has changed since.
    """
    head = session.head
    name = setup.scene.name
    if head.scene != name:
        raise WorldError(f"{path}: the session was recorded in scene '{head.scene}', not in '{name}'")
    if head.identity != console_scene.identity(setup, head.dt):
        raise WorldError(
            f"{path}: scene '{name}' has changed since this session (places, limits, frames or the console), "
            f"or the first line of the file has (a tick of {head.dt:g} s): restore the earlier scene or file to replay "
            "the session"
        )


def replay(session: Session, setup: Setup, progress: Progress, parts: Mapping[str, Parts] | None = None) -> SessionRun:
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
    device_sizes = session_file.sizes(start.device)
    recorded = Recorded(Recording(start.dt, device_sizes, session.device), *device_sizes)
    tape = Tape()
    world = console_scene.world(setup, recorded, start.dt, records=False, watch=[tape], parts=parts)
    # in their order as well: rows are compared number by number
    if list(world.signals.sizes.items()) != list(session_file.sizes(start.world).items()):
        raise WorldError(
            f"the session was written by twin {start.twin}, whose World has other signals: replay it with that version"
        )
    return repeat(session, world, tape, Keep(world, kept(world)), progress)


def repeat(session: Session, world: World, tape: Tape, keep: Keep, progress: Progress) -> SessionRun:
    """Step a World by the recorded device to the end of a session; compare the signals of the World with the recording.

    Args:
        session: the session.
        world: the World, at its start.
        tape: receives the rows of the World.
        keep: collects the signals that measures and exports use.
        progress: called with "replay" and the fraction done.
    """
    difference = None
    t = 0.0
    ticks = sum([len(chunk.device) for chunk in session.chunks])
    for chunk in session.chunks:
        world.step(len(chunk.device))
        rows = tape.take()
        keep.add(rows)
        t1 = t + len(rows) * session.head.dt
        if difference is None and session_file.digest(rows) != chunk.digest:
            difference = _difference(t, t1, rows[-1], chunk.last, world)
        t = t1
        progress("replay", keep.ticks / ticks)
    return SessionRun(
        keep.recording(),
        keep.ticks,
        session.head.dt,
        difference,
        condition=session.head.condition,
        forces=keep.forces.measures(),
    )


def _difference(t0: float, t1: float, row: Array, last: Array, world: World) -> Difference:
    """Compare the rows after a chunk that lasts from t0 to t1 in s: `row` of the replay, `last` of the recording."""
    differences = np.abs(row - last)
    largest = int(np.argmax(differences))
    if differences[largest] == 0:
        return Difference(t0, t1, "", 0.0)
    names = list(world.signals.sizes)
    ends = np.cumsum(list(world.signals.sizes.values()))
    signal = names[int(np.searchsorted(ends, largest, side="right"))]
    return Difference(t0, t1, signal, float(differences[largest]))
