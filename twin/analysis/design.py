"""Vary parameters and distances of a robot, and evaluate workspace and accuracy of each resulting design.

A factor is a varied quantity: a parameter of the equations, or the distance between two joints on one body of the
mechanism. The name of a distance is `body:joint-joint`; a change of the distance moves the second joint along the line
between the joints. Each design is evaluated independently, so that the work can be distributed, stopped and resumed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from twin.analysis.error_propagation import ErrorPropagation, Spread
from twin.analysis.grid_workspace import centre, shared_bounds
from twin.analysis.pose_grid import PoseGrid
from twin.analysis.workspace_result import volume_error
from twin.api.robot import Robot
from twin.api.robot_loading import load
from twin.core import spatial
from twin.core.compute_device import Choice, computing_on
from twin.core.errors import TwinError, unknown
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.units import DEG, MM, UM
from twin.kinematics import Kinematics
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism

OBJECTIVES = {
    "volume": ("dm³", +1, "volume of the positions reached in the home orientation"),
    "conditioning": ("", +1, "mean inverse condition number over the positions reached in the home orientation"),
    "margin": ("", +1, "mean margin to the nearest joint limit (0 at the limit, 1 in the middle of the range)"),
    "tolerance": (
        "µm",
        -1,
        "95th-percentile position error at home; standard deviations: joint frames 10 µm and 0.001°, "
        "encoders 1 µm or 0.001°",
    ),
}
"""Objectives by name: (unit, +1 if larger values are better or -1 if smaller values are better, description)."""

POSITIONS = 27_000
"""Number of tool positions from which the step of the grid follows; the grid has whole steps, so about as many."""

_DESIGNS = 10_000_000
"""Maximum number of designs of a sweep, all of which are held in memory."""

_SMALLEST_DISTANCE = 1e-9
"""Distance in m below which two joints count as being at one point."""

_PARALLEL = 1e-6
"""Sine of the angle between two pins below which they count as parallel."""

_BOX_MARGIN = 0.1
"""Margin of the grid on each side, as a share of the extent of the workspace of the CAD's design."""

_TOLERANCE_ERRORS = Spread(10 * UM, 0.001 * DEG, 1 * UM, 0.001 * DEG)
"""Standard deviations of the objective "tolerance", as its description states them."""

_LENGTHS = {"m": 1.0, "mm": MM, "um": UM, "µm": UM}
"""{unit of a length: its size in m}."""

_ANGLES = {"rad": 1.0, "deg": DEG}
"""{unit of an angle: its size in rad}."""

_UNITS = {**_LENGTHS, **_ANGLES, "": 1.0}
"""{unit of a factor: its size in SI units}; "": a number without a unit."""


@dataclass(frozen=True)
class Factor:
    """A quantity that is varied over a range.

    Attributes:
        name: name of a parameter, or `body:joint-joint`.
        low, high: range in SI units.
        unit: display unit.
        drawn: value of the quantity in the CAD, in SI units.
    """

    name: str
    low: float
    high: float
    unit: str
    drawn: float

    @property
    def scale(self) -> float:
        """Number by which a value in `unit` is multiplied to convert it to SI units."""
        return _UNITS[self.unit]


@dataclass(frozen=True)
class DesignJob:
    """All data that a worker needs to evaluate a design.

    Attributes:
        source: name or path of the robot.
        protocol: name of the protocol that sets the trocar position, or None.
        factors: the factors to vary.
        objectives: names of the objectives to evaluate.
        low, step, shape: grid of positions, see `PoseGrid`; `low` and `step` in m.
        R: (3, 3) orientation of the tool at all positions.
        inputs: (name, content) of what the results depend on besides: hashes of the robot's files, places of trocars.
    """

    source: str
    protocol: str | None
    factors: tuple[Factor, ...]
    objectives: tuple[str, ...]
    low: tuple[float, float, float]
    step: float
    shape: tuple[int, int, int]
    R: tuple[tuple[float, ...], ...]
    inputs: tuple[tuple[str, str], ...] = ()


