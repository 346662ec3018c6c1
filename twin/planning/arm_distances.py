"""Distances between arms that move together, over time, and the nearest bodies in each phase."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from twin.core.json_types import JsonObject
from twin.core.sampling import spread
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.mechanism import Mechanism
from twin.planning.path import Path
from twin.reference import ReferenceModel
from twin.reference.clearance import Clearance, between
from twin.reference.path_clearance import Certificate

_INSTANTS = 201
"""Largest number of instants at which the distances between the arms are computed."""


@dataclass(frozen=True)
class ArmDistances:
    """Distances of each pair of arms at the times t (k,) in s; each key of `by_pair` names two arms."""

    t: Array
    by_pair: Mapping[tuple[str, str], Clearance]

    def least(self, t0: float = -np.inf, t1: float = np.inf) -> tuple[float, float, tuple[str, str]]:
        """Return the smallest distance from t0 to t1: (distance in m, its time in s, names ARM_BODY of both bodies).

        Raises:
            ValueError: no time of `t` lies from t0 to t1.
        """
        rows = np.flatnonzero((self.t >= t0) & (self.t <= t1))
        if not len(rows):
            raise ValueError(f"the distances between the arms have no time from {t0} s to {t1} s")
        nearest = min(self.by_pair.values(), key=lambda clearance: clearance.distance[rows].min())
        row = int(rows[np.argmin(nearest.distance[rows])])
        first, second = nearest.pair[row]
        names = (first.replace("/", "_", 1), second.replace("/", "_", 1))  # ARM/BODY -> ARM_BODY
        return float(nearest.distance[row]), float(self.t[row]), names


@dataclass(frozen=True)
class Nearest:
    """Smallest distance between bodies in a phase, for one kind of pair (`group_result.KINDS`).

    Attributes:
        proven: lower bound in m of the distance in the whole phase.
        found: smallest distance in m that was found.
        bodies: names of the two bodies with this distance.
        t: time in s at which they have it.
    """

    proven: float
    found: float
    bodies: tuple[str, str]
    t: float

    def as_dict(self) -> JsonObject:
        """Return plain data; the keys of quantities end with the unit."""
        return {
            "proven_mm": self.proven / MM,
            "found_mm": self.found / MM,
            "bodies": list(self.bodies),
            "t_s": self.t,
        }

    def or_nearer(self, arm_distances: ArmDistances, t0: float, t1: float) -> Nearest:
        """Return this distance, or the smallest one between the arms from t0 to t1 in s if that is smaller."""
        is_in_phase = (arm_distances.t >= t0) & (arm_distances.t <= t1)
        if not is_in_phase.any():  # the phase is shorter than the time step of the distances
            return self
        distance, t, bodies = arm_distances.least(t0, t1)
        if distance >= self.found:
            return self
        # a proven bound above a distance that was found would be wrong by rounding
        proven = min(self.proven, distance)
        return Nearest(proven, distance, bodies, t)


def nearest_at(certificate: Certificate, path: Path, q: Array, t: Array) -> Nearest:
    """Return the distance of a certificate with the time in s at which the path has it.

    The time is that of the sample nearest to path(certificate.s); the samples are q (k, n) at the times t (k,) in s.
    """
    nearest = path(np.array([certificate.s]))[0]
    difference = np.abs(q - nearest).max(axis=1)
    t_nearest = float(t[np.argmin(difference)])
    return Nearest(certificate.proven, certificate.found, certificate.bodies, t_nearest)


def distances_between_arms(
    arms: Mapping[str, tuple[Mechanism, Array]], q: Mapping[str, Array], t: Array, check: Callable[[], None]
) -> ArmDistances:
    """Return the distances of each pair of arms over time.

    Args:
        arms: (mechanism, T_world_base (4, 4)) of each arm, by name of the arm.
        q: joint values (k, n) of each arm in m or rad.
        t: (k,) times in s.
        check: called between the steps; an exception of `check` ends the computation.
    """
    rows = spread(len(t), _INSTANTS)
    mechanisms = {}
    poses = {}
    for name, (mechanism, T_world_base) in arms.items():
        check()
        model = ReferenceModel(mechanism)
        in_base = model.link_poses(model.run(q[name][rows]).x)
        mechanisms[name] = mechanism
        poses[name] = {body: T_world_base @ T_base_body for body, T_base_body in in_base.items()}
    check()
    return ArmDistances(t[rows], between(mechanisms, poses))
