"""The result of `twin compare`: verdict, findings, text and data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from twin.comparison.compared_items import ComparedItem, NumberEdit
from twin.comparison.file_numbers import why_not_edited
from twin.comparison.fit_problem import ANGLE_PER_LENGTH
from twin.comparison.mimic import MimicError
from twin.comparison.pose_comparison import PoseFit
from twin.comparison.properties import PROPERTY_KINDS, Properties, PropertyRow
from twin.comparison.side import RobotSide
from twin.comparison.side_pair import SidePair
from twin.core import spatial
from twin.core.findings import Finding, disagreement, error, info, warning
from twin.core.json_types import JsonObject
from twin.core.quantity import deg, mm
from twin.core.result import Line, Part, Result, TextTable
from twin.core.spatial import Array
from twin.core.units import MM

_SHOWN_EDITS = 3
"""Number of edits of each side that the text of an item shows."""

_MAX_LISTED_NAMES = 6
"""Number of joints or links that a line on values of only one side names."""

_UNMOVED_SIZE = 1e-9
"""Shift in m and rotation in rad below which a fitted frame is not moved."""


@dataclass(frozen=True)
class Comparison(Result):
    """The comparison of two or more sides, pair by pair.

    Attributes:
        sides: the sides, in the order in which they were given.
        pairs: the comparison of each pair.
        tolerance: distance in m up to which two joint lines coincide.
        strict: whether a difference of convention counts as a disagreement.
    """

    kind: ClassVar[str] = "compare"

    sides: tuple[RobotSide, ...]
    pairs: tuple[SidePair, ...]
    tolerance: float
    strict: bool = False

    @property
    def findings(self) -> list[Finding]:
        """One finding for each convention, difference and property that differs."""
        findings: list[Finding] = []
        for pair in self.pairs:
            findings += self._findings(pair)
        outlier = self.alone
        if outlier is not None:
            text = f"{outlier} stands alone: the other sides agree with each other, and not with it"
            findings.append(info("compare.alone", outlier, text))
        return findings

    def _findings(self, pair: SidePair) -> Iterator[Finding]:
        """Yield the findings of one pair."""
        where = f"{pair.first.label} and {pair.second.label}"
        if pair.kinematics == "unexplained":
            text = "no conventions, and no small number of different links, explain how the two differ"
            yield error("compare.unexplained", where, text)
            return  # without an explanation, no convention and no property has a meaning
        if pair.mimic is not None:
            yield from _mimic_findings(pair.mimic, where, follows=self._mimic_follows(pair.mimic))
        convention_finding = disagreement if self.strict else warning
        for item in pair.conventions:
            yield convention_finding("compare.convention", where, _sentence(item.text), suggestion=_suggestion(item))
        # what joint lines explain is told by them; an open loop explains no pose
        is_explained = bool(pair.differences) and not pair.loops_alone
        if pair.poses is not None and not pair.poses.agrees and pair.kinematics == "disagree" and not is_explained:
            text = f"The poses differ by up to {_remainder_text(pair.poses)} after the fit of base and tool frame."
            yield disagreement("compare.poses", where, text, when=where)
        for item in pair.differences:
            tolerance = self.tolerance if pair.problem is None else pair.problem.tolerance
            size = mm(item.shift) if item.shift > tolerance else deg(item.turn)
            yield disagreement(
                "compare.link", item.joint, _sentence(item.text), size, None, _suggestion(item), when=where, word=""
            )
        if pair.uncompared:
            yield info("compare.uncompared", where, _sentence(_uncompared_joints_text(pair.uncompared)))
        if pair.properties is None:
            return
        for row in pair.properties.rows:
            if row.stated:
                values = f"{row.first} in {pair.first.label}, {row.second} in {pair.second.label}"
                text = f"{row.kind} of '{row.where}': {values}"
                suggestion = " ".join(_edit_sentences(row.edits, together=row.together))
                yield disagreement(f"compare.{row.kind.replace(' ', '_')}", row.where, text, suggestion=suggestion)

    def _mimic_follows(self, mimic: MimicError) -> bool:
        """Return whether mimic joints place all links where the loops do."""
        return mimic.is_within(self.tolerance, ANGLE_PER_LENGTH * self.tolerance)

    @property
    def alone(self) -> str | None:
        """Label of the side that disagrees with all others while they agree with each other, or None."""
        if len(self.sides) < 3:  # of two sides that differ, neither stands alone
            return None
        outliers = []
        for side in self.sides:
            disagrees_with_all = True
            others_agree = True
            for pair in self.pairs:
                if side in (pair.first, pair.second):
                    disagrees_with_all = disagrees_with_all and not pair.agrees
                else:
                    others_agree = others_agree and pair.agrees
            if disagrees_with_all and others_agree:
                outliers.append(side.label)
        if len(outliers) == 1:
            return outliers[0]
        return None

    @property
    def word(self) -> str:
        """The verdict as text."""
        if self.verdict == "agree" and any(pair.conventions for pair in self.pairs):
            return "Agree after conventions"
        return {"agree": "Agree", "disagree": "Disagree", "unchecked": "Could not be compared"}[self.verdict]

    def content(self) -> JsonObject:
        """Return the pairs as plain data."""
        sides = []
        for side in self.sides:
            sides.append({"label": side.label, "joints": side.joint_names})
        return {
            "sides": sides,
            "tolerance_mm": self.tolerance / MM,
            "strict": self.strict,
            "pairs": [pair.as_dict() for pair in self.pairs],
            "alone": self.alone,
        }

    def text(self) -> Iterator[Part]:
        """Yield the verdict of each pair, its conventions, differences, edits and properties."""
        for pair in self.pairs:
            follows = pair.mimic is not None and self._mimic_follows(pair.mimic)
            yield from _pair_text(pair, follows=follows)
        if self.alone is not None:
            yield f"\n{self.alone} stands alone: the other sides agree with each other."
        styles = {"agree": "bold green", "disagree": "bold red", "unchecked": "bold yellow"}
        yield Line(f"\n{self.word}.", styles[self.verdict])


def _mimic_findings(mimic: MimicError, where: str, *, follows: bool) -> Iterator[Finding]:
    """Yield what a comparison of mimic joints with loops says, and what it leaves out."""
    if not follows:
        size = mm(mimic.worst.distance)
        suggestion = "Close the loops in the format, or fit ratio and offset of the mimic joints to the stroke in use."
        text = _sentence(mimic.text()).removesuffix(".")
        yield disagreement("compare.mimic", mimic.leader, text, size, None, suggestion, when=where, word="")
    if mimic.part_text():
        yield info("compare.part", where, f"The joints correspond only in part: {mimic.part_text()}.")
    yield info("compare.uncompared", where, _sentence(_uncompared_text(mimic)))


def _uncompared_text(mimic: MimicError) -> str:
    """Return what a comparison of mimic joints with loops leaves out."""
    tools = "" if mimic.tool is not None else "tool frames, "
    return (
        f"only motions and the limits of '{mimic.leader}' were compared, not {tools}masses, centres of mass, inertias, "
        "speeds, efforts and the limits of other joints"
    )


def _uncompared_joints_text(names: Sequence[str]) -> str:
    """Return that joints beside the tool were not compared by poses."""
    listed = _list_text(list(map(_quoted, names)))
    if len(names) == 1:
        return f"the place of joint {listed} was not compared: the pose of the tool does not depend on it"
    return f"the places of joints {listed} were not compared: the pose of the tool does not depend on them"


def _quoted(name: str) -> str:
    return f"'{name}'"


def _list_text(texts: Sequence[str]) -> str:
    """Return texts as a list for a sentence; only a few of many are named."""
    listed = ", ".join(texts[:_MAX_LISTED_NAMES])
    if len(texts) > _MAX_LISTED_NAMES:
        listed += f" and {len(texts) - _MAX_LISTED_NAMES} more"
    return listed


def _pair_text(pair: SidePair, *, follows: bool) -> Iterator[Part]:
    """Yield the verdict of a pair, its conventions, differences, edits and properties.

    `follows`: whether mimic joints, where they replace loops, place all links where the loops do.
    """
    yield f"{pair.first.label}  ↔  {pair.second.label}: {_verdict_text(pair)}"
    for item in pair.conventions:
        yield f"  ▲ convention, {item.kind}: {item.text}"
        yield from _item_text(item, pair)
    for item in pair.differences:
        yield f"  ✖ {item.text}"
        yield from _item_text(item, pair)
    yield from _unedited_text(pair)
    for texts in pair.ties:
        yield f"  or, equally well: {'; '.join(texts)}"
    if pair.mimic is not None:
        mark = "✔" if follows else "✖"
        yield f"  {mark} {pair.mimic.text()}"
        yield f"  the joints correspond only in part: {pair.mimic.part_text() or 'loops are open'}"
        yield f"  {_uncompared_text(pair.mimic)}"
    if pair.poses is not None:
        yield from _poses_text(pair.poses)
        if pair.uncompared:
            yield f"  {_uncompared_joints_text(pair.uncompared)}"
    elif pair.worst is not None and pair.differences:
        largest = pair.worst
        yield f"  largest difference of '{largest.frame}': {mm(largest.distance)} and {deg(largest.angle)}"
    if pair.properties is not None:
        yield from _properties_text(pair, pair.properties)


def _properties_text(pair: SidePair, properties: Properties) -> Iterator[Part]:
    """Yield the verdict of each kind of property, what only one side states, and what differs with its edits."""
    rows = []
    for kind in PROPERTY_KINDS:
        rows.append((kind, properties.verdict(kind), str(properties.compared[kind])))
    yield TextTable(("property", "verdict", "compared"), rows)
    yield from _one_sided_text(properties.rows)
    stated = [row for row in properties.rows if row.stated]
    if stated:
        table_rows = []
        for row in stated:
            table_rows.append((row.kind, row.where, row.first, row.second))
        yield TextTable(("differs", "of", pair.first.label, pair.second.label), table_rows)
        for row in stated:
            for text in _edit_sentences(row.edits, together=row.together):
                yield f"      {row.kind} of '{row.where}': {text}"


def _unedited_text(pair: SidePair) -> Iterator[str]:
    """Yield for each side whose numbers cannot be edits the reason, if an item has no edit of it."""
    for side in (pair.first, pair.second):
        has_unedited = False
        for item in pair.items:
            if item.moves_geometry and not _has_edit_of(item, side):
                has_unedited = True
        reason = why_not_edited(side)
        if has_unedited and reason:
            yield f"  no edits of {side.label}: {reason}."


def _has_edit_of(item: ComparedItem, side: RobotSide) -> bool:
    """Return whether an item has an edit of a side."""
    return side.label in [edit.side for edit in item.edits]


def _one_sided_text(rows: Sequence[PropertyRow]) -> Iterator[str]:
    """Yield for each kind of property the joints or links of which only one side states a value."""
    for kind in PROPERTY_KINDS:
        names = []
        for row in rows:
            if row.kind == kind and not row.stated:
                names.append(_quoted(row.where))
        if not names:
            continue
        yield f"  {kind} of {_list_text(names)}: not compared, because only one side states them"


def _poses_text(fit: PoseFit) -> Iterator[str]:
    """Yield the fitted frames, the noise and the remainder."""
    kind = "computed" if fit.computed else "measured"
    what = "poses" if fit.rotations else "positions"
    yield f"  {fit.rows} {kind} {what}; fitted: base {_motion_text(fit.base)}, tool {_motion_text(fit.tool)}"
    place = f" in line {fit.line}" if fit.line else ""
    if fit.uncertainty:
        yield f"  standard deviation of these differences: up to {mm(fit.uncertainty)}, of angles at half a metre"
    yield f"  largest remainder {_remainder_text(fit)}{place}; {_noise_text(fit)}"


def _noise_text(fit: PoseFit) -> str:
    """Return the noise of the rows as text, with its source."""
    if fit.computed:
        return "the rows have no noise"
    if fit.noise is None:
        return "noise not stated, and too few rows to estimate it"
    length, angle = fit.noise
    size = f"noise {mm(length)}"
    if fit.rotations:
        size += f" and {deg(angle)}"
    source = "stated by the table" if fit.stated else "estimated from the rows"
    return f"{size} (standard deviation, {source})"


def _remainder_text(fit: PoseFit) -> str:
    """Return the largest remainder of poses, or of positions alone, as text."""
    if fit.rotations:
        return f"{mm(fit.distance)} and {deg(fit.angle)}"
    return str(mm(fit.distance))


def _motion_text(T: Array) -> str:
    """Return the size of a motion (4, 4) as text."""
    shift = float(np.linalg.norm(T[:3, 3]))
    turn = float(spatial.rotation_angle(T[:3, :3]))
    if shift < _UNMOVED_SIZE and turn < _UNMOVED_SIZE:
        return "as it is"
    return f"moved {mm(shift)} and {deg(turn)}"


def _verdict_text(pair: SidePair) -> str:
    """Return the verdict on joints and links as text."""
    if pair.poses is not None and not pair.items:
        return "poses agree" if pair.agrees else "poses disagree"
    if pair.mimic is not None and not pair.loops_alone:
        return "mimic joints follow the loops" if pair.agrees else "mimic joints do not follow the loops"
    texts = {
        "agree": "joints and links agree",
        "agree after conventions": "joints and links agree after these conventions",
        "disagree": "joints and links disagree",
        "unexplained": "no explanation was found",
    }
    return texts[pair.kinematics]


def _item_text(item: ComparedItem, pair: SidePair) -> Iterator[str]:
    """Yield the edits of an item, or that there are none."""
    for label, edits in _edits_by_side(item.edits).items():
        prefix = "edit"
        for edit in edits[:_SHOWN_EDITS]:
            if edit.obstacle:
                yield f"      {edit.text()}"
                continue
            yield f"      {prefix} {edit.text()}"
            prefix = "  or"
        if len(edits) > _SHOWN_EDITS:
            yield f"      and {len(edits) - _SHOWN_EDITS} more in {label}"
    # without joint lines, no text was read with another number
    were_edits_searched = pair.problem is not None and not (why_not_edited(pair.first) and why_not_edited(pair.second))
    if were_edits_searched and not item.edits and item.moves_geometry:
        yield "      no edit of one number was found that removes this"


def _edits_by_side(edits: Sequence[NumberEdit]) -> dict[str, list[NumberEdit]]:
    """Return {label of a side: its edits}."""
    edits_of_side: dict[str, list[NumberEdit]] = {}
    for edit in edits:
        edits_of_side.setdefault(edit.side, []).append(edit)
    return edits_of_side


def _suggestion(item: ComparedItem) -> str:
    """Return the edits of an item as sentences; "" without edits."""
    return " ".join(_edit_sentences(item.edits))


def _edit_sentences(edits: Sequence[NumberEdit], *, together: bool = False) -> list[str]:
    """Return for each side a sentence with its edits.

    Several edits of one side are alternatives, of which a few are shown; with `together`, all are needed and shown.
    """
    separator = "; and " if together else "; or "
    sentences = []
    for edits_of_side in _edits_by_side(edits).values():
        texts = []
        for edit in edits_of_side:
            # what stands in the way of an edit is no alternative to the others: it gets a sentence of its own
            if edit.obstacle:
                sentences.append(f"{edit.text()}.")
            else:
                texts.append(edit.text())
        if not texts:
            continue
        if not together:
            texts = texts[:_SHOWN_EDITS]
        sentences.append(f"Edit {separator.join(texts)}.")
    return sentences


def _sentence(text: str) -> str:
    """Return a text with a capital at its beginning, and a full stop at its end."""
    return text[0].upper() + text[1:] + "."
