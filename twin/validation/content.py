"""Compare all data of the mechanism read back from a USD stage with the CAD's mechanism, item by item.

If the build did not compute the mass of a body, the mass is estimated from the CAD's meshes and densities by a sum over
tetrahedra. The build uses another method. For a coarse mesh, the estimate is a few per cent too low.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Iterator
from typing import Any

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
from twin.model.mechanism import Mechanism
from twin.validation.masses import solid

SINGLE = 1e-5
"""Maximum relative difference that single precision can cause."""

COARSE_MASS, COARSE_SIZE = 0.15, 0.04
"""Tolerances for estimates from coarse meshes: of a mass, relative; of a mass centre, divided by the body's size."""

COARSE_MOMENT = 0.4
"""Tolerance of an entry of an estimated inertia tensor, relative to the largest entry. It is large, because the moment
of a cylinder about its axis varies with the fourth power of the radius."""

_AGAIN = "rebuild the stage with `twin build`"
_CONTENT = Kind("stage.content", "disagreement", _AGAIN, word="CAD and description")
_MISPLACED = Kind("stage.content", "disagreement", _AGAIN, word="")


def content(mechanism: Mechanism, stage: Mechanism, description: Description) -> list[Finding]:
    """Return findings on data of a mechanism that are missing or different on its USD stage.

    `description` contains the densities that are used for bodies without computed masses.
    """
    found: list[Finding] = []
    for kind, ours, theirs in (
        ("body", mechanism.bodies, stage.bodies),
        ("joint", mechanism.joints, stage.joints),
        ("frame", mechanism.frames, stage.frames),
        ("point", mechanism.points, stage.points),
        ("actuator", mechanism.actuators, stage.actuators),
        ("transmission", mechanism.transmissions, stage.transmissions),
    ):
        have, want = {x.name for x in theirs}, {x.name for x in ours}
        found += [_CONTENT(n, f"{kind} '{n}' is not on the stage") for n in sorted(want - have)]
        found += [_CONTENT(n, f"{kind} '{n}' is on the stage, but not in the CAD") for n in sorted(have - want)]
    lost, more = (sorted(set(a.trocars) - set(b.trocars)) for a, b in ((mechanism, stage), (stage, mechanism)))
    found += [_CONTENT(n, f"trocar '{n}' is not marked as a trocar on the stage") for n in lost]
    found += [_CONTENT(n, f"'{n}' is marked as a trocar on the stage, but not in the CAD") for n in more]
    for a, b in _common(mechanism.joints, stage.joints):
        found += _joint(a, b)
    found += _motors(mechanism, stage)
    for a, b in _common(mechanism.frames, stage.frames):
        found += _place(f"frame '{a.name}'", a.name, a.T_body_frame, b.T_body_frame)
    for a, b in _common(mechanism.points, stage.points):
        found += _place(f"point '{a.name}'", a.name, spatial.pose(p=a.p_body), spatial.pose(p=b.p_body))
    for a, b in _common(mechanism.bodies, stage.bodies):
        found += _body(a, b, description)
    return found


def _common(ours: Iterable[Any], theirs: Iterable[Any]) -> list[tuple[Any, Any]]:
    """Return pairs (item of `ours`, item of `theirs`) with the same name."""
    by_name = {x.name: x for x in theirs}
    return [(x, by_name[x.name]) for x in ours if x.name in by_name]


def _differs(what: str, where: str, ours: float, theirs: float, unit: str, rel: float = SINGLE) -> Iterator[Finding]:
    if abs(ours - theirs) > rel * max(abs(ours), abs(theirs)) + 1e-12:
        yield _CONTENT(where, f"{what} differs on the stage", Quantity(theirs, unit), float(ours))


def _joint(a: Joint, b: Joint) -> Iterator[Finding]:
    if (a.parent, a.child) == (b.child, b.parent):  # on the stage, joints of the tree point away from the base
        b = reversed_joint(b)
    for what in ("type", "parent", "child", "active"):
        ours, theirs = getattr(a, what), getattr(b, what)
        if ours != theirs:
            yield _CONTENT(a.name, f"joint '{a.name}' has {what} {theirs} on the stage, but {ours} in the CAD")
            return
    yield from _place(f"joint '{a.name}' on '{a.parent}'", a.name, a.T_parent_joint, b.T_parent_joint)
    yield from _place(f"joint '{a.name}' on '{a.child}'", a.name, a.T_child_joint, b.T_child_joint)
    unit, scale = display_unit(a.is_angle)
    pairs: list[tuple[str, float | None, float | None, str, float]] = [
        ("largest speed", a.max_speed, b.max_speed, f"{unit}/s", scale),
        ("largest acceleration", a.max_acceleration, b.max_acceleration, f"{unit}/s2", scale),
        ("largest jerk", a.max_jerk, b.max_jerk, f"{unit}/s3", scale),
        ("cone", a.cone, b.cone, "deg", DEG),
    ]
    for i, end in enumerate(("lower", "upper")):
        for name, ours, theirs in (("limit", a.limits, b.limits), ("soft limit", a.soft_limits, b.soft_limits)):
            one, two = (None if x is None else x[i] for x in (ours, theirs))
            pairs.append((f"{end} {name}", one, two, unit, scale))
    effort = ("N/m", "N s/m", "N") if not a.is_angle else ("N m/rad", "N m s/rad", "N m")
    for name, per in zip(("stiffness", "damping", "max_effort"), effort, strict=True):
        one, two = (getattr(j.drive, name) if j.drive is not None else None for j in (a, b))
        pairs.append((f"drive's {name.replace('_', ' ')}", one, two, per, 1.0))
    for name, one, two, per, factor in pairs:
        what = f"the {name} of joint '{a.name}'"
        if one is None and two is None:
            continue
        if one is None or two is None:
            text = f"{what} is missing on the stage" if two is None else f"{what} is on the stage, but not in the CAD"
            yield _CONTENT(a.name, text)
            continue
        yield from _differs(what, a.name, one / factor, two / factor, per)


