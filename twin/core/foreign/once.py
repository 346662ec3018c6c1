"""Files that are read once, however many ask for them."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from twin.core.foreign.budget import check_size

Read = Callable[[Path, str], bytes]
"""Reader of a whole file, given its path and the format whose limits hold: `budget.read_bytes`, or a `Once`."""


class Once:
    """A reader that opens each file once, and again only after the file has changed on disk.

    It belongs to one robot: what is parsed and what is hashed are then the same bytes, and a robot that lives long (in
    a viewer) never gets an old text. It is pickled empty.
    """

    def __init__(self) -> None:
        self._known: dict[Path, tuple[tuple[int, ...], bytes]] = {}

    def __call__(self, path: Path, kind: str) -> bytes:
        """Return a whole file.

        Raises:
            BudgetError: it is too large.
            OSError: it cannot be read.
        """
        stamp = _stamp(path.stat())
        if (known := self._known.get(path)) is not None and known[0] == stamp:
            return known[1]
        check_size(path, kind)
        with path.open("rb") as file:
            stamp, data = _stamp(os.fstat(file.fileno())), file.read()
        self._known[path] = stamp, data
        return data

    def __reduce__(self) -> tuple[type[Once], tuple[()]]:
        return Once, ()


def _stamp(stat: os.stat_result) -> tuple[int, ...]:
    return stat.st_dev, stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns
