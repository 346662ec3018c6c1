"""Read an MJCF file: MuJoCo compiles the file, and the mechanism is made from the compiled model.

The compiled model has all defaults, includes, units and meshes resolved. Frames of bodies are unchanged. If a body has
several joints, massless bodies are added between the joints. Equality constraints close loops (connect, weld) or couple
joints. A joint coordinate has the same value as in MuJoCo, also if the joint has a `ref`.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.core import spatial
from twin.core.errors import SourceError, UnsupportedError
from twin.core.foreign.admit import admit
from twin.core.foreign.budget import check_size, read_bytes
from twin.core.identifiers import identifier
from twin.core.spatial import Array
from twin.exchange.formats.mjcf.read.drives import DriveReader
from twin.exchange.formats.mjcf.read.equalities import EqualityReader
from twin.exchange.formats.mjcf.read.geoms import read_geoms
from twin.exchange.formats.mjcf.read.left_out import find_left_out
from twin.exchange.formats.mjcf.read.missing_files import BodiesWithMissingMeshes, remove_missing_files
from twin.exchange.formats.mjcf.read.motors import read_motors
from twin.exchange.formats.mjcf.read.robots import choose_robot
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
from twin.model.joint import Joint, JointType

if TYPE_CHECKING:
    import mujoco

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
            missing_parts = remove_missing_files(spec, path, findings)
            model = spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise SourceError(f"{path}: MuJoCo rejects the file: {_one_line(error)}") from error
    reader = _Mjcf(path, model, missing_parts, root, findings)
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
        missing: bodies that lack shapes or mass, because files of meshes are missing.
        root: name of a body of the robot to read; None if the file has only one robot.
        findings: receives what is changed and left out.
        bodies, joints: identifiers, by MuJoCo's numbers.
        drives: {MuJoCo's number of a driven joint: its drive, or None}.
    """

    def __init__(
        self, path: Path, model: mujoco.MjModel, missing: BodiesWithMissingMeshes, root: str | None, findings: Findings
    ) -> None:
        self.path = path
        self.model = model
        self.missing = missing
        self.root = root
        self.findings = findings

    def _name(self, kind: str, number: int) -> str:
        """Return the name of an object of a kind, such as "BODY"; without one, its kind and number."""
        import mujoco

        code = getattr(mujoco.mjtObj, f"mjOBJ_{kind}")
        try:
            name = mujoco.mj_id2name(self.model, code, number)
        except UnicodeDecodeError as error:
            raise SourceError(f"{self.path}: the name of {kind.lower()} {number} is not UTF-8") from error
        if name:
            return name
        free = f"{kind.lower()}{number}"
        while mujoco.mj_name2id(self.model, code, free) >= 0:  # another object has this name
            free += "_"
        return free

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
        motors = read_motors(model, robot_bodies, self.joints, self._name, self.findings)
        one_coordinate_joints = self._one_coordinate_joints(robot_bodies)
        drive_reader = DriveReader(self.path, model, self._name, self.joints, one_coordinate_joints, self.findings)
        self.drives = drive_reader.read(motors, robot_bodies)
        inserted_bodies: list[Body] = []
        joints: list[Joint] = []
        for body in robot_bodies[1:]:
            joints += self._joints_of_body(body, inserted_bodies)
        bodies = self._bodies(robot_bodies) + inserted_bodies
        equalities = EqualityReader(self.path, model, self._name, self.bodies, self.joints, self.findings)
        equalities.read(robot_bodies, joints)
        joints += equalities.loop_joints
        self.findings += find_left_out(model, self._name, motors.tendons)
        frames, points = self._frames_and_points(robot_bodies)
        # MuJoCo keeps all names in a row, each with a zero byte at its end; the first is that of the model.
        first_name = model.names[: model.names.index(b"\0")]
        name = first_name.decode("utf-8", "replace") or self.path.stem
        joint_names = {joint.name for joint in joints}
        efforts = _of_joints(drive_reader.efforts, joint_names)
        start = self._coordinates(robot_bodies, model.qpos0)
        imported = assemble(
            self.path,
            name,
            self.bodies[0],
            bodies,
            joints,
            frames,
            equalities.couplings,
            self.findings,
            efforts,
            start,
        )
        gravity = self._gravity()
        keys = self._key_postures(robot_bodies)
        driven = {self.joints[joint] for joint in self.drives}
        postures: dict[str, dict[str, float]] = {}
        for key, values in keys.items():
            postures[key] = _of_joints(values, driven)  # the other joints follow from the loops
        mechanism = replace(
            imported.mechanism,
            actuators=motors.actuators,
            transmissions=motors.transmissions,
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
        import mujoco

        if self.model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY):
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


def _of_joints(values: Mapping[str, float], joints: Collection[str]) -> dict[str, float]:
    """Return the values of some joints."""
    values_of_joints: dict[str, float] = {}
    for joint, value in values.items():
        if joint in joints:
            values_of_joints[joint] = value
    return values_of_joints


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of an MJCF file; see `read_mjcf`."""
    refuse_nan(path)
    if options.guarded:
        admit(path)
    return read_mjcf(path, options.root)
