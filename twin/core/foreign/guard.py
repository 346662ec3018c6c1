"""Run native parsers first in a separate process, so that a crash or an endless wait of a parser does not affect twin.

The operating system limits the processor time and memory of the separate process; the limits (`Budget`) grow with the
file sizes.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import tempfile
import time
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import IO

from twin.core.errors import BudgetError, SourceError
from twin.core.foreign.budget import BODIES, BUDGETS, MB, MJCF_SUFFIXES, STAGE_SUFFIXES, way
from twin.core.processes import Child, isolated

_LIMITS_PROGRAM = """
import resource, sys
def most(what, value):
    resource.setrlimit(what, (value, resource.getrlimit(what)[1]))
most(resource.RLIMIT_CORE, 0)
most(resource.RLIMIT_CPU, int(sys.argv[1]))
most(resource.RLIMIT_DATA, int(sys.argv[2]))
def over(what, value, limit):
    sys.exit(f"over at least {value:,} {what}; the limit is {limit:,}")
"""
"""Beginning of each program in the separate process: its arguments are processor time in s, memory in bytes, files."""

_PARSERS = {
    "MJCF": "import mujoco; mujoco.MjData(mujoco.MjSpec.from_file(sys.argv[3]).compile())",
    "USD": f"""
from pxr import Usd
for path in sys.argv[3:]:
    most_prims, most_depth, count, bodies = {BUDGETS["USD"].count}, {BUDGETS["USD"].depth}, 0, 0
    stage = Usd.Stage.Open(path)
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        count += 1
        if count > most_prims:
            over("prims", count, most_prims)
        if prim.GetPath().pathElementCount > most_depth:
            over("levels of prims", prim.GetPath().pathElementCount, most_depth)
        bodies += prim.HasAPI("PhysicsRigidBodyAPI") or prim.IsA("PhysicsJoint")
        if bodies > 2 * {BODIES}:
            over("bodies and joints", bodies, 2 * {BODIES})
        if prim.IsA("Mesh"):
            prim.GetAttribute("points").Get(), prim.GetAttribute("faceVertexIndices").Get()
""",
    # cascadio imports trimesh to register itself; the import takes longer than reading most files.
    "STEP": """
sys.modules["trimesh"] = None
import cascadio
sys.exit(cascadio.step_to_glb(sys.argv[3], sys.argv[4], float(sys.argv[5]), float(sys.argv[6]), include_brep=True))
""",
    "xacro": "from twin.core.foreign.xacro_process import main; main(*sys.argv[3:6])",
}

_PARSERS["fine STEP"] = _PARSERS["STEP"]

_REFERRED_SUFFIXES = {"MJCF": (*MJCF_SUFFIXES, ".stl", ".obj", ".msh", ".png"), "USD": STAGE_SUFFIXES}
"""{format: suffixes of files to which a file of this format may refer}. Files with these suffixes in the same folder or
its subfolders increase the limits."""

_MOST_FILES_BESIDE = 2000
"""Maximum number of files that are searched for these suffixes, in the folder and its subfolders."""

_MOST_SECONDS = 600.0
"""Maximum processor time in s of a parser's process, whatever the sizes of its files."""

_MOST_MEMORY = 8_000 * MB
"""Maximum memory in bytes of a parser's process, whatever the sizes of its files."""

_MOST_IDLE_S = 8.0
"""Maximum idle time of a parser in s, for instance while it waits for a pipe."""

_TAIL_BYTES = 4000
"""Number of bytes at the end of the output of a parser that are read."""

_MEMORY_WORDS = re.compile(rb"MemoryError|bad_alloc|allocat|out of memory|unknown exception", re.IGNORECASE)


