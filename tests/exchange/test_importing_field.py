"""What real description files taught: imported as they stand, exported, and not accused of what is no fault.

Each kind is a table of small files or a seeded loop, with the value that is right.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports] - installed beside site-packages
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import twin
from twin.core.errors import SourceError
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.meshes import check_mesh
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.exchange.read.robot_folder import write_folder
from twin.model.body import Body, Frame, Mesh
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference.clearance import unjointed_pairs

INERTIAL = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'


def imported(tmp_path, name, text):
    """Return the import of a text in a file, with its loops closed."""
    path = tmp_path / name
    path.write_text(text)
    return close(read(path, guarded=False))


def audited(tmp_path, found, formats=("usd", "mjcf", "urdf")):
    """Return the audit of the exported folder of an import."""
    write_folder(found, "robot", tmp_path / "robot", tmp_path / "source")
    twin.export(twin.load(tmp_path / "robot"), out=tmp_path / "out", to=formats)
    return twin.audit(tmp_path / "out")


def wrong(report):
    return [f.message for f in report.findings if f.severity in ("error", "disagreement")]


def values(mechanism):
    """Return {joint: coordinate at rest in m or rad}."""
    single = [j for j in mechanism.tree if len(j.free_axes) == 1]
    return {j.name: float(j.coordinate(mechanism.rest[j.parent], mechanism.rest[j.child])) for j in single}


# ------------------------------------------------------------------------------------------------------ the start


def serial(limits, kinds=None):
    """Return a URDF of an arm with one joint for each pair of limits."""
    links = "".join(f'<link name="l{i}">{INERTIAL}</link>' for i in range(len(limits) + 1))
    joints = "".join(
        f'<joint name="j{i}" type="{(kinds or {}).get(i, "revolute")}"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="0 0 0.1"/><axis xyz="0 {i % 2} {1 - i % 2}"/>'
        f'<limit lower="{low!r}" upper="{high!r}" effort="9" velocity="1"/></joint>'
        for i, (low, high) in enumerate(limits)
    )
    return f'<robot name="arm">{links}{joints}</robot>'


def test_a_urdf_starts_at_the_values_within_the_limits_that_are_nearest_to_zero(tmp_path):
    rng = np.random.default_rng(0)
    for _ in range(12):
        ends = np.sort(rng.uniform(-3, 3, (5, 2)), axis=1)
        ends[:, 1] += 0.01
        found = imported(tmp_path, "arm.urdf", serial(ends.tolist(), {3: "prismatic"}))
        nearest = np.clip(0.0, ends[:, 0], ends[:, 1])
        np.testing.assert_allclose(list(values(found.mechanism).values()), nearest, rtol=0, atol=1e-12)
        said = any(f.code == "import.home" for f in found.findings)
        assert said == bool((nearest != 0).any())
        assert not any(f.code == "import.rest" for f in found.findings)


MJCF = """<mujoco><compiler angle="radian"/><worldbody><body name="t" pos="0 0 .1"><joint name="h" axis="0 0 1"
range="-1 1" {h}/><geom type="box" size=".1 .1 .1"/><body name="l" pos="0 0 -.3"><joint name="k" axis="0 1 0"
range="-2 -0.5" {k}/><geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02"/></body></body></worldbody>
<actuator><position joint="h" kp="10"/><position joint="k" kp="10"/></actuator>{keys}</mujoco>"""


@pytest.mark.parametrize(
    ("parts", "home", "key"),
    [
        ({"k": 'ref="-0.9"'}, (0.0, -0.9), None),  # the start of MuJoCo, qpos0
        ({"h": 'ref="0.3"', "k": 'ref="-0.9"'}, (0.3, -0.9), "0.5 -1"),
        ({}, (0.5, -1.0), "0.5 -1"),  # outside of the limits at qpos0: the key frame
        ({}, (0.0, -0.5), "0.5 -3"),  # also the key frame is outside: the nearest limit
        ({"k": 'ref="-2.7"'}, (0.0, -2.0), None),
    ],
)
def test_an_mjcf_starts_at_its_own_start(parts, home, key, tmp_path):
    keys = f'<keyframe><key name="up" qpos="{key}"/></keyframe>' if key else ""
    text = MJCF.format(**{"h": "", "k": "", "keys": keys} | parts)
    m = imported(tmp_path, "arm.xml", text).mechanism
    np.testing.assert_allclose(list(values(m).values()), home, rtol=0, atol=1e-12)
    assert m.postures["home"] == pytest.approx({"h": home[0], "k": home[1]}, abs=1e-12)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = home
    mujoco.mj_kinematics(model, data)
    for name in ("t", "l"):
        np.testing.assert_allclose(m.rest[name][:3, 3], data.body(name).xpos, atol=1e-12)
        np.testing.assert_allclose(m.rest[name][:3, :3].ravel(), data.body(name).xmat, atol=1e-12)


def test_the_start_of_coupled_joints_is_the_nearest_state_of_the_coupling_within_the_limits(tmp_path):
    rng = np.random.default_rng(1)
    met = 0
    for _ in range(8):
        ratio, offset = float(rng.uniform(-2, 2)), float(rng.uniform(-1, 1))
        first, second = np.sort(rng.uniform(-2, 2, (2, 2)), axis=1)
        links = serial([first.tolist(), second.tolist()])
        mimic = f'<mimic joint="j0" multiplier="{ratio!r}" offset="{offset!r}"/></joint></robot>'
        m = imported(tmp_path, "arm.urdf", links.removesuffix("</joint></robot>") + mimic).mechanism
        lead, follow = values(m).values()
        # values of the leader for which both joints are within their limits
        ends = np.sort((second - offset) / ratio)
        low, high = max(first[0], ends[0]), min(first[1], ends[1])
        if high - low < 0.01:
            continue
        met += 1
        assert follow == pytest.approx(ratio * lead + offset, abs=1e-8)
        assert first[0] - 1e-9 <= lead <= first[1] + 1e-9
        assert second[0] - 1e-9 <= follow <= second[1] + 1e-9
    assert met > 2


def test_a_home_at_a_limit_and_off_zero_is_exported_without_a_finding(tmp_path):
    found = imported(tmp_path, "arm.urdf", serial([(-1.0, 1.0), (-3.07, -0.07), (0.2, 2.0)]))
    assert wrong(audited(tmp_path, found, ("usd", "mjcf"))) == []
    data = mujoco.MjData(model := mujoco.MjModel.from_xml_path(str(tmp_path / "out/robot.xml")))
    mujoco.mj_resetDataKeyframe(model, data, 0)
    np.testing.assert_allclose(data.qpos, [0.0, -0.07, 0.2], atol=1e-9)


# ------------------------------------------------------------------------------- bodies that are fixed to the world

WORLD = """<robot name="w"><link name="world"/><link name="b">{i}<visual><geometry><box size=".2 .2 .2"/></geometry>
</visual></link><link name="a">{i}</link><joint name="f" type="fixed"><parent link="world"/><child link="b"/></joint>
<joint name="s" type="revolute"><parent link="b"/><child link="a"/><origin xyz="0 0 .1"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="10" velocity="2"/></joint></robot>"""

TWO = """<mujoco><worldbody><body name="b"><geom type="box" size=".1 .1 .1"/><body name="c" pos="0 0 .3">
<joint name="k" axis="0 1 0" range="-60 60"/><geom type="sphere" size=".05"/></body></body>
<body name="table" pos="1 0 0"><geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>"""


def test_a_base_named_world_is_the_world_of_every_format(tmp_path):
    assert wrong(audited(tmp_path, imported(tmp_path, "two.xml", TWO))) == []


def test_a_body_that_one_file_does_not_fix_to_the_world_is_found(tmp_path):
    assert wrong(audited(tmp_path, imported(tmp_path, "w.urdf", WORLD.format(i=INERTIAL)))) == []
    path = tmp_path / "out/robot.xml"
    text = path.read_text()
    assert '<body name="b"' in text
    start = text.index(">", text.index('<body name="b"')) + 1
    path.write_text(f'{text[:start]}<joint name="loose" type="hinge" axis="1 0 0"/>{text[start:]}')
    told = " ".join(wrong(twin.audit(tmp_path / "out")))
    assert "bodies fixed to the world" in told


# ------------------------------------------------------------------------------------ masses and what shapes show

BOX = '<geometry><box size="0.01 0.01 0.01"/></geometry>'


SHAPES = {
    "l1": f'<visual><origin xyz="0.9 0 0"/>{BOX}</visual>',  # for display only
    "l2": f'<visual><origin xyz="0.9 0 0"/>{BOX}</visual><collision>{BOX}</collision>',  # the second is left out
    "l3": f'<visual>{BOX}</visual><visual><geometry><mesh filename="no.stl"/></geometry></visual>',
    "l4": f'<collision><origin xyz="0.9 0 0"/>{BOX}</collision>',  # nothing is left out
    "l5": f'<visual><origin xyz="0.9 0 0"/>{BOX}</visual><collision><origin xyz="0.9 0 0"/>{BOX}</collision>',
}
"""Shapes that do not fit the masses of the links, and what a file of the field leaves out of them."""


def test_a_mass_is_judged_only_by_shapes_that_show_the_whole_body(tmp_path):
    text = serial([(-1.0, 1.0)] * 5)
    for link, shapes in SHAPES.items():
        text = text.replace(f'<link name="{link}">', f'<link name="{link}">{shapes}')
    found = imported(tmp_path, "arm.urdf", text)
    assert {b.name for b in found.mechanism.bodies if not b.whole} == {"l1", "l2", "l3"}
    report = audited(tmp_path, found, ("usd", "mjcf", "urdf", "glb"))
    told = [f for f in report.findings if f.code.startswith(("physics.", "stage.com", "stage.inertia"))]
    for file in ("robot.glb", "usd/robot.usda", "robot.xml", "robot.urdf"):
        for link in SHAPES:
            here = {f.severity for f in told if f.where.startswith(file) and f.where.endswith(link)}
            assert here == ({"info"} if link in ("l1", "l2", "l3") else {"disagreement"}), (file, link)


def test_mjcf_bodies_with_shapes_for_display_are_not_whole(tmp_path):
    geoms = {
        "visual": '<geom type="box" size=".1 .1 .1" contype="0" conaffinity="0" mass="1"/>',
        "solid": '<geom type="box" size=".1 .1 .1" mass="1"/>',
    }
    geoms["both"] = geoms["visual"] + geoms["solid"]
    bodies = "".join(
        f'<body name="{n}" pos="{i} 0 0"><joint axis="0 0 1" name="j{i}"/>{g}</body>'
        for i, (n, g) in enumerate(geoms.items())
    )
    path = tmp_path / "three.xml"
    path.write_text(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    m = read(path, root="world", guarded=False).mechanism
    assert {b.name: b.whole for b in m.bodies if b.name in geoms} == {"visual": False, "both": False, "solid": True}


# ------------------------------------------------------------------------ free joints, and bodies without shape

FLOATING = f"""<robot name="f"><link name="ground">{INERTIAL}</link><link name="trunk">{INERTIAL}</link>
<link name="leg">{INERTIAL}</link><link name="ball">{INERTIAL}</link>
<joint name="float" type="floating"><parent link="ground"/><child link="trunk"/><origin xyz="0.1 0.2 0.5"
rpy="0.3 -0.2 0.9"/></joint>
<joint name="knee" type="revolute"><parent link="trunk"/><child link="leg"/><origin xyz="0 0 -0.1"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="-1" effort="9" velocity="1"/></joint>
<joint name="loose" type="floating"><parent link="ground"/><child link="ball"/><origin xyz="1 0 0"/></joint></robot>"""

ON_MOVING = FLOATING.replace('<parent link="ground"/><child link="ball"/>', '<parent link="leg"/><child link="ball"/>')

ANT = """<mujoco><compiler angle="radian"/><worldbody><geom type="plane" size="1 1 1"/><body name="trunk" pos="0 0 0.7"
euler="0.1 0.2 0.3"><freejoint name="float"/><geom type="sphere" size="0.2"/><body name="leg" pos="0.2 0 0">
<joint name="knee" axis="0 1 0" range="0.5 1"/><geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.05"/></body></body>
</worldbody><actuator><motor joint="knee"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    ("file", "text", "free"),
    [
        pytest.param("f.urdf", FLOATING, ("float", "loose"), id="urdf", marks=pytest.mark.slow),
        pytest.param("f.urdf", ON_MOVING, ("float", "loose"), id="on a moving body"),
        pytest.param("a.xml", ANT, ("float",), id="mjcf", marks=pytest.mark.slow),
    ],
)
def test_a_free_joint_has_one_name_and_one_kind_in_every_format(file, text, free, tmp_path):
    found = imported(tmp_path, file, text)
    m = found.mechanism
    assert tuple(j.name for j in m.joints if j.type == "free") == free
    assert wrong(audited(tmp_path, found, ("usd", "mjcf", "urdf", "tracks"))) == []
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out/robot.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_kinematics(model, data)
    urdf = pin.buildModelFromUrdf(str(tmp_path / "out/robot.urdf"))
    drawn = urdf.createData()
    q = pin.neutral(urdf)
    q[urdf.joints[urdf.getJointId("knee")].idx_q] = m.postures["home"]["knee"]
    pin.framesForwardKinematics(urdf, drawn, q)
    for joint in (j for j in m.joints if j.type == "free"):
        kind = mujoco.mjtJoint(int(model.joint(joint.name).type[0]))
        on_moving = joint.parent == "leg"
        assert kind == (mujoco.mjtJoint.mjJNT_BALL if on_moving else mujoco.mjtJoint.mjJNT_FREE)
        assert urdf.joints[urdf.getJointId(joint.name)].shortname() == "JointModelFreeFlyer"
        T_base_body = np.linalg.inv(m.rest[m.base]) @ m.rest[joint.child]
        np.testing.assert_allclose(data.body(joint.child).xpos, T_base_body[:3, 3], atol=1e-9)
        np.testing.assert_allclose(data.body(joint.child).xmat, T_base_body[:3, :3].ravel(), atol=1e-9)
        T = drawn.oMf[urdf.getFrameId(joint.child)].homogeneous
        np.testing.assert_allclose(T, T_base_body, atol=1e-9)


