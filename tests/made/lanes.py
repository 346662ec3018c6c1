"""Which cases of a table run in the default suite; the others run in the slow lane."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from functools import cache
from typing import Any

import pytest

from twin.core import assets


def thinned(cases: Iterable[Any], every: int) -> list[Any]:
    """Return cases for `parametrize`: one of `every` as it is, the others marked slow. Each is whole in CI."""
    return [case if i % every == 0 else pytest.param(case, marks=pytest.mark.slow) for i, case in enumerate(cases)]


@cache
def kind(robot: str) -> tuple[bool, ...]:
    """Return what sets a built-in robot apart from others, as its description file says.

    These are: loops, joints that are not hinges or slides, motors that move several joints, a trocar among the joints,
    and more driven joints than a pose has coordinates.
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
    """Return the robots before which there is one of the same kind."""
    names = list(robots)
    return {name for i, name in enumerate(names) if kind(name) in map(kind, names[:i])}


def one_of_a_kind(robots: Iterable[str] | None = None) -> list[Any]:
    """Return built-in robots (all by default) for `parametrize`: the first of each kind, the others marked slow."""
    names = assets.names() if robots is None else list(robots)
    return [pytest.param(n, marks=pytest.mark.slow) if n in alike(names) else n for n in names]


def designs() -> list[str]:
    """Return built-in robots without the mirror images of others: these have the same equations and dimensions."""
    drawn = {n: (assets.files(n).description.parent / "dimensions.toml").read_bytes() for n in assets.names()}
    return [n for i, n in enumerate(drawn) if drawn[n] not in list(drawn.values())[:i]]
