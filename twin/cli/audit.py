"""`twin audit`: files that describe a moving robot, read with readers that share no code with a writer."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin import api
from twin.cli import show
from twin.core.errors import TwinError
from twin.core.findings import by_severity
from twin.exchange.audit import audit as audit_
from twin.exchange.audit import key_times
from twin.exchange.audit.report import POSITION_TOL, ROTATION_TOL, quantity

if TYPE_CHECKING:
    from twin.exchange.audit import AuditReport, Check

_VERDICTS = {
    "agree": "AGREE: nothing is wrong with these files, and they say the same",
    "disagree": "DISAGREE: do not hand these files over before you know why",
    "unchecked": "UNCHECKED: something could not be read",
}


def audit(args: argparse.Namespace) -> int:
    """Audit a file or folder, print what was measured and found; exit 1 if something is wrong, 2 if unreadable."""
    path = Path(args.path)
    with show.progress(args.quiet or args.json) as progress:
        truth, mechanism = None, None
        if args.robot is not None:
            truth, mechanism = _truth(args.robot, path, progress), api.load(args.robot).weighed().mechanism
        report = audit_(path, truth=truth, mechanism=mechanism, progress=progress)
    print(show.as_json(report.as_dict()) if args.json else _text(report, args.all))
    return report.exit_code


def _truth(name: str, path: Path, progress: api.Progress) -> dict[str, tuple[np.ndarray, dict[str, np.ndarray]]]:
    """Return the poses of the reference model at the key times of the files, by protocol.

    Raises:
        TwinError: no clip of the files is named after a protocol of the robot.
    """
    from twin.reference import ReferenceModel

    robot = api.load(name)
    if robot.files is None:
        raise TwinError(f"--robot {name}: a stage has no protocols; give a robot by name, or its folder")
    progress("read key times", 0.0)
    known = robot.files.protocols()
    out = {}
    for clip, times in key_times(path).items():
        fits = [p for p in known if clip == p or clip.removesuffix("_ar").endswith(f"_{p}")]
        if not fits:
            continue
        protocol = robot.protocol(max(fits, key=len))
        trajectory = api.plan(robot, protocol, progress)
        inside = np.clip(times, 0.0, trajectory.duration)  # the last key is rounded
        model = ReferenceModel(robot.bound(protocol).mechanism)
        run = trajectory.on(model, inside)
        out[protocol.name] = (times, model.link_poses(run.x))
    if not out:
        raise TwinError(f"--robot {name}: no clip is named after one of its protocols ({', '.join(known) or 'none'})")
    return out


def _text(report: AuditReport, everything: bool) -> str:
    lines = [report.path, "", f"  {_VERDICTS[report.verdict]}", ""]
    rows = [
        (
            f["file"],
            str(f.get("units", "")),
            str(f.get("up_axis", "")),
            str(f.get("handedness", "")),
            _links(f),
            ", ".join(f"{c['name']} ({c['keys']} keys, {c['duration_s']:.3f} s)" for c in f["clips"]) or "-",
        )
        for f in report.files
    ]
    if rows:
        lines += [show.table(rows, ("file", "units", "up", "handed", "links", "clips"), fit=True), ""]
    checks = list(report.checks) if everything else _worst(report.checks)
    rows = [
        (c.check, c.file, _quantity(c.worst, c.unit), _quantity(c.tolerance, c.unit), c.where, c.when, _mark(c))
        for c in checks
    ]
    if rows:
        header = ("check", "worst in", "worst", "tolerance", "where", "when", "")
        lines += [show.table(rows, header, fit=True), ""]
    shown = [f for f in by_severity(report.findings) if everything or f.severity != "info"]
    lines += [show.finding(f) for f in shown]
    notes = len(report.findings) - len(shown)
    lines += [""] if shown else []
    lines.append(
        f"  {len(report.checks)} checks, {len(report.findings)} findings"
        + (f", {notes} of them notes (--all shows them)" if notes else "")
        + f"; poses agree within {POSITION_TOL * 1e6:g} µm and {np.degrees(ROTATION_TOL):.3g} deg"
    )
    return "\n".join(lines)


def _links(file: Mapping[str, object]) -> str:
    return f"{file['nodes']} nodes" if file["links"] is None else str(file["links"])


def _worst(checks: list[Check]) -> list[Check]:
    """Return the worst check of each kind; kinds differ by more than the clip, the file and the counts they name."""
    kinds: dict[str, Check] = {}
    for check in checks:
        kind = re.sub(r"clip '[^']*': | against [^,]*|, \d.*|\d+", "", check.check)
        first = kinds.setdefault(kind, check)
        if (check.verdict != "agree", check.worst or 0.0) > (first.verdict != "agree", first.worst or 0.0):
            kinds[kind] = check
    return list(kinds.values())


def _mark(check: Check) -> str:
    return {"agree": "ok", "disagree": "WRONG", "unchecked": "?"}[check.verdict]


def _quantity(value: float | None, unit: str) -> str:
    if value is None:
        return ""
    if unit == "rad":
        return f"{value * 180 / np.pi:.3g} deg"
    return quantity(value, "" if unit == "1" else unit, 3).strip().replace("um", "µm")
