"""Rows of joint values and tool poses against a robot: measured poses, or poses that equations compute.

Base and tool frames are always fitted, because whoever measures chooses them: T_row = X T(q) Y. What remains is
compared with the noise: that which the table states or, for a chain, what remains with every joint free (all zeros and
all places of joints). Stated noise must explain the whole remainder, and also the part that free joints would take from
it. If the remainder is larger, the fewest signs, zeros and places of joints that reduce it to the noise are searched;
they make another side of the table (`identified`), whose joint lines are compared with the robot's.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtr, chdtrc, fdtrc

from twin.comparison.fit import ANGLE_PER_LENGTH
from twin.comparison.properties import followed_of
from twin.comparison.side import ONE_COORDINATE, Axis, JointGroup, PoseRows, RobotSide, joint_motion, plain
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.quantity import moved
from twin.core.spatial import Array
from twin.core.units import DEG, MM

_SIGNIFICANCE = 1e-4
"""Probability of the remainder under noise alone below which it is no noise."""

_NEEDED = 4.0
"""A fitted number that is smaller than this multiple of its standard deviation is not needed."""

_SEARCHED = 400
"""Number of rows with which changes are searched; the chosen ones are fitted to all rows."""

_FLIPS = 2
"""Maximum number of joints that turn the other way."""

_CHANGES = 3
"""Maximum number of zeros and places of joints that are changed together."""

_TRIED = 6
"""Number of the most promising sets of signs, and of changes, that are fitted."""

_LARGEST_NOISE = 2e-3
"""Standard deviation of a coordinate in m above which an estimate is no noise: no few changes explain the rows."""

_FREEDOMS = 6
"""Fewest numbers of the rows beyond the unknowns with which noise is estimated."""

_CLOSED = 0.5
"""Smallest share of the rows at which the loops of a robot must close."""

_ROUNDS = 25
"""Maximum number of Gauss-Newton steps."""

_STEP = 1e-6
"""Step of the unknowns in m and rad for derivatives by differences."""

_MOVED = 0.01
"""Displacement in m or rad with which it is tried whether a joint moves the tool."""

_FOLLOWS = 1e-3
"""Largest distance in m or rad of a joint from the value that its coupling gives it."""

_FRAMES = 12
"""Number of unknowns of base and tool frame."""

_LEVER = 1.0 / ANGLE_PER_LENGTH
"""Length in m by which an angle in rad counts as much as a distance."""


@dataclass(frozen=True)
class PoseFit:
    """What rows of poses say about a robot.

    Attributes:
        rows: number of rows.
        base, tool: (4, 4) fitted frames: T_row = base T_base_tool(q) tool.
        rotations: whether rotations were compared.
        noise: (standard deviation of a coordinate in m, of an angle in rad); None without an estimate.
        stated: whether the table states the noise; else it is estimated from the rows.
        computed: whether the rows are computed by equations, so that they have no noise.
        distance, angle: largest remainder in m and rad after the fit of both frames.
        line: line of the table with the largest remainder; 0 for computed rows.
        agrees: whether the remainder is within the tolerance or the noise.
        uncertainty: largest standard deviation of the changes that explain the rows, in m; 0 without changes.
    """

    rows: int
    base: Array
    tool: Array
    rotations: bool
    noise: tuple[float, float] | None
    stated: bool
    computed: bool
    distance: float
    angle: float
    line: int
    agrees: bool
    uncertainty: float = 0.0

    def as_dict(self) -> JsonObject:
        """Return the fit as plain data, lengths in mm and angles in degrees."""
        noise = None
        if self.noise is not None:
            noise = {"length_mm": self.noise[0] / MM, "angle_deg": self.noise[1] / DEG, "stated": self.stated}
        return {
            "rows": self.rows,
            "computed": self.computed,
            "rotations": self.rotations,
            "base": self.base.tolist(),
            "tool": self.tool.tolist(),
            "noise": noise,
            "largest_mm": self.distance / MM,
            "largest_deg": self.angle / DEG,
            "line": self.line,
            "agrees": self.agrees,
            "uncertainty_mm": self.uncertainty / MM,
        }


@dataclass(frozen=True)
class PoseComparison:
    """The fit, the row (joints of the robot's side) with the largest remainder, and the side that the rows describe.

    `identified` is None if the robot has loops, or if no few changes explain the rows.
    """

    fit: PoseFit
    q: dict[str, float]
    identified: RobotSide | None
    tolerance: float


def compare_rows(rows: PoseRows, label: str, side: RobotSide, tolerance: float) -> PoseComparison:
    """Compare rows of poses with a robot.

    Args:
        rows: the rows.
        label: how the user named their side.
        side: the robot.
        tolerance: largest distance in m that is no difference.

    Raises:
        TwinError: the joints cannot be matched, or no row is in the range of the robot's joints.
    """
    rows = _without_followers(rows, label, side)
    q = _matched(rows, label, side)
    _require_range(rows, q, label, side)
    if side.tool_poses is not None:
        T = side.tool_poses(q)
        closed = np.asarray(np.isfinite(T).all(axis=(1, 2)))
        if closed.mean() < _CLOSED:
            text = f"{side.label}: its loops close at only {int(closed.sum())} of the {len(T)} states of {label}"
            raise TwinError(f"{text}. Correct the joint values, or the links of the loops")
        rows = rows.chosen(closed)
        q = q[closed]
        fitted = _Fixed(T[closed])
    else:
        fitted = _Chain(side, q)
    return _Comparison(rows, label, side, q, fitted, tolerance).result()


def _matched(rows: PoseRows, label: str, side: RobotSide) -> Array:
    """Return the joint values (k, joints) of the rows in the order of the driven joints of the robot's side.

    Joints that do not move the tool can be missing in the rows: their values are NaN.
    """
    order = side.order
    known = {plain(name): i for i, name in enumerate(rows.joints)}
    on_path = _driving(side)
    wanted = [name for name in order if name in on_path]
    missing = [name for name in wanted if plain(name) not in known]
    if side.tool_poses is not None:
        missing = [name for name in missing if _moves_tool(side, name)]
    driven_names = {plain(joint) for joint in order}
    extra = [name for name in rows.joints if plain(name) not in driven_names]
    columns: dict[str, int] = {}
    if not missing and not extra:
        columns = {name: known[plain(name)] for name in order if plain(name) in known}
    elif len(rows.joints) == len(wanted) == len(missing):
        columns = {name: i for i, name in enumerate(wanted)}
    else:
        stated = f"{label} has values of {len(rows.joints)} joints ({', '.join(rows.joints)})"
        needed = f"the tool of {side.label} is moved by {len(wanted)} ({', '.join(wanted)})"
        way_out = "Name the joints alike, or compare fewer with --only"
        passive = _passive(extra, side)
        if passive:
            way_out = f"Remove the columns of joints without a motor: {', '.join(passive)}"
        raise TwinError(f"the joints cannot be matched: {stated}, but {needed}. {way_out}")
    angles = {axis.name: axis.is_angle for axis in side.axes}
    q = np.full((len(rows.q), len(order)), np.nan)
    for i, name in enumerate(order):
        if name not in columns:
            continue
        column = columns[name]
        if name in angles and angles[name] != rows.angles[column]:
            kinds = ("a length", "an angle")
            stated = f"joint '{rows.joints[column]}' of {label} is {kinds[rows.angles[column]]}"
            known_kind = f"'{name}' of {side.label} is {kinds[angles[name]]}"
            way_out = "Correct the unit in the heading, or the order of the columns"
            raise TwinError(f"{stated}, but {known_kind}. {way_out}")
        q[:, i] = rows.q[:, column]
    return q


def _without_followers(rows: PoseRows, label: str, side: RobotSide) -> PoseRows:
    """Return the rows without the columns of joints that others move by a coupling, if they have the values of it.

    Raises:
        TwinError: a value is not that of the coupling.
    """
    if side.looped:
        return rows
    column = {plain(name): k for k, name in enumerate(rows.joints)}
    values = np.full((len(rows.q), len(side.axes)), np.nan)
    for i, axis in enumerate(side.axes):
        if plain(axis.name) in column:
            values[:, i] = rows.q[:, column[plain(axis.name)]]
    kept = list(range(len(rows.joints)))
    for i, (ratios, offset) in followed_of(side).items():
        name = side.axes[i].name
        moving = np.flatnonzero(ratios)
        if name in side.order or plain(name) not in column or np.isnan(values[:, moving]).any():
            continue
        followed = values[:, moving] @ ratios[moving] + offset
        gaps = np.abs(values[:, i] - followed)
        row = int(np.argmax(gaps))
        if gaps[row] > _FOLLOWS:
            stated = f"{name} = {values[row, i]:.6g}, but its coupling in {side.label} gives {followed[row]:.6g}"
            line = f":{rows.lines[row]}" if rows.lines else ""
            way_out = "Correct the value or the coupling, or remove the column"
            raise TwinError(f"{label}{line}: {stated} in rad or m (up to {_FOLLOWS:g} apart is allowed). {way_out}")
        kept.remove(column[plain(name)])
    joints = tuple(rows.joints[k] for k in kept)
    return replace(rows, joints=joints, angles=tuple(rows.angles[k] for k in kept), q=rows.q[:, kept])


def _passive(names: Sequence[str], side: RobotSide) -> list[str]:
    """Return which of the names are joints of the side without a motor."""
    undriven = {plain(axis.name) for axis in side.axes} - {plain(name) for name in side.order}
    return [name for name in names if plain(name) in undriven]


def _moves_tool(side: RobotSide, name: str) -> bool:
    """Return whether a driven joint of a robot with loops moves its tool."""
    assert side.tool_poses is not None
    states = np.full((2, len(side.order)), np.nan)
    states[1, side.order.index(name)] = side.axes[side.index(name)].drawn + _MOVED
    at_rest, displaced = side.tool_poses(states)
    return bool(np.abs(displaced - at_rest).max() > 1e-9) or not np.isfinite(displaced).all()


def _driving(side: RobotSide) -> set[str]:
    """Return the names of the driven joints that move the tool; of a robot with loops, all."""
    if side.tool_poses is not None or side.looped:
        return set(side.order)
    coupled = followed_of(side)
    names = set()
    for axis in _path(side):
        i = side.index(axis.name)
        if i not in coupled:
            names.add(axis.name)
            continue
        for leader in np.flatnonzero(np.abs(coupled[i][0]) > 1e-9):
            names.add(side.axes[leader].name)
    return names


def _path(side: RobotSide) -> list[Axis]:
    """Return the joints from the base to the tool."""
    above = {axis.child: axis for axis in side.tree}
    group = side.frames[side.tool][0]
    path = []
    while group in above:
        path.append(above[group])
        group = above[group].parent
    return path[::-1]


def _require_range(rows: PoseRows, q: Array, label: str, side: RobotSide) -> None:
    """Require that for each joint, one row is within its limits."""
    limits = {axis.name: axis.limits for axis in side.axes}
    for i, name in enumerate(side.order):
        stated = limits.get(name)
        values = q[:, i]
        if stated is None or not np.isfinite(values).all():
            continue
        if values.max() >= stated[0] and values.min() <= stated[1]:
            continue
        angle = next(axis.is_angle for axis in side.axes if axis.name == name)
        place = f"{label}:{rows.lines[0]}" if rows.lines else label
        raise TwinError(
            f"{place}: joint '{name}' has no common range: {moved(float(values.min()), angle)} .. "
            f"{moved(float(values.max()), angle)} in {label}, {moved(stated[0], angle)} .. {moved(stated[1], angle)} "
            f"in {side.label}. Correct the unit, the zero or the limits"
        )


class _Fixed:
    """Poses of a robot at the rows, of which only base and tool frame are fitted."""

    count = 0

    def __init__(self, T: Array) -> None:
        self.T = T

    def poses(self, signs: Array, zeros: Array, places: dict[int, Array]) -> Array:
        return self.T


class _Chain:
    """The joints from base to tool, whose zeros, signs and places can be changed."""

    def __init__(self, side: RobotSide, q: Array) -> None:
        self.side = side
        self.path = _path(side)
        self.count = len(self.path)
        column = {name: i for i, name in enumerate(side.order)}
        states = np.zeros((len(q), len(side.axes)))
        for i, axis in enumerate(side.axes):
            states[:, i] = axis.drawn
            if axis.name in column and np.isfinite(q[:, column[axis.name]]).all():
                states[:, i] = q[:, column[axis.name]]
        coupled = followed_of(side)
        self.values = np.zeros((len(q), self.count))
        self.own = np.zeros(self.count, bool)
        self.kept: dict[tuple[int, float], Array] = {}
        for k, axis in enumerate(self.path):
            if axis.kind not in ONE_COORDINATE:
                raise TwinError(
                    f"{side.label}: joint '{axis.name}' has several coordinates: rows of poses cannot hold it"
                )
            if axis.name in column and np.isfinite(q[:, column[axis.name]]).all():
                self.values[:, k] = q[:, column[axis.name]] - axis.drawn
                self.own[k] = True
                continue
            i = side.index(axis.name)
            if i in coupled:
                ratios, offset = coupled[i]
                self.values[:, k] = states @ ratios + offset - axis.drawn
        self.M = side.frames[side.tool][1]
        self.frames: list[Array] = []
        for axis in self.path:
            across = spatial.unit_across(axis.direction)
            self.frames.append(spatial.frame_from_axes(axis.direction, across))

    def place(self, k: int, values: Array) -> Array:
        """Return the motion (4, 4) of joint k on its parent link for a rotation vector and a shift in its frame."""
        frame = self.frames[k]
        R = spatial.exp_so3(frame @ values[:3])
        point = self.path[k].point
        return spatial.pose(R, point - R @ point + frame @ values[3:])

    def poses(self, signs: Array, zeros: Array, places: dict[int, Array]) -> Array:
        T = np.broadcast_to(np.eye(4), (len(self.values), 4, 4))
        for k in range(self.count):
            if k in places:
                T = T @ self.place(k, places[k])
            T = T @ self._motion(k, float(signs[k]), float(zeros[k]))
        return T @ self.M

    def _motion(self, k: int, sign: float, zero: float) -> Array:
        """Return the motions (rows, 4, 4) of a joint; those without a zero are kept, as they are needed most often."""
        if zero:
            return joint_motion(self.path[k], sign * self.values[:, k] + zero)
        if (k, sign) not in self.kept:
            self.kept[k, sign] = joint_motion(self.path[k], sign * self.values[:, k])
        return self.kept[k, sign]


_ZERO = 0
_PLACE = 1

Change = tuple[int, int]
"""(kind, joint of the path): a zero, or the place of a joint on its link."""


@dataclass
class _State:
    """Unknowns of a fit and its remainder.

    Attributes:
        signs: (joints,).
        changes: changed zeros and places.
        x: base (6), tool (6), then the values of the changes.
        free: (unknowns,) which of them are fitted.
        r: (rows * 3 or 6) remainder in units of the noise, or in m.
        J: its derivatives by the free unknowns.
    """

    signs: Array
    changes: tuple[Change, ...]
    x: Array
    free: NDArray[np.bool_]
    r: Array
    J: Array

    @property
    def sse(self) -> float:
        return float(self.r @ self.r)


class _Comparison:
    def __init__(
        self, rows: PoseRows, label: str, side: RobotSide, q: Array, model: _Fixed | _Chain, tolerance: float
    ) -> None:
        self.rows = rows
        self.label = label
        self.side = side
        self.q = q
        self.model = model
        self.tolerance = tolerance
        length = rows.noise[0]
        angle = rows.noise[1]
        self.stated = length is not None
        self.scale = length or 1.0
        self.lever = _LEVER
        if length is not None and angle is not None:
            self.lever = length / angle

    # -- remainder ------------------------------------------------------------------------------------

    def parts(self, x: Array, signs: Array, changes: Sequence[Change]) -> tuple[Array, Array]:
        """Return the shifts (k, 3) in m and rotation vectors (k, 3) in rad from the computed to the stated poses."""
        zeros = np.zeros(self.model.count)
        places: dict[int, Array] = {}
        start = _FRAMES
        for kind, joint in changes:
            if kind == _ZERO:
                zeros[joint] = x[start]
                start += 1
            else:
                places[joint] = x[start : start + 6]
                start += 6
        X = spatial.pose(spatial.exp_so3(x[:3]), x[3:6])
        Y = spatial.pose(spatial.exp_so3(x[6:9]), x[9:12])
        T = X @ self.model.poses(signs, zeros, places) @ Y
        shifts = T[:, :3, 3] - self.rows.T[:, :3, 3]
        if not self.rows.rotations:
            return shifts, np.zeros_like(shifts)
        turns = spatial.log_so3(np.swapaxes(self.rows.T[:, :3, :3], 1, 2) @ T[:, :3, :3])
        return shifts, turns

    def residual(self, x: Array, signs: Array, changes: Sequence[Change]) -> Array:
        shifts, turns = self.parts(x, signs, changes)
        values = [shifts.ravel()]
        if self.rows.rotations:
            values.append(self.lever * turns.ravel())
        return np.concatenate(values) / self.scale

    def fit(self, signs: Array, changes: tuple[Change, ...], x: Array, free: NDArray[np.bool_] | None = None) -> _State:
        """Return the unknowns after damped Gauss-Newton steps."""
        if free is None:
            free = np.ones(len(x), bool)
            if not self.rows.rotations:
                free[6:9] = False  # positions do not depend on the rotation of the tool frame
        columns = np.flatnonzero(free)
        r = self.residual(x, signs, changes)
        damping = 1e-9
        J = self._derivatives(x, signs, changes, columns, r)
        for _ in range(_ROUNDS):
            gradient = J.T @ r
            normal = J.T @ J
            size = np.diag(normal).max() if len(columns) else 0.0
            step = np.linalg.lstsq(normal + damping * size * np.eye(len(columns)), -gradient, rcond=1e-13)[0]
            tried = x.copy()
            tried[columns] += step
            r_tried = self.residual(tried, signs, changes)
            before = float(r @ r)
            after = float(r_tried @ r_tried)
            if after < before:
                x = tried
                r = r_tried
                damping = max(damping / 10, 1e-12)
                J = self._derivatives(x, signs, changes, columns, r)
                if before - after < 1e-7 * before:
                    break
            else:
                damping *= 30
                if damping > 10:
                    break
        return _State(signs, changes, x, free, r, J)

    def _derivatives(
        self, x: Array, signs: Array, changes: Sequence[Change], columns: NDArray[np.intp], r: Array
    ) -> Array:
        J = np.zeros((len(r), len(columns)))
        for k, column in enumerate(columns):
            shifted = x.copy()
            shifted[column] += _STEP
            J[:, k] = (self.residual(shifted, signs, changes) - r) / _STEP
        return J

    # -- start values ---------------------------------------------------------------------------------

    def frames(self, signs: Array) -> _State:
        """Return the best fit of base and tool frame alone."""
        T = self.model.poses(signs, np.zeros(self.model.count), {})
        best: _State | None = None
        for x in self._starts(T):
            fit = self.fit(signs, (), x)
            if best is None or fit.sse < best.sse:
                best = fit
        assert best is not None
        return best

    def _starts(self, T: Array) -> Iterator[Array]:
        yield np.zeros(_FRAMES)
        if self.rows.rotations:
            yield _hand_eye(T, self.rows.T)
            return
        for y in (np.zeros(3), *(0.1 * np.eye(3)), *(-0.1 * np.eye(3))):
            points = T[:, :3, :3] @ y + T[:, :3, 3]
            R, p = _placed(points, self.rows.T[:, :3, 3])
            yield np.concatenate([spatial.log_so3(R), p, np.zeros(3), y])

    # -- verdict --------------------------------------------------------------------------------------

    def result(self) -> PoseComparison:
        """Return the comparison."""
        signs = np.ones(self.model.count)
        plain = self.frames(signs)
        shifts, turns = self.parts(plain.x, signs, ())
        distances = np.linalg.norm(shifts, axis=1)
        angles = np.linalg.norm(turns, axis=1)
        k = int(np.argmax(distances + _LEVER * angles))
        saturated = self._saturated(plain)
        noise = self._noise(saturated)
        agrees = self._agrees(plain, saturated)
        explained = None
        if not agrees and saturated is not None:
            explained, saturated = self._searched(plain, saturated)
            noise = self._noise(saturated)
        fit = PoseFit(
            rows=len(self.rows.q),
            base=spatial.pose(spatial.exp_so3(plain.x[:3]), plain.x[3:6]),
            tool=spatial.pose(spatial.exp_so3(plain.x[6:9]), plain.x[9:12]),
            rotations=self.rows.rotations,
            noise=noise,
            stated=self.stated,
            computed=self.rows.computed,
            distance=float(distances[k]),
            angle=float(angles[k]),
            line=self.rows.lines[k] if self.rows.lines else 0,
            agrees=agrees,
        )
        q = {name: float(self.q[k, i]) for i, name in enumerate(self.side.order)}
        identified = None
        tolerance = self.tolerance
        if explained is not None and saturated is not None and isinstance(self.model, _Chain):
            identified = _identified(self.model, explained, self.label)
            uncertainty = self._uncertainty(explained, saturated)
            tolerance = max(tolerance, _NEEDED * uncertainty)
            fit = replace(fit, uncertainty=uncertainty)
        return PoseComparison(fit, q, identified, tolerance)

    def _within(self, state: _State) -> bool:
        shifts, turns = self.parts(state.x, state.signs, state.changes)
        far = float(np.linalg.norm(shifts, axis=1).max())
        turned = float(np.linalg.norm(turns, axis=1).max())
        return far <= self.tolerance and turned <= ANGLE_PER_LENGTH * self.tolerance

    def _agrees(self, plain: _State, saturated: _State | None) -> bool:
        """Return whether the remainder of the two frames alone is within the tolerance or the noise."""
        if self._within(plain):
            return True
        if self.stated:
            return self._is_stated_noise(plain, saturated)
        return saturated is not None and not self.rows.computed and self._is_noise(plain, saturated)

    def _saturated(self, state: _State) -> _State | None:
        """Return the fit with every joint free, with each kind of remainder in units of its own noise.

        None without a chain, or with too few rows.
        """
        if not isinstance(self.model, _Chain):
            return None
        changes = tuple((_PLACE, k) for k in range(self.model.count))
        x = np.concatenate([state.x, np.zeros(6 * self.model.count)])
        saturated = self.fit(state.signs, changes, x)
        if self._freedoms(saturated) < _FREEDOMS:
            return None
        if self.stated or self.rows.computed or not self.rows.rotations:
            return saturated
        sigma, sigma_angle = self._deviation(saturated)
        if sigma > 0 and sigma_angle > 0:
            self.lever = sigma / sigma_angle
            saturated = self.fit(saturated.signs, saturated.changes, saturated.x)
            # the remainder of the frames alone in the same units
            again = self.fit(state.signs, state.changes, state.x)
            state.x = again.x
            state.r = again.r
            state.J = again.J
        return saturated

    def _least(self, states: Sequence[_State], saturated: _State) -> _State:
        """Return the fit with every joint free and the least noise, among sets of signs that leave less than the first.

        With a wrong sign, no places of joints leave only noise: it would be estimated far too large.
        """
        first = states[0]
        best = saturated
        least = self._deviation(saturated)[0]
        for state in states[1:]:
            if state.sse >= first.sse:
                continue
            lever = self.lever
            fit = self._saturated(state)
            if fit is not None and self._deviation(fit)[0] < 0.5 * least:
                best = fit
                least = self._deviation(fit)[0]
            else:
                self.lever = lever
        return best

    def _deviation(self, saturated: _State) -> tuple[float, float]:
        """Return the standard deviations of a coordinate in m and of an angle in rad that a fit leaves."""
        shifts, turns = self.parts(saturated.x, saturated.signs, saturated.changes)
        share = self._freedoms(saturated) / len(saturated.r)
        sigma = float(np.sqrt((shifts**2).mean() / share))
        sigma_angle = float(np.sqrt((turns**2).mean() / share))
        return sigma, sigma_angle

    def _noise(self, saturated: _State | None) -> tuple[float, float] | None:
        """Return the noise that the table states, or else that the rows show; None without an estimate."""
        if self.stated:
            return self.scale, self.scale / self.lever
        if saturated is None or self.rows.computed:
            return None
        return self._deviation(saturated)

    def _freedoms(self, state: _State) -> int:
        return len(state.r) - self._rank(state)

    @staticmethod
    def _rank(state: _State) -> int:
        return int(np.linalg.matrix_rank(state.J.T @ state.J, tol=1e-9 * float((state.J**2).sum())))

    def _is_noise(self, state: _State, saturated: _State) -> bool:
        """Return whether the remainder is not significantly larger than with every joint free."""
        if self.stated:
            return self._is_stated_noise(state, saturated)
        if self._deviation(saturated)[0] > _LARGEST_NOISE:
            return False
        return self._is_estimated_noise(state, saturated)

    def _is_estimated_noise(self, state: _State, saturated: _State) -> bool:
        """Return whether the remainder is not significantly larger than with every joint free: that is noise."""
        if state is saturated:
            return True
        more = self._rank(saturated) - self._rank(state)
        freedoms = self._freedoms(saturated)
        if more <= 0 or saturated.sse <= 0:
            return state.sse <= saturated.sse * (1 + 1e-9)
        F = (max(state.sse - saturated.sse, 0.0) / more) / (saturated.sse / freedoms)
        return float(fdtrc(more, freedoms, F)) > _SIGNIFICANCE

    def _is_stated_noise(self, state: _State, saturated: _State | None) -> bool:
        """Return whether the stated noise explains the remainder, and all that free joints would take from it.

        The whole remainder of many rows hides an error of one number, which only few of its freedoms show.
        """
        if float(chdtrc(self._freedoms(state), state.sse)) <= _SIGNIFICANCE:
            return False
        if saturated is None or state is saturated:
            return True
        if self._is_overstated(saturated):
            return self._is_estimated_noise(state, saturated)
        more = self._rank(saturated) - self._rank(state)
        if more <= 0:
            return True
        gain = max(state.sse - saturated.sse, 0.0)
        return float(chdtrc(more, gain)) > _SIGNIFICANCE

    def _is_overstated(self, saturated: _State) -> bool:
        """Return whether the rows have far less noise than the table states."""
        return float(chdtr(self._freedoms(saturated), saturated.sse)) < _SIGNIFICANCE

    def _accepted(self, state: _State, saturated: _State) -> bool:
        return self._within(state) or self._is_noise(state, saturated)

    # -- explanation ----------------------------------------------------------------------------------

    def _searched(self, plain: _State, saturated: _State) -> tuple[_State | None, _State]:
        """Return (the fit with the fewest changes or None, the fit with every joint free)."""
        if self._accepted(saturated, saturated):
            explained = self._explained([plain], saturated)
            if explained is not None:
                return explained, saturated
        starts = self._sign_states(plain)
        saturated = self._least(starts, saturated)
        if not self._accepted(saturated, saturated):
            return None, saturated  # what remains with every joint free is no noise: fewer changes leave more
        starts = [self.fit(state.signs, (), state.x) for state in starts]
        return self._explained(starts, saturated), saturated

    def _explained(self, starts: Sequence[_State], saturated: _State) -> _State | None:
        """Return the fit with the fewest changes that leaves only noise; None if there is none."""
        model = self.model
        assert isinstance(model, _Chain)
        every: list[Change] = []
        for kind in (_ZERO, _PLACE):
            for k in range(model.count):
                if kind == _PLACE or model.own[k]:
                    every.append((kind, k))
        for cost in range(1, _FLIPS + _CHANGES + 1):
            for state in starts:
                flips = int((state.signs < 0).sum())
                size = cost - flips
                if not 0 <= size <= _CHANGES:
                    continue
                for candidate in self._promising(state, every, size):
                    if self._accepted(candidate, saturated):
                        return self._pruned(candidate, saturated)
        return None

    def _sign_states(self, plain: _State) -> list[_State]:
        """Return fits of the frames alone with the most promising sets of signs, first that without changes."""
        model = self.model
        assert isinstance(model, _Chain)
        states = []
        driven = np.flatnonzero(model.own)
        for flips in range(1, _FLIPS + 1):
            for chosen in combinations(driven, flips):
                signs = np.ones(model.count)
                signs[list(chosen)] = -1.0
                T = model.poses(signs, np.zeros(model.count), {})
                x = self._best_start(T, signs)
                cost = float((self.residual(x, signs, ()) ** 2).sum())
                states.append((cost, signs, x))
        states.sort(key=lambda found: found[0])
        fitted = [self.fit(signs, (), x) for _, signs, x in states[:_TRIED]]
        return [plain, *fitted]

    def _best_start(self, T: Array, signs: Array) -> Array:
        """Return the start with the smallest sum of absolute residuals for poses T of the model's tool."""
        starts = list(self._starts(T))
        sums = []
        for start in starts:
            r = self.residual(start, signs, ())
            sums.append(float(np.abs(r).sum()))
        return starts[int(np.argmin(sums))]

    def _promising(self, state: _State, every: Sequence[Change], size: int) -> Iterator[_State]:
        """Yield fits with `size` changes, those with the smallest linear estimate of their remainder first."""
        if size == 0:
            yield state
            return
        columns = {change: self._columns(state, change) for change in every}
        estimates = []
        for chosen in combinations(every, size):
            if len({joint for _, joint in chosen}) < size:
                continue
            J = np.hstack([state.J, *(columns[change] for change in chosen)])
            damping = 1e-12 * float((J**2).sum())
            normal = J.T @ J + damping * np.eye(J.shape[1])
            step = np.linalg.lstsq(normal, J.T @ state.r, rcond=None)
            remainder = state.r - J @ step[0]
            # a place has six values, a zero one: of similar remainders the zero is the smaller change
            values = sum(6 if kind == _PLACE else 1 for kind, _ in chosen)
            estimates.append((float(remainder @ remainder), values, chosen))
        estimates.sort(key=lambda found: found[0])
        most = _TRIED if size == 1 else _TRIED // 2
        tried = sorted(estimates[:most], key=lambda found: found[1])
        for _, values, chosen in tried:
            x = np.concatenate([state.x, np.zeros(values)])
            yield self.fit(state.signs, chosen, x)

    def _columns(self, state: _State, change: Change) -> Array:
        values = 6 if change[0] == _PLACE else 1
        x = np.concatenate([state.x, np.zeros(values)])
        columns = np.arange(_FRAMES, _FRAMES + values)
        return self._derivatives(x, state.signs, (change,), columns, state.r)

    def _pruned(self, state: _State, saturated: _State) -> _State:
        """Return the fit with as few values as the noise allows: one after another is held at zero."""
        while True:
            deviations = self._deviations(state, saturated)
            free_values = [k for k in np.flatnonzero(state.free) if k >= _FRAMES]
            free_values.sort(key=lambda k: abs(state.x[k]) / max(deviations[k], 1e-15))
            for k in free_values:
                free = state.free.copy()
                free[k] = False
                x = state.x.copy()
                x[k] = 0.0
                tried = self.fit(state.signs, state.changes, x, free)
                if self._accepted(tried, saturated):
                    state = tried
                    break
            else:
                return state

    def _deviations(self, state: _State, saturated: _State) -> Array:
        """Return the standard deviations (unknowns,) of the fitted values; 0 for those that are held."""
        variance = 1.0
        if not self.stated or self._is_overstated(saturated):
            variance = saturated.sse / max(self._freedoms(saturated), 1)
        covariance = np.linalg.pinv(state.J.T @ state.J, rcond=1e-12) * variance
        deviations = np.zeros(len(state.x))
        deviations[state.free] = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        return deviations

    def _uncertainty(self, state: _State, saturated: _State) -> float:
        """Return the largest standard deviation of the changed values in m, angles by their lever."""
        chain = self.model
        assert isinstance(chain, _Chain)
        deviations = self._deviations(state, saturated)
        largest = 0.0
        start = _FRAMES
        for kind, joint in state.changes:
            if kind == _ZERO:
                angle = chain.path[joint].is_angle
                largest = max(largest, deviations[start] * (_LEVER if angle else 1.0))
                start += 1
                continue
            largest = max(largest, _LEVER * float(deviations[start : start + 3].max()))
            largest = max(largest, float(deviations[start + 3 : start + 6].max()))
            start += 6
        return largest


def _identified(chain: _Chain, state: _State, label: str) -> RobotSide:
    """Return the side that the rows describe: the robot's side with the fitted signs, zeros and places."""
    side = chain.side
    zeros: dict[str, float] = {}
    places: dict[str, Array] = {}
    start = _FRAMES
    for kind, joint in state.changes:
        name = chain.path[joint].name
        if kind == _ZERO:
            zeros[name] = float(state.x[start])
            start += 1
        else:
            places[name] = chain.place(joint, state.x[start : start + 6])
            start += 6
    signs = {axis.name: float(sign) for axis, sign in zip(chain.path, state.signs, strict=True)}
    motions: dict[int, Array] = {0: np.eye(4)}
    axes = []
    for axis in side.tree:
        W = motions[axis.parent]
        if axis.name in places:
            W = W @ places[axis.name]
        sign = signs.get(axis.name, 1.0)
        zero = zeros.get(axis.name, 0.0)
        point = W[:3, :3] @ axis.point + W[:3, 3]
        direction = sign * (W[:3, :3] @ axis.direction)
        axes.append(replace(axis, point=point, direction=direction, limits=None, max_speed=None))
        motions[axis.child] = W @ joint_motion(axis, np.array([zero]))[0]
    frames = {}
    for name, (group, T) in side.frames.items():
        frames[name] = (group, motions[group] @ T)
    groups = tuple(JointGroup(group.bodies) for group in side.groups)
    return replace(
        side,
        label=label,
        axes=tuple(axes),
        groups=groups,
        frames=frames,
        path=None,
        text=None,
        places={},
        rows=(),
        efforts={},
    )


def _hand_eye(T: Array, target: Array) -> Array:
    """Return start values (12,) of base and tool frame with target = X T Y, from relative motions.

    target_i target_0^-1 = X (T_i T_0^-1) X^-1: the rotation of X maps rotation vectors onto each other, its shift is a
    linear problem.
    """
    A = target @ spatial.inverse(target[0])
    B = T @ spatial.inverse(T[0])
    a = spatial.log_so3(A[:, :3, :3])
    b = spatial.log_so3(B[:, :3, :3])
    U, _, Vt = np.linalg.svd(a.T @ b)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    # R_A p + p_A = R p_B + p, for the shift p of X
    M = (A[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    c = (B[:, :3, 3] @ R.T - A[:, :3, 3]).ravel()
    p = np.linalg.lstsq(M, c, rcond=1e-9)[0]
    X = spatial.pose(R, p)
    Y = spatial.inverse(X @ T[0]) @ target[0]
    parts = [spatial.log_so3(R), p, spatial.log_so3(Y[:3, :3]), Y[:3, 3]]
    return np.concatenate([np.asarray(part, float) for part in parts])


def _placed(points: Array, targets: Array) -> tuple[Array, Array]:
    """Return rotation (3, 3) and shift (3,) that bring points (k, 3) nearest to targets (k, 3)."""
    middle = points.mean(axis=0)
    target_middle = targets.mean(axis=0)
    U, _, Vt = np.linalg.svd((targets - target_middle).T @ (points - middle))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return R, target_middle - R @ middle
