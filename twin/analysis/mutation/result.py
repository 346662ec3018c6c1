"""The score of the validator on one robot: plain data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from twin.analysis.mutation.fault import FAMILIES, MEANING, Family, Outcome
from twin.core.findings import Finding

BAR = 0.95
"""Share of the faults that has to be caught."""

SCHEMA = "twin.selftest/1"


@dataclass(frozen=True)
class Score:
    """Results of all seeded faults.

    Attributes:
        robot, protocol, source: what they were seeded in.
        seed: of the draw.
        seconds: it all took.
        outcomes: one for each fault.
        false_alarms: what the validator says against the correct robot.
        bar: share that has to be caught.
    """

    robot: str
    protocol: str
    source: str
    seed: int
    seconds: float
    outcomes: tuple[Outcome, ...]
    false_alarms: tuple[Finding, ...]
    bar: float = BAR

    def of(self, family: Family) -> list[Outcome]:
        """Return the outcomes of a family."""
        return [o for o in self.outcomes if o.family == family]

    @property
    def counted(self) -> int:
        """Faults that are any: equivalent ones are not."""
        return sum(o.state != "equivalent" for o in self.outcomes)

    @property
    def caught(self) -> int:
        """Faults that were noticed."""
        return sum(o.state in ("caught", "warned") for o in self.outcomes)

    @property
    def share(self) -> float:
        """Caught of counted, 0..1."""
        return self.caught / self.counted if self.counted else 1.0

    @property
    def passed(self) -> bool:
        """Whether the bar is met and the correct robot is left in peace."""
        return self.share >= self.bar and not self.false_alarms

    @property
    def exit_code(self) -> int:
        """0 passed, 1 not."""
        return 0 if self.passed else 1

    def table(self) -> list[dict[str, Any]]:
        """Return one row for each family that was seeded."""
        rows = []
        for family in FAMILIES:
            some = self.of(family)
            if not some:
                continue
            state = Counter(o.state for o in some)
            codes = Counter(o.code for o in some if o.code)
            rows.append(
                {
                    "family": family,
                    "meaning": MEANING[family],
                    "seeded": len(some),
                    "caught": state["caught"],
                    "warned": state["warned"],
                    "missed": state["missed"],
                    "equivalent": state["equivalent"],
                    "by": dict(codes.most_common()),
                }
            )
        return rows

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "protocol": self.protocol,
            "source": self.source,
            "verdict": "agree" if self.passed else "disagree",
            "seed": self.seed,
            "seconds": round(self.seconds, 1),
            "bar": self.bar,
            "counted": self.counted,
            "caught": self.caught,
            "share": self.share,
            "false_alarms": [f.as_dict() for f in self.false_alarms],
            "families": self.table(),
            "faults": [o.as_dict() for o in self.outcomes],
        }


def from_dict(data: Mapping[str, Any]) -> Score:
    """Return a score from what `as_dict` gave."""
    outcomes = tuple(Outcome(**o) for o in data["faults"])
    alarms = tuple(Finding(**f) for f in data["false_alarms"])
    return Score(
        data["robot"],
        data["protocol"],
        data["source"],
        data["seed"],
        data["seconds"],
        outcomes,
        alarms,
        data["bar"],
    )
