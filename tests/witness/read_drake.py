"""Drake: where it puts the links of a URDF at given joint values.

    read_drake.py job.json

The job: {"urdf", "base", "frames": [{joint: value}]}; the answer is that of read_physx.py, "links" only.
"""

import json
import sys
from pathlib import Path

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

job = json.loads(Path(sys.argv[1]).read_text())
plant = MultibodyPlant(0.0)
(model,) = Parser(plant).AddModels(job["urdf"])
plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(job["base"], model))
plant.Finalize()
context = plant.CreateDefaultContext()
bodies = [plant.get_body(i) for i in plant.GetBodyIndices(model)]
links = {body.name(): [] for body in bodies}
for frame in job["frames"]:
    q = plant.GetPositions(context)
    for name, value in frame.items():
        q[plant.GetJointByName(name, model).position_start()] = value
    plant.SetPositions(context, q)
    for body in bodies:
        X = plant.EvalBodyPoseInWorld(context, body)
        q = X.rotation().ToQuaternion()
        links[body.name()].append([*X.translation().tolist(), q.x(), q.y(), q.z(), q.w()])
print(json.dumps({"links": links}), flush=True)
