"""Motors and transmissions: their algebra, what is refused, and a robot with a 3 x 3 one from file to simulation."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from made.transmissions import MATRIX, raven
from twin.cad.build import read_mechanism
from twin.core.errors import DescriptionError, MechanismError
from twin.exchange.read.closing import close
from twin.exchange.read.folder import write_folder
from twin.exchange.read.source import Imported
from twin.model.transmission import Actuator, Transmission

# -- algebra -------------------------------------------------------------------------------------------


def some(rng, n):
    """Return a matrix that is far from singular, with entries of any sign."""
    return np.linalg.qr(rng.normal(size=(n, n)))[0] @ np.diag(rng.uniform(0.1, 3, n)) + 0.05 * rng.normal(size=(n, n))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_motors_and_joints_lead_to_each_other_and_do_the_same_work(seed):
    rng = np.random.default_rng(seed)
    m = raven(some(rng, 3))
    q, qd, tau = rng.normal(size=(3, 5, len(m.active)))
    np.testing.assert_allclose(m.from_motors(m.motors(q)), q, atol=1e-9)
    np.testing.assert_allclose(m.motors(q[0]), m.motors(q)[0], atol=1e-12)
    np.testing.assert_allclose(m.motor_efforts(tau) @ m.motors(qd[0]), tau @ qd[0], atol=1e-9)


def test_joints_in_no_transmission_are_driven_directly():
    m = raven()
    assert m.motor_names == ("lift", "m1", "m2", "m3")
    np.testing.assert_array_equal(m.motor_matrix[0], [1, 0, 0, 0])
    np.testing.assert_array_equal(m.motor_matrix[1:, 1:], MATRIX)
    bare = replace(m, actuators=(), transmissions=())
    np.testing.assert_array_equal(bare.motor_matrix, np.eye(4))
    assert bare.motor_names == ("lift", "q1", "q2", "q3")
    q = np.array([0.1, 0.2, -0.3, 0.4])
    np.testing.assert_array_equal(bare.motors(q), q)
    assert m.motors(q)[0] == q[0]


def test_the_joints_of_a_transmission_need_not_stand_in_the_order_of_q():
    m = raven()
    (t,) = m.transmissions
    order = [2, 0, 1]
    turned = replace(t, joints=tuple(t.joints[i] for i in order), matrix=t.matrix[order])
    other = replace(m, transmissions=(turned,))
    q = np.array([0.1, 0.2, -0.3, 0.4])
    assert dict(zip(other.motor_names, other.motors(q), strict=True)) == pytest.approx(
        dict(zip(m.motor_names, m.motors(q), strict=True))
    )


# -- what is no transmission ---------------------------------------------------------------------------

T = Transmission("cables", ("q1", "q2", "q3"), ("m1", "m2", "m3"), MATRIX)
FLAT = np.array([[1.0, 2.0, 0.0], [2.0, 4.0, 0.0], [0.0, 0.0, 1.0]])
BAD = [
    ({"transmissions": [replace(T, joints=("q1", "q2", "q9"))]}, "cables': there is no active joint 'q9'"),
    ({"transmissions": [replace(T, joints=("q1", "q2", "wrist"))]}, "there is no active joint 'wrist'"),
    ({"transmissions": [replace(T, actuators=("m1", "m2", "m9"))]}, "there is no actuator 'm9'"),
    ({"transmissions": [replace(T, joints=("q1", "q2", "q2"))]}, "active joint 'q2' is used twice"),
    ({"transmissions": [T, replace(T, name="more")]}, "'q1' is used by transmission 'cables' already"),
    ({"transmissions": [replace(T, matrix=MATRIX[:2])]}, "the matrix is 2 x 3; it must be 3 x 3"),
    ({"transmissions": [replace(T, joints=("q1", "q2"))]}, "2 joints and 3 actuators"),
    ({"transmissions": [replace(T, joints=(), actuators=())]}, "0 joints and 0 actuators"),
    ({"transmissions": [replace(T, matrix=FLAT)]}, r"cannot be inverted \(condition number "),
    ({"transmissions": [replace(T, matrix=np.diag([1.0, 0.0, 1.0]))]}, r"condition number inf, limit 1e\+06"),
    ({"transmissions": [replace(T, matrix=MATRIX * np.nan)]}, "entries that are not finite"),
    ({"transmissions": [T, T]}, "two transmission entries are named 'cables'"),
    ({"transmissions": []}, "actuator 'm1' is in no transmission"),
    ({"actuators": [Actuator("q1")]}, "actuator 'q1': a joint has this name; choose another"),
    ({"actuators": [Actuator("M1")]}, "'M1' is not an identifier"),
    ({"actuators": [Actuator("m1", "angel")]}, "there is no kind 'angel'"),  # pyright: ignore[reportArgumentType]
    ({"actuators": [Actuator("m1", limits=(1.0, -1.0))]}, "limits 1 .. -1 are not ordered"),
    ({"actuators": [Actuator("m1", max_speed=0.0)]}, "max_speed is 0; it must be finite and above 0"),
    ({"actuators": [Actuator("m1", rotor_inertia=np.inf)]}, "rotor_inertia is inf"),
    ({"actuators": [Actuator("m1", damping=-1.0)]}, "damping is -1; it must be finite and at least 0"),
    ({"actuators": [Actuator("m1", damping=1.0)]}, "damping needs stiffness"),
]


@pytest.mark.parametrize(("change", "message"), BAD, ids=[m[:40] for _, m in BAD])
def test_what_is_no_transmission_is_refused(change, message):
    with pytest.raises(MechanismError, match=message):
        replace(raven(), **{k: tuple(v) for k, v in change.items()})


def test_a_joint_has_a_drive_or_a_transmission_not_both():
    m = raven()
    drive = m.joint("lift").drive
    joints = tuple(replace(j, drive=drive) for j in m.joints)
    with pytest.raises(MechanismError, match="joint 'q1' has a drive of its own, but actuators move it"):
        replace(m, joints=joints)


def test_the_condition_of_a_matrix_has_no_unit():
    """A lead screw of 1 mm a turn beside a belt is no bad matrix, though one entry is ten thousand times smaller."""
    mixed = np.diag([1e-3 / (2 * np.pi), 1.0, 500.0])
    assert replace(raven(), transmissions=(replace(T, matrix=mixed),)).motors(np.ones(4))[1] == pytest.approx(
        2000 * np.pi
    )


# -- files ---------------------------------------------------------------------------------------------


def assert_same_motors(a, b, rtol=1e-9, without=()):
    assert [t.name for t in a.transmissions] == [t.name for t in b.transmissions]
    for t, u in zip(a.transmissions, b.transmissions, strict=True):
        assert (t.joints, t.actuators) == (u.joints, u.actuators)
        np.testing.assert_allclose(t.matrix, u.matrix, rtol=rtol)
    assert [x.name for x in a.actuators] == [x.name for x in b.actuators]
    for x, y in zip(a.actuators, b.actuators, strict=True):
        for key in vars(x):
            one, two = getattr(x, key), getattr(y, key)
            assert key in without or one == two or one == pytest.approx(two, rel=rtol), (x.name, key)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The robot folder of the arm, without CAD, as `twin new` would write it."""
    return written(raven(), tmp_path_factory.mktemp("transmission"))


