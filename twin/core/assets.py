"""Locations of data folders and robot files: next to pyproject.toml in a checkout, or in twin/_data in a wheel.

A user's robot is one folder that contains `cad/`, `trajectories/`, `usd/` and `formula.py`. The files of a built-in
robot are in several folders. `RobotFiles` has the same attributes for both kinds of robots.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass, field
from pathlib import Path

from twin.core.atomic import atomic_folder as atomic_folder
from twin.core.atomic import require_writable as require_writable
from twin.core.atomic import require_writable_file as require_writable_file
from twin.core.atomic import settle
from twin.core.errors import KinematicsError, TwinError, unknown
from twin.core.foreign.once import Once
from twin.core.foreign.text import read_text

_OTHER_TABLES = ("dimensions", "inertia", "machine", "exhibit", "scene", "scenery")
"""Names, without suffix, of TOML files in a robot's cad/ folder that are not its description."""

NO_EQUATIONS = "FORMULA = None"
"""Line in formula.py that marks the empty template."""

_PACKAGE = Path(__file__).resolve().parents[1]


def data_folder() -> Path:
    """Return the folder that contains cad/, usd/ and trajectories/."""
    installed = _PACKAGE / "_data"
    if installed.is_dir():
        return installed
    return _PACKAGE.parent


def examples() -> dict[str, Path]:
    """Return the folders of the examples of a user's robot, by name."""
    folder = data_folder() / "examples"
    if is_checkout():
        folder = data_folder() / "docs/examples"
    folders = {}
    for path in sorted(folder.glob("*")):
        if (path / "cad").is_dir():
            folders[path.name] = path
    return folders


def is_checkout() -> bool:
    """Return whether twin runs from a source checkout, where `build` may write usd/."""
    return data_folder() == _PACKAGE.parent and (_PACKAGE.parent / "pyproject.toml").is_file()


@dataclass(frozen=True)
class RobotFiles:
    """The paths of one robot; the files need not exist.

    `cad`, `usd` and `trajectories` are folders; `formula` is the file of the equations; `read` returns the bytes of a
    file and opens each file once (`twin.core.foreign.once`).
    """

    name: str
    cad: Path
    usd: Path
    trajectories: Path
    formula: Path
    read: Once = field(default_factory=Once, compare=False, repr=False)

    @property
    def description(self) -> Path:
        """The robot's TOML file."""
        return self.cad / f"{self.name}.toml"

    @property
    def has_equations(self) -> bool:
        """Whether there is a formula other than the empty template (`FORMULA = None`); the file is not executed."""
        try:
            return NO_EQUATIONS not in read_text(self.formula, "text", errors="replace", read=self.read).splitlines()
        except OSError:
            return False

    @property
    def stage(self) -> Path:
        """The robot's USD root layer."""
        return self.usd / f"{self.name}.usda"

    def protocols(self) -> dict[str, Path]:
        """Return the paths of the protocol files, by protocol name."""
        return {path.stem: path for path in sorted(self.trajectories.glob("*.toml"))}

    def protocol(self, name: str) -> Path:
        """Return the file of one protocol; `name` is FOLDER/NAME for a file in a subfolder of `trajectories`.

        Raises:
            TwinError: the protocol does not exist; the message lists the existing protocols.
        """
        paths_by_name = self.protocols()
        if re.fullmatch(r"\w+/\w+", name) and (path := self.trajectories / f"{name}.toml").is_file():
            return path
        if name not in paths_by_name:
            raise TwinError(f"{self.name}: {unknown('protocol', name, paths_by_name)}")
        return paths_by_name[name]

    def hashes(self) -> dict[str, str]:
        """Return {name of a file: SHA-256 of its bytes} of the equations, the description and the STEP files."""
        hashes = {}
        for path in (self.formula, self.description, *sorted(self.cad.glob("*.step"))):
            if path.is_file():
                hashes[path.name] = hashlib.sha256(path.read_bytes()).hexdigest()
        return hashes


