"""Where files are, and folders that are written whole or not at all."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from pathlib import Path

import pytest

from twin import assets
from twin.errors import OutputError, TwinError

ROOT = Path(__file__).parents[1]


def _tree(folder: Path) -> dict[str, str]:
    """Everything below a folder, hidden files too."""
    return {str(p.relative_to(folder)): p.read_text() if p.is_file() else "" for p in folder.rglob("*")}


# ---------------------------------------------------------------------------------------- robot files


def test_checkout_is_recognised():
    assert assets.is_checkout()
    assert assets.data_folder() == ROOT


def test_names_are_the_folders_with_a_description_of_their_own_name():
    assert "sils" in assets.names()
    assert all((ROOT / "cad" / n / f"{n}.toml").is_file() for n in assets.names())


def test_built_in_robot_is_spread_over_three_places():
    files = assets.files("sils")
    assert files.name == "sils"
    assert files.description == ROOT / "cad/sils/sils.toml"
    assert files.stage == ROOT / "usd/sils/sils.usda"
    assert files.trajectories == ROOT / "trajectories/sils"
    assert files.formula == ROOT / "twin/robots/sils.py"
    assert set(files.protocols()) == {p.stem for p in (ROOT / "trajectories/sils").glob("*.toml")}
    assert files.protocol("table2") == ROOT / "trajectories/sils/table2.toml"


@pytest.fixture
def folder(tmp_path) -> Path:
    robot = tmp_path / "my_robot"
    (robot / "cad").mkdir(parents=True)
    (robot / "cad/arm.toml").write_text("")
    (robot / "cad/dimensions.toml").write_text("")
    (robot / "trajectories").mkdir()
    (robot / "trajectories/wave.toml").write_text("")
    return robot


def test_robot_folder_holds_everything(folder):
    files = assets.files(folder)
    assert files.name == "arm"
    assert files.description == folder / "cad/arm.toml"
    assert files.stage == folder / "usd/arm.usda"
    assert files.formula == folder / "formula.py"
    assert files.protocols() == {"wave": folder / "trajectories/wave.toml"}


def test_robot_folder_by_relative_path_stays_the_same_when_the_directory_changes(folder, monkeypatch):
    monkeypatch.chdir(folder.parent)
    files = assets.files("my_robot")
    monkeypatch.chdir("/")
    assert files.description.is_file()


def test_robot_folder_without_protocols_has_none(folder):
    shutil.rmtree(folder / "trajectories")
    assert assets.files(folder).protocols() == {}
    with pytest.raises(TwinError, match=r"arm: there is no protocol 'wave'.* Known: none\."):
        assets.files(folder).protocol("wave")


def test_built_in_name_wins_over_a_folder_of_that_name(folder, monkeypatch):
    folder.rename(folder.parent / "sils")
    monkeypatch.chdir(folder.parent)
    assert assets.files("sils").name == "sils"
    assert assets.files("./sils").name == "arm"


@pytest.mark.parametrize("name", ["slis", "SILS", "sill"])
def test_misspelt_robot_gets_the_right_name(name):
    with pytest.raises(TwinError, match=rf"there is no robot '{name}'.*Known: .*sils.*path to a robot folder"):
        assets.files(name)


def test_near_name_is_proposed():
    with pytest.raises(TwinError, match="Did you mean 'sils'"):
        assets.files("silss")


def test_misspelt_protocol_gets_the_right_name():
    with pytest.raises(TwinError, match=r"there is no protocol 'tabel2'\. Did you mean 'table2'\? Known: .*table2"):
        assets.files("sils").protocol("tabel2")


def test_folder_without_description_says_what_is_expected(tmp_path):
    with pytest.raises(TwinError, match=r"expected one robot description in .*cad, found none.*cad/<name>\.toml"):
        assets.files(tmp_path)


def test_folder_with_two_descriptions_names_them(folder):
    (folder / "cad/leg.toml").write_text("")
    with pytest.raises(TwinError, match=r"(?s)expected one.*arm\.toml.*leg\.toml|expected one.*leg\.toml.*arm\.toml"):
        assets.files(folder)


# ------------------------------------------------------------------------------------- atomic folder


def test_atomic_folder_moves_all_files(tmp_path):
    target = tmp_path / "a/b"
    with assets.atomic_folder(target) as work:
        (work / "one").write_text("1")
        (work / "deep/er").mkdir(parents=True)
        (work / "deep/er/two").write_text("2")
        assert not (target / "one").exists()
    assert _tree(target) == {"one": "1", "deep": "", "deep/er": "", "deep/er/two": "2"}


def test_atomic_folder_replaces_what_it_writes_and_keeps_the_rest(tmp_path):
    (tmp_path / "old").write_text("old")
    (tmp_path / "both").write_text("old")
    with assets.atomic_folder(tmp_path) as work:
        (work / "both").write_text("new")
    assert _tree(tmp_path) == {"old": "old", "both": "new"}


class _MishapError(Exception):
    pass


def _write(target: Path, files: dict[str, str], error: BaseException | None = None) -> None:
    with assets.atomic_folder(target) as work:
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
        with assets.atomic_folder(tmp_path / "a/b"):
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
        with pytest.raises(OutputError, match=rf"cannot write to {target}: .*--out"), assets.atomic_folder(target):
            pytest.fail("the block is not entered")
    assert _tree(tmp_path) == {"file": "x"}


def test_folder_that_cannot_be_written_leaves_no_parents(tmp_path, monkeypatch):
    def refuse(**_):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(assets.tempfile, "mkdtemp", refuse)
    with pytest.raises(OutputError, match="Permission denied"), assets.atomic_folder(tmp_path / "a/b"):
        pytest.fail("the block is not entered")
    assert _tree(tmp_path) == {}


def test_asking_whether_a_folder_can_be_written_leaves_nothing(tmp_path):
    assets.require_writable(tmp_path / "a/b")
    assert _tree(tmp_path) == {}
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match=r"cannot write to .*file/below"):
        assets.require_writable(tmp_path / "file/below")
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
