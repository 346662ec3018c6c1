"""yourdfpy reads a URDF and writes it again: resave_yourdfpy.py in.urdf out.urdf."""

import json
import sys

import yourdfpy

source, target = sys.argv[1:]
robot = yourdfpy.URDF.load(source, load_meshes=False, build_scene_graph=False, build_collision_scene_graph=False)
robot.write_xml_file(target)
print(json.dumps({"joints": len(robot.joint_map)}), flush=True)
