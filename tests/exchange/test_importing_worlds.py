"""Worlds of Gazebo and MuJoCo with several models in them: one is chosen, nothing of it is lost, the rest is told."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

from twin import cli
from twin.cad.build import read_mechanism
from twin.core.errors import BudgetError, SourceError, UnsupportedError
from twin.core.foreign.budget import INCLUDES
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.reference import ReferenceModel

WORLDS = Path(__file__).parents[1] / "data/importing/worlds"
ROBOTS = {
    "two_arms": "right",
    "props": None,
    "nested": None,
    "include": None,
    "relative": None,
    "loop": None,
}


def at(m, body):
    return (m.rest[m.base] @ m.rest[body])[:3, 3]


def test_every_world_has_its_robot():
    assert {p.stem for p in WORLDS.glob("*.sdf")} == set(ROBOTS)


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_every_world_becomes_a_robot_folder(name, tmp_path, capsys):
    root = ["--root", ROBOTS[name]] if ROBOTS[name] else []
    target = tmp_path / name
    assert cli.main(["new", name, "--from", str(WORLDS / f"{name}.sdf"), "--out", str(target), "--quiet", *root]) == 0
    capsys.readouterr()
    m = read_mechanism(target / f"cad/{name}.toml").mechanism
    model = ReferenceModel(m)
    assert model.home().worst_gap < 1e-9
    assert cli.main(["info", str(target), "--quiet"]) == 0


def test_several_robots_are_listed_and_one_is_chosen(capsys, tmp_path):
    with pytest.raises(SourceError, match=r"2 models with joints: left, right\. Choose one with --root NAME\."):
        read(WORLDS / "two_arms.sdf")
    with pytest.raises(SourceError, match=r"--root: there is no model 'rigth'\. Did you mean 'right'\?"):
        read(WORLDS / "two_arms.sdf", root="rigth")
    imported = read(WORLDS / "two_arms.sdf", root="left")
    assert [j.name for j in imported.mechanism.joints] == ["base_free", "lift"]
    np.testing.assert_allclose(at(imported.mechanism, "base"), [0, 0.5, 0], atol=1e-12)
    props = {f.where: f.severity for f in imported.findings if f.code == "import.prop"}
    assert props == {"right": "warning", "ground_plane": "info"}


def test_what_is_no_robot_is_left_out_and_told():
    imported = read(WORLDS / "props.sdf")
    assert [j.name for j in imported.mechanism.joints] == ["base_free", "shoulder"]
    assert {f.where for f in imported.findings if f.code == "import.prop"} == {"table", "can"}
    assert len([f for f in imported.findings if f.code == "import.include"]) == 2


def test_nested_models_stand_where_their_frames_say():
    m = read(WORLDS / "nested.sdf").mechanism
    joints = {j.name: j for j in m.joints}
    assert {n: (j.parent, j.child) for n, j in joints.items()} == {
        "base_free": ("world", "base"),
        "shoulder": ("base", "upper"),
        "wrist": ("upper", "hand_palm"),
        "hand_close": ("hand_palm", "hand_finger"),
        "hand_bend": ("hand_palm", "hand_thumb_tip"),
        "roll": ("hand_finger", "nail"),
    }
    # the flange is 0.2 m along x of the upper arm, which is turned by a quarter about z
    np.testing.assert_allclose(at(m, "hand_palm"), [0.1, 0.2, 0.35], atol=1e-12)
    np.testing.assert_allclose(at(m, "hand_finger"), [0.12, 0.2, 0.35], atol=1e-12)
    np.testing.assert_allclose(at(m, "hand_thumb_tip"), [0.08, 0.21, 0.35], atol=1e-12)
    np.testing.assert_allclose(at(m, "nail"), [0.12, 0.2, 0.36], atol=1e-12)
    close_ = m.rest["hand_palm"] @ joints["hand_close"].T_parent_joint
    np.testing.assert_allclose(close_[:3, 2], [-1, 0, 0], atol=1e-12)
    assert [f.name for f in m.frames if f.name not in ("flange", "tool")] == []


def test_included_models_are_parts_with_their_own_names():
    m = read(WORLDS / "include.sdf").mechanism
    assert {j.name: j.limits for j in m.joints if j.type == "revolute"} == {
        "one_knuckle": (0, 1.2),
        "two_knuckle": (0, 1.2),
    }
    np.testing.assert_allclose(at(m, "two_tip"), [-0.05, 0, 0.04], atol=1e-12)
    axes = [(m.rest[j.parent] @ j.T_parent_joint)[:3, 2] for j in m.joints if j.type == "revolute"]
    np.testing.assert_allclose(axes, [[1, 0, 0], [-1, 0, 0]], atol=1e-12)


def test_an_include_that_is_missing_or_endless_is_an_error(tmp_path):
    text = (WORLDS / "include.sdf").read_text()
    (tmp_path / "hand.sdf").write_text(text)
    with pytest.raises(SourceError, match=r"model 'hand': include model://finger is missing"):
        read(tmp_path / "hand.sdf")
    folder = tmp_path / "finger"
    folder.mkdir()
    (folder / "model.sdf").write_text(
        '<sdf version="1.9"><model name="finger"><include><uri>model://finger</uri></include></model></sdf>'
    )
    with pytest.raises(SourceError, match="more than 8 levels; check that no model includes itself"):
        read(tmp_path / "hand.sdf")


def test_too_many_includes_and_several_models_without_joints_are_errors(tmp_path):
    folder = tmp_path / "box"
    folder.mkdir()
    (folder / "model.sdf").write_text('<sdf version="1.9"><model name="box"><link name="l"/></model></sdf>')
    for count, error, text in (
        (2, UnsupportedError, "the file has 2 models, none with joints: b0, b1. Choose one with --root NAME"),
        (INCLUDES + 1, BudgetError, "number of included files so far: 301; the limit for SDF is 300"),
    ):
        includes = [f"<include><uri>model://box</uri><name>b{k}</name></include>" for k in range(count)]
        world = tmp_path / "world.sdf"
        world.write_text(f'<sdf version="1.9"><world name="w">{"".join(includes)}</world></sdf>')
        with pytest.raises(error, match=text):
            read(world)


def test_relative_poses_lead_through_joints_and_frames():
    m = read(WORLDS / "relative.sdf").mechanism
    # of the base: j1 is 0.5 above, turned by a quarter about y: its x points down, its z along x
    np.testing.assert_allclose(at(m, "base"), [3, 2, 2], atol=1e-12)
    np.testing.assert_allclose(at(m, "a"), [3, 2, 2.4], atol=1e-12)
    np.testing.assert_allclose(at(m, "b"), [3.2, 2, 2.4], atol=1e-12)
    np.testing.assert_allclose((m.rest["a"] @ m.joint("j2").T_parent_joint)[:3, 2], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose((m.rest["base"] @ m.joint("j1").T_parent_joint)[:3, 2], [0, 1, 0], atol=1e-12)
    assert m.frame("eye").body == "b"


def test_a_model_placed_by_a_frame_that_is_placed_in_the_world_is_an_error(tmp_path):
    file = tmp_path / "circle.sdf"
    text = "<sdf version='1.9'><model name='m' placement_frame='f'><link name='a'/><link name='b'/><frame name='f'>"
    text += "<pose relative_to='world'/></frame><joint name='j' type='fixed'><parent>a</parent><child>b</child></joint>"
    file.write_text(f"{text}</model></sdf>")
    with pytest.raises(SourceError, match="the frame that places the model is itself placed in the world"):
        read(file)


def test_the_loop_of_a_world_closes():
    imported = close(read(WORLDS / "loop.sdf"))
    assert [j.name for j in imported.mechanism.loops] == ["meet"]
    assert [j.name for j in imported.mechanism.active] == ["drive"]
    model = ReferenceModel(imported.mechanism)
    assert model.solve(np.array([0.3])).q_full["pivot"] == pytest.approx(0.3, abs=1e-9)


# -- MJCF -------------------------------------------------------------------------------------------------

ARM = """<body name="{n}" pos="0 {y} 0"><joint name="{n}_a" axis="0 0 1"/><geom size=".1" mass="1"/>
<body name="{n}_fore" pos=".3 0 0"><joint name="{n}_b" axis="0 1 0"/><geom size=".1" mass="1"/></body></body>"""


def mjcf(folder, bodies, more="", assets=""):
    path = folder / "scene.xml"
    path.write_text(f"<mujoco>{assets}<worldbody><geom type='plane' size='1 1 1'/>{bodies}</worldbody>{more}</mujoco>")
    return path


def arms(count, driven=True):
    bodies = "".join(ARM.format(n=f"arm{i}", y=i) for i in range(count))
    motors = "".join(f'<motor joint="arm{i}_a"/>' for i in range(count))
    return bodies, f"<actuator>{motors}</actuator>" if driven else ""


@pytest.mark.parametrize("driven", [True, False])
def test_several_robots_of_an_mjcf_are_listed_and_one_is_chosen(driven, tmp_path):
    path = mjcf(tmp_path, *arms(2, driven))
    with pytest.raises(SourceError, match=r"the file has 2 robots: 'arm0', 'arm1'\. Choose one with --root NAME"):
        read(path, guarded=False)
    one = close(read(path, root="arm1_fore", guarded=False))
    assert [b.name for b in one.mechanism.bodies] == ["world", "arm1", "arm1_fore"]
    assert {f.where for f in one.findings if f.code == "import.prop"} == {"'arm0'"}
    both = close(read(path, root="world", guarded=False))
    assert len(both.mechanism.joints) == 4
    with pytest.raises(SourceError, match=r"--root: there is no body 'arm7'\. Did you mean"):
        read(path, root="arm7", guarded=False)


def test_what_an_equality_ties_is_one_robot_and_a_loose_thing_is_none(tmp_path):
    bodies, motors = arms(2)
    tie = '<equality><connect body1="arm0_fore" body2="arm1_fore" anchor="0 .5 0"/></equality>'
    assert len(read(mjcf(tmp_path, bodies, motors + tie), guarded=False).mechanism.joints) == 5
    mug = '<body name="mug" pos="1 1 1"><freejoint/><geom size=".1"/></body>'
    table = '<body name="table"><geom type="box" size="1 1 .1"/></body>'
    imported = read(mjcf(tmp_path, arms(1)[0] + mug + table, arms(1)[1]), guarded=False)
    assert {b.name for b in imported.mechanism.bodies} == {"world", "arm0", "arm0_fore", "table"}
    assert {f.where: f.severity for f in imported.findings if f.code == "import.prop"} == {"'mug'": "warning"}


def test_missing_meshes_and_textures_of_an_mjcf_are_warnings(tmp_path):
    assets = (
        '<compiler meshdir="parts"/><asset><mesh name="m" file="nowhere.stl"/><mesh file="spare.obj"/>'
        '<texture name="t" type="2d" file="no.png"/><material name="wood" texture="t"/></asset>'
    )
    bodies = (
        '<body name="a"><joint name="q"/><geom type="mesh" mesh="m" material="wood"/>'
        '<body name="b"><joint name="r" axis="0 1 0"/><inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>'
        '<geom type="mesh" mesh="m"/><geom size="0.1"/></body></body>'
    )
    imported = close(read(mjcf(tmp_path, bodies, assets=assets), guarded=False))
    told = [(f.code, f.severity) for f in imported.findings if f.code in ("import.mesh", "import.texture")]
    assert told.count(("import.mesh", "warning")) == 3
    assert ("import.texture", "warning") in told
    assert any("nowhere.stl is missing" in f.message for f in imported.findings)
    assert imported.mechanism.body("a").inertia is None
    assert imported.mechanism.body("b").inertia.mass == 2
    assert len(imported.mechanism.body("b").meshes) == 1


def test_a_missing_height_field_of_an_mjcf_is_a_warning(tmp_path):
    assets = '<compiler meshdir="parts"/><asset><hfield name="hills" file="hills.png" size="1 1 1 1"/></asset>'
    ground = '<geom name="ground" type="hfield" hfield="hills"/>'
    arm = '<body name="a"><joint name="q"/><geom name="arm" size="0.1"/></body>'
    pair = '<contact><pair geom1="ground" geom2="arm"/></contact>'
    imported = read(mjcf(tmp_path, ground + arm, pair, assets=assets), guarded=False)
    (told,) = [f for f in imported.findings if f.code == "import.mesh"]
    assert told.message == "height field 'hills': parts/hills.png is missing: it is left out."


def test_a_leg_with_springs_balls_and_two_loops_is_read_whole():
    imported = close(read(WORLDS / "cassie.xml", guarded=False))
    m = imported.mechanism
    assert [j.name for j in m.loops] == ["equality0", "equality1"]
    assert [j.name for j in m.active] == ["hip", "knee", "foot_crank"]
    types = {j.name: j.type for j in m.joints}
    assert (types["joint0"], types["rod_ball"], types["shin_spring"]) == ("free", "spherical", "revolute")
    assert max(g[0] for g in ReferenceModel(m).home().gap.values()) < 1e-9
    told = [f.message for f in imported.findings if f.code == "import.friction"]
    assert any("shin_spring" in t and "stiffness 1500" in t for t in told)
    assert any(f.code == "import.free" for f in imported.findings)
    assert {"hip", "knee", "foot_crank"} == set(next(v for k, v in m.postures.items() if k != "home"))


def test_a_mocap_body_and_what_holds_the_robot_to_it_are_left_out(tmp_path):
    path = tmp_path / "held.xml"
    path.write_text(
        """<mujoco><worldbody><body name="hand" mocap="true" pos="0 0 1"><geom size=".1"/></body>
        <body name="arm"><joint name="j" axis="0 1 0"/><geom size=".1"/></body></worldbody>
        <equality><weld name="grip" body1="hand" body2="arm"/></equality></mujoco>"""
    )
    found = read(path, guarded=False)
    assert [b.name for b in found.mechanism.bodies] == ["world", "arm"]
    assert [j.name for j in found.mechanism.joints] == ["j"]
    assert {(f.code, f.where) for f in found.findings if f.severity == "warning"} >= {
        ("import.mocap", "hand"),
        ("import.equality", "grip"),
    }


def test_a_skin_is_for_display_and_left_out(tmp_path):
    path = tmp_path / "skin.xml"
    path.write_text(
        """<mujoco><worldbody><body name="arm"><joint name="j" axis="0 1 0"/><geom size=".1"/></body></worldbody>
        <deformable><skin name="s" vertex="0 0 0 1 0 0 0 1 0" face="0 1 2"><bone body="arm" bindpos="0 0 0"
        bindquat="1 0 0 0" vertid="0 1 2" vertweight="1 1 1"/></skin></deformable></mujoco>"""
    )
    found = read(path, guarded=False)
    assert [j.name for j in found.mechanism.joints] == ["j"]
    assert any(f.code == "import.skin" and f.severity == "warning" for f in found.findings)


def test_a_joint_may_have_the_name_of_its_link(tmp_path):
    """Before SDF 1.7, only things of one kind need different names; `pose` without frame is relative to the child."""
    text = """<sdf version="1.5"><model name="cart">
      <link name="base"/>
      <link name="wheel"><pose>0.1 0.2 0.3 0 0 0</pose></link>
      <joint name="wheel" type="revolute">
        <pose>0 0 0.05 0 0 0</pose>
        <parent>base</parent><child>wheel</child><axis><xyz>0 1 0</xyz></axis>
      </joint>
    </model></sdf>"""
    (tmp_path / "cart.sdf").write_text(text, encoding="utf-8")
    (joint,) = [joint for joint in read(tmp_path / "cart.sdf").mechanism.joints if joint.type == "revolute"]
    np.testing.assert_allclose(joint.T_parent_joint[:3, 3], (0.1, 0.2, 0.35), atol=1e-15)
    np.testing.assert_allclose(joint.T_child_joint[:3, 3], (0, 0, 0.05), atol=1e-15)


PAIR = '<link name="a"/><link name="b"><pose>1 0 0 0 0 0</pose>{}</link>{}'
PAIR_JOINT = '<joint name="j" type="revolute"><parent>a</parent><child>b</child><axis><xyz>0 0 1</xyz>{}</axis></joint>'
BALL = "<geometry><sphere><radius>0.1</radius></sphere></geometry>"


def pair(tmp_path, in_link="", more="", of_model="", in_axis=""):
    """Return the import of an SDF with the links a and b, 1 m apart along x."""
    path = tmp_path / "pair.sdf"
    parts = PAIR.format(in_link, more) + PAIR_JOINT.format(in_axis)
    path.write_text(f'<sdf version="1.9"><model name="m"{of_model}><static>1</static>{parts}</model></sdf>')
    return read(path)


def test_a_shape_of_sdf_stands_relative_to_the_frame_that_it_names(tmp_path):
    visual = f'<visual name="v"><pose relative_to="f">0 0 2 0 0 0</pose>{BALL}</visual>'
    frame = '<frame name="f"><pose>0 3 0 0 0 0</pose></frame>'
    (mesh,) = pair(tmp_path, visual, frame).mechanism.body("b").meshes
    np.testing.assert_allclose(mesh.vertices.mean(axis=0), (-1, 3, 2), atol=1e-12)


@pytest.mark.parametrize("attached", ["", ' attached_to="__model__"'])
def test_a_frame_of_an_sdf_model_moves_with_its_canonical_link(attached, tmp_path):
    frame = f'<frame name="f"{attached}><pose>0 0 5 0 0 0</pose></frame>'
    (found,) = [f for f in pair(tmp_path, "", frame, ' canonical_link="b"').mechanism.frames if f.name == "f"]
    assert found.body == "b"
    np.testing.assert_allclose(found.T_body_frame[:3, 3], (-1, 0, 5), atol=1e-12)
    (found,) = [f for f in pair(tmp_path, "", frame).mechanism.frames if f.name == "f"]
    assert found.body == "a"


def test_an_include_says_whether_its_model_is_static(tmp_path):
    (tmp_path / "part").mkdir()
    pair(tmp_path / "part")
    world = '<sdf version="1.9"><world name="w"><include><uri>part/pair.sdf</uri>{}</include></world></sdf>'
    path = tmp_path / "world.sdf"
    path.write_text(world.format("<static>false</static><pose>1 2 3 0 0 0</pose>"))
    assert [j.type for j in read(path).mechanism.joints] == ["free", "revolute"]
    path.write_text(world.format("<pose>1 2 3 0 0 0</pose>"))
    assert [j.type for j in read(path).mechanism.joints] == ["fixed", "revolute"]


@pytest.mark.parametrize(
    ("in_link", "in_axis", "said"),
    [
        ('<inertial auto="true"/>', "", r"link 'b': its mass is to be computed from its colliders \(auto\)"),
        ('<inertial><pose relative_to="a">0 0 1 0 0 0</pose></inertial>', "", "although it is relative to 'a'"),
        ("", "<initial_position>0.5</initial_position>", "joint 'j', axis: <initial_position> is not read"),
        (
            '<visual name="v"><geometry><mesh><uri>b.stl</uri><submesh/></mesh></geometry></visual>',
            "",
            r"the whole mesh b\.stl is shown, although only its <submesh> is stated",
        ),
    ],
)
def test_what_an_sdf_states_and_is_not_read_is_told(in_link, in_axis, said, tmp_path):
    trimesh.creation.box().export(tmp_path / "b.stl")
    found = pair(tmp_path, in_link, in_axis=in_axis)
    warnings = "\n".join(f.message for f in found.findings if f.severity == "warning")
    assert re.search(said, warnings)
    if "auto" in in_link:
        assert found.mechanism.body("b").inertia is None


def test_links_of_sdf_whose_names_become_alike_keep_their_own_meshes(tmp_path):
    visual = f'<visual name="v">{BALL}</visual>'
    link = f'<link name="B">{visual}</link><joint name="k" type="fixed"><parent>a</parent><child>B</child></joint>'
    mechanism = pair(tmp_path, visual, link).mechanism
    assert sorted(mesh.name for body in mechanism.bodies for mesh in body.meshes) == ["b_shape", "b_shape_2"]