UNIVERSAL = """<mujoco><worldbody><body name="frame"><geom type="box" size=".1 .1 .1"/><body name="leg" pos="0 0 0.12">
<joint name="x" type="hinge" axis="1 0 0"/><joint name="y" type="hinge" axis="0 1 0"/>
<geom type="box" size=".05 .05 .1"/><body name="tip" pos="0 0 0.12"><joint name="s" type="slide" axis="0 0 1"/>
<geom type="box" size=".02 .02 .1"/></body></body></body><body name="top" pos="0 0 0.15"><freejoint name="free"/>
<geom type="box" size=".1 .1 .01"/></body></worldbody></mujoco>"""


def test_a_body_that_the_import_inserted_is_no_gap_between_parent_and_child(tmp_path):
    path = tmp_path / "u.xml"
    path.write_text(UNIVERSAL)
    m = close(read(path, root="world", guarded=False)).mechanism
    assert m.body("leg_after_x").meshes == ()
    pairs = {frozenset((a.body, b.body)) for a, b in unjointed_pairs(m)}
    # parent and child overlap at their joint; the free body is connected with nothing
    assert pairs == {frozenset(p) for p in (("frame", "tip"), ("frame", "top"), ("leg", "top"), ("tip", "top"))}


def test_arms_on_a_base_without_shape_can_collide():
    arms = [Joint(f"j{i}", "revolute", "base", f"arm{i}", active=True) for i in range(2)]
    box = Mesh("box", np.eye(4)[:, :3] * 0.1, np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]))
    bodies = [Body("base"), *(Body(f"arm{i}", (replace(box, name=f"box{i}"),)) for i in range(2))]
    frames = (Frame("tool", "arm0", np.eye(4)),)
    rest = {b.name: np.eye(4) for b in bodies}
    m = Mechanism("two", "base", tuple(bodies), tuple(arms), frames, tool="tool", rest=rest)
    assert [(a.body, b.body) for a, b in unjointed_pairs(m)] == [("arm0", "arm1")]


