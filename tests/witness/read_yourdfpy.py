"""yourdfpy: where it puts the links of a URDF at joint values.

    read_yourdfpy.py job.json

The job: {"urdf", "base", "frames": [{joint: value}]}; the answer is that of read_physx.py, "links" only, with
"unnamed": joints that no frame names.
"""

import json
import sys
from pathlib import Path

import yourdfpy

job = json.loads(Path(sys.argv[1]).read_text())
robot = yourdfpy.URDF.load(job["urdf"], load_meshes=False, build_collision_scene_graph=False)
links = {name: [] for name in robot.link_map}
for frame in job["frames"]:
    robot.update_cfg({name: frame[name] for name in robot.actuated_joint_names if name in frame})
    for name, rows in links.items():
        rows.append(robot.get_transform(name, job["base"]).tolist())
unnamed = sorted(set(robot.actuated_joint_names) - set(job["frames"][0]))
print(json.dumps({"links": links, "unnamed": unnamed}), flush=True)
