"""Robots without equations: stages, description files and empty formulas, answered by the mechanism."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import twin
from twin.core.errors import KinematicsError, TwinError

ROOT = Path(__file__).parents[2]
MODELS = ROOT / "tests/data/importing/models"
FILES = [MODELS / f"fourbar.{suffix}" for suffix in ("urdf", "xml", "sdf")]

ARM = """<robot name="arm">
  <link name="base"/><link name="upper"/><link name="lower"/><link name="hand"/>
  <joint name="q1" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="q2" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.4 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="tip" type="fixed"><parent link="lower"/><child link="hand"/><origin xyz="0.3 0 0"/></joint>
</robot>
"""


def by_hand(q1, q2):
    """Pose of the hand of `ARM`, by trigonometry."""
    T = np.eye(4)
    c, s = np.cos(q1 + q2), np.sin(q1 + q2)
    T[:2, :2] = [[c, -s], [s, c]]
    T[0, 3] = 0.4 * np.cos(q1) + 0.3 * c
    T[1, 3] = 0.4 * np.sin(q1) + 0.3 * s
    return T


@pytest.fixture
def arm(tmp_path):
    """An arm of two links as a URDF file."""
    file = tmp_path / "arm.urdf"
    file.write_text(ARM)
    return twin.load(file)


def test_a_description_file_is_a_robot_whose_mechanism_answers(arm):
    qs = np.array([[0.3, 0.7], [-0.4, 1.1], [0.9, 0.2]])
    Ts = np.array([by_hand(*q) for q in qs])
    assert arm.name == "arm"
    assert arm.joints == ("q1", "q2")
    assert not arm.has_equations
    assert np.allclose(arm.forward(qs[0]), Ts[0], atol=1e-9)
    assert np.allclose(arm.forward(qs), Ts, atol=1e-9)
    assert np.allclose(arm.inverse(Ts[0]), qs[0], atol=1e-9)
    assert np.allclose(arm.inverse(Ts[0], seed=[0.2, 0.5]), qs[0], atol=1e-9)
    assert np.allclose(arm.inverse(Ts, seed=[0.2, 0.5]), qs, atol=1e-9)
    J = arm.jacobian(qs[0])
    step = 1e-6
    for j in range(2):
        moved = by_hand(*(qs[0] + step * np.eye(2)[j])) - by_hand(*(qs[0] - step * np.eye(2)[j]))
        assert np.allclose(J[:3, j], moved[:3, 3] / (2 * step), atol=1e-8)
    assert np.allclose(J[3:], [[0, 0], [0, 0], [1, 1]], atol=1e-12)


def test_a_seed_chooses_the_branch(arm):
    """The elbow is on either side; a pose as the seed of forward is that of the same joints."""
    T = by_hand(0.5, -0.8)
    assert np.allclose(arm.inverse(T, seed=[0.4, -0.6]), [0.5, -0.8], atol=1e-9)
    assert np.allclose(arm.forward([0.5, -0.8], seed=T), T, atol=1e-9)
    assert np.allclose(arm.forward([[0.5, -0.8]], seed=T), [T], atol=1e-9)


@pytest.mark.slow
def test_what_the_mechanism_cannot_reach_is_refused(arm):
    far = by_hand(0.3, 0.4)
    far[0, 3] += 2.0
    with pytest.raises(KinematicsError, match="2 degrees of freedom"):
        arm.inverse(far)
    near = by_hand(0.3, 0.4)
    near[0, 3] += 2e-4
    with pytest.raises(KinematicsError, match="not found to reach the pose"):
        arm.inverse(near)
    with pytest.raises(KinematicsError, match=r"^pose 1 \(of 0 \.\. 1\): "):
        arm.inverse(np.array([by_hand(0.3, 0.4), far]), seed=[0.2, 0.3])
    with pytest.raises(TwinError, match=r"expected \(2,\)"):
        arm.forward(np.zeros(3))
    assert np.isnan(arm.forward([[0.1, np.nan]])).all()


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES, ids=lambda file: file.suffix)
def test_loops_of_every_format_are_closed_alike(file):
    reference = twin.load(FILES[0])
    robot = twin.load(file)
    q = reference.mechanism.home + 0.1
    assert np.allclose(robot.forward(q)[:3, 3], reference.forward(q)[:3, 3], atol=1e-6)
    assert np.allclose(robot.inverse(robot.forward(q)), q, atol=1e-8)


@pytest.mark.slow
def test_a_stage_answers_as_the_equations_of_its_robot():
    stage = twin.load(ROOT / "usd/sils/sils.usda")
    robot = twin.load("sils")
    q = robot.mechanism.posture("insertion")
    T = robot.forward(q)
    assert np.allclose(stage.forward(q), T, atol=1e-6)
    assert np.allclose(stage.inverse(T), q, atol=1e-6)
    assert np.allclose(stage.jacobian(q), robot.jacobian(q), atol=1e-5)


@pytest.mark.slow
def test_every_function_takes_a_path(arm, tmp_path):
    file = str(tmp_path / "arm.urdf")
    assert twin.workspace(file, count=4000).reached.any()
    bundle = twin.export(file, to="urdf", out=tmp_path / "out")
    assert bundle.verdict == "agree"
    for call in (twin.plan, twin.validate, twin.build, twin.masses, twin.explain):
        with pytest.raises(TwinError):
            call(file)
    with pytest.raises(TwinError, match="write out='somewhere' for a folder"):
        twin.export("sils", "somewhere")


def test_a_missing_file_and_a_drawing_say_what_to_do(tmp_path):
    with pytest.raises(TwinError, match=r"gone\.urdf: the file does not exist"):
        twin.load(tmp_path / "gone.urdf")
    shutil.copy(ROOT / "cad/sils/sils.step", tmp_path / "arm.step")
    with pytest.raises(TwinError, match="make a robot folder by `twin new"):
        twin.load(tmp_path / "arm.step")
    with pytest.raises(TwinError, match="xacro, dh and units are for a description file"):
        twin.load("sils", units="mm,deg")


@pytest.mark.slow
def test_variants_are_written_as_on_the_command_line():
    robot = twin.load("sils")
    T = robot.forward(robot.mechanism.posture("insertion"))
    printed = robot.inverse(T, variant={"eq1": "printed"})
    assert np.array_equal(robot.inverse(T, variant="eq1=printed"), printed)
    for wrong in ("eq1=", "eq1=printed, eq1=corrected", "eq1=printed printed"):
        with pytest.raises(KinematicsError):
            robot.inverse(T, variant=wrong)


@pytest.mark.slow
def test_notebooks_show_robots_results_and_trajectories(arm):
    page = arm._repr_html_()
    assert "q1" in page
    assert "no equations" in page
    sils = twin.load("sils")
    assert "insertion" in sils._repr_html_()
    assert "eq1=printed" in sils._repr_html_()
    trajectory = twin.plan(sils, ROOT / "tests/data/short.toml")
    page = trajectory._repr_html_()
    assert page.count("<svg") == 6
    assert " mm</td>" in page or ">mm<" in page
    assert len(repr(trajectory)) < 120
    result = twin.study("sher")
    page = result._repr_html_()
    assert "Disagrees" in page
    assert "<table>" in page
