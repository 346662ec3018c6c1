"""Read an MJCF file: MuJoCo compiles the file, and computes body poses and loop gaps at the joint values of a track."""

from __future__ import annotations

from collections import Counter
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
from twin.exchange.audit.meshes import check_mesh, joined
from twin.exchange.audit.motion import Content, FileClip, LinkShape
from twin.exchange.audit.physics import WORLD
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Ledger, Measured, ReadError, quantity, um
from twin.exchange.formats.mjcf.audit.physics import BALL, FREE, HINGE, SLIDE, compiled_physics
from twin.exchange.formats.urdf.audit import assumed_masses, named_mesh, numbers, parse_xml, partly_shown

LOOP_TOL = 1e-6
"""Maximum residual of an equality constraint at the joint values of a track, in m or (rotation of a weld) in rad."""

LIMIT_TOL = 1e-5
"""Maximum relative difference between limits that counts as a rounding error, because MuJoCo saves six digits."""

KEY_GAP = 1e-4
"""Maximum residual in m or rad of an equality constraint at a keyframe; simulations start from keyframes."""


class Mjcf:
    """An MJCF file, compiled by MuJoCo."""

    def __init__(self, path: Path, ledger: Ledger) -> None:
        self._ledger = ledger
        root = parse_xml(path)
        if root.tag != "mujoco":
            raise ReadError(f"the root element is <{root.tag}>, expected <mujoco>")
        self.content = Content(ledger, "mjcf")
        self.content.shapes = _shapes(root, path, ledger)
        try:
            self.model = mujoco.MjModel.from_xml_path(str(path))
        except (ValueError, mujoco.FatalError) as error:
            raise ReadError(f"MuJoCo rejects the file: {str(error).strip()[:200]}") from error
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        self.data = mujoco.MjData(self.model)
        m = self.model
        self.bodies = {m.body(i).name: i for i in range(m.nbody) if m.body(i).name and (i or _holds(root))}
        mujoco.mj_kinematics(m, self.data)
        self.content.rest = {n: self._pose(i) for n, i in self.bodies.items()}
        self.content.facts = {
            "units": "m (MuJoCo)",
            "up_axis": "Z" if m.opt.gravity[2] < 0 else "?",
            "handedness": "right (MuJoCo)",
        }
        self.content.physics = compiled_physics(m, self.bodies)
        self.content.physics.assumed = assumed_masses(path)
        self.content.physics.partly = partly_shown(path) | _partly_read(m)
        self.content.colors = _colors(m)
        _check_model(m, self.data, ledger)

    def _pose(self, body: int) -> Array:
        q = self.data.xquat[body]
        return poses.pose(poses.rotation(q[[1, 2, 3, 0]]), self.data.xpos[body].copy())

    def play(self, clip: FileClip) -> FileClip:
        """Return the clip of poses T_world_link (k, 4, 4) that MuJoCo computes from a track; report open loops."""
        m, d = self.model, self.data
        count = len(clip.times)
        qpos = np.tile(m.qpos0, (count, 1))
        for body in range(1, m.nbody):
            self._set(body, clip, qpos)
        number = {WORLD: 0, **self.bodies}  # a base named world is MuJoCo's own fixed body
        names = [n for n in number if n in clip.links]
        place, turn = np.zeros((count, m.nbody, 3)), np.zeros((count, m.nbody, 4))
        worst, where, when = 0.0, "", ""
        for k in range(count):
            d.qpos[:] = qpos[k]
            mujoco.mj_fwdPosition(m, d)
            place[k], turn[k] = d.xpos, d.xquat
            gap, equality = _gap(m, d)
            if gap > worst:
                worst, where, when = gap, equality, f"t = {clip.times[k]:.4g} s"
        if m.neq:
            self._ledger.row(f"clip '{clip.name}': loops in MuJoCo", worst, "m", LOOP_TOL, where=where, when=when)
        if worst > LOOP_TOL:
            text = f"clip '{clip.name}': equality '{where}' is open by {quantity(worst, 'm')}."
            self._ledger.wrong("mjcf.loop", text, where, size=um(worst, LOOP_TOL), when=when)
        T = poses.pose(poses.rotation(turn[..., [1, 2, 3, 0]]), place)
        return FileClip(clip.name, clip.times, {n: T[:, number[n]] for n in names})

    def _set(self, body: int, clip: FileClip, qpos: Array) -> None:
        """Set the coordinates of one body's joints at all keys, from the track's joint values or link poses."""
        m = self.model
        joints = range(m.body_jntadr[body], m.body_jntadr[body] + m.body_jntnum[body]) if m.body_jntnum[body] else ()
        if not joints:
            return
        if m.jnt_type[joints[0]] == FREE:  # every pose of the body is a pose of the joint
            goal = self._goal(body, clip)
            if goal is not None:
                at = m.jnt_qposadr[joints[0]]
                qpos[:, at : at + 3] = goal[:, :3, 3]
                qpos[:, at + 3 : at + 7] = poses.quaternion(goal[:, :3, :3])[:, [3, 0, 1, 2]]
            return
        links, given, owners = map(list, zip(*self._chain(body, joints, clip), strict=True))
        if any(g is None and link.kind != "fixed" for g, link in zip(given, links, strict=True)):
            goal = self._goal(body, clip)
            if goal is None:
                return
            given = fit(links, given, goal)
        for j in joints:
            at = m.jnt_qposadr[j]
            values = [g for g, o in zip(given, owners, strict=True) if o == j and g is not None]
            if m.jnt_type[j] == BALL:
                R = poses.about([1, 0, 0], values[0]) @ poses.about([0, 1, 0], values[1])
                q = poses.quaternion(R @ poses.about([0, 0, 1], values[2]))
                qpos[:, at : at + 4] = q[:, [3, 0, 1, 2]]
            else:
                qpos[:, at] = values[0] + m.qpos0[at]

    def _chain(self, body: int, joints: range, clip: FileClip) -> Iterator[tuple[ChainStep, Array | None, int]]:
        """Yield (step, values, joint) for each step of the chain from a body's parent to the body.

        `values` (k,) are the joint values in m or rad, None if unknown. `joint` is MuJoCo's joint number, or -1 for a
        step without a joint.
        """
        m = self.model
        yield ChainStep(poses.pose(poses.rotation(m.body_quat[body][[1, 2, 3, 0]]), m.body_pos[body])), None, -1
        for j in joints:
            there, axis = poses.pose(None, m.jnt_pos[j]), m.jnt_axis[j].copy()
            known = clip.joints.get(m.joint(j).name)
            if m.jnt_type[j] == BALL:
                for i in range(3):
                    yield ChainStep(there if not i else np.eye(4), "turn", np.eye(3)[i]), None, j
            elif m.jnt_type[j] in (HINGE, SLIDE):
                value = None if known is None else known - m.qpos0[m.jnt_qposadr[j]]
                yield ChainStep(there, "turn" if m.jnt_type[j] == HINGE else "slide", axis), value, j
            yield ChainStep(poses.inverse(there)), None, -1

    def _goal(self, body: int, clip: FileClip) -> Array | None:
        """Return T_parent_body (k, 4, 4) from the track: poses of `body` or of a body welded to it; None if unknown."""
        upper = self._known(self.model.body_parentid[body], clip)
        here = self._known(body, clip)
        if here is None:
            here = self._welded(body, clip)
        return None if upper is None or here is None else poses.inverse(upper) @ here

    def _known(self, body: int, clip: FileClip) -> Array | None:
        if body == 0:
            return np.broadcast_to(np.eye(4), (len(clip.times), 4, 4))
        return clip.links.get(self.model.body(body).name)

    def _welded(self, body: int, clip: FileClip) -> Array | None:
        m = self.model
        for e in range(m.neq):
            if m.eq_type[e] != mujoco.mjtEq.mjEQ_WELD or m.eq_objtype[e] != mujoco.mjtObj.mjOBJ_SITE:
                continue
            sites = [int(m.eq_obj1id[e]), int(m.eq_obj2id[e])]
            for mine, its in (sites, sites[::-1]):
                other = self._known(int(m.site_bodyid[its]), clip)
                if m.site_bodyid[mine] == body and other is not None:
                    T_mine, T_its = (
                        poses.pose(poses.rotation(m.site_quat[s][[1, 2, 3, 0]]), m.site_pos[s]) for s in (mine, its)
                    )
                    return other @ T_its @ poses.inverse(T_mine)
        return None

    def check_limits(self, name: str, low: Mapping[str, float], high: Mapping[str, float]) -> None:
        """Compare the joint ranges of the file with the joint limits in a track.

        `name` is the file name of the track. `low` and `high` map joints to their limits in the track, in m or rad.
        """
        m = self.model
        for j in range(m.njnt):
            joint = m.joint(j).name
            if joint not in low or abs(low[joint]) > 1e29:
                continue
            got = m.jnt_range[j] if m.jnt_limited[j] else np.array([-np.inf, np.inf])
            off = float(np.max(np.abs(got - [low[joint], high[joint]])))
            if not off <= LIMIT_TOL * max(1.0, *(abs(v) for v in (low[joint], high[joint]) if abs(v) < 1e29)):
                text = (
                    f"joint '{joint}' has range {got[0]:g} .. {got[1]:g}; in {name} it is {low[joint]:g} .. "
                    f"{high[joint]:g}."
                )
                self._ledger.wrong("mjcf.limits", text, joint, size=off)


