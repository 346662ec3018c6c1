"""Rows, findings and curves of a comparison of equations and mechanism, and the samples at which they are compared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from twin.core.findings import Finding, Kind
from twin.core.progress import Progress
from twin.core.result import TextTable
from twin.core.spatial import Array, Index
from twin.formula.contract import Equation
from twin.kinematics import Kinematics
from twin.planning.trajectory import Trajectory
from twin.reference import ReferenceModel, SolvedSamples
from twin.validation.residual_rows import SampleClock, Tolerances
from twin.validation.result import Residual


@dataclass
class EquationsComparison:
    """Rows, findings and curves of one comparison of equations and mechanism; the checks add to them."""

    residuals: list[Residual] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    series: dict[str, Array] = field(default_factory=dict)
    facts: dict[str, dict[str, str]] = field(default_factory=dict)
    tables: dict[str, TextTable] = field(default_factory=dict)
    driven: SolvedSamples | None = None
    """States of the mechanism at the equations' joint values, at every sample; None if it cannot be assembled there."""

    posed: SolvedSamples | None = None
    """States of the mechanism at the protocol's tool poses, at the coarse samples; None before they are computed."""

    coarse: Index = field(default_factory=lambda: np.zeros(0, np.intp))
    """Indices of the coarse samples."""

    def judge(self, residual: Residual, kind: Kind, what: str, where: str = "", **details: str) -> None:
        """Add a row and, if the row disagrees, a finding; for the arguments see `Residual.finding`."""
        self.residuals.append(residual)
        if not residual.agrees:
            self.findings.append(residual.finding(kind, what, where, **details))

    def differs(self, residual: Residual, what: str, cause: str = "") -> None:
        """Add a row and, if the row disagrees, a finding.

        The severity is info if the row is a consequence of another row, else disagreement. `cause` is the name of the
        wrong equation, if known.
        """
        if residual.consequence_of:
            kind = Kind(f"{residual.quantity}.differs", "info", word="tolerance")
            suggestion = f"caused by {residual.consequence_of}; fix that first"
        else:
            kind = Kind(f"{residual.quantity}.differs", "disagreement", word="tolerance")
            suggestion = ""
        self.judge(residual, kind, what, suggestion=suggestion, cause=cause)


@dataclass(frozen=True)
class ComparedSamples:
    """The samples at which equations and mechanism are compared, with all that the checks of one comparison need.

    Attributes:
        model: the reference model of the mechanism from the CAD.
        trajectory: the motion.
        clock: times and phases of all its samples.
        tolerances: largest deviations that count as agreement.
        progress: receives (what is computed, fraction that is done).
        comparison: the comparison; each check adds its rows and findings to it.
        posed: states of the mechanism at the tool poses of the coarse samples.
    """

    model: ReferenceModel
    trajectory: Trajectory
    clock: SampleClock
    tolerances: Tolerances
    progress: Progress
    comparison: EquationsComparison
    posed: SolvedSamples

    @property
    def coarse(self) -> SampleClock:
        """Times and phases of the coarse samples."""
        return self.clock.at(self.comparison.coarse)

    @property
    def Ts(self) -> Array:  # noqa: N802
        """Tool poses (k, 4, 4) of the coarse samples."""
        return self.trajectory.Ts_base_tool[self.comparison.coarse]


@dataclass(frozen=True)
class Blame:
    """A wrong row that explains other rows; all attributes are empty if there is no such row.

    Attributes:
        row: name of the row.
        cause: name of the equation that computes the row.
        points: name of the wrong equation, by point.
    """

    row: str = ""
    cause: str = ""
    points: Mapping[str, str] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.row)


def named_with_variant(kin: Kinematics, equation: Equation) -> str:
    """Return an equation with its variant in use, as "name (variant)"."""
    return f"{equation.name} ({kin.variants.get(equation.name, equation.default)})"


def equation_of(kin: Kinematics, symbols: str | tuple[str, ...]) -> str:
    """Return the equation that computes one of the symbols, as "name (variant)"; "" if there is none."""
    if isinstance(symbols, str):
        symbols = (symbols,)
    wanted_symbols = set(symbols)
    for equation in kin.formula.equations:
        # a helper computes symbols for other equations, and is not printed as one
        if equation.stage != "helper" and wanted_symbols & set(equation.outputs):
            return named_with_variant(kin, equation)
    return ""
