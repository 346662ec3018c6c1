"""Write the export folder: every requested format, README.txt, and proof.json with the results of the audit.

The caller passes the audit function, because the code that writes the files must not check them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from twin.core import assets
from twin.core.errors import TwinError, unknown
from twin.core.findings import Finding, by_severity, error
from twin.core.json_types import JsonObject
from twin.core.progress import Progress
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.core.units import DEG, UM
from twin.exchange.format import Holds
from twin.exchange.formats import export_formats, format_named
from twin.exchange.write import readme
from twin.exchange.write.clip import Clip
from twin.exchange.write.order import Order
from twin.exchange.write.proof_json import PROOF, budget_checks, json_lines, proof_content, written_before

README = "README.txt"


class AuditedCheck(Protocol):
    """A measurement of an audit: the file it is of, relative to the export folder, and the whole as data for JSON."""

    @property
    def file(self) -> str: ...  # noqa: D102
    def as_dict(self) -> JsonObject: ...  # noqa: D102


class Audit(Protocol):
    """Interface of an audit's result: measurements, and findings on faults."""

    @property
    def checks(self) -> Sequence[AuditedCheck]: ...  # noqa: D102
    @property
    def findings(self) -> Sequence[Finding]: ...  # noqa: D102


@dataclass(frozen=True)
class Bundle(Result):
    """Result of an export.

    `files` are paths relative to the export folder. `findings` come from the robot, the writers and the audit. `checks`
    are the measurements in proof.json.
    """

    folder: Path
    formats: tuple[str, ...]
    files: tuple[Path, ...]
    order: Order
    findings: tuple[Finding, ...]
    checks: tuple[JsonObject, ...]

    kind = "export"

    @property
    def size(self) -> int:
        """Total size of the files in bytes."""
        total = 0
        for file in self.files:
            total += (self.folder / file).stat().st_size
        return total

    def content(self) -> JsonObject:
        """Return the result as plain data for JSON."""
        return {
            "folder": str(self.folder),
            "files": list(map(Path.as_posix, self.files)),
            "bytes": self.size,
            "clips": list(map(_content_of_clip, self.order.clips)),
            "checks": list(self.checks),
        }

    def text(self) -> Iterator[Part]:
        """Yield lines of text: verdict, findings, motions with their errors, and files."""
        yield f"{self.order.mechanism.name} · {', '.join(self.formats)}\n\n  {_VERDICTS[self.verdict]}\n"
        has_findings = False
        for finding in by_severity(self.findings):
            if finding.severity != "info":
                has_findings = True
                yield finding
        if has_findings:
            yield ""
        if self.order.clips:
            header = ("motion", "duration s", "keys per second", "error µm", "error deg", "joint gap µm")
            yield TextTable(header, list(map(_table_row, self.order.clips)))
            yield ""
        yield TextTable((), self._sizes())
        yield f"\n  {self.size / 1e6:.1f} MB in {len(self.files)} files; {len(self.checks)} checks in proof.json"
        counts = self.order.assumed_counts
        if str(counts):
            yield f"  Assumed values (unpublished): {counts}; see README.txt."

    def _sizes(self) -> list[tuple[str, str]]:
        """Return (path, size) of the files in the export folder, and of its folders with all that they contain."""
        sizes: dict[str, int] = {}
        for file in self.files:
            top = str(self.folder / file.parts[0])
            if len(file.parts) > 1:
                top += "/"
            sizes[top] = sizes.get(top, 0) + (self.folder / file).stat().st_size
        rows = []
        for top, size in sizes.items():
            rows.append((top, f"{size / 1e3:.0f} kB"))
        return rows


_VERDICTS = {
    "agree": "PASS: independent readers find the same robot in every file, at every key",
    "disagree": "FAIL: the exported files disagree; see the findings",
    "unchecked": "UNCHECKED: the audit could not read all exported files",
}


def _content_of_clip(clip: Clip) -> JsonObject:
    return {
        "protocol": clip.name,
        "keys": len(clip.times),
        "rate": clip.rate,
        "between_position": clip.between.position,
        "between_rotation": clip.between.rotation,
        "joint_gap": clip.between.joint_gap,
    }


def _table_row(clip: Clip) -> tuple[str, ...]:
    between = clip.between
    position = f"{between.position / UM:.1f}"
    rotation = f"{between.rotation / DEG:.4f}"
    gap = f"{between.joint_gap / UM:.1f}"
    return clip.name, f"{clip.times[-1]:.3f}", f"{clip.rate:g}", position, rotation, gap


def chosen_formats(requested: Sequence[str] | None) -> tuple[str, ...]:
    """Return the names of the chosen formats in the order of an export; if `requested` is None, return all formats.

    Raises:
        TwinError: `requested` is empty, or a format does not exist; the message lists the known formats.
    """
    known_names = tuple(format.name for format in export_formats())
    if requested is None:
        return known_names
    for name in requested:
        if name not in known_names:
            raise TwinError(unknown("format", name, known_names))
    if not requested:
        raise TwinError(f"no format is given. Known formats: {', '.join(known_names)}.")
    return tuple(sorted(set(requested), key=known_names.index))


