"""Folders that are written whole or not at all, also when the process that writes them is killed."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import signal
import subprocess
import sys
import tempfile
import warnings
import weakref
from pathlib import Path

import pytest

from made.lanes import thinned
from twin.cli import main
from twin.core import atomic, unfinished
from twin.core.atomic import (
    Scratch,
    atomic_folder,
    require_writable,
    require_writable_file,
    settle,
    settle_all,
    write_text,
)
from twin.core.errors import OutputError


@pytest.fixture(autouse=True)
def register(tmp_path_factory, monkeypatch):
    """The register of temporary folders, of which other processes know nothing."""
    place = tmp_path_factory.mktemp("cache")
    monkeypatch.setenv("XDG_CACHE_HOME", str(place))
    return place / "twin/unfinished"


def _tree(folder: Path) -> dict[str, str]:
    """Everything below a folder, hidden files too."""
    return {str(p.relative_to(folder)): p.read_text() if p.is_file() else "" for p in folder.rglob("*")}


def test_a_text_below_a_file_is_an_output_error_that_names_it(tmp_path):
    (tmp_path / "file").write_text("old")
    with pytest.raises(OutputError, match=r"file/report\.xml: cannot be written"):
        write_text(tmp_path / "file/report.xml", "new")
    assert (tmp_path / "file").read_text() == "old"


def test_a_text_is_written_to_the_file_behind_a_link(tmp_path):
    shared = tmp_path / "shared.json"
    shared.write_text("old")
    link = tmp_path / "link.json"
    link.symlink_to(shared)
    write_text(link, "new")
    assert link.is_symlink()
    assert shared.read_text() == "new"


def test_no_file_takes_the_place_of_a_pipe(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(OutputError, match="pipe: it is a device or a pipe; give the name of a file"):
        require_writable_file(pipe)
    with pytest.raises(OutputError, match="pipe: it is a device or a pipe; give the name of a file"):
        write_text(pipe, "new")
    assert pipe.is_fifo()


def test_atomic_folder_moves_all_files(tmp_path):
    target = tmp_path / "a/b"
    with atomic_folder(target) as work:
        (work / "one").write_text("1")
        (work / "deep/er").mkdir(parents=True)
        (work / "deep/er/two").write_text("2")
        assert not (target / "one").exists()
    assert _tree(target) == {"one": "1", "deep": "", "deep/er": "", "deep/er/two": "2"}


def test_atomic_folder_replaces_what_it_writes_and_keeps_the_rest(tmp_path):
    (tmp_path / "old").write_text("old")
    (tmp_path / "both").write_text("old")
    with atomic_folder(tmp_path) as work:
        (work / "both").write_text("new")
    assert _tree(tmp_path) == {"old": "old", "both": "new"}


class _MishapError(Exception):
    pass


def _write(target: Path, files: dict[str, str], error: BaseException | None = None) -> None:
    with atomic_folder(target) as work:
        for name, text in files.items():
            (work / name).parent.mkdir(exist_ok=True)
            (work / name).write_text(text)
        if error is not None:
            raise error


@pytest.mark.parametrize("error", [_MishapError, KeyboardInterrupt])
def test_error_inside_leaves_the_target_untouched(tmp_path, error):
    (tmp_path / "both").write_text("old")
    with pytest.raises(error):
        _write(tmp_path, {"both": "new"}, error())
    assert _tree(tmp_path) == {"both": "old"}


def test_error_inside_removes_the_folders_that_were_made(tmp_path):
    with pytest.raises(_MishapError):
        _write(tmp_path / "a/b/c", {"one": "1"}, _MishapError())
    assert _tree(tmp_path) == {}


def test_error_inside_keeps_folders_that_hold_something_else(tmp_path):
    (tmp_path / "a").mkdir()

    def write():
        with atomic_folder(tmp_path / "a/b"):
            (tmp_path / "a/b").mkdir()
            (tmp_path / "a/b/foreign").write_text("x")
            raise _MishapError

    with pytest.raises(_MishapError):
        write()
    assert _tree(tmp_path) == {"a": "", "a/b": "", "a/b/foreign": "x"}


def test_full_disk_while_writing_is_an_output_error(tmp_path):
    (tmp_path / "both").write_text("old")
    with pytest.raises(OutputError, match=r"cannot write to .*No space left on device.*--out") as caught:
        _write(tmp_path, {"both": "new"}, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    assert isinstance(caught.value.__cause__, OSError)
    assert _tree(tmp_path) == {"both": "old"}


def test_full_disk_while_copying_names_the_folder_of_the_copy(tmp_path):
    target, source = tmp_path / "robot", tmp_path.parent / "elsewhere/arm.step"
    with pytest.raises(OutputError, match="No space left on device") as caught, atomic_folder(target) as work:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(source), None, str(work / "arm.step"))
    assert str(caught.value).startswith(f"cannot write to {target}: ")


@pytest.mark.parametrize("links", [True, False], ids=["file system with links", "file system without links"])
@pytest.mark.parametrize("fails_at", [1, 2, 3])
def test_failure_while_moving_puts_everything_back(tmp_path, monkeypatch, fails_at, links):
    target = tmp_path / "out"
    target.mkdir()
    (target / "b").write_text("old b")
    (target / "foreign").write_text("x")
    real, calls = os.replace, []

    def replace(source, final):
        calls.append(final)
        if len(calls) == fails_at:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        real(source, final)

    def no_link(self, other):
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    monkeypatch.setattr(os, "replace", replace)
    if not links:
        monkeypatch.setattr(Path, "hardlink_to", no_link)
    with pytest.raises(OutputError, match="cannot write to"):
        _write(target, {"a": "new a", "b": "new b", "sub/c": "new c"})
    assert _tree(target) == {"b": "old b", "foreign": "x"}


def test_directory_in_the_place_of_a_file_is_not_replaced(tmp_path):
    (tmp_path / "b").mkdir()
    (tmp_path / "b/precious").write_text("x")
    with pytest.raises(OutputError, match="cannot write to"):
        _write(tmp_path, {"a": "new a", "b": "new b"})
    assert _tree(tmp_path) == {"b": "", "b/precious": "x"}


def test_file_in_the_way_is_named(tmp_path):
    (tmp_path / "file").write_text("x")
    for target in (tmp_path / "file", tmp_path / "file/below"):
        with pytest.raises(OutputError, match=rf"cannot write to {target}: .*--out"), atomic_folder(target):
            pytest.fail("the block is not entered")
    assert _tree(tmp_path) == {"file": "x"}


def test_folder_that_cannot_be_written_leaves_no_parents(tmp_path, monkeypatch):
    def refuse(*_):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(atomic, "_new_scratch", refuse)
    with pytest.raises(OutputError, match="Permission denied"), atomic_folder(tmp_path / "a/b"):
        pytest.fail("the block is not entered")
    assert _tree(tmp_path) == {}


def test_asking_whether_a_folder_can_be_written_leaves_nothing(tmp_path):
    require_writable(tmp_path / "a/b")
    assert _tree(tmp_path) == {}
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match=r"cannot write to .*file/below"):
        require_writable(tmp_path / "file/below")
    assert _tree(tmp_path) == {"file": "x"}


def test_read_only_folder_is_named():
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        target = Path(folder) / "locked"
        target.mkdir(mode=0o555)
        me = os.geteuid()
        if me == 0:  # root may write everywhere: be nobody for a moment
            os.seteuid(65534)
        try:
            with pytest.raises(OutputError, match=rf"cannot write to {target}: Permission denied"):
                _write(target, {"a": "new a"})
        finally:
            os.seteuid(me)
        assert list(target.iterdir()) == []


# ------------------------------------------------------------------------------------------- killed


OLD = {"a": "old", "b/c": "old", "stale/d": "old", "keep": "x"}
NEW = {"a": "new", "b/c": "new", "new/e": "new", "keep": "x"}

STEPS = ("replace", "rename", "unlink", "link", "mkdir", "rmdir", "open")
"""Calls of the system by which files appear, move and go."""


def _killed_at(step: int, target: Path, error: type[BaseException] | None = None) -> bool:
    """Write NEW over OLD in a child that is killed before its nth step; return whether there is such a step.

    With an error, this is raised at the step, and the child is killed at the step after.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # the child only runs what is here
        child = os.fork()
    if child == 0:
        left = [step]

        def counted(real):
            def call(*args, **kwargs):
                left[0] -= 1
                if left[0] == 0 and error is not None:
                    raise error
                if left[0] == (-1 if error else 0):
                    os.kill(os.getpid(), signal.SIGKILL)
                return real(*args, **kwargs)

            return call

        try:
            for name in STEPS:
                setattr(os, name, counted(getattr(os, name)))
            with atomic_folder(target, replacing=["stale/d"]) as work:
                for name, text in NEW.items():
                    if name != "keep":
                        (work / name).parent.mkdir(exist_ok=True)
                        (work / name).write_text(text)
        finally:
            os._exit(0 if left[0] > 0 else 1)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) != 0


