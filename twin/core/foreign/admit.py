"""Files looked at before anything else is done with them: cheap counts first, then their native parser elsewhere."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable
from pathlib import Path

from twin.core.errors import BudgetError, SourceError
from twin.core.foreign.archive import check_zip
from twin.core.foreign.budget import BUDGETS, check_size, over, read_bytes
from twin.core.foreign.gltf import check_gltf
from twin.core.foreign.guard import pass_together, try_first
from twin.core.foreign.text import check_depth, count_json

_USD = (".usd", ".usda", ".usdc", ".usdz")
_OTHER = {".csv": "CSV", ".obj": "OBJ", ".stl": "STL", ".step": "STEP", ".stp": "STEP", ".urdf": "XML", ".sdf": "XML"}

_MOST_TEXT = 50_000_000
"""Bytes of a text layer whose depth is looked at; the parser of a larger one is stopped at its limits."""


def admit(path: Path) -> None:
    """Do nothing if a file can be read at a cost that its format may have; the end of its name says the format.

    Raises:
        BudgetError: it cannot; the file and the limit are named.
        SourceError: its native parser crashes.
        OSError: it cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix in _USD:
        _look_at_usd(path)
        try_first(path, "USD")
    elif suffix in (".glb", ".gltf"):
        check_gltf(path)
    elif suffix == ".3mf":
        check_zip(path, "3MF")
    elif suffix == ".ply":
        _check_ply(path)
    elif suffix in (".xml", ".mjcf"):
        check_size(path, "MJCF")
        try_first(path, "MJCF")
    elif suffix == ".json":
        count_json(path, read_bytes(path, "JSON"))
    elif suffix in _OTHER:
        check_size(path, _OTHER[suffix])


def admit_together(paths: Iterable[Path]) -> set[Path]:
    """Return the stages, of several, that need no `admit`: they have passed in one process, or none has."""
    likely = []
    for path in paths:
        with contextlib.suppress(BudgetError, SourceError, OSError):
            _look_at_usd(path)
            likely.append(path)
    return set(likely) if len(likely) > 1 and pass_together(likely, "USD") else set()


def _look_at_usd(path: Path) -> None:
    check_size(path, "USD")
    if path.suffix.lower() == ".usdz":
        check_zip(path, "USDZ")
    elif path.stat().st_size <= _MOST_TEXT and (data := path.read_bytes()).startswith(b"#"):
        check_depth(path, "USD", data.decode("utf-8", "replace"))


def _check_ply(path: Path) -> None:
    """Believe no header that asks for more rows than a mesh has."""
    check_size(path, "PLY")
    with path.open("rb") as file:
        head = file.read(65536).partition(b"end_header")[0]
    for count in re.findall(rb"^\s*element\s+\S+\s+(\d+)", head, re.MULTILINE):
        if int(count[:18]) > BUDGETS["PLY"].count:
            over(path, "PLY", "rows that its header states", int(count[:18]), BUDGETS["PLY"].count)
