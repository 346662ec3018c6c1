"""Native parsers tried in a process of their own: a file that makes one crash or hang must not take twin with it."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

from twin.errors import SourceError

_PROGRAMS = {
    "MJCF": "import mujoco, sys; mujoco.MjSpec.from_file(sys.argv[1]).compile()",
    "USD": "from pxr import Usd; import sys; s = Usd.Stage.Open(sys.argv[1]); list(s.Traverse())",
    "STEP": (
        "import cascadio, sys, tempfile\n"
        "with tempfile.TemporaryDirectory() as d:\n"
        "    cascadio.step_to_glb(sys.argv[1], d + '/x.glb', 1.0, 0.5, include_brep=True)"
    ),
}

_PATIENCE = 120.0
"""Seconds after which a parser is given up."""


def try_first(path: Path, kind: str) -> None:
    """Let the parser of a format read the file, elsewhere. What it merely refuses is told by the reader itself.

    Raises:
        SourceError: the parser crashed, or did not end.
    """
    command = [sys.executable, "-I", "-c", _PROGRAMS[kind], str(path.resolve())]
    try:
        done = subprocess.run(command, capture_output=True, timeout=_PATIENCE, check=False)
    except subprocess.TimeoutExpired as error:
        raise SourceError(f"{path}: the {kind} parser does not come to an end with it ({_PATIENCE:g} s)") from error
    if done.returncode < 0:
        name = signal.Signals(-done.returncode).name
        raise SourceError(f"{path}: the {kind} parser crashes on it ({name}): the file is damaged, or hits a bug of it")
