"""A second engine that nobody here wrote: SILS as a closed-loop MJCF, assembled on MuJoCo's own constraint rows.

MuJoCo's equality constraints are soft, so nothing is simulated: its kinematics, `efc_pos` and `efc_J` are taken
and Gauss-Newton closes the loops (facts of google-deepmind/mujoco discussion 3494).
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from twin.core import spatial

KINDS = {"revolute": "hinge", "prismatic": "slide", "spherical": "ball"}
APART = 0.05
"""Metres between the two points of a pin's axis that are tied together."""


def numbers(values):
    return " ".join(repr(float(v)) for v in values)


def mjcf(mechanism):
    """Return the mechanism as MJCF: the tree as nested bodies, loops as site-to-site connections."""
    children, sites = {}, {}
    for joint in mechanism.tree:
        children.setdefault(joint.parent, []).append(joint)
    ties = []
    for joint in mechanism.loops:
        assert joint.type in ("revolute", "spherical")
        for n, along in enumerate((0.0, APART) if joint.type == "revolute" else (0.0,)):
            for body, T in ((joint.parent, joint.T_parent_joint), (joint.child, joint.T_child_joint)):
                point = T[:3, 3] + along * T[:3, 2]
                sites.setdefault(body, []).append(f'<site name="{joint.name}_{n}_{body}" pos="{numbers(point)}"/>')
            ends = f'site1="{joint.name}_{n}_{joint.parent}" site2="{joint.name}_{n}_{joint.child}"'
            ties.append(f'<connect name="{joint.name}_{n}" {ends}/>')
    tool = mechanism.frame(mechanism.tool)
    sites.setdefault(tool.body, []).append(
        f'<site name="tool" pos="{numbers(tool.T_body_frame[:3, 3])}" '
        f'quat="{numbers(spatial.quat_from_matrix_wxyz(tool.T_body_frame[:3, :3]))}"/>'
    )

    def body(name):
        inside = "".join(sites.get(name, []))
        for joint in children.get(name, []):
            T = joint.T_parent_joint @ spatial.inverse(joint.T_child_joint)
            at, axis = joint.T_child_joint[:3, 3], joint.T_child_joint[:3, 2]
            turned = "" if joint.type == "spherical" else f'axis="{numbers(axis)}"'
            inside += (
                f'<body name="{joint.child}" pos="{numbers(T[:3, 3])}" '
                f'quat="{numbers(spatial.quat_from_matrix_wxyz(T[:3, :3]))}">'
                f'<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
                f'<joint name="{joint.name}" type="{KINDS[joint.type]}" pos="{numbers(at)}" {turned}/>'
                f"{body(joint.child)}</body>"
            )
        return inside

    return (
        f'<mujoco><compiler angle="radian" autolimits="true"/><option jacobian="dense"><flag contact="disable"/>'
        f"</option><worldbody>{body(mechanism.base)}</worldbody><equality>{''.join(ties)}</equality></mujoco>"
    )


class Engine:
    """The assembled MuJoCo model, started in the posture as drawn."""

    def __init__(self, mechanism):
        self.mechanism = mechanism
        self.model = mujoco.MjModel.from_xml_string(mjcf(mechanism))
        self.data = mujoco.MjData(self.model)
        for joint in mechanism.tree:
            T = joint.relative(mechanism.rest[joint.parent], mechanism.rest[joint.child])
            at = self.model.jnt_qposadr[self.model.joint(joint.name).id]
            if joint.type == "revolute":
                self.data.qpos[at] = np.arctan2(T[1, 0], T[0, 0])
            elif joint.type == "prismatic":
                self.data.qpos[at] = T[2, 3]
            else:  # the turn about the anchor, in the axes of the child body
                R = joint.T_child_joint[:3, :3] @ T[:3, :3] @ joint.T_child_joint[:3, :3].T
                self.data.qpos[at : at + 4] = spatial.quat_from_matrix_wxyz(R)
        active = [self.model.joint(j.name).id for j in mechanism.active]
        self.driven = self.model.jnt_qposadr[active]
        self.passive = np.setdiff1d(np.arange(self.model.nv), self.model.jnt_dofadr[active])

    def rows(self):
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_makeConstraint(self.model, self.data)
        return self.data.efc_pos.copy(), self.data.efc_J.reshape(-1, self.model.nv).copy()

    def close(self):
        """Close the loops with the driven joints held; return the residual in m."""
        for _ in range(20):
            r, J = self.rows()
            if np.abs(r).max() < 1e-14:
                break
            step = np.zeros(self.model.nv)
            step[self.passive] = -np.linalg.lstsq(J[:, self.passive], r, rcond=1e-9)[0]
            mujoco.mj_integratePos(self.model, self.data.qpos, step, 1.0)
        return float(np.abs(self.rows()[0]).max())

    def solve(self, q, steps=25):
        start = self.data.qpos[self.driven].copy()
        for s in np.linspace(1 / steps, 1, steps):
            self.data.qpos[self.driven] = start + s * (q - start)
            residual = self.close()
        tool = self.data.site("tool")
        return spatial.pose(tool.xmat.reshape(3, 3), tool.xpos), residual


@pytest.fixture(scope="module")
def engine(sils_cad):
    return Engine(sils_cad.mechanism)


def test_the_mjcf_has_the_mechanisms_counts(engine):
    assert (engine.model.nbody, engine.model.njnt, engine.model.nv) == (17, 16, 18)
    r, _ = engine.rows()
    assert len(r) == 3 * 6 + 2 * 3  # two points a pin, one a ball
    assert np.abs(r).max() < 1e-14  # as drawn


@pytest.mark.parametrize("posture", ["home", "insertion", "inserted"])
def test_mujoco_finds_the_same_tool_pose(engine, sils_model, posture):
    q = sils_model.mechanism.posture(posture)
    T, residual = engine.solve(q)
    assert residual < 1e-13
    assert np.abs(T - sils_model.solve(q).T_base_tool).max() < 1e-12


def test_mujoco_finds_the_same_links_and_freedoms_at_random_joint_values(engine, sils_model, rng):
    home = sils_model.mechanism.posture("home")
    for _ in range(10):
        q = home + rng.uniform(-8e-3, 8e-3, 6)
        T, residual = engine.solve(q, steps=4)
        assert residual < 1e-13
        state = sils_model.solve(q)
        assert np.abs(T - state.T_base_tool).max() < 1e-12
        for body, T_base_body in state.link_poses.items():
            own = engine.data.body("world" if body == "frame" else body)
            assert np.abs(own.xpos - T_base_body[:3, 3]).max() < 1e-12
            assert np.abs(own.xmat.reshape(3, 3) - T_base_body[:3, :3]).max() < 1e-12
        s = np.linalg.svd(engine.rows()[1], compute_uv=False)
        rank = int(np.sum(s > 1e-9 * s[0]))
        assert engine.model.nv - rank == sils_model.mobility(state.x).freedom == 6
