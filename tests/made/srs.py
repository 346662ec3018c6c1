"""Tip and trocar in closed form, for arms with a spherical shoulder and wrist (S-R-S) and a straight instrument.

Tip and trocar determine the shaft, and therefore the wrist. Two choices remain: the swivel of the elbow about the line
from shoulder to wrist, and for each swivel one of eight postures (the signs of q2, q4 and q6). Both are chosen for the
largest margin. The margin is the minimum of all distances to joint limits (relative to half the range), |sin q2| and
|sin q6|. These sines are 0 where joint axes are collinear; |sin q4| does not depend on the choice. A path has one
swivel, whose smallest margin along the path is the largest; a closed path is therefore also closed in the joints.

Convention: alpha = 0, -90, 90, -90, 90, -90, 90 deg in modified Denavit-Hartenberg form, origin at the shoulder.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.core.units import MM
from twin.formula import symbolic
from twin.formula.evaluator import Evaluator

SWIVELS = 72
"""Number of swivels in a scan: one every 5 deg."""

_NEAREST = tuple(sorted((k * np.pi / 8 for k in range(-7, 9)), key=abs))
"""Offsets from the requested swivel, the nearest first."""


@dataclass(frozen=True)
class TrocarPose:
    """An arm with its instrument through a trocar.

    Attributes:
        q: (6,) joints in rad; the seventh joint rotates the instrument about its axis and is free.
        swivel: angle in rad; 0: the elbow is in the vertical plane through shoulder and wrist, above their line.
        margin: see the module; negative beyond a limit.
        elbow, wrist: (3,) in m, in the frame at the shoulder.
    """

    q: Array
    swivel: float
    margin: float
    elbow: Array
    wrist: Array


class SrsArm:
    """An S-R-S arm with an instrument along its last axis.

    Attributes:
        upper, fore, hand: shoulder to elbow, elbow to wrist, wrist to tip, in m.
        limits: (6, 2) of q1..q6 in rad.
        body: radius of the arm about its centre lines, in m.
    """

    def __init__(self, upper: float, fore: float, hand: float, limits: ArrayLike, body: float = 0.0) -> None:
        """Take lengths in m and limits (6, 2) in rad; `body` in m: minimum distance of a trocar from the centre lines.

        Raises:
            KinematicsError: a length or a limit is invalid.
        """
        self.upper, self.fore, self.hand = float(upper), float(fore), float(hand)
        self.limits, self.body = np.asarray(limits, float), float(body)
        if not min(self.upper, self.fore, self.hand) > 0:
            raise KinematicsError(f"lengths {upper}, {fore}, {hand} m of an S-R-S arm must be above 0")
        if self.limits.shape != (6, 2) or not np.all(self.limits[:, 0] < self.limits[:, 1]):
            raise KinematicsError("limits must be (6, 2), and no lower limit may exceed its upper limit")

    @cached_property
    def _postures(self) -> Evaluator:
        """(tip, trocar, swivel) -> best q (6), its margin, elbow (3), wrist (3)."""
        z, rows, places = self._closed_form()
        best, most = ca.SX.zeros(6), ca.SX(-1e9)
        for q, margin in rows:
            better = margin > most
            best, most = ca.if_else(better, q, best), ca.if_else(better, margin, most)
        return Evaluator("srs_trocar", z, ca.vertcat(best, most, places))

    @cached_property
    def _every(self) -> Evaluator:
        """(tip, trocar, swivel) -> for each of the eight postures q (6) and margin; (8, 7)."""
        z, rows, _ = self._closed_form()
        return Evaluator("srs_postures", z, ca.vertcat(*(ca.vertcat(q, m).T for q, m in rows)), (8, 7))

    def _closed_form(self) -> tuple[symbolic.SX, list[tuple[symbolic.SX, symbolic.SX]], symbolic.SX]:
        z = ca.SX.sym("z", 7)
        tip, trocar, swivel = z[0:3], z[3:6], z[6]
        u = trocar - tip
        depth = ca.norm_2(u)
        u = u / depth
        wrist = tip + self.hand * u
        D = ca.norm_2(wrist)
        n = wrist / D
        a = (self.upper**2 - self.fore**2 + D**2) / (2 * D)
        up = ca.vertcat(0, 0, 1)
        e1 = up - ca.dot(up, n) * n
        e1 = e1 / ca.norm_2(e1)
        elbow = a * n + ca.sqrt(self.upper**2 - a**2) * (ca.cos(swivel) * e1 + ca.sin(swivel) * ca.cross(n, e1))
        q1, q2 = ca.atan2(elbow[1], elbow[0]), ca.atan2(ca.norm_2(elbow[0:2]), elbow[2])
        R = symbolic.rotation_z(q1) @ symbolic.rotation_y(q2)
        w = R.T @ (wrist - elbow) / self.fore
        q3, q4 = ca.atan2(w[1], w[0]), ca.atan2(ca.norm_2(w[0:2]), w[2])
        v = -(R @ symbolic.rotation_z(q3) @ symbolic.rotation_y(q4)).T @ u
        q5, q6 = ca.atan2(v[1], v[0]), ca.atan2(ca.norm_2(v[0:2]), v[2])
        middle, half = self.limits.mean(axis=1), np.ptp(self.limits, axis=1) / 2
        gap = ca.fmin(_to_segment(trocar, ca.SX.zeros(3), elbow), _to_segment(trocar, elbow, wrist))
        fits = ca.logic_and(depth < self.hand, gap > self.body)
        lined_up = ca.fmin(ca.fabs(ca.sin(q2)), ca.fabs(ca.sin(q6)))
        rows = []
        for s2, s4, s6 in product((0, 1), repeat=3):  # the other sign of a joint turns its neighbours by 180 deg
            q = [q1 + s2 * ca.pi, q2 * (1 - 2 * s2), q3 + (s2 + s4) * ca.pi]
            q += [q4 * (1 - 2 * s4), q5 + (s4 + s6) * ca.pi, q6 * (1 - 2 * s6)]
            margin = lined_up
            for i in range(6):
                if np.isfinite(half[i]):
                    q[i] -= 2 * ca.pi * ca.floor((q[i] - middle[i]) / (2 * ca.pi) + 0.5)
                    margin = ca.fmin(margin, 1 - ca.fabs(q[i] - middle[i]) / half[i])
            rows.append((ca.vertcat(*q), ca.if_else(fits, margin, margin - 2)))
        return z, rows, ca.vertcat(elbow, wrist)

    def at(self, tip: ArrayLike, trocar: ArrayLike, swivel: float = 0.0) -> TrocarPose:
        """Return the best posture at one swivel, whether or not it keeps the limits.

        Raises:
            KinematicsError: see `solve`.
        """
        z = self._checked(tip, trocar)
        return self._result(self._postures.one(np.append(z, swivel)), swivel, z)

    def solve(self, tip: ArrayLike, trocar: ArrayLike, swivel: float = 0.0) -> TrocarPose:
        """Return a posture with the tip at `tip` (3,) and the shaft through `trocar` (3,), within the limits.

        The swivel is the given one if this keeps the limits; otherwise the nearest of sixteen evenly spaced swivels
        that keeps them; otherwise the swivel with the best margin in a finer scan.

        Raises:
            KinematicsError: tip and trocar coincide, the trocar is beyond the wrist, the wrist is out of reach, or no
                swivel keeps the limits; with a suggestion.
        """
        z = np.array([*tip, *trocar, swivel], float)  # type: ignore[misc]
        for turn in _NEAREST:
            z[6] = swivel + turn
            out = self._postures.one(z)
            if out[6] > 0:  # also False if the margin is NaN
                return TrocarPose(out[:6], float(z[6]), float(out[6]), out[7:10], out[10:13])
        return self.best(tip, trocar)

    def best(self, tip: ArrayLike, trocar: ArrayLike) -> TrocarPose:
        """Return the posture with the best margin over all swivels.

        Raises:
            KinematicsError: see `solve`.
        """
        z = self._checked(tip, trocar)
        return self.along(z[None, :3], z[None, 3:])[0]

    def along(self, tips: Array, trocars: Array) -> list[TrocarPose]:
        """Return postures along tips (k, 3) and trocars (k, 3), all with the one swivel of the largest minimum margin.

        Raises:
            KinematicsError: see `solve`; the message names the sample.
        """
        trocars = np.broadcast_to(np.asarray(trocars, float), np.shape(tips))
        Z = np.array([self._checked(a, b, f"sample {k}: ") for k, (a, b) in enumerate(zip(tips, trocars, strict=True))])
        swivels = np.linspace(-np.pi, np.pi, SWIVELS, endpoint=False)
        look = Z if len(Z) <= 64 else Z[np.linspace(0, len(Z) - 1, 64).astype(int)]
        rows = np.hstack([np.repeat(look, SWIVELS, axis=0), np.tile(swivels, len(look))[:, None]])
        margins = self._every.many(rows)[..., 6].reshape(len(look), SWIVELS * 8)
        worst = np.where(np.isfinite(margins), margins, -np.inf).min(axis=0)
        choice, posture = divmod(int(np.argmax(worst)), 8)
        best = float(swivels[choice])
        rows = np.c_[Z, np.full(len(Z), best)]
        every, places = self._every.many(rows)[:, posture], self._postures.many(rows)[:, 7:]
        qs = np.unwrap(every[:, :6], axis=0)  # a joint range wider than a turn may be used fully
        middle, half = self.limits.mean(axis=1), np.ptp(self.limits, axis=1) / 2
        left = np.where(np.isfinite(half), 1 - np.abs(qs - middle) / np.where(np.isfinite(half), half, 1), 1).min(
            axis=1
        )
        whole = np.column_stack([qs, np.minimum(every[:, 6], left), places])
        out = [self._result(o, best, z) for o, z in zip(whole, Z, strict=True)]
        k = int(np.argmin([p.margin for p in out]))
        if out[k].margin <= 0:
            outside = [
                f"q{i + 1} = {np.degrees(v):.1f} deg outside {np.degrees(a):g} .. {np.degrees(b):g} deg"
                for i, (v, (a, b)) in enumerate(zip(out[k].q, self.limits, strict=True))
                if not a <= v <= b
            ]
            if not outside:
                raise KinematicsError(
                    f"the trocar at {_mm(Z[k, 3:])} is inside the arm, {self.body / MM:.0f} mm about its centre lines, "
                    "at every swivel that keeps the limits: move it away from the shoulder, or the base away from it.",
                    best=out[k].q,
                )
            raise KinematicsError(
                f"no swivel of the elbow keeps the joint limits{f' at sample {k}' if len(Z) > 1 else ''}: the best "
                f"({np.degrees(best):.0f} deg) leaves {'; '.join(outside)}. Move the base, or the trocar.",
                best=out[k].q,
            )
        return out

    def _result(self, out: Array, swivel: float, z: Array) -> TrocarPose:
        if not np.isfinite(out).all():
            raise KinematicsError(
                f"the wrist at {_mm(self.wrist(z[:3], z[3:]))} lies on the vertical through the shoulder: the "
                "swivel angle is undefined there. Move tip or trocar sideways by a millimetre."
            )
        return TrocarPose(out[:6], float(swivel), float(out[6]), out[7:10], out[10:13])

    def wrist(self, tip: Array, trocar: Array) -> Array:
        """Return the position (3,) of the wrist that tip and trocar require."""
        u = np.asarray(trocar, float) - tip
        return tip + self.hand * u / np.linalg.norm(u)

    def _checked(self, tip: ArrayLike, trocar: ArrayLike, where: str = "") -> Array:
        """Return tip and trocar as one vector (6,), or raise with a suggestion."""
        tip, trocar = np.asarray(tip, float), np.asarray(trocar, float)
        if tip.shape != (3,) or trocar.shape != (3,) or not np.isfinite([*tip, *trocar]).all():
            raise KinematicsError(f"{where}tip and trocar must be three finite numbers each, in m")
        depth = float(np.linalg.norm(trocar - tip))
        if depth < 1e-6:
            raise KinematicsError(
                f"{where}the tip is in the trocar at {_mm(trocar)}: the direction of the shaft is not defined there. "
                "Give a tip at least a millimetre beyond it."
            )
        if depth >= self.hand:
            raise KinematicsError(
                f"{where}the trocar is {depth / MM:.1f} mm from the tip, beyond the wrist: the instrument is "
                f"{self.hand / MM:.1f} mm long. Move the tip nearer to the trocar by {(depth - self.hand) / MM:.1f} mm."
            )
        wrist = self.wrist(tip, trocar)
        D, most, least = float(np.linalg.norm(wrist)), self.upper + self.fore, abs(self.upper - self.fore)
        if not least <= D <= most:
            raise KinematicsError(where + self._out_of_reach(tip, trocar, wrist, D, most if most < D else least))
        return np.concatenate([tip, trocar])

    def _out_of_reach(self, tip: Array, trocar: Array, wrist: Array, D: float, limit: float) -> str:
        """Return the message with the distance, and the nearest reachable depth through the same trocar."""
        u = (trocar - tip) / np.linalg.norm(trocar - tip)
        text = (
            f"the wrist would be {D / MM:.1f} mm from the shoulder; the arm reaches "
            f"{'up to' if limit < D else 'not below'} {limit / MM:.1f} mm."
        )
        b, c = wrist @ u, D**2 - limit**2
        if b * b >= c:
            shifts = np.array([-b + np.sqrt(b * b - c), -b - np.sqrt(b * b - c)])
            depth = np.linalg.norm(trocar - tip) - shifts
            fine = (depth > 1e-6) & (depth < self.hand)
            if fine.any():
                i = int(np.argmin(np.where(fine, np.abs(shifts), np.inf)))
                near = tip + shifts[i] * u
                return f"{text} On the same line the tip can be at {_mm(near)}, a depth of {depth[i] / MM:.1f} mm."
        return f"{text} No depth on this line is within reach: move the base {abs(D - limit) / MM:.1f} mm nearer."


def _to_segment(p: symbolic.SX, a: symbolic.SX, b: symbolic.SX) -> symbolic.SX:
    """Return the distance of p from the line segment between a and b."""
    s = ca.fmax(0, ca.fmin(1, ca.dot(p - a, b - a) / ca.sumsqr(b - a)))
    return ca.norm_2(p - a - s * (b - a))


def _mm(p: Array) -> str:
    return "(" + ", ".join(f"{x / MM:.1f}" for x in p) + ") mm"
