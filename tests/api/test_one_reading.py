"""A command reads each file of a robot once, and what it hashes are the bytes that it read."""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import shutil
import sys
from collections import Counter
from pathlib import Path

import pytest

import twin
from twin.cli import main
from twin.core import assets
from twin.core.errors import BudgetError
from twin.core.foreign import budget
from twin.core.foreign.once import Once

pytestmark = pytest.mark.usefixtures("no_plots")

_OPENED: list[str] | None = None


def _heard(event: str, args: tuple) -> None:
    if _OPENED is not None and event == "open" and isinstance(args[0], str | os.PathLike):
        _OPENED.append(os.path.realpath(args[0]))


@pytest.fixture(scope="module")
def hearing():
    """Hear of every opened file, as late as possible: Python takes no such hook back, and it slows down the others."""
    sys.addaudithook(_heard)


@pytest.fixture
def opened(hearing):
    """Paths in the order in which this process has opened them."""
    global _OPENED
    _OPENED = found = []
    yield found
    _OPENED = None


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A user's folder with the built-in robot whose drawing is the smallest."""
    name = min(twin.names(), key=lambda n: sum(p.stat().st_size for p in assets.files(n).cad.glob("*.step")))
    files, out = assets.files(name), tmp_path_factory.mktemp("robots") / name
    for part in ("cad", "usd", "trajectories"):
        shutil.copytree(getattr(files, part), out / part)
    shutil.copy(files.formula, out / "formula.py")
    return out


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


COMMANDS = {
    "info": ["info", "{robot}"],
    "plan": ["plan", "{robot}", "--out", "{out}"],
    "explain": ["explain", "{robot}"],
    "list": ["list"],
}
LONG = {
    "export": ["export", "{robot}", "--to", "tracks", "--out", "{out}"],
    "validate": ["validate", "{robot}", "--all-protocols", "--out", "{out}"],
}
LONGEST = {
    "check": ["build", "{robot}", "--check"],
    "run": ["run", "{robot}", "--all-protocols", "--out", "{out}"],
}


@pytest.mark.parametrize(
    "words",
    [
        *COMMANDS.values(),
        *(pytest.param(w, marks=pytest.mark.slow) for w in LONG.values()),
        *(pytest.param(w, marks=pytest.mark.nightly) for w in LONGEST.values()),
    ],
    ids=lambda w: w[0],
)
def test_a_command_opens_each_file_of_a_robot_once(words, folder, opened, tmp_path, capsys):
    main([w.format(robot=folder, out=tmp_path / "out") for w in words])

    root = assets.data_folder() if words == ["list"] else folder
    robot = [p for p in opened if Path(p).is_relative_to(root) and Path(p).suffix in (".toml", ".step", ".py")]
    known = [p for p in robot if "site-packages" not in p and Path(p).parent.name != "tests"]
    counts = Counter(known)
    assert {Path(p).suffix for p in counts} >= ({".toml"} if words == ["list"] else {".toml", ".step", ".py"})
    assert {p: n for p, n in counts.items() if n != 1} == {}
    if words[0] == "export":
        proof = json.loads((tmp_path / "out/proof.json").read_text())
        told = {f["file"]: f["sha256"] for f in proof["inputs"]}
        assert told == {p.relative_to(folder).as_posix(): _hash(p) for p in map(Path, counts)}


def test_a_file_is_read_again_once_it_has_changed(tmp_path, opened):
    read, path = Once(), tmp_path / "a.toml"
    path.write_text("a = 1")
    assert [read(path, "TOML") for _ in range(3)] == [b"a = 1"] * 3
    path.write_text("a = 2")  # as long as before
    os.utime(path, ns=(1, 1))
    assert read(path, "TOML") == b"a = 2"
    (tmp_path / "b").write_text("a = 3")
    (tmp_path / "b").replace(path)  # as this program writes
    assert read(path, "TOML") == b"a = 3"
    assert read(path, "TOML") == b"a = 3"
    path.unlink()
    with pytest.raises(FileNotFoundError):
        read(path, "TOML")


def test_a_reader_keeps_to_the_limits_and_takes_nothing_to_another_process(tmp_path):
    read, path = Once(), tmp_path / "a.toml"
    path.write_bytes(b" " * budget.BUDGETS["TOML"].bytes)
    read(path, "TOML")
    assert len(pickle.dumps(read)) < 1000
    path.write_bytes(b" " * (budget.BUDGETS["TOML"].bytes + 1))
    with pytest.raises(BudgetError):
        read(path, "TOML")


def test_equations_are_explained_as_they_ran(folder, tmp_path):
    """A file that is edited meanwhile does not move the lines of what runs."""
    from twin.formula.variant_rows import function_definition

    copy = tmp_path / folder.name
    shutil.copytree(folder, copy)
    formula = twin.load(copy).formula
    function = next(iter(formula.equations[0].variants.values()))
    line = function_definition(function).lineno
    (copy / "formula.py").write_text("# other\n" * 5 + (copy / "formula.py").read_text())
    assert function_definition(function).lineno == line
    assert not (copy / "__pycache__").exists()
