"""Inverse kinematics of an arm with revolute joints alone, the PA-10: our closed form against two solvers.

EAIK and ssik derive the inverse of a serial arm from its axes, by subproblems. They know no loops, no slides and no
trocar, so of twin's robots the PA-10 is the only one that they take. The poses are those with the elbow up (joint 3 at
0): there, our inverse at swivel 0 and a six-axis arm with joint 3 locked have the same solutions.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from race import Contender, Effort, Fact, Table, clock, installed, race

import twin
from twin.core.spatial import Array

AXES = np.array([[0, 0, 1], [0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1]], float)
"""Axes of the joints at zero: the arm points straight up."""
LOCKED = 2
"""The joint that the six-axis arm has not."""
LOW = np.radians([-170, 5, 0, 5, -170, 5, -170])
HIGH = np.radians([170, 90, 0, 130, 170, 160, 170])
"""Joint values from which poses are drawn: elbow up, away from stretched arm and wrist."""
TOLERANCE = 1e-9
"""Largest error of a pose, m and 1, at which an answer counts."""


def offsets() -> Array:
    """Return the offsets (8, 3) in m: from base to joint 1, from each joint to the next, from joint 7 to the tip."""
    p = twin.load("pa10").formula.parameters
    length = {parameter.name: parameter.value for parameter in p}
    out = np.zeros((8, 3))
    out[2, 2] = length["RL3"]
    out[4, 2] = length["RL5"]
    out[7, 2] = length["RL7"] + length["RL8"]
    return out


def six_axes() -> tuple[Array, Array]:
    """Return (axes (6, 3), offsets (7, 3) in m) of the arm with joint 3 locked at 0."""
    p = offsets()
    axes = np.delete(AXES, LOCKED, axis=0)
    p[LOCKED] += p[LOCKED + 1]
    return axes, np.delete(p, LOCKED + 1, axis=0)


def topic(effort: Effort) -> list[Table]:
    """Run the race."""
    table = Table("pa10", "Inverse kinematics of the PA-10 (seven revolute joints), one pose a call")
    table.judge = "largest error of a pose of any answer, m and 1, by the forward equations"
    table.limit = TOLERANCE
    count = effort.of(200, 40)
    kin = twin.load("pa10").kinematics()
    q = np.random.default_rng(6).uniform(LOW, HIGH, (count, 7))
    Ts = kin.forward_many(q)

    def closed() -> int:
        for T in Ts:
            kin.inverse(T)
        return count

    found = kin.inverse_many(Ts)
    error = float(np.abs(kin.forward_many(found) - Ts).max())
    rows = [Contender("twin: closed form at one swivel, with its checks", closed, count, error, f"{count} of {count}")]
    if installed(table, "eaik", "EAIK"):
        rows.append(_peer("EAIK, joint 3 locked, all branches", *by_eaik(), Ts, kin))
    if installed(table, "ssik", "ssik"):
        rows.append(_peer("ssik, joint 3 locked, all branches", *by_ssik(6, None), Ts, kin))
        rows.append(_peer("ssik, joint 3 locked, one branch", *by_ssik(6, 1), Ts, kin))
        rows.append(_peer("ssik, seven joints, one branch", *by_ssik(7, 1), Ts, kin))
    many = np.tile(Ts, (effort.of(500, 100), 1, 1))
    table.facts.append(Fact("inverse_many, poses per second", _rate(kin.inverse_many, many)))
    if installed(table, "eaik", "EAIK, batch"):
        arm = eaik_arm()
        batch = many[:: effort.of(10, 10)]
        table.facts.append(Fact("EAIK IK_batched, poses per second", _rate(arm.IK_batched, batch)))
    table.notes.append(
        "twin returns one solution (elbow up) and checks the pose. Both others need only the axes of the arm, no "
        "equations, and return all branches (eight); ssik is called by the module that `ssik build` writes for it. "
        "They take arms with six or seven revolute joints: of twin's robots, this one."
    )
    return [race(table, rows, effort)]


def _rate(solve: Callable, Ts: Array) -> float:
    """Return the poses per second of a batch, the best of three."""
    solve(Ts)
    best = np.inf
    for _ in range(3):
        start = clock()
        solve(Ts)
        best = min(best, clock() - start)
    return len(Ts) / best


def _peer(
    name: str, solve: Callable[[Array], Any], read: Callable[[Any], list[Array]], Ts: Array, kin: Any
) -> Contender:
    """Return a contender; `solve` is what is timed, `read` returns the joint values (7,) of all its answers."""
    worst = 0.0
    answered = 0
    branches = 0
    for T in Ts:
        answers = read(solve(T))
        if not answers:
            continue
        branches += len(answers)
        errors = np.abs(kin.forward_many(np.array(answers)) - T).max(axis=(1, 2))
        answered += bool(errors.min() <= TOLERANCE)
        worst = max(worst, float(errors.max()))

    def run() -> int:
        for T in Ts:
            solve(T)
        return len(Ts)

    return Contender(name, run, len(Ts), worst, f"{answered} of {len(Ts)}, {branches / len(Ts):.1f} branches")


def eaik_arm() -> Any:
    """Return the six-axis arm of EAIK."""
    from eaik.IK_HP import HPRobot

    axes, p = six_axes()
    return HPRobot(axes, p)


def by_eaik() -> tuple[Callable[[Array], Any], Callable[[Any], list[Array]]]:
    """Return (EAIK's solver, function that reads its answers); approximations for poses out of reach are none."""

    def read(found: Any) -> list[Array]:
        answers = []
        for q, approximate in zip(np.atleast_2d(found.Q), np.atleast_1d(found.is_LS), strict=True):
            if not approximate:
                answers.append(np.insert(q, LOCKED, 0.0))
        return answers

    return eaik_arm().IK, read


def by_ssik(joints: int, most: int | None) -> tuple[Callable[[Array], Any], Callable[[Any], list[Array]]]:
    """Return (ssik's solver of the arm with 6 or 7 joints, for at most so many branches; what reads its answers)."""
    solver = _built(joints)

    def read(found: Any) -> list[Array]:
        answers = []
        for solution in found:
            answers.append(solution.q if joints == 7 else np.insert(solution.q, LOCKED, 0.0))
        return answers

    if most is None:
        return solver, read
    return partial(solver, max_solutions=most), read


@cache
def _built(joints: int) -> Callable[..., Any]:
    """Return the function `solve` of the module that `ssik build` writes for the arm with 6 or 7 joints."""
    axes, p = (AXES, offsets()) if joints == 7 else six_axes()
    name = f"pa10_{joints}"
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / f"{name}.urdf").write_text(urdf(name, axes, p))
        command = [Path(sys.executable).with_name("ssik"), "build", f"{name}.urdf", "--base", "link0", "--ee", "tip"]
        subprocess.run([*command, "--no-validate", "--out", f"{name}.py"], cwd=folder, check=True, capture_output=True)
        spec = importlib.util.spec_from_file_location(name, Path(folder) / f"{name}.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
        return module.solve


def urdf(name: str, axes: Array, p: Array) -> str:
    """Return a URDF of an arm with axes (n, 3) and offsets (n + 1, 3) in m, without shapes."""
    lines = [f'<robot name="{name}">', '<link name="link0"/>']
    for i, (axis, offset) in enumerate(zip(axes, p, strict=False)):
        lines += [
            f'<link name="link{i + 1}"/>',
            f'<joint name="joint{i + 1}" type="revolute">',
            f'<parent link="link{i}"/><child link="link{i + 1}"/>',
            f'<origin xyz="{_text(offset)}"/><axis xyz="{_text(axis)}"/>',
            f'<limit lower="{-np.pi!r}" upper="{np.pi!r}" effort="1" velocity="1"/>',
            "</joint>",
        ]
    lines += [
        '<link name="tip"/>',
        f'<joint name="tip" type="fixed"><parent link="link{len(axes)}"/><child link="tip"/>',
        f'<origin xyz="{_text(p[-1])}"/></joint>',
        "</robot>",
    ]
    return "\n".join(lines)


def _text(vector: Array) -> str:
    return " ".join(repr(float(x)) for x in vector)
