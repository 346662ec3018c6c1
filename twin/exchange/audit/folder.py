"""Find the files in a folder that the audit can check, grouped by kind."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from twin.core.errors import TwinError
from twin.core.foreign.budget import check_size
from twin.exchange.format import Format
from twin.exchange.formats import audited

MOST_FILES = 20_000
"""Maximum number of files in an audited folder."""

SCENE = "scene.json"
"""Name of the file that lists the robots of an exported scene, with their folders and base poses."""

_TEXT = {".json": "JSON", **dict.fromkeys((".meta", ".asmdef", ".cs", ".txt", ".md"), "text")}
"""File name suffixes of text formats."""


@dataclass
class FolderFiles:
    """The files found.

    Attributes:
        root: the audited folder, or the folder of the audited file.
        files: {name of a format: its files, or the folders that are audited as one}, in the order of reading.
        proofs, readmes: the files proof.json and README.txt.
        unrecognised: (file, file of the same name that is read, title of their format): only the first is of no format.
    """

    root: Path
    files: dict[str, list[Path]] = field(default_factory=dict)
    proofs: list[Path] = field(default_factory=list)
    readmes: list[Path] = field(default_factory=list)
    unrecognised: list[tuple[Path, Path, str]] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Number of files that can be audited without other files."""
        return len(self.proofs) + sum(map(len, self.files.values()))

    def name(self, path: Path) -> str:
        """Return a path as reports show it: relative to the audited folder."""
        if path == self.root:
            return path.name
        return path.relative_to(self.root).as_posix()


def find(path: Path) -> FolderFiles:
    """Return the files to audit: the file at a path, or the files in the folder at the path.

    Raises:
        TwinError: the path does not exist, or has no file that can be audited.
    """
    if path.is_file():
        out = FolderFiles(path.parent)
        _sort(out, [path], alone=True)
        if not out.count:
            known = ", ".join(_shown(format) for format in audited() if format.variants)
            raise TwinError(f"{path}: a file of this kind cannot be audited; supported are {known} and proof.json.")
        return out
    if not path.is_dir():
        raise TwinError(f"{path}: the file or folder does not exist")
    out = FolderFiles(path)
    files = []
    for file in sorted(path.rglob("*")):
        if file.is_file() and not _hidden(file.relative_to(path)):
            files.append(file)
            syntax = _TEXT.get(file.suffix.lower())
            if syntax is not None:
                check_size(file, syntax)
        if len(files) > MOST_FILES:
            raise TwinError(f"{path} contains more than {MOST_FILES} files: give the folder of one export")
    wholes = _wholes(files)
    whole_folders: list[Path] = []
    for format, folders in wholes:
        out.files[format.name] = folders
        whole_folders += folders
    single = [file for file in files if not _within(file, whole_folders)]
    _sort(out, single, alone=False)
    if not out.count:
        known = ", ".join(format.title for format in audited())
        raise TwinError(f"{path}: the folder has no file that can be audited ({known})")
    return out


def _hidden(path: Path) -> bool:
    return any(part.startswith(".") for part in path.parts)


def _within(path: Path, folders: Sequence[Path]) -> bool:
    return any(map(path.is_relative_to, folders))


def _shown(format: Format) -> str:
    """Return the suffixes of a format for a message, with its name if others use the suffixes too."""
    suffixes = ", ".join(variant.suffix for variant in format.variants)
    if format.recognise is None:
        return suffixes
    return f"{format.title} ({suffixes})"


def _wholes(files: Sequence[Path]) -> list[tuple[Format, list[Path]]]:
    """Return (format, folders) for each format whose folders are audited as one; a folder in another is part of it."""
    wholes = []
    for format in audited():
        if not format.marker:
            continue
        folders = []
        for file in files:
            if file.name == format.marker and format.accepts(file):
                folders.append(file.parent)
        outer = []
        for folder in folders:
            # The working directory "." is its own parent: only other folders can contain a folder.
            others = set(folders) - {folder}
            if others.isdisjoint(folder.parents):
                outer.append(folder)
        wholes.append((format, outer))
    return wholes


def _sort(out: FolderFiles, files: Sequence[Path], alone: bool) -> None:
    """Add files to `out`. A file that is audited alone has the format of its suffix, even if it is damaged."""
    formats = audited()
    by_format: dict[str, list[tuple[int, Path]]] = {}
    strangers: list[Path] = []
    for file in files:
        if file.name == "README.txt" and not alone:
            out.readmes.append(file)
            continue
        if file.name == "proof.json":
            out.proofs.append(file)
            continue
        format = _format_of(file, formats, alone)
        if format is None:
            strangers.append(file)
        else:
            variant = format.variant(file)
            if variant is not None:
                by_format.setdefault(format.name, []).append((variant.rank, file))
    for format in formats:
        rows = by_format.get(format.name, [])
        rows.sort(key=lambda row: row[0])  # by rank alone, so that files of one rank stay in the order of their names
        chosen = format.outermost([file for _, file in rows])
        if chosen:
            out.files[format.name] = chosen
            out.unrecognised += _unrecognised(format, strangers, chosen)


def _unrecognised(
    format: Format, strangers: Sequence[Path], chosen: Sequence[Path]
) -> Iterator[tuple[Path, Path, str]]:
    """Yield (file, file of the same name, title) of files that have a suffix of a format, but not its contents."""
    by_stem = {file.with_suffix(""): file for file in chosen}
    for file in strangers:
        sibling = by_stem.get(file.with_suffix(""))
        if sibling is not None and format.variant(file) is not None:
            yield file, sibling, format.title


def _format_of(file: Path, formats: Sequence[Format], alone: bool) -> Format | None:
    first: Format | None = None
    for format in formats:
        if format.variant(file) is None:
            continue
        if format.accepts(file):
            return format
        if first is None:
            first = format
    return first if alone else None
