"""What keeps a controller and a validator waiting: the solvers of a control tick, and the independent model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from race import Contender, Effort, Fact, Table, race

import twin
from twin.simulation.controllers.jacobian_step import pose_error, step
from twin.simulation.limits import JointLimits


def topic(effort: Effort) -> list[Table]:
    """Run the races."""
    return [reference(effort), *(control(effort, *which) for which in GOALS)]


def reference(effort: Effort) -> Table:
    """Race the independent model's run along a motion against itself, sample by sample."""
    table = Table("reference", "Independent model of SILS, per sample of a 1 kHz motion")
    robot = twin.load("sils")
    q0, q1 = (robot.mechanism.posture(n) for n in ("insertion", "inserted"))
    model = robot.reference()
    motion = q0 + (0.5 - 0.5 * np.cos(np.linspace(0, np.pi, effort.of(1000, 200))))[:, None] * (q1 - q0)

    def one_by_one() -> None:
        state = None
        for q in motion:
            state = model.solve(q, state)

    rows = [
        Contender("run: coarse walk, then all samples together", lambda: model.run(motion), len(motion)),
        Contender("solve: each sample from the one before", one_by_one, len(motion)),
    ]
    run, single = model.run(motion), model.solve(motion[-1])
    rows[0].error, table.limit, table.judge = float(run.gaps[..., 0].max()), 1e-11, "largest gap of a loop in m"
    off = float(np.abs(run.Ts_base_tool[-1] - single.T_base_tool).max())
    table.facts.append(Fact("the two differ by at most (m, 1)", off, bar=1e-9))
    return race(table, rows, effort)


HOME = "home"
GOALS = (
    ("near", "free, some um away", np.array([1e-6, -1e-6, 2e-6, 1e-5, 1e-6])),
    ("far", "rates at their bounds, some mm away", np.array([4e-3, -3e-3, 2e-3, 0.15, 5e-3])),
)


def control(effort: Effort, name: str, title: str, away: np.ndarray) -> Table:
    """Race the solvers of a control tick on SHER: Algorithm 2.1's SLSQP against damped least squares."""
    table = Table(f"tick_{name}", f"One control tick of SHER at 1 kHz: {title}")
    robot = twin.load("sher")
    kin, active = robot.kinematics(), robot.mechanism.active
    low, high = np.array([j.limits for j in active]).T
    limits = JointLimits(low, high, np.array([j.max_speed for j in active]))
    home = robot.mechanism.posture(HOME)
    T = kin.forward(home + away)

    def ticks(solver) -> Callable[[], None]:
        def run() -> None:
            for _ in range(10):
                step(kin, home, T, 1e-3, limits, solver)

        return run

    for solver in ("damped", "slsqp"):
        q, count, left = home, 0, 1.0
        while left > 1e-9 and count < effort.of(5000, 50):
            q, count = step(kin, q, T, 1e-3, limits, solver).q, count + 1  # type: ignore[arg-type]
            left = float(np.linalg.norm(pose_error(kin.forward(q), T)))
        table.notes.append(f"{solver}: {count} ticks to an error of {left:.1e} (m, rad)")
    rows = [
        Contender("damped least squares, bounded", ticks("damped"), 10),
        Contender("SLSQP (Algorithm 2.1)", ticks("slsqp"), 10),
    ]
    return race(table, rows, effort)