# --------------------------------------------------------------------------------------------------- flat shapes


def test_a_flat_mesh_is_exported_as_a_shape_that_mujoco_reads(tmp_path):
    sheet = "v 0 0 0\nv 0.1 0 0\nv 0.1 0.1 0\nv 0 0.1 0\nf 1 2 3\nf 1 3 4\n"
    (tmp_path / "sheet.obj").write_text(sheet)
    shape = '<geometry><mesh filename="sheet.obj"/></geometry>'
    text = serial([(-1.0, 1.0)]).replace('<link name="l1">', f'<link name="l1"><visual>{shape}</visual>')
    assert wrong(audited(tmp_path, imported(tmp_path, "arm.urdf", text), ("mjcf",))) == []
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out/robot.xml"))
    assert model.nmesh == 1
    assert int(model.geom_conaffinity[0]) == 0


# -------------------------------------------------------------------------------- rounding of the writers themselves


def cracked(width):
    """Return the OBJ of a cube of 50 mm whose upper face is not joined with the sides: a crack of `width` in m."""
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * 0.05
    points = [[*p, z] for z in (0.0, 0.05, 0.05 + width) for p in square]
    faces = [(0, 3, 2, 1), (8, 9, 10, 11), *((i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i) for i in range(4))]
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.array(points).tolist()]
    return "\n".join([*lines, *("f " + " ".join(str(k + 1) for k in f) for f in faces)]) + "\n"


