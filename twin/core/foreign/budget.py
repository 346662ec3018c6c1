"""Limits for reading one file or archive, by format; time and memory limits grow with the size of the file."""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NoReturn

from twin.core.errors import BudgetError

MB = 1_000_000

STAGE_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
"""Suffixes of OpenUSD stages and layers."""

DRAWING_SUFFIXES = (".step", ".stp")
"""Suffixes of CAD drawings."""

GLTF_SUFFIXES = (".glb", ".gltf")
"""Suffixes of glTF files."""

MJCF_SUFFIXES = (".xml", ".mjcf")
"""Suffixes of MJCF files."""


@dataclass(frozen=True)
class Budget:
    """Limits of one format; 0 means no limit.

    Attributes:
        bytes: maximum size of the file.
        unpacked: maximum bytes of all files of an archive together.
        depth: maximum nesting of the parts of the file.
        count: maximum number of parts of the file: elements of XML and Collada, objects and lists of JSON, nodes of
            glTF, prims of USD, rows of PLY.
        numbers: maximum number of values or vertices; the triangles of a part that is used n times are counted n times.
        seconds, seconds_per_mb: maximum processor time of the native parser in s, and its increase per MB of the file.
        memory, memory_per_byte: maximum memory of the native parser in bytes, and its increase per byte of the file.
    """

    bytes: int
    unpacked: int = 0
    depth: int = 0
    count: int = 0
    numbers: int = 0
    seconds: float = 0.0
    seconds_per_mb: float = 0.0
    memory: int = 0
    memory_per_byte: int = 0


BUDGETS = {
    "TOML": Budget(500_000, depth=20),
    "YAML": Budget(100_000),  # the YAML parser takes 40 µs for each byte
    "XML": Budget(16 * MB, depth=300, count=200_000),
    "JSON": Budget(48 * MB, count=3_000_000),
    "CSV": Budget(24 * MB),
    "text": Budget(16 * MB),
    "OBJ": Budget(40 * MB),
    "STL": Budget(200 * MB),
    "PLY": Budget(100 * MB, count=5_000_000),
    "3MF": Budget(50 * MB, unpacked=100 * MB, depth=30, count=1_000_000, numbers=5_000_000),
    "DAE": Budget(60 * MB, depth=100, count=300_000, numbers=30_000_000),
    "GLTF": Budget(200 * MB, depth=200, count=10_000, numbers=50_000_000),
    "USDZ": Budget(1000 * MB, unpacked=1000 * MB, count=10_000),
    "USD": Budget(
        1000 * MB, depth=200, count=100_000, seconds=5, seconds_per_mb=2, memory=600 * MB, memory_per_byte=20
    ),
    "xacro": Budget(16 * MB, seconds=8, seconds_per_mb=10, memory=600 * MB, memory_per_byte=100),
    "MJCF": Budget(50 * MB, seconds=6, seconds_per_mb=2, memory=600 * MB, memory_per_byte=40),
    "STEP": Budget(500 * MB, seconds=6, seconds_per_mb=10, memory=600 * MB, memory_per_byte=100),
    # For masses: triangles within 5 µm of the faces. For comparison, a patient model takes 1.6 GB and one minute.
    "fine STEP": Budget(500 * MB, seconds=150, seconds_per_mb=30, memory=3000 * MB, memory_per_byte=200),
}
"""Limits by format. Normal files need at most a tenth of each limit; error messages suggest how to reduce a file."""

BODIES = 1000
"""Maximum number of bodies, of joints, and of shapes in one mechanism."""

INCLUDES = 300
"""Maximum number of files that a file includes, directly or through other included files."""

FREEDOMS = 200
"""Maximum sum of the joints' degrees of freedom; the memory for the dynamics grows with the cube of this sum."""

_WAYS = {
    "TOML": "remove unused parts",
    "XML": "split the file, or remove the parts that do not belong to the robot",
    "OBJ": "reduce the mesh, or save it as binary STL",
    "3MF": "reduce the mesh, or save it as binary STL",
    "PLY": "reduce the mesh, or save it as binary STL",
    "DAE": "reduce the mesh, or save it as binary STL",
    "GLTF": "simplify the meshes, or merge nodes",
    "USD": "remove the parts that do not belong to the robot",
    "xacro": "remove the parts that do not belong to the robot; if not, look for a macro or an expression without end",
    "MJCF": "remove the parts that do not belong to the robot",
    "STEP": "remove the parts that do not belong to the robot, or simplify the parts in the CAD",
}


def over(path: Path, kind: str, what: str, value: float, limit: float) -> NoReturn:
    """Raise a `BudgetError` that states the value and the limit of a file."""
    raise BudgetError(f"{path}: {what}: {value:,.0f}; the limit for {kind} is {limit:,.0f}. {way(kind)}")


def way(kind: str) -> str:
    """Return advice for reducing a file that exceeds a limit."""
    return f"If the file is correct, {_WAYS.get(kind, 'make the file smaller')}."


def read_bytes(path: Path, kind: str) -> bytes:
    """Return the bytes of a file that is within the size limit of its format.

    Raises:
        BudgetError: the file is too large.
        OSError: the file cannot be read.
    """
    check_size(path, kind)
    with path.open("rb") as file:
        return read_limited(file, path, kind)


def read_limited(file: BinaryIO, path: Path, kind: str) -> bytes:
    """Return all bytes of an open file, whose size has been checked; a device or a pipe states none, and may not end.

    Raises:
        BudgetError: the file is too large.
        OSError: the file cannot be read.
    """
    if stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        return file.read()
    limit = BUDGETS[kind].bytes
    data = file.read(limit + 1)
    if len(data) > limit:
        over(path, kind, "bytes so far", len(data), limit)
    return data


def check_size(path: Path, kind: str, budget: Budget | None = None) -> None:
    """Raise `BudgetError` for a file that is too large, and `OSError` if the file does not exist.

    `budget` contains the limits of a kind that is not in `BUDGETS`.
    """
    limits = BUDGETS[kind] if budget is None else budget
    size = path.stat().st_size
    if size > limits.bytes:
        over(path, kind, "bytes", size, limits.bytes)


def check_zip(path: Path, kind: str) -> None:
    """Raise an error if the files of an archive together exceed the limits; a file that is not an archive passes.

    The check uses the sizes stated in the archive. This is safe, because unpacking reads no more bytes than stated.

    Raises:
        BudgetError: the archive has too many files, or they are too large.
        OSError: the file cannot be read.
    """
    import zipfile  # only archives need it

    check_size(path, kind)
    limits = BUDGETS[kind]
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
    except (zipfile.BadZipFile, EOFError, NotImplementedError, RuntimeError, ValueError):
        return
    if kind == "USDZ" and len(entries) > limits.count:
        over(path, kind, "files in the archive", len(entries), limits.count)
    size = sum(entry.file_size for entry in entries)
    if size > limits.unpacked:
        over(path, kind, "unpacked bytes", size, limits.unpacked)
