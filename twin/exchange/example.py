"""Copies of the examples of a user's robot, as a beginning."""

from __future__ import annotations

import shutil
from pathlib import Path

from twin.core import assets
from twin.core.errors import TwinError, unknown
from twin.exchange.read.robot_folder import require_free

_COPIED = ("cad/*.toml", "cad/*.step", "trajectories/*.toml", "formula.py")
"""Files of a robot folder; programs that draw its STEP, and the stage built from it, are not copied."""


def copy_example(name: str, target: Path, force: bool = False) -> list[Path]:
    """Copy an example into a robot folder.

    Args:
        name: name of the example, see `assets.examples`.
        target: a new or empty folder.
        force: whether files of a robot folder are overwritten.

    Returns:
        The files written.

    Raises:
        TwinError: there is no such example.
        OutputError: `target` is a file, or a folder that must not be overwritten.
    """
    examples = assets.examples()
    if name not in examples:
        raise TwinError(unknown("example", name, examples))
    require_free(target, force)
    source = examples[name]
    written = []
    with assets.atomic_folder(target) as work:
        for pattern in _COPIED:
            for file in sorted(source.glob(pattern)):
                relative = file.relative_to(source)
                (work / relative).parent.mkdir(exist_ok=True)
                shutil.copyfile(file, work / relative)
                written.append(target / relative)
    return written
