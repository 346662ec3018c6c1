"""Check whether mass, first moments and inertia of a body are physically possible and fit its shapes.

The pseudo-inertia [[Sigma, h], [h^T, m]], with the second moments Sigma, first moment h and mass m, must be positive
definite; this includes the triangle inequality and the minimum mass. If the shapes are known, the mass centre must be
inside their convex hull, and the density must be plausible for a real material. `probable_mistake` searches for the
mistake in a tensor that does not fit the shapes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from twin.core.findings import Finding, Severity, finding
from twin.core.json_types import JsonObject
from twin.core.quantity import Quantity, mm
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.body import Mesh
from twin.model.inertia import Inertia
from twin.validation.masses import solid_moments
from twin.validation.masses.probable_mistake import probable_mistakes

PLAUSIBLE_DENSITIES = (30.0, 25000.0)
"""Plausible density in kg/m3 (mass / volume of closed shapes), from foam and hollow castings to tungsten."""

HULL_TOLERANCE = 2 * MM
"""Accepted distance in m of a mass centre from the convex hull of the shapes; shapes may be coarse or incomplete."""

_ALUMINIUM_DENSITY = 2700.0
"""Density in kg/m3 from which the number of lost decimal places is estimated: most links are of aluminium."""

_ROUNDING = 1e-9
"""Relative difference that the rounding of stated numbers causes."""

_LEAST_DIVISOR = 1e-300
"""Minimum divisor where the second moment of a body may be zero."""

_ABOVE_MINIMUM = 1 + 1e-6
"""Factor of the minimum mass with which moments without a mass are judged: at the minimum itself, they are singular."""

_SUM_OF_WEIGHTS = 1e3
"""Weight of the condition that the weights of hull corners have the sum one: it must hold exactly."""

LEAST_EIGENVALUE_RATIO = 1e-9
"""Minimum ratio of the smallest to the largest eigenvalue of the pseudo-inertia; a flat sheet has a smaller ratio."""


@dataclass(frozen=True)
class StatedInertia:
    """Stated mass data of one body, in one frame of the body.

    Attributes:
        name, source: name of the body, and source of its mass data.
        mass: mass in kg; None if not stated.
        first: (3,) in kg m, first moment of mass.
        tensor: (3, 3) in kg m2, inertia about the origin of the frame.
        meshes: shapes of the body in the same frame; may be empty.
        own_shapes: whether shapes and masses have the same source. If true, a contradiction between them is a
            disagreement, otherwise a warning.
    """

    name: str
    source: str
    mass: float | None
    first: Array
    tensor: Array
    meshes: tuple[Mesh, ...] = ()
    own_shapes: bool = True


@dataclass(frozen=True)
class JudgedInertia:
    """Quantities and findings derived from the stated mass data of a body.

    Attributes:
        name, source, mass: as stated.
        least: minimum mass in kg for the stated moments; infinite if the moments are impossible.
        slack: sum of the two smaller principal moments minus the largest, in kg m2, about the mass centre (about the
            origin if no mass is stated).
        definite: ratio of the smallest to the largest eigenvalue of the pseudo-inertia, with lengths in radii of
            gyration.
        density: density in kg/m3; NaN without closed shapes or without mass.
        outside: distance in m of the mass centre from the hull of the shapes, 0 if inside; NaN without shapes or mass.
        findings: the faults.
    """

    name: str
    source: str
    mass: float | None
    least: float
    slack: float
    definite: float
    density: float
    outside: float
    findings: tuple[Finding, ...]

    def as_dict(self) -> JsonObject:
        """Return the derived quantities and findings as plain data."""
        return {**vars(self), "findings": [finding.as_dict() for finding in self.findings]}


def stated_inertia(
    name: str, source: str, inertia: Inertia, meshes: tuple[Mesh, ...] = (), own_shapes: bool = True
) -> StatedInertia:
    """Return `StatedInertia` data about the origin of the body frame, from an inertia about the mass centre."""
    p = np.asarray(inertia.p_body_com, float)
    # parallel axes: the tensor of the whole mass at the mass centre is added
    shift = inertia.mass * ((p @ p) * np.eye(3) - np.outer(p, p))
    tensor = np.asarray(inertia.I_com, float) + shift
    return StatedInertia(
        name,
        source,
        mass=float(inertia.mass),
        first=inertia.mass * p,
        tensor=tensor,
        meshes=meshes,
        own_shapes=own_shapes,
    )


def second_moments(tensor: Array) -> Array:
    """Return the second moments (3, 3) of mass for an inertia tensor (3, 3) about the same point."""
    return 0.5 * np.trace(tensor) * np.eye(3) - tensor


def _pseudo_inertia(tensor: Array, first: Array, mass: float) -> Array:
    """Return the pseudo-inertia (4, 4), dimensionless: lengths in radii of gyration, masses relative to `mass`."""
    P = Inertia(mass, first / mass, _about_centre(tensor, first, mass)).pseudo()
    second_moment = abs(float(np.trace(P[:3, :3])))
    length = np.sqrt(max(second_moment, _LEAST_DIVISOR) / mass)
    scale = np.array([1 / length, 1 / length, 1 / length, 1.0])
    return P * np.outer(scale, scale) / mass


def least_mass(tensor: Array, first: Array) -> float:
    """Return the minimum mass in kg for a tensor (3, 3) and first moment (3,); infinite if no mass is possible."""
    S = second_moments(tensor)
    if not np.all(np.isfinite(S)) or np.linalg.eigvalsh(S)[0] <= 0:
        return float("inf")
    return float(first @ np.linalg.solve(S, first))


def judged_inertia(body: StatedInertia) -> JudgedInertia:
    """Check a body's stated mass data; return derived quantities and findings."""
    faults = _Faults(body)
    mass = body.mass
    first = np.asarray(body.first, float)
    tensor = 0.5 * (body.tensor + body.tensor.T)  # eigenvalues below are those of symmetric matrices
    if not _is_finite(body):
        faults.add("number", "a mass or moment is not a finite number")
        return _without_quantities(body, faults)
    skew = float(np.abs(body.tensor - body.tensor.T).max())
    if skew > _ROUNDING * float(np.abs(tensor).max()):
        faults.add("symmetry", "the tensor is not symmetric", Quantity(skew, "kg m2"), 0.0)
    if mass is not None and mass <= 0:
        faults.add("mass", "the mass is not positive", Quantity(mass, "kg"), 0.0)
        return _without_quantities(body, faults)
    least = least_mass(tensor, first)
    if mass is not None:
        about_centre = _about_centre(tensor, first, mass)
        pseudo = _pseudo_inertia(tensor, first, mass)
    else:
        about_centre = tensor
        # without a first moment, the minimum is zero, and the ratio is the same for any mass
        minimum = 1.0
        if 0 < least < np.inf:
            minimum = least
        pseudo = _pseudo_inertia(tensor, first, minimum * _ABOVE_MINIMUM)
    moments: Array = np.asarray(np.linalg.eigvalsh(about_centre), float)  # in increasing order
    slack = float(moments[0] + moments[1] - moments[2])
    eigenvalues = np.linalg.eigvalsh(pseudo)
    definite = float(eigenvalues[0] / eigenvalues[-1])
    _check_moments(moments, slack, least, definite, faults)
    density, outside = _compared_with_shapes(body, first, faults)
    if mass is not None and body.meshes:
        shape = _shape_tensor(body)
        faults.findings += probable_mistakes(
            body.name, body.source, tensor=about_centre, centre=first / mass, mass=mass, shape=shape
        )
    return JudgedInertia(
        body.name,
        body.source,
        mass=mass,
        least=least,
        slack=slack,
        definite=definite,
        density=density,
        outside=outside,
        findings=tuple(faults.findings),
    )


