"""Write the bad inputs beside this file: each is a good file with one thing wrong."""

from pathlib import Path

HERE = Path(__file__).parent

URDF = """<robot name="arm">
<link name="base"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
<link name="upper"><inertial><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="q1" type="revolute"><origin xyz="0 0 0.1" rpy="0 0 0"/><parent link="base"/><child link="upper"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="2" velocity="3" effort="0"/></joint>
</robot>
"""
MJCF = """<mujoco model="arm"><worldbody><body name="a"><joint name="q" type="hinge"/><geom size="0.1" mass="1"/>
<body name="b" pos="0 0 0.1"><joint name="r" type="hinge"/><geom size="0.1" mass="1"/></body></body></worldbody>
<equality><joint joint1="q" joint2="r" polycoef="0 1 0 0 0"/></equality></mujoco>
"""
BALL = """<mujoco model="arm"><worldbody><body name="a"><joint name="r" type="hinge"/><geom size="0.1" mass="1"/>
</body></worldbody></mujoco>
"""
SDF = """<sdf version="1.8"><model name="arm"><link name="base"/><link name="upper"><pose>0 0 0.1 0 0 0</pose></link>
<joint name="q" type="revolute"><parent>base</parent><child>upper</child><axis><xyz>0 1 0</xyz>
<limit><lower>-1</lower><upper>1</upper></limit></axis></joint></model></sdf>
"""
YAML = "closed_loop: [[q1, base]]\ntype: [6d]\nname_mot: [q1]\n"

BAD = {
    "error_not_xml.urdf": (URDF, "</robot>", ""),
    "error_entities.urdf": (URDF, "<robot ", "<!DOCTYPE robot><robot "),
    "error_other_root.urdf": (URDF, "robot", "model"),
    "error_unknown_link.urdf": (URDF, 'child link="upper"', 'child link="uper"'),
    "error_two_links_of_one_name.urdf": (URDF, 'link name="upper"', 'link name="base"'),
    "error_planar_joint.urdf": (URDF, "revolute", "planar"),
    "error_axis_zero.urdf": (URDF, 'axis xyz="0 1 0"', 'axis xyz="0 0 0"'),
    "error_origin_not_numbers.urdf": (URDF, "0 0 0.1", "0 0 1,5"),
    "error_origin_nan.urdf": (URDF, "0 0 0.1", "0 0 nan"),
    "error_limits_swapped.urdf": (URDF, 'upper="2"', 'upper="-2"'),
    "error_negative_speed.urdf": (URDF, 'velocity="3"', 'velocity="-3"'),
    "error_no_child.urdf": (URDF, '<child link="upper"/>', ""),
    "error_mimic_nobody.urdf": (URDF, "<axis", '<mimic joint="q9"/><axis'),
    "error_box_negative.urdf": (URDF, "0.1 0.1 0.1", "0.1 -0.1 0.1"),
    "error_inertia_incomplete.urdf": (URDF, 'ixx="0.1"', ""),
    "error_quadratic_coupling.xml": (MJCF, "0 1 0 0 0", "0 1 2 0 0"),
    "error_locked_joint.xml": (MJCF, ' joint2="r"', ""),
    "error_unknown_attribute.xml": (MJCF, 'name="r"', 'name="r" colour="red"'),
    "error_ball_limited.xml": (BALL, '"hinge"', '"ball" range="0 1" limited="true"'),
    "error_screw_joint.sdf": (SDF, "revolute", "screw"),
    "error_unknown_link.sdf": (SDF, "<child>upper", "<child>uper"),
    "error_two_models.sdf": (SDF, "</sdf>", '<model name="b"/></sdf>'),
    "error_pose_circle.sdf": (SDF, "<pose>", '<pose relative_to="upper">'),
    "error_nested_model.sdf": (SDF, "</model>", '<model name="in"/></model>'),
    "error_limits_swapped.sdf": (SDF, "<upper>1", "<upper>-2"),
    "error_unknown_name.yaml": (YAML, "[q1, base]", "[q7, base]"),
    "error_type_5d.yaml": (YAML, "6d", "5d"),
    "error_types_missing.yaml": (YAML, "[6d]", "[]"),
    "error_no_motor.yaml": (YAML, "[q1]\n", "[]\n"),
    "error_unknown_motor.yaml": (YAML, "name_mot: [q1]", "name_mot: [q2]"),
    "error_alias.yaml": (YAML, "[[q1, base]]", "&a [[q1, base], *a]"),
    "error_one_body.yaml": (YAML, "[q1, base]", "[q1, upper]"),
    "error_unknown_key.yaml": (YAML, "name_mot", "motors"),
}

for name, (good, old, new) in BAD.items():
    assert old in good, name
    (HERE / name).write_text(good.replace(old, new))
for suffix, good in (("urdf", URDF), ("xml", MJCF), ("sdf", SDF)):
    (HERE / f"good.{suffix}").write_text(good)
