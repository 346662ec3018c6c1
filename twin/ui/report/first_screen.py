"""The questions of a reader that the first screen answers: which joint, how much, which line, what was not judged."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from twin.core import format as fmt
from twin.core.findings import Finding
from twin.ui.report import plot_data
from twin.ui.report.residual_matrix import PAIR_TITLES, label
from twin.ui.report.robot_picture import RobotPicture
from twin.validation.result import Report

_NOT_KINEMATIC = "forces, bending and play in the joints (the comparison is kinematic)"

_MAX_PLACES = 4
"""Largest number of further places of a cause that an answer names; the first screen has room for few."""

_MAX_WARNINGS = 2
"""Largest number of warnings that an answer quotes."""

_MAX_MISSING = 4
"""Largest number of comparisons and checks that are named as missing."""


@dataclass(frozen=True)
class Answer:
    """A question and its answer in plain words. `code`: a file with its line, or a command line, or ""."""

    question: str
    text: str
    code: str = ""


def answers(report: Report, picture: RobotPicture | None) -> list[Answer]:
    """Return the answers beside the picture; "What to do" above them is the report's suggestion.

    Without a cause, the answers state what was compared, how close it is, and the warnings; then the line "What to do"
    names what was not judged.
    """
    rows = []
    if report.causes:
        head = report.causes[0].head
        rows.append(Answer("Which joint or link?", _which(report, picture)))
        rows.append(Answer("How much?", _how_much(head)))
        rows.append(_which_line(report, picture))
        rows.append(Answer("What was not judged?", "; ".join(not_judged(report))))
        return rows
    rows.append(Answer("What was compared?", _compared(report)))
    nearest = _nearest(report)
    if nearest:
        rows.append(Answer("How close?", nearest))
    warnings = [finding for finding in report.findings if finding.severity == "warning"]
    if warnings:
        texts = [finding.message for finding in warnings[:_MAX_WARNINGS]]
        if len(warnings) > _MAX_WARNINGS:
            texts.append(f"{len(warnings) - _MAX_WARNINGS} more below")
        rows.append(Answer("Any warning?", "; ".join(texts)))
    return rows


def _nearest(report: Report) -> str:
    """Return the residual that comes nearest to its tolerance, as text; "" without residuals with a tolerance."""
    judged = []
    of_equations = []
    for row in report.residuals:
        if row.tolerance and math.isfinite(row.worst):
            judged.append(row)
            if row.pair == "A-B":
                of_equations.append(row)
    # equations against mechanism is what a reader asks for first
    candidates = of_equations or judged
    if not candidates:
        return ""
    row = max(candidates, key=lambda row: row.worst / (row.tolerance or 1.0))
    pair, _ = PAIR_TITLES.get(row.pair, (row.pair, row.pair))
    worst = fmt.deviation(row.worst, row.unit, row.tolerance)
    allowed = fmt.quantity(row.tolerance, row.unit)
    return f"{pair}: {label(row)} {worst}; {allowed} allowed; the others are further from their tolerances"


def _which(report: Report, picture: RobotPicture | None) -> str:
    cause = report.causes[0]
    where = cause.head.where or cause.name
    text = where
    if cause.name and cause.name != where:
        if cause.side == "equations":
            text += f", by {_equations(cause.name)}"
        else:
            text += f" ({cause.name})"
    if picture is not None and picture.marked:
        links = [link for link in picture.marked if link != where]
        if links:
            text += f", on {' and '.join(links)}"
    others = [finding.where for finding in cause.also if finding.where and finding.where != where]
    if others:
        named = dict.fromkeys(others[:_MAX_PLACES])
        text += f"; also {', '.join(named)}"
        if len(others) > _MAX_PLACES:
            text += f" and {len(others) - _MAX_PLACES} more"
    return text


def _equations(names: str) -> str:
    """Return names of equations, separated by commas; of many, their number."""
    count = names.count(", ") + 1
    if count > _MAX_PLACES:
        return f"one of {count} equations"
    return names


def _how_much(head: Finding) -> str:
    if head.size is None:
        return "no size: the check could not be done"
    text = fmt.shown(head.size, head.unit)
    if head.limit is not None:
        text += f"; allowed: {fmt.shown(head.limit, head.unit)}{times_limit(head)}"
    if head.when:
        text += f"; worst: {head.when}"
    return text


def times_limit(finding: Finding) -> str:
    """Return how many times its limit a finding's size is, such as " (3×10⁶ times exceeded)"; "" without a limit."""
    if not finding.size or not finding.limit or not math.isfinite(finding.size):
        return ""
    size = abs(finding.size)
    limit = abs(finding.limit)
    if size <= limit:
        return ""
    return f" ({fmt.ratio(size, limit).rstrip('×')} times that)"


def _which_line(report: Report, picture: RobotPicture | None) -> Answer:
    question = "Which line?"
    cited = re.search(r"\(([^()\s]+:\d+(?:, \d+)*)\)", report.cure)
    if cited:
        return Answer(question, "", cited[1])
    if picture is not None and picture.line:
        return Answer(question, "", picture.line)
    if report.causes[0].side == "equations" and "explain" in report.commands:
        return Answer(question, "search for it with", report.commands["explain"])
    return Answer(question, "not known; the finding names the place")


def _compared(report: Report) -> str:
    rows = [row for row in report.residuals if row.tolerance is not None]
    text = f"{fmt.count(len(rows), 'quantity', 'quantities')} along {report.protocol_title or report.protocol}"
    judged = report.facts.get("joint range", {}).get("judged", "")
    if judged:
        text += f", and {judged}"
    return text


def not_judged(report: Report) -> list[str]:
    """Return what the verdict does not cover, the most important first."""
    texts = list(_missing(report))
    for finding in report.findings:
        if finding.severity == "error":
            texts.append(f"{finding.where or finding.code}: {finding.message}")
    texts = texts[:_MAX_MISSING]
    if report.assumed:
        texts.append(f"whether the assumed values are those of a built robot: {report.assumed_counts}")
    texts.append(_NOT_KINEMATIC)
    return texts


def _missing(report: Report) -> Iterator[str]:
    """Yield the comparisons that the report does not contain."""
    pairs = {row.pair for row in report.residuals if row.tolerance is not None}
    if "A-B" not in pairs:
        yield "equations (there are none, or they were not compared)"
    judged = report.facts.get("joint range", {}).get("judged", "")
    if not judged and "A-B" in pairs:
        yield "poses off this protocol"
    elif judged and not judged.startswith("100 %"):
        share = re.match(r"(\d+) %", judged)
        if share:
            yield f"{100 - int(share[1])} % of the joint range"
        else:
            yield f"the joint range beyond {judged}"
    if not pairs & {"B-C", "C"}:
        yield "the USD stage"
    if "B-D" not in pairs:
        yield "the baked motion"
    if plot_data.curve_of(report, "clearance", "clearance_t") is None:
        yield "collisions"
    open_rows = sum(row.tolerance is None for row in report.residuals)
    if open_rows:
        yield fmt.count(open_rows, "quantity without a tolerance", "quantities without a tolerance")
