"""What errors of manufacture and of encoders cost at the tool: to first order through the loops, and by chance.

Every joint has two frames, one on each body; each is off by a small shift and turn. The loops are closed again, in the
least-squares sense where they are overconstrained (pins of a planar loop that are no longer parallel: what cannot be
closed is shared, as clearances would). The derivative of that is linear algebra (implicit functions); a Monte Carlo run
of the whole, with compiled Newton steps, checks it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from twin.codegen import Kernel, Stage
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.kinematics.closed_loops import LoopSolver, linear
from twin.kinematics.closed_loops.equations import Equations
from twin.model.mechanism import Mechanism

_CHUNK = 8192
"""Samples of chance at once: a few hundred errors each."""

_NEWTON, _LAST = 12, 1e-10

SHARE = 0.95
"""Share of machines that must be within the requirement."""


@dataclass(frozen=True)
class Spread:
    """Standard deviations, each about each axis of each frame.

    Attributes:
        shift: of the position of a joint frame on its body, m. turn: of its direction, rad.
        slide, angle: of the encoders of sliding and turning active joints, m and rad.
    """

    shift: float
    turn: float
    slide: float
    angle: float


@dataclass(frozen=True)
class Budget:
    """What the errors cost in one state.

    Attributes:
        name: of the state. q: (n,) active joints.
        sensitivity: (6, errors) tool shift (m) and turn (rad), in base, per error.
        labels: (errors,) joint of each. sigma: (errors,) standard deviations.
        covariance: (6, 6) of the tool to first order.
        within: (2,) what `SHARE` of machines keep to, position in m and rotation in rad, to first order.
        sampled: (6, 6) covariance, and sampled_within: (2,) the same by Monte Carlo; None if it was not asked for.
        samples: how many.
    """

    name: str
    q: Array
    sensitivity: Array
    labels: tuple[str, ...]
    sigma: Array
    covariance: Array
    within: tuple[float, float]
    sampled: Array | None = None
    sampled_within: tuple[float, float] | None = None
    samples: int = 0

    @property
    def contributors(self) -> list[tuple[str, float, float]]:
        """Joints with their share of the variance of position and of rotation, the worst first."""
        effect = (self.sensitivity * self.sigma) ** 2
        whole = np.array([effect[:3].sum(), effect[3:].sum()])
        out = []
        for name in dict.fromkeys(self.labels):
            mine = effect[:, [k for k, x in enumerate(self.labels) if x == name]]
            share = np.array([mine[:3].sum(), mine[3:].sum()]) / np.maximum(whole, 1e-300)
            out.append((name, float(share[0]), float(share[1])))
        return sorted(out, key=lambda x: -x[1])

    @property
    def difference(self) -> float | None:
        """By how much the standard deviations of both ways differ at most, relative to the largest of their kind."""
        if self.sampled is None:
            return None
        a, b = (np.sqrt(np.diag(c)) for c in (self.covariance, self.sampled))
        scale = np.repeat([a[:3].max(), a[3:].max()], 3)
        return float((np.abs(a - b)[scale > 0] / scale[scale > 0]).max(initial=0.0))


class Tolerances:
    """The errors of one mechanism; `budget` for one state."""

    def __init__(self, mechanism: Mechanism, spread: Spread) -> None:
        """Write down the equations with their errors.

        Raises:
            TwinError: a spread is negative or all are zero.
            AssemblyError: as drawn the loops do not close.
        """
        parts = (spread.shift, spread.turn, spread.slide, spread.angle)
        if min(parts) < 0 or not max(parts) > 0 or not np.isfinite(parts).all():
            raise TwinError("tolerances must be finite and not negative, and one of them positive")
        self.mechanism, self.spread = mechanism, spread
        self.solver = LoopSolver(mechanism)
        self.equations = e = Equations(mechanism, with_errors=True)
        self.error = ca.vertcat(*e.errors.values()) if e.errors else ca.SX(0, 1)
        frames = [joint for joint, _ in e.errors for _ in range(6)]
        encoders = [j.name for j in mechanism.active]
        self.labels = (*frames, *(f"encoder {n}" for n in encoders))
        size = [spread.shift] * 3 + [spread.turn] * 3
        drives = [spread.angle if j.is_angle else spread.slide for j in mechanism.active]
        self.sigma = np.array([*size * len(e.errors), *drives])
        T = e.pose(mechanism.frame(mechanism.tool).body, mechanism.frame(mechanism.tool).T_body_frame, stepping=True)
        self._slopes = self._derivatives(T)

    def budget(self, name: str, q: Array, samples: int = 0, rng: np.random.Generator | None = None) -> Budget:
        """Return what the errors cost at active joints q (n,).

        Args:
            name: of the state.
            q: in m or rad.
            samples: of chance, to check; 0: none.
            rng: of them.

        Raises:
            AssemblyError: the loops cannot be closed at q.
        """
        found = self.solver.forward_many(np.asarray(q, float)[None])
        self.solver.forward(q)  # raises with words if it cannot
        state = found.states[:, 0]
        S = self._sensitivity(np.asarray(q, float), state)
        covariance = (S * self.sigma**2) @ S.T
        budget = Budget(name, np.asarray(q, float), S, self.labels, self.sigma, covariance, _within(covariance))
        if not samples:
            return budget
        twists = self._chance(np.asarray(q, float), state, samples, rng or np.random.default_rng(0))
        size = np.stack([np.linalg.norm(twists[:, :3], axis=1), np.linalg.norm(twists[:, 3:], axis=1)])
        far, turned = np.quantile(size, SHARE, axis=1)
        sampled: Array = twists.T @ twists / samples
        return Budget(
            name, budget.q, S, self.labels, self.sigma, covariance, budget.within, sampled, (far, turned), samples
        )

    def _derivatives(self, T: ca.SX) -> ca.Function:
        """Return slopes of residual and tool by steps of the unknowns, by errors and by active joints."""
        e = self.equations
        zero = [(self.error, 0), (e.steps, 0)]

        def at(x: ca.SX) -> ca.SX:
            for symbol, value in zero:
                x = ca.substitute(x, symbol, value)
            return ca.densify(x)

        R = at(T[:3, :3])

        def twist(by: ca.SX) -> ca.SX:
            rows = ca.jacobian(T[:3, 3], by)
            turns = []
            for k in range(by.numel()):
                W = ca.jtimes(T[:3, :3], by, ca.SX.eye(by.numel())[:, k])
                turns.append(W)
            spun = [at(W) @ R.T for W in turns]
            vee = [ca.vertcat(W[2, 1], W[0, 2], W[1, 0]) for W in spun]
            return ca.vertcat(at(rows), ca.horzcat(*vee) if vee else ca.SX(3, 0))

        by = (e.steps, self.error, e.q)
        residual = [at(e.jacobian), at(ca.jacobian(e.residual, self.error)), at(ca.jacobian(e.residual, e.q))]
        outs = [*residual, *(twist(x) for x in by)]
        return ca.Function("slopes", [e.q, e.states], [ca.densify(x) for x in outs], {"cse": True})

    def _sensitivity(self, q: Array, state: Array) -> Array:
        """Return the tool's twist (6, errors) in base per error: frames first, then encoders."""
        Jx, Je, Jq, Tx, Te, Tq = (x.full() for x in self._slopes(q, state))
        direct = np.hstack([Te, Tq])
        if not Jx.size:
            return direct
        return direct - Tx @ np.linalg.pinv(Jx, rcond=1e-9) @ np.hstack([Je, Jq])

    def _chance(self, q: Array, state: Array, samples: int, rng: np.random.Generator) -> Array:
        """Return the tool's shift and turn (samples, 6) in base for errors drawn at random."""
        kernel, T0 = self._kernel, self.solver.forward(q)
        out = np.zeros((samples, 6))
        frames = self.error.numel()
        for first in range(0, samples, _CHUNK):
            k = min(_CHUNK, samples - first)
            drawn = self.sigma[:, None] * rng.normal(size=(len(self.sigma), k))
            qs = q[:, None] + drawn[frames:]
            pose = kernel(drawn[:frames], qs, np.repeat(state[:, None], k, axis=1))[0].T.reshape(k, 3, 4)
            out[first : first + k, :3] = pose[:, :, 3] - T0[:3, 3]
            out[first : first + k, 3:] = spatial.log_so3(pose[:, :, :3] @ T0[:3, :3].T)
        return out

    @property
    def _kernel(self) -> Kernel:
        """The loops closed again for given errors: Gauss-Newton from the state without them."""
        e = self.equations
        names = [p.name for p in e.passive]
        seed = ca.SX.sym("seed", e.states.numel())
        parts, at = [], 0
        for p in e.passive:
            parts.append(seed[at : at + p.state.numel()])
            at += p.state.numel()
        stages = [Stage(ca.Function("split", [seed], parts), ("seed",), tuple(names))] if names else []
        arguments = [self.error, e.q, *[p.state for p in e.passive]]
        takes = ("e", "q", *names)
        if names and e.residual.numel():
            pattern = np.array(ca.DM(e.jacobian.sparsity(), 1).full(), bool)
            step = linear.least_squares(e.jacobian, -e.residual, pattern)
            size = ca.SX(0)
            for x in ca.vertsplit(step):
                size = ca.fmax(size, ca.fabs(x))
            new, at = {}, 0
            for p in e.passive:
                new[p.name] = p.stepped(step[at : at + p.step.numel()])
                at += p.step.numel()
            function = ca.Function("step", arguments, [*new.values(), size], {"cse": True})
            stages.append(Stage(function, takes, (*new, "error"), _NEWTON, _LAST))
        pose = ca.Function("pose", arguments, [ca.densify(ca.vec(e.T_base_tool[:3, :].T))], {"cse": True})
        stages.append(Stage(pose, takes, ("pose",)))
        return Kernel(stages, {"e": self.error.numel(), "q": e.q.numel(), "seed": e.states.numel()}, ["pose"])