def parse_factor(robot: Robot, text: str) -> Factor:
    """Return the factor for the text NAME=LOW..HIGH[unit].

    Without a unit, the unit is that of the parameter, or mm for a distance of the mechanism.

    Raises:
        TwinError: the text does not have this form, the name does not exist, or the unit does not fit the parameter.
    """
    name, equals, range_ = text.partition("=")
    low, dots, high = range_.partition("..")
    digits = high.rstrip("abcdefghijklmnopqrstuvwxyzµ")
    unit = high[len(digits) :].strip()
    try:
        start = float(low)
        end = float(digits)
    except ValueError:
        start = np.nan
        end = np.nan
    if not (equals and dots and np.isfinite(start) and np.isfinite(end)):
        raise TwinError(f"--vary '{text}': write NAME=LOW..HIGH with a unit, as in l_p=120..150mm")
    if unit not in _UNITS:
        known_units = [*_LENGTHS, *_ANGLES]
        raise TwinError(f"--vary '{text}': {unknown('unit', unit, known_units)}")
    if not start < end:
        raise TwinError(f"--vary '{text}': the lower value {start:g} must be below the upper value {end:g}")
    if _is_distance(name):
        drawn_value = distance(robot.mechanism, name)
        stated_unit = "mm"
    else:
        parameters = {parameter.name: parameter for parameter in robot.formula.parameters}
        if name not in parameters:
            raise TwinError(f"--vary: {unknown('parameter', name, parameters)}; a distance is written body:joint-joint")
        drawn_value = float(parameters[name].value)
        stated_unit = parameters[name].unit
    if not unit and stated_unit in _UNITS:
        unit = stated_unit
    for kind, units in (("length", _LENGTHS), ("angle", _ANGLES)):
        if stated_unit in units and unit not in units:
            raise TwinError(f"--vary '{text}': {name} is given in {stated_unit}; '{unit}' is not a unit of {kind}")
    if unit and stated_unit not in _LENGTHS and stated_unit not in _ANGLES:
        raise TwinError(f"--vary '{text}': {name} is neither a length nor an angle; leave out '{unit}'")
    scale = _UNITS[unit]
    return Factor(name, low=start * scale, high=end * scale, unit=unit, drawn=drawn_value)


def _is_distance(name: str) -> bool:
    """Return whether a factor is a distance of the mechanism, `body:joint-joint`."""
    return ":" in name


def distance_names(factors: Sequence[Factor]) -> list[str]:
    """Return the names of the factors that are distances of the mechanism, and not parameters of the equations."""
    return [factor.name for factor in factors if _is_distance(factor.name)]


def distance(mechanism: Mechanism, name: str) -> float:
    """Return the distance in m with the name `body:joint-joint`.

    It is measured perpendicular to the axes of revolute and cylindrical joints; if the axes of two such joints are not
    parallel, it is that between the origins of the joint frames.
    """
    return float(np.linalg.norm(_between(mechanism, name)[0]))


def stretched(mechanism: Mechanism, name: str, value: float) -> Mechanism:
    """Return the mechanism with the distance `name` set to `value` in m; the second joint of the name is moved."""
    line, joint, side = _between(mechanism, name)
    size = float(np.linalg.norm(line))
    if size < _SMALLEST_DISTANCE:
        raise TwinError(f"--vary {name}: both joints are at one point, so the direction of the distance is undefined")
    moved_frame = getattr(joint, side).copy()
    moved_frame[:3, 3] += line * (value / size - 1)
    joints = []
    for drawn_joint in mechanism.joints:
        if drawn_joint.name == joint.name:
            drawn_joint = replace(joint, **{side: moved_frame})
        joints.append(drawn_joint)
    return replace(mechanism, joints=tuple(joints))


