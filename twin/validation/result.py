"""Report of a validation: residual matrix, findings and curves, as plain data for JSON, HTML and plots."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Literal

from twin.core.findings import Finding, Kind, by_severity
from twin.core.format import quantity
from twin.core.json_types import JsonObject
from twin.core.provenance import Parameter
from twin.core.quantity import si
from twin.core.result import Part, Result, Table
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
            mechanism and baked motion; "B": the mechanism alone (loop gaps, RCM);
            "A": the equations and other methods for the same task; "P-T": the plan's timing and the
            timing by a second solver.
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
        limit = None if self.tolerance is None else si(self.tolerance, self.unit)
        at = when or f"{self.phase}, t = {self.t:.2f} s"
        return kind(where or self.name, what, si(self.worst, self.unit), limit, suggestion, when=at, cause=cause)


_SAME = 0.999
"""Rows count as equally bad if their deviation is at least this fraction of the largest; the first row is shown."""


def headline(rows: Sequence[Residual]) -> Residual:
    """Return the worst row of a group, to be shown; failed rows that are no consequence of another row come first."""

    def weight(r: Residual) -> tuple[int, float]:
        """Return (rank, deviation / tolerance); failed rows have the highest rank.

        Without a tolerance, the second value is the deviation itself. NaN counts as infinite.
        """
        rank = 0 if r.tolerance is None else 1 if r.agrees else 2 if r.consequence_of else 3
        return rank, math.inf if math.isnan(r.worst) else r.worst / (r.tolerance or 1.0)

    rank, most = max(map(weight, rows))
    return next(r for r in rows if weight(r)[0] == rank and weight(r)[1] >= _SAME * most)


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
        out = {k: v for k, v in vars(self).items() if k != "rounds"}
        return out | {"rounds": None if self.rounds is None else self.rounds.as_dict()}


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
        facts: {heading: {name: short text}}, such as mobility, mass and sample rates.
        tables: {heading: table of text}, such as the methods for tip and trocar.
        environment: software versions and machine.
        series: arrays for plots. On the samples "t" (k,) in s: "q", "qd", "qdd" (k, n); "p_tool", "v_tool", "a_tool"
            (k, 3); "angles" (k, 3) in rad; "residual_tool" (k,) in m; "residual_rotation" (k,) in rad; "rcm_error"
            (k,) in m, NaN in phases without an RCM; "fulcrum" (k, 2) in m, see `fulcrum`; "limit_margin" (k,),
            smallest distance of a joint to a limit, in rad or m; "singularity.<name>" (k,); "reach.<name>" (k,) in m.
            The residuals of searches for tip and trocar, with their outcomes: see `trocar_methods.SEARCHES`, `Single`.
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
    tables: Mapping[str, Table] = field(default_factory=dict)

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
        way = first.head.suggestion
        if first.side == "equations" and first.head.severity == "disagreement":
            look = (
                f"find the edit that corrects the equations: {self.commands['explain']}"
                if "explain" in self.commands
                else ""
            )
            return self.cure or way or look
        if first.side == "CAD":
            way = f"fix {first.head.where or 'the part'} in the CAD{_size(first.head)}" + (f": {way}" if way else "")
        if first.side == "protocol":
            place = ", ".join(x for x in (first.head.where, first.head.when) if x)
            way = f"in the protocol, {place}: {way or 'change the motion that exceeds the limit'}"
        way = way or "rebuild the file"
        return f"{way}; then {self.commands['validate']}" if self.commands else way

    @property
    def assumed(self) -> tuple[Parameter, ...]:
        """The parameters with provenance ASSUMED (not published)."""
        return tuple(p for p in self.parameters if p.provenance == "ASSUMED")

    def content(self) -> JsonObject:
        """Return the report as plain data, without the curves (`series`)."""
        return {
            "robot": self.robot,
            "protocol": self.protocol,
            "causes": [c.as_dict() for c in self.causes],
            "what_to_do": self.what_to_do,
            "cure": self.cure,
            "commands": dict(self.commands),
            "variants": dict(self.variants),
            "residuals": [asdict(r) | {"agrees": r.agrees} for r in self.residuals],
            "phases": [p.as_dict() for p in self.phases],
            "parameters": [asdict(p) for p in self.parameters],
            "facts": {k: dict(v) for k, v in self.facts.items()},
            "tables": {k: [dict(zip(t.header, row, strict=True)) for row in t.rows] for k, t in self.tables.items()},
            "environment": dict(self.environment),
        }

    def text(self) -> Iterator[Part]:
        """Yield the verdict, findings by cause, the largest residuals, and the number of assumed parameters."""
        variants = ", ".join(f"{k} {v}" for k, v in self.variants.items())
        yield " · ".join(filter(None, (self.robot, self.protocol, variants))) + "\n"
        unjudged = not self.variants and self.verdict == "agree"
        yield f"  {_WITHOUT if unjudged else self.verdict_line}\n"
        told = {id(f) for c in self.causes for f in c.findings}
        others = [f for f in by_severity(self.findings) if id(f) not in told and f.severity != "info"]
        for cause in self.causes:
            yield cause.head
            yield from (f"      {line}" for line in cause.lines())
        yield from others
        if self.causes or others:
            yield ""
        groups: dict[tuple[str, str, str], list[Residual]] = {}
        for row in self.residuals:
            groups.setdefault((row.pair, row.quantity, row.unit), []).append(row)
        rows = [(pair, name, *_row(headline(group))) for (pair, name, _), group in groups.items()]
        yield Table(("pair", "quantity", "worst", "tolerance", "where", "phase", ""), rows)
        yield ""
        for heading, table in self.tables.items():
            yield f"  {heading}\n"
            yield table
            yield ""
        if self.assumed:
            yield f"  {len(self.assumed)} assumed values (unpublished) are listed in the report and by `twin info`."

    @property
    def verdict_line(self) -> str:
        """The verdict as text; for a disagreement, it states which two sides differ."""
        line = _VERDICTS[self.verdict].format(SIDES[self.causes[0].side] if self.causes else "")
        judged = self.facts.get("joint range", {}).get("judged", "")
        return f"{line}, over {judged}" if judged and self.verdict == "agree" else line


_VERDICTS = {
    "agree": "AGREE: equations, mechanism and stage agree",
    "disagree": "DISAGREE: {}",
    "unchecked": "UNCHECKED: some checks could not be done",
}
_WITHOUT = "AGREE: mechanism and stage agree; no equations yet"


def _row(r: Residual) -> tuple[str, ...]:
    """Return the cells of a residual's table row: largest deviation, tolerance, name, phase, verdict."""
    tolerance = "" if r.tolerance is None else quantity(r.tolerance, r.unit)
    return quantity(r.worst, r.unit), tolerance, r.name, r.phase, state(r)


def state(r: Residual) -> str:
    """Return "ok", "DIFFERS" or the cause; for a row without a tolerance "", or "unchecked" if it has no value."""
    if r.tolerance is None:
        return "unchecked" if math.isnan(r.worst) else ""
    if r.agrees:
        return "ok"
    return f"follows from {r.consequence_of}" if r.consequence_of else "DIFFERS"


def _size(f: Finding) -> str:
    return "" if f.size is None else f", {f.size:.4g} {f.unit} off"
