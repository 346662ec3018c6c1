"""Find the files in a folder that the audit can check, grouped by kind."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from pathlib import Path

from twin.core.errors import TwinError
from twin.core.foreign.budget import check_size

MOST_FILES = 20_000
"""Maximum number of files in an audited folder."""

STAGES = (".usd", ".usda", ".usdc")

_TEXT = {".json": "JSON", **dict.fromkeys((".meta", ".asmdef", ".cs", ".txt", ".md"), "text")}
"""File name suffixes of text formats."""

_LISTS = {".glb": "gltf", ".gltf": "gltf", ".usdz": "usdz", ".urdf": "urdf", **dict.fromkeys(STAGES, "stages")}
"""For each suffix that belongs to a single format: name of the list in `Found` for files with this suffix."""

_SUBLAYER = re.compile(r"@([^@\0]+\.usd[ac]?)@")


@dataclass
class Found:
    """The files found, by kind, each kind sorted by path."""

    root: Path
    gltf: list[Path] = field(default_factory=list)
    stages: list[Path] = field(default_factory=list)
    usdz: list[Path] = field(default_factory=list)
    tracks: list[Path] = field(default_factory=list)
    csv: list[Path] = field(default_factory=list)
    mjcf: list[Path] = field(default_factory=list)
    urdf: list[Path] = field(default_factory=list)
    unity: list[Path] = field(default_factory=list)
    proofs: list[Path] = field(default_factory=list)
    readmes: list[Path] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Number of files that can be audited without other files."""
        return sum(len(v) for k, v in vars(self).items() if k not in ("root", "readmes"))

    def name(self, path: Path) -> str:
        """Return a path as reports show it: relative to the audited folder."""
        return path.relative_to(self.root).as_posix() if path != self.root else path.name


def find(path: Path) -> Found:
    """Return the files to audit: the file at a path, or the files in the folder at the path.

    Raises:
        TwinError: the path does not exist, or has no file that can be audited.
    """
    if path.is_file():
        out = Found(path.parent)
        _sort(out, path, alone=True)
        if not out.count:
            raise TwinError(
                f"{path}: a file of this kind cannot be audited; supported are .glb, .gltf, .usd, .usda, .usdc, "
                ".usdz, tracks (.json, .csv), MJCF (.xml), .urdf and proof.json."
            )
        return out
    if not path.is_dir():
        raise TwinError(f"{path}: the file or folder does not exist")
    out = Found(path)
    files = []
    for file in sorted(path.rglob("*")):
        parts = file.relative_to(path).parts
        if file.is_file() and not any(p.startswith(".") for p in parts):
            files.append(file)
            if suffix := _TEXT.get(file.suffix.lower()):
                check_size(file, suffix)
        if len(files) > MOST_FILES:
            raise TwinError(f"{path} contains more than {MOST_FILES} files: give the folder of one export")
    packages = [f.parent for f in files if f.name == "package.json" and _is_package(f)]
    out.unity = [p for p in packages if not any(p != q and p.is_relative_to(q) for q in packages)]
    for file in files:
        if not any(file.is_relative_to(p) for p in out.unity):
            _sort(out, file, alone=False)
    _leave_sublayers(out)
    if not out.count:
        kinds = ".glb, .gltf, USD, .usdz, tracks, MJCF, URDF or Unity package"
        raise TwinError(f"{path}: the folder has no file that can be audited ({kinds})")
    return out


def _sort(out: Found, file: Path, alone: bool) -> None:
    suffix = file.suffix.lower()
    if suffix in _LISTS:
        getattr(out, _LISTS[suffix]).append(file)
    elif suffix == ".xml" and (alone or _starts(file, b"<mujoco")):
        out.mjcf.append(file)
    elif file.name == "README.txt" and not alone:
        out.readmes.append(file)
    elif file.name == "proof.json":
        out.proofs.append(file)
    elif suffix == ".json" and (alone or (not file.name.endswith(".schema.json") and _is_track(file))):
        out.tracks.append(file)
    elif suffix == ".csv" and (alone or _is_table(file)):
        out.csv.append(file)


def _starts(file: Path, mark: bytes) -> bool:
    """Return whether the first 4 kB of a file contain a marker."""
    try:
        with file.open("rb") as f:
            return mark in f.read(4096)
    except OSError:
        return False


def _is_track(file: Path) -> bool:
    """Return whether a JSON file is a track: its entry `schema` says so, wherever it stands.

    A file that names the schema, but is not JSON, is a damaged track.
    """
    try:
        data = file.read_bytes()
        if b'"twin-track"' not in data:
            return False
        told = json.loads(data)
    except OSError:
        return False
    except (ValueError, RecursionError):
        return True
    return isinstance(told, dict) and told.get("schema") == "twin-track"


def _is_table(file: Path) -> bool:
    """Return whether a CSV file is a track: one of the lines `# name: value` at its start names the schema."""
    try:
        with file.open("rb") as f:
            for line in f:
                if not line.startswith(b"#"):
                    return False
                if b"twin-track" in line:
                    return True
    except OSError:
        return False
    return False


def _is_package(file: Path) -> bool:
    """Return whether a package.json belongs to a Unity package: its entry `unity` states the editor version."""
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return "unity" in file.parent.name.lower()
    return isinstance(data, dict) and "unity" in data


def _leave_sublayers(out: Found) -> None:
    """Remove stages from `out.stages` that are sublayers of another stage and have no sublayers of their own."""
    named: set[Path] = set()
    naming: set[Path] = set()
    for stage in out.stages:
        if stage.suffix != ".usda":
            continue
        try:
            text = stage.read_text(encoding="utf-8", errors="replace")[:200_000]
        except OSError:
            continue
        for target in _SUBLAYER.findall(text):
            named.add((stage.parent / target).resolve())
            naming.add(stage.resolve())
    out.stages = [s for s in out.stages if s.resolve() not in named or s.resolve() in naming]
