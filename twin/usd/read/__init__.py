"""Read a UsdPhysics stage as a mechanism: a stage that twin wrote, or one from other software.

    bodies      meshes, colours, masses, named frames and points
    joints      joints, limits, drives, the base
    twin_data   what only twin writes: trocars, couplings, motors, postures, parameters
    tool        choice of the tool, if the stage does not name one

This package does not import the writer. Like other readers, it uses the joint frames of UsdPhysics, which are in single
precision.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom, UsdPhysics

from twin.core import spatial
from twin.core.errors import MechanismError, StageError
from twin.core.findings import Finding, info
from twin.core.identifiers import identifier, unique
from twin.core.spatial import Array
from twin.model.body import Body, Frame, Point
from twin.model.joint import Joint
from twin.model.mechanism import EARTH, WORLD, Mechanism
from twin.usd.read.bodies import (
    bake_scale,
    below,
    original_name,
    read_frames_and_points,
    read_inertia,
    read_meshes,
    shows_all,
)
from twin.usd.read.joints import Selection, convert, select
from twin.usd.read.tool import with_tool
from twin.usd.read.twin_data import TwinData, read_twin_data
from twin.usd.scan import RawStage, first_reason

__all__ = ["inspect_stage", "made_from", "read_motion", "read_stage", "with_tool"]

_ORIGIN_TOL = 1e-9
"""Maximum difference of a pose from the identity, in m or 1, at which a body counts as placed at the origin."""

_FRAME_ROUNDING = 1e-5
"""Maximum difference of two poses, in m or 1, that counts as a rounding error of a joint's frames."""


def made_from(path: str | Path) -> str:
    """Return the attribute twin:source of the default prim of a stage; "" if it is missing."""
    scene = RawStage(path)  # keep a reference, because a prim is invalid without its stage
    prim = scene.stage.GetDefaultPrim()
    if not prim:
        return ""
    return str(prim.GetAttribute("twin:source").Get() or "")


def read_stage(path: str | Path, root: str | None = None) -> Mechanism:
    """Return the mechanism of a stage; `inspect_stage` also returns findings on omitted data."""
    return inspect_stage(path, root)[0]


def inspect_stage(path: str | Path, root: str | None = None) -> tuple[Mechanism, list[Finding]]:
    """Return (mechanism of a stage, findings on renamed, guessed and omitted data).

    Every up axis and unit is converted to z up, metres and kilograms. Joint frames with axis X or Y are rotated so that
    z is the axis. Bodies may be nested. A joint side whose target is missing or not a body is attached to the
    world. Joints excluded from the articulation come last, so that they close the loops; in a stage written by twin,
    the order of joints is unchanged. Rest poses are those at the default time; positions have double precision,
    rotations the precision of the orient op. Gravity is that of the robot (`twin:gravity`), else of the physics scene.

    The first body is the first of these that exists: the body named by `twin:base`; the body fixed to the world; the
    articulation root; the first body that is never a child; the first body of the stage. If the frame of this body is
    the frame of the world, it is the base. Otherwise, and if other joints connect to the world, the base is an added
    body "world". If no joint connects the robot to the world, it floats: a free joint connects its first body to an
    added body "world". `root` is the prim path of the robot, if the stage has several robots.

    Raises:
        StageError: the file is missing or not USD; it has no bodies or joints, several robots or several fixed bodies;
            a body is mirrored or sheared, or an ancestor of a body is scaled non-uniformly; a joint is invalid or
            cannot be expressed; or a mesh uses vertices that do not exist.
    """
    scene = RawStage(path)
    _refuse_unknown_types(scene)
    try:
        return _inspect(scene, root)
    except Tf.ErrorException as error:  # for example a path outside the allowed folders
        raise StageError(f"{scene.path}: {first_reason(error)}") from error


