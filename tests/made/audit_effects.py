"""Whether a change of a file has an effect on the robot, as a reader sees it that shares nothing with the audit.

MuJoCo compiles an MJCF and Pinocchio reads a URDF; what they do not read (transmissions, safety controllers, names) has
an effect unless it is in the short lists here, each with its reason.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

UNUSED = {
    "stat": "statistics of the picture",
    "vis": "settings of the picture",
    "signature": "a hash of the file",
    "buffer": "size",
    "names": "compared by the other arrays' order, and by name below",
    "narena": "size of memory",
    "nbuffer": "size of memory",
    "name_": "addresses of names, which are compared as a list",
    "nnames": "size of memory",
    "npaths": "size of memory",
    "paths": "paths of files; the meshes themselves are compared",
    "geom_fluid": "fluid forces; exports have no medium",
    "body_sameframe": "a shortcut of the computation, which follows from the poses",
    "geom_sameframe": "a shortcut",
    "site_sameframe": "a shortcut",
    "cam_": "cameras, which are no parts of the robot",
    "ncam": "the same",
    "light_": "lights, which are no parts of the robot",
    "nlight": "the same",
    "sensor": "sensors read the robot",
    "nsensor": "the same",
    "numeric": "numbers for other programs",
    "nnumeric": "the same",
    "nuser": "room for numbers of other programs",
    "site_rgba": "colour of a mark in the picture",
    "jnt_group": "groups of the viewer",
    "site_group": "groups of the viewer",
    "actuator_group": "groups of the viewer",
    "tendon_group": "groups of the viewer",
    "actuator_lengthrange": "of muscles; exports have none",
    "key_time": "the time at which a simulation starts",
    "site_size": "size of a mark in the picture",
    "bvh": "bounding volumes, which follow from the meshes",
    "oct": "bounding volumes, which follow from the meshes",
}
"""Fields of a compiled model, by the beginning of their names, that do not change what the robot does or looks like."""

ROUNDING = 1e-9


class RefusedError(Exception):
    """The reader refuses the file."""


def mjcf_model(file: Path) -> dict[str, Any]:
    """Return what MuJoCo compiles of a file, by field."""
    import mujoco

    try:
        m = mujoco.MjModel.from_xml_path(str(file))
    except (ValueError, mujoco.FatalError) as error:
        raise RefusedError(str(error)) from error
    read: dict[str, Any] = {}
    for name in dir(m):
        if name.startswith("_") or name.startswith(tuple(UNUSED)):
            continue
        value = getattr(m, name)
        if callable(value):
            continue
        if isinstance(value, np.ndarray | int | float):
            read[name] = np.array(value)
            if name.endswith("quat") and read[name].size:
                read[name] = unsigned(read[name])
    for joint in range(m.njnt):
        if m.jnt_type[joint] == mujoco.mjtJoint.mjJNT_BALL and m.nkey:
            at = slice(m.jnt_qposadr[joint], m.jnt_qposadr[joint] + 4)
            read["key_qpos"][:, at] = unsigned(read["key_qpos"][:, at])
    for name in dir(m.opt):
        value = getattr(m.opt, name)
        if not name.startswith("_") and isinstance(value, np.ndarray | int | float):
            read[f"opt.{name}"] = np.array(value)
    for kind, count in NAMED.items():
        object_type = getattr(mujoco.mjtObj, f"mjOBJ_{kind}")
        names = [mujoco.mj_id2name(m, object_type, k) for k in range(getattr(m, count))]
        # A second keyframe is only used on demand.
        read[f"names of {kind}"] = names[:1] if kind == "KEY" else names
    return read


def unsigned(quaternions: np.ndarray) -> np.ndarray:
    """Return quaternions (n, 4) whose largest component is positive: their sign is none of a rotation."""
    largest = np.take_along_axis(quaternions, np.abs(quaternions).argmax(axis=1)[:, None], axis=1)
    return quaternions * np.where(largest < 0, -1.0, 1.0)


NAMED = {
    "BODY": "nbody",
    "JOINT": "njnt",
    "GEOM": "ngeom",
    "SITE": "nsite",
    "MESH": "nmesh",
    "MATERIAL": "nmat",
    "ACTUATOR": "nu",
    "EQUALITY": "neq",
    "TENDON": "ntendon",
    "EXCLUDE": "nexclude",
    "PAIR": "npair",
    "TEXT": "ntext",
    "TUPLE": "ntuple",
    "KEY": "nkey",
}
"""Kinds of objects whose names others refer to, with the field that counts them."""


def urdf_model(file: Path) -> dict[str, Any]:
    """Return what Pinocchio reads of a URDF: joints, inertias, limits, shapes."""
    import pinocchio

    try:
        m = pinocchio.buildModelFromUrdf(str(file))
        shapes = [
            pinocchio.buildGeomFromUrdf(m, str(file), kind, package_dirs=[str(file.parent)])
            for kind in (pinocchio.GeometryType.VISUAL, pinocchio.GeometryType.COLLISION)
        ]
    except (ValueError, RuntimeError) as error:
        raise RefusedError(str(error)) from error
    read: dict[str, Any] = {"names": list(m.names), "joints": [str(j.shortname()) for j in m.joints]}
    for name in ("lowerPositionLimit", "upperPositionLimit", "damping", "friction"):
        read[name] = np.array(getattr(m, name))
    read["effort"] = np.array(m.upperEffortLimit if hasattr(m, "upperEffortLimit") else m.effortLimit)
    read["speed"] = np.array(m.upperVelocityLimit if hasattr(m, "upperVelocityLimit") else m.velocityLimit)
    read["parents"] = np.array(list(m.parents))
    read["placements"] = np.array([p.homogeneous for p in m.jointPlacements])
    read["inertias"] = np.array([i.matrix() for i in m.inertias])
    read["axes"] = [re.sub(r"-?0\.?0*(?=[ \n])", "0", str(j)) for j in m.joints]
    # An order of siblings is none of the robot.
    read["frames"] = {f.name: (f.parentJoint, f.placement.homogeneous) for f in m.frames}
    for k, model in enumerate(shapes):
        kind = ("visual", "collision")[k]
        for g in model.geometryObjects:
            entry = [g.parentJoint, g.placement.homogeneous, np.array(g.meshScale), Path(g.meshPath).name]
            entry.append(np.array(g.meshColor))
            read[f"{kind} {g.name}"] = entry
    return read


READERS = {".xml": mjcf_model, ".urdf": urdf_model}


def same(a: Any, b: Any) -> bool:
    """Return whether two values read are equal within rounding; a blocked one is that of an identity, or false."""
    if a is None or b is None:
        other = b if a is None else a
        if isinstance(other, np.ndarray):
            return other.shape in ((3,), (4,)) and bool(np.all(other[-3:] == 0))
        return not other
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    if isinstance(a, list | tuple):
        return isinstance(b, list | tuple) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        if not (isinstance(a, np.ndarray) and isinstance(b, np.ndarray)):
            return False
        if a.shape != b.shape:
            return False
        if a.dtype.kind in "fc":
            size = max(1e-12, float(np.abs(a[np.isfinite(a)]).max(initial=0.0)))
            return bool(np.allclose(a, b, rtol=ROUNDING, atol=1e-3 * ROUNDING * size, equal_nan=True))
        return bool(np.array_equal(a, b))
    return bool(a == b)


DIRECTIONS = ("quat", "pos", "mat", "pose", "placements", "frames")
"""Parts of the names of fields in m or without unit, of which 1e-8 is nothing."""


def differing(a: dict[str, Any], b: dict[str, Any]) -> list[str]:
    """Return the fields in which two models differ."""
    found = []
    for key in sorted({*a, *b}):
        if key in a and key in b:
            one, other = a[key], b[key]
            placed = any(part in key for part in DIRECTIONS) and isinstance(one, np.ndarray)
            if same(one, other) or (placed and one.shape == other.shape and np.allclose(one, other, rtol=0, atol=1e-8)):
                continue
        found.append(key)
    return found


NO_ORDER = "after the next"
"""Change of the order of children: objects have names. Of an MJCF, the order of joints and bodies is that of `qpos`."""

URDF_UNREAD = ("transmission", "gazebo", "safety_controller", "calibration", "robot@name", "mimic", "ros2_control")
"""Fields of a URDF that Pinocchio does not read, and that have an effect on the robot."""

NO_EFFECT = (
    (r"worldbody/(inertial.*|.*@mass.*)", r"^(base|frame|world)$", "the base is fixed: its mass moves nothing"),
    (r".*over2 \(apiSchemas\): without PhysicsMassAPI", r"/(base|frame|world)$", "the base is fixed"),
    (r"worldbody/site@quat.*", r"point_", "a point has no directions"),
    (r"joint/origin@rpy.*", r"_[ab]_fixed$", "a ball closes its loop at a point, in any direction"),
    (r"transmission@name: unknown", r"", "nothing refers to a transmission by name"),
    (r"transmission/actuator/hardwareInterface: removed", r"", "ros_control reads that of the joint, since Indigo"),
    (r"transmission/actuator/mechanicalReduction: removed", r"", "without one it is 1, as it was here"),
    (r"transmission/actuator@name: unknown", r"", "an actuator may have any name; a file of one says nothing else"),
    (r".*PhysicsFixedJoint: (renamed|below a sibling)", r"root_joint", "the joint of the base has a name only here"),
    (r".*PhysicsFixedJoint\..*(blocked|body0: without targets)", r"root_joint", "the base is at the origin"),
    (r".*Scope: (renamed|without a type|below a sibling)", r"", "a scope only groups"),
    (r".*parameters/.*/(note|index).*", r"", "notes and their order are for people"),
    (r".*twin:(source|mating).*", r"", "sources are for people"),
    (r".*gravityDirection\[2\]: small|.*gravityDirection: (removed|blocked)", r"", "a direction has no length; down"),
    (r".*gravityMagnitude: (removed|blocked|sign)", r"", "the schema then takes the gravity of the earth"),
    (r".*PhysicsScene: renamed", r"", "a scene may have any name"),
    (r".*Xform\.purpose.*", r"", "frames and points have no shape that could be shown"),
    (r".*Xform: renamed", r"tool_point", "twin:name states its name"),
    (r".*(Joint|Scope)\.(purpose|visibility).*", r"/joints", "joints have no shape that could be shown"),
    (r".*Scope: duplicated", r"/materials$", "nothing binds a second set of materials"),
    (r".*doubleSided.*", r"", "the inner sides of closed meshes are not seen"),
    (
        r'<link name="more"/><joint name="more_joint" type="fixed">.*',
        r"",
        "a link without mass and shape marks a place",
    ),
    (r"asset/mesh@inertia: removed", r"", "shapes have no mass, links state theirs; MuJoCo only rounds otherwise"),
    (r"actuator/general@dynprm added.*", r"", "without dyntype, an actuator has no dynamics"),
    (r".*Shader: duplicated", r"", "no material connects to a second shader"),
    (r".*Joint: below a sibling", r"", "a joint may be anywhere: it names its bodies"),
)
"""Changes without effect that a reader cannot tell: pattern of the kind, pattern of the place, reason."""


Model = dict[str, Any]
Harmless = Callable[[Model, Model, str], bool]
"""Whether the difference of two models in one field is none of the robot."""


def changed_rows(a: Model, b: Model, key: str) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yield (number, row before, row after) of the rows of a field that differ."""
    for k, (one, other) in enumerate(zip(a[key], b[key], strict=True)):
        if not np.array_equal(one, other):
            yield k, np.asarray(one, float), np.asarray(other, float)


