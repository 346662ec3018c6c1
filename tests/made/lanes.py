"""Select the cases that run in the default suite; the other cases are marked slow."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from functools import cache
from typing import Any

import pytest

from twin.core import assets


def thinned(cases: Iterable[Any], every: int) -> list[Any]:
    """Return cases for `parametrize`: one in `every` is unmarked, the others are marked slow. CI runs all cases."""
    return [case if i % every == 0 else pytest.param(case, marks=pytest.mark.slow) for i, case in enumerate(cases)]


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
    """Return built-in robots (all by default) for `parametrize`: the first of each kind, the others marked slow."""
    names = assets.names() if robots is None else list(robots)
    return [pytest.param(n, marks=pytest.mark.slow) if n in alike(names) else n for n in names]


def designs() -> list[str]:
    """Return the built-in robots without mirrored copies, which have the same dimensions file as another robot."""
    drawn = {n: (assets.files(n).description.parent / "dimensions.toml").read_bytes() for n in assets.names()}
    return [n for i, n in enumerate(drawn) if drawn[n] not in list(drawn.values())[:i]]
