"""What reading one file may cost, by format. A small file may cost little; more is allowed in step with its size."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from twin.core.errors import BudgetError

MB = 1_000_000


@dataclass(frozen=True)
class Budget:
    """Limits of one format; 0 for what is not limited.

    Attributes:
        bytes: of the file.
        unpacked: bytes, when it is an archive.
        depth: how deep its parts may be nested.
        count: its parts: elements of XML, objects and lists of JSON, nodes of glTF, prims of USD, rows of PLY.
        numbers: numbers or vertices that its parts may stand for together, when parts may be used several times.
        seconds: processor time of its native parser, and `seconds_per_mb` more for each MB it is given.
        memory: bytes that its native parser may ask for, and `memory_per_byte` more for each byte it is given.
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
    "YAML": Budget(100_000),  # its parser takes 40 µs for a byte
    "XML": Budget(16 * MB, depth=300, count=200_000),
    "JSON": Budget(48 * MB, count=3_000_000),
    "CSV": Budget(24 * MB),
    "text": Budget(16 * MB),
    "OBJ": Budget(40 * MB),
    "STL": Budget(200 * MB),
    "PLY": Budget(100 * MB, count=5_000_000),
    "3MF": Budget(50 * MB, unpacked=100 * MB, depth=30, count=1_000_000, numbers=5_000_000),
    "GLTF": Budget(200 * MB, depth=200, count=10_000, numbers=50_000_000),
    "USDZ": Budget(1000 * MB, unpacked=1000 * MB, count=10_000),
    "USD": Budget(
        1000 * MB, depth=200, count=100_000, seconds=5, seconds_per_mb=2, memory=600 * MB, memory_per_byte=20
    ),
    "MJCF": Budget(50 * MB, seconds=6, seconds_per_mb=2, memory=600 * MB, memory_per_byte=40),
    "STEP": Budget(500 * MB, seconds=6, seconds_per_mb=10, memory=600 * MB, memory_per_byte=100),
    # Triangles for masses, 5 µm from the faces, of a file within the limits above: a patient takes 1.6 GB and a minute.
    "fine STEP": Budget(500 * MB, seconds=150, seconds_per_mb=30, memory=3000 * MB, memory_per_byte=200),
}
"""By format. Honest files stay ten times or more below; what is refused has one line that says how to get smaller."""

BODIES = 1000
"""Bodies, joints or shapes of one mechanism."""

INCLUDES = 300
"""Times that a file may bring in others, all of them together."""

FREEDOMS = 200
"""Degrees of freedom of one mechanism, all joints together: the memory of its dynamics grows with their cube."""

_WAYS = {
    "TOML": "leave out what is not read",
    "XML": "split it, or leave out what is no part of the robot",
    "OBJ": "thin the mesh out, or save it as binary STL",
    "3MF": "thin the mesh out, or save it as binary STL",
    "PLY": "thin the mesh out, or save it as binary STL",
    "GLTF": "thin it out, or join nodes",
    "USD": "leave out what is no part of the robot",
    "MJCF": "leave out what is no part of the robot",
    "STEP": "leave out what is no part of the robot, or simplify it in the CAD",
}


def over(path: Path, kind: str, what: str, value: float, limit: float) -> NoReturn:
    """Raise `BudgetError`: a file wants more of something than its format's limit."""
    raise BudgetError(f"{path}: {what}: {value:,.0f}; the limit for {kind} is {limit:,.0f}. {way(kind)}")


def way(kind: str) -> str:
    """Return what to do with a file that costs too much."""
    return f"If it is meant so, {_WAYS.get(kind, 'make it smaller')}."


def read_bytes(path: Path, kind: str) -> bytes:
    """Return a whole file.

    Raises:
        BudgetError: it is too large.
        OSError: it cannot be read.
    """
    check_size(path, kind)
    return path.read_bytes()


def check_size(path: Path, kind: str) -> None:
    """Raise `BudgetError` for a file that is too large, and `OSError` for one that is none."""
    size, most = path.stat().st_size, BUDGETS[kind].bytes
    if size > most:
        over(path, kind, "bytes", size, most)
