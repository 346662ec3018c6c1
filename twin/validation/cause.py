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

_SIDE_OF_CODE: dict[str, Side] = {
    **dict.fromkeys(("cad", "loop"), "CAD"),
    **dict.fromkeys(("point", "points", "driven", "passive", "tool", "forward", "length", "mechanism"), "equations"),
    **dict.fromkeys(("speed", "acceleration", "margin", "range"), "equations"),
    **dict.fromkeys(("stage", "usd"), "stage"),
    "baked": "motion",
}
"""Side of a finding, by the first word of its code; findings with other codes belong to the side "protocol"."""

_EQUAL_SIZE_RATIO = 0.999
"""Findings count as equally large if their size is at least this fraction of the largest size; the first is `head`."""


_NOISE_MAGNIFICATION = 30.0
"""Largest ratio of an error of the equations and a gap of the CAD at which the error can follow from noise."""

_LINK_LENGTH = 0.1
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
    def message(self) -> str:
        """The message of `head`."""
        return self.head.message

    @property
    def findings(self) -> tuple[Finding, ...]:
        """All findings of the cause, `head` first."""
        return (self.head, *self.also, *self.follows, *self.perhaps)

    def lines(self) -> Iterator[str]:
        """Yield a line with places and sizes for each of `also`, `follows` and `perhaps` that is not empty."""
        if self.also:
            yield f"also: {_sizes_text(self.also)}"
        if self.follows:
            yield f"follows from this: {_sizes_text(self.follows)}"
        if self.perhaps:
            yield f"may follow from this: {_sizes_text(self.perhaps)}"

    def as_dict(self) -> JsonObject:
        """Return the cause as JSON data; findings other than `head` have only code, place and size."""
        return {
            "cause": self.name,
            "side": self.side,
            "between": SIDES[self.side],
            "code": self.head.code,
            "where": self.head.where,
            "size": self.head.size,
            "unit": self.head.unit,
            "limit": self.head.limit,
            "also": _references(self.also),
            "follows": _references(self.follows),
            "may_follow": _references(self.perhaps),
        }


def _references(findings: Iterable[Finding]) -> list[JsonObject]:
    """Return code, place and size of findings as JSON data."""
    references: list[JsonObject] = []
    for finding in findings:
        references.append({"code": finding.code, "where": finding.where, "size": finding.size, "unit": finding.unit})
    return references


def causes(findings: Iterable[Finding]) -> tuple[Cause, ...]:
    """Return the causes of errors and disagreements: errors first; within a severity, in the order of `SIDES`."""
    ordered = by_severity(findings)
    groups: dict[tuple[Side, str], list[Finding]] = {}
    for finding in ordered:
        if finding.severity in ("error", "disagreement"):
            groups.setdefault(_side_and_name(finding), []).append(finding)
    for finding in ordered:  # warnings and notes are listed only under a cause that they name
        if finding.severity in ("warning", "info") and finding.cause and _side_and_name(finding) in groups:
            groups[_side_and_name(finding)].append(finding)
    ordered_causes = []
    for (faulty, name), group in groups.items():
        ordered_causes.append(_cause(faulty, name, group))
    # the sort is stable: causes of one side stay in the order of their severity
    sides = list(SIDES)
    ordered_causes.sort(key=lambda cause: (cause.head.severity != "error", sides.index(cause.side)))
    return _with_equations_after_cad(ordered_causes)


def side_of(finding: Finding) -> Side:
    """Return the side of a finding, a key of `SIDES`, from the first word of its code."""
    return _SIDE_OF_CODE.get(finding.code.partition(".")[0], "protocol")


def _side_and_name(finding: Finding) -> tuple[Side, str]:
    """Return (side, name) of the cause to which a finding belongs."""
    faulty = side_of(finding)
    if finding.cause:
        if faulty == "CAD" and finding.code.startswith("loop."):
            faulty = "equations"  # a loop that is open at the equations' joint values is their fault
        return faulty, finding.cause
    if faulty == "CAD":
        return faulty, finding.where  # whatever is found on one part has one cause: the part
    return faulty, f"{finding.code} {finding.where}"


def _cause(faulty: Side, name: str, group: list[Finding]) -> Cause:
    """Return the cause of a group of findings, the most severe one first; findings of another kind follow from it."""
    first = group[0]  # the most severe: groups are filled in that order
    alike: list[Finding] = []
    follows: list[Finding] = []
    for finding in group:
        if (finding.code, finding.severity) == (first.code, first.severity):
            alike.append(finding)
        else:
            follows.append(finding)
    head = _representative(alike)
    also = []
    for finding in alike:
        if finding is not head:  # by identity: two findings can have the same content
            also.append(finding)
    return Cause(first.cause or first.where or first.code, faulty, head=head, also=tuple(also), follows=tuple(follows))


def _representative(findings: list[Finding]) -> Finding:
    """Return the first of the findings, in the unit of the first, that is about as large as the largest of them."""
    first = findings[0]
    comparable: list[tuple[float, Finding]] = []
    for finding in findings:
        if finding.unit == first.unit and finding.size is not None:
            comparable.append((finding.size, finding))
    largest = max((size for size, _ in comparable), default=0.0)
    # not simply the largest: rounding would decide between equal faults, and name another one on another machine
    for size, finding in comparable:
        if size >= _EQUAL_SIZE_RATIO * largest:
            return finding
    return first


def _with_equations_after_cad(ordered_causes: list[Cause]) -> tuple[Cause, ...]:
    """If the first cause is a fault of the CAD, move findings on the equations to `perhaps` of this cause.

    Findings on the equations that are much larger than the gaps of a noisy CAD are causes of their own.
    """
    if not ordered_causes or ordered_causes[0].side != "CAD" or ordered_causes[0].head.severity != "disagreement":
        return tuple(ordered_causes)
    # the equations were compared with a mechanism that is itself wrong, so their differences may be its fault
    first = ordered_causes[0]
    perhaps: list[Finding] = []
    others: list[Cause] = []
    for cause in ordered_causes[1:]:
        if cause.side == "equations" and not _is_beyond_noise(cause.head, first.head):
            perhaps += cause.findings
        else:
            others.append(cause)
    return (replace(first, perhaps=tuple(perhaps)), *others)


def _is_beyond_noise(finding: Finding, cad: Finding) -> bool:
    """Return whether a finding is too large to follow from noise of the CAD, the finding `cad`."""
    if cad.code != "cad.noise" or finding.size is None or cad.size is None:
        return False
    gap = _NOISE_MAGNIFICATION * cad.size * MM
    if finding.unit == "mm":
        return finding.size * MM > gap
    if finding.unit == "deg":
        return finding.size * DEG > gap / _LINK_LENGTH
    return False  # rates and shares are compared with no gap


def _sizes_text(findings: Sequence[Finding], most: int = 6) -> str:
    """Return a text with place and size of each of the first `most` findings, and the number of further findings."""
    texts: list[str] = []
    for finding in findings[:most]:
        if finding.size is None:
            texts.append(finding.code.partition(".")[2].replace("_", " "))
        else:
            texts.append(f"{finding.where} {shown(finding.size, finding.unit)}".strip())
    listed = "; ".join(texts)
    if len(findings) > most:
        listed += f" and {len(findings) - most} more"
    return listed
