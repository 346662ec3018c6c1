"""Simulate a surgeon at a console, and replay a session."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from twin.api.console_session import ConsoleSession
from twin.api.machine import Machines, machine_parts
from twin.api.robot import Robot
from twin.api.scene_loading import as_scene, scene_of_session
from twin.api.scene_parts import members_of, props_of, robots_at
from twin.core.atomic import Scratch
from twin.core.errors import AssemblyError, TwinError
from twin.core.progress import Progress, silent
from twin.model.scene import Scene
from twin.model.task import ConsoleTask
from twin.simulation import console_scene, machine_scene
from twin.simulation.condition import Condition
from twin.simulation.machine.machine_link import Address
from twin.simulation.machine.machine_parts import Parts
from twin.simulation.session import training
from twin.simulation.session.session_file import NAME as FILE
from twin.simulation.session.session_run import SessionRun
from twin.simulation.session.task_play import ArmPath, play_of
from twin.simulation.session.training import Training
from twin.simulation.setup import Setup
from twin.simulation.world.signal_kinds import ROBOT_Q


def operate_console(
    scene: Scene | str | Path,
    task: str | None = None,
    *,
    seed: int = 0,
    scale: float | None = None,
    haptics: bool | None = None,
    mistake: str = "",
    progress: Progress = silent,
) -> ConsoleSession:
    """Simulate a surgeon who performs a task at the console of a scene; the surgeon's habits are ASSUMED.

    Args:
        scene: a scene with a console, its name or its path.
        task: a task of the scene; default: the first task.
        seed: random seed; the same seed gives the same session.
        scale: motion scale, 0.05 to 1; default: the motion scale of the console.
        haptics: whether to compute forces on the hands (the simulated surgeon does not react to them); default: no.
        mistake: a mistake that the surgeon makes in a task with a ring to guide; see `simulation.tasks`.
        progress: see `Progress`.

    Raises:
        TwinError: the scene has no console or no such task, or the scale is out of range.

    Examples:
        >>> import twin
        >>> session = twin.operate_console("davinci", "touch")
        >>> session.verdict
        'agree'
    """
    from twin.simulation.session import session_run

    scene = as_scene(scene)
    console_scene.console_of(scene)
    chosen = session_run.task_of(scene, task)
    _require_console(chosen)
    _require_scale(scale)
    if mistake and not chosen.kind.mistakes:
        raise TwinError(f"task '{chosen.name}': a simulated surgeon makes mistakes only in a task with a ring to guide")
    progress("read CAD", 0.0)
    condition = None
    if haptics is not None:
        condition = Condition(haptics=haptics)
    robots, setup = _setup(scene, chosen, condition)
    with Scratch() as folder:
        # the session is recorded as one of a person, so that `twin session` can replay and check it
        file = Path(folder) / FILE
        run = session_run.perform(setup, file, seed=seed, scale=scale, mistake=mistake, progress=progress)
        recorded = file.read_bytes()
    return _session(setup, robots, run, "", seed, recorded=recorded)


def operate_machine(
    scene: Scene,
    *,
    seed: int = 0,
    triangles: int = 2,
    scale: float | None = None,
    running: Mapping[str, Address] | None = None,
    progress: Progress = silent,
) -> ConsoleSession:
    """Simulate a trainee who teleoperates the machines of a scene in real time, then rehearses a motion and replays it.

    The trainee rehearses in the model alone; the machine replays the recorded motion.

    Args:
        scene: a scene with machines.
        seed: random seed of the trainee.
        triangles: number of triangles that the trainee traces by teleoperation.
        scale: motion scale, 0.05 to 1; default: the motion scale of the console.
        running: {name of a place: address} of the machines that already run; the others start in child processes.
        progress: see `Progress`.

    Raises:
        TwinError: the scene has no machines, the scale is out of range, or a machine does not answer.
    """
    from twin.simulation.session import machine_run

    if scene.trainer is None:
        raise TwinError(f"scene '{scene.name}' has no machines: add a section [trainer] to {scene.file.name}")
    _require_scale(scale)
    if triangles < 1:
        raise TwinError(f"--trials {triangles}: the number of triangles must be at least 1")
    progress("read CAD", 0.0)
    robots, setup = _setup(scene, None, Condition(haptics=True))
    with Scratch() as folder, machines_of(scene, robots, running) as machines:
        file = Path(folder) / FILE
        run = machine_run.train(
            setup,
            machines.parts,
            machines.links,
            file,
            seed=seed,
            triangles=triangles,
            scale=scale,
            progress=progress,
        )
        recorded = file.read_bytes()
    return _session(setup, robots, run, "", seed, recorded=recorded, training=_training(setup, run))


def machines_of(scene: Scene, robots: Mapping[str, Robot], running: Mapping[str, Address] | None = None) -> Machines:
    """Connect to the machines of a scene, or start them; see `Machines`."""
    names = machine_scene.machines(scene)
    sources = {place.name: place.robot for place in scene.places}
    robots_of_machines = {name: robots[name] for name in names}
    return Machines(robots_of_machines, sources, running)


def _parts_of_machines(scene: Scene, robots: Mapping[str, Robot]) -> dict[str, Parts]:
    """Return {name of a place: compiled parts of its machine}; empty for a scene without machines."""
    parts = {}
    for name in machine_scene.machines(scene):
        parts[name] = machine_parts(robots[name])
    return parts


def _require_scale(scale: float | None) -> None:
    from twin.simulation.controllers.tool_following import SCALE_RANGE

    if scale is not None and not SCALE_RANGE[0] <= scale <= SCALE_RANGE[1]:
        raise TwinError(f"--scale {scale:g}: give {SCALE_RANGE[0]:g} to {SCALE_RANGE[1]:g} for a console")


def replay_session(
    path: str | Path, scene: Scene | str | Path | None = None, progress: Progress = silent
) -> ConsoleSession:
    """Replay a session in a new World, compare the replay bit by bit with the recording, and return the measures.

    The default scene is the built-in scene that the file names.

    Raises:
        WorldError: the file is damaged, or was recorded with another version of twin or in another scene.
        TwinError: there is no such scene, or the scene has no console.

    Examples:
        >>> from pathlib import Path
        >>> import twin
        >>> session = twin.operate_console("davinci", "touch")
        >>> _ = Path("hands.session").write_bytes(session.recorded)
        >>> twin.replay_session("hands.session").verdict
        'agree'
    """
    from twin.simulation.session import session_run
    from twin.simulation.session.session_file import read_session

    path = Path(path)
    session = read_session(path)
    head = session.head
    chosen_scene = scene_of_session(path, head.scene, scene)
    if head.task is not None and head.task not in chosen_scene.tasks:
        raise TwinError(f"{path}: scene '{chosen_scene.name}' has no task '{head.task}', the task of the session")
    task = None
    if head.task is not None:
        task = chosen_scene.tasks[head.task]
        _require_console(task)
    progress("read CAD", 0.0)
    robots, setup = _setup(chosen_scene, task, head.condition)
    # before the replay: of another scene, it would differ from the first sample on, without the reason
    session_run.require_scene(session, path, setup)
    run = session_run.replay(session, setup, progress, _parts_of_machines(chosen_scene, robots))
    measures_of_machines = _training(setup, run)
    return _session(setup, robots, run, str(path), head.seed, lost=session.lost, training=measures_of_machines)


def _session(
    setup: Setup,
    robots: Mapping[str, Robot],
    run: SessionRun,
    source: str,
    seed: int | None,
    *,
    lost: str = "",
    recorded: bytes | None = None,
    training: Sequence[Training] = (),
) -> ConsoleSession:
    """Return the result of a session with the measures of its task."""
    arms = _arms(setup, robots, run)
    task = setup.task
    outcome = None
    if task is not None:
        outcome = play_of(task).outcome(setup, task, run.recording, arms)
    return ConsoleSession(
        setup.scene, source, seed, task, run, arms, lost=lost, recorded=recorded, outcome=outcome, training=training
    )


def _training(setup: Setup, run: SessionRun) -> list[Training]:
    """Return the measures of the machines of a session."""
    table = setup.scene.trainer
    if table is None:
        return []
    measures_of_machines = []
    for name in table.robots:
        kin = setup.members[name].kin
        measures_of_machines.append(training.measure(run.recording, table, name, kin))
    return measures_of_machines


def _require_console(task: ConsoleTask) -> None:
    if not task.kind.console:
        raise TwinError(
            f"task '{task.name}' is a procedure: use `operate_procedure` and `replay_procedure` of twin.api.procedure"
        )


def _setup(scene: Scene, task: ConsoleTask | None, condition: Condition | None) -> tuple[dict[str, Robot], Setup]:
    """Return a console's robots and setup; props are read only with a `condition`, or if the task needs them."""
    robots = robots_at(console_scene.led_by(scene))
    members = members_of(robots)
    props_needed = condition is not None
    if task is not None and task.kind.props:
        props_needed = True
    props = None
    if props_needed:
        props = props_of(scene)
    return robots, Setup(scene, members, task, props, condition)


