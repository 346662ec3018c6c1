"""Bound the difference of forward equations and mechanism over all joint values of a serial chain."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from twin.api.robot import Robot
from twin.core.errors import TwinError
from twin.core.findings import Finding
from twin.core.json_types import JsonObject
from twin.core.result import Part, Result
from twin.core.units import DEG, MM, UM

if TYPE_CHECKING:
    from twin.proof.trigonometric import TrigonometricSum

_ROWS = slice(0, 3)
"""Rows and columns of the rotation in a pose."""

_ROUNDING_FACTOR = 1 + 1e-15
"""Factor by which the bound of the angle grows: `sqrt` and `asin` round to the nearest number, which may be below."""


@dataclass(frozen=True)
class ChainBounds(Result):
    """By how much forward equations and mechanism, or two mechanisms, can differ at any joint values.

    Attributes:
        robot: name of the robot.
        sides: what is compared: "equations" and "mechanism", or the names of two robots.
        variants: the chosen variant of each equation.
        position: upper bound of the distance of the tool's origins in m.
        rotation: upper bound of the angle between the tool's orientations in rad.
        terms: number of products of sines and cosines in the poses of both sides.
        tolerance: by how much each length of the equations may differ from its value, in m.
        files: {file of equations or mechanism: SHA-256 of its bytes}; empty if two mechanisms are compared.
        operations: the variables, and both sides as operations, for a certificate; not printed, because they are long.
    """

    robot: str
    sides: tuple[str, str]
    variants: Mapping[str, str]
    position: float
    rotation: float
    terms: tuple[int, int]
    tolerance: float
    files: Mapping[str, str]
    operations: tuple[Sequence[JsonObject], tuple[JsonObject, JsonObject]] = field(repr=False)

    kind = "prove-bounds"
    judges = False

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Always empty: a bound is no verdict."""
        return ()

    def content(self) -> JsonObject:
        """Return the bounds as plain data."""
        return {
            "robot": self.robot,
            "sides": list(self.sides),
            "variants": dict(self.variants),
            "position_bound_mm": self.position / MM,
            "rotation_bound_deg": self.rotation / DEG,
            "terms": list(self.terms),
            "tolerance_um": self.tolerance / UM,
        }

    def certificate(self) -> JsonObject:
        """Return the certificate of the bounds, which docs/check_bounds.py checks without twin."""
        from twin.proof.bounds_certificate import SCHEMA
        from twin.proof.certificate import digest

        variables, sides = self.operations
        data: JsonObject = {
            "schema": SCHEMA,
            "robot": self.robot,
            "variants": dict(self.variants),
            "files": dict(self.files),
            "tolerance_m": self.tolerance,
            "variables": list(variables),
            "sides": list(sides),
            "position_m": self.position,
            "rotation_rad": self.rotation,
        }
        return {**data, "sha256": digest(data)}

    def write(self, folder: Path) -> None:
        """Write the certificate."""
        text = json.dumps(self.certificate(), ensure_ascii=True, allow_nan=False)
        (folder / "certificate.json").write_text(text, encoding="ascii")

    def text(self) -> Iterator[Part]:
        """Yield the bounds."""
        yield f"{self.robot}: {self.sides[0]} and {self.sides[1]}, at all joint values"
        yield ""
        lengths = ""
        if self.tolerance:
            lengths = f", if each length of the equations is within {self.tolerance / UM:g} um of its value"
        yield f"  tool position     at most {self.position / MM:.3g} mm apart{lengths}"
        yield f"  tool orientation  at most {self.rotation / DEG:.3g} deg apart"
        yield f"  terms             {self.terms[0]} of {self.sides[0]}, {self.terms[1]} of {self.sides[1]}"
        yield ""