def _between(mechanism: Mechanism, name: str) -> tuple[Array, Joint, str]:
    """Return (vector (3,) in m, in the body frame, from first to second joint; second joint; its frame attribute)."""
    body, _, pair = name.partition(":")
    first, dash, second = pair.partition("-")
    if not dash:
        raise TwinError(f"--vary '{name}': give BODY:JOINT-JOINT (a body and two joints)")
    mechanism.body(body)  # raises a clear error if there is no such body
    positions = []
    sides = []
    pins = []
    joints = (mechanism.joint(first), mechanism.joint(second))
    for joint in joints:
        if body not in (joint.parent, joint.child):
            raise TwinError(f"--vary '{name}': joint '{joint.name}' is not on body '{body}'")
        side = "T_child_joint"
        if joint.parent == body:
            side = "T_parent_joint"
        T_body_joint = getattr(joint, side)
        sides.append(side)
        positions.append(T_body_joint[:3, 3])
        if joint.type in ("revolute", "cylindrical"):
            pins.append(T_body_joint[:3, 2])
    line = positions[1] - positions[0]
    if pins and np.linalg.norm(np.cross(pins[0], pins[-1])) < _PARALLEL:  # a shift along parallel pins has no effect
        line = line - (line @ pins[0]) * pins[0]
    return line, joints[1], sides[1]


def design_job(
    robot: Robot, source: str, protocol: str | None, factors: Sequence[Factor], objectives: Sequence[str]
) -> DesignJob:
    """Return the job, with a grid that is 20 % larger in each direction than the workspace of the CAD's design.

    Raises:
        TwinError: an objective does not exist, or depends on none of the factors.
    """
    from twin.analysis.grid_workspace import UnreachedError, box

    for name in objectives:
        if name not in OBJECTIVES:
            raise TwinError(f"--objective: {unknown('objective', name, OBJECTIVES)}")
    varied = distance_names(factors)
    if varied and set(objectives) - {"tolerance"}:
        raise TwinError(
            f"--vary '{varied[0]}' is a distance of the mechanism and affects only the objective 'tolerance'; for "
            "other objectives, vary a parameter of the equations"
        )
    if len(varied) < len(factors) and "tolerance" in objectives:
        raise TwinError(
            "--objective tolerance depends on the mechanism only, not on parameters of the equations; vary a "
            "distance of the mechanism (body:joint-joint)"
        )
    inputs = _inputs(robot, source)
    if set(objectives) == {"tolerance"}:
        return DesignJob(
            source,
            protocol=protocol,
            factors=tuple(factors),
            objectives=tuple(objectives),
            low=(0.0, 0.0, 0.0),
            step=1.0,
            shape=(1, 1, 1),
            R=(),
            inputs=inputs,
        )
    T = centre(robot)
    try:
        low, high = box(robot, T)
    except UnreachedError:
        raise UnreachedError(
            f"{robot.name}: volume, conditioning and margin of a design are evaluated at positions in all three "
            "directions in the home orientation, of which the tool reaches none beside home, as in a planar robot; "
            "vary a distance of the mechanism (body:joint-joint), which is evaluated by tolerance"
        ) from None
    # other designs may reach farther; all are counted on one grid, so that their volumes can be compared
    margin = _BOX_MARGIN * (high - low)
    low = low - margin
    high = high + margin
    step = float(np.prod(high - low) / POSITIONS) ** (1 / 3)
    nx, ny, nz = (np.floor((high - low) / step).astype(int) + 1).tolist()
    x, y, z = low.tolist()
    # Plain numbers, because a job is hashed as JSON.
    R = tuple(map(tuple, T[:3, :3].tolist()))
    return DesignJob(
        source,
        protocol=protocol,
        factors=tuple(factors),
        objectives=tuple(objectives),
        low=(x, y, z),
        step=step,
        shape=(nx, ny, nz),
        R=R,
        inputs=inputs,
    )


