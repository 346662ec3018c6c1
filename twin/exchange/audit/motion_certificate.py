"""Check a certificate of bounds along a protocol: the mechanism that it states is moved to random times of its path.

No code of the prover is used. Loops are closed by Newton's method in double precision, with derivatives by complex
steps, and no value may be beyond its bound. A sample shows that a bound is wrong, not that it is right.

The certificate is a JSON object with these entries, lengths in m, angles in rad, times in s, frames as the first three
rows of a pose:

    mechanism     {base, tool: {body, frame}, driven, tree, loops, couplings}
      driven      numbers of the driven coordinates; those of the joints of the tree are numbered in their order
      tree, loops joints {name, type, parent, child, on_parent, on_child, child_in_joint: the inverse of on_child}
      couplings   {coordinates, ratios, total}: the sum of ratio * coordinate is the total
    path          {frame_in_tool: the moved frame, shaft: its axis (3,), phases}
      phase       {series: Chebyshev coefficients of each driven coordinate over s in 0 .. 1, grid and rates: ds/dt at
                  values of s, rcm: (3,) or null, enforced, tip_speed and rotation_speed: limits}
    pieces        [phase, first s, last s, series of each passive coordinate over -1 .. 1 or null, matrix] in order; the
                  matrix, for Krawczyk's operator, is not used here
    bounds        {kind, value: its name, "at least" or "at most", and what it is about, as in `_values`}
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from twin.core.json_types import JsonMapping
from twin.exchange.audit.ledger import Ledger

SCHEMA = "twin/motion-certificate/1"

TIMES = 1000
"""Number of random times."""

CLOSED = 1e-9
"""Largest gap in m of a closed loop, and largest part by which a value may be beyond its bound."""

_MAX_PREDICTION_ERROR = 1e-5
"""Largest distance in m or rad of the joint values from those predicted."""

_DETERMINANT = "determinant"
"""Kind of the bound that has no row: that it is not 0 shows in the loops, which Newton's method closes."""

_NEWTON_STEPS = 8
"""Number of Newton steps, each of which doubles the number of right digits."""

_COMPLEX_STEP = 1e-30
"""Step along the imaginary axis; its square is below any rounding."""

_COORDINATES = {"revolute": "t", "prismatic": "s", "cylindrical": "st", "spherical": "zyx", "fixed": ""}
"""{type of a joint: its coordinates}: t is a turn about z, s a slide along z; x, y and z are turns about an axis."""

_ANGLE_ARM = 0.1
"""Length in m by which gaps of directions are multiplied."""

_Piece = tuple[int, float, float, Sequence[Sequence[float]] | None, object]
"""A piece of the path, as the certificate has it."""

Numbers = npt.NDArray[np.complex128]
Reals = npt.NDArray[np.float64]


@dataclass(frozen=True)
class _PlacedBodies:
    """Poses {body: T_base_body (k, 4, 4)} of the bodies at k states."""

    poses: Mapping[str, Numbers]

    def relative(self, joint: JsonMapping) -> Numbers:
        """Return the second frame (k, 4, 4) of a joint in its first."""
        first = self.poses[joint["parent"]] @ _frame(joint["on_parent"])
        return np.linalg.inv(first) @ self.poses[joint["child"]] @ _frame(joint["on_child"])


