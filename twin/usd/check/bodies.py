"""Masses, inertias, nesting and meshes of rigid bodies."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from twin.core.errors import StageError
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.mechanism import Inertia
from twin.usd import gf
from twin.usd.read.bodies import below, mesh_triangles
from twin.usd.scan import Scene, quaternion_attributes

QUATERNION_TOL = 1e-4
"""Deviation from unit length that is still rounding of single precision."""

COM_MARGIN = 1 * MM
"""Distance by which a centre of mass may leave the box around the meshes (thin shells, coarse meshes)."""

GYRATION = (0.02, 1.0)
"""Plausible range of the largest radius of gyration over the diagonal of the meshes."""

LARGEST = 20.0
"""Diagonal of one link in m above which the unit is in doubt."""


def check_bodies(scene: Scene) -> Iterator[Finding]:
    """Yield findings on each rigid body."""
    weighed = any(_has_mass(prim) for prim in scene.bodies.values())
    for path, prim in scene.bodies.items():
        yield from _check_nesting(scene, path, prim)
        box = _bounds(scene, prim)
        yield from _check_size(path, box)
        yield from _check_mass(scene, path, prim, box, weighed)
    for prim in scene.prims:
        yield from _check_quaternions(prim)


def _check_nesting(scene: Scene, path: str, prim: Usd.Prim) -> Iterator[Finding]:
    above = scene.owner(prim.GetParent())
    reset = UsdGeom.Xformable(prim).GetResetXformStack() if prim.IsA(UsdGeom.Xformable) else False
    if above and not reset:
        yield Finding(
            "stage.nested",
            "disagreement",
            f"rigid body {path} lies inside rigid body {above.GetPath()}: engines let it follow, "
            "refuse it, or move it twice.",
            where=path,
            suggestion="make bodies siblings below the robot; joints, not nesting, connect them",
        )


def _bounds(scene: Scene, body: Usd.Prim) -> tuple[Array, Array] | None:
    """Return the box (3,), (3,) in m around the shown meshes in the frame of the body, or None."""
    corners = []
    for prim in below(scene, body):
        if prim.IsA(UsdGeom.Mesh):
            points = gf.array(UsdGeom.Mesh(prim).GetPointsAttr().Get() or []).reshape(-1, 3)
            if len(points):
                M = scene.relative(prim, body)
                corners.append(points.astype(float) @ M[:3, :3].T + M[:3, 3])
    if not corners:
        return None
    stacked = np.vstack(corners) * scene.meters
    return stacked.min(axis=0), stacked.max(axis=0)


def _check_size(path: str, box: tuple[Array, Array] | None) -> Iterator[Finding]:
    diagonal = 0.0 if box is None else float(np.linalg.norm(box[1] - box[0]))
    if diagonal > LARGEST:
        yield Finding(
            "stage.size",
            "warning",
            f"body {path} measures {diagonal:.4g} m across, as if millimetres stood on a stage in metres.",
            where=path,
            size=diagonal,
            unit="m",
            limit=LARGEST,
            suggestion="check metersPerUnit; references never convert it",
        )


def _is_told_base(prim: Usd.Prim) -> bool:
    told = prim.GetParent().GetAttribute("twin:base")
    return bool(told) and str(told.Get()) == prim.GetName()


def _has_mass(prim: Usd.Prim) -> bool:
    api = UsdPhysics.MassAPI(prim)
    return bool(prim.HasAPI(UsdPhysics.MassAPI) and (api.GetMassAttr().Get() or api.GetDensityAttr().Get() > 0))


def _check_mass(
    scene: Scene, path: str, prim: Usd.Prim, box: tuple[Array, Array] | None, weighed: bool
) -> Iterator[Finding]:
    api = UsdPhysics.MassAPI(prim)
    has = prim.HasAPI(UsdPhysics.MassAPI)
    mass = float(api.GetMassAttr().Get()) * scene.kilograms if has else 0.0
    density = float(api.GetDensityAttr().Get()) if has else 0.0
    if mass < 0:
        yield Finding(
            "stage.mass",
            "disagreement",
            f"body {path} has mass {mass:g} kg.",
            where=path,
            size=mass,
            unit="kg",
            limit=0.0,
            suggestion="author a positive physics:mass",
        )
        return
    if not mass and not density > 0 and _is_told_base(prim):
        yield Finding(
            "stage.mass_missing",
            "info",
            f"body {path} has no mass: it is the base, which stands still.",
            where=path,
        )
        return
    if not mass and not density > 0:
        yield Finding(
            "stage.mass_missing",
            "warning" if weighed else "info",
            f"body {path} has no mass"
            + (": simulators take 1000 kg/m3 times its colliders, or 1 kg." if weighed else ", as every other body."),
            where=path,
            suggestion="author physics:mass with PhysicsMassAPI" if weighed else "kinematics needs none, simulators do",
        )
        return
    center = gf.vector(api.GetCenterOfMassAttr().Get()) * scene.meters
    if box is not None and np.all(np.isfinite(center)):
        outside = np.maximum(np.maximum(box[0] - center, center - box[1]), 0)
        gap = float(np.linalg.norm(outside))
        if gap > COM_MARGIN:
            yield Finding(
                "stage.com",
                "disagreement",
                f"the centre of mass of {path} lies {gap / MM:.4g} mm outside the box around its meshes "
                f"(limit {COM_MARGIN / MM:g} mm).",
                where=path,
                size=gap / MM,
                unit="mm",
                limit=COM_MARGIN / MM,
                suggestion="author it in the body frame and in the unit of the stage, metres",
            )
    moments = gf.vector(api.GetDiagonalInertiaAttr().Get()) * scene.kilograms * scene.meters**2
    if np.any(moments):
        yield from _check_inertia(path, mass, moments, box)


def _check_inertia(path: str, mass: float, moments: Array, box: tuple[Array, Array] | None) -> Iterator[Finding]:
    tensor = Inertia(mass or 1.0, np.zeros(3), np.diag(moments))
    for text in tensor.violations():
        yield Finding(
            "stage.inertia",
            "disagreement",
            f"body {path}: {text}.",
            where=path,
            size=float(np.sort(moments)[2]),
            unit="kg m2",
            limit=float(np.sort(moments)[:2].sum()),
            suggestion="take the principal moments about the centre of mass from the CAD",
        )
    if mass and box is not None and np.max(moments) > 0:
        diagonal = float(np.linalg.norm(box[1] - box[0]))
        gyration = float(np.sqrt(np.max(moments) / mass))
        if diagonal > 0 and not GYRATION[0] < gyration / diagonal < GYRATION[1]:
            yield Finding(
                "stage.inertia_size",
                "disagreement",
                f"body {path}: radius of gyration {gyration / MM:.4g} mm, but its meshes measure "
                f"{diagonal / MM:.4g} mm across.",
                where=path,
                size=gyration / MM,
                unit="mm",
                limit=GYRATION[gyration > diagonal * GYRATION[0]] * diagonal / MM,
                suggestion="author kg m2 about the centre of mass (kg mm2 and g mm2 are off by 1e6 and 1e9)",
            )


def _check_quaternions(prim: Usd.Prim) -> Iterator[Finding]:
    for attribute, value in quaternion_attributes(prim):
        length = float(np.linalg.norm(gf.quat_wxyz(value)))
        not_given = length == 0 and attribute.GetName() == "physics:principalAxes"
        if not not_given and not abs(length - 1) < QUATERNION_TOL:
            yield non_unit(str(prim.GetPath()), attribute.GetName(), length)


def non_unit(path: str, name: str, length: float, when: str = "") -> Finding:
    """Return the finding for a quaternion that is not of unit length."""
    return Finding(
        "stage.quaternion",
        "disagreement",
        f"{path}: quaternion {name} has length {length:.6g}; engines normalise it, scale by it, or fail.",
        where=path,
        when=when,
        size=length,
        limit=1.0,
        suggestion="normalise it; USD text is (w, x, y, z)",
    )


def check_meshes(scene: Scene) -> Iterator[Finding]:
    """Yield findings on indices, extent, winding and subdivision of each mesh."""
    for prim in scene.prims:
        if not prim.IsA(UsdGeom.Mesh):
            continue
        mesh, path = UsdGeom.Mesh(prim), str(prim.GetPath())
        points = gf.array(mesh.GetPointsAttr().Get() or []).reshape(-1, 3).astype(float)
        try:
            triangles = mesh_triangles(mesh)
        except StageError as error:
            yield Finding(
                "stage.point_index",
                "disagreement",
                f"{error}.",
                where=path,
                suggestion="indices count from 0 to the number of points less 1",
            )
            continue
        if not len(triangles):
            continue
        if mesh.GetSubdivisionSchemeAttr().Get() != UsdGeom.Tokens.none:
            yield Finding(
                "stage.subdivision",
                "warning",
                f"mesh {path} is a subdivision cage: viewers round its edges off.",
                where=path,
                suggestion='author subdivisionScheme = "none"',
            )
        extent = gf.array(mesh.GetExtentAttr().Get() or []).reshape(-1, 3)
        real = np.array([points.min(axis=0), points.max(axis=0)])
        slack = 1e-4 * float(np.linalg.norm(real[1] - real[0]))
        if len(extent) == 2 and (off := float(np.max(np.abs(extent - real)))) > slack:
            yield Finding(
                "stage.extent",
                "disagreement",
                f"the extent of mesh {path} is off by {off * scene.meters / MM:.4g} mm: viewers cull and frame by it.",
                where=path,
                size=off * scene.meters / MM,
                unit="mm",
                limit=slack * scene.meters / MM,
                suggestion="recompute it from the points",
            )
        if _is_closed(triangles):
            a, b, c = (points[triangles[:, i]] for i in range(3))
            volume = float(np.sum(a * np.cross(b, c)) / 6) * scene.meters**3
            if volume < 0:
                yield Finding(
                    "stage.winding",
                    "disagreement",
                    f"mesh {path} is inside out (volume {volume:.3g} m3): viewers show its "
                    "back, and its mass is negative.",
                    where=path,
                    size=volume,
                    unit="m3",
                    limit=0.0,
                    suggestion="turn its faces round, or author orientation = leftHanded",
                )


def _is_closed(triangles: np.ndarray) -> bool:
    """Return whether each directed edge has its opposite exactly once: volume has a sign only then."""
    edges = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
    n = int(edges.max()) + 1
    return np.array_equal(np.sort(edges[:, 0] * n + edges[:, 1]), np.sort(edges[:, 1] * n + edges[:, 0]))