def read_motion(path: str | Path) -> tuple[Array, dict[str, Array]]:
    """Return the sample times and the poses of all rigid bodies of a stage.

    The samples are the time samples of the transforms of bodies and of their ancestors. If bodies have samples at
    different time codes, all bodies are evaluated at every time code of any body; USD then interpolates poses.

    Returns:
        (times, poses): times (k,) in s from time code 0; poses {name: T_world_body (k, 4, 4)} in metres, world z up,
        with the body names of `read_stage`.

    Raises:
        StageError: the file cannot be read or no body moves.
    """
    scene = RawStage(path)
    codes = scene.sample_codes
    if not len(codes):
        raise StageError(f"{scene.path}: no transform of a rigid body has time samples")
    original_names = []
    for body_path, body in scene.bodies.items():
        original_names.append((body_path, original_name(body)))
    names = unique(original_names)
    T_world_body = scene.poses(list(scene.bodies.values()), codes)
    times = codes / scene.stage.GetTimeCodesPerSecond()
    return times, dict(zip(names.values(), T_world_body, strict=True))


def _inspect(scene: RawStage, root: str | None) -> tuple[Mechanism, list[Finding]]:
    notes: list[Finding] = []
    selection = select(scene, root, notes)
    prims = [scene.bodies[body_path] for body_path in selection.bodies]
    for prim in prims:
        bake_scale(scene, prim, notes)
    T_world_body = dict(zip(selection.bodies, scene.poses(prims)[:, 0], strict=True))
    T_world_chosen = T_world_body.get(selection.base, np.eye(4))
    at_origin = np.allclose(T_world_chosen, np.eye(4), rtol=0.0, atol=_ORIGIN_TOL)
    base = selection.base
    if selection.floats or not at_origin:
        base = ""
    names = _body_names(scene, selection, base)
    joint_names = _joint_names(selection)
    mesh_names = _mesh_names(scene, prims)
    _note_names(notes, {**names, **joint_names})

    bodies: list[Body] = []
    if not base:
        bodies.append(Body(names[""]))
    frames: list[Frame] = []
    points: list[Point] = []
    for body_path, prim in zip(selection.bodies, prims, strict=True):
        name = names[body_path]
        meshes = read_meshes(scene, prim, mesh_names, notes)
        inertia = read_inertia(scene, prim, notes)
        bodies.append(Body(name, meshes, inertia, shows_all(scene, prim)))
        for kind, given_name, T in read_frames_and_points(scene, prim):
            if kind == "frame":
                frames.append(Frame(given_name, name, T))
            else:
                points.append(Point(given_name, name, T[:3, 3]))
    T_world_base = T_world_body.get(base, np.eye(4))
    robot = prims[0].GetParent()
    twin_data = read_twin_data(scene, robot)
    joints = _joints(scene, selection, base, names, joint_names, T_world_body, twin_data, notes)
    try:
        mechanism = Mechanism(
            name=identifier(_robot_name(scene, selection, root)),
            base=names[base],
            bodies=tuple(bodies),
            joints=joints,
            frames=tuple(frames),
            points=tuple(points),
            rest=_rest(names, T_world_body, T_world_base),
            gravity=_gravity(scene, robot),
            source=scene.path,
            tool=twin_data.tool,
            trocars=twin_data.trocars,
            couplings=twin_data.couplings,
            actuators=twin_data.actuators,
            transmissions=twin_data.transmissions,
            postures=twin_data.postures,
            parameters=twin_data.parameters,
        )
    except MechanismError as error:
        raise StageError(f"{scene.path}: {error}") from error
    return mechanism, notes


def _body_names(scene: RawStage, chosen: Selection, base: str) -> dict[str, str]:
    """Return {prim path: name} of the bodies; the added body "world" has the path "".

    Only the base can have the name "world": in an MJCF, a body of this name is the world itself.
    """
    body_names = []
    for path in chosen.bodies:
        body_names.append((path, original_name(scene.bodies[path])))
    if not base:
        return unique(body_names, reserved=(WORLD,)) | {"": WORLD}
    if identifier(original_name(scene.bodies[base])) == WORLD:
        return unique(body_names)
    return unique(body_names, reserved=(WORLD,))