@dataclass
class _Faults:
    """The findings on one body."""

    body: StatedInertia
    findings: list[Finding] = field(default_factory=list)

    def add(
        self,
        code: str,
        what: str,
        size: Quantity | None = None,
        limit: Quantity | float | None = None,
        suggestion: str = "",
        *,
        severity: Severity = "disagreement",
        word: str = "limit",
    ) -> None:
        """Add a finding on the body; for the arguments see `twin.core.findings.finding`."""
        name = self.body.name
        fault = finding(
            severity,
            f"inertia.{code}",
            name,
            f"{name}: {what}",
            size=size,
            limit=limit,
            suggestion=suggestion,
            when=self.body.source,
            word=word,
        )
        self.findings.append(fault)


def _is_finite(body: StatedInertia) -> bool:
    """Return whether mass, if stated, and all moments are finite numbers."""
    if body.mass is not None and not np.isfinite(body.mass):
        return False
    return bool(np.isfinite(body.first).all() and np.isfinite(body.tensor).all())


def _without_quantities(body: StatedInertia, faults: _Faults) -> JudgedInertia:
    """Return the result for a body from whose data no quantity can be derived."""
    nan = float("nan")
    return JudgedInertia(
        body.name,
        body.source,
        mass=body.mass,
        least=nan,
        slack=nan,
        definite=nan,
        density=nan,
        outside=nan,
        findings=tuple(faults.findings),
    )