class _StatedMechanism:
    """The mechanism of a certificate: its bodies and the gaps of its loops at coordinates x (k, m)."""

    def __init__(self, data: JsonMapping) -> None:
        self._mechanism: JsonMapping = data["mechanism"]
        tool = self._mechanism["tool"]
        self._tool_body = str(tool["body"])
        self._T_tool_body_frame = _frame(tool["frame"]) @ _frame(data["path"]["frame_in_tool"])
        self.coordinate_count = 0
        for joint in self._mechanism["tree"]:
            self.coordinate_count += len(_COORDINATES[joint["type"]])
        self.driven: list[int] = list(self._mechanism["driven"])
        self.passive = sorted(set(range(self.coordinate_count)) - set(self.driven))

    def require_inverse_frames(self) -> None:
        """Raise ValueError unless both frames of each joint on its child are inverse to one another.

        Other programs place the child by the inverse, this one by the frame itself.
        """
        for joint in self._mechanism["tree"]:
            product = _frame(joint["child_in_joint"]) @ _frame(joint["on_child"])
            if not np.abs(product - np.eye(4)).max() <= CLOSED:
                raise ValueError(f"the two frames of joint {joint['name']} on its child are not inverse to one another")

    def placed(self, x: Numbers) -> _PlacedBodies:
        """Return the bodies at coordinates x (k, m)."""
        poses: dict[str, Numbers] = {self._mechanism["base"]: np.broadcast_to(np.eye(4, dtype=complex), (len(x), 4, 4))}
        number = 0
        for joint in self._mechanism["tree"]:
            T = poses[joint["parent"]] @ _frame(joint["on_parent"])
            for coordinate in _COORDINATES[joint["type"]]:
                T = T @ _motion(coordinate, x[:, number])
                number += 1
            poses[joint["child"]] = T @ np.linalg.inv(_frame(joint["on_child"]))
        return _PlacedBodies(poses)

    def gaps(self, x: Numbers) -> Numbers:
        """Return the gaps (k, rows) of loops and couplings in m; those of angles are multiplied by `_ANGLE_ARM`."""
        bodies = self.placed(x)
        rows = []
        for joint in self._mechanism["loops"]:
            rows += _gaps_of_joint(joint["type"], bodies.relative(joint))
        for coupling in self._mechanism["couplings"]:
            ratios = np.array(coupling["ratios"], float)
            rows.append(x[:, coupling["coordinates"]] @ ratios - coupling["total"])
        if not rows:
            return np.zeros((len(x), 0), complex)
        return np.stack(rows, axis=1)

    def gaps_by_passive(self, x: Reals) -> Reals:
        """Return the derivatives (k, rows, columns) of the gaps by the passive coordinates."""
        columns = []
        for number in self.passive:
            stepped = x.astype(np.complex128)
            stepped[:, number] += 1j * _COMPLEX_STEP
            columns.append(self.gaps(stepped).imag / _COMPLEX_STEP)
        if not columns:
            return np.zeros((*self.gaps(x.astype(np.complex128)).shape, 0))
        return np.stack(columns, axis=2)

    def moved_frame(self, x: Numbers) -> Numbers:
        """Return the pose (k, 4, 4) of the frame that the path moves."""
        return self.placed(x).poses[self._tool_body] @ self._T_tool_body_frame


@dataclass(frozen=True)
class _PathStates:
    """A mechanism at k states of a path.

    Attributes:
        mechanism: the mechanism.
        path: the entry "path" of the certificate.
        phases: number of the phase (k,) of each state.
        x: coordinates (k, m) in m and rad.
        slopes: their derivatives (k, m) by s.
        rates: ds/dt (k,) in 1/s.
        gaps: gaps (k, rows) of the loops in m; (k, 0) before `_closed`.
    """

    mechanism: _StatedMechanism
    path: JsonMapping
    phases: npt.NDArray[np.int64]
    x: Reals
    slopes: Reals
    rates: Reals
    gaps: Reals


def audit_motion_bounds(data: JsonMapping, ledger: Ledger) -> None:
    """Add a row for each bound of a certificate, and a finding for each that a sample exceeds.

    Raises:
        ValueError, KeyError, TypeError, IndexError: the certificate was changed.
    """
    generator = np.random.default_rng()  # no time that the author of a certificate could foresee
    pieces = data["pieces"]
    kinds = {bound["kind"] for bound in data["bounds"]}
    if kinds <= {_DETERMINANT}:
        raise ValueError("it has no bound that a sample could exceed")
    _require_tiles(pieces, len(data["path"]["phases"]))
    mechanism = _StatedMechanism(data)
    mechanism.require_inverse_frames()
    states = _states_at_random_times(data, mechanism, generator)
    has_bodies = pieces[0][3] is not None
    if has_bodies:
        predicted = states.x
        with np.errstate(all="ignore"):
            states = _closed(states)
        distance = float(np.abs(states.x - predicted).max(initial=0.0))
        text = "the joint values are far from those predicted"
        _add_row(ledger, "predictions", distance, _MAX_PREDICTION_ERROR, text, "m or rad")
        gap = float(np.abs(states.gaps).max(initial=0.0))
        _add_row(ledger, "loops", gap, CLOSED, "a loop does not close", "m")
    for bound in data["bounds"]:
        if bound["kind"] != _DETERMINANT:
            _judge(bound, states, has_bodies, ledger)


