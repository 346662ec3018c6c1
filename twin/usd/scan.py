"""Extract rigid bodies, joints and poses from a UsdPhysics stage, without checking them.

The reader and the checker use this module. Lengths are converted to metres and poses to world z up, whatever the unit
and up axis of the stage; joint frames are rotated so that z is the axis. Invalid data are also returned: the reader
rejects them, and the checker reports them.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdPhysics

from twin.core import spatial
from twin.core.errors import StageError
from twin.core.spatial import Array
from twin.model.joint import FREE_AXES
from twin.usd import gf

DIRECTIONS = ("transX", "transY", "transZ", "rotX", "rotY", "rotZ")
"""Instance names of the six directions of a generic joint, in the order of `model.joint.FREE_AXES`."""

_CYCLIC_TURN = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]], float)
"""Cyclic rotation (3, 3): x to y, y to z, z to x."""

TURN_OF_AXIS = {"X": _CYCLIC_TURN, "Y": _CYCLIC_TURN @ _CYCLIC_TURN, "Z": np.eye(3)}
"""Rotation (3, 3) of the joint frame that makes z the axis of the joint, by axis token (X, Y, Z)."""


_SCHEMA_KINDS = (
    (UsdPhysics.FixedJoint, "fixed"),
    (UsdPhysics.RevoluteJoint, "revolute"),
    (UsdPhysics.PrismaticJoint, "prismatic"),
    (UsdPhysics.SphericalJoint, "spherical"),
)
"""Schemas of joints with the joint type of a mechanism that each of them is."""

_UNIT_ROUNDING = 1e-15
"""Difference of a length from 1 that is rounding in double precision."""

SCALE_TOL = 1e-5
"""Maximum difference of a scale from 1 that is taken as a rounding error of a transform in single precision."""


@dataclass(frozen=True)
class JointSide:
    """One side of a joint.

    Attributes:
        body: prim path of the body; "": the world.
        T_body_joint: pose (4, 4) of the joint's frame, axis along z; the identity if the side is invalid.
        problem: why the side is invalid (missing target, zero quaternion); "" if it is valid.
    """

    body: str
    T_body_joint: Array
    problem: str = ""


@dataclass(frozen=True)
class RawJoint:
    """A joint prim.

    Attributes:
        type: matching joint type of a mechanism; "" if no type matches.
        ends: sides of the joint on body0 and body1.
        instance: instance name of the joint's drive and state ("angular", "linear", "rotX", ...); "" if the joint does
            not have one coordinate.
        limits: (lower, upper) in units of the stage (degrees for angles); None if unlimited.
        unit: factor that converts limits, states and targets of the stage to degrees (angles) or metres.
        excluded: whether the joint is excluded from the articulation, because it closes a loop.
        enabled: False for a disabled joint, except a free joint that twin wrote, which constrains nothing.
        problem: why no joint type matches; "" if a type matches.

    """

    prim: Usd.Prim
    type: str
    ends: tuple[JointSide, JointSide]
    instance: str = ""
    limits: tuple[float, float] | None = None
    unit: float = 1.0
    excluded: bool = False
    enabled: bool = True
    problem: str = ""

    @property
    def path(self) -> str:
        """Path of the joint's prim."""
        return str(self.prim.GetPath())

    @property
    def fault(self) -> str:
        """Reason why the joint is invalid: unknown type, invalid side, or both sides on one body; "" if valid."""
        problem = self.problem or self.ends[0].problem or self.ends[1].problem
        if problem or self.ends[0].body != self.ends[1].body:
            return problem
        return f"both sides of the joint are on {self.ends[0].body or 'the world'}"

    @property
    def is_grounded(self) -> bool:
        """Whether a side of the joint is on the world."""
        return not (self.ends[0].body and self.ends[1].body)

    def touches(self, bodies: Container[str]) -> bool:
        """Return whether a side of the joint is on one of the bodies with the prim paths `bodies`."""
        return self.ends[0].body in bodies or self.ends[1].body in bodies

    @property
    def is_angle(self) -> bool:
        """Whether the coordinate is an angle, which a stage stores in degrees."""
        return self.type == "revolute"


