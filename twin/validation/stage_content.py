"""Compare all data of the mechanism read back from a USD stage with the CAD's mechanism, item by item.

If the build did not compute the mass of a body, the mass is estimated from the CAD's meshes and densities by a sum over
tetrahedra. The build uses another method. For a coarse mesh, the estimate is a few per cent too low.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Iterator
from typing import Protocol, TypeVar

import numpy as np

from twin.cad.description import Description
from twin.core import spatial
from twin.core.findings import Finding, Kind
from twin.core.quantity import Quantity, deg, mm
from twin.core.spatial import Array
from twin.core.units import DEG, MM, display_unit
from twin.model.body import Body, Mesh
from twin.model.inertia import Inertia
from twin.model.joint import Joint, reversed_joint
from twin.model.mechanism import Coupling, Mechanism
from twin.validation.masses import solid_moments

SINGLE_PRECISION = 1e-5
"""Maximum relative difference that single precision can cause."""

_ZERO_ROUNDING = 1e-12
"""Difference, in the unit of the number, that is a rounding error beside zero."""

_POSITION_ROUNDING = 1e-6
"""Difference of a position in m that is a rounding error beside the origin, on a stage of about 10 m."""

COARSE_MASS = 0.15
"""Relative tolerance of a mass that is estimated from coarse meshes."""

COARSE_SIZE = 0.04
"""Tolerance of a mass centre that is estimated from coarse meshes, divided by the size of the body."""

COARSE_MOMENT = 0.4
"""Tolerance of an entry of an inertia tensor that is estimated from coarse meshes, relative to the largest entry.

