"""The folder that is handed over: every format that was asked for, a README and a proof.

The auditor is handed in by the caller: what writes a file never judges it.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from twin.core import assets
from twin.core.errors import TwinError, unknown
from twin.core.findings import EXIT_CODES, Finding, Verdict, verdict
from twin.core.version import __version__
from twin.exchange.write import readme
from twin.exchange.write.clip import model_hash
from twin.exchange.write.order import Order, Progress

FORMATS = ("usd", "usdz", "glb", "unity", "tracks", "mjcf", "urdf")
"""What a bundle may hold."""

PROOF = "proof.json"


class Audit(Protocol):
    """What an auditor hands back."""

    @property
    def checks(self) -> Sequence[Any]:
        """Rows of what was measured, each with `as_dict`."""
        ...

    @property
    def findings(self) -> Sequence[Finding]:
        """What is wrong."""
        ...


@dataclass(frozen=True)
class Bundle:
    """What was written.

    Attributes:
        folder: where.
        files: every file, relative to it.
        order: what it was made of.
        findings: of the robot, the writers and the audit.
        checks: rows of the proof.
    """

    folder: Path
    files: tuple[Path, ...]
    order: Order
    findings: tuple[Finding, ...]
    checks: tuple[dict[str, Any], ...]

    @property
    def verdict(self) -> Verdict:
        """agree, disagree (a reader sees something else, or a budget is missed) or unchecked."""
        return verdict(self.findings)

    @property
    def exit_code(self) -> int:
        """Exit code of the command line."""
        return EXIT_CODES[self.verdict]

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum((self.folder / f).stat().st_size for f in self.files)


def chosen_formats(asked: Sequence[str] | None) -> tuple[str, ...]:
    """Return the formats in the order of `FORMATS`; all of them without a choice.

    Raises:
        TwinError: there is none of that name; the message lists those that exist.
    """
    if asked is None:
        return FORMATS
    for name in asked:
        if name not in FORMATS:
            raise TwinError(unknown("format", name, FORMATS))
    if not asked:
        raise TwinError(f"no format to export to. Known: {', '.join(FORMATS)}.")
    return tuple(f for f in FORMATS if f in asked)


def write_bundle(
    order: Order,
    folder: Path,
    formats: Sequence[str],
    audit: Callable[..., Audit],
    progress: Progress,
) -> Bundle:
    """Write a bundle; files of an earlier one that are no longer part of it go, everything else in the folder stays.

    Args:
        order: what to write.
        folder: where to; on an error it is left as it was.
        formats: see `chosen_formats`.
        audit: (folder, truth, mechanism) -> what readers of its own find there; truth: (times (k,), T_world_link
            (k, 4, 4) by link) by clip, of the independent model.
        progress: see `twin.api.Progress`.

    Raises:
        OutputError: the folder cannot be written.
        TwinError: a format cannot hold the robot.
    """
    with assets.atomic_folder(folder, replacing=_written_before(folder)) as work:
        findings = list(order.findings)
        for i, name in enumerate(formats):
            progress(f"write {name}", i / len(formats))
            findings += _WRITERS[name](order, work)
        (work / "README.txt").write_text(readme.text(order, formats, findings), encoding="utf-8")
        progress("audit", 0.0)
        judged = audit(work, truth={c.name: (c.times, c.links) for c in order.clips}, mechanism=order.mechanism)
        checks, missed = _budgets(order)
        checks += [c.as_dict() for c in judged.checks]
        findings += [*missed, *judged.findings]
        files = sorted(p.relative_to(work) for p in work.rglob("*") if p.is_file())
        proof = _proof(order, work, files, checks, findings)
        (work / PROOF).write_text(_lines(proof), encoding="utf-8")
        files = sorted([*files, Path(PROOF)])
    return Bundle(folder, tuple(files), order, tuple(findings), tuple(checks))


# ------------------------------------------------------------------------------------------------ formats


def _usd(order: Order, work: Path) -> list[Finding]:
    from twin.exchange.write.usd import write_usd

    write_usd(order.mechanism, order.clips, work / "usd")
    return []


def _usdz(order: Order, work: Path) -> list[Finding]:
    from twin.exchange.write.usdz import write_usdz

    name, clips = order.mechanism.name, {c.name: c for c in order.clips}
    first = clips[order.quick_looks[0]] if order.quick_looks else None
    write_usdz(order.mechanism, first, work / f"{name}_ar.usdz")
    for clip in order.quick_looks[1:]:
        write_usdz(order.mechanism, clips[clip], work / f"{name}_{clip}_ar.usdz")
    return []


def _glb(order: Order, work: Path) -> list[Finding]:
    from twin.exchange.write.glb import write_glb

    write_glb(order.mechanism, order.clips, work / f"{order.mechanism.name}.glb")
    return []


def _unity(order: Order, work: Path) -> list[Finding]:
    from twin.exchange.write.unity import write_unity

    write_unity(work / "unity")
    return []


def _tracks(order: Order, work: Path) -> list[Finding]:
    from twin.exchange.write.tracks import write_schema, write_tracks

    for scene in order.scenes:
        write_tracks(scene.mechanism, scene.clip, work / "tracks", order.mechanism, order.assumed)
    write_schema(work / "tracks")
    return []


def _mjcf(order: Order, work: Path) -> list[Finding]:
    from twin.exchange.write.mjcf import mjcf_findings, write_mjcf

    write_mjcf(order.mechanism, work)
    for scene in order.elsewhere:
        write_mjcf(scene.mechanism, work, f"{order.mechanism.name}_{scene.clip.name}")
    return mjcf_findings(order.mechanism)


def _urdf(order: Order, work: Path) -> list[Finding]:
    from twin.exchange.write.urdf import urdf_findings, write_urdf
    from twin.usd.write.spanning import spanning

    write_urdf(order.mechanism, work)
    hung = {j.name for j in spanning(order.mechanism).tree} & set(order.mechanism.trocars)
    for scene in order.elsewhere if hung else ():  # a trocar at which the tree is cut has no place in the file
        write_urdf(scene.mechanism, work, f"{order.mechanism.name}_{scene.clip.name}")
    return urdf_findings(order.mechanism)


_WRITERS: dict[str, Callable[[Order, Path], list[Finding]]] = {
    "usd": _usd,
    "usdz": _usdz,
    "glb": _glb,
    "unity": _unity,
    "tracks": _tracks,
    "mjcf": _mjcf,
    "urdf": _urdf,
}


# ------------------------------------------------------------------------------------------------ proof


def _budgets(order: Order) -> tuple[list[dict[str, Any]], list[Finding]]:
    """Return a row for each number of each clip's budget, and a finding for each that is missed."""
    rows, findings = [], []
    for clip in order.clips:
        b, budget = clip.between, clip.budget
        for name, worst, (where, when), unit, limit in (
            ("any point of a link, between keys", b.position, b.position_at, "m", budget and budget.position),
            ("rotation of a link, between keys", b.rotation, b.rotation_at, "rad", budget and budget.rotation),
            ("opening of a joint, between keys", b.joint_gap, b.joint_gap_at, "m", budget and budget.joint_gap),
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
                text = (
                    f"{clip.name}: {name}: {_short(worst):g} {unit} at {clip.rate:g} Hz; the budget is {limit:g} {unit}"
                )
                way = "no rate is higher: give a larger --budget-um, or slow the protocol down"
                findings.append(
                    Finding("export.budget", "disagreement", text, where, f"t = {when:.3f} s", worst, unit, limit, way)
                )
    return rows, findings


def _proof(
    order: Order, work: Path, files: Sequence[Path], checks: Sequence[dict[str, Any]], findings: Sequence[Finding]
) -> dict[str, Any]:
    """Return proof.json: what was made from what, and what every check measured. Nothing in it depends on the time."""
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
                "between_position_m": _short(c.between_position),
                "between_rotation_rad": _short(c.between_rotation),
                "joint_gap_m": _short(c.joint_gap),
                **(
                    {
                        "budget_position_m": _short(c.budget.position),
                        "budget_rotation_rad": _short(c.budget.rotation),
                        "budget_joint_gap_m": _short(c.budget.joint_gap),
                    }
                    if c.budget
                    else {}
                ),
            }
            for c in order.clips
        ],
        "checks": [{k: _short(v) if isinstance(v, float) else v for k, v in c.items()} for c in checks],
        "findings": [f.as_dict() for f in findings],
        "verdict": verdict(findings),
    }


def _lines(proof: Mapping[str, Any]) -> str:
    """Return JSON with a line for each entry and each row of a list: to be read, searched and compared by line."""
    out = []
    for key, value in proof.items():
        if isinstance(value, list) and value:
            rows = ",\n".join(json.dumps(v, ensure_ascii=False, allow_nan=False) for v in value)
            out.append(f"{json.dumps(key)}: [\n{rows}\n]")
        else:
            out.append(f"{json.dumps(key)}: {json.dumps(value, ensure_ascii=False, allow_nan=False)}")
    return "{\n" + ",\n".join(out) + "\n}\n"


def _short(value: float) -> float:
    """Return a number with six digits: what processors disagree on stays out of the file."""
    return float(f"{value:.6g}")


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _written_before(folder: Path) -> list[str]:
    """Return the files of the bundle that lies in the folder, by its proof, that nobody has changed since."""
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
