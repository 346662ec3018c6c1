"""Result of `explain`: plain data, ready for JSON and for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from twin.core.findings import Finding, Verdict
from twin.core.result import Line, Part, Result
from twin.core.units import decimals


@dataclass(frozen=True)
class Row:
    """One wrong row of the formula.

    Attributes:
        equation, variant, symbol: name, variant and symbol of the row.
        file, line: place of the row.
        text: the row.
        term: the part of the row that the best repair changes, or "".
        means: the named point, joint or pose that the symbol stands for.
        off: worst difference; unit "mm" or "deg".
        share: fraction of the judged poses at which it is wrong.
        worst_at, least_at: poses with the largest and smallest difference.
        why: text instead of a difference, for a row that is judged by the states where it vanishes (`off` is NaN, or in
            `unit`).
    """

    equation: str
    variant: str
    symbol: str
    file: str
    line: int
    text: str
    means: str
    off: float
    unit: str
    share: float
    worst_at: str
    least_at: str
    term: str = ""
    why: str = ""


@dataclass(frozen=True)
class Change:
    """One edit for people and tools: the line before, and after all edits."""

    file: str
    line: int
    edit: str
    kind: str
    before: str
    after: str


@dataclass(frozen=True)
class Reading:
    """Edits that, together, make the rows agree.

    Attributes:
        changes: one or two; `after` of each is its line after all changes.
        diff: all changes as one unified diff, including new definitions.
        note: further manual changes, or "".
        dropped: symbols on which a row no longer depends after the edits.
    """

    changes: tuple[Change, ...]
    diff: str
    note: str = ""
    dropped: tuple[str, ...] = ()


@dataclass(frozen=True)
class Repair:
    """A repair of rows of a formula.

    Attributes:
        rows: the rows that it fixes, "eq1.X_S1".
        before, after: worst residual of these rows before and after the repair, in units of the tolerance.
        margin: worst residual of the runner-up divided by that of the repair; 0 if there is no repair.
        runner_up: the best edit that is not exact, and its residual.
        cures: each a list of readings (edits) that make the same function. The judged poses cannot decide between
            several cures; no pose can decide between the readings of one cure.
        tie: why the paper or the data do not decide, or "".
        tried: number of edits.
        complete: whether every edit of the kinds known here was tried.
        seconds: duration of the search for pairs of edits; 0 if one edit is exact.
        note: further remarks, mainly if there is no repair.
    """

    rows: tuple[str, ...]
    before: float
    after: float
    margin: float
    runner_up: str
    cures: tuple[tuple[Reading, ...], ...]
    tie: str
    tried: int
    complete: bool
    note: str = ""
    seconds: float = 0.0


@dataclass(frozen=True)
class Moved:
    """A parameter whose changed value explains the difference.

    Attributes:
        name, unit: name and unit of the parameter; the values below are in this unit.
        formula, fitted, sigma: value in the formula, value that fits the mechanism, its standard deviation.
        note: for instance "metres for millimetres", or "".
    """

    name: str
    unit: str
    formula: float
    fitted: float
    sigma: float
    note: str = ""


@dataclass(frozen=True)
class Identified:
    """Parameters fitted to the mechanism.

    Attributes:
        exact: whether the fitted values make all rows agree.
        before, after: worst residual in units of the tolerance.
        moved: changed parameters; with `alternatives`, each alone explains the difference.
        alternatives: whether the entries of `moved` exclude each other.
        blind: combinations of parameters that the rows do not depend on.
        covariance: (n, n) of `names`, in SI.
        names: the parameters that were fitted.
    """

    exact: bool
    before: float
    after: float
    moved: tuple[Moved, ...]
    alternatives: bool
    blind: tuple[str, ...]
    names: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Convention:
    """A convention under which formula and mechanism agree.

    Attributes:
        kind: "euler", "unit", "sign", "offset", "axes", "handedness", "dh".
        message: one sentence.
        rows: the rows that it fixes.
        after: worst remaining residual, in units of the tolerance.
    """

    kind: str
    message: str
    rows: tuple[str, ...]
    after: float


@dataclass(frozen=True)
class PartOff:
    """Joints that do not meet in the CAD for one reason, and the faulty part.

    Attributes:
        joints: names of the joints.
        part, features: the faulty part and its features; "" if no single part explains it.
        told_by: kind of evidence: "drawing" (lengths, identical parts), "joints" (the other joints of the second part
            meet), "loops" (they close only with this part corrected), "rows" (they agree only with this part
            corrected), or "" if undecided between this part and `others`.
        why: the evidence.
        others: alternatives.
        message: one sentence.
    """

    joints: tuple[str, ...]
    part: str
    features: tuple[str, ...]
    told_by: str
    why: tuple[str, ...]
    others: tuple[str, ...]
    message: str


@dataclass(frozen=True)
class Explanation(Result):
    """The result of `explain`.

    Attributes:
        robot, variants: robot and variants that were judged.
        outcome: the verdict. "agree": nothing to explain. "disagree": explained or not. "unchecked": something was
            not judged.
        explained: whether every wrong row has an exact repair, exact numbers or an exact convention, or agrees with the
            corrected CAD.
        samples: number of judged poses.
        invariants: violated invariants.
        rows: the wrong rows.
        repairs, identified, conventions: possible fixes.
        notes: parts that were not judged, and why.
        judged, rows_of_formula: number of judged rows, and of all rows.
        seconds: duration of each step.
        lead: kind of the explanation: "drawing", "edits", "numbers", "edits or numbers" (equally simple),
            "conventions", or "" if there is nothing to explain or no explanation.
        drawing: joints that do not meet in the CAD.
        parts: faulty parts of the CAD, if joints do not meet.
    """

    robot: str
    variants: Mapping[str, str]
    outcome: Verdict
    explained: bool
    samples: int
    invariants: tuple[Finding, ...]
    rows: tuple[Row, ...]
    repairs: tuple[Repair, ...] = ()
    identified: Identified | None = None
    conventions: tuple[Convention, ...] = ()
    notes: tuple[str, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    lead: str = ""
    drawing: tuple[Finding, ...] = ()
    parts: tuple[PartOff, ...] = ()
    judged: int = 0
    rows_of_formula: int = 0

    kind = "explain"

    @property
    def verdict(self) -> Verdict:
        """Return the outcome."""
        return self.outcome

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Faults of the CAD, and violated invariants."""
        return (*self.drawing, *self.invariants)

    def content(self) -> dict[str, Any]:
        """Return plain data."""
        out = asdict(self)
        del out["outcome"]
        return out

    def text(self) -> Iterator[Part]:
        """Yield the verdict, the wrong rows, the violated invariants, and possible fixes."""
        variants = ", ".join(f"{k} {v}" for k, v in self.variants.items())
        yield f"{self.robot} · {variants} · {self.samples} poses of the mechanism"
        yield ""
        if self.verdict == "agree":
            count = f"{self.judged} of {self.rows_of_formula} rows judged"
            yield Line(f"  AGREE: {count}, and each agrees at every pose; there is nothing to explain", "bold green")
        elif self.lead == "drawing":
            yield Line(
                f"  {self.verdict.upper()}: {_drawn(self)}", "bold red" if self.verdict == "disagree" else "bold yellow"
            )
        elif not self.rows:
            yield Line("  UNCHECKED: not every row could be checked", "bold yellow")
        else:
            what = "explained" if self.explained else "NOT explained: no known kind of edit makes the rows agree"
            number = f"{len(self.rows)} row{'s' if len(self.rows) > 1 else ''} off"
            yield Line(f"  {self.verdict.upper()}: {number}, {what}", "bold green" if self.explained else "bold red")
        if self.drawing:
            yield ""
            yield Line("the CAD", "bold")
            yield from self.drawing
            yield from (Line(f"  {p.message}", "green" if p.part and not p.others else "yellow") for p in self.parts)
        if self.lead == "numbers":
            yield from _numbers(self)
        if self.rows:
            yield ""
            yield Line("what is off", "bold")
            for r in self.rows:
                if r.why:
                    yield Line(f"  {r.equation} ({r.variant}), {r.symbol} = {r.means}: {r.why}", "")
                    yield Line(f"      {r.file}:{r.line}   {r.text}", "dim")
                    yield Line(f"      at {r.worst_at}", "dim")
                    continue
                much = (
                    f"{r.off:.4g} {'°' if r.unit == 'deg' else r.unit}".replace(" °", "°")
                    if r.off == r.off
                    else "no value"
                )
                share = "at every pose" if r.share == 1 else f"at {100 * r.share:.0f} % of the poses"
                yield Line(f"  {r.equation} ({r.variant}), {r.symbol} = {r.means}: {much}, {share}", "")
                yield Line(f"      {r.file}:{r.line}   {r.text}", "dim")
                if r.term:
                    yield Line(f"      term: {r.term}", "dim")
                yield Line(f"      worst at {r.worst_at}", "dim")
                if r.share < 1:
                    yield Line(f"      right at {r.least_at}", "dim")
        if self.invariants:
            yield ""
            yield Line("what cannot be", "bold")
            yield from self.invariants
        if self.repairs:
            yield ""
            yield Line("possible fixes", "bold")
            for repair in self.repairs:
                yield from _repair(repair)
        if self.lead != "numbers":
            yield from _numbers(self)
        if self.conventions:
            yield ""
            yield Line("conventions", "bold")
            for c in self.conventions:
                yield Line(f"  {c.message}", "green")
                yield Line(f"      cures {', '.join(c.rows)}", "dim")
        if self.notes:
            yield ""
            yield from (Line(f"  · {n}", "dim") for n in self.notes)


