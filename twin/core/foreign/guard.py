"""Native parsers tried in a process of their own: a file that makes one crash, hang or grow must not take twin with it.

The system holds the process to its processor time and memory (`Budget`), which grow with what the file brings along.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Literal

from twin.core.errors import BudgetError, SourceError
from twin.core.foreign.budget import BODIES, BUDGETS, MB, way
from twin.core.processes import isolated

_LIMITED = """
import resource, sys
def most(what, value):
    resource.setrlimit(what, (value, resource.getrlimit(what)[1]))
most(resource.RLIMIT_CORE, 0)
most(resource.RLIMIT_CPU, int(sys.argv[1]))
most(resource.RLIMIT_DATA, int(sys.argv[2]))
def over(what, value, limit):
    sys.exit(f"over {what}: {value:,}; the limit is {limit:,}")
"""

_PROGRAMS = {
    "MJCF": "import mujoco; mujoco.MjData(mujoco.MjSpec.from_file(sys.argv[3]).compile())",
    "USD": f"""
from pxr import Usd
for path in sys.argv[3:]:
    most_prims, most_depth, count, bodies = {BUDGETS["USD"].count}, {BUDGETS["USD"].depth}, 0, 0
    stage = Usd.Stage.Open(path)
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        count += 1
        if count > most_prims:
            over("prims, at least", count, most_prims)
        if prim.GetPath().pathElementCount > most_depth:
            over("depth of its prims, at least", prim.GetPath().pathElementCount, most_depth)
        bodies += prim.HasAPI("PhysicsRigidBodyAPI") or prim.IsA("PhysicsJoint")
        if bodies > 2 * {BODIES}:
            over("bodies and joints, at least", bodies, 2 * {BODIES})
        if prim.IsA("Mesh"):
            prim.GetAttribute("points").Get(), prim.GetAttribute("faceVertexIndices").Get()
""",
    # trimesh, which cascadio would register itself with, takes longer to import than most files to read.
    "STEP": """
sys.modules["trimesh"] = None
import cascadio
sys.exit(cascadio.step_to_glb(sys.argv[3], sys.argv[4], float(sys.argv[5]), float(sys.argv[6]), include_brep=True))
""",
}

_PROGRAMS["fine STEP"] = _PROGRAMS["STEP"]

_BESIDE = {"MJCF": (".xml", ".mjcf", ".stl", ".obj", ".msh", ".png"), "USD": (".usd", ".usda", ".usdc", ".usdz")}
"""What a file may bring along, by the ends of names: more may be used for it then."""

_MOST_BESIDE = 2000
"""Files beside it that are looked at."""

_MOST_SECONDS, _MOST_MEMORY = 600.0, 8_000 * MB
"""What no file gets more of, however large."""

_IDLE = 8.0
"""Seconds that a parser may wait without working: it reads from something that has no end."""

_MEMORY_WORDS = re.compile(rb"MemoryError|bad_alloc|allocat|out of memory|unknown exception", re.IGNORECASE)


def try_first(path: Path, kind: str) -> None:
    """Let the parser of a format read the file, elsewhere. What it merely refuses is told by the reader itself.

    Raises:
        BudgetError: it needs more time or memory than it may, or has too many parts.
        SourceError: the parser crashed.
    """
    run(path, kind)


def run(path: Path, kind: str, *arguments: str) -> int:
    """Run a format's parser on a file within its limits, and return its exit code.

    Raises:
        BudgetError: it needs more time or memory than it may, or has too many parts.
        SourceError: it crashed.
    """
    seconds, memory = limits(path, kind)
    code, idle, text = _limited(kind, seconds, memory, path.resolve(), *arguments)
    told = f"{path}: the {kind} parser"
    if idle:
        raise BudgetError(f"{told} waits for {_IDLE:g} s: the file names something that has no end. {way(kind)}")
    if code == -signal.SIGXCPU:
        raise BudgetError(f"{told} is not done after {seconds:.0f} s of processor time, its limit. {way(kind)}")
    if _MEMORY_WORDS.search(text) and code != 0:
        raise BudgetError(f"{told} wants more than {memory / MB:,.0f} MB of memory, its limit. {way(kind)}")
    if code < 0:
        name = signal.Signals(-code).name
        raise SourceError(
            f"{told} crashes on it ({name}) within {memory / MB:,.0f} MB: the file is damaged, hits a bug of it, or is "
            "nested too deep"
        )
    if code and (found := re.search(rb"^over (.*)$", text, re.MULTILINE)):
        raise BudgetError(f"{path}: {found[1].decode('utf-8', 'replace')}. {way(kind)}")
    return code


def pass_together(paths: Sequence[Path], kind: Literal["USD"]) -> bool:
    """Return whether files all pass in one process, which imports their parser once; if not, try them one by one."""
    each = [limits(path, kind) for path in paths]
    seconds, memory = sum(s for s, _ in each), max(m for _, m in each)
    return _limited(kind, seconds, memory, *(path.resolve() for path in paths))[:2] == (0, False)


def limits(path: Path, kind: str) -> tuple[float, int]:
    """Return the seconds of processor time and the bytes of memory that a file's parser gets."""
    budget, size = BUDGETS[kind], path.stat().st_size
    if kind in _BESIDE:
        beside = (p for i, p in zip(range(_MOST_BESIDE), path.parent.rglob("*"), strict=False))
        size += sum(p.stat().st_size for p in beside if p != path and p.suffix.lower() in _BESIDE[kind] and p.is_file())
    seconds = min(budget.seconds + budget.seconds_per_mb * size / MB, _MOST_SECONDS)
    return seconds, int(min(budget.memory + budget.memory_per_byte * size, _MOST_MEMORY))


def _limited(kind: str, seconds: float, memory: int, *arguments: object) -> tuple[int, bool, bytes]:
    """Run a parser; return its exit code, whether it was ended because it waits, and the end of what it said."""
    own: dict[str, str] = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MALLOC_ARENA_MAX"), "1")
    own["MUJOCO_GL"] = "disable"  # it looks for a display's libraries otherwise, with programs of its own
    python, *rest = isolated(_LIMITED + _PROGRAMS[kind], int(seconds + 1), memory, *arguments)
    command = [python, "-S", *rest]  # no parser needs what installed packages run at each start
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=said, stderr=said, env=os.environ | own)
        return *_wait(process), _tail(said)


def _wait(process: subprocess.Popen[bytes]) -> tuple[int, bool]:
    """Return the exit code of a process, and whether it was ended because it waits for something."""
    before, since, pause = "", time.monotonic(), 0.005
    try:
        while process.poll() is None:
            time.sleep(pause)
            pause = min(1.5 * pause, 0.1)
            now = _asleep(process.pid)
            if not now or now != before:
                before, since = now, time.monotonic()
            elif time.monotonic() - since > _IDLE:
                process.kill()
                process.wait()
                return process.returncode, True
    finally:
        if process.poll() is None:  # an interrupt
            process.kill()
            process.wait()
    return process.returncode, False


def _asleep(pid: int) -> str:
    """Return the processor time that a sleeping process has used; "" if it works, or waits for a busy processor."""
    try:
        state, *fields = Path(f"/proc/{pid}/stat").read_text("ascii", "replace").rpartition(")")[2].split()
        return f"{fields[10]} {fields[11]}" if state == "S" else ""
    except (OSError, IndexError, ValueError):
        return ""


def _tail(file: IO[bytes]) -> bytes:
    file.seek(0, os.SEEK_END)
    file.seek(max(0, file.tell() - 4000))
    return file.read()
