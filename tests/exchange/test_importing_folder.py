"""The folder that `twin new` writes: it works at once, nothing is lost unsaid, nothing of the user's is touched."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from made.lanes import nightly
from twin import api, cli
from twin.core import spatial
from twin.core.errors import KinematicsError, OutputError
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.exchange.read.robot_folder import write_folder
from twin.exchange.read.templates import protocol
from twin.ui.session.movable_robot import MovableRobot

pytestmark = pytest.mark.usefixtures("no_plots")

DATA = Path(__file__).parents[1] / "data/importing"
MODELS = DATA / "models"

GANTRY = """<robot name="gantry"><link name="base"/>
<link name="x"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="y"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="z"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool"/>
<joint name="qx" type="prismatic"><parent link="base"/><child link="x"/><axis xyz="1 0 0"/>
<limit lower="-0.5" upper="0.5" velocity="1" effort="0"/></joint>
<joint name="qy" type="prismatic"><parent link="x"/><child link="y"/><axis xyz="0 1 0"/>
<limit lower="-0.5" upper="0.5" velocity="1" effort="0"/></joint>
<joint name="qz" type="prismatic"><parent link="y"/><child link="z"/><axis xyz="0 0 1"/>
<limit lower="-0.5" upper="0.5" velocity="1" effort="0"/></joint>
<joint name="mount" type="fixed"><origin xyz="0 0 0.3"/><parent link="z"/><child link="tool"/></joint></robot>
"""

EQUATIONS = """
def inverse(pose):
    x, y, z = pose[:3, 3]
    return x, y, z - 0.3 + FAULT
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fourbar.urdf", "slider.xml", *nightly(["slider.sdf", "fourbar.usda"], 3)])
def test_info_validate_build_and_view_work_on_a_new_folder_at_once(name, tmp_path, capsys):
    folder = tmp_path / "deep/own"
    assert cli.main(["new", "own", "--from", str(MODELS / name), "--out", str(folder), "--quiet"]) == 0
    assert "1 loops closed within" in capsys.readouterr().out
    assert cli.main(["info", str(folder), "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    assert info["degrees_of_freedom"] == 1
    assert cli.main(["build", str(folder), "--quiet"]) == 0
    assert "own_first.usda" in capsys.readouterr().out
    for command in ("validate", "plan"):  # by the mechanism alone
        assert cli.main([command, str(folder), "--quiet"]) == 0
    assert cli.main(["explain", str(folder), "--quiet"]) == 2
    assert "formula.py: there are no equations yet" in capsys.readouterr().err
    movable = MovableRobot(api.load(folder))
    assert movable.kin is None
    assert movable.move_joint(0, movable.assembly.q[0] + 0.05).good
    assert api.load(folder / "usd/own.usda").reference().home().worst_gap < 1e-6


def stretched(axes, finger):
    """Return a URDF of a chain of hinges about `axes`, each 0.2 m along x from the one before, with a tool at its end.

    `finger` adds a driven slide that does not move the tool.
    """
    inertia = '<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/>'
    rows = ['<link name="base"/>']
    for i, axis in enumerate(axes):
        parent = f"link{i}" if i else "base"
        rows.append(f'<link name="link{i + 1}"><inertial><mass value="1"/>{inertia}</inertial></link>')
        rows.append(f'<joint name="q{i + 1}" type="revolute"><parent link="{parent}"/><child link="link{i + 1}"/>')
        rows.append(f'<origin xyz="{0.2 if i else 0.0} 0 0"/><axis xyz="{AXES[axis]}"/>')
        rows.append('<limit lower="-0.5" upper="2.5" velocity="1" effort="9"/></joint>')
    if finger:
        rows.append(f'<link name="finger"><inertial><mass value="0.1"/>{inertia}</inertial></link>')
        rows.append(f'<joint name="grip" type="prismatic"><parent link="link{len(axes)}"/><child link="finger"/>')
        rows.append('<axis xyz="0 1 0"/><limit lower="0" upper="0.05" velocity="1" effort="9"/></joint>')
    rows.append(f'<link name="tool"/><joint name="flange" type="fixed"><parent link="link{len(axes)}"/>')
    rows.append('<child link="tool"/><origin xyz="0.2 0 0"/></joint>')
    return "\n".join(['<robot name="stretched">', *rows, "</robot>"])


AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
STRETCHED = [("yyy", False), ("yyyx", True), ("yyy", True), ("zyyxyx", False), ("zyyxyxy", True)]


def regularity(axes, q):
    """Return smallest by largest singular value of the Jacobian of `stretched`, with lengths in 0.1 m."""
    T, places = np.eye(4), []
    for axis, value in zip(axes, q, strict=True):
        direction = np.array(AXES[axis].split(), float)
        places.append((T[:3, 3], T[:3, :3] @ direction))
        T = T @ spatial.pose(spatial.exp_so3(value * direction)) @ spatial.pose(p=[0.2, 0.0, 0.0])
    columns = [[*(np.cross(w, T[:3, 3] - p) / 0.1), *w] for p, w in places]
    values = np.linalg.svd(np.array(columns).T, compute_uv=False)
    return values[-1] / values[0]


@pytest.mark.parametrize(("axes", "finger"), STRETCHED)
def test_the_first_motion_of_a_stretched_arm_starts_where_it_is_not_singular(axes, finger, tmp_path):
    source = tmp_path / "stretched.urdf"
    source.write_text(stretched(axes, finger))
    told = tomllib.loads(protocol(close(read(source)).mechanism))
    for name in ("home", "near"):
        joints = told["waypoints"][name]["joints"]
        q = [np.radians(joints[f"q{i + 1}_deg"]) for i in range(len(axes))]
        assert min(q) >= -0.5
        assert max(q) <= 2.5
        assert regularity(axes, q) > 1e-4
    assert regularity(axes, np.zeros(len(axes))) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("holds", ["link3", "base"])
def test_a_stretched_arm_with_a_gripper_validates(holds, tmp_path, monkeypatch):
    """A tool on the base never moves, so it says nothing about singularities."""
    monkeypatch.chdir(tmp_path)
    flange = '<joint name="flange" type="fixed"><parent link="{}"/>'
    text = stretched("yyy", True)
    assert flange.format("link3") in text
    Path("stretched.urdf").write_text(text.replace(flange.format("link3"), flange.format(holds)))
    assert cli.main(["new", "own", "stretched.urdf"]) == 0
    assert cli.main(["validate", "own/"]) == 0


@pytest.mark.slow
def test_the_template_and_protocol_serve_as_soon_as_equations_are_there(tmp_path):
    source, folder = tmp_path / "gantry.urdf", tmp_path / "gantry"
    source.write_text(GANTRY)
    write_folder(close(read(source)), "gantry", folder, source)
    with pytest.raises(KinematicsError, match="no equations yet"):
        api.load(folder).kinematics()
    assert api.validate(api.load(folder)).verdict == "agree"  # mechanism and stage
    template = (folder / "formula.py").read_text()
    assert template.endswith("\nFORMULA = None\n")
    written = template.removesuffix("FORMULA = None\n") + EQUATIONS  # as its text says
    (folder / "formula.py").write_text(written.replace("FAULT", "0"))
    robot = api.load(folder)
    trajectory = api.plan(robot)
    assert np.ptp(trajectory.q[:, 0]) == pytest.approx(0.01, abs=1e-9)  # qx, as the protocol says
    assert api.validate(robot, trajectory).verdict == "agree"
    (folder / "formula.py").write_text(written.replace("FAULT", "0.0001"))
    assert api.validate(api.load(folder), trajectory).verdict == "disagree"


def test_the_template_is_python_that_is_not_run_before_it_is_filled_in(tmp_path):
    write_folder(close(read(MODELS / "slider.urdf")), "own", tmp_path / "own", MODELS / "slider.urdf")
    formula = tmp_path / "own/formula.py"
    compile(formula.read_text(), "formula.py", "exec")
    assert "q (rad)" in formula.read_text()
    formula.write_text(formula.read_text() + "raise SystemExit('run')\n")
    assert not api.load(tmp_path / "own").files.has_equations
    assert api.load(tmp_path / "own").mechanism.name == "own"


# -- nothing of the user's is touched -------------------------------------------------------------------


def test_a_folder_with_something_in_it_is_left_alone(tmp_path):
    (tmp_path / "mine.txt").write_text("keep")
    for force in (False, True):  # it is no robot folder either
        with pytest.raises(OutputError):
            write_folder(close(read(DATA / "good.urdf")), "arm", tmp_path, DATA / "good.urdf", force)
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


def test_force_writes_over_a_robot_folder_but_keeps_equations_and_protocols(tmp_path, capsys):
    command = ["new", "own", "--from", str(MODELS / "slider.urdf"), "--out", str(tmp_path / "own"), "--quiet"]
    assert cli.main(command) == 0
    (tmp_path / "own/formula.py").write_text("FORMULA = 1\n")
    (tmp_path / "own/trajectories/first.toml").write_text("# mine\n")
    assert cli.main(command) == 2
    assert "the folder is not empty" in capsys.readouterr().err
    assert cli.main([*command, "--force"]) == 0
    assert (tmp_path / "own/formula.py").read_text() == "FORMULA = 1\n"
    assert (tmp_path / "own/trajectories/first.toml").read_text() == "# mine\n"


def test_a_write_that_fails_leaves_nothing(tmp_path, monkeypatch):
    from twin.exchange.read import robot_folder

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(robot_folder, "notes", full)
    with pytest.raises(OutputError, match="No space left"):
        write_folder(close(read(DATA / "good.urdf")), "arm", tmp_path / "a/arm", DATA / "good.urdf")
    assert list(tmp_path.iterdir()) == []


def test_command_takes_a_file_alone_and_tells_json(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new", str(MODELS / "fourbar.xml"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["robot"] == "fourbar"
    assert told["worst_gap_m"] < 1e-9
    assert Path("fourbar/cad/fourbar.toml").is_file()
    assert {f["code"] for f in told["findings"]} >= {"import.soft"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["Arm!", "--from", "x.urdf"], "'Arm!' is not a valid robot name"),
        (["arm"], "'arm' is not a file to read: give a file"),
        (["arm", "--from", "nowhere.urdf"], "the file does not exist"),
        (["arm", "--from", "robot.txt"], "suffix '.txt' is not supported"),
        (["arm", "--from", str(MODELS / "fourbar.xml"), "--closures", "x.yaml"], "a closure YAML is for URDF only"),
        (["arm", "--from", str(MODELS / "fourbar.xml"), "--root", "/a"], "--root: there is no body '/a'"),
        (
            ["arm", "--from", str(MODELS / "fourbar.urdf"), "--root", "a"],
            "a URDF file contains one robot: --root does not apply",
        ),
        (
            ["arm", "--from", str(DATA.parent / "cad/crank.step"), "--root", "/a"],
            "--closures and --root do not apply to a STEP",
        ),
    ],
)
def test_command_refuses(arguments, message, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new", *arguments, "--quiet"]) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


# -- what is not carried is told ------------------------------------------------------------------------

LOST = [
    ("fourbar.urdf", '<limit lower="-1"', '<dynamics damping="0.3" friction="0.1"/><limit lower="-1"', "damping 0.3"),
    ("fourbar.urdf", '<color rgba="0.2 0.4 0.8 0.5"/>', '<texture filename="a.png"/>', "texture a.png"),
    (
        "fourbar.urdf",
        '<axis xyz="0 1 0"/>\n  </joint>\n  <joint name="rocker_joint"',
        '<axis xyz="0 1 0"/><limit effort="7" velocity="1"/></joint><joint name="rocker_joint"',
        "joint 'elbow': effort 7 is not imported",
    ),
    ("fourbar.urdf", "</robot>", '<gazebo reference="crank"/></robot>', "<gazebo>"),
    ("fourbar.urdf", "</robot>", "<sensor/></robot>", "<sensor>"),
    ("fourbar.urdf", '<box size="0.01 0.01 0.1"/>', '<mesh filename="package://a/b.stl"/>', "package://a/b.stl"),
    (
        "fourbar.urdf",
        "</robot>",
        '<transmission name="t"><joint name="crank_joint"/><actuator name="m"><mechanicalReduction>50'
        '</mechanicalReduction></actuator><actuator name="n"/></transmission></robot>',
        "mechanicalReduction 50",
    ),
    ("fourbar.sdf", "<limit><lower>-1", "<dynamics><damping>0.2</damping></dynamics><limit><lower>-1", "damping 0.2"),
    (
        "fourbar.sdf",
        "<child>coupler</child><axis><xyz>0 1 0</xyz>",
        "<child>coupler</child><axis><xyz>0 1 0</xyz><limit><effort>9</effort></limit>",
        "joint 'elbow': effort 9 is not imported",
    ),
    ("fourbar.sdf", '<link name="rocker">', '<link name="rocker"><sensor name="s" type="imu"/>', "<sensor>"),
    ("fourbar.sdf", "</model>", "<gripper/></model>", "<gripper>"),
    ("fourbar.sdf", "<box><size>0.01 0.01 0.1</size></box>", "<plane/>", "a <plane> is not shown"),
    ("fourbar.xml", 'name="elbow"', 'name="elbow" stiffness="3" springref="0.1"', "stiffness 3"),
    ("fourbar.xml", 'name="elbow"', 'name="elbow" damping="0.4" frictionloss="0.2" armature="0.01"', "damping 0.4"),
    ("fourbar.xml", "<equality>", '<contact><exclude body1="crank" body2="rocker"/></contact><equality>', "exclusion"),
    ("fourbar.xml", "<position", '<motor joint="elbow" name="push"/><position', "'push' is not a position servo"),
    (
        "fourbar.xml",
        "<equality>",
        '<tendon><fixed name="t"><joint joint="elbow" coef="1"/></fixed></tendon><equality>',
        "'t'",
    ),
    ("fourbar.xml", 'name="wrist"', 'name="wrist" active="false"', "'wrist' is not active"),
    ("fourbar.xml", "<equality>", '<sensor><jointpos joint="elbow"/></sensor><equality>', "1 sensors"),
    (
        "fourbar.usda",
        'PhysicsRevoluteJoint "elbow"\n    {',
        'PhysicsRevoluteJoint "elbow"\n    {\n        float physxJoint:jointFriction = 0.3',
        "jointFriction",
    ),
    (
        "fourbar.usda",
        'def Mesh "crank_shape"',
        'def Cube "lump" {}\ndef Mesh "crank_shape"',
        "Cube /fourbar/crank/lump",
    ),
    (
        "fourbar.usda",
        '"PhysicsRigidBodyAPI", "PhysicsMassAPI"',
        '"PhysicsRigidBodyAPI", "PhysicsMassAPI", "PhysxForceAPI"',
        "PhysxForceAPI is not read",
    ),
    ("fourbar.usda", "float3 physics:diagonalInertia = (3, 0.1, 3)", "", "the mass of 0.15 kg is not imported"),
]


@pytest.mark.parametrize(("name", "old", "new", "told"), LOST, ids=[f"{n[8:]}-{t}" for n, _, _, t in LOST])
def test_what_is_not_carried_is_named_and_written_down(name, old, new, told, tmp_path):
    text = (MODELS / name).read_text()
    assert old in text
    source = tmp_path / name
    source.write_text(text.replace(old, new, 1))
    if name.endswith(".urdf"):
        (tmp_path / "fourbar.yaml").write_text((MODELS / "fourbar.yaml").read_text())
    assert not [f for f in close(read(MODELS / name, guarded=False)).findings if told in f.message]
    imported = close(read(source, guarded=False))
    assert [f for f in imported.findings if told in f.message]
    write_folder(imported, "own", tmp_path / "own", source)
    assert told in (tmp_path / "own/IMPORT.md").read_text()


def test_mimic_joints_of_sdf_and_key_frames_of_mjcf_are_carried(tmp_path):
    text = (DATA / "good.sdf").read_text()
    more = (
        '<link name="tip"><pose>0 0 0.2 0 0 0</pose></link><joint name="r" type="revolute"><parent>upper</parent>'
        '<child>tip</child><axis><xyz>0 1 0</xyz><mimic joint="q"><multiplier>2</multiplier><offset>0.3</offset>'
        "<reference>0.1</reference></mimic></axis></joint></model>"
    )
    (tmp_path / "x.sdf").write_text(text.replace("</model>", more))
    m = read(tmp_path / "x.sdf").mechanism
    (c,) = m.couplings
    assert (c.joints, c.ratios) == (("r", "q"), (1.0, -2.0))
    assert c.total == pytest.approx(0.3 - 2 * 0.1)
    assert [j.name for j in m.active] == ["q"]
    key = '<keyframe><key name="Up" qpos="0.5 0 0"/></keyframe></mujoco>'
    (tmp_path / "x.xml").write_text((MODELS / "fourbar.xml").read_text().replace("</mujoco>", key))
    assert dict(read(tmp_path / "x.xml").mechanism.postures["up"]) == {"crank_joint": 0.5}
