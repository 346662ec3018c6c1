"""Drake as its users start it: an MJCF, its parser as it is; loops are the ball constraints that it makes of connects.

    read_drake_stranger.py job.json

The job: {"mjcf", "step", "drives": {joint: [stiffness, damping]}, "times", "targets": {joint: values},
"ties": [[body, point, body, point, free]]}. "free": the direction of the first body in which a tie may slide, (0, 0, 0)
if in none. Drake reads no actuators of the kind `general`, so that drives with these gains are added, as its users do;
they go for the targets, m or rad, in time. Prints {"start", "held", "moved", "constraints"}: how far the ties,
points on two bodies in m, are open as loaded and later, how far any body goes, and how many constraints there are.
"""

import json
import logging
import sys
from pathlib import Path

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.analysis import Simulator

logging.getLogger("drake").setLevel(logging.ERROR)  # it tells of every mesh that it has no collision filters
job = json.loads(Path(sys.argv[1]).read_text())
plant = MultibodyPlant(job["step"])
plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
(model,) = Parser(plant).AddModels(job["mjcf"])
for name, (stiffness, damping) in job["drives"].items():
    actuator = plant.AddJointActuator(name, plant.GetJointByName(name, model))
    actuator.set_controller_gains(PdControllerGains(p=stiffness, d=damping))
plant.Finalize()
simulator = Simulator(plant)
context = simulator.get_mutable_context()
ties = [
    (plant.GetBodyByName(a), np.array(p), plant.GetBodyByName(b), np.array(q), np.array(free))
    for a, p, b, q, free in job["ties"]
]
bodies = [plant.get_body(i) for i in plant.GetBodyIndices(model)]


def gap():
    """Return how far the farthest tie is open, m; of one that may slide, how far it is off its line."""
    apart = []
    for a, p, b, q, free in ties:
        T = a.EvalPoseInWorld(context)
        off, way = T @ p - b.EvalPoseInWorld(context) @ q, T.rotation() @ free
        apart.append(np.linalg.norm(off - way * (way @ off)))
    return float(max(apart, default=0.0))


def places():
    return np.array([b.EvalPoseInWorld(context).translation() for b in bodies])


answer = {"start": gap(), "constraints": plant.num_constraints()}
before, held, moved = places(), 0.0, 0.0
targets = np.array([job["targets"][name] for name in job["drives"]])
desired = plant.get_desired_state_input_port(model)
for t in np.arange(job["step"], job["times"][-1], job["step"]):
    wanted = [np.interp(t, job["times"], values) for values in targets]
    desired.FixValue(context, np.concatenate([wanted, np.zeros(len(wanted))]))
    simulator.AdvanceTo(float(t))
    if round(t / job["step"]) % 10 == 0:
        held, moved = max(held, gap()), max(moved, float(np.abs(places() - before).max()))
print(json.dumps(answer | {"held": held, "moved": moved}), flush=True)
