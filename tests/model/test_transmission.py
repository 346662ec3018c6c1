"""Motors and transmissions: their algebra, what is refused, and a robot with a 3 x 3 one from file to simulation."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Sdf, Usd, UsdPhysics

from made import motor_seeds
from made.audit_seeds import copied, found
from made.importing_same import assert_same, made
from made.transmissions import MATRIX, raven, screwed
from twin import api, cli
from twin.analysis.joint_samples import by_joints
from twin.cad.build import read_mechanism
from twin.core.errors import DescriptionError, MechanismError, ProtocolError, StageError
from twin.exchange.audit import audit
from twin.exchange.formats.mjcf.write import mjcf_findings, write_mjcf
from twin.exchange.formats.urdf.write import urdf_findings, write_urdf
from twin.exchange.read import read
from twin.exchange.read.assumed_drives import with_drives
from twin.exchange.read.imported_robot import Imported
from twin.exchange.read.loop_closing import close
from twin.exchange.read.robot_folder import write_folder
from twin.kinematics.closed_loops.bounds import bounds_of
from twin.kinematics.closed_loops.dragging import Dragger
from twin.model.transmission import Actuator, Transmission
from twin.planning.check import check
from twin.ui.session.movable_robot import MovableRobot
from twin.usd.read import read_stage
from twin.validation.stage_content import compare_content

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
    with pytest.raises(MechanismError, match="joint 'q1' has a drive, but actuators move the joint"):
        replace(m, joints=joints)


def test_the_condition_of_a_matrix_has_no_unit():
    """A lead screw of 1 mm a turn beside a belt is not a bad matrix, though one entry is ten thousand times smaller."""
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
    assert names["actuator m1 max_speed"].value == pytest.approx(10.0)


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
    ('kind = "angle"', 'kind = "length"', "the coordinate of this actuator is of kind length; write limits_mm"),
    ("max_speed_deg_s = 18000", "max_speed_deg_s = -1", "max_speed_deg_s"),
    ("limits_deg = [-36000, 36000]", "limits_deg = [1, -1]", "limits are swapped"),
    ('joints = ["lift"]', 'joints = ["left"]', "there is no active joint 'left'. Did you mean"),
    ('joints = ["lift"]', 'joints = ["q1"]', "'q1' is used by transmission 'cables' already"),
    ('actuators = ["screw"]', 'actuators = ["crew"]', "there is no actuator 'crew'"),
    ("[[0.0003183098861837907]]", "[[0.0]]", "cannot be inverted (condition number inf"),
    ("[[0.0003183098861837907]]", "[[1.0, 2.0]]", "1 joints, 1 actuators, rows of length 2"),
    ('name = "screw"', 'name = "lift"', "a joint has this name"),
    ('name = "spindle"', 'name = "spindle"\nratio = 3', "ratio"),
]


@pytest.fixture
def file(folder, tmp_path):
    text = (folder / "cad/raven.toml").read_text()
    start = text.index('[[drive]]\njoints = ["lift"]')
    text = text[:start] + text[text.index("\n[[", start + 2) :]  # its motor drives it now
    (tmp_path / "meshes").symlink_to(folder / "cad/meshes")
    path = tmp_path / "raven.toml"
    path.write_text(text + SCREW)
    return path


def test_a_lead_screw_leads_an_angle_to_a_length(file):
    m = read_mechanism(file).mechanism
    assert m.motor_names == ("screw", "m1", "m2", "m3")
    assert m.motors(np.array([0.002, 0, 0, 0]))[0] == pytest.approx(2 * np.pi)
    assert m.actuator("screw").limits == pytest.approx((-200 * np.pi, 200 * np.pi))
    force = np.array([100.0, 0, 0, 0])  # N
    assert m.motor_efforts(force)[0] == pytest.approx(100 * 0.002 / (2 * np.pi))


@pytest.mark.parametrize(("right", "wrong", "message"), WRONG, ids=[m[:30] for *_, m in WRONG])
def test_a_wrong_table_is_told_with_its_line(file, right, wrong, message):
    text = file.read_text()
    assert right in SCREW
    file.write_text(text[: -len(SCREW)] + SCREW.replace(right, wrong, 1))
    with pytest.raises(DescriptionError, match=re.escape(message)) as caught:
        read_mechanism(file)
    line = int(str(caught.value).split(":")[1])
    assert line > text[: -len(SCREW)].count("\n")


def test_a_joint_with_a_drive_of_its_own_is_refused_in_the_file(folder, tmp_path):
    (tmp_path / "meshes").symlink_to(folder / "cad/meshes")
    path = tmp_path / "raven.toml"
    path.write_text((folder / "cad/raven.toml").read_text() + SCREW)
    with pytest.raises(DescriptionError, match="joint 'lift' has a drive, but"):
        read_mechanism(path)


# -- planned, validated, exported, read back -----------------------------------------------------------

PROTOCOL = """
[limits.joints]
tip_speed_mm_s = 500
tip_acceleration_mm_s2 = 300
rotation_speed_deg_s = 2000
rotation_acceleration_deg_s2 = 200
provenance = "ASSUMED"
note = "the motors limit the motion"

