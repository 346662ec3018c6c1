"""A motion for players: poses of every link at keys, between which players interpolate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from twin.core.spatial import Array
from twin.core.units import DEG, UM

DECIMALS = 13
"""Decimals in m, rad and 1 of poses and coordinates in exported files, which then do not depend on the processor."""


@dataclass(frozen=True)
class ClipAccuracy:
    """Maximum errors between keys: position of a point of a link in m, rotation of a link in rad, joint gap in m."""

    position: float = 100 * UM
    rotation: float = 0.05 * DEG
    joint_gap: float = 100 * UM


@dataclass(frozen=True)
class InterpolationErrors:
    """Measured maximum errors between keys.

    Attributes:
        position: position error in m of any point of a link.
        rotation: rotation error in rad of a link.
        joint_gap: gap in m of a joint.
        position_at, rotation_at, joint_gap_at: (name of the link or joint, time in s) of the three maximum errors.
    """

    position: float
    rotation: float
    joint_gap: float
    position_at: tuple[str, float] = ("", 0.0)
    rotation_at: tuple[str, float] = ("", 0.0)
    joint_gap_at: tuple[str, float] = ("", 0.0)

    def numbers(self) -> dict[str, float]:
        """Return {name in exported files: error in m or rad}, rounded to six significant digits."""
        return {
            # Digits beyond the sixth differ between processors; the files are the same everywhere.
            "between_position": float(f"{self.position:.6g}"),
            "between_rotation": float(f"{self.rotation:.6g}"),
            "joint_gap": float(f"{self.joint_gap:.6g}"),
        }

    def keeps(self, budget: ClipAccuracy) -> bool:
        """Return whether no error exceeds the budget."""
        poses_fit = self.position <= budget.position and self.rotation <= budget.rotation
        return poses_fit and self.joint_gap <= budget.joint_gap


@dataclass(frozen=True)
class Clip:
    """A motion at keys, in SI units; the world is the base frame, z up.

    Attributes:
        times: (k,) in s: 0, then every 1 / rate, and the end.
        links: {body: T_world_body (k, 4, 4)}.
        joints: {joint: coordinates (k,) in m or rad}, for all joints with a single coordinate: active and passive, of
            the tree and of loops.
        active: names of the driven joints, in the order of q.
        phases: (name, start in s, end in s) of each phase.
        rate: key rate in Hz.
        between: maximum errors between keys, for players that interpolate positions linearly and rotations by slerp or
            by components.
        budget: the error budget for which the rate was chosen; None if the keys are the samples of a file.
        frame: name of the frame that the protocol moves.
        shaft_axis: (3,) unit vector along the shaft in `frame`.
        phase_rcm: RCM (3,) in m of each phase, relative to the base frame; None for a phase without an RCM.
        phase_rcm_enforced: for each phase, whether the shaft must pass through the RCM (True), or the RCM is only
            monitored (False).
        assumed: one text "name: reason" for each assumed number of the protocol.
        trocars: {trocar: position (3,) in m, relative to the base frame}.
    """

    name: str
    title: str
    times: Array
    links: Mapping[str, Array]
    joints: Mapping[str, Array]
    active: tuple[str, ...]
    phases: tuple[tuple[str, float, float], ...]
    rate: float
    between: InterpolationErrors
    budget: ClipAccuracy | None = None
    frame: str = ""
    shaft_axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    phase_rcm: tuple[Array | None, ...] = ()
    phase_rcm_enforced: tuple[bool, ...] = ()
    assumed: tuple[str, ...] = ()
    trocars: Mapping[str, Array] = field(default_factory=dict)

    @property
    def rcm(self) -> Array | None:
        """RCM (3,) in m, relative to the base frame, of the first phase with an RCM; None if no phase has an RCM."""
        for rcm in self.phase_rcm:
            if rcm is not None:
                return rcm
        return None


def rounded(arrays: Mapping[str, Array]) -> dict[str, Array]:
    """Return arrays, by name, rounded to `DECIMALS`."""
    rounded_arrays = {}
    for name, array in arrays.items():
        rounded_arrays[name] = np.round(array, DECIMALS) + 0.0  # adding 0.0 removes negative zeros
    return rounded_arrays
