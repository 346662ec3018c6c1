"""The cells of time of a path: intervals of s, each within one piece and between two grid points of the timing.

Between two grid points, (ds/dt)^2 is linear in s: on a cell, values that depend on time are polynomials of one
variable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.proof.motion.path import TimedPhase
from twin.proof.motion.pieces import Pieces
from twin.proof.motion.taylor import TaylorModel
from twin.proof.rounding import UNIT_ROUNDOFF

_CELL_OVERLAP = 1e-12
"""Fraction by which a cell is longer than the interval that it stands for."""

_MIDDLE_ERROR = 4 * UNIT_ROUNDOFF
"""Bound of the rounding of the middle of a cell, in s, which is at most 1."""

_SHORTEST_CELL = 16 * UNIT_ROUNDOFF
"""Distance in s from the end of a piece within which a grid point is no new cell: it is that end, rounded."""

_BESIDE_SEGMENT = 4 * _SHORTEST_CELL
"""Bound of how far in s a cell reaches beyond its segment between two grid points, by its overlap and by rounding."""

_SQUARE_ROUNDINGS = 32
"""Bound of the number of roundings in the value of a segment at a place: squares, slope, distance and sum."""


@dataclass(frozen=True)
class TimeCells:
    """M intervals in which values are enclosed, in the order of time.

    Attributes:
        piece: (M,) index of the piece.
        phase: (M,) index of the phase.
        first, last: (M,) both ends in s.
        middle, width: (M,) the cell in the variable of its piece.
        square: (M,) models of (ds/dt)^2.
    """

    piece: np.ndarray
    phase: np.ndarray
    first: Array
    last: Array
    middle: Array
    width: Array
    square: TaylorModel

    def of(self, model: TaylorModel) -> TaylorModel:
        """Return functions (N, ...) on pieces as functions (M, ...) on cells."""
        chosen = model[self.piece]
        shape = (-1,) + (1,) * (len(chosen.shape) - 1)
        return chosen.on_parts(self.middle.reshape(shape), self.width.reshape(shape))


def cells_of(pieces: Pieces, phases: tuple[TimedPhase, ...], order: int) -> TimeCells:
    """Return the cells of pieces."""
    first_of_pieces, last_of_pieces = pieces.ends
    piece = []
    first = []
    last = []
    for piece_number in range(len(pieces)):
        piece_start = first_of_pieces[piece_number]
        piece_end = last_of_pieces[piece_number]
        grid = phases[pieces.phase[piece_number]].grid
        inside = grid[(grid > piece_start + _SHORTEST_CELL) & (grid < piece_end - _SHORTEST_CELL)]
        edges = np.concatenate([[piece_start], inside, [piece_end]])
        piece.append(np.full(len(edges) - 1, piece_number))
        first.append(edges[:-1])
        last.append(edges[1:])
    index = np.concatenate(piece)
    start = np.concatenate(first)
    end = np.concatenate(last)
    # longer by the rounding of its middle as well
    half = 0.5 * (end - start) * (1.0 + _CELL_OVERLAP) + _MIDDLE_ERROR
    centre = 0.5 * (start + end)
    scale = pieces.half[index]
    phase = pieces.phase[index]
    return TimeCells(
        piece=index,
        phase=phase,
        first=start,
        last=end,
        middle=(centre - pieces.middle[index]) / scale,
        width=half / scale,
        square=_squared_rates(phases, phase, centre, half, order),
    )


def _squared_rates(
    phases: tuple[TimedPhase, ...], phase: np.ndarray, centre: Array, half: Array, order: int
) -> TaylorModel:
    """Return models (M,) of (ds/dt)^2, linear in s, on cells.

    Args:
        phases: the phases.
        phase: (M,) index of the phase of each cell.
        centre: (M,) middle of each cell in s.
        half: (M,) half of its length in s.
        order: degree of the models.
    """
    c = np.zeros((order + 1, len(centre)))
    r = np.zeros(len(centre))
    for k, timed in enumerate(phases):
        in_phase = phase == k
        squares = timed.rates**2  # at the grid points
        segment = np.clip(np.searchsorted(timed.grid, centre[in_phase], side="right") - 1, 0, len(squares) - 2)
        slopes = np.diff(squares) / np.diff(timed.grid)
        slope = slopes[segment]
        # near an end the cell may reach into the next segment by the rounding of s
        beside = np.abs(np.concatenate([slopes[:1], slopes, slopes[-1:]]))
        steepest = np.maximum(np.maximum(beside[segment], beside[segment + 1]), beside[segment + 2])
        c[0, in_phase] = squares[segment] + (centre[in_phase] - timed.grid[segment]) * slope
        if order > 0:
            c[1, in_phase] = slope * half[in_phase]
        rounding = _SQUARE_ROUNDINGS * UNIT_ROUNDOFF * (squares[segment] + squares[segment + 1])
        r[in_phase] = rounding + _BESIDE_SEGMENT * steepest
    return TaylorModel(c, r)