def equations(files: RobotFiles | None, name: str) -> Path:
    """Return the file of a robot's equations; a robot loaded from a USD stage has no files (None).

    Raises:
        KinematicsError: the file is missing, or is still the empty template.
    """
    if files is None or not files.formula.is_file():
        raise KinematicsError(f"robot '{name}' has no equations: formula.py is missing")
    if not files.has_equations:
        raise KinematicsError(
            f"{files.formula}: there are no equations yet; planning and validation need them. Write `inverse` or "
            f"`forward` in this file, and delete the line `{NO_EQUATIONS}`."
        )
    return files.formula


def scenes() -> list[str]:
    """Return the names of the built-in scenes: every cad/<name>/scene.toml."""
    scene_names = [path.parent.name for path in data_folder().glob("cad/*/scene.toml")]
    return sorted(scene_names)


def scene_file(scene: str | Path) -> Path | None:
    """Return the scene file that `scene` names: a built-in scene, a file, or the folder of a file; otherwise None."""
    if str(scene) in scenes():
        return data_folder() / "cad" / str(scene) / "scene.toml"
    path = Path(scene)
    if path.is_dir():
        path = path / "scene.toml"
    if path.name == "scene.toml" and path.is_file():
        return path
    return None


def studies(name: str) -> list[Path]:
    """Return the built-in study files trajectories/<name>/study/*.toml; `name` need not be the name of a robot."""
    # the studies of a robot are found in its files; a path must not lead out of the data
    if name in names() or "/" in name or name in ("", ".", ".."):
        return []
    return sorted((data_folder() / "trajectories" / name / "study").glob("*.toml"))


def names() -> list[str]:
    """Return the names of the built-in robots: every cad/<name>/<name>.toml."""
    robots = []
    for path in data_folder().glob("cad/*/*.toml"):
        if path.stem == path.parent.name:
            robots.append(path.stem)
    return sorted(robots)


def files(robot: str | Path) -> RobotFiles:
    """Return the paths of a built-in robot (by name) or of a robot folder (by path).

    Raises:
        TwinError: the argument is neither a built-in robot nor a robot folder.
    """
    folder = Path(robot)
    if str(robot) in names():
        root = data_folder()
        name = str(robot)
        robot_files = RobotFiles(
            name=name,
            cad=root / "cad" / name,
            usd=root / "usd" / name,
            trajectories=root / "trajectories" / name,
            formula=_PACKAGE / "robots" / f"{name}.py",
        )
    elif folder.is_dir():
        folder = folder.resolve()
        descriptions = _descriptions(folder)
        if len(descriptions) != 1:
            file_names = [path.name for path in descriptions]
            raise TwinError(
                f"robot folder {folder}: expected one robot description in {folder / 'cad'}, found "
                f"{file_names or 'none'}. A robot folder contains cad/<name>.toml, "
                "trajectories/ and formula.py."
            )
        robot_files = RobotFiles(
            name=descriptions[0].stem,
            cad=folder / "cad",
            usd=folder / "usd",
            trajectories=folder / "trajectories",
            formula=folder / "formula.py",
        )
    else:
        raise TwinError(f"{unknown('robot', str(robot), names())} The path of a robot folder is also accepted.")
    # writes of killed processes may have left files half replaced
    for place in (robot_files.cad, robot_files.usd, robot_files.trajectories):
        settle(place)
    return robot_files


def hidden(robot: str | Path) -> Path | None:
    """Return the robot folder in the working directory if a built-in robot has precedence over it; else None."""
    if str(robot) in names() and _descriptions(Path(robot)):
        return Path(robot).resolve()
    return None


def _descriptions(folder: Path) -> list[Path]:
    """Return the TOML files in a robot folder that may be its description."""
    return [path for path in (folder / "cad").glob("*.toml") if path.stem not in _OTHER_TABLES]
