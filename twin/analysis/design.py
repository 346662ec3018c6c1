"""Vary parameters and distances of a robot, and evaluate workspace and accuracy of each resulting design.

A factor is a varied quantity: a parameter of the equations, or the distance between two joints on one body of the
mechanism. The name of a distance is `body:joint-joint`; a change of the distance moves the second joint along the line
between the joints. Each design is evaluated independently, so that the work can be distributed, stopped and resumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from twin.analysis.tolerance import Spread, Tolerances
from twin.analysis.workspace import Grid, centre, shared_bounds, volume_error
from twin.api.robot import Robot, load
from twin.core import spatial
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
"""Number of tool positions at which every design is evaluated."""

_SPREAD = Spread(10 * UM, 0.001 * DEG, 1 * UM, 0.001 * DEG)
_LENGTHS, _ANGLES = {"m": 1.0, "mm": MM, "um": UM, "µm": UM}, {"rad": 1.0, "deg": DEG}
_UNITS = {**_LENGTHS, **_ANGLES, "": 1.0}


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
class Job:
    """All data that a worker needs to evaluate a design.

    Attributes:
        source: name or path of the robot.
        protocol: name of the protocol that sets the trocar position, or None.
        factors: the factors to vary.
        objectives: names of the objectives to evaluate.
        low, step, shape: grid of positions, see `Grid`; `low` and `step` in m.
        R: (3, 3) orientation of the tool at all positions.
    """

    source: str
    protocol: str | None
    factors: tuple[Factor, ...]
    objectives: tuple[str, ...]
    low: tuple[float, float, float]
    step: float
    shape: tuple[int, int, int]
    R: tuple[tuple[float, ...], ...]


def factor(robot: Robot, text: str) -> Factor:
    """Return the factor for the text NAME=LOW..HIGH[unit].

    Without a unit, the unit is that of the parameter, or mm for a distance of the mechanism.

    Raises:
        TwinError: the text does not have this form, the name does not exist, or the unit does not fit the parameter.
    """
    name, mark, range_ = text.partition("=")
    low, dots, high = range_.partition("..")
    digits = high.rstrip("abcdefghijklmnopqrstuvwxyzµ")
    unit = high[len(digits) :].strip()
    try:
        ends = (float(low), float(digits))
    except ValueError:
        ends = (np.nan, np.nan)
    if not (mark and dots and np.isfinite(ends).all()):
        raise TwinError(f"--vary '{text}': write NAME=LOW..HIGH with a unit, as in l_p=120..150mm")
    if unit not in _UNITS:
        raise TwinError(f"--vary '{text}': {unknown('unit', unit, [u for u in _UNITS if u])}")
    if not ends[0] < ends[1]:
        raise TwinError(f"--vary '{text}': the lower value {ends[0]:g} must be below the upper value {ends[1]:g}")
    if ":" in name:
        drawn, own = distance(robot.mechanism, name), "mm"
    else:
        parameters = {p.name: p for p in robot.formula.parameters}
        if name not in parameters:
            raise TwinError(f"--vary: {unknown('parameter', name, parameters)}; a distance is written body:joint-joint")
        drawn, own = float(parameters[name].value), parameters[name].unit
    unit = unit or (own if own in _UNITS else "")
    for kind, units in (("length", _LENGTHS), ("angle", _ANGLES)):
        if own in units and unit not in units:
            raise TwinError(f"--vary '{text}': {name} is given in {own}; '{unit}' is not a unit of {kind}")
    return Factor(name, ends[0] * _UNITS[unit], ends[1] * _UNITS[unit], unit, drawn)


def distance(mechanism: Mechanism, name: str) -> float:
    """Return the distance in m with the name `body:joint-joint`; for parallel pins, the distance between their axes."""
    return float(np.linalg.norm(_between(mechanism, name)[0]))


def stretched(mechanism: Mechanism, name: str, value: float) -> Mechanism:
    """Return the mechanism with the distance `name` set to `value` in m; the second joint of the name is moved."""
    line, joint, side = _between(mechanism, name)
    size = float(np.linalg.norm(line))
    if size < 1e-9:
        raise TwinError(f"--vary {name}: both joints are at one point, so the direction of the distance is undefined")
    moved = getattr(joint, side).copy()
    moved[:3, 3] += line * (value / size - 1)
    changed = replace(joint, **{side: moved})
    return replace(mechanism, joints=tuple(changed if j.name == joint.name else j for j in mechanism.joints))


def _between(mechanism: Mechanism, name: str) -> tuple[Array, Joint, str]:
    """Return (vector (3,) in m, in the body frame, from first to second joint; second joint; its frame attribute)."""
    body, _, pair = name.partition(":")
    first, mark, second = pair.partition("-")
    if not mark:
        raise TwinError(f"--vary '{name}': give BODY:JOINT-JOINT (a body and two joints)")
    mechanism.body(body)
    ends = []
    for joint in (mechanism.joint(first), mechanism.joint(second)):
        if body not in (joint.parent, joint.child):
            raise TwinError(f"--vary '{name}': joint '{joint.name}' is not on body '{body}'")
        ends.append((joint, "T_parent_joint" if joint.parent == body else "T_child_joint"))
    a, b = (getattr(joint, side) for joint, side in ends)
    line = b[:3, 3] - a[:3, 3]
    axes = [T[:3, 2] for T, (joint, _) in zip((a, b), ends, strict=True) if joint.type in ("revolute", "cylindrical")]
    if axes and np.linalg.norm(np.cross(axes[0], axes[-1])) < 1e-6:  # a shift along parallel pins has no effect
        line = line - (line @ axes[0]) * axes[0]
    return line, *ends[1]


def job(robot: Robot, source: str, protocol: str | None, factors: Sequence[Factor], objectives: Sequence[str]) -> Job:
    """Return the job, with a grid that is 20 % larger in each direction than the workspace of the CAD's design.

    Raises:
        TwinError: an objective does not exist, or depends on none of the factors.
    """
    from twin.analysis.workspace import UnreachedError, box

    for name in objectives:
        if name not in OBJECTIVES:
            raise TwinError(f"--objective: {unknown('objective', name, OBJECTIVES)}")
    places = [f.name for f in factors if ":" in f.name]
    if places and set(objectives) - {"tolerance"}:
        raise TwinError(
            f"--vary '{places[0]}' is a distance of the mechanism and affects only the objective 'tolerance'; for "
            "other objectives, vary a parameter of the equations"
        )
    if len(places) < len(factors) and "tolerance" in objectives:
        raise TwinError(
            "--objective tolerance depends on the mechanism only, not on parameters of the equations; vary a "
            "distance of the mechanism (body:joint-joint)"
        )
    if set(objectives) == {"tolerance"}:
        return Job(source, protocol, tuple(factors), tuple(objectives), (0.0, 0.0, 0.0), 1.0, (1, 1, 1), ())
    T = centre(robot)
    try:
        low, high = box(robot, T)
    except UnreachedError:
        raise UnreachedError(
            f"{robot.name}: volume, conditioning and margin of a design are evaluated at positions in all three "
            "directions in the home orientation, of which the tool reaches none beside home, as in a planar robot; "
            "vary a distance of the mechanism (body:joint-joint), which is evaluated by tolerance"
        ) from None
    low, high = low - 0.1 * (high - low), high + 0.1 * (high - low)
    step = float(np.prod(high - low) / POSITIONS) ** (1 / 3)
    nx, ny, nz = (int(n) for n in np.floor((high - low) / step) + 1)
    x, y, z = (float(v) for v in low)
    R = tuple(tuple(float(v) for v in row) for row in T[:3, :3])
    return Job(source, protocol, tuple(factors), tuple(objectives), (x, y, z), step, (nx, ny, nz), R)


def values(factors: Sequence[Factor], samples: int, levels: int | None, seed: int) -> Array:
    """Return designs (k, factors) in SI units: the CAD's design, then a grid of `levels` or else a Latin hypercube."""
    from scipy.stats import qmc

    low, high = np.array([f.low for f in factors]), np.array([f.high for f in factors])
    drawn = np.array([[f.drawn for f in factors]])
    if levels:
        axes = np.meshgrid(*[np.linspace(a, b, levels) for a, b in zip(low, high, strict=True)], indexing="ij")
        return np.concatenate([drawn, np.stack([a.ravel() for a in axes], axis=1)])
    cube = qmc.LatinHypercube(len(factors), rng=np.random.default_rng(seed)).random(samples)
    return np.concatenate([drawn, low + cube * (high - low)])


