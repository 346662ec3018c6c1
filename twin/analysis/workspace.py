"""Compute a workspace on a grid of positions, in several orientations near a central orientation.

Poses are not stored: in chunks of indices, a compiled kernel computes each pose from its index. Only a few values are
stored for each position. Hard limits of driven joints, motors, rails and passive joints are kept; collisions are not
checked.
"""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import product
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from twin.analysis import measure
from twin.analysis.cluster import each
from twin.api.robot import Robot, load
from twin.core.errors import KinematicsError, TwinError
from twin.core.findings import Finding
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.result import Part, Result
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.formula import symbolic
from twin.kinematics.closed_loops.dragging import Bound, bounds_of
from twin.kinematics.closed_loops.passive_limits import PassiveCheck, passive_limits

if TYPE_CHECKING:
    from distributed import Client

PoseKernel = Callable[[Array], tuple[Array, ...]]
"""Function of samples (size, k), see `twin.analysis.measure.kernel`."""

CHUNK = 1 << 18
"""Number of poses in a chunk; a chunk requires tens of milliseconds and a few MB."""

COLUMNS = measure.NAMES
"""Columns of the values for each position.

`reached`: fraction of the orientations that are reached at the position. The other values are taken over the reached
orientations. `inverse_condition`: mean inverse condition number. `limit_margin`: largest margin to the joint limits.
`singularity`: smallest singularity measure.
"""

_START, _FARTHEST = 0.1, 12.8
"""Half the edge length, in m, of the first box and of the largest box in the search for reached positions."""

_COARSE, _GROWN = 32, 5
"""Number of positions along the longest edge in the search for the box, and maximum number of refinements."""


class UnreachedError(TwinError):
    """No position of a grid is reached in any of the grid's orientations."""