def along_axis(a: Model, b: Model, key: str) -> bool:
    """The anchor of a hinge may be anywhere on its axis, that of a slide anywhere."""
    if not np.array_equal(a["jnt_axis"], b["jnt_axis"]) or not np.array_equal(a["jnt_type"], b["jnt_type"]):
        return False
    for k, one, other in changed_rows(a, b, key):
        slide = int(a["jnt_type"][k]) == 2
        if not slide and np.linalg.norm(np.cross(a["jnt_axis"][k], other - one)) > 1e-9:
            return False
    return True


def unbounded(a: Model, b: Model, key: str) -> bool:
    """1e6 in N m, N, rad/s or m/s means no bound, and more does too."""
    return all(one >= UNBOUNDED and other >= UNBOUNDED for _, one, other in changed_rows(a, b, key))


def weightless(a: Model, b: Model, key: str) -> bool:
    """The end of a loop, or a part of a ball joint, has 1 mg."""
    return all(max(one[0, 0], other[0, 0]) <= 1.1e-6 for _, one, other in changed_rows(a, b, key))


def impedance(solimp: np.ndarray) -> np.ndarray:
    """Return the impedance of a constraint at displacements up to 10 mm (MuJoCo, "Solver parameters")."""
    start, end = np.clip(solimp[:2], 1e-4, 0.9999)
    width, middle, power = max(1e-15, solimp[2]), np.clip(solimp[3], 1e-4, 0.9999), max(1.0, solimp[4])
    x = np.minimum(np.concatenate([[0.0], np.geomspace(1e-9, 1e-2, 200)]) / width, 1.0)
    low = x**power / middle ** (power - 1)
    high = 1 - (1 - x) ** power / (1 - middle) ** (power - 1)
    return start + np.where(x <= middle, low, high) * (end - start)