@lru_cache(maxsize=2)
def _robot(source: str, protocol: str | None) -> Robot:
    robot = load(source)
    return robot.bound(robot.protocol(protocol)) if protocol or robot.mechanism.trocars else robot


def judge(work: Job, design: Sequence[float]) -> dict[str, float]:
    """Return the objectives of one design by name, in the units of `OBJECTIVES`.

    All objectives are NaN if the design cannot be assembled.
    """
    robot = _robot(work.source, work.protocol)
    out: dict[str, float] = {}
    named = {f.name: float(v) for f, v in zip(work.factors, design, strict=True)}
    if "tolerance" in work.objectives:
        mechanism = robot.mechanism
        try:
            for name, value in named.items():
                mechanism = stretched(mechanism, name, value)
            tolerances = Tolerances(mechanism, _SPREAD)
            out["tolerance"] = tolerances.budget("home", tolerances.solver.q).within[0] / UM
        except TwinError:
            out["tolerance"] = float("nan")
    if set(work.objectives) - {"tolerance"}:
        out |= _reach(work, robot, named)
    return {n: out[n] for n in work.objectives}


def grid_error(work: Job) -> float:
    """Return the uncertainty, in dm3, that the grid step causes in the workspace volume of the CAD's design."""
    _, _, good = _good(work, _robot(work.source, work.protocol).kinematics())
    nx, ny, nz = work.shape
    return volume_error(good.reshape(nz, ny, nx), (work.step / 0.1) ** 3)


