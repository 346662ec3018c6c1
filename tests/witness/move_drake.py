"""Drake: how an arm moves under given efforts.

    move_drake.py job.json

The job: {"urdf", "base", "joints": [names], "follow": {joint: {driven joint: ratio}}, "rotor" (n, n), "q" (n,) at the
start, with rates zero, "tick" in s, rows (k, n) of "wanted", "rates" and "feed" for each tick, "kp" and "kd" (n,)}, in
SI, and "viscous" (n,). Efforts are feed + kp (wanted - q) + kd (rates - qd), constant during a tick, and minus viscous
friction times qd, which is not. Drake gives mass matrix, bias and
gravity of the tree; passive joints follow the driven ones; integration is by the Runge-Kutta method of fourth order,
one step a tick. The answer: {"q": (k, n) after each tick, "version"}.
"""

import importlib.metadata
import json
import sys
from pathlib import Path

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

job = json.loads(Path(sys.argv[1]).read_text())
plant = MultibodyPlant(0.0)
(model,) = Parser(plant).AddModels(job["urdf"])
plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(job["base"], model))
plant.mutable_gravity_field().set_gravity_vector([0, 0, -9.81])
plant.Finalize()
context = plant.CreateDefaultContext()
places = [plant.GetJointByName(n, model).position_start() for n in job["joints"]]
columns = [plant.GetJointByName(n, model).velocity_start() for n in job["joints"]]
gain_q, gain_v = np.zeros((plant.num_positions(), len(places))), np.zeros((plant.num_velocities(), len(places)))
for i, (place, column) in enumerate(zip(places, columns, strict=True)):
    gain_q[place, i] = gain_v[column, i] = 1
for name, driven in job["follow"].items():
    joint = plant.GetJointByName(name, model)
    for other, ratio in driven.items():
        i = job["joints"].index(other)
        gain_q[joint.position_start(), i] = gain_v[joint.velocity_start(), i] = ratio
rotor, viscous = np.array(job["rotor"]), np.array(job["viscous"])


def forward(q, v, efforts):
    plant.SetPositions(context, gain_q @ q)
    plant.SetVelocities(context, gain_v @ v)
    M = gain_v.T @ plant.CalcMassMatrix(context) @ gain_v + rotor
    bias = plant.CalcBiasTerm(context) - plant.CalcGravityGeneralizedForces(context)
    return np.linalg.solve(M, efforts - viscous * v - gain_v.T @ bias)


h, q, out = job["tick"], np.array(job["q"], float), []
v = np.zeros_like(q)
kp, kd = np.array(job["kp"]), np.array(job["kd"])
for wanted, rates, feed in zip(*(np.array(job[n]) for n in ("wanted", "rates", "feed")), strict=True):
    efforts = feed + kp * (wanted - q) + kd * (rates - v)
    a1 = forward(q, v, efforts)
    a2 = forward(q + h / 2 * v, v + h / 2 * a1, efforts)
    a3 = forward(q + h / 2 * v + h * h / 4 * a1, v + h / 2 * a2, efforts)
    a4 = forward(q + h * v + h * h / 2 * a2, v + h * a3, efforts)
    q, v = q + h * v + h * h / 6 * (a1 + a2 + a3), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    out.append(q.tolist())
print(json.dumps({"q": out, "version": importlib.metadata.version("drake")}), flush=True)
