"""Check whether a robot's USD stage equals a new stage built from the robot's CAD and protocols."""

from __future__ import annotations

import filecmp
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from twin.api import make
from twin.api.robot import Progress, Robot, silent
from twin.core.atomic import Scratch
from twin.core.errors import TwinError
from twin.core.findings import Finding, disagreement
from twin.core.json_types import JsonMapping
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
        way = f"rebuild the stage with: {self.command}"
        told = {"differs": "differs from a new build", "unexpected": "is not part of a new build"}
        return [
            disagreement(f"build.{code}", name, f"{name} {told[code]}", suggestion=way)
            for code, names in (("differs", self.differing), ("unexpected", self.unexpected))
            for name in names
        ]

    def content(self) -> JsonMapping:
        """Return {"differing": file names, "unexpected": file names}."""
        return {"differing": self.differing, "unexpected": self.unexpected}

    def text(self) -> Iterator[Part]:
        """Yield the verdict, then the files."""
        if self.verdict == "agree":
            yield f"  {self.folder} is current: {self.fresh} files equal a new build"
            return
        yield f"  {self.folder} is not current. Rebuild it with: {self.command}"
        yield from (f"    differs: {n}" for n in self.differing)
        yield from (f"    unexpected: {n}" for n in self.unexpected)


def check_build(robot: Robot, folder: Path | None = None, word: str = "", progress: Progress = silent) -> StageCheck:
    """Compare a robot's USD stage with a new build in a temporary folder.

    The default folder is the robot's own stage. `word` is the name of the robot in the rebuild command.

    Raises:
        TwinError: the robot was loaded from a stage, or cannot be built.
    """
    if robot.files is None:
        raise TwinError(f"{robot.name} was loaded from a USD stage: there is no CAD to build from")
    current = folder or robot.files.usd
    with Scratch() as work:
        fresh = make.build(robot, Path(work), progress=progress)
        names = [p.relative_to(work) for p in fresh]
        differing = tuple(str(n) for n in names if not _same(Path(work) / n, current / n))
    found = (p.relative_to(current) for p in current.rglob("*.usd*"))
    extra = tuple(str(p) for p in found if p not in names)
    return StageCheck(current, len(names), differing, extra, f"twin build {word or robot.name}")


def _same(a: Path, b: Path) -> bool:
    """Return whether two files have equal bytes or, except for rounding errors of the processors, equal USD content."""
    if not b.is_file():
        return False
    if filecmp.cmp(a, b, shallow=False):
        return True
    from pxr import Tf

    from twin.usd.same import same_layer

    try:
        return same_layer(a, b)
    except Tf.ErrorException:  # not a USD layer
        return False
