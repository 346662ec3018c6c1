"""Commands killed at any moment: what was there stays whole, or what is new is whole, and nothing else lies about.

TWIN_KILLS=100 pytest -m slow tests/test_kill.py    the long form; the default is a handful
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROBOT = "hibou"
KILLS = int(os.environ.get("TWIN_KILLS", "6"))

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

SAVE = (
    AT_MOVE
    + """
from pathlib import Path
from twin import api
from twin.ui.viewer.keep import save_posture
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

    @property
    def out(self) -> Path:
        return self.home / "twin-out/out"

    def reset(self) -> None:
        shutil.rmtree(self.home, ignore_errors=True)
        shutil.copytree(self.before, self.out)
        (self.home / "tmp").mkdir()

    def start(
        self, program: str, arguments: tuple[str, ...], moves: int = 10**9, err: int = subprocess.DEVNULL
    ) -> subprocess.Popen:
        """Start a program in a session of its own."""
        env = os.environ | {"TMPDIR": str(self.home / "tmp"), "MOVED_TO": str(self.out)}
        argv = [sys.executable, "-c", program, str(moves), *(a.format(out=self.out) for a in arguments)]
        return subprocess.Popen(
            argv, cwd=self.home, env=env, stdout=subprocess.DEVNULL, stderr=err, start_new_session=True
        )

    def run(self, moves: int = 10**9) -> int:
        return self.start(self.program, self.arguments, moves).wait()

    def next_start(self) -> None:
        """A command that has nothing to do with the one that was killed."""
        assert self.start(COMMAND, ("list", "--quiet")).wait() == 0

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


@pytest.fixture(scope="module", params=KINDS)
def place(request, tmp_path_factory) -> tuple[Place, dict[str, bytes], dict[str, bytes], float, int]:
    """A place with its trees before and after, how long the command takes, and how many files it moves."""
    program, arguments = KINDS[request.param]
    made = tmp_path_factory.mktemp(request.param)
    before = made / "before"
    if request.param == "save":
        shutil.copytree(ROOT / "cad" / ROBOT, before / "cad")
    else:  # files of another content, some of which are written anew, and one that is nobody's business
        before.mkdir()
        (before / "mine.txt").write_text("mine")
    out = Place(made / "home", program, arguments, before)
    if request.param == "export":  # an export of other formats, whose files go when the new ones come
        out.reset()
        assert Place(out.home, COMMAND, ("export", ROBOT, "--to", "urdf", "--out", "{out}"), before).run() == 0
        shutil.copytree(out.out, before, dirs_exist_ok=True)
    out.reset()
    assert out.run() == 0
    if request.param == "run":
        for file in [p for p in out.out.rglob("*") if p.is_file() and p.name != "mine.txt"][::2]:
            old = before / file.relative_to(out.out)
            old.parent.mkdir(parents=True, exist_ok=True)
            old.write_text("old")
    out.reset()
    old, begun = out.tree(), time.monotonic()
    assert out.run() == 0
    new = out.tree()
    assert new != old
    assert not out.litter()
    return out, old, new, time.monotonic() - begun, sum(new.get(k) != v for k, v in old.items())


def _judged(out: Place, old: dict[str, bytes], new: dict[str, bytes]) -> str:
    out.next_start()
    assert not out.litter()
    now = out.tree()
    assert now in (old, new), sorted(k for k in now.keys() | new.keys() if now.get(k) not in (old.get(k), new.get(k)))
    return "new" if now == new else "old"


@pytest.mark.slow
def test_killed_while_files_are_moved(place):
    """The journal is there, so everything is completed by whatever twin does next."""
    out, old, new, _, _ = place
    moved = sum(1 for k in new if new[k] != old.get(k))
    count = max(1, KILLS // 8)
    for n in random.Random(17).sample(range(moved), min(moved, count)):
        out.reset()
        assert out.run(moves=n) == -signal.SIGKILL
        assert _judged(out, old, new) == "new", n


@pytest.mark.slow
def test_killed_at_random(place):
    """Also in what comes before and after the moves."""
    out, old, new, seconds, _ = place
    rng, ends = random.Random(8), []
    for _ in range(max(1, KILLS // 4)):
        out.reset()
        process = out.start(out.program, out.arguments)
        try:
            process.wait(rng.uniform(0, 1.05 * seconds))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        ends.append(_judged(out, old, new))
    print(f"{ends.count('old')} times what was there, {ends.count('new')} times what is new")


@pytest.mark.slow
@pytest.mark.parametrize("place", ["export", "run"], indirect=True, scope="module")
def test_stopped_by_ctrl_c_at_random(place):
    """What Ctrl-C leaves is whole at once, without another start of twin, and no process of its own goes on."""
    out, old, new, seconds, _ = place
    rng = random.Random(9)
    for _ in range(max(1, KILLS // 4)):
        out.reset()
        code, said, left = _interrupted(
            out.start(COMMAND, out.arguments, err=subprocess.PIPE), rng.uniform(0.3, seconds)
        )
        if code:
            assert (code, len(said.splitlines())) == (130, 1), said
            assert said.startswith("twin: interrupted: ")
        assert not left
        assert not out.litter()
        assert out.tree() in (old, new)


@pytest.mark.slow
def test_a_sweep_stopped_by_ctrl_c_says_what_it_keeps(tmp_path):
    """Also while its workers start, and while they work."""
    arguments = ("sweep", "sils", "--vary", "l_p=120..150mm", "--samples", "5000", "--workers", "2", "--out", "{out}")
    (tmp_path / "before").mkdir()
    out = Place(tmp_path / "home", COMMAND, arguments, tmp_path / "before")
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
    for _ in range(100):  # the process of Python that watches semaphores ends a moment after the command
        own = [p.name for p in Path("/proc").iterdir() if p.name.isdigit() and _session(p) == process.pid]
        if not own:
            break
        time.sleep(0.05)
    return process.returncode, said, own


def _session(process: Path) -> int:
    try:
        return int((process / "stat").read_text().rpartition(")")[2].split()[3])
    except OSError:  # it has ended
        return 0
