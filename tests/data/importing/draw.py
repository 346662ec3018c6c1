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
XACRO = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:property name="height" value="${0.1 * 3}"/>
<xacro:macro name="hinge" params="name *place">
<joint name="${name}" type="revolute"><xacro:insert_block name="place"/><parent link="base"/><child link="upper"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="2" velocity="3" effort="0"/></joint>
</xacro:macro>
<link name="base"/><link name="upper"/>
<xacro:hinge name="q1"><origin xyz="0 0 ${height}" rpy="0 0 0"/></xacro:hinge>
</robot>
"""
INCLUDE = '<xacro:include filename="{}"/><link name="base"/>'
MJCF = """<mujoco model="arm"><worldbody><body name="a"><joint name="q" type="hinge"/><geom size="0.1" mass="1"/>
<site name="s"/><body name="b" pos="0 0 0.1"><joint name="r" type="hinge"/><geom size="0.1" mass="1"/>
<site name="u"/></body></body></worldbody>
<equality><joint joint1="q" joint2="r" polycoef="0 1 0 0 0"/></equality></mujoco>
"""
BALL = """<mujoco model="arm"><worldbody><body name="a"><joint name="r" type="hinge"/><geom size="0.1" mass="1"/>
</body></worldbody></mujoco>
"""
SDF = """<sdf version="1.8"><model name="arm"><link name="base"/><link name="upper"><pose>0 0 0.1 0 0 0</pose></link>
<joint name="q" type="revolute"><parent>base</parent><child>upper</child><axis><xyz>0 1 0</xyz>
<limit><lower>-1</lower><upper>1</upper></limit></axis></joint></model></sdf>
"""
USD = (HERE / "models/fourbar.usda").read_text()
STEP = (HERE.parents[1] / "data/cad/crank.step").read_text()
YAML = "closed_loop: [[q1, base]]\ntype: [6d]\nname_mot: [q1]\n"

BAD = {
    "error_not_xml.urdf": (URDF, "</robot>", ""),
    "error_entities.urdf": (URDF, "<robot ", "<!DOCTYPE robot><robot "),
    "error_other_root.urdf": (URDF, "robot", "model"),
    "error_unknown_link.urdf": (URDF, 'child link="upper"', 'child link="uper"'),
    "error_two_links_of_one_name.urdf": (URDF, 'link name="upper"', 'link name="base"'),
    "error_unknown_type.urdf": (URDF, "revolute", "screw"),
    "error_axis_zero.urdf": (URDF, 'axis xyz="0 1 0"', 'axis xyz="0 0 0"'),
    "error_origin_not_numbers.urdf": (URDF, "0 0 0.1", "0 0 1,5"),
    "error_origin_nan.urdf": (URDF, "0 0 0.1", "0 0 nan"),
    "error_limits_swapped.urdf": (URDF, 'upper="2"', 'upper="-2"'),
    "error_negative_speed.urdf": (URDF, 'velocity="3"', 'velocity="-3"'),
    "error_no_child.urdf": (URDF, '<child link="upper"/>', ""),
    "error_mimic_nobody.urdf": (URDF, "<axis", '<mimic joint="q9"/><axis'),
    "error_box_negative.urdf": (URDF, "0.1 0.1 0.1", "0.1 -0.1 0.1"),
    "error_inertia_incomplete.urdf": (URDF, 'ixx="0.1"', ""),
    "error_argument_undefined.xacro": (XACRO, '"${name}"', '"$(arg side)_${name}"'),
    "error_expression.xacro": (XACRO, "0.1 * 3", "0.1 * / 3"),
    "error_include_itself.xacro": (XACRO, '<link name="base"/>', INCLUDE.format("error_include_itself.xacro")),
    "error_include_missing.xacro": (XACRO, '<link name="base"/>', INCLUDE.format("nowhere.xacro")),
    "error_include_not_xml.xacro": (XACRO, '<link name="base"/>', INCLUDE.format("error_not_xml.urdf")),
    "error_macro_loop.xacro": (XACRO, "</xacro:macro>", '<xacro:hinge name="q2"><axis/></xacro:hinge></xacro:macro>'),
    "error_macro_undefined.xacro": (XACRO, '<xacro:macro name="hinge"', '<xacro:macro name="slide"'),
    "error_package_missing.xacro": (XACRO, '<link name="base"/>', '<link name="$(find nowhere)"/>'),
    "error_parameter_missing.xacro": (XACRO, '<xacro:hinge name="q1">', "<xacro:hinge>"),
    "error_property_circle.xacro": (XACRO, "0.1 * 3", "height + 3"),
    "error_property_undefined.xacro": (XACRO, "0 ${height}", "0 ${heigth}"),
    "error_nan.xacro": (XACRO, "0.1 * 3", "float('nan')"),
    "error_unsafe_name.xacro": (XACRO, "0.1 * 3", "__import__('os')"),
    "error_quadratic_coupling.xml": (MJCF, "0 1 0 0 0", "0 1 2 0 0"),
    "error_locked_joint.xml": (MJCF, ' joint2="r"', ""),
    "error_unknown_attribute.xml": (MJCF, 'name="r"', 'name="r" colour="red"'),
    "error_ball_limited.xml": (BALL, '"hinge"', '"ball" range="0 1" limited="true"'),
    "error_screw_joint.sdf": (SDF, "revolute", "screw"),
    "error_unknown_link.sdf": (SDF, "<child>upper", "<child>uper"),
    "error_two_models.sdf": (
        SDF,
        "</sdf>",
        f"{SDF[SDF.index('<model') : SDF.index('</sdf>')].replace('arm', 'b')}</sdf>",
    ),
    "error_pose_circle.sdf": (SDF, "<pose>", '<pose relative_to="upper">'),
    "error_missing_include.sdf": (SDF, "</model>", "<include><uri>model://nowhere</uri></include></model>"),
    "error_placement_frame.sdf": (
        SDF,
        "</model>",
        '<model name="in" placement_frame="f"><link name="l"/></model></model>',
    ),
    "error_limits_swapped.sdf": (SDF, "<upper>1", "<upper>-2"),
    "error_unknown_name.yaml": (YAML, "[q1, base]", "[q7, base]"),
    "error_type_5d.yaml": (YAML, "6d", "5d"),
    "error_types_missing.yaml": (YAML, "[6d]", "[]"),
    "error_no_motor.yaml": (YAML, "[q1]\n", "[]\n"),
    "error_unknown_motor.yaml": (YAML, "name_mot: [q1]", "name_mot: [q2]"),
    "error_alias.yaml": (YAML, "[[q1, base]]", "&a [[q1, base], *a]"),
    "error_one_body.yaml": (YAML, "[q1, base]", "[q1, upper]"),
    "error_joint_type.yaml": (YAML, "[q1]\n", "[q1]\njoint_name: [q1]\njoint_type: [BALL]\n"),
    "error_joint_types_missing.yaml": (YAML, "[q1]\n", "[q1]\njoint_name: [q1]\n"),
    "error_driven_ball.yaml": (YAML, "[q1]\n", "[q1]\njoint_name: [q1]\njoint_type: [SPHERICAL]\n"),
    "error_unknown_key.yaml": (YAML, "name_mot", "motors"),
    "error_not_yaml.yaml": (YAML, "[[q1", "[[q1: {"),
    "error_pair_of_three.yaml": (YAML, "[q1, base]", "[q1, base, upper]"),
    "error_with_itself.yaml": (YAML, "[q1, base]", "[q1, q1]"),
    "error_motor_twice.yaml": (YAML, "name_mot: [q1]", "name_mot: [q1, q1]"),
    "error_no_list.yaml": (YAML, "[6d]", "6d"),
    "error_two_roots.urdf": (URDF, "</robot>", '<link name="alone"/></robot>'),
    "error_two_parents.urdf": (
        URDF,
        "</robot>",
        '<joint name="q2" type="fixed"><parent link="base"/><child link="upper"/></joint></robot>',
    ),
    "error_no_joints.urdf": (URDF, URDF[URDF.index("<joint") : URDF.index("</robot>")], ""),
    "error_unknown_shape.urdf": (URDF, '<box size="0.1 0.1 0.1"/>', '<cone radius="1"/>'),
    "error_no_links.sdf": (SDF, SDF[SDF.index('<link name="base"') : SDF.index("</model>")], ""),
    "error_axis_zero.sdf": (SDF, "<xyz>0 1 0", "<xyz>0 0 0"),
    "error_pose_of_five.sdf": (SDF, "0 0 0.1 0 0 0", "0 0 0.1 0 0"),
    "error_mimic_nobody.sdf": (SDF, "</limit>", '</limit><mimic joint="q9"/>'),
    "error_frame_on_nothing.sdf": (SDF, "</model>", '<frame name="f" attached_to="g"/></model>'),
    "error_child_world.sdf": (SDF, "<child>upper", "<child>world"),
    "error_mocap.xml": (BALL, 'body name="a"', 'body name="a" mocap="true"'),
    "error_size_nan.xml": (BALL, 'size="0.1"', 'type="ellipsoid" size="0.1 0.1 nan"'),
    "error_no_joints.xml": (BALL, BALL[BALL.index("<body ") : BALL.index("</worldbody>")], ""),
    "error_spatial_tendon.xml": (
        MJCF,
        '<equality><joint joint1="q" joint2="r" polycoef="0 1 0 0 0"/>',
        '<tendon><spatial name="t"><site site="s"/><site site="u"/></spatial></tendon><equality><tendon tendon1="t"/>',
    ),
    "error_not_usda.usda": (USD, "#usda 1.0", "#usda 9.9"),
    "error_cut_off.usda": (USD, USD[-200:], ""),
    "error_no_joints.usda": (USD, USD[USD.index("    def PhysicsRevoluteJoint") :], "}\n"),
    "error_no_bodies.usda": (USD, '"PhysicsRigidBodyAPI", ', ""),
    "error_unknown_body.usda": (USD, "rel physics:body1 = </fourbar/crank>", "rel physics:body1 = </fourbar/krank>"),
    "error_scaled_body.usda": (
        USD,
        'double3 xformOp:translate = (0, 10, 0)\n        uniform token[] xformOpOrder = ["xformOp:translate"]',
        'double3 xformOp:scale = (1, 2, -1)\n        uniform token[] xformOpOrder = ["xformOp:scale"]',
    ),
    "error_distance_joint.usda": (USD, 'PhysicsRevoluteJoint "wrist"', 'PhysicsDistanceJoint "wrist"'),
    "error_limits_swapped.usda": (USD, "physics:upperLimit = 57.29578", "physics:upperLimit = -90"),
    "error_rotation_of_nothing.usda": (USD, "localRot1 = (0, 1, 0, 0)", "localRot1 = (0, 0, 0, 0)"),
    "error_limit_of_three_numbers.usda": (
        USD,
        "float physics:lowerLimit = -57.29578",
        "point3f physics:lowerLimit = (1, 2, 3)",
    ),
    "error_unknown_type.usda": (USD, "float physics:lowerLimit", "flaot physics:lowerLimit"),
    "error_missing_vertices.usda": (USD, "[0, 1, 2, 0", "[0, 1, 9, 0"),
    "error_mimic_of_a_vendor.usda": (
        USD,
        'PhysicsRevoluteJoint "elbow"\n',
        'PhysicsRevoluteJoint "elbow" (\n        prepend apiSchemas = ["PhysxMimicJointAPI:rotZ"]\n    )\n',
    ),
    "error_not_step.step": (STEP, "ISO-10303-21;", "solid"),
    "error_cut_off.step": (STEP, STEP[len(STEP) // 2 :], ""),
    "error_no_unit.step": (STEP, "LENGTH_UNIT()", "LENGHT_UNIT()"),
    "error_one_body.step": ((HERE.parents[1] / "data/cad/metre.step").read_text(), "", ""),
    "error_no_solids.step": (STEP, STEP[STEP.index("DATA;") : STEP.index("ENDSEC;", STEP.index("DATA;"))], "DATA;\n"),
}

for name, (good, old, new) in BAD.items():
    assert old in good, name
    (HERE / name).write_text(good.replace(old, new) if old else good)
for suffix, good in (("urdf", URDF), ("xml", MJCF), ("sdf", SDF)):
    (HERE / f"good.{suffix}").write_text(good)
