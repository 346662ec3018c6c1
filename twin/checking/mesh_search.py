"""Find the meshes that a description names, by path or by package, in the checked folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from twin.checking.descriptions import FolderContent


@dataclass(frozen=True)
class FoundMesh:
    """Where a mesh is: `path`, or None; `outside`: it is in a package that is not here; `similar`: other case."""

    path: Path | None
    outside: bool = False
    similar: str = ""


def find_mesh(address: str, beside: Path, tree: FolderContent) -> FoundMesh:
    """Return where the mesh at a path or a `package://`, `model://` or `file://` address is.

    Paths are relative to the file's folder, or to a folder around it, up to the checked folder.
    """
    scheme, separator, path_text = address.partition("://")
    if not separator:
        path_text = address
        scheme = ""
    if scheme in ("http", "https"):
        return FoundMesh(None, outside=True)
    candidates: list[Path] = []
    is_package_known = True
    if scheme in ("package", "model"):
        package, _, inner = path_text.lstrip("/").partition("/")
        is_package_known = package in tree.packages or tree.folder.name == package
        for place in tree.packages.get(package, ()):
            candidates.append(place / inner)
        if tree.folder.name == package:
            candidates.append(tree.folder / inner)
        for around in _folders_around(beside, tree.folder):
            candidates.append(around / path_text.lstrip("/"))
            if around.name == package:
                is_package_known = True
                candidates.append(around / inner)
    elif Path(path_text).is_absolute():
        candidates.append(Path(path_text))
    else:
        for around in _folders_around(beside, tree.folder):
            candidates.append(around / path_text)
    for candidate in candidates:
        if candidate.is_file():
            return FoundMesh(candidate)
    for candidate in candidates:
        similar = _name_in_other_case(candidate)
        if similar:
            return FoundMesh(None, similar=similar)
    return FoundMesh(None, outside=not is_package_known)


def _folders_around(beside: Path, folder: Path) -> list[Path]:
    """Return a folder in the checked folder, and those around it, up to the checked folder itself."""
    places = [beside]
    for parent in beside.parents:
        if beside == folder or not parent.is_relative_to(folder):
            break
        places.append(parent)
    return places


def _name_in_other_case(path: Path) -> str:
    """Return the name of a file that differs from a path only in upper and lower case; "" if there is none."""
    try:
        for beside in path.parent.iterdir():
            if beside.name.casefold() == path.name.casefold():
                return beside.name
    except OSError:
        return ""
    return ""
