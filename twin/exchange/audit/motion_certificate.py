"""Check a certificate of bounds along a protocol: the mechanism that it states is moved to random times of its path.

No code of the prover is used. Loops are closed by Newton's method in double precision, with derivatives by complex
steps, and no value may be beyond its bound. A sample shows that a bound is wrong, not that it is right.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from twin.exchange.audit.report import Ledger

SCHEMA = "twin/motion-certificate/1"

TIMES = 1000
"""Number of random times."""

CLOSED = 1e-9
"""Largest gap in m of a closed loop, and largest part by which a value may be beyond its bound."""

_NEAR = 1e-5
"""Largest distance in m or rad of the joint values from those predicted."""

_NOT_SAMPLED = "determinant"
"""Kind of the bound that has no row of its own."""

_STEPS = 8
"""Number of Newton steps."""

_STEP = 1e-30
"""Step along the imaginary axis; its square is below any rounding."""

_PARTS = {"revolute": "t", "prismatic": "s", "cylindrical": "st", "spherical": "zyx", "fixed": ""}
"""{type of a joint: its coordinates; t and s about and along z}."""

_ARM = 0.1
"""Length in m by which gaps of directions are multiplied."""

Numbers = npt.NDArray[np.complex128]
Reals = npt.NDArray[np.float64]


def audit_motion_bounds(data: Mapping[str, Any], ledger: Ledger) -> None:
    """Add a row for each bound of a certificate, and a finding for each that a sample exceeds."""
    generator = np.random.default_rng()  # no time that the author of a certificate could foresee
    pieces = data["pieces"]
    phases = data["path"]["phases"]
    kinds = {bound["kind"] for bound in data["bounds"]}
    if kinds <= {_NOT_SAMPLED}:
        raise ValueError("it has no bound that a sample could exceed")
    _require_tiles(pieces, len(phases))
    for joint in data["mechanism"]["tree"]:
        # other programs place the child by the inverse, this one by the frame itself
        product = _frame(joint["child_in_joint"]) @ _frame(joint["on_child"])
        if not np.abs(product - np.eye(4)).max() <= CLOSED:
            raise ValueError(f"the two frames of joint {joint['name']} on its child are not inverse to one another")
    sampled = _states_at_random_times(data, generator)
    has_bodies = pieces[0][3] is not None
    if has_bodies:
        passive = _passive_coordinates(sampled.x.shape[1], list(data["mechanism"]["driven"]))
        predicted = sampled.x.copy()
        with np.errstate(all="ignore"):
            sampled.close(passive)
        distance = float(np.abs(sampled.x - predicted).max(initial=0.0))
        _row(ledger, "predictions", distance, _NEAR, "the joint values are far from those predicted", "rad")
        gap = float(np.abs(sampled.gaps).max(initial=0.0))
        _row(ledger, "loops", gap, CLOSED, "a loop does not close", "m")
    for bound in data["bounds"]:
        _judge(bound, sampled, has_bodies, ledger)


def _states_at_random_times(data: Mapping[str, Any], generator: np.random.Generator) -> _Sampled:
    """Return the mechanism at random times of the path, with the passive coordinates that the pieces predict."""
    pieces = data["pieces"]
    phases = data["path"]["phases"]
    coordinate_count = 0
    for joint in data["mechanism"]["tree"]:
        coordinate_count += len(_PARTS[joint["type"]])
    driven = list(data["mechanism"]["driven"])
    passive = _passive_coordinates(coordinate_count, driven)
    chosen_pieces = np.sort(generator.integers(0, len(pieces), TIMES))
    phase_numbers = np.zeros(TIMES, np.int64)
    x = np.zeros((TIMES, coordinate_count))
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
    return _Sampled(data["mechanism"], data["path"], phase_numbers, x, slopes, np.sqrt(squared_rates))


def _passive_coordinates(count: int, driven: Sequence[int]) -> list[int]:
    """Return the numbers of the coordinates, of which there are `count`, that are not driven."""
    return sorted(set(range(count)) - set(driven))


def _require_tiles(pieces: Sequence[Sequence[Any]], phases: int) -> None:
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
    if (phase + 1, end) != (phases, 1.0):
        raise ValueError(f"its pieces end at {end} of phase {phase + 1}, not at the end of phase {phases}")


class _Sampled:
    """A mechanism at k states of a path: coordinates x (k, m), their derivatives by s, and ds/dt (k,)."""

    def __init__(
        self,
        mechanism: Mapping[str, Any],
        path: Mapping[str, Any],
        phase: npt.NDArray[np.int64],
        x: Reals,
        slopes: Reals,
        rate: Reals,
    ) -> None:
        self.mechanism = mechanism
        self.path = path
        self.phase = phase
        self.x = x
        self.slopes = slopes
        self.rate = rate
        self.gaps = np.zeros((len(x), 0))
        self.poses: dict[str, Numbers] = {}

    def close(self, passive: Sequence[int]) -> None:
        """Close the loops by Newton's method, and find the rates of the passive coordinates."""
        for _ in range(_STEPS):
            gaps, _ = self.place(self.x.astype(np.complex128))
            J = self._derivatives(passive)
            if not passive or not gaps.shape[1]:
                break
            self.x[:, passive] -= (np.linalg.pinv(J) @ gaps.real[..., None])[..., 0]
        moving = self.x + 1j * _STEP * self.slopes
        moving[:, passive] = self.x[:, passive]
        if passive and self.gaps.shape[1]:
            by_driven = self.place(moving)[0].imag / _STEP
            self.slopes[:, passive] = -(np.linalg.pinv(self._derivatives(passive)) @ by_driven[..., None])[..., 0]
        gaps, _ = self.place(self.x + 1j * _STEP * self.slopes)
        self.gaps = gaps.real

    def _derivatives(self, passive: Sequence[int]) -> Reals:
        """Return the derivatives (k, rows, columns) of the gaps by the passive coordinates."""
        columns = []
        for i in passive:
            stepped = self.x.astype(np.complex128)
            stepped[:, i] += 1j * _STEP
            columns.append(self.place(stepped)[0].imag / _STEP)
        self.gaps = self.place(self.x.astype(np.complex128))[0].real
        if not columns:
            return np.zeros((*self.gaps.shape, 0))
        return np.stack(columns, axis=2)

    def place(self, x: Numbers) -> tuple[Numbers, Numbers]:
        """Place all bodies; return the gaps (k, rows) of the loops, and the pose (k, 4, 4) of the moved frame."""
        self.poses = {self.mechanism["base"]: np.broadcast_to(np.eye(4, dtype=complex), (len(x), 4, 4))}
        i = 0
        for joint in self.mechanism["tree"]:
            T = self.poses[joint["parent"]] @ _frame(joint["on_parent"])
            for part in _PARTS[joint["type"]]:
                T = T @ _motion(part, x[:, i])
                i += 1
            self.poses[joint["child"]] = T @ np.linalg.inv(_frame(joint["on_child"]))
        rows = []
        for joint in self.mechanism["loops"]:
            rows += _gaps(joint["type"], self.relative(joint))
        for coupling in self.mechanism["couplings"]:
            rows.append(x[:, coupling["coordinates"]] @ np.array(coupling["ratios"], float) - coupling["total"])
        tool = self.mechanism["tool"]
        tip = self.poses[tool["body"]] @ _frame(tool["frame"]) @ _frame(self.path["frame_in_tool"])
        if not rows:
            return np.zeros((len(x), 0), complex), tip
        return np.stack(rows, axis=1), tip

    def relative(self, joint: Mapping[str, Any]) -> Numbers:
        """Return the second frame (k, 4, 4) of a joint in its first."""
        first = self.poses[joint["parent"]] @ _frame(joint["on_parent"])
        return np.linalg.inv(first) @ self.poses[joint["child"]] @ _frame(joint["on_child"])


