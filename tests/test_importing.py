"""Foreign descriptions as robot folders: what survives, what is refused, and that nothing is dropped silently."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin import api, cli, spatial
from twin.cad.build import read_mechanism
from twin.errors import OutputError, SourceError, TwinError
from twin.importing import read
from twin.importing.closing import close
from twin.importing.closures import read_closures
from twin.importing.folder import write_folder
from twin.importing.text import zyx
from twin.reference import ReferenceModel
from twin.stage.read import read_stage

DATA = Path(__file__).parent / "data/importing"

PARALLEL = ("5bar_linkage", "5bar_linkage_iso6d", "cassie_like", "digit_like", "disney_like", "robot_delta")

BAD = {
    "error_not_xml.urdf": "not XML: no element found: line 8",
    "error_entities.urdf": "it declares a document type or entities",
    "error_other_root.urdf": "the root element is <model>, expected <robot>",
    "error_unknown_link.urdf": "joint 'q1', child: there is no link 'uper'. Did you mean 'upper'?",
    "error_two_links_of_one_name.urdf": "link 'base': two have this name",
    "error_planar_joint.urdf": "joint 'q1': there is no joint type 'planar'",
    "error_axis_zero.urdf": "joint 'q1': its axis has no length",
    "error_origin_not_numbers.urdf": "joint 'q1': origin xyz = '0 0 1,5' is not 3 numbers",
    "error_origin_nan.urdf": "joint 'q1': origin xyz = '0 0 nan' is not 3 finite numbers",
    "error_limits_swapped.urdf": "joint 'q1': limits -1 .. -2 are not ordered",
    "error_negative_speed.urdf": "joint 'q1': velocity -3 is negative",
    "error_no_child.urdf": "joint 'q1': it has no <child link>",
    "error_mimic_nobody.urdf": "joint 'q1', mimic: there is no joint 'q9'",
    "error_box_negative.urdf": "link 'base': box of size -0.1: it must be positive",
    "error_inertia_incomplete.urdf": "link 'upper': ixx is missing",
    "error_quadratic_coupling.xml": "equality 'equality0' is a polynomial of degree > 1",
    "error_locked_joint.xml": "equality 'equality0' locks joint 'q'",
    "error_unknown_attribute.xml": "unrecognized attribute: 'colour'",
    "error_ball_limited.xml": "ball joint 'r' limits its angle",
    "error_screw_joint.sdf": "joint 'q': there is no joint type 'screw'",
    "error_unknown_link.sdf": "joint 'q', child: there is no link 'uper'",
    "error_two_models.sdf": "expected one model, found 2",
    "error_pose_circle.sdf": "its pose is relative to itself",
    "error_nested_model.sdf": "a nested <model> is not read",
    "error_limits_swapped.sdf": "joint 'q': limits -1 .. -2 are not ordered",
    "error_unknown_name.yaml": "closed_loop: there is no joint or link 'q7'",
    "error_type_5d.yaml": "type: there is no closure type '5d'",
    "error_types_missing.yaml": "1 pairs in closed_loop, but 0 in type",
    "error_no_motor.yaml": "name_mot names no driven joint",
    "error_unknown_motor.yaml": "name_mot: there is no joint 'q2'",
    "error_alias.yaml": "aliases (*name) are not read",
    "error_one_body.yaml": "'q1' and 'upper' lie on one body",
    "error_unknown_key.yaml": "there is no key 'motors'",
}


def test_every_bad_file_has_its_message():
    assert {p.name for p in DATA.glob("error_*")} == set(BAD)


@pytest.mark.parametrize("name", sorted(BAD))
def test_bad_file_is_refused_with_file_and_element(name):
    path = DATA / name
    with pytest.raises(SourceError) as error:
        read(DATA / "good.urdf", path) if path.suffix == ".yaml" else read(path)
    assert BAD[name] in str(error.value)
    assert name in str(error.value)


FOURBAR = """<mujoco model="FourBar"><compiler angle="degree"/><worldbody>
<body name="Crank"><joint name="q" axis="0 1 0" range="-30 40"/><geom type="box" size=".01 .01 .05" mass="2"/>
<body name="Coupler" pos="0 0 .1"><joint name="c" axis="0 1 0"/><geom type="box" size=".1 .01 .01" pos=".1 0 0"/>
<site name="tool" pos=".2 .01 .02" euler="10 20 30"/></body></body>
<body name="Rocker" pos=".2 0 0"><joint name="r" axis="0 1 0"/><geom type="cylinder" size=".01 .05" pos="0 0 .05"/>
</body></worldbody><equality><connect name="pin" body1="Coupler" body2="Rocker" anchor=".2 0 0"/></equality>
<actuator><position joint="q" kp="10" kv="1"/></actuator></mujoco>"""


def assert_same(a, b, tolerance=1e-12):
    """Assert that two mechanisms agree in names, joints in space, limits, masses and frames, whatever the body frames.

    Body frames may differ, so everything is compared in the base, at rest.
    """
    assert [x.name for x in a.bodies] == [x.name for x in b.bodies]
    assert {j.name for j in a.loops} == {j.name for j in b.loops}
    assert [j.name for j in a.active] == [j.name for j in b.active]
    by_name = {j.name: j for j in b.joints}
    for j in a.joints:
        k = by_name.pop(j.name)
        assert (j.type, j.parent, j.child) == (k.type, k.parent, k.child)
        for body, T, U in ((j.parent, j.T_parent_joint, k.T_parent_joint), (j.child, j.T_child_joint, k.T_child_joint)):
            np.testing.assert_allclose(a.rest[body] @ T, b.rest[body] @ U, atol=tolerance)
        assert (j.limits is None) == (k.limits is None)
        if j.limits:
            np.testing.assert_allclose(j.limits, k.limits, atol=max(tolerance, 1e-14), rtol=1e-7)
    assert not by_name
    for x, y in zip(a.bodies, b.bodies, strict=True):
        assert (x.inertia is None) == (y.inertia is None)
        if x.inertia and y.inertia:
            np.testing.assert_allclose(x.inertia.mass, y.inertia.mass, rtol=1e-6)
            com = [(m.rest[x.name] @ np.append(i.p_body_com, 1))[:3] for m, i in ((a, x.inertia), (b, y.inertia))]
            np.testing.assert_allclose(*com, atol=max(tolerance, 1e-12))
    for frame in a.frames:
        other = b.frame(frame.name)
        assert other.body == frame.body
        at = [m.rest[frame.body] @ f.T_body_frame for m, f in ((a, frame), (b, other))]
        np.testing.assert_allclose(*at, atol=tolerance)


def made(source, name, folder, closures=None):
    """Return what was imported and closed, the folder's mechanism, and the mechanism of its USD stage."""
    imported = close(read(source, closures))
    write_folder(imported, name, folder, source)
    robot = api.load(folder)
    root = api.build(robot)[0]
    return imported, read_mechanism(robot.files.description).mechanism, read_stage(root)


