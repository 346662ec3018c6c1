"""Result of `explain`: its data for JSON, and its text for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field

from twin.core.findings import Finding, Verdict
from twin.core.json_types import JsonObject
from twin.core.result import Line, Part, Result
from twin.validation.explain.explanation_data import Convention, FaultyPart, FittedParameters, Repair, WrongRow
from twin.validation.explain.explanation_text import (
    convention_lines,
    number_lines,
    part_lines,
    repair_lines,
    row_lines,
    section,
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
        variants = ", ".join(f"{equation} {variant}" for equation, variant in self.variants.items())
        yield f"{self.robot} · {variants} · {self.samples} poses of the mechanism"
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
