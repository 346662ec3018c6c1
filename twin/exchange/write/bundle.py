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
from twin.core.quantity import Quantity
from twin.core.result import Part, Result, Table
from twin.core.units import DEG, UM
from twin.core.version import __version__
from twin.exchange.formats import exported, named
from twin.exchange.write import readme
from twin.exchange.write.clip import Between, Budget, Clip, model_hash
from twin.exchange.write.order import Order, Progress

PROOF = "proof.json"


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
        return sum((self.folder / f).stat().st_size for f in self.files)

    def content(self) -> JsonObject:
        """Return the result as plain data for JSON."""
        return {
            "folder": str(self.folder),
            "files": [f.as_posix() for f in self.files],
            "bytes": self.size,
            "clips": [
                {
                    "protocol": c.name,
                    "keys": len(c.times),
                    "rate": c.rate,
                    "between_position": c.between.position,
                    "between_rotation": c.between.rotation,
                    "joint_gap": c.between.joint_gap,
                }
                for c in self.order.clips
            ],
            "checks": list(self.checks),
        }

    def text(self) -> Iterator[Part]:
        """Yield lines of text: verdict, findings, motions with their errors, and files."""
        yield f"{self.order.mechanism.name} · {', '.join(self.formats)}\n\n  {_VERDICTS[self.verdict]}\n"
        if shown := [f for f in by_severity(self.findings) if f.severity != "info"]:
            yield from shown
            yield ""
        if self.order.clips:
            header = ("motion", "duration s", "keys per second", "error µm", "error deg", "joint gap µm")
            yield Table(header, [_row(c) for c in self.order.clips])
            yield ""
        top: dict[str, int] = {}
        for file in self.files:
            name = f"{file.parts[0]}/" if len(file.parts) > 1 else file.name
            top[name] = top.get(name, 0) + (self.folder / file).stat().st_size
        rows = [(f"{self.folder / n}{'/' * n.endswith('/')}", f"{size / 1e3:.0f} kB") for n, size in top.items()]
        yield Table((), rows)
        yield f"\n  {self.size / 1e6:.1f} MB in {len(self.files)} files; {len(self.checks)} checks in proof.json"
        if assumed := len(self.order.assumed) + sum(len(c.assumed) for c in self.order.clips):
            yield f"  {assumed} assumed values (unpublished) are listed in README.txt."


_VERDICTS = {
    "agree": "PASS: independent readers find the same robot in every file, at every key",
    "disagree": "FAIL: the exported files disagree; see the findings",
    "unchecked": "UNCHECKED: the audit could not read all exported files",
}


def _row(c: Clip) -> tuple[str, ...]:
    b = c.between
    between = (f"{b.position / UM:.1f}", f"{b.rotation / DEG:.4f}", f"{b.joint_gap / UM:.1f}")
    return c.name, f"{c.times[-1]:.3f}", f"{c.rate:g}", *between


def chosen_formats(asked: Sequence[str] | None) -> tuple[str, ...]:
    """Return the names of the chosen formats in the order of an export; if `asked` is None, return all formats.

    Raises:
        TwinError: `asked` is empty, or a format does not exist; the message lists the known formats.
    """
    known = tuple(format.name for format in exported())
    if asked is None:
        return known
    for name in asked:
        if name not in known:
            raise TwinError(unknown("format", name, known))
    if not asked:
        raise TwinError(f"no format is given. Known formats: {', '.join(known)}.")
    return tuple(name for name in known if name in asked)


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
    if tuple(formats) == ("tracks",) and not order.clips:
        text = "tracks contain only motions: choose another format as well, such as glb,tracks"
        raise TwinError(f"{order.mechanism.name} has no motion to export, and {text}")
    with assets.atomic_folder(folder, replacing=_written_before(folder)) as work:
        findings = list(order.findings)
        written: dict[str, set[str]] = {}  # files by format, except schemas, which do not depend on the robot
        for i, name in enumerate(formats):
            progress(f"write {name}", i / len(formats))
            before = _tree(work)
            findings += write_format(name, order, work)
            written[name] = {f for f in _tree(work) - before if not f.endswith(".schema.json")}
        (work / "README.txt").write_text(readme.text(order, formats, findings), encoding="utf-8")
        progress("audit", 0.0)
        truth = {s.clip.name: (s.clip.times, s.judged) for s in order.scenes}
        judged = audit(work, truth=truth, mechanism=order.mechanism)
        checks, missed = _budgets(order)
        checks += [c.as_dict() for c in judged.checks]
        findings += [*missed, *judged.findings, *_unjudged(written, {c.file for c in judged.checks})]
        files = sorted(Path(p) for p in _tree(work))
        proof = _proof(order, work, files, checks, findings)
        (work / PROOF).write_text(_lines(proof), encoding="utf-8")
        files = sorted([*files, Path(PROOF)])
    return Bundle(folder, tuple(formats), tuple(files), order, tuple(findings), tuple(checks))


