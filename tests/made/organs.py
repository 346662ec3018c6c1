"""Soft bodies of simple shapes, and rods that push them."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import trimesh

from twin.cad.build import read_props
from twin.core import spatial
from twin.core.units import MM
from twin.model.body import Body, Mesh
from twin.model.deformable import Bend
from twin.model.scene import load_scene
from twin.model.surface import Surface
from twin.model.tissue import Pin, Tissue
from twin.simulation import tissue_scene
from twin.simulation.plants.tissue import Organs, Tool
from twin.ui.headset.scene_frame import QUANTISATION_STEPS

ROOT = Path(__file__).parents[2]

RADIUS = 4 * MM
"""Radius of the rod and of its round end."""


def tissue(name, mesh, below, cells=(2, 2, 2), edge=np.inf, **more):
    """Return the tissue of a mesh; its nodes with z below `below` in m are fixed."""
    numbers = {"young": 5e3, "poisson": 0.4, "damping": 0.05, "density": 1000.0, "friction": 0.1, **more}
    low, high = np.array([-1.0, -1, -1]), np.array([1.0, 1, below])
    return Tissue(
        name, Surface(name, mesh.vertices, mesh.faces, edge), cells, pins=(Pin("floor", low, high),), **numbers
    )


def block(size=(0.12, 0.1, 0.08), **more):
    """Return a block on the floor, z = 0; its edges in m differ, so that its principal axes are unique."""
    box = trimesh.creation.box(size)
    box.apply_translation([0, 0, size[2] / 2])
    return tissue("block", box, 1e-4, **{"edge": 0.02, **more})


def ball(**more):
    """Return an ellipsoid on the floor, z = 0, symmetric about the planes x = 0 and y = 0; its top is at z = 80 mm."""
    sphere = trimesh.creation.icosphere(3)
    sphere.apply_scale([0.08, 0.06, 0.04])
    sphere.apply_translation([0, 0, 0.04])
    return tissue("ball", sphere, 1e-3, **more)


def corner(**more):
    """Return a wall on one end of a slab, which lies on the floor, z = 0; half of its grid is empty."""
    outline = np.array([[0, 0], [0.12, 0], [0.12, 0.03], [0.03, 0.03], [0.03, 0.12], [0, 0.12]])  # x and z in m
    front = np.insert(outline, 1, 0.0, axis=1)
    back = np.insert(outline, 1, 0.04, axis=1)
    triangles = []
    for a, b, c in ((0, 1, 2), (0, 2, 3), (0, 3, 5), (3, 4, 5)):
        triangles += [(a, b, c), (a + 6, c + 6, b + 6)]
    for a in range(6):
        b = (a + 1) % 6
        triangles += [(a, a + 6, b), (b, a + 6, b + 6)]
    mesh = trimesh.Trimesh(np.concatenate([front, back]), triangles)
    return tissue("corner", mesh, 1e-4, **{"cells": (4, 1, 4), "edge": np.inf, "upright": True, **more})


@functools.cache
def rod(length=0.2):
    """Return a vertical rod with a length in m; its lower round end is at its origin."""
    capsule = trimesh.creation.capsule(length - 2 * RADIUS, RADIUS)
    capsule.apply_translation([0, 0, -capsule.bounds[0][2]])
    return Body("rod", (Mesh("rod", np.array(capsule.vertices), np.array(capsule.faces, np.int32)),))


@functools.cache
def plate():
    """Return a plate, 200 mm x 200 mm x 10 mm, whose lower face is at z = 0."""
    box = trimesh.creation.box((0.2, 0.2, 0.01))
    box.apply_translation([0, 0, 0.005])
    return Body("plate", (Mesh("plate", np.array(box.vertices), np.array(box.faces, np.int32)),))


def at(*p):
    """Return the pose (4, 4) without rotation at a point in m."""
    return spatial.pose(p=np.array(p, float))


def pushed(organ, body, start, depths, steps=100, hold=60):
    """Push a body down from `start` by each of `depths` in m in sequence; yield the organs after each."""
    organs = Organs([organ], [Tool("tool", body)], [at(*start)])
    last = 0.0
    for depth in depths:
        for part in [*np.linspace(last, depth, steps), *[depth] * hold]:
            organs.step([at(*(np.array(start) - [0, 0, part]))])
        last = depth
        yield organs


@functools.cache
def abdomen():
    """Return the tissues of the scene vsrs."""
    scene = load_scene(ROOT / "cad/vsrs/scene.toml")
    assert scene.anatomy is not None
    return tissue_scene.tissues(scene, read_props(scene.file.parent / scene.anatomy.file))


def torn(frame):
    """Return whether a frame mixes vertices of several times: no node positions of the organ's grid give them."""
    for tissue, v in zip(abdomen(), frame.fields, strict=True):
        off = tissue.weights @ (_back(tissue.name) @ v) - v
        if (
            v.shape != tissue.surface.vertices.shape
            or np.abs(off).max() > 2 * np.ptp(v, axis=0).max() / QUANTISATION_STEPS
        ):
            return True
    return False


