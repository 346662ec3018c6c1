"""Folders that are written completely or not at all, even if the process is killed, and temporary folders.

`atomic_folder` writes into `.twin-XXXXXXXX.tmp/new` in the target folder. When all files are written, one rename
creates a journal (a list of moves) in `.twin-XXXXXXXX.tmp`. Before this rename, the target is unchanged; after it, all
files will be moved. If the process is killed, the next process that calls `settle` completes the moves or removes the
unfinished files; each start of twin calls `settle_all`, which finds the folders of killed processes in a register. A
process locks its folder, and the kernel releases the lock when the process ends. There is no fsync: a power failure may
still lose files.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterator
from pathlib import Path

from twin.core import unfinished
from twin.core.cache import cache_folder
from twin.core.errors import OutputError

DISK_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""System error numbers for a full disk, an exceeded quota, and a file that is too large."""

UNFINISHED = ".twin-"
"""Start of the names of folders with files that are not yet complete."""

_SCRATCH_SUFFIX = ".tmp"
_SCRATCH_NAME = re.compile(r"\.twin-[a-z0-9_]{8}\.tmp")
"""Names of the folders that this module creates, in a target folder or in the folder for temporary files."""

_PARENT_LEVELS = 4
"""Number of parent folders in which `settle` searches for the journal of an interrupted write. The journal is in the
nearest parent folder that existed before the write began."""

_COMMIT = "commit"
"""File name of a journal whose moves are to be completed."""

_UNDO = "undo"
"""File name of a journal whose moves are to be undone."""


completed: list[Path] = []
"""Folders into which `atomic_folder` has moved files, oldest first; if a command is interrupted, it names them."""


@contextlib.contextmanager
def atomic_folder(target: Path, replacing: Collection[str] = ()) -> Iterator[Path]:
    """Yield a temporary folder; move its files into `target` when the block ends without an error.

    Other files in `target` stay unchanged, except old files whose paths (relative to `target`) are in `replacing`:
    these are removed in the same step, unless the block writes them again. On any error `target` stays unchanged.

    Raises:
        OutputError: the target cannot be written (read-only, full, a file with the name of a folder).
    """
    target = Path(target)
    try:
        base = _nearest_existing(target)
        settle(base)
        scratch, lock = _claimed(lambda: _new_scratch(base))
    except OSError as error:
        raise OutputError(_unwritable(target, error)) from error
    try:
        try:
            (scratch / "new").mkdir()
            (scratch / "old").mkdir()
            yield scratch / "new"
            with _locked(base):
                _commit(base, target, scratch, replacing)
            is_inner = any(map(_SCRATCH_NAME.fullmatch, target.parts))  # an outer block is still writing
            if not is_inner and cache_folder("") not in target.parents:
                completed.append(target)
        except OSError as error:
            raise OutputError(_unwritable(target, error)) from error
        except OutputError as error:  # from an inner atomic_folder: name the target, not the temporary folder
            raise OutputError(str(error).replace(str(scratch / "new"), str(target))) from error
    finally:
        try:
            _discard(scratch)
        finally:  # after Ctrl-C during the removal, `settle` can remove the rest only if the folder is not locked
            os.close(lock)


def _nearest_existing(path: Path) -> Path:
    """Return a path if it exists, else its nearest parent folder that exists."""
    if path.exists():
        return path
    for parent in path.absolute().parents:
        if parent.exists():
            return parent
    raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))


class _ProbeError(Exception):
    pass


def require_writable(target: Path) -> None:
    """Raise an error if `atomic_folder` could not write to the target; call this before a long computation.

    Raises:
        OutputError: the target cannot be written (read-only, full, a file with the name of a folder).
    """
    with contextlib.suppress(_ProbeError), atomic_folder(target):
        raise _ProbeError


def require_writable_file(path: Path) -> None:
    """Raise an error if no file could be written at this path; call this before a long computation.

    Raises:
        OutputError: the path is a folder, a device or a pipe, or its parent folder cannot be written.
    """
    if path.is_dir():
        raise OutputError(f"cannot write to {path}: it is a folder; give the name of a file, as in {path / 'name'}")
    _refuse_device(path)
    require_writable(path.parent)


def _refuse_device(path: Path) -> None:
    """Raise an `OutputError` for a device or a pipe, such as /dev/stdout, of which a new file would take the place."""
    if path.exists() and not path.is_file():
        raise OutputError(f"cannot write to {path}: it is a device or a pipe; give the name of a file")


def write_text(path: Path, text: str) -> None:
    """Write a text in UTF-8 to a file; the file has the old or the new content, also after an interrupt.

    At a symbolic link, the file to which it leads is written.

    Raises:
        OutputError: it cannot be written.
    """
    if not path.is_dir():
        _refuse_device(path)
    path = Path(os.path.realpath(path))
    beside = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        beside.write_text(text, encoding="utf-8")
        beside.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):  # below a file, or in a folder that cannot be entered, nothing was written
            beside.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error


