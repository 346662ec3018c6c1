"""Find the objects that other installed packages name in their metadata, in a group of entry points."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from twin.core.errors import TwinError


def entry_points(group: str) -> dict[str, object]:
    """Return {name: object} of a group of entry points; a package on `sys.path` hides those of the same name behind it.

    Raises:
        TwinError: an object cannot be imported; the message names the metadata.
    """
    objects: dict[str, object] = {}
    for file in _files(group):
        for name, place in _rows(file, group):
            if name not in objects:
                objects[name] = _loaded(name, place, file)
    return objects


def names(package: str, group: str) -> list[str]:
    """Return the names of the modules in a package of twin, and of the entry points of a group; nothing is loaded."""
    all_names = set()
    for module in iter_modules(import_module(package).__path__):
        all_names.add(module.name)
    for file in _files(group):
        for name, _ in _rows(file, group):
            all_names.add(name)
    return sorted(all_names)


def _files(group: str) -> list[Path]:
    """Return the metadata files that mention a group.

    `importlib.metadata` is not used: its import, and the metadata of all packages that it reads, take as long as all of
    `twin --help`. Relative folders of `sys.path` are not searched: the working directory may hold a foreign robot, and
    what lies beside it must not be imported.
    """
    heading = f"[{group}]".encode()
    files = []
    for folder in map(Path, sys.path):
        if not folder.is_absolute():
            continue
        for file in sorted(folder.glob("*.dist-info/entry_points.txt")):
            if heading in file.read_bytes():
                files.append(file)
    return files


def _rows(file: Path, group: str) -> list[tuple[str, str]]:
    """Return (name, "module:object") for each entry point of a group in a file."""
    rows = []
    current = ""
    for line in file.read_text(encoding="utf-8").splitlines():
        line = line.strip()
        if line.startswith("["):
            current = line.strip("[]")
        elif current == group and "=" in line and not line.startswith(("#", ";")):
            name, _, place = line.partition("=")
            rows.append((name.strip(), place.strip()))
    return rows


def _loaded(name: str, place: str, file: Path) -> object:
    """Return the object that an entry point names, as "module:attribute".

    Raises:
        TwinError: it cannot be imported.
    """
    module, _, attribute = place.partition(":")
    try:
        return getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        text = f"the entry point '{name} = {place}' in {file} cannot be imported: {error}"
        raise TwinError(f"{text}. Repair or uninstall the package.") from error
