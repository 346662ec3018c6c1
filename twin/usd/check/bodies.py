"""Check masses, inertias, nesting and meshes of rigid bodies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdPhysics

from twin.core.errors import StageError
from twin.core.findings import Finding, Kind, info, warning
from twin.core.quantity import Quantity, mm
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.inertia import Inertia
from twin.usd import gf
from twin.usd.read.bodies import below, mesh_points, mesh_triangles, shows_all
from twin.usd.scan import RawStage, quaternion_attributes

QUATERNION_TOL = 1e-4
"""Maximum difference of a quaternion's length from 1 that is taken as a rounding error of single precision."""

COM_MARGIN = 1 * MM
"""Maximum distance in m of a centre of mass from the bounding box of the meshes; meshes may be thin or coarse."""

GYRATION_RANGE = (0.02, 1.0)
"""Plausible range of the maximum radius of gyration, divided by the diagonal of the meshes' bounding box."""

EXTENT_TOL = 1e-4
"""Maximum difference of an extent from the points, divided by the diagonal of their bounding box."""

SHEET_VOLUME = 1e-7
"""Volume per surface area and diagonal of the bounding box below which a closed mesh is a sheet with two sides."""

MAX_LINK_DIAGONAL = 20.0
"""Diagonal in m of a link's bounding box above which the unit of length is probably wrong."""


_QUATERNION = Kind(
    "stage.quaternion",
    "disagreement",
    "normalise the quaternion (engines may scale the prim or fail); the order in USD text is (w, x, y, z)",
    word="expected",
)
_NESTED = Kind(
    "stage.nested", "disagreement", "make bodies siblings below the robot; connect them by joints, not by nesting"
)
_SIZE = Kind("stage.size", "warning", "check metersPerUnit; references do not convert units")
_INERTIA = Kind(
    "stage.inertia", "disagreement", "take the principal moments about the centre of mass from the CAD", word=""
)
_COM = Kind("stage.com", "disagreement", "author the centre of mass in the body frame and in the unit of the stage")
_INERTIA_SIZE = Kind(
    "stage.inertia_size",
    "disagreement",
    "author the inertia in kg m2 about the centre of mass; 1 kg m2 is 1e6 kg mm2 or 1e9 g mm2",
)
_ADVICE_FOR_PARTS = "none is needed if the shapes that this file omits, or that are for display only, explain it"
_COM_NOTE = replace(_COM, severity="info", suggestion=_ADVICE_FOR_PARTS)
_INERTIA_SIZE_NOTE = replace(_INERTIA_SIZE, severity="info", suggestion=_ADVICE_FOR_PARTS)
_SUBDIVISION = Kind("stage.subdivision", "warning", 'author subdivisionScheme = "none"')
_EXTENT = Kind("stage.extent", "disagreement", "recompute the extent from the points")
_POINT_INDEX = Kind("stage.point_index", "disagreement", "number the points from 0 to their count minus 1")
_NOT_FINITE = Kind("stage.not_finite", "disagreement", "author finite numbers")
_WINDING = Kind("stage.winding", "disagreement", "reverse the faces of the mesh, or author orientation = leftHanded")


_MASS = Kind("stage.mass", "disagreement", "author a positive physics:mass")


def check_bodies(scene: RawStage) -> Iterator[Finding]:
    """Yield findings on nesting, size, mass and inertia of each rigid body, and on the quaternions of all prims."""
    weighed = any(_has_mass(prim) for prim in scene.bodies.values())
    for path, prim in scene.bodies.items():
        yield from _check_nesting(scene, path, prim)
        box = _bounds(scene, prim)
        yield from _check_size(scene, path, box)
        yield from _check_mass(scene, path, prim, box, weighed)
    for prim in scene.prims:
        yield from _check_quaternions(prim)


def _check_nesting(scene: RawStage, path: str, prim: Usd.Prim) -> Iterator[Finding]:
    outer = scene.owner(prim.GetParent())
    if not outer:
        return
    if prim.IsA(UsdGeom.Xformable) and UsdGeom.Xformable(prim).GetResetXformStack():
        return  # the body does not move with the outer body
    yield _NESTED(
        path, f"rigid body {path} is nested in rigid body {outer.GetPath()}: engines interpret nesting differently"
    )


def _bounds(scene: RawStage, body: Usd.Prim) -> tuple[Array, Array] | None:
    """Return (low (3,), high (3,)) in m of the meshes' bounding box in the body's frame, at its scaled size.

    None without meshes, or if a point is not finite.
    """
    corners: list[Array] = []
    for prim in below(scene, body):
        if not prim.IsA(UsdGeom.Mesh):
            continue
        points = mesh_points(UsdGeom.Mesh(prim))
        if not np.isfinite(points).all():  # `check_meshes` names the point
            return None
        if len(points):
            M = scene.relative(prim, body)
            corners.append(points @ M[:3, :3].T + M[:3, 3])
    if not corners:
        return None
    stacked = np.vstack(corners) * scene.meters * scene.scale(body)
    return stacked.min(axis=0), stacked.max(axis=0)