def _check_moments(moments: Array, slack: float, least: float, definite: float, faults: _Faults) -> None:
    """Add at most one finding on principal moments (3,) in increasing order; for the others see `JudgedInertia`."""
    mass = faults.body.mass
    place = "about the mass centre "
    if mass is None:
        place = ""
    if moments[0] <= 0:
        text = f"the tensor {place}is not positive definite: smallest principal moment"
        faults.add("impossible", text, Quantity(moments[0], "kg m2"), 0.0)
    elif slack <= 0:
        text = f"principal moments {_listed(moments)} kg m2 violate the triangle inequality: largest"
        faults.add("impossible", text, Quantity(moments[2], "kg m2"), moments[:2].sum())
    elif mass is not None and (mass < least * (1 - _ROUNDING) or definite < LEAST_EIGENVALUE_RATIO):
        text = "the mass is too small for these moments (the pseudo-inertia is not positive definite)"
        faults.add("impossible", text, Quantity(mass, "kg"), least, word="minimum")


def _listed(values: Array) -> str:
    """Return three numbers as text."""
    return ", ".join(f"{value:.4g}" for value in values)


def _about_centre(tensor: Array, first: Array, mass: float) -> Array:
    """Return the inertia tensor (3, 3) about the mass centre, from that about the origin."""
    p = first / mass
    # parallel axes: the tensor of the whole mass at the mass centre is subtracted
    return tensor - mass * ((p @ p) * np.eye(3) - np.outer(p, p))


def _shape_tensor(body: StatedInertia) -> Array | None:
    """Return the tensor per mass (3, 3) in m2 of the filled shapes about their centre; None if a mesh is open."""
    moments = solid_moments.moments_of_meshes(body.meshes)
    if moments is None:
        return None
    about_centre = moments.second - np.outer(moments.first, moments.first) / moments.volume
    return np.asarray(solid_moments.inertia_tensor(about_centre) / moments.volume, float)


def _compared_with_shapes(body: StatedInertia, first: Array, faults: _Faults) -> tuple[float, float]:
    """Return (density, distance of the mass centre from the shapes), see `JudgedInertia`; add findings on them."""
    mass = body.mass
    if mass is None or not body.meshes:
        return float("nan"), float("nan")
    severity = "disagreement" if body.own_shapes else "warning"
    outside = hull_distance(first / mass, body.meshes)
    if outside > HULL_TOLERANCE:
        text = "the mass centre lies outside the convex hull of the shapes"
        advice = "check its frame, its signs and its unit"
        faults.add("outside", text, mm(outside), mm(HULL_TOLERANCE), advice, severity=severity)
    moments = solid_moments.moments_of_meshes(body.meshes)
    if moments is None:
        return float("nan"), outside
    density = mass / moments.volume
    lightest, heaviest = PLAUSIBLE_DENSITIES
    if not lightest <= density <= heaviest:
        guess = ""
        advice = ""
        power = int(np.round(np.log10(density / _ALUMINIUM_DENSITY)))
        if power:
            guess = f" (decimal mark probably shifted by {abs(power)} places)"
            advice = f"{mass / 10.0**power:g} kg would be {density / 10.0**power:.4g} kg/m3"
        limit = lightest if density < lightest else heaviest
        text = f"{mass:g} kg in {1e6 * moments.volume:.4g} cm3 of shapes{guess}: density"
        faults.add("density", text, Quantity(density, "kg/m3"), limit, advice, severity=severity)
    return density, outside


def hull_distance(p: Array, meshes: Sequence[Mesh]) -> float:
    """Return the distance in m from a point (3,) to the convex hull of meshes; 0 inside."""
    from scipy.optimize import nnls
    from scipy.spatial import ConvexHull, QhullError

    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    scale = float(np.ptp(vertices, axis=0).max())
    if not scale:
        return float(np.linalg.norm(vertices[0] - p))
    corners = vertices
    try:
        hull = ConvexHull(vertices)
    except QhullError:
        pass  # all vertices are in one plane: their hull has no inside, and each vertex may be a corner
    else:
        if (hull.equations[:, :3] @ p + hull.equations[:, 3]).max() <= 0:
            return 0.0
        corners = vertices[hull.vertices]
    # nearest point of the hull: non-negative weights of the corners with sum one
    A = np.vstack([(corners - p).T / scale, np.full(len(corners), _SUM_OF_WEIGHTS)])
    weights, _ = nnls(A, np.array([0.0, 0.0, 0.0, _SUM_OF_WEIGHTS]), maxiter=50 * len(corners))
    return float(np.linalg.norm(weights @ corners / weights.sum() - p))