It is large, because the moment of a cylinder about its axis varies with the fourth power of the radius.
"""

_BUILD_AGAIN_ADVICE = "rebuild the stage with `twin build`"
_CONTENT_DIFFERS = Kind("stage.content", "disagreement", _BUILD_AGAIN_ADVICE, word="CAD and description")
_CONTENT_MISPLACED = Kind("stage.content", "disagreement", _BUILD_AGAIN_ADVICE, word="")


def compare_content(mechanism: Mechanism, stage: Mechanism, description: Description) -> list[Finding]:
    """Return findings on data of a mechanism that are missing or different on its USD stage.

    `description` contains the densities that are used for bodies without computed masses.
    """
    findings: list[Finding] = []
    for kind, in_cad, on_stage in (
        ("body", mechanism.bodies, stage.bodies),
        ("joint", mechanism.joints, stage.joints),
        ("frame", mechanism.frames, stage.frames),
        ("point", mechanism.points, stage.points),
        ("actuator", mechanism.actuators, stage.actuators),
        ("transmission", mechanism.transmissions, stage.transmissions),
        ("coupling", mechanism.couplings, stage.couplings),
    ):
        names_in_cad = {item.name for item in in_cad}
        names_on_stage = {item.name for item in on_stage}
        findings += _compare_names(kind, names_in_cad, names_on_stage)
    for name in sorted(set(mechanism.trocars) - set(stage.trocars)):
        findings.append(_CONTENT_DIFFERS(name, f"trocar '{name}' is not marked as a trocar on the stage"))
    # the other way round too: a frame may be marked by mistake
    for name in sorted(set(stage.trocars) - set(mechanism.trocars)):
        findings.append(_CONTENT_DIFFERS(name, f"'{name}' is marked as a trocar on the stage, but not in the CAD"))
    for cad_item, stage_item in _pairs_by_name(mechanism.joints, stage.joints):
        findings += _compare_joints(cad_item, stage_item)
    findings += _compare_motors(mechanism, stage)
    for cad_item, stage_item in _pairs_by_name(mechanism.couplings, stage.couplings):
        findings += _compare_couplings(cad_item, stage_item)
    findings += _compare_world(mechanism, stage)
    for cad_item, stage_item in _pairs_by_name(mechanism.frames, stage.frames):
        findings += _compare_poses(
            f"frame '{cad_item.name}'", cad_item.name, cad_item.T_body_frame, stage_item.T_body_frame
        )
    for cad_item, stage_item in _pairs_by_name(mechanism.points, stage.points):
        findings += _compare_poses(
            f"point '{cad_item.name}'",
            cad_item.name,
            spatial.pose(p=cad_item.p_body),
            spatial.pose(p=stage_item.p_body),
        )
    for cad_item, stage_item in _pairs_by_name(mechanism.bodies, stage.bodies):
        findings += _compare_bodies(cad_item, stage_item, description)
    return findings


def _compare_names(kind: str, in_cad: set[str], on_stage: set[str]) -> Iterator[Finding]:
    """Yield a finding for each name that only the CAD or only the stage has."""
    for name in sorted(in_cad - on_stage):
        yield _CONTENT_DIFFERS(name, f"{kind} '{name}' is not on the stage")
    for name in sorted(on_stage - in_cad):
        yield _CONTENT_DIFFERS(name, f"{kind} '{name}' is on the stage, but not in the CAD")


class _Named(Protocol):
    """A part of a mechanism: a joint, a body, a frame, ..."""

    @property
    def name(self) -> str: ...


_Part = TypeVar("_Part", bound=_Named)


def _pairs_by_name(in_cad: Iterable[_Part], on_stage: Iterable[_Part]) -> list[tuple[_Part, _Part]]:
    """Return pairs (item of `in_cad`, item of `on_stage`) with the same name."""
    by_name = {item.name: item for item in on_stage}
    pairs: list[tuple[_Part, _Part]] = []
    for item in in_cad:
        if item.name in by_name:
            pairs.append((item, by_name[item.name]))
    return pairs


def _compare_numbers(
    what: str, where: str, in_cad: float, on_stage: float, unit: str, relative: float = SINGLE_PRECISION
) -> Iterator[Finding]:
    """Yield a finding if a number in `unit` differs on the stage by more than the fraction `relative`."""
    limit = relative * max(abs(in_cad), abs(on_stage)) + _ZERO_ROUNDING
    if abs(in_cad - on_stage) > limit:
        yield _CONTENT_DIFFERS(where, f"{what} differs on the stage", Quantity(on_stage, unit), float(in_cad))


def _compare_joints(cad_joint: Joint, stage_joint: Joint) -> Iterator[Finding]:
    """Compare a joint of the CAD with that of the stage: type, bodies, frames and numbers."""
    if (cad_joint.parent, cad_joint.child) == (
        stage_joint.child,
        stage_joint.parent,
    ):  # on the stage, joints of the tree point away from the base
        stage_joint = reversed_joint(stage_joint)
    for what in ("type", "parent", "child", "active"):
        in_cad = getattr(cad_joint, what)
        on_stage = getattr(stage_joint, what)
        if in_cad != on_stage:
            yield _CONTENT_DIFFERS(
                cad_joint.name, f"joint '{cad_joint.name}' has {what} {on_stage} on the stage, but {in_cad} in the CAD"
            )
            return
    yield from _compare_poses(
        f"joint '{cad_joint.name}' on '{cad_joint.parent}'",
        cad_joint.name,
        cad_joint.T_parent_joint,
        stage_joint.T_parent_joint,
    )
    yield from _compare_poses(
        f"joint '{cad_joint.name}' on '{cad_joint.child}'",
        cad_joint.name,
        cad_joint.T_child_joint,
        stage_joint.T_child_joint,
    )
    values_in_cad = _joint_numbers(cad_joint)
    values_on_stage = _joint_numbers(stage_joint)
    for name, (in_cad, unit) in values_in_cad.items():
        on_stage, _ = values_on_stage[name]
        what = f"the {name} of joint '{cad_joint.name}'"
        if in_cad is not None and on_stage is not None:
            yield from _compare_numbers(what, cad_joint.name, in_cad=in_cad, on_stage=on_stage, unit=unit)
        elif in_cad is not None:
            yield _CONTENT_DIFFERS(cad_joint.name, f"{what} is missing on the stage")
        elif on_stage is not None:
            yield _CONTENT_DIFFERS(cad_joint.name, f"{what} is on the stage, but not in the CAD")


def _joint_numbers(joint: Joint) -> dict[str, tuple[float | None, str]]:
    """Return {name: (value or None, unit)} of the numbers of a joint, angles in deg and lengths in mm."""
    unit, scale = display_unit(joint.is_angle)

    def shown(value: float | None) -> float | None:
        if value is None:
            return None
        return value / scale

    lower, upper = joint.limits or (None, None)
    soft_lower, soft_upper = joint.soft_limits or (None, None)
    cone = None
    if joint.cone is not None:
        cone = joint.cone / DEG
    values: dict[str, tuple[float | None, str]] = {
        "largest speed": (shown(joint.max_speed), f"{unit}/s"),
        "largest acceleration": (shown(joint.max_acceleration), f"{unit}/s2"),
        "largest jerk": (shown(joint.max_jerk), f"{unit}/s3"),
        "cone": (cone, "deg"),
        "lower limit": (shown(lower), unit),
        "lower soft limit": (shown(soft_lower), unit),
        "upper limit": (shown(upper), unit),
        "upper soft limit": (shown(soft_upper), unit),
    }
    stiffness = None
    damping = None
    max_effort = None
    if joint.drive is not None:
        stiffness = joint.drive.stiffness
        damping = joint.drive.damping
        max_effort = joint.drive.max_effort
    if joint.is_angle:
        values["drive's stiffness"] = (stiffness, "N m/rad")
        values["drive's damping"] = (damping, "N m s/rad")
        values["drive's max effort"] = (max_effort, "N m")
    else:
        values["drive's stiffness"] = (stiffness, "N/m")
        values["drive's damping"] = (damping, "N s/m")
        values["drive's max effort"] = (max_effort, "N")
    return values


def _compare_motors(mechanism: Mechanism, stage: Mechanism) -> Iterator[Finding]:
    """Compare actuators and transmission matrices with the stage, which stores their numbers in double precision."""
    for cad_item, stage_item in _pairs_by_name(mechanism.actuators, stage.actuators):
        name = cad_item.name
        for key, described in vars(cad_item).items():
            on_stage = getattr(stage_item, key)
            if on_stage != described:
                text = f"{key} of actuator '{name}' is {on_stage} on the stage, but {described} in the description"
                yield _CONTENT_DIFFERS(name, text)
    for cad_item, stage_item in _pairs_by_name(mechanism.transmissions, stage.transmissions):
        same_axes = (cad_item.joints, cad_item.actuators) == (stage_item.joints, stage_item.actuators)
        if not same_axes or not np.array_equal(cad_item.matrix, stage_item.matrix):
            yield _CONTENT_DIFFERS(cad_item.name, f"the stage has a different matrix of transmission '{cad_item.name}'")


def _compare_couplings(cad_coupling: Coupling, stage_coupling: Coupling) -> Iterator[Finding]:
    """Compare a coupling with the stage, which stores its numbers in double precision, and joints in another order."""
    in_cad = dict(zip(cad_coupling.joints, cad_coupling.ratios, strict=True))
    on_stage = dict(zip(stage_coupling.joints, stage_coupling.ratios, strict=True))
    if in_cad != on_stage:
        text = f"coupling '{cad_coupling.name}' has the ratios {on_stage} on the stage, but {in_cad} in the description"
        yield _CONTENT_DIFFERS(cad_coupling.name, text)
    if cad_coupling.total != stage_coupling.total:
        text = (
            f"coupling '{cad_coupling.name}' has the sum {stage_coupling.total:g} on the stage, but "
            f"{cad_coupling.total:g} in the description"
        )
        yield _CONTENT_DIFFERS(cad_coupling.name, text)


def _compare_world(mechanism: Mechanism, stage: Mechanism) -> Iterator[Finding]:
    """Compare base, tool and gravity with the stage; its physics scene has gravity in single precision."""
    for what in ("base", "tool"):
        in_cad = getattr(mechanism, what)
        on_stage = getattr(stage, what)
        if in_cad != on_stage:
            yield _CONTENT_DIFFERS(
                on_stage, f"the {what} is '{on_stage}' on the stage, but '{in_cad}' in the description"
            )
    right = np.array(mechanism.gravity)
    stage_gravity = np.array(stage.gravity)
    if float(np.linalg.norm(stage_gravity - right)) > SINGLE_PRECISION * float(np.linalg.norm(right)):
        on_stage = _vector_text(stage_gravity)
        text = f"gravity in base is {on_stage} m/s2 on the stage, but {_vector_text(right)} m/s2 in the description"
        yield _CONTENT_DIFFERS("gravity", text)


def _vector_text(v: Array) -> str:
    """Return a vector as text, such as "(0, 0, -9.81)"."""
    listed = ", ".join(f"{component:g}" for component in v)
    return f"({listed})"


def _compare_poses(what: str, where: str, in_cad: Array, on_stage: Array) -> Iterator[Finding]:
    """Yield a finding if a pose (4, 4) differs on the stage; one of position and rotation is enough to be seen."""
    distance, angle = spatial.pose_difference(in_cad, on_stage)
    # a position in single precision has an error relative to its size
    limit = _POSITION_ROUNDING + _POSITION_ROUNDING * float(np.linalg.norm(in_cad[:3, 3]))
    text = f"{what} is displaced on the stage by {mm(distance)} and {deg(angle)}"
    if distance > limit:
        yield _CONTENT_MISPLACED(where, text, mm(distance), mm(limit))
    elif angle > SINGLE_PRECISION:
        yield _CONTENT_MISPLACED(where, text, deg(angle), deg(SINGLE_PRECISION))


def _compare_bodies(cad_body: Body, stage_body: Body, description: Description) -> Iterator[Finding]:
    """Compare meshes and inertia of a body of the CAD with those on the stage."""
    yield from _compare_meshes(cad_body, stage_body)
    if cad_body.inertia is not None:
        if stage_body.inertia is None:
            yield _CONTENT_DIFFERS(cad_body.name, f"the mass of body '{cad_body.name}' is not on the stage")
            return
        yield from _compare_inertias(
            cad_body,
            in_cad=cad_body.inertia,
            on_stage=stage_body.inertia,
            mass_limit=SINGLE_PRECISION,
            com_limit=SINGLE_PRECISION,
            moment_limit=10 * SINGLE_PRECISION,
        )
        return
    if stage_body.inertia is None:
        return
    # the stage has masses that the build computed: an independent estimate must come near to them
    estimated = estimated_inertia(cad_body, description)
    if estimated is not None:
        yield from _compare_inertias(
            cad_body,
            in_cad=estimated,
            on_stage=stage_body.inertia,
            mass_limit=COARSE_MASS,
            com_limit=COARSE_SIZE,
            moment_limit=COARSE_MOMENT,
        )


def _compare_inertias(
    body: Body, in_cad: Inertia, on_stage: Inertia, mass_limit: float, com_limit: float, moment_limit: float
) -> Iterator[Finding]:
    """Compare mass, mass centre and inertia tensor of a body.

    The limits are relative: to the mass, to the size of the body, and to the largest entry of the inertia tensor.
    """
    yield from _compare_numbers(
        f"the mass of '{body.name}'",
        body.name,
        in_cad=in_cad.mass,
        on_stage=on_stage.mass,
        unit="kg",
        relative=mass_limit,
    )
    distance = float(np.linalg.norm(in_cad.p_body_com - on_stage.p_body_com))
    limit = _POSITION_ROUNDING + com_limit * _body_size(body)
    if distance > limit:
        text = f"the mass centre of '{body.name}' is {mm(distance)} from its position in the CAD"
        yield _CONTENT_MISPLACED(body.name, text, mm(distance), mm(limit))
    difference = float(np.abs(in_cad.I_com - on_stage.I_com).max())
    largest = float(np.abs(in_cad.I_com).max())
    if difference > moment_limit * largest:
        yield _CONTENT_MISPLACED(
            body.name,
            f"the inertia tensor of '{body.name}' differs by {Quantity(difference, 'kg m2')}; its largest entry in "
            f"the CAD is {Quantity(largest, 'kg m2')}",
            Quantity(difference, "kg m2"),
            moment_limit * largest,
        )


def _body_size(body: Body) -> float:
    """Return the diagonal in m of the box around a body's meshes; 0 without meshes."""
    if not body.meshes:
        return 0.0
    vertices = np.concatenate([mesh.vertices for mesh in body.meshes])
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def _compare_meshes(cad_body: Body, stage_body: Body) -> Iterator[Finding]:
    """Compare the meshes of a body of the CAD with those on the stage, by name."""
    in_cad = {mesh.name for mesh in cad_body.meshes}
    on_stage = {mesh.name for mesh in stage_body.meshes}
    for mesh in cad_body.meshes:
        if mesh.name not in on_stage:
            yield _CONTENT_DIFFERS(mesh.name, f"mesh '{mesh.name}' is not on the stage")
    for mesh, stage_mesh in _pairs_by_name(cad_body.meshes, stage_body.meshes):
        yield from _compare_mesh(mesh, stage_mesh)
    for mesh in stage_body.meshes:
        if mesh.name not in in_cad:
            yield _CONTENT_DIFFERS(mesh.name, f"mesh '{mesh.name}' is on the stage, but not in the CAD")