@dataclass(frozen=True)
class Grid:
    """Positions and orientations to evaluate.

    Attributes:
        low: (3,) first position in m, in base.
        step: distance between positions in m.
        shape: number of positions (nx, ny, nz).
        R_base_tool: (3, 3) the central orientation.
        tilt: maximum rotation about each axis of base in rad.
        turns: number of orientations at each position; the first is the central orientation.
    """

    low: Array
    step: float
    shape: tuple[int, int, int]
    R_base_tool: Array
    tilt: float = 0.0
    turns: int = 1

    @property
    def positions(self) -> int:
        """Number of positions."""
        return math.prod(self.shape)  # without overflow

    @property
    def poses(self) -> int:
        """Number of poses: positions times orientations."""
        return self.positions * self.turns

    @property
    def axes(self) -> tuple[int, ...]:
        """Axes (0, 1, 2 for x, y, z) along which there are several positions."""
        return tuple(a for a, n in enumerate(self.shape) if n > 1)

    def position(self, number: np.ndarray) -> Array:
        """Return the positions (k, 3) in m with indices (k,); x varies fastest."""
        nx, ny, _ = self.shape
        index = np.stack([number % nx, number // nx % ny, number // (nx * ny)], axis=1)
        return self.low + self.step * index

    def pose(self, i: ca.SX) -> ca.SX:
        """Return the pose (4, 4) with index i; the orientations at one position have consecutive indices."""
        nx, ny, _ = self.shape
        place = ca.floor((i + 0.5) / self.turns)
        row = ca.floor((place + 0.5) / nx)
        layer = ca.floor((row + 0.5) / ny)
        index = (place - nx * row, row - ny * layer, layer)
        p = [float(o) + self.step * k for o, k in zip(self.low, index, strict=True)]
        R = ca.SX(self.R_base_tool)
        if self.turns > 1 and self.tilt:
            turn = i - self.turns * place
            parts = [turn / measure.ROOT**k for k in (1, 2, 3)]
            w = [2 * self.tilt * (x + 0.5 - ca.floor(x + 0.5) - 0.5) for x in parts]
            R = symbolic.exp_so3(ca.vertcat(*w)) @ R
        return ca.vertcat(ca.horzcat(R, ca.vertcat(*p)), ca.SX([[0, 0, 0, 1]]))


@dataclass(frozen=True)
class Measure:
    """Quantity that measures the size of a set of grid cells: volume, area or length.

    Attributes:
        name: "volume", "area" or "length".
        unit: unit as written in keys of the JSON output.
        symbol: unit as written in text.
        edge: edge length in m of a cube, square or line of size 1 in this unit.
        dimension: 3, 2 or 1.
    """

    name: str
    unit: str
    symbol: str
    edge: float
    dimension: int

    def cell(self, step: float) -> float:
        """Return the size, in `unit`, of a cell with an edge length of `step` m."""
        return (step / self.edge) ** self.dimension

    def key(self, what: str = "") -> str:
        """Return the JSON key of the size, such as "volume_dm3"; with `what` = "error", the key "volume_error_dm3"."""
        return "_".join(x for x in (self.name, what, self.unit) if x)


_MEASURES = {
    3: Measure("volume", "dm3", "dm³", 0.1, 3),
    2: Measure("area", "cm2", "cm²", 0.01, 2),
    1: Measure("length", "mm", "mm", MM, 1),
}

_SETS = {0: "one point", 1: "a curve", 2: "a surface", 3: "a volume"}


@dataclass(frozen=True)
class Workspace(Result):
    """The workspace of a robot.

    Attributes:
        grid: the evaluated positions and orientations.
        values: (positions, 4) values, see `COLUMNS`.
        facts: further results, with the keys of the JSON output.
        dimension: 3 if the reached positions form a volume, 2 for a surface, 1 for a curve, 0 for a point.
    """

    robot: str
    grid: Grid
    values: np.ndarray
    facts: JsonObject = field(default_factory=dict)
    dimension: int = 3

    kind = "workspace"
    judges = False

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Always empty: a workspace is measured, not judged."""
        return ()

    @property
    def reached(self) -> np.ndarray:
        """(k,) bool: whether a position is reached in at least one orientation."""
        return self.values[:, 0] > 0

    @property
    def cube(self) -> np.ndarray:
        """The values of the positions as an array (nx, ny, nz, 4); the last axis has the order of `COLUMNS`."""
        nx, ny, nz = self.grid.shape
        return self.values.reshape(nz, ny, nx, len(COLUMNS)).transpose(2, 1, 0, 3)

    @property
    def measure(self) -> Measure | None:
        """The measured quantity; None for a point, and for a curve or surface that is not parallel to the axes."""
        return _MEASURES.get(self.dimension) if self.dimension == len(self.grid.axes) else None

    def content(self) -> JsonObject:
        """Return the size, fractions, condition numbers and limits of the workspace as plain data.

        The size is a volume in dm3, an area in cm2 if all positions are in one plane parallel to two axes of base, or a
        length in mm if all positions are on a line parallel to an axis. For other surfaces and curves, the size is
        None.
        """
        good = self.values[self.reached]
        share, inverse = good[:, 0].astype(float), good[:, 1].astype(float)
        low = self.grid.position(np.flatnonzero(self.reached)).min(axis=0) if len(good) else np.full(3, np.nan)
        high = self.grid.position(np.flatnonzero(self.reached)).max(axis=0) if len(good) else np.full(3, np.nan)
        best = int(np.argmax(np.where(self.reached, self.values[:, 1], -1)))
        g = self.grid
        return {
            "robot": self.robot,
            "poses": g.poses,
            "positions": g.positions,
            "orientations": g.turns,
            "tilt_deg": g.tilt / DEG,
            "step_mm": float(g.step / MM),
            "dimension": self.dimension,
            **self._size(share),
            "share_of_orientations": float(share.mean()) if len(good) else 0.0,
            "global_conditioning_index": float(np.average(inverse, weights=share)) if inverse.any() else None,
            "inverse_condition_quantiles": _quantiles(inverse) if inverse.any() else {},
            "limit_margin_quantiles": _quantiles(good[:, 2].astype(float)),
            "smallest_singularity_measure": _least(good[:, 3]),
            "box_mm": {"low": (low / MM).tolist(), "high": (high / MM).tolist()},
            "best_position_mm": (g.position(np.array([best]))[0] / MM).tolist() if len(good) else None,
            **self.facts,
        }

    def _size(self, share: np.ndarray) -> dict[str, float | None]:
        """Return the size and its error; `share` (k,) is the reached fraction of orientations at reached positions."""
        none: dict[str, float | None] = dict.fromkeys(
            ("volume_dm3", "volume_error_dm3", "volume_every_orientation_dm3")
        )
        m = self.measure
        if m is None:
            return none
        cell, reached = m.cell(self.grid.step), self.cube[..., 0] > 0
        # A sampled cell counts if any part is reached: on average half a cell too much at each face of the boundary.
        faces = sum(int(np.diff(reached, axis=a).sum()) for a in self.grid.axes) if self.facts.get("sampled") else 0
        found: dict[str, float | None] = {
            m.key(): float(cell * len(share)),
            m.key("error"): volume_error(reached, cell) + 0.5 * cell * faces,
            m.key("every_orientation"): float(cell * (share == 1).sum()),
        }
        return {**none, **found}

    def text(self) -> Iterator[Part]:
        """Yield the size, condition numbers, margins and the best position."""
        s = self.content()
        yield f"{s['robot']} · {_what(s)} · cells of {s['step_mm']:.3g} mm"
        yield ""
        corner = ", ".join(f"{a:.0f} .. {b:.0f}" for a, b in zip(s["box_mm"]["low"], s["box_mm"]["high"], strict=True))
        m = self.measure
        if m is None:
            size = f"{_SETS[self.dimension]}, whose size is not computed,"
        else:
            error = float(f"{s[m.key('error')]:.1g}")  # one digit, without an exponent
            size = f"{s[m.key()]:.4g} ± {error:g} {m.symbol} (error of counting cells)"
            size += {2: " of a plane", 1: " of a line"}.get(self.dimension, "")
        yield f"  reached           {size} in x, y, z = {corner} mm"
        if s["orientations"] > 1 and m is not None:
            yield f"  every orientation {s[m.key('every_orientation')]:.4g} {m.symbol} are reached in every orientation"
        if s["global_conditioning_index"] is not None:
            spread = ", ".join(f"{k}: {v:.3f}" for k, v in s["inverse_condition_quantiles"].items())
            yield f"  inverse condition mean {s['global_conditioning_index']:.3f} (quantiles {spread})"
        spread = ", ".join(f"{k}: {v:.2f}" for k, v in s["limit_margin_quantiles"].items())
        yield f"  joint limits      margin (0 at a limit, 1 in the middle of the range), quantiles {spread}"
        if names := s.get("without_limits"):
            yield f"                    {', '.join(names)}: no limits are stated; -180° to 180° is assumed"
        if s["smallest_singularity_measure"] is not None:
            yield f"  singularity       smallest measure {s['smallest_singularity_measure']:.3g}"
        if s["best_position_mm"] is not None:
            why = " (largest inverse condition number)" if s["global_conditioning_index"] is not None else ""
            yield f"  best position     {', '.join(f'{x:.0f}' for x in s['best_position_mm'])} mm{why}"
        if names := s.get("passive_limits_kept"):
            yield f"  passive joints    limits of {', '.join(names)} are kept"
        if names := s.get("passive_limits_unchecked"):
            why = "the equations do not describe the mechanism of the CAD"
            yield f"  not checked       limits of the passive joints {', '.join(names)}: {why}"
        if names := s.get("soft_limits_unchecked"):
            yield f"  not checked       soft limits of {', '.join(names)}, which only cause warnings"
        yield "  not checked       collisions"
        yield ""


def _what(s: JsonMapping) -> str:
    if s.get("sampled") == "joints":
        return f"{s['samples']} joint positions, {100 * s['assembled']:.1f} % can be assembled"
    if s["orientations"] == 1:
        return f"{s['poses']} positions in one orientation"
    return f"{s['positions']} positions in {s['orientations']} orientations within {s['tilt_deg']:g}° about each axis"


def volume_error(cube: np.ndarray, cell: float) -> float:
    """Return the uncertainty of a volume computed by counting cells, about two standard deviations.

    The grid is split into eight interleaved grids with twice the step (four grids for one layer of cells). The result
    is the standard deviation of the volumes computed from these grids. It is about twice the standard deviation of the
    volume from the full grid, as measured on SILS with shifted grids of 6 to 32 mm.

    `cube` (nx, ny, nz) states whether each position is reached. `cell` is the volume of one cell; the result has the
    same unit.
    """
    starts = product(*[range(min(n, 2)) for n in cube.shape])
    parts = [cube[i::2, j::2, k::2].sum() for i, j, k in starts]
    return float(len(parts) * cell * np.std(parts))


def _quantiles(x: Array) -> dict[str, float]:
    if not len(x):
        return {}
    return {f"{p} %": float(v) for p, v in zip((5, 50, 95), np.quantile(x, (0.05, 0.5, 0.95)), strict=True)}


def _least(x: np.ndarray) -> float | None:
    good = x[np.isfinite(x)]
    return float(good.min()) if len(good) else None


def shared_bounds(robot: Robot) -> tuple[Bound, ...]:
    """Return the limits of a robot that involve several joints."""
    return measure.shared(bounds_of(robot.mechanism, robot.cad.gaps if robot.files is not None else ()))


def gaps_of(robot: Robot) -> list[tuple[int, int, float]]:
    """Return (lower joint index, upper joint index, minimum distance in m) of each pair of joints on one rail."""
    order = [j.name for j in robot.mechanism.active]
    pairs = robot.cad.gaps if robot.files is not None else ()
    return [(order.index(lower), order.index(upper), least) for lower, upper, least in pairs]


def passive_check(robot: Robot) -> PassiveCheck | None:
    """Return the check of limits of passive joints.

    The result is None in two cases: no passive joint has limits, or the equations do not describe the mechanism. In the
    second case, its loops do not close at poses of the equations; the central pose is tested.
    """
    if not passive_limits(robot.mechanism):
        return None
    check = robot.passive_check
    if robot.files is None or not robot.files.has_equations:
        return check
    kin, T = robot.kinematics(), centre(robot)
    if kin.closed_inverse:
        return check if measure.agree(kin, check, T) else None
    q = _home(robot)[None]
    Ts = kin.forward_many(q)
    return check if np.isfinite(Ts).all() and check.placed(q, Ts)[1].all() else None


def limit_facts(robot: Robot, passive: PassiveCheck | None) -> dict[str, list[str]]:
    """Return the names of passive joints whose limits are kept, and of joints with limits that are not checked."""
    joints = dict.fromkeys(limit.joint.name for limit in passive_limits(robot.mechanism))
    soft = []
    for joint in robot.mechanism.active:
        if joint.soft_limits is None:
            continue
        low, high = joint.limits or (-np.inf, np.inf)
        if joint.soft_limits[0] > low or joint.soft_limits[1] < high:
            soft.append(joint.name)
    return {
        "passive_limits_kept": list(joints) if passive is not None else [],
        "passive_limits_unchecked": list(joints) if passive is None else [],
        "soft_limits_unchecked": soft,
    }


def judge(robot: Robot, grid: Grid) -> PoseKernel:
    """Return the function that decides which poses of a grid a robot can reach.

    Raises:
        KinematicsError: the robot's equations have no closed-form inverse.
    """
    kin = robot.kinematics()
    if not kin.closed_inverse:
        raise KinematicsError(
            f"{robot.name}: the equations have no closed-form inverse; a numerical inverse would take hours"
        )
    bounds, passive = shared_bounds(robot), passive_check(robot)
    return measure.kernel(kin, robot.mechanism.limits, grid.pose, bounds=bounds, passive=passive)


def chunks(grid: Grid) -> Iterator[tuple[int, int]]:
    """Yield (first position, last position + 1) of chunks of about `CHUNK` poses."""
    many = max(1, CHUNK // grid.turns)
    for first in range(0, grid.positions, many):
        yield first, min(first + many, grid.positions)


def evaluate(kernel: PoseKernel, grid: Grid, first: int, last: int) -> np.ndarray:
    """Return the values (last - first, 4) float32, in the order of `COLUMNS`, of the positions first to last - 1."""
    number = np.arange(first * grid.turns, last * grid.turns, dtype=np.float64)[None]
    reached, inverse, margin, singularity, _ = (x.reshape(-1, last - first, grid.turns) for x in kernel(number))
    count = reached[0].sum(axis=1)
    out = np.zeros((last - first, 4), np.float32)
    out[:, 0] = count / grid.turns
    out[:, 1] = inverse[0].sum(axis=1) / np.maximum(count, 1)
    out[:, 2] = margin[0].max(axis=1)
    out[:, 3] = np.fmin.reduce(singularity[0], axis=1)
    return out


def centre(robot: Robot) -> Array:
    """Return T_base_tool (4, 4) in the posture `home`, else in the first posture, else in the rest poses."""
    return robot.loops.forward(_home(robot))


def _home(robot: Robot) -> Array:
    """Return the joint values (n,) of the posture `home`, else of the first posture, else of the rest poses."""
    names = [n for n in ("home", *robot.mechanism.postures) if n in robot.mechanism.postures]
    return robot.mechanism.posture(names[0]) if names else robot.loops.q


def box(robot: Robot, T: Array, tilt: float = 0.0, turns: int = 1) -> tuple[Array, Array]:
    """Return the lower and the upper corner (3,) in m, in base, of a box around all reached positions.

    The search starts at the position of T (4, 4); the central orientation is that of T.

    Raises:
        UnreachedError: no position near the pose is reached.
    """
    half, middle = _START, T[:3, 3]
    while True:
        p, step = _reached(robot, middle - half, middle + half, T, tilt, turns)
        if half >= _FARTHEST or (len(p) and (np.abs(p - middle) < half - 0.5 * step).all()):
            break
        half *= 2
    if not len(p):
        raise UnreachedError(
            f"{robot.name}: with the tool's orientation in posture home, the tool reaches no position within {half:g} "
            "m of its position there; allow other orientations (--tilt-deg), or sample joint values (--joints)"
        )
    low, high = p.min(axis=0) - 2 * step, p.max(axis=0) + 2 * step
    for _ in range(_GROWN):  # repeat on a finer grid: a coarse grid misses thin regions
        p, step = _reached(robot, low, high, T, tilt, turns)
        touched = (p.min(axis=0) < low + step) | (p.max(axis=0) > high - step)
        low, high = p.min(axis=0) - 2 * step, p.max(axis=0) + 2 * step
        if not touched.any():
            break
    return low, high


def _reached(robot: Robot, low: Array, high: Array, T: Array, tilt: float, turns: int) -> tuple[Array, float]:
    """Return (reached positions (k, 3), step) of a coarse grid between two corners, in m."""
    step = float((high - low).max() / (_COARSE - 1))
    nx, ny, nz = (int(n) for n in np.ceil((high - low) / step - 1e-9) + 1)
    grid = Grid(low, step, (nx, ny, nz), T[:3, :3], tilt, turns)
    values = evaluate(judge(robot, grid), grid, 0, grid.positions)
    return grid.position(np.flatnonzero(values[:, 0] > 0)), step


@lru_cache(maxsize=4)
def _judge_of(source: str, protocol: str | None, packed: bytes) -> tuple[PoseKernel, Grid]:
    robot = load(source)
    if protocol or robot.mechanism.trocars:
        robot = robot.bound(robot.protocol(protocol))
    grid = pickle.loads(packed)
    return judge(robot, grid), grid


def _remote(source: str, protocol: str | None, packed: bytes, first: int, last: int) -> np.ndarray:
    """Evaluate a chunk of positions; called in a worker process, which caches the kernel for its next chunk."""
    return evaluate(*_judge_of(source, protocol, packed), first, last)


def workspace(
    robot: Robot,
    grid: Grid,
    store: Callable[[tuple[int, int]], np.ndarray] = lambda shape: np.zeros(shape, np.float32),
    progress: Callable[[str, float], None] = lambda label, fraction: None,
    *,
    client: Client | None = None,
    source: str = "",
    protocol: str | None = None,
) -> Workspace:
    """Return the workspace of a robot on a grid, computed with all processors of this machine or by a cluster.

    Args:
        robot: a robot with a closed-form inverse.
        grid: the positions and orientations to evaluate.
        store: function from a shape (positions, 4) to the array for the results, in memory or on disk.
        progress: called with a text on the current activity and the fraction done.
        client: client of a cluster; None: this machine.
        source: name or path by which the cluster's workers load the robot.
        protocol: name of the protocol that sets the trocar positions, or None.

    Raises:
        KinematicsError: the equations have no closed-form inverse.
    """
    values = store((grid.positions, len(COLUMNS)))
    if client is not None:
        parts, packed = list(chunks(grid)), pickle.dumps(grid)
        tasks = [(source, protocol, packed, *part) for part in parts]
        for done, (i, result) in enumerate(each(client, _remote, tasks)):
            values[parts[i][0] : parts[i][1]] = result
            progress(f"{grid.poses:.3g} poses", (done + 1) / len(parts))
        return Workspace(robot.name, grid, values, limit_facts(robot, passive_check(robot)))
    kernel = judge(robot, grid)
    for first, last in chunks(grid):
        values[first:last] = evaluate(kernel, grid, first, last)
        progress(f"{grid.poses:.3g} poses", last / grid.positions)
    return Workspace(robot.name, grid, values, limit_facts(robot, passive_check(robot)))
