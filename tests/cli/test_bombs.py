"""Small files that would cost hours or gigabytes are refused in 10 s and 1 GB; the message names file and limit."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from made import bombs
from made.lanes import nightly
from twin.cli import main

# What needs a parser's own process to be found takes seconds: the rest is the default suite's.
NATIVE = {name for name, b in bombs.BOMBS.items() if "parser" in b.says or "prims" in b.says}
LARGE = {"threemf_of_3_mb_that_unpacks_to_gigabytes", "usdz_that_unpacks_to_gigabytes", "obj_beside_a_urdf_of_60_mb"}


@pytest.mark.parametrize("name", sorted(set(bombs.BOMBS) - NATIVE - LARGE))
def test_bomb_is_refused(name, tmp_path, capsys):
    bomb = bombs.BOMBS[name]
    file = bomb.make(tmp_path)
    assert main([a.format(file=file, folder=tmp_path) for a in bomb.argv]) == 2
    told = "".join(capsys.readouterr())
    assert bomb.says in told
    assert str(tmp_path) in told
    assert "internal error" not in told
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize("name", nightly(sorted(bombs.BOMBS, reverse=True), every=4))
def test_bomb_costs_little(name, tmp_path):
    """10 s, and 1 GB in any process: the system stops at twice that."""
    bomb = bombs.BOMBS[name]
    file = bomb.make(tmp_path)
    argv = [sys.executable, "-m", "twin", *(a.format(file=file, folder=tmp_path) for a in bomb.argv)]
    env = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    with (tmp_path / "told").open("wb") as told:
        process = subprocess.Popen(
            argv,
            stdout=told,
            stderr=told,
            env=env,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (2_000_000_000, 2_000_000_000)),
        )
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    text = (tmp_path / "told").read_text(errors="replace")
    print(f"{name:60s} {used.ru_utime + used.ru_stime:5.1f} s {used.ru_maxrss / 1e6:5.2f} GB {text.strip()[-160:]}")
    assert process.returncode == 2, text
    assert bomb.says in text
    assert "internal error" not in text
    assert "Traceback" not in text
    assert used.ru_maxrss < 1_000_000  # kB, the largest of it and its children
    assert used.ru_utime + used.ru_stime < 10  # of processor time, of all


def test_honest_file_beside_is_no_concern(tmp_path):
    """The same models, small: they are read."""
    file = bombs._3mf(tmp_path, bombs._doubled(3, 2))
    assert main(["new", "bomb", "--from", str(file), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    assert Path(tmp_path / "out/cad/bomb.toml").is_file()