def _frame(numbers: Sequence[Sequence[float]]) -> Reals:
    """Return a pose (4, 4) from its first three rows."""
    T = np.eye(4)
    T[:3] = np.array(numbers, float)
    return T


def _motion(part: str, value: Numbers) -> Numbers:
    """Return the motion (k, 4, 4) of one coordinate (k,)."""
    T = np.zeros((len(value), 4, 4), complex)
    T[:] = np.eye(4)
    if part == "s":
        T[:, 2, 3] = value
        return T
    axis = {"x": 0, "y": 1}.get(part, 2)
    second, third = (axis + 1) % 3, (axis + 2) % 3
    T[:, second, second] = T[:, third, third] = np.cos(value)
    T[:, third, second] = np.sin(value)
    T[:, second, third] = -T[:, third, second]
    return T


def _gaps(kind: str, T: Numbers) -> list[Numbers]:
    """Return the gaps of a joint, whose second frame is at T (k, 4, 4) in its first."""
    rows = [T[:, 0, 3], T[:, 1, 3]]
    if kind not in ("prismatic", "cylindrical"):
        rows.append(T[:, 2, 3])
    if kind in ("fixed", "prismatic"):
        # the vector of the rotation, which is zero only without one, or at half a turn
        for i, j in ((2, 1), (0, 2), (1, 0)):
            rows.append(_ARM / 2 * (T[:, i, j] - T[:, j, i]))
    if kind in ("revolute", "cylindrical"):
        rows += [-_ARM * T[:, 1, 2], _ARM * T[:, 0, 2]]
    return rows


