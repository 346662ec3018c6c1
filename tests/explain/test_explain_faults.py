"""Slips seeded in the sources of our robots and of strangers' robots: are they found and undone?

`TWIN_FAULTS=200` seeds two hundred of one token, `TWIN_PAIRS=60` sixty of two.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from itertools import cycle

import numpy as np
import pytest

from made import explain_rewrites as rewrites
from made import explain_seeds as seeds

FAULTS = int(os.environ.get("TWIN_FAULTS", "8"))
PAIRS = int(os.environ.get("TWIN_PAIRS", "2"))
REWRITES = int(os.environ.get("TWIN_REWRITES", "20"))
REWRITES_SEED = int(os.environ.get("TWIN_REWRITES_SEED", "8"))


@pytest.fixture(scope="module")
def strangers():
    return [seeds.stranger(path) for path in sorted(seeds.STRANGERS.glob("*.py"))]


@pytest.fixture(scope="module")
def cases(strangers):
    return [*seeds.built_ins(), *strangers]


def run(cases, count, tokens, budget, tmp_path, capsys, seed):
    """Seed faults, explain each, print a table; return the part that was undone."""
    from twin.core.errors import TwinError

    rng = np.random.default_rng(seed)
    results, seen = [], set()
    for case in cycle(cases):  # a formula in which nothing can be changed must not be the last one
        if len(results) == count:
            break
        folder = tmp_path / f"{tokens}_{len(seen)}"
        folder.mkdir(exist_ok=True)
        done = seeds.seeded(case, folder / "formula.py", rng, tokens)
        if done is None or (case.name, done) in seen:
            continue
        seen.add((case.name, done))
        try:
            faulty = case.load(folder / "formula.py")
        except TwinError:
            continue
        began = time.monotonic()
        why = seeds.outcome(case, faulty, folder, budget)
        if why in ("no fault", "no formula"):
            continue
        results.append((case.name, why if why in ("rank 1", "tie") else "missed"))
        if os.environ.get("TWIN_FAULTS_TIMES") or results[-1][1] == "missed":
            with capsys.disabled():
                print(f"\n{time.monotonic() - began:6.2f} s {case.name} {done}: {why}", end="", flush=True)
    table = Counter(results)
    with capsys.disabled():
        print(f"\n{'robot':8} {'rank 1':>7} {'tie':>5} {'missed':>7}")
        for case in cases:
            print(f"{case.name:8}", *(f"{table[case.name, k]:6}" for k in ("rank 1", "tie", "missed")))
    return sum(n for (_, k), n in table.items() if k != "missed") / len(results)


@pytest.mark.nightly
def test_seeded_faults_are_undone(cases, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(time, "monotonic", time.process_time)  # 3 s of a machine that does nothing else
    assert run(cases, FAULTS, 1, 3.0, tmp_path, capsys, 42) >= (0.98 if FAULTS >= 100 else 0.93)


@pytest.mark.nightly
def test_two_slips_at_once_are_undone(cases, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(time, "monotonic", time.process_time)  # 30 s of a machine that does nothing else
    assert run(cases, PAIRS, 2, 30.0, tmp_path, capsys, 43) >= (0.7 if PAIRS >= 30 else 0.5)


def check_rewrites(cases, count, tmp_path):
    from twin.validation.explain.row_deviations import Judge

    rng, done = np.random.default_rng(REWRITES_SEED), 0
    for case in cycle(cases):  # a function of calls only has nothing to rewrite: go on with the next robot
        text = rewrites.rewritten(case, rng)
        if text is None:
            continue
        if done == count:
            break
        done += 1
        path = tmp_path / f"same{done}.py"
        path.write_text(text, encoding="utf-8")
        judge = Judge(case.load(path), None, case.reference)
        assert judge.residuals
        assert judge.failing() == [], f"{case.name}, rewrite {done}"


def test_the_same_said_otherwise_is_no_fault(strangers, tmp_path):
    check_rewrites(strangers, 9, tmp_path)


@pytest.mark.slow
def test_no_rewrite_of_any_robot_is_a_fault(cases, tmp_path):
    check_rewrites(cases, REWRITES, tmp_path)


@pytest.mark.slow
def test_a_slip_of_a_stranger_is_undone(strangers, tmp_path):
    slips = (
        ("delta", "np.cos(phi)", "np.cos(r)"),  # what a line before it in the loop assigns
        ("five_bar", "2 * upper * rho", "2 * fore * rho"),
        ("five_bar", "x - d, y, m_1, m_2", "x - d, y, m_2, m_1"),
    )
    for i, (name, right, wrong) in enumerate(slips):
        case = next(c for c in strangers if c.name == name)
        text = case.path.read_text(encoding="utf-8")
        folder = tmp_path / str(i)
        folder.mkdir()
        assert text.count(right) == 1
        (folder / "formula.py").write_text(text.replace(right, wrong), encoding="utf-8")
        assert seeds.outcome(case, case.load(folder / "formula.py"), folder, 20.0) in ("rank 1", "tie")
