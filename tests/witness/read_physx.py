"""PhysX (ovphysx, on the CPU): where it puts links at given joint values, and how it moves them when driven.

    read_physx.py job.json

The job: {"stage", "robot": path without its first slash, "frames": [{joint: value, or quaternion xyzw of a ball}],
"rate": steps a second, "joints": [names], "targets": [[value of each joint] each step], "every": steps between two
answers}.
Prints {"start": {link: [7]}, "links": {link: [[7] each frame]}, "run": {link: [[7] each answer]}}; a pose is
x y z qx qy qz qw in the world, m. With "robots" instead, several that only rest: {robot: {"start", "run"}}.
"""

import json
import math
import os
import sys
from pathlib import Path

import numpy as np
from ovphysx import PhysX
from ovphysx.types import TensorType


def turn(quaternion):
    """Return the rotation vector of a unit quaternion xyzw: PhysX's three coordinates of a ball."""
    x, y, z, w = quaternion if quaternion[3] >= 0 else [-c for c in quaternion]
    n = math.sqrt(x * x + y * y + z * z)
    return [0.0, 0.0, 0.0] if n < 1e-12 else [2 * math.atan2(n, w) * c / n for c in (x, y, z)]


class Articulation:
    """One robot on a stage."""

    def __init__(self, physx, robot):
        self.physx, self._robot = physx, f"/{robot}"
        self.pose = self._bind(TensorType.ARTICULATION_LINK_POSE)
        self.q = self._bind(TensorType.ARTICULATION_DOF_POSITION)
        self.target = self._bind(TensorType.ARTICULATION_DOF_POSITION_TARGET)
        self.speed = self._bind(TensorType.ARTICULATION_DOF_VELOCITY_TARGET)
        self.links, self.dofs = list(self.pose.body_names), list(self.q.dof_names)

    def _bind(self, kind):
        return self.physx.create_tensor_binding(pattern=self._robot, tensor_type=kind)

    def get(self, binding):
        """Return what a binding holds, (1, ...)."""
        out = np.zeros(binding.shape, np.float32)
        binding.read(out)
        return out

    def place(self, frame):
        """Put joints at values and return the poses of all links."""
        values = self.get(self.q)
        for name, value in frame.items():
            if isinstance(value, list):
                for i, part in enumerate(turn(value)):
                    values[0, self.dofs.index(f"{name}:{i}")] = part
            else:
                values[0, self.dofs.index(name)] = value
        self.q.write(values)
        self.physx.update_articulations_kinematic()
        return self.get(self.pose)[0].tolist()

    def drive(self, names, targets, rate, every):
        """Follow targets, one row a step, with their speeds; return poses after every so many steps."""
        columns = [self.dofs.index(n) for n in names]
        rows = np.array(targets)
        speeds = np.gradient(rows, 1 / rate, axis=0) if len(rows) > 1 else np.zeros_like(rows)
        target, speed, out = self.get(self.target), self.get(self.speed), []
        for k, (row, rates) in enumerate(zip(rows, speeds, strict=True)):
            target[0, columns], speed[0, columns] = row, rates
            self.target.write(target)
            self.speed.write(speed)
            self.physx.step_sync(1 / rate, k / rate)
            if (k + 1) % every == 0:
                out.append(self.get(self.pose)[0].tolist())
        return out


def opened(stage):
    # Its first thread waits for the others by giving way without end. On one processor they take turns at once: two
    # thirds of the time, and a tenth where other programs run, with the same numbers.
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    physx = PhysX(device="cpu")
    physx.add_usd(stage)
    physx.wait_all()
    return physx


def rest(physx, robots, steps, rate, every):
    """Step without touching anything; return the poses of each robot after every so many steps."""
    out = [[] for _ in robots]
    for k in range(steps):
        physx.step_sync(1 / rate, k / rate)
        if (k + 1) % every == 0:
            for robot, rows in zip(robots, out, strict=True):
                rows.append(robot.get(robot.pose)[0].tolist())
    return out


def by_link(links, rows):
    return {name: [row[i] for row in rows] for i, name in enumerate(links)}


def started(robot):
    return {"start": by_link(robot.links, [robot.get(robot.pose)[0].tolist()])}


job = json.loads(Path(sys.argv[1]).read_text())
physx = opened(job["stage"])
if "robots" in job:
    robots = {name: Articulation(physx, name) for name in job["robots"]}
    answer = {name: started(robot) for name, robot in robots.items()}
    runs = rest(physx, list(robots.values()), job["steps"], job["rate"], job["every"])
    for (name, robot), run in zip(robots.items(), runs, strict=True):
        answer[name]["run"] = by_link(robot.links, run)
else:
    robot = Articulation(physx, job["robot"])
    answer = started(robot)
    if "frames" in job:
        answer["links"] = by_link(robot.links, [robot.place(f) for f in job["frames"]])
    elif "targets" in job:
        answer["run"] = by_link(robot.links, robot.drive(job["joints"], job["targets"], job["rate"], job["every"]))
    else:
        (run,) = rest(physx, [robot], job["steps"], job["rate"], job["every"])
        answer["run"] = by_link(robot.links, run)
print(json.dumps(answer), flush=True)
os._exit(0)  # its own way out complains about a stage that it still holds