def chain_bounds(robot: Robot, variants: Mapping[str, str] | str | None = None, tolerance: float = 0.0) -> ChainBounds:
    """Return bounds of the difference of forward equations and mechanism over all joint values.

    The equations are repeated on sums of sines and cosines; the mechanism multiplies the motions of its joints from the
    base to the tool. What remains of the difference is bounded by the sum of the magnitudes of its coefficients.

    Args:
        robot: a robot with forward equations and CAD.
        variants: {equation: variant}, or one variant for all equations that have it.
        tolerance: by how much each length of the equations may differ from its value, in m.

    Raises:
        TwinError: the equations have no forward model, a branch, a table or a root; a sliding joint has no limits; the
            tolerance is not a number of at least 0.
    """
    from twin.formula import variant_choice
    from twin.proof import bounds_certificate, chain, formula_chain

    if not (math.isfinite(tolerance) and tolerance >= 0):
        raise TwinError(f"the tolerance of lengths is {tolerance / UM:g} um; give a number of micrometres, 0 or more")
    if robot.files is None or not robot.files.has_equations:
        raise TwinError(f"{robot.name} has no equations to compare with its mechanism")
    formula = robot.formula
    chosen = variant_choice.choose(formula, variants)
    sliding = {}
    for joint in formula.joints:
        # sines and cosines are bounded for every angle; a length is bounded only by the limits of its joint
        if joint.kind == "prismatic":
            sliding[joint.name] = chain.sliding_range(robot.mechanism, joint.name)
    tolerances = {}
    for parameter in formula.parameters:
        if tolerance and parameter.unit in ("m", "mm"):
            tolerances[parameter.name] = tolerance
    equations, joints = formula_chain.tool_pose(formula, chosen, sliding, tolerances)
    mechanism = chain.tool_pose(robot.mechanism, joints)
    turning = set()
    names = []
    for place, joint in enumerate(formula.joints):
        names.append(joint.name)
        if joint.kind == "revolute":
            turning.add(place)
    position, rotation = _bounds(robot.name, (equations, mechanism), turning)
    # the certificate is checked from operations: the sums of this computation are no evidence for a reader
    operations = (
        bounds_certificate.variables(formula, robot.mechanism, names, tolerances),
        (
            bounds_certificate.equations_side(formula, chosen, robot.mechanism, tolerances),
            bounds_certificate.mechanism_side(robot.mechanism),
        ),
    )
    return ChainBounds(
        robot.name,
        ("equations", "mechanism"),
        chosen,
        position,
        rotation,
        (equations.keys.size, mechanism.keys.size),
        tolerance,
        robot.hashes(),
        operations,
    )


def mechanism_bounds(first: Robot, second: Robot) -> ChainBounds:
    """Return bounds of the difference of two mechanisms over all values of their joints, which have the same names.

    A joint that slides has the values within the limits of the first mechanism.

    Raises:
        TwinError: the mechanisms differ in the driven joints between base and tool, or a passive one is between them.
    """
    from twin.proof import bounds_certificate, chain, trigonometric
    from twin.proof.trigonometric import AngleSum, Operand

    joints: dict[str, Operand] = {}
    turning = set()
    for place, joint in enumerate(first.mechanism.active):
        if joint.type == "revolute":
            joints[joint.name] = AngleSum({place: 1}, 0.0, 0.0)
            turning.add(place)
        else:
            joints[joint.name] = trigonometric.variable(place, *chain.sliding_range(first.mechanism, joint.name))
    poses = chain.tool_pose(first.mechanism, joints), chain.tool_pose(second.mechanism, joints)
    position, rotation = _bounds(first.name, poses, turning)
    operations = (
        bounds_certificate.variables(None, first.mechanism, list(joints), {}),
        (bounds_certificate.mechanism_side(first.mechanism), bounds_certificate.mechanism_side(second.mechanism)),
    )
    return ChainBounds(
        first.name,
        (first.name, f"{second.name} of --against"),
        {},
        position,
        rotation,
        (poses[0].keys.size, poses[1].keys.size),
        0.0,
        {},
        operations,
    )


def _bounds(robot: str, poses: tuple[TrigonometricSum, TrigonometricSum], turning: set[int]) -> tuple[float, float]:
    """Return bounds in m and rad of the difference of two poses; `turning` are the places of the joints that turn."""
    from twin.proof.trigonometric import VARIABLES, length_bound, part

    difference = poses[0] - poses[1]
    lengths = sorted(set(range(VARIABLES)) - turning)
    position = length_bound(part(difference, _ROWS, slice(3, 4)), lengths)
    # the distance of two rotations in the norm of Frobenius is 2 sqrt(2) sin(angle / 2)
    sine = part(difference, _ROWS, _ROWS).bound() / (2 * math.sqrt(2))
    # a bound above 1 says nothing: any two orientations are at most 180 degrees apart
    rotation = 2 * math.asin(min(sine, 1.0)) * _ROUNDING_FACTOR
    if not math.isfinite(position):
        raise TwinError(f"{robot}: a number of the equations or of the mechanism is not finite, or too large")
    return position, rotation
