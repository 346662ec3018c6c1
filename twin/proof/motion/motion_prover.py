"""Prove limits, speeds, RCM, loops and singularities along a protocol, between the samples as well as at them.

What is proved is a function of continuous time. The driven joints follow q(s(t)): q is the series of each phase that
was timed, s(t) the motion whose (ds/dt)^2 is linear in s between the grid points of the timing. The bodies follow as
the mechanism of the CAD carries them, with closed loops. Its numbers are taken as they are, as floating-point numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from twin.core.errors import TwinError
from twin.core.progress import Progress, silent
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.proof.motion import value_groups as groups
from twin.proof.motion.closure import ClosedLinkage, closed_linkage, connected
from twin.proof.motion.linkage import Linkage, supported
from twin.proof.motion.path import TimedPath
from twin.proof.motion.pieces import DEEPEST, OVERLAP, Pieces, first_pieces
from twin.proof.motion.prediction import Poses, nodes
from twin.proof.motion.quantities import Enclosure, TimeCells, cells_of, enclosures
from twin.proof.motion.series import on_pieces
from twin.proof.motion.taylor import joined

ORDER = 5
"""Degree of the Taylor models."""

TIGHT = 1.1
"""Ratio of an upper bound to a value that is certainly reached, above which pieces are halved."""

ROUNDING = 2e-11
"""Size in m, rad, m/s or rad/s below which no bound is made tighter."""

SPEED_EXCESS = 1e-3
"""Fraction by which a speed may exceed its limit: as for the samples of a plan."""

TOUCHING = 1e-12
"""Distance in m or rad by which a limit of a joint may be exceeded: rounding of a motion that ends at its limit."""

_EXPONENTIAL_ERROR = 1e-12
"""Bound of the relative rounding error of the exponential of a logarithm of a determinant."""

_DEEPEST_OPEN = 3
"""How often a piece is halved at most on which no motion of the passive joints is proved."""

_MOST_PIECES = 6000
"""Largest number of pieces of a path."""

SPEEDS = (groups.JOINT_SPEED, groups.MOTOR_SPEED, groups.TOOL_SPEED)
"""Groups of values that depend on the timing."""

DRIVEN = (groups.JOINT_LIMIT, groups.JOINT_SPEED, groups.MOTOR_LIMIT, groups.MOTOR_SPEED, groups.GAP)
"""Groups of values that follow from the driven joints alone."""

MARGINS = (groups.JOINT_LIMIT, groups.MOTOR_LIMIT, groups.PASSIVE_LIMIT, groups.GAP)
"""Groups of values that must not be below their limit."""

States = Callable[[Array], Poses]
"""Function of driven joint values (k, n) along the path that returns the poses of all bodies."""


@dataclass(frozen=True)
class MotionClaim:
    """A claim about a value along the whole path.

    Attributes:
        name, group, unit: see `Enclosure`.
        smallest: whether it is about the smallest value; otherwise about the largest.
        low, high: the smallest (largest) value along the path is certainly between these.
        limit: its limit; infinite without one.
        status: "proved", "refuted" or "unproved".
        phase: name of the phase with this value.
        t: time in s of this value, rounded.
        reason: why the claim is not proved.
    """

    name: str
    group: str
    unit: str
    smallest: bool
    low: float
    high: float
    limit: float
    status: str
    phase: str
    t: float
    reason: str = ""

    @property
    def bound(self) -> float:
        """The proved bound: of the smallest value from below, of the largest one from above."""
        return self.low if self.smallest else self.high


@dataclass(frozen=True)
class MotionCurve:
    """A value over time: in the i-th of M cells, from t[i] to t[i + 1], it is certainly between low[i] and high[i]."""

    t: Array
    low: Array
    high: Array


@dataclass(frozen=True)
class PredictedPieces:
    """The predictions around which the motion was enclosed, for a certificate; whoever reads it proves them again.

    Attributes:
        phase: (N,) index of the phase of each piece.
        first, last: (N,) its ends in s.
        coordinates: (order + 1, N, m) coefficients of all coordinates, in powers of x in [-1, 1] on the piece.
        balls: {ball joint: coefficients (order + 1, N, 3, 3) of its rotation}.
        jacobian: (N, rows, passive) derivatives of the loops' gaps in the middle of the pieces; None without loops.
        proved: whether one motion is proved from start to end.
    """

    phase: np.ndarray
    first: Array
    last: Array
    coordinates: Array
    balls: Mapping[str, Array]
    jacobian: Array | None
    proved: bool


@dataclass(frozen=True)
class MotionProof:
    """Claims along one protocol.

    Attributes:
        protocol: its name.
        claims: all claims.
        curves: {(group, name) of a claim: its value over time}.
        pieces: number of pieces on which the mechanism was enclosed.
        cells: number of intervals of time.
        duration: of the protocol in s.
        predicted: what a certificate needs of the pieces; None if nothing was enclosed.
    """

    protocol: str
    claims: tuple[MotionClaim, ...]
    curves: dict[tuple[str, str], MotionCurve]
    pieces: int
    cells: int
    duration: float
    predicted: PredictedPieces | None = None

    def count(self, status: str) -> int:
        """Return the number of claims with a status."""
        return [claim.status for claim in self.claims].count(status)


@dataclass(frozen=True)
class _Round:
    """Everything on the N pieces of one round.

    Attributes:
        pieces: the pieces.
        cells: the M cells of time in them.
        enclosures: all values, on the cells.
        closed: (N,) whether a motion of the passive joints is proved on each piece.
        is_connected: (N - 1,) whether it goes on in that of the next piece.
        linkage: the mechanism on the pieces; None if nothing was enclosed.
    """

    pieces: Pieces
    cells: TimeCells
    enclosures: list[Enclosure]
    closed: np.ndarray
    is_connected: np.ndarray
    linkage: ClosedLinkage | None = None


def prove_motion(
    mechanism: Mechanism,
    path: TimedPath,
    states: States,
    progress: Progress = silent,
) -> MotionProof:
    """Return the claims about the motion of a mechanism along a timed path.

    Args:
        mechanism: the mechanism of the CAD.
        path: the timed path.
        states: solver of the mechanism, for predictions; what it returns is proved, not trusted.
        progress: called with a label and the finished fraction.

    Raises:
        TwinError: the path has a value that is not finite, or the mechanism has a joint that cannot be proved.
    """
    path.require_finite()
    why = supported(mechanism)
    if why:
        raise TwinError(f"{mechanism.name}: the motion cannot be proved: {why}")
    linkage = Linkage(mechanism)
    pieces = first_pieces(len(path.phases))
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        progress(f"{path.protocol}: {len(pieces)} pieces", 0.0)
        judged = _judged(linkage, path, pieces, states)
        for level in range(DEEPEST):
            wide = _to_halve(judged, pieces.level < DEEPEST, pieces.level < _DEEPEST_OPEN)
            if not wide.any() or len(pieces) + wide.sum() > _MOST_PIECES:
                break
            pieces = pieces.halved(wide)
            progress(f"{path.protocol}: {len(pieces)} pieces", (level + 1) / (DEEPEST + 1))
            judged = _judged(linkage, path, pieces, states)
    return _proof(path, judged)


def _judged(linkage: Linkage, path: TimedPath, pieces: Pieces, states: States) -> _Round:
    """Return the enclosures of all values on pieces."""
    places = nodes(ORDER)
    q = []
    slopes = []
    values = []
    for k, phase in enumerate(path.phases):
        phase_pieces = pieces.some(pieces.phase == k)
        on_phase, slope = on_pieces(phase.coefficients, phase_pieces.middle, phase_pieces.half, ORDER)
        q.append(on_phase)
        slopes.append(slope)
        at_nodes = np.polynomial.polynomial.polyval(places, on_phase.c)  # (N, n, nodes)
        values.append(np.moveaxis(at_nodes, -1, 1).reshape(-1, phase.coefficients.shape[1]))
    driven = joined(q)
    rate = joined(slopes)
    closed = closed_linkage(linkage, driven, states(np.concatenate(values)))
    cells = cells_of(pieces, path.phases, ORDER)
    value_enclosures = list(enclosures(linkage, path, cells, driven, rate, closed))
    # pieces are longer than their intervals: the border with the next one lies inside both
    border = np.full(len(pieces), 1.0 / (1.0 + OVERLAP))
    is_connected = np.ones(max(len(pieces) - 1, 0), bool)
    if linkage.closes:
        is_connected = connected(closed, linkage, border, -border)
    return _Round(pieces, cells, value_enclosures, closed.closed, is_connected, closed)


def _to_halve(judged: _Round, possible: np.ndarray, possible_open: np.ndarray) -> np.ndarray:
    """Return (N,) which pieces are too long: the mechanism is not closed there, or a bound is not tight.

    `possible` (N,) says which pieces may be halved, `possible_open` which of those on which no motion is proved.
    """
    still_open = ~judged.closed
    still_open[:-1] |= ~judged.is_connected
    still_open[1:] |= ~judged.is_connected
    if (still_open & ~possible_open).any():
        return np.zeros(len(still_open), bool)  # nothing will be proved of the whole path
    wide = still_open
    for enclosure in judged.enclosures:
        if enclosure.group == groups.LOOP_GAP:
            continue
        loose = _loose(enclosure)
        wide[np.unique(judged.cells.piece[loose])] = True
    return wide & possible


def _loose(enclosure: Enclosure) -> np.ndarray:
    """Return (M,) the cells whose bound alone makes the bound over the whole path too wide."""
    low, high, limit = _as_largest(enclosure)
    certain = float(low.max())  # certainly reached
    if enclosure.group == groups.DETERMINANT:
        tight = certain + np.log(TIGHT)
    elif certain >= 0:
        tight = max(certain * TIGHT, ROUNDING)
    else:
        # a margin: the bound -margin is tight if the margin is not much smaller than one that is reached
        tight = min(certain / TIGHT, certain + 1.0)
        tight = max(tight, certain + ROUNDING)
    loose = high > tight
    # a cell may decide whether the limit is kept
    if np.isfinite(limit) and certain <= limit:
        loose |= high > limit
    return loose & np.isfinite(low)


def _as_largest(enclosure: Enclosure) -> tuple[Array, Array, float]:
    """Return (low, high, limit) of a value that must not exceed its limit."""
    limit = enclosure.limit
    if enclosure.group in SPEEDS:
        limit = limit * (1.0 + SPEED_EXCESS)
    if enclosure.group in MARGINS:
        limit = limit - TOUCHING
    if enclosure.smallest:
        return -enclosure.high, -enclosure.low, -limit
    return enclosure.low, enclosure.high, limit


def _proof(path: TimedPath, judged: _Round) -> MotionProof:
    """Return the claims of the last round."""
    cells = judged.cells
    times = np.zeros(len(cells.piece) + 1)
    for k, phase in enumerate(path.phases):
        phase_cells = np.flatnonzero(cells.phase == k)
        times[phase_cells] = phase.times(cells.first[phase_cells])
        times[phase_cells[-1] + 1] = phase.start + phase.duration
    claims = []
    curves = {}
    for enclosure in _continued(judged):
        claims.append(_claim(path, judged, enclosure, times))
        low = enclosure.low
        high = enclosure.high
        if enclosure.group == groups.DETERMINANT:
            low = np.exp(low)
            high = np.exp(high)
        curves[enclosure.group, enclosure.name] = MotionCurve(times, low, high)
    last = path.phases[-1]
    duration = last.start + last.duration
    return MotionProof(
        protocol=path.protocol,
        claims=tuple(claims),
        curves=curves,
        pieces=len(judged.pieces),
        cells=len(cells.piece),
        duration=duration,
        predicted=_predicted(judged),
    )


def _predicted(judged: _Round) -> PredictedPieces | None:
    """Return the predictions of the last round."""
    if judged.linkage is None:
        return None
    jacobian = None
    if judged.linkage.jacobian is not None:
        jacobian = judged.linkage.jacobian.c[0]
    first, last = judged.pieces.ends
    return PredictedPieces(
        phase=judged.pieces.phase,
        first=first,
        last=last,
        coordinates=judged.linkage.prediction.c,
        balls={name: R.c for name, R in judged.linkage.balls.items()},
        jacobian=jacobian,
        proved=bool(judged.closed.all() and judged.is_connected.all()),
    )


def _continued(judged: _Round) -> list[Enclosure]:
    """Return the enclosures, of which those of bodies are unknown after the motion is no longer proved to go on.

    The motion of the passive joints is that which begins at the start. After a piece on which it may have jumped to
    another assembly, values of that other assembly say nothing about it.
    """
    breaks = np.flatnonzero(~judged.is_connected)
    if not len(breaks):
        return judged.enclosures
    after = judged.cells.piece > breaks[0]
    cut_enclosures = []
    for enclosure in judged.enclosures:
        if enclosure.group not in DRIVEN:
            low = np.where(after, -np.inf, enclosure.low)
            high = np.where(after, np.inf, enclosure.high)
            enclosure = replace(enclosure, low=low, high=high)
        cut_enclosures.append(enclosure)
    return cut_enclosures


def _claim(path: TimedPath, judged: _Round, enclosure: Enclosure, times: Array) -> MotionClaim:
    """Return the claim about the extreme of a value."""
    low, high, limit = _as_largest(enclosure)
    certain = float(low.max())
    bound = float(high.max())
    cell = int(np.argmax(high))
    reason = ""
    if not np.isfinite(bound):
        status = "unproved"
        reason = _reason_unknown(path, judged, times)
    elif certain > limit:
        status = "refuted"
        cell = int(np.argmax(low))
    elif bound <= limit:
        status = "proved"
    else:
        status = "unproved"
        reason = "the bound is not tight enough to decide"
    is_averaged = any(phase.smoothing > 0 for phase in path.phases)
    if enclosure.group in SPEEDS and is_averaged:
        # an average over time is never faster, but what was enclosed is the motion before it
        status = "unproved"
        reason = "the motion is averaged over time to keep a jerk limit"
    smallest = certain
    largest = bound
    limit_of_claim = enclosure.limit
    if enclosure.smallest:
        smallest = -bound
        largest = -certain
    if enclosure.group == groups.DETERMINANT:
        # enclosed by its logarithm; what is claimed is that it is not 0
        smallest = float(np.exp(smallest)) * (1.0 - _EXPONENTIAL_ERROR)
        largest = float(np.exp(largest)) * (1.0 + _EXPONENTIAL_ERROR)
        limit_of_claim = 0.0
    return MotionClaim(
        name=enclosure.name,
        group=enclosure.group,
        unit=enclosure.unit,
        smallest=enclosure.smallest,
        low=smallest,
        high=largest,
        limit=limit_of_claim,
        status=status,
        phase=path.phases[judged.cells.phase[cell]].name,
        t=0.5 * float(times[cell] + times[cell + 1]),
        reason=reason,
    )


def _reason_unknown(path: TimedPath, judged: _Round, times: Array) -> str:
    """Return why a value is unknown somewhere."""
    if judged.closed.all() and judged.is_connected.all():
        return "the bound is infinite"
    if judged.closed.all():
        piece = int(np.flatnonzero(~judged.is_connected)[0]) + 1
        text = "it is not proved that the motion of the passive joints goes on in that of the piece before"
    else:
        piece = int(np.flatnonzero(~judged.closed)[0])
        text = "no motion of the passive joints is proved to exist"
    cell = int(np.flatnonzero(judged.cells.piece == piece)[0])
    name = path.phases[judged.pieces.phase[piece]].name
    return f"in phase '{name}' near t = {times[cell]:.3f} s, {text}"