def _within(covariance: Array) -> tuple[float, float]:
    """Return the lengths that `SHARE` of normal vectors keep to, of position and rotation."""
    draw = np.random.default_rng(0).normal(size=(200_000, 3))
    out = []
    for block in (covariance[:3, :3], covariance[3:, 3:]):
        values = np.maximum(np.linalg.eigvalsh(block), 0)
        out.append(float(np.sqrt(np.quantile(draw**2 @ values, SHARE))))
    return out[0], out[1]


def all_states(
    tolerances: Tolerances,
    states: list[tuple[str, Array]],
    samples: int,
    seed: int,
    progress: Callable[[str, float], None],
) -> list[Budget]:
    """Return the budget of each state; chance checks the worst of them alone, whose budget it replaces."""
    budgets = []
    for i, (name, q) in enumerate(states):
        progress(f"state {name}", i / (len(states) + 1))
        budgets.append(tolerances.budget(name, q))
    if samples:
        worst = int(np.argmax([b.within[0] for b in budgets]))
        progress(f"{samples} machines by chance", len(states) / (len(states) + 1))
        name, q = states[worst]
        budgets[worst] = tolerances.budget(name, q, samples, np.random.default_rng(seed))
    return budgets


def as_dict(budget: Budget) -> dict[str, Any]:
    """Return plain data in SI."""
    sd = np.sqrt(np.diag(budget.covariance))
    out: dict[str, Any] = {
        "state": budget.name,
        "q": budget.q.tolist(),
        "sigma_position": sd[:3].tolist(),
        "sigma_rotation": sd[3:].tolist(),
        "within_position": budget.within[0],
        "within_rotation": budget.within[1],
        "contributors": [{"what": n, "position": p, "rotation": r} for n, p, r in budget.contributors],
    }
    if budget.sampled is not None and budget.sampled_within is not None:
        sampled = np.sqrt(np.diag(budget.sampled))
        out["monte_carlo"] = {
            "samples": budget.samples,
            "sigma_position": sampled[:3].tolist(),
            "sigma_rotation": sampled[3:].tolist(),
            "within_position": budget.sampled_within[0],
            "within_rotation": budget.sampled_within[1],
            "difference": budget.difference,
        }
    return out