[waypoints.near]
joints = { lift_mm = 30.0, q1_deg = 60.0, q2_deg = 20.0, q3_deg = -25.0 }
provenance = "ASSUMED"
note = "test"
"""


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """The arm with the lead screw, and a protocol that its motors limit."""
    folder = written(screwed(), tmp_path_factory.mktemp("robot"))
    path = folder / "trajectories/first.toml"
    text = path.read_text()
    for table in re.findall(r"(?m)^\[.*\]", PROTOCOL):
        start = text.index(table)
        text = text[:start] + text[text.index("\n[", start + 1) + 1 :]
    start = text.index("[[phases]]")
    path.write_text(text[:start] + PROTOCOL + "\n" + text[start:])
    return api.load(folder)


@pytest.fixture(scope="module")
def trajectory(robot):
    return api.plan(robot, "first")


def test_a_plan_keeps_the_speeds_of_the_motors_and_goes_as_fast_as_they_allow(robot, trajectory):
    m = robot.mechanism
    speeds = np.abs(m.motors(trajectory.qd)) / np.array([m.actuator(n).max_speed for n in m.motor_names])
    assert speeds.max() <= 1 + 1e-3
    assert speeds.max() > 0.99
    values = m.motors(trajectory.q)
    left = [(v.min() - a.limits[0], a.limits[1] - v.max()) for v, a in zip(values.T, m.actuators, strict=True)]
    told = {f.where: np.radians(f.size) for f in trajectory.findings if f.code == "margin.motor"}
    assert told == pytest.approx({a.name: min(ends) for a, ends in zip(m.actuators, left, strict=True)})


def test_a_motion_beyond_what_motors_may_is_told_in_its_samples(robot, trajectory):
    kinematics, protocol = robot.path_kinematics(), robot.protocol("first")
    tight = replace(kinematics.motors, upper=np.full(4, 10.0), max_speed=np.full(4, 9.0))
    found = check(trajectory, protocol, replace(kinematics, motors=tight))
    by_code = {c: {f.where for f in found if f.code == c} for c in ("limit.motor", "limit.motor_speed")}
    m = robot.mechanism
    beyond = {n for n, v in zip(m.motor_names, m.motors(trajectory.q).T, strict=True) if v.max() > 10}
    fast = {n for n, v in zip(m.motor_names, m.motors(trajectory.qd).T, strict=True) if np.abs(v).max() > 9.009}
    assert by_code == {"limit.motor": beyond, "limit.motor_speed": fast}
    assert beyond
    assert fast
    assert not [f for f in check(trajectory, protocol, kinematics) if f.severity != "info"]


def limited(robot, **limits):
    """Return the robot with other limits of some motors."""
    m = robot.mechanism
    actuators = tuple(replace(a, limits=limits.get(a.name, a.limits)) for a in m.actuators)
    return robot.with_mechanism(replace(m, actuators=actuators))


def test_a_protocol_beyond_the_range_of_a_motor_is_refused(robot):
    with pytest.raises(ProtocolError, match=r"motor m2 would go [\d.]+ deg beyond its limits of -286.48..859.44 deg"):
        api.plan(limited(robot, m2=(-5.0, 15.0)), "first")


def test_the_workspace_ends_where_a_motor_does(robot):
    """The motor's range leaves a part of what the joints alone would reach."""
    free, tight = (by_joints(r, 20_000, 0.01) for r in (robot, limited(robot, m1=(-5.0, 5.0))))
    assert 0 < tight.reached.sum() < 0.5 * free.reached.sum()


