"""A check that ends early never passes: every way to end the program gives exit code 2, a message, and the place."""

from __future__ import annotations

import io
import json
import os
import runpy
import subprocess
import sys
from argparse import Namespace
from pathlib import Path

import pytest

from twin.cli import command_line
from twin.cli.command_line import after_imports
from twin.cli.parser import HELP, Command
from twin.core.errors import TwinError
from twin.core.jobs import Call
from twin.core.program_end import SECONDS, ProgramEndError, contained, ending
from twin.robots import load_formula

ENDINGS = {  # code of an author that tries to end the program, and a part of the message
    "SystemExit(0)": "raise SystemExit(0)",
    "SystemExit('done')": "raise SystemExit('done')",
    "SystemExit": "import sys; sys.exit()",
    "SystemExit(3)": "exit(3)",
    "by SystemExit, so": "quit(None)",
    "KeyboardInterrupt": "raise KeyboardInterrupt",
    "GeneratorExit": "raise GeneratorExit",
    "Leaving": "class Leaving(BaseException): pass\nraise Leaving",
    "CancelledError": "import asyncio\nraise asyncio.CancelledError",
    "SystemExit(0), so": "import sys\ndef end(*a): raise SystemExit(0)\nsys.settrace(end)\n(lambda: None)()",
    "without an end": "while True: pass",
    "run for 0.2 s": "while True:\n  try:\n    while True: pass\n  except Exception: pass",
    "for 0.2 s without": "import time; time.sleep(1e6)",
    "0.2 s without an": "import threading; threading.Event().wait()",
}

ENDLESS = ("without an end", "run for 0.2 s", "for 0.2 s without", "0.2 s without an")

INTERPRETER_ENDS = {  # what Python cannot catch: the process ends
    "os._exit was called at": "import os; os._exit(0)",
    "at PATH": "from os import _exit; _exit(0)",
    "os.execv was called": "import os; os.execv('/bin/true', ['true'])",
    "os.execve was called": "import os; os.execle('/bin/true', 'true', {})",
    "with exit code 0": "import ctypes; ctypes.CDLL(None).exit(0)",
    "ended with exit code 0": "import ctypes; ctypes.CDLL(None)._exit(0)",
    "exit code 1 before": "import faulthandler as f, time; f.dump_traceback_later(0.05, exit=True); time.sleep(30)",
    "SIGABRT": "import os; os.abort()",
    "SIGKILL": "import os; os.kill(os.getpid(), 9)",
    "SIGTERM": "import os; os.kill(os.getpid(), 15)",
    "SIGHUP": "import os; os.kill(os.getpid(), 1)",
    "SIGSEGV": "import ctypes; ctypes.string_at(0)",
    "os._exit": "import os, threading, time; threading.Timer(0, os._exit, [0]).start(); time.sleep(30)",
    "exit code 0": "import os, threading, time; threading.Thread(target=os._exit, args=[0]).start(); time.sleep(30)",
    "SIGXCPU": "import resource; resource.setrlimit(resource.RLIMIT_CPU, (1, 5))\nwhile True: pass",
    "was ended by SIGTERM (os.kill was called at PATH": "import os, time; os.kill(os.getppid(), 15); time.sleep(30)",
    "SIGHUP (os.kill was": "import os, time; os.kill(os.getppid(), 1); time.sleep(30)",
    "SIGTERM (os.kill was": "import os; os.kill(0, 15)",
    "SIGTERM (os.killpg": "import os; os.killpg(os.getpgid(0), 15)",
    "ended by SIGTERM before": "import os; os.system(f'kill -15 {os.getppid()}; sleep 3 >&- 2>&-')",
    "SIGALRM": "import signal; signal.signal(14, signal.SIG_DFL); signal.alarm(1); signal.pause()",
}

