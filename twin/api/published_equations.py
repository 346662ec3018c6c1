"""Check published equations that are not kinematics: equations of motion, and those of a surgeon's console."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from twin.api.robot import Robot
from twin.api.robot_loading import loaded
from twin.core.errors import TwinError, unknown
from twin.core.findings import Finding, by_severity
from twin.core.json_types import JsonObject
from twin.core.progress import Progress, silent
from twin.core.result import Part, Result, TextTable

if TYPE_CHECKING:
    from twin.validation.closed_form import JudgedForm
    from twin.validation.console_result import ConsoleResult


@dataclass(frozen=True)
class PublishedMotion(Result):
    """Published equations of motion, compared with the dynamics of the mechanism.

    Attributes:
        source: document of the equations.
        states: number of random states.
        judged: row of each compared term, cause of the differences, and findings.
    """

    robot: str
    source: str
    states: int
    judged: JudgedForm

    kind = "motion"

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on terms that differ between equations and mechanism, and on properties that are violated."""
        return tuple(self.judged.findings)

    def content(self) -> JsonObject:
        """Return the compared rows, the cause of the differences, and the violated properties, as plain data."""
        rows = []
        for row in self.judged.rows:
            rows.append({"term": row.term, "worst": row.worst, "unit": row.unit, "limit": row.limit})
        return {
            "name": self.robot,
            "source": self.source,
            "states": self.states,
            "cause": self.judged.cause,
            "rows": rows,
            "power_balance": self.judged.balance,
            "smallest_eigenvalue": self.judged.least,
        }

    def text(self) -> Iterator[Part]:
        """Yield a row for each compared term, the findings, the cause of the differences, and the verdict."""
        judged = self.judged
        yield f"{self.robot}: equations of motion against the mechanism, {self.states} random states"
        yield f"  {self.source}\n"
        rows = []
        for row in judged.rows:
            outcome = "DIFFERS"
            if row.agrees:
                outcome = "ok"
            rows.append((row.term, f"{row.worst:.2e} {row.unit}", f"{row.limit:g}", outcome))
        yield TextTable(("term", "largest difference", "limit", ""), rows)
        yield f"\n  power balance {judged.balance:.1e} (relative); smallest eigenvalue of M {judged.least:.3g}\n"
        yield from by_severity(self.findings)
        if judged.cause:
            yield f"  one edit explains all differences: {judged.cause}"
        yield self.word


def equations_of_motion(robot: Robot | str | Path, states: int = 200) -> PublishedMotion:
    """Compare a robot's published equations of motion with the dynamics of its mechanism.

    The masses are those of inertia.toml; the comparison uses `states` random states.

    Raises:
        TwinError: the robot has no published equations of motion, or no masses.

    Examples:
        >>> import twin
        >>> twin.equations_of_motion("raven_left", states=20).verdict
        'agree'
    """
    from twin.reference import inertia
    from twin.simulation.dynamics.arm import arm
    from twin.validation.closed_form import judge

    robot = loaded(robot)
    form = robot.formula.motion
    if form is None or robot.files is None:
        raise TwinError(
            f"{robot.name} has no published equations of motion; of the built-in robots, raven_left and raven_right do"
        )
    # the published equations have the published masses, not those of the CAD
    masses_of_bodies = inertia.of_robot(robot.files.cad)
    dynamics = arm(robot.mechanism, masses_of_bodies).dynamics()
    judged = judge(form, dynamics, states)
    return PublishedMotion(robot.name, form.source, states, judged)


def console(
    name: str = "davinci", variants: str | Mapping[str, str] | None = None, progress: Progress = silent
) -> ConsoleResult:
    """Check the published equations of a surgeon's console, separately for each clause (requirement).

    `variants` is one variant for all equations ("paper", "conjugate", "decoupled"), or {equation: variant}.

    Raises:
        TwinError: there is no such console, equation or variant.

    Examples:
        >>> import twin
        >>> twin.console("davinci", "paper").verdict
        'disagree'
    """
    from twin.simulation.controllers import console_equations as equations
    from twin.validation.console_clauses import judge

    if name != "davinci":  # the only console whose equations are published
        raise TwinError(unknown("console", name, ("davinci",)))
    if isinstance(variants, str):
        if variants not in equations.READINGS:
            raise TwinError(f"--variant: {unknown('variant', variants, equations.READINGS)}")
        variants = equations.READINGS[variants]
    return judge(equations.console(variants), progress)
