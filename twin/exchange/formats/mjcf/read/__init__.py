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
from twin.core.identifiers import identifier
from twin.core.spatial import Array
from twin.exchange.formats.mjcf.read.geoms import read_geoms
from twin.exchange.formats.mjcf.read.motors import fixed_tendon, read_motors
from twin.exchange.formats.mjcf.read.robots import choose_robot, tied_bodies
from twin.exchange.read.imported_robot import (
    Findings,
    Imported,
    Names,
    Options,
    assemble,
    pose_along,
    possible_inertia,
    stated_gravity,
)
from twin.model.body import TOOL, Body, Frame, Point
from twin.model.inertia import Inertia
from twin.model.joint import Drive, Joint, JointType
from twin.model.mechanism import Coupling

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
    findings = Findings()
    try:
        with warnings.catch_warnings(record=True) as recorded:
            warnings.simplefilter("always")
            spec = mujoco.MjSpec.from_file(str(path))
            missing_parts = _remove_missing(spec, path, findings)
            model = spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise SourceError(f"{path}: MuJoCo rejects the file: {_one_line(error)}") from error
    reader = _Mjcf(path, model, missing_parts, root)
    reader.findings += findings
    for caught in recorded:
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
    """Reader of one compiled model.

    Attributes:
        model: the compiled `MjModel`.
        mujoco: the module, which is imported only if a file is read.
        missing: bodies that lack shapes or mass, because files of meshes are missing.
        root: name of a body of the robot to read; None if the file has only one robot.
        efforts: {joint: maximum effort in N or N m} of driven joints without a drive.
        bodies, joints: identifiers, by MuJoCo's numbers.
        motors: actuators and transmissions that are made from tendons.
        drives: {MuJoCo's number of a driven joint: its drive, or None}.
    """

    def __init__(self, path: Path, model, missing: _Missing, root: str | None) -> None:
        import mujoco

        self.path = path
        self.model = model
        self.mujoco = mujoco
        self.missing = missing
        self.root = root
        self.findings = Findings()
        self.efforts: dict[str, float] = {}

    def _name(self, kind: str, number: int) -> str:
        code = getattr(self.mujoco.mjtObj, f"mjOBJ_{kind}")
        try:
            name = self.mujoco.mj_id2name(self.model, code, number)
        except UnicodeDecodeError as error:
            raise SourceError(f"{self.path}: the name of {kind.lower()} {number} is not UTF-8") from error
        return name or f"{kind.lower()}{number}"

    def _names(self, kind: str, count: int) -> list[str]:
        """Return the identifiers of all objects of one kind, by number."""
        stated_names = [self._name(kind, number) for number in range(count)]
        identifiers = Names(kind.lower(), stated_names, self.findings)
        return [identifiers[name] for name in stated_names]

    def read(self) -> Imported:
        model = self.model
        if model.nflex:
            raise UnsupportedError(f"{self.path}: the model has a flexible body, but only rigid bodies are supported")
        if model.nskin:  # for display only: a surface that bends with the bodies
            self.findings.warn("skin", f"{model.nskin} skins are not imported: only rigid bodies are shown.", "skin")
        self.bodies = self._names("BODY", model.nbody)
        self.joints = self._names("JOINT", model.njnt)
        robot_bodies = choose_robot(model, self.path, self.root, self._name, self.findings)
        self.motors = read_motors(model, robot_bodies, self.joints, self._name, self.findings)
        self.drives = self._read_drives()
        self.drives |= dict.fromkeys(self.motors.joints)
        if not model.nu:
            self.drives = dict.fromkeys(self._all_driven(robot_bodies))
        inserted_bodies: list[Body] = []
        joints: list[Joint] = []
        for body in robot_bodies[1:]:
            joints += self._joints_of_body(body, inserted_bodies)
        bodies = self._bodies(robot_bodies) + inserted_bodies
        couplings = self._read_equalities(robot_bodies, joints)
        self.findings += _report_left_out(model, self._name, self.motors.tendons)
        frames, points = self._frames_and_points(robot_bodies)
        # MuJoCo keeps all names in a row, each with a zero byte at its end; the first is that of the model.
        first_name = model.names[: model.names.index(b"\0")]
        name = first_name.decode("utf-8", "replace") or self.path.stem
        joint_names = {joint.name for joint in joints}
        efforts = _values_of_joints(self.efforts, joint_names)
        start = self._coordinates(robot_bodies, model.qpos0)
        imported = assemble(
            self.path, name, self.bodies[0], bodies, joints, frames, couplings, self.findings, efforts, start
        )
        gravity = self._gravity()
        keys = self._key_postures(robot_bodies)
        driven = {self.joints[joint] for joint in self.drives}
        postures: dict[str, dict[str, float]] = {}
        for key, values in keys.items():
            postures[key] = _values_of_joints(values, driven)  # the other joints follow from the loops
        mechanism = replace(
            imported.mechanism,
            actuators=self.motors.actuators,
            transmissions=self.motors.transmissions,
            gravity=gravity,
            points=tuple(points),
            postures=postures,
        )
        return replace(imported, mechanism=mechanism, keys=keys)

    def _bodies(self, robot_bodies: Sequence[int]) -> list[Body]:
        meshes, partly_shown = read_geoms(self.model, self.bodies, self._name, self.findings)
        bodies: list[Body] = []
        for body in robot_bodies:
            shows_whole = body not in partly_shown and self._name("BODY", body) not in self.missing.shapeless
            bodies.append(Body(self.bodies[body], tuple(meshes[body]), self._inertia(body), shows_whole))
        return bodies

    def _read_equalities(self, robot_bodies: Sequence[int], joints: list[Joint]) -> list[Coupling]:
        """Return the couplings of the robot, and append the joints that close its loops to `joints`."""
        couplings: list[Coupling] = []
        used_names = {joint.name for joint in joints}
        for number in range(self.model.neq):
            tied = tied_bodies(self.model, number)
            if tied.issubset(robot_bodies):
                self._add_equality(number, joints, couplings, used_names)
            elif not tied.isdisjoint(robot_bodies):
                where = self._name("EQUALITY", number)
                text = f"equality '{where}' is left out, because it acts on a body that is left out."
                self.findings.warn("equality", text, where)
        return couplings

    def _frames_and_points(self, robot_bodies: Sequence[int]) -> tuple[list[Frame], list[Point]]:
        """Return the sites of the robot, as frames and points.

        In files that twin exported, the site frame_NAME marks the frame NAME, and point_NAME the point NAME; one of the
        frames is the tool. In all other files, a site is a frame of its name.
        """
        model = self.model
        names = self._names("SITE", model.nsite)
        site_names = [self._name("SITE", site) for site in range(model.nsite)]
        exported = f"frame_{TOOL}" in site_names
        frames: list[Frame] = []
        points: list[Point] = []
        for site, name in enumerate(names):
            if model.site_bodyid[site] not in robot_bodies:
                continue
            body = self.bodies[model.site_bodyid[site]]
            if exported and name.startswith("point_"):
                points.append(Point(name.removeprefix("point_"), body, model.site_pos[site].copy()))
                continue
            if exported:
                name = name.removeprefix("frame_")
            frames.append(Frame(name, body, _pose(model.site_pos[site], model.site_quat[site])))
        return frames, points

    def _coordinates(self, robot_bodies: Sequence[int], qpos: Array) -> dict[str, float]:
        """Return {joint: value in m or rad} at coordinates qpos (nq,), for the joints with one coordinate."""
        values: dict[str, float] = {}
        for joint in self._one_coordinate_joints(robot_bodies):
            address = self.model.jnt_qposadr[joint]
            values[self.joints[joint]] = float(qpos[address])
        return values

    def _gravity(self) -> tuple[float, float, float]:
        """Return the gravitational acceleration in m/s2; zero if the file disables gravity."""
        if self.model.opt.disableflags & int(self.mujoco.mjtDisableBit.mjDSBL_GRAVITY):
            return (0.0, 0.0, 0.0)
        return stated_gravity(self.model.opt.gravity, self.findings)

    def _key_postures(self, robot_bodies: Sequence[int]) -> dict[str, dict[str, float]]:
        """Return {key frame: {joint: value in m or rad}} for the joints with one coordinate."""
        postures: dict[str, dict[str, float]] = {}
        for key in range(self.model.nkey):
            name = self._name("KEY", key)
            label = identifier(name)
            if label == "home" or label in postures:  # `home` is the rest pose with closed loops
                label = f"{label}_key{key}"
            postures[label] = self._coordinates(robot_bodies, self.model.key_qpos[key])
            self.findings.note("key", f"key frame '{name}' becomes posture '{label}'.", label)
        return postures

    def _all_driven(self, robot_bodies: Sequence[int]) -> list[int]:
        """Return the joints that are driven in a file without actuators: all that have one coordinate and follow none.

        If equalities close loops, no joint is driven: the file does not say which of the joints of a loop could be.
        """
        model = self.model
        eq = self.mujoco.mjtEq
        followers: set[int] = set()
        for number in range(model.neq):
            if not model.eq_active0[number]:
                continue
            kind = eq(int(model.eq_type[number]))
            first = int(model.eq_obj1id[number])
            if kind in (eq.mjEQ_CONNECT, eq.mjEQ_WELD) and tied_bodies(model, number).issubset(robot_bodies):
                return []
            if kind == eq.mjEQ_JOINT:
                followers.add(first)
            if kind == eq.mjEQ_TENDON:
                # The first joint of the tendon is taken as the follower of the others.
                tendon_joints = list(fixed_tendon(model, first))
                followers.update(tendon_joints[:1])
        driven = [joint for joint in self._one_coordinate_joints(robot_bodies) if joint not in followers]
        if driven:
            text = f"the file has no actuators: {len(driven)} joints are imported as driven."
            self.findings.warn("driven", text, self.path.name)
        return driven

    def _one_coordinate_joints(self, robot_bodies: Sequence[int]) -> list[int]:
        """Return the numbers of the joints with one coordinate between the bodies of the robot."""
        joints = []
        for joint in range(self.model.njnt):
            if self.model.jnt_type[joint] in (_SLIDE, _HINGE) and self.model.jnt_bodyid[joint] in robot_bodies:
                joints.append(joint)
        return joints

    def _joints_of_body(self, number: int, inserted_bodies: list[Body]) -> list[Joint]:
        """Return the joints between a body and its parent, starting at the parent.

        The massless bodies between two joints are appended to `inserted_bodies`.
        """
        model = self.model
        body = self.bodies[number]
        parent = self.bodies[model.body_parentid[number]]
        # The pose in the parent, if every coordinate equals its `ref`.
        T = _pose(model.body_pos[number], model.body_quat[number])
        first_joint = model.body_jntadr[number]
        last_joint = first_joint + model.body_jntnum[number] - 1
        if last_joint < first_joint:
            return [Joint(f"{body}_mount", "fixed", parent, body, T)]
        joints: list[Joint] = []
        for joint in range(first_joint, last_joint + 1):
            name = self.joints[joint]
            kind = int(model.jnt_type[joint])
            child = body
            if joint != last_joint:
                child = f"{body}_after_{name}"
                inserted_bodies.append(Body(child))
            T_body_joint = np.eye(4)
            T_home = np.eye(4)
            if kind != _FREE:  # MuJoCo ignores the `pos` of a free joint
                T_body_joint = spatial.pose(p=model.jnt_pos[joint])
            if kind in (_SLIDE, _HINGE):
                # The largest component of a unit vector is at least 0.577: MuJoCo could not normalise a shorter axis.
                if not np.abs(model.jnt_axis[joint]).max() > 0.5:
                    raise SourceError(f"{self.path}: the axis of joint '{name}' has length 0, or is too long")
                T_body_joint = T_body_joint @ pose_along(model.jnt_axis[joint])
                q0 = float(model.qpos0[model.jnt_qposadr[joint]])
                T_home = spatial.pose(p=[0, 0, -q0])
                if kind == _HINGE:
                    T_home = spatial.pose(spatial.rotation_z(-q0))
            if kind == _FREE:
                text = f"joint '{name}' is a free joint: the base of the robot is not fixed to the world."
                self.findings.warn("free", text, name)
            joints.append(
                Joint(
                    name,
                    _TYPES[kind],
                    parent,
                    child,
                    T @ T_body_joint @ T_home,
                    T_body_joint,
                    active=joint in self.drives,
                    limits=self._limits(joint, kind),
                    drive=self.drives.get(joint),
                )
            )
            parent = child
            T = np.eye(4)
        return joints

    def _limits(self, joint: int, kind: int) -> tuple[float, float] | None:
        model = self.model
        if not model.jnt_limited[joint]:
            return None
        if kind == _BALL:
            text = f"ball joint '{self.joints[joint]}' has a range of its rotation angle, which is not supported"
            raise UnsupportedError(f"{self.path}: {text}")
        low, high = map(float, model.jnt_range[joint])
        return low, high

    def _read_drives(self) -> dict[int, Drive | None]:
        """Return {joint number: drive} of the driven joints; the drive is None without a position actuator."""
        model = self.model
        transmission_types = self.mujoco.mjtTrn
        drives: dict[int, Drive | None] = {}
        for number in range(model.nu):
            if number in self.motors.numbers:
                continue
            name = self._name("ACTUATOR", number)
            kind = transmission_types(int(model.actuator_trntype[number]))
            target = int(model.actuator_trnid[number, 0])
            if kind == transmission_types.mjTRN_TENDON:
                joints = list(fixed_tendon(model, target))
                if joints:
                    self._warn_of_tendon(name, joints)
                    drives[joints[0]] = None
                    continue
            if kind not in (transmission_types.mjTRN_JOINT, transmission_types.mjTRN_JOINTINPARENT):
                text = f"actuator '{name}' acts on a spatial tendon, a site or a body, so it drives no joint."
                self.findings.warn("actuator", text, name)
            elif model.jnt_type[target] not in (_SLIDE, _HINGE):
                text = (
                    f"actuator '{name}' drives joint '{self.joints[target]}', which has several coordinates: the "
                    "actuator is left out."
                )
                self.findings.warn("actuator", text, name)
            else:
                drives[target] = self._drive(number, name, self.joints[target])
        return drives

    def _warn_of_tendon(self, name: str, joints: Sequence[int]) -> None:
        first, *other_joints = joints
        text = f"actuator '{name}' pulls a fixed tendon: joint '{self.joints[first]}' is imported as driven, "
        text += "without gains."
        if other_joints:
            others = ", ".join(f"'{self.joints[joint]}'" for joint in other_joints)
            text += f" The tendon's other joints, {others}, move only if an equality couples them."
        self.findings.warn("actuator", text, name)

    def _drive(self, number: int, name: str, joint: str) -> Drive | None:
        """Return the drive of an actuator, for its joint; None if it is not a position servo.

        MuJoCo's gains are for the motor, those of a drive for the joint: the gear ratio counts twice.
        """
        model = self.model
        gear = float(model.actuator_gear[number, 0])
        gain = model.actuator_gainprm[number, 0]
        bias = model.actuator_biasprm[number]
        kp = float(gain) * gear**2
        effort = None
        if model.actuator_forcelimited[number]:
            effort = float(np.abs(model.actuator_forcerange[number]).max() * abs(gear))
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

    def _add_equality(self, number: int, joints: list[Joint], couplings: list[Coupling], used_names: set[str]) -> None:
        model = self.model
        eq = self.mujoco.mjtEq
        name = self._name("EQUALITY", number)
        kind = eq(int(model.eq_type[number]))
        label = identifier(name)
        while label in used_names:
            label += "_loop"
        used_names.add(label)
        if not model.eq_active0[number]:
            self.findings.warn("inactive", f"equality '{name}' is not active and is left out.", name)
        elif kind in (eq.mjEQ_CONNECT, eq.mjEQ_WELD):
            joints.append(self._loop_joint(number, label, kind == eq.mjEQ_WELD))
        elif kind == eq.mjEQ_JOINT:
            couplings.append(self._coupling(number, name, label))
        elif kind == eq.mjEQ_TENDON and model.eq_obj2id[number] < 0:
            couplings.append(self._tendon_coupling(number, name, label))
        else:
            content = "couples two tendons"
            if kind != eq.mjEQ_TENDON:
                content = f"has the type {kind.name.removeprefix('mjEQ_').lower()}"
            text = f"equality '{name}' {content}, which a mechanism cannot express"
            supported = "supported are connect, weld, joint and tendon (a single tendon)"
            raise UnsupportedError(f"{self.path}: {text}; {supported}")

    def _coupling(self, number: int, name: str, label: str) -> Coupling:
        """Return the coupling of two joints a and b. MuJoCo: a - a_ref = c0 + c1 (b - b_ref) + c2 (b - b_ref)^2 ..."""
        model = self.model
        follower = int(model.eq_obj1id[number])
        leader = int(model.eq_obj2id[number])
        polynomial = model.eq_data[number, :5]
        if leader < 0 or not np.any(polynomial[1:]):
            raise UnsupportedError(
                f"{self.path}: equality '{name}' locks joint '{self.joints[follower]}': remove the joint"
            )
        if np.any(polynomial[2:]):
            raise UnsupportedError(
                f"{self.path}: equality '{name}' is a polynomial of degree > 1; the degree must be 1"
            )
        ratio = float(polynomial[1])
        follower_ref = float(model.qpos0[model.jnt_qposadr[follower]])
        leader_ref = float(model.qpos0[model.jnt_qposadr[leader]])
        total = float(polynomial[0]) + follower_ref - ratio * leader_ref
        return Coupling(label, (self.joints[follower], self.joints[leader]), (1.0, -ratio), total)

    def _tendon_coupling(self, number: int, name: str, label: str) -> Coupling:
        """Return the coupling of a fixed tendon: the sum of coefficient times joint coordinate is constant."""
        tendon = int(self.model.eq_obj1id[number])
        coefficients = fixed_tendon(self.model, tendon)
        if not coefficients:
            raise UnsupportedError(
                f"{self.path}: equality '{name}' constrains a spatial tendon, which is not supported"
            )
        total = float(self.model.tendon_length0[tendon] + self.model.eq_data[number, 0])
        names = tuple(self.joints[joint] for joint in coefficients)
        return Coupling(label, names, tuple(coefficients.values()), total)

    def _loop_joint(self, number: int, label: str, weld: bool) -> Joint:
        """Return the joint for a weld or, if `weld` is False, a connect; between two bodies or two sites."""
        model = self.model
        data = model.eq_data[number]
        first = int(model.eq_obj1id[number])
        second = int(model.eq_obj2id[number])
        kind: JointType = "fixed" if weld else "spherical"
        if int(model.eq_objtype[number]) == int(self.mujoco.mjtObj.mjOBJ_SITE):
            T_first = _pose(model.site_pos[first], model.site_quat[first])
            T_second = _pose(model.site_pos[second], model.site_quat[second])
            first = int(model.site_bodyid[first])
            second = int(model.site_bodyid[second])
        elif weld:
            # As in MuJoCo's engine_core_constraint.c: the anchor is data[3:6] in body 1 and data[0:3] in body 2
            T_first = _pose(data[3:6], data[6:10])
            T_second = spatial.pose(p=data[0:3])
        else:
            T_first = spatial.pose(p=data[0:3])
            T_second = spatial.pose(p=data[3:6])
        return Joint(label, kind, self.bodies[first], self.bodies[second], T_first, T_second)

    def _inertia(self, number: int) -> Inertia | None:
        model = self.model
        if number == 0 or not model.body_mass[number] or self._name("BODY", number) in self.missing.weightless:
            return None
        R = spatial.matrix_from_quat_wxyz(model.body_iquat[number])
        tensor = R @ np.diag(model.body_inertia[number]) @ R.T
        return possible_inertia(
            Inertia(float(model.body_mass[number]), model.body_ipos[number].copy(), tensor),
            self.bodies[number],
            self.findings,
        )


