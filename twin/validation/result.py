"""What `validate` returns: plain data, ready for JSON, HTML and plots."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, Literal

from twin.core.findings import EXIT_CODES, Finding, Verdict, by_severity, verdict
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.validation.cause import Cause, causes


def as_json(data: Any) -> str:
    """Return plain data as JSON text; what is not finite becomes null, since JSON has no word for it."""

    def plain(x: Any) -> Any:
        if isinstance(x, Mapping):
            return {str(k): plain(v) for k, v in x.items()}
        if isinstance(x, list | tuple):
            return [plain(v) for v in x]
        return None if isinstance(x, float) and not math.isfinite(x) else x

    return json.dumps(plain(data), indent=2, allow_nan=False)


Quantity = Literal["length", "tool", "point", "driven", "passive", "loop", "speed", "acceleration", "baked", "rcm"]


@dataclass(frozen=True)
class Residual:
    """One row of the residual matrix.

    Attributes:
        pair: which sides are compared: "A-B" formula and mechanism, "B-C" mechanism and stage read back,
            "B-D" mechanism and baked motion, "B" the mechanism by itself (loop gaps, RCM).
        quantity: what is compared.
        name: named point, joint, loop, or "tool".
        unit: "m", "rad", "m/s", "rad/s", "m/s2" or "rad/s2".
        worst, rms: over all samples, in `unit`.
        tolerance: largest value that counts as agreement, or None if the row is for information.
        t, phase: when the worst value occurs.
        component: direction in which it is largest ("x", "y", "z") or "".
        samples: how many samples were compared.
        consequence_of: the row that explains this one, or "".
        note: what a reader should know about this row, or "".
    """

    pair: str
    quantity: Quantity
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
        """Whether the row is within its tolerance (rows for information always are)."""
        return self.tolerance is None or self.worst <= self.tolerance


_SAME = 0.999
"""Sizes within this ratio are equal but for rounding: the first of them is shown."""


def headline(rows: Sequence[Residual]) -> Residual:
    """Return the row that stands for several: one that differs by itself before one that follows from another."""

    def weight(r: Residual) -> tuple[int, float]:
        """Of what is judged the share of its tolerance, else the size; no number is worst."""
        rank = 0 if r.tolerance is None else 1 if r.agrees else 2 if r.consequence_of else 3
        return rank, math.inf if math.isnan(r.worst) else r.worst / (r.tolerance or 1.0)

    rank, most = max(map(weight, rows))
    return next(r for r in rows if weight(r)[0] == rank and weight(r)[1] >= _SAME * most)


@dataclass(frozen=True)
class PhaseSummary:
    """One phase of the protocol: name, type, start and end in s, registered RCM (3,) in m, if any."""

    name: str
    type: str
    t0: float
    t1: float
    rcm: tuple[float, float, float] | None = None
    rcm_mode: str = ""


@dataclass(frozen=True)
class Report:
    """The judgement of one robot on one protocol.

    Attributes:
        robot, title, source: what was judged.
        protocol, protocol_title: along what.
        variants: chosen variant by equation, and `reasons` why the default differs from the printed one.
        residuals: the residual matrix.
        findings: from CAD, protocol, comparison, stage and clearance; they decide the verdict.
        phases: of the protocol, in order.
        parameters: of the formula and of the description, with provenance.
        facts: short statements with figures (mobility, mass, sample rates, sensitivity, ...), by heading.
        environment: versions and machine.
        series: curves for plots, time first. Keys: "t", "q", "qd", "qdd" (k, n); "p_tool", "v_tool", "a_tool"
            (k, 3); "angles" (k, 3) rad; "residual_tool" (k,) m, "residual_rotation" (k,) rad;
            "rcm_error" (k,) m (NaN where none is registered); "limit_margin" (k,) m;
            "singularity.<name>" (k,); "reach.<name>" (k,) m; "clearance_t" (j,), "clearance" (j,) m;
            "residual_driven.<joint>" and "residual_point.<name>" on "t_coarse" (c,), as "p_tool_B", "v_tool_B" and
            "a_tool_B" (c, 3), the tool of the mechanism driven by the equations.
        joint_names: for the second axis of q.
        angles: names of the joints that are angles; others are lengths.
        commands: command lines that judge the same again ("validate") and that look further ("explain"); may be empty.
        cure: what would make the equations agree, as `explain` found it; "" if it was not asked or found nothing.
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

    @property
    def verdict(self) -> Verdict:
        """Return "agree", "disagree" or "unchecked"."""
        return verdict(self.findings)

    @property
    def exit_code(self) -> int:
        """Return 0 agree, 1 disagree, 2 could not check."""
        return EXIT_CODES[self.verdict]

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """What disagrees or could not be checked, by cause; the first is the headline."""
        return causes(self.findings)

    @property
    def what_to_do(self) -> str:
        """Return one line: the way out of the first cause; "" if nothing disagrees."""
        if not self.causes:
            return ""
        first = self.causes[0]
        way = first.head.suggestion
        if first.side == "equations" and first.head.severity == "disagreement":
            look = (
                f"look for the edit that makes them agree: {self.commands['explain']}"
                if "explain" in self.commands
                else ""
            )
            return self.cure or way or look
        if first.side == "CAD":
            way = f"fix {first.head.where or 'the part'} in the CAD{_size(first.head)}" + (f": {way}" if way else "")
        if first.side == "protocol":
            place = ", ".join(x for x in (first.head.where, first.head.when) if x)
            way = f"in the protocol, {place}: {way or 'change what breaks the limit'}"
        way = way or "make the file again"
        return f"{way}; then {self.commands['validate']}" if self.commands else way

    @property
    def assumed(self) -> tuple[Parameter, ...]:
        """Return the parameters that nobody has published."""
        return tuple(p for p in self.parameters if p.provenance == "ASSUMED")

    def as_dict(self) -> dict[str, Any]:
        """Return plain data; the curves are left out."""
        return {
            "schema": "twin.report/1",
            "robot": self.robot,
            "protocol": self.protocol,
            "verdict": self.verdict,
            "causes": [c.as_dict() for c in self.causes],
            "what_to_do": self.what_to_do,
            "cure": self.cure,
            "commands": dict(self.commands),
            "variants": dict(self.variants),
            "residuals": [asdict(r) | {"agrees": r.agrees} for r in self.residuals],
            "findings": [f.as_dict() for f in by_severity(self.findings)],
            "phases": [asdict(p) for p in self.phases],
            "parameters": [asdict(p) for p in self.parameters],
            "facts": {k: dict(v) for k, v in self.facts.items()},
            "environment": dict(self.environment),
        }

    def to_json(self) -> str:
        """Return the report as JSON text; what is not finite becomes null."""
        return as_json(self.as_dict())


def _size(f: Finding) -> str:
    return "" if f.size is None else f", {f.size:.4g} {f.unit} off"