def _gap(m: mujoco.MjModel, d: mujoco.MjData) -> tuple[float, str]:
    """Return (largest residual of an equality constraint in m or rad, name of this constraint)."""
    gaps = np.where(d.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY, np.abs(d.efc_pos), 0.0)
    if not gaps.any():
        return 0.0, ""
    row = int(np.argmax(gaps))
    return float(gaps[row]), m.equality(int(d.efc_id[row])).name


def _holds(root: ET.Element) -> bool:
    """Return whether the world is the base of the robot: True if a joint connects a top-level body to the world."""
    return any(b.find("joint") is not None for world in root.iter("worldbody") for b in world.findall("body"))


def _partly_read(m: mujoco.MjModel) -> frozenset[str]:
    """Return the names of bodies without a shape that collides, or with a shape that is not a mesh and is not read."""
    out = set()
    for body in range(m.nbody):
        shapes = range(m.body_geomadr[body], m.body_geomadr[body] + m.body_geomnum[body])
        collides = any(m.geom_contype[g] or m.geom_conaffinity[g] for g in shapes)
        meshes = all(m.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH for g in shapes)
        if not collides or not meshes:
            out.add(m.body(body).name)
    return frozenset(out)


def _colors(m: mujoco.MjModel) -> dict[str, dict[Rgba, float]]:
    """Return {body: {colour: fraction of area}}. A mesh that is used for both display and collision counts once."""
    out = Palette()
    seen = set()
    for g in range(m.ngeom):
        mesh = int(m.geom_dataid[g])
        key = (int(m.geom_bodyid[g]), mesh, m.geom_pos[g].tobytes())
        if m.geom_type[g] != mujoco.mjtGeom.mjGEOM_MESH or mesh < 0 or key in seen:
            continue
        seen.add(key)
        at, faces = int(m.mesh_vertadr[mesh]), int(m.mesh_faceadr[mesh])
        vertices = m.mesh_vert[at : at + m.mesh_vertnum[mesh]].astype(float)
        area = surface_area(vertices, m.mesh_face[faces : faces + m.mesh_facenum[mesh]])
        rgba = m.mat_rgba[m.geom_matid[g]] if m.geom_matid[g] >= 0 else m.geom_rgba[g]
        out.add(m.body(key[0]).name, (*linear(rgba[:3]).tolist(), float(rgba[3])), area)
    return out.shares()


