"""One file per robot: its published equations, and how such files are found and loaded.

A file here and a user's `formula.py` elsewhere obey the same contract (`twin.formula.contract`) and load the same way;
either may hold plain functions instead, `inverse(pose)` and `forward(q)` (`twin.formula.plain`). Loading a formula runs
its file. Importing this package imports no CasADi; loading a formula does.
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

if TYPE_CHECKING:
    from types import ModuleType

    from twin.core.foreign.once import Read
    from twin.core.spatial import Array
    from twin.formula.contract import Formula

_FOLDER = Path(__file__).resolve().parent
_said: set[Path] = set()

NO_CODE = "TWIN_NO_CODE"
"""Environment variable: while it is set, no Python of a robot's folder is run, in child processes either."""


def names() -> list[str]:
    """Return the names of the robots that have a formula here."""
    return sorted(p.stem for p in _FOLDER.glob("*.py") if not p.stem.startswith("_"))


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
        name: of the robot, for a plain formula; default the name of its folder.
        driven: called for a plain formula: returns active joints in order and whether each is an angle; a tool pose
            (4, 4) of the robot, and q there or None, for solvers to begin at.
        trial: a copy of a file that runs already; for any other, a notice is logged once that its code is run.
        read: gives the bytes of a file that is not of this package.

    Raises:
        KinematicsError: if there is no such file, it cannot be imported (file and line are named), it has no FORMULA
            and no plain functions, or breaks the contract.
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
            raise KinematicsError(f"{path}: a plain formula needs the robot's joints: load the robot, not the file.")
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
        name = f"_twin_formula_{hashlib.sha256(str(path).encode()).hexdigest()[:12]}"
        if os.environ.get(NO_CODE):
            raise CodeRefusedError(
                f"{path}: reading these equations runs this file, which --no-code (or {NO_CODE} in the environment) "
                "forbids. Read the file, then omit that option; `twin audit` and USD stages need no equations."
            )
        if not trial and path not in _said:  # warn once before code of an untrusted folder runs
            _said.add(path)
            logging.getLogger(__name__).info("running the Python code in %s", path)
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise KinematicsError(f"{path}: not a Python file; its name must end in .py.")
    try:
        if path.parent != _FOLDER:
            from twin.formula.loader import Loader

            spec.loader = Loader(name, path, read(path, "text"))
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module  # dataclasses look their module up while it runs
        spec.loader.exec_module(module)
    except Exception as error:
        sys.modules.pop(name, None)
        raise KinematicsError(f"{path}:{_line(error, path)}: {type(error).__name__}: {error}") from error
    return module


def _line(error: Exception, path: Path) -> int:
    if isinstance(error, SyntaxError) and error.lineno:
        return error.lineno
    lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
    return lines[-1] or 1 if lines else 1
