"""free: move the driven joints to a waypoint on a path around obstacles, outside the patient."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from twin.core.provenance import Parameter
from twin.core.units import MM
from twin.planning.protocol.phase import WaypointPhase
from twin.planning.protocol.phase_table import PhaseTable
from twin.planning.protocol.protocol_file import ProtocolFile
from twin.planning.protocol.protocol_state import ProtocolState
from twin.schema import Identifier, NotNegative, Positive, at

ETA = (0.1, 0.5)
"""Weights of length and squared tip acceleration in the cost `published`: those of the Raven paper's Table 2."""


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
        Literal["length", "stops", "length_and_stops", "clearance", "published"],
        Field(
            description="what the search minimises: the length of the path; its corners, as if the robot stopped at "
            "each (stops); a weighted sum of both; the length, in which parts within 20 mm of other bodies count up "
            "to ten times (clearance); or eq. (1) of the Raven paper (published; arms without loops only)"
        ),
    ] = "length"
    eta1: Annotated[
        NotNegative | None,
        Field(description='only with cost = "published": weight of the length of joint motion; default 0.1'),
    ] = None
    eta2: Annotated[
        NotNegative | None,
        Field(description='only with cost = "published": weight of the squared tip acceleration; default 0.5'),
    ] = None
    samples: Annotated[
        int,
        Field(
            ge=0,
            le=100_000,
            description="the first path found is improved with at most this number of samples; 0: it is not improved",
        ),
    ] = 0

    rank: ClassVar[int] = 8

    @model_validator(mode="after")
    def _weights(self) -> Self:
        given_weights = [name for name in ("eta1", "eta2") if getattr(self, name) is not None]
        if given_weights and self.cost != "published":
            raise at(given_weights[0], f'has no effect with cost = "{self.cost}": omit it, or set cost = "published"')
        if self.cost == "published" and not any(self._eta()):
            raise at("eta2", "eta1 and eta2 are both 0, so that every path costs the same: set one of them above 0")
        return self

    def _eta(self) -> tuple[float, float]:
        """Return the weights of eq. (1): those given, else those of the paper's Table 2."""
        eta1, eta2 = ETA
        if self.eta1 is not None:
            eta1 = self.eta1
        if self.eta2 is not None:
            eta2 = self.eta2
        return eta1, eta2

    def advance(self, state: ProtocolState) -> None:
        """Check that no RCM is registered, and set the waypoint `to` as the end of the phase."""
        state.require_no_rcm(self.type)
        state.end_at(self.to, "a free motion", "position_mm", "joints")

    def phase(self, protocol_file: ProtocolFile) -> Free:
        """Return the phase that this table describes, in SI units."""
        clearance = self.clearance_mm * MM
        scene = self.scene or ""
        return Free(self.name, self.to, clearance, self.seed, scene, self.cost, self.samples, self._eta())


@dataclass(frozen=True)
class Free(WaypointPhase):
    """Move the driven joints to the waypoint `to`, with a `clearance` in m to obstacles and between the robot's bodies.

    `seed` is the seed of the random search. `scene` is the name or path of the scene with the obstacles, or "" for the
    robot alone. `cost` names what the search minimises (`twin.planning.costs`); `eta` are the weights of length and
    acceleration in the cost `published`. The first path found is improved with at most `samples` samples.
    """

    clearance: float
    seed: int = 0
    scene: str = ""
    cost: str = "length"
    samples: int = 0
    eta: tuple[float, float] = ETA
    type: ClassVar[str] = "free"
    by_joints: ClassVar[bool] = True

    def parameters(self) -> Iterator[Parameter]:
        """Yield the required clearance, with its provenance."""
        note = "minimum distance of the robot's bodies; see the protocol file"
        yield Parameter(f"{self.name}_clearance", self.clearance, "mm", self.clearance / MM, "ASSUMED", note)