def _states_at_random_times(
    data: JsonMapping, mechanism: _StatedMechanism, generator: np.random.Generator
) -> _PathStates:
    """Return the mechanism at random times of the path, with the passive coordinates that the pieces predict."""
    pieces = data["pieces"]
    phases = data["path"]["phases"]
    driven = mechanism.driven
    passive = mechanism.passive
    chosen_pieces = np.sort(generator.integers(0, len(pieces), TIMES))
    phase_numbers = np.zeros(TIMES, np.int64)
    x = np.zeros((TIMES, mechanism.coordinate_count))
    slopes = np.zeros(x.shape)
    squared_rates = np.zeros(TIMES)
    for piece_number in np.unique(chosen_pieces).tolist():
        in_piece = chosen_pieces == piece_number
        phase_number, begin, end, passive_series, _ = pieces[piece_number]
        phase_numbers[in_piece] = phase_number
        s = generator.uniform(begin, end, in_piece.sum())
        driven_series = np.array(phases[phase_number]["series"], float).T
        # Chebyshev series are over -1 .. 1, the path over 0 .. 1: hence the factor 2 of the derivative.
        x[np.ix_(in_piece, driven)] = np.polynomial.chebyshev.chebval(2 * s - 1, driven_series).T
        derivative = 2 * np.polynomial.chebyshev.chebder(driven_series)
        slopes[np.ix_(in_piece, driven)] = np.polynomial.chebyshev.chebval(2 * s - 1, derivative).T
        # With constant accelerations between the grid's points, the square of the rate is linear.
        squares_on_grid = np.square(phases[phase_number]["rates"])
        squared_rates[in_piece] = np.interp(s, phases[phase_number]["grid"], squares_on_grid)
        if passive_series is not None and passive:
            local = (2 * s - begin - end) / (end - begin)
            coefficients = np.array(passive_series, float).T
            x[np.ix_(in_piece, passive)] = np.polynomial.polynomial.polyval(local, coefficients).T
    no_gaps = np.zeros((TIMES, 0))
    return _PathStates(mechanism, data["path"], phase_numbers, x, slopes, np.sqrt(squared_rates), no_gaps)


def _require_tiles(pieces: Sequence[_Piece], phase_count: int) -> None:
    """Raise an error unless the pieces of each phase follow one another from 0 to 1, and all phases have some."""
    phase, end = -1, 1.0
    for piece_number, (number, first, last, *_) in enumerate(pieces):
        if end == 1.0 and first == 0.0 and number == phase + 1:
            phase = number
        elif number != phase or first != end:
            raise ValueError(
                f"piece {piece_number} does not begin where the one before it ends: a part of the path is left out"
            )
        if not first < last <= 1.0:
            raise ValueError(f"piece {piece_number} goes from {first} to {last}")
        end = last
    if (phase + 1, end) != (phase_count, 1.0):
        raise ValueError(f"its pieces end at {end} of phase {phase + 1}, not at the end of phase {phase_count}")


def _closed(states: _PathStates) -> _PathStates:
    """Return states with closed loops, by Newton's method, and with the slopes of the passive coordinates."""
    mechanism = states.mechanism
    passive = mechanism.passive
    x = states.x.copy()
    slopes = states.slopes.copy()
    has_loops = bool(passive) and mechanism.gaps(x.astype(np.complex128)).shape[1] > 0
    if has_loops:
        for _ in range(_NEWTON_STEPS):
            gaps = mechanism.gaps(x.astype(np.complex128)).real
            x[:, passive] -= (np.linalg.pinv(mechanism.gaps_by_passive(x)) @ gaps[..., None])[..., 0]
        # The gaps stay 0 along the path: slopes of passive coordinates make up for those of driven ones.
        driven_slopes = slopes.copy()
        driven_slopes[:, passive] = 0.0
        by_driven = mechanism.gaps(x + 1j * _COMPLEX_STEP * driven_slopes).imag / _COMPLEX_STEP
        slopes[:, passive] = -(np.linalg.pinv(mechanism.gaps_by_passive(x)) @ by_driven[..., None])[..., 0]
    gaps = mechanism.gaps(x.astype(np.complex128)).real
    return _PathStates(mechanism, states.path, states.phases, x, slopes, states.rates, gaps)


def _frame(numbers: Sequence[Sequence[float]]) -> Reals:
    """Return a pose (4, 4) from its first three rows."""
    T = np.eye(4)
    T[:3] = np.array(numbers, float)
    return T


def _motion(coordinate: str, value: Numbers) -> Numbers:
    """Return the motion (k, 4, 4) of one coordinate (k,), as `_COORDINATES` names it."""
    T = np.zeros((len(value), 4, 4), complex)
    T[:] = np.eye(4)
    if coordinate == "s":
        T[:, 2, 3] = value
        return T
    axis = {"x": 0, "y": 1}.get(coordinate, 2)
    second, third = (axis + 1) % 3, (axis + 2) % 3
    T[:, second, second] = T[:, third, third] = np.cos(value)
    T[:, third, second] = np.sin(value)
    T[:, second, third] = -T[:, third, second]
    return T


def _gaps_of_joint(joint_type: str, T: Numbers) -> list[Numbers]:
    """Return the gaps of a joint in m, whose second frame is at T (k, 4, 4) in its first."""
    rows = [T[:, 0, 3], T[:, 1, 3]]
    if joint_type not in ("prismatic", "cylindrical"):
        rows.append(T[:, 2, 3])
    if joint_type in ("fixed", "prismatic"):
        # the vector of the rotation, which is zero only without one, or at half a turn
        for i, j in ((2, 1), (0, 2), (1, 0)):
            rows.append(_ANGLE_ARM / 2 * (T[:, i, j] - T[:, j, i]))
    if joint_type in ("revolute", "cylindrical"):
        rows += [-_ANGLE_ARM * T[:, 1, 2], _ANGLE_ARM * T[:, 0, 2]]
    return rows


