"""Shell commands that repeat a validation, or explain its result."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping
from pathlib import Path

from twin.core import assets
from twin.core.units import UM
from twin.kinematics import Kinematics
from twin.validation.rows import Tolerances

SECONDS = 60
"""Time limit in s of the proposed `explain` command; it allows a search for combinations of two edits."""


def commands(
    files: assets.RobotFiles, kin: Kinematics | None, protocol: str | Path, tolerances: Tolerances | None
) -> dict[str, str]:
    """Return the commands {"validate": ..., "explain": ...} to run in the current folder; "explain" needs equations.

    `kin`: the equations in the judged variants; None: the robot has no equations. `tolerances`: None means the
    tolerances of the CAD.
    """
    chosen = []
    if kin is not None:
        default = {e.name: e.default for e in kin.formula.equations}
        chosen = [w for n, v in kin.variants.items() if v != default[n] for w in ("--variant", f"{n}={v}")]
    if tolerances is not None:
        chosen += ["--tolerance-um", f"{tolerances.position / UM:g}"]
    name = [_word(files)]
    out = {"validate": shlex.join(["twin", "validate", *name, "--protocol", str(protocol), *chosen])}
    if kin is not None:
        out["explain"] = shlex.join(["twin", "explain", *name, *chosen, "--seconds", str(SECONDS)])
    return out


def again(robot: str, protocol: str, variants: Mapping[str, str]) -> str:
    """Return the command that repeats a validation, from the names of robot, protocol and variants."""
    chosen = [w for n, v in variants.items() for w in ("--variant", f"{n}={v}")]
    return shlex.join(["twin", "validate", robot, "--protocol", protocol, *chosen])


def _word(files: assets.RobotFiles) -> str:
    """Return the robot's command-line argument: its name if it is built in, otherwise its folder."""
    if files.cad == assets.data_folder() / "cad" / files.name:
        return files.name
    folder = files.cad.parent
    return os.path.relpath(folder) if folder.is_relative_to(Path.cwd()) else str(folder)