@pytest.mark.slow
def test_it_is_validated_and_its_margins_are_told(robot, trajectory):
    report = api.validate(robot, trajectory)
    assert report.verdict == "agree", [f.message for f in report.findings if f.severity != "info"]
    margins = report.facts["margins along the path"]
    assert re.search(r"deg to a limit, .*; maximum speed [\d.e+]+ \(limit 573\) deg/s", margins["motor m1"])


def test_info_shows_motors_and_what_they_move(robot, capsys):
    assert cli.main(["info", str(robot.files.description.parents[1]), "--all"]) == 0
    shown = capsys.readouterr().out
    assert "transmission cables (rad, m): q1 = 0.05 m1; q2 = -0.02 m1 + 0.04 m2; q3 = 0.01 m1" in shown
    assert re.search(r"m1 +angle +-3437.75 .. 4583.66 deg +572.958 deg/s +0.2 N m +1e-05 kg m2", shown)
    assert cli.main(["info", str(robot.files.description.parents[1]), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert np.array(told["transmissions"][1]["matrix"]) == pytest.approx(MATRIX)
    assert [a["name"] for a in told["actuators"]] == ["screw", "m1", "m2", "m3"]


def test_motors_on_the_stage_are_held_against_the_description(robot):
    m, described = robot.weighed().mechanism, robot.cad.description
    assert compare_content(m, m, described) == []
    t = replace(m.transmissions[1], matrix=1.001 * MATRIX)
    spoilt = replace(
        m, transmissions=(m.transmissions[0], t), actuators=(*m.actuators[:3], replace(m.actuators[3], max_effort=1))
    )
    assert [f.where for f in compare_content(m, spoilt, described)] == ["m3", "cables"]
    bare = replace(m, transmissions=m.transmissions[:1], actuators=m.actuators[:1])
    assert {f.where for f in compare_content(m, bare, described)} == {"m1", "m2", "m3", "cables"}


@pytest.fixture(scope="module")
def bundle(robot, trajectory, tmp_path_factory):
    out = tmp_path_factory.mktemp("bundle") / "screwed"
    api.export(robot, trajectory, out, to=("usd", "mjcf", "urdf"))
    return out


def test_the_stage_holds_motors_exactly_and_drives_of_joints_beside_them(bundle, robot):
    m, back = screwed(), read_stage(bundle / "usd/raven.usda")
    assert_same_motors(m, back, rtol=0)
    assert [j.drive for j in back.active] == [None] * 4
    stage = Usd.Stage.Open(str(bundle / "usd/raven.usda"))
    K = np.linalg.inv(MATRIX).T @ np.diag([a.stiffness for a in m.actuators[1:]]) @ np.linalg.inv(MATRIX)
    for i, name in enumerate(("q1", "q2", "q3")):
        drive = UsdPhysics.DriveAPI(stage.GetPrimAtPath(f"/raven/joints/{name}"), "angular")
        assert np.degrees(drive.GetStiffnessAttr().Get()) == pytest.approx(K[i, i], rel=1e-6)
    assert_same_motors(m, read(bundle / "usd/raven.usda").mechanism, rtol=0)


def test_mjcf_is_read_back_with_its_motors(bundle):
    back = read(bundle / "raven.xml", guarded=False)
    assert_same_motors(screwed(), back.mechanism, without=("max_speed",))
    assert not [f for f in back.findings if f.severity == "warning"]
    again = with_drives(close(back))
    assert again.assumed == frozenset()
    assert [j.drive for j in again.mechanism.active] == [None] * 4


def test_a_new_robot_from_mjcf_keeps_its_motors(bundle, tmp_path):
    imported, written_down, staged = made(bundle / "raven.xml", "own", tmp_path / "own")
    for m in (imported.mechanism, written_down, staged):
        assert_same_motors(screwed(), m, without=("max_speed",))
    assert_same(imported.mechanism, written_down)


def test_urdf_holds_motors_of_one_joint_and_says_what_it_cannot(bundle):
    (told,) = (f for f in urdf_findings(screwed()) if f.code == "export.urdf_transmission")
    assert "q3 = 0.01 m1 - 0.015 m2 + 0.03 m3" in told.message
    assert told.message in (bundle / "raven.urdf").read_text()
    back = with_drives(close(read(bundle / "raven.urdf", guarded=False)))
    (t,) = back.mechanism.transmissions
    assert (t.name, t.joints, t.actuators) == ("spindle", ("lift",), ("screw",))
    assert t.matrix[0, 0] == pytest.approx(0.002 / (2 * np.pi))
    (motor,) = back.mechanism.actuators
    assert motor.max_effort == pytest.approx(0.1)  # from that of the joint, by the balance of power
    assert motor.stiffness > 0
    assert "screw" in back.assumed
    assert [j.name for j in back.mechanism.active] == ["lift", "q1", "q2", "q3"]
    assert [f.where for f in back.findings if f.code == "import.gear"] == ["cables"]


def test_what_a_format_leaves_out_of_motors_is_told(bundle):
    left = {
        f.message.replace("the format cannot hold the ", "").split(" of the actuators")[0]
        for f in (*urdf_findings(screwed()), *mjcf_findings(screwed()))
        if f.code == "export.left_out" and "screw, m1, m2, m3" in f.where
    }
    lost = ("urdf: limits", "urdf: rotor inertia", "urdf: stiffness", "xml: max speed")
    assert left == {f"raven.{one}" for one in lost}
    assert "xml: the format cannot hold the max speed of the actuators" in (bundle / "raven.xml").read_text()
    assert not [f for f in mjcf_findings(replace(screwed(), actuators=(), transmissions=())) if "actuator" in f.message]


def test_a_diagonal_transmission_needs_no_warning_in_urdf(tmp_path):
    m = raven(np.diag([0.05, -0.02, 0.1]))
    assert not [f for f in urdf_findings(m) if "transmission" in f.code]
    back = read(write_urdf(m, tmp_path), guarded=False).mechanism
    assert {(t.joints, t.actuators): t.matrix[0, 0] for t in back.transmissions} == pytest.approx(
        {((f"q{i}",), (f"m{i}",)): k for i, k in ((1, 0.05), (2, -0.02), (3, 0.1))}
    )


def test_an_mjcf_of_others_is_read_by_its_tendons(tmp_path):
    """No tuple, no texts, gears, an actuator with the name of a joint: a differential of two hinges."""
    text = write_mjcf(raven(), tmp_path).read_text()
    text = re.sub(r"(?s)<custom>.*</custom>", "", text).replace('<general name="m1" ', '<general name="q3" gear="2" ')
    (tmp_path / "raven.xml").write_text(text)
    m = read(tmp_path / "raven.xml", guarded=False).mechanism
    (t,) = m.transmissions
    assert (t.joints, t.actuators) == (("q1", "q2", "q3"), ("q3_motor", "m2", "m3"))
    np.testing.assert_allclose(t.matrix, MATRIX * [0.5, 1, 1], rtol=1e-9)
    assert m.actuator("q3_motor").limits == pytest.approx((-120, 160))
    assert m.actuator("q3_motor").rotor_inertia == pytest.approx(1e-5 / 4)


def test_tendons_that_are_no_transmission_are_told_as_before(tmp_path):
    text = write_mjcf(raven(), tmp_path).read_text()
    text = re.sub(r'(?s)<general name="m3".*?/>', "", text).replace('ctrl="0 0 0 0"', 'ctrl="0 0 0"')
    text = re.sub(r"(?s)<custom>.*</custom>", "", text)
    (tmp_path / "raven.xml").write_text(text)
    back = read(tmp_path / "raven.xml", guarded=False)
    assert back.mechanism.transmissions
    assert back.mechanism.actuators
    assert {f.where for f in back.findings if f.code == "import.tendon"} == {"m3"}


@pytest.mark.parametrize(
    "change",
    [
        {"transmissions": {"cables": {"index": 0, "joints": "q1"}}},
        {"transmissions": {"cables": 3}},
        {"actuators": {"m1": {"index": 0, "kind": "angle", "torque": 3.0}}},
        {"actuators": {"m1": {"index": 0, "kind": "angle", "limits": "wide"}}},
        {"actuators": {"m9": {"index": 0, "kind": "angle"}}},
    ],
)
def test_a_stage_whose_motors_are_of_another_form_is_refused(bundle, tmp_path, change):
    shutil.copytree(bundle / "usd", tmp_path / "usd")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "usd/physics.usda"))
    spec = layer.GetPrimAtPath("/raven")
    spec.customData = {"twin": {**dict(spec.customData)["twin"], **change}}
    layer.Save()
    with pytest.raises(StageError, match=r"twin:actuators or twin:transmissions does not have the form|actuator"):
        read_stage(tmp_path / "usd/raven.usda")


