"""Find the files in a folder that the audit can check, grouped by kind."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from twin.core.errors import TwinError
from twin.core.foreign.budget import check_size
from twin.exchange.format import Format
from twin.exchange.formats import audit_formats

MAX_FILES = 20_000
"""Maximum number of files in an audited folder."""

SCENE = "scene.json"
"""Name of the file that lists the robots of an exported scene, with their folders and base poses."""

_SYNTAX_BY_SUFFIX = {".json": "JSON", **dict.fromkeys((".meta", ".asmdef", ".cs", ".txt", ".md"), "text")}
"""File name suffixes of text formats."""


@dataclass
class FolderFiles:
    """The files found.

    Attributes:
        root: the audited folder, or the folder of the audited file.
        files: {name of a format: its files, or the folders that are audited as one}, in the order of reading.
        proofs: the files proof.json.
        unrecognised: (file, file of the same name that is read, title of their format): only the first is of no format.
    """

    root: Path
    files: dict[str, list[Path]] = field(default_factory=dict)
    proofs: list[Path] = field(default_factory=list)
    unrecognised: list[tuple[Path, Path, str]] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Number of files that can be audited without other files."""
        count = len(self.proofs)
        for files in self.files.values():
            count += len(files)
        return count

    def name(self, path: Path) -> str:
        """Return a path as reports show it: relative to the audited folder."""
        if path == self.root:
            return path.name
        return path.relative_to(self.root).as_posix()


def find_files(path: Path) -> FolderFiles:
    """Return the files to audit: the file at a path, or the files in the folder at the path.

    Raises:
        TwinError: the path does not exist, or has no file that can be audited.
    """
    if path.is_file():
        folder_files = FolderFiles(path.parent)
        _group_by_format(folder_files, [path], is_single=True)
        if not folder_files.count:
            known_suffixes = []
            for format in audit_formats():
                if format.variants:
                    known_suffixes.append(_suffixes_text(format))
            supported = ", ".join(known_suffixes)
            raise TwinError(f"{path}: a file of this kind cannot be audited; supported are {supported} and proof.json.")
        return folder_files
    if not path.is_dir():
        raise TwinError(f"{path}: the file or folder does not exist")
    folder_files = FolderFiles(path)
    files = []
    for file in sorted(path.rglob("*")):
        if file.is_file() and not _is_hidden(file.relative_to(path)):
            files.append(file)
            syntax = _SYNTAX_BY_SUFFIX.get(file.suffix.lower())
            if syntax is not None:
                check_size(file, syntax)
        # Whoever gives a home folder by mistake learns it here, before all of its files are searched.
        if len(files) > MAX_FILES:
            raise TwinError(f"{path} contains more than {MAX_FILES} files: give the folder of one export")
    folders_of_formats: list[Path] = []
    for format, folders in _folders_by_format(files):
        folder_files.files[format.name] = folders
        folders_of_formats += folders
    single = []
    for file in files:
        if not _is_within(file, folders_of_formats):
            single.append(file)
    _group_by_format(folder_files, single, is_single=False)
    if not folder_files.count:
        titles = [format.title for format in audit_formats()]
        raise TwinError(f"{path}: the folder has no file that can be audited ({', '.join(titles)})")
    return folder_files


def _is_hidden(path: Path) -> bool:
    return any(part.startswith(".") for part in path.parts)


def _is_within(path: Path, folders: Sequence[Path]) -> bool:
    return any(map(path.is_relative_to, folders))


def _suffixes_text(format: Format) -> str:
    """Return the suffixes of a format for a message, with its name if others use the suffixes too."""
    suffixes = ", ".join(variant.suffix for variant in format.variants)
    if format.recognise is None:
        return suffixes
    return f"{format.title} ({suffixes})"


def _folders_by_format(files: Sequence[Path]) -> list[tuple[Format, list[Path]]]:
    """Return (format, folders) for each format whose folders are audited as one; a folder in another is part of it."""
    folder_formats = []
    for format in audit_formats():
        if not format.marker:
            continue
        folders = []
        for file in files:
            if file.name == format.marker and format.accepts(file):
                folders.append(file.parent)
        outer_folders = []
        for folder in folders:
            # The working directory "." is its own parent: only other folders can contain a folder.
            others = set(folders) - {folder}
            if others.isdisjoint(folder.parents):
                outer_folders.append(folder)
        folder_formats.append((format, outer_folders))
    return folder_formats


def _group_by_format(folder_files: FolderFiles, files: Sequence[Path], is_single: bool) -> None:
    """Add files to `folder_files`. A file that is audited alone has the format of its suffix, even if it is damaged."""
    formats = audit_formats()
    by_format: dict[str, list[tuple[int, Path]]] = {}
    unmatched: list[Path] = []
    for file in files:
        if file.name == "proof.json":
            folder_files.proofs.append(file)
            continue
        format = _format_of(file, formats, is_single)
        if format is None:
            unmatched.append(file)
        else:
            variant = format.variant(file)
            if variant is not None:
                by_format.setdefault(format.name, []).append((variant.rank, file))
    for format in formats:
        ranked = by_format.get(format.name, [])
        ranked.sort(key=lambda row: row[0])  # by rank alone, so that files of one rank stay in the order of their names
        chosen = format.outermost([file for _, file in ranked])  # parts, such as sublayers, go with their whole
        if chosen:
            folder_files.files[format.name] = chosen
            folder_files.unrecognised += _unrecognised(format, unmatched, chosen)


def _unrecognised(
    format: Format, unmatched: Sequence[Path], chosen: Sequence[Path]
) -> Iterator[tuple[Path, Path, str]]:
    """Yield (file, file of the same name, title) of files that have a suffix of a format, but not its contents."""
    by_stem = {file.with_suffix(""): file for file in chosen}
    for file in unmatched:
        sibling = by_stem.get(file.with_suffix(""))
        if sibling is not None and format.variant(file) is not None:
            yield file, sibling, format.title


def _format_of(file: Path, formats: Sequence[Format], is_single: bool) -> Format | None:
    format_of_suffix: Format | None = None
    for format in formats:
        if format.variant(file) is None:
            continue
        if format.accepts(file):
            return format
        if format_of_suffix is None:
            format_of_suffix = format
    if is_single:
        return format_of_suffix
    return None
