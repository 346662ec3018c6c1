"""Foreign descriptions as robot folders: what survives, what is refused, and that nothing is dropped silently."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.cad.build import read_mechanism
from twin.cad.description import load
from twin.core import spatial
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.exchange.read.robot_folder import write_folder
from twin.reference import ReferenceModel

DATA = Path(__file__).parents[1] / "data/importing"

from made import importing_same as same

FOURBAR = """<mujoco model="FourBar"><compiler angle="degree"/><worldbody>
<body name="Crank"><joint name="q" axis="0 1 0" range="-30 40"/><geom type="box" size=".01 .01 .05" mass="2"/>
<body name="Coupler" pos="0 0 .1"><joint name="c" axis="0 1 0"/><geom type="box" size=".1 .01 .01" pos=".1 0 0"/>
<site name="tool" pos=".2 .01 .02" euler="10 20 30"/></body></body>
<body name="Rocker" pos=".2 0 0"><joint name="r" axis="0 1 0"/><geom type="cylinder" size=".01 .05" pos="0 0 .05"/>
</body></worldbody><equality><connect name="pin" body1="Coupler" body2="Rocker" anchor=".2 0 0"/></equality>
<actuator><position joint="q" kp="10" kv="1"/></actuator></mujoco>"""


def test_mjcf_four_bar_keeps_loop_limits_mass_names_and_drive(tmp_path):
    source = tmp_path / "four.xml"
    source.write_text(FOURBAR)
    imported, folder, stage = same.made(source, "fourbar", tmp_path / "fourbar")
    assert [j.name for j in imported.mechanism.loops] == ["pin"]
    crank = imported.mechanism.joint("q")
    np.testing.assert_allclose(crank.limits, np.deg2rad([-30, 40]))
    assert (crank.drive.stiffness, crank.drive.damping) == (10, 1)
    assert folder.body("crank").inertia.mass == 2
    same.assert_same(imported.mechanism, folder)
    same.assert_same(folder, stage, 5e-7)
    # The loop moves as a parallelogram: the rocker turns as the crank does.
    moved = ReferenceModel(folder).solve(np.array([0.3]))
    assert moved.q_full["r"] == pytest.approx(0.3, abs=1e-9)
    assert moved.worst_gap < 1e-9


def test_urdf_goes_to_a_folder_and_usd_and_comes_back(tmp_path):
    imported, folder, stage = same.made(DATA / "good.urdf", "arm", tmp_path / "arm")
    assert folder.joint("q1").limits == pytest.approx((-1, 2))
    assert folder.joint("q1").max_speed == pytest.approx(3)
    assert folder.body("upper").inertia.mass == 2
    assert len(folder.body("base").meshes) == 1
    same.assert_same(imported.mechanism, folder)
    same.assert_same(folder, stage, 5e-7)


def test_a_seeded_shift_of_a_joint_is_seen(tmp_path):
    a = read(DATA / "good.urdf").mechanism
    text = (DATA / "good.urdf").read_text().replace("0 0 0.1", "0 0 0.100001")
    (tmp_path / "shifted.urdf").write_text(text)
    with pytest.raises(AssertionError):
        same.assert_same(a, read(tmp_path / "shifted.urdf").mechanism, 5e-7)


def test_sdf_limits_and_base_survive():
    m = read(DATA / "good.sdf").mechanism
    assert (m.base, m.joint("base_free").type) == ("world", "free")
    assert m.joint("q").limits == (-1, 1)
    np.testing.assert_allclose(m.rest["upper"][:3, 3], [0, 0, 0.1])


@pytest.mark.parametrize(
    ("soft", "kept"),
    [((-0.5, 0.5), (-0.5, 0.5)), ((-9.0, 0.5), (-1.0, 0.5)), ((-0.5, 9.0), (-0.5, 2.0)), ((2.0, 3.0), None)],
)
def test_soft_limits_end_at_the_hard_ones(tmp_path, soft, kept):
    text = (DATA / "good.urdf").read_text()
    assert 'lower="-1" upper="2"' in text
    safety = f'<safety_controller soft_lower_limit="{soft[0]}" soft_upper_limit="{soft[1]}" k_velocity="1"/>'
    (tmp_path / "arm.urdf").write_text(text.replace("</joint>", f"{safety}</joint>", 1))
    found = read(tmp_path / "arm.urdf")
    assert found.mechanism.joint("q1").soft_limits == kept
    said = [f.message for f in found.findings if f.code == "import.soft_limits"]
    assert len(said) == (kept != soft)
    assert all(m.endswith("are left out." if kept is None else "are clipped to the limits.") for m in said)


def test_soft_limits_of_an_endless_joint_make_a_folder_that_is_read(tmp_path):
    text = (DATA / "good.urdf").read_text()
    safety = '<safety_controller soft_lower_limit="-0.5" soft_upper_limit="0.5" k_velocity="1"/></joint>'
    text = text.replace("</joint>", safety, 1).replace('type="revolute"', 'type="continuous"', 1)
    (tmp_path / "arm.urdf").write_text(text)
    found = read(tmp_path / "arm.urdf")
    assert "q1" in found.unlimited
    description = write_folder(found, "arm", tmp_path / "arm", tmp_path / "arm.urdf")[0]
    joint = read_mechanism(description).mechanism.joint("q1")
    assert joint.limits is None
    assert joint.soft_limits == pytest.approx((-0.5, 0.5))


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


@given(st.lists(st.floats(-4, 4), min_size=3, max_size=3), st.sampled_from([None, np.pi / 2, -np.pi / 2]))
@settings(max_examples=200, deadline=None)
def test_printed_angles_give_the_rotation_back_also_at_90_degrees(angles, pitch):
    psi, theta, phi = angles
    theta = theta if pitch is None else pitch
    ex, ey, ez = np.eye(3)
    R = spatial.exp_so3(psi * ez) @ spatial.exp_so3(theta * ey) @ spatial.exp_so3(phi * ex)
    a, b, c = spatial.euler_angles(R, "zyx")
    back = spatial.exp_so3(a * ez) @ spatial.exp_so3(b * ey) @ spatial.exp_so3(c * ex)
    np.testing.assert_allclose(back, R, atol=4e-15)


URDF = """<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"
ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="revolute"><parent link="a"/><child link="b"/>
<limit lower="-1" upper="1" effort="-5" velocity="1"/></joint></robot>"""
MJCF = """<mujoco><worldbody><body name="b"><geom size=".1"/><joint name="j" type="hinge"/></body></worldbody><actuator>
<{kind} name="m" joint="j" forcerange="-20 0"/></actuator></mujoco>"""
STAGE = """#usda 1.0
(defaultPrim = "r"
metersPerUnit = 1
upAxis = "Z")
def Xform "r" (prepend apiSchemas = ["PhysicsArticulationRootAPI"]) {
def Xform "a" (prepend apiSchemas = ["PhysicsRigidBodyAPI"]) {}
def Xform "b" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]) {
float physics:mass = MASS
float3 physics:diagonalInertia = (1, 1, 1)
}
def PhysicsFixedJoint "f" {
rel physics:body1 = </r/a>
}
def PhysicsRevoluteJoint "j" (prepend apiSchemas = ["PhysicsDriveAPI:angular"]) {
rel physics:body0 = </r/a>
rel physics:body1 = </r/b>
uniform token physics:axis = "Z"
float drive:angular:physics:stiffness = 5
float drive:angular:physics:maxForce = 0
}
}
"""


@pytest.mark.parametrize(
    ("name", "text", "effort", "said"),
    [
        ("r.urdf", URDF, None, "joint 'j': maximum effort -5 is not imported: it must be positive."),
        ("r.xml", MJCF.format(kind="motor"), 20.0, ""),
        ("r.xml", MJCF.format(kind="position kp='10'"), 20.0, ""),
        ("r.usda", STAGE.replace("MASS", "1"), None, "joint 'j': maximum effort 0 is not imported"),
        ("r.usda", STAGE.replace("MASS", "-1"), None, "link 'b': mass -1 kg is not positive"),
        ("r😀é.urdf", URDF, None, "joint 'j'"),
    ],
)
def test_numbers_that_no_robot_has_are_left_out_and_the_folder_can_be_read(name, text, effort, said, tmp_path):
    (tmp_path / name).write_text(text)
    imported = close(read(tmp_path / name, guarded=False))
    assert said in "".join(f.message for f in imported.findings)
    toml, *_ = write_folder(imported, "r", tmp_path / "out", tmp_path / name)
    assert [d.max_effort for d in load(toml).drive] == [effort]
    assert load(toml).source == name


def test_a_hinge_that_is_drawn_a_full_turn_away_from_its_limits_is_not_called_moved(tmp_path):
    """Drawn at -148 degrees with limits 100 to 300: the hinge is at 212 degrees, and there is no loop to close."""
    half = np.radians(-148) / 2
    turned = f"quatd xformOp:orient = ({np.cos(half)}, 0, 0, {np.sin(half)})"
    text = STAGE.replace("float physics:mass = MASS", f'{turned}\nuniform token[] xformOpOrder = ["xformOp:orient"]')
    limits = "float physics:lowerLimit = 100\nfloat physics:upperLimit = 300\nuniform token physics:axis"
    (tmp_path / "r.usda").write_text(text.replace("uniform token physics:axis", limits))
    imported = close(read(tmp_path / "r.usda", guarded=False))
    assert imported.mechanism.postures["home"]["j"] == pytest.approx(np.radians(212))
    assert "import.moved" not in {f.code for f in imported.findings}


def test_a_file_name_that_is_not_utf8_is_written_with_an_escape(tmp_path):
    source = tmp_path / "r\udcff.urdf"
    source.write_text(URDF)
    toml, *_ = write_folder(close(read(source, guarded=False)), "r", tmp_path / "out", source)
    assert load(toml).source == "r\\udcff.urdf"