def run(path: Path, kind: str, *arguments: str, given: Path | None = None) -> int:
    """Run a format's parser on a file in a separate process, within the limits of the format; return its exit code.

    `given` is a copy of the file that the parser reads instead of `path`; None: the parser reads `path`.

    Raises:
        BudgetError: the parser exceeds its time or memory, or the file has too many parts.
        SourceError: the parser crashed.
    """
    seconds, memory = limits(path, kind)
    code, idle, text = _limited(kind, seconds, memory, (given or path).resolve(), *arguments)
    subject = f"{path}: the {kind} parser"
    if idle:
        raise BudgetError(f"{subject} waited for {_MOST_IDLE_S:g} s: the file refers to an endless stream. {way(kind)}")
    if code == -signal.SIGXCPU:
        raise BudgetError(f"{subject} exceeded its limit of {seconds:.0f} s of processor time. {way(kind)}")
    if _MEMORY_WORDS.search(text) and code != 0:
        raise BudgetError(f"{subject} exceeded its limit of {memory / MB:,.0f} MB of memory. {way(kind)}")
    if code < 0:
        name = signal.Signals(-code).name
        raise SourceError(
            f"{subject} crashed ({name}, memory limit {memory / MB:,.0f} MB): the file is damaged, "
            "is nested too deeply, or triggers a bug of the parser"
        )
    if code and (excess := re.search(rb"^over (.*)$", text, re.MULTILINE)):
        raise BudgetError(f"{path}: {excess[1].decode('utf-8', 'replace')}. {way(kind)}")
    return code


def pass_together(paths: Sequence[Path]) -> bool:
    """Return whether OpenUSD can read all stages in one process; OpenUSD is then imported only once."""
    seconds = 0.0
    memory = 0
    for path in paths:
        seconds_of_file, memory_of_file = limits(path, "USD")
        seconds += seconds_of_file
        memory = max(memory, memory_of_file)
    code, idle, _ = _limited("USD", seconds, memory, *(path.resolve() for path in paths))
    return code == 0 and not idle


def limits(path: Path, kind: str) -> tuple[float, int]:
    """Return the limits of a file's parser: processor time in s, memory in bytes."""
    budget = BUDGETS[kind]
    size = path.stat().st_size
    if kind in _REFERRED_SUFFIXES:
        # a folder may contain any number of files: only the first ones are searched
        for beside in islice(path.parent.rglob("*"), _MOST_FILES_BESIDE):
            if beside != path and beside.suffix.lower() in _REFERRED_SUFFIXES[kind] and beside.is_file():
                size += beside.stat().st_size
    seconds = budget.seconds + budget.seconds_per_mb * size / MB
    memory = budget.memory + budget.memory_per_byte * size
    return min(seconds, _MOST_SECONDS), int(min(memory, _MOST_MEMORY))


def _limited(kind: str, seconds: float, memory: int, *arguments: object) -> tuple[int, bool, bytes]:
    """Run a parser; return (exit code, whether the parser was killed because it waited too long, end of its output)."""
    variables: dict[str, str] = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MALLOC_ARENA_MAX"), "1")
    variables["MUJOCO_GL"] = "disable"  # otherwise MuJoCo starts programs to find display libraries
    python, *arguments_of_python = isolated(_LIMITS_PROGRAM + _PARSERS[kind], int(seconds + 1), memory, *arguments)
    command = [python, "-S", *arguments_of_python]  # parsers do not need the start-up code of installed packages
    with tempfile.TemporaryFile() as output:
        process = Child(command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, env=os.environ | variables)
        return *_wait(process), _tail(output)


def _wait(process: subprocess.Popen[bytes]) -> tuple[int, bool]:
    """Return the exit code of a process, and whether it was killed because it waited too long."""
    time_before = ""
    since = time.monotonic()
    pause = 0.005
    try:
        while process.poll() is None:
            time.sleep(pause)
            pause = min(1.5 * pause, 0.02)
            time_used = _time_asleep(process.pid)
            if not time_used or time_used != time_before:
                time_before = time_used
                since = time.monotonic()
            elif time.monotonic() - since > _MOST_IDLE_S:
                process.kill()
                process.wait()
                return process.returncode, True
    finally:
        if process.poll() is None:  # after an interrupt
            process.kill()
            process.wait()
    return process.returncode, False


def _time_asleep(pid: int) -> str:
    """Return the processor time used by a sleeping process, as text; "" if the process is running or ready to run."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text("ascii", "replace")
        # the name of the program, in parentheses, may contain spaces
        state, *fields = stat.rpartition(")")[2].split()
        if state != "S":
            return ""
        return f"{fields[10]} {fields[11]}"
    except (OSError, IndexError, ValueError):
        return ""


def _tail(file: IO[bytes]) -> bytes:
    """Return the end of the output of a parser, in which it says why it has ended."""
    file.seek(0, os.SEEK_END)
    file.seek(max(0, file.tell() - _TAIL_BYTES))
    return file.read()
