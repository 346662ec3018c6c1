"""Newton (on the CPU): where its forward kinematics puts the links of a USD stage at given joint values.

    read_newton.py

Reads paths of jobs, one a line, and answers each with a line. Job and answer are those of read_physx.py, "frames" only.
"""

import json
import sys
from pathlib import Path

import newton
import numpy as np


def answer(job):
    builder = newton.ModelBuilder()
    builder.add_usd(job["stage"], load_visual_shapes=False, skip_mesh_approximation=True)
    model = builder.finalize(device="cpu")
    places = {label.rsplit("/", 1)[-1]: i for i, label in enumerate(model.joint_label)}
    starts = model.joint_q_start.numpy()
    links = [label.rsplit("/", 1)[-1] for label in model.body_label]
    poses = []
    for frame in job["frames"]:
        q = model.joint_q.numpy().copy()
        for name, value in frame.items():
            values = value if isinstance(value, list) else [value]
            q[starts[places[name]] : starts[places[name]] + len(values)] = values
        model.joint_q.assign(q.astype(np.float32))
        state = model.state()
        newton.eval_fk(model, model.joint_q, model.joint_qd, state)
        poses.append(state.body_q.numpy().tolist())
    return {"links": {name: [row[i] for row in poses] for i, name in enumerate(links)}}


for line in sys.stdin:
    print(json.dumps(answer(json.loads(Path(line.strip()).read_text()))), flush=True)