def same_impedance(a: Model, b: Model, key: str) -> bool:
    """The impedance is its maximum, or constant over the width."""
    return all(np.allclose(impedance(x), impedance(y), rtol=0, atol=1e-9) for _, x, y in changed_rows(a, b, key))


def unread_coefficients(a: Model, b: Model, key: str) -> bool:
    """Of an equality of one tendon or joint, MuJoCo reads the first coefficient alone."""
    for k, one, other in changed_rows(a, b, key):
        single = int(b["eq_type"][k]) in (2, 3) and int(b["eq_obj2id"][k]) < 0
        if not single or one[0] != other[0]:
            return False
    return True


def same_start(a: Model, b: Model, key: str) -> bool:
    """Without its keyframe, a simulation starts at `ref`, with controls of 0: the same state; a second is on demand."""
    if int(b["nkey"]) > int(a["nkey"]) > 0:
        return bool(np.array_equal(a["key_qpos"][0], b["key_qpos"][0]))
    if int(b["nkey"]) or not np.all(a["key_ctrl"] == 0) or not np.all(a["key_qvel"] == 0):
        return False
    return bool(np.allclose(a["key_qpos"], a["qpos0"], rtol=0, atol=1e-9))


def numbers_before_and_after(a: Model, b: Model, key: str) -> tuple[np.ndarray, np.ndarray] | None:
    one, other = a.get(key), b.get(key)
    if not (isinstance(one, np.ndarray) and isinstance(other, np.ndarray)) or one.shape != other.shape:
        return None
    return one, other


