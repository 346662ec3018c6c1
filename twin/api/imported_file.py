"""A description file in a foreign format (URDF, MJCF, SDF, xacro, DH table), opened as the mechanism of a robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from twin.core.errors import SourceError

if TYPE_CHECKING:
    from twin.exchange.read.imported_robot import DhOptions, Imported
    from twin.exchange.xacro import XacroSettings
    from twin.model.mechanism import Mechanism


@dataclass(frozen=True)
class ImportedFile:
    """A file of a format that `twin new` reads, read once when its mechanism is first used.

    Attributes:
        path: the file.
        tool: frame or body to use as tool; None: as the file states it, else the end of the longest chain.
        xacro: arguments and package folders of a xacro; None: defaults and the neighbours of the file.
        dh: convention and units of a table of Denavit-Hartenberg parameters; None: as the table states them.
    """

    path: Path
    tool: str | None = None
    xacro: XacroSettings | None = None
    dh: DhOptions | None = None

    def __post_init__(self) -> None:
        """Check that there is such a file, and that it states joints.

        Raises:
            SourceError: the file does not exist, or is a drawing.
        """
        from twin.exchange.read import format_of

        if format_of(self.path).name == "step":
            raise SourceError(
                f"{self.path}: a STEP file has bodies, but no joints: make a robot folder by `twin new {self.path}`, "
                "and name its joints there"
            )

    @property
    def name(self) -> str:
        """Name of the file without any of its suffixes: ur for ur.urdf.xacro."""
        return self.path.name.split(".")[0]

    @property
    def options(self) -> tuple[str, ...]:
        """Names of the options of `twin.load` that were given for this file: tool, xacro, dh, units."""
        options: list[str] = []
        if self.tool is not None:
            options.append("tool")
        if self.xacro is not None and self.xacro.given:
            options.append("xacro")
        if self.dh is not None:
            if self.dh.convention is not None:
                options.append("dh")
            if self.dh.length is not None or self.dh.angle is not None:
                options.append("units")
        return tuple(options)

    @cached_property
    def imported(self) -> Imported:
        """Mechanism with closed loops, and the findings of the reader.

        Raises:
            SourceError: the file cannot be read, or its content cannot be expressed as a mechanism.
        """
        from twin.exchange.read import read
        from twin.exchange.read.loop_closing import close

        return close(read(self.path, xacro=self.xacro, dh=self.dh))

    @property
    def unlimited(self) -> frozenset[str]:
        """Joints of which the file states that they have no limits."""
        return self.imported.unlimited

    @property
    def efforts(self) -> Mapping[str, float]:
        """Largest effort in N or N m of each joint for which the file states an effort, but no gains."""
        return self.imported.efforts

    @cached_property
    def opened(self) -> tuple[Mechanism, str]:
        """Mechanism with its tool, and a note on the assumed tool (the note is "" if the tool is named)."""
        from twin.usd.read.tool import with_tool

        imported = self.imported
        if self.tool is not None:
            return with_tool(imported.mechanism, self.tool)
        for finding in imported.findings:
            # the reader says where it has assumed a tool; a tool that the file names is only an info
            if finding.code == "import.tool" and finding.severity == "warning":
                return imported.mechanism, f"{self.path.name} names no tool: its end, '{finding.where}', is the tool."
        return imported.mechanism, ""


def imported_file(
    path: Path, tool: str | None, xacro: XacroSettings | None, dh: str | None, units: str | None
) -> ImportedFile:
    """Return a description file with options as `twin.load` takes them.

    Raises:
        SourceError: the file does not exist or is a drawing, or the options do not apply.
    """
    from twin.exchange.read.imported_robot import dh_options

    table = None
    if dh is not None or units is not None:
        table = dh_options(dh, units)
    return ImportedFile(path, tool, xacro, table)
