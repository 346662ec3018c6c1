"""Read an MJCF file: MuJoCo compiles the file, and the mechanism is made from the compiled model.

The compiled model has all defaults, includes, units and meshes resolved. Frames of bodies are unchanged. If a body has
several joints, massless bodies are added between the joints. Equality constraints close loops (connect, weld) or couple
joints. A joint coordinate has the same value as in MuJoCo, also if the joint has a `ref`.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twin.core import spatial
from twin.core.errors import SourceError, UnsupportedError
from twin.core.foreign.admit import admit
from twin.core.foreign.budget import check_size, read_bytes
from twin.core.spatial import Array
from twin.exchange.formats.mjcf.read.geoms import shown
from twin.exchange.formats.mjcf.read.motors import fixed_tendon, read_motors
from twin.exchange.formats.mjcf.read.robots import chosen, tied_by
from twin.exchange.read.source import (
    Findings,
    Imported,
    Names,
    Options,
    along,
    assemble,
    possible,
    stated_gravity,
)
from twin.model.body import TOOL, Body, Frame, Point
from twin.model.inertia import Inertia
from twin.model.joint import Drive, Joint, JointType
from twin.model.mechanism import Coupling
from twin.usd.read.names import identifier

_ATTRIBUTE = re.compile(r"""([\w:]+)\s*=\s*["']([^"']*)["']""")

_FREE, _BALL, _SLIDE, _HINGE = range(4)
_TYPES: tuple[JointType, ...] = ("free", "spherical", "prismatic", "revolute")


def read_mjcf(path: Path, root: str | None = None) -> Imported:
    """Read an MJCF file.

    If the file has several robots, `root` selects the robot by the name of one of its bodies; "world" selects all
    robots, which are read as one mechanism.

    Raises:
        SourceError: MuJoCo rejects the file, the file has a constraint that a mechanism cannot express, or the file has
            several robots and `root` is None.
    """
    import mujoco

    check_size(path, "MJCF")
    missing = Findings()
    try:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            spec = mujoco.MjSpec.from_file(str(path))
            gone = _without_missing(spec, path, missing)
            model = spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise SourceError(f"{path}: MuJoCo rejects the file: {_one_line(error)}") from error
    reader = _Mjcf(path, model, gone, root)
    reader.findings += missing
    for caught in told:
        reader.findings.warn("mujoco", f"MuJoCo: {_one_line(caught.message)}", path.name)
    imported = reader.read()
    unlimited = set()
    for joint in spec.joints:
        # a joint without a range states nothing; only `limited="false"` states that it has no limits
        if joint.limited == mujoco.mjtLimited.mjLIMITED_FALSE:
            unlimited.add(reader.joints[joint.id])
    return replace(imported, unlimited=frozenset(unlimited))


def _one_line(message: object) -> str:
    """Return a message with each run of white space replaced by one space."""
    return " ".join(str(message).split())


def refuse_nan(path: Path) -> None:
    """Raise `SourceError` if a number is NaN: MuJoCo never finishes compiling an ellipsoid whose size is NaN."""
    text = read_bytes(path, "MJCF").decode(errors="replace")
    for number, line in enumerate(text.splitlines(), 1):
        for name, value in _ATTRIBUTE.findall(line):
            tokens = value.lower().split()
            # Only numbers: "nan" may also be a word of a name or a text.
            if "nan" in tokens and all(map(_is_number, tokens)):
                raise SourceError(f"{path}:{number}: {name} = '{value[:80]}' contains a number that is not finite")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _pose(p: Array, q_wxyz: Array) -> Array:
    return spatial.pose(spatial.matrix_from_quat_wxyz(q_wxyz), p)


class _Mjcf:
    def __init__(self, path: Path, model, missing: _Missing, root: str | None) -> None:
        import mujoco

        self.path = path
        self.m = model
        self.mujoco = mujoco
        self.missing = missing
        self.root = root
        self.findings = Findings()
        self.efforts: dict[str, float] = {}

    def _name(self, kind: str, i: int) -> str:
        code = getattr(self.mujoco.mjtObj, f"mjOBJ_{kind}")
        try:
            name = self.mujoco.mj_id2name(self.m, code, i)
        except UnicodeDecodeError as error:
            raise SourceError(f"{self.path}: the name of {kind.lower()} {i} is not UTF-8") from error
        return name or f"{kind.lower()}{i}"

    def _names(self, kind: str, count: int) -> list[str]:
        """Return the identifiers of all objects of one kind, by number."""
        stated = [self._name(kind, i) for i in range(count)]
        identifiers = Names(kind.lower(), stated, self.findings)
        return [identifiers[name] for name in stated]

    def read(self) -> Imported:
        m = self.m
        if m.nflex:
            raise UnsupportedError(f"{self.path}: the model has a flexible body, but only rigid bodies are supported")
        if m.nskin:  # for display only: a surface that bends with the bodies
            self.findings.warn("skin", f"{m.nskin} skins are not imported: only rigid bodies are shown.", "skin")
        self.bodies = self._names("BODY", m.nbody)
        self.joints = self._names("JOINT", m.njnt)
        kept = chosen(m, self.path, self.root, self._name, self.findings)
        self.motors = read_motors(m, kept, self.joints, self._name, self.findings)
        self.drives = self._actuators()
        self.drives |= dict.fromkeys(self.motors.joints)
        if not m.nu:
            self.drives = dict.fromkeys(self._all_driven(kept))
        extra: list[Body] = []
        joints: list[Joint] = []
        for i in kept[1:]:
            joints += self._hang(i, extra)
        bodies = self._bodies(kept) + extra
        couplings = self._equalities(kept, joints)
        self.findings += _left_out(m, self._name, self.motors.tendons)
        frames, points = self._sites(kept)
        first_name = m.names[: m.names.index(b"\0")]  # all names of the model in a row; the first is that of the model
        name = first_name.decode("utf-8", "replace") or self.path.stem
        present = {joint.name for joint in joints}
        efforts = {joint: effort for joint, effort in self.efforts.items() if joint in present}
        start = self._coordinates(kept, m.qpos0)
        out = assemble(
            self.path, name, self.bodies[0], bodies, joints, frames, couplings, self.findings, efforts, start
        )
        gravity = self._gravity()
        keys = self._keys(kept)
        driven = {self.joints[k] for k in self.drives}
        postures: dict[str, dict[str, float]] = {}
        for key, values in keys.items():
            postures[key] = {joint: value for joint, value in values.items() if joint in driven}
        mechanism = replace(
            out.mechanism,
            actuators=self.motors.actuators,
            transmissions=self.motors.transmissions,
            gravity=gravity,
            points=tuple(points),
            postures=postures,
        )
        return replace(out, mechanism=mechanism, keys=keys)

    def _bodies(self, kept: Sequence[int]) -> list[Body]:
        meshes, partly = shown(self.m, self.bodies, self._name, self.findings)
        bodies: list[Body] = []
        for i in kept:
            whole = i not in partly and self._name("BODY", i) not in self.missing.shapeless
            bodies.append(Body(self.bodies[i], tuple(meshes[i]), self._inertia(i), whole))
        return bodies

    def _equalities(self, kept: Sequence[int], joints: list[Joint]) -> list[Coupling]:
        """Return the couplings of the robot, and append the joints that close its loops to `joints`."""
        couplings: list[Coupling] = []
        used = {joint.name for joint in joints}
        for i in range(self.m.neq):
            tied = tied_by(self.m, i)
            if tied.issubset(kept):
                self._equality(i, joints, couplings, used)
            elif not tied.isdisjoint(kept):
                where = self._name("EQUALITY", i)
                text = f"equality '{where}' is left out, because it acts on a body that is left out."
                self.findings.warn("equality", text, where)
        return couplings

    def _sites(self, kept: Sequence[int]) -> tuple[list[Frame], list[Point]]:
        """Return the sites of the robot, as frames and points.

        In files that twin exported, the site frame_NAME marks the frame NAME, and point_NAME the point NAME; one of the
        frames is the tool. In all other files, a site is a frame of its name.
        """
        m = self.m
        names = self._names("SITE", m.nsite)
        exported = f"frame_{TOOL}" in [self._name("SITE", i) for i in range(m.nsite)]
        frames: list[Frame] = []
        points: list[Point] = []
        for i, name in enumerate(names):
            if m.site_bodyid[i] not in kept:
                continue
            body = self.bodies[m.site_bodyid[i]]
            if exported and name.startswith("point_"):
                points.append(Point(name.removeprefix("point_"), body, m.site_pos[i].copy()))
                continue
            if exported:
                name = name.removeprefix("frame_")
            frames.append(Frame(name, body, _pose(m.site_pos[i], m.site_quat[i])))
        return frames, points

    def _coordinates(self, kept: Sequence[int], qpos: Array) -> dict[str, float]:
        """Return {joint: value in m or rad} at coordinates qpos (nq,), for the joints with one coordinate."""
        return {self.joints[k]: float(qpos[self.m.jnt_qposadr[k]]) for k in self._single(kept)}

    def _gravity(self) -> tuple[float, float, float]:
        """Return the gravitational acceleration in m/s2; zero if the file disables gravity."""
        if self.m.opt.disableflags & int(self.mujoco.mjtDisableBit.mjDSBL_GRAVITY):
            return (0.0, 0.0, 0.0)
        return stated_gravity(self.m.opt.gravity, self.findings)

    def _keys(self, kept: Sequence[int]) -> dict[str, dict[str, float]]:
        """Return {key frame: {joint: value in m or rad}} for the joints with one coordinate."""
        keys: dict[str, dict[str, float]] = {}
        for i in range(self.m.nkey):
            name = self._name("KEY", i)
            label = identifier(name)
            if label == "home" or label in keys:  # `home` is the rest pose with closed loops
                label = f"{label}_key{i}"
            keys[label] = self._coordinates(kept, self.m.key_qpos[i])
            self.findings.note("key", f"key frame '{name}' becomes posture '{label}'.", label)
        return keys

    def _all_driven(self, kept: Sequence[int]) -> list[int]:
        """Return the joints that are driven in a file without actuators: all that have one coordinate and follow none.

        If equalities close loops, no joint is driven: the file does not say which of the joints of a loop could be.
        """
        m = self.m
        eq = self.mujoco.mjtEq
        followers: set[int] = set()
        for i in range(m.neq):
            if not m.eq_active0[i]:
                continue
            kind = eq(int(m.eq_type[i]))
            first = int(m.eq_obj1id[i])
            if kind in (eq.mjEQ_CONNECT, eq.mjEQ_WELD) and tied_by(m, i).issubset(kept):
                return []
            if kind == eq.mjEQ_JOINT:
                followers.add(first)
            if kind == eq.mjEQ_TENDON:
                # The first joint of the tendon is taken as the follower of the others.
                followers.update(list(fixed_tendon(m, first))[:1])
        driven = [k for k in self._single(kept) if k not in followers]
        if driven:
            text = f"the file has no actuators: {len(driven)} joints are imported as driven."
            self.findings.warn("driven", text, self.path.name)
        return driven

    def _single(self, kept: Sequence[int]) -> list[int]:
        """Return the numbers of the joints with one coordinate between the bodies of the robot."""
        numbers = []
        for k in range(self.m.njnt):
            if self.m.jnt_type[k] in (_SLIDE, _HINGE) and self.m.jnt_bodyid[k] in kept:
                numbers.append(k)
        return numbers

    def _hang(self, i: int, extra: list[Body]) -> list[Joint]:
        """Return the joints between a body and its parent, starting at the parent.

        The massless bodies between two joints are appended to `extra`.
        """
        m = self.m
        body = self.bodies[i]
        parent = self.bodies[m.body_parentid[i]]
        T = _pose(m.body_pos[i], m.body_quat[i])  # pose in the parent if every coordinate equals its `ref`
        first = m.body_jntadr[i]
        last = first + m.body_jntnum[i] - 1
        if last < first:
            return [Joint(f"{body}_mount", "fixed", parent, body, T)]
        joints: list[Joint] = []
        for k in range(first, last + 1):
            name = self.joints[k]
            kind = int(m.jnt_type[k])
            child = body
            if k != last:
                child = f"{body}_after_{name}"
                extra.append(Body(child))
            at = np.eye(4)
            ref = np.eye(4)
            if kind != _FREE:  # MuJoCo ignores the `pos` of a free joint
                at = spatial.pose(p=m.jnt_pos[k])
            if kind in (_SLIDE, _HINGE):
                if not np.abs(m.jnt_axis[k]).max() > 0.5:  # not a unit vector: MuJoCo could not normalise the axis
                    raise SourceError(f"{self.path}: the axis of joint '{name}' has length 0, or is too long")
                at = at @ along(m.jnt_axis[k])
                q0 = float(m.qpos0[m.jnt_qposadr[k]])
                ref = spatial.pose(p=[0, 0, -q0])
                if kind == _HINGE:
                    ref = spatial.pose(spatial.rotation_z(-q0))
            if kind == _FREE:
                text = f"joint '{name}' is a free joint: the base of the robot is not fixed to the world."
                self.findings.warn("free", text, name)
            joints.append(
                Joint(
                    name,
                    _TYPES[kind],
                    parent,
                    child,
                    T @ at @ ref,
                    at,
                    active=k in self.drives,
                    limits=self._limits(k, kind),
                    drive=self.drives.get(k),
                )
            )
            parent = child
            T = np.eye(4)
        return joints

    def _limits(self, k: int, kind: int) -> tuple[float, float] | None:
        m = self.m
        if not m.jnt_limited[k]:
            return None
        if kind == _BALL:
            raise UnsupportedError(
                f"{self.path}: ball joint '{self.joints[k]}' has a range of its rotation angle, which is not supported"
            )
        low, high = map(float, m.jnt_range[k])
        return low, high

    def _actuators(self) -> dict[int, Drive | None]:
        """Return {joint number: drive} of the driven joints; the drive is None without a position actuator."""
        m = self.m
        trn = self.mujoco.mjtTrn
        drives: dict[int, Drive | None] = {}
        for i in range(m.nu):
            if i in self.motors.numbers:
                continue
            name = self._name("ACTUATOR", i)
            kind = trn(int(m.actuator_trntype[i]))
            target = int(m.actuator_trnid[i, 0])
            if kind == trn.mjTRN_TENDON:
                tied = list(fixed_tendon(m, target))
                if tied:
                    self._warn_of_tendon(name, tied)
                    drives[tied[0]] = None
                    continue
            if kind not in (trn.mjTRN_JOINT, trn.mjTRN_JOINTINPARENT):
                text = f"actuator '{name}' acts on a spatial tendon, a site or a body, so it drives no joint."
                self.findings.warn("actuator", text, name)
            elif m.jnt_type[target] not in (_SLIDE, _HINGE):
                text = (
                    f"actuator '{name}' drives joint '{self.joints[target]}', which has several coordinates: the "
                    "actuator is left out."
                )
                self.findings.warn("actuator", text, name)
            else:
                drives[target] = self._drive(i, name, self.joints[target])
        return drives

    def _warn_of_tendon(self, name: str, tied: Sequence[int]) -> None:
        first, *rest = tied
        text = f"actuator '{name}' pulls a fixed tendon: joint '{self.joints[first]}' is imported as driven, "
        text += "without gains."
        if rest:
            others = ", ".join(f"'{self.joints[k]}'" for k in rest)
            text += f" The tendon's other joints, {others}, move only if an equality couples them."
        self.findings.warn("actuator", text, name)

    def _drive(self, i: int, name: str, joint: str) -> Drive | None:
        """Return the drive of the actuator with number `i`, for its joint; None if it is not a position servo.

        MuJoCo's gains are for the motor, those of a drive for the joint: the gear ratio counts twice.
        """
        m = self.m
        gear = float(m.actuator_gear[i, 0])
        gain = m.actuator_gainprm[i, 0]
        bias = m.actuator_biasprm[i]
        kp = float(gain) * gear**2
        effort = None
        if m.actuator_forcelimited[i]:
            effort = float(np.abs(m.actuator_forcerange[i]).max() * abs(gear))
        # A position servo has the force gain * control - gain * length: its bias has the negative gain.
        if bias[1] < 0 and np.isclose(-bias[1], gain) and kp > 0:
            return Drive(kp, max(0.0, float(-bias[2] * gear**2)), effort)
        if effort is not None:
            self.efforts[joint] = effort
        text = (
            f"actuator '{name}' is not a position servo: joint '{joint}' is imported as driven, and the gains of "
            "the actuator are ignored."
        )
        self.findings.warn("actuator", text, name)
        return None

    def _equality(self, i: int, joints: list[Joint], couplings: list[Coupling], used: set[str]) -> None:
        m = self.m
        eq = self.mujoco.mjtEq
        name = self._name("EQUALITY", i)
        kind = eq(int(m.eq_type[i]))
        label = identifier(name)
        while label in used:
            label += "_loop"
        used.add(label)
        if not m.eq_active0[i]:
            self.findings.warn("inactive", f"equality '{name}' is not active and is left out.", name)
        elif kind in (eq.mjEQ_CONNECT, eq.mjEQ_WELD):
            joints.append(self._loop(i, label, kind == eq.mjEQ_WELD))
        elif kind == eq.mjEQ_JOINT:
            couplings.append(self._coupling(i, name, label))
        elif kind == eq.mjEQ_TENDON and m.eq_obj2id[i] < 0:
            couplings.append(self._tendon(i, name, label))
        else:
            what = "couples two tendons"
            if kind != eq.mjEQ_TENDON:
                what = f"has the type {kind.name.removeprefix('mjEQ_').lower()}"
            known = "supported are connect, weld, joint and tendon (a single tendon)"
            raise UnsupportedError(f"{self.path}: equality '{name}' {what}, which a mechanism cannot express; {known}")

    def _coupling(self, i: int, name: str, label: str) -> Coupling:
        """Return the coupling of two joints a and b. MuJoCo: a - a_ref = c0 + c1 (b - b_ref) + c2 (b - b_ref)^2 ..."""
        m = self.m
        a = int(m.eq_obj1id[i])
        b = int(m.eq_obj2id[i])
        c = m.eq_data[i, :5]
        if b < 0 or not np.any(c[1:]):
            raise UnsupportedError(f"{self.path}: equality '{name}' locks joint '{self.joints[a]}': remove the joint")
        if np.any(c[2:]):
            raise UnsupportedError(
                f"{self.path}: equality '{name}' is a polynomial of degree > 1; the degree must be 1"
            )
        ratio = float(c[1])
        a_ref = float(m.qpos0[m.jnt_qposadr[a]])
        b_ref = float(m.qpos0[m.jnt_qposadr[b]])
        total = float(c[0]) + a_ref - ratio * b_ref
        return Coupling(label, (self.joints[a], self.joints[b]), (1.0, -ratio), total)

    def _tendon(self, i: int, name: str, label: str) -> Coupling:
        """Return the coupling of a fixed tendon: the sum of coefficient times joint coordinate is constant."""
        tendon = int(self.m.eq_obj1id[i])
        tied = fixed_tendon(self.m, tendon)
        if not tied:
            raise UnsupportedError(
                f"{self.path}: equality '{name}' constrains a spatial tendon, which is not supported"
            )
        total = float(self.m.tendon_length0[tendon] + self.m.eq_data[i, 0])
        return Coupling(label, tuple(self.joints[j] for j in tied), tuple(tied.values()), total)

    def _loop(self, i: int, label: str, weld: bool) -> Joint:
        m = self.m
        data = m.eq_data[i]
        a = int(m.eq_obj1id[i])
        b = int(m.eq_obj2id[i])
        kind: JointType = "fixed" if weld else "spherical"
        if int(m.eq_objtype[i]) == int(self.mujoco.mjtObj.mjOBJ_SITE):
            T_a = _pose(m.site_pos[a], m.site_quat[a])
            T_b = _pose(m.site_pos[b], m.site_quat[b])
            a = int(m.site_bodyid[a])
            b = int(m.site_bodyid[b])
        elif weld:
            # As in MuJoCo's engine_core_constraint.c: the anchor is data[3:6] in body 1 and data[0:3] in body 2
            T_a = _pose(data[3:6], data[6:10])
            T_b = spatial.pose(p=data[0:3])
        else:
            T_a = spatial.pose(p=data[0:3])
            T_b = spatial.pose(p=data[3:6])
        return Joint(label, kind, self.bodies[a], self.bodies[b], T_a, T_b)

    def _inertia(self, i: int) -> Inertia | None:
        m = self.m
        if i == 0 or not m.body_mass[i] or self._name("BODY", i) in self.missing.weightless:
            return None
        R = spatial.matrix_from_quat_wxyz(m.body_iquat[i])
        tensor = R @ np.diag(m.body_inertia[i]) @ R.T
        return possible(Inertia(float(m.body_mass[i]), m.body_ipos[i].copy(), tensor), self.bodies[i], self.findings)


class _Missing(NamedTuple):
    """Names of bodies that lack shapes because of missing files, and of those among them whose mass is unknown."""

    shapeless: set[str]
    weightless: set[str]


def _without_missing(spec, path: Path, findings: Findings) -> _Missing:
    """Remove meshes and textures whose files are missing, and the geoms of these meshes, from a MuJoCo specification.

    `spec` is parsed, but not compiled. Each missing file is reported as a warning.

    The mass of a body is unknown if a geom was removed and the file states no inertia.
    """
    lost: dict[str, str] = {}
    for mesh in list(spec.meshes):
        if mesh.file and not _place(spec, path, spec.meshdir, mesh.file).is_file():
            searched = Path(mesh.file).name if spec.strippath else mesh.file
            lost[mesh.name or Path(mesh.file).stem] = (Path(spec.meshdir) / searched).as_posix()
            spec.delete(mesh)
    weightless: set[str] = set()
    shapeless: set[str] = set()
    gone: set[str] = set()
    for geom in list(spec.geoms):
        if geom.meshname not in lost:
            continue
        body = geom.parent
        text = f"body '{body.name}': mesh {lost[geom.meshname]} is missing: the body is shown without this mesh."
        findings.warn("mesh", text, lost[geom.meshname])
        shapeless.add(body.name)
        if not body.explicitinertial and body.name != "world":
            weightless.add(body.name)
        gone.add(geom.name)
        spec.delete(geom)
    reported = {finding.where for finding in findings}
    for name, file in lost.items():
        if file not in reported:
            reported.add(file)
            findings.warn("mesh", f"mesh '{name}': {file} is missing; no body uses it.", file)
    gone.discard("")  # a geom without a name is in no pair
    for pair in list(spec.pairs):
        if pair.geomname1 in gone or pair.geomname2 in gone:
            spec.delete(pair)
    _textures(spec, path, findings)
    for body in spec.bodies:
        if body.name in weightless:  # a placeholder that compiles; the reader ignores this mass
            body.explicitinertial = True
            body.mass = 1.0
            body.inertia = [1.0, 1.0, 1.0]
            text = f"body '{body.name}' has no mass, because its mesh is missing."
            findings.warn("inertia", text, body.name)
    return _Missing(shapeless, weightless)


def _textures(spec, path: Path, findings: Findings) -> None:
    for texture in list(spec.textures):
        missing: list[str] = []
        for file in (texture.file, *texture.cubefiles):
            if file and not _place(spec, path, spec.texturedir, file).is_file():
                missing.append(file)
        if not missing:
            continue
        for material in spec.materials:
            textures = list(material.textures)
            if texture.name in textures:
                # Assigned as a whole, because MuJoCo returns a copy of the list.
                material.textures = ["" if name == texture.name else name for name in textures]
        findings.warn("texture", f"texture '{texture.name}': {missing[0]} does not exist.", missing[0])
        spec.delete(texture)


def _place(spec, path: Path, folder: str, file: str) -> Path:
    """Return the path at which MuJoCo searches for a file."""
    if spec.strippath:
        file = Path(file).name
    return path.parent / folder / file


def _left_out(m, name: Callable[[str, int], str], kept_tendons: Collection[int] = ()) -> Findings:
    """Return findings on data of the model that are not imported.

    `name` is a function (kind, number) that returns the name of an object. `kept_tendons` are the numbers of the
    tendons in transmissions, which are imported.
    """
    import mujoco

    found = Findings()
    for i in range(m.njnt):
        dof = int(m.jnt_dofadr[i])
        kept = _nonzero(
            {
                "stiffness": float(np.ravel(m.jnt_stiffness[i])[0]),
                "damping": float(np.ravel(m.dof_damping[dof])[0]),
                "frictionloss": float(m.dof_frictionloss[dof]),
                "armature": float(m.dof_armature[dof]),
            }
        )
        if m.jnt_actfrclimited[i]:
            low, high = m.jnt_actfrcrange[i]
            kept.append(f"actuatorfrcrange {low:g} .. {high:g}")
        if kept:
            where = name("JOINT", i)
            found.warn("friction", f"joint '{where}': {_not_imported(kept)}", where)
    for i in kept_tendons:
        kept = _nonzero(
            {
                "stiffness": np.ravel(m.tendon_stiffness[i])[0],
                "damping": np.ravel(m.tendon_damping[i])[0],
                "frictionloss": np.ravel(m.tendon_frictionloss[i])[0],
            }
        )
        if kept:
            where = name("TENDON", i)
            found.warn("friction", f"tendon '{where}': {_not_imported(kept)}", where)
    read = set(kept_tendons)
    for i in range(m.neq):
        if m.eq_type[i] == mujoco.mjtEq.mjEQ_TENDON:
            read.add(int(m.eq_obj1id[i]))
    for i in range(m.ntendon):
        if i not in read:
            where = name("TENDON", i)
            found.warn("tendon", f"tendon '{where}' is not imported: no equality constrains its length.", where)
    for i in range(m.nexclude):
        signature = int(m.exclude_signature[i])  # MuJoCo packs the numbers of both bodies, with 16 bits each
        a = name("BODY", signature >> 16)
        b = name("BODY", signature & 0xFFFF)
        found.note("contact", f"contact exclusion of '{a}' and '{b}' is not imported.", a)
    for i in range(m.npair):
        a = name("GEOM", int(m.pair_geom1[i]))
        b = name("GEOM", int(m.pair_geom2[i]))
        found.note("contact", f"contact pair of '{a}' and '{b}' is not imported.", a)
    if m.neq:
        found.note("soft", "equality constraints are soft in MuJoCo, but exact in the mechanism.", name("EQUALITY", 0))
    for count, what in ((m.nsensor, "sensors"), (m.ncam, "cameras"), (m.nlight, "lights")):
        if count:
            found.note("unread", f"{count} {what} are not imported.", what)
    if m.nplugin:
        found.warn("plugin", f"{m.nplugin} plug-ins are not imported.", "plugin")
    return found


def _nonzero(values: Mapping[str, float]) -> list[str]:
    """Return a text "key value" for each value other than 0."""
    return [f"{key} {value:g}" for key, value in values.items() if value]


def _not_imported(kept: Sequence[str]) -> str:
    """Return the end of a sentence on values that are not imported."""
    verb = "is" if len(kept) == 1 else "are"
    return f"{', '.join(kept)} {verb} not imported."


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of an MJCF file; see `read_mjcf`."""
    refuse_nan(path)
    if options.guarded:
        admit(path)
    return read_mjcf(path, options.root)