def _good(work: Job, kin: Kinematics) -> tuple[Array, Array, np.ndarray]:
    """Return (poses (k, 4, 4) of the grid, joints (k, n) at these poses, whether each pose is reached (k,))."""
    robot = _robot(work.source, work.protocol)
    grid = Grid(np.array(work.low), work.step, work.shape, np.array(work.R))
    Ts = spatial.pose(np.array(work.R), grid.position(np.arange(grid.positions)))
    with np.errstate(all="ignore"):
        q = kin.inverse_many(Ts)
        limits = robot.mechanism.limits
        good = ((q >= limits[:, 0]) & (q <= limits[:, 1])).all(axis=1)
        for bound in shared_bounds(robot):
            good &= q @ bound.weights >= bound.least
        if kin.formula.aspects:
            preferred = np.sign([a.preferred for a in kin.formula.aspects])
            good &= (kin.aspect_signs(Ts, q) == preferred).all(axis=1)
    return Ts, q, np.asarray(good)


def _reach(work: Job, robot: Robot, parameters: dict[str, float]) -> dict[str, float]:
    try:
        kin = robot.kinematics(parameters=parameters)
    except TwinError:
        return dict.fromkeys(("volume", "conditioning", "margin"), float("nan"))
    Ts, q, good = _good(work, kin)
    limits = robot.mechanism.limits
    span = limits[:, 1] - limits[:, 0]
    with np.errstate(all="ignore"):
        near = np.where(np.isfinite(span), 2 * np.minimum(q - limits[:, 0], limits[:, 1] - q) / span, 1.0)
        condition = kin.condition_many(Ts[good], q[good])
    return {
        "volume": float(good.sum() * (work.step / 0.1) ** 3),
        "conditioning": float(np.mean(1 / condition)) if good.any() else 0.0,
        "margin": float(near[good].min(axis=1).mean()) if good.any() else 0.0,
    }


def pareto(rows: Array, directions: Sequence[int]) -> np.ndarray:
    """Return (k,) bool: whether each row of objectives (k, n) is Pareto-optimal; a row with a NaN never is.

    `directions` (n,) is 1 for objectives that are better if larger, and -1 for objectives that are better if smaller.
    """
    better = rows * np.array(directions)
    known = np.isfinite(better).all(axis=1)
    out = np.zeros(len(rows), bool)
    for i in np.flatnonzero(known):
        other = better[known]
        out[i] = not ((other >= better[i]).all(axis=1) & (other > better[i]).any(axis=1)).any()
    return out


def row(work: Job, number: int, design: Sequence[float], judged: dict[str, float]) -> JsonObject:
    """Return one row of the table of designs, with the factors in their display units."""
    names = [f"{f.name} [{f.unit}]" if f.unit else f.name for f in work.factors]
    shown = {n: v / f.scale for n, f, v in zip(names, work.factors, design, strict=True)}
    named = {f"{n} [{OBJECTIVES[n][0]}]" if OBJECTIVES[n][0] else n: v for n, v in judged.items()}
    return {"design": number, **shown, **named}
