"""Find noise of the measured features: the parts of many joints do not meet, and no single part is at fault."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from twin.cad import meeting
from twin.cad.description import Description
from twin.cad.features import MeasuredFeature
from twin.cad.frames import Faces, drawn
from twin.core import spatial
from twin.core.errors import CadError
from twin.core.findings import Finding, disagreement
from twin.core.quantity import mm
from twin.core.spatial import Array
from twin.core.units import DEG, UM

_SMALLEST_POSITION = 0.1 * UM
"""Noise of positions in m from which a text states it."""

_SMALLEST_DIRECTION = 1e-6
"""Noise of directions in rad from which a text states it."""

CAUSE = "noise of the CAD"
"""Name of the cause of the findings on joints whose parts do not meet because of noise."""

_FEWEST_JOINTS = 4
"""Minimum number of joints that do not meet for which the gaps can be noise."""

_LARGEST_RATIO = 6.0
"""Maximum ratio of the largest and the median gap; a larger gap has a cause of its own."""

_SAMPLE_COUNT = 16
"""Number of random errors from which the gaps are computed that noise causes."""

_UNIT_NOISE = (1 * UM, 1e-5)
"""Noise of positions in m and of directions in rad for which gaps are computed; the gaps are proportional to it."""


@dataclass(frozen=True)
class Noise:
    """Noise of the measured features of a CAD model.

    Attributes:
        position: standard deviation in m of each coordinate of a feature's position.
        direction: standard deviation in rad of a feature's direction about each axis.
        joints: names of the joints whose parts do not meet.
        largest: the largest gap in m.
    """

    position: float
    direction: float
    joints: tuple[str, ...]
    largest: float

    def finding(self, description: Description) -> Finding:
        """Return the finding on the noise of a CAD with this description."""
        parts = []
        if self.position > _SMALLEST_POSITION:
            parts.append(f"{self.position / UM:.2g} µm in each coordinate")
        if self.direction > _SMALLEST_DIRECTION:
            parts.append(f"{self.direction / DEG:.2g}° in each direction")
        return disagreement(
            "cad.noise",
            "the features",
            f"the features in the CAD have noise of {' and '.join(parts)} (standard deviation), and the parts of "
            f"{len(self.joints)} joints do not meet; largest gap",
            mm(self.largest),
            mm(description.tolerance.meeting_um * UM),
            "export the CAD again with more digits, or place the parts exactly",
            when="as drawn",
            cause=CAUSE,
            word="tolerance",
        )


def noise(description: Description, measured: Faces, findings: Sequence[Finding]) -> Noise | None:
    """Return the noise of the features that causes the gaps of a CAD model; None if they have another cause.

    The gaps are noise if at least half of the joints with measured features have one, if they are of similar size, and
    if three parts or more must be at fault. `findings` are those of `meeting.meetings`.
    """
    joints = tuple(dict.fromkeys(finding.where for finding in findings))
    measured_joints = 0
    for joint in description.joint:
        if any(spec.position_mm is None for _, spec in joint.sides):
            measured_joints += 1
    if len(joints) < max(_FEWEST_JOINTS, measured_joints / 2) or _are_on_two_parts(description, joints):
        return None
    sizes: dict[str, list[float]] = {}  # offsets and angles have different codes
    for finding in findings:
        sizes.setdefault(finding.code, []).append(finding.size or 0.0)
    for sizes_of_code in sizes.values():
        if max(sizes_of_code) > _LARGEST_RATIO * float(np.median(sizes_of_code)):
            return None
    gaps = _gaps(description, measured)
    rng = np.random.default_rng(0)
    # mean squares of offsets and of angles (rows) for noise of one unit of positions and of directions (columns)
    effect = np.zeros((2, 2))
    try:
        for _ in range(_SAMPLE_COUNT):
            for column, (position, direction) in enumerate(np.diag(_UNIT_NOISE)):
                change = _gaps(description, with_noise(measured, position, direction, rng)) - gaps
                effect[:, column] += _squares(change) / _SAMPLE_COUNT
    except CadError:  # the features hardly define the frames
        return None
    scale = np.array(_UNIT_NOISE) ** 2
    from scipy.optimize import nnls  # takes longer to import than most commands need for the rest

    # The squares of the gaps are sums of the two variances, each times the squares for noise of one unit.
    # Variances cannot be negative: with the plain least squares, one of the two could come out below zero.
    variances, _ = nnls(effect / scale[:, None], _squares(gaps) / scale)
    position, direction = np.sqrt(variances) * _UNIT_NOISE
    largest = float(np.linalg.norm(gaps[:, :3], axis=1).max())
    return Noise(float(position), float(direction), joints, largest)


def with_noise(measured: Faces, position: float, direction: float, rng: np.random.Generator) -> Faces:
    """Return the features with random errors of the given standard deviations (m; rad)."""
    disturbed: dict[str, dict[str, MeasuredFeature]] = {}
    for body, features in measured.items():
        disturbed[body] = {}
        for name, feature in features.items():
            R = spatial.exp_so3(direction * rng.standard_normal(3))
            point = feature.face.point + position * rng.standard_normal(3)
            face = replace(feature.face, point=point, direction=R @ feature.face.direction)
            disturbed[body][name] = replace(feature, face=face, direction=R @ feature.direction)
    return disturbed


def _are_on_two_parts(description: Description, joints: Sequence[str]) -> bool:
    """Return whether every one of the joints is on one of the same two parts."""
    ends: list[set[str]] = []
    for joint in description.joint:
        if joint.name in joints:
            ends.append({joint.parent, joint.child})
    bodies = sorted(set().union(*ends))
    for first, second in combinations(bodies, 2):
        others = [pair for pair in ends if not pair & {first, second}]
        if not others:
            return True
    return False


def _gaps(description: Description, faces: Faces) -> Array:
    """Return offsets in m and rotation vectors in rad (joints, 6) between the two frames of each joint."""
    at = drawn(description, faces)
    gaps = []
    for joint in description.joint:
        offset, turn = meeting.locked_gap(meeting.child_in_parent(at, joint.name), joint.type)
        gaps.append([*offset, *turn])
    return np.array(gaps)


def _squares(gaps: Array) -> Array:
    """Return the sums of squares of offsets and of rotation vectors (2,)."""
    return np.array([(gaps[:, :3] ** 2).sum(), (gaps[:, 3:] ** 2).sum()])
