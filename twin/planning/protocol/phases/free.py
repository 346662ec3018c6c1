"""free: move the driven joints to a waypoint on a path around obstacles, outside the patient."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from twin.core.provenance import Parameter
from twin.core.units import MM
from twin.planning.protocol.phase import PhaseTable, Reaching, Walk
from twin.schema import Identifier, Positive


class FreeTable(PhaseTable):
    """Move the driven joints to a waypoint on a path around obstacles, outside the patient."""

    type: Literal["free"]
    to: Identifier
    clearance_mm: Annotated[
        Positive, Field(description="minimum distance of the robot's bodies from each other and from the scene")
    ] = 5.0
    seed: Annotated[int, Field(ge=0, description="seed of the random search; the same seed gives the same path")] = 0
    scene: Annotated[
        str | None,
        Field(min_length=1, description="a scene with this robot: its props and other robots, as drawn, are obstacles"),
    ] = None
    cost: Annotated[
        Literal["length", "stops", "length_and_stops", "clearance"],
        Field(
            description="what the search minimises: the length of the path; its corners, as if the robot stopped at "
            "each (stops); a weighted sum of both; or the length, in which parts within 20 mm of other bodies count up "
            "to ten times"
        ),
    ] = "length"
    samples: Annotated[
        int,
        Field(
            ge=0,
            le=100_000,
            description="the first path found is improved with at most this number of samples; 0: it is not improved",
        ),
    ] = 0

    rank: ClassVar[int] = 8

    def follow(self, walk: Walk) -> None:
        """Check that no RCM is registered, and set the waypoint `to` as the end of the phase."""
        walk.outside(self.type)
        walk.go(self.to, "a free motion", "position_mm", "joints")

    def phase(self, walk: Walk) -> Free:
        """Return the phase that this table describes, in SI units."""
        return Free(self.name, self.to, self.clearance_mm * MM, self.seed, self.scene or "", self.cost, self.samples)


@dataclass(frozen=True)
class Free(Reaching):
    """Move the driven joints to the waypoint `to`, with a `clearance` in m to obstacles and between the robot's bodies.

    `seed` is the seed of the random search. `scene` is the name or path of the scene with the obstacles, or "" for the
    robot alone. `cost` names what the search minimises (`twin.planning.costs`). The first path found is
    improved with at most `samples` samples.
    """

    clearance: float
    seed: int = 0
    scene: str = ""
    cost: str = "length"
    samples: int = 0
    type: ClassVar[str] = "free"
    by_joints: ClassVar[bool] = True

    def parameters(self) -> Iterator[Parameter]:
        """Yield the required clearance, with its provenance."""
        note = "minimum distance of the robot's bodies; see the protocol file"
        yield Parameter(f"{self.name}_clearance", self.clearance, "mm", self.clearance / MM, "ASSUMED", note)