def _shapes(root: ET.Element, path: Path, ledger: Ledger) -> dict[str, LinkShape]:
    compiler = root.find("compiler")
    folder = "" if compiler is None else compiler.get("meshdir", compiler.get("assetdir", ""))
    assets = {}
    for mesh in root.findall("asset/mesh"):
        file = mesh.get("file", "")
        name = mesh.get("name") or Path(file).stem
        assets[name] = (f"{folder}/{file}" if folder else file, numbers(mesh.get("scale"), 3, (1, 1, 1)))
    checked: dict[str, tuple[Array, Array] | None] = {}
    out = {}
    for body in (*root.iter("worldbody"), *root.iter("body")):
        parts, seen = [], set()
        for geom in body.findall("geom"):
            place = (geom.get("mesh"), geom.get("pos"), geom.get("quat"))
            if place in seen:  # the same mesh is used for display and collision
                continue
            seen.add(place)
            if geom.get("mesh") not in assets or not set(geom.keys()).isdisjoint(
                {"euler", "axisangle", "xyaxes", "zaxis"}
            ):
                continue
            file, scale = assets[geom.get("mesh")]
            got = named_mesh(path, file, scale, checked, ledger, "mjcf")
            if got is not None:
                q = numbers(geom.get("quat"), 4, (1, 0, 0, 0))[[1, 2, 3, 0]]
                T = poses.pose(poses.rotation(q), numbers(geom.get("pos"), 3, (0, 0, 0)))
                parts.append(check_mesh(Ledger(""), "", got[0] @ T[:3, :3].T + T[:3, 3], got[1], None, "mjcf"))
        shape = joined(p for p in parts if p is not None)
        name = "world" if body.tag == "worldbody" else body.get("name", "")
        if shape is not None and name:
            out[name] = shape
    return out


