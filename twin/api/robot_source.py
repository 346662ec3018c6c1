"""What a robot is read from: the files of a robot folder, a USD stage, or a description file in a foreign format."""

from __future__ import annotations

import contextlib
import typing
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from twin.core import assets
from twin.core.errors import TwinError

if TYPE_CHECKING:
    from twin.cad.build import CadModel
    from twin.cad.description import Description
    from twin.model.mechanism import Mechanism
    from twin.planning.protocol import Protocol


class DescribedRobot(typing.Protocol):
    """A description file in a foreign format.

    Only an interface: `twin.api.imported_file` implements it, and reaches all readers, which judges must not load.
    """

    @property
    def path(self) -> Path:
        """The file."""
        ...

    @property
    def name(self) -> str:
        """Name of the file without suffixes."""
        ...

    @property
    def options(self) -> tuple[str, ...]:
        """Names of the options of `load` that were given for this file."""
        ...

    @property
    def opened(self) -> tuple[Mechanism, str]:
        """Mechanism with its tool, and a note on the assumed tool."""
        ...

    @property
    def unlimited(self) -> frozenset[str]:
        """Joints of which the file states that they have no limits."""
        ...

    @property
    def efforts(self) -> Mapping[str, float]:
        """Largest effort in N or N m of each joint for which the file states an effort, but no gains."""
        ...


class RobotSource:
    """Either the files of a robot folder, a USD stage or a description file; read once, shared by all robots of it.

    Attributes:
        files: files of a robot folder or of a built-in robot, or None.
        stage: a USD stage, or None.
        tool: frame or body of the stage to use as tool; None: the tool that the stage names, else its end.
        described: a description file in a foreign format, or None.
    """

    def __init__(
        self,
        files: assets.RobotFiles | None = None,
        stage: Path | None = None,
        tool: str | None = None,
        described: DescribedRobot | None = None,
    ) -> None:
        self.files = files
        self.stage = stage
        self.tool = tool
        self.described = described

    @property
    def name(self) -> str:
        """Name of the robot's folder, or of the file of the stage or description; "" for no source."""
        if self.files is not None:
            return self.files.name
        if self.described is not None:
            return self.described.name
        if self.stage is not None:
            return self.stage.stem
        return ""

    @property
    def path(self) -> Path | None:
        """The stage or the description file; None for a robot with a folder."""
        if self.described is not None:
            return self.described.path
        return self.stage

    @property
    def kind(self) -> str:
        """What the robot was loaded from, for messages: "a USD stage", or "the file arm.urdf"."""
        if self.described is not None:
            return f"the file {self.described.path.name}"
        return "a USD stage"

    @property
    def options(self) -> tuple[str, ...]:
        """Names of the options of `load` that were given for the stage or file, and that change its mechanism."""
        if self.described is not None:
            return self.described.options
        if self.tool is not None:
            return ("tool",)
        return ()

    @cached_property
    def cad(self) -> CadModel:
        """The robot measured on the CAD, without masses."""
        return self._read(with_mass=False)

    @cached_property
    def weighed(self) -> CadModel:
        """The robot measured on the CAD, with the masses of the parts."""
        return self._read(with_mass=True)

    @cached_property
    def description(self) -> Description:
        """The content of the robot's TOML file.

        Raises:
            TwinError: the robot was loaded from a stage or file, or its TOML file is malformed.
        """
        from twin.cad.description import load

        return load(self._files.description, self._files.read)

    @cached_property
    def opened(self) -> tuple[Mechanism, str]:
        """Mechanism of the stage or file, and a note on the assumed tool (the note is "" if the tool is named)."""
        from twin.usd.read import read_stage, with_tool

        if self.described is not None:
            return self.described.opened

        assert self.stage is not None
        mechanism = read_stage(self.stage)
        return with_tool(mechanism, self.tool)

    def protocol(self, name: str | Path | None) -> Protocol:
        """Return the protocol with a name, or at the path of a TOML file; None: the robot's default protocol.

        Raises:
            TwinError: the protocol does not exist, is written for another robot, or its file is malformed.
        """
        from twin.planning.protocol import load_protocol
        from twin.schema import error_at

        is_path = name is not None and Path(name).suffix == ".toml"
        if is_path:
            path = Path(str(name))
        elif self.files is None:
            raise TwinError(f"{self.name} was loaded from {self.kind}: give the path of a protocol file")
        else:
            path = self.files.protocol(str(name or self.description.default_protocol))
        if self.files is None:
            protocol = load_protocol(path)
        else:
            protocol = load_protocol(path, self.files.read)
        # results and baked motions have the name in the file, commands that of the file
        if not is_path and protocol.name != path.stem:
            raise error_at(path, ("name",), f"'{protocol.name}' must be the file's name, '{path.stem}'")
        if protocol.robot != self.name:
            raise error_at(path, ("robot",), f"the protocol is written for '{protocol.robot}', not for '{self.name}'")
        return protocol

    @contextlib.contextmanager
    def fresh_stage(self) -> Iterator[Path]:
        """Yield the robot's own USD stage if it is up to date with the CAD, else one rebuilt in a temporary folder."""
        from twin.exchange.formats.usd.write import fresh_stage

        cad = vars(self).get("weighed") or self.cad  # `cad` and `weighed` have the same file hash
        with fresh_stage(self._files.stage, cad.mechanism.source, lambda: self.weighed.mechanism) as root:
            yield root

    @property
    def _files(self) -> assets.RobotFiles:
        if self.files is None:
            name = self.path.stem if self.path else "the robot"
            raise TwinError(f"{name} was loaded from {self.kind}: it has no CAD")
        return self.files

    def _read(self, with_mass: bool) -> CadModel:
        from twin.cad.build import read_mechanism

        return read_mechanism(self._files.description, with_mass=with_mass, read=self._files.read)
