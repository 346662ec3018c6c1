"""A plan whose timing is judged by a second solver: by toppra if our own passes timed it, and the other way round."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass

from twin.core.findings import Finding
from twin.core.format import deviation, quantity
from twin.core.json_types import JsonMapping
from twin.core.result import TextTable
from twin.model.mechanism import Mechanism
from twin.planning import topp, toppra_solver
from twin.planning.plan_result import Planned
from twin.planning.protocol import Protocol, Solver
from twin.planning.trajectory import Trajectory
from twin.validation.result import Residual, row_verdict
from twin.validation.retiming import Fastest, judge_durations

OTHERS: Mapping[Solver, tuple[Solver, Fastest]] = {
    "passes": ("toppra", toppra_solver.fastest),
    "toppra": ("passes", topp.fastest),
}
"""{solver that timed a phase: (solver that judges it, this solver)}."""


def retimed(
    trajectory: Trajectory, mechanism: Mechanism, protocol: Protocol
) -> tuple[list[Residual], dict[str, str], list[Finding]]:
    """Judge the timing of each phase by the solver that did not time it; see `judge_durations`.

    Returns:
        rows, durations and findings, as in a `CheckedPlan`.
    """
    return judge_durations(trajectory, mechanism, protocol, OTHERS)


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
        rows = []
        for row in self.rows:
            rows.append(asdict(row) | {"agrees": row.agrees})
        return {**super().content(), "residuals": rows, "durations": dict(self.durations)}

    def tables(self) -> Iterator[TextTable]:
        """Yield the rows on the timing, then the tables of every plan."""
        judges: list[str] = []
        for phase in self.trajectory.phases:
            if phase.solver is not None and OTHERS[phase.solver][0] not in judges:
                judges.append(OTHERS[phase.solver][0])
        cells = []
        for row in self.rows:
            tolerance = ""
            if row.tolerance is not None:
                tolerance = quantity(row.tolerance, row.unit)
            worst = deviation(row.worst, row.unit, row.tolerance)
            cells.append((row.quantity, row.name, worst, tolerance, row.phase, row_verdict(row)))
        heading = "timing"
        if judges:
            heading = f"by {' and '.join(judges)}"
        yield TextTable((heading, "of", "worst", "tolerance", "phase", ""), cells)
        yield from super().tables()
