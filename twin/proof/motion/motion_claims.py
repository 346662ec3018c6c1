"""What is claimed along a path, from all values enclosed on its pieces: each claim is about an extreme of one value.

A value is certainly between `low` and `high` in each cell of time. Its largest value over the path is then at least the
largest `low` and at most the largest `high`: if the first exceeds the limit, the claim is refuted; if the second does
not, it is proved; otherwise nothing is known. Of a smallest value, the negative is judged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from twin.core.spatial import Array
from twin.proof.motion import value_groups as groups
from twin.proof.motion.closure import ClosedLinkage
from twin.proof.motion.enclosure import Enclosure
from twin.proof.motion.path import TimedPath
from twin.proof.motion.pieces import Pieces
from twin.proof.motion.time_cells import TimeCells

_EXPONENTIAL_ERROR = 1e-12
"""Bound of the relative rounding error of the exponential of a logarithm of a determinant."""


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
class EnclosedPieces:
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


def motion_proof(path: TimedPath, judged: EnclosedPieces) -> MotionProof:
    """Return the claims about all values on the pieces."""
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


def _predicted(judged: EnclosedPieces) -> PredictedPieces | None:
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


def _continued(judged: EnclosedPieces) -> list[Enclosure]:
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
        if enclosure.group not in groups.DRIVEN:
            low = np.where(after, -np.inf, enclosure.low)
            high = np.where(after, np.inf, enclosure.high)
            enclosure = replace(enclosure, low=low, high=high)
        cut_enclosures.append(enclosure)
    return cut_enclosures


def _claim(path: TimedPath, judged: EnclosedPieces, enclosure: Enclosure, times: Array) -> MotionClaim:
    """Return the claim about the extreme of a value."""
    low, high, limit = enclosure.as_largest()
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
    if enclosure.group in groups.SPEEDS and is_averaged:
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


def _reason_unknown(path: TimedPath, judged: EnclosedPieces, times: Array) -> str:
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