def _check_model(m: mujoco.MjModel, d: mujoco.MjData, ledger: Ledger) -> None:
    """Report faults of actuators and keyframes."""
    names = {m.joint(j).name: j for j in range(m.njnt) if m.joint(j).name}
    for a in range(m.nu):
        name, j = m.actuator(a).name, int(m.actuator_trnid[a, 0])
        if int(m.actuator_trntype[a]) != int(mujoco.mjtTrn.mjTRN_JOINT):
            continue
        if names.get(name, j) != j:
            text = f"actuator '{name}' drives joint '{m.joint(j).name}', not the joint of the same name."
            advice = "let the actuator drive the joint of the same name, or rename the actuator"
            ledger.wrong("mjcf.actuator", text, name, suggestion=advice)
    for a in range(m.nu):
        _check_servo(m, a, ledger)
    _check_softness(m, ledger)
    for k in range(m.nkey):
        _check_key(m, d, k, ledger)
    mujoco.mj_resetData(m, d)


def _check_servo(m: mujoco.MjModel, a: int, ledger: Ledger) -> None:
    """Report a position servo whose control is no position: force = gain * control - stiffness * coordinate + ...

    The control is the coordinate, or the displacement of the coordinate from `ref`.
    """
    name = m.actuator(a).name
    gain, stiffness = float(m.actuator_gainprm[a, 0]), -float(m.actuator_biasprm[a, 1])
    affine = int(m.actuator_biastype[a]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
    if not affine or stiffness <= 0:  # a motor, or a drive of the speed
        return
    if abs(gain - stiffness) > LIMIT_TOL * stiffness:
        text = (
            f"actuator '{name}': gainprm is {gain:.6g}, but -biasprm[1] is {stiffness:.6g}: a control of 1 moves the "
            f"drive by {gain / stiffness:.6g}."
        )
        ledger.wrong(
            "mjcf.control", text, name, size=Measured(gain, stiffness), suggestion="write gainprm = -biasprm[1]"
        )
    j = int(m.actuator_trnid[a, 0])
    by_joint = int(m.actuator_trntype[a]) == int(mujoco.mjtTrn.mjTRN_JOINT)
    if not by_joint or not m.actuator_ctrllimited[a] or not m.jnt_limited[j] or m.jnt_type[j] not in (HINGE, SLIDE):
        return
    ref = float(m.qpos0[m.jnt_qposadr[j]])
    ordered = m.actuator_ctrlrange[a] / float(m.actuator_gear[a, 0])
    beyond = []
    for start in (0.0, ref):
        low, high = m.jnt_range[j] - start
        beyond.append(max(float(low - ordered[0]), float(ordered[1] - high)))
    if min(beyond) > LIMIT_TOL * max(1.0, float(np.abs(m.jnt_range[j]).max())):
        text = (
            f"actuator '{name}': ctrlrange {ordered[0]:.6g} .. {ordered[1]:.6g} goes beyond the range of its joint by "
            f"{min(beyond):.6g}: relative to ref it is {low:.6g} .. {high:.6g}."
        )
        ledger.wrong("mjcf.control", text, name, size=min(beyond), suggestion="write ctrlrange = range - ref")


def _check_softness(m: mujoco.MjModel, ledger: Ledger) -> None:
    """Report equality constraints whose solver parameters differ from those of most others in the file."""
    rows = [(*m.eq_solref[e].tolist(), *m.eq_solimp[e].tolist()) for e in range(m.neq)]
    common = Counter(rows).most_common(1)
    for e, row in enumerate(rows):
        if row != common[0][0]:
            name = m.equality(e).name
            text = (
                f"equality '{name}' has solref {row[0]:g} {row[1]:g} and solimp {row[2]:g} {row[3]:g}, most others "
                f"have {common[0][0][0]:g} {common[0][0][1]:g} and {common[0][0][2]:g} {common[0][0][3]:g}: its loop "
                "opens by another amount under load."
            )
            ledger.wrong("mjcf.softness", text, name, suggestion="give all loops the same solref and solimp")


def _check_key(m: mujoco.MjModel, d: mujoco.MjData, k: int, ledger: Ledger) -> None:
    name = m.key(k).name or f"key {k}"
    mujoco.mj_resetDataKeyframe(m, d, k)
    mujoco.mj_fwdPosition(m, d)
    worst, where = _gap(m, d)
    if m.neq:
        ledger.row(f"loops at keyframe '{name}'", worst, "m", KEY_GAP)
    if worst > KEY_GAP:
        text = f"keyframe '{name}': equality '{where}' is open by {quantity(worst, 'm')}."
        ledger.wrong("mjcf.keyframe", text, name, size=Measured(worst, KEY_GAP, "m"))
    for j in range(m.njnt):
        q = float(d.qpos[m.jnt_qposadr[j]])
        low, high = m.jnt_range[j]
        if m.jnt_limited[j] and m.jnt_type[j] != BALL and not low - 1e-6 <= q <= high + 1e-6:
            text = f"keyframe '{name}': joint '{m.joint(j).name}' is at {q:.6g}, outside {low:.6g} .. {high:.6g}."
            ledger.wrong("mjcf.keyframe", text, name, size=q)
    _check_push(m, d, name, ledger)


def _check_push(m: mujoco.MjModel, d: mujoco.MjData, name: str, ledger: Ledger) -> None:
    """Report actuators whose force is at its limit at a keyframe with zero velocity.

    If even the right force would be above the limit, the motor is too weak, which is a warning; else the control is
    wrong.
    """
    mujoco.mj_fwdVelocity(m, d)
    mujoco.mj_fwdActuation(m, d)
    needed = _holding(m, d)
    for a in range(m.nu):
        if not m.actuator_forcelimited[a]:
            continue
        bound = float(np.abs(m.actuator_forcerange[a]).max())
        if abs(needed[a]) > bound:
            text = (
                f"keyframe '{name}': actuator '{m.actuator(a).name}' cannot hold the robot: it needs "
                f"{abs(needed[a]):.4g} N or N m, its maximum effort is {bound:g}."
            )
            where = m.actuator(a).name
            ledger.add("mjcf.effort", "warning", text, where, size=Measured(needed[a], bound))
        elif abs(d.actuator_force[a]) >= bound:
            text = f"keyframe '{name}': actuator '{m.actuator(a).name}' is at its maximum effort, {bound:g} N or N m."
            ledger.wrong(
                "mjcf.keyframe",
                text,
                m.actuator(a).name,
                size=Measured(d.actuator_force[a], bound),
                suggestion="set the actuator's control in the keyframe to the value of its joint",
            )


def _holding(m: mujoco.MjModel, d: mujoco.MjData) -> Array:
    """Return the forces (nu,) in N or N m with which the actuators hold the robot at rest, with closed loops.

    The forces of the actuators and of the equality constraints balance gravity, in the least-squares sense. Loops hold
    what they can: the efforts are the smallest ones.
    """
    columns = np.zeros((m.nv, m.nu))
    for a in range(m.nu):
        for k in range(int(d.moment_rownnz[a])):
            at = int(d.moment_rowadr[a]) + k
            columns[int(d.moment_colind[at]), a] = d.actuator_moment.ravel()[at]
    held = [k for k in range(d.nefc) if d.efc_type[k] == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
    loops = np.zeros((m.nv, len(held)))
    for i, k in enumerate(held):
        row, force = np.zeros(m.nv), np.zeros(d.nefc)
        force[k] = 1.0
        mujoco.mj_mulJacTVec(m, d, row, force)
        loops[:, i] = row
    return np.linalg.lstsq(np.hstack([columns, loops]), d.qfrc_bias - d.qfrc_passive, rcond=None)[0][: m.nu]


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of an MJCF file with its poses along the tracks, and report its faults."""
    admit(path)
    ledger.tool, ledger.version = "mujoco", mujoco.__version__
    return played(Mjcf(path, ledger), path, ledger, context)
