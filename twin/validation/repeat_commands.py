"""Shell commands that repeat a validation, or explain its result."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from twin.core import assets
from twin.core.units import UM
from twin.kinematics import Kinematics
from twin.validation.residual_rows import Tolerances

EXPLAIN_TIME_LIMIT = 60
"""Time limit in s of the proposed `explain` command; it allows a search for combinations of two edits."""


def commands(
    files: assets.RobotFiles, kin: Kinematics | None, protocol: str | Path, tolerances: Tolerances | None
) -> dict[str, str]:
    """Return the commands {"validate": ..., "explain": ...} to run in the current folder; "explain" needs equations.

    `kin`: the equations in the judged variants; None: the robot has no equations. `tolerances`: None means the
    tolerances of the CAD.
    """
    changed: dict[str, str] = {}
    if kin is not None:
        default = {equation.name: equation.default for equation in kin.formula.equations}
        for name, variant in kin.variants.items():
            if variant != default[name]:
                changed[name] = variant
    tolerance_options: list[str] = []
    if tolerances is not None:
        tolerance_options = ["--tolerance-um", f"{tolerances.position / UM:g}"]
    robot = _robot_argument(files)
    commands_by_name = {"validate": validate_command(robot, str(protocol), changed, tolerance_options)}
    if kin is not None:
        options = [*_variant_options(changed), *tolerance_options, "--seconds", str(EXPLAIN_TIME_LIMIT)]
        commands_by_name["explain"] = shlex.join(["twin", "explain", robot, *options])
    return commands_by_name


def validate_command(
    robot: str, protocol: str, variants: Mapping[str, str], further_options: Sequence[str] = ()
) -> str:
    """Return the command that repeats a validation, from the names of robot, protocol and variants."""
    options = [*_variant_options(variants), *further_options]
    return shlex.join(["twin", "validate", robot, "--protocol", protocol, *options])


def _variant_options(variants: Mapping[str, str]) -> list[str]:
    options: list[str] = []
    for name, variant in variants.items():
        options += ["--variant", f"{name}={variant}"]
    return options


def _robot_argument(files: assets.RobotFiles) -> str:
    """Return the robot's command-line argument: its name if it is built in, otherwise its folder."""
    if files.cad == assets.data_folder() / "cad" / files.name:
        return files.name
    folder = files.cad.parent
    if folder.is_relative_to(Path.cwd()):
        return os.path.relpath(folder)
    return str(folder)