def test_mjcf_four_bar_keeps_loop_limits_mass_names_and_drive(tmp_path):
    source = tmp_path / "four.xml"
    source.write_text(FOURBAR)
    imported, folder, stage = made(source, "fourbar", tmp_path / "fourbar")
    assert [j.name for j in imported.mechanism.loops] == ["pin"]
    crank = imported.mechanism.joint("q")
    np.testing.assert_allclose(crank.limits, np.deg2rad([-30, 40]))
    assert (crank.drive.stiffness, crank.drive.damping) == (10, 1)
    assert folder.body("crank").inertia.mass == 2
    assert_same(imported.mechanism, folder)
    assert_same(folder, stage, 5e-7)
    # The loop moves as a parallelogram: the rocker turns as the crank does.
    moved = ReferenceModel(folder).solve(np.array([0.3]))
    assert moved.q_full["r"] == pytest.approx(0.3, abs=1e-9)
    assert moved.worst_gap < 1e-9


def test_urdf_goes_to_a_folder_and_usd_and_comes_back(tmp_path):
    imported, folder, stage = made(DATA / "good.urdf", "arm", tmp_path / "arm")
    assert folder.joint("q1").limits == pytest.approx((-1, 2))
    assert folder.joint("q1").max_speed == pytest.approx(3)
    assert folder.body("upper").inertia.mass == 2
    assert len(folder.body("base").meshes) == 1
    assert_same(imported.mechanism, folder)
    assert_same(folder, stage, 5e-7)


def test_a_seeded_shift_of_a_joint_is_seen(tmp_path):
    a = read(DATA / "good.urdf").mechanism
    text = (DATA / "good.urdf").read_text().replace("0 0 0.1", "0 0 0.100001")
    (tmp_path / "shifted.urdf").write_text(text)
    with pytest.raises(AssertionError):
        assert_same(a, read(tmp_path / "shifted.urdf").mechanism, 5e-7)


def test_sdf_limits_and_base_survive():
    m = read(DATA / "good.sdf").mechanism
    assert m.base == "base"
    assert m.joint("q").limits == (-1, 1)
    np.testing.assert_allclose(m.rest["upper"][:3, 3], [0, 0, 0.1])


def test_missing_mesh_is_a_warning_that_names_it(tmp_path):
    text = (DATA / "good.urdf").read_text().replace('<box size="0.1 0.1 0.1"/>', '<mesh filename="package://a/b.stl"/>')
    (tmp_path / "arm.urdf").write_text(text)
    found = [f for f in read(tmp_path / "arm.urdf").findings if f.code == "import.mesh"]
    assert [f.severity for f in found] == ["warning"]
    assert "package://a/b.stl" in found[0].message


def test_mimic_is_a_coupling_with_its_offset(tmp_path):
    text = (DATA / "good.urdf").read_text()
    more = (
        '<link name="tip"/><joint name="q2" type="continuous"><parent link="upper"/><child link="tip"/>'
        '<axis xyz="0 0 1"/><mimic joint="q1" multiplier="-2" offset="0.5"/></joint></robot>'
    )
    (tmp_path / "arm.urdf").write_text(text.replace("</robot>", more))
    m = read(tmp_path / "arm.urdf").mechanism
    (c,) = m.couplings
    assert (c.joints, c.ratios, c.total) == (("q2", "q1"), (1.0, 2.0), 0.5)
    assert [j.name for j in m.active] == ["q1"]


