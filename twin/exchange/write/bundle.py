"""Write the export folder: every requested format, README.txt, and proof.json with the results of the audit.

The caller passes the audit function, because the code that writes the files must not check them.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from twin.core import assets
from twin.core.errors import TwinError, unknown
from twin.core.findings import Finding, Kind, by_severity, error, verdict
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.progress import Progress
from twin.core.quantity import Quantity
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.core.units import DEG, UM
from twin.core.version import __version__
from twin.exchange.format import Holds
from twin.exchange.formats import export_formats, format_named
from twin.exchange.write import readme
from twin.exchange.write.clip import Clip, ClipAccuracy, InterpolationErrors, model_hash
from twin.exchange.write.order import Order

PROOF = "proof.json"
README = "README.txt"


_BUDGET = Kind(
    "export.budget",
    "disagreement",
    "the highest key rate is already used: use a larger --budget-um, or make the protocol slower",
    word="budget",
)


class Audit(Protocol):
    """Interface of an audit's result: `checks` (measurements, each with a method `as_dict`) and `findings` (faults)."""

    @property
    def checks(self) -> Sequence[Any]: ...  # noqa: D102
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
            "clips": list(map(_entry, self.order.clips)),
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
            yield TextTable(header, list(map(_row, self.order.clips)))
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


def _entry(clip: Clip) -> JsonObject:
    return {
        "protocol": clip.name,
        "keys": len(clip.times),
        "rate": clip.rate,
        "between_position": clip.between.position,
        "between_rotation": clip.between.rotation,
        "joint_gap": clip.between.joint_gap,
    }


def _row(clip: Clip) -> tuple[str, ...]:
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
    with assets.atomic_folder(folder, replacing=_written_before(folder)) as work:
        findings, written = write_files(order, work, formats, progress)
        progress("audit", 0.0)
        truth: dict[str, tuple[Array, Mapping[str, Array]]] = {}
        for scene in order.scenes:
            truth[scene.clip.name] = (scene.clip.times, scene.judged)
        audit_result = audit(work, truth=truth, mechanism=order.mechanism)
        checks, missed = _budgets(order)
        files_read: set[str] = set()
        for check in audit_result.checks:
            checks.append(check.as_dict())
            files_read.add(check.file)
        findings += [*missed, *audit_result.findings, *_unjudged(written, files_read)]
        files = sorted(map(Path, _tree(work)))
        proof = _proof(order, work, files, checks, findings)
        (work / PROOF).write_text(_lines(proof), encoding="utf-8")
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
        before = _tree(folder)
        findings += write_format(name, order, folder)
        written[name] = _tree(folder) - before
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


def _tree(folder: Path) -> set[str]:
    """Return the paths of all files in a folder and below, relative to the folder."""
    files = set()
    for path in folder.rglob("*"):
        if path.is_file():
            files.add(path.relative_to(folder).as_posix())
    return files


def _unjudged(written: Mapping[str, set[str]], files_read: set[str]) -> list[Finding]:
    """Return an error for each format whose files the audit did not read; such an error makes the export fail."""
    findings = []
    for name, files in written.items():
        # A schema does not depend on the robot, and is not read by the audit.
        of_robot = {file for file in files if not file.endswith(".schema.json")}
        if of_robot and not _reads_one(of_robot, files_read):
            text = f"the audit read none of the files of format '{name}', so these files are unchecked"
            advice = "add a reader for the format: audit.py in its folder"
            findings.append(error("export.unjudged", min(of_robot), text, suggestion=advice))
    return findings


def _reads_one(files: set[str], files_read: set[str]) -> bool:
    """Return whether the audit read one of the files, or a folder with one of them."""
    for file in files:
        if file in files_read:
            return True
        for folder in Path(file).parents:
            if folder.as_posix() in files_read:
                return True
    return False


# ------------------------------------------------------------------------------------------------ proof


