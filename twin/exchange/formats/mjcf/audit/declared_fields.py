"""Read what an MJCF declares beside the quantities that all formats share: fields with other values than MuJoCo's own.

Each field of each joint, shape, actuator, tendon, constraint, body, mesh, material and option is compared with the
value that it has where nothing is written, after default classes. So a field that no other comparison reads is found
by its name, also one that later versions of MuJoCo add.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import mujoco
import numpy as np

from twin.exchange.audit.file_joints import WORLD

_EQUAL_ROUNDING = 1e-12
"""Relative difference of equal numbers."""

_INTERNAL_FIELDS = frozenset(
    {"alt", "classname", "compiler", "frame", "id", "info", "name", "parent", "plugin", "signature", "userdata"}
)
"""Fields that are no declarations of the robot."""

_COMPARED_MOTION_FIELDS: Mapping[str, frozenset[str]] = {
    "joints": frozenset(
        {"armature", "axis", "damping", "frictionloss", "group", "limited", "margin", "pos", "range", "ref"}
        | {"stiffness", "type", "align", "solref_limit", "solimp_limit"}
    ),
    "actuators": frozenset(
        {"biasprm", "biastype", "ctrllimited", "ctrlrange", "dynprm", "dyntype", "forcelimited", "forcerange"}
        | {"gainprm", "gear", "group", "target", "trntype", "type", "ctrlspec", "lengthrange"}
    ),
    "tendons": frozenset(
        {"armature", "limited", "range", "group", "width", "rgba", "material", "springlength", "path", "type"}
    ),
    "equalities": frozenset({"active", "data", "name1", "name2", "objtype", "solimp", "solref", "type"}),
    "bodies": frozenset(
        {"childclass", "explicitinertial", "frames", "fullinertia", "gravcomp", "ialt", "inertia", "ipos", "iquat"}
        | {"mass", "pos", "quat", "bodies", "geoms", "joints", "sites", "cameras", "lights"}
    ),
}
"""Fields, by list of objects, that other comparisons read, or that have no effect; all others act on the motion."""

_COMPARED_CONTACT_FIELDS: Mapping[str, frozenset[str]] = {
    "geoms": frozenset(
        {"mass", "density", "fromto", "group", "meshname", "hfieldname", "material", "pos", "quat", "rgba", "size"}
        | {"type", "typeinertia", "contype", "conaffinity", "fitscale", "fluid_coefs", "fluid_ellipsoid"}
    ),
    "meshes": frozenset(
        {"content_type", "file", "inertia", "material", "refpos", "refquat", "scale", "uservert", "usernormal"}
        | {"userface", "usertexcoord", "userfacenormal", "userfacetexcoord", "usertexcoordface", "needsdf"}
    ),
    "materials": frozenset({"rgba", "metallic", "roughness", "textures"}),
}
"""The same for what acts on contacts and on the look."""

_LIMIT_SOLVER_FIELDS = ("solref_limit", "solimp_limit")
"""Fields of joints that say how far a limit yields; they act like those of contacts, and authors may choose them."""

_COMPARED_OPTIONS = frozenset(
    {"gravity", "density", "viscosity", "disableflags", "timestep", "integrator", "iterations", "tolerance"}
)
"""Options that other comparisons read, or that a comment of the file states (`claims`)."""

_ACCURACY_OPTIONS = frozenset(
    {"ls_iterations", "ls_tolerance", "ccd_iterations", "ccd_tolerance", "jacobian", "sdf_initpoints", "sdf_iterations"}
    | {"noslip_iterations", "noslip_tolerance", "sleep_tolerance", "solver", "magnetic", "wind"}
)
"""Options of how exactly the solver works, and of what needs sensors or a medium: the motion is nearly the same."""

_COMPARED_TRANSMISSIONS = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_TENDON)
"""Transmissions of actuators that are read; others pull at bodies and sites."""

_LAST_SHOWN_GROUP = 2
"""Highest group of shapes that MuJoCo's viewer shows; colliders of others are in higher ones."""

