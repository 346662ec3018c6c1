"""Whose code is run: of the working directory nothing, of a robot's folder its formula.py, and that is told."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import twin
from twin.cli import main
from twin.core.errors import CodeRefusedError, TwinError
from twin.core.foreign.consent import NO_CODE
from twin.core.jobs import Call, _send_answer
from twin.core.processes import WorkerProcess, isolated
from twin.ui.session.timeline import prepare

TWIN = Path(twin.__file__).parent
HOSTILE = ("twin", "numpy", "json", "pickle", "socket", "multiprocessing", "tempfile", "pydantic", "rich", "logging")
FORMULA = "open({mark!r}, 'a').write('run')\n\ndef inverse(pose):\n    return [pose[0, 3]]\n"


@pytest.fixture
def hostile(tmp_path, monkeypatch):
    """A working directory with modules that say so when they are imported; it is on PYTHONPATH too, as ''."""
    for name in HOSTILE:
        (tmp_path / f"{name}.py").write_text("open('imported', 'a').write(__name__ + ' ')\n")
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    assert not (tmp_path / "imported").exists(), (tmp_path / "imported").read_text()


def test_an_isolated_program_imports_nothing_from_the_working_directory(hostile):
    names = ", ".join(HOSTILE)
    env = {**os.environ, "PYTHONPATH": f":{hostile}", "PYTHONSTARTUP": str(hostile / "twin.py")}
    command = isolated(f"import sys, {names}; print(twin.__file__, *sys.argv[1:])", "a b", 3)
    done = subprocess.run(command, capture_output=True, text=True, env=env)
    assert done.stdout.split() == [str(TWIN / "__init__.py"), "a", "b", "3"], done.stderr


def test_nor_does_a_process_that_answers_over_a_line(hostile, monkeypatch):
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)  # as a user's own script starts it
    with Call(prepare, "no_such_robot", None) as call, pytest.raises(TwinError, match="there is no robot 'no_such"):
        call.result()


def test_a_process_ends_with_its_owner_and_not_by_ctrl_c():
    process = WorkerProcess(_send_answer, prepare.__module__, prepare.__qualname__, ("no_such_robot", None), 0)
    pid = process._process.pid
    os.kill(pid, signal.SIGINT)
    assert process.line.poll(60)
    process.line.recv()
    process.close()
    assert not process.alive
    process = WorkerProcess(_send_answer, prepare.__module__, prepare.__qualname__, ("sils", None), 0)
    pid = process._process.pid
    del process
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


BUSY = "import ctypes, os; print(os.getpid(), flush=True); ctypes.PyDLL(None).sleep(600)"  # holds the GIL

STARTS = {
    "a function": """
from twin.core.jobs import Call
child = Call(exec, {busy!r})
""",
    "a program": """
from twin.core.processes import Child, isolated
child = Child(isolated({busy!r}))
""",
    "from a thread that ends": """
import threading
from twin.core.processes import Child, isolated
started = []
thread = threading.Thread(target=lambda: started.append(Child(isolated({busy!r}))))
thread.start()
thread.join()
""",
    "by multiprocessing": """
import multiprocessing
from twin.core.processes import spawning_children
with spawning_children():
    multiprocessing.get_context("spawn").Process(target=exec, args=({busy!r},)).start()
""",
}


@pytest.mark.parametrize("start", STARTS)
def test_a_busy_process_ends_at_once_with_its_owner_that_is_killed(start):
    for _ in range(5):  # 0.01 s, but more where the computer is busy with other work
        if _seconds_until_its_end(start) < 1.0:
            return
    pytest.fail("the process lives on after its owner")


def _seconds_until_its_end(start):
    program = STARTS[start].format(busy=BUSY) + "import time\ntime.sleep(600)\n"
    owner = subprocess.Popen(isolated(program), stdout=subprocess.PIPE, text=True)
    assert owner.stdout is not None
    child = int(owner.stdout.readline())
    time.sleep(0.05)
    assert _running(child)
    owner.kill()
    owner.wait()
    killed = time.monotonic()
    while _running(child):
        assert time.monotonic() - killed < 60
        time.sleep(0.001)
    seconds = time.monotonic() - killed
    owner.stdout.close()
    return seconds


SUPERVISED = """
import ctypes, os, sys, time
from twin.cli.supervisor import supervised
def command():
    ctypes.CDLL(None).prctl(1, 0)  # the kernel no longer kills the command with its supervisor
    exec({start!r}, globals())
    print(os.getpid(), flush=True)
    time.sleep(600)
