"""Result of `explain`, as plain data for JSON and for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from math import inf, isnan

from twin.core.findings import Finding, Verdict
from twin.core.json_types import JsonObject
from twin.core.result import Line, Part, Result
from twin.core.units import decimals


@dataclass(frozen=True)
class Row:
    """One wrong row (assignment) of the formula.

    Attributes:
        equation, variant, symbol: equation and variant of the row, and the symbol it computes.
        file, line: place of the row.
        term: summand of the row that the best repair changes; "" if there is none.
        means: meaning of the symbol: a named point, a joint or the tool pose.
        off: largest difference, in `unit` ("mm" or "deg").
        share: fraction of the judged poses at which the row is wrong.
        worst_at, least_at: poses with the largest and the smallest difference, as text.
        why: explanation of a wrong margin (reach, singularity measure, aspect; `off` may be NaN); "" for other rows.
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
    """One edit, with its source line before the edit and after all edits."""

    file: str
    line: int
    edit: str
    kind: str
    before: str
    after: str


@dataclass(frozen=True)
class Reading:
    """Edits that together make the rows agree.

    Attributes:
        changes: one or two edits.
        diff: all edits as one unified diff, including new definitions.
        note: further changes to make manually, or "".
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
        rows: the fixed rows, as "eq1.X_S1".
        before, after: worst residual of these rows before and after the repair, in units of the tolerance.
        margin: worst residual of the runner-up divided by the worst residual of the repair; 0 without a repair.
        runner_up: text with an edit and its residual; of all edits that do not fix the rows, this edit has the smallest
            residual.
        cures: the possible repairs. Cures result in different functions, which agree at all judged poses. Each cure is
            a tuple of readings: different edits that result in the same function, which no pose can distinguish.
        tie: why the data do not determine one repair, or "".
        tried: number of edits tried.
        complete: whether every edit that the search can generate was tried.
        seconds: duration of the search for pairs of edits in s; 0 if one edit is exact.
        note: further remarks, mainly if there is no repair.
        proofs: what a prover says of the equations after each cure; empty if none was asked.
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
    proofs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Moved:
    """A parameter whose changed value explains the differences.

    Attributes:
        name, unit: name of the parameter, and unit of its values.
        formula, fitted, sigma: value in the formula, value fitted to the mechanism, and its standard deviation.
        note: probable mistake, such as "looks like metres instead of millimetres", or "".
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
        before, after: worst residual before and after the fit, in units of the tolerance.
        moved: the parameters whose changes explain the differences.
        alternatives: whether each entry of `moved` alone explains the differences; otherwise, all together do.
        blind: combinations of parameters on which no row depends.
        covariance: (n, n) covariance of the fitted parameters, in SI.
        names: names (n) of the fitted parameters.
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
        rows: the fixed rows.
        after: worst remaining residual, in units of the tolerance.
    """

    kind: str
    message: str
    rows: tuple[str, ...]
    after: float


@dataclass(frozen=True)
class PartOff:
    """A faulty part of the CAD: it causes gaps between the parts of some joints.

    Attributes:
        joints: names of the joints whose parts do not meet.
        part, features: the faulty part and its faulty features; "" and () if no single part causes all the gaps.
        told_by: kind of evidence that this part is faulty. "drawing": lengths or identical parts; "joints": the other
            part of the joint fits at all further joints; "loops": the loops close only if this part is corrected;
            "rows": the rows agree only if this part is corrected; "": undecided between this part and `others`.
        why: the evidence, as text.
        others: alternative parts.
        message: the result in one sentence.
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
    """Result of `explain`.

    Attributes:
        robot, variants: name of the robot, and {equation: judged variant}.
        outcome: the verdict. "agree": nothing to explain; "disagree": rows are wrong; "unchecked": some rows were not
            judged.
        explained: whether every wrong row is explained by an exact repair, exact numbers, an exact convention, or the
            corrected CAD.
        samples: number of judged poses.
        invariants: findings on violated invariants.
        rows: the wrong rows.
        repairs, identified, conventions: possible fixes.
        notes: texts on equations and rows that were not judged, with the reason.
        judged, rows_of_formula: number of judged rows, and of all rows.
        seconds: duration of each step in s.
        lead: kind of the explanation: "drawing" (faulty parts of the CAD), "noise" (of the CAD), "edits", "numbers",
            "edits or numbers" (equally simple), "conventions"; "" if there is none.
        drawing: findings on joints whose parts do not meet in the CAD.
        parts: the faulty parts of the CAD.
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
        """The verdict, from `outcome`."""
        return self.outcome

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on the CAD and on violated invariants."""
        return (*self.drawing, *self.invariants)

    @property
    def summary(self) -> str:
        """What explains the disagreement, or why there is nothing to explain."""
        what = self._summary().text.partition(": ")[2]
        return what[:1].upper() + what[1:]

    def content(self) -> JsonObject:
        """Return the explanation as plain data."""
        out = asdict(self)
        del out["outcome"]
        return out

    def text(self) -> Iterator[Part]:
        """Yield the verdict, the wrong rows, the violated invariants, and possible fixes."""
        variants = ", ".join(f"{k} {v}" for k, v in self.variants.items())
        yield f"{self.robot} · {variants} · {self.samples} poses of the mechanism"
        yield ""
        yield self._summary()
        parts = [Line(f"  {p.message}", "green" if p.part and not p.others else "yellow") for p in self.parts]
        yield from _section("the CAD", [*self.drawing, *parts] if self.drawing else [])
        numbers = "numbers, as plausible as the edit" if self.lead == "edits or numbers" else "numbers"
        fitted = list(_identified(self.identified)) if self.identified is not None else []
        if self.lead == "numbers":
            yield from _section(numbers, fitted)
        faults = _first_changes(self.repairs)
        wrong = []
        for row in self.rows:
            wrong += _row(row, faults.get(f"{row.equation}.{row.symbol}", ()))
        if wrong and any(not row.why for row in self.rows):
            wrong.insert(0, Line(f"  {_SIZES.format(self.samples)}", "dim"))
        yield from _section("wrong rows", wrong)
        yield from _section("violated invariants", self.invariants)
        yield from _section("possible fixes", [line for repair in self.repairs for line in _repair(repair)])
        if self.lead != "numbers":
            yield from _section(numbers, fitted)
        yield from _section("conventions", [line for c in self.conventions for line in _convention(c)])
        if self.notes:
            yield ""
            yield from (Line(f"  · {n}", "dim") for n in self.notes)

    def _summary(self) -> Line:
        if self.verdict == "agree":
            count = f"{self.judged} of {self.rows_of_formula} rows judged"
            return Line(f"  AGREE: {count}, and each agrees at every pose; there is nothing to explain", "bold green")
        wrong = f"{len(self.rows)} row{'s' if len(self.rows) > 1 else ''} wrong"
        colour = "bold red" if self.verdict == "disagree" else "bold yellow"
        if self.lead == "drawing":
            what = "parts do not meet in the CAD; every row agrees"
            if self.rows:
                what = (
                    f"{wrong} because of the CAD: with the CAD corrected, every row agrees; the equations need no edit"
                )
            return Line(f"  {self.verdict.upper()}: {what}", colour)
        if self.lead == "noise":
            what = "noise of the CAD explains the differences of all rows; the equations need no edit"
            return Line(f"  {self.verdict.upper()}: {what}", colour)
        if not self.rows:
            return Line("  UNCHECKED: not every row could be checked", "bold yellow")
        if self.verdict == "unchecked":
            wrong = wrong.replace("wrong", "wrong or without a value")
        what = "explained" if self.explained else "NOT explained: no edit among those tried makes the rows agree"
        return Line(f"  {self.verdict.upper()}: {wrong}, {what}", f"bold {'green' if self.explained else 'red'}")


