"""The user's consent to code in files that others write: it is stated on stderr when it runs, and can be refused."""

from __future__ import annotations

import logging
import os
from pathlib import Path

from twin.core.errors import CodeRefusedError

NO_CODE = "TWIN_NO_CODE"
"""Environment variable; if it is set, no Python code of a robot folder or of a xacro is run, not even in child
processes."""

_XACRO_CODE = "the Python expressions of the xacro"

_announced_files: set[Path] = set()


def require_consent(path: Path) -> None:
    """State on stderr, once for each file, that the Python expressions of a xacro run.

    Raises:
        CodeRefusedError: the environment variable TWIN_NO_CODE is set.
    """
    if os.environ.get(NO_CODE):
        raise CodeRefusedError(
            f"{path}: reading this file runs {_XACRO_CODE}, which --no-code (or {NO_CODE} in the environment) forbids. "
            f"Inspect the file, then omit --no-code or {NO_CODE}; a URDF that `xacro` has made needs no code."
        )
    resolved = path.resolve()
    if resolved not in _announced_files:
        _announced_files.add(resolved)
        logging.getLogger(__name__).info("running %s in %s", _XACRO_CODE, path)