def same_display(a: Model, b: Model, key: str) -> bool:
    """0.5 % of a colour, linear or as displayed, is rounding to eight bits."""
    both = numbers_before_and_after(a, b, key)
    if both is None:
        return False
    linear = np.abs(both[0] - both[1]).max(initial=0.0)
    powers = [np.clip(colour, 0.0, None) ** (1 / 2.4) for colour in both]
    return bool(min(linear, np.abs(powers[0] - powers[1]).max(initial=0.0)) <= ROUNDED_COLOUR)


def shown_groups(a: Model, b: Model, key: str) -> bool:
    """Viewers show the groups 0 to 2."""
    return bool(a[key].max(initial=0) <= 2 and b[key].max(initial=0) <= 2)


def same_effort(a: Model, b: Model, key: str) -> bool:
    """A constant effort of a servo below 1e-6 N or N m moves nothing."""
    return all(np.abs(one - other).max() < 1e-6 for _, one, other in changed_rows(a, b, key))


def same_painted(a: Model, b: Model, key: str) -> bool:
    """A shape of a URDF, of which the last entry is its colour as displayed."""
    *one, color = a.get(key) or [None]
    *other, other_color = b.get(key) or [None]
    if color is None or other_color is None or not same(one, other):
        return False
    return float(np.abs(color - other_color).max()) <= ROUNDED_COLOUR