class _Missing(NamedTuple):
    """Names of bodies that lack shapes because of missing files, and of those among them whose mass is unknown."""

    shapeless: set[str]
    weightless: set[str]


def _remove_missing(spec, path: Path, findings: Findings) -> _Missing:
    """Remove meshes and textures whose files are missing, and the geoms of these meshes, from a MuJoCo specification.

    `spec` is parsed, but not compiled. Each missing file is reported as a warning.

    The mass of a body is unknown if a geom was removed and the file states no inertia.
    """
    missing_meshes: dict[str, str] = {}
    for mesh in list(spec.meshes):
        if mesh.file and not _searched_path(spec, path, spec.meshdir, mesh.file).is_file():
            searched = Path(mesh.file).name if spec.strippath else mesh.file
            missing_meshes[mesh.name or Path(mesh.file).stem] = (Path(spec.meshdir) / searched).as_posix()
            spec.delete(mesh)
    weightless: set[str] = set()
    shapeless: set[str] = set()
    removed_geoms: set[str] = set()
    for geom in list(spec.geoms):
        if geom.meshname not in missing_meshes:
            continue
        body = geom.parent
        text = (
            f"body '{body.name}': mesh {missing_meshes[geom.meshname]} is missing: the body is shown without this mesh."
        )
        findings.warn("mesh", text, missing_meshes[geom.meshname])
        shapeless.add(body.name)
        if not body.explicitinertial and body.name != "world":
            weightless.add(body.name)
        removed_geoms.add(geom.name)
        spec.delete(geom)
    reported = {finding.where for finding in findings}
    for name, file in missing_meshes.items():
        if file not in reported:
            reported.add(file)
            findings.warn("mesh", f"mesh '{name}': {file} is missing; no body uses it.", file)
    removed_geoms.discard("")  # a geom without a name is in no pair
    for pair in list(spec.pairs):
        if pair.geomname1 in removed_geoms or pair.geomname2 in removed_geoms:
            spec.delete(pair)
    _remove_missing_textures(spec, path, findings)
    for body in spec.bodies:
        if body.name in weightless:  # a placeholder that compiles; the reader ignores this mass
            body.explicitinertial = True
            body.mass = 1.0
            body.inertia = [1.0, 1.0, 1.0]
            text = f"body '{body.name}' has no mass, because its mesh is missing."
            findings.warn("inertia", text, body.name)
    return _Missing(shapeless, weightless)


