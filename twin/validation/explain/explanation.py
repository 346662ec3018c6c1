"""Result of `explain`: its data for JSON, and its text for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from math import inf, isnan

from twin.core.findings import Finding, Verdict
from twin.core.json_types import JsonObject
from twin.core.result import Line, Part, Result
from twin.core.units import decimals
from twin.validation.explain.explanation_data import (
    Change,
    Convention,
    FaultyPart,
    FittedParameters,
    Reading,
    Repair,
    WrongRow,
)


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
    rows: tuple[WrongRow, ...]
    repairs: tuple[Repair, ...] = ()
    identified: FittedParameters | None = None
    conventions: tuple[Convention, ...] = ()
    notes: tuple[str, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    lead: str = ""
    drawing: tuple[Finding, ...] = ()
    parts: tuple[FaultyPart, ...] = ()
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
        _, _, text = self._verdict_line().text.partition(": ")
        return text[:1].upper() + text[1:]

    def content(self) -> JsonObject:
        """Return the explanation as plain data."""
        data = asdict(self)
        del data["outcome"]  # the result has it as its verdict
        return data

    def text(self) -> Iterator[Part]:
        """Yield the verdict, the wrong rows, the violated invariants, and possible fixes."""
        variants: list[str] = []
        for equation, variant in self.variants.items():
            variants.append(f"{equation} {variant}")
        yield f"{self.robot} · {', '.join(variants)} · {self.samples} poses of the mechanism"
        yield ""
        yield self._verdict_line()
        if self.drawing:
            yield from section("the CAD", [*self.drawing, *part_lines(self.parts)])
        # What explains the rows comes before them, what may explain them after them.
        if self.lead == "numbers":
            yield from self._numbers()
        yield from section("wrong rows", row_lines(self.rows, self.repairs, self.samples))
        yield from section("violated invariants", self.invariants)
        yield from section("possible fixes", repair_lines(self.repairs))
        if self.lead != "numbers":
            yield from self._numbers()
        yield from section("conventions", convention_lines(self.conventions))
        if self.notes:
            yield ""
            for note in self.notes:
                yield Line(f"  · {note}", "dim")

    def _numbers(self) -> Iterator[Part]:
        """Yield the section on fitted numbers; nothing if none were fitted."""
        if self.identified is None:
            return
        title = "numbers"
        if self.lead == "edits or numbers":
            title = "numbers, as plausible as the edit"
        yield from section(title, number_lines(self.identified))

    def _verdict_line(self) -> Line:
        """Return the verdict and its reason as one line."""
        if self.verdict == "agree":
            count = f"{self.judged} of {self.rows_of_formula} rows judged"
            return Line(f"  AGREE: {count}, and each agrees at every pose; there is nothing to explain", "bold green")
        verdict = self.verdict.upper()
        wrong = f"{len(self.rows)} row wrong"
        if len(self.rows) > 1:
            wrong = f"{len(self.rows)} rows wrong"
        colour_of_cad = "bold yellow"
        if self.verdict == "disagree":
            colour_of_cad = "bold red"
        if self.lead == "drawing":
            reason = "parts do not meet in the CAD; every row agrees"
            if self.rows:
                reason = (
                    f"{wrong} because of the CAD: with the CAD corrected, every row agrees; the equations need no edit"
                )
            return Line(f"  {verdict}: {reason}", colour_of_cad)
        if self.lead == "noise":
            reason = "noise of the CAD explains the differences of all rows; the equations need no edit"
            return Line(f"  {verdict}: {reason}", colour_of_cad)
        if not self.rows:
            return Line("  UNCHECKED: not every row could be checked", "bold yellow")
        if self.verdict == "unchecked":
            wrong = wrong.replace("wrong", "wrong or without a value")
        if self.explained:
            return Line(f"  {verdict}: {wrong}, explained", "bold green")
        reason = "NOT explained: no edit among those tried makes the rows agree"
        return Line(f"  {verdict}: {wrong}, {reason}", "bold red")


_SIZES_REMARK = (
    "sizes: the largest difference of each row alone, at {} poses around the postures; `twin validate` gives the size "
    "of the fault along a protocol"
)
"""Remark on the sizes of wrong rows: they are not those of `validate`, which judges points along a protocol."""

_DIFF_COLOURS = {"-": "red", "+": "green"}
"""Colours of the lines of a diff, by their first character."""


def section(title: str, parts: Sequence[Part]) -> Iterator[Part]:
    """Yield a title and the parts of a section; nothing if it has no parts."""
    if parts:
        yield ""
        yield Line(title, "bold")
        yield from parts


def part_lines(parts: Sequence[FaultyPart]) -> list[Line]:
    """Return one line for each faulty part of the CAD."""
    lines: list[Line] = []
    for part in parts:
        is_certain = bool(part.part) and not part.others
        lines.append(Line(f"  {part.message}", "green" if is_certain else "yellow"))
    return lines


def row_lines(rows: Sequence[WrongRow], repairs: Sequence[Repair], samples: int) -> list[Line]:
    """Return the lines on the wrong rows, judged at `samples` poses."""
    faults = _first_changes(repairs)
    lines: list[Line] = []
    has_sizes = False
    for row in rows:
        has_sizes |= not row.why  # margins have a reason instead of a size
        lines += _lines_of_row(row, faults.get(f"{row.equation}.{row.symbol}", ()))
    if has_sizes:
        lines.insert(0, Line(f"  {_SIZES_REMARK.format(samples)}", "dim"))
    return lines


def _first_changes(repairs: Sequence[Repair]) -> dict[str, tuple[Change, ...]]:
    """Return, for each row with a fix, the changes of its first fix: they are where the fault is."""
    changes: dict[str, tuple[Change, ...]] = {}
    for repair in repairs:
        if repair.cures:
            for row in repair.rows:
                changes.setdefault(row, repair.cures[0][0].changes)
    return changes


def _lines_of_row(row: WrongRow, faults: Sequence[Change]) -> Iterator[Line]:
    """Yield the lines on a wrong row; `faults` are the changes of its first fix, the line of each is cited first."""
    yield Line(f"  {row.equation} ({row.variant}), {row.symbol} = {row.means}: {_difference_text(row)}", "")
    for fault in faults:
        if (fault.file, fault.line) != (row.file, row.line):
            yield Line(f"      fault: {fault.file}:{fault.line}   {fault.before}", "dim")
    yield Line(f"      {row.file}:{row.line}   {row.text}", "dim")
    if row.why:
        yield Line(f"      at {row.worst_at}", "dim")
        return
    if row.term:
        yield Line(f"      term: {row.term}", "dim")
    yield Line(f"      worst at {row.worst_at}", "dim")
    if row.share < 1:
        yield Line(f"      correct at {row.least_at}", "dim")


def _difference_text(row: WrongRow) -> str:
    """Return how much a row differs, and at how many of the poses; of a margin, why it is wrong."""
    if row.why:
        return row.why
    unit = "°" if row.unit == "deg" else f" {row.unit}"
    size = "no value" if isnan(row.off) else f"up to {row.off:.4g}{unit}"
    if row.share == 1:
        return f"{size}, wrong at every pose"
    return f"{size}, wrong at {100 * row.share:.0f} % of the poses"


def convention_lines(conventions: Sequence[Convention]) -> list[Line]:
    """Return the lines on conventions under which rows agree."""
    lines: list[Line] = []
    for convention in conventions:
        lines.append(Line(f"  {convention.message}", "green"))
        lines.append(Line(f"      makes these rows agree: {', '.join(convention.rows)}", "dim"))
    return lines


def repair_lines(repairs: Sequence[Repair]) -> list[Part]:
    """Return the lines on the repairs of all groups of rows."""
    lines: list[Part] = []
    for repair in repairs:
        lines += _lines_of_repair(repair)
    return lines


def _lines_of_repair(repair: Repair) -> Iterator[Part]:
    """Yield the lines on the repair of one group of rows; without a cure, the reason."""
    rows = ", ".join(repair.rows)
    if not repair.cures:
        yield Line(f"  {rows}: {repair.note}", "red")
        yield Line(f"      {_extent_text(repair)}", "dim")
        return
    if repair.tie:
        yield Line(f"  {rows} (TIE)", "yellow")
    else:
        yield Line(f"  {rows}", "green")
    for i, cure in enumerate(repair.cures):
        for reading in cure:
            bullet = ""
            if len(repair.cures) > 1:
                bullet = f"{i + 1}. "
            elif reading is not cure[0]:
                bullet = "or "
            yield from _lines_of_reading(reading, f"    {bullet}")
        if repair.proofs:
            colour = "green" if repair.proofs[i].startswith("identity") else "yellow"
            yield Line(f"        {repair.proofs[i]}", colour)
    if repair.tie:
        yield Line(f"      tie: {repair.tie}", "yellow")
    margin = "no other candidate is close"
    if repair.margin != inf:
        margin = f"the next best is {repair.margin:.1g} times worse"
    if repair.runner_up:
        margin += f": {repair.runner_up}"
    yield Line(f"      {margin}; {_extent_text(repair)}", "dim")


def _lines_of_reading(reading: Reading, bullet: str) -> Iterator[Line]:
    """Yield one fix; its first line begins with `bullet`."""
    changes: list[str] = []
    for change in reading.changes:
        changes.append(f"{change.edit}   ({change.kind}, {change.file}:{change.line})")
    yield Line(bullet + " and ".join(changes), "bold")
    for line in reading.diff.splitlines():
        if not line.startswith(("---", "+++")):
            yield Line(f"        {line}", _DIFF_COLOURS.get(line[0], "dim"))
    if reading.dropped:
        yield Line(f"        with this fix, the row no longer depends on {', '.join(reading.dropped)}", "dim")
    if reading.note:
        yield Line(f"        {reading.note}", "dim")


def _extent_text(repair: Repair) -> str:
    """Return how many edits were tried, whether more could be, and for pairs the time of their search."""
    if repair.seconds:  # pairs were searched
        extent = "every pair" if repair.complete else "not every pair (a larger --seconds gives more time)"
        return f"{repair.tried} edits and pairs of edits were tried; {extent} was tried, in {repair.seconds:.1f} s"
    edits = "1 edit was" if repair.tried == 1 else f"{repair.tried} edits were"
    if repair.complete:
        return f"{edits} tried"
    return f"{edits} tried; not every edit (a larger --seconds gives more time)"


def number_lines(fit: FittedParameters) -> list[Part]:
    """Return the lines on parameters whose changed values explain the rows, or on their absence."""
    lines: list[Part] = []
    if not fit.moved:
        lines.append(Line(f"  no values of {', '.join(fit.names)} make the rows agree", "red"))
    elif fit.alternatives:
        text = "  each of these changes alone makes every row agree; the rows do not determine the true one:"
        lines.append(Line(text, "yellow"))
    for parameter in fit.moved:
        note = f"  ({parameter.note})" if parameter.note else ""
        digits = decimals(abs(parameter.fitted - parameter.formula))
        in_formula = f"{parameter.formula:.{digits}f} {parameter.unit} in the formula"
        in_cad = f"{parameter.fitted:.{digits}f} ± {parameter.sigma:.1g} {parameter.unit} in the CAD"
        lines.append(Line(f"  {parameter.name}: {in_formula}, {in_cad}{note}", "green"))
    for combination in fit.blind:
        lines.append(Line(f"  a combined change that has no effect on any row: {combination}", "dim"))
    return lines
