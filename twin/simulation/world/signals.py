"""Named signals: all values that the blocks of a World exchange, in one row of numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import WorldError, unknown
from twin.core.spatial import Array

NAME = r"[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)+"
"""Regular expression of signal names."""


def columns(sizes: Mapping[str, int]) -> dict[str, slice]:
    """Return the columns of each signal in a row, from the number of values of each signal."""
    ends = np.cumsum([0, *sizes.values()]).tolist()
    return {name: slice(a, b) for name, a, b in zip(sizes, ends, ends[1:], strict=False)}


class Signals:
    """Vectors in SI by name, "<owner>.<what>", for example `hand.pedal` or `sher.encoder`.

    Reading returns a copy that a block may store. Only the World writes.
    """

    def __init__(self, initial: Mapping[str, ArrayLike]) -> None:
        """Store the initial values, each a number or an array (n,).

        Raises:
            WorldError: a name does not have the form "<owner>.<what>".
        """
        if wrong := [name for name in initial if not re.fullmatch(NAME, name)]:
            raise WorldError(f"signal '{wrong[0]}' must be called <owner>.<what>, in small letters, digits and _")
        values = {name: np.atleast_1d(np.asarray(v, float)).ravel() for name, v in initial.items()}
        self.sizes = {name: len(v) for name, v in values.items()}
        self.row = np.concatenate([*values.values(), []])
        self._columns = columns(self.sizes)

    def __getitem__(self, name: str) -> Array:
        """Return a signal (n,) by name.

        Raises:
            WorldError: there is no such signal.
        """
        try:
            return self.row[self._columns[name]].copy()
        except KeyError:
            raise WorldError(unknown("signal", name, self.sizes)) from None

    def __contains__(self, name: str) -> bool:
        return name in self.sizes

    def write(self, name: str, value: ArrayLike) -> None:
        """Set the value of a signal.

        Raises:
            WorldError: the signal has another number of values.
        """
        value = np.asarray(value, float)
        if value.size != self.sizes[name]:
            raise WorldError(f"signal '{name}' holds {self.sizes[name]} numbers; {value.size} were written")
        self.row[self._columns[name]] = value.ravel()

    def check(self, t: float) -> None:
        """Check that all values are finite.

        Raises:
            WorldError: a value is not finite; the message has the signal and the time `t` in s.
        """
        if not np.isfinite(self.row).all():
            name = next(n for n, c in self._columns.items() if not np.isfinite(self.row[c]).all())
            raise WorldError(f"signal '{name}' is not finite at t = {t:.3f} s: {self[name].tolist()}")
