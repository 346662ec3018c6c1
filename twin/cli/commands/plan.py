"""`twin plan`: plan the timed motion of a protocol, or of several robots of a scene at once."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli.parser import Command
from twin.core.errors import TwinError
from twin.core.units import MM

if TYPE_CHECKING:
    from twin.api import Robot
    from twin.planning.rounds import SearchRounds

EXAMPLES = """\
  twin plan sils
  twin plan sils lowered_patient --out plan/
  twin plan sils --check             judge the timing by toppra
  twin plan pa10 --inverse points    joint values by the published optimisation of elbow and wrist
  twin plan pa10 --avoid vsrs        around the props and the other robots of a scene, outside the patient
  twin plan davinci_psm around/withdraw --avoid davinci --with psm2=around/across --clearance-mm 2  two arms at once"""

_COST = "path_cost.png"
"""File name of the plot of path cost against number of samples, for the searches of paths around obstacles."""

_DISTANCES = "clearance.png"
"""File name of the plot of the distances between arms over time."""

_CLEARANCE = 5.0
"""Default of --clearance-mm."""


def arguments(command: Command) -> None:
    """Add the arguments of `twin plan`."""
    command.robot()
    command.protocol()
    command.timing()
    text = (
        "what gives the joint values: the equations in closed form, or the published Levenberg-Marquardt optimisation "
        "of points of the arm (pa10: elbow and wrist)"
    )
    command.choice("--inverse", ("equations", "points"), text, "equations")
    text = "judge the timing by the other solver (toppra, unless it made the plan): durations, and limits at its grid"
    command.flag("--check", text)
    text = (
        "plan phases of the types joints, positioning and home around obstacles: props and other robots of a scene; "
        "without a scene, the robot's own bodies"
    )
    command.text("--avoid", "SCENE", text, nargs="?", const="")
    command.text(
        "--with",
        "ROBOT=PROTOCOL",
        "with --avoid SCENE: also plan these robots of the scene, as pairs separated by commas. The n-th phases of all "
        "protocols begin and end together. Robots are planned in the given order: each avoids the earlier ones, which "
        "may wait for it. view, serve and export open the folder of the plan",
        dest="beside",
    )
    command.number("--clearance-mm", "MM", "with --avoid: required minimum distance between bodies", _CLEARANCE)
    command.seed("with --avoid: seed of the random search")
    command.out("./twin-out/<robot>/<protocol>/, with --with ./twin-out/<scene>/<robots>/")


def run(args: argparse.Namespace) -> int:
    """Plan the timed motion of a protocol, or of several robots; print phases and findings; write CSV and JSON."""
    from twin import api
    from twin.cli import show
    from twin.core import assets
    from twin.planning.plan_result import FILES, Planned
    from twin.planning.protocol.free_motions import with_free_motions

    if args.avoid is None:
        stated = (("--clearance-mm", args.clearance_mm, _CLEARANCE, "g"), ("--seed", args.seed, 0, "d"))
        for name, value, usual, notation in stated:
            if value != usual:
                raise TwinError(f"{name} {value:{notation}} has no effect without --avoid: add --avoid, or omit {name}")
    robot = api.load(args.robot).with_timing(args.timing).with_inverse(args.inverse)
    if args.beside is not None:
        if args.check:
            raise TwinError("--check judges the plan of one robot: omit --with")
        return _together(robot, args)
    protocol = robot.protocol(args.protocol)
    if args.avoid is not None:
        protocol = with_free_motions(protocol, args.avoid, args.clearance_mm * MM, args.seed)
    folder = show.folder(args, robot.name, protocol.name)
    with show.progress(args.quiet or args.json) as progress:
        trajectory = api.plan(robot, protocol, progress)
        if args.check:
            planned = api.check_plan(robot, trajectory, protocol)
        else:
            planned = Planned(trajectory)
    with assets.atomic_folder(folder) as work:
        planned.write(work)
        pictures = _plot_rounds(f"{robot.name} on {protocol.name}", planned.rounds, work)
    return show.finish(planned, args, folder, [FILES[0], *pictures])


def _plot_rounds(what: str, searches: Mapping[str, SearchRounds], folder: Path) -> list[str]:
    """Plot the path cost in each round of the path searches, if there are any; return the written file names."""
    if not searches:
        return []
    from twin.ui.report import figure_output, search_figures

    (folder / _COST).write_bytes(figure_output.png(search_figures.figure(f"Paths around obstacles · {what}", searches)))
    return [_COST]


def _together(robot: Robot, args: argparse.Namespace) -> int:
    """Plan several robots of a scene at once (`plan --avoid SCENE --with ROBOT=PROTOCOL`)."""
    from twin import api
    from twin.cli import show
    from twin.core import assets

    if not args.avoid:
        raise TwinError("--with: name the scene in which all robots stand, such as --avoid raven")
    scene = api.load_scene(args.avoid)
    places = {place.name: place.robot for place in scene.places}
    arms = {robot.name: (robot, robot.protocol(args.protocol))}
    for text in args.beside.split(","):
        name, _, chosen = text.strip().partition("=")
        if name in arms:
            raise TwinError(f"--with {name}: this robot is given twice; give each robot once, by its name in the scene")
        if name not in {*places, *places.values()}:
            raise TwinError(f"--with '{name}': scene '{scene.name}' has no such robot; it has: {', '.join(places)}")
        # a name may be that of a place, whose robot may have another name
        robot_beside = api.load(places.get(name) or name).with_timing(args.timing)
        arms[name] = robot_beside, robot_beside.protocol(chosen or None)
    folder = show.folder(args, scene.name, "_".join(arms))
    with show.progress(args.quiet or args.json) as progress:
        planned = api.plan_together(args.avoid, arms, args.clearance_mm * MM, args.seed, progress)
    from twin.ui.report import figure_output, together_figures

    with assets.atomic_folder(folder) as work:
        planned.write(work)
        (work / _DISTANCES).write_bytes(figure_output.png(together_figures.figure(planned)))
        pictures = _plot_rounds(f"scene {scene.name}", planned.rounds, work)
    code = show.finish(planned, args, folder, [*planned.files(), _DISTANCES, *pictures])
    if not args.json:
        print(f"\n  Play the plan: twin view {shlex.quote(str(folder))}; other commands: serve, export")
    return code