_SIZES = (
    "sizes: the largest difference of each row alone, at {} poses around the postures; `twin validate` gives the size "
    "of the fault along a protocol"
)
"""Remark on the sizes of wrong rows: they are not those of `validate`, which judges points along a protocol."""


def _section(title: str, parts: Sequence[Part]) -> Iterator[Part]:
    """Yield a title and the parts of a section; nothing if it has no parts."""
    if parts:
        yield ""
        yield Line(title, "bold")
        yield from parts


def _first_changes(repairs: Sequence[Repair]) -> dict[str, tuple[Change, ...]]:
    """Return, for each row with a fix, the changes of its first fix: they are where the fault is."""
    changes: dict[str, tuple[Change, ...]] = {}
    for repair in repairs:
        if repair.cures:
            for row in repair.rows:
                changes.setdefault(row, repair.cures[0][0].changes)
    return changes


def _row(r: Row, faults: Sequence[Change]) -> Iterator[Line]:
    """Yield the lines on a wrong row; `faults` are the changes of its first fix, the line of each is cited first."""
    unit = "°" if r.unit == "deg" else f" {r.unit}"
    much = "no value" if isnan(r.off) else f"up to {r.off:.4g}{unit}"
    share = "wrong at every pose" if r.share == 1 else f"wrong at {100 * r.share:.0f} % of the poses"
    yield Line(f"  {r.equation} ({r.variant}), {r.symbol} = {r.means}: {r.why or f'{much}, {share}'}", "")
    for fault in faults:
        if (fault.file, fault.line) != (r.file, r.line):
            yield Line(f"      fault: {fault.file}:{fault.line}   {fault.before}", "dim")
    yield Line(f"      {r.file}:{r.line}   {r.text}", "dim")
    if r.why:
        yield Line(f"      at {r.worst_at}", "dim")
        return
    if r.term:
        yield Line(f"      term: {r.term}", "dim")
    yield Line(f"      worst at {r.worst_at}", "dim")
    if r.share < 1:
        yield Line(f"      correct at {r.least_at}", "dim")