def _judge(bound: JsonMapping, states: _PathStates, has_bodies: bool, ledger: Ledger) -> None:
    """Add the row of a bound, and a finding if a sample is beyond it."""
    name = f"{bound['kind']} {bound['value']}"
    if ("at least" in bound) == ("at most" in bound):
        raise ValueError(f"{name} has not either a lower or an upper bound")
    if not has_bodies and "weights" not in bound:
        raise ValueError(f"{name} rests on the bodies, which have no prediction")
    values = _values(bound, states)
    if not len(values):
        raise ValueError(f"{name}: no phase has such a value")
    if "at least" in bound:
        stated = float(bound["at least"])
        sample = float(values.min())
        beyond = stated - sample
    else:
        stated = float(bound["at most"])
        sample = float(values.max())
        beyond = sample - stated
    relative = beyond / max(1.0, float(np.abs(values).max()))
    _add_row(ledger, name, relative, CLOSED, f"a sample is {sample:.6g}, beyond its bound {stated:.6g}", "")


def _values(bound: JsonMapping, states: _PathStates) -> Reals:
    """Return the values (k,) that a bound is about; none where no phase has them.

    A bound with "weights" is about a sum of coordinates: its speed, or its distance from "limits". Others are about
    the loops, the tool, the RCM, or a passive "joint": an angle whose cosine is a sum of entries of its rotation with
    the weights "cosine", less than "angle", or a slide within "limits".
    """
    kind = bound["kind"]
    mechanism = states.mechanism
    if kind == "loop gap":
        return np.abs(states.gaps).max(axis=1)
    if kind == "tool speed":
        change = mechanism.moved_frame(states.x + 1j * _COMPLEX_STEP * states.slopes).imag / _COMPLEX_STEP
        speed = np.linalg.norm(change[:, :3, 3], axis=1)
        if bound["value"] == "rotation":
            speed = np.linalg.norm(change[:, :3, :3], axis=(1, 2)) / math.sqrt(2)
        limits = np.array([phase[f"{bound['value']}_speed"] for phase in states.path["phases"]], float)
        return speed * states.rates / limits[states.phases]
    if "weights" in bound:
        columns = list(bound["coordinates"])
        weights = np.array(bound["weights"], float)
        if kind.endswith("speed"):
            return np.abs(states.slopes[:, columns] @ weights) * states.rates
        return _margins(states.x[:, columns] @ weights, bound["limits"])
    if kind == "RCM":
        return _distances_from_rcm(states, bound["value"] == "enforced")
    T = mechanism.placed(states.x.astype(np.complex128)).relative(bound["joint"]).real
    if "cosine" in bound:
        entries = np.stack([T[:, 0, 0], T[:, 1, 1], T[:, 1, 0], T[:, 0, 1], T[:, 2, 2]], axis=1)
        cosine = entries @ np.array(bound["cosine"], float)
        return float(bound["angle"]) - np.arccos(np.clip(cosine, -1.0, 1.0))
    return _margins(T[:, 2, 3], bound["limits"])


def _margins(values: Reals, limits: Sequence[float | None]) -> Reals:
    """Return the distances of values from the nearer limit."""
    low, high = limits
    if low is None:
        low = -math.inf
    if high is None:
        high = math.inf
    return np.minimum(values - low, high - values)


def _distances_from_rcm(states: _PathStates, is_enforced: bool) -> Reals:
    """Return the distances in m of the shaft from the RCM in the phases that have one, enforced or not."""
    T = states.mechanism.moved_frame(states.x.astype(np.complex128)).real
    distances = []
    for phase_number, phase in enumerate(states.path["phases"]):
        in_phase = states.phases == phase_number
        if phase["rcm"] is not None and phase["enforced"] == is_enforced and in_phase.any():
            axis = T[in_phase, :3, :3] @ np.array(states.path["shaft"], float)
            from_rcm = T[in_phase, :3, 3] - np.array(phase["rcm"], float)
            distances.append(np.linalg.norm(np.cross(from_rcm, axis), axis=1))
    if not distances:
        return np.zeros(0)
    return np.concatenate(distances)


def _add_row(ledger: Ledger, what: str, value: float, limit: float, text: str, unit: str) -> None:
    """Add a row, and a finding if the value is above its limit or no number."""
    ledger.row("motion", value, unit, limit, where=what)
    if not value <= limit:
        ledger.wrong("certificate.wrong", f"{what}: {text}", what)
