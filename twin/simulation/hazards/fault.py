"""A fault changes one or several numbers of a signal from a start time to an end time."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import WorldError, unknown
from twin.core.json_types import JsonMapping
from twin.core.spatial import Array
from twin.simulation.world import Hazard

if TYPE_CHECKING:
    from twin.simulation.setup import Setup

Operation = Literal["hold", "overwrite", "add", "add_once", "delay", "skip", "duplicate"]
"""How a fault changes a signal. hold: the last value before the fault; overwrite: `value`; add: the sum with `value`;
add_once: as add, but the change remains after the fault's end; delay: the signal as it was `value` steps earlier; skip:
a packet is lost; duplicate: a packet arrives twice."""


@dataclass
class Fault(Hazard):
    """A fault of a signal in a World or in a machine; each fault can be used only once.

    Attributes:
        signal: name of the signal.
        start, stop: the fault acts at start <= t < stop; both are times in s or, with `counts`, packet numbers.
        operation, value: see `Operation`; `value` is one number, or one for each number of the signal.
        target: index or indices of the changed numbers in the signal; None: all.
        counts: whether `start` and `stop` are packet numbers.
    """

    signal: str
    start: float
    stop: float
    operation: Operation
    value: ArrayLike = 0.0
    target: int | list[int] | None = None
    counts: bool = False
    # state, for which a fault can be used only once: the last value before "hold", and the latest values for "delay"
    _last_faultless: Array | None = field(default=None, repr=False)
    _recent: deque[Array] = field(default_factory=deque, repr=False)

    def __post_init__(self) -> None:
        if self.operation not in get_args(Operation):
            raise WorldError(f"fault of {self.signal}: {unknown('operation', self.operation, get_args(Operation))}")
        if not self.start < self.stop:
            raise WorldError(
                f"fault of {self.signal}: its stop is {self.stop:g}; it must be after its start, {self.start:g}"
            )
        if isinstance(self.target, list) and not self.target:
            raise WorldError(
                f"fault of {self.signal}: target is []; give an index, or leave target out for all numbers"
            )
        value = np.asarray(self.value, float)
        if not np.isfinite(value).all():
            raise WorldError(f"fault of {self.signal}: the value is {self.value}; it must be finite")
        is_step_count = value.ndim == 0 and value >= 1 and float(value).is_integer()
        if self.operation == "delay" and not is_step_count:
            raise WorldError(f"fault of {self.signal}: a delay of {self.value} steps; give a whole number above 0")

    def copies(self, t: float) -> int:
        """Return how many times the value at t arrives: 0 (lost), 1 or 2."""
        if not self._is_active(t):
            return 1
        return {"skip": 0, "duplicate": 2}.get(self.operation, 1)

    def change(self, t: float, value: Array) -> Array:
        """Return the value that readers of the signal get at t instead of `value` (n,).

        It must be called in each step of the signal, also before the fault: "hold" and "delay" remember values.
        """
        is_active = self._is_active(t)
        # before the fault, too: it shows values from before its start
        if self.operation == "delay":
            self._recent.append(value.copy())
            if len(self._recent) > int(np.asarray(self.value)) + 1:
                self._recent.popleft()
        if self.operation == "hold" and (self._last_faultless is None or not is_active):
            self._last_faultless = value.copy()
        remains = self.operation == "add_once" and t >= self.stop
        if not (is_active or remains):
            return value
        if np.shape(self.value) not in ((), value.shape):
            raise WorldError(
                f"fault of {self.signal}: {np.size(self.value)} values for a signal of {len(value)} numbers"
            )
        faulty = self._faulty(value)
        if self.target is None:
            return faulty
        changed = value.copy()
        try:
            changed[self.target] = faulty[self.target]
        except IndexError as error:
            text = f"target {self.target} is outside a signal of {len(value)} numbers"
            raise WorldError(f"fault of {self.signal}: {text}") from error
        return changed

    def _is_active(self, t: float) -> bool:
        return self.start <= t < self.stop

    def _faulty(self, value: Array) -> Array:
        """Return the value (n,) as the operation changes it, for all numbers of the signal."""
        if self.operation == "hold":
            assert self._last_faultless is not None
            return self._last_faultless
        if self.operation == "overwrite":
            return np.broadcast_to(np.asarray(self.value, float), value.shape)
        if self.operation == "delay":
            return self._recent[0]
        if self.operation in ("skip", "duplicate"):  # see `copies`; the content of the packet stays
            return value
        return value + np.asarray(self.value, float)


def from_scene(name: str, settings: JsonMapping, setup: Setup) -> Fault:
    """Return the fault that a section [hazard.NAME] of a scene describes; `settings` has the attributes of `Fault`.

    Raises:
        WorldError: the fault acts on packets, which only machines have.
    """
    fault = Fault(**settings)
    if fault.counts or fault.operation in ("skip", "duplicate"):
        text = (
            "acts on the packets of a machine; a scene needs hold, overwrite, add, add_once or delay, with times in s"
        )
        raise WorldError(f"fault of {fault.signal}: {text}")
    return fault