def _judge(bound: Mapping[str, Any], sampled: _Sampled, has_bodies: bool, ledger: Ledger) -> None:
    """Add the row of a bound, and a finding if a sample is beyond it."""
    name = f"{bound['kind']} {bound['value']}"
    if bound["kind"] == _NOT_SAMPLED:
        return  # that it is not 0 shows in the loops, which Newton's method closes
    if ("at least" in bound) == ("at most" in bound):
        raise ValueError(f"{name} has not either a lower or an upper bound")
    if not has_bodies and "weights" not in bound:
        raise ValueError(f"{name} rests on the bodies, which have no prediction")
    values = _values(bound, sampled)
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
    _row(ledger, name, relative, CLOSED, f"a sample is {sample:.6g}, beyond its bound {stated:.6g}", "")


def _values(bound: Mapping[str, Any], sampled: _Sampled) -> Reals:
    """Return the values (k,) that a bound is about; none where no phase has them."""
    kind = bound["kind"]
    if kind == "loop gap":
        return np.abs(sampled.gaps).max(axis=1)
    if kind == "tool speed":
        _, T = sampled.place(sampled.x + 1j * _STEP * sampled.slopes)
        change = T.imag / _STEP
        speed = np.linalg.norm(change[:, :3, 3], axis=1)
        if bound["value"] == "rotation":
            speed = np.linalg.norm(change[:, :3, :3], axis=(1, 2)) / math.sqrt(2)
        limits = np.array([phase[f"{bound['value']}_speed"] for phase in sampled.path["phases"]], float)
        return speed * sampled.rate / limits[sampled.phase]
    if "weights" in bound:
        columns = list(bound["coordinates"])
        weights = np.array(bound["weights"], float)
        if kind.endswith("speed"):
            return np.abs(sampled.slopes[:, columns] @ weights) * sampled.rate
        return _margins(sampled.x[:, columns] @ weights, bound["limits"])
    if kind == "RCM":
        return _distances(bound, sampled)
    T = sampled.relative(bound["joint"]).real
    if "cosine" in bound:
        entries = np.stack([T[:, 0, 0], T[:, 1, 1], T[:, 1, 0], T[:, 0, 1], T[:, 2, 2]], axis=1)
        return float(bound["angle"]) - np.arccos(np.clip(entries @ np.array(bound["cosine"], float), -1.0, 1.0))
    return _margins(T[:, 2, 3], bound["limits"])


def _margins(values: Reals, limits: Sequence[float | None]) -> Reals:
    """Return the distances of values from the nearer limit."""
    low, high = limits
    if low is None:
        low = -math.inf
    if high is None:
        high = math.inf
    return np.minimum(values - low, high - values)


def _distances(bound: Mapping[str, Any], sampled: _Sampled) -> Reals:
    """Return the distances of the shaft from the RCM in the phases that have one."""
    _, T = sampled.place(sampled.x.astype(np.complex128))
    distances = []
    for phase_number, phase in enumerate(sampled.path["phases"]):
        in_phase = sampled.phase == phase_number
        if phase["rcm"] is not None and phase["enforced"] == (bound["value"] == "enforced") and in_phase.any():
            axis = T[in_phase, :3, :3].real @ np.array(sampled.path["shaft"], float)
            from_rcm = T[in_phase, :3, 3].real - np.array(phase["rcm"], float)
            distances.append(np.linalg.norm(np.cross(from_rcm, axis), axis=1))
    if not distances:
        return np.zeros(0)
    return np.concatenate(distances)


def _row(ledger: Ledger, what: str, value: float, limit: float, text: str, unit: str) -> None:
    """Add a row, and a finding if the value is above its limit or no number."""
    ledger.row("motion", value, unit, limit, where=what)
    if not value <= limit:
        ledger.wrong("certificate.wrong", f"{what}: {text}", what)
