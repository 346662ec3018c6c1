"""Where the data folders are: in a checkout beside pyproject.toml, in an installed wheel in twin/_data.

A robot of one's own is one folder with `cad/`, `trajectories/`, `usd/` and `formula.py` inside; a
built-in robot is spread over three places. `RobotFiles` gives the same paths for both.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from twin.errors import KinematicsError, OutputError, TwinError, unknown

_BESIDE = ("dimensions", "inertia", "exhibit", "scene")
"""What may lie beside a description in a robot's cad/ folder."""

NO_EQUATIONS = "FORMULA = None"
"""The line of a formula.py that waits for its equations."""

_PACKAGE = Path(__file__).resolve().parent


def data_folder() -> Path:
    """Return the folder that holds cad/, usd/ and trajectories/."""
    installed = _PACKAGE / "_data"
    return installed if installed.is_dir() else _PACKAGE.parent


def is_checkout() -> bool:
    """Return whether twin runs from a source checkout, where `build` may write usd/."""
    return data_folder() == _PACKAGE.parent and (_PACKAGE.parent / "pyproject.toml").is_file()


@dataclass(frozen=True)
class RobotFiles:
    """The paths of one robot; they need not all exist."""

    name: str
    cad: Path
    usd: Path
    trajectories: Path
    formula: Path

    @property
    def description(self) -> Path:
        """The robot's TOML file."""
        return self.cad / f"{self.name}.toml"

    @property
    def has_equations(self) -> bool:
        """Whether there is a formula that is no empty template: one has the line `FORMULA = None`; nothing is run."""
        try:
            return NO_EQUATIONS not in self.formula.read_text("utf-8", "replace").splitlines()
        except OSError:
            return False

    @property
    def stage(self) -> Path:
        """The robot's USD root layer."""
        return self.usd / f"{self.name}.usda"

    def protocols(self) -> dict[str, Path]:
        """Return the protocol files by name."""
        return {p.stem: p for p in sorted(self.trajectories.glob("*.toml"))}

    def protocol(self, name: str) -> Path:
        """Return the file of one protocol.

        Raises:
            TwinError: if there is none of that name; the message lists those that exist.
        """
        known = self.protocols()
        if name not in known:
            raise TwinError(f"{self.name}: {unknown('protocol', name, known)}")
        return known[name]


def equations(files: RobotFiles | None, name: str) -> Path:
    """Return the file of a robot's equations; `files` is None for a bare stage.

    Raises:
        KinematicsError: there is none, or it is still the empty template.
    """
    if files is None or not files.formula.is_file():
        raise KinematicsError(f"robot '{name}' has no equations: formula.py is missing")
    if not files.has_equations:
        raise KinematicsError(
            f"{files.formula}: there are no equations yet, so nothing can be planned or judged. Write `inverse` or "
            f"`forward` there, and take the line `{NO_EQUATIONS}` out."
        )
    return files.formula


def names() -> list[str]:
    """Return the names of the built-in robots: every cad/<name>/<name>.toml."""
    return sorted(p.parent.name for p in data_folder().glob("cad/*/*.toml") if p.stem == p.parent.name)


def files(robot: str | Path) -> RobotFiles:
    """Return the paths of a built-in robot (by name) or of a robot folder (by path).

    Raises:
        TwinError: if it is neither.
    """
    if str(robot) in names():
        root, name = data_folder(), str(robot)
        return RobotFiles(
            name,
            root / "cad" / name,
            root / "usd" / name,
            root / "trajectories" / name,
            _PACKAGE / "robots" / f"{name}.py",
        )
    folder = Path(robot)
    if folder.is_dir():
        folder = folder.resolve()
        descriptions = [p for p in (folder / "cad").glob("*.toml") if p.stem not in _BESIDE]
        if len(descriptions) != 1:
            raise TwinError(
                f"robot folder {folder}: expected one robot description in {folder / 'cad'}, found "
                f"{[p.name for p in descriptions] or 'none'}. A robot folder holds cad/<name>.toml, "
                "trajectories/ and formula.py."
            )
        return RobotFiles(
            descriptions[0].stem,
            folder / "cad",
            folder / "usd",
            folder / "trajectories",
            folder / "formula.py",
        )
    raise TwinError(f"{unknown('robot', str(robot), names())} A path to a robot folder is accepted too.")


@contextlib.contextmanager
def atomic_folder(target: Path) -> Iterator[Path]:
    """Yield a temporary folder; move its files into `target` when the block ends without an error.

    Files that the block does not write stay as they are. On any error `target` is left untouched.

    Raises:
        OutputError: if the target cannot be written (read-only, full, a file in the way).
    """
    target = Path(target)
    missing = [p for p in (target, *target.parents) if not p.exists()]
    try:
        target.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=".twin-", dir=target))
        spare = [work]
    except OSError as error:
        for folder in missing:  # also a parent that this call made
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise OutputError(_unwritable(target, error)) from error
    moved: list[tuple[Path, Path | None]] = []
    done = False
    try:
        yield work
        old = Path(tempfile.mkdtemp(prefix=".twin-", dir=target))
        spare.append(old)
        for i, source in enumerate(sorted(p for p in work.rglob("*") if p.is_file())):
            final = target / source.relative_to(work)
            missing += [p for p in (final.parent, *final.parent.parents) if not p.exists()]
            final.parent.mkdir(parents=True, exist_ok=True)
            moved.append((final, _spare(final, old / str(i)) if final.is_file() else None))
            os.replace(source, final)  # noqa: PTH105 - Path.replace is the same call, this name says atomic
        done = True
    except OSError as error:
        raise OutputError(_unwritable(target, error)) from error
    finally:
        if not done:
            _undo(moved)
        for folder in spare:
            shutil.rmtree(folder, ignore_errors=True)
        if not done:
            for folder in sorted(missing, key=lambda p: -len(p.parts)):
                with contextlib.suppress(OSError):
                    folder.rmdir()


class _ProbeError(Exception):
    pass


def require_writable(target: Path) -> None:
    """Do nothing if `atomic_folder` could write there: for those who compute long before they write.

    Raises:
        OutputError: as `atomic_folder`.
    """
    with contextlib.suppress(_ProbeError), atomic_folder(target):
        raise _ProbeError


def _spare(file: Path, kept: Path) -> Path:
    """Keep a second copy of a file, without taking it away."""
    try:
        kept.hardlink_to(file)
    except OSError:  # a file system without links
        shutil.copy2(file, kept)
    return kept


def _undo(moved: list[tuple[Path, Path | None]]) -> None:
    """Put back what was there before; `moved` holds each file and where its forerunner is kept."""
    for final, kept in reversed(moved):
        with contextlib.suppress(OSError):
            if kept is not None:
                os.replace(kept, final)  # noqa: PTH105
            else:
                final.unlink(missing_ok=True)


def _unwritable(target: Path, error: OSError) -> str:
    return f"cannot write to {target}: {error.strerror or error}. Choose another folder with --out."
