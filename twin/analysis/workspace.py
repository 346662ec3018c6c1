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
from twin.core import compute_device
from twin.core.compute_device import PROCESSOR, Choice
from twin.core.errors import KinematicsError, TwinError
from twin.core.findings import Finding
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.result import Part, Result
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.formula import symbolic
from twin.kinematics.closed_loops.bounds import Bound, bounds_of
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

_START = 0.1
_FARTHEST = 12.8
"""Half the edge length, in m, of the first box and of the largest box in the search for reached positions."""

_COARSE = 32
"""Number of positions along the longest edge in the search for the box."""

_GROWN = 5
"""Maximum number of refinements of the box."""


class UnreachedError(TwinError):
    """No position of a grid is reached in any of the grid's orientations."""


@dataclass(frozen=True)
class PoseGrid:
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
        return tuple([axis for axis in range(3) if self.shape[axis] > 1])

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
        p = []
        for low, k in zip(self.low, index, strict=True):
            p.append(float(low) + self.step * k)
        R = ca.SX(self.R_base_tool)
        if self.turns > 1 and self.tilt:
            turn = i - self.turns * place
            parts = [turn / measure.ROOT**k for k in (1, 2, 3)]
            w = []
            for part in parts:
                # The fractional part is shifted by a half: the first orientation, with part 0, is not rotated.
                w.append(2 * self.tilt * (part + 0.5 - ca.floor(part + 0.5) - 0.5))
            R = symbolic.exp_so3(ca.vertcat(*w)) @ R
        upper = ca.horzcat(R, ca.vertcat(*p))
        return ca.vertcat(upper, ca.SX([[0, 0, 0, 1]]))


@dataclass(frozen=True)
class CellMeasure:
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
        if what:
            return f"{self.name}_{what}_{self.unit}"
        return f"{self.name}_{self.unit}"