def with_cubes(tmp_path, widths):
    """Return the URDF of an arm with a cube on each link, cracked by the given widths in m."""
    text = serial([(-1.0, 1.0)] * len(widths))
    for i, width in enumerate(widths, 1):
        (tmp_path / f"cube{i}.obj").write_text(cracked(width))
        shape = f'<collision><geometry><mesh filename="cube{i}.obj"/></geometry></collision>'
        text = text.replace(f'<link name="l{i}">', f'<link name="l{i}">{shape}')
    return text


def of_closing(report):
    return [m for m in wrong(report) if "open mesh" in m or "closed mesh" in m]


def test_a_crack_that_rounding_closes_in_one_format_is_no_difference(tmp_path):
    text = with_cubes(tmp_path, [2e-7, 4e-7, 2e-6, 1e-3])
    assert of_closing(audited(tmp_path, imported(tmp_path, "arm.urdf", text))) == []


@pytest.mark.slow
def test_a_hole_in_one_format_is_a_difference(tmp_path):
    audited(tmp_path, imported(tmp_path, "arm.urdf", with_cubes(tmp_path, [0.0])), ("usd", "urdf"))
    path = next((tmp_path / "out/meshes").glob("*.obj"))
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:-1]) + "\n")  # one triangle less
    assert of_closing(twin.audit(tmp_path / "out"))


