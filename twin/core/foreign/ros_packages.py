"""Find the folders of ROS packages by their names, without ROS.

A folder is a package if it holds a package.xml. Searched are, in this order: the package that contains the file, so
that two versions of a package are not mixed; the given folders, those in ROS_PACKAGE_PATH, AMENT_PREFIX_PATH and
COLCON_PREFIX_PATH; and the packages beside that of the file.
"""

from __future__ import annotations

import os
import re
from collections import deque
from collections.abc import Iterator
from pathlib import Path

_SHARE_OF_PREFIX = {"ROS_PACKAGE_PATH": "", "AMENT_PREFIX_PATH": "share", "COLCON_PREFIX_PATH": "share"}
"""{environment variable: folder of the packages in each of its folders}."""

_LEVELS_BELOW = 4
"""Maximum number of folder levels that are searched for packages below a given folder."""

_MOST_FOLDERS = 5000
"""Maximum number of folders that are searched for packages."""

_LEVELS_ABOVE = 6
"""Number of folders above a file in which its package.xml is searched."""

_NAME_BYTES = 20_000
"""Number of bytes at the beginning of a package.xml in which its name is searched."""


class PackageMissingError(Exception):
    """A package was not found; the message is its name."""


class RosPackages:
    """Folders of the packages that the file `file` may name; `given` are folders to search first."""

    def __init__(self, file: Path, given: list[str]) -> None:
        self._neighbours = list(_neighbours(file))
        self._search_folders = [Path(folder) for folder in given]
        for variable, share in _SHARE_OF_PREFIX.items():
            for folder in os.environ.get(variable, "").split(os.pathsep):
                if folder:
                    self._search_folders.append(Path(folder) / share)
        self._by_name: dict[str, Path] | None = None  # None: the folders have not been searched yet

    def find(self, name: str) -> str:
        """Return the folder of a package.

        Raises:
            PackageMissingError: it was not found.
        """
        package_of_file = self._neighbours[0]
        if _package_name(package_of_file) == name:
            return str(package_of_file)
        for place in self._search_folders:
            if place.name == name and place.is_dir():
                return str(place.resolve())
            if (place / name).is_dir():
                return str((place / name).resolve())
        if self._by_name is None:
            self._by_name = self._found_packages()
        if name not in self._by_name:
            raise PackageMissingError(name)
        return str(self._by_name[name])

    def _found_packages(self) -> dict[str, Path]:
        """Return {name: folder} of the packages in all folders, of several with one name the first."""
        search = _PackageSearch()
        for place in self._search_folders:
            search.add_below(place, _LEVELS_BELOW)
        # the folders around the file are only searched one level deep: they may be the user's whole disk
        for place in self._neighbours:
            search.add_below(place, 1)
        return search.packages


class _PackageSearch:
    """A search of packages, level by level, in at most `_MOST_FOLDERS` folders.

    Attributes:
        packages: {name: folder} of the packages that were found.
    """

    def __init__(self) -> None:
        self.packages: dict[str, Path] = {}
        self._folders_left = _MOST_FOLDERS

    def add_below(self, place: Path, levels: int) -> None:
        """Add the packages in a folder and `levels` levels below it; folders inside packages are not searched."""
        waiting = deque([(place, 0)])
        while waiting and self._folders_left:
            self._folders_left -= 1
            folder, level = waiting.popleft()
            name = _package_name(folder)
            if name:
                self.packages.setdefault(name, folder.resolve())
            elif level < levels:
                for inner in _folders(folder):
                    waiting.append((inner, level + 1))


def _neighbours(file: Path) -> Iterator[Path]:
    """Yield the package that contains a file, then its folder; for a file outside packages, the folders around it."""
    around = list(file.resolve().parents)[:_LEVELS_ABOVE]
    for folder in around:
        if _package_name(folder):
            yield folder
            yield folder.parent
            yield folder.parent.parent
            return
    yield from around[:2]


def _folders(folder: Path) -> list[Path]:
    """Return the folders in a folder, sorted, without hidden ones; [] if it cannot be read."""
    folders = []
    try:
        for path in folder.iterdir():
            if path.is_dir() and not path.name.startswith("."):
                folders.append(path)
    except OSError:
        return []
    return sorted(folders)


def _package_name(folder: Path) -> str:
    """Return the name in the package.xml of a folder; "" if the folder is no package."""
    try:
        with (folder / "package.xml").open("rb") as file:
            head = file.read(_NAME_BYTES).decode("utf-8", "replace")
    except OSError:
        return ""
    name = re.search(r"<name>\s*([\w-]+)\s*</name>", head)
    return name[1] if name else folder.name
