"""A small repository of robots without a fault, and its faults, one for each rule of `twin check`."""

from __future__ import annotations

from pathlib import Path

ARM = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base">
    <visual><geometry><box size="0.2 0.2 0.1"/></geometry></visual>
  </link>
  <link name="upper">
    <inertial>
      <origin xyz="0.1 0 0"/>
      <mass value="1.5"/>
      <inertia ixx="0.0021" ixy="0" ixz="0" iyy="0.0056" iyz="0" izz="0.0061"/>
    </inertial>
    <visual>
      <origin xyz="0.1 0 0"/>
      <geometry><box size="0.2 0.1 0.08"/></geometry>
    </visual>
    <collision>
      <origin xyz="0.1 0 0"/>
      <geometry><box size="0.2 0.1 0.08"/></geometry>
    </collision>
  </link>
  <link name="fore">
    <visual>
      <geometry><mesh filename="package://arm_description/meshes/fore.stl"/></geometry>
    </visual>
  </link>
  <joint name="shoulder" type="revolute">
    <parent link="base"/>
    <child link="upper"/>
    <origin xyz="0 0 0.1" rpy="0 0 0"/>
    <axis xyz="0 0 1"/>
    <limit lower="-1.5" upper="1.5" velocity="2" effort="30"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/>
    <child link="fore"/>
    <origin xyz="0.2 0 0" rpy="0 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="2" effort="30"/>
  </joint>
</robot>
"""

TETRAHEDRON = """solid t
facet normal 0 0 -1
outer loop
vertex 0 0 0
vertex 0 0.1 0
vertex 0.1 0 0
endloop
endfacet
facet normal 0 -1 0
outer loop
vertex 0 0 0
vertex 0.1 0 0
vertex 0 0 0.1
endloop
endfacet
facet normal -1 0 0
outer loop
vertex 0 0 0
vertex 0 0 0.1
vertex 0 0.1 0
endloop
endfacet
facet normal 1 1 1
outer loop
vertex 0.1 0 0
vertex 0 0.1 0
vertex 0 0 0.1
endloop
endfacet
endsolid t
"""

_SECOND = '<joint name="elbow" type="revolute">'
_TENSOR = 'ixx="0.0021" ixy="0" ixz="0" iyy="0.0056" iyz="0" izz="0.0061"'

FAULTS = {
    "file/malformed": ("</robot>", "</robo>"),
    "mesh/missing": ("fore.stl", "Fore.stl"),
    "mesh/outside": ("package://arm_description", "package://other_description"),
    "inertia/mass": ('mass value="1.5"', 'mass value="-1.5"'),
    "inertia/positive": ('ixy="0"', 'ixy="0.02"'),
    "inertia/triangle": ('izz="0.0061"', 'izz="0.0091"'),
    "inertia/rounded": (_TENSOR, 'ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.004"'),
    "inertia/zero": (_TENSOR, 'ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"'),
    "inertia/centre": ('<origin xyz="0.1 0 0"/>\n      <mass', '<origin xyz="100 0 0"/>\n      <mass'),
    "inertia/size": (_TENSOR, 'ixx="2.1" ixy="0" ixz="0" iyy="5.6" iyz="0" izz="6.1"'),
    "inertia/density": ('mass value="1.5"', 'mass value="1500"'),
    "limits/order": ('lower="-2" upper="2"', 'lower="2" upper="-2"'),
    "limits/fixed": ('lower="-2" upper="2"', 'lower="1" upper="1"'),
    "limits/missing": ('<limit lower="-2" upper="2" velocity="2" effort="30"/>', ""),
    "limits/velocity": ('upper="2" velocity="2"', 'upper="2" velocity="0"'),
    "limits/effort": ('effort="30"', 'effort="-30"'),
    "limits/degrees": ('lower="-2" upper="2"', 'lower="-120" upper="120"'),
    "limits/zero": ('lower="-2" upper="2"', 'lower="0.5" upper="2"'),
    "limits/soft": (
        '<limit lower="-2"',
        '<safety_controller k_velocity="1" soft_lower_limit="-3" soft_upper_limit="3"/><limit lower="-2"',
    ),
    "origin/degrees": ('xyz="0.2 0 0" rpy="0 0 0"', 'xyz="0.2 0 0" rpy="0 0 90"'),
    "axis/zero": ('axis xyz="0 1 0"', 'axis xyz="0 0 0"'),
    "mimic/leader": ('<limit lower="-2"', '<mimic joint="sholder"/><limit lower="-2"'),
    "names/duplicate": (_SECOND, '<joint name="shoulder" type="revolute">'),
    "names/unknown": ('<child link="fore"/>', '<child link="forearm"/>'),
    "names/tree": (
        '<parent link="upper"/>\n    <child link="fore"/>',
        '<parent link="fore"/>\n    <child link="upper"/>',
    ),
    "audit/fault": (
        "</robot>",
        '<transmission name="t"><type>transmission_interface/SimpleTransmission</type><joint name="none"/>'
        '<actuator name="m"/></transmission></robot>',
    ),
}
"""{rule: (text of the arm, the text that makes the fault)}."""


def repository(folder: Path, text: str = ARM) -> Path:
    """Write a package with one arm into a folder, and return the file of the arm."""
    package = folder / "arm_description"
    (package / "urdf").mkdir(parents=True)
    (package / "meshes").mkdir()
    (package / "package.xml").write_text("<package><name>arm_description</name></package>\n", encoding="utf-8")
    (package / "meshes/fore.stl").write_text(TETRAHEDRON, encoding="utf-8")
    file = package / "urdf/arm.urdf"
    file.write_text(text, encoding="utf-8")
    return file


def faulty(rule: str) -> tuple[str, int]:
    """Return the text of the arm with the fault of a rule, and the line on which it is."""
    old, new = FAULTS[rule]
    assert old in ARM
    at = ARM.index(old)
    return ARM.replace(old, new, 1), ARM.count("\n", 0, at) + 1
