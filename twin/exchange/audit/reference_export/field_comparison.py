"""Compare an audited file, or the files of an audited folder, with those of a new export."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from twin.core import format
from twin.exchange.audit.ledger import Ledger, guarded
from twin.exchange.audit.reference_export.difference import FieldDifference, differences
from twin.exchange.audit.reference_export.entries import Entry
from twin.exchange.audit.reference_export.gltf_entries import read_gltf_entries
from twin.exchange.audit.reference_export.json_entries import read_json
from twin.exchange.audit.reference_export.text_entries import read_bytes, read_lines, read_mesh, read_table
from twin.exchange.audit.reference_export.usd_entries import read_layer, read_package
from twin.exchange.audit.reference_export.xml_entries import COMMENT, read_xml


@dataclass(frozen=True)
class EntryReader:
    """How files of one syntax are read and compared.

    Attributes:
        read: returns the entries of a file.
        when_rewritten: what tells that another program has written a file anew, so that it is not compared: kinds of
            entries that are missing or added, or many other lines, on which a program writes the same content in its
            own way; "never": no program saves such a text again.
        is_always_compared: whether a file is compared that the audit could not read.
    """

    read: Callable[[Path], Entry]
    when_rewritten: Literal["other kinds", "other lines", "never"] = "other kinds"
    is_always_compared: bool = False


_JSON = EntryReader(read_json)
_XML = EntryReader(read_xml, is_always_compared=True)  # what a program rejects in it is often one field
_LAYER = EntryReader(read_layer)
_TEXT = EntryReader(read_lines, when_rewritten="never")

READERS: Mapping[str, EntryReader] = {
    ".json": _JSON,
    ".asmdef": _JSON,
    ".urdf": _XML,
    ".xml": _XML,
    ".csv": EntryReader(read_table),
    ".obj": EntryReader(read_mesh),
    ".usda": _LAYER,
    ".usdc": _LAYER,
    ".usdz": EntryReader(read_package),
    ".glb": EntryReader(read_gltf_entries),
    ".cs": _TEXT,
    ".md": _TEXT,
    ".meta": _TEXT,
    ".txt": _TEXT,
    ".yaml": EntryReader(read_lines, when_rewritten="other lines"),
}
"""{suffix of a file: how it is read}; files of all other kinds are compared byte by byte."""

_BYTES = EntryReader(read_bytes)

_SCENERY = frozenset(("camera", "light", "sensor", "Camera"))
"""Kinds of entries that a user adds around a robot without changing it."""

_MOST_LABELS = 3
"""Largest number of entries around the robot that a note names."""

_OTHER_KINDS = 4
_OTHER_SHARE = 0.1
"""A file is not structured as twin writes it if at least so many kinds of entries are missing or added and, with all
inside them, they are at least this fraction of the entries."""

_RENAMED_SHARE = 0.3
"""Nor is it if at least this fraction of the entries is missing, and as many are added: names are others."""

_OTHER_LINES_SHARE = 0.5
"""Fraction of the lines of a YAML that differ if another program has written the same content on other lines."""

_LARGEST_RATIO = 20
_SMALL_SIZE = 1_000_000
"""A file is not compared if it has more than this number of times the size of its counterpart, and these bytes."""

_TOOL = "twin.exchange.audit reference_export"
_NEW_EXPORT = "a new export"
_EXPORT_AGAIN = "export the files again, together"
_README = "README.txt"
_PROOF = "proof.json"
_ADVICE = "write it as in a new export; or, if the robot is to be so, change the robot and export again"


def compare_with_reference(path: Path, reference: Path, unreadable: Collection[str]) -> Iterator[Ledger]:
    """Yield a ledger for each file that differs from that of the new export, and one for all files.

    Args:
        path: the audited folder or file.
        reference: folder of the new export.
        unreadable: names of files, as reports show them, that the audit could not read. Those of a syntax that is
            always compared are compared all the same.
    """
    file_count = 0
    missing = _missing_files(path, reference)
    difference_count = len(missing)
    for file, reference_file in _file_pairs(path, reference):
        name = file.name
        if file != path:
            name = file.relative_to(path).as_posix()
        reader = READERS.get(file.suffix.lower(), _BYTES)
        if name in unreadable and not reader.is_always_compared:
            continue
        if file.stat().st_size > _LARGEST_RATIO * reference_file.stat().st_size + _SMALL_SIZE:
            continue
        file_count += 1
        if file.read_bytes() == reference_file.read_bytes():
            continue
        ledger = Ledger(name, _TOOL, "1", code="export")
        found = guarded(partial(_differences_of_files, reference_file), file, ledger) or []
        for difference in found:
            text = f"{difference.text}."
            ledger.wrong(f"export.{difference.form}", text, difference.place, suggestion=_ADVICE)
        difference_count += len(found)
        yield ledger
    for name in missing:
        ledger = Ledger(name, _TOOL, "1", code="export")
        ledger.wrong("export.missing", f"the file is missing, which {_NEW_EXPORT} has.", suggestion=_EXPORT_AGAIN)
        yield ledger
    ledger_of_all = Ledger(format.count(file_count, "file"), _TOOL, "1")
    if file_count:
        ledger_of_all.row(
            "fields that differ from a new export", float(difference_count), "1", 0.0, against=_NEW_EXPORT
        )
    yield ledger_of_all


def not_compared(path: Path, reason: str) -> Ledger:
    """Return a ledger that says why the files of an export are not compared with a new export."""
    ledger = Ledger(path.name, _TOOL, "1", code="export")
    text = f"the files are not compared with {_NEW_EXPORT}, which would name further changes: {reason}."
    ledger.add("export.not_compared", "info", text)
    return ledger


def _file_pairs(path: Path, reference: Path) -> Iterator[tuple[Path, Path]]:
    """Yield (audited file, its counterpart in the reference): in a folder of the same name, a single file by suffix."""
    if path.is_file():
        candidates = sorted(reference.rglob(f"*{path.suffix}"))
        same_names = [file for file in candidates if file.name == path.name]
        for file in (same_names or candidates)[:1]:
            yield path, file
        return
    for reference_file in sorted(reference.rglob("*")):
        file = path / reference_file.relative_to(reference)
        if reference_file.is_file() and file.is_file():
            yield file, reference_file


def _missing_files(path: Path, reference: Path) -> list[str]:
    """Return the files of a new export that an export lacks: a folder with README.txt, not a copy of some files."""
    missing = []
    for reference_file in sorted(reference.rglob("*")):
        relative = reference_file.relative_to(reference)
        if not reference_file.is_file() or relative.name == _PROOF or (path / relative).exists():
            continue
        if any((path / folder / _README).is_file() for folder in relative.parents):
            missing.append(relative.as_posix())
    return missing


def _differences_of_files(reference_file: Path, file: Path, ledger: Ledger) -> list[FieldDifference]:
    """Return the differences of a file; none, but a note in the ledger, if it is not structured as twin writes it."""
    reader = READERS.get(file.suffix.lower(), _BYTES)
    reference = reader.read(reference_file)
    found = []
    scenery = []
    for difference in differences(reference, reader.read(file)):
        is_comment = difference.pattern.endswith(f"/{COMMENT}")
        if is_comment and difference.form in ("missing", "order"):
            continue  # programs that save again may leave out comments
        if difference.form == "extra" and difference.entry is not None and _is_scenery(difference.entry):
            scenery.append(difference.entry.label)
            continue
        found.append(difference)
    if _is_structured_otherwise(reader, reference, found):
        text = (
            f"the file is not structured as twin writes it: {len(found)} places differ. Its fields are not compared "
            "with those of a new export."
        )
        ledger.add("export.rewritten", "info", text)
        return []
    if scenery:
        labels = ", ".join(scenery[:_MOST_LABELS])
        if len(scenery) > _MOST_LABELS:
            labels += ", …"
        text = f"added around the robot, and not checked: {format.count(len(scenery), 'entry', 'entries')} ({labels})."
        ledger.add("export.scenery", "info", text)
    return found


def _is_structured_otherwise(reader: EntryReader, reference: Entry, found: Sequence[FieldDifference]) -> bool:
    """Return whether a file with these differences was written anew by another program, or has other names."""
    if reader.when_rewritten == "never":
        return False
    if reader.when_rewritten == "other lines":
        return len(found) >= _OTHER_LINES_SHARE * reference.count()
    patterns = set()
    entry_counts = {"missing": 0, "extra": 0}
    for difference in found:
        if difference.form in entry_counts:
            patterns.add((difference.form, difference.pattern))
            entry_counts[difference.form] += 1 if difference.entry is None else difference.entry.count()
    reference_count = reference.count()
    has_other_kinds = len(patterns) >= _OTHER_KINDS and sum(entry_counts.values()) >= _OTHER_SHARE * reference_count
    has_other_names = min(entry_counts.values()) >= _RENAMED_SHARE * reference_count
    return has_other_kinds or has_other_names


def _is_scenery(entry: Entry) -> bool:
    """Return whether an added entry is a camera, a light, a sensor or a floor, which the robot does not have."""
    is_floor = entry.kind == "geom" and entry.values.get("type") == "plane"
    return entry.kind in _SCENERY or entry.kind.endswith("Light") or is_floor
