"""Create a robot folder from a description in another format, a table of DH parameters, or a STEP assembly."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from twin.core.errors import TwinError
from twin.core.findings import Finding
from twin.core.json_types import JsonMapping
from twin.core.progress import Progress, silent
from twin.core.result import Part, Result

if TYPE_CHECKING:
    from twin.exchange.xacro import XacroSettings
    from twin.model.mechanism import Mechanism

_PRINTED_FINDINGS = 3
"""Maximum number of printed findings of one kind; the notes contain all findings."""


@dataclass(frozen=True)
class NewRobot(Result):
    """A robot folder that was written.

    Attributes:
        robot: name of the robot.
        folder: the folder; `twin.load(folder)` opens the robot.
        files: the files written, the description first.
        mechanism: what was read, with closed loops.
        findings: changes, guesses and omissions.
        gap: largest gap of a loop in m.
        has_formula: whether the source stated equations, as a table of DH parameters does.
    """

    robot: str
    folder: Path
    files: tuple[Path, ...]
    mechanism: Mechanism
    findings: tuple[Finding, ...]
    gap: float
    has_formula: bool = False

    kind = "new"
    judges = False

    @property
    def active(self) -> list[str]:
        """Names of the driven joints."""
        return [joint.name for joint in self.mechanism.active]

    def content(self) -> JsonMapping:
        """Return names and numbers of what was written."""
        return {
            "robot": self.robot,
            "files": list(map(str, self.files)),
            "bodies": len(self.mechanism.bodies),
            "joints": len(self.mechanism.joints),
            "active": self.active,
            "loops": len(self.mechanism.loops),
            "worst_gap_m": self.gap,
        }

    def text(self) -> Iterator[Part]:
        """Yield the warnings, at most `_PRINTED_FINDINGS` of each kind, then what was written and the next commands."""
        findings_by_code: dict[str, list[Finding]] = {}
        for finding in self.findings:
            if finding.severity != "info":
                findings_by_code.setdefault(finding.code, []).append(finding)
        for code, findings in findings_by_code.items():
            for finding in findings[:_PRINTED_FINDINGS]:
                yield f"  {finding.severity}: {finding.message}"
            if len(findings) > _PRINTED_FINDINGS:
                yield f"    and {len(findings) - _PRINTED_FINDINGS} more of {code}"
        loops = ""
        if self.mechanism.loops:
            loops = f", {len(self.mechanism.loops)} loops closed within {self.gap:.2g} m"
        yield (
            f"  {self.folder}/: {len(self.mechanism.bodies)} bodies, {len(self.mechanism.joints)} joints{loops}, "
            f"{len(self.active)} driven; changes and omissions: {self.folder}/IMPORT.md"
        )
        yield f"  next: {self._next_commands}"

    @property
    def _next_commands(self) -> str:
        """What to do with the new folder: command lines, and the file to edit."""
        robot = f"{self.folder}/"  # with a slash, it is a path, also if a built-in robot has this name
        if self.has_formula:
            return f"twin validate {robot}, twin info {robot}, twin view {robot}; the equations are in formula.py"
        first = ""
        if not self.active:  # of a STEP file: its skeleton proposes joints as comments
            first = f"name the joints in {self.files[0]}, then "
        return (
            f"{first}twin info {robot}, twin build {robot}, twin view {robot}; then your equations in formula.py and "
            f"twin validate {robot}"
        )


def new(
    source: str | Path,
    name: str | None = None,
    *,
    out: str | Path | None = None,
    closures: str | Path | None = None,
    root: str | None = None,
    xacro: XacroSettings | None = None,
    dh: str | None = None,
    units: str | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> NewRobot:
    """Write a robot folder from a description file (URDF, MJCF, SDF, USD, xacro, DH table) or a STEP assembly.

    Args:
        source: the file to read.
        name: name of the robot: lower-case letters, digits and _, with a letter first; default: made from the name of
            the file.
        out: folder to write; default: ./<name>/.
        closures: closure YAML of a URDF; default: the .yaml file of the same name, if it exists.
        root: robot to read, if the file has several: prim path (USD), model (SDF) or body (MJCF).
        xacro: arguments and package folders, for a xacro.
        dh: convention of a DH table, if the table does not state it: "standard", "modified", "khalil" or "hayati".
        units: units of such a table, as "mm,deg", if the table does not state them.
        force: whether a robot folder may be overwritten; its equations and protocols are kept.
        progress: see `Progress`.

    Raises:
        SourceError: the file cannot be read, or its content cannot be expressed as a mechanism.
        OutputError: the folder must not be overwritten.
        TwinError: the name is invalid, or an option does not apply to this format.

    Examples:
        >>> from pathlib import Path
        >>> import twin
        >>> urdf = "<robot name='arm'><link name='base'/><link name='tip'/><joint name='q' type='continuous'>"
        >>> urdf += "<parent link='base'/><child link='tip'/><axis xyz='0 0 1'/></joint></robot>"
        >>> _ = Path("arm.urdf").write_text(urdf)
        >>> made = twin.new("arm.urdf", out="my_arm")
        >>> twin.load(made.folder).joints
        ('q',)
    """
    from twin.core.identifiers import identifier
    from twin.exchange.read import format_of
    from twin.exchange.read.robot_folder import require_free

    path = Path(source)
    if name is not None and identifier(name) != name:
        raise TwinError(f"'{name}' is not a valid robot name; use [a-z][a-z0-9_]*, as in {identifier(name)}")
    format = format_of(path)
    if name is None:
        name = identifier(path.stem)
    folder = Path(out or name)
    require_free(folder, force)  # before the file is read, which can take a minute
    progress(f"read {path.name}", 0.0)
    if format.name == "step":
        if closures or root:
            raise TwinError(f"{path}: --closures and --root do not apply to a STEP file")
        if (xacro is not None and xacro.given) or dh or units:
            raise TwinError(f"{path}: --arg, --packages, --dh and --units do not apply to a STEP file")
        return _from_drawing(path, name, folder, force, progress)
    closing_file = Path(closures) if closures else None
    return _from_description(path, name, folder, force, closing_file, root, xacro, dh, units, progress)


def _from_drawing(path: Path, name: str, folder: Path, force: bool, progress: Progress) -> NewRobot:
    from twin.exchange.formats.step.read import read_skeleton, write_skeleton

    skeleton = read_skeleton(path)
    progress("write the skeleton", 0.5)
    written, mechanism = write_skeleton(skeleton, name, folder, path, force)
    return NewRobot(name, folder, tuple(written), mechanism, tuple(skeleton.findings), 0.0)


def _from_description(
    path: Path,
    name: str,
    folder: Path,
    force: bool,
    closures: Path | None,
    root: str | None,
    xacro: XacroSettings | None,
    dh: str | None,
    units: str | None,
    progress: Progress,
) -> NewRobot:
    from twin.exchange.read import format_of, read
    from twin.exchange.read.imported_robot import dh_options
    from twin.exchange.read.loop_closing import close
    from twin.exchange.read.robot_folder import write_folder
    from twin.reference import ReferenceModel

    imported = read(path, closures, root, xacro=xacro, dh=dh_options(dh, units))
    progress("close loops", 0.4)
    imported = close(imported)  # before writing: the folder states rest poses in which the loops are closed
    progress("write the folder", 0.8)
    written = write_folder(imported, name, folder, path, force)
    gap = ReferenceModel(imported.mechanism).home().worst_gap
    has_formula = "table" in format_of(path).takes
    findings = tuple(imported.findings)
    return NewRobot(name, folder, tuple(written), imported.mechanism, findings, gap, has_formula)
