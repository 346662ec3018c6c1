"""Compare what files state about themselves: the robot's name, and titles, rates and errors of clips."""

from __future__ import annotations

from collections.abc import Sequence

from twin.exchange.audit.file_content import Content
from twin.exchange.audit.ledger import MECHANISM
from twin.exchange.formats import family, trust

ROBOT = "robot"
"""Name of the statement that `compare_stated` compares with the mechanism."""

_SAME_NUMBER_TOL = 1e-5
"""Relative difference of numbers that are written with six digits."""


def compare_stated(contents: Sequence[Content], robot: str = "") -> None:
    """Report statements that differ from those of most formats; `robot` is the name of the mechanism, if there is one.

    If as many formats state one value as the other, the one that is trusted more is right, as for other data.
    """
    names: dict[str, None] = {}
    for content in contents:
        names |= dict.fromkeys(content.stated)
    for name in names:
        stating = []
        for content in contents:
            if name in content.stated:
                stating.append(content)
        stating.sort(key=lambda content: trust(content.format))
        if name == ROBOT and robot:
            _report(name, stating, robot, MECHANISM, "")
        elif len(stating) > 1:
            groups = _groups(name, stating)
            right_group = max(groups, key=_count_formats)  # of equal ones the first, which is trusted most
            doubt = ""
            if _count_formats(right_group) == 1:
                doubt = " One of the two statements is wrong."
            _report(name, stating, right_group[0].stated[name], right_group[0].file, doubt)


def _count_formats(contents: Sequence[Content]) -> int:
    """Return the number of formats of files; those of one format are written from the same data, and count once."""
    return len({family(content.format) for content in contents})


def _groups(name: str, stating: Sequence[Content]) -> list[list[Content]]:
    """Return the files in groups: each states the same as the first of its group."""
    groups: list[list[Content]] = []
    for content in stating:
        for group in groups:
            if same_value(group[0].stated[name], content.stated[name]):
                group.append(content)
                break
        else:
            groups.append([content])
    return groups


def _report(name: str, stating: Sequence[Content], expected: object, source: str, doubt: str) -> None:
    """Report the files whose statement `name` is not the expected one of `source`; `doubt` ends each message."""
    for content in stating:
        value = content.stated[name]
        if not same_value(value, expected):
            text = f"{name} is stated as {value!r}; in {source} it is {expected!r}.{doubt}"
            advice = "export all files again, together"
            content.ledger.wrong("compare.stated", text, name, suggestion=advice)


def same_value(a: object, b: object) -> bool:
    """Return whether two values are equal; numbers are equal within the digits of texts."""
    if isinstance(a, int | float) and isinstance(b, int | float):
        return abs(a - b) <= _SAME_NUMBER_TOL * max(abs(a), abs(b))
    return bool(a == b)