_COMPARED_FLAGS = (
    int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    | int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    | int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
)
"""Flags that disable what is compared as a whole: then it is missing."""

_ELEMENT_OF_LIST = {
    "joints": "joint",
    "actuators": "actuator",
    "tendons": "tendon",
    "equalities": "equality",
    "geoms": "geom",
    "meshes": "mesh",
    "materials": "material",
}
"""{list of a specification: element of MJCF of its objects}."""

_LISTS_WITHOUT_OBJECTS = {"motion": ("flexes", "skins", "plugins"), "contact": ("excludes", "pairs")}
"""Objects that an export has none of."""

Declared = dict[str, dict[str, str]]
"""{object, such as "joint 'q1'": {field: value as text}}."""


def further_declarations(spec: mujoco.MjSpec) -> tuple[Declared, Declared]:
    """Return the further declarations of an MJCF: (those that act on the motion, those on contacts and look)."""
    motion = _declared_fields(spec, _COMPARED_MOTION_FIELDS)
    contact = _declared_fields(spec, _COMPARED_CONTACT_FIELDS) | _limit_solver_fields(spec)
    options = _fields(spec.option, mujoco.MjSpec().option, _COMPARED_OPTIONS | _ACCURACY_OPTIONS)
    flags = _flag_names(mujoco.mjtDisableBit, spec.option.disableflags & ~_COMPARED_FLAGS)
    if flags:
        options["disabled"] = ", ".join(flags)
    if options:
        motion["the option"] = options
    accuracy: dict[str, str] = {}
    for key, text in _fields(spec.option, mujoco.MjSpec().option, _COMPARED_OPTIONS).items():
        if key in _ACCURACY_OPTIONS:
            accuracy[key] = text
    if accuracy:
        contact["the option"] = accuracy
    for kind, declared in (("motion", motion), ("contact", contact)):
        for name in _LISTS_WITHOUT_OBJECTS[kind]:
            count = len(getattr(spec, name))
            if count:
                declared.setdefault("the file", {})[name] = str(count)
    moving: list[str] = []
    for key in spec.keys:
        if np.any(np.nan_to_num(key.qvel)):  # NaN: not stated
            moving.append(key.name)
    if moving:
        motion["the keyframes"] = {"qvel": ", ".join(moving)}
    return motion, contact


def _declared_fields(spec: mujoco.MjSpec, compared_fields: Mapping[str, frozenset[str]]) -> Declared:
    declared: Declared = {}
    for name, compared in compared_fields.items():
        default = _object_with_defaults(name)
        for number, item in enumerate(getattr(spec, name)):
            fields = _fields(item, default, compared)
            fields |= _partly_compared_fields(name, item)
            if fields:
                label = item.name or f"{number + 1} of {len(getattr(spec, name))}"
                declared[f"{_ELEMENT_OF_LIST.get(name, 'body')} '{label}'"] = fields
    return declared


def _limit_solver_fields(spec: mujoco.MjSpec) -> Declared:
    """Return how limits of joints yield, where that is not by MuJoCo's own parameters."""
    declared: Declared = {}
    default = _object_with_defaults("joints")
    for number, joint in enumerate(spec.joints):
        fields: dict[str, str] = {}
        for key in _LIMIT_SOLVER_FIELDS:
            value = getattr(joint, key)
            if not _equal(value, getattr(default, key)):
                fields[key] = _text(value)
        if fields:
            label = joint.name or f"{number + 1} of {len(spec.joints)}"
            declared[f"joint '{label}'"] = fields
    return declared


def _object_with_defaults(name: str) -> object:
    """Return an object of a list with the values that MuJoCo gives it."""
    spec = mujoco.MjSpec()
    if name == "bodies":
        return spec.worldbody.add_body()
    return getattr(spec.default, _ELEMENT_OF_LIST[name])