def _check_size(scene: RawStage, path: str, box: tuple[Array, Array] | None) -> Iterator[Finding]:
    if box is None:
        return
    diagonal = float(np.linalg.norm(box[1] - box[0]))
    if diagonal > MAX_LINK_DIAGONAL:
        reason = f"is too large for the stage's unit of {scene.meters:g} m"
        if scene.meters == 1:
            reason = "seems to be in millimetres, but the stage is in metres"
        text = f"body {path} {reason}; diagonal of the body's meshes"
        yield _SIZE(path, text, Quantity(diagonal, "m"), MAX_LINK_DIAGONAL)


def _has_mass(prim: Usd.Prim) -> bool:
    if not prim.HasAPI(UsdPhysics.MassAPI):
        return False
    mass = UsdPhysics.MassAPI(prim)
    return bool(mass.GetMassAttr().Get() or (mass.GetDensityAttr().Get() or 0.0) > 0)


def _check_mass(
    scene: RawStage, path: str, prim: Usd.Prim, box: tuple[Array, Array] | None, weighed: bool
) -> Iterator[Finding]:
    api = UsdPhysics.MassAPI(prim)
    mass = 0.0
    density = 0.0
    if prim.HasAPI(UsdPhysics.MassAPI):
        # A blocked attribute has no value, as if it were not authored.
        mass = float(api.GetMassAttr().Get() or 0.0) * scene.kilograms
        density = float(api.GetDensityAttr().Get() or 0.0)
    if mass < 0:
        yield _MASS(path, f"body {path} has a negative mass", Quantity(mass, "kg"), 0.0)
        return
    if not mass and not density > 0:
        yield _missing_mass(scene, path, weighed)
        return
    # Meshes that do not show the whole body cannot show that its mass is wrong.
    is_whole_body = shows_all(scene, prim)
    stated_center = _three_numbers(api.GetCenterOfMassAttr().Get(), -np.inf)
    if not np.all(np.isfinite(stated_center)) and not np.all(np.isneginf(stated_center)):  # -inf: not given
        text = f"a number of the centre of mass of body {path} is not finite"
        yield _NOT_FINITE(path, text)
    center = stated_center * scene.meters * scene.scale(prim)
    if box is not None and np.all(np.isfinite(center)):
        low, high = box
        outside = np.maximum(np.maximum(low - center, center - high), 0)
        gap = float(np.linalg.norm(outside))
        if gap > COM_MARGIN:
            kind = _COM if is_whole_body else _COM_NOTE
            text = f"the centre of mass of body {path} is outside the bounding box of the body's meshes"
            yield kind(path, text, mm(gap), mm(COM_MARGIN))
    moments = _three_numbers(api.GetDiagonalInertiaAttr().Get(), 0.0) * scene.kilograms * scene.meters**2
    if not np.all(np.isfinite(moments)):
        yield _NOT_FINITE(path, f"a number of the inertia of body {path} is not finite")
    elif np.any(moments):
        yield from _check_inertia(path, mass, moments, box, is_whole_body)


def _three_numbers(stated: Gf.Vec3f | None, fallback: float) -> Array:
    """Return three numbers, or a fallback of the schema three times if an attribute is blocked."""
    if stated is None:
        return np.full(3, fallback)
    return np.array(stated, float)


def _missing_mass(scene: RawStage, path: str, weighed: bool) -> Finding:
    """Return the finding on a body without a mass; `weighed`: another body of the stage has a mass."""
    code = "stage.mass_missing"
    if scene.is_stated_base(path):
        return info(code, path, f"body {path} has no mass: it is the fixed base")
    suggestion = "author physics:mass with PhysicsMassAPI"
    if weighed:
        text = (
            f"body {path} has no mass: simulators assume a density of 1000 kg/m³ for the body's colliders, or a mass "
            "of 1 kg"
        )
        return warning(code, path, text, suggestion=suggestion)
    text = f"body {path} has no mass; no body of the stage has a mass"
    return info(code, path, text, suggestion=f"{suggestion}, if a simulator needs the mass")