def _motors(mechanism: Mechanism, stage: Mechanism) -> Iterator[Finding]:
    """Compare actuators and transmission matrices with the stage, which stores their numbers in double precision."""
    for a, b in _common(mechanism.actuators, stage.actuators):
        for key, ours in vars(a).items():
            if (theirs := getattr(b, key)) != ours:
                text = f"{key} of actuator '{a.name}' is {theirs} on the stage, but {ours} in the description"
                yield _CONTENT(a.name, text)
    for t, u in _common(mechanism.transmissions, stage.transmissions):
        if (t.joints, t.actuators) != (u.joints, u.actuators) or not np.array_equal(t.matrix, u.matrix):
            yield _CONTENT(t.name, f"the stage has a different matrix of transmission '{t.name}'")


def _place(what: str, where: str, ours: Array, theirs: Array) -> Iterator[Finding]:
    off = float(np.linalg.norm(ours[:3, 3] - theirs[:3, 3]))
    turn = float(spatial.rotation_angle(ours[:3, :3].T @ theirs[:3, :3]))
    limit = 1e-6 + 1e-6 * float(np.linalg.norm(ours[:3, 3]))
    if off > limit or turn > SINGLE:
        yield _MISPLACED(
            where,
            f"{what} is displaced on the stage by {mm(off)} and {deg(turn)}",
            *((mm(off), mm(limit)) if off > limit else (deg(turn), deg(SINGLE))),
        )


def _body(a: Body, b: Body, description: Description) -> Iterator[Finding]:
    yield from _meshes(a, b)
    weighed = a.inertia is not None
    ours = a.inertia if weighed else estimate(a, description)
    if ours is None or b.inertia is None:
        if weighed:
            yield _CONTENT(a.name, f"the mass of body '{a.name}' is not on the stage")
        return
    theirs = b.inertia
    mass, moment = (SINGLE, 10 * SINGLE) if weighed else (COARSE_MASS, COARSE_MOMENT)
    yield from _differs(f"the mass of '{a.name}'", a.name, ours.mass, theirs.mass, "kg", mass)
    size = _size(a)
    off = float(np.linalg.norm(ours.p_body_com - theirs.p_body_com))
    limit = 1e-6 + (SINGLE if weighed else COARSE_SIZE) * size
    if off > limit:
        yield _MISPLACED(
            a.name, f"the mass centre of '{a.name}' is {mm(off)} from its position in the CAD", mm(off), mm(limit)
        )
    apart = float(np.abs(ours.I_com - theirs.I_com).max())
    largest = float(np.abs(ours.I_com).max())
    if apart > moment * largest:
        yield _MISPLACED(
            a.name,
            f"the inertia tensor of '{a.name}' differs by {Quantity(apart, 'kg m2')}; its largest entry in the CAD "
            f"is {Quantity(largest, 'kg m2')}",
            Quantity(apart, "kg m2"),
            moment * largest,
        )


def _size(body: Body) -> float:
    if not body.meshes:
        return 0.0
    vertices = np.concatenate([m.vertices for m in body.meshes])
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def _meshes(a: Body, b: Body) -> Iterator[Finding]:
    ours, theirs = {m.name for m in a.meshes}, {m.name for m in b.meshes}
    for name in (m.name for m in a.meshes if m.name not in theirs):
        yield _CONTENT(name, f"mesh '{name}' is not on the stage")
    for mesh, other in _common(a.meshes, b.meshes):
        same = mesh.vertices.shape == other.vertices.shape and mesh.triangles.shape == other.triangles.shape
        off = float(np.abs(mesh.vertices - other.vertices).max(initial=0.0)) if same else np.inf
        limit = 1e-6 + SINGLE * float(np.abs(mesh.vertices).max(initial=0.0))
        if off > limit or not np.array_equal(mesh.triangles, other.triangles):
            text = f"the stage has a different mesh '{mesh.name}'"
            if same and off > limit:
                text = f"vertices of mesh '{mesh.name}' are displaced by up to {off / MM:.4g} mm on the stage"
            yield _CONTENT(mesh.name, text)
    for name in (m.name for m in b.meshes if m.name not in ours):
        yield _CONTENT(name, f"mesh '{name}' is on the stage, but not in the CAD")


def estimate(body: Body, description: Description) -> Inertia | None:
    """Estimate mass, mass centre and inertia tensor of a body from its meshes and the densities of their materials.

    Return None (mass unknown) if a mesh is open or has no material.
    """

    def density(mesh: Mesh) -> float | None:
        """Return the density of the last material whose `parts` contain the name of the mesh; None if there is none."""
        found = None
        for material in description.material.values():
            if any(fnmatch.fnmatch(mesh.name, pattern.lower()) for pattern in material.parts):
                found = material.density_kg_m3
        return found

    total = solid.of_meshes(body.meshes, density)
    if total is None:
        return None
    com = total.first / total.volume
    about = total.second - total.volume * np.outer(com, com)
    return Inertia(total.volume, com, solid.tensor(about))