def _partly_compared_fields(list_name: str, item: Any) -> dict[str, str]:
    """Return fields of which other comparisons read only the first numbers, or only the usual values."""
    if list_name == "actuators":
        return _actuator_fields(item)
    if list_name == "equalities":
        return _equality_fields(item)
    if list_name == "geoms":
        return _geom_fields(item)
    return {}


def _actuator_fields(actuator: mujoco.MjsActuator) -> dict[str, str]:
    fields: dict[str, str] = {}
    for key, first in (("gear", 1), ("gainprm", 1), ("biasprm", 3), ("dynprm", 1)):
        numbers = np.asarray(getattr(actuator, key), float)[first:]
        if np.any(np.nan_to_num(numbers)):
            fields[f"{key}[{first}:]"] = _text(numbers)
    if actuator.trntype not in _COMPARED_TRANSMISSIONS:
        fields["trntype"] = mujoco.mjtTrn(actuator.trntype).name.removeprefix("mjTRN_").lower()
    return fields


def _equality_fields(equality: mujoco.MjsEquality) -> dict[str, str]:
    if equality.type != mujoco.mjtEq.mjEQ_JOINT or not equality.name2:
        return {}
    # Couplings are compared as linear ones.
    powers = np.asarray(equality.data, float)[2:5]
    if not np.any(powers):
        return {}
    return {"polycoef[2:]": _text(powers)}


def _geom_fields(geom: mujoco.MjsGeom) -> dict[str, str]:
    fields: dict[str, str] = {}
    # Only meshes are read as shapes, so no comparison of meshes would show others. The world may have a floor.
    if geom.type != mujoco.mjtGeom.mjGEOM_MESH and geom.parent.name != WORLD:
        kind = mujoco.mjtGeom(geom.type).name.removeprefix("mjGEOM_").lower()
        fields["type"] = f"{kind} on body '{geom.parent.name}'"
        if geom.meshname:
            fields["type"] += f", which MuJoCo fits to mesh '{geom.meshname}'"
    if geom.group > _LAST_SHOWN_GROUP:
        fields["group"] = f"{geom.group}, which viewers do not show"
    return fields


def _fields(item: object, default: object, compared: Iterable[str]) -> dict[str, str]:
    """Return {field: text} of the fields of an object that differ from those of another, without those `compared`."""
    fields: dict[str, str] = {}
    for key in _field_names(item):
        if key in compared:
            continue
        value = getattr(item, key)
        expected = getattr(default, key)
        if not _equal(value, expected):
            fields[key] = _text(value)
    return fields


def _field_names(item: object) -> Iterator[str]:
    for key in dir(item):
        if key.startswith(("_", "first_", "next_", "add_", "set_", "find_", "to_")) or key in _INTERNAL_FIELDS:
            continue
        if not callable(getattr(item, key)):
            yield key


def _equal(a: object, b: object) -> bool:
    if isinstance(a, str) or isinstance(b, str):
        return str(a) == str(b)
    try:
        first = np.asarray(a, float)
        second = np.asarray(b, float)
    except (TypeError, ValueError):
        return True  # objects, which are no values
    return first.shape == second.shape and bool(
        np.allclose(first, second, rtol=_EQUAL_ROUNDING, atol=0.0, equal_nan=True)
    )


def _text(value: object) -> str:
    if isinstance(value, str):
        return value
    numbers = np.atleast_1d(np.asarray(value, float))
    return " ".join(map("{:g}".format, numbers))


def _flag_names(flags: type[mujoco.mjtDisableBit], bits: int) -> list[str]:
    """Return the names of the bits that are set, such as "constraint"."""
    names = []
    for name, flag in flags.__members__.items():
        if name.startswith("mjDSBL_") and bits & int(flag):
            names.append(name.removeprefix("mjDSBL_").lower())
    return names
