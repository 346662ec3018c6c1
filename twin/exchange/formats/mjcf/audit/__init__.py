"""Read an MJCF file: MuJoCo compiles the file, and computes body poses and loop gaps at the joint values of a track."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco
import numpy as np

from twin.core.foreign.admit import admit
from twin.exchange.audit import poses
from twin.exchange.audit.chain import ChainStep, fit
from twin.exchange.audit.colors import Palette, Rgba, linear, surface_area
from twin.exchange.audit.context import Context, played
from twin.exchange.audit.mechanism_data import WORLD
from twin.exchange.audit.motion import Content, FileClip
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Ledger, ReadError, um
from twin.exchange.formats.mjcf.audit.claims import check_claims
from twin.exchange.formats.mjcf.audit.further import further
from twin.exchange.formats.mjcf.audit.model_checks import (
    ROUNDING_TOL,
    balance_at_keyframe,
    check_model,
    gap_of,
    opening,
)
from twin.exchange.formats.mjcf.audit.physics import BALL, FREE, HINGE, SLIDE, compiled_physics
from twin.exchange.formats.mjcf.audit.shapes import link_shapes
from twin.exchange.formats.urdf.audit import assumed_masses, parse_xml, partly_shown

LOOP_TOL = 1e-6
"""Maximum residual of an equality constraint at the joint values of a track, in m or (rotation of a weld) in rad."""

_UNLIMITED = 1e29
"""Limits of tracks in m or rad above this size mean "no limit"."""


class Mjcf:
    """An MJCF file, compiled by MuJoCo."""

    def __init__(self, path: Path, ledger: Ledger) -> None:
        self._ledger = ledger
        root = parse_xml(path)
        if root.tag != "mujoco":
            raise ReadError(f"the root element is <{root.tag}>, expected <mujoco>")
        self.content = Content(ledger, "mjcf")
        try:
            spec = mujoco.MjSpec.from_file(str(path))
            self.content.shapes = link_shapes(spec, path, ledger)
            self.model = mujoco.MjModel.from_xml_path(str(path))
        except (ValueError, mujoco.FatalError) as error:
            raise ReadError(f"MuJoCo rejects the file: {str(error).strip()[:200]}") from error
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        self.data = mujoco.MjData(self.model)
        m = self.model
        self.bodies: dict[str, int] = {}
        for i in range(0 if _holds(root) else 1, m.nbody):
            if m.body(i).name:
                self.bodies[m.body(i).name] = i
        mujoco.mj_kinematics(m, self.data)
        self.content.rest = {name: self._pose(i) for name, i in self.bodies.items()}
        self.content.facts = {
            "units": "m (MuJoCo)",
            "up_axis": "Z" if m.opt.gravity[2] < 0 else "?",
            "handedness": "right (MuJoCo)",
        }
        self.content.physics = compiled_physics(m, self.bodies)
        self.content.physics.further, self.content.physics.contact = further(spec)
        self.content.physics.robot = _robot_name(spec)
        self.content.physics.assumed = assumed_masses(path)
        self.content.physics.partly = partly_shown(path) | _partly_read(m)
        self.content.colors, self.content.finishes = _colors(m)
        check_model(m, ledger)
        # Assumed masses are held by nothing: the controls are those of the robot, which has no such masses.
        weighed = not self.content.physics.assumed
        check_claims(path.read_text("utf-8", errors="replace"), m, balance_at_keyframe(m), weighed, ledger)

    def _pose(self, body: int) -> Array:
        q = self.data.xquat[body]
        return poses.pose(poses.rotation(q[[1, 2, 3, 0]]), self.data.xpos[body].copy())

    def play(self, clip: FileClip) -> FileClip:
        """Return the clip of poses T_world_link (k, 4, 4) that MuJoCo computes from a track; report open loops."""
        m = self.model
        d = self.data
        count = len(clip.times)
        qpos = np.tile(m.qpos0, (count, 1))
        for body in range(1, m.nbody):
            self._set(body, clip, qpos)
        number = {WORLD: 0, **self.bodies}  # a base named world is MuJoCo's own fixed body
        place = np.zeros((count, m.nbody, 3))
        turn = np.zeros((count, m.nbody, 4))
        worst = 0.0
        where = ""
        when = ""
        for k in range(count):
            d.qpos[:] = qpos[k]
            mujoco.mj_fwdPosition(m, d)
            place[k] = d.xpos
            turn[k] = d.xquat
            gap, equality = gap_of(m, d)
            if gap > worst:
                worst = gap
                where = equality
                when = f"t = {clip.times[k]:.4g} s"
        if m.neq:
            self._ledger.row(f"clip '{clip.name}': loops in MuJoCo", worst, "m", LOOP_TOL, where=where, when=when)
        if worst > LOOP_TOL:
            text = f"clip '{clip.name}': equality '{where}' is open by {opening(m, where, worst)}."
            self._ledger.wrong("mjcf.loop", text, where, size=um(worst, LOOP_TOL), when=when)
        T = poses.pose(poses.rotation(turn[..., [1, 2, 3, 0]]), place)
        links = {name: T[:, i] for name, i in number.items() if name in clip.links}
        return FileClip(clip.name, clip.times, links)

    def _set(self, body: int, clip: FileClip, qpos: Array) -> None:
        """Set the coordinates of one body's joints at all keys, from the track's joint values or link poses."""
        m = self.model
        first = m.body_jntadr[body]
        joints = range(first, first + m.body_jntnum[body])
        if not joints:
            return
        if m.jnt_type[first] == FREE:  # every pose of the body is a pose of the joint
            goal = self._goal(body, clip)
            if goal is not None:
                at = m.jnt_qposadr[first]
                qpos[:, at : at + 3] = goal[:, :3, 3]
                qpos[:, at + 3 : at + 7] = poses.quaternion(goal[:, :3, :3])[:, [3, 0, 1, 2]]
            return
        steps: list[ChainStep] = []
        given: list[Array | None] = []
        owners: list[int] = []
        unknown = False
        for step, values, owner in self._chain(body, joints, clip):
            steps.append(step)
            given.append(values)
            owners.append(owner)
            unknown |= values is None and step.kind != "fixed"
        if unknown:
            goal = self._goal(body, clip)
            if goal is None:
                return
            given = fit(steps, given, goal)
        for j in joints:
            at = m.jnt_qposadr[j]
            values = [q for q, owner in zip(given, owners, strict=True) if owner == j and q is not None]
            if m.jnt_type[j] == BALL:
                about_x, about_y, about_z = values
                R = poses.about([1, 0, 0], about_x) @ poses.about([0, 1, 0], about_y) @ poses.about([0, 0, 1], about_z)
                qpos[:, at : at + 4] = poses.quaternion(R)[:, [3, 0, 1, 2]]
            else:
                qpos[:, at] = values[0] + m.qpos0[at]

    def _chain(self, body: int, joints: range, clip: FileClip) -> Iterator[tuple[ChainStep, Array | None, int]]:
        """Yield (step, values, joint) for each step of the chain from a body's parent to the body.

        `values` (k,) are the joint values in m or rad, None if unknown. `joint` is MuJoCo's joint number, or -1 for a
        step without a joint.
        """
        m = self.model
        R_parent_body = poses.rotation(m.body_quat[body][[1, 2, 3, 0]])
        yield ChainStep(poses.pose(R_parent_body, m.body_pos[body])), None, -1
        for j in joints:
            anchor = poses.pose(None, m.jnt_pos[j])
            if m.jnt_type[j] == BALL:
                x, y, z = np.eye(3)
                yield ChainStep(anchor, "turn", x), None, j
                yield ChainStep(np.eye(4), "turn", y), None, j
                yield ChainStep(np.eye(4), "turn", z), None, j
            elif m.jnt_type[j] in (HINGE, SLIDE):
                kind = "turn" if m.jnt_type[j] == HINGE else "slide"
                values = clip.joints.get(m.joint(j).name)
                if values is not None:
                    values = values - m.qpos0[m.jnt_qposadr[j]]  # MuJoCo's poses are those at `ref`
                yield ChainStep(anchor, kind, m.jnt_axis[j].copy()), values, j
            yield ChainStep(poses.inverse(anchor)), None, -1

    def _goal(self, body: int, clip: FileClip) -> Array | None:
        """Return T_parent_body (k, 4, 4) from the track: poses of `body` or of a body welded to it; None if unknown."""
        upper = self._known(self.model.body_parentid[body], clip)
        T_world_body = self._known(body, clip)
        if T_world_body is None:
            T_world_body = self._welded(body, clip)
        if upper is None or T_world_body is None:
            return None
        return poses.inverse(upper) @ T_world_body

    def _known(self, body: int, clip: FileClip) -> Array | None:
        if body == 0:
            return np.broadcast_to(np.eye(4), (len(clip.times), 4, 4))
        return clip.links.get(self.model.body(body).name)

    def _welded(self, body: int, clip: FileClip) -> Array | None:
        m = self.model
        for e in range(m.neq):
            if m.eq_type[e] != mujoco.mjtEq.mjEQ_WELD or m.eq_objtype[e] != mujoco.mjtObj.mjOBJ_SITE:
                continue
            first = int(m.eq_obj1id[e])
            second = int(m.eq_obj2id[e])
            for own, other in ((first, second), (second, first)):
                T_world_other = self._known(int(m.site_bodyid[other]), clip)
                if m.site_bodyid[own] == body and T_world_other is not None:
                    return T_world_other @ self._site(other) @ poses.inverse(self._site(own))
        return None

    def _site(self, site: int) -> Array:
        """Return T_body_site (4, 4)."""
        return poses.pose(poses.rotation(self.model.site_quat[site][[1, 2, 3, 0]]), self.model.site_pos[site])

    def check_limits(self, name: str, low: Mapping[str, float], high: Mapping[str, float]) -> None:
        """Compare the joint ranges of the file with the joint limits in a track.

        `name` is the file name of the track. `low` and `high` map joints to their limits in the track, in m or rad.
        """
        m = self.model
        for j in range(m.njnt):
            joint = m.joint(j).name
            if joint not in low or abs(low[joint]) > _UNLIMITED:
                continue
            lower = -np.inf
            upper = np.inf
            if m.jnt_limited[j]:
                lower, upper = m.jnt_range[j].tolist()
            off = float(np.max(np.abs([lower - low[joint], upper - high[joint]])))
            scale = 1.0
            for limit in (low[joint], high[joint]):
                if abs(limit) < _UNLIMITED:
                    scale = max(scale, abs(limit))
            if not off <= ROUNDING_TOL * scale:
                text = (
                    f"joint '{joint}' has range {lower:g} .. {upper:g}; in {name} it is {low[joint]:g} .. "
                    f"{high[joint]:g}."
                )
                self._ledger.wrong("mjcf.limits", text, joint, size=off)


def _robot_name(spec: mujoco.MjSpec) -> str:
    """Return the name of the model; "" if the file states none, for which MuJoCo has a name of its own."""
    name = str(spec.modelname)
    return "" if name == mujoco.MjSpec().modelname else name


def _holds(root: ET.Element) -> bool:
    """Return whether the world is the base of the robot: True if a joint connects a top-level body to the world."""
    return any(world.find("body/joint") is not None for world in root.iter("worldbody"))


def _partly_read(m: mujoco.MjModel) -> frozenset[str]:
    """Return the names of bodies without a shape that collides, or with a shape that is not a mesh and is not read."""
    out = set()
    for body in range(m.nbody):
        first = m.body_geomadr[body]
        end = first + m.body_geomnum[body]
        collides = m.geom_contype[first:end].any() or m.geom_conaffinity[first:end].any()
        meshes = (m.geom_type[first:end] == mujoco.mjtGeom.mjGEOM_MESH).all()
        if not collides or not meshes:
            out.add(m.body(body).name)
    return frozenset(out)


def _colors(m: mujoco.MjModel) -> tuple[dict[str, dict[Rgba, float]], dict[str, dict[Rgba, float]]]:
    """Return {body: {colour: fraction of area}}, and the same for finishes (metallic, roughness, 0, 1).

    A mesh that is used for both display and collision counts once. Materials without a finish have none.
    """
    out = Palette()
    finishes = Palette()
    # MuJoCo has -1 for what a material does not state; a file in which none states it has no finishes.
    finished = bool(np.any(m.mat_metallic >= 0) or np.any(m.mat_roughness >= 0))
    seen = set()
    for g in range(m.ngeom):
        mesh = int(m.geom_dataid[g])
        key = (int(m.geom_bodyid[g]), mesh, m.geom_pos[g].tobytes())
        if m.geom_type[g] != mujoco.mjtGeom.mjGEOM_MESH or mesh < 0 or key in seen:
            continue
        seen.add(key)
        vertex = int(m.mesh_vertadr[mesh])
        face = int(m.mesh_faceadr[mesh])
        vertices = m.mesh_vert[vertex : vertex + m.mesh_vertnum[mesh]].astype(float)
        area = surface_area(vertices, m.mesh_face[face : face + m.mesh_facenum[mesh]])
        rgba = m.geom_rgba[g]
        material = int(m.geom_matid[g])
        if material >= 0:  # the colour of a material hides that of the shape
            rgba = m.mat_rgba[material]
            metallic, roughness = float(m.mat_metallic[material]), float(m.mat_roughness[material])
            if finished:
                finishes.add_finish(m.body(key[0]).name, metallic, roughness, area)
        red, green, blue = linear(rgba[:3]).tolist()
        out.add(m.body(key[0]).name, (red, green, blue, float(rgba[3])), area)
    return out.shares(), finishes.shares()


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of an MJCF file with its poses along the tracks, and report its faults."""
    admit(path)
    ledger.tool = "mujoco"
    ledger.version = mujoco.__version__
    return played(Mjcf(path, ledger), path, ledger, context)
