"""Cost against size: poses, grid points, links and loops; exponents are fitted to the medians."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from race import Effort, Fact, Row, Table, show

import twin
from twin.codegen import Kernel, Stage
from twin.core import spatial
from twin.kinematics.closed_loops import LoopSolver
from twin.model.body import Body, Frame
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism

BAR = 1.05


def topic(effort: Effort) -> list[Table]:
    """Measure all four."""
    return [poses(effort), grid(effort), *mechanisms(effort)]


def measured(sizes: list[int], make: Callable[[int], Callable[[], Any]], effort: Effort) -> np.ndarray:
    """Return the median time in s at each size, sizes in turns."""
    runs = [make(n) for n in sizes]
    times: list[list[float]] = [[] for _ in sizes]
    for run in runs:
        run()
    for _ in range(effort.of(9, 3)):
        for k, run in enumerate(runs):
            start, done = time.perf_counter(), 0
            while done == 0 or time.perf_counter() - start < effort.turn / 5:
                run()
                done += 1
            times[k].append((time.perf_counter() - start) / done)
    return np.median(times, axis=1)


def exponent(sizes: list[int], seconds: np.ndarray) -> float:
    """Return p of seconds ~ size^p, by least squares of logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def rows(table: Table, what: str, sizes: list[int], seconds: np.ndarray, per: bool = True) -> None:
    """Add the times to a table, for an item or for all; their ratio is to the first size."""
    table.sizes = True
    each = seconds * 1e6 / np.array(sizes) if per else seconds * 1e6
    for n, us in zip(sizes, each, strict=True):
        table.rows.append(Row(f"{what}, {n}", us, 0, us / each[0], us / each[0], us / each[0], None, "", None, False))


def poses(effort: Effort) -> Table:
    """Closed-form IK and closed-loop FK of SILS, from a thousand to a million poses."""
    table = Table("poses", "Cost of a pose against the number of poses")
    robot = twin.load("sils")
    kin, solver, rng = robot.kinematics(), robot.loops, np.random.default_rng(0)
    most = effort.of(1_000_000, 100_000)
    moved = spatial.pose(spatial.exp_so3(rng.uniform(-0.3, 0.3, (most, 3))), rng.uniform(-0.04, 0.04, (most, 3)))
    Ts = solver.forward(solver.q) @ moved
    qs = kin.inverse_many(Ts)
    z = np.ascontiguousarray(Ts.reshape(-1, 16).T)
    kernel = Kernel([Stage(kin.program.inverse.function, ("z",), ("out",))], {"z": 16}, ["out"])
    sizes = [n for n in (1000, 10_000, 100_000, 1_000_000) if n <= most]

    def inverse(n: int) -> Callable[[], Any]:
        return lambda: kernel(z[:, :n])

    def forward(n: int) -> Callable[[], Any]:
        return lambda: solver.forward_many(qs[:n])

    for what, make in (("closed-form IK", inverse), ("closed-loop FK", forward)):
        seconds = measured(sizes, make, effort)
        rows(table, what, sizes, seconds)
        table.facts.append(Fact(f"exponent of poses, {what}", exponent(sizes, seconds), bar=BAR))
    show(table)
    return table


def grid(effort: Effort) -> Table:
    """The timing of a path, from 100 grid points to 10 000."""
    table = Table("grid", "Cost of timing a path against its grid points")
    from twin.planning.timing import time_path

    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(2, 6, 4))
    k = np.arange(1, 5)

    def path(s: np.ndarray, order: int = 0) -> np.ndarray:
        x = np.pi * s[:, None, None] * k + order * np.pi / 2
        return ((np.pi * k) ** order * (a * np.sin(x) + b * np.cos(x))).sum(axis=-1)

    sizes = [101, 1001, 10_001] if not effort.short else [101, 501, 2001]
    limits = np.full(6, 1.0), np.full(6, 5.0)
    seconds = measured(sizes, lambda n: lambda: time_path(path, *limits, dt=1e-2, knots=n, finest=n), effort)
    rows(table, "time_path", sizes, seconds)
    table.facts.append(Fact("exponent of grid points", exponent(sizes, seconds), bar=BAR))
    show(table)
    return table


def side_by_side(count: int) -> Mechanism:
    """Return `count` four-bars on one base, each with a crank of its own: loops that have nothing to do with others."""
    joints, rest = [], {}
    for k in range(count):
        rest |= _four_bar(joints, k, "base", np.array([0.0, 0.5 * k, 0.0]))
    return _mechanism(joints, rest, f"coupler{count - 1}")