def _compare_mesh(in_cad: Mesh, on_stage: Mesh) -> Iterator[Finding]:
    """Compare vertices and triangles of a mesh; the stage stores vertices in single precision."""
    name = in_cad.name
    same_vertices = in_cad.vertices.shape == on_stage.vertices.shape
    if not same_vertices or in_cad.triangles.shape != on_stage.triangles.shape:
        yield _CONTENT_DIFFERS(name, f"the stage has a different mesh '{name}'")
        return
    distance = float(np.abs(in_cad.vertices - on_stage.vertices).max(initial=0.0))
    limit = _POSITION_ROUNDING + SINGLE_PRECISION * float(np.abs(in_cad.vertices).max(initial=0.0))
    if distance > limit:
        yield _CONTENT_DIFFERS(
            name, f"vertices of mesh '{name}' are displaced by up to {distance / MM:.4g} mm on the stage"
        )
    elif not np.array_equal(in_cad.triangles, on_stage.triangles):  # other triangles between the same corners
        yield _CONTENT_DIFFERS(name, f"the stage has a different mesh '{name}'")


def estimated_inertia(body: Body, description: Description) -> Inertia | None:
    """Estimate mass, mass centre and inertia tensor of a body from its meshes and the densities of their materials.

    Return None (mass unknown) if a mesh is open or has no material.
    """

    def density(mesh: Mesh) -> float | None:
        """Return the density of the last material whose `parts` contain the name of the mesh; None if there is none."""
        # all patterns are tried: a later material replaces an earlier one, as in the build
        last = None
        for material in description.material.values():
            for pattern in material.parts:
                if fnmatch.fnmatch(mesh.name, pattern.lower()):
                    last = material.density_kg_m3
        return last

    total = solid_moments.moments_of_meshes(body.meshes, density)
    if total is None:
        return None
    com = total.first / total.volume
    about_com = total.second - total.volume * np.outer(com, com)
    return Inertia(total.volume, com, solid_moments.inertia_tensor(about_com))
