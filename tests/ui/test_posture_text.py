"""A posture and a time as text: what is written is read back, and what is wrong is named."""

from __future__ import annotations

import numpy as np
import pytest

import twin
from twin.core.errors import TwinError
from twin.core.units import DEG, MM
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.posture_text import MAX_LENGTH, posture_text, read_posture


@pytest.fixture(scope="module", params=["sils", "pa10"])
def joints(request):
    return MovableRobot(twin.load(request.param)).joints


def test_what_is_written_is_read_back(joints, rng):
    for _ in range(50):
        q = np.array([rng.uniform(-3, 3) if joint.is_angle else rng.uniform(-1, 1) for joint in joints])
        t = rng.uniform(0, 100)
        text = posture_text(joints, q, t)
        assert len(text) <= MAX_LENGTH
        found, at = read_posture(text, joints)
        np.testing.assert_allclose(found, q, rtol=0, atol=1e-8)  # six decimals of mm and of degrees
        assert at == pytest.approx(t, abs=1e-3)


def test_numbers_are_in_mm_and_degrees():
    joints = MovableRobot(twin.load("davinci_psm")).joints
    q = np.array([2 * DEG if joint.is_angle else 30 * MM for joint in joints])
    numbers = posture_text(joints, q, None).removeprefix("q=").split(",")
    assert numbers == ["2" if joint.is_angle else "30" for joint in joints]
    _, t = read_posture("#" + posture_text(joints, q, None), joints)
    assert t is None


def test_a_robot_with_many_joints_has_fewer_decimals():
    joints = MovableRobot(twin.load("pa10")).joints * 3
    q = np.full(len(joints), 1.23456789)
    text = posture_text(joints, q, 1.0)
    assert 0 < len(text) <= MAX_LENGTH
    np.testing.assert_allclose(read_posture(text, joints)[0], q, atol=1e-3)
    assert posture_text(joints * 4, np.tile(q, 4), 1.0) == "", "there is no link of more characters than a page sends"


def test_zero_has_no_sign_and_time_is_not_negative():
    joints = MovableRobot(twin.load("sils")).joints
    text = posture_text(joints, np.full(len(joints), -1e-12), 3.2)
    assert text == "q=0,0,0,0,0,0&t=3.200"
    _, t = read_posture("#q=0,0,0,0,0,0&t=-1", joints)
    assert t == 0.0


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("", "has 0"),
        ("q=1,2,3", "6 numbers"),
        ("q=1,2,3,4,5,x", "'x' is not a finite number"),
        ("q=1,2,3,4,5,nan", "q6 = 'nan'"),
        ("q=1,2,3,4,5,1e999", "q6 = '1e999'"),
        ("q=1,2,3,4,5,6&t=soon", "t = 'soon'"),
    ],
)
def test_what_is_wrong_is_named(text, wrong):
    joints = MovableRobot(twin.load("sils")).joints
    with pytest.raises(TwinError) as error:
        read_posture(text, joints)
    assert wrong in str(error.value)
