"""Judge a task with rings from the recorded poses: transferred and dropped rings, collisions of instruments, time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.movable import Movable
from twin.model.scene import Task
from twin.simulation.contact_scene import Peg
from twin.simulation.session.movement import runs
from twin.simulation.world import Recording

_FALL = 10 * MM
"""Minimum fall in m of a ring that is not held, to count as a drop; ASSUMED."""

_SHORT = 0.25
"""Minimum duration in s of an interruption that ends a grasp or a collision; ASSUMED."""


@dataclass(frozen=True)
class RingResult:
    """Result of one ring.

    Attributes:
        ring, peg: names of ring and peg.
        t: time in s from which the ring is around its peg, not held, until the end; None: it is not.
        drops: number of times that it has been dropped.
    """

    ring: str
    peg: str
    t: float | None
    drops: int


@dataclass(frozen=True)
class BoardMeasures:
    """Measures of the peg board, named as in the paper.

    Attributes:
        rings: result of each ring.
        collisions: number of collisions of an instrument with a fixed part, or with the other instrument.
        time: t_PB, time in s from the first moment in which an arm follows its hand until the last ring is transferred;
            until the end of the session if a ring is not transferred.
    """

    rings: Sequence[RingResult]
    collisions: int
    time: float

    @property
    def transferred(self) -> int:
        """Number of rings that lie around their pegs at the end; n_RTC."""
        return sum(r.t is not None for r in self.rings)

    @property
    def dropped(self) -> int:
        """Number of drops; n_RD."""
        return sum(r.drops for r in self.rings)

    @property
    def errors(self) -> int:
        """Drops and collisions; n_Err."""
        return self.dropped + self.collisions


def measure(
    kept: Recording, task: Task, objects: Sequence[Movable], pegs: Mapping[str, Peg], robots: Sequence[str]
) -> BoardMeasures:
    """Return the measures of a task with transfers.

    Args:
        kept: signals of the session, with `<ring>.pose`, `<ring>.holder`, and `touches`, `meets` of each robot.
        task: the task.
        objects: the objects of the scene.
        pegs: the pegs, by name.
        robots: the instruments.
    """
    shapes = {o.name: o for o in objects}
    rings = [_ring(kept, t.ring, shapes[t.ring].size[0], pegs[t.peg]) for t in task.transfers]
    few = round(_SHORT / kept.dt)
    collisions = sum(len(_merged(kept[f"{name}.touches"][:, 0] > 0.5, few)) for name in robots)
    met = np.any([kept[f"{name}.meets"][:, 0] > 0.5 for name in robots], axis=0)
    begun = np.flatnonzero(np.any([kept[f"{name}.follows"][:, 0] > 0.5 for name in robots], axis=0))
    start = float(kept.t[begun[0]]) if len(begun) else 0.0
    end = max((float(kept.t[-1]) + kept.dt if r.t is None else r.t for r in rings), default=start)
    return BoardMeasures(rings, collisions + len(_merged(met, few)), end - start)


def around(Ts: Array, radius: float, peg: Peg) -> np.ndarray:
    """Return (k,) bool: whether the peg passes through the hole of a ring at poses Ts (k, 4, 4) in the World.

    It does if the peg's axis intersects the plane of the ring at less than `radius` in m from the ring's centre.
    """
    n, middle = Ts[:, :3, 2], Ts[:, :3, 3]
    way = peg.end - peg.foot
    slope = n @ way
    s = np.sum(n * (middle - peg.foot), axis=1) / np.where(np.abs(slope) < 1e-12, np.inf, slope)
    cut = peg.foot + s[:, None] * way
    return (np.abs(slope) >= 1e-12) & (s >= 0) & (s <= 1) & (np.linalg.norm(cut - middle, axis=1) < radius)


def _ring(kept: Recording, name: str, radius: float, peg: Peg) -> RingResult:
    Ts = kept[f"{name}.pose"].reshape(-1, 4, 4)
    held = np.zeros(len(Ts), bool)
    for a, b in _merged(kept[f"{name}.holder"][:, 0] >= 0, round(_SHORT / kept.dt)):
        held[a : b + 1] = True
    placed = around(Ts, radius, peg) & ~held
    drops = 0
    for a, b in runs(~held):
        after_grasp = a > 0
        if after_grasp and not placed[b] and Ts[a, 2, 3] - Ts[b, 2, 3] > _FALL:
            drops += 1
    last = runs(placed)[-1] if placed[-1:].any() else None
    return RingResult(name, peg.name, None if last is None else float(kept.t[last[0]]), drops)


def _merged(flags: np.ndarray, few: int) -> list[tuple[int, int]]:
    """Return the runs of true values in flags (k,); runs that are at most `few` apart are joined."""
    out: list[tuple[int, int]] = []
    for a, b in runs(flags):
        if out and a - out[-1][1] <= few:
            out[-1] = out[-1][0], b
        else:
            out.append((a, b))
    return out