def _drawn(x: Explanation) -> str:
    """Return the summary if the CAD explains the disagreement."""
    if not x.rows:
        return "parts do not meet in the CAD; every row agrees"
    rows = f"{len(x.rows)} row{'s' if len(x.rows) > 1 else ''} off"
    return f"{rows}; the CAD explains them: with the CAD corrected every row agrees; the equations need no edit"


def _repair(r: Repair) -> Iterator[Part]:
    rows = ", ".join(r.rows)
    if not r.cures:
        yield Line(f"  {rows}: {r.note}", "red")
        yield Line(f"      {_tried(r)}", "dim")
        return
    margin = (
        "no other candidate is close" if r.margin == float("inf") else f"the next best is {r.margin:.1g} times worse"
    )
    yield Line(f"  {rows}" + (" (TIE)" if r.tie else ""), "yellow" if r.tie else "green")
    for i, cure in enumerate(r.cures):
        for reading in cure:
            mark = (
                f"    {i + 1}. "
                if len(r.cures) > 1
                else "    or "
                if len(cure) > 1 and reading is not cure[0]
                else "    "
            )
            yield Line(
                mark + " and ".join(f"{c.edit}   ({c.kind}, {c.file}:{c.line})" for c in reading.changes), "bold"
            )
            for line in reading.diff.splitlines():
                if not line.startswith(("---", "+++")):
                    yield Line(f"        {line}", "red" if line[0] == "-" else "green" if line[0] == "+" else "dim")
            if reading.dropped:
                yield Line(f"        the row then no longer depends on {', '.join(reading.dropped)}", "dim")
            if reading.note:
                yield Line(f"        {reading.note}", "dim")
    if r.tie:
        yield Line(f"      tie: {r.tie}", "yellow")
    yield Line(f"      {margin}: {r.runner_up}; {_tried(r)}", "dim")


