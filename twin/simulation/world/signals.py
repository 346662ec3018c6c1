"""Named signals: all values that the blocks of a World exchange, in one row of numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import WorldError, unknown
from twin.core.spatial import Array

NAME = r"[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)+"
"""Regular expression of signal names."""


def columns(sizes: Mapping[str, int]) -> dict[str, slice]:
    """Return {signal: its columns in a row}; `sizes` is {signal: number of values}, in the order of the row."""
    slices = {}
    start = 0
    for name, size in sizes.items():
        slices[name] = slice(start, start + size)
        start += size
    return slices


class Signals:
    """Vectors in SI by name, "<owner>.<what>", for example `hand.pedal` or `sher.encoder`.

    Reading returns a copy that a block may store. The World writes what the steps of blocks return; a fast block writes
    its own outputs itself, into the memory that it receives in `Block.attach`.

    Attributes:
        now: the current values (n,) without a copy, for fast blocks; they are read-only and valid until the next write.
        row: all values.
        sizes: {signal: number of values}.
    """

    def __init__(self, initial: Mapping[str, ArrayLike]) -> None:
        """Store the initial values, each a number or an array (n,).

        Raises:
            WorldError: a name does not have the form "<owner>.<what>".
        """
        values = []
        self.sizes: dict[str, int] = {}
        for name, value in initial.items():
            if not re.fullmatch(NAME, name):
                raise WorldError(f"signal '{name}' must be called <owner>.<what>, in lower-case letters, digits and _")
            vector = np.asarray(value, float).ravel()
            values.append(vector)
            self.sizes[name] = len(vector)
        self.row = np.concatenate([*values, []])  # []: a World without signals has a row of no values
        self._views: dict[str, Array] = {}
        read_only: dict[str, Array] = {}
        for name, place in columns(self.sizes).items():
            self._views[name] = self.row[place]
            read_only[name] = self.row[place]
        self.now = _Now(read_only)

    def __getitem__(self, name: str) -> Array:
        """Return a signal (n,) by name.

        Raises:
            WorldError: there is no such signal.
        """
        return self.now[name].copy()

    def __contains__(self, name: str) -> bool:
        return name in self.sizes

    def view(self, name: str) -> Array:
        """Return the memory (n,) of a signal, into which `put` writes."""
        return self._views[name]

    def check(self, t: float) -> None:
        """Check that all values are finite.

        Raises:
            WorldError: a value is not finite; the message has the signal and the time `t` in s.
        """
        # The sum of squares is finite if all values are finite and below 1e150. Otherwise, test each value.
        if not math.isfinite(self.row @ self.row) and not np.isfinite(self.row).all():
            for name, view in self._views.items():
                if not np.isfinite(view).all():
                    raise WorldError(f"signal '{name}' is not finite at t = {t:.3f} s: {view.tolist()}")


class _Now(dict[str, Array]):
    """Views of signals; a missing name raises a `WorldError`."""

    def __init__(self, views: Mapping[str, Array]) -> None:
        super().__init__(views)
        for view in self.values():
            view.flags.writeable = False

    def __missing__(self, name: str) -> Array:
        raise WorldError(unknown("signal", name, self))


def put(view: Array, name: str, value: ArrayLike) -> None:
    """Write a signal into its memory (n,).

    Raises:
        WorldError: the value has another size.
    """
    if type(value) is float and view.size == 1:
        view[0] = value  # faster than the general case
        return
    value = np.asarray(value, float)
    if value.size != view.size:
        raise WorldError(f"signal '{name}' has {view.size} numbers; {value.size} were written")
    view[...] = value.ravel()