def _files(folder: Path) -> dict[str, str]:
    return {str(p.relative_to(folder)): p.read_text() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.slow
@pytest.mark.parametrize("error", thinned([None, OSError(errno.EIO, "input/output error"), KeyboardInterrupt], every=3))
@pytest.mark.parametrize("old", [OLD, {}], ids=["over old files", "a new folder"])
def test_killed_at_any_step_it_is_whole_after_the_next_start(tmp_path, old, error):
    seen, step = set(), 0
    new = NEW if old else {k: v for k, v in NEW.items() if k != "keep"}
    while True:
        step += 1
        home = tmp_path / str(step)
        home.mkdir()
        target = home / "out/deep"
        for name, text in old.items():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            (target / name).write_text(text)
        reached = _killed_at(step, target, error)
        settle(target)
        assert _files(home) in ({f"out/deep/{k}": v for k, v in t.items()} for t in (old, new)), step
        folders = {p for p in home.rglob("*") if p.is_dir()}
        assert not [p for p in folders if not any(q.is_file() for q in p.rglob("*"))], step
        seen.add(len(_files(home)) and (target / "a").read_text())
        if not reached:
            break
    assert step > 15
    assert "new" in seen
    assert len(seen) == 2  # both ends were met


def test_folder_in_use_is_left_alone(tmp_path):
    with atomic_folder(tmp_path) as work:
        (work / "a").write_text("new")
        settle(tmp_path)
        assert (work / "a").is_file()
    assert _tree(tmp_path) == {"a": "new"}


def test_temporary_folder_of_a_killed_process_goes_and_others_stay(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    program = "import os\nfrom twin.core.atomic import Scratch\ns = Scratch()\nos.kill(os.getpid(), 9)"
    done = subprocess.run([sys.executable, "-c", program], env=os.environ | {"TMPDIR": str(tmp_path)})
    assert done.returncode == -signal.SIGKILL
    (tmp_path / ".twin-settings").mkdir()
    with Scratch() as mine:
        assert len(list(tmp_path.iterdir())) == 3
        settle(tmp_path)
        assert {str(p) for p in tmp_path.iterdir()} == {mine, str(tmp_path / ".twin-settings")}
    assert [p.name for p in tmp_path.iterdir()] == [".twin-settings"]


def test_a_temporary_folder_that_another_process_removes_at_once_is_made_again(tmp_path, monkeypatch):
    """The first folder is forgotten: at the end of the program, nobody warns that it was not cleaned up."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    removed = []

    def register_late(folder):
        if not removed:
            removed.append(folder)
            folder.rmdir()

    monkeypatch.setattr(unfinished, "register", register_late)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scratch = Scratch()
        assert Path(scratch.name).is_dir()
        assert [Path(scratch.name)] != removed
        scratch.cleanup()
        finalizers = [f for f in weakref.finalize._registry if f.alive and f.peek()[0] is scratch]
        assert finalizers == []
    assert list(tmp_path.iterdir()) == []


KILLED = """
import os, sys
from pathlib import Path
from twin.core.atomic import Scratch, atomic_folder
scratch = Scratch()
with atomic_folder(Path(sys.argv[1])) as work:
    (work / "a").write_text("new")
    os.kill(os.getpid(), 9)
"""


def test_each_start_finds_the_folders_of_killed_processes_wherever_they_are(tmp_path, register):
    places = [tmp_path / name for name in ("one/deep/er", "two")]
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    for place in places:
        place.mkdir(parents=True)
        env = os.environ | {"TMPDIR": str(temporary)}
        done = subprocess.run([sys.executable, "-c", KILLED, str(place)], env=env, cwd=tmp_path)
        assert done.returncode == -signal.SIGKILL
    left = sorted([*temporary.iterdir(), *(p for place in places for p in place.iterdir())])
    assert len(left) == 4
    with atomic_folder(tmp_path / "mine") as work:
        (work / "a").write_text("new")
        assert sorted(unfinished.abandoned()) == left
        settle_all()
        assert (work / "a").is_file()
        assert len(list(register.iterdir())) == 1
    assert list(register.iterdir()) == []
    assert _tree(tmp_path) == {
        "one": "", "one/deep": "", "one/deep/er": "", "two": "", "temporary": "", "mine": "", "mine/a": "new",
    }  # fmt: skip


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], [], ["list", "--quiet"], ["no such command"]])
def test_every_command_sweeps_them(tmp_path, arguments, capsys):
    done = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], cwd="/")
    assert done.returncode == -signal.SIGKILL
    assert len(unfinished.abandoned()) == 2
    with contextlib.suppress(SystemExit):
        main(arguments)
    assert unfinished.abandoned() == []
    assert list(tmp_path.iterdir()) == []


def test_the_register_names_nothing_but_folders_of_twin(tmp_path, register):
    """An entry of another kind is left alone, with what it names; one that names nothing is removed."""
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "file").write_text("x")
    register.mkdir(parents=True)
    (register / "precious").symlink_to(precious)
    (register / ".twin-00000000.tmp").symlink_to(tmp_path / ".twin-00000000.tmp")
    (register / "a file").write_text("x")
    settle_all()
    assert _tree(tmp_path) == {"precious": "", "precious/file": "x"}
    assert sorted(p.name for p in register.iterdir()) == ["a file", "precious"]


def test_without_a_cache_folder_files_are_written_all_the_same(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    _write(tmp_path / "out", {"one": "1"})
    settle_all()
    assert _tree(tmp_path / "out") == {"one": "1"}


def test_a_temporary_folder_can_be_written_like_any_other():
    """It is locked already, by the process that would lock it."""
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)  # rather than to wait for ever
    signal.alarm(20)
    try:
        with Scratch() as name:
            _write(Path(name), {"one": "1"})
            assert (Path(name) / "one").read_text() == "1"
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("name", ["../outside", "link/outside", "/tmp/outside"])
def test_journal_of_somebody_else_reaches_nothing_outside(tmp_path, name):
    """A folder from elsewhere may hold anything, a journal too."""
    (tmp_path / "place").mkdir()
    (tmp_path / "outside").write_text("precious")
    folder = tmp_path / "place/robot"
    own = folder / ".twin-abcdefgh.tmp"
    (own / "new").mkdir(parents=True)
    (own / "new/x").write_text("evil")
    (folder / "link").symlink_to(tmp_path)
    target = str(tmp_path / "outside") if name.startswith("/") else name
    (own / "commit").write_text(json.dumps({"put": [[target, "x"]], "drop": [target], "made": []}))
    settle(folder)
    assert (tmp_path / "outside").read_text() == "precious"
    assert not (tmp_path / "place/outside").exists()


def test_two_at_once_the_last_one_wins_whole(tmp_path):
    with atomic_folder(tmp_path) as one:
        with atomic_folder(tmp_path) as two:
            for name in "abc":
                (two / name).write_text("two")
        for name in "abc":
            (one / name).write_text("one")
    assert _tree(tmp_path) == dict.fromkeys("abc", "one")


@pytest.mark.parametrize("part", ["shutil.rmtree", "fcntl.flock"])
def test_what_ctrl_c_leaves_of_a_folder_is_removed_by_the_same_process(tmp_path, monkeypatch, part):
    """Ctrl-C while the temporary folder is locked or removed: the lock is released, so that `settle` can go on."""

    def stop(*args, **kwargs):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(atomic, "settle", lambda folder: None)  # which would lock what others left in parent folders
        patched.setattr(f"twin.core.atomic.{part}", stop)
        with pytest.raises(KeyboardInterrupt):
            atomic.require_writable(tmp_path)
    assert list(tmp_path.iterdir())
    atomic.settle(tmp_path)
    assert not list(tmp_path.iterdir())
