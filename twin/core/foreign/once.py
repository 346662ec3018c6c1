"""Reader that opens each file once and shares its bytes."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from twin.core.foreign.budget import check_size, read_limited

Read = Callable[[Path, str], bytes]
"""Function that returns the bytes of a file from its path and format: `budget.read_bytes`, or a `Once`."""


class Once:
    """A reader that opens each file once, and again only after the file has changed on disk.

    Each robot has its own reader. Parsing and hashing then use the same bytes, and a robot in a long-running viewer
    never uses outdated text. A pickled reader is empty.
    """

    def __init__(self) -> None:
        self._known: dict[Path, tuple[tuple[int, ...], bytes]] = {}

    def __call__(self, path: Path, kind: str) -> bytes:
        """Return the bytes of a file.

        Raises:
            BudgetError: the file is too large.
            OSError: the file cannot be read.
        """
        stamp = _stamp(path.stat())
        if path in self._known:
            known_stamp, known_data = self._known[path]
            if known_stamp == stamp:
                return known_data
        check_size(path, kind)
        with path.open("rb") as file:
            stamp = _stamp(os.fstat(file.fileno()))  # of the file that is read: another may have taken its place
            data = read_limited(file, path, kind)
        self._known[path] = (stamp, data)
        return data

    def __reduce__(self) -> tuple[type[Once], tuple[()]]:
        return Once, ()


def _stamp(stat: os.stat_result) -> tuple[int, ...]:
    """Return numbers that change if a file is replaced or written."""
    return stat.st_dev, stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns
