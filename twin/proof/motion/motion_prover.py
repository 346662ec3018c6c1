"""Prove limits, speeds, RCM, loops and singularities along a protocol, between the samples as well as at them.

What is proved is a function of continuous time. The driven joints follow q(s(t)): q is the series of each phase that
was timed, s(t) the motion whose (ds/dt)^2 is linear in s between the grid points of the timing. The bodies follow as
the mechanism of the CAD carries them, with closed loops. Its numbers are taken as they are, as floating-point numbers.

    pieces = 15 intervals of s in each phase
    repeat:
        driven joints on the pieces, as Taylor models                       # series
        passive joints that certainly close the loops near predictions      # prediction, closure
        all values that are judged, enclosed in the cells of the pieces     # quantities
        halve the pieces that are not closed, or whose bounds are not tight
    claims about the extremes of the values over the path                   # motion_claims
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.core.errors import TwinError
from twin.core.progress import Progress, silent
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.proof.motion import value_groups as groups
from twin.proof.motion.closure import closed_linkage, connected
from twin.proof.motion.enclosure import Enclosure
from twin.proof.motion.linkage import Linkage, supported
from twin.proof.motion.motion_claims import EnclosedPieces, MotionProof, motion_proof
from twin.proof.motion.path import TimedPath
from twin.proof.motion.pieces import MOST_HALVINGS, OVERLAP, Pieces, first_pieces
from twin.proof.motion.prediction import Poses, chebyshev_nodes
from twin.proof.motion.quantities import enclosures
from twin.proof.motion.series import on_pieces
from twin.proof.motion.taylor import joined
from twin.proof.motion.time_cells import cells_of

ORDER = 5
"""Degree of the Taylor models."""

_TIGHT = 1.1
"""Ratio of an upper bound to a value that is certainly reached, above which pieces are halved."""

_SMALLEST_TIGHT_BOUND = 2e-11
"""Distance in m, rad, m/s or rad/s from a reached value, or from 0, below which no bound is made tighter."""

_MOST_HALVINGS_UNPROVED = 3
"""How often a piece is halved at most on which no motion of the passive joints is proved."""

_MARGIN_STEP = 1.0
"""Difference in m or rad from a reached margin above which its bound is not tight, however large the margin."""

_MOST_PIECES = 6000
"""Largest number of pieces of a path."""

States = Callable[[Array], Poses]
"""Function of driven joint values (k, n) along the path that returns the poses of all bodies."""


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
        enclosed = _enclosed(linkage, path, pieces, states)
        for level in range(MOST_HALVINGS):
            too_long = _too_long(enclosed, pieces.level < MOST_HALVINGS, pieces.level < _MOST_HALVINGS_UNPROVED)
            if not too_long.any() or len(pieces) + too_long.sum() > _MOST_PIECES:
                break
            pieces = pieces.halved(too_long)
            progress(f"{path.protocol}: {len(pieces)} pieces", (level + 1) / (MOST_HALVINGS + 1))
            enclosed = _enclosed(linkage, path, pieces, states)
    return motion_proof(path, enclosed)


def _enclosed(linkage: Linkage, path: TimedPath, pieces: Pieces, states: States) -> EnclosedPieces:
    """Return the enclosures of all values on pieces."""
    nodes = chebyshev_nodes(ORDER)
    q_of_phases = []
    slopes_of_phases = []
    q_at_nodes = []
    for k, phase in enumerate(path.phases):
        phase_pieces = pieces.chosen(pieces.phase == k)
        q, slope = on_pieces(phase.coefficients, phase_pieces.middle, phase_pieces.half, ORDER)
        q_of_phases.append(q)
        slopes_of_phases.append(slope)
        at_nodes = np.polynomial.polynomial.polyval(nodes, q.c)  # (N, n, nodes)
        q_at_nodes.append(np.moveaxis(at_nodes, -1, 1).reshape(-1, phase.coefficients.shape[1]))
    driven = joined(q_of_phases)
    slopes = joined(slopes_of_phases)
    poses = states(np.concatenate(q_at_nodes))
    closed = closed_linkage(linkage, driven, poses)
    cells = cells_of(pieces, path.phases, ORDER)
    value_enclosures = list(enclosures(linkage, path, cells, driven, slopes, closed))
    # pieces are longer than their intervals: the border with the next one lies inside both
    border = np.full(len(pieces), 1.0 / (1.0 + OVERLAP))
    is_connected = np.ones(max(len(pieces) - 1, 0), bool)
    if linkage.closes:
        is_connected = connected(closed, linkage, border, -border)
    return EnclosedPieces(pieces, cells, value_enclosures, closed.closed, is_connected, closed)


def _too_long(enclosed: EnclosedPieces, may_halve: np.ndarray, may_halve_unproved: np.ndarray) -> np.ndarray:
    """Return (N,) which pieces are too long: the mechanism is not closed there, or a bound is not tight.

    Args:
        enclosed: what is known on the N pieces.
        may_halve: (N,) which pieces may be halved.
        may_halve_unproved: (N,) which of them may be halved if no motion of the passive joints is proved there.
    """
    is_unproved = ~enclosed.closed
    is_unproved[:-1] |= ~enclosed.is_connected
    is_unproved[1:] |= ~enclosed.is_connected
    if (is_unproved & ~may_halve_unproved).any():
        return np.zeros(len(is_unproved), bool)  # nothing will be proved of the whole path
    is_too_long = is_unproved
    for enclosure in enclosed.enclosures:
        if enclosure.group == groups.LOOP_GAP:
            continue
        is_loose = _is_loose(enclosure)
        is_too_long[np.unique(enclosed.cells.piece[is_loose])] = True
    return is_too_long & may_halve


def _is_loose(enclosure: Enclosure) -> np.ndarray:
    """Return (M,) whether the bound of a cell alone makes the bound over the whole path too wide."""
    low, high, limit = enclosure.as_largest()
    reached = float(low.max())  # the value is certainly this large somewhere
    if enclosure.group == groups.DETERMINANT:
        tight_bound = reached + np.log(_TIGHT)
    elif reached >= 0:
        tight_bound = max(reached * _TIGHT, _SMALLEST_TIGHT_BOUND)
    else:
        # a margin: the bound -margin is tight if the margin is not much smaller than one that is reached
        tight_bound = min(reached / _TIGHT, reached + _MARGIN_STEP)
        tight_bound = max(tight_bound, reached + _SMALLEST_TIGHT_BOUND)
    is_loose = high > tight_bound
    # a cell may decide whether the limit is kept
    if np.isfinite(limit) and reached <= limit:
        is_loose |= high > limit
    return is_loose & np.isfinite(low)