def test_gains_of_any_size_keep_their_digits(tmp_path):
    gains = (3.2718281828e-9, 4.1415926e-5, 1.2345678912, 5.4321987654e7)
    bodies = actuators = ""
    for i, gain in enumerate(gains):
        bodies += f'<body name="b{i}" pos="0 0 .1"><joint name="j{i}" axis="0 1 0"/><geom type="sphere" size=".02"/>'
        law = f'kp="{gain!r}" kv="{gain / 7!r}" forcerange="-{gain / 3!r} {gain / 3!r}"'
        actuators += f'<position joint="j{i}" {law}/>'
    bodies += "</body>" * len(gains)
    text = f"<mujoco><worldbody>{bodies}</worldbody><actuator>{actuators}</actuator></mujoco>"
    assert wrong(audited(tmp_path, imported(tmp_path, "arm.xml", text))) == []
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out/robot.xml"))
    for i, gain in enumerate(gains):
        a = model.actuator(f"j{i}").id
        assert model.actuator_gainprm[a, 0] == pytest.approx(gain, rel=1e-9)
        assert model.actuator_biasprm[a, 1:3] == pytest.approx([-gain, -gain / 7], rel=1e-9)
        assert model.actuator_forcerange[a, 1] == pytest.approx(gain / 3, rel=1e-9)


def test_a_sheet_shows_no_density(tmp_path):
    (tmp_path / "sheet.obj").write_text("v 0 0 0\nv 0.04 0 0\nv 0.04 0.04 0\nv 0 0.04 0\nf 1 2 3\nf 1 3 4\n")
    shape = '<geometry><mesh filename="sheet.obj"/></geometry>'
    light = (
        '<inertial><mass value="0.009"/><inertia ixx="1e-6" iyy="1e-6" izz="2e-6" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    text = serial([(-1.0, 1.0)]).replace(
        f'<link name="l1">{INERTIAL}', f'<link name="l1">{light}<collision>{shape}</collision>'
    )
    found = imported(tmp_path, "arm.urdf", text)
    assert found.mechanism.body("l1").whole
    assert wrong(audited(tmp_path, found, ("mjcf", "urdf"))) == []


@pytest.mark.slow
def test_a_sheet_with_two_sides_is_not_inside_out(tmp_path):
    """Its volume is a rounding error, with another sign in each format."""
    rng = np.random.default_rng(5)
    shapes = ""
    for i in range(3):
        outline = np.array([(0, 0, 0), (0.3, 0.01, 0), (0.31, 0.2, 0), (0, 0.17, 0)])
        points = outline @ Rotation.random(random_state=rng.integers(99)).as_matrix().T + rng.uniform(-1, 1, 3)
        corners = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())
        (tmp_path / f"{i}.obj").write_text(f"{corners}f 1 2 3\nf 1 3 4\nf 1 3 2\nf 1 4 3\n")
        shapes += f'<collision><geometry><mesh filename="{i}.obj"/></geometry></collision>'
    text = serial([(-1.0, 1.0)]).replace('<link name="l1">', f'<link name="l1">{shapes}')
    found = imported(tmp_path, "arm.urdf", text)
    assert len(found.mechanism.body("l1").meshes) == 3
    report = audited(tmp_path, found, ("usd", "mjcf", "urdf", "glb"))
    assert [f.message for f in report.findings if "winding" in f.code or f.code == "compare.volume"] == []


