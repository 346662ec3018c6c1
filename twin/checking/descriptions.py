"""The robot descriptions in a folder, and the meshes and packages that they name."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pathspec import GitIgnoreSpec
from pathspec.patterns.gitignore import GitIgnorePatternError

from twin.core.errors import SourceError
from twin.core.foreign.budget import MJCF_SUFFIXES, STAGE_SUFFIXES
from twin.exchange.read import suffixes

Kind = str
"""Name of the format in `twin.exchange.formats`, or "folder" for a robot folder of twin."""

_UNSEARCHED_FOLDERS = (".git", ".hg", ".svn", ".venv", "node_modules", "__pycache__", ".tox", "twin-out")
"""Names of folders that are never searched."""

_HEAD_SIZE = 65536
"""Number of bytes at the beginning of a file that tell its kind."""

_MAX_ENTRIES = 200_000
"""Maximum number of files and folders in a checked folder."""

_ROOT_ELEMENT = re.compile(rb"<(?![?!])\s*([A-Za-z_][\w.:-]*)")
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
# a xacro without the name of a robot holds macros for others to include
_NAMED_ROBOT = re.compile(rb"<robot\b[^>]*\sname\s*=")
_PACKAGE_NAME = re.compile(rb"<name>\s*([^<\s]+)\s*</name>")
_INCLUDED_FILE = re.compile(rb"<include\b[^>]*\bfile\s*=\s*[\"']([^\"']+)[\"']")
# the two angles of a row of Denavit-Hartenberg parameters, also as LaTeX or in Greek (UTF-8)
_DH_TWIST = re.compile(rb"\balpha|\\alpha|\btwist|\xce\xb1", re.IGNORECASE)
_DH_TURN = re.compile(rb"theta|\xce\xb8|\\theta|\boffset", re.IGNORECASE)


@dataclass(frozen=True)
class DescriptionFile:
    """A file that may describe a robot.

    Attributes:
        path: the file, or the folder of a robot of twin.
        name: its path relative to the checked folder, with /.
        kind: see `Kind`.
        root: root element of a file whose elements have rules: "robot" or "sdf"; "" for the others.
    """

    path: Path
    name: str
    kind: Kind
    root: str = ""


@dataclass
class FolderContent:
    """What a checked folder contains.

    Attributes:
        folder: the folder, an absolute path.
        descriptions: the descriptions, by name.
        packages: {name of a ROS package or folder: folders with this name}.
        unreadable: {name: reason} of files and folders that cannot be read.
        parts: MJCF files that other files include.
    """

    folder: Path
    descriptions: list[DescriptionFile] = field(default_factory=list)
    packages: dict[str, list[Path]] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)
    parts: set[Path] = field(default_factory=set)


def walk(folder: Path, exclude: Sequence[str] = (), packages: Sequence[Path] = ()) -> FolderContent:
    """Search a folder and its subfolders for descriptions.

    Links to folders are not followed, so a loop of links ends. `exclude` are the lines of a .gitignore file in the
    folder; `packages` are further folders with packages.

    Raises:
        SourceError: the folder or one of `packages` does not exist, is not a folder or cannot be read; the folder has
            too many files, without excluded ones; or a pattern has no meaning.
    """
    if not folder.exists():
        raise SourceError(f"{folder}: the folder does not exist")
    if not folder.is_dir():
        raise SourceError(f"{folder}: this is a file; give the folder that contains it")
    folder = folder.resolve()  # messages have one path of each file, which names in the folder replace
    excluded = patterns(exclude)
    tree = FolderContent(folder)
    count = 0

    def refused(error: OSError) -> None:
        place = Path(str(error.filename or folder))
        tree.unreadable[_relative(place, folder)] = error.strerror or str(error)

    for place, folders, files in os.walk(folder, onerror=refused):
        current = Path(place)
        searched: list[str] = []
        for name in sorted(folders):
            # the final / says that the name is that of a folder
            if name not in _UNSEARCHED_FOLDERS and not excluded.match_file(f"{_relative(current / name, folder)}/"):
                searched.append(name)
                tree.packages.setdefault(name, []).append(current / name)
        folders[:] = searched  # `os.walk` goes on into the folders that remain in this list
        included: list[str] = []
        for name in sorted(files):
            if not excluded.match_file(_relative(current / name, folder)):
                included.append(name)
        count += len(searched) + len(included)
        if count > _MAX_ENTRIES:
            raise SourceError(
                f"{folder}: more than {_MAX_ENTRIES:,} files; check its folders one by one, or use --exclude"
            )
        if "cad" in searched and _is_robot_folder(current):
            tree.descriptions.append(DescriptionFile(current, _relative(current, folder), "folder"))
        for name in included:
            _add_file(tree, current / name, _relative(current / name, folder))
    for package_folder in packages:
        _add_packages(tree, package_folder)
    tree.descriptions.sort(key=lambda description: description.name)
    return tree


def _add_packages(tree: FolderContent, package_folder: Path) -> None:
    """Add a folder and its subfolders to the packages of the tree."""
    place = package_folder.resolve()
    if not place.is_dir():
        raise SourceError(f"{package_folder}: there is no such folder; give a folder that contains packages")
    try:
        inner_places = list(place.iterdir())
    except OSError as error:
        raise SourceError(f"{package_folder}: cannot be read ({error.strerror or error})") from error
    tree.packages.setdefault(place.name, []).append(place)
    for inner in inner_places:
        if inner.is_dir():
            tree.packages.setdefault(inner.name, []).append(inner)


def _add_file(tree: FolderContent, path: Path, name: str) -> None:
    """Add a file to the tree, if it is a description, a package or a part of a description."""
    suffix = path.suffix.lower()
    if suffix not in suffixes():
        return
    if not path.is_file():  # a link to nothing, or a pipe
        if path.is_symlink():
            tree.unreadable[name] = "the link points to no file"
        return
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_SIZE)
    except OSError as error:
        tree.unreadable[name] = error.strerror or str(error)
        return
    if path.name == "package.xml":
        package_name = _PACKAGE_NAME.search(head)
        if package_name is not None:
            tree.packages.setdefault(package_name[1].decode("utf-8", "replace"), []).append(path.parent)
        return
    if suffix in MJCF_SUFFIXES:
        for target in _INCLUDED_FILE.findall(_COMMENT.sub(b"", head)):
            tree.parts.add((path.parent / target.decode("utf-8", "replace")).resolve())
    found_kind = _kind(path, suffix, head)
    if found_kind is not None:
        kind, root = found_kind
        tree.descriptions.append(DescriptionFile(path, name, kind, root))


def _kind(path: Path, suffix: str, head: bytes) -> tuple[Kind, str] | None:
    """Return kind and root of a description, see `DescriptionFile`; None for another file."""
    if suffix in STAGE_SUFFIXES:
        return "usd", ""
    if "table" in suffixes()[suffix].takes:
        if path.parent.name == "cad" and suffix == ".toml":  # the description of a robot folder
            return None
        if _DH_TWIST.search(head) and _DH_TURN.search(head):
            return "dh", ""
        return None
    markup = _COMMENT.sub(b"", head)
    root = _ROOT_ELEMENT.search(markup)
    name = b"" if root is None else root[1]
    if suffix == ".xacro":
        if _NAMED_ROBOT.search(markup) is None:
            return None  # macros for others to include
        return "xacro", "robot"
    if suffix == ".urdf":
        return "urdf", "robot"
    if suffix == ".sdf":
        return "sdf", "sdf"
    if name == b"mujoco":
        return "mjcf", ""
    return None


def patterns(exclude: Sequence[str]) -> GitIgnoreSpec:
    """Return the patterns of `--exclude`, which mean what they mean as lines of a .gitignore file.

    Raises:
        SourceError: a pattern has no meaning.
    """
    try:
        return GitIgnoreSpec.from_lines(exclude)
    except GitIgnorePatternError as error:
        stated = "'" + "', '".join(exclude) + "'"
        advice = "give a name, a path, or a pattern with *"
        raise SourceError(f"--exclude {stated}: not a pattern of .gitignore ({error}); {advice}") from error


def _is_robot_folder(folder: Path) -> bool:
    """Return whether a folder has a description cad/NAME.toml with joints."""
    for file in (folder / "cad").glob("*.toml"):
        try:
            with file.open("rb") as stream:
                head = stream.read(_HEAD_SIZE)
        except OSError:
            continue
        if b"[[joint]]" in head:
            return True
    return False


def _relative(path: Path, folder: Path) -> str:
    try:
        return path.relative_to(folder).as_posix()
    except ValueError:
        return path.as_posix()
