"""Samples out of many: which rows of a long table to show, to test or to start from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def spread(count: int, most: int) -> NDArray[np.int64]:
    """Return at most `most` indices of `count` items in order, evenly spread; the first and the last are among them.

    Without items there are no indices.

    Raises:
        ValueError: `most` is below 2, so that first and last cannot both be among them.
    """
    if most < 2:
        raise ValueError(f"at most {most} indices: give at least 2, for the first and the last")
    if count < 1:
        return np.zeros(0, np.int64)
    places = np.linspace(0, count - 1, most)
    return np.unique(places.astype(np.int64))
