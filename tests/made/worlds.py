"""One World of each kind. Run as a program, it prints a digest of the results of each, to compare processes."""

from __future__ import annotations

import hashlib
import json
import sys
from functools import cache
from pathlib import Path

import numpy as np

import twin
from made.field import Field
from made.loops import two_links
from twin.core import spatial
from twin.core.units import DEG, MM
from twin.kinematics import compile_formula
from twin.model.body import Mesh
from twin.model.deformable import Deformable
from twin.model.scene import load_scene
from twin.robots import load_formula
from twin.simulation import scene_play, trial
from twin.simulation.controllers.teleoperation import Clutch, Gains, Teleoperation
from twin.simulation.devices.hand import Goal, ScriptedHand
from twin.simulation.limits import JointLimits
from twin.simulation.plants.kinematic import Kinematic
from twin.simulation.world import Block, Hazard, Placed, World

ROOT = Path(__file__).parents[2]

UNITS = np.array([MM, MM, MM, DEG, MM])
HOME = np.array([50, 50, 50, 0, 20.25077]) * UNITS
LIMITS = JointLimits(
    np.array([0, 0, 0, -60, 0]) * UNITS,
    np.array([100, 100, 100, 60, 50]) * UNITS,
    np.array([10, 10, 10, 15, 10]) * UNITS,
)
SCALE = np.array([0.1, 0.1, 0.1, 1.0, 1.0])


@cache
def sher_equations():
    return compile_formula(load_formula("sher"))


def controller(clutch: Clutch = "corrected"):
    return Teleoperation(Gains(scale=SCALE), 1 / 200, clutch)


def goal_beside_home(kin, mm=(0.8, -0.5, 0.6), tolerance=50e-6):
    T = kin.forward(HOME)
    T[:3, 3] += np.array(mm) * MM
    return Goal("there", T, tolerance)


def sher(device: Block | None = None, hazards: tuple[Hazard, ...] = (), seed=0, mm=(0.3, -0.2, 0.2)) -> World:
    """Return a World with the robot SHER: a scripted hand (or `device`) moves it to a goal near home."""
    kin = sher_equations()
    hand = ScriptedHand("sher", kin, [goal_beside_home(kin, mm)], SCALE, 1 / 200, seed)
    return trial.world(kin, HOME, LIMITS, controller(), device or hand, hazards=hazards)


@cache
def actors() -> tuple[scene_play.Actor, ...]:
    """Return the three robots of the scene vsrs with their plans."""
    found = []
    for place in load_scene(ROOT / "cad/vsrs/scene.toml").places:
        robot = twin.load(place.name)
        protocol = robot.protocol(place.protocol)
        plan, mechanism = twin.plan(robot, protocol), robot.bound(protocol).mechanism
        found.append(scene_play.Actor(place, mechanism, plan, scene_play.trocars_of(place, mechanism, plan)))
    return tuple(found)


def vsrs() -> World:
    """Return a World with all robots of the scene vsrs; one tick is 20 ms."""
    return scene_play.world(actors(), dt=0.02)


def cloth(n=5) -> Deformable:
    """Return a square cloth of n x n vertices in the hand of a two-link arm."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(0, 0.1, n), np.linspace(0, 0.1, n)))
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    triangles = np.concatenate(
        [np.stack([corner, corner + 1, corner + n], 1), np.stack([corner + 1, corner + n + 1, corner + n], 1)]
    )
    mesh = Mesh("square", np.stack([x, y, 0 * x], 1), triangles.astype(np.int32))
    return Deformable("cloth", mesh, "arm", "hand")


def wave(rest, t):
    """Return the vertices at time `t` in s: a wave of all rows except the first."""
    return rest + np.outer(rest[:, 1] * np.sin(20 * t + 30 * rest[:, 0]), [0, 0, 1])


class Swing(Block):
    """A controller that swings the joints."""

    def __init__(self):
        self.outputs = {"arm.command": np.zeros(2)}

    def step(self, signals, t, dt):
        return {"arm.command": 0.3 * np.sin(2 * np.pi * t + np.array([0.0, 0.5]))}


def waving() -> World:
    """Return a World with a two-link arm, 1 m from the origin, that holds a cloth in its hand."""
    free = np.full(2, np.inf)
    return World(
        robots=[Placed("arm", two_links(), spatial.pose(p=[1.0, 0, 0]))],
        deformables=[cloth()],
        controllers=[Swing()],
        plants=[Kinematic("arm", np.zeros(2), JointLimits(-free, free, np.full(2, 1.0))), Field(cloth(), wave)],
    )


KINDS = {"sher": sher, "vsrs": vsrs, "waving": waving}


def happened(world: World, ticks=600) -> str:
    """Run a World and return a digest of its results: its recording, and its first and last frame."""
    frames = [world.frame()]
    world.step(ticks)
    frames.append(world.frame())
    told = hashlib.sha256(world.recording().to_bytes())
    for frame in frames:
        for links in frame.link_poses.values():
            told.update(np.array(list(links.values())).tobytes())
        for vertices in frame.fields.values():
            told.update(vertices.tobytes())
    return told.hexdigest()


if __name__ == "__main__":
    json.dump({name: happened(make()) for name, make in KINDS.items()}, sys.stdout)
