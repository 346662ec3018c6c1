"""Cache of compiled kernels in the user's folder, which may be deleted at any time."""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat

from twin.core.atomic import atomic_folder
from twin.core.cache import cache_folder
from twin.core.errors import OutputError

_CACHED = 1024
"""Maximum number of kernels in the cache; the oldest kernels are removed first."""

_NAME = "kernels"

_DIGEST_SIZE = 32
"""Number of bytes of a SHA-256, with which a file begins."""


def key(target: str, text: str) -> str:
    """Return the key of a kernel: a hash of its text and of the processor, with versions, for which it is compiled."""
    return hashlib.sha256(f"{target}\n{text}".encode()).hexdigest()


def read(key: str) -> bytes | None:
    """Return the code of a kernel; None: the cache does not have it, or it cannot be trusted.

    Truncated files, and files that other users can write, are not read.
    """
    path = cache_folder(_NAME) / f"{key}.o"
    try:
        for place in (path.parent, path):
            status = place.stat()
            if status.st_uid != os.getuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
                return None
        data = path.read_bytes()
    except OSError:
        return None
    # a process that was killed, or a full disk, may have left a part of the code: running it would crash
    digest = data[:_DIGEST_SIZE]
    code = data[_DIGEST_SIZE:]
    if hashlib.sha256(code).digest() != digest:
        return None
    return code


def keep(key: str, code: bytes) -> None:
    """Store the code of a kernel. A cache that cannot be written is not an error."""
    folder = cache_folder(_NAME)
    with contextlib.suppress(OSError, OutputError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        by_age = sorted(folder.glob("*.o"), key=lambda path: path.stat().st_mtime)
        for path in by_age[:-_CACHED]:
            path.unlink()
        with atomic_folder(folder) as work:
            (work / f"{key}.o").write_bytes(hashlib.sha256(code).digest() + code)
            (work / f"{key}.o").chmod(0o600)