class RawStage:
    """An opened stage.

    Attributes:
        meters: metres per unit of length.
        kilograms: kilograms per unit of mass.
        R_world_stage: rotation (3, 3) from the stage's axes to z up.
    """

    def __init__(self, path: str | Path) -> None:
        """Open a stage.

        Raises:
            StageError: the file is missing or not USD, or one of its layers cannot be found.
        """
        self.path = str(path)
        self.stage = _open(Path(path))
        self.meters = UsdGeom.GetStageMetersPerUnit(self.stage)
        self.kilograms = UsdPhysics.GetStageKilogramsPerUnit(self.stage)
        self.R_world_stage = np.eye(3)
        if UsdGeom.GetStageUpAxis(self.stage) == UsdGeom.Tokens.y:
            # rounded: a turn by 90 degrees has only the numbers -1, 0 and 1
            self.R_world_stage = spatial.exp_so3([np.pi / 2, 0, 0]).round()

    @cached_property
    def prims(self) -> list[Usd.Prim]:
        """All prims in the order of the stage, including prims inside instances."""
        return list(self.stage.Traverse(Usd.TraverseInstanceProxies()))

    @cached_property
    def bodies(self) -> dict[str, Usd.Prim]:
        """Enabled rigid bodies by prim path, in the order of the stage."""
        bodies = {}
        for prim in self.prims:
            if prim.HasAPI(UsdPhysics.RigidBodyAPI):
                enabled = UsdPhysics.RigidBodyAPI(prim).GetRigidBodyEnabledAttr().Get()
                if enabled is not False:
                    bodies[str(prim.GetPath())] = prim
        return bodies

    @cached_property
    def joints(self) -> list[RawJoint]:
        """Joints in the order of the stage, including joints of unknown type."""
        joints: list[RawJoint] = []
        for prim in self.prims:
            # joint types of other software do not derive from UsdPhysics.Joint, but have "Joint" in their name
            if prim.IsA(UsdPhysics.Joint) or str(prim.GetTypeName()).endswith("Joint"):
                joints.append(self._joint(prim))
        return joints

    @cached_property
    def sample_codes(self) -> Array:
        """Time codes (k,) at which the transform of a body or of an ancestor has samples."""
        prims: dict[Sdf.Path, Usd.Prim] = {}
        for body in self.bodies.values():
            for ancestor in _with_ancestors(body):
                prims[ancestor.GetPath()] = ancestor
        codes = set()
        for prim in prims.values():
            if prim.IsA(UsdGeom.Xformable):
                codes.update(UsdGeom.Xformable(prim).GetTimeSamples())
        return np.array(sorted(codes), float)

    def is_kinematic(self, body: str) -> bool:
        """Return whether no force moves the body at a prim path: it stays in the world without a joint."""
        return bool(UsdPhysics.RigidBodyAPI(self.bodies[body]).GetKinematicEnabledAttr().Get())

    def is_stated_base(self, body: str) -> bool:
        """Return whether the attribute `twin:base` of the robot names the body at the prim path `body`."""
        prim = self.bodies.get(body)
        if not prim:
            return False
        name = prim.GetParent().GetAttribute("twin:base")
        return bool(name and str(name.Get()) == prim.GetName())

    def owner(self, prim: Usd.Prim) -> Usd.Prim | None:
        """Return the rigid body that a prim belongs to (itself or its nearest ancestor); None if there is none."""
        for ancestor in _with_ancestors(prim):
            if str(ancestor.GetPath()) in self.bodies:
                return ancestor
        return None

    def raw_transform(self, prim: Usd.Prim) -> Array:
        """Return T_stage_prim (4, 4) at the default time, with scale; lengths are in units of the stage."""
        with self._evaluating():
            return gf.affine(UsdGeom.XformCache().GetLocalToWorldTransform(prim))

    def poses(self, prims: Sequence[Usd.Prim], codes: ArrayLike | None = None) -> Array:
        """Return T_world_prim (n, k, 4, 4) of n prims at k time codes in metres, z up, without scale.

        `codes` are time codes; None: only the default time (k = 1).
        """
        if codes is None:
            times = [Usd.TimeCode.Default()]
        else:
            times = list(map(Usd.TimeCode, np.asarray(codes).tolist()))
        raw = np.zeros((len(prims), len(times), 4, 4))
        cache = UsdGeom.XformCache()
        with self._evaluating():
            for k, time in enumerate(times):
                cache.SetTime(time)
                for i, prim in enumerate(prims):
                    raw[i, k] = cache.GetLocalToWorldTransform(prim)
        T = rigid(np.swapaxes(raw, -1, -2))  # Gf matrices act on row vectors
        T[..., :3, 3] *= self.meters
        if not np.array_equal(self.R_world_stage, np.eye(3)):
            T = spatial.pose(self.R_world_stage) @ T
        return T

    def scale(self, prim: Usd.Prim) -> Array:
        """Return the scale (3,) along the axes of a prim: length in units of the stage per length in units of the prim.

        A scale that is uniform up to rounding errors is returned with three equal numbers.
        """
        axes = self.raw_transform(prim)[:3, :3]
        scales = np.linalg.norm(axes, axis=0)
        if np.ptp(scales) <= SCALE_TOL * scales.max():
            volume = abs(np.linalg.det(axes))
            scales = np.full(3, np.cbrt(volume))
        if np.abs(scales - 1).max() <= SCALE_TOL:
            return np.ones(3)
        return scales

    def relative(self, prim: Usd.Prim, body: Usd.Prim) -> Array:
        """Return T_body_prim (4, 4) of a prim below a body, in units of the body, with scale.

        Only the transforms between the body and the prim are multiplied, so that no precision is lost.
        """
        with self._evaluating():
            M, _ = UsdGeom.XformCache().ComputeRelativeTransform(prim, body)
        return gf.affine(M)

    @contextlib.contextmanager
    def _evaluating(self) -> Iterator[None]:
        """Convert errors of USD (such as a transform op of a wrong type) to `StageError`."""
        try:
            yield
        except Tf.ErrorException as error:
            reason = str(error).strip().splitlines()[-1].strip()
            raise StageError(f"{self.path}: a transform cannot be evaluated: {reason}") from error

    def _joint(self, prim: Usd.Prim) -> RawJoint:
        joint = UsdPhysics.Joint(prim)
        kind, free, token, problem = _type_and_axis(prim)
        R_joint_axis = TURN_OF_AXIS[token]
        end0 = self._end(joint.GetBody0Rel(), joint.GetLocalPos0Attr(), joint.GetLocalRot0Attr(), R_joint_axis)
        end1 = self._end(joint.GetBody1Rel(), joint.GetLocalPos1Attr(), joint.GetLocalRot1Attr(), R_joint_axis)
        instance, limits = _instance_and_limits(prim, kind, free)
        unit = self.meters
        if kind == "revolute":
            unit = 1.0  # the stage has degrees, as the checks
        enabled = joint.GetJointEnabledAttr().Get() is not False
        return RawJoint(
            prim,
            kind,
            (end0, end1),
            instance,
            limits,
            unit,
            bool(joint.GetExcludeFromArticulationAttr().Get()),
            enabled or bool(prim.GetAttribute("twin:free").Get()),
            problem,
        )

    def _end(
        self, body: Usd.Relationship, position: Usd.Attribute, rotation: Usd.Attribute, R_joint_axis: Array
    ) -> JointSide:
        targets = []
        if body:
            targets = body.GetForwardedTargets()
        p = np.zeros(3)
        if position and position.Get() is not None:
            p = np.array(position.Get(), float)
        R = np.eye(3)
        try:
            if rotation and rotation.Get() is not None:
                R = gf.rotation(rotation.Get())
        except ValueError as error:
            return JointSide("", np.eye(4), f"{rotation.GetName()}: {error}")
        R_turned = R @ R_joint_axis
        if not targets:
            return JointSide("", spatial.pose(self.R_world_stage) @ spatial.pose(R_turned, p * self.meters))
        target = self.stage.GetPrimAtPath(targets[0])
        if len(targets) > 1 or not target:
            listed = ", ".join(map(str, targets))
            return JointSide("", np.eye(4), f"{body.GetName()} points to {listed}, but must point to one prim")
        owner = self.owner(target)
        T_target_joint = spatial.pose(R_turned, p * self.meters * self.scale(target))
        if owner is None:  # a prim without a rigid body is fixed to the world
            return JointSide("", self.poses([target])[0, 0] @ T_target_joint)
        if owner == target:
            return JointSide(str(owner.GetPath()), T_target_joint)
        T_owner_target = rigid(self.relative(target, owner))
        T_owner_target[:3, 3] *= self.meters * self.scale(owner)
        return JointSide(str(owner.GetPath()), T_owner_target @ T_target_joint)