def one_on_another(count: int) -> Mechanism:
    """Return `count` four-bars, each on the coupler of the one before: a chain of loops."""
    joints, rest, base = [], {}, "base"
    for k in range(count):
        rest |= _four_bar(joints, k, base, np.array([0.0, 0.1 if k else 0.0, 0.0]))
        base = f"coupler{k}"
    return _mechanism(joints, rest, base)


def _four_bar(joints: list[Joint], k: int, base: str, at: np.ndarray) -> dict:
    """Add crank 0.1, coupler 0.3, rocker 0.25 on a ground of 0.3 (m), upright crank; return where they are."""
    crank, coupler, rocker = (f"{n}{k}" for n in ("crank", "coupler", "rocker"))
    ground, at_base = np.array([0.3, 0, 0]), spatial.pose(p=at)
    top = np.array([0.0, 0.1, 0.0])
    gap = ground - top
    d, angle = np.hypot(gap[0], gap[1]), np.arctan2(gap[1], gap[0])
    inner = np.arccos((0.3**2 + d**2 - 0.25**2) / (2 * 0.3 * d))
    turn = angle + inner
    end = top + 0.3 * np.array([np.cos(turn), np.sin(turn), 0])
    lean = np.arctan2(end[1], end[0] - 0.3)

    def z(a: float) -> np.ndarray:
        return spatial.exp_so3(np.array([0, 0, a]))

    joints += [
        Joint(f"a{k}", "revolute", base, crank, at_base, active=True),
        Joint(f"b{k}", "revolute", crank, coupler, spatial.pose(p=[0.1, 0, 0])),
        Joint(f"c{k}", "revolute", base, rocker, at_base @ spatial.pose(p=ground)),
        Joint(f"d{k}", "revolute", coupler, rocker, spatial.pose(p=[0.3, 0, 0]), spatial.pose(p=[0.25, 0, 0])),
    ]
    return {
        (base, crank): at_base @ spatial.pose(z(np.pi / 2)),
        (base, coupler): at_base @ spatial.pose(z(turn), top),
        (base, rocker): at_base @ spatial.pose(z(lean), ground),
    }


def _mechanism(joints: list[Joint], relative: dict, tool: str) -> Mechanism:
    rest = {"base": np.eye(4)}
    for (base, body), T in relative.items():
        rest[body] = rest[base] @ T
    bodies = tuple(Body(n) for n in rest)
    frame = Frame("tool", tool, np.eye(4))
    return Mechanism("row", "base", bodies, tuple(joints), (frame,), (), rest)


def mechanisms(effort: Effort) -> list[Table]:
    """Closed-loop solvers of mechanisms that grow, four links and a loop at a time."""
    return [
        growing(effort, "loops_beside", "four-bars side by side", side_by_side),
        growing(effort, "loops_chained", "four-bars, each on the coupler of the one before", one_on_another),
    ]


def growing(effort: Effort, name: str, title: str, make: Callable[[int], Mechanism]) -> Table:
    """Solve and build mechanisms of more and more loops."""
    table = Table(name, f"Cost against loops: {title}")
    sizes = [1, 2, 4, 8] if effort.short else [1, 2, 4, 8, 16]
    solvers, made = {}, []
    for n in sizes:
        start = time.perf_counter()
        solvers[n] = LoopSolver(make(n))
        made.append(time.perf_counter() - start)
    rng = np.random.default_rng(0)
    count = effort.of(20_000, 8_000)
    qs = {n: s.q + rng.uniform(-0.2, 0.2, (count, n)) for n, s in solvers.items()}
    worst = max(float(solvers[n].forward_many(qs[n]).offset.max()) for n in sizes)
    seconds = measured(sizes, lambda n: lambda: solvers[n].forward_many(qs[n]), effort)
    rows(table, f"{count} states, loops", sizes, seconds / count, per=False)
    rows(table, "structure and equations, loops", sizes, np.array(made), per=False)
    table.facts += [
        Fact("exponent of loops, solving (from 2 on)", exponent(sizes[1:], seconds[1:])),
        Fact("exponent of loops, structure and equations (from 2 on)", exponent(sizes[1:], np.array(made[1:]))),
        Fact("largest gap of any loop", worst, "m", bar=1e-11),
        Fact("largest block of equations", max(len(b.rows) for b in solvers[sizes[-1]].blocks)),
    ]
    show(table)
    return table