def _inputs(robot: Robot, source: str) -> tuple[tuple[str, str], ...]:
    """Return (name, content) of what a design depends on besides the job; results of a robot that was edited differ."""
    inputs = list(robot.hashes().items())
    file = Path(source)
    if file.is_file():  # a robot of one file, such as a URDF, has no other hashes
        inputs.append((file.name, hashlib.sha256(file.read_bytes()).hexdigest()))
    for name, position in robot.mechanism.trocar_places.items():
        x, y, z = position
        inputs.append((f"trocar {name}", f"{x:.9g}, {y:.9g}, {z:.9g} m"))
    return tuple(inputs)


def sample_designs(factors: Sequence[Factor], samples: int, levels: int | None, seed: int) -> Array:
    """Return designs (k, factors) in SI units: the CAD's design, then a grid of `levels` or else a Latin hypercube.

    Raises:
        TwinError: there are more than `_DESIGNS` designs.
    """
    from scipy.stats import qmc

    count = levels ** len(factors) if levels else samples
    if count > _DESIGNS:
        option = "--grid" if levels else "--samples"
        raise TwinError(f"{option}: {count} designs; the limit is {_DESIGNS}: give fewer, or vary fewer quantities")
    ranges = np.array([(factor.drawn, factor.low, factor.high) for factor in factors])
    drawn_design = ranges[None, :, 0]
    low = ranges[:, 1]
    high = ranges[:, 2]
    if levels:
        steps = np.linspace(low, high, levels)  # (levels, factors)
        axes = np.meshgrid(*steps.T, indexing="ij")
        return np.concatenate([drawn_design, np.stack(axes, axis=-1).reshape(-1, len(factors))])
    sampler = qmc.LatinHypercube(len(factors), rng=np.random.default_rng(seed))
    cube = sampler.random(samples)
    return np.concatenate([drawn_design, low + cube * (high - low)])


@lru_cache(maxsize=2)
def _robot(source: str, protocol: str | None) -> Robot:
    """Load a robot once in each worker."""
    robot = load(source)
    if protocol or robot.mechanism.trocars:
        return robot.bound(robot.protocol(protocol))
    return robot


def evaluate(job: DesignJob, design: Sequence[float]) -> dict[str, float]:
    """Return the objectives of one design by name, in the units of `OBJECTIVES`.

    All objectives are NaN if the design cannot be assembled.
    """
    robot = _robot(job.source, job.protocol)
    factor_values = {}
    for factor, value in zip(job.factors, design, strict=True):
        factor_values[factor.name] = float(value)
    results: dict[str, float] = {}
    if "tolerance" in job.objectives:
        results["tolerance"] = _tolerance(robot.mechanism, factor_values)
    if set(job.objectives) - {"tolerance"}:
        results |= _reach(job, robot, factor_values)
    return {name: results[name] for name in job.objectives}  # in the order of the request


def evaluate_on(job: DesignJob, design: Sequence[float], device: Choice) -> tuple[dict[str, float], str]:
    """Return the objectives of one design, as `evaluate` does, and what has computed them (`ComputeDevice.name`)."""
    with computing_on(device) as computing:
        results = evaluate(job, design)
    return results, computing.name


def _tolerance(mechanism: Mechanism, lengths: dict[str, float]) -> float:
    """Return the objective "tolerance" of a mechanism with these distances in m; NaN if it cannot be assembled."""
    try:
        for name, length in lengths.items():
            mechanism = stretched(mechanism, name, length)
        tolerances = ErrorPropagation(mechanism, _TOLERANCE_ERRORS)
        budget = tolerances.budget("home", tolerances.solver.q)
    except TwinError:
        return float("nan")
    return budget.within[0] / UM


