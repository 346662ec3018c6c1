"""A ring that falls on the peg board: where it comes to rest in the World, and in a simulator of others."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import twin
from twin.api.scene_parts import props_of
from twin.core import spatial
from twin.core.units import DEG, MM
from twin.reference import ReferenceModel
from twin.simulation import contact_scene
from twin.simulation.plants.contact import Contact, Solid
from twin.simulation.tasks.transfer.task import Transfer, Transfers
from twin.simulation.world import World

pytestmark = pytest.mark.witness
SECONDS, FAR, TURNED = 2.0, 0.5 * MM, 3 * DEG
NO = float("nan")


@pytest.fixture(scope="module")
def board():
    """(scene, props, the fixed parts, all pegs by name)."""
    scene = twin.load_scene("davinci")
    props = props_of(scene)
    poses = ReferenceModel(props).home().link_poses
    solids = [Solid(n, props.body(n).meshes, scene.contact.friction, poses[n]) for n in scene.contact.solid]
    names = [part.name for solid in solids for part in solid.parts if "peg" in part.name]
    task = replace(scene.tasks["pegboard"], goal=Transfers(tuple(Transfer(ring="ring1", peg=name) for name in names)))
    return scene, solids, contact_scene.pegs(scene, props, task)


def starts(scene, pegs):
    """Return the poses (4, 4) from which a ring falls, by what it falls on."""
    peg = pegs[scene.tasks["pegboard"].goal.transfers[0].peg]
    hung = scene.objects[0].T_world_object
    floor = peg.foot[:2]
    high = max(o.T_world_object[2, 3] for o in scene.objects) - 20 * MM
    lifted = spatial.pose(hung[:3, :3], hung[:3, 3] + [0, 0, 1 * MM])
    return {
        "flat on the floor": spatial.pose(p=[0.0, floor[1], high]),
        "leaning, on the floor": spatial.pose(spatial.exp_so3(np.array([0.15, 0, 0])), [0.0, floor[1], high]),
        "around a peg": spatial.pose(p=[floor[0] + 1 * MM, floor[1], peg.end[2] - 2 * MM]),
        "hung on a peg of the wall": lifted,
    }


@pytest.mark.witness("drake")
def test_a_ring_comes_to_rest_where_it_does_in_drake(board, foreign, figures, tmp_path):
    scene, solids, pegs = board
    ring = scene.objects[0]
    begun = starts(scene, pegs)
    boxes = []
    for solid in solids:
        for part in solid.parts:
            if part.name not in pegs:
                p = part.vertices @ solid.T_world_body[:3, :3].T + solid.T_world_body[:3, 3]
                low, high = p.min(axis=0), p.max(axis=0)
                boxes.append({"half": ((high - low) / 2).tolist(), "p": ((low + high) / 2).tolist()})
    friction = max(ring.friction, scene.contact.friction)
    job = {
        "boxes": boxes,
        "pegs": [{"foot": p.foot.tolist(), "end": p.end.tolist(), "radius": p.radius} for p in pegs.values()],
        "ring": {"radius": ring.size[0], "wire": ring.size[1], "mass": ring.mass},
        "friction": friction,
        "starts": [[*T[:3, 3], *spatial.quat_from_matrix_wxyz(T[:3, :3])] for T in begun.values()],
        "seconds": SECONDS,
    }
    (tmp_path / "drop.json").write_text(json.dumps(job))
    answer = foreign.read("drake", "drop_drake.py", tmp_path / "drop.json")
    for (what, T), rest, speed in zip(begun.items(), answer["rests"], answer["speeds"], strict=True):
        assert speed < 1 * MM, f"{what}: the ring is not at rest in drake"
        item = replace(ring, T_world_object=T)
        world = World(objects=[item], plants=[Contact([item], solids, friction=scene.contact.friction)], records=False)
        world.step(round(SECONDS / world.dt))
        found = world.signals[f"{ring.name}.pose"].reshape(4, 4)
        theirs = spatial.pose(spatial.matrix_from_quat_wxyz(np.array(rest[3:])), rest[:3])
        far = float(np.linalg.norm(found[:3, 3] - theirs[:3, 3]))
        turned = float(np.arccos(np.clip(found[:3, 2] @ theirs[:3, 2], -1, 1)))  # about its axis, a ring looks the same
        figures.add(answer["version"], scene.name, what, far, turned, "ring at rest")
        assert far <= FAR, f"{what}: {far / MM:.3f} mm"
        assert turned <= TURNED, f"{what}: {turned / DEG:.2f} deg"
        assert np.linalg.norm(found[:3, 3] - T[:3, 3]) > FAR, f"{what}: it has not fallen"
