"""Compare the mechanism data of files, with one table of quantities and their tolerances.

Each format counts as one independent source, because several files of a format may share data (five stages may share
one layer). If a mechanism is given, the value in the mechanism counts as correct; otherwise, the value that most
sources state.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.exchange.audit.compared_quantities import QUANTITIES, ComparisonRule, difference_text, words_of
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.file_view import MECHANISM_FORMAT, FileView
from twin.exchange.audit.ledger import MECHANISM, Measured
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.stated_values import state_all, stated_keys
from twin.exchange.format import Holds
from twin.exchange.formats import trust

_GEOMETRY = ("place", "axis", "pose", "zero")
"""Quantities that show where the joints of a robot are."""


def compare_mechanisms(contents: Sequence[Content], truth: FileMechanism | None = None) -> None:
    """Compare links, joints, frames and gravity of all files, and report differences in each file's ledger.

    `truth` contains the data of the expected mechanism. If it is None, the files are compared only with each other.
    """
    views = []
    for content in contents:
        if content.mechanism is not None or content.shapes:
            mechanism = content.mechanism or FileMechanism()
            view = FileView(
                content.file,
                content.format,
                content.ledger,
                mechanism,
                content.shapes,
                content.colors,
                content.finishes,
            )
            views.append(view)
    if truth is not None:
        views.append(FileView(MECHANISM, MECHANISM_FORMAT, None, truth))
    # By trust, because the first file of a group of equal ones is its reference.
    views.sort(key=_trust)
    if len(views) < 2:
        return
    state_all(views, contents)
    _check_transmissions(views)
    worst: dict[str, dict[str, tuple[float, str]]] = {}
    for subject, name in stated_keys(views):
        stating = []
        for view in views:
            if (subject, name) in view.values:
                stating.append(view)
        if len(stating) > 1:
            _compare_values(subject, name, stating, worst)
    others = "the other files"
    if truth is not None and len(views) == 2:
        # With one file and the mechanism, the row states the mechanism as the source of the values.
        others = MECHANISM
    for view in views:
        if view.ledger is None:
            continue
        for name, (difference, subject) in worst.get(view.file, {}).items():
            rule = QUANTITIES[name]
            check = f"{words_of(name)} against {others}"
            finite = min(difference, 1e300)  # JSON has no infinity
            fits = True if rule.severity == "warning" else None  # a warning is no disagreement
            unit = rule.unit_of_difference
            view.ledger.row(check, finite, unit, rule.tolerance, where=subject, fits=fits, against=others)


def _check_transmissions(views: Sequence[FileView]) -> None:
    """Report a URDF without transmissions if other files state which joints are driven.

    A single file that is compared with the mechanism receives a warning, because URDFs of others often have none.
    """
    for view in views:
        if not view.holds(Holds.TRANSMISSIONS) or view.mechanism.reductions is not None or view.ledger is None:
            continue
        others = []
        for other in views:
            if other is not view:
                others.append(other)
        driven = _driven(view.mechanism.joints, others)
        if driven:
            sources = _file_names(others)
            names = ", ".join(sorted(driven))
            text = f"the file has no transmissions; in {sources} the driven joints are {names}."
            severity = "disagreement" if len(views) > 2 else "warning"
            advice = "write a transmission for each driven joint"
            code = f"{view.format}.transmission"
            view.ledger.add(code, severity, text, "transmissions", suggestion=advice)


def _driven(joints: Sequence[FileJoint], views: Sequence[FileView]) -> set[str]:
    """Return the names of the joints with one coordinate that one of the files states as driven."""
    driven = set()
    for joint in joints:
        # A transmission acts on one coordinate: joints in parts, such as balls, have none.
        if len(joint.names) != 1 or len(joint.motions) != 1:
            continue
        name = joint.names[0]
        for view in views:
            if view.values.get((f"joint '{name}'", "driven")):
                driven.add(name)
    return driven


def _compare_values(
    subject: str, name: str, views: Sequence[FileView], worst: dict[str, dict[str, tuple[float, str]]]
) -> None:
    """Compare the values of one quantity in the files that state it.

    `worst` gets the largest difference of each file and quantity: {file: {quantity: (difference, subject)}}.
    """
    rule = QUANTITIES[name]
    key = (subject, name)
    groups = _groups(key, rule, views)
    right_group = max(groups, key=_weight)
    if rule.usual is not None:
        for group in groups:
            if group[0].values[key] == rule.usual:
                right_group = group
    reference = right_group[0]
    with_mechanism = any(view.is_mechanism for view in views)
    if rule.by_majority and not with_mechanism and len(_families(right_group)) < 2:
        return
    for view in views:
        if view.ledger is not None and with_mechanism:
            view.ledger.placed |= name in _GEOMETRY
        difference = rule.difference(reference.values[key], view.values[key])
        row = worst.setdefault(view.file, {})
        if rule.is_check and (name not in row or difference > row[name][0]):
            row[name] = (difference, subject)
        if view in right_group or view.ledger is None:
            continue
        others = _file_names(right_group)
        text = difference_text(subject, name, view.values[key], reference.values[key], difference, others)
        if len(_families(right_group)) == 1 and not reference.is_mechanism:
            text += " One of the two statements is wrong."
        advice = "find out which file is wrong: `twin audit --robot NAME` compares every file with the mechanism"
        if reference.is_mechanism:
            advice = "export the file again; if its value is the right one, correct the robot"
        value: float | None = None
        if np.isfinite(difference):
            value = difference
        size = Measured(value, rule.tolerance, rule.unit_of_difference)
        # "physics", as before in results that other programs read
        code = f"physics.{name.replace(' ', '_')}"
        view.ledger.add(code, rule.severity, text, subject, suggestion=advice, size=size)


def _groups(key: tuple[str, str], rule: ComparisonRule, views: Sequence[FileView]) -> list[list[FileView]]:
    """Return the files in groups: each agrees with the first of its group."""
    groups: list[list[FileView]] = []
    for view in views:
        for group in groups:
            # With the first of the group: along a chain of neighbours, files farther apart than the tolerance would
            # agree.
            if rule.difference(group[0].values[key], view.values[key]) <= rule.tolerance:
                group.append(view)
                break
        else:
            groups.append([view])
    return groups


def _families(views: Sequence[FileView]) -> set[str]:
    """Return the independent sources among files."""
    return {view.family for view in views}


def _trust(view: FileView) -> int:
    if view.is_mechanism:
        return 0
    return trust(view.format)


def _weight(group: Sequence[FileView]) -> tuple[bool, int, int]:
    """Return what decides which group is right: the mechanism, the number of sources, the trust in its first file."""
    families = _families(group)
    # Negative: of groups with as many sources, the one with the most trusted file, whose number is the smallest.
    return MECHANISM_FORMAT in families, len(families), -min(map(_trust, group))


def _file_names(views: Sequence[FileView]) -> str:
    """Return the names of files as text; of more than three, the first two and the number of the others."""
    names = [view.file for view in views]
    if len(names) > 3:
        names = [*names[:2], f"{len(views) - 2} more"]
    *first, last = names
    if not first:
        return last
    return f"{', '.join(first)} and {last}"
