"""The framework that builds environments for foreign programs, without the network."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).parent


@pytest.fixture
def framework(witness_environments, monkeypatch, tmp_path):
    monkeypatch.setenv("TWIN_WITNESS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(witness_environments, "HERE", tmp_path)
    (tmp_path / "printer.txt").write_text("some-printer==1.0\n")
    return witness_environments


def answers(monkeypatch, framework, code: int) -> list[list[str]]:
    """Let every command end with a code; return the list that they are noted in."""
    seen: list[list[str]] = []

    def run(command, cwd=None, timeout=0.0):
        seen.append([str(c) for c in command])
        return subprocess.CompletedProcess(command, code, "", "no route to host")

    monkeypatch.setattr(framework, "_run", run)
    monkeypatch.setattr(framework, "_uv", lambda: "uv")
    return seen


def test_every_requirement_is_pinned():
    lists = sorted(HERE.glob("*.txt"))
    assert lists
    for path in lists:
        for line in path.read_text().splitlines():
            assert not line or line[0] == "#" or re.fullmatch(r"[A-Za-z0-9._\-]+==[^ ]+", line), f"{path.name}: {line}"


def test_names_are_unique(witness_environments):
    pins = [*HERE.glob("*.txt"), *HERE.glob("*.apt"), *HERE.glob("*/package-lock.json")]
    pins += [p for p in [witness_environments.WEB / "package-lock.json"] if p.is_file()]
    assert sorted(e.pins for e in witness_environments.environments().values()) == sorted(pins)


def test_witness_tests_are_where_ci_looks():
    marked = [p for p in (HERE.parent).rglob("test_*.py") if re.search(r"mark\.witness\b", p.read_text("utf-8"))]
    assert {p.name for p in marked if HERE not in p.parents} == set()


def test_failed_download_is_named_and_leaves_nothing(framework, monkeypatch, capsys, tmp_path):
    seen = answers(monkeypatch, framework, 1)
    assert framework.main(["build", "printer"]) == 1
    said = capsys.readouterr().err
    assert "NOT BUILT: printer" in said
    assert "no route to host" in said
    assert f"`{' '.join(seen[-1])}` ended with 1" in said
    assert list((tmp_path / "cache").iterdir()) == []
    assert not framework.environments()["printer"].ready


def test_built_environment_is_found_and_not_built_again(framework, monkeypatch, tmp_path):
    seen = answers(monkeypatch, framework, 0)
    assert framework.main(["build", "--all"]) == 0
    assert framework.environment("printer").folder.parent == tmp_path / "cache"
    commands = len(seen)
    assert framework.main(["build", "printer"]) == 0
    assert len(seen) == commands


def test_another_pin_is_another_environment(framework, tmp_path):
    before = framework.environments()["printer"].folder
    (tmp_path / "printer.txt").write_text("some-printer==1.1\n")
    assert framework.environments()["printer"].folder != before


def test_missing_environment_skips_loudly_or_fails_where_required(framework, foreign, monkeypatch):
    monkeypatch.delenv("TWIN_WITNESS_REQUIRED", raising=False)
    with pytest.raises(pytest.skip.Exception, match="NO PRINTER: run `make witnesses`"):
        foreign.need("printer")
    monkeypatch.setenv("TWIN_WITNESS_REQUIRED", "1")
    with pytest.raises(pytest.fail.Exception, match="NO PRINTER"):
        foreign.need("printer")


def test_reader_that_fails_is_named(witness_environments, monkeypatch):
    env = witness_environments.Environment("shell", "apt", HERE / "none.apt")
    monkeypatch.setattr(witness_environments, "environment", lambda name: env)
    with pytest.raises(RuntimeError, match="read_nothing"):
        witness_environments.read("shell", "read_nothing.py")
