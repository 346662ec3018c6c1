"""Read an MJCF file: MuJoCo compiles the file, and the mechanism is made from the compiled model.

The compiled model has all defaults, includes, units and meshes resolved. Frames of bodies are unchanged. If a body has
several joints, massless bodies are added between the joints. Equality constraints close loops (connect, weld) or couple
joints. A joint coordinate has the same value as in MuJoCo, also if the joint has a `ref`.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twin.core import spatial
from twin.core.errors import SourceError
from twin.core.foreign.admit import admit
from twin.core.foreign.budget import check_size, read_bytes
from twin.core.spatial import Array
from twin.exchange.formats.mjcf.read.motors import fixed_tendon, read_motors
from twin.exchange.formats.mjcf.read.robots import chosen, tied_by
from twin.exchange.formats.mjcf.read.shapes import shown
from twin.exchange.read.source import (
    Findings,
    Imported,
    Names,
    Options,
    along,
    assemble,
    possible,
    stated_gravity,
    warning,
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
        raise SourceError(f"{path}: MuJoCo rejects the file: {' '.join(str(error).split())}") from error
    reader = _Mjcf(path, model, gone, root)
    reader.findings += missing
    reader.findings += [warning("mujoco", f"MuJoCo: {' '.join(str(w.message).split())}", path.name) for w in told]
    return reader.read()


def refuse_nan(path: Path) -> None:
    """Raise `SourceError` if a number is NaN: MuJoCo never finishes compiling an ellipsoid whose size is NaN."""
    for number, line in enumerate(read_bytes(path, "MJCF").decode(errors="replace").splitlines(), 1):
        for name, value in _ATTRIBUTE.findall(line):
            if "nan" in (tokens := value.lower().split()) and all(map(_is_number, tokens)):
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

        self.path, self.m, self.mujoco = path, model, mujoco
        self.missing, self.root = missing, root
        self.findings = Findings()
        self.efforts: dict[str, float] = {}

    def _name(self, kind: str, i: int) -> str:
        try:
            name = self.mujoco.mj_id2name(self.m, getattr(self.mujoco.mjtObj, f"mjOBJ_{kind}"), i)
        except UnicodeDecodeError as error:
            raise SourceError(f"{self.path}: the name of {kind.lower()} {i} is not UTF-8") from error
        return name or f"{kind.lower()}{i}"

    def read(self) -> Imported:
        m = self.m
        if m.nflex:
            raise SourceError(f"{self.path}: the model has a flexible body, but only rigid bodies are supported")
        if m.nskin:  # for display only: a surface that bends with the bodies
            self.findings.warn("skin", f"{m.nskin} skins are not imported: only rigid bodies are shown.", "skin")
        names = Names("body", (self._name("BODY", i) for i in range(m.nbody)), self.findings)
        self.bodies = [names[self._name("BODY", i)] for i in range(m.nbody)]
        joint_names = Names("joint", (self._name("JOINT", i) for i in range(m.njnt)), self.findings)
        self.joints = [joint_names[self._name("JOINT", i)] for i in range(m.njnt)]
        kept = chosen(m, self.path, self.root, self._name, self.findings)
        self.motors = read_motors(m, kept, self.joints, self._name, self.findings)
        self.drives = dict(self._actuators())
        self.drives |= dict.fromkeys(self.motors.joints)
        if not m.nu:
            self.drives = dict.fromkeys(self._all_driven(kept))
        extra: list[Body] = []
        joints: list[Joint] = []
        for i in kept[1:]:
            joints += self._hang(i, extra)
        meshes, partly = shown(m, self.bodies, self._name, self.findings)
        bodies: list[Body] = []
        for i in kept:
            whole = i not in partly and self._name("BODY", i) not in self.missing.shapeless
            bodies.append(Body(self.bodies[i], tuple(meshes[i]), self._inertia(i), whole))
        bodies += extra
        used = {j.name for j in joints}
        couplings: list[Coupling] = []
        for i in range(m.neq):
            tied = tied_by(m, i)
            if tied <= set(kept):
                self._equality(i, joints, couplings, used)
            elif tied & set(kept):
                where = self._name("EQUALITY", i)
                text = f"equality '{where}' is left out, because it acts on a body that is left out."
                self.findings.warn("equality", text, where)
        self.findings += _left_out(m, self._name, self.motors.tendons)
        site_names = Names("site", (self._name("SITE", i) for i in range(m.nsite)), self.findings)
        # In files that twin exported, the site frame_NAME marks the frame NAME, and point_NAME the point NAME; one of
        # the frames is the tool.
        prefix = "frame_" if f"frame_{TOOL}" in site_names else ""
        frames, points = [], []
        for i in range(m.nsite):
            if m.site_bodyid[i] not in kept:
                continue
            name, body = site_names[self._name("SITE", i)], self.bodies[m.site_bodyid[i]]
            if prefix and name.startswith("point_"):
                points.append(Point(name.removeprefix("point_"), body, m.site_pos[i].copy()))
            else:
                frames.append(Frame(name.removeprefix(prefix), body, _pose(m.site_pos[i], m.site_quat[i])))
        name = (m.names[: m.names.index(b"\0")] or b"").decode("utf-8", "replace") or self.path.stem
        efforts = {n: e for n, e in self.efforts.items() if n in {j.name for j in joints}}
        start = {self.joints[k]: float(m.qpos0[m.jnt_qposadr[k]]) for k in self._single(kept)}
        out = assemble(
            self.path, name, self.bodies[0], bodies, joints, frames, couplings, self.findings, efforts, start
        )
        motors = self.motors
        moved = replace(out.mechanism, actuators=motors.actuators, transmissions=motors.transmissions)
        moved = replace(moved, gravity=self._gravity(), points=tuple(points))
        keys = self._keys(kept)
        driven = {self.joints[k] for k in self.drives}
        postures = {n: {j: q for j, q in key.items() if j in driven} for n, key in keys.items()}
        return replace(out, mechanism=replace(moved, postures=postures), keys=keys)

    def _gravity(self) -> tuple[float, float, float]:
        """Return the gravitational acceleration in m/s2; zero if the file disables gravity."""
        if self.m.opt.disableflags & int(self.mujoco.mjtDisableBit.mjDSBL_GRAVITY):
            return (0.0, 0.0, 0.0)
        return stated_gravity(self.m.opt.gravity, self.findings)

    def _keys(self, kept: list[int]) -> dict[str, dict[str, float]]:
        """Return {key frame: {joint: value in m or rad}} for the joints with one coordinate."""
        m, out = self.m, {}
        for i in range(m.nkey):
            label = identifier(self._name("KEY", i))
            label = label if label not in ("home", *out) else f"{label}_key{i}"
            out[label] = {self.joints[k]: float(m.key_qpos[i, m.jnt_qposadr[k]]) for k in self._single(kept)}
            self.findings.note("key", f"key frame '{self._name('KEY', i)}' becomes posture '{label}'.", label)
        return out

    def _all_driven(self, kept: list[int]) -> list[int]:
        """Return the joints that are driven in a file without actuators: all that have one coordinate and follow none.

        If equalities close loops, no joint is driven: the file does not say which of the joints of a loop could be.
        """
        m, eq = self.m, self.mujoco.mjtEq
        followers: set[int] = set()
        for i in range(m.neq):
            kind = eq(int(m.eq_type[i]))
            if not m.eq_active0[i]:
                continue
            if kind in (eq.mjEQ_CONNECT, eq.mjEQ_WELD) and tied_by(m, i) <= set(kept):
                return []
            if kind == eq.mjEQ_JOINT:
                followers.add(int(m.eq_obj1id[i]))
            if kind == eq.mjEQ_TENDON:
                followers |= set(list(fixed_tendon(m, int(m.eq_obj1id[i])))[:1])
        driven = [k for k in self._single(kept) if k not in followers]
        if driven:
            text = f"the file has no actuators: {len(driven)} joints are imported as driven."
            self.findings.warn("driven", text, self.path.name)
        return driven

    def _single(self, kept: list[int]) -> list[int]:
        """Return the numbers of the joints with one coordinate between the bodies of the robot."""
        m = self.m
        return [k for k in range(m.njnt) if m.jnt_type[k] in (_SLIDE, _HINGE) and m.jnt_bodyid[k] in kept]

    def _hang(self, i: int, extra: list[Body]) -> Iterator[Joint]:
        """Yield the joints between a body and its parent, starting at the parent."""
        m, body = self.m, self.bodies[i]
        parent = self.bodies[m.body_parentid[i]]
        T = _pose(m.body_pos[i], m.body_quat[i])  # pose in the parent if every coordinate equals its `ref`
        first, count = m.body_jntadr[i], m.body_jntnum[i]
        if not count:
            yield Joint(f"{body}_mount", "fixed", parent, body, T)
            return
        for k in range(first, first + count):
            kind = int(m.jnt_type[k])
            last = k == first + count - 1
            child = body if last else f"{body}_after_{self.joints[k]}"
            if not last:
                extra.append(Body(child))
            at = np.eye(4) if kind == _FREE else spatial.pose(p=m.jnt_pos[k])
            ref = np.eye(4)
            if kind in (_SLIDE, _HINGE):
                if not np.abs(m.jnt_axis[k]).max() > 0.5:  # not a unit vector: MuJoCo could not normalise the axis
                    raise SourceError(f"{self.path}: the axis of joint '{self.joints[k]}' has length 0, or is too long")
                at = at @ along(m.jnt_axis[k])
                q0 = float(m.qpos0[m.jnt_qposadr[k]])
                ref = spatial.pose(p=[0, 0, -q0]) if kind == _SLIDE else spatial.pose(spatial.rotation_z(-q0))
            if kind == _FREE:
                where = self.joints[k]
                text = f"joint '{where}' is a free joint: the base of the robot is not fixed to the world."
                self.findings.warn("free", text, where)
            yield Joint(
                self.joints[k],
                _TYPES[kind],
                parent,
                child,
                T @ at @ ref,
                at,
                active=k in self.drives,
                limits=self._limits(k, kind),
                drive=self.drives.get(k),
            )
            parent, T = child, np.eye(4)

    def _limits(self, k: int, kind: int) -> tuple[float, float] | None:
        m = self.m
        if not m.jnt_limited[k]:
            return None
        if kind == _BALL:
            raise SourceError(
                f"{self.path}: ball joint '{self.joints[k]}' has a range of its rotation angle, which is not supported"
            )
        low, high = map(float, m.jnt_range[k])
        return low, high

    def _actuators(self) -> Iterator[tuple[int, Drive | None]]:
        """Yield (joint number, drive) of the driven joints; the drive is None without a position actuator."""
        m, trn = self.m, self.mujoco.mjtTrn
        for i in range(m.nu):
            name = self._name("ACTUATOR", i)
            if i in self.motors.numbers:
                continue
            if trn(int(m.actuator_trntype[i])) == trn.mjTRN_TENDON and (
                tied := list(fixed_tendon(m, int(m.actuator_trnid[i, 0])))
            ):
                others = ", ".join(f"'{self.joints[k]}'" for k in tied[1:])
                text = (
                    f"actuator '{name}' pulls a fixed tendon: joint '{self.joints[tied[0]]}' is imported as "
                    "driven, without gains."
                )
                if others:
                    text += f" The tendon's other joints, {others}, move only if an equality couples them."
                self.findings.warn("actuator", text, name)
                yield tied[0], None
                continue
            if trn(int(m.actuator_trntype[i])) not in (trn.mjTRN_JOINT, trn.mjTRN_JOINTINPARENT):
                text = f"actuator '{name}' acts on a spatial tendon, a site or a body, so it drives no joint."
                self.findings.warn("actuator", text, name)
                continue
            k, gear = int(m.actuator_trnid[i, 0]), float(m.actuator_gear[i, 0])
            if m.jnt_type[k] not in (_SLIDE, _HINGE):
                text = (
                    f"actuator '{name}' drives joint '{self.joints[k]}', which has several coordinates: the actuator "
                    "is left out."
                )
                self.findings.warn("actuator", text, name)
                continue
            kp, bias = float(m.actuator_gainprm[i, 0]) * gear**2, m.actuator_biasprm[i]
            servo = bias[1] < 0 and np.isclose(-bias[1], m.actuator_gainprm[i, 0])
            effort = float(np.abs(m.actuator_forcerange[i]).max() * abs(gear)) if m.actuator_forcelimited[i] else None
            if servo and kp > 0:
                yield k, Drive(kp, max(0.0, float(-bias[2] * gear**2)), effort)
                continue
            joint = self.joints[k]
            if effort is not None:
                self.efforts[self.joints[k]] = effort
            text = (
                f"actuator '{name}' is not a position servo: joint '{joint}' is imported as driven, and the gains of "
                "the actuator are ignored."
            )
            self.findings.warn("actuator", text, name)
            yield k, None

    def _equality(self, i: int, joints: list[Joint], couplings: list[Coupling], used: set[str]) -> None:
        m, eq = self.m, self.mujoco.mjtEq
        name = self._name("EQUALITY", i)
        kind, data = eq(int(m.eq_type[i])), m.eq_data[i]
        label = identifier(name)
        while label in used:
            label += "_loop"
        used.add(label)
        if not m.eq_active0[i]:
            self.findings.warn("inactive", f"equality '{name}' is not active and is left out.", name)
        elif kind in (eq.mjEQ_CONNECT, eq.mjEQ_WELD):
            joints.append(self._loop(i, label, kind == eq.mjEQ_WELD))
        elif kind == eq.mjEQ_JOINT:
            a, b = int(m.eq_obj1id[i]), int(m.eq_obj2id[i])
            if b < 0 or not np.any(data[1:5]):
                raise SourceError(f"{self.path}: equality '{name}' locks joint '{self.joints[a]}': remove the joint")
            if np.any(data[2:5]):
                raise SourceError(f"{self.path}: equality '{name}' is a polynomial of degree > 1; the degree must be 1")
            # MuJoCo: a - a_ref = c0 + c1 (b - b_ref)
            refs = [float(m.qpos0[m.jnt_qposadr[k]]) for k in (a, b)]
            total = float(data[0]) + refs[0] - float(data[1]) * refs[1]
            couplings.append(Coupling(label, (self.joints[a], self.joints[b]), (1.0, -float(data[1])), total))
        elif kind == eq.mjEQ_TENDON and m.eq_obj2id[i] < 0:
            couplings.append(self._tendon(i, name, label))
        else:
            what = "couples two tendons" if kind == eq.mjEQ_TENDON else f"has the type {kind.name[5:].lower()}"
            known = "supported are connect, weld, joint and tendon (a single tendon)"
            raise SourceError(f"{self.path}: equality '{name}' {what}, which a mechanism cannot express; {known}")

    def _tendon(self, i: int, name: str, label: str) -> Coupling:
        """Return the coupling of a fixed tendon: the sum of coefficient times joint coordinate is constant."""
        m, k = self.m, int(self.m.eq_obj1id[i])
        tied = fixed_tendon(m, k)
        if not tied:
            raise SourceError(f"{self.path}: equality '{name}' constrains a spatial tendon, which is not supported")
        total = float(m.tendon_length0[k] + m.eq_data[i, 0])
        return Coupling(label, tuple(self.joints[j] for j in tied), tuple(tied.values()), total)

    def _loop(self, i: int, label: str, weld: bool) -> Joint:
        m, data = self.m, self.m.eq_data[i]
        a, b = int(m.eq_obj1id[i]), int(m.eq_obj2id[i])
        T_a, T_b = np.eye(4), np.eye(4)
        if int(m.eq_objtype[i]) == int(self.mujoco.mjtObj.mjOBJ_SITE):
            T_a, T_b = (_pose(m.site_pos[s], m.site_quat[s]) for s in (a, b))
            a, b = int(m.site_bodyid[a]), int(m.site_bodyid[b])
        elif weld:
            # As in MuJoCo's engine_core_constraint.c: the anchor is data[3:6] in body 1 and data[0:3] in body 2
            T_a, T_b = _pose(data[3:6], data[6:10]), spatial.pose(p=data[0:3])
        else:
            T_a, T_b = spatial.pose(p=data[0:3]), spatial.pose(p=data[3:6])
        return Joint(label, "fixed" if weld else "spherical", self.bodies[a], self.bodies[b], T_a, T_b)

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
            lost[mesh.name or Path(mesh.file).stem] = mesh.file
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
    for name, file in lost.items():
        if all(f.where != file for f in findings):
            findings.warn("mesh", f"mesh '{name}': {file} is missing; no body uses it.", file)
    for pair in list(spec.pairs):
        if {pair.geomname1, pair.geomname2} & (gone - {""}):
            spec.delete(pair)
    _textures(spec, path, findings)
    for body in spec.bodies:
        if body.name in weightless:  # a placeholder that compiles; the reader ignores this mass
            body.explicitinertial, body.mass, body.inertia = True, 1.0, [1.0, 1.0, 1.0]
            text = f"body '{body.name}' has no mass, because its mesh is missing."
            findings.warn("inertia", text, body.name)
    return _Missing(shapeless, weightless)


def _textures(spec, path: Path, findings: Findings) -> None:
    for texture in list(spec.textures):
        files = [f for f in (texture.file, *texture.cubefiles) if f]
        missing = [f for f in files if not _place(spec, path, spec.texturedir, f).is_file()]
        if not missing:
            continue
        for material in spec.materials:
            if texture.name in list(material.textures):
                material.textures = ["" if t == texture.name else t for t in material.textures]
        findings.warn("texture", f"texture '{texture.name}': {missing[0]} does not exist.", missing[0])
        spec.delete(texture)


def _place(spec, path: Path, folder: str, file: str) -> Path:
    """Return the path at which MuJoCo searches for a file."""
    return path.parent / folder / (Path(file).name if spec.strippath else file)


def _left_out(m, name: Callable[[str, int], str], kept_tendons: Collection[int] = ()) -> Findings:
    """Return findings on data of the model that are not imported.

    `name` is a function (kind, number) that returns the name of an object. `kept_tendons` are the numbers of the
    tendons in transmissions, which are imported.
    """
    import mujoco

    found = Findings()
    for i in range(m.njnt):
        dof = int(m.jnt_dofadr[i])
        told = {
            "stiffness": float(np.ravel(m.jnt_stiffness[i])[0]),
            "damping": float(np.ravel(m.dof_damping[dof])[0]),
            "frictionloss": float(m.dof_frictionloss[dof]),
            "armature": float(m.dof_armature[dof]),
        }
        kept = [f"{k} {v:g}" for k, v in told.items() if v]
        if m.jnt_actfrclimited[i]:
            kept.append(f"actuatorfrcrange {m.jnt_actfrcrange[i, 0]:g} .. {m.jnt_actfrcrange[i, 1]:g}")
        if kept:
            where = name("JOINT", i)
            found.warn("friction", f"joint '{where}': {_not_imported(kept)}", where)
    tied = {int(m.eq_obj1id[i]) for i in range(m.neq) if m.eq_type[i] == mujoco.mjtEq.mjEQ_TENDON}
    for i in kept_tendons:
        told = {k: np.ravel(getattr(m, f"tendon_{k}")[i])[0] for k in ("stiffness", "damping", "frictionloss")}
        if kept := [f"{k} {v:g}" for k, v in told.items() if v]:
            where = name("TENDON", i)
            found.warn("friction", f"tendon '{where}': {_not_imported(kept)}", where)
    for i in set(range(m.ntendon)) - tied - set(kept_tendons):
        where = name("TENDON", i)
        found.warn("tendon", f"tendon '{where}' is not imported: no equality constrains its length.", where)
    for i in range(m.nexclude):
        a, b = (name("BODY", int(v)) for v in (m.exclude_signature[i] >> 16, m.exclude_signature[i] & 0xFFFF))
        found.note("contact", f"contact exclusion of '{a}' and '{b}' is not imported.", a)
    for i in range(m.npair):
        a, b = (name("GEOM", int(v)) for v in (m.pair_geom1[i], m.pair_geom2[i]))
        found.note("contact", f"contact pair of '{a}' and '{b}' is not imported.", a)
    if m.neq:
        found.note("soft", "equality constraints are soft in MuJoCo, but exact in the mechanism.", name("EQUALITY", 0))
    for count, what in ((m.nsensor, "sensors"), (m.ncam, "cameras"), (m.nlight, "lights")):
        if count:
            found.note("unread", f"{count} {what} are not imported.", what)
    if m.nplugin:
        found.warn("plugin", f"{m.nplugin} plug-ins are not imported.", "plugin")
    return found


def _not_imported(kept: Sequence[str]) -> str:
    """Return the end of a sentence on values that are not imported."""
    return f"{', '.join(kept)} {'is' if len(kept) == 1 else 'are'} not imported."


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of an MJCF file; see `read_mjcf`."""
    refuse_nan(path)
    if options.guarded:
        admit(path)
    return read_mjcf(path, options.root)