def _budgets(order: Order) -> tuple[list[JsonObject], list[Finding]]:
    """Return a check for each error budget of each clip, and a finding for each budget that is exceeded."""
    rows = []
    findings = []
    for clip in order.clips:
        errors = clip.between
        position = rotation = joint_gap = None
        if clip.budget is not None:
            position = clip.budget.position
            rotation = clip.budget.rotation
            joint_gap = clip.budget.joint_gap
        for name, worst, (where, when), unit, limit in (
            ("any point of a link, between keys", errors.position, errors.position_at, "m", position),
            ("rotation of a link, between keys", errors.rotation, errors.rotation_at, "rad", rotation),
            ("gap of a joint, between keys", errors.joint_gap, errors.joint_gap_at, "m", joint_gap),
        ):
            time = f"t = {when:.3f} s"
            is_within_budget = limit is None or worst <= limit
            tolerance: float | None = None
            if limit is not None:
                tolerance = _short(limit)
            row = {
                "check": name,
                "file": f"clip {clip.name}",
                "tool": "twin.exchange.write",
                "version": __version__,
                "worst": _short(worst),
                "unit": unit,
                "tolerance": tolerance,
                "verdict": "agree" if is_within_budget else "disagree",
                "where": where,
                "when": time if where else "",
            }
            rows.append(row)
            if limit is not None and not is_within_budget:
                text = f"{clip.name}: {name} at {clip.rate:g} Hz"
                findings.append(_BUDGET(where, text, Quantity(worst, unit), limit, when=time))
    return rows, findings


def _proof(
    order: Order, work: Path, files: Sequence[Path], checks: Sequence[JsonObject], findings: Sequence[Finding]
) -> JsonObject:
    """Return the content of proof.json, which does not depend on the date: sources and results of all checks."""
    inputs = []
    for name, sha in order.inputs:
        inputs.append({"file": name, "sha256": sha})
    file_entries = []
    for file in files:
        data = (work / file).read_bytes()
        sha = hashlib.sha256(data).hexdigest()
        file_entries.append({"file": file.as_posix(), "sha256": sha, "bytes": len(data)})
    return {
        "schema": "twin-proof",
        "version": 1,
        "robot": order.mechanism.name,
        "model_hash": model_hash(order.mechanism),
        "made_by": f"twin {__version__}",
        "inputs": inputs,
        "files": file_entries,
        "clips": list(map(_proof_of_clip, order.clips)),
        "checks": list(map(_shortened, checks)),
        "findings": list(map(Finding.as_dict, findings)),
        "verdict": verdict(findings),
    }


def _proof_of_clip(clip: Clip) -> JsonObject:
    entry = {
        "protocol": clip.name,
        "rate": clip.rate,
        "keys": len(clip.times),
        "duration_s": round(float(clip.times[-1]), 9),
    }
    entry |= _errors("between_", "", clip.between)
    if clip.budget is not None:
        entry |= _errors("budget_", "budget_", clip.budget)
    return entry


def _shortened(check: JsonMapping) -> JsonObject:
    """Return a check with its numbers rounded."""
    shortened = dict(check)
    for key, value in check.items():
        if isinstance(value, float):
            shortened[key] = _short(value)
    return shortened


def _errors(begin: str, begin_gap: str, errors: InterpolationErrors | ClipAccuracy) -> dict[str, float]:
    return {
        f"{begin}position_m": _short(errors.position),
        f"{begin}rotation_rad": _short(errors.rotation),
        f"{begin_gap}joint_gap_m": _short(errors.joint_gap),
    }


def _lines(proof: JsonMapping) -> str:
    """Return JSON text with one line for each entry and each list element, so that `diff` can compare versions."""
    entries = []
    for key, value in proof.items():
        content = _json(value)
        if isinstance(value, list) and value:
            rows = ",\n".join(map(_json, value))
            content = f"[\n{rows}\n]"
        entries.append(f"{json.dumps(key)}: {content}")
    return "{\n" + ",\n".join(entries) + "\n}\n"


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _short(value: float) -> float:
    """Return a number rounded to six digits, so that the file does not depend on the processor."""
    return float(f"{value:.6g}")


def _written_before(folder: Path) -> list[str]:
    """Return the files of an earlier export that are unchanged: their hashes are equal to the hashes in proof.json."""
    unchanged = []
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        proof = json.loads((folder / PROOF).read_text(encoding="utf-8"))
        if proof["schema"] == "twin-proof":
            for row in proof["files"]:
                name = str(row["file"])
                if _is_unchanged(folder, name, str(row["sha256"])):
                    unchanged.append(name)
            return unchanged
    return []  # also if one of the files cannot be read: then no file is removed


def _is_unchanged(folder: Path, name: str, sha: str) -> bool:
    relative = Path(name)
    if relative.is_absolute() or ".." in relative.parts:
        return False
    path = folder / name
    # A link in the folder may lead out of it; such a file is not one of the export.
    if not path.resolve().is_relative_to(folder.resolve()) or not path.is_file():
        return False
    return hashlib.sha256(path.read_bytes()).hexdigest() == sha