@pytest.mark.parametrize("thickness", [1e-2, 1e-6])
def test_a_thin_solid_that_is_inside_out_is_found(thickness):
    solid = trimesh.creation.box((0.1, 0.2, thickness))
    for faces, code in ((solid.faces, []), (solid.faces[:, ::-1], ["x.winding"])):
        ledger = Ledger("file")
        check_mesh(ledger, "plate", solid.vertices, faces, None, "x")
        assert [f.code for f in ledger.found] == code


def test_an_assumed_mass_is_not_judged_by_the_shape(tmp_path):
    """The closed bars fill a small part of their bounding box, whose mass the export assumes."""
    frame = trimesh.util.concatenate([trimesh.creation.box((0.004, 0.004, 0.4)) for _ in range(2)])
    frame.vertices[8:] += (0.5, 0.5, 0)
    frame.export(tmp_path / "frame.obj")
    shape = '<geometry><mesh filename="frame.obj"/></geometry>'
    bare = f'<link name="l1"><visual>{shape}</visual><collision>{shape}</collision>'
    found = imported(tmp_path, "arm.urdf", serial([(-1.0, 1.0)]).replace(f'<link name="l1">{INERTIAL}', bare))
    assert found.mechanism.body("l1").inertia is None
    assert found.mechanism.body("l1").whole
    assert wrong(audited(tmp_path, found, ("mjcf", "urdf"))) == []
    # the same mass as a statement is wrong
    stated = bare.replace("<visual>", f"{INERTIAL.replace('1', '100', 1)}<visual>", 1)
    found = imported(tmp_path, "arm.urdf", serial([(-1.0, 1.0)]).replace(f'<link name="l1">{INERTIAL}', stated))
    report = audited(tmp_path / "stated", found, ("urdf",))
    assert any(f.code == "physics.density" and f.severity == "disagreement" for f in report.findings)


# ----------------------------------------------------------------------------------------------------- weak motors


@pytest.mark.parametrize(("limit", "control", "code"), [(3, 0.0, "warning"), (6, 0.0, ""), (6, 1.0, "disagreement")])
def test_a_motor_that_is_too_weak_is_no_wrong_control(limit, control, code, tmp_path):
    # 1 kg at 0.5 m: 4.905 N m hold the arm
    text = f"""<mujoco><worldbody><body name="arm"><inertial pos="0.5 0 0" mass="1" diaginertia=".01 .01 .01"/>
    <joint name="j" axis="0 1 0"/><geom type="box" pos=".5 0 0" size=".1 .1 .1"/></body></worldbody><actuator>
    <position joint="j" kp="100" forcerange="-{limit} {limit}"/></actuator></mujoco>"""
    audited(tmp_path, imported(tmp_path, "arm.xml", text), ("mjcf",))
    path = tmp_path / "out/robot.xml"
    key = path.read_text().replace('ctrl="0"', f'ctrl="{control}"')
    path.write_text(key)
    told = [f for f in twin.audit(path).findings if f.code in ("mjcf.effort", "mjcf.keyframe")]
    assert [f.severity for f in told] == ([code] if code else [])
    if code == "warning":
        assert told[0].size == pytest.approx(-4.905, abs=1e-6)
        assert "cannot hold the robot: it needs 4.905 N or N m, its maximum effort is 3" in told[0].message


# ------------------------------------------------------------------------------------- links of several open meshes


@pytest.mark.slow
def test_open_meshes_that_close_each_other_are_one_closed_shape_in_every_format(tmp_path):
    halves = {"a": range(6), "b": range(6, 12)}
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    shapes = ""
    for name, faces in halves.items():
        trimesh.Trimesh(box.vertices, box.faces[list(faces)], process=False).export(tmp_path / f"{name}.obj")
        shapes += f'<collision><geometry><mesh filename="{name}.obj"/></geometry></collision>'
    text = serial([(-1.0, 1.0)]).replace('<link name="l1">', f'<link name="l1">{shapes}')
    assert of_closing(audited(tmp_path, imported(tmp_path, "arm.urdf", text), ("glb", "urdf", "usd"))) == []


# --------------------------------------------------------------------------------------------------- planar joints


def planar(axis, origin):
    """Return a URDF of an arm with one hinge, on a base that a planar joint moves."""
    return f"""<robot name="cart"><link name="ground"/><link name="base">{INERTIAL}</link><link name="arm">{INERTIAL}
    </link><joint name="drive" type="planar"><parent link="ground"/><child link="base"/><origin {origin}/>
    <axis xyz="{axis}"/><limit lower="-2" upper="2" effort="100" velocity="0.5"/></joint>
    <joint name="h" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="9" velocity="1"/></joint></robot>"""


