"""Published equations of the built-in robots, one file for each robot, and functions that find and load such files.

A file of this package and a user's `formula.py` follow the same contract (`twin.formula.contract`) and are loaded in
the same way. Instead of FORMULA, both may define plain functions `inverse(pose)`, `forward(q)` (`twin.formula.plain`).
Loading a formula runs its file. Importing this package does not import CasADi; loading a formula does.
"""

from __future__ import annotations

import hashlib
import importlib.util
import logging
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from twin.core.errors import CodeRefusedError, KinematicsError, unknown
from twin.core.foreign.budget import read_bytes
from twin.core.foreign.consent import NO_CODE
from twin.core.program_end import ProgramEndError, contained

if TYPE_CHECKING:
    from types import ModuleType

    from twin.core.foreign.once import Read
    from twin.core.spatial import Array
    from twin.formula.contract import Formula

_FOLDER = Path(__file__).resolve().parent
_logged_paths: set[Path] = set()
"""Files outside this package whose execution has been logged."""

FORMULA_MODULE = "_twin_formula_"
"""Prefix of the name under which a formula file outside this package is imported as a module."""


def names() -> list[str]:
    """Return the names of the robots that have a formula in this package."""
    robots: list[str] = []
    for file in _FOLDER.glob("*.py"):
        if not file.stem.startswith("_"):  # modules that several robots share
            robots.append(file.stem)
    return sorted(robots)


def load_formula(
    robot: str | Path,
    name: str = "",
    driven: Callable[[], tuple[Sequence[tuple[str, bool]], Array, Array | None]] | None = None,
    trial: bool = False,
    read: Read = read_bytes,
) -> Formula:
    """Return the formula of a built-in robot (by name) or of a file or robot folder (by path).

    Args:
        robot: name or path.
        name: name of the robot, for a plain formula; default: the name of its folder.
        driven: function called for a plain formula. It returns a list of (name, is_angle) of the active joints, a tool
            pose (4, 4) at which solvers start, and q (n,) at this pose, or None instead of q.
        trial: whether the file is a copy of a file that was run before; the execution of other files is logged.
        read: function that returns the bytes of a file outside this package.

    Raises:
        KinematicsError: the file does not exist, cannot be imported (the message gives file and line), has no FORMULA
            and no plain functions, or violates the contract.
        CodeRefusedError: the file is outside this package, and the environment variable TWIN_NO_CODE is set.
    """
    path = _FOLDER / f"{robot}.py" if str(robot) in names() else Path(robot)
    if path.is_dir():
        path = path / "formula.py"
    if not path.is_file():
        raise KinematicsError(f"{unknown('formula', str(robot), names())} A path to a formula.py is accepted too.")
    module = _import(path.resolve(), trial, read)
    from twin.formula.contract import check_formula
    from twin.formula.plain import is_plain, plain_formula

    formula = getattr(module, "FORMULA", None)
    if formula is None and is_plain(module):
        if driven is None:
            raise KinematicsError(f"{path}: a plain formula requires the robot's joints: load the robot, not the file.")
        joints, T, q = driven()
        formula = plain_formula(module, path.resolve(), name or path.resolve().parent.name, joints, (T, q))
    elif formula is None:
        raise KinematicsError(
            f"{path}: it defines no FORMULA and no plain functions: write inverse(pose), forward(q) or both."
        )
    try:
        check_formula(formula)
    except KinematicsError as error:
        raise KinematicsError(f"{path}: {error}") from error
    return formula


def _import(path: Path, trial: bool, read: Read) -> ModuleType:
    if path.parent == _FOLDER:
        name = f"twin.robots.{path.stem}"
        if name in sys.modules:
            return sys.modules[name]
    else:
        name = f"{FORMULA_MODULE}{hashlib.sha256(str(path).encode()).hexdigest()[:12]}"
        if os.environ.get(NO_CODE):
            raise CodeRefusedError(
                f"{path}: reading the equations runs this file, which --no-code (or {NO_CODE} in the environment) "
                f"forbids. Inspect the file, then omit --no-code or {NO_CODE}; `twin audit` and USD stages need no "
                "equations."
            )
        if not trial and path not in _logged_paths:  # logged once, before code of an untrusted folder runs
            _logged_paths.add(path)
            logging.getLogger(__name__).info("running the Python code in %s", path)
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise KinematicsError(f"{path}: not a Python file; its name must end in .py.")
    try:
        if path.parent != _FOLDER:
            from twin.formula.loader import Loader

            spec.loader = Loader(name, path, read(path, "text"))
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module  # dataclasses look up their module while its code runs
        with contained(path):
            spec.loader.exec_module(module)
    except ProgramEndError:
        sys.modules.pop(name, None)
        raise
    except Exception as error:
        sys.modules.pop(name, None)
        raise KinematicsError(f"{path}:{_line_of(error, path)}: {type(error).__name__}: {error}") from error
    return module


def _line_of(error: Exception, path: Path) -> int:
    if isinstance(error, SyntaxError) and error.lineno:
        return error.lineno
    line = 1
    for entry in traceback.extract_tb(error.__traceback__):
        if entry.filename == str(path):
            line = entry.lineno or 1  # the last entry of the file is the innermost
    return line