def _joint_names(chosen: Selection) -> dict[str, str]:
    """Return {prim path: name} of the joints; the joint of an added body "world" has the path ""."""
    joint_names = [(joint.path, joint.prim.GetName()) for joint in chosen.joints]
    joint_names.append(("", _mount_name(chosen)))
    return unique(joint_names)


def _mesh_names(scene: RawStage, bodies: list[Usd.Prim]) -> dict[str, str]:
    """Return {prim path: name} of the meshes of the bodies."""
    mesh_names: list[tuple[str, str]] = []
    for body in bodies:
        for prim in below(scene, body):
            if prim.IsA(UsdGeom.Mesh):
                mesh_names.append((str(prim.GetPath()), original_name(prim)))
    return unique(mesh_names)


def _joints(
    scene: RawStage,
    chosen: Selection,
    base: str,
    names: dict[str, str],
    joint_names: dict[str, str],
    T_world_body: dict[str, Array],
    twin_data: TwinData,
    notes: list[Finding],
) -> tuple[Joint, ...]:
    """Return the joints, first the one between an added body "world" and the first body of the stage."""
    joints: list[Joint] = []
    mounted = chosen.base != base
    if mounted:
        mount = _mount(scene, chosen, joint_names[""], names, T_world_body[chosen.base], notes)
        if chosen.floats:
            mount = replace(mount, type="free")
        joints.append(mount)
    geared: set[str] = set()
    for transmission in twin_data.transmissions:
        geared.update(transmission.joints)
    T_world_base = T_world_body.get(base, np.eye(4))
    for raw in chosen.joints:
        joint = convert(scene, raw, joint_names[raw.path], names, base, T_world_base, notes)
        if joint.name in geared:
            joint = replace(joint, drive=None)  # the drive is equivalent to the joint's motors
        if mounted and joint.name in twin_data.trocars:  # a trocar is a joint of the base
            T_world_joint = T_world_body[chosen.base] @ joint.T_parent_joint
            joint = replace(joint, parent=names[""], T_parent_joint=T_world_joint)
        joints.append(joint)
    return tuple(joints)


def _mount_name(chosen: Selection) -> str:
    """Return the name of the joint between the added body "world" and the first body."""
    if chosen.anchor is not None:
        return chosen.anchor.prim.GetName()
    leaf = chosen.base.rpartition("/")[2]
    if chosen.floats:
        return f"{leaf}_free"
    return f"{leaf}_mount"


def _mount(
    scene: RawStage, chosen: Selection, name: str, names: dict[str, str], T_world_body: Array, notes: list[Finding]
) -> Joint:
    """Return the joint from the world to the first body, which has the pose `T_world_body` (4, 4).

    The frames of the stage's own joint are in single precision; they are used only if they contradict this pose.
    """
    at_pose = Joint(name, "fixed", names[""], names[chosen.base], T_world_body)
    if chosen.anchor is None:
        return at_pose
    stated = convert(scene, chosen.anchor, name, names, "", np.eye(4), notes)
    if stated.parent == names[""]:
        deviation = stated.relative(np.eye(4), T_world_body)
    else:
        deviation = stated.relative(T_world_body, np.eye(4))
    if np.allclose(deviation, np.eye(4), rtol=0.0, atol=_FRAME_ROUNDING):
        return at_pose
    return stated


