"""A formula as it is after edits of its file, while this file exists."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from twin.core.atomic import Scratch
from twin.core.errors import KinematicsError
from twin.formula.contract import Formula
from twin.robots import load_formula
from twin.validation.explain.function_source import Edit, patched


def source_path(formula: Formula) -> Path:
    """Return the file of a formula: that of its first equation."""
    home = formula.equations[0]
    return Path(inspect.unwrap(home.variants[home.default]).__code__.co_filename)  # type: ignore[attr-defined]


@contextmanager
def edited_formula(formula: Formula, change: Sequence[Edit]) -> Iterator[Formula | None]:
    """Yield a formula after edits of its file; None if it cannot be loaded, or if an edit is in another file.

    An edit of a left side is no edit of the file alone. The edited file exists while the context lasts: what judges the
    formula may read its statements.
    """
    path = source_path(formula)
    if any(edit.path != path or edit.kind == "left side" for edit in change):
        yield None
        return
    with Scratch() as folder:
        file = Path(folder) / "formula.py"
        file.write_text(patched(change), encoding="utf-8")
        yield _loaded(formula, file)


def _loaded(formula: Formula, file: Path) -> Formula | None:
    """Return the edited formula in a file; None if it cannot be loaded."""
    joints = [(joint.name, joint.kind == "revolute") for joint in formula.joints]
    try:
        return load_formula(file, formula.name, lambda: (joints, np.eye(4), None), trial=True)
    except KinematicsError:
        return None
