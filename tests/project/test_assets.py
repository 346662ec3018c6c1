"""Where files are."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import twin
from twin.core import assets
from twin.core.errors import TwinError

ROOT = Path(__file__).parents[2]


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


def test_built_in_name_wins_over_a_folder_of_that_name(folder, monkeypatch, caplog):
    """The other robot is named, with the way to it."""
    monkeypatch.chdir(folder.parent)
    (folder.parent / "sils").mkdir()  # not a robot
    assert twin.load("sils").name == "sils"
    assert not caplog.records
    (folder.parent / "sils").rmdir()
    folder.rename(folder.parent / "sils")
    assert twin.load("sils").name == "sils"
    (said,) = caplog.messages
    assert str(folder.parent / "sils") in said
    assert "./sils" in said
    caplog.clear()
    assert twin.load("./sils").name == "arm"
    assert not caplog.records


@pytest.mark.parametrize("name", ["slis", "SILS", "sill"])
def test_misspelt_robot_gets_the_right_name(name):
    with pytest.raises(TwinError, match=rf"there is no robot '{name}'.*Known: .*sils.*path of a robot folder"):
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


def test_a_protocol_in_a_folder_is_named_with_the_folder():
    robot = twin.load("raven_left")
    assert robot.protocol("around/dome").name == "dome"
    for wrong in ("around/dom", "../raven_left/around/dome", "around", "/around/dome"):
        with pytest.raises(TwinError, match="there is no protocol"):
            robot.protocol(wrong)
