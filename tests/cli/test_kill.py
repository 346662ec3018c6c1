"""Commands killed at any moment: what was there stays whole, or what is new is whole, and nothing else lies about.

TWIN_KILLS=100 pytest -m slow tests/cli/test_kill.py    the long form, on a quiet machine; the default is a handful
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from made.lanes import nightly
from twin.core.cache import cache_folder

ROOT = Path(__file__).parents[2]
ROBOT = "hibou"
KILLS = int(os.environ.get("TWIN_KILLS", "6"))

LONGEST = 0.1 if "TWIN_KILLS" in os.environ else 30.0
"""Time in s after which no process of a killed command may run: with TWIN_KILLS a measurement, for a quiet machine."""

# Kills itself before the nth file is moved: a program of its own, because the moves take a few milliseconds.
AT_MOVE = """
import os, sys
left = int(sys.argv.pop(1))
def counted(real):
    def call(source, final, *args, **kwargs):
        global left
        left -= os.fspath(final).startswith(os.environ["MOVED_TO"]) and ".tmp/" not in os.fspath(final)
        if left < 0:
            os.kill(os.getpid(), 9)
        return real(source, final, *args, **kwargs)
    return call
os.replace = counted(os.replace)
"""

COMMAND = AT_MOVE + "from twin.cli import main; sys.exit(main(sys.argv[1:]))"

INTERRUPTED = (
    AT_MOVE
    + """
import twin.cli.command_line
from twin.cli import main
open(os.environ["READY"], "w").close()
sys.exit(main(sys.argv[1:]))
"""
)
"""The command, which creates a file when all is imported that tells of Ctrl-C."""

PROGRAM = "import sys; del sys.argv[1]; from twin.cli import main; sys.exit(main())"
"""The program as it is installed: the command runs in a child process of this process, which supervises it."""

SAVE = (
    AT_MOVE
    + """
from pathlib import Path
from twin import api
from twin.ui.session.robot_file_edits import save_posture
robot = api.load(sys.argv[1])
save_posture(robot.files.description, "kept", {j.name: sum(j.limits) / 2 for j in robot.mechanism.active})
"""
)


@dataclass
class Place:
    """A folder where a command writes: what lay there before, and what lies there when it is done."""

    home: Path
    program: str
    arguments: tuple[str, ...]
    before: Path
    cache: Path

    @property
    def out(self) -> Path:
        return self.home / "twin-out/out"

    @property
    def ready(self) -> Path:
        return self.home.with_name("ready")

    def reset(self) -> None:
        shutil.rmtree(self.home, ignore_errors=True)
        shutil.copytree(self.before, self.out)
        (self.home / "tmp").mkdir()

    def start(
        self, program: str, arguments: tuple[str, ...], moves: int = 10**9, err: int = subprocess.DEVNULL
    ) -> subprocess.Popen:
        """Start a program in a session of its own."""
        env = os.environ | {"TMPDIR": str(self.home / "tmp"), "MOVED_TO": str(self.out)}
        env |= {"XDG_CACHE_HOME": str(self.cache), "READY": str(self.ready)}
        argv = [sys.executable, "-c", program, str(moves), *(a.format(out=self.out) for a in arguments)]
        return subprocess.Popen(
            argv, cwd=self.home, env=env, stdout=subprocess.DEVNULL, stderr=err, start_new_session=True
        )

    def run(self, moves: int = 10**9) -> int:
        return self.start(self.program, self.arguments, moves).wait()

    def next_start(self) -> None:
        """A command that has nothing to do with the one that was killed, in another folder."""
        env = os.environ | {"XDG_CACHE_HOME": str(self.cache)}
        command = [sys.executable, "-P", "-m", "twin", "--version"]
        subprocess.run(command, cwd="/", env=env, stdout=subprocess.DEVNULL, check=True)

    def tree(self) -> dict[str, bytes]:
        """All there is, hidden files too, of what this test makes."""
        return {str(p.relative_to(self.home)): p.read_bytes() for p in self.home.rglob("*") if p.is_file()}

    def litter(self) -> list[Path]:
        folders = [p for p in self.home.rglob("*") if p.is_dir() and p != self.home / "tmp"]
        return [p for p in folders if p.name.startswith(".") or not any(p.iterdir())] + list(
            (self.home / "tmp").iterdir()
        )


KINDS = {
    "export": (COMMAND, ("export", ROBOT, "--to", "mjcf,tracks", "--out", "{out}", "--quiet")),
    "run": (COMMAND, ("run", ROBOT, "--out", "{out}", "--quiet")),
    "save": (SAVE, ("{out}",)),
}


@pytest.fixture(scope="session")
def cache(tmp_path_factory) -> Path:
    """A cache folder with the contents of the user's, but with its own register of temporary folders."""
    place = tmp_path_factory.mktemp("cache")
    (place / "twin").mkdir()
    for name in ("step", "kernels"):
        cache_folder(name).mkdir(parents=True, exist_ok=True)
        (place / "twin" / name).symlink_to(cache_folder(name))
    return place


