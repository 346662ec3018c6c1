"""Run the campaign of `audit_every_field` and count what the audit found."""

from __future__ import annotations

import random
import re
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from made import audit_every_field, audit_seeds, glb_by_pygltflib
from made.audit_every_field import Change
from made.audit_read_once import ReadOnce

WORDS = ("found", "refused", "harmless", "missed")


def campaign(given: Any) -> None:
    """Judge all changes of the command line, print those that were missed, and the counts."""
    with tempfile.TemporaryDirectory() as work:
        total: Counter[str] = Counter()
        for robot in given.robots.split(","):
            good = exported(given.good, robot, Path(work))
            for part in given.parts.split(","):
                counts = judged(robot, good, part, given, Path(work) / "spoilt")
                print(f"{robot} {part}: {dict(counts)}", flush=True)
                total += counts
        known = sum(total.values()) - total["harmless"]
        print(f"found by cause {total['found']}, refused {total['refused']}, of {known}; harmless {total['harmless']}")
        print(f"missed {total['missed']}: {100 * total['missed'] / max(known, 1):.1f} %")


def exported(good: Path | None, robot: str, work: Path) -> Path:
    """Return the export of a robot in `good`; it is written if it does not exist."""
    folder = (good or work / "good") / robot
    if not folder.exists():
        audit_seeds.exported([robot], folder.parent)
    return folder


def judged(robot: str, good: Path, part: str, given: Any, target: Path) -> Counter[str]:
    rng = random.Random(f"{given.seed} {robot} {part}")
    reader = ReadOnce(good)
    counts: Counter[str] = Counter()
    changes = [c for c in audit_every_field.PARTS[part](good, rng, given.per) if re.search(given.only, c.name)]
    for change in rng.sample(changes, min(given.most, len(changes))):
        word, told = judge(change, reader, target, robot if given.robot else None)
        if word:
            counts[word] += 1
        if word in ("missed", "harmless"):
            print(f"  {word.upper()} {robot} {change.name}: {told[:230]}", flush=True)
    return counts


def _is_harmless(change: Change) -> bool:
    return any(change.part == part and re.search(what, change.name) for part, what, _ in audit_every_field.HARMLESS)


def judge(change: Change, reader: ReadOnce, target: Path, robot: str | None) -> tuple[str, str]:
    """Return what became of a change, one of WORDS or "" if the robot has nothing of it, and what the audit said."""
    if not audit_every_field.copied(reader.good, target, change):
        return "", ""
    told = audit_every_field.caused(reader.audit(target, robot), change)
    if told in ("found", "refused"):
        return told, ""
    if _is_harmless(change):
        return "harmless", told
    if change.part == "glb" and glb_by_pygltflib.same(target / change.file, reader.good / change.file):
        return "harmless", told
    return "missed", told