def moved(mechanism, values):
    """Return the pose (4, 4) of the base for the values of the three joints of the planar joint, in m and rad."""
    T = np.eye(4)
    for joint, value in zip(mechanism.joints[:3], values, strict=True):
        motion = np.eye(4)
        if joint.type == "prismatic":
            motion[2, 3] = value
        else:
            motion[:3, :3] = Rotation.from_rotvec([0, 0, value]).as_matrix()
        T = T @ joint.T_parent_joint @ motion @ np.linalg.inv(joint.T_child_joint)
    return T


def test_a_planar_joint_has_the_poses_of_pinocchio(tmp_path):
    rng = np.random.default_rng(2)
    for _ in range(5):
        xyz, rpy = rng.uniform(-1, 1, (2, 3))
        text = planar("0 0 1", f'xyz="{xyz[0]} {xyz[1]} {xyz[2]}" rpy="{rpy[0]} {rpy[1]} {rpy[2]}"')
        found = imported(tmp_path, "cart.urdf", text)
        assert [(j.name, j.type, j.active) for j in found.mechanism.joints] == [
            ("drive_x", "prismatic", False),
            ("drive_y", "prismatic", False),
            ("drive_z", "revolute", False),
            ("h", "revolute", True),
        ]
        judge = pin.buildModelFromUrdf(str(tmp_path / "cart.urdf"))
        state = judge.createData()
        for x, y, angle in rng.uniform(-2, 2, (4, 3)):
            pin.framesForwardKinematics(judge, state, np.array([x, y, np.cos(angle), np.sin(angle), 0.0]))
            right = state.oMf[judge.getFrameId("base")].homogeneous
            np.testing.assert_allclose(moved(found.mechanism, (x, y, angle)), right, rtol=0, atol=1e-12)


def test_a_planar_joint_moves_in_the_plane_of_its_axis(tmp_path):
    rng = np.random.default_rng(3)
    for axis in [*np.eye(3), *-np.eye(3), *rng.normal(size=(4, 3))]:
        normal = axis / np.linalg.norm(axis)
        found = imported(tmp_path, "cart.urdf", planar(" ".join(map(repr, axis.tolist())), 'xyz="0 0 0"'))
        x, y, angle = rng.uniform(-2, 2, 3)
        T = moved(found.mechanism, (x, y, angle))
        np.testing.assert_allclose(T[:3, 3] @ normal, 0.0, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(T[:3, 3]), np.hypot(x, y), atol=1e-12)
        np.testing.assert_allclose(T[:3, :3], Rotation.from_rotvec(angle * normal).as_matrix(), atol=1e-12)


@pytest.mark.slow
def test_a_robot_on_a_planar_joint_is_exported_without_a_finding(tmp_path):
    found = imported(tmp_path, "cart.urdf", planar("0 0 1", 'xyz="0.1 0 0.3" rpy="0 0 0.4"'))
    told = [f.message for f in found.findings if f.severity == "warning"]
    assert "joint 'drive' is planar: the limits -2 .. 2 are not imported." in told
    assert wrong(audited(tmp_path, found)) == []


# ---------------------------------------------------------------------- inertials without mass, driven joints twice


@pytest.mark.parametrize(
    ("inertial", "lacking"),
    [
        ('<mass value="1.02"/>', "inertia"),
        ('<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>', "mass"),
        ("", "mass"),
    ],
)
def test_a_link_whose_inertial_is_incomplete_is_read_without_mass(inertial, lacking, tmp_path):
    text = serial([(-1.0, 1.0)]).replace(
        f'<link name="l1">{INERTIAL}', f'<link name="l1"><inertial>{inertial}</inertial>'
    )
    found = imported(tmp_path, "arm.urdf", text)
    assert found.mechanism.body("l1").inertia is None
    told = [f.message for f in found.findings if f.code == "import.inertia"]
    assert told == [f"link 'l1': the <inertial> has no <{lacking}>: the link is imported without mass."]
    assert pin.buildModelFromUrdf(str(tmp_path / "arm.urdf")).nq == 1