def _arms(setup: Setup, robots: Mapping[str, Robot], run: SessionRun) -> dict[str, ArmPath]:
    """Return {name of a place: motion of its robot}, computed from the robots' mechanisms."""
    table = console_scene.console_of(setup.scene)
    hands = console_scene.hands_of(setup.scene)
    arms: dict[str, ArmPath] = {}
    for place in console_scene.led_by(setup.scene):
        robot = robots[place.name]
        mechanism = robot.mechanism
        # the World records only joint values: the bodies follow from them by the loops of the mechanism
        q = run.recording[ROBOT_Q.of(place.name)]
        solver = robot.loops
        closed = solver.forward_many(q)
        is_closed = np.isfinite(closed.Ts_base_tool).all(axis=(1, 2))
        if not is_closed.all():
            first_open = int(np.flatnonzero(~is_closed)[0])
            t = run.recording.t[first_open]
            raise AssemblyError(f"{place.name}: its loops cannot be closed at {t:.3f} s of the session")
        links = solver.link_poses(q, closed.states)
        tip = mechanism.tool
        if table.tip is not None and place.name in hands:  # the robot of the camera keeps its own tool
            tip = table.tip
        frame = mechanism.frame(tip)
        Ts_world_tip = place.T_world_base @ links[frame.body] @ frame.T_body_frame
        arms[place.name] = ArmPath(place, mechanism, q, links, Ts_world_tip[:, :3, 3])
    return arms
