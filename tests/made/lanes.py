"""Share the cases of a test between the default suite, the slow lane and the nightly lane."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from functools import cache
from typing import Any

import pytest

from twin.core import assets

CONTRASTING = ("davinci_psm", "pa10", "sher")
"""Built-in robots that differ most by `kind`: loops with couplings, no loop, loops with ball joints."""


def thinned(cases: Iterable[Any], every: int, slow: int = 3) -> list[Any]:
    """Return cases for `parametrize`, shared between three lanes.

    One in `every` is unmarked; of the others, those whose index is 1 modulo `slow` are marked slow, the rest nightly.
    """
    found = []
    for i, case in enumerate(cases):
        if i % every == 0:
            found.append(case)
        elif i % slow == 1:
            found.append(pytest.param(case, marks=pytest.mark.slow))
        else:
            found.append(pytest.param(case, marks=pytest.mark.nightly))
    return found


def nightly(cases: Iterable[Any], every: int) -> list[Any]:
    """Return cases for `parametrize`: one in `every` stays in the lane of its test, the others are marked nightly.

    Cases that are lists or tuples are the values of several parameters.
    """
    found = []
    for i, case in enumerate(cases):
        values = case if isinstance(case, list | tuple) else (case,)
        found.append(case if i % every == 0 else pytest.param(*values, marks=pytest.mark.nightly))
    return found


def contrasting(robots: Iterable[str] | None = None) -> list[Any]:
    """Return built-in robots (all by default) for `parametrize`: those that differ most; the others marked nightly."""
    names = assets.names() if robots is None else list(robots)
    return [n if n in CONTRASTING else pytest.param(n, marks=pytest.mark.nightly) for n in names]


def robots(unmarked: Iterable[str], slow: Iterable[str]) -> list[Any]:
    """Return all built-in robots for `parametrize`: some unmarked, some marked slow, the others marked nightly."""
    found: list[Any] = list(unmarked)
    for name in assets.names():
        if name in slow:
            found.append(pytest.param(name, marks=pytest.mark.slow))
        elif name not in found:
            found.append(pytest.param(name, marks=pytest.mark.nightly))
    return found


@cache
def kind(robot: str) -> tuple[bool, ...]:
    """Return the kind of a built-in robot, from its description file: whether it has each of five features.

    The features: loops; joints other than fixed, revolute and prismatic; actuators, transmissions or couplings; a
    trocar; more than six driven joints.
    """
    said = tomllib.loads(assets.files(robot).description.read_text(encoding="utf-8"))
    joints = said["joint"]
    return (
        len(joints) >= len(said["body"]),
        not {j["type"] for j in joints} <= {"fixed", "revolute", "prismatic"},
        any(key in said for key in ("actuator", "transmission", "coupling")),
        "trocar" in said or "trocars" in said,
        sum(bool(j.get("active")) for j in joints) > 6,
    )


def alike(robots: Iterable[str]) -> set[str]:
    """Return the robots that are of the same kind as an earlier robot in the list."""
    names = list(robots)
    return {name for i, name in enumerate(names) if kind(name) in map(kind, names[:i])}


def one_of_a_kind(robots: Iterable[str] | None = None) -> list[Any]:
    """Return built-in robots (all by default) for `parametrize`: the first of each kind, the others marked nightly."""
    names = assets.names() if robots is None else list(robots)
    return [pytest.param(n, marks=pytest.mark.nightly) if n in alike(names) else n for n in names]


def designs() -> list[str]:
    """Return the built-in robots without mirrored copies, which have the same dimensions file as another robot."""
    drawn = {n: (assets.files(n).description.parent / "dimensions.toml").read_bytes() for n in assets.names()}
    return [n for i, n in enumerate(drawn) if drawn[n] not in list(drawn.values())[:i]]