def write_format(name: str, order: Order, folder: Path) -> list[Finding]:
    """Write the files of one format into `folder`; return findings, such as what the format cannot hold."""
    return named(name).module("write").write(order, folder)


def _tree(folder: Path) -> set[str]:
    return {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}


def _unjudged(written: Mapping[str, set[str]], judged: set[str]) -> list[Finding]:
    """Return an error for each format whose files the audit did not read; such an error makes the export fail."""
    return [
        error(
            "export.unjudged",
            min(files),
            f"the audit read none of the files of format '{name}', so these files are unchecked",
            suggestion="add a reader for the format: audit.py in its folder",
        )
        for name, files in written.items()
        if files and not any(f == j or f.startswith(f"{j}/") for f in files for j in judged)
    ]


# ------------------------------------------------------------------------------------------------ proof


def _budgets(order: Order) -> tuple[list[JsonObject], list[Finding]]:
    """Return a check for each error budget of each clip, and a finding for each budget that is exceeded."""
    rows, findings = [], []
    for clip in order.clips:
        b, budget = clip.between, clip.budget
        for name, worst, (where, when), unit, limit in (
            ("any point of a link, between keys", b.position, b.position_at, "m", budget and budget.position),
            ("rotation of a link, between keys", b.rotation, b.rotation_at, "rad", budget and budget.rotation),
            ("gap of a joint, between keys", b.joint_gap, b.joint_gap_at, "m", budget and budget.joint_gap),
        ):
            kept = limit is None or worst <= limit
            rows.append(
                {
                    "check": name,
                    "file": f"clip {clip.name}",
                    "tool": "twin.exchange.write",
                    "version": __version__,
                    "worst": _short(worst),
                    "unit": unit,
                    "tolerance": None if limit is None else _short(limit),
                    "verdict": "agree" if kept else "disagree",
                    "where": where,
                    "when": f"t = {when:.3f} s" if where else "",
                }
            )
            if limit is not None and not kept:
                what, at = f"{clip.name}: {name} at {clip.rate:g} Hz", f"t = {when:.3f} s"
                findings.append(_BUDGET(where, what, Quantity(worst, unit), limit, when=at))
    return rows, findings


def _proof(
    order: Order, work: Path, files: Sequence[Path], checks: Sequence[JsonObject], findings: Sequence[Finding]
) -> JsonObject:
    """Return the content of proof.json, which does not depend on the date: sources and results of all checks."""
    return {
        "schema": "twin-proof",
        "version": 1,
        "robot": order.mechanism.name,
        "model_hash": model_hash(order.mechanism),
        "made_by": f"twin {__version__}",
        "inputs": [{"file": name, "sha256": sha} for name, sha in order.inputs],
        "files": [
            {"file": f.as_posix(), "sha256": _sha256(work / f), "bytes": (work / f).stat().st_size} for f in files
        ],
        "clips": [
            {
                "protocol": c.name,
                "rate": c.rate,
                "keys": len(c.times),
                "duration_s": round(float(c.times[-1]), 9),
                **_errors("between_", "", c.between),
                **(_errors("budget_", "budget_", c.budget) if c.budget else {}),
            }
            for c in order.clips
        ],
        "checks": [{k: _short(v) if isinstance(v, float) else v for k, v in c.items()} for c in checks],
        "findings": [f.as_dict() for f in findings],
        "verdict": verdict(findings),
    }


def _errors(begin: str, begin_gap: str, e: Between | Budget) -> dict[str, float]:
    return {
        f"{begin}position_m": _short(e.position),
        f"{begin}rotation_rad": _short(e.rotation),
        f"{begin_gap}joint_gap_m": _short(e.joint_gap),
    }


def _lines(proof: JsonMapping) -> str:
    """Return JSON text with one line for each entry and each list element, so that `diff` can compare versions."""
    out = []
    for key, value in proof.items():
        if isinstance(value, list) and value:
            rows = ",\n".join(json.dumps(v, ensure_ascii=False, allow_nan=False) for v in value)
            out.append(f"{json.dumps(key)}: [\n{rows}\n]")
        else:
            out.append(f"{json.dumps(key)}: {json.dumps(value, ensure_ascii=False, allow_nan=False)}")
    return "{\n" + ",\n".join(out) + "\n}\n"


def _short(value: float) -> float:
    """Return a number rounded to six digits, so that the file does not depend on the processor."""
    return float(f"{value:.6g}")


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _written_before(folder: Path) -> list[str]:
    """Return the files of an earlier export that are unchanged: their hashes are equal to the hashes in proof.json."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        proof = json.loads((folder / PROOF).read_text(encoding="utf-8"))
        if proof["schema"] == "twin-proof":
            return [str(f["file"]) for f in proof["files"] if _is_unchanged(folder, str(f["file"]), str(f["sha256"]))]
    return []


def _is_unchanged(folder: Path, name: str, sha: str) -> bool:
    path = folder / name
    if Path(name).is_absolute() or ".." in Path(name).parts:
        return False
    return path.resolve().is_relative_to(folder.resolve()) and path.is_file() and _sha256(path) == sha