sys.exit(supervised(command))
"""


@pytest.mark.parametrize("start", STARTS)
def test_a_busy_process_ends_with_the_supervisor_while_the_command_lives(start):
    """The end of a large command takes as long as its memory is freed; its child processes do not wait for that."""
    program = SUPERVISED.format(start=STARTS[start].format(busy=BUSY))
    supervisor = subprocess.Popen(isolated(program), stdout=subprocess.PIPE, text=True)
    assert supervisor.stdout is not None
    child, command = sorted((int(supervisor.stdout.readline()) for _ in range(2)), key=_is_command(supervisor.pid))
    assert _running(child)
    supervisor.kill()
    supervisor.wait()
    killed = time.monotonic()
    try:
        while _running(child):
            assert time.monotonic() - killed < 60
            time.sleep(0.001)
        assert _running(command)
    finally:
        os.kill(command, signal.SIGKILL)
        supervisor.stdout.close()


def _is_command(supervisor):
    """Return a function that tells whether the supervisor has started a process itself."""
    return lambda process: _parent(process) == supervisor


def _parent(process):
    return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])


def _running(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


@pytest.mark.slow
def test_the_command_does_not_import_what_lies_there(hostile):
    """The README's example saved as twin.py, and worse, in the folder in which twin is called."""
    (hostile / "twin.py").write_text('import twin\n\nopen("imported", "a").write("twin")\ntwin.load("sils")\n')
    done = subprocess.run([Path(sys.executable).with_name("twin"), "list", "--json"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)


@pytest.mark.slow
def test_nor_does_python_m_twin(hostile):
    """Beside a `twin.py` Python takes that, before any code of ours: all others are ours to leave out."""
    (hostile / "twin.py").unlink()
    done = subprocess.run([sys.executable, "-m", "twin", "list"], capture_output=True, text=True, cwd=hostile)
    assert done.returncode == 0, done.stderr
    (hostile / "twin.py").write_text("open('imported', 'a').write('twin')\n")
    done = subprocess.run([sys.executable, "-P", "-m", "twin", "list"], capture_output=True, text=True, cwd=hostile)
    assert done.returncode == 0, done.stderr


def test_every_process_is_started_in_one_way():
    """`sys.executable` is named where commands are made; `distributed` starts its own, in an environment of ours."""
    pattern = r"sys\.executable|get_context|os\.fork|os\.system|os\.exec|ProcessPoolExecutor\(|LocalCluster\("
    ways = {p.relative_to(TWIN).as_posix(): set(re.findall(pattern, p.read_text())) for p in TWIN.rglob("*.py")}
    assert {n: w for n, w in ways.items() if w} == {
        "core/processes.py": {"sys.executable"},
        "cli/__init__.py": {"sys.executable", "os.exec"},  # itself, once more, with the flags it had
        "cli/supervisor.py": {"os.exec", "os.fork"},  # the command, supervised; it names os.execv of others' code
        "analysis/cluster.py": {"LocalCluster("},
    }


# ------------------------------------------------------------------------------------------------ the robot's code


@pytest.fixture
def robot(tmp_path):
    """A robot folder whose equations leave a mark when they are run."""
    folder = tmp_path / "slide"
    (folder / "cad").mkdir(parents=True)
    (folder / "cad" / "slide.toml").touch()
    (folder / "formula.py").write_text(FORMULA.format(mark=str(tmp_path / "mark")))
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("how", [["--quiet", "--json"], []])
def test_that_code_is_run_is_always_told(how, tmp_path):
    """In a process of its own: it is said once in each."""
    example = TWIN.parent / "docs/examples/hexapod"
    command = [sys.executable, "-P", "-m", "twin", "info", str(example), *how]
    done = subprocess.run(command, capture_output=True, text=True)
    assert f"running the Python code in {example / 'formula.py'}" in done.stderr
    if "--json" in how:
        json.loads(done.stdout)


@pytest.mark.parametrize(
    "command",
    [
        "info",
        "plan",
        "view",
        *(pytest.param(c, marks=pytest.mark.slow) for c in ("validate", "build", "export", "run")),
    ],
)
def test_no_code_runs_none_and_says_how_to_go_on(command, tmp_path, monkeypatch, capsys):
    import shutil

    monkeypatch.setenv(NO_CODE, "")  # so that it is as before afterwards
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "hexapod"
    shutil.copytree(TWIN.parent / "docs/examples/hexapod", folder)
    text = (folder / "formula.py").read_text()
    (folder / "formula.py").write_text(f"open({str(tmp_path / 'mark')!r}, 'a').write('run')\n" + text)
    more = ["--port", "0", "--no-browser"] if command == "view" else []
    assert main([command, str(folder), *more, "--no-code"]) == 2
    said = capsys.readouterr().err
    assert "formula.py" in said
    assert "--no-code" in said
    assert "internal error" not in said
    assert not (tmp_path / "mark").exists()


def test_no_code_holds_for_the_interface_and_for_other_processes(robot, monkeypatch, tmp_path):
    monkeypatch.setenv(NO_CODE, "1")
    from twin.robots import load_formula

    with pytest.raises(CodeRefusedError, match=r"formula\.py"):
        load_formula(robot)
    assert load_formula("sils").name == "sils"  # our own is not a stranger's
    hexapod = str(TWIN.parent / "docs/examples/hexapod")
    with Call(prepare, hexapod, None) as call, pytest.raises(TwinError, match="--no-code"):
        call.result()
    assert not (tmp_path / "mark").exists()
