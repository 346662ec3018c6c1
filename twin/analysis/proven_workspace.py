"""The part of a workspace that is proved free of singularities, beside the sampled one."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.analysis import grid_workspace as sampled
from twin.analysis.pose_grid import PoseGrid
from twin.analysis.workspace_result import volume_error
from twin.api.robot import Robot
from twin.core.errors import TwinError
from twin.core.findings import Finding, warning
from twin.core.json_types import JsonObject
from twin.core.progress import Progress, silent
from twin.core.result import Part, Result
from twin.core.spatial import Array
from twin.core.units import MM, UM
from twin.formula import variant_choice
from twin.kinematics.closed_loops.bounds import bounds_of
from twin.proof.box_judge import BoxJudge
from twin.proof.certificate import digest
from twin.proof.formula_boxes import FormulaBoxes
from twin.proof.linear_limit import LinearLimit
from twin.proof.loops import ClosingConditions
from twin.proof.regular_workspace import RegularWorkspace, cover
from twin.proof.workspace_certificate import SCHEMA, boxes_as_data, limits_as_data, loops_as_data

_BOXES_PER_SIDE = 232
"""Number of smallest boxes along the longest side of the workspace, unless an edge is given."""

_LARGEST_BOX_HALVINGS = 3
"""How often the largest boxes are halved: larger ones are hardly ever proved, and cost time."""

_MOST_BOXES = 4e8
"""Maximum number of smallest boxes in the box."""

_SAMPLED_POSITIONS = 300_000
"""Number of positions of the sampled workspace."""

_LITRE = 1e-3
"""A cubic decimetre in m3."""


@dataclass(frozen=True)
class ProvenWorkspace(Result):
    """What is proved of the tool positions in one orientation.

    Attributes:
        robot: name of the robot.
        variants: the chosen variant of each equation.
        proof: the proved boxes.
        sampled: volume in m3 of the reached positions, as `twin workspace` counts them in the same box.
        sampled_error: its error of counting cells in m3, about two standard deviations.
        unchecked: limits that the proof does not consider.
        files: {file of equations or mechanism: SHA-256 of its bytes}.
        certified: loops, limits and boxes as plain data, for the certificate.
        tolerance: by how much each coordinate of the origin of each joint's frame may differ from its number, in m.
    """

    robot: str
    variants: Mapping[str, str]
    proof: RegularWorkspace
    sampled: float
    sampled_error: float
    unchecked: tuple[str, ...]
    files: Mapping[str, str]
    certified: JsonObject
    tolerance: float = 0.0

    kind = "prove-workspace"
    judges = False

    @property
    def findings(self) -> tuple[Finding, ...]:
        """A warning if nothing is proved, or if a limit is not considered."""
        findings = []
        if not len(self.proof.low):
            text = "no box is proved free of singularities; give a smaller edge (--edge-mm), or a box within reach"
            findings.append(warning("prove.no_box", self.robot, text))
        if self.unchecked:
            text = f"limits of {', '.join(self.unchecked)} are not considered: these joints close loops"
            findings.append(warning("prove.limits", self.robot, text))
        return tuple(findings)

    @property
    def share(self) -> float:
        """Proved volume divided by the sampled one; NaN if nothing is sampled."""
        if not self.sampled:
            return math.nan
        return self.proof.volume / self.sampled

    def content(self) -> JsonObject:
        """Return volumes as plain data."""
        proof = self.proof
        open_dm3 = {}
        for reason, volume in proof.open.items():
            open_dm3[reason] = volume / _LITRE
        return {
            "robot": self.robot,
            "variants": dict(self.variants),
            "orientation": proof.orientation.tolist(),
            "proved_dm3": proof.volume / _LITRE,
            "proved_boxes": len(proof.low),
            "outside_dm3": proof.outside / _LITRE,
            "open_dm3": open_dm3,
            "sampled_dm3": self.sampled / _LITRE,
            "sampled_error_dm3": self.sampled_error / _LITRE,
            "share": self.share,
            "smallest_edges_mm": (proof.edges / MM).tolist(),
            "examined_boxes": proof.boxes,
            "largest_redundant_condition": proof.redundant,
            "limits_unchecked": list(self.unchecked),
            "tolerance_um": self.tolerance / UM,
        }

    def certificate(self) -> JsonObject:
        """Return the certificate of the proved boxes, which docs/check_workspace.py checks without twin."""
        data: JsonObject = {
            "schema": SCHEMA,
            "robot": self.robot,
            "variants": dict(self.variants),
            "files": dict(self.files),
            "orientation": self.proof.orientation.tolist(),
            "tolerance_m": self.tolerance,
            **self.certified,
        }
        return {**data, "sha256": digest(data)}

    def write(self, folder: Path) -> None:
        """Write the proved boxes and, if there is one, the certificate: without a box it states nothing."""
        low = (self.proof.low / MM).tolist()
        high = (self.proof.high / MM).tolist()
        data = {"low_mm": low, "high_mm": high, "R_base_tool": self.proof.orientation.tolist()}
        (folder / "boxes.json").write_text(json.dumps(data), encoding="ascii")
        if not len(self.proof.low):
            return
        text = json.dumps(self.certificate(), ensure_ascii=True, allow_nan=False)
        (folder / "certificate.json").write_text(text, encoding="ascii")

    def text(self) -> Iterator[Part]:
        """Yield the volumes."""
        proof = self.proof
        yield f"{self.robot}: tool positions in one orientation, that of the posture home"
        yield ""
        yield f"  proved            {proof.volume / _LITRE:.4g} dm³ in {len(proof.low)} boxes ({proof.boxes} examined)"
        yield "                    at every position: one assembly near the equations, within limits, not singular"
        if self.tolerance:
            within = f"{self.tolerance / UM:g} um of the CAD along x, y and z"
            yield f"                    of every mechanism whose joints are within {within}"
        error = float(f"{self.sampled_error / _LITRE:.1g}")
        yield f"  sampled           {self.sampled / _LITRE:.4g} ± {error:g} dm³ are reached (as by `twin workspace`)"
        yield f"  share             {100 * self.share:.3g} %"
        for reason, volume in proof.open.items():
            yield f"  open              {volume / _LITRE:.3g} dm³: {_REASONS[reason]}"
        yield f"  smallest edge     {proof.edges.max() / MM:.3g} mm"
        if proof.redundant:
            yield f"  other conditions  the loops that follow from the others close within {proof.redundant:.1e} m"
        yield "  not considered    collisions"
        yield ""
        yield from self.findings


_REASONS = {  # the keys are those of `RegularWorkspace.open`
    "no assembly": "no assembly was enclosed; near the edge of reach, or where a limb is nearly singular",
    "other conditions": "a loop may not close, or only with a joint turned over, although enough conditions hold",
    "limit": "a limit may be exceeded in a part of the box",
    "other assembly": "the assembly is not the one that the equations prefer",
    "singular": "the tool might move while the joints are at rest",
}


def proven_workspace(
    robot: Robot,
    variants: Mapping[str, str] | str | None = None,
    edge: float | None = None,
    corners: tuple[Array, Array] | None = None,
    progress: Progress = silent,
    tolerance: float = 0.0,
) -> ProvenWorkspace:
    """Return the tool positions, in the orientation of the posture home, that are proved regular.

    Args:
        robot: a robot with equations and CAD.
        variants: {equation: variant}, or one variant for all equations that have it.
        edge: edge of the smallest boxes in m; default: a part of the longest side of the workspace.
        corners: lower and upper corner (3,) of the box of positions in m, in base; default: around all reached ones.
        progress: see `Progress`.
        tolerance: by how much each coordinate of the origin of each joint's frame may differ from its number, in m; the
            positions are then proved for all these mechanisms.

    Raises:
        TwinError: the robot has no equations, or loops that are not enclosed; the box has no volume or is not reached.
    """
    if robot.files is None or not robot.files.has_equations:
        raise TwinError(f"{robot.name} has no equations, which must predict the joint values")
    if not (math.isfinite(tolerance) and tolerance >= 0):
        raise TwinError(f"the tolerance of lengths is {tolerance / UM:g} um; give a number of micrometres, 0 or more")
    mechanism = robot.mechanism
    loops = ClosingConditions(mechanism, tolerance)
    T = sampled.centre(robot)
    start = T[:3, 3]
    if corners is None:
        progress("the box of reached positions", 0.0)
        try:
            low, high = sampled.box(robot, T)
        except sampled.UnreachedError as unreached:
            raise TwinError(
                f"{robot.name}: in the orientation of posture home, the tool reaches no volume: its positions are a "
                "surface or a curve, or the orientation changes with them; nothing can be proved of boxes"
            ) from unreached
    else:
        low, high = _checked_corners(robot.name, corners)
        start = np.clip(start, low, high)  # the position of the posture home, or that nearest to it in the box
    edge = _edge(edge, low, high)
    limits, unchecked = _limits(robot, loops)
    chosen = variant_choice.choose(robot.formula, variants)
    equations = FormulaBoxes(robot.formula, chosen, R=T[:3, :3], joints=loops.names, limits=limits)
    judge = BoxJudge(loops, R=T[:3, :3], limits=limits, equations=equations, p=start)
    halvings = int(np.clip(np.log2((high - low).min() / edge), 0, _LARGEST_BOX_HALVINGS))
    proof = cover(judge, low=low, high=high, edge=edge, halvings=halvings, progress=progress)
    volume, error = _sampled_volume(robot, T, low, high, progress)
    certified: JsonObject = {
        **loops_as_data(loops),
        "limits": limits_as_data(limits),
        "boxes": boxes_as_data(proof, equations.values(0.5 * (proof.low + proof.high))),
    }
    return ProvenWorkspace(
        robot.name,
        variants=chosen,
        proof=proof,
        sampled=volume,
        sampled_error=error,
        unchecked=unchecked,
        files=robot.hashes(),
        certified=certified,
        tolerance=tolerance,
    )


def _checked_corners(name: str, corners: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the lower and the upper corner (3,) of a box in m; `name` is that of the robot, for messages.

    Raises:
        TwinError: a coordinate is not finite, or a lower one is not below the upper one.
    """
    low = np.asarray(corners[0], float)
    high = np.asarray(corners[1], float)
    for axis, first, last in zip("xyz", low, high, strict=True):
        if not (math.isfinite(first) and math.isfinite(last) and first < last):
            extent = f"from {first / MM:g} to {last / MM:g} mm along {axis}"
            raise TwinError(f"{name}: the box is {extent}; give a lower and an upper end")
    return low, high