def same_look(a: Model, b: Model, key: str) -> bool:
    """Viewers show the material of a shape; displayColor is for those that read none."""
    return bool(a.get(f"{key.rpartition('.')[0]} material")) and (b.get(key) is None or same_display(a, b, key))


def same_normals(a: Model, b: Model, key: str) -> bool:
    """A normal turned by less than a degree is no other picture."""
    both = numbers_before_and_after(a, b, key)
    if both is None or both[0].ndim != 2:
        return False
    one, other = (rows / np.linalg.norm(rows, axis=1, keepdims=True) for rows in both)
    return bool(np.linalg.norm(one - other, axis=1).max(initial=0.0) < np.radians(1.0))


def same_tensor(a: Model, b: Model, key: str) -> bool:
    """The principal axes may be turned by half a turn about one of them, or about one of symmetry."""
    moments = key.replace("principalAxes", "diagonalInertia")
    if numbers_before_and_after(a, b, moments) is None:
        return False
    tensors = []
    for model in (a, b):
        w, x, y, z = model[key]
        R = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        tensors.append(R @ np.diag(model[moments]) @ R.T)
    return bool(np.abs(tensors[0] - tensors[1]).max() <= TENSOR * np.abs(tensors[0]).max())


def still(a: Model, b: Model, key: str) -> bool:
    """5e-4 time codes, of a stage without motion."""
    moving = any(" pose at " in name for name in a)
    return not moving and float(np.abs(a[key] - b[key]).max()) <= 1e-3


UNBOUNDED = 1e6
ROUNDED_COLOUR = 0.0051
TENSOR = 1e-5
"""Relative difference of equal tensors: stages have single precision."""

BY_VALUE: tuple[tuple[str, Harmless], ...] = (
    (r"jnt_pos", along_axis),
    (r"actuator_biasprm", same_effort),
    (r"geom_group", shown_groups),
    (r"effort|speed", unbounded),
    (r"inertias", weightless),
    (r"eq_solimp", same_impedance),
    (r"eq_data", unread_coefficients),
    (r"key_.*|nkey", same_start),
    (r"(mat|geom)_rgba|mat_(metallic|roughness)|.*\.inputs:(diffuseColor|metallic|roughness)", same_display),
    (r"visual .*", same_painted),
    (r".*\.primvars:displayColor", same_look),
    (r".*\.(primvars:)?normals", same_normals),
    (r".*\.physics:principalAxes", same_tensor),
    (r"range", still),
)
"""Fields in which models may differ without an effect: pattern of the field, what shows that by its values."""


def harmless(a: Model, b: Model, key: str) -> bool:
    """Return whether a difference of two models in a field is shown to be none of the robot by its values."""
    for pattern, shown in BY_VALUE:
        if re.fullmatch(pattern, key):
            # A keyframe, a displayed colour and a shape may be absent; all others have as many numbers as before.
            comparable = numbers_before_and_after(a, b, key) is not None
            return (comparable or shown in (same_start, same_look, same_painted)) and shown(a, b, key)
    return False


def effect(before: dict[str, Any], file: Path, kind: str, place: str) -> str:
    """Return "none", "refused", or the fields of the model that differ from those `before` the change."""
    try:
        after = READERS[file.suffix](file)
    except RefusedError:
        return "refused"
    except Exception as error:  # a reader that raises anything else refuses too, in its way
        return f"refused ({type(error).__name__})"
    fields = [key for key in differing(before, after) if not harmless(before, after, key)]
    if NO_ORDER in kind and not re.search(r"(^|/)(joint|body|worldbody): ", kind):
        return "none"
    for pattern, there, _ in NO_EFFECT:
        if re.fullmatch(pattern, kind) and re.search(there, place):
            return "none"
    if file.suffix == ".urdf" and any(word in kind for word in URDF_UNREAD) and NO_ORDER not in kind:
        fields.append("(not read by Pinocchio)")
    return ", ".join(fields[:6]) or "none"


