"""Results of the independent model: one state, or states along samples."""

from __future__ import annotations

from dataclasses import dataclass

from twin.core.spatial import Array


@dataclass(frozen=True)
class Assembly:
    """A solved state of the mechanism.

    Attributes:
        T_base_tool: (4, 4).
        q: (n,) active joints.
        q_full: coordinate in m or rad of each joint that has a single one, tree and loop alike.
        link_poses: T_base_body (4, 4) by body.
        points: named points in base (3,).
        gap: by loop, offset in m and misalignment in rad in the locked directions of the joint.
        x: the configuration in Pinocchio's coordinates, to start the next solution from.
    """

    T_base_tool: Array
    q: Array
    q_full: dict[str, float]
    link_poses: dict[str, Array]
    points: dict[str, Array]
    gap: dict[str, tuple[float, float]]
    x: Array

    @property
    def worst_gap(self) -> float:
        """Largest loop offset in metres (0 without loops)."""
        return max((g[0] for g in self.gap.values()), default=0.0)


@dataclass(frozen=True)
class Run:
    """Solved states along samples, arrays time first.

    Attributes:
        x: (k, nq) configurations.
        q: (k, n) active joints.
        Ts_base_tool: (k, 4, 4).
        q_passive: (k,) by passive joint with one coordinate.
        points: (k, 3) by named point, in base.
        gaps: (k, loops, 2) offset in m, misalignment in rad.
        loop_names: names for the second axis of `gaps`.
    """

    x: Array
    q: Array
    Ts_base_tool: Array
    q_passive: dict[str, Array]
    points: dict[str, Array]
    gaps: Array
    loop_names: tuple[str, ...]
