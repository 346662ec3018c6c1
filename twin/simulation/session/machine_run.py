"""Run a World with a simulated trainee and real machines, in real time, and write its session."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

from twin.core.errors import DeviceError
from twin.core.progress import Progress
from twin.simulation import console_scene
from twin.simulation.devices.combined_devices import CombinedDevices
from twin.simulation.devices.machine_states import MachineStates
from twin.simulation.devices.trainee import Trainee
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_link import MachineLink
from twin.simulation.machine.machine_parts import Parts
from twin.simulation.machine.outbox import Outbox
from twin.simulation.machine.packet_exchange import Exchange
from twin.simulation.session.session_file import SessionWriter
from twin.simulation.session.session_run import Keep, SessionRun, head_of, kept, seat_of
from twin.simulation.session.tape import Tape
from twin.simulation.setup import Setup

_CHUNK = 100
"""Number of ticks between two writes."""

_OWED = 0.1
"""Largest lag in s behind real time that the World makes up by faster steps; a larger lag remains."""

_POLL = 0.01
"""Time in s between two looks at the state of a machine that is made ready."""

_HOME = 20.0
"""Maximum time in s in which a machine must reach its home posture after its start."""


def train(
    setup: Setup,
    parts: Mapping[str, Parts],
    links: Mapping[str, MachineLink],
    path: Path,
    *,
    seed: int = 0,
    triangles: int = 2,
    scale: float | None = None,
    progress: Progress,
) -> SessionRun:
    """Simulate a trainee who teleoperates, rehearses and replays, and write the session.

    Args:
        setup: a scene with machines, its robots, and the condition of the cues on the hands.
        parts: {name of a place: compiled parts of its machine}.
        links: {name of a place: connection to its machine}.
        path: the session file.
        seed: random seed of the trainee; with the same seed, the states of real machines still differ between runs.
        triangles: number of triangles that the trainee traces by teleoperation.
        scale: motion scale; None: the motion scale of the console.
        progress: called with the current step of the exercise, and the fraction done.

    Raises:
        DeviceError: a machine does not answer, is not ready, or accepts packets from another master.
        OutputError: the file cannot be written.
    """
    for name, link in links.items():
        ready(name, link)
    trainee = Trainee(seat_of(setup, seed, scale), links, triangles)
    states = {}
    for name in links:
        states[name] = MachineStates(name, parts[name].home)
    device = CombinedDevices([trainee, *states.values()])
    outbox = Outbox(parts)
    tape = Tape()
    world = console_scene.world(setup, device, records=False, watch=[outbox, tape], parts=parts)
    exchange = Exchange(links, states, outbox)
    keep = Keep(world, kept(world))
    lag = 0.0
    begin = time.monotonic()
    with SessionWriter(path, head_of(setup, world, device, seed)) as writer:
        while not world.ended and not writer.full:
            # in real time: the machines step by their own clocks
            wait = begin + world.t - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            elif wait < -_OWED:
                begin -= wait  # the clock of the World begins anew: the lag remains
                lag -= wait
            exchange.receive()
            world.step()
            exchange.send()
            if world.tick % _CHUNK == 0 or world.ended:
                rows = tape.take()
                if len(rows):
                    writer.add(rows)
                    keep.add(rows)
                for name, link in links.items():
                    if link.problem:
                        raise DeviceError(f"{name}: {link.problem}")
                progress(trainee.doing, trainee.done)
    forces = keep.forces.measures()
    return SessionRun(keep.recording(), keep.ticks, world.dt, condition=setup.condition, forces=forces, lag=lag)


def ready(name: str, link: MachineLink, patience: float = _HOME) -> None:
    """Press the start button of a machine in E_STOP, and wait until the machine is in its home posture.

    Raises:
        DeviceError: the machine does not answer, or is not in its home posture within `patience` s.
    """
    end = time.monotonic() + patience
    pressed = False
    while time.monotonic() < end:
        state = link.state
        if state is not None and state.level >= Level.PEDAL_UP:
            return
        if state is not None and state.level == Level.E_STOP and not pressed:
            link.reader.press("start")
            pressed = True
        if link.reader.problem:
            break
        time.sleep(_POLL)
    state = link.state
    reason = link.problem
    if not reason and state is not None:
        reason = f"it is in {state.level.name}"
    raise DeviceError(f"{name}: the machine is not ready: {reason}. Stop it, and start it again with --start")
