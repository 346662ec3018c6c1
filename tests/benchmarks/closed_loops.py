"""Closed-loop forward kinematics of SILS: warm along a motion, cold from the drawn state, and as a batch."""

from __future__ import annotations

import numpy as np
from loop_peers import Casadi, Drake, Judge, MuJoCo, Ours, Pinocchio, Scipy
from race import Contender, Effort, Table, installed, race

import twin
from twin.core import spatial

JUDGE = "largest gap of a loop in m, by Pinocchio's model of the mechanism (twin.reference)"
RIGHT = 1e-4
"""Metres or radians: a tool further from where it must be is in another assembly mode, or was not found."""
OPEN = 1e-5
"""Metres of gap above which a loop does not count as closed."""


class Task:
    """SILS, poses that it must find again, and the contenders."""

    def __init__(self, effort: Effort) -> None:
        self.robot = twin.load("sils")
        self.solver = self.robot.loops
        self.judge, self.ours = Judge(self.solver.mechanism), Ours(self.solver)
        self.home = self.ours.common(self.solver.forward_many(self.solver.q[None]).states[0])
        self.q, self.Ts = self.poses(effort.of(300, 60))
        a, b = (self.solver.mechanism.posture(n) for n in ("insertion", "inserted"))
        self.motion = (a + (0.5 - 0.5 * np.cos(np.linspace(0, np.pi, 1000)))[:, None] * (b - a))[450:551]
        self.states = self.solver.forward_many(self.motion)

    def poses(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return q (k, 6) and T_base_tool (k, 4, 4): up to 40 mm and 23 degrees an axis from as drawn, in reach."""
        rng = np.random.default_rng(0)
        moved = spatial.pose(
            spatial.exp_so3(rng.uniform(-0.4, 0.4, (count + count // 50, 3))),
            rng.uniform(-0.04, 0.04, (count + count // 50, 3)),
        )
        Ts = self.solver.forward(self.solver.q) @ moved
        q = self.robot.kinematics().inverse_many(Ts)
        good = np.flatnonzero(np.isfinite(q).all(axis=1))[:count]
        return q[good], Ts[good]

    def peers(self, table: Table) -> dict:
        """Return the solvers of others by name."""
        m = self.solver.mechanism
        made: dict = {"Pinocchio constraints, Gauss-Newton in Python": Pinocchio(self.judge)}
        made["MuJoCo efc_J, Gauss-Newton in Python"] = MuJoCo(m)
        made["CasADi fast_newton by buffer, our equations"] = Casadi(self.solver)
        made["scipy root(hybr), our equations"] = Scipy(self.solver)
        if installed(table, "pydrake", "Drake IK, SNOPT"):
            made["Drake IK, SNOPT as it comes"] = Drake(m)
            made["Drake IK, SNOPT at 1e-10"] = Drake(m, 1e-10)
        return made

    def judged(self, qs: np.ndarray, commons: list, Ts: np.ndarray) -> tuple[float, str]:
        """Return the worst gap of the answers on the right branch, and how many are there."""
        seen = [self.judge(q, c) for q, c in zip(qs, commons, strict=True)]
        right = [g < OPEN and np.abs(T - want).max() < RIGHT for (g, T), want in zip(seen, Ts, strict=True)]
        worst = max((g for (g, _), r in zip(seen, right, strict=True) if r), default=np.nan)
        return float(worst), f"{sum(right)} of {len(qs)}"


BARS = {
    "Drake IK, SNOPT as it comes": 30.0,
    "Pinocchio constraints, Gauss-Newton in Python": 4.0,
    "MuJoCo efc_J, Gauss-Newton in Python": 4.0,
}


def topic(effort: Effort) -> list[Table]:
    """Run the three races."""
    task = Task(effort)
    return [warm(task, effort), *cold(task, effort)]


def warm(task: Task, effort: Effort) -> Table:
    """Each of 100 samples of a 1 kHz motion from the one before."""
    table = Table("warm", "Closed-loop FK of SILS, one Python call a sample of a 1 kHz motion, from the sample before")
    table.judge, table.limit = JUDGE, 1e-11
    qs, states, solver = task.motion[1:], task.states.states, task.solver
    Ts = task.judge.model.run(task.motion).Ts_base_tool[1:]
    seeds = list(states[: len(qs)])

    def ours() -> None:
        for q, seed in zip(qs, seeds, strict=True):
            solver.forward(q, seed)

    found = solver.forward_many(qs, states[:-1])
    error, good = task.judged(qs, [task.ours.common(x) for x in found.states], Ts)
    contenders = [Contender("twin: robot.loops.forward(q, seed)", ours, len(qs), error, good)]
    for name, peer in task.peers(table).items():
        start = peer.start(task.motion[0], task.ours.common(states[0]))

        def walk(peer=peer, start=start) -> list:
            xs = [start]
            for q in qs:
                xs.append(peer.solve(q, xs[-1]))
            return xs[1:]

        error, good = task.judged(qs, [peer.common(x) for x in walk()], Ts)
        contenders.append(Contender(name, walk, len(qs), error, good, BARS.get(name)))
    table.notes.append("No compiler is needed for any row. Peers are called from Python; their C++ would be faster.")
    return race(table, contenders, effort)


def cold(task: Task, effort: Effort) -> list[Table]:
    """Poses that have nothing to do with one another, all from the drawn state: one by one, and as one batch."""
    single = Table("cold", "Closed-loop FK of SILS, one Python call a pose, from the drawn state")
    single.judge, single.limit = JUDGE, 1e-11
    solver, qs = task.solver, task.q
    states = solver.forward_many(qs).states
    error, good = task.judged(qs, [task.ours.common(x) for x in states], task.Ts)
    ours = lambda: [solver.forward(q) for q in qs]  # noqa: E731
    contenders = [Contender("twin: robot.loops.forward(q)", ours, len(qs), error, good)]
    peers = []
    for name, peer in task.peers(single).items():
        start = peer.start(solver.q, task.home)
        error, good = task.judged(qs, [peer.common(peer.solve(q, start)) for q in qs], task.Ts)
        few = qs[: effort.of(100, 30)]

        def solve(peer=peer, start=start, few=few) -> None:
            for q in few:
                peer.solve(q, start)

        peers.append(Contender(name, solve, len(few), error, good, BARS.get(name)))
    race(single, [*contenders, *peers], effort)

    count = effort.of(200_000, 20_000)
    many = Table("batch", f"Closed-loop FK of SILS, {count} poses at once, from the drawn state")
    many.judge, many.limit, many.missing = JUDGE, 1e-11, single.missing
    q, Ts = task.poses(count)
    found = solver.forward_many(q)
    off = np.abs(found.Ts_base_tool - Ts).reshape(len(q), -1).max(axis=1)
    some = np.linspace(0, len(q) - 1, 2000).astype(int)
    error, _ = task.judged(q[some], [task.ours.common(found.states[k]) for k in some], Ts[some])
    good = f"{int((off < RIGHT).sum())} of {len(q)}"
    batch = [Contender("twin: robot.loops.forward_many(qs)", lambda: solver.forward_many(q), len(q), error, good)]
    for c in peers:
        c.bar = 1000.0 if c.name.startswith("Pinocchio") else None
    race(many, [*batch, *peers], effort)
    many.notes.append(
        "The truth is the pose from which the closed-form inverse of the equations made q: the tool of every answer "
        f"is within {off.max():.1e} (m, and entries of the rotation) of it. Peers are called pose by pose."
    )
    return [single, many]