def grid_error(job: DesignJob) -> float:
    """Return the uncertainty, in dm3, that the grid step causes in the workspace volume of the CAD's design."""
    _, _, reached = _grid_states(job, _robot(job.source, job.protocol).kinematics())
    nx, ny, nz = job.shape
    return volume_error(reached.reshape(nz, ny, nx), _cell(job))


def _cell(job: DesignJob) -> float:
    """Return the volume of a grid cell in dm³."""
    return (job.step / 0.1) ** 3


def _grid_states(job: DesignJob, kin: Kinematics) -> tuple[Array, Array, np.ndarray]:
    """Return (poses (k, 4, 4) of the grid, joints (k, n) at these poses, whether each pose is reached (k,))."""
    robot = _robot(job.source, job.protocol)
    R = np.array(job.R)
    grid = PoseGrid(np.array(job.low), job.step, job.shape, R)
    Ts = spatial.pose(R, grid.position(np.arange(grid.positions)))
    with np.errstate(all="ignore"):
        q = kin.inverse_many(Ts)
        low, high = robot.mechanism.limits.T
        reached = ((q >= low) & (q <= high)).all(axis=1)  # NaN, out of reach, is within no limits
        for bound in shared_bounds(robot):
            reached &= q @ bound.weights >= bound.least
        if kin.formula.aspects:
            preferred = np.sign([aspect.preferred for aspect in kin.formula.aspects])
            reached &= (kin.aspect_signs(Ts, q) == preferred).all(axis=1)
    return Ts, q, np.asarray(reached)


def _reach(job: DesignJob, robot: Robot, parameters: dict[str, float]) -> dict[str, float]:
    """Return the objectives that depend on the reached positions; NaN if the equations refuse the parameters."""
    try:
        kin = robot.kinematics(parameters=parameters)
    except TwinError:
        return dict.fromkeys(("volume", "conditioning", "margin"), float("nan"))
    Ts, q, reached = _grid_states(job, kin)
    if not reached.any():
        return dict.fromkeys(("volume", "conditioning", "margin"), 0.0)
    low, high = robot.mechanism.limits.T
    span = high - low
    with np.errstate(all="ignore"):
        relative_margins = 2 * np.minimum(q - low, high - q) / span
        margins = np.where(np.isfinite(span), relative_margins, 1.0)
        condition = kin.condition_many(Ts[reached], q[reached])
    return {
        "volume": float(reached.sum() * _cell(job)),
        "conditioning": float(np.mean(1 / condition)),
        "margin": float(margins[reached].min(axis=1).mean()),
    }


def pareto(rows: Array, directions: Sequence[int]) -> np.ndarray:
    """Return (k,) bool: whether each row of objectives (k, n) is Pareto-optimal; a row with a NaN never is.

    `directions` (n,) is 1 for objectives that are better if larger, and -1 for objectives that are better if smaller.
    """
    gains = rows * np.array(directions)  # larger is better
    is_feasible = np.isfinite(gains).all(axis=1)
    others = gains[is_feasible]
    optimal = np.zeros(len(rows), bool)
    for i in np.flatnonzero(is_feasible):
        # A design dominates another if it is nowhere worse, and better in at least one objective.
        dominating = (others >= gains[i]).all(axis=1) & (others > gains[i]).any(axis=1)
        optimal[i] = not dominating.any()
    return optimal


def table_row(job: DesignJob, number: int, design: Sequence[float], objectives: dict[str, float]) -> JsonObject:
    """Return one row of the table of designs, with the factors in their display units."""
    cells: JsonObject = {"design": number}
    for factor, value in zip(job.factors, design, strict=True):
        cells[_column_head(factor.name, factor.unit)] = value / factor.scale
    for name, value in objectives.items():
        unit, _, _ = OBJECTIVES[name]
        cells[_column_head(name, unit)] = value
    return cells


def _column_head(name: str, unit: str) -> str:
    """Return the head of a column: a name with its unit, if it has one."""
    if unit:
        return f"{name} [{unit}]"
    return name
