"""Check whether a robot's USD stage equals a new stage built from the robot's CAD and protocols."""

from __future__ import annotations

import filecmp
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from twin.api import exports
from twin.api.robot import Robot
from twin.api.robot_loading import loaded
from twin.core.atomic import Scratch
from twin.core.errors import TwinError
from twin.core.findings import Finding, disagreement
from twin.core.json_types import JsonMapping
from twin.core.progress import Progress, silent
from twin.core.result import Part, Result


@dataclass(frozen=True)
class StageCheck(Result):
    """Comparison of a USD stage with a new build.

    Attributes:
        folder: folder of the stage.
        fresh: number of files of the new build.
        differing: files of the new build that the stage lacks or has with other content.
        unexpected: files that are not in the new build.
        command: command line that rebuilds the stage.
    """

    kind: ClassVar[str] = "build"
    folder: Path
    fresh: int
    differing: tuple[str, ...]
    unexpected: tuple[str, ...]
    command: str

    @property
    def findings(self) -> list[Finding]:
        """One finding for each file that differs or is unexpected."""
        suggestion = f"rebuild the stage with: {self.command}"
        findings: list[Finding] = []
        for name in self.differing:
            text = f"{name} differs from a new build"
            findings.append(disagreement("build.differs", name, text, suggestion=suggestion))
        for name in self.unexpected:
            text = f"{name} is not part of a new build"
            findings.append(disagreement("build.unexpected", name, text, suggestion=suggestion))
        return findings

    def content(self) -> JsonMapping:
        """Return {"differing": file names, "unexpected": file names}."""
        return {"differing": self.differing, "unexpected": self.unexpected}

    def text(self) -> Iterator[Part]:
        """Yield the verdict, then the files."""
        if self.verdict == "agree":
            yield f"  {self.folder} is current: {self.fresh} files equal a new build"
            return
        yield f"  {self.folder} is not current. Rebuild it with: {self.command}"
        for name in self.differing:
            yield f"    differs: {name}"
        for name in self.unexpected:
            yield f"    unexpected: {name}"


def check_build(
    robot: Robot | str | Path, folder: Path | None = None, word: str = "", progress: Progress = silent
) -> StageCheck:
    """Compare a robot's USD stage with a new build in a temporary folder.

    The default folder is the robot's own stage. `word` is the name of the robot in the rebuild command.

    Raises:
        TwinError: the robot was loaded from a stage, or cannot be built.
    """
    robot = loaded(robot)
    if robot.files is None:
        raise TwinError(f"{robot.name} was loaded from {robot.source.kind}: there is no CAD to build from")
    current = folder or robot.files.usd
    with Scratch() as work:
        new_files = exports.build(robot, Path(work), progress=progress)
        new_names = [path.relative_to(work) for path in new_files]
        differing = []
        for name in new_names:
            if not _same(Path(work) / name, current / name):
                differing.append(str(name))
    unexpected = []
    for path in current.rglob("*.usd*"):  # textures and notes of the user may be beside the layers
        name = path.relative_to(current)
        if name not in new_names:
            unexpected.append(str(name))
    command = f"twin build {word or robot.name}"
    return StageCheck(current, len(new_names), tuple(differing), tuple(unexpected), command)


def _same(fresh_file: Path, current_file: Path) -> bool:
    """Return whether two files have equal bytes or, except for rounding errors of the processors, equal USD content."""
    if not current_file.is_file():
        return False
    if filecmp.cmp(fresh_file, current_file, shallow=False):
        return True
    from pxr import Tf

    from twin.usd.same import same_layer

    try:
        return same_layer(fresh_file, current_file)
    except Tf.ErrorException:  # not a USD layer
        return False
