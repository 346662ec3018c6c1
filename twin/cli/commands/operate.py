"""`twin operate`: simulate an operator (hands, pedals) at a robot or a console, with the measures of a user study."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli.parser import Command
from twin.core.entry_points import names
from twin.core.errors import TwinError

if TYPE_CHECKING:
    from twin.model.scene import Scene

_SCALE = 0.1
"""Default motion scale of a robot's operator; a console has another default."""

EXAMPLES = """\
  twin operate sher phantom
  twin operate sher phantom --trials 5 --seed 10 --json
  twin operate sher phantom --clutch printed      the published clutch, with which the tool jumps
  twin operate sils lowered_patient --scale 0.5
  twin operate davinci --seed 3       a surgeon with two hands, clutch and camera at a scene's console
  twin operate davinci --task pegboard      rings from pegs to pegs, held by friction
  twin operate raven_dome                   a ring handed over and guided along a wire
  twin operate vsrs --task cholecystectomy  a gallbladder taken out in five stages
  twin operate raven --trials 3       machines by teleoperation, then a motion rehearsed in their models"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin operate`."""
    command.robot("a built-in robot, the path of a robot folder, or a scene with a task")
    command.protocol()
    keys = ", ".join(names("twin.simulation.tasks", "twin.tasks"))
    command.text("--task", "NAME", f"task of a scene (default: its first task); a task has one of the keys {keys}")
    mistakes = "clip_missed, wrong_vessel, organ_punctured, cut_outside, bed_left"
    guided = "dropped, not_handed_over, stopped_short, wire_touched, wall_hit, left_inside"
    text = f"mistake that the surgeon makes. In a procedure: {mistakes}; with a ring to guide: {guided}"
    command.text("--mistake", "NAME", text)
    command.choice("--haptics", ("on", "off"), "compute forces on the hands, to which the operator does not react")
    command.out("./twin-out/<robot>/<protocol>-operator/")
    command.seed("random seed of the first trial; each further trial has the next seed")
    command.integer("--trials", "number of trials; with machines, number of triangles to trace", 1)
    command.machines()
    text = (
        "ratio of tool motion to hand motion (default 0.1, ASSUMED, because the paper states none; at a console the "
        "scene's scale); rotations are not scaled"
    )
    command.number("--scale", "S", text)
    text = "clutch of the SHER simulation paper, eq. (7): corrected (default), or as printed"
    command.choice("--clutch", ("corrected", "printed"), text, "corrected")
    command.choice(
        "--solver", ("damped", "slsqp"), "solver of the joint motion in each time step (default damped)", "damped"
    )


def run(args: argparse.Namespace) -> int:
    """Simulate the operator and print the measures; write JSON, CSV and a picture.

    The exit code is 1 if a goal was not reached.
    """
    from twin import api
    from twin.cli import show
    from twin.core import assets

    file = assets.scene_file(args.robot)
    if file is not None:
        return _at_console(file, args)
    if args.haptics is not None:
        raise TwinError(f"--haptics applies to the console of a scene; {args.robot} is a robot")
    if args.task is not None:
        raise TwinError(f"--task applies to a scene; {args.robot} is a robot: give a protocol instead")
    if args.mistake is not None:
        raise TwinError(f"--mistake requires a scene with a procedure or a ring to guide; {args.robot} is a robot")
    if args.machine:
        raise TwinError(f"--machine applies to a scene with machines, such as raven; {args.robot} is a robot")
    robot = api.load(args.robot)
    protocol = robot.protocol(args.protocol)
    folder = show.folder(args, robot.name, f"{protocol.name}-operator")
    with show.progress(args.quiet or args.json) as progress:
        operated = api.operate(
            robot,
            protocol,
            trials=args.trials,
            seed=args.seed,
            clutch=args.clutch,
            scale=_SCALE if args.scale is None else args.scale,
            solver=args.solver,
            progress=progress,
        )
    return show.store(operated, args, folder)


def _at_console(file: Path, args: argparse.Namespace) -> int:
    """Simulate a surgeon at a console, a trainee at machines, or a surgeon in a procedure, as the scene requires.

    Write the session, and the same files as `twin session --out`.
    """
    from twin import api
    from twin.api.console_runs import FILE, operate_console
    from twin.cli import show
    from twin.simulation.session.session_run import task_of

    if args.protocol is not None:
        raise TwinError(f"{args.robot} is a scene: give a task by --task instead of the protocol '{args.protocol}'")
    scene = api.load_scene(file)
    if scene.trainer is not None and args.task is None:
        return _machine(scene, args)
    if args.machine:
        raise TwinError(
            f"--machine requires a scene with a section [trainer] in {file.name}, and cannot be used with --task"
        )
    # an option without effect is refused: the measures would be taken for those of the option
    for option, default in (("trials", 1), ("clutch", "corrected"), ("solver", "damped")):
        if getattr(args, option) != default:
            raise TwinError(
                f"--{option} can be used only with a single robot; options for a scene with a console are --task, "
                "--seed, --scale, --haptics and --mistake"
            )
    task = task_of(scene, args.task)
    folder = show.folder(args, scene.name, f"{task.name}-operator")
    if not task.kind.console:
        return _procedure(scene, task.name, folder, args)
    if args.mistake is not None and not task.kind.mistakes:
        raise TwinError(f"--mistake applies to a procedure or a ring to guide; task '{task.name}' is neither")
    with show.progress(args.quiet or args.json) as progress:
        haptics = None
        if args.haptics is not None:
            haptics = args.haptics == "on"
        session = operate_console(
            scene,
            task.name,
            seed=args.seed,
            scale=args.scale,
            haptics=haptics,
            mistake=args.mistake or "",
            progress=progress,
        )
    return show.store(session, args, folder, [FILE])


def _machine(scene: Scene, args: argparse.Namespace) -> int:
    """Simulate a trainee who teleoperates the machines of a scene; write the session and the report."""
    from twin.api.console_runs import FILE, operate_machine
    from twin.cli import show
    from twin.cli.machines import running

    defaults = {"haptics": None, "mistake": None, "clutch": "corrected", "solver": "damped"}
    for option, default in defaults.items():
        if getattr(args, option) != default:
            raise TwinError(
                f"--{option} does not apply to machines; their options are --seed, --trials, --scale, --machine"
            )
    folder = show.folder(args, scene.name, "machine-operator")
    with show.progress(args.quiet or args.json) as progress:
        session = operate_machine(
            scene,
            seed=args.seed,
            triangles=args.trials,
            scale=args.scale,
            running=running(args.machine),
            progress=progress,
        )
    return show.store(session, args, folder, [FILE])


def _procedure(scene: Scene, task: str, folder: Path, args: argparse.Namespace) -> int:
    """Simulate a surgeon who performs a procedure; write the session and the report."""
    from twin.api.procedure import operate_procedure
    from twin.cli import show
    from twin.simulation.session.session_file import NAME

    for option in ("scale", "haptics"):
        if getattr(args, option) is not None:
            raise TwinError(
                f"--{option} applies to a console; the options of a procedure are --task, --seed, --mistake"
            )
    with show.progress(args.quiet or args.json) as progress:
        session = operate_procedure(scene, task, seed=args.seed, mistake=args.mistake or "", progress=progress)
    return show.store(session, args, folder, [NAME])
