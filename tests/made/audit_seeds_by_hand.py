"""Seeded defects that people and other tools make in exports by hand, of kinds that the audit did not find at first.

Sixty defects were written, over all formats of five robots, before the audit was read; those here were missed: the
audit reported nothing, or named another thing than the one that was broken.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from made.audit_seeds import Seed

BY_HAND: list[Seed] = []


def seed(kind: str, blamed: str, says: str) -> Callable:
    """Return a decorator that adds an edit of an export's folder to `BY_HAND`; for `blamed` and `says` see `Seed`."""

    def add(edit: Callable[[Path], None]) -> Callable[[Path], None]:
        BY_HAND.append(Seed(kind, edit, blamed, says))
        return edit

    return add


def replaced(file: Path, pattern: str, text: str) -> None:
    """Replace the only match of a pattern in a file."""
    changed, count = re.subn(pattern, text, file.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert count == 1, f"{file.name}: {count} places match {pattern}"
    file.write_text(changed, encoding="utf-8")


def robot_class(folder: Path) -> Path:
    (file,) = (folder / "unity/Runtime/Robots").glob("*.cs")
    return file


# -------------------------------------------------------------------------------------------------------- URDF


@seed("URDF: the only mimic is lost", r"\.urdf", "coupling of 'jaw'")
def mimic_lost(folder):
    replaced(next(folder.glob("*.urdf")), r"\s*<mimic [^>]*/>", "")


# -------------------------------------------------------------------------------------------------------- Unity


@seed("Unity: the class has another home", r"Kinematics\.cs", "differs is homeJoints")
def home_other(folder):
    replaced(robot_class(folder), r"(homeJoints = \{\s*)0\.0", r"\g<1>0.2")


@seed("Unity: the class takes targets that it misses", r"Kinematics\.cs", "differs is PoseTolerance")
def tolerance_wide(folder):
    replaced(robot_class(folder), r"PoseTolerance = 1e-6", "PoseTolerance = 1e-2")


@seed("Unity: the class warns of a singularity ten times later", r"Kinematics\.cs", "differs is measureAlarms")
def alarm_late(folder):
    replaced(robot_class(folder), r"(measureAlarms = \{ )0\.1,", r"\g<1>0.01,")