def _convention(c: Convention) -> Iterator[Line]:
    yield Line(f"  {c.message}", "green")
    yield Line(f"      makes these rows agree: {', '.join(c.rows)}", "dim")


def _repair(r: Repair) -> Iterator[Part]:
    rows = ", ".join(r.rows)
    if not r.cures:
        yield Line(f"  {rows}: {r.note}", "red")
        yield Line(f"      {_tried(r)}", "dim")
        return
    margin = "no other candidate is close" if r.margin == inf else f"the next best is {r.margin:.1g} times worse"
    yield Line(f"  {rows}" + (" (TIE)" if r.tie else ""), "yellow" if r.tie else "green")
    for i, cure in enumerate(r.cures):
        for reading in cure:
            number = f"{i + 1}. " if len(r.cures) > 1 else "or " if reading is not cure[0] else ""
            yield from _reading(reading, f"    {number}")
        if r.proofs:
            colour = "green" if r.proofs[i].startswith("identity") else "yellow"
            yield Line(f"        {r.proofs[i]}", colour)
    if r.tie:
        yield Line(f"      tie: {r.tie}", "yellow")
    if r.runner_up:
        margin += f": {r.runner_up}"
    yield Line(f"      {margin}; {_tried(r)}", "dim")


def _reading(r: Reading, mark: str) -> Iterator[Line]:
    """Yield one fix; its first line begins with `mark`."""
    yield Line(mark + " and ".join(f"{c.edit}   ({c.kind}, {c.file}:{c.line})" for c in r.changes), "bold")
    for line in r.diff.splitlines():
        if not line.startswith(("---", "+++")):
            yield Line(f"        {line}", {"-": "red", "+": "green"}.get(line[0], "dim"))
    if r.dropped:
        yield Line(f"        with this fix, the row no longer depends on {', '.join(r.dropped)}", "dim")
    if r.note:
        yield Line(f"        {r.note}", "dim")


def _tried(r: Repair) -> str:
    if not r.seconds:
        more = "" if r.complete else "; not every edit (a larger --seconds gives more time)"
        edits = "1 edit was" if r.tried == 1 else f"{r.tried} edits were"
        return f"{edits} tried{more}"
    most = "every pair" if r.complete else "not every pair (a larger --seconds gives more time)"
    return f"{r.tried} edits and pairs of edits were tried; {most} was tried, in {r.seconds:.1f} s"


def _identified(x: Identified) -> Iterator[Part]:
    if not x.moved:
        yield Line(f"  no values of {', '.join(x.names)} make the rows agree", "red")
    elif x.alternatives:
        yield Line(
            "  each of these changes alone makes every row agree; the rows do not determine the true one:", "yellow"
        )
    for m in x.moved:
        note = f"  ({m.note})" if m.note else ""
        n = decimals(abs(m.fitted - m.formula))
        fitted = f"{m.fitted:.{n}f} ± {m.sigma:.1g} {m.unit} in the CAD"
        yield Line(f"  {m.name}: {m.formula:.{n}f} {m.unit} in the formula, {fitted}{note}", "green")
    for b in x.blind:
        yield Line(f"  a combined change that has no effect on any row: {b}", "dim")
