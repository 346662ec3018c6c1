"""Pieces of a path: intervals of the path parameter on which everything is enclosed, halved where bounds are too wide.

The path parameter is from 0 to 1 in each phase.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin.core.spatial import Array

_FIRST_COUNT = 15
"""Number of pieces of a phase at the beginning; halved 4, 5 or 6 times, they are 240, 480 or 960 intervals."""

MOST_HALVINGS = 9
"""How often a piece is halved at most."""

OVERLAP = 1e-9
"""Fraction by which a piece is longer than the interval that it stands for, so that rounded borders lie inside."""


@dataclass(frozen=True)
class Pieces:
    """N intervals of the phases of a path, in the order of time.

    Attributes:
        phase: (N,) index of the phase.
        level: (N,) how often a first piece was halved.
        place: (N,) index among the `_FIRST_COUNT` * 2**level pieces of this level.
    """

    phase: np.ndarray
    level: np.ndarray
    place: np.ndarray

    def __len__(self) -> int:
        """Return the number of pieces."""
        return len(self.phase)

    @property
    def counts(self) -> Array:
        """(N,) number of pieces of the level in a phase."""
        # A power of two times a small integer is exact in double precision, so that borders of all levels meet
        # exactly.
        return _FIRST_COUNT * 2.0**self.level

    @property
    def middle(self) -> Array:
        """(N,) middle in the path parameter, 0 to 1."""
        return (self.place + 0.5) / self.counts

    @property
    def half(self) -> Array:
        """(N,) half of the length in the path parameter, longer by `OVERLAP`."""
        return 0.5 / self.counts * (1.0 + OVERLAP)

    @property
    def ends(self) -> tuple[Array, Array]:
        """(first (N,), last (N,)) value of the path parameter, without `OVERLAP`."""
        return self.place / self.counts, (self.place + 1) / self.counts

    def chosen(self, indices_or_mask: np.ndarray) -> Pieces:
        """Return some of the pieces, given by their indices (m,) or by a mask (N,)."""
        return Pieces(self.phase[indices_or_mask], self.level[indices_or_mask], self.place[indices_or_mask])

    def halved(self, is_halved: np.ndarray) -> Pieces:
        """Return the pieces, of which those of a mask (N,) are halved."""
        parts = np.where(is_halved, 2, 1)
        whole = np.repeat(np.arange(len(self)), parts)  # of each new piece, the piece of which it is a part
        # A halved piece occurs twice in a row; only its second occurrence equals the entry before.
        is_second_half = np.concatenate([[False], whole[1:] == whole[:-1]])
        repeated = self.chosen(whole)
        is_half = is_halved[whole]
        level = np.where(is_half, repeated.level + 1, repeated.level)
        place = np.where(is_half, 2 * repeated.place + is_second_half, repeated.place)
        return replace(repeated, level=level, place=place)


def first_pieces(phases: int) -> Pieces:
    """Return the first pieces of all phases."""
    phase = np.repeat(np.arange(phases), _FIRST_COUNT)
    return Pieces(phase, np.zeros(len(phase), int), np.tile(np.arange(_FIRST_COUNT), phases))
