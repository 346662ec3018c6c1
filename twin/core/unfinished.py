"""A register of the temporary folders that are in use, in the user's cache folder.

Each entry is a symbolic link to a folder, with the name of the folder. If a process is killed, its entries remain;
therefore any later start of twin finds the folders, wherever they are. Each start of twin reads the register, so this
module imports little.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path

from twin.core.cache import cache_folder


def register(folder: Path) -> None:
    """Enter a folder with a unique name; call this before the folder is created."""
    entry = _entry(folder)
    with contextlib.suppress(OSError, RuntimeError):  # no cache folder can be written, or there is no home folder
        entry.parent.mkdir(parents=True, exist_ok=True)
        entry.symlink_to(folder.absolute())


def remove(folder: Path) -> None:
    """Remove the entry of a folder that no longer exists."""
    with contextlib.suppress(OSError, RuntimeError):
        _entry(folder).unlink(missing_ok=True)


def abandoned() -> list[Path]:
    """Return the folders in the register that no process uses; a process locks the folders that it uses."""
    try:
        entries = list(_entry(Path()).iterdir())
    except (OSError, RuntimeError):
        return []
    folders = []
    for entry in entries:
        with contextlib.suppress(OSError):  # removed by another process, or no symbolic link
            folder = entry.readlink()
            if not _in_use(folder):
                folders.append(folder)
    return folders


def _in_use(folder: Path) -> bool:
    """Return whether the process that locked a folder is alive."""
    try:
        lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError:  # it was removed
        return False
    try:
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(lock)
    return False


def _entry(folder: Path) -> Path:
    return cache_folder("unfinished") / folder.name