USD_COMMENTS = ("documentation", "comment", "twin:mating", "twin:whole", "displayName", "customLayerData")
"""Parts of keys of a stage that are for people."""


def stage_model(file: Path) -> dict[str, Any]:
    """Return what OpenUSD resolves of a stage: prims, values at rest and at the first and last sample, world poses."""
    from pxr import Tf, Usd, UsdGeom, UsdShade

    try:
        stage = Usd.Stage.Open(str(file))
        if not stage or stage.GetCompositionErrors():
            raise RefusedError(str(stage and stage.GetCompositionErrors()))
        read: dict[str, Any] = {}
        read["rate"] = stage.GetTimeCodesPerSecond()  # falls back to the frames per second
        for key in ("upAxis", "metersPerUnit", "kilogramsPerUnit", "defaultPrim"):
            read[key] = stage.GetMetadata(key)
        read["range"] = np.array([stage.GetStartTimeCode(), stage.GetEndTimeCode()])
        read["frames"] = stage.GetFramesPerSecond()
        cache = UsdGeom.XformCache()
        for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
            path = str(prim.GetPath())
            schemas = sorted(map(str, prim.GetPrimTypeInfo().GetAppliedAPISchemas()))
            read[path] = [str(prim.GetTypeName()), schemas, prim.IsInstance()]
            read[f"{path} data"] = str(prim.GetCustomData())
            if prim.IsA(UsdGeom.Imageable):
                shown = UsdGeom.Imageable(prim)
                read[f"{path} look"] = [shown.ComputeVisibility(), shown.ComputePurpose()]
                read[f"{path} pose"] = np.array(cache.GetLocalToWorldTransform(prim))
                for time in UsdGeom.Xformable(prim).GetTimeSamples() if prim.IsA(UsdGeom.Xformable) else ():
                    moved = UsdGeom.Xformable(prim).GetLocalTransformation(time)
                    read[f"{path} pose at {time}"] = np.array(moved)
                material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
                read[f"{path} material"] = str(material.GetPath()) if material else ""
            for attribute in prim.GetAttributes():
                if attribute.GetName().startswith("xformOp"):
                    continue  # the poses are compared
                key = f"{path}.{attribute.GetName()}"
                read[key] = resolved(attribute.Get())
                interpolation = attribute.GetMetadata("interpolation")
                if UsdGeom.Primvar.IsPrimvar(attribute):
                    interpolation = UsdGeom.Primvar(attribute).GetInterpolation()  # with that of the schema
                read[f"{key} interpolation"] = str(interpolation)
                for time in attribute.GetTimeSamples():
                    read[f"{key} {time}"] = resolved(attribute.Get(time))
            for relationship in prim.GetRelationships():
                read[f"{path}.{relationship.GetName()}"] = [str(t) for t in relationship.GetForwardedTargets()]
    except (Tf.ErrorException, RuntimeError) as error:
        raise RefusedError(str(error)) from error
    return {key: value for key, value in read.items() if not any(word in key for word in USD_COMMENTS)}


def resolved(value: Any) -> Any:
    """Return a value of a stage as numbers if it has some; the sign of a quaternion is none of a rotation."""
    from pxr import Gf

    if isinstance(value, Gf.Quatf | Gf.Quatd | Gf.Quath):
        numbers = np.array([value.GetReal(), *value.GetImaginary()], float)
        return numbers if numbers[int(np.argmax(np.abs(numbers)))] > 0 else -numbers
    if value is None or isinstance(value, bool | str):
        return value
    try:
        return np.array(value, float)
    except (TypeError, ValueError):
        return str(value)


READERS[".usda"] = stage_model
