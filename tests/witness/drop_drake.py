"""Drake: where a ring that falls on a board comes to rest.

    drop_drake.py job.json

The job: {"boxes": [{"half", "p"}], "pegs": [{"foot", "end", "radius"}] (round at both ends, from foot to end), "ring":
{"radius", "wire", "mass"}, "friction", "starts": [[x y z qw qx qy qz]], "seconds"}, in m, kg and s, z up. The answer:
{"rests": [[x y z qw qx qy qz]], "speeds": [m/s at the end], "version"}.
"""

import importlib.metadata
import json
import math
import sys
from pathlib import Path

import numpy as np
from pydrake.geometry import Box, Capsule
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction, DiscreteContactApproximation
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

STEP, AROUND = 5e-4, 40
job = json.loads(Path(sys.argv[1]).read_text())
rough = CoulombFriction(job["friction"], job["friction"])


def between(a, b, radius):
    """Return (shape, pose) of a capsule whose round ends reach the points a and b."""
    way = np.subtract(b, a)
    length = float(np.linalg.norm(way))
    X = RigidTransform(RotationMatrix.MakeFromOneVector(way / length, 2), np.add(a, b) / 2)
    return Capsule(radius, length - 2 * radius), X


def rest(start):
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, STEP)
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kLagged)
    world = plant.world_body()
    for k, box in enumerate(job["boxes"]):
        plant.RegisterCollisionGeometry(
            world, RigidTransform(box["p"]), Box(*(2 * h for h in box["half"])), f"b{k}", rough
        )
    for k, peg in enumerate(job["pegs"]):
        shape, X = between(peg["foot"], peg["end"], peg["radius"])
        plant.RegisterCollisionGeometry(world, X, shape, f"p{k}", rough)
    radius, wire, mass = (job["ring"][n] for n in ("radius", "wire", "mass"))
    across, along = radius**2 / 2 + 5 / 8 * wire**2, radius**2 + 3 / 4 * wire**2
    body = plant.AddRigidBody("ring", SpatialInertia(mass, np.zeros(3), UnitInertia(across, across, along)))
    corner = radius / math.cos(math.pi / AROUND)
    for k in range(AROUND):
        ends = [
            [corner * math.cos(a), corner * math.sin(a), 0] for a in (2 * math.pi / AROUND * (k + i) for i in (0, 1))
        ]
        middle, way = np.mean(ends, axis=0), np.subtract(*ends)
        length = float(np.linalg.norm(way))
        X = RigidTransform(RotationMatrix.MakeFromOneVector(way / length, 2), middle)
        plant.RegisterCollisionGeometry(body, X, Capsule(wire, length), f"r{k}", rough)
    plant.Finalize()
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    p, q = start[:3], start[3:]
    plant.SetPositions(context, [*q, *p])
    simulator.AdvanceTo(job["seconds"])
    found, speeds = plant.GetPositions(context), plant.GetVelocities(context)
    return [*found[4:], *found[:4]], float(np.linalg.norm(speeds[3:]))


rests = [rest(start) for start in job["starts"]]
answer = {"rests": [r for r, _ in rests], "speeds": [s for _, s in rests]}
print(json.dumps(answer | {"version": f"drake {importlib.metadata.version('drake')}"}), flush=True)