OUTPUT_ENDS = {  # the program goes on, but prints where nobody reads
    "replaces sys.stdout": "import io, sys; sys.stdout = io.StringIO()",
    "the code replaces sys.stdout, so": "import sys; sys.stdout = None",
    "replaces print": "import builtins; builtins.print = lambda *a, **k: None",
    "closes sys.stdout": "import sys; sys.stdout.close()",
    "the code closes sys.stdout, so": "import sys; sys.stdout.detach()",
    "closes or redirects the file descriptor 1": "import os; os.close(1)",
    "redirects the file descriptor 1": "import os; os.dup2(os.open(os.devnull, os.O_WRONLY), 1)",
}

FORMULA = """
import numpy as np

def forward(q):
    {inside}
    return np.eye(4)

{outside}
"""


def written(folder: Path, code: str, where: str) -> Path:
    path = folder / "formula.py"
    indented = code.replace("\n", "\n    ")
    text = (
        FORMULA.format(inside=indented, outside="") if where == "forward" else FORMULA.format(inside="", outside=code)
    )
    path.write_text(text)
    return path


@pytest.mark.parametrize("where", ["import", "forward"])
@pytest.mark.parametrize("message", ENDINGS)
def test_code_that_ends_the_program_is_an_error_with_file_and_line(tmp_path, monkeypatch, message, where):
    path = written(tmp_path, ENDINGS[message], where)
    line = path.read_text().split(ENDINGS[message].split("\n")[0])[0].count("\n") + 1
    last = line + ENDINGS[message].count("\n")

    def driven():
        import numpy as np

        return (("q1", True),), np.eye(4), np.zeros(1)

    # On a busy computer, a short time may be over before the code begins: then it gets more.
    limits = ("0.2", "2", "20") if message in ENDLESS else ("1000",)
    text = place = ""
    for seconds in limits:
        monkeypatch.setenv(SECONDS, seconds)
        with pytest.raises(ProgramEndError) as error, after_imports():  # as on the command line, for Ctrl-C
            load_formula(path, driven=driven)
        text = str(error.value).replace(f"{seconds} s", "0.2 s")
        place = text.split(": ")[0]
        if place.startswith(f"{path}:"):
            break
    assert message in text
    assert place.startswith(f"{path}:")
    assert line <= int(place.rsplit(":", 1)[1]) <= last


@pytest.mark.parametrize("where", ["import", "forward"])
@pytest.mark.parametrize("message", [m for m in OUTPUT_ENDS if "print" in m or "replaces" in m])
def test_code_that_prints_elsewhere_is_an_error_with_its_file(tmp_path, capsys, message, where):
    path = written(tmp_path, OUTPUT_ENDS[message], where)

    def driven():
        import numpy as np

        return (("q1", True),), np.eye(4), np.zeros(1)

    with pytest.raises(ProgramEndError, match="so no verdict can be printed") as error:
        load_formula(path, driven=driven)
    assert message in str(error.value)
    place = path if where == "import" else f"{path}:4"
    assert str(error.value).startswith(f"{place}: the code ")
    print("seen")
    assert capsys.readouterr().out == "seen\n"


def test_code_that_restores_the_output_is_right(tmp_path):
    code = "import contextlib, io\nwith contextlib.redirect_stdout(io.StringIO()):\n    print('not seen')"
    path = written(tmp_path, code + "\nraise SystemExit", "import")
    with pytest.raises(ProgramEndError, match="ends the program by SystemExit"):
        load_formula(path)


