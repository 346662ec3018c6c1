"""Name or path by which other processes load the same robot."""

from __future__ import annotations

from pathlib import Path

from twin.api.robot import Robot
from twin.api.robot_loading import names
from twin.core import assets
from twin.core.errors import TwinError


def name_or_path(robot: Robot | str | Path) -> str:
    """Return the name or path by which other processes load a robot.

    Raises:
        TwinError: the robot is not as its files describe it, so that other processes would load another one.
    """
    if isinstance(robot, Robot):
        differences = _differences(robot)
        if differences:
            raise TwinError(
                f"{robot.name} differs from its files, by which other processes load it, in: "
                f"{', '.join(differences)}. Write it as a robot folder, or give the robot by its name or path"
            )
        if robot.files is None:
            if robot.source.path is None:
                return robot.name
            return str(robot.source.path.resolve())
        # a folder may have the name of a built-in robot
        if robot.name in names() and robot.files.cad == assets.files(robot.name).cad:
            return robot.name
        return str(robot.files.cad.parent)
    if Path(robot).exists():
        return str(Path(robot).resolve())
    return str(robot)


def _differences(robot: Robot) -> list[str]:
    """Return what makes a robot differ from the one that `twin.load` returns for its name or path alone.

    Masses that the files give are not named: who needs them weighs the robot that is loaded.
    """
    differences: list[str] = []
    if robot.given_mechanism is not None:
        differences.append("the mechanism")
    if robot.given_formula is not None:
        differences.append("the formula")
    if robot.chosen_variants:
        differences.append("the variants of the equations")
    if robot.parameters:
        differences.append(f"the parameters {', '.join(robot.parameters)}")
    if robot.trocars:
        differences.append(f"the trocars {', '.join(robot.trocars)}")
    if robot.timing is not None:
        differences.append(f"the timing '{robot.timing}'")
    if robot.inverse_by != "equations":
        differences.append(f"the inverse by {robot.inverse_by}")
    for option in robot.source.options:
        differences.append(f"the option {option} of twin.load")
    return differences