def _tried(r: Repair) -> str:
    if not r.seconds:
        return f"{r.tried} edits tried"
    most = "every pair of tokens" if r.complete else "not every pair (--seconds gives more time)"
    return f"{r.tried} edits and pairs tried, pairs for {r.seconds:.1f} s, {most}"


def _numbers(x: Explanation) -> Iterator[Part]:
    if x.identified is not None:
        yield ""
        yield Line("numbers" + (", as plausible as the edit" if x.lead == "edits or numbers" else ""), "bold")
        yield from _identified(x.identified)


def _identified(x: Identified) -> Iterator[Part]:
    if not x.moved:
        yield Line(f"  no values of {', '.join(x.names)} make the rows agree", "red")
    elif x.alternatives:
        yield Line("  each of these alone makes every row agree; the rows do not determine which:", "yellow")
    for m in x.moved:
        note = f"  ({m.note})" if m.note else ""
        n = decimals(abs(m.fitted - m.formula))
        fitted = f"{m.fitted:.{n}f} ± {m.sigma:.1g} {m.unit} in the CAD"
        yield Line(f"  {m.name}: {m.formula:.{n}f} {m.unit} in the formula, {fitted}{note}", "green")
    for b in x.blind:
        yield Line(f"  no row depends on this combined change: {b}", "dim")
