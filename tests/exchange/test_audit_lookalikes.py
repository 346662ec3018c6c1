"""`twin audit --robot`: no lookalike of a robot passes, and no file of the robot itself is accused.

TWIN_LOOKALIKES=40 draws forty lookalikes over six robots, every second one beside tracks of the true robot; the default
is a few without tracks. TWIN_LOOKALIKES_SEED draws others.
"""

from __future__ import annotations

import os
import shutil
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import twin
from made import lookalikes
from twin.cli import main

LOOKALIKES = int(os.environ.get("TWIN_LOOKALIKES", "3"))
SEED = int(os.environ.get("TWIN_LOOKALIKES_SEED", "38"))
LONG = LOOKALIKES >= 40
ROBOTS = ("pa10", "davinci_psm", "raven_left", "hibou", "sils", "sher") if LONG else ("pa10",)


@cache
def robot(name: str):
    return twin.load(name).weighed()


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Return a function that copies the true files of a robot in one format to a folder."""
    kept = tmp_path_factory.mktemp("true")

    def copied(name: str, kind: str, folder: Path) -> Path:
        source = kept / name / kind
        if not source.exists():
            lookalikes.write(robot(name).mechanism, kind, source)
        shutil.copytree(source, folder)
        return folder

    return copied


@pytest.fixture(scope="module")
def add_tracks(tmp_path_factory):
    """Return a function that adds the tracks of a robot's default protocol to a folder."""
    kept = tmp_path_factory.mktemp("tracks")

    def added(name: str, folder: Path) -> None:
        source = kept / name
        if not source.exists():
            protocol = robot(name).protocol().name
            twin.export(robot(name), out=source, to=["tracks"], protocols=[protocol])
        shutil.copytree(source / "tracks", folder / "tracks")

    return added


def placed(report) -> list[str]:
    """Return the checks of geometry against the mechanism."""
    return [c.check for c in report.checks if c.against == "the mechanism" and c.unit in ("m", "rad")]


@pytest.mark.slow
def test_no_lookalike_passes(files, add_tracks, tmp_path):
    """A lookalike with the names of the robot disagrees; one with other names disagrees or is unchecked."""
    rng = np.random.default_rng(SEED)
    found = 0
    for i in range(LOOKALIKES):
        name, kind = ROBOTS[i % len(ROBOTS)], lookalikes.FORMATS[i % 4 if len(ROBOTS) == 1 else (i + i // 6) % 4]
        folder = files(name, kind, tmp_path / str(i))
        done = lookalikes.change(folder, kind, int(rng.integers(1, 6)), rng)
        renamed = i % 3 == 2
        if renamed:
            lookalikes.rename(folder, kind)
        with_tracks = LONG and i % 2 == 1
        if with_tracks:
            add_tracks(name, folder)
        report = twin.audit(folder, robot(name))
        told = [(f.severity, f.code, f.message) for f in report.findings]
        print(name, kind, "renamed" if renamed else "named", "tracks" if with_tracks else "", report.verdict, done)
        assert report.verdict != "agree", (name, kind, done, told)
        found += renamed or report.verdict == "disagree"
    assert found >= 0.95 * LOOKALIKES


@pytest.mark.parametrize("kind", lookalikes.FORMATS)
def test_a_true_file_passes_and_says_what_was_compared(kind, files, add_tracks, tmp_path):
    for i, name in enumerate(ROBOTS):
        folder = files(name, kind, tmp_path / name)
        if LONG and i % 2 == 1:
            add_tracks(name, folder)
        report = twin.audit(folder, robot(name))
        assert report.verdict == "agree", report.findings
        assert placed(report), name


SLOW = [pytest.param(kind, marks=pytest.mark.slow) for kind in ("mjcf", "usd")]


@pytest.mark.parametrize("kind", ["urdf", "glb", *SLOW])
def test_a_true_file_with_other_names_is_not_accused(kind, files, tmp_path):
    for name in ROBOTS:
        folder = files(name, kind, tmp_path / name)
        lookalikes.rename(folder, kind)
        report = twin.audit(folder, robot(name))
        print(name, kind, report.headline)
        assert report.verdict != "disagree", report.findings
        assert report.verdict == "unchecked" or placed(report)


CHAIN = """<robot name="arm"><link name="base"/><link name="l1"/><link name="l2"/><link name="tool"/>
<joint name="q1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="q2" type="revolute"><parent link="l1"/><child link="l2"/><axis xyz="0 1 0"/>
  <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="q3" type="revolute"><parent link="l2"/><child link="tool"/><origin xyz="0.3 0 0.05"/><axis xyz="1 0 0"/>
  <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""


def test_another_arm_with_the_names_of_the_joints_is_accused_by_joint_and_length(tmp_path, capsys):
    file = tmp_path / "arm.urdf"
    file.write_text(CHAIN)
    assert main(["audit", str(file), "--robot", "pa10"]) == 1
    out = capsys.readouterr().out
    assert "FAIL" in out
    assert "the axes of joints 'q2' and 'q3' are 50 mm apart; in the mechanism they are 0 mm apart" in out


def test_what_cannot_be_compared_is_unchecked_in_the_headline(tmp_path, capsys):
    file = tmp_path / "arm.urdf"
    file.write_text(CHAIN.replace('name="q', 'name="joint').replace('type="revolute"', 'type="prismatic"'))
    assert main(["audit", str(file), "--robot", "pa10"]) == 2
    out = capsys.readouterr().out
    assert "UNCHECKED: arm.urdf could not be compared with the mechanism" in out
    assert "PASS" not in out


def test_a_single_file_without_a_robot_is_valid_not_passed(tmp_path, capsys):
    file = tmp_path / "arm.urdf"
    file.write_text(CHAIN)
    assert main(["audit", str(file)]) == 0
    out = capsys.readouterr().out
    assert "VALID" in out
    assert "PASS" not in out
