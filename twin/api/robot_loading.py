"""Robots by their names, and from paths: a robot folder, a USD stage or a description file."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path

from twin.api.robot import Robot
from twin.api.robot_source import RobotSource
from twin.core import assets
from twin.core.errors import TwinError
from twin.core.foreign.admit import admit
from twin.core.foreign.budget import STAGE_SUFFIXES


def names() -> list[str]:
    """Return the names of the built-in robots.

    Examples:
        >>> import twin
        >>> "sils" in twin.names()
        True
    """
    return assets.names()


def loaded(robot: Robot | str | Path) -> Robot:
    """Return a robot that is given as such, by name or by path; the functions of the API take all three."""
    if isinstance(robot, Robot):
        return robot
    return load(robot)


def _is_described(path: Path) -> bool:
    """Return whether a path is that of a description file, not of a USD stage, a robot folder or a built-in robot."""
    suffix = path.suffix.lower()
    if not suffix or suffix in STAGE_SUFFIXES or path.is_dir():
        return False
    from twin.exchange.formats import import_formats

    return any(suffix in format.sources for format in import_formats())


def load(
    robot: str | Path,
    *,
    variants: Mapping[str, str] | str | None = None,
    parameters: Mapping[str, float] | None = None,
    tool: str | None = None,
    xacro: object = None,
    dh: str | None = None,
    units: str | None = None,
) -> Robot:
    """Load a robot by its name, folder, USD stage or description file.

    Args:
        robot: the name of a built-in robot, or the path of a robot folder, of a USD stage, or of a file in a format
            that `twin new` reads (URDF, MJCF, SDF, xacro, DH table). A stage or file gives a mechanism without
            equations: `forward`, `inverse` and `jacobian` are those of the mechanism.
        variants: {equation: variant}, or one name for all equations; default: the default of each equation.
        parameters: {name: value in SI} that replace published values in the equations.
        tool: frame or body of a stage or file to use as tool; default: the tool that it names, else the end of its
            longest chain.
        xacro: arguments and package folders, for a xacro: a `twin.exchange.xacro.XacroSettings`.
        dh: convention of a table of Denavit-Hartenberg parameters, if the table does not state it: "standard",
            "modified", "khalil" or "hayati".
        units: units of such a table, as "mm,deg", if the table does not state them.

    Raises:
        TwinError: there is no such robot or file, or `tool` is given for a robot whose description names its tool.

    Examples:
        >>> import twin
        >>> twin.load("sils").joints
        ('q1', 'q2', 'q3', 'q4', 'q5', 'q6')
    """
    path = Path(robot)
    if _is_described(path):
        # by name: who loads robots with equations, as `twin validate` does, loads nothing that reads other formats
        described = import_module("twin.api.imported_file").imported_file(path, tool, xacro, dh, units)
        return Robot(RobotSource(described=described), variants, dict(parameters or {}))
    if xacro is not None or dh is not None or units is not None:
        raise TwinError(f"{robot}: xacro, dh and units are for a description file, such as arm.xacro or arm.csv")
    if path.suffix in STAGE_SUFFIXES:
        if not path.is_file():
            raise TwinError(f"{path}: the stage does not exist")
        admit(path)  # before USD opens it in this process: a malformed stage may crash or fill the memory
        return Robot(RobotSource(stage=path, tool=tool), variants, dict(parameters or {}))
    if tool is not None:
        raise TwinError(f"{robot} is neither a USD stage nor a description file: its tool is set in its description")
    files = assets.files(robot)
    hidden_folder = assets.hidden(robot)
    if hidden_folder is not None:
        logging.getLogger(__name__).warning(
            "'%s' is the built-in robot; for the robot in the folder %s write ./%s", robot, hidden_folder, robot
        )
    return Robot(RobotSource(files=files), variants, dict(parameters or {}))