@functools.cache
def _back(name):
    return np.linalg.pinv(next(t.weights for t in abdomen() if t.name == name))


SHORT = 0.08
"""Length in m of a rod that fits in the abdomen without contact with its wall."""


class Rods:
    """Rods in the abdomen, one above the middle of each organ and of the wall; all move down together."""

    def __init__(self, tissues):
        self.tissues = tissues
        self.starts = []
        for t in tissues:
            v = t.surface.vertices
            middle = v.mean(axis=0)[:2]
            far = np.linalg.norm(v[:, :2] - middle, axis=1)
            self.starts.append(np.append(middle, v[far <= max(2 * RADIUS, far.min()), 2].max() + 5 * MM))
        self.links = {t.name: [rod(SHORT)] for t in tissues}
        self.organs = Organs(tissues, [Tool(t.name, rod(SHORT)) for t in tissues], self.poses(0.0))

    def poses(self, depth):
        return [at(*(p - [0, 0, depth])) for p in self.starts]


def wander(seed, seconds, period=8e-3):
    """Yield poses of three short rods: smooth motion at up to 0.3 m/s in the abdomen, with rare jumps.

    The rods stay above the middle of the organs, because the lower faces of the organs are fixed.
    """
    rng = np.random.default_rng(seed)
    *tissues, wall = abdomen()
    assert wall.name == "wall"
    low = np.min([t.surface.vertices.min(axis=0) for t in tissues], axis=0)
    high = np.max([t.surface.vertices.max(axis=0) for t in tissues], axis=0)
    low[2] = (low[2] + high[2]) / 2
    p, v = np.tile([0.0, 0.0, high[2] + 0.05], (3, 1)) + np.outer([-1, 0, 1], [0.06, 0.05, 0]), np.zeros((3, 3))
    for _ in range(round(seconds / period)):
        v += period * (rng.normal(0, 6.0, (3, 3)) + 4.0 * ((low + high) / 2 - p) - 0.8 * v)
        v *= np.minimum(1.0, 0.3 / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-9))
        p += period * v
        v[p[:, 2] < low[2], 2] = 0.1
        if rng.random() < 0.002:
            p[rng.integers(3)] = rng.uniform(low, high)
        yield [at(*x) for x in p]


@functools.cache
def bends():
    """Return the deformations of a ball that a rod pushes aside, and of an untouched block, for 2 s at 60 Hz."""
    soft, far = ball(), block(size=(0.05, 0.04, 0.03))
    s = np.linspace(0, 1, 60)
    path = np.column_stack([0.02 + 0.02 * s, 0 * s, 0.078 - 0.02 * np.sin(np.pi * s) + 0.01 * (s == 0)])
    poses = np.stack([at(*p) for p in path] + [at(0.2, 0.2, 0.3)] * 60)
    found = tissue_scene.followed([soft], [Tool("tool", rod())], [poses], 1 / 60)
    still = Bend(far.deformable.mesh, far.weights, found[0].times, np.repeat(far.nodes[None], 120, axis=0))
    assert np.abs(found[0].nodes - found[0].nodes[0]).max() > 5 * MM
    return [*found, still]


@functools.cache
def abdomen_bends():
    """Return the deformations of the organs and the wall of vsrs, each pressed by a rod, for 2 s at 60 Hz."""
    rods = Rods(abdomen())
    poses = [rods.poses(0.02 * np.sin(np.pi * k / 120) ** 2) for k in range(121)]
    tools = [Tool(t.name, rod(SHORT)) for t in rods.tissues]
    found = tissue_scene.followed(rods.tissues, tools, [np.stack(Ts) for Ts in zip(*poses, strict=True)], 1 / 60)
    assert [b.name for b in found] == ["liver", "gallbladder", "stomach", "wall"]
    assert min(np.abs(b.nodes - b.nodes[0]).max() for b in found) > 5 * MM
    return found


def at_time(bend, t):
    """Return the vertices (n, 3) at a time in s, by linear interpolation between simulated times."""
    s = np.clip(t * 60, 0, len(bend.times) - 1)
    k = min(int(s), len(bend.times) - 2)
    return bend.weights @ (bend.nodes[k] * (k + 1 - s) + bend.nodes[k + 1] * (s - k))
