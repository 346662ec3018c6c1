"""Run drawings (cad/*/model.py) in processes that have build123d already: to import it takes longer than to draw."""

from __future__ import annotations

import multiprocessing
import os
import runpy
import sys
import tempfile
from pathlib import Path

_processes = multiprocessing.get_context("forkserver")
_processes.set_forkserver_preload(["build123d"])


def draw(model: Path, *arguments: object) -> None:
    """Run a drawing's command line, each in a process of its own.

    Raises:
        ChildProcessError: it failed; the message has what it said.
    """
    with tempfile.NamedTemporaryFile() as said:
        process = _processes.Process(target=_run, args=(str(model), [str(a) for a in arguments], said.name))
        process.start()
        process.join()
        code = process.exitcode
        process.close()
        if code:
            text = Path(said.name).read_text("utf-8", "replace")[-2000:]
            raise ChildProcessError(f"{model} ended with {code}\n{text}")


def _run(model: str, arguments: list[str], said: str) -> None:
    with Path(said).open("w") as file:
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)
    sys.argv = [model, *arguments]
    sys.path.insert(0, str(Path(model).parent))
    runpy.run_path(model, run_name="__main__")