def test_a_folder_with_something_in_it_is_left_alone(tmp_path):
    (tmp_path / "mine.txt").write_text("keep")
    with pytest.raises(OutputError, match="something already"):
        write_folder(close(read(DATA / "good.urdf")), "arm", tmp_path, DATA / "good.urdf")
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


def test_command_makes_a_folder_that_info_reads(tmp_path, capsys):
    assert cli.main(["new", "arm", "--from", str(DATA / "good.urdf"), "--out", str(tmp_path / "arm"), "--quiet"]) == 0
    assert "1 driven" in capsys.readouterr().out
    assert cli.main(["info", str(tmp_path / "arm")]) == 0
    assert cli.main(["new", "Arm!", "--from", str(DATA / "good.urdf")]) == 2


@given(st.lists(st.floats(-4, 4), min_size=3, max_size=3), st.sampled_from([None, np.pi / 2, -np.pi / 2]))
@settings(max_examples=200, deadline=None)
def test_printed_angles_give_the_rotation_back_also_at_90_degrees(angles, pitch):
    psi, theta, phi = angles
    theta = theta if pitch is None else pitch
    ex, ey, ez = np.eye(3)
    R = spatial.exp_so3(psi * ez) @ spatial.exp_so3(theta * ey) @ spatial.exp_so3(phi * ex)
    a, b, c = zyx(R)
    back = spatial.exp_so3(a * ez) @ spatial.exp_so3(b * ey) @ spatial.exp_so3(c * ex)
    np.testing.assert_allclose(back, R, atol=4e-15)


@pytest.mark.parametrize("suffix", ["urdf", "sdf", "yaml"])
@given(data=st.data())
@settings(max_examples=150, deadline=None)
def test_damaged_text_never_ends_in_anything_but_a_twin_error(suffix, data, tmp_path_factory):
    good = (DATA / (f"good.{suffix}" if suffix != "yaml" else "error_one_body.yaml")).read_bytes()
    start = data.draw(st.integers(0, len(good)))
    length = data.draw(st.integers(0, 12))
    junk = data.draw(st.one_of(st.binary(max_size=12), st.text("[]{}<>&*:!'\"-0123456789e.\n xyz", max_size=12)))
    path = tmp_path_factory.mktemp("fuzz") / f"x.{suffix}"
    junk = junk if isinstance(junk, bytes) else junk.encode()
    path.write_bytes(good[:start] + junk + good[start + length :])
    try:
        read_closures(path) if suffix == "yaml" else read(path)
    except TwinError as error:
        assert str(path.name) in str(error)  # noqa: PT017 - other errors must pass through


def models() -> Path:
    folder = os.environ.get("TWIN_PARALLEL_ROBOTS")
    if not folder or not Path(folder).is_dir():
        pytest.skip("NO THIRD-PARTY MODELS: set TWIN_PARALLEL_ROBOTS to a checkout of example-parallel-robots")
    return Path(folder)


@pytest.mark.parametrize("name", PARALLEL)
def test_third_party_loops_close_and_come_back_from_usd(name, tmp_path):
    source = models() / name / "robot.urdf"
    imported, folder, stage = made(source, "robot", tmp_path / "robot")
    assert imported.mechanism.loops
    assert ReferenceModel(folder).home().worst_gap < 1e-9
    assert_same(imported.mechanism, folder, 1e-11)
    assert_same(folder, stage, 1e-6)
    assert ReferenceModel(stage).home().worst_gap < 1e-6  # joint frames are single precision


def test_third_party_model_that_stays_open_says_by_how_much():
    found = close(read(models() / "kangaroo_like/robot.urdf")).findings
    assert max(f.size or 0 for f in found if f.code == "import.gap") > 1e-9


def test_stage_of_a_foreign_converter_is_read(tmp_path):
    file = os.environ.get("TWIN_FOREIGN_USD")
    if not file:
        pytest.skip("NO FOREIGN STAGE: set TWIN_FOREIGN_USD to a stage that urdf-usd-converter wrote")
    imported, folder, stage = made(Path(file), "foreign", tmp_path / "foreign")
    assert_same(imported.mechanism, folder)
    assert_same(folder, stage, 1e-6)


def test_gripper_with_equalities_of_a_test_only_package(tmp_path):
    file = os.environ.get("TWIN_GRIPPER_MJCF")
    if not file:
        pytest.skip("NO GRIPPER: set TWIN_GRIPPER_MJCF to an MJCF with loop equalities, of robosuite for instance")
    imported, folder, stage = made(Path(file), "gripper", tmp_path / "gripper")
    assert imported.mechanism.loops or imported.mechanism.couplings
    assert ReferenceModel(folder).home().worst_gap < 1e-9
    assert_same(imported.mechanism, folder, 1e-11)
    assert_same(folder, stage, 1e-6)