# -- by the hand ---------------------------------------------------------------------------------------


def test_a_hand_stops_where_a_motor_is_at_its_limit(robot):
    """Joints may go further: q1 = 2.4 rad would take m1 to 48 rad, of the 30 that it is given here."""
    m = screwed()
    short = replace(m.actuator("m1"), limits=(-30.0, 30.0))
    m = replace(m, actuators=tuple(short if a.name == "m1" else a for a in m.actuators))
    dragger = Dragger(m, bounds_of(m))
    u = np.concatenate([*dragger.solver.home, []])
    dragged = dragger.move_joints(np.zeros(4), u, np.array([0, 2.4, 0, 0]))
    assert [(b.name, b.kind) for b in dragged.stops] == [("m1", "motor")]
    assert m.motors(dragged.q)[1] == pytest.approx(30.0)
    movable = MovableRobot(limited(robot, m1=(-30.0, 30.0)))
    moved = movable.move_joint(1, 2.4)
    assert not moved.good
    assert "motor m1 is at a limit (-30 .. 30 rad)" in moved.reason
    moved = movable.move_joints(np.array([0, 2.4, 0, 0]))
    assert "motor m1 would exceed its limits of -30 .. 30 rad by 18 rad" in moved.reason


# -- motors move joints in MuJoCo by the matrix --------------------------------------------------------


