"""A plan whose timing is judged by a second solver: by toppra if our own passes timed it, and the other way round."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass

from twin.core.findings import Finding
from twin.core.format import quantity
from twin.core.json_types import JsonMapping
from twin.core.result import TextTable
from twin.model.mechanism import Mechanism
from twin.planning import topp, toppra_solver
from twin.planning.plan_result import Planned
from twin.planning.protocol import Protocol, Solver
from twin.planning.trajectory import Trajectory
from twin.validation.durations import Fastest, durations
from twin.validation.result import Residual, state

OTHERS: Mapping[Solver, tuple[Solver, Fastest]] = {
    "passes": ("toppra", toppra_solver.fastest),
    "toppra": ("passes", topp.fastest),
}
"""{solver that timed a phase: (solver that judges it, this solver)}."""


def retimed(
    trajectory: Trajectory, mechanism: Mechanism, protocol: Protocol
) -> tuple[list[Residual], dict[str, str], list[Finding]]:
    """Judge the timing of each phase by the solver that did not time it; see `durations`."""
    return durations(trajectory, mechanism, protocol, OTHERS)


@dataclass(frozen=True)
class CheckedPlan(Planned):
    """A planned trajectory whose timing was judged by a second solver.

    Attributes:
        rows: rows of the residual matrix on the timing.
        durations: {phase: durations by both solvers, as text}.
        judged: findings on the timing.
    """

    rows: Sequence[Residual]
    durations: Mapping[str, str]
    judged: Sequence[Finding]

    @property
    def findings(self) -> Sequence[Finding]:
        """Findings of the check of every sample, then those on the timing."""
        return [*super().findings, *self.judged]

    def content(self) -> JsonMapping:
        """Return the plan as plain data, with the rows on its timing."""
        rows = [asdict(r) | {"agrees": r.agrees} for r in self.rows]
        return {**super().content(), "residuals": rows, "durations": dict(self.durations)}

    def tables(self) -> Iterator[TextTable]:
        """Yield the rows on the timing, then the tables of every plan."""
        judges = dict.fromkeys(OTHERS[p.solver][0] for p in self.trajectory.phases if p.solver is not None)
        rows = [
            (
                r.quantity,
                r.name,
                quantity(r.worst, r.unit),
                "" if r.tolerance is None else quantity(r.tolerance, r.unit),
                r.phase,
                state(r),
            )
            for r in self.rows
        ]
        heading = f"by {' and '.join(judges)}" if judges else "timing"
        yield TextTable((heading, "of", "worst", "tolerance", "phase", ""), rows)
        yield from super().tables()
