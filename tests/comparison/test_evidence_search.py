"""Seeded changes of convention over five robots and four formats: each is resolved or a tie, none is accused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import twin
from made import chains
from twin.comparison.side_pair import SidePair

KINDS = ("base frame", "tool frame", "zero", "sign", "name", "zero")


QUICK = ("gantry", "offset_arm")
"""Robots whose first change is tried by default: one slides, the other turns."""


def lane(robot: str, seed: int) -> list[pytest.MarkDecorator]:
    """Return the marks of a case: the first change of two robots is tried by default, the last eight nightly."""
    if seed == 0 and robot in QUICK:
        return []
    return [pytest.mark.slow] if seed < 4 else [pytest.mark.nightly]


SINGLE = [pytest.param(name, seed, marks=lane(name, seed)) for name in chains.ROBOTS for seed in range(12)]

DOUBLE = [(name, seed) for name in chains.ROBOTS for seed in range(6)]


def changed(robot: chains.Chain, kind: str, rng: np.random.Generator) -> tuple[chains.Chain, tuple[str, str]]:
    """Return the robot with another convention, and (kind, joint) of the change."""
    i = int(rng.integers(len(robot.lines)))
    name = chains.ROBOTS["seven"].names()[i]
    if kind == "base frame":
        return chains.with_base(robot, chains.pose(rng, 0.5, float(rng.uniform(0.2, 3.0)))), (kind, "")
    if kind == "tool frame":
        return chains.with_tool(robot, chains.pose(rng, 0.1, float(rng.uniform(0.2, 3.0)))), (kind, "")
    if kind == "sign":
        return chains.with_sign(robot, i), (kind, name)
    if kind == "name":
        return chains.with_names(robot), (kind, "")
    size = float(rng.choice([np.pi / 2, -np.pi / 2, 0.3, np.pi]))
    if not robot.lines[i].turns:
        size = 0.05
    return chains.with_zero(robot, i, size), (kind, name)


def compared(robot: str, kinds: list[str], seed: int, folder: Path) -> tuple[SidePair, list[tuple[str, str]]]:
    rng = np.random.default_rng([seed, sum(map(ord, robot))])
    original = chains.ROBOTS[robot]
    other = original
    truth = []
    for kind in kinds:
        other, change = changed(other, kind, rng)
        truth.append(change)
    formats = list(rng.permutation(chains.FORMATS))
    if "tool frame" in kinds:
        formats.remove("usda")
    first = chains.write(other, folder / "first", formats[0])
    second = chains.write(original, folder / "second", formats[1])
    return twin.compare(first, second).pairs[0], truth


def resolved(found: SidePair, truth: list[tuple[str, str]]) -> bool:
    """Return whether the changes are told, as the first explanation or as a tie, and no more than were made."""
    kinds = {item.kind for item in found.conventions}
    told = len(found.conventions)
    if "name" in kinds:  # one item for each joint
        told -= len(found.second.axes) - 1
    if not found.agrees or told > len(truth):
        return False
    if told < len(truth):
        return True  # fewer changes do the same
    explanations = [" ".join(f"{item.kind} {item.text}" for item in found.conventions)]
    explanations += [" ".join(texts) for texts in found.ties]
    return any(all(_tells(text, kind, joint) for kind, joint in truth) for text in explanations)


def _tells(text: str, kind: str, joint: str) -> bool:
    words = {
        "base frame": "base frame of",
        "tool frame": "'tool' of",
        "zero": f"zero of joint '{joint}'",
        "sign": f"joint '{joint}' turns the other way",
        "name": "is joint",
    }
    return words[kind] in text or (kind == "sign" and f"joint '{joint}' slides the other way" in text)


@pytest.mark.parametrize(("robot", "seed"), SINGLE)
def test_one_changed_convention_is_resolved(robot: str, seed: int, tmp_path: Path) -> None:
    found, truth = compared(robot, [KINDS[seed % len(KINDS)]], seed, tmp_path)
    assert found.differences == ()
    assert resolved(found, truth), (truth, [item.text for item in found.items], found.ties)
    assert found.properties is not None
    assert found.properties.verdict("limits") == "agree"


@pytest.mark.slow
def test_pairs_of_changes_are_resolved(tmp_path: Path) -> None:
    good = 0
    for robot, seed in DOUBLE:
        rng = np.random.default_rng(seed + 77)
        kinds = [str(kind) for kind in rng.choice(KINDS[:5], 2, replace=False)]
        found, truth = compared(robot, kinds, seed, tmp_path)
        assert found.differences == ()
        good += resolved(found, truth)
    assert good >= 0.9 * len(DOUBLE)