@pytest.mark.parametrize("told", ["transmission", "ros2_control"])
def test_a_joint_that_mimics_another_is_not_driven(told, tmp_path):
    mimic = '<mimic joint="j0" multiplier="-0.5"/></joint></robot>'
    text = serial([(-1.0, 1.0), (-1.0, 1.0)]).removesuffix("</joint></robot>") + mimic
    one = '<joint name="j{i}"><command_interface name="position"/></joint>'
    if told == "transmission":
        parts = "".join(
            f'<transmission name="t{i}">{one.format(i=i)}<actuator name="m{i}"/></transmission>' for i in range(2)
        )
    else:
        parts = f'<ros2_control name="c">{one.format(i=0)}{one.format(i=1)}</ros2_control>'
    found = imported(tmp_path, "arm.urdf", text.replace("</robot>", f"{parts}</robot>"))
    assert [j.name for j in found.mechanism.active] == ["j0"]


BODY_XML = '<inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>'


def mjcf(tmp_path, more="", upper='name="a"', joint='name="j"', lower='name="b"'):
    """Return the import of an MJCF with two bodies, each on a hinge, and more elements."""
    inner = f'<body {lower} pos="0 0 1">{BODY_XML}<joint name="k" axis="0 1 0"/></body>'
    outer = f'<body {upper}>{BODY_XML}<joint {joint} axis="0 0 1"/>{inner}</body>'
    path = tmp_path / "two.xml"
    path.write_text(f"<mujoco><worldbody>{outer}</worldbody>{more}</mujoco>")
    return read(path, guarded=False)


SERVO = '<position name="p" joint="j" kp="100" forcerange="-5 5"/>'
DAMPER = '<velocity name="v" joint="j" kv="10" forcerange="-7 7"/>'


@pytest.mark.parametrize("actuators", [SERVO + DAMPER, DAMPER + SERVO])
def test_a_position_servo_beside_another_actuator_keeps_its_gains(actuators, tmp_path):
    found = mjcf(tmp_path, f"<actuator>{actuators}</actuator>")
    (joint,) = found.mechanism.active
    assert joint.drive is not None
    assert (joint.drive.stiffness, joint.drive.max_effort) == (100, 5)
    assert found.efforts == {}


def test_a_tendon_on_a_joint_with_a_servo_takes_no_gains(tmp_path):
    tendon = '<tendon><fixed name="t"><joint joint="j" coef="1"/></fixed></tendon>'
    found = mjcf(tmp_path, f'{tendon}<actuator>{SERVO}<motor name="m" tendon="t"/></actuator>')
    (joint,) = found.mechanism.active
    assert joint.drive is not None
    assert joint.drive.stiffness == 100


def test_a_second_position_servo_of_a_joint_is_told(tmp_path):
    found = mjcf(tmp_path, f'<actuator>{SERVO}<position name="q" joint="j" kp="9"/></actuator>')
    (joint,) = found.mechanism.active
    assert joint.drive is not None
    assert joint.drive.stiffness == 100
    assert any("'q' is another position servo of joint 'j'" in f.message for f in found.findings)


@pytest.mark.parametrize(("scale", "kind"), [("0", "spherical"), ("1", "fixed")])
def test_a_weld_without_torque_is_a_ball(scale, kind, tmp_path):
    found = mjcf(tmp_path, f'<equality><weld body1="b" torquescale="{scale}"/></equality>')
    (loop,) = found.mechanism.loops
    assert loop.type == kind


def test_things_of_an_mjcf_without_names_get_names_that_no_other_has(tmp_path):
    found = mjcf(tmp_path, upper="", joint="", lower='name="body1"').mechanism
    assert [body.name for body in found.bodies] == ["world", "body1", "body1_2"]
    assert [joint.child for joint in found.joints] == ["body1", "body1_2"]


def test_compensation_of_gravity_is_told(tmp_path):
    found = mjcf(tmp_path, upper='name="a" gravcomp="0.5"')
    assert ("warning", "body 'a': gravcomp 0.5 is not imported.") in [(f.severity, f.message) for f in found.findings]


def test_a_joint_that_mimics_itself_is_refused(tmp_path):
    text = serial([(-1.0, 1.0)]).replace("</joint></robot>", '<mimic joint="j0"/></joint></robot>')
    with pytest.raises(SourceError, match=r"joint 'j0', mimic: the joint mimics itself"):
        imported(tmp_path, "arm.urdf", text)


def test_a_negative_mass_is_not_called_no_mass(tmp_path):
    negative = INERTIAL.replace('mass value="1"', 'mass value="-1"')
    mark = f'<link name="mark">{negative}</link>'
    joint = '<joint name="on" type="fixed"><parent link="l1"/><child link="mark"/></joint></robot>'
    text = serial([(-1.0, 1.0)]).replace("</robot>", mark + joint)
    found = imported(tmp_path, "arm.urdf", text)
    assert any("link 'mark': mass -1 kg is not positive" in f.message for f in found.findings)
