"""The command lines that make a judgement again, and that look further into it."""

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
"""What `explain` is given for the search for two edits when a short search has found nothing."""


def commands(
    files: assets.RobotFiles, kin: Kinematics | None, protocol: str | Path, tolerances: Tolerances | None
) -> dict[str, str]:
    """Return the command lines "validate" and "explain" of a judgement, to be run from the present folder.

    Args:
        files: of the robot.
        kin: the equations in the variants that were judged; None: there are none to explain.
        protocol: name or path of the protocol.
        tolerances: what was asked for; None: what the CAD gives.
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
    """Return the command line of a judgement of which only names are known."""
    chosen = [w for n, v in variants.items() for w in ("--variant", f"{n}={v}")]
    return shlex.join(["twin", "validate", robot, "--protocol", protocol, *chosen])


def _word(files: assets.RobotFiles) -> str:
    """Return how the command line names a robot: a built-in one by its name, another by its folder."""
    if files.cad == assets.data_folder() / "cad" / files.name:
        return files.name
    folder = files.cad.parent
    return os.path.relpath(folder) if folder.is_relative_to(Path.cwd()) else str(folder)