def test_a_motor_moves_the_joints_of_the_exported_model_by_the_matrix(bundle):
    """Each motor is driven alone, without gravity: what the drives bear of the weight at home is taken out."""
    model = mujoco.MjModel.from_xml_path(str(bundle / "raven.xml"))
    model.opt.gravity[:] = 0
    m = screwed()
    assert [model.actuator(i).name for i in range(model.nu)] == list(m.motor_names)
    for i in range(model.nu):
        data = mujoco.MjData(model)
        target = np.zeros(model.nu)
        target[i] = 12.0
        data.ctrl[:] = target - model.actuator_biasprm[:, 0] / model.actuator_gainprm[:, 0]
        mujoco.mj_step(model, data, 4000)
        np.testing.assert_allclose(data.actuator_length, target, atol=1e-3)
        np.testing.assert_allclose(data.qpos, m.from_motors(target), atol=1e-4)


def test_work_of_motors_is_work_of_joints_in_mujoco(bundle):
    """Torques of motors reach the joints by the transpose of the inverse, and rotors are felt by their squares."""
    model = mujoco.MjModel.from_xml_path(str(bundle / "raven.xml"))
    data, m = mujoco.MjData(model), screwed()
    tau = np.array([0.02, 0.05, -0.03, 0.01])
    kp, bias = model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 0]
    data.ctrl[:] = (tau - bias) / kp
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.actuator_force, tau, atol=1e-12)
    np.testing.assert_allclose(m.motor_efforts(data.qfrc_actuator), tau, atol=1e-9)
    full = np.zeros((4, 4))
    mujoco.mj_fullM(model, data, full)
    light = mujoco.MjModel.from_xml_path(str(bundle / "raven.xml"))
    light.tendon_armature[:] = 0
    bare, still = np.zeros((4, 4)), mujoco.MjData(light)
    mujoco.mj_forward(light, still)
    mujoco.mj_fullM(light, still, bare)
    rows = np.linalg.inv(m.motor_matrix)
    rotors = rows.T @ np.diag([a.rotor_inertia for a in m.actuators]) @ rows
    np.testing.assert_allclose(full - bare, rotors, rtol=1e-6, atol=1e-9)


# -- the audit -----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_good_export_passes_the_audit(bundle, robot):
    for known in (None, robot.weighed().mechanism):
        report = audit(bundle, mechanism=known)
        assert report.verdict == "agree", [f.message for f in report.findings]


FEW = ("xml: ratio x 1.001", "xml: deleted", "urdf: reduction halved", "usd: matrix")
"""Kinds that are seeded by default; all of them in the nightly lane."""


@pytest.mark.parametrize(
    "one",
    [pytest.param(s, id=s.name, marks=[] if s.name in FEW else pytest.mark.nightly) for s in motor_seeds.SEEDS],
)
def test_a_seeded_defect_of_a_motor_is_found_by_its_cause(one, bundle, tmp_path):
    assert copied(bundle, tmp_path / "spoilt", one)
    report = audit(tmp_path / "spoilt")
    assert found(report, one), [(f.code, f.where, f.message) for f in report.findings]
