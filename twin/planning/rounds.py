"""Rounds of the search of a free phase: number of samples, cost of the best path, and time after each round."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

from twin.core.json_types import JsonObject

UNITS: Mapping[str, str] = MappingProxyType(
    {"length": "m", "stops": "m2/s3", "length_and_stops": "", "clearance": "m", "published": ""}
)
"""{name of a cost in `twin.planning.costs.COSTS`: its unit}; "" for a sum of different units."""


@dataclass(frozen=True)
class SearchRound:
    """State of a path search at the end of one of its rounds.

    Costs are those of the straight connections between the corners of a path, in the unit of the search's cost.
    Costs are the same in every run; times are not, and comparisons leave out times.

    Attributes:
        samples: number of collision-free samples in the tree.
        tree: cost of the path in the tree, without shortcuts; infinite if the tree contains no path to the goal.
        best: cost of the best path found so far, with shortcuts; infinite if no path has been found.
        processor: processor time in s since the start of the first round.
        wall: wall-clock time in s since the start of the first round.
    """

    samples: int
    tree: float
    best: float
    processor: float = field(compare=False)
    wall: float = field(compare=False)


@dataclass(frozen=True)
class SearchRounds:
    """The rounds of the path search in one phase, in order; at least one.

    Attributes:
        cost: name of what the search minimises (`twin.planning.costs.COSTS`).
        rounds: the rounds.
    """

    cost: str
    rounds: Sequence[SearchRound]

    @property
    def unit(self) -> str:
        """Unit of the costs; "" for a sum of different units."""
        return UNITS[self.cost]

    def as_dict(self) -> JsonObject:
        """Return plain data without times, so that every run returns the same data; a cost None means "no path"."""
        samples = []
        tree = []
        best = []
        for search_round in self.rounds:
            samples.append(search_round.samples)
            tree.append(_finite(search_round.tree))
            best.append(_finite(search_round.best))
        return {"cost": self.cost, "unit": self.unit, "samples": samples, "tree": tree, "best": best}

    def times(self) -> dict[str, list[float]]:
        """Return processor time and wall-clock time in s at the end of each round."""
        processor = []
        wall = []
        for search_round in self.rounds:
            processor.append(search_round.processor)
            wall.append(search_round.wall)
        return {"processor_s": processor, "wall_s": wall}


def _finite(value: float) -> float | None:
    """Return a cost for JSON, which has no infinity: None instead."""
    if not math.isfinite(value):
        return None
    return value
