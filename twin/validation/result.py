"""Report of a validation: residual matrix, findings and curves, as plain data for JSON, HTML and plots."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import IntEnum
from functools import cached_property
from typing import Literal

from twin.core.findings import Finding, Kind, by_severity
from twin.core.format import deviation, quantity
from twin.core.json_types import JsonObject
from twin.core.provenance import AssumedCounts, Parameter, count_assumed
from twin.core.quantity import si
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.planning.rounds import SearchRounds
from twin.validation.cause import SIDES, Cause, causes

RowKind = Literal[
    "length",
    "tool",
    "point",
    "driven",
    "passive",
    "loop",
    "speed",
    "acceleration",
    "baked",
    "rcm",
    "range",
    "duration",
    "limit",
    "trocar",
]


@dataclass(frozen=True)
class Residual:
    """One row of the residual matrix: the deviation of one quantity between two sides.

    Attributes:
        pair: the two compared sides. "A-B": equations and CAD mechanism; "B-C": mechanism and USD stage; "B-D":
            mechanism and baked motion; "B": the mechanism alone (loop gaps, RCM); "C": the USD stage alone (loop
            gaps); "A": the equations and other methods for the same task; "P-T": the plan's timing and the timing by a
            second solver.
        quantity: kind of the compared quantity, such as "point" or "speed".
        name: name of the point, joint, body, loop or phase, or "tool".
        unit: "m", "rad", "m/s", "rad/s", "m/s2" or "rad/s2"; "" for a relative deviation.
        worst, rms: largest and root-mean-square deviation over all samples, in `unit`.
        tolerance: largest accepted deviation in `unit`; None if the row is not judged.
        t, phase: time in s and phase of the largest deviation.
        component: axes along which vectors deviate most ("x", "x, z", ...); "" for scalars.
        samples: number of samples compared.
        consequence_of: name of the row that causes this deviation; "" if none is known.
        note: remark for the reader; may be empty.
    """

    pair: str
    quantity: RowKind
    name: str
    unit: str
    worst: float
    rms: float
    tolerance: float | None
    t: float
    phase: str
    component: str = ""
    samples: int = 0
    consequence_of: str = ""
    note: str = ""

    @property
    def agrees(self) -> bool:
        """Whether the deviation is within the tolerance; True for rows without a tolerance."""
        return self.tolerance is None or self.worst <= self.tolerance

    def finding(
        self, kind: Kind, what: str, where: str = "", *, suggestion: str = "", when: str = "", cause: str = ""
    ) -> Finding:
        """Return a finding for this row with the message `what`, the largest deviation, the tolerance, place and time.

        Defaults: `where` is the name of the row, `suggestion` is the suggestion of `kind`, and `when` is the phase and
        the time of the largest deviation.
        """
        limit = None
        if self.tolerance is not None:
            limit = si(self.tolerance, self.unit)
        when = when or f"{self.phase}, t = {self.t:.2f} s"
        worst = si(self.worst, self.unit)
        return kind(where or self.name, what, worst, limit, suggestion, when=when, cause=cause)


class _Urgency(IntEnum):
    """How soon a row is shown; a row with a higher number comes first."""

    UNJUDGED = 0
    AGREES = 1
    FOLLOWS = 2
    DIFFERS = 3


def _urgency(row: Residual) -> _Urgency:
    """Return how soon a row is shown, from its verdict."""
    if row.tolerance is None:
        return _Urgency.UNJUDGED
    if row.agrees:
        return _Urgency.AGREES
    if row.consequence_of:
        return _Urgency.FOLLOWS
    return _Urgency.DIFFERS


def _relative_deviation(row: Residual) -> float:
    """Return deviation / tolerance, or the deviation itself without a tolerance; NaN becomes infinite."""
    if math.isnan(row.worst):
        return math.inf
    return row.worst / (row.tolerance or 1.0)


_EQUAL_DEVIATION_RATIO = 0.999
"""Rows count as equally bad if their deviation is at least this fraction of the largest; the first row is shown."""


def headline(rows: Sequence[Residual]) -> Residual:
    """Return the worst row of a group, to be shown; failed rows that are no consequence of another row come first."""
    most_urgent = max(map(_urgency, rows))
    urgent = [row for row in rows if _urgency(row) == most_urgent]
    largest = max(map(_relative_deviation, urgent))
    # the first of equally bad rows, not the largest: rounding would decide between them
    return next(row for row in urgent if _relative_deviation(row) >= _EQUAL_DEVIATION_RATIO * largest)


@dataclass(frozen=True)
class PhaseSummary:
    """One phase of the protocol.

    Attributes:
        name, type: name and type in the protocol.
        t0, t1: start and end time in s.
        rcm: (3,) RCM in m in base; None if there is none.
        rcm_mode: "enforced", "monitored" or "".
        rounds: number of rounds in the path search of a free phase; None without a search.
        solver: solver of the timing: "passes", "toppra", or "" if the timing was given.
    """

    name: str
    type: str
    t0: float
    t1: float
    rcm: tuple[float, float, float] | None = None
    rcm_mode: str = ""
    rounds: SearchRounds | None = None
    solver: str = ""

    def as_dict(self) -> JsonObject:
        """Return the phase as plain data, without durations of the search, which change from run to run."""
        content = dict(vars(self))
        del content["rounds"]
        content["rounds"] = None
        if self.rounds is not None:
            content["rounds"] = self.rounds.as_dict()
        return content


@dataclass(frozen=True)
class Report(Result):
    """Report of the validation of one robot with one protocol.

    Attributes:
        robot, title, source: name, title and source document of the robot.
        protocol, protocol_title: name and title of the protocol.
        variants: variant in use, by name of the equation.
        reasons: texts on how and why a variant differs from the printed equation, by key "equation, variant".
        residuals: the residual matrix.
        findings: findings of all checks (CAD, protocol, comparison, stage, clearance); they determine the verdict.
        phases: phases of the protocol.
        parameters: parameters of equations, mechanism, protocol and CAD, with provenance.
        of_protocol: those of `parameters` that are the protocol's.
        facts: {heading: {name: short text}}, such as mobility, mass and sample rates.
        tables: {heading: table of text}, such as the methods for tip and trocar.
        environment: software versions and machine.
        series: arrays for plots. On the samples "t" (k,) in s: "q", "qd", "qdd" (k, n); "p_tool", "v_tool", "a_tool"
            (k, 3); "angles" (k, 3) in rad; "residual_tool" (k,) in m; "residual_rotation" (k,) in rad; "rcm_error"
            (k,) in m, NaN in phases without an RCM; "fulcrum" (k, 2) in m, see `fulcrum`; "limit_margin" (k,),
            smallest distance of a joint to a limit, in rad or m; "singularity.<name>" (k,); "reach.<name>" (k,) in m.
            The residuals of searches for tip and trocar, with their outcomes: see `trocar_methods.OneStartResult`.
            On the times "clearance_t" (j,) in s: "clearance" (j,) in m. On the times "t_coarse" (c,) in s:
            "residual_driven.<joint>", "residual_point.<name>"; "p_tool_B", "v_tool_B", "a_tool_B" (c, 3), the tool's
            motion if the joint values of the equations drive the mechanism.
        joint_names: names of the joints, in the order of the columns of `q`.
        angles: names of the joints whose coordinate is an angle; other coordinates are lengths.
        commands: shell commands that repeat this validation ("validate") and search for the wrong equation
            ("explain"); may be empty.
        cure: correction of the equations found by `explain`; "" if there is none.
    """

    robot: str
    title: str
    source: str
    protocol: str
    protocol_title: str
    variants: Mapping[str, str]
    reasons: Mapping[str, str]
    residuals: tuple[Residual, ...]
    findings: tuple[Finding, ...]
    phases: tuple[PhaseSummary, ...]
    parameters: tuple[Parameter, ...]
    facts: Mapping[str, Mapping[str, str]]
    environment: Mapping[str, str]
    joint_names: tuple[str, ...]
    series: Mapping[str, Array] = field(default_factory=dict, repr=False)
    commands: Mapping[str, str] = field(default_factory=dict)
    cure: str = ""
    angles: frozenset[str] = frozenset()
    tables: Mapping[str, TextTable] = field(default_factory=dict)
    of_protocol: tuple[Parameter, ...] = ()

    kind = "report"

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """Causes of the disagreements and failed checks; the first one is shown as the headline."""
        return causes(self.findings)

    @property
    def what_to_do(self) -> str:
        """Suggestion for the first cause, in one line; "" if nothing disagrees."""
        if not self.causes:
            return ""
        first = self.causes[0]
        finding = first.head
        # a wrong equation has a command that finds its cure; faults of other sides have none
        if first.side == "equations" and finding.severity == "disagreement":
            return self._cure_of_equations(finding.suggestion)
        suggestion = finding.suggestion
        if first.side == "CAD":
            part = finding.where or "the part"
            suggestion = f"fix {part} in the CAD{_size_text(finding)}"
            if finding.suggestion:
                suggestion += f": {finding.suggestion}"
        elif first.side == "protocol":
            place = ", ".join(filter(None, (finding.where, finding.when)))
            change = finding.suggestion or "change the motion that exceeds the limit"
            suggestion = f"in the protocol, {place}: {change}"
        suggestion = suggestion or "rebuild the file"
        if not self.commands:
            return suggestion
        return f"{suggestion}; then {self.commands['validate']}"

    def _cure_of_equations(self, suggestion: str) -> str:
        """Return the correction that `explain` found, else the suggestion of the finding, else the search for it."""
        if self.cure or suggestion:
            return self.cure or suggestion
        if "explain" in self.commands:
            return f"find the edit that corrects the equations: {self.commands['explain']}"
        return ""

    @property
    def assumed(self) -> tuple[Parameter, ...]:
        """The parameters with provenance ASSUMED (not published)."""
        return tuple(p for p in self.parameters if p.provenance == "ASSUMED")

    @property
    def assumed_counts(self) -> AssumedCounts:
        """Numbers of assumed values, as all pages and commands count them."""
        # `parameters` contain those of the protocol: they are counted once, apart from the robot's
        everything = count_assumed(self.parameters)
        of_protocol = count_assumed((), self.of_protocol).protocol
        return AssumedCounts(everything.robot - of_protocol, of_protocol, everything.drawing)

    def content(self) -> JsonObject:
        """Return the report as plain data, without the curves (`series`)."""
        return {
            "robot": self.robot,
            "protocol": self.protocol,
            "causes": [cause.as_dict() for cause in self.causes],
            "what_to_do": self.what_to_do,
            "cure": self.cure,
            "commands": dict(self.commands),
            "variants": dict(self.variants),
            "residuals": [asdict(row) | {"agrees": row.agrees} for row in self.residuals],
            "phases": [phase.as_dict() for phase in self.phases],
            "parameters": [asdict(parameter) for parameter in self.parameters],
            "facts": {heading: dict(facts) for heading, facts in self.facts.items()},
            "tables": {heading: table.records() for heading, table in self.tables.items()},
            "environment": dict(self.environment),
        }

    def text(self) -> Iterator[Part]:
        """Yield the verdict, findings by cause, the largest residuals, and the number of assumed parameters."""
        variants = ", ".join(f"{equation} {variant}" for equation, variant in self.variants.items())
        title = filter(None, (self.robot, self.protocol, variants))
        yield " · ".join(title) + "\n"
        line = self.verdict_line
        if not self.variants and self.verdict == "agree":
            line = _AGREE_WITHOUT_EQUATIONS
        yield f"  {line}"
        if self.what_to_do:
            yield f"  WHAT TO DO: {self.what_to_do}"
        yield ""
        others = self._without_cause()
        for cause in self.causes:
            yield cause.head
            for line in cause.lines():
                yield f"      {line}"
        yield from others
        if self.causes or others:
            yield ""
        yield TextTable(("pair", "quantity", "worst", "tolerance", "where", "phase", ""), self._headlines())
        yield ""
        for heading, table in self.tables.items():
            yield f"  {heading}\n"
            yield table
            yield ""
        if self.assumed:
            counts = self.assumed_counts
            yield f"  Assumed values (unpublished): {counts}; see the report, or `twin info --all`."

    def _without_cause(self) -> list[Finding]:
        """Return the findings above "info" that no cause contains, the most severe first."""
        # by identity: two findings can have the same content
        explained: set[int] = set()
        for cause in self.causes:
            explained.update(map(id, cause.findings))
        others: list[Finding] = []
        for finding in by_severity(self.findings):
            if id(finding) not in explained and finding.severity != "info":
                others.append(finding)
        return others

    def _headlines(self) -> list[tuple[str, ...]]:
        """Return a row of cells for each kind of compared quantity: the row with the largest deviation."""
        groups: dict[tuple[str, str, str], list[Residual]] = {}
        for residual in self.residuals:
            key = (residual.pair, residual.quantity, residual.unit)
            groups.setdefault(key, []).append(residual)
        rows: list[tuple[str, ...]] = []
        for (pair, name, _), group in groups.items():
            rows.append((pair, name, *_cells_of_row(headline(group))))
        return rows

    @property
    def verdict_line(self) -> str:
        """The verdict as text; for a disagreement, it states which two sides differ."""
        sides = ""
        if self.causes:
            sides = SIDES[self.causes[0].side]
        line = _VERDICTS[self.verdict].format(sides)
        judged = self.facts.get("joint range", {}).get("judged", "")
        if judged and self.verdict == "agree":
            line += f", over {judged}"
        return line


_VERDICTS = {
    "agree": "AGREE: equations, mechanism and stage agree",
    "disagree": "DISAGREE: {}",
    "unchecked": "UNCHECKED: some checks could not be done",
}
_AGREE_WITHOUT_EQUATIONS = "AGREE: mechanism and stage agree; no equations yet"


def _cells_of_row(residual: Residual) -> tuple[str, ...]:
    """Return the cells of a residual's table row: largest deviation, tolerance, name, phase, verdict."""
    tolerance = ""
    if residual.tolerance is not None:
        tolerance = quantity(residual.tolerance, residual.unit)
    worst = deviation(residual.worst, residual.unit, residual.tolerance)
    return worst, tolerance, residual.name, residual.phase, row_verdict(residual)


def row_verdict(residual: Residual) -> str:
    """Return "ok", "DIFFERS" or the cause; for a row without a tolerance "", or "unchecked" if it has no value."""
    if residual.tolerance is None and math.isnan(residual.worst):
        return "unchecked"
    if residual.tolerance is None:
        return ""
    if residual.agrees:
        return "ok"
    if residual.consequence_of:
        return f"follows from {residual.consequence_of}"
    return "DIFFERS"


def _size_text(f: Finding) -> str:
    if f.size is None:
        return ""
    return f", {f.size:.4g} {f.unit} off"
