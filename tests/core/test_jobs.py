"""A function in another process: answers, errors, death."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import numpy as np
import pytest

from twin.core import assets
from twin.core.errors import TwinError
from twin.core.jobs import Call


def test_the_answer_comes_back():
    with Call(np.linalg.norm, np.array([3.0, 4.0])) as task:
        assert task.result() == 5.0


def test_an_error_of_ours_is_raised_here():
    with Call(assets.files, "sill") as task, pytest.raises(TwinError, match="there is no robot 'sill'"):
        task.result()


def test_a_process_that_dies_is_told_with_its_last_words():
    with Call(os._exit, 3) as task, pytest.raises(TwinError, match="the worker process ended with exit code 3"):
        task.result()
    with Call(np.linalg.inv, "no matrix") as task, pytest.raises(TwinError, match="LinAlgError"):
        task.result()


def test_leaving_ends_it():
    start = time.monotonic()
    with Call(time.sleep, 600) as task:
        pass
    assert not task._process.alive
    assert time.monotonic() - start < 300  # it does not wait for the process to end by itself


@pytest.fixture
def hostile(tmp_path, monkeypatch):
    """A working directory with modules that say so when they are imported."""
    for name in ("twin", "numpy", "json", "pickle", "socket", "multiprocessing", "tempfile"):
        (tmp_path / f"{name}.py").write_text("open('imported', 'a').write(__name__)\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_second_process_imports_nothing_from_the_working_directory(hostile):
    with Call(np.linalg.norm, np.array([3.0, 4.0])) as task:
        assert task.result() == 5.0
    assert not (hostile / "imported").exists()


@pytest.mark.slow
def test_nor_does_any_process_that_the_command_line_starts(hostile):
    """Whoever runs twin in a downloaded folder runs the equations of the robot that is named, and nothing else."""
    program = hostile / "elsewhere/program.py"
    program.parent.mkdir()
    program.write_text(
        "if __name__ == '__main__':\n"
        "    import twin.cli, multiprocessing\n"
        "    twin.cli.main(['list'])\n"
        "    p = multiprocessing.get_context('spawn').Process(target=print, args=('spawned',)); p.start(); p.join()\n"
    )
    done = subprocess.run([sys.executable, program], cwd=hostile, capture_output=True, text=True)
    assert "spawned" in done.stdout, done.stderr
    assert not (hostile / "imported").exists()