def _check_inertia(
    path: str, mass: float, moments: Array, box: tuple[Array, Array] | None, is_whole_body: bool
) -> Iterator[Finding]:
    tensor = Inertia(mass or 1.0, np.zeros(3), np.diag(moments))
    ordered = np.sort(moments)
    largest = ordered[2]
    sum_of_others = ordered[:2].sum()
    for text in tensor.violations():
        yield _INERTIA(path, f"body {path}: {text}", Quantity(largest, "kg m2"), Quantity(sum_of_others, "kg m2"))
    if not mass or box is None or not np.max(moments) > 0:
        return
    diagonal = float(np.linalg.norm(box[1] - box[0]))
    if not diagonal > 0:
        return
    gyration = float(np.sqrt(np.max(moments) / mass))
    smallest, greatest = GYRATION_RANGE
    if smallest < gyration / diagonal < greatest:
        return
    limit = smallest * diagonal
    if gyration > limit:
        limit = greatest * diagonal
    kind = _INERTIA_SIZE if is_whole_body else _INERTIA_SIZE_NOTE
    message = (
        f"the radius of gyration of body {path} is not plausible: the diagonal of the body's meshes is "
        f"{mm(diagonal)}, the radius of gyration"
    )
    yield kind(path, message, mm(gyration), mm(limit))


def _check_quaternions(prim: Usd.Prim) -> Iterator[Finding]:
    for attribute, value in quaternion_attributes(prim):
        length = float(np.linalg.norm(gf.quat_wxyz(value)))
        not_given = length == 0 and attribute.GetName() == "physics:principalAxes"
        if not not_given and not abs(length - 1) < QUATERNION_TOL:
            yield non_unit(str(prim.GetPath()), attribute.GetName(), length)


def non_unit(path: str, name: str, length: float, when: str = "") -> Finding:
    """Return the finding for a quaternion whose length is not 1."""
    return _QUATERNION(path, f"{path}: the length of quaternion {name} is not 1", Quantity(length), 1.0, when=when)


def check_meshes(scene: RawStage) -> Iterator[Finding]:
    """Yield findings on indices, extent, winding and subdivision of each mesh."""
    for prim in scene.prims:
        if not prim.IsA(UsdGeom.Mesh):
            continue
        mesh = UsdGeom.Mesh(prim)
        path = str(prim.GetPath())
        try:
            triangles = mesh_triangles(mesh)
        except StageError as failed:
            yield _POINT_INDEX(path, str(failed).rstrip("."))
            continue
        if not len(triangles):
            continue
        if mesh.GetSubdivisionSchemeAttr().Get() != UsdGeom.Tokens.none:
            yield _SUBDIVISION(path, f"mesh {path} is a subdivision surface: viewers round its edges")
        points = mesh_points(mesh)
        is_finite = np.isfinite(points).all(axis=1)
        if not is_finite.all():
            number = int(np.argmin(is_finite))
            yield _NOT_FINITE(path, f"mesh {path}: point {number} has a coordinate that is not finite")
            continue
        yield from _check_extent(scene, path, mesh, points)
        if _is_closed(triangles):
            yield from _check_winding(scene, path, points, triangles)


def _check_extent(scene: RawStage, path: str, mesh: UsdGeom.Mesh, points: Array) -> Iterator[Finding]:
    extent = np.array(mesh.GetExtentAttr().Get() or []).reshape(-1, 3)
    if len(extent) != 2:
        return
    box = np.array([points.min(axis=0), points.max(axis=0)])
    diagonal = float(np.linalg.norm(box[1] - box[0]))
    slack = EXTENT_TOL * diagonal
    difference = float(np.max(np.abs(extent - box)))
    if difference > slack:
        text = f"the extent of mesh {path}, which viewers use for culling, differs from the points"
        yield _EXTENT(path, text, mm(difference * scene.meters), mm(slack * scene.meters))


def _check_winding(scene: RawStage, path: str, points: Array, triangles: np.ndarray) -> Iterator[Finding]:
    low = points.min(axis=0)
    high = points.max(axis=0)
    centered = points - np.array([low, high]).mean(axis=0)  # far from the origin, the sum of volumes loses digits
    a = centered[triangles[:, 0]]
    b = centered[triangles[:, 1]]
    c = centered[triangles[:, 2]]
    # sum of the signed volumes of tetrahedra from the middle to each triangle
    volume = float(np.sum(a * np.cross(b, c)) / 6) * scene.meters**3
    normals = np.cross(b - a, c - a)
    area = float(np.linalg.norm(normals, axis=1).sum() / 2) * scene.meters**2
    diagonal = float(np.linalg.norm(high - low)) * scene.meters
    if volume < -SHEET_VOLUME * area * diagonal:
        yield _WINDING(path, f"mesh {path} is inside out: its volume is negative", Quantity(volume, "m3"), 0.0)


def _is_closed(triangles: np.ndarray) -> bool:
    """Return whether each directed edge occurs as often as its opposite, so that the sign of the volume is defined."""
    a, b, c = triangles.astype(np.int64).T
    start = np.concatenate([a, b, c])
    end = np.concatenate([b, c, a])
    n = int(triangles.max()) + 1
    # an edge as one number, so that edges can be sorted
    return np.array_equal(np.sort(start * n + end), np.sort(end * n + start))