@pytest.fixture(scope="module", params=[pytest.param("run", marks=pytest.mark.nightly), "export", "save"])
def place(request, tmp_path_factory, cache) -> tuple[Place, dict[str, bytes], dict[str, bytes], float]:
    """A place with its trees before and after, and how long the command takes."""
    program, arguments = KINDS[request.param]
    made = tmp_path_factory.mktemp(request.param)
    before = made / "before"
    if request.param == "save":
        shutil.copytree(ROOT / "cad" / ROBOT, before / "cad")
    else:  # files of another content, some of which are written anew, and one that is nobody's business
        before.mkdir()
        (before / "mine.txt").write_text("mine")
    out = Place(made / "home", program, arguments, before, cache)
    out.reset()
    if request.param == "export":  # an export of other formats, whose files go when the new ones come
        assert Place(out.home, COMMAND, ("export", ROBOT, "--to", "urdf", "--out", "{out}"), before, cache).run() == 0
        shutil.copytree(out.out, before, dirs_exist_ok=True)
    begun = time.monotonic()
    assert out.run() == 0
    seconds = time.monotonic() - begun
    new = out.tree()
    assert not out.litter()
    if request.param == "run":
        for file in [p for p in out.out.rglob("*") if p.is_file() and p.name != "mine.txt"][::2]:
            old = before / file.relative_to(out.out)
            old.parent.mkdir(parents=True, exist_ok=True)
            old.write_text("old")
    out.reset()
    old = out.tree()
    assert new != old
    return out, old, new, seconds


def _judged(out: Place, old: dict[str, bytes], new: dict[str, bytes]) -> str:
    out.next_start()
    assert not out.litter()
    now = out.tree()
    assert now in (old, new), sorted(k for k in now.keys() | new.keys() if now.get(k) not in (old.get(k), new.get(k)))
    return "new" if now == new else "old"


