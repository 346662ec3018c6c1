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
from twin.exchange.audit.mechanism_data import WORLD
from twin.exchange.audit.motion import Content, FileClip
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Ledger, Measured, ReadError, quantity, um
from twin.exchange.formats.mjcf.audit.claims import Balance, check_claims
from twin.exchange.formats.mjcf.audit.further import further
from twin.exchange.formats.mjcf.audit.physics import BALL, FREE, HINGE, SLIDE, compiled_physics
from twin.exchange.formats.mjcf.audit.shapes import link_shapes
from twin.exchange.formats.urdf.audit import assumed_masses, parse_xml, partly_shown

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
        _check_model(m, self.data, ledger)
        # Assumed masses are held by nothing: the controls are those of the robot, which has no such masses.
        weighed = not self.content.physics.assumed
        check_claims(path.read_text("utf-8", errors="replace"), m, _at_keyframe(m, self.data), weighed, ledger)
        mujoco.mj_resetData(m, self.data)

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
            gap, equality = _gap(m, d)
            if gap > worst:
                worst = gap
                where = equality
                when = f"t = {clip.times[k]:.4g} s"
        if m.neq:
            self._ledger.row(f"clip '{clip.name}': loops in MuJoCo", worst, "m", LOOP_TOL, where=where, when=when)
        if worst > LOOP_TOL:
            text = f"clip '{clip.name}': equality '{where}' is open by {_opening(m, where, worst)}."
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
            if joint not in low or abs(low[joint]) > 1e29:
                continue
            lower = -np.inf
            upper = np.inf
            if m.jnt_limited[j]:
                lower, upper = m.jnt_range[j].tolist()
            off = float(np.max(np.abs([lower - low[joint], upper - high[joint]])))
            scale = 1.0
            for limit in (low[joint], high[joint]):
                if abs(limit) < 1e29:  # larger ones mean "no limit"
                    scale = max(scale, abs(limit))
            if not off <= LIMIT_TOL * scale:
                text = (
                    f"joint '{joint}' has range {lower:g} .. {upper:g}; in {name} it is {low[joint]:g} .. "
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


def _opening(m: mujoco.MjModel, equality: str, gap: float) -> str:
    """Return the residual of an equality constraint as text: a length of points, else in m or rad."""
    if equality and m.equality(equality).type == mujoco.mjtEq.mjEQ_CONNECT:
        return quantity(gap, "m")
    return f"{gap:.4g} m or rad"


def _robot_name(spec: mujoco.MjSpec) -> str:
    """Return the name of the model; "" if the file states none, for which MuJoCo has a name of its own."""
    name = str(spec.modelname)
    return "" if name == mujoco.MjSpec().modelname else name


def _at_keyframe(m: mujoco.MjModel, d: mujoco.MjData) -> Balance | None:
    """Set the state to the first keyframe; return the forces there; None without a keyframe."""
    if not m.nkey:
        return None
    mujoco.mj_resetDataKeyframe(m, d, 0)
    mujoco.mj_fwdPosition(m, d)
    mujoco.mj_fwdVelocity(m, d)
    mujoco.mj_fwdActuation(m, d)
    columns, loops, gravity = _statics(m, d)
    forces = d.actuator_force.copy()
    servo = m.actuator_biastype == int(mujoco.mjtBias.mjBIAS_AFFINE)
    pulled, *_ = np.linalg.lstsq(np.hstack([columns * servo, loops]), gravity, rcond=None)
    holding = pulled[: m.nu] * servo
    remaining = _unbalanced(gravity - columns @ forces, loops)
    least = _unbalanced(gravity - columns @ holding, loops)
    weight = float(np.abs(gravity).max(initial=0.0))
    return Balance(forces, holding, remaining, least, weight)


def _unbalanced(efforts: Array, loops: Array) -> float:
    """Return the largest of the efforts (nv,) in N or N m that the loops (nv, k) cannot carry."""
    carried, *_ = np.linalg.lstsq(loops, efforts, rcond=None)
    return float(np.abs(efforts - loops @ carried).max(initial=0.0))


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


def _check_model(m: mujoco.MjModel, d: mujoco.MjData, ledger: Ledger) -> None:
    """Report faults of actuators and keyframes."""
    names: dict[str, int] = {}
    for j in range(m.njnt):
        if m.joint(j).name:
            names[m.joint(j).name] = j
    for a in range(m.nu):
        if int(m.actuator_trntype[a]) != int(mujoco.mjtTrn.mjTRN_JOINT):
            continue
        name = m.actuator(a).name
        j = int(m.actuator_trnid[a, 0])
        if names.get(name, j) != j:
            text = f"actuator '{name}' drives joint '{m.joint(j).name}', not the joint of the same name."
            advice = "let the actuator drive the joint of the same name, or rename the actuator"
            ledger.wrong("mjcf.actuator", text, name, suggestion=advice)
    for a in range(m.nu):
        _check_servo(m, a, ledger)
        _check_ranges(m, a, ledger)
    _check_names(m, ledger)
    _check_colliders(m, ledger)
    _check_softness(m, ledger)
    _check_soft_limits(m, ledger)
    for k in range(m.nkey):
        _check_key(m, d, k, ledger)
    mujoco.mj_resetData(m, d)


def _check_servo(m: mujoco.MjModel, a: int, ledger: Ledger) -> None:
    """Report a position servo whose control is no position: force = gain * control - stiffness * coordinate + ...

    The control is the coordinate, or the displacement of the coordinate from `ref`.
    """
    name = m.actuator(a).name
    gain = float(m.actuator_gainprm[a, 0])
    stiffness = -float(m.actuator_biasprm[a, 1])
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
    stretch = _stretch(m, a)
    gear = float(m.actuator_gear[a, 0])
    if stretch is None or not m.actuator_ctrllimited[a] or not gear:
        return
    range_, at_home, kind = stretch
    lowest, highest = np.sort(m.actuator_ctrlrange[a] / gear)
    beyond = []
    for start in (0.0, at_home):
        low, high = range_ - start
        beyond.append(max(float(low - lowest), float(highest - high)))
    largest = float(np.abs(range_).max())
    if min(beyond) > LIMIT_TOL * max(1.0, largest):
        text = (
            f"actuator '{name}': ctrlrange {lowest:.6g} .. {highest:.6g} goes beyond the range of its {kind} by "
            f"{min(beyond):.6g}: relative to home it is {low:.6g} .. {high:.6g}."
        )
        advice = f"write ctrlrange = range of the {kind} - its value at home"
        ledger.wrong("mjcf.control", text, name, size=min(beyond), suggestion=advice)


def _check_ranges(m: mujoco.MjModel, a: int, ledger: Ledger) -> None:
    """Report ranges of an actuator that the file declares and switches off: MuJoCo then ignores them."""
    name = m.actuator(a).name
    for what, limited, range_ in (
        ("ctrl", m.actuator_ctrllimited[a], m.actuator_ctrlrange[a]),
        ("force", m.actuator_forcelimited[a], m.actuator_forcerange[a]),
    ):
        if limited or not range_.any():
            continue
        text = (
            f"actuator '{name}' has {what}range {range_[0]:g} .. {range_[1]:g}, but {what}limited is false: MuJoCo "
            "ignores the range."
        )
        ledger.add("mjcf.range_off", "warning", text, name, suggestion=f"remove {what}limited, or {what}range")


def _stretch(m: mujoco.MjModel, a: int) -> tuple[Array, float, str] | None:
    """Return (range (2,), value at home, "joint" or "tendon") of what an actuator moves; None if it has no range."""
    i = int(m.actuator_trnid[a, 0])
    moves = int(m.actuator_trntype[a])
    if moves == int(mujoco.mjtTrn.mjTRN_TENDON) and m.tendon_limited[i]:
        return m.tendon_range[i], float(m.tendon_length0[i]), "tendon"
    if moves == int(mujoco.mjtTrn.mjTRN_JOINT) and m.jnt_limited[i] and m.jnt_type[i] in (HINGE, SLIDE):
        return m.jnt_range[i], float(m.qpos0[m.jnt_qposadr[i]]), "joint"
    return None


def _check_names(m: mujoco.MjModel, ledger: Ledger) -> None:
    """Report hinges and slides without a name if most others of the file have one: values are assigned by name."""
    single = [j for j in range(m.njnt) if m.jnt_type[j] in (HINGE, SLIDE)]
    unnamed = [j for j in single if not m.joint(j).name]
    if 2 * len(unnamed) >= len(single):
        return
    for j in unnamed:
        body = m.body(int(m.jnt_bodyid[j])).name
        text = f"the joint of body '{body}' has no name; {len(single) - len(unnamed)} others of the file have one."
        ledger.add("mjcf.unnamed", "warning", text, body, suggestion="name the joint as in the other files")


def _check_colliders(m: mujoco.MjModel, ledger: Ledger) -> None:
    """Report meshes that a body has twice, and meshes that collide in another way than most others in the file."""
    forms: dict[int, tuple[int, int]] = {}
    seen: set[tuple[bytes, ...]] = set()
    for g in range(m.ngeom):
        if m.geom_type[g] != mujoco.mjtGeom.mjGEOM_MESH:
            continue
        forms[g] = (int(m.geom_contype[g]), int(m.geom_conaffinity[g]))
        fields = (m.geom_bodyid, m.geom_dataid, m.geom_pos, m.geom_quat, m.geom_contype, m.geom_conaffinity)
        place = tuple(field[g].tobytes() for field in (*fields, m.geom_group, m.geom_matid))
        if place in seen:
            name, mesh = m.body(int(m.geom_bodyid[g])).name, m.mesh(int(m.geom_dataid[g])).name
            text = f"body '{name}' has the shape of mesh '{mesh}' twice at the same place."
            ledger.add("mjcf.repeated", "warning", text, name, suggestion="keep one of them")
        seen.add(place)
    if len(forms) < 3:  # two that differ say nothing about which of them is meant
        return
    common, count = Counter(forms.values()).most_common(1)[0]
    if count < 0.7 * len(forms):
        return
    for g, form in forms.items():
        if form != common:
            name, mesh = m.body(int(m.geom_bodyid[g])).name, m.mesh(int(m.geom_dataid[g])).name
            text = (
                f"body '{name}': the shape of mesh '{mesh}' has contype {form[0]} and conaffinity {form[1]}, "
                f"{count} others have {common[0]} and {common[1]}: it collides with other things."
            )
            ledger.add("mjcf.collider", "warning", text, name, suggestion="give all shapes the same bits")


def _check_softness(m: mujoco.MjModel, ledger: Ledger) -> None:
    """Report equality constraints whose solver parameters differ from those of most others in the file."""
    rows: list[tuple[float, ...]] = []
    for e in range(m.neq):
        rows.append((*m.eq_solref[e].tolist(), *m.eq_solimp[e].tolist()))
    if not rows:
        return
    common, _ = Counter(rows).most_common(1)[0]
    for e, row in enumerate(rows):
        if row != common:
            name = m.equality(e).name
            text = (
                f"equality '{name}' has solref {row[0]:g} {row[1]:g} and solimp {row[2]:g} {row[3]:g}, most others "
                f"have {common[0]:g} {common[1]:g} and {common[2]:g} {common[3]:g}: its loop opens by another amount "
                "under load."
            )
            ledger.wrong("mjcf.softness", text, name, suggestion="give all loops the same solref and solimp")


def _check_soft_limits(m: mujoco.MjModel, ledger: Ledger) -> None:
    """Report limits of joints that yield by other parameters of the solver than most others in the file."""
    rows: dict[str, tuple[float, ...]] = {}
    for j in range(m.njnt):
        if m.jnt_limited[j]:
            rows[m.joint(j).name] = (*m.jnt_solref[j].tolist(), *m.jnt_solimp[j].tolist())
    if len(rows) < 3:  # two that differ say nothing about which of them is meant
        return
    common, count = Counter(rows.values()).most_common(1)[0]
    if count < 0.7 * len(rows):
        return
    for name, row in rows.items():
        if row != common:
            text = (
                f"the limit of joint '{name}' has solref {row[0]:g} {row[1]:g} and solimp {row[2]:g} {row[3]:g}, most "
                f"others have {common[0]:g} {common[1]:g} and {common[2]:g} {common[3]:g}: it yields differently."
            )
            ledger.add("mjcf.softness", "warning", text, name, suggestion="give all limits the same parameters")


def _check_key(m: mujoco.MjModel, d: mujoco.MjData, k: int, ledger: Ledger) -> None:
    name = m.key(k).name or f"key {k}"
    mujoco.mj_resetDataKeyframe(m, d, k)
    mujoco.mj_fwdPosition(m, d)
    worst, where = _gap(m, d)
    if m.neq:
        ledger.row(f"loops at keyframe '{name}'", worst, "m", KEY_GAP)
    if worst > KEY_GAP:
        text = f"keyframe '{name}': equality '{where}' is open by {_opening(m, where, worst)}."
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
    columns, loops, gravity = _statics(m, d)
    forces, *_ = np.linalg.lstsq(np.hstack([columns, loops]), gravity, rcond=None)
    return forces[: m.nu]


def _statics(m: mujoco.MjModel, d: mujoco.MjData) -> tuple[Array, Array, Array]:
    """Return what acts at rest: efforts (nv, nu) by actuator, those (nv, k) by loop constraint, and weight (nv,)."""
    columns = np.zeros((m.nv, m.nu))
    for a in range(m.nu):
        for k in range(int(d.moment_rownnz[a])):
            at = int(d.moment_rowadr[a]) + k
            columns[int(d.moment_colind[at]), a] = d.actuator_moment.ravel()[at]
    held = np.flatnonzero(d.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    loops = np.zeros((m.nv, len(held)))
    for i, k in enumerate(held):
        row = np.zeros(m.nv)
        force = np.zeros(d.nefc)
        force[k] = 1.0
        mujoco.mj_mulJacTVec(m, d, row, force)
        loops[:, i] = row
    return columns, loops, d.qfrc_bias - d.qfrc_passive


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of an MJCF file with its poses along the tracks, and report its faults."""
    admit(path)
    ledger.tool = "mujoco"
    ledger.version = mujoco.__version__
    return played(Mjcf(path, ledger), path, ledger, context)
