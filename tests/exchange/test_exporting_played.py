"""A URDF is played from the numbers of a track alone: every robot, by Pinocchio, which knows nothing of the loops."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import twin
from made.lanes import one_of_a_kind
from twin.core import spatial
from twin.exchange.formats.tracks.write import write_tracks
from twin.exchange.formats.urdf.write import write_urdf
from twin.exchange.write.clip import Clip, InterpolationErrors
from twin.model.body import Body, Frame
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel

FRAMES, TOL = 9, 1e-6


def bare(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism without its shapes, which nothing here looks at."""
    return replace(
        mechanism,
        bodies=tuple(replace(b, meshes=()) for b in mechanism.bodies),
        joints=tuple(replace(j, mating=()) for j in mechanism.joints),
    )


def swing(mechanism: Mechanism) -> Clip:
    """Return a motion of all driven joints, not in step, that does not begin at home."""
    model = ReferenceModel(mechanism)
    home = model.home()
    times = np.arange(FRAMES) / 10
    size = np.array([0.1 if j.is_angle else 0.01 for j in mechanism.active])
    q = home.q + size * np.cos(times[:, None] * 2 + np.linspace(0.0, 1.0, len(size)))
    run = model.run(q, home)
    joints = {j.name: run.q[:, i] for i, j in enumerate(mechanism.active)} | run.q_passive
    active = tuple(j.name for j in mechanism.active)
    return Clip(
        "swing", "", times, model.link_poses(run.x), joints, active, (), 10.0, InterpolationErrors(0.0, 0.0, 0.0)
    )


def slider() -> tuple[Mechanism, Clip]:
    """Return a rod that slides and turns in a tilted sleeve, with a ball at its end: many coordinates a joint."""
    T = spatial.pose(spatial.exp_so3([0.3, -1.1, 0.4]), [0.1, 0.2, 0.3])
    at = spatial.pose(spatial.rotation_z(1.1), [0.0, 0.05, 0.2])
    joints = (
        Joint("sleeve", "cylindrical", "base", "rod", T),
        Joint("ball", "spherical", "rod", "bob", at, spatial.pose(p=[0.0, 0.02, 0.0])),
    )
    bodies, frames = (Body("base"), Body("rod"), Body("bob")), (Frame("tool", "bob", np.eye(4)),)
    rest = {"base": np.eye(4), "rod": T, "bob": T @ at @ spatial.pose(p=[0.0, -0.02, 0.0])}
    mechanism = Mechanism("rod", "base", bodies, joints, frames, rest=rest, tool="tool")
    home = ReferenceModel(mechanism).home().link_poses
    t = np.linspace(0.0, 1.0, FRAMES)
    sleeve = spatial.pose(spatial.rotation_z(4 * t), np.stack([0 * t, 0 * t, 0.03 * t], axis=1))
    rod = home["base"] @ T @ sleeve
    tumble = spatial.pose(spatial.exp_so3(np.stack([t, 0.5 * t, -1.2 * t], axis=1)))
    there = spatial.pose(p=[0.0, 0.02, 0.0])
    bob = rod @ spatial.inverse(home["rod"]) @ home["bob"] @ there @ tumble @ spatial.inverse(there)
    links = {"base": np.broadcast_to(home["base"], (FRAMES, 4, 4)), "rod": rod, "bob": bob}
    return mechanism, Clip("swing", "", t, links, {}, (), (), 8.0, InterpolationErrors(0.0, 0.0, 0.0))


@pytest.mark.parametrize("name", [*one_of_a_kind(), "rod"])
def test_pinocchio_plays_the_urdf_from_the_track_alone(name, tmp_path):
    if name == "rod":
        mechanism, clip = slider()
    else:
        mechanism = bare(twin.load(name).mechanism)
        clip = swing(mechanism)
    data = json.loads(write_tracks(mechanism, clip, tmp_path)[0].read_text(encoding="utf-8"))
    model = pin.buildModelFromUrdf(str(write_urdf(mechanism, tmp_path)))
    values = dict(zip(data["joints"], np.reshape(data["positions"], (FRAMES, -1)).T, strict=True))
    poses = np.reshape(data["poses"], (FRAMES, len(data["links"]), 7))
    state = model.createData()
    assert set(model.names[1:]) <= set(values)  # nothing is left at zero
    for k in range(FRAMES):
        q = pin.neutral(model)
        for joint, joint_name in zip(model.joints[1:], model.names[1:], strict=True):
            v = values[joint_name][k]
            q[joint.idx_q : joint.idx_q + joint.nq] = v if joint.nq == 1 else [np.cos(v), np.sin(v)]
        pin.framesForwardKinematics(model, state, q)
        for i, link in enumerate(data["links"]):
            T = state.oMf[model.getFrameId(link)]
            assert np.linalg.norm(T.translation - poses[k, i, :3]) <= TOL, (link, k)
            R = spatial.matrix_from_quat_wxyz(np.roll(poses[k, i, 3:], 1))
            assert spatial.rotation_angle(T.rotation.T @ R) <= TOL, (link, k)
