"""Results of the independent model: one state, or states at many samples."""

from __future__ import annotations

from dataclasses import dataclass

from twin.core.spatial import Array


@dataclass(frozen=True)
class Assembly:
    """A solved state of the mechanism.

    Attributes:
        T_base_tool: (4, 4) pose of the tool.
        q: (n,) active joint values in m or rad.
        q_full: {name: value in m or rad} of the joints with a single coordinate, including loop joints.
        link_poses: T_base_body (4, 4) by name of the body.
        points: named points (3,) in base, in m.
        gap: {name: (offset in m, rotation in rad)} of the loop joints, in their locked directions.
        x: (nq,) configuration in Pinocchio's coordinates; further solutions can start from this configuration.
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
        """Largest loop offset in m; 0 without loops."""
        return max((g[0] for g in self.gap.values()), default=0.0)


@dataclass(frozen=True)
class SolvedSamples:
    """Solved states at k samples; the first axis of each array is the sample.

    Attributes:
        x: (k, nq) configurations.
        q: (k, n) active joint values in m or rad.
        Ts_base_tool: (k, 4, 4) tool poses.
        q_passive: {name: values (k,) in m or rad} of the passive joints with a single coordinate.
        points: positions (k, 3) of each named point in base, in m.
        gaps: (k, loops, 2) loop gaps: offset in m, rotation in rad.
        loop_names: names of the loops, in the order of the second axis of `gaps`.
    """

    x: Array
    q: Array
    Ts_base_tool: Array
    q_passive: dict[str, Array]
    points: dict[str, Array]
    gaps: Array
    loop_names: tuple[str, ...]