def _edge(edge: float | None, low: Array, high: Array) -> float:
    """Return the edge of the smallest boxes in m.

    Raises:
        TwinError: it is no positive number, or the box has too many of them.
    """
    if edge is None:
        return float((high - low).max()) / _BOXES_PER_SIDE
    if not (math.isfinite(edge) and edge > 0):
        raise TwinError(f"the edge of the smallest boxes is {edge / MM:g} mm; give a positive number of millimetres")
    count = float(np.prod((high - low) / edge))
    if count > _MOST_BOXES:
        raise TwinError(
            f"the box has {count:.1e} boxes of {edge / MM:g} mm, at most {_MOST_BOXES:.0e}: give a larger edge"
        )
    return edge


def _limits(robot: Robot, loops: ClosingConditions) -> tuple[list[LinearLimit], tuple[str, ...]]:
    """Return the hard limits of joints, motors and rails, and the joints whose limits are not considered."""
    mechanism = robot.mechanism
    limits = []
    for bound in bounds_of(mechanism, robot.gaps):
        weights = {}
        for joint, weight in zip(mechanism.active, bound.weights, strict=True):
            if weight:
                weights[joint.name] = float(weight)
        limits.append(LinearLimit(f"{bound.name} {bound.kind}", weights, bound.least))
    unchecked = []
    for joint in mechanism.joints:
        if joint.active or joint.limits is None or len(joint.free_axes) != 1:
            continue
        if joint.name not in loops.names:
            unchecked.append(joint.name)
            continue
        low, high = joint.limits
        if math.isfinite(low):
            limits.append(LinearLimit(f"{joint.name} lower", {joint.name: 1.0}, low))
        if math.isfinite(high):
            limits.append(LinearLimit(f"{joint.name} upper", {joint.name: -1.0}, -high))
    return limits, tuple(unchecked)


def _sampled_volume(robot: Robot, T: Array, low: Array, high: Array, progress: Progress) -> tuple[float, float]:
    """Return volume and error in m3 of the reached positions on a grid."""
    step = float(np.cbrt(np.prod(high - low) / _SAMPLED_POSITIONS))
    nx, ny, nz = np.maximum(np.round((high - low) / step).astype(int), 1).tolist()
    # each position is the middle of its cell
    grid = PoseGrid(low + 0.5 * (high - low - step * (np.array([nx, ny, nz]) - 1)), step, (nx, ny, nz), T[:3, :3])
    space = sampled.over_grid(robot, grid, progress=progress)
    cell = step**3
    reached = space.cube[..., 0] > 0
    return float(cell * reached.sum()), volume_error(reached, cell)