class Scratch(tempfile.TemporaryDirectory):
    """A temporary folder; if this process is killed, the next start of twin removes the folder."""

    def __init__(self) -> None:
        def make() -> str:
            if hasattr(self, "name"):  # another process removed the folder before it was locked
                super(Scratch, self).cleanup()
            super(Scratch, self).__init__(_SCRATCH_SUFFIX, UNFINISHED)
            return self.name

        _, self._lock = _claimed(make)

    def cleanup(self) -> None:
        """Remove the folder."""
        super().cleanup()
        unfinished.remove(Path(self.name))
        with contextlib.suppress(OSError):
            os.close(self._lock)


def settle(folder: Path) -> None:
    """Complete, undo or remove unfinished writes of killed processes in a folder and its nearest parent folders."""
    place = folder.absolute()
    for base in (place, *list(place.parents)[:_PARENT_LEVELS]):
        try:
            scratch_folders = []
            for entry in os.scandir(base):
                if _SCRATCH_NAME.fullmatch(entry.name):
                    scratch_folders.append(Path(entry.path))
        except (OSError, ValueError):  # the folder does not exist, or its name is no path
            continue
        for scratch in scratch_folders:
            with contextlib.suppress(OSError, ValueError, KeyError, TypeError):  # in use, or not a journal of twin
                _settle(base, scratch)


def settle_all() -> None:
    """Complete, undo or remove the unfinished writes of all killed processes of this user, in any folder."""
    for scratch in unfinished.abandoned():
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):  # in use, or not a folder of twin
            if _SCRATCH_NAME.fullmatch(scratch.name) and scratch.is_dir():
                _settle(scratch.parent, scratch)
            if not scratch.exists():
                unfinished.remove(scratch)


