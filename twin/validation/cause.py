"""Group findings by cause, and assign each cause to a side: equations (A), CAD (B), stage (C), motion (D), protocol."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from twin.core.findings import Finding, by_severity
from twin.core.format import shown
from twin.core.json_types import JsonObject
from twin.core.units import DEG, MM

Side = Literal["CAD", "equations", "stage", "motion", "protocol"]

SIDES: dict[Side, str] = {
    "CAD": "the CAD (B) contradicts itself",
    "equations": "equations (A) and CAD (B) differ",
    "stage": "USD stage (C) and CAD (B) differ",
    "motion": "baked motion (D) and CAD (B) differ",
    "protocol": "the motion breaks a limit of the protocol or of the robot",
}
"""Message for each side that can be faulty. Causes are listed in the order of these sides, because a fault of one side
can cause findings on a later side."""

_FAMILIES: dict[str, Side] = {
    **dict.fromkeys(("cad", "loop"), "CAD"),
    **dict.fromkeys(("point", "points", "driven", "passive", "tool", "forward", "length", "mechanism"), "equations"),
    **dict.fromkeys(("speed", "acceleration", "margin", "range"), "equations"),
    **dict.fromkeys(("stage", "usd"), "stage"),
    "baked": "motion",
}
"""Side of a finding, by the first word of its code; findings with other codes belong to the side "protocol"."""

_SAME = 0.999
"""Findings count as equally large if their size is at least this fraction of the largest size; the first is `head`."""


_LEVER = 30.0
"""Largest ratio of an error of the equations and a gap of the CAD at which the error can follow from noise."""

_LINK = 0.1
"""Length in m by which gaps are divided to compare them with angles."""


@dataclass(frozen=True)
class Cause:
    """One cause with its findings.

    Attributes:
        name: name of the fault: the wrong equation (with its variant), joint, CAD part or file, or the violated rule.
        side: the faulty side, a key of `SIDES`.
        head: the finding that represents the cause: the largest one.
        also: further findings with the same code, in other rows or places.
        follows: other findings that this cause explains.
        perhaps: findings that this cause may explain, because they compare values with the faulty side.
    """

    name: str
    side: Side
    head: Finding
    also: tuple[Finding, ...] = ()
    follows: tuple[Finding, ...] = ()
    perhaps: tuple[Finding, ...] = ()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """All findings of the cause, `head` first."""
        return (self.head, *self.also, *self.follows, *self.perhaps)

    def lines(self) -> Iterator[str]:
        """Yield a line with places and sizes for each of `also`, `follows` and `perhaps` that is not empty."""
        for words, found in (("also", self.also), ("follows", self.follows), ("may follow", self.perhaps)):
            if found:
                yield f"{words}: {_sizes(found)}" if words == "also" else f"{words} from this: {_sizes(found)}"

    def as_dict(self) -> JsonObject:
        """Return the cause as JSON data; findings other than `head` have only code, place and size."""

        def named(findings: Iterable[Finding]) -> list[JsonObject]:
            return [{"code": f.code, "where": f.where, "size": f.size, "unit": f.unit} for f in findings]

        return {
            "cause": self.name,
            "side": self.side,
            "between": SIDES[self.side],
            "code": self.head.code,
            "where": self.head.where,
            "size": self.head.size,
            "unit": self.head.unit,
            "limit": self.head.limit,
            "also": named(self.also),
            "follows": named(self.follows),
            "may_follow": named(self.perhaps),
        }


def causes(findings: Iterable[Finding]) -> tuple[Cause, ...]:
    """Return the causes of errors and disagreements: errors first; within a severity, in the order of `SIDES`."""
    ordered = by_severity(findings)
    groups: dict[tuple[Side, str], list[Finding]] = {}
    for f in ordered:
        if f.severity in ("error", "disagreement"):
            groups.setdefault(_key(f), []).append(f)
    for f in ordered:  # warnings and notes are listed only under a cause that they name
        if f.severity in ("warning", "info") and f.cause and _key(f) in groups:
            groups[_key(f)].append(f)
    out = [_cause(side, name, group) for (side, name), group in groups.items()]
    out.sort(key=lambda c: (c.head.severity != "error", list(SIDES).index(c.side)))
    return _after_cad(out)


def side(finding: Finding) -> Side:
    """Return the side of a finding, a key of `SIDES`, from the first word of its code."""
    return _FAMILIES.get(finding.code.partition(".")[0], "protocol")


def _key(f: Finding) -> tuple[Side, str]:
    of = side(f)
    if f.cause:  # a loop that is open at the equations' joint values is a fault of the equations
        return "equations" if of == "CAD" and f.code.startswith("loop.") else of, f.cause
    return of, f.where if of == "CAD" else f"{f.code} {f.where}"


def _cause(of: Side, name: str, group: list[Finding]) -> Cause:
    first = group[0]
    alike = [f for f in group if (f.code, f.severity) == (first.code, first.severity)]
    rivals = [f for f in alike if f.unit == first.unit and f.size is not None]
    top = max((f.size or 0.0 for f in rivals), default=0.0)
    head = next((f for f in rivals if (f.size or 0.0) >= _SAME * top), first)
    return Cause(
        first.cause or first.where or first.code,
        of,
        head,
        tuple(f for f in alike if f is not head),
        tuple(f for f in group if f not in alike),
    )


def _after_cad(found: list[Cause]) -> tuple[Cause, ...]:
    """If the first cause is a fault of the CAD, move findings on the equations to `perhaps` of this cause.

    Findings on the equations that are much larger than the gaps of a noisy CAD are causes of their own.
    """
    if not found or found[0].side != "CAD" or found[0].head.severity != "disagreement":
        return tuple(found)
    blamed = [c for c in found if c.side == "equations" and not _beyond(c.head, found[0].head)]
    below = replace(found[0], perhaps=tuple(f for c in blamed for f in c.findings))
    return (below, *(c for c in found[1:] if c not in blamed))


def _beyond(f: Finding, cad: Finding) -> bool:
    """Return whether the finding `f` is too large to follow from noise of the CAD, the finding `cad`."""
    if cad.code != "cad.noise" or f.size is None or cad.size is None:
        return False
    gap = _LEVER * cad.size * MM
    if f.unit == "mm":
        return f.size * MM > gap
    if f.unit == "deg":
        return f.size * DEG > gap / _LINK
    return False  # rates and shares are compared with no gap


def _sizes(found: Sequence[Finding], most: int = 6) -> str:
    """Return a text with place and size of each of the first `most` findings, and the number of further findings."""
    words = [
        f.code.partition(".")[2].replace("_", " ") if f.size is None else f"{f.where} {shown(f.size, f.unit)}".strip()
        for f in found
    ]
    return "; ".join(words[:most]) + (f" and {len(words) - most} more" if len(words) > most else "")