@pytest.mark.parametrize("message", OUTPUT_ENDS)
def test_a_command_that_prints_where_nobody_reads_has_exit_code_2(tmp_path, message):
    """Also if the code does so in a thread, after it has been called: the command line checks its output at the end."""
    path = tmp_path / "author.py"
    path.write_text(OUTPUT_ENDS[message])
    program = (
        "import runpy, sys\n"
        "from twin.cli import command_line\n"
        "from twin.cli.supervisor import supervised\n"
        "def command(args):\n"
        f"    runpy.run_path({str(path)!r})\n"
        "    try:\n"
        "        print('done')\n"
        "    except (OSError, ValueError):\n"
        "        pass\n"
        "    return 0\n"
        "command_line._prepared = lambda args: command\n"
        "sys.exit(supervised(lambda: command_line.run(['list'])))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert message in done.stderr
    assert "no verdict can be printed" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_time_is_that_of_the_outermost_context_and_ends_with_it(monkeypatch):
    import signal

    monkeypatch.setenv(SECONDS, "1000")
    before = signal.signal(signal.SIGALRM, signal.SIG_IGN)
    with contained(Path(__file__)):
        outer = signal.getitimer(signal.ITIMER_REAL)[0]
        with contained(Path(__file__)):
            assert 0 < signal.getitimer(signal.ITIMER_REAL)[0] <= outer
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0
    assert signal.signal(signal.SIGALRM, before) == signal.SIG_IGN


@pytest.mark.parametrize("text", ["0", "-1", "nan", "inf", "soon"])
def test_a_wrong_time_is_refused(monkeypatch, text):
    monkeypatch.setenv(SECONDS, text)
    with (
        pytest.raises(TwinError, match=f"{SECONDS}={text}: give a positive number of seconds"),
        contained(Path(__file__)),
    ):
        pass


def supervised(path: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Execute a file as the command of the supervised command line."""
    program = (
        "import runpy, sys\n"
        "from twin.cli.supervisor import supervised\n"
        "def command():\n"
        f"    runpy.run_path({str(path)!r})\n"
        "    print('done')\n"
        "    return 0\n"
        "sys.exit(supervised(command))\n"
    )
    line = [sys.executable, "-c", program, *arguments]
    # in a process group of its own, because some of these files send signals to their group
    return subprocess.run(line, capture_output=True, text=True, timeout=120, check=False, start_new_session=True)


def lane(message):
    """Mark the file that uses a whole second of processor time, the least limit that there is, for the slow lane."""
    return pytest.param(message, marks=pytest.mark.slow) if message == "SIGXCPU" else message


@pytest.mark.parametrize("message", [lane(message) for message in INTERPRETER_ENDS])
def test_a_process_that_ends_without_a_verdict_has_exit_code_2(tmp_path, message):
    path = tmp_path / "author.py"
    path.write_text(INTERPRETER_ENDS[message])
    done = supervised(path)
    assert (done.returncode, done.stdout) == (2, "")
    assert message.replace("PATH", f"{path}:1") in done.stderr
    assert "before it printed a verdict, so nothing was checked" in done.stderr


def test_a_file_name_with_a_line_that_is_a_number_is_no_exit_code(tmp_path):
    folder = tmp_path / "a\n0\nexit code 0\n"
    folder.mkdir()
    path = folder / "author.py"
    path.write_text("import os; os._exit(3)")
    done = supervised(path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "with exit code 3" in done.stderr


INTERRUPTS = {  # code of an author that interrupts its own program, and whether it does so where it runs
    "import _thread; _thread.interrupt_main()": True,
    "import signal; signal.raise_signal(signal.SIGINT)": True,
    "import os; os.kill(os.getpid(), 2)": True,
    "import os, time; os.kill(os.getppid(), 2); time.sleep(30)": True,
    "import os, time; os.kill(0, 2); time.sleep(30)": True,
    "import _thread, threading as t; t.Timer(0.2, _thread.interrupt_main).start()": False,
}


def commanded(path: Path, code: str) -> list[str]:
    """Return the line of a program that runs code of an author, contained, as a command that waits for its timers."""
    path.write_text(code)
    program = (
        "import pathlib, runpy, sys, threading\n"
        "from twin.cli import command_line\n"
        "from twin.cli.supervisor import supervised\n"
        "from twin.core.program_end import contained\n"
        "def command(args):\n"
        f"    path = pathlib.Path({str(path)!r})\n"
        "    with contained(path):\n"
        "        runpy.run_path(str(path))\n"
        "    for thread in threading.enumerate():\n"
        "        if isinstance(thread, threading.Timer):\n"
        "            thread.join()\n"
        "    print('done')\n"
        "    return 0\n"
        "command_line._prepared = lambda args: command\n"
        "sys.exit(supervised(lambda: command_line.run(['list'])))\n"
    )
    return [sys.executable, "-c", program]


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory):
    """Start a program for each interrupt, all at once because each waits; return {code: (file, process)}."""
    started = {}
    for code in INTERRUPTS:
        path = tmp_path_factory.mktemp("interrupted") / "author.py"
        line = commanded(path, code)
        pipe = subprocess.PIPE
        started[code] = path, subprocess.Popen(line, stdout=pipe, stderr=pipe, text=True, start_new_session=True)
    yield started
    for _, process in started.values():
        process.kill()
        process.communicate()


@pytest.mark.parametrize(("code", "here"), INTERRUPTS.items())
def test_an_interrupt_by_code_is_no_ctrl_c(interrupted, code, here):
    path, process = interrupted[code]
    out, err = process.communicate(timeout=120)
    assert (process.returncode, out) == (2, "")
    assert "the code ends the program by KeyboardInterrupt, so nothing can be checked" in err
    if here:
        assert f"twin: {path}:1: the code" in err


def test_an_interrupt_that_comes_twice_is_told_where_the_first_one_came(tmp_path):
    path = written(tmp_path, "raise KeyboardInterrupt", "import")
    try:
        try:
            runpy.run_path(str(path))
        finally:
            raise KeyboardInterrupt
    except KeyboardInterrupt as second:
        text = str(ending(second))
    assert text.startswith(f"{path}:")


@pytest.mark.parametrize("group", [False, True])
def test_ctrl_c_has_exit_code_130_also_while_code_of_an_author_runs(tmp_path, group):
    import signal

    line = commanded(tmp_path / "author.py", "import time; print('ready', flush=True); time.sleep(30)")
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(line, text=True, start_new_session=True, **pipes) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        (os.killpg if group else os.kill)(process.pid, signal.SIGINT)
        said = process.communicate(timeout=60)
    assert (process.returncode, *said) == (130, "", "twin: interrupted: nothing was written\n")


def test_a_crash_of_a_native_library_prints_the_line_that_called_it(tmp_path):
    path = tmp_path / "author.py"
    path.write_text("import ctypes\nctypes.string_at(0)\n")
    assert f'File "{path}", line 2' in supervised(path).stderr


def test_an_exit_handler_does_not_change_the_exit_code(tmp_path):
    path = tmp_path / "author.py"
    path.write_text("import atexit, os\natexit.register(os._exit, 1)\n")
    done = supervised(path)
    assert (done.returncode, done.stdout) == (0, "done\n")


def test_an_early_end_is_an_error_in_json(tmp_path):
    path = tmp_path / "author.py"
    path.write_text("import os; os._exit(0)")
    record = json.loads(supervised(path, "--json").stdout)
    assert (record["verdict"], record["error"]) == ("unchecked", "EndedError")


@pytest.mark.parametrize("command", HELP)
def test_no_command_passes_if_its_code_exits(capsys, monkeypatch, command):
    def leave(args):
        raise SystemExit(0)

    assert _code_of(leave, command, monkeypatch) == 2
    assert "the code ends the program by SystemExit(0), so nothing can be checked" in capsys.readouterr().err


@pytest.mark.parametrize("command", HELP)
def test_no_command_passes_if_its_verdict_is_printed_elsewhere(capsys, monkeypatch, command):
    def print_elsewhere(args):
        sys.stdout = io.StringIO()
        print("agree")
        return 0

    assert _code_of(print_elsewhere, command, monkeypatch) == 2
    assert "the code replaces sys.stdout, so no verdict can be printed" in capsys.readouterr().err


def _code_of(function, command, monkeypatch):
    """Return the exit code of a command that runs a function instead of its own."""
    monkeypatch.setattr(command_line, "_prepared", lambda args: function)
    parsed = Namespace(command=command, json=False, debug=False)
    monkeypatch.setattr(Command, "parse_known_args", lambda self, args, names: (parsed, []))
    return command_line.run([command])


def leave_worker(status: int) -> None:
    os._exit(status)


def exit_worker() -> None:
    raise SystemExit(0)


def test_the_end_of_a_worker_is_an_error_of_its_caller(capfd):
    with Call(leave_worker, 0) as call, pytest.raises(TwinError, match="the worker process ended with exit code 0"):
        call.result()
    assert f"twin: os._exit was called at {__file__}:" in capfd.readouterr().err
    with Call(exit_worker) as call, pytest.raises(TwinError, match=r"the code ends the program by SystemExit\(0\)"):
        call.result()


WORKER_ENDS = {
    "by SIGABRT": "import os; os.abort()",
    "by SIGALRM": "import signal; signal.setitimer(signal.ITIMER_REAL, 0.05); signal.pause()",
    "with exit code 1": "import faulthandler, time; faulthandler.dump_traceback_later(0.05, exit=True); time.sleep(30)",
    "with exit code 0": "import os, threading, time; threading.Timer(0, os._exit, [0]).start(); time.sleep(30)",
    "by SystemExit": "import sys\ndef end(*a): raise SystemExit(0)\nsys.settrace(end)\n(lambda: None)()",
    "worker process ended": "import os; os.closerange(3, 100)",
    "worker process ended with exit code 1": "raise GeneratorExit",
}


@pytest.mark.parametrize("message", WORKER_ENDS)
def test_a_worker_that_ends_early_gives_no_result(message):
    with Call(exec, WORKER_ENDS[message]) as call, pytest.raises(TwinError, match=message):
        call.result()


def test_a_closed_standard_error_prevents_no_verdict():
    command = f"exec {sys.executable} -m twin info silss --json 2>&-"
    done = subprocess.run(["sh", "-c", command], stdout=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert "there is no robot 'silss'" in json.loads(done.stdout)["message"], "JSON and nothing else"


def test_a_closed_output_is_refused_before_the_command_runs():
    line = [sys.executable, "-m", "twin", "list"]
    done = subprocess.run(line, capture_output=True, text=True, check=False, preexec_fn=lambda: os.close(1))
    assert done.returncode == 2
    assert "the standard output is closed, so no verdict can be printed" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_signals_reach_the_command_and_it_does_not_outlive_its_supervisor(tmp_path):
    import signal

    path = tmp_path / "author.py"
    path.write_text("import os, time\nprint(os.getpid(), flush=True)\ntime.sleep(100)\n")
    program = (
        "import runpy, sys\nfrom twin.cli.supervisor import supervised\n"
        f"sys.exit(supervised(lambda: runpy.run_path({str(path)!r}) and 0))"
    )
    for sent in (signal.SIGTERM, signal.SIGHUP, signal.SIGKILL):
        with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            child = int(process.stdout.readline())
            process.send_signal(sent)
            assert process.stdout.read() == ""  # the child has closed its output: it has ended
            assert process.wait(60) == -sent
        if sent != signal.SIGKILL:  # nobody waits for the child of a killed supervisor
            with pytest.raises(ProcessLookupError):
                os.kill(child, 0)


def test_a_signal_to_the_process_group_reaches_the_command_once(tmp_path):
    import signal

    path = tmp_path / "author.py"
    path.write_text(
        "import signal, time\nreceived = []\n"
        "signal.signal(signal.SIGINT, lambda number, frame: received.append(number))\n"
        "signal.signal(signal.SIGTERM, lambda number, frame: print(len(received), flush=True))\n"
        "print('ready', flush=True)\nwhile True:\n    time.sleep(0.01)\n"
    )
    program = (
        "import runpy\nfrom twin.cli.supervisor import supervised\n"
        f"supervised(lambda: runpy.run_path({str(path)!r}) and 0)"
    )
    command = [sys.executable, "-c", program]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True) as process:
        assert process.stdout is not None
        try:
            assert process.stdout.readline() == "ready\n"
            for times in (1, 2, 3):
                if times == 2:
                    process.send_signal(signal.SIGINT)
                else:
                    os.killpg(process.pid, signal.SIGINT)
                heard = 0
                while heard < times:  # the count of a signal that is still on its way
                    process.send_signal(signal.SIGTERM)
                    heard = int(process.stdout.readline())
                assert heard == times
            process.send_signal(signal.SIGTERM)
            assert process.stdout.readline() == "3\n"
        finally:
            process.kill()