_MEASURES = {
    3: CellMeasure("volume", "dm3", "dm³", 0.1, 3),
    2: CellMeasure("area", "cm2", "cm²", 0.01, 2),
    1: CellMeasure("length", "mm", "mm", MM, 1),
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
    grid: PoseGrid
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
    def measure(self) -> CellMeasure | None:
        """The measured quantity; None for a point, and for a curve or surface that is not parallel to the axes."""
        return _MEASURES.get(self.dimension) if self.dimension == len(self.grid.axes) else None

    def content(self) -> JsonObject:
        """Return the size, fractions, condition numbers and limits of the workspace as plain data.

        The size is a volume in dm3, an area in cm2 if all positions are in one plane parallel to two axes of base, or a
        length in mm if all positions are on a line parallel to an axis. For other surfaces and curves, the size is
        None.
        """
        grid = self.grid
        reached = self.reached
        good = self.values[reached]
        share = good[:, 0].astype(float)
        inverse = good[:, 1].astype(float)
        low = np.full(3, np.nan)
        high = np.full(3, np.nan)
        mean_share = 0.0
        best_mm = None
        if len(good):
            positions = grid.position(np.flatnonzero(reached))
            low = positions.min(axis=0)
            high = positions.max(axis=0)
            mean_share = float(share.mean())
            best = np.argmax(np.where(reached, self.values[:, 1], -1))
            best_mm = (grid.position(np.array([best]))[0] / MM).tolist()
        conditioning = None
        condition_quantiles: dict[str, float] = {}
        if inverse.any():  # without equations, there are no condition numbers
            conditioning = float(np.average(inverse, weights=share))
            condition_quantiles = _quantiles(inverse)
        return {
            "robot": self.robot,
            "poses": grid.poses,
            "positions": grid.positions,
            "orientations": grid.turns,
            "tilt_deg": grid.tilt / DEG,
            "step_mm": float(grid.step / MM),
            "dimension": self.dimension,
            **self._size(share),
            "share_of_orientations": mean_share,
            "global_conditioning_index": conditioning,
            "inverse_condition_quantiles": condition_quantiles,
            "limit_margin_quantiles": _quantiles(good[:, 2].astype(float)),
            "smallest_singularity_measure": _least(good[:, 3]),
            "box_mm": {"low": (low / MM).tolist(), "high": (high / MM).tolist()},
            "best_position_mm": best_mm,
            **self.facts,
        }

    def _size(self, share: np.ndarray) -> dict[str, float | None]:
        """Return the size and its error; `share` (k,) is the reached fraction of orientations at reached positions."""
        volume_keys = ("volume_dm3", "volume_error_dm3", "volume_every_orientation_dm3")
        sizes: dict[str, float | None] = dict.fromkeys(volume_keys)
        measure = self.measure
        if measure is None:
            return sizes
        cell = measure.cell(self.grid.step)
        reached = self.cube[..., 0] > 0
        error = volume_error(reached, cell)
        if self.facts.get("sampled"):
            # A sampled cell counts if any part is reached: on average half a cell too much at each face of the
            # boundary.
            faces = 0
            for axis in self.grid.axes:
                faces += int(np.diff(reached, axis=axis).sum())
            error += 0.5 * cell * faces
        sizes[measure.key()] = float(cell * len(share))
        sizes[measure.key("error")] = error
        sizes[measure.key("every_orientation")] = float(cell * (share == 1).sum())
        return sizes

    @property
    def key_figures(self) -> tuple[tuple[str, str, str], ...]:
        """Size with its error, best position, conditioning, and what is not checked."""
        content = self.content()
        figures: list[tuple[str, str, str]] = []
        measure = self.measure
        if measure is not None:
            error = float(f"{content[measure.key('error')]:.1g}")
            size = f"{content[measure.key()]:.4g} {measure.symbol}"
            figures.append(("Reached by the tool", size, f"± {error:g} {measure.symbol} by counting cells"))
        if content["best_position_mm"] is not None:
            position = ", ".join(f"{x:.0f}" for x in content["best_position_mm"])
            figures.append(("Best position x, y, z", f"{position} mm", "largest inverse condition number"))
        conditioning = content["global_conditioning_index"]
        if conditioning is not None:
            figures.append(("Inverse condition, mean", f"{conditioning:.3f}", "0 singular, 1 isotropic"))
        figures.append(("Not checked", "collisions", "and what the list below names"))
        return tuple(figures)

    def text(self) -> Iterator[Part]:
        """Yield the size, condition numbers, margins and the best position."""
        content = self.content()
        yield f"{self.robot} · {_evaluated(content)} · cells of {content['step_mm']:.3g} mm"
        yield ""
        yield f"  reached           {self._size_text(content)} in x, y, z = {_box_text(content)} mm"
        measure = self.measure
        if self.grid.turns > 1 and measure is not None:
            size = content[measure.key("every_orientation")]
            yield f"  every orientation {size:.4g} {measure.symbol} are reached in every orientation"
        conditioning = content["global_conditioning_index"]
        if conditioning is not None:
            quantiles = _listed(content["inverse_condition_quantiles"], digits=3)
            yield f"  inverse condition mean {conditioning:.3f} (quantiles {quantiles})"
        quantiles = _listed(content["limit_margin_quantiles"], digits=2)
        yield f"  joint limits      margin (0 at a limit, 1 in the middle of the range), quantiles {quantiles}"
        if content.get("without_limits"):
            names = ", ".join(content["without_limits"])
            yield f"                    {names}: no limits are stated; -180° to 180° is assumed"
        singularity = content["smallest_singularity_measure"]
        if singularity is not None:
            yield f"  singularity       smallest measure {singularity:.3g}"
        if content["best_position_mm"] is not None:
            position = ", ".join(f"{x:.0f}" for x in content["best_position_mm"])
            reason = " (largest inverse condition number)" if conditioning is not None else ""
            yield f"  best position     {position} mm{reason}"
        if content.get("passive_limits_kept"):
            names = ", ".join(content["passive_limits_kept"])
            yield f"  passive joints    limits of {names} are kept"
        if content.get("passive_limits_unchecked"):
            names = ", ".join(content["passive_limits_unchecked"])
            reason = "the equations do not describe the mechanism of the CAD"
            yield f"  not checked       limits of the passive joints {names}: {reason}"
        if content.get("soft_limits_unchecked"):
            names = ", ".join(content["soft_limits_unchecked"])
            yield f"  not checked       soft limits of {names}, which only cause warnings"
        yield "  not checked       collisions"
        if content.get("device", PROCESSOR) != PROCESSOR:
            yield f"  computed by       {content['device']}"
        yield ""

    def _size_text(self, content: JsonMapping) -> str:
        measure = self.measure
        if measure is None:
            return f"{_SETS[self.dimension]}, whose size is not computed,"
        error = float(f"{content[measure.key('error')]:.1g}")  # one digit, without an exponent
        place = {2: " of a plane", 1: " of a line"}.get(self.dimension, "")
        return f"{content[measure.key()]:.4g} ± {error:g} {measure.symbol} (error of counting cells){place}"


def _evaluated(content: JsonMapping) -> str:
    """Return what was evaluated: joint samples, or positions and orientations."""
    if content.get("sampled") == "joints":
        return f"{content['samples']} joint positions, {100 * content['assembled']:.1f} % can be assembled"
    turns = content["orientations"]
    if turns == 1:
        return f"{content['poses']} positions in one orientation"
    return f"{content['positions']} positions in {turns} orientations within {content['tilt_deg']:g}° about each axis"


def _box_text(content: JsonMapping) -> str:
    box = content["box_mm"]
    ranges = []
    for low, high in zip(box["low"], box["high"], strict=True):
        ranges.append(f"{low:.0f} .. {high:.0f}")
    return ", ".join(ranges)


def _listed(quantiles: dict[str, float], digits: int) -> str:
    return ", ".join(f"{name}: {value:.{digits}f}" for name, value in quantiles.items())


def volume_error(cube: np.ndarray, cell: float) -> float:
    """Return the uncertainty of a volume computed by counting cells, about two standard deviations.

    The grid is split into eight interleaved grids with twice the step (four grids for one layer of cells). The result
    is the standard deviation of the volumes computed from these grids. It is about twice the standard deviation of the
    volume from the full grid, as measured on SILS with shifted grids of 6 to 32 mm.

    `cube` (nx, ny, nz) states whether each position is reached. `cell` is the volume of one cell; the result has the
    same unit.
    """
    starts = product(*[range(min(n, 2)) for n in cube.shape])
    counts = [cube[i::2, j::2, k::2].sum() for i, j, k in starts]
    return float(len(counts) * cell * np.std(counts))


def _quantiles(values: Array) -> dict[str, float]:
    if not len(values):
        return {}
    low, median, high = np.quantile(values, (0.05, 0.5, 0.95)).tolist()
    return {"5 %": low, "50 %": median, "95 %": high}


def _least(values: np.ndarray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite.min()) if len(finite) else None


def shared_bounds(robot: Robot) -> tuple[Bound, ...]:
    """Return the limits of a robot that involve several joints."""
    return measure.shared(bounds_of(robot.mechanism, robot.gaps))


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
    kin = robot.kinematics()
    T = centre(robot)
    if kin.closed_inverse:
        closes = measure.agree(kin, check, T)
    else:
        q = _home(robot)[None]
        Ts = kin.forward_many(q)
        closes = np.isfinite(Ts).all() and check.placed(q, Ts)[1].all()
    return check if closes else None


def limited_passive_joints(robot: Robot) -> list[str]:
    """Return the names of the passive joints with limits; a joint with several limits once."""
    names = [limit.joint.name for limit in passive_limits(robot.mechanism)]
    return list(dict.fromkeys(names))


def limit_facts(robot: Robot, passive: PassiveCheck | None) -> dict[str, list[str]]:
    """Return the names of passive joints whose limits are kept, and of joints with limits that are not checked."""
    kept: list[str] = []
    unchecked: list[str] = []
    soft = []
    if passive is None:
        unchecked = limited_passive_joints(robot)
    else:
        kept = limited_passive_joints(robot)
    for joint in robot.mechanism.active:
        if joint.soft_limits is None:
            continue
        low, high = joint.limits or (-np.inf, np.inf)
        soft_low, soft_high = joint.soft_limits
        if soft_low > low or soft_high < high:
            soft.append(joint.name)
    return {
        "passive_limits_kept": kept,
        "passive_limits_unchecked": unchecked,
        "soft_limits_unchecked": soft,
    }


def judge(robot: Robot, grid: PoseGrid) -> PoseKernel:
    """Return the function that decides which poses of a grid a robot can reach.

    Raises:
        KinematicsError: the robot's equations have no closed-form inverse.
    """
    kin = robot.kinematics()
    if not kin.closed_inverse:
        raise KinematicsError(
            f"{robot.name}: the equations have no closed-form inverse; a numerical inverse would take hours"
        )
    limits = robot.mechanism.limits
    return measure.kernel(kin, limits, grid.pose, bounds=shared_bounds(robot), passive=passive_check(robot))


def chunks(grid: PoseGrid) -> Iterator[tuple[int, int]]:
    """Yield (first position, last position + 1) of chunks of about `CHUNK` poses."""
    many = max(1, CHUNK // grid.turns)
    for first in range(0, grid.positions, many):
        yield first, min(first + many, grid.positions)


def evaluate(kernel: PoseKernel, grid: PoseGrid, first: int, last: int) -> np.ndarray:
    """Return the values (last - first, 4) float32, in the order of `COLUMNS`, of the positions first to last - 1."""
    indices = np.arange(first * grid.turns, last * grid.turns, dtype=np.float64)[None]
    *values, _ = kernel(indices)
    by_position = [value.reshape(last - first, grid.turns) for value in values]
    reached, inverse, margin, singularity = by_position
    count = reached.sum(axis=1)
    out = np.zeros((last - first, 4), np.float32)
    out[:, 0] = count / grid.turns
    out[:, 1] = inverse.sum(axis=1) / np.maximum(count, 1)
    out[:, 2] = margin.max(axis=1)
    out[:, 3] = np.fmin.reduce(singularity, axis=1)
    return out


def centre(robot: Robot) -> Array:
    """Return T_base_tool (4, 4) in the posture `home`, else in the first posture, else in the rest poses."""
    return robot.loops.forward(_home(robot))


def _home(robot: Robot) -> Array:
    """Return the joint values (n,) of the posture `home`, else of the first posture, else of the rest poses."""
    postures = robot.mechanism.postures
    if "home" in postures:
        return robot.mechanism.posture("home")
    if postures:
        first = next(iter(postures))
        return robot.mechanism.posture(first)
    return robot.loops.q


def box(robot: Robot, T: Array, tilt: float = 0.0, turns: int = 1) -> tuple[Array, Array]:
    """Return the lower and the upper corner (3,) in m, in base, of a box around all reached positions.

    The search starts at the position of T (4, 4); the central orientation is that of T.

    Raises:
        UnreachedError: no position near the pose is reached.
    """
    half = _START
    middle = T[:3, 3]
    while True:
        p, step = _reached(robot, middle - half, middle + half, T, tilt, turns)
        # The outermost positions of the box are not reached: all reached positions are inside.
        surrounded = len(p) > 0 and (np.abs(p - middle) < half - 0.5 * step).all()
        if surrounded or half >= _FARTHEST:
            break
        half *= 2
    if not len(p):
        raise UnreachedError(
            f"{robot.name}: with the tool's orientation in posture home, the tool reaches no position within {half:g} "
            "m of its position there; allow other orientations (--tilt-deg), or sample joint values (--joints)"
        )
    low = p.min(axis=0) - 2 * step
    high = p.max(axis=0) + 2 * step
    for _ in range(_GROWN):  # repeat on a finer grid: a coarse grid misses thin regions
        p, step = _reached(robot, low, high, T, tilt, turns)
        lowest = p.min(axis=0)
        highest = p.max(axis=0)
        touched = (lowest < low + step) | (highest > high - step)
        low = lowest - 2 * step
        high = highest + 2 * step
        if not touched.any():
            break
    return low, high


def _reached(robot: Robot, low: Array, high: Array, T: Array, tilt: float, turns: int) -> tuple[Array, float]:
    """Return (reached positions (k, 3), step) of a coarse grid between two corners, in m."""
    step = float((high - low).max() / (_COARSE - 1))
    # Without 1e-9, rounding could add a layer of positions beyond the upper corner.
    nx, ny, nz = (np.ceil((high - low) / step - 1e-9).astype(int) + 1).tolist()
    grid = PoseGrid(low, step, (nx, ny, nz), T[:3, :3], tilt, turns)
    values = evaluate(judge(robot, grid), grid, 0, grid.positions)
    return grid.position(np.flatnonzero(values[:, 0] > 0)), step


@lru_cache(maxsize=4)
def _judge_of(source: str, protocol: str | None, packed: bytes) -> tuple[PoseKernel, PoseGrid]:
    robot = load(source)
    if protocol or robot.mechanism.trocars:
        robot = robot.bound(robot.protocol(protocol))
    grid = pickle.loads(packed)
    return judge(robot, grid), grid


def _remote(
    source: str, protocol: str | None, packed: bytes, first: int, last: int, choice: Choice
) -> tuple[np.ndarray, str]:
    """Evaluate a chunk of positions; return the values, and what has computed them (`ComputeDevice.name`).

    This is called in a worker process, which caches the kernel for its next chunk.
    """
    with compute_device.computing_on(choice) as device:
        found = evaluate(*_judge_of(source, protocol, packed), first, last)
    return found, device.name


def workspace(
    robot: Robot,
    grid: PoseGrid,
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
    label = f"{grid.poses:.3g} poses"
    if client is not None:
        parts = list(chunks(grid))
        packed = pickle.dumps(grid)
        choice = compute_device.current().choice
        tasks = [(source, protocol, packed, first, last, choice) for first, last in parts]
        names: set[str] = set()
        for done, (i, (result, name)) in enumerate(each(client, _remote, tasks), 1):
            first, last = parts[i]
            values[first:last] = result
            names.add(name)
            progress(label, done / len(parts))
    else:
        kernel = judge(robot, grid)
        for first, last in chunks(grid):
            values[first:last] = evaluate(kernel, grid, first, last)
            progress(label, last / grid.positions)
        names = {compute_device.current().name}
    facts: JsonObject = {"device": ", ".join(sorted(names)), **limit_facts(robot, passive_check(robot))}
    return Workspace(robot.name, grid, values, facts)