def rigid(M: Array) -> Array:
    """Return the poses (..., 4, 4) of affine matrices (..., 4, 4), without scale and with an orthonormal rotation."""
    T = M.copy()
    axes = T[..., :3, :3]
    size = np.linalg.norm(axes, axis=-2, keepdims=True)
    # An orthonormal rotation is returned unchanged; a rounded or scaled rotation is made orthonormal.
    unscaled = axes / np.where(size > 0, size, 1.0)
    R = np.where(np.abs(size - 1) < _UNIT_ROUNDING, axes, unscaled)
    with np.errstate(invalid="ignore"):  # a pose that is not finite stays so, for the checks to find
        is_mirrored = np.linalg.det(R)[..., None, None] < 0
    R = np.where(is_mirrored, -R, R)
    products = np.swapaxes(R, -1, -2) @ R
    is_exact = np.all(products == np.eye(3), axis=(-1, -2))[..., None, None]
    orthonormal = spatial.matrix_from_quat_wxyz(spatial.quat_from_matrix_wxyz(R))
    T[..., :3, :3] = np.where(is_exact, R, orthonormal)
    T[..., 3, :] = [0.0, 0.0, 0.0, 1.0]
    return T


def _open(path: Path) -> Usd.Stage:
    if not path.is_file():
        raise StageError(f"there is no file {path}")
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise StageError(f"{path} is not a readable USD file: {first_reason(error)}") from error
    if not stage:
        raise StageError(f"{path} is not a readable USD file")
    stage.Reload()  # USD caches layers in memory, but the file may have changed
    composition_errors = [e for e in stage.GetCompositionErrors()]  # noqa: C416 - a C++ vector, not a list
    if composition_errors:
        raise StageError(f"{path}: {first_reason(composition_errors[0])}")
    return stage


