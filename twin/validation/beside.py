"""Run a function in a second Python process, beside what this one does.

A plain child process rather than `multiprocessing`, which would run the user's own script again (spawn) or is
unsafe once threads exist (fork).
"""

from __future__ import annotations

import importlib
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

from twin.core.atomic import Scratch, no_room
from twin.core.errors import TwinError
from twin.core.processes import isolated

_PROGRAM = "from twin.validation.beside import serve; serve()"


class Beside:
    """A call in a child process; `result` waits for it, leaving the `with` block ends it.

    Args:
        function: a module-level function; it, its arguments and its result are pickled.
        arguments: its arguments.
    """

    def __init__(self, function: Callable[..., Any], *arguments: Any) -> None:
        self._folder = Scratch()
        self._answer = Path(self._folder.name) / "answer"
        task = Path(self._folder.name) / "task"
        task.write_bytes(pickle.dumps((function.__module__, function.__qualname__, arguments)))
        self._log = Path(self._folder.name) / "log"
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                isolated(_PROGRAM, task, self._answer),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )

    def result(self) -> Any:
        """Return what the function returned.

        Raises:
            TwinError: what the function raised, or that the process died.
        """
        self._process.wait()
        if not self._answer.is_file():
            raise TwinError(f"a second process died: {self._log.read_text(errors='replace')[-500:]}")
        answer, error = pickle.loads(self._answer.read_bytes())
        if error is not None:
            raise error
        return answer

    def __enter__(self) -> Beside:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        self._folder.cleanup()


def serve() -> None:
    """Do the task in the file named by the first argument, write the answer to the second: the child's side."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    task, answer = (Path(p) for p in sys.argv[1:])
    module, name, arguments = pickle.loads(task.read_bytes())
    outcome: tuple[Any, TwinError | None]
    try:
        outcome = getattr(importlib.import_module(module), name)(*arguments), None
    except TwinError as error:
        # Errors with more than a message would not survive pickling.
        outcome = None, TwinError(f"{type(error).__name__}: {error}")
    except OSError as error:
        if not (full := no_room(error)):
            raise
        outcome = None, TwinError(full)
    answer.write_bytes(pickle.dumps(outcome))