@pytest.mark.slow
def test_killed_while_files_are_moved(place):
    """The journal is there, so everything is completed by whatever twin does next."""
    out, old, new, _ = place
    moved = sum(1 for k in new if new[k] != old.get(k))
    count = max(1, KILLS // 8)
    for n in random.Random(17).sample(range(moved), min(moved, count)):
        out.reset()
        assert out.run(moves=n) == -signal.SIGKILL
        assert _judged(out, old, new) == "new", n


@pytest.mark.slow
def test_killed_at_random(place):
    """Also in what comes before and after the moves; no process of its own goes on."""
    out, old, new, seconds = place
    program = PROGRAM if out.program == COMMAND else out.program
    rng, ends, last = random.Random(8), [], [0.0]
    for _ in range(max(1, KILLS // 4)):
        out.reset()
        process = out.start(program, out.arguments)
        try:
            process.wait(rng.uniform(0, 1.05 * seconds))
        except subprocess.TimeoutExpired:
            last.append(_killed(process, rng))
        ends.append(_judged(out, old, new))
    print(f"{ends.count('old')} times what was there, {ends.count('new')} times what is new")
    print(f"the last child process ended {1e3 * max(last):.0f} ms after the kill")
    assert max(last) < LONGEST


@pytest.mark.nightly
def test_a_sweep_that_is_killed_leaves_nothing(tmp_path, cache):
    """Its workers are started by Dask."""
    arguments = ("sweep", "sils", "--vary", "l_p=120..150mm", "--samples", "5000", "--workers", "2", "--out", "{out}")
    (tmp_path / "before").mkdir()
    out = Place(tmp_path / "home", PROGRAM, arguments, tmp_path / "before", cache)
    out.reset()
    process = out.start(PROGRAM, arguments)
    file = out.out / "rows.csv"
    while not file.is_file() or len(file.read_bytes().splitlines()) < 2:
        assert process.poll() is None
        time.sleep(0.05)
    assert len(_own(process.pid)) >= 4  # the program, the command, two workers
    seconds = _killed(process)
    print(f"the last child process ended {1e3 * seconds:.0f} ms after the kill")
    assert seconds < LONGEST
    out.next_start()
    assert not out.litter()


@pytest.mark.slow
@pytest.mark.parametrize("place", nightly(["export", "run"], every=2), indirect=True, scope="module")
def test_stopped_by_ctrl_c_at_random(place):
    """What Ctrl-C leaves is whole at once, without another start of twin, and no process of its own goes on."""
    out, old, new, seconds = place
    rng = random.Random(9)
    for _ in range(max(1, KILLS // 4)):
        out.reset()
        out.ready.unlink(missing_ok=True)
        process = out.start(INTERRUPTED, out.arguments, err=subprocess.PIPE)
        while not out.ready.exists():
            assert process.poll() is None
            time.sleep(0.01)
        code, said, left = _interrupted(process, rng.uniform(0.05, seconds))
        if code:
            assert (code, len(said.splitlines())) == (130, 1), said
            assert said.startswith("twin: interrupted: ")
        assert not left
        assert not out.litter()
        assert out.tree() in (old, new)


@pytest.mark.nightly
def test_a_sweep_stopped_by_ctrl_c_says_what_it_keeps(tmp_path, cache):
    """Also while its workers start, and while they work."""
    arguments = ("sweep", "sils", "--vary", "l_p=120..150mm", "--samples", "5000", "--workers", "2", "--out", "{out}")
    (tmp_path / "before").mkdir()
    out = Place(tmp_path / "home", COMMAND, arguments, tmp_path / "before", cache)
    for rows in (-1, 1):
        out.reset()
        process = out.start(COMMAND, arguments, err=subprocess.PIPE)
        file = out.out / "rows.csv"
        while not file.is_file() or len(file.read_bytes().splitlines()) < rows:
            assert process.poll() is None
            time.sleep(0.05)
        code, said, left = _interrupted(process, 1.0)
        assert (code, len(said.splitlines())) == (130, 1), said
        kept = len(file.read_bytes().splitlines())
        assert f"interrupted: {kept} of 5001 designs are in {out.out}; run the same command again" in said
        assert kept >= rows
        assert not left
        assert list((out.home / "tmp").iterdir()) == []


def _interrupted(process: subprocess.Popen, wait: float) -> tuple[int, str, list[str]]:
    """Return (exit code, stderr, processes that go on) of a command that gets Ctrl-C after a time in s."""
    try:
        process.wait(wait)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGINT)
    said = process.communicate(timeout=120)[1].decode()
    for _ in range(1200):  # the process of Python that watches semaphores ends a moment after the command
        own = _own(process.pid)
        if not own:
            break
        time.sleep(0.05)
    return process.returncode, said, own


def _killed(process: subprocess.Popen, rng: random.Random | None = None) -> float:
    """Kill a program; with `rng`, perhaps its command instead. Return the time in s until its child processes ended."""
    victims = [process.pid]
    if rng is not None:
        victims += map(int, Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()[:1])
        victims = [rng.choice(victims)]
    with suppress(ProcessLookupError):
        os.kill(victims[0], signal.SIGKILL)
    killed = time.monotonic()
    while set(_own(process.pid)) - {str(process.pid)} and time.monotonic() - killed < 60:
        time.sleep(0.002)
    seconds = time.monotonic() - killed
    process.wait()
    return seconds


def _own(session: int) -> list[str]:
    """Return the running processes of a session."""
    return [p.name for p in Path("/proc").iterdir() if p.name.isdigit() and _session(p) == session]


def _session(process: Path) -> int:
    try:
        state, _, _, session = (process / "stat").read_text().rpartition(")")[2].split()[:4]
    except OSError:  # it has ended
        return 0
    return 0 if state in "ZX" else int(session)