def _remove_missing_textures(spec, path: Path, findings: Findings) -> None:
    for texture in list(spec.textures):
        missing: list[str] = []
        for file in (texture.file, *texture.cubefiles):
            if file and not _searched_path(spec, path, spec.texturedir, file).is_file():
                missing.append(file)
        if not missing:
            continue
        for material in spec.materials:
            textures = list(material.textures)
            if texture.name in textures:
                # Assigned as a whole, because MuJoCo returns a copy of the list.
                for index, name in enumerate(textures):
                    if name == texture.name:
                        textures[index] = ""
                material.textures = textures
        findings.warn("texture", f"texture '{texture.name}': {missing[0]} does not exist.", missing[0])
        spec.delete(texture)


def _searched_path(spec, path: Path, folder: str, file: str) -> Path:
    """Return the path at which MuJoCo searches for a file."""
    if spec.strippath:
        file = Path(file).name
    return path.parent / folder / file


def _report_left_out(model, name: Callable[[str, int], str], imported_tendons: Collection[int] = ()) -> Findings:
    """Return findings on data of the model that are not imported.

    `name` is a function (kind, number) that returns the name of an object. `imported_tendons` are the numbers of the
    tendons in transmissions.
    """
    import mujoco

    findings = Findings()
    for index in range(model.njnt):
        dof = int(model.jnt_dofadr[index])
        values = _stated_values(
            {
                "stiffness": float(np.ravel(model.jnt_stiffness[index])[0]),
                "damping": float(np.ravel(model.dof_damping[dof])[0]),
                "frictionloss": float(model.dof_frictionloss[dof]),
                "armature": float(model.dof_armature[dof]),
            }
        )
        if model.jnt_actfrclimited[index]:
            low, high = model.jnt_actfrcrange[index]
            values.append(f"actuatorfrcrange {low:g} .. {high:g}")
        if values:
            where = name("JOINT", index)
            findings.warn("friction", f"joint '{where}': {_not_imported(values)}", where)
    for index in imported_tendons:
        values = _stated_values(
            {
                "stiffness": np.ravel(model.tendon_stiffness[index])[0],
                "damping": np.ravel(model.tendon_damping[index])[0],
                "frictionloss": np.ravel(model.tendon_frictionloss[index])[0],
            }
        )
        if values:
            where = name("TENDON", index)
            findings.warn("friction", f"tendon '{where}': {_not_imported(values)}", where)
    imported = set(imported_tendons)
    for index in range(model.neq):
        if model.eq_type[index] == mujoco.mjtEq.mjEQ_TENDON:
            imported.add(int(model.eq_obj1id[index]))
    for index in range(model.ntendon):
        if index not in imported:
            where = name("TENDON", index)
            findings.warn("tendon", f"tendon '{where}' is not imported: no equality constrains its length.", where)
    for index in range(model.nexclude):
        signature = int(model.exclude_signature[index])  # MuJoCo packs the numbers of both bodies, with 16 bits each
        first = name("BODY", signature >> 16)
        second = name("BODY", signature & 0xFFFF)
        findings.note("contact", f"contact exclusion of '{first}' and '{second}' is not imported.", first)
    for index in range(model.npair):
        first = name("GEOM", int(model.pair_geom1[index]))
        second = name("GEOM", int(model.pair_geom2[index]))
        findings.note("contact", f"contact pair of '{first}' and '{second}' is not imported.", first)
    if model.neq:
        findings.note(
            "soft", "equality constraints are soft in MuJoCo, but exact in the mechanism.", name("EQUALITY", 0)
        )
    for count, what in ((model.nsensor, "sensors"), (model.ncam, "cameras"), (model.nlight, "lights")):
        if count:
            findings.note("unread", f"{count} {what} are not imported.", what)
    if model.nplugin:
        findings.warn("plugin", f"{model.nplugin} plug-ins are not imported.", "plugin")
    return findings


def _values_of_joints(values: Mapping[str, float], joints: Collection[str]) -> dict[str, float]:
    """Return the values of some joints."""
    values_of_joints: dict[str, float] = {}
    for joint, value in values.items():
        if joint in joints:
            values_of_joints[joint] = value
    return values_of_joints


def _stated_values(values: Mapping[str, float]) -> list[str]:
    """Return a text "key value" for each value other than 0."""
    texts: list[str] = []
    for key, value in values.items():
        if value:
            texts.append(f"{key} {value:g}")
    return texts


def _not_imported(values: Sequence[str]) -> str:
    """Return the end of a sentence on values that are not imported."""
    verb = "is" if len(values) == 1 else "are"
    return f"{', '.join(values)} {verb} not imported."


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of an MJCF file; see `read_mjcf`."""
    refuse_nan(path)
    if options.guarded:
        admit(path)
    return read_mjcf(path, options.root)
