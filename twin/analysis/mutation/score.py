"""Mutation score: the fraction of seeded faults that the validator catches on one robot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from twin.analysis.mutation.fault import FAMILIES, MEANING, Detection, Family, State
from twin.core.findings import Finding, Verdict, disagreement
from twin.core.json_types import JsonObject
from twin.core.quantity import Quantity
from twin.core.result import Part, Result, TextTable

BAR = 0.95
"""Required fraction of faults that are caught."""

_SHOWN_CODES = 4
"""Maximum number of codes of findings in a row of the text."""


@dataclass(frozen=True)
class Score(Result):
    """Results of all seeded faults on one robot.

    Attributes:
        robot, protocol, source: name of the robot, name of its protocol, and source of its mechanism.
        seed: seed of the random faults.
        seconds: total duration in s.
        outcomes: one result for each fault.
        false_alarms: disagreements and errors that the validator reports for the correct robot.
        bar: required fraction of faults that are caught.
    """

    robot: str
    protocol: str
    source: str
    seed: int
    seconds: float
    outcomes: tuple[Detection, ...]
    false_alarms: tuple[Finding, ...]
    bar: float = BAR

    kind = "selftest"

    @property
    def findings(self) -> tuple[Finding, ...]:
        """A finding if `share` is below `bar`, and all false alarms."""
        if self.share >= self.bar:
            return self.false_alarms
        low = disagreement(
            "selftest.bar",
            "",
            f"{self.caught} of {self.counted} seeded faults caught",
            size=Quantity(100 * self.share, "percent"),
            limit=100 * self.bar,
            word="required",
        )
        return (low, *self.false_alarms)

    def of(self, family: Family) -> list[Detection]:
        """Return the results of one family of faults."""
        outcomes = []
        for outcome in self.outcomes:
            if outcome.family == family:
                outcomes.append(outcome)
        return outcomes

    def _count(self, *states: State) -> int:
        """Return the number of faults that are in one of these states."""
        count = 0
        for outcome in self.outcomes:
            if outcome.state in states:
                count += 1
        return count

    @property
    def counted(self) -> int:
        """Number of faults that have an effect."""
        return self._count("caught", "warned", "missed")

    @property
    def caught(self) -> int:
        """Number of faults that were caught or caused a warning."""
        return self._count("caught", "warned")

    @property
    def share(self) -> float:
        """`caught` divided by `counted`, 0..1."""
        if not self.counted:  # all faults were equivalent: none was missed
            return 1.0
        return self.caught / self.counted

    @property
    def passed(self) -> bool:
        """Whether `share` is at least `bar` and there are no false alarms."""
        return self.share >= self.bar and not self.false_alarms

    @property
    def verdict(self) -> Verdict:
        """The verdict: "agree" if `passed`, else "disagree"."""
        return "agree" if self.passed else "disagree"

    def families(self) -> list[JsonObject]:
        """Return one table row for each family with seeded faults."""
        rows = []
        for family in FAMILIES:
            outcomes = self.of(family)
            if not outcomes:
                continue
            states: Counter[State] = Counter()
            codes: Counter[str] = Counter()
            for outcome in outcomes:
                states[outcome.state] += 1
                if outcome.code:
                    codes[outcome.code] += 1
            rows.append(
                {
                    "family": family,
                    "meaning": MEANING[family],
                    "seeded": len(outcomes),
                    "caught": states["caught"],
                    "warned": states["warned"],
                    "missed": states["missed"],
                    "equivalent": states["equivalent"],
                    "by": dict(codes.most_common()),
                }
            )
        return rows

    @property
    def word(self) -> str:
        """Verdict as text: whether the validator passes."""
        return "The validator passes" if self.passed else "The validator fails"

    def content(self) -> JsonObject:
        """Return the score as plain data."""
        return {
            "robot": self.robot,
            "protocol": self.protocol,
            "source": self.source,
            "seed": self.seed,
            "seconds": round(self.seconds, 1),
            "bar": self.bar,
            "counted": self.counted,
            "caught": self.caught,
            "share": self.share,
            "false_alarms": [finding.as_dict() for finding in self.false_alarms],
            "families": self.families(),
            "faults": [outcome.as_dict() for outcome in self.outcomes],
        }

    def text(self) -> Iterator[Part]:
        """Yield the score, a row for each family, the missed faults, the faults without effect, and false alarms."""
        yield f"{self.robot} · {self.protocol} · seed {self.seed} · {self.seconds:.0f} s"
        yield ""
        percent = 100 * self.share
        bar = f"{100 * self.bar:.0f} %"
        share = f"{self.caught} of {self.counted} seeded faults caught ({percent:.1f} %, required {bar})"
        alarms = f"{len(self.false_alarms)} false alarms on the correct robot"
        result = "PASSED" if self.passed else "FAILED"
        yield f"  {result}: {share}, {alarms}"
        yield ""
        rows = []
        for family in self.families():
            cells = [family["family"]]
            for key in ("seeded", "caught", "warned", "missed", "equivalent"):
                cells.append(str(family[key]))
            codes = []
            for code, number in list(family["by"].items())[:_SHOWN_CODES]:  # the most frequent first
                codes.append(f"{code} {number}")
            cells.append(", ".join(codes))
            rows.append(cells)
        head = ("family", "seeded", "caught", "only warned", "missed", "no effect", "caught by")
        yield TextTable(head, rows)
        yield from self._listed("missed", "missed")
        yield from self._listed("no effect: not counted", "equivalent")
        if self.false_alarms:
            yield ""
            yield "  false alarms"
            yield from self.false_alarms

    def _listed(self, title: str, state: State) -> Iterator[Part]:
        """Yield a title and a line for each fault in a state; nothing without such faults."""
        if not self._count(state):
            return
        yield ""
        yield f"  {title}"
        for outcome in self.outcomes:
            if outcome.state != state:
                continue
            yield f"    {outcome.family}, {outcome.kind}: {outcome.what} ({outcome.message})"