def _gravity(scene: RawStage, robot: Usd.Prim) -> tuple[float, float, float]:
    """Return the gravitational acceleration in m/s2 in the world, z up: of the robot, else of the physics scene."""
    own_gravity = robot.GetAttribute("twin:gravity").Get()
    if own_gravity is not None:
        return (float(own_gravity[0]), float(own_gravity[1]), float(own_gravity[2]))
    physics = _physics_scene(scene)
    if physics is None:
        return EARTH
    direction = np.array(physics.GetGravityDirectionAttr().Get(), float)
    size = float(physics.GetGravityMagnitudeAttr().Get())
    if not np.any(direction):  # in UsdPhysics, a zero vector means down, and a negative size means that of the earth
        direction = scene.R_world_stage.T @ np.array([0.0, 0.0, -1.0])
    down = scene.R_world_stage @ direction / np.linalg.norm(direction)
    if size < 0.0 or not np.isfinite(size):
        x, y, z = -EARTH[2] * down
    else:
        x, y, z = scene.meters * size * down
    return _from_single(x), _from_single(y), _from_single(z)


def _physics_scene(scene: RawStage) -> UsdPhysics.Scene | None:
    """Return the first physics scene of a stage, or None."""
    for prim in scene.prims:
        if prim.IsA(UsdPhysics.Scene):
            return UsdPhysics.Scene(prim)
    return None


def _from_single(value: float) -> float:
    """Return a value of single precision without its rounding error (9.81 is stored as 9.8100004), and 0 for -0."""
    return float(f"{value:.7g}") + 0.0


def _shape(name: Sdf.ValueTypeName) -> tuple:
    """Return (is_array, kind) of a value type; the kind is number, quaternion, text, or the size of a vector."""
    value = name.scalarType.defaultValue
    if isinstance(value, bool | str):
        return name.isArray, type(value)
    if hasattr(value, "GetReal"):
        return name.isArray, "quaternion"
    try:
        return name.isArray, len(value)
    except TypeError:
        return name.isArray, 0


def _refuse_unknown_types(scene: RawStage) -> None:
    """Raise `StageError` if an attribute has an unknown type, or not that of its schema; USD would misread values."""
    layers = scene.stage.GetUsedLayers()  # in the order of their addresses in memory
    for layer in sorted(layers, key=lambda layer: layer.identifier):

        def check(path: Sdf.Path, layer: Sdf.Layer = layer) -> None:
            spec = layer.GetAttributeAtPath(path) if path.IsPropertyPath() else None
            if spec:
                _refuse_unknown_type(scene, path, spec)

        layer.Traverse(Sdf.Path.absoluteRootPath, check)


def _refuse_unknown_type(scene: RawStage, path: Sdf.Path, spec: Sdf.AttributeSpec) -> None:
    kind = spec.GetInfo("typeName")
    if spec.typeName.type.isUnknown:
        raise StageError(f"{scene.path}: {path} has type '{kind}', which USD does not define")
    prim = scene.stage.GetPrimAtPath(path.GetPrimPath())
    if not prim:
        return
    schema = prim.GetPrimDefinition().GetSchemaAttributeSpec(path.name)
    if schema and _shape(schema.typeName) != _shape(spec.typeName):
        text = f"{path} has type '{kind}', but the schema of the prim requires {schema.typeName}"
        raise StageError(f"{scene.path}: {text}")


def _rest(names: dict[str, str], T_world_body: dict[str, Array], T_world_base: Array) -> dict[str, Array]:
    T_base_world = spatial.inverse(T_world_base)
    rest: dict[str, Array] = {}
    for path, name in names.items():
        rest[name] = T_base_world @ T_world_body.get(path, np.eye(4))
    return rest


def _note_names(notes: list[Finding], names: dict[str, str]) -> None:
    for path, name in names.items():
        leaf = path.rpartition("/")[2]
        if path and name != leaf:
            notes.append(info("stage.read.renamed", path, f"{path} is renamed to '{name}'"))


def _robot_name(scene: RawStage, chosen: Selection, root: str | None) -> str:
    if root:
        return root.rpartition("/")[2]
    default = scene.stage.GetDefaultPrim()
    if default:
        return default.GetName()
    return chosen.bodies[0].split("/")[1]