_REASON_IN_ERROR = re.compile(r"Error in '[^']*' at line \d+ in file \S+ : '(.*?)'\s*(?=Error in '|\Z)", re.DOTALL)


def first_reason(error: object) -> str:
    """Return the first reason in an error of USD, without source code lines; a fixed text if the error is not UTF-8."""
    try:
        text = str(error).strip()
    except UnicodeDecodeError:
        return "the file contains text that is not UTF-8"
    reasons = _REASON_IN_ERROR.findall(text)
    if reasons:
        reason = " ".join(reasons[0].split())
        return re.sub(r"parse error matching \S*pxr\S* ", "syntax error ", reason)
    lines = text.splitlines()
    if not lines:
        return "unknown format"
    return lines[-1].strip()


def _with_ancestors(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """Yield a prim and its ancestors, from the prim outwards, without the pseudo-root."""
    while prim and not prim.IsPseudoRoot():
        yield prim
        prim = prim.GetParent()


def _type_and_axis(prim: Usd.Prim) -> tuple[str, frozenset[int], str, str]:
    """Return (type, free directions as authored, axis token, problem) of a joint prim."""
    for schema, kind in _SCHEMA_KINDS:
        if prim.IsA(schema):
            token = "Z"
            if kind != "fixed":
                token = str(schema(prim).GetAxisAttr().Get())
            if token not in TURN_OF_AXIS:
                return "", frozenset(), "Z", f"axis '{token}' is not X, Y or Z"
            return kind, frozenset(FREE_AXES[kind]), token, ""
    if prim.GetTypeName() != "PhysicsJoint":
        return "", frozenset(), "Z", f"joints of type {prim.GetTypeName()} are not supported"
    free = _free_axes(prim)
    for name in DIRECTIONS:
        if not prim.HasAPI(UsdPhysics.LimitAPI, name):
            continue
        limit = UsdPhysics.LimitAPI(prim, name)
        low = limit.GetLowAttr().Get()
        if low == limit.GetHighAttr().Get() and low != 0:
            return "", frozenset(), "Z", f"{name} is locked at {low:g}: move the joint's frame there"
    if prim.HasAPI(UsdPhysics.LimitAPI, "distance"):
        return "", frozenset(free), "Z", "a distance limit is not supported"
    for i, token in enumerate("XYZ"):
        for kind, pattern in (("revolute", [3 + i]), ("prismatic", [i]), ("cylindrical", [i, 3 + i])):
            if free == pattern:
                return kind, frozenset(free), token, ""
    for kind in ("fixed", "spherical", "free"):
        if free == list(FREE_AXES[kind]):
            return kind, frozenset(free), "Z", ""
    names = ", ".join(DIRECTIONS[axis] for axis in free)
    return "", frozenset(free), "Z", f"a joint that is free in {names} is not supported; split it into two joints"


def _free_axes(prim: Usd.Prim) -> list[int]:
    """Return the directions of a generic joint that its limits leave free, in increasing order."""
    free: list[int] = []
    for axis, name in enumerate(DIRECTIONS):
        if not prim.HasAPI(UsdPhysics.LimitAPI, name):
            free.append(axis)
            continue
        limit = UsdPhysics.LimitAPI(prim, name)
        if limit.GetLowAttr().Get() < limit.GetHighAttr().Get():  # in UsdPhysics, low > high locks an axis
            free.append(axis)
    return free


def _instance_and_limits(prim: Usd.Prim, kind: str, free: frozenset[int]) -> tuple[str, tuple[float, float] | None]:
    """Return (instance name of drive and state, limits) of a joint with one coordinate."""
    if kind not in ("revolute", "prismatic"):
        return "", None
    if prim.GetTypeName() == "PhysicsJoint":
        instance = DIRECTIONS[min(free)]
        if not prim.HasAPI(UsdPhysics.LimitAPI, instance):
            return instance, None
        limit = UsdPhysics.LimitAPI(prim, instance)
        low = limit.GetLowAttr().Get()
        high = limit.GetHighAttr().Get()
    else:
        if kind == "revolute":
            instance = "angular"
            joint = UsdPhysics.RevoluteJoint(prim)
        else:
            instance = "linear"
            joint = UsdPhysics.PrismaticJoint(prim)
        low = joint.GetLowerLimitAttr().Get()
        high = joint.GetUpperLimitAttr().Get()
    # A blocked limit has no value, as if it were not authored.
    lower = -np.inf if low is None else float(low)
    upper = np.inf if high is None else float(high)
    if np.isneginf(lower) and np.isposinf(upper):
        return instance, None
    return instance, (lower, upper)


def quaternion_attributes(prim: Usd.Prim) -> list[tuple[Usd.Attribute, Gf.Quatf]]:
    """Return (attribute, value) of each quaternion attribute of a prim with a value at the default time."""
    attributes = []
    for attribute in prim.GetAuthoredAttributes():
        if attribute.GetTypeName().type in (Sdf.ValueTypeNames.Quatf.type, Sdf.ValueTypeNames.Quatd.type):
            value = attribute.Get()
            if value is not None:
                attributes.append((attribute, value))
    return attributes
