"""Lengths of single parts: measured on the CAD, compared with the parameters of the equations."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import twin
from twin.cad.build import read_mechanism
from twin.cad.lengths import measured_lengths
from twin.core.errors import CadError, DescriptionError, TwinError
from twin.core.units import MM

ROOT = Path(__file__).parents[2]


@pytest.fixture
def copied(tmp_path):
    """Return a function that copies SHER's description and STEP, with the text of the first length replaced."""

    def make(old: str, new: str) -> Path:
        text = (ROOT / "cad/sher/sher.toml").read_text(encoding="utf-8")
        assert old in text
        (tmp_path / "sher.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
        shutil.copy(ROOT / "cad/sher/sher.step", tmp_path)
        return tmp_path / "sher.toml"

    return make


@pytest.mark.parametrize("robot", twin.names())
def test_every_declared_length_is_that_of_the_equations(robot):
    loaded = twin.load(robot)
    found = measured_lengths(loaded.cad)
    declared = len(loaded.cad.description.length)
    assert len(found) == declared
    for length in found:
        assert length.value == pytest.approx(loaded.kinematics().parameters[length.parameter], abs=1e-10)


@pytest.mark.nightly
def test_lengths_that_one_part_shows_are_declared():
    """Those of PA-10, Lapbot and Hibou span several parts, and are judged by the poses alone."""
    assert sum(len(twin.load(robot).cad.description.length) for robot in twin.names()) >= 46


def test_each_pair_of_kinds_has_a_distance(copied):
    """Sphere to axis (a rod), axis to axis (a link), axis to a plane beside it."""
    path = copied('between = ["pin_a", "pin_b"]', 'between = ["pin_b", "pin_a"]')
    by = {(x.body, x.parameter): x.value for x in measured_lengths(read_mechanism(path, with_mass=False))}
    assert by["arm", "AB"] == pytest.approx(28 * MM, abs=1e-10)
    assert by["rod2b", "l"] == pytest.approx(68 * MM, abs=1e-10)
    assert np.isfinite(list(by.values())).all()


def test_axes_that_are_not_parallel_have_no_length(copied):
    path = copied('between = ["pin_a", "pin_b"]', 'between = ["pin_a", "shaft"]')
    with pytest.raises(CadError, match="length on 'arm': 'pin_a' and 'shaft' are not parallel"):
        measured_lengths(read_mechanism(path, with_mass=False))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('["pin_a", "pin_b"]', '["pin_a", "pin_z"]', "body 'arm': there is no feature 'pin_z'"),
        ('[[length]]\nbody = "arm"', '[[length]]\nbody = "ann"', "there is no body 'ann'"),
    ],
)
def test_unknown_names_are_told_with_their_line(copied, old, new, message):
    with pytest.raises(DescriptionError, match=re.escape(message)) as error:
        read_mechanism(copied(old, new))
    assert re.search(r"sher\.toml:\d+", str(error.value))


def test_a_parameter_that_the_equations_do_not_have_is_named(tmp_path):
    (tmp_path / "cad").mkdir()
    text = (ROOT / "cad/sher/sher.toml").read_text(encoding="utf-8").replace('parameter = "AB"', 'parameter = "BA"')
    (tmp_path / "cad/sher.toml").write_text(text, encoding="utf-8")
    shutil.copy(ROOT / "cad/sher/sher.step", tmp_path / "cad")
    shutil.copytree(ROOT / "trajectories/sher", tmp_path / "trajectories")
    shutil.copy(ROOT / "twin/robots/sher.py", tmp_path / "formula.py")
    with pytest.raises(TwinError, match=r"no parameter 'BA'.*AB"):
        twin.validate(twin.load(tmp_path))
