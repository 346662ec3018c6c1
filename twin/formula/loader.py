"""Load formula files: each file is read once, and its bytes are used for execution, hash and explanation."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType
from typing import Any

ModuleNames = dict[str, Any]
"""The global names of a module, and what the author of its file gave them: functions, modules, numbers, texts."""


class Loader(SourceFileLoader):
    """Load a module from bytes that were already read; no byte code is written next to a user's file."""

    def __init__(self, name: str, path: Path, data: bytes) -> None:
        super().__init__(name, str(path))
        self.data = data

    def get_data(self, path: str) -> bytes:
        """Return the bytes that were already read, even if the file has changed since then."""
        return self.data

    def get_code(self, fullname: str) -> CodeType:
        """Return the code object compiled from the bytes."""
        return self.source_to_code(self.data, self.path)


def text_of(path: Path, names: Mapping[str, object]) -> bytes:
    """Return the bytes of a module's file: those read by the module's `Loader` or, without `Loader`, those on disk.

    `names` are the globals of the module.
    """
    loader = names.get("__loader__")
    if isinstance(loader, Loader) and Path(loader.path) == path:
        return loader.data
    stat = path.stat()
    return _stored(path, (stat.st_mtime_ns, stat.st_size))


@lru_cache(maxsize=64)
def _stored(path: Path, stamp: tuple[int, int]) -> bytes:
    """Return the bytes of a file, read once for each time and size `stamp` (ns, bytes) of it."""
    return path.read_bytes()