def _settle(base: Path, scratch: Path) -> None:
    """Complete, undo or remove one unfinished write of a killed process in `base`; nothing while its owner is alive.

    Raises:
        OSError: the folder is locked by its owner, or was removed.
    """
    lock = os.open(scratch, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        if os.fstat(lock).st_uid != os.geteuid():
            return
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # raises while the owner process is alive
        with _locked(base):
            if (scratch / _COMMIT).is_file():
                _complete_moves(base, scratch)
            elif (scratch / _UNDO).is_file():
                _undo_moves(base, scratch)
        _discard(scratch)
    finally:
        os.close(lock)


def _discard(scratch: Path) -> None:
    """Remove a folder, unless it contains a journal whose moves must be completed or undone."""
    if (scratch / _COMMIT).is_file() or (scratch / _UNDO).is_file():
        return
    shutil.rmtree(scratch, ignore_errors=True)
    if not scratch.exists():
        unfinished.remove(scratch)


def _new_scratch(base: Path) -> str:
    """Create a temporary folder with a random name in `base`; it is registered before, as the process may be killed."""
    while True:
        scratch = base / f"{UNFINISHED}{os.urandom(4).hex()}{_SCRATCH_SUFFIX}"
        unfinished.register(scratch)
        try:
            scratch.mkdir(mode=0o700)
            return str(scratch)
        except FileExistsError:
            continue
        except OSError:
            unfinished.remove(scratch)
            raise


def _claimed(make: Callable[[], str]) -> tuple[Path, int]:
    """Create, lock and register a folder; if another process removes the folder before it is locked, try again."""
    while True:
        scratch = Path(make())
        with contextlib.suppress(FileNotFoundError):
            lock = os.open(scratch, os.O_RDONLY | os.O_DIRECTORY)
            try:
                with contextlib.suppress(OSError):  # a file system without locks
                    fcntl.flock(lock, fcntl.LOCK_EX)
                unfinished.register(scratch)
                if scratch.is_dir():
                    return scratch, lock
            except BaseException:
                os.close(lock)
                raise
            os.close(lock)


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Allow only one process at a time to move files in a folder."""
    if _SCRATCH_NAME.fullmatch(folder.name):  # this process has already locked the folder
        yield
        return
    lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
    finally:
        os.close(lock)


def _commit(base: Path, target: Path, scratch: Path, replacing: Collection[str]) -> None:
    """Move the files of `scratch`/new into the target, which is `base` or a folder in `base`."""
    below = Path(os.path.relpath(target.absolute(), base.absolute()))
    new = scratch / "new"
    new_files = []
    for path in new.rglob("*"):
        if path.is_file():
            new_files.append(path.relative_to(new))
    new_files.sort()
    dropped_files = sorted(set(map(Path, replacing)) - set(new_files))
    placed_names = [(below / path).as_posix() for path in new_files]
    dropped_names = [(below / path).as_posix() for path in dropped_files]
    # Old files are kept by their number in the journal, until all moves are done.
    for number, name in enumerate([*placed_names, *dropped_names]):
        final = base / name
        if final.is_file():
            _copy_aside(final, scratch / "old" / str(number))
        elif final.exists():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(final))
    folders = set()
    moves = []
    for name, path in zip(placed_names, new_files, strict=True):
        folders.add((base / name).parent)
        moves.append([name, path.as_posix()])
    if new_files:
        folders.add(target)
    data = {
        "put": moves,
        "drop": dropped_names,
        "made": [folder.relative_to(base).as_posix() for folder in _missing_folders(folders, base)],
    }
    (scratch / "journal").write_text(json.dumps(data), encoding="utf-8")
    os.rename(scratch / "journal", scratch / _COMMIT)  # noqa: PTH104 - os.rename names the atomic system call
    try:
        _complete_moves(base, scratch)
    except BaseException:
        if (scratch / _COMMIT).is_file():  # otherwise all moves were done before the interrupt
            os.rename(scratch / _COMMIT, scratch / _UNDO)  # noqa: PTH104
            _undo_moves(base, scratch)
        raise


def _missing_folders(folders: Collection[Path], base: Path) -> list[Path]:
    """Return the folders, and their parent folders in `base`, that do not exist, sorted."""
    missing = set()
    for folder in folders:
        for path in (folder, *folder.parents):
            if path.is_relative_to(base) and not path.exists():
                missing.add(path)
    return sorted(missing)


def _complete_moves(base: Path, scratch: Path) -> None:
    """Complete the moves of a journal; moves that are already done are skipped."""
    journal = json.loads((scratch / _COMMIT).read_text(encoding="utf-8"))
    for name, source in journal["put"]:
        fresh = _inside(scratch / "new", source)
        if fresh.is_file():
            final = _inside(base, name)
            final.parent.mkdir(parents=True, exist_ok=True)
            os.replace(fresh, final)  # noqa: PTH105
    for name in journal["drop"]:
        _remove_file(base, _inside(base, name))
    (scratch / _COMMIT).unlink()  # from here on the folder can be removed


def _undo_moves(base: Path, scratch: Path) -> None:
    """Undo the moves of a journal: restore the previous files."""
    journal = json.loads((scratch / _UNDO).read_text(encoding="utf-8"))
    moves = list(journal["put"])
    for name in journal["drop"]:
        moves.append((name, None))
    for number, (name, source) in enumerate(moves):
        with contextlib.suppress(OSError):  # the other files must be restored all the same
            final = _inside(base, name)
            old_copy = scratch / "old" / str(number)
            if old_copy.is_file():
                final.parent.mkdir(parents=True, exist_ok=True)
                os.replace(old_copy, final)  # noqa: PTH105
            elif source is not None and not _inside(scratch / "new", source).is_file():
                final.unlink(missing_ok=True)
    for folder in sorted(journal["made"], key=len, reverse=True):
        with contextlib.suppress(OSError):
            _inside(base, folder).rmdir()
    (scratch / _UNDO).unlink()


def _inside(base: Path, name: str) -> Path:
    """Return the path of a file that a journal names; the journal is untrusted: another user may have written it.

    Raises:
        ValueError: the path is outside `base`.
    """
    path = base / name
    if not path.parent.resolve().is_relative_to(base.resolve()) or ".." in Path(name).parts:
        raise ValueError(f"{name} is outside {base}")
    return path


def _remove_file(base: Path, file: Path) -> None:
    """Remove a file, and then its parent folders below `base` that are empty."""
    file.unlink(missing_ok=True)
    for parent in file.parents:
        if parent == base or not parent.is_relative_to(base):
            return
        try:
            parent.rmdir()
        except OSError:
            return


def _copy_aside(file: Path, copy: Path) -> None:
    """Create a second copy of a file, as a hard link if possible."""
    try:
        copy.hardlink_to(file)
    except OSError:  # a file system without links
        shutil.copy2(file, copy)


def no_room(error: BaseException) -> str:
    """Return an error text with advice for a full disk; "" for any other error."""
    if not (isinstance(error, OSError) and error.errno in DISK_FULL):
        return ""
    written = _unwritten_path(error)
    place = Path(written).parent if written else "the disk"
    return (
        f"cannot write to {place}: {error.strerror}. Free some space, or choose another folder with --out, or, for "
        f"temporary files (now {tempfile.gettempdir()}), with TMPDIR."
    )


def _unwritable(target: Path, error: OSError) -> str:
    """Return the message for a target that cannot be written, with the way out."""
    text = f"cannot write to {target}: {error.strerror or error}. Choose another folder with --out."
    if error.errno not in DISK_FULL:
        return text
    written = _unwritten_path(error)
    if written and not Path(written).absolute().is_relative_to(target.absolute().parent):
        return no_room(error)  # the error concerns another file
    return f"{text} Temporary files are in {tempfile.gettempdir()} (TMPDIR)."


def _unwritten_path(error: OSError) -> str | None:
    """Return the path that could not be written (for a copy or a move: the destination); None if it is unknown."""
    return error.filename2 or error.filename