def written(mechanism, where):
    write_folder(close(Imported(mechanism)), mechanism.name, where / mechanism.name, where / "drawn.py")
    return where / mechanism.name


def test_a_robot_folder_holds_motors(folder):
    read = read_mechanism(folder / "cad/raven.toml").mechanism
    assert_same_motors(raven(), read)
    assert [j.drive for j in read.active[1:]] == [None] * 3
    names = {p.name: p for p in read.parameters}
    assert names["transmission cables: q3 per m2"].value == -0.015
    assert names["actuator m1 max_speed"].value == pytest.approx(30.0)


SCREW = """
[[actuator]]
name = "screw"
kind = "angle"
limits_deg = [-36000, 36000]
max_speed_deg_s = 18000
provenance = "ASSUMED"
note = "test"

[[transmission]]
name = "spindle"
joints = ["lift"]
actuators = ["screw"]
matrix = [[0.0003183098861837907]] # 2 mm a turn, in m/rad
provenance = "ASSUMED"
note = "test"
"""
WRONG = [
    ('kind = "angle"', 'kind = "length"', "the coordinate of the actuator is of kind length; write limits_mm"),
    ("max_speed_deg_s = 18000", "max_speed_deg_s = -1", "max_speed_deg_s"),
    ("limits_deg = [-36000, 36000]", "limits_deg = [1, -1]", "limits are swapped"),
    ('joints = ["lift"]', 'joints = ["left"]', "there is no active joint 'left'. Did you mean"),
    ('joints = ["lift"]', 'joints = ["q1"]', "'q1' is used by transmission 'cables' already"),
    ('actuators = ["screw"]', 'actuators = ["crew"]', "there is no actuator 'crew'"),
    ("[[0.0003183098861837907]]", "[[0.0]]", "cannot be inverted (condition number inf"),
    ("[[0.0003183098861837907]]", "[[1.0, 2.0]]", "1 joints, 1 actuators, rows of 2"),
    ('name = "screw"', 'name = "lift"', "a joint has this name"),
    ('name = "spindle"', 'name = "spindle"\nratio = 3', "ratio"),
]


@pytest.fixture
def screwed(folder, tmp_path):
    text = (folder / "cad/raven.toml").read_text()
    start = text.index('[[drive]]\njoints = ["lift"]')
    text = text[:start] + text[text.index("\n[[", start + 2) :]  # its motor drives it now
    (tmp_path / "meshes").symlink_to(folder / "cad/meshes")
    path = tmp_path / "raven.toml"
    path.write_text(text + SCREW)
    return path


def test_a_lead_screw_leads_an_angle_to_a_length(screwed):
    m = read_mechanism(screwed).mechanism
    assert m.motor_names == ("screw", "m1", "m2", "m3")
    assert m.motors(np.array([0.002, 0, 0, 0]))[0] == pytest.approx(2 * np.pi)
    assert m.actuator("screw").limits == pytest.approx((-200 * np.pi, 200 * np.pi))
    force = np.array([100.0, 0, 0, 0])  # N
    assert m.motor_efforts(force)[0] == pytest.approx(100 * 0.002 / (2 * np.pi))


@pytest.mark.parametrize(("right", "wrong", "message"), WRONG, ids=[m[:30] for *_, m in WRONG])
def test_a_wrong_table_is_told_with_its_line(screwed, right, wrong, message):
    text = screwed.read_text()
    assert right in SCREW
    screwed.write_text(text[: -len(SCREW)] + SCREW.replace(right, wrong, 1))
    with pytest.raises(DescriptionError, match=re.escape(message)) as caught:
        read_mechanism(screwed)
    line = int(str(caught.value).split(":")[1])
    assert line > text[: -len(SCREW)].count("\n")


def test_a_joint_with_a_drive_of_its_own_is_refused_in_the_file(folder, tmp_path):
    (tmp_path / "meshes").symlink_to(folder / "cad/meshes")
    path = tmp_path / "raven.toml"
    path.write_text((folder / "cad/raven.toml").read_text() + SCREW)
    with pytest.raises(DescriptionError, match="joint 'lift' has a drive of its own"):
        read_mechanism(path)
