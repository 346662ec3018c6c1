"""Check an untrusted file before it is read: by size and fast counts; USD and MJCF also by their native parsers.

The native parsers run in a separate process (`guard`), because they can crash or never end. STEP and xacro run in such
a process when they are read. XML and Collada are counted while they are read; of CSV, OBJ and STL only the size is
limited.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from pathlib import Path

from twin.core.errors import BudgetError, SourceError
from twin.core.foreign.budget import (
    BUDGETS,
    DRAWING_SUFFIXES,
    GLTF_SUFFIXES,
    MJCF_SUFFIXES,
    STAGE_SUFFIXES,
    check_size,
    check_zip,
    over,
    read_bytes,
)
from twin.core.foreign.gltf import check_gltf
from twin.core.foreign.guard import pass_together, run
from twin.core.foreign.text import check_depth, count_json

_SIZE_LIMITED_KINDS = {
    ".csv": "CSV",
    ".dae": "DAE",
    ".obj": "OBJ",
    ".stl": "STL",
    **dict.fromkeys(DRAWING_SUFFIXES, "STEP"),
    ".urdf": "XML",
    ".xacro": "XML",
    ".sdf": "XML",
}
"""{suffix: format} of the files of which only the size is limited here."""

_MOST_LAYER_BYTES = 50_000_000
"""Maximum size in bytes of a text layer whose depth is checked; for a larger layer, only the limits of the parser
apply."""

_MOST_HEADER_BYTES = 1_000_000
"""Maximum size in bytes of the header of a PLY file: a normal one has less than a thousand."""


def admit(path: Path) -> None:
    """Raise an error if reading a file would exceed the limits of its format; the suffix determines the format.

    Raises:
        BudgetError: a limit is exceeded; the message names the file and the limit.
        SourceError: the native parser crashes on the file, or no limits are known for its suffix.
        OSError: the file cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix in STAGE_SUFFIXES:
        _check_usd_bytes(path)
        run(path, "USD")
    elif suffix in GLTF_SUFFIXES:
        check_gltf(path)
    elif suffix == ".3mf":
        check_zip(path, "3MF")
    elif suffix == ".ply":
        _check_ply(path)
    elif suffix in MJCF_SUFFIXES:
        check_size(path, "MJCF")
        run(path, "MJCF")
    elif suffix == ".json":
        count_json(path, read_bytes(path, "JSON"))
    elif suffix in _SIZE_LIMITED_KINDS:
        check_size(path, _SIZE_LIMITED_KINDS[suffix])
    else:
        raise SourceError(
            f"{path}: no limits are known for the suffix '{path.suffix}'; give the file the suffix of its format, "
            "such as .urdf, .xml, .sdf, .usd, .glb, .stl or .step"
        )


def admit_together(paths: Iterable[Path]) -> set[Path]:
    """Check several USD stages in one process, and return the stages that pass.

    Stages that exceed the limits of bytes, archive or depth are left out. If the parser cannot read all remaining
    stages, or if only one stage remains, the returned set is empty. Use `admit` to check each stage that is not in the
    returned set.
    """
    likely = []
    for path in paths:
        with contextlib.suppress(BudgetError, SourceError, OSError):
            _check_usd_bytes(path)
            likely.append(path)
    return set(likely) if len(likely) > 1 and pass_together(likely) else set()


def _check_usd_bytes(path: Path) -> None:
    """Raise an error if a USD file exceeds limits that its own bytes show."""
    check_size(path, "USD")
    if path.suffix.lower() == ".usdz":
        check_zip(path, "USDZ")
    elif path.stat().st_size <= _MOST_LAYER_BYTES and (data := path.read_bytes()).startswith(b"#"):
        check_depth(path, "USD", data.decode("utf-8", "replace"))


def _check_ply(path: Path) -> None:
    """Raise an error if the header states more rows (vertices, faces) than the limit, or is longer than the limit.

    The conditions on words are those of the reader, trimesh: only a line that it takes for an element counts. A header
    that ends with the file is left to the reader, which rejects the file.
    """
    check_size(path, "PLY")
    with path.open("rb") as file:
        head = file.read(_MOST_HEADER_BYTES + 1)
    for line in head.split(b"\n"):
        words = line.split()
        if b"end_header" in words:
            return
        if len(words) != 3 or b"element" not in words[0] or not words[2].isdigit():
            continue
        count = int(words[2][:18])
        if count > BUDGETS["PLY"].count:
            over(path, "PLY", "rows stated in the header", count, BUDGETS["PLY"].count)
    if len(head) > _MOST_HEADER_BYTES:
        over(path, "PLY", "bytes of the header, which does not end", len(head), _MOST_HEADER_BYTES)
