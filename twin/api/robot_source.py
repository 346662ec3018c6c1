"""Name or path by which other processes load the same robot."""

from __future__ import annotations

from pathlib import Path

from twin.api.robot import Robot, names
from twin.core import assets
from twin.core.errors import TwinError


def robot_source(robot: Robot | str | Path) -> str:
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
    found: list[str] = []
    if robot.changed is not None:
        found.append("the mechanism")
    if robot.equations is not None:
        found.append("the formula")
    if robot.chosen_variants:
        found.append("the variants of the equations")
    if robot.parameters:
        found.append(f"the parameters {', '.join(robot.parameters)}")
    if robot.trocars:
        found.append(f"the trocars {', '.join(robot.trocars)}")
    if robot.timing is not None:
        found.append(f"the timing '{robot.timing}'")
    if robot.inverse_by != "equations":
        found.append(f"the inverse by {robot.inverse_by}")
    for option in robot.source.options:
        found.append(f"the option {option} of twin.load")
    return found
