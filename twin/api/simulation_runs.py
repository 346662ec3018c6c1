"""Run simulations: trials of an operator with one robot, or the protocols of all robots of a scene together."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from twin.api.protocol_plan import plan
from twin.api.robot import Robot
from twin.api.robot_loading import loaded
from twin.api.scene_loading import as_scene
from twin.api.scene_parts import anatomy_of, props_of, robots_at
from twin.core.errors import TwinError
from twin.core.progress import Progress, silent

if TYPE_CHECKING:
    from twin.model.scene import Scene
    from twin.planning.protocol import Protocol
    from twin.simulation.controllers.jacobian_step import Solver
    from twin.simulation.controllers.teleoperation import Clutch
    from twin.simulation.operator_trials import Operated
    from twin.simulation.scene_play import Actor, Played
    from twin.simulation.world import World


def operate(
    robot: Robot | str | Path,
    protocol: str | Path | Protocol | None = None,
    *,
    trials: int = 1,
    seed: int = 0,
    clutch: Clutch = "corrected",
    scale: float = 0.1,
    solver: Solver = "damped",
    progress: Progress = silent,
) -> Operated:
    """Simulate an operator (handle, clutch pedal) who performs a protocol; hand motion and gains are ASSUMED.

    Args:
        robot: a robot with equations, its name or its folder.
        protocol: a protocol with an insertion; default: the robot's default protocol.
        trials: number of trials, with the seeds seed, seed + 1, ...
        seed: seed of the first trial; the same seed gives the same hand motion.
        clutch: equation of the clutch, eq. (7) of the paper on the SHER simulation: "printed" or "corrected".
        scale: ratio of tool translation to handle translation; rotations are not scaled.
        solver: solver that computes the joint motion of each time step, "damped" or "slsqp".
        progress: see `Progress`.

    Raises:
        TwinError: the protocol has no insertion, `trials` is below 1, or `scale` is not above 0 and finite.
        KinematicsError: the robot cannot reach the end pose of a phase.

    Examples:
        >>> import twin
        >>> operated = twin.operate("sher", "phantom")
        >>> operated.verdict
        'agree'
    """
    from twin.planning.protocol import Protocol
    from twin.simulation.operator_trials import run_trials

    if trials < 1:
        raise TwinError(f"--trials {trials}: the number must be at least 1")
    if not 0 < scale < float("inf"):
        raise TwinError(f"--scale {scale:g}: the scale must be above 0 and finite")
    robot = loaded(robot)
    if not isinstance(protocol, Protocol):
        protocol = robot.protocol(protocol)
    progress("read CAD", 0.0)
    kin = robot.kinematics()
    mechanism = robot.mechanism
    return run_trials(robot.name, kin, mechanism, protocol, trials, seed, clutch, scale, solver, progress)


def world(scene: Scene | str | Path, dt: float = 1e-3, progress: Progress = silent) -> World:
    """Return a World in which every robot of a scene plays its protocol, with the props and organs.

    The time step of the organs is the multiple of `dt` nearest to 8 ms.

    Args:
        scene: a scene, its name or its path.
        dt: time step in s.
        progress: see `twin.api.Progress`.

    Raises:
        TwinError: a protocol cannot be planned.
        WorldError: the scene has organs, and either `dt` is above 20 ms or a link starts inside an organ.

    Examples:
        >>> import twin
        >>> world = twin.world("vsrs")
        >>> world.dt
        0.001
    """
    from twin.simulation import scene_play, tissue_scene
    from twin.simulation.plants.tissue import Tissues
    from twin.simulation.plants.tissue.organs import PERIOD

    scene = as_scene(scene)
    actors = _actors(scene, progress, at_ports=False)
    organs = None
    anatomy = anatomy_of(scene)
    if anatomy is not None:
        mechanisms = {}
        q_start = {}
        for actor in actors:
            mechanisms[actor.place.name] = actor.mechanism
            q_start[actor.place.name] = actor.trajectory.q[0]
        links = tissue_scene.links(scene, mechanisms, q_start)
        # organs are computed less often than robots: a step of them takes many times as long
        ticks = max(1, round(PERIOD / dt))
        organs = Tissues(tissue_scene.tissues(scene, anatomy), links, ticks * dt)
    return scene_play.world(actors, props_of(scene), dt, organs)


def play(scene: Scene | str | Path, progress: Progress = silent) -> Played:
    """Play the protocols of all robots of a scene together, and check clearances and trocar errors at the ports.

    `scene` is a scene, its name or its path.

    Raises:
        TwinError: a protocol cannot be planned, or the scene assigns a port to a trocar that the robot lacks.

    Examples:
        >>> import twin
        >>> twin.play("vsrs").verdict
        'agree'
    """
    from twin.simulation import scene_play

    # planning and playing are shown as the two halves of one progress
    def planned(label: str, fraction: float) -> None:
        progress(label, fraction / 2)

    def played(label: str, fraction: float) -> None:
        progress(label, 0.5 + fraction / 2)

    scene = as_scene(scene)
    actors = _actors(scene, planned)
    return scene_play.play(scene, actors, props_of(scene), played)


def _actors(scene: Scene, progress: Progress, *, at_ports: bool = True) -> list[Actor]:
    """Return the robots of a scene with their trajectories and, if `at_ports` is True, their trocar positions."""
    from twin.simulation.scene_play import Actor, trocars_of

    scene.require_protocols()
    actors = []
    robots = robots_at(scene.places)
    for i, place in enumerate(scene.places):
        progress(f"plan {place.name}", i / len(scene.places))
        robot = robots[place.name]
        protocol = robot.protocol(place.protocol)
        trajectory = plan(robot, protocol)
        mechanism = robot.bound(protocol).mechanism
        trocars = {}
        if at_ports:
            trocars = trocars_of(place, mechanism, trajectory)
        actors.append(Actor(place, mechanism, trajectory, trocars))
    return actors
