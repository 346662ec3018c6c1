"""Bad inputs of every reader of `twin new`: each is one good file with one thing wrong, and each is told by name.

The files are drawn by tests/data/importing/draw.py. Bad TOML is in tests/data/cad and tests/data/protocols.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from twin import cli
from twin.core.errors import BudgetError, SourceError, TwinError
from twin.core.foreign import guard
from twin.core.foreign.admit import admit, admit_together
from twin.core.foreign.budget import Budget, read_bytes
from twin.core.foreign.once import Once
from twin.exchange.formats.step.read import read_skeleton
from twin.exchange.read import read

DATA = Path(__file__).parents[1] / "data/importing"

BAD = {
    "error_axis_zero.sdf": "joint 'q': axis xyz: the axis has length 0",
    "error_child_world.sdf": "joint 'q': the child of the joint is the world: exchange parent and child",
    "error_frame_on_nothing.sdf": "frame 'g' does not exist",
    "error_limits_swapped.sdf": "joint 'q': the lower limit -1 is not below the upper limit -2",
    "error_mimic_nobody.sdf": "joint 'q', mimic: there is no joint 'q9'",
    "error_missing_include.sdf": "model 'arm': include model://nowhere is missing: put it into the folder of the SDF",
    "error_no_links.sdf": "no <link>, so there is no mechanism",
    "error_pose_circle.sdf": "'upper': the pose is relative to itself: q -> upper -> upper",
    "error_pose_of_five.sdf": "link 'upper': pose = '0 0 0.1 0 0' is not 6 finite numbers",
    "error_screw_joint.sdf": "joint 'q': there is no joint type 'screw'",
    "error_placement_frame.sdf": "model 'in': placement_frame is not supported: expand the model (gz sdf -p)",
    "error_two_models.sdf": "2 models with joints: arm, b. Choose one with --root NAME.",
    "error_unknown_link.sdf": "joint 'q', child: there is no link 'uper'",
    "error_argument_undefined.xacro": "xacro:4: the argument 'side' has no value and no default. Give it: --arg side:=",
    "error_expression.xacro": "xacro:8: invalid syntax (<expression>, line 1) when evaluating expression '0.1 * / 3'",
    "error_include_itself.xacro": "the file includes itself: error_include_itself.xacro -> error_include_itself.xacro",
    "error_include_missing.xacro": "nowhere.xacro cannot be read (No such file or directory). Correct the path, or add",
    "error_include_not_xml.xacro": "xacro: error_not_xml.urdf:8: the file is not XML: no element found: line 8",
    "error_macro_loop.xacro": "xacro:6: macro 'hinge' calls itself without end: more than 150 macros call each other",
    "error_macro_undefined.xacro": "xacro:8: unknown macro name: xacro:hinge. Define the macro, or include the file",
    "error_nan.xacro": 'xacro:8: <origin> has xyz="0 0 nan", but must be finite. Correct the expression.',
    "error_package_missing.xacro": "xacro:7: package 'nowhere' was not found: it is in no folder of --packages, ROS",
    "error_parameter_missing.xacro": "xacro:8: Undefined parameters [name]. Correct the parameters of the macro",
    "error_property_circle.xacro": "xacro:8: circular variable definition: height -> height",
    "error_property_undefined.xacro": "xacro:8: name 'heigth' is not defined when evaluating expression 'heigth'. Def",
    "error_unsafe_name.xacro": "xacro:8: Use of invalid name(s): __import__ when evaluating expression '__import__('o",
    "error_cut_off.step": "is truncated: END-ISO-10303-21 is missing. Export or copy it again.",
    "error_no_solids.step": "states no length unit; a STEP file without a unit cannot be scaled. Export it again in",
    "error_no_unit.step": "states no length unit; a STEP file without a unit cannot be scaled. Export it again in",
    "error_not_step.step": "is not a STEP file: it does not begin with ISO-10303-21",
    "error_one_body.step": "the file has one body, 'block': a mechanism requires an assembly with a node for each bod",
    "error_axis_zero.urdf": "joint 'q1': axis: the axis has length 0",
    "error_box_negative.urdf": "link 'base': a size of the box is -0.1, but must not be negative",
    "error_entities.urdf": "the file declares a document type or entities; expand the entities first",
    "error_inertia_incomplete.urdf": "link 'upper': ixx is missing",
    "error_limits_swapped.urdf": "joint 'q1': the lower limit -1 is not below the upper limit -2",
    "error_mimic_nobody.urdf": "joint 'q1', mimic: there is no joint 'q9'",
    "error_negative_speed.urdf": "joint 'q1': velocity -3 is negative",
    "error_no_child.urdf": "joint 'q1': the joint has no <child link>",
    "error_no_joints.urdf": "no <joint>, so there is no mechanism",
    "error_not_xml.urdf": "not XML: no element found: line 8, column 0",
    "error_origin_nan.urdf": "joint 'q1': origin xyz = '0 0 nan' is not 3 finite numbers",
    "error_origin_not_numbers.urdf": "joint 'q1': origin xyz = '0 0 1,5' is not 3 numbers",
    "error_other_root.urdf": "the root element is <model>, expected <robot>. Expand a xacro first",
    "error_two_links_of_one_name.urdf": "link 'base': the name is used twice",
    "error_two_parents.urdf": "link 'upper': the link is the child of two joints, 'q1' and 'q2', but a URDF is a tree",
    "error_two_roots.urdf": "expected one root link, found base, alone",
    "error_unknown_link.urdf": "joint 'q1', child: there is no link 'uper'",
    "error_unknown_type.urdf": "joint 'q1': there is no joint type 'screw'",
    "error_unknown_shape.urdf": "link 'base': there is no shape 'cone'",
    "error_cut_off.usda": "is not a readable USD file",
    "error_distance_joint.usda": "joint /fourbar/wrist: joints of type PhysicsDistanceJoint are not suppor",
    "error_limit_of_three_numbers.usda": "lowerLimit has type 'point3f', but the schema of the prim requires float",
    "error_unknown_type.usda": "lowerLimit has type 'flaot', which USD does not define",
    "error_limits_swapped.usda": "fourbar: joint 'crank_joint': limits -1 .. -1.5708 are not ordered",
    "error_mimic_of_a_vendor.usda": "joint /fourbar/elbow is coupled to another joint by PhysxMimicJointAPI:rotZ",
    "error_missing_vertices.usda": "mesh /fourbar/crank/crank_shape: an index refers to vertex 9, but the mes",
    "error_no_bodies.usda": "no rigid bodies (PhysicsRigidBodyAPI), so there is no mechanism",
    "error_no_joints.usda": "no joints, so there is no mechanism",
    "error_not_usda.usda": "is not a readable USD file",
    "error_rotation_of_nothing.usda": "joint /fourbar/crank_joint: physics:localRot1: quaternion (w, x, y, z) = [0.0,",
    "error_scaled_body.usda": "rigid body /fourbar/coupler is scaled by (1, 2, 1), mirrored. Scale the meshes below ",
    "error_unknown_body.usda": "joint /fourbar/crank_joint: physics:body1 points to /fourbar/krank, but must point to",
    "error_ball_limited.xml": "ball joint 'r' has a range of its rotation angle, which is not supported",
    "error_locked_joint.xml": "equality 'equality0' locks joint 'q': remove the joint",
    "error_mocap.xml": "MuJoCo rejects the file: Error: mocap body 'a' is not a fixed child of world Element",
    "error_no_joints.xml": "no joints, so there is no mechanism",
    "error_quadratic_coupling.xml": "equality 'equality0' is a polynomial of degree > 1; the degree must be 1",
    "error_size_nan.xml": "size = '0.1 0.1 nan' contains a number that is not finite",
    "error_two_tendons.xml": "equality 'equality0' couples two tendons, which a mechanism cannot express; supported",
    "error_no_geometry.urdf": "link 'base': a <visual> has no shape in a <geometry>",
    "error_spatial_tendon.xml": "equality 'equality0' constrains a spatial tendon, which is not supported",
    "error_unknown_attribute.xml": "MuJoCo rejects the file: XML Error: Schema violation: unrecognized attribute: ",
    "error_alias.yaml": "aliases (*name) are not supported; write the full list instead",
    "error_driven_ball.yaml": "name_mot: joint 'q1' is SPHERICAL and cannot be driven",
    "error_joint_type.yaml": "joint_type: there is no joint type 'BALL'.",
    "error_joint_types_missing.yaml": "joint_name has 1 names, but joint_type has 0 entries; give one type for each",
    "error_motor_twice.yaml": "name_mot: 'q1' is listed twice",
    "error_no_list.yaml": "type: expected a list, found '6d'",
    "error_no_motor.yaml": "name_mot is empty; name at least one",
    "error_not_yaml.yaml": "not YAML: while parsing a flow node expected the node content, but found ',' i",
    "error_one_body.yaml": "closed_loop: 'q1' and 'upper' are on the same body, 'upper'",
    "error_pair_of_three.yaml": "closed_loop: ['q1', 'base', 'upper'] is not a pair of names",
    "error_type_5d.yaml": "type: there is no closure type '5d'",
    "error_types_missing.yaml": "closed_loop has 1 pairs, but type has 0 entries; give one type for each pair",
    "error_unknown_key.yaml": "there is no key 'motors'",
    "error_unknown_motor.yaml": "name_mot: there is no joint 'q2'",
    "error_unknown_name.yaml": "closed_loop: there is no joint or link 'q7'",
    "error_with_itself.yaml": "closed_loop: 'q1' is paired with itself",
}


def test_every_bad_file_has_its_message():
    assert {p.name for p in DATA.glob("error_*")} == set(BAD)


def _read(path):
    if path.suffix == ".yaml":
        return read(DATA / "good.urdf", path)
    return read_skeleton(path) if path.suffix == ".step" else read(path, guarded=False)


@pytest.mark.parametrize("name", sorted(BAD))
def test_bad_file_is_refused_with_file_and_element(name):
    with pytest.raises(TwinError) as error:
        _read(DATA / name)
    assert BAD[name] in str(error.value)
    assert name in str(error.value)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["error_no_child.urdf", "error_locked_joint.xml", "error_unknown_body.usda"])
def test_a_bad_file_leaves_no_folder_and_exits_2(name, tmp_path, capsys):
    target = tmp_path / "robots/arm"
    assert cli.main(["new", "arm", "--from", str(DATA / name), "--out", str(target), "--quiet"]) == 2
    assert name in capsys.readouterr().err
    assert not target.parent.exists()


@pytest.mark.slow
def test_a_parser_that_crashes_or_hangs_is_an_error_that_names_the_file(tmp_path, monkeypatch):
    path = tmp_path / "bad.xml"
    path.write_text("<mujoco/>")
    monkeypatch.setitem(guard._PARSERS, "MJCF", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    with pytest.raises(SourceError, match=r"bad\.xml: the MJCF parser crashed \(SIGSEGV"):
        guard.run(path, "MJCF")
    monkeypatch.setitem(guard._PARSERS, "MJCF", "while True: pass")
    monkeypatch.setitem(guard.BUDGETS, "MJCF", Budget(10**6, seconds=0.5, memory=10**9))
    with pytest.raises(BudgetError, match=r"bad\.xml: the MJCF parser exceeded its limit of 0 s of processor time"):
        guard.run(path, "MJCF")
    monkeypatch.setitem(guard.BUDGETS, "MJCF", Budget(10**6, seconds=20, memory=10**9))
    monkeypatch.setitem(guard._PARSERS, "MJCF", "a = [bytes(10**8) + b'x' for i in range(100)]")
    with pytest.raises(BudgetError, match="exceeded its limit of 1,000 MB of memory"):
        guard.run(path, "MJCF")
    monkeypatch.setattr(guard, "_MOST_IDLE_S", 0.5)
    monkeypatch.setitem(guard._PARSERS, "MJCF", "import os; os.read(os.pipe()[0], 1)")
    with pytest.raises(BudgetError, match="refers to an endless stream"):
        guard.run(path, "MJCF")


@pytest.mark.parametrize("reader", [read_bytes, Once()])
def test_a_file_without_end_is_read_up_to_the_limit(reader):
    with pytest.raises(BudgetError, match="/dev/zero: bytes so far: 100,001; the limit for YAML is 100,000"):
        reader(Path("/dev/zero"), "YAML")


@pytest.mark.parametrize("kind", sorted(guard._PARSERS))
def test_the_guard_lets_good_files_pass(kind, tmp_path):
    step = DATA.parent / "cad/crank.step"
    good = {"MJCF": DATA / "good.xml", "USD": DATA / "models/fourbar.usda", "STEP": step, "fine STEP": step}
    good["xacro"] = DATA / "good.urdf"
    arguments = (str(tmp_path / "x.glb"), "1.0", "0.5") if good[kind] == step else ()
    if kind == "xacro":
        (tmp_path / "request.json").write_text('{"arguments": {}, "packages": []}')
        arguments = (str(tmp_path / "request.json"), str(tmp_path / "answer.json"))
    assert guard.run(good[kind], kind, *arguments) == 0


def test_a_ply_header_is_read_to_its_end_and_no_suffix_is_without_limits(tmp_path):
    file = tmp_path / "m.ply"
    comments = 3000 * "comment a long line, of which many writers write some, with its end_headers\n"
    start = f"ply\nformat ascii 1.0\n{comments}"
    file.write_text(f"{start}element vertex 4000000000\nproperty float x\nend_header\n0\n", "utf-8")
    with pytest.raises(BudgetError, match="rows stated in the header: 4,000,000,000"):
        admit(file)
    file.write_text(f"{start}element vertex 1\nproperty float x\nend_header\nelement vertex 4000000000\n", "utf-8")
    admit(file)
    file.write_text(f"ply\n{5 * comments}", "utf-8")
    with pytest.raises(BudgetError, match="bytes of the header, which does not end"):
        admit(file)
    with pytest.raises(SourceError, match=r"no limits are known for the suffix '\.x3d'"):
        admit(tmp_path / "m.x3d")


@pytest.mark.slow
def test_files_pass_together_or_none_does(tmp_path, monkeypatch):
    good = [DATA / "models/fourbar.usda", tmp_path / "again.usda"]
    shutil.copy(good[0], good[1])
    assert admit_together(good) == set(good)
    bad = tmp_path / "bad.usda"
    bad.write_text("#usda 1.0\ndef {", "utf-8")
    assert admit_together([*good, bad]) == set()
    crashing = guard._PARSERS["USD"] + "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"
    monkeypatch.setitem(guard._PARSERS, "USD", crashing)
    assert admit_together(good) == set()
