"""circle: full circles of the tip. The shaft passes through the RCM; without RCM, the orientation is constant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from twin.core import spatial
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.core.units import MM
from twin.planning.protocol.course import Course, Motion, rotation
from twin.planning.protocol.phase import Phase, PhaseEnd, PhaseStart
from twin.planning.protocol.phase_table import PhaseTable, TrocarName
from twin.planning.protocol.protocol_file import ProtocolFile
from twin.planning.protocol.protocol_state import ProtocolState
from twin.schema import Vector, at

_NO_RADIUS = 1e-9
"""Radius in m below which there is no circle."""


class CircleTable(PhaseTable):
    """Full circles of the tip; if there is an RCM, the shaft passes through it."""

    type: Literal["circle"]
    centre_mm: Vector
    normal: Vector = (0.0, 0.0, 1.0)
    turns: Annotated[int, Field(ge=1, le=1000)] = 1
    trocar: TrocarName = None

    rank: ClassVar[int] = 5
    in_patient: ClassVar[bool] = True

    @model_validator(mode="after")
    def _has_an_axis(self) -> CircleTable:
        if not any(self.normal):
            raise at("normal", "the axis of a circle must not be zero")
        return self

    def advance(self, state: ProtocolState) -> None:
        """Register the trocar, if named; the phase ends at the waypoint where it begins."""
        state.register_trocar(self.trocar)
        state.end_at_start()

    def phase(self, protocol_file: ProtocolFile) -> Circle:
        """Return the phase that this table describes, in SI units."""
        normal = np.array(self.normal, float)
        normal /= np.abs(normal).max()  # squares of very small or large numbers are 0 or infinite
        centre = np.array(self.centre_mm) * MM
        return Circle(self.name, centre, normal / np.linalg.norm(normal), self.turns, self.trocar or "")


@dataclass(frozen=True)
class Circle(Phase):
    """Full circles of the tip about the axis `normal` (3,) through `centre` (3,) in m, counter-clockwise.

    If there is an RCM, the shaft passes through it and does not rotate about its own axis; a `trocar` named here is the
    RCM of this phase. If there is no RCM, the orientation of the tool is constant.
    """

    centre: Array
    normal: Array
    turns: int = 1
    trocar: str = ""
    type: ClassVar[str] = "circle"
    has_length: ClassVar[bool] = False

    def end_after(self, start: PhaseStart) -> PhaseEnd:
        """Return the state at the end of the phase, which is the state at its start."""
        if np.linalg.norm(np.cross(start.tip - self.centre, self.normal)) < _NO_RADIUS:
            raise start.error(
                "the tip begins on the axis of the circle: the radius is 0; change centre_mm or the start"
            )
        if start.rcm is None:
            return PhaseEnd(start.angles, start.tip, None)
        missed = spatial.point_to_line(start.rcm, start.tip, start.shaft)
        if missed > start.tolerance:
            raise start.error(
                f"the shaft begins {missed / MM:.3f} mm beside the RCM (allowed: {start.tolerance / MM:g} mm)"
            )
        return PhaseEnd(start.angles, start.tip, start.rcm, rcm_mode="enforced", depth=start.depth)

    def motion(self, course: Course, s: Array) -> Motion:
        """Return the motion at s (k,); the tool rotates minimally from the initial to the current shaft direction."""
        R0 = rotation(course.angles0, course.order)
        from_centre = course.tip0 - self.centre
        along = (from_centre @ self.normal) * self.normal  # along the axis: the start may be beside the plane
        radius = from_centre - along
        tangent = np.cross(self.normal, radius)
        angle = 2 * np.pi * self.turns
        cos = np.cos(angle * s)[:, None]
        sin = np.sin(angle * s)[:, None]
        p = self.centre + along + cos * radius + sin * tangent
        p1 = angle * (cos * tangent - sin * radius)
        p2 = -(angle**2) * (cos * radius + sin * tangent)
        if course.rcm is None:
            no_rotation = np.zeros((len(s), 3))
            return course.moved(np.tile(R0, (len(s), 1, 1)), p, p1, p2, no_rotation, no_rotation)
        n, n1, n2 = _direction(p - course.rcm, p1, p2)
        n0 = R0 @ course.n_tool_shaft
        # the smallest rotation that turns n0 to n: I + hat(n0 x n) + hat(n0 x n)^2 / (1 + n0 n)
        share = 1 / (1 + n @ n0)
        hat = spatial.hat(np.cross(n0, n))
        R = (np.eye(3) + hat + share[:, None, None] * (hat @ hat)) @ R0
        # its rate, and the derivative of the rate
        share = share[:, None]
        w1 = np.cross(n0 + n, n1) * share
        w2 = np.cross(n0 + n, n2) * share - w1 * (n1 @ n0)[:, None] * share
        return course.moved(R, p, p1, p2, w1, w2)

    def depth_at(self, course: Course, s: float) -> float:
        """Return the insertion depth in m at the path parameter s; NaN if no RCM is registered."""
        if course.rcm is None:
            return course.depth0
        p = self.motion(course, np.array([s])).p[0]
        return float(np.linalg.norm(p - course.rcm))

    def parameters(self) -> Iterator[Parameter]:
        """Yield the three coordinates of the circle's centre, with their provenance."""
        for label, p in zip("xyz", self.centre, strict=True):
            note = "centre of the circle; see the protocol file"
            yield Parameter(f"{self.name}_centre_{label}", float(p), "mm", float(p) / MM, "ASSUMED", note)


def _direction(w: Array, w1: Array, w2: Array) -> tuple[Array, Array, Array]:
    """Return the unit vectors (k, 3) along vectors w (k, 3), and their derivatives; w1 and w2 are those of w.

    With the length r and w = r n, the product rule gives w1 = r1 n + r n1 and w2 = r2 n + 2 r1 n1 + r n2.
    """
    r = np.linalg.norm(w, axis=1)[:, None]
    n = w / r
    r1 = np.sum(n * w1, axis=1)[:, None]
    n1 = (w1 - r1 * n) / r
    r2 = (np.sum(n1 * w1, axis=1) + np.sum(n * w2, axis=1))[:, None]
    n2 = (w2 - r2 * n - 2 * r1 * n1) / r
    return n, n1, n2