def write_bundle(
    order: Order,
    folder: Path,
    formats: Sequence[str],
    audit: Callable[..., Audit],
    progress: Progress,
) -> Bundle:
    """Write an export folder (bundle). Obsolete files of an earlier export are removed; all other files are kept.

    Args:
        order: the data to write.
        folder: the export folder; it is unchanged if an error occurs.
        formats: see `chosen_formats`.
        audit: function (folder, truth, mechanism) that reads the files independently and returns an `Audit`. `truth`
            is the motion of the reference model: {clip: (times (k,) in s, {link: T_world_link (k, 4, 4)})}.
        progress: see `twin.api.Progress`.

    Raises:
        OutputError: the folder cannot be written.
        TwinError: a format cannot hold the robot, or only tracks are chosen and there is no motion.
    """
    if not order.clips:
        _require_more_than_motions(order, formats)
    with assets.atomic_folder(folder, replacing=written_before(folder)) as work:
        findings, written = write_files(order, work, formats, progress)
        progress("audit", 0.0)
        truth: dict[str, tuple[Array, Mapping[str, Array]]] = {}
        for scene in order.scenes:
            truth[scene.clip.name] = (scene.clip.times, scene.judged)
        audit_result = audit(work, truth=truth, mechanism=order.mechanism)
        checks, budget_findings = budget_checks(order)
        files_read: set[str] = set()
        for check in audit_result.checks:
            checks.append(check.as_dict())
            files_read.add(check.file)
        findings += [*budget_findings, *audit_result.findings, *_unread_formats(written, files_read)]
        files = sorted(map(Path, _files_below(work)))
        proof = proof_content(order, work, files, checks, findings)
        (work / PROOF).write_text(json_lines(proof), encoding="utf-8")
        files = sorted([*files, Path(PROOF)])
    return Bundle(folder, tuple(formats), tuple(files), order, tuple(findings), tuple(checks))


def write_files(
    order: Order, folder: Path, formats: Sequence[str], progress: Progress
) -> tuple[list[Finding], dict[str, set[str]]]:
    """Write the files of all formats and README.txt into a folder, without an audit and proof.json.

    Returns:
        The findings of the order and of the writers, and {format: paths of its files, relative to the folder}.
    """
    findings = list(order.findings)
    written: dict[str, set[str]] = {}
    for i, name in enumerate(formats):
        progress(f"write {name}", i / len(formats))
        files_before = _files_below(folder)
        findings += write_format(name, order, folder)
        written[name] = _files_below(folder) - files_before
    # The README states the findings of the writers; the audit comes after it.
    (folder / README).write_text(readme.text(order, formats, findings), encoding="utf-8")
    return findings, written


def _require_more_than_motions(order: Order, formats: Sequence[str]) -> None:
    """Raise an error if all chosen formats contain only motions: without a motion, there would be no files."""
    titles = []
    for format in export_formats():
        if format.name not in formats:
            continue
        if Holds.COORDINATES not in format.holds:
            return
        titles.append(format.title)
    if titles:
        only = f"{', '.join(titles)} contain only motions"
        advice = f"choose another format as well, such as glb,{','.join(formats)}"
        raise TwinError(f"{order.mechanism.name} has no motion to export, and {only}: {advice}")


def write_format(name: str, order: Order, folder: Path) -> list[Finding]:
    """Write the files of one format into `folder`; return findings, such as what the format cannot hold."""
    return format_named(name).module("write").write(order, folder)


def _files_below(folder: Path) -> set[str]:
    """Return the paths of all files in a folder and below, relative to the folder."""
    files = set()
    for path in folder.rglob("*"):
        if path.is_file():
            files.add(path.relative_to(folder).as_posix())
    return files


def _unread_formats(written: Mapping[str, set[str]], files_read: set[str]) -> list[Finding]:
    """Return an error for each format whose files the audit did not read; such an error makes the export fail."""
    findings = []
    for name, files in written.items():
        # A schema does not depend on the robot, and is not read by the audit.
        of_robot = {file for file in files if not file.endswith(".schema.json")}
        if of_robot and not _is_any_read(of_robot, files_read):
            text = f"the audit read none of the files of format '{name}', so these files are unchecked"
            advice = "add a reader for the format: audit.py in its folder"
            findings.append(error("export.unjudged", min(of_robot), text, suggestion=advice))
    return findings


def _is_any_read(files: set[str], files_read: set[str]) -> bool:
    """Return whether the audit read one of the files, or a folder with one of them."""
    for file in files:
        if file in files_read:
            return True
        for folder in Path(file).parents:
            if folder.as_posix() in files_read:
                return True
    return False
