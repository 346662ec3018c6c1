"""Tool error caused by manufacturing and encoder errors: first-order propagation through the loops, and Monte Carlo.

Every joint has two frames, one on each body; each frame has a small error in position and rotation. With these errors,
the loops are closed again. Overconstrained loops are closed by least squares, which distributes the gaps as clearances
would; an example is a planar loop with pins that are no longer parallel. The first-order result is the derivative of
the implicit equations. A Monte Carlo simulation with compiled Newton steps checks this result.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from twin.analysis.limits import beyond_limits
from twin.api.judge import plan
from twin.api.robot import Progress, Robot, silent
from twin.codegen import Kernel, Stage
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.findings import Finding, Verdict, disagreement
from twin.core.json_types import JsonObject
from twin.core.quantity import um
from twin.core.result import Part, Result, Table
from twin.core.spatial import Array
from twin.core.units import DEG, UM
from twin.kinematics.closed_loops import LoopSolver, linear
from twin.kinematics.closed_loops.equations import Equations, stepped
from twin.model.mechanism import Mechanism

_CHUNK = 8192
"""Number of Monte Carlo samples in a batch; each sample has a few hundred errors."""

_NEWTON, _LAST = 12, 1e-10
"""Maximum number of Newton steps, and step size in m or rad below which the iteration ends."""

_ALONG = 12
"""Number of states evaluated along a protocol."""

SHARE = 0.95
"""Fraction of the built robots that must meet the accuracy requirement."""


@dataclass(frozen=True)
class Spread:
    """Standard deviations of the errors of each encoder, and of each joint frame along and about each axis.

    Attributes:
        shift: standard deviation of a joint frame's position on its body, in m.
        turn: standard deviation of a joint frame's rotation, in rad.
        slide, angle: standard deviations of the encoders of prismatic and revolute active joints, in m and rad.
    """

    shift: float
    turn: float
    slide: float
    angle: float


@dataclass(frozen=True)
class Budget:
    """Tool error of a mechanism in one state.

    Attributes:
        q: (n,) active joints in m or rad.
        sensitivity: (6, errors) tool shift (m) and rotation (rad), in base, per unit (m or rad) of each error.
        labels: (errors,) joint or encoder of each error.
        sigma: (errors,) standard deviations in m or rad.
        covariance: (6, 6) covariance of the tool error, to first order.
        within: (position error in m, rotation error in rad): for each error, the quantile `SHARE` over all robots, to
            first order.
        sampled, sampled_within: `covariance` and `within` by Monte Carlo; None if not requested.
        samples: number of Monte Carlo samples.
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
        """(joint or encoder, fraction of position variance, fraction of rotation variance) for each joint or encoder.

        The list is sorted by the fraction of position variance, largest first.
        """
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
        """Largest relative difference between the first-order and Monte Carlo standard deviations of the tool error.

        None without a Monte Carlo check.
        """
        if self.sampled is None:
            return None
        a, b = (np.sqrt(np.diag(c)) for c in (self.covariance, self.sampled))
        scale = np.repeat([a[:3].max(), a[3:].max()], 3)
        return float((np.abs(a - b)[scale > 0] / scale[scale > 0]).max(initial=0.0))


class Tolerances:
    """Error propagation in one mechanism; `budget` evaluates one state."""

    def __init__(self, mechanism: Mechanism, spread: Spread) -> None:
        """Set up the loop equations with frame errors.

        Raises:
            TwinError: a standard deviation is negative or not finite, or all are zero.
            AssemblyError: the loops do not close in the rest poses.
        """
        parts = (spread.shift, spread.turn, spread.slide, spread.angle)
        if min(parts) < 0 or not max(parts) > 0 or not np.isfinite(parts).all():
            raise TwinError("standard deviations must be finite and not negative, and at least one must be positive")
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
        """Return the tool error at active joints q (n,) in m or rad.

        `samples` is the number of samples of the Monte Carlo check; 0: no check.

        Raises:
            AssemblyError: the loops cannot be closed at q.
        """
        q = np.asarray(q, float)
        found = self.solver.forward_many(q[None])
        self.solver.forward(q)  # raises a clear error if the loops cannot be closed
        state = found.states[:, 0]
        S = self._sensitivity(q, state)
        covariance = (S * self.sigma**2) @ S.T
        budget = Budget(name, q, S, self.labels, self.sigma, covariance, _within(covariance))
        if not samples:
            return budget
        twists = self._chance(budget.q, state, samples, rng or np.random.default_rng(0))
        size = np.stack([np.linalg.norm(twists[:, :3], axis=1), np.linalg.norm(twists[:, 3:], axis=1)])
        far, turned = np.quantile(size, SHARE, axis=1)
        sampled: Array = twists.T @ twists / samples
        return replace(budget, sampled=sampled, sampled_within=(far, turned), samples=samples)

    def _derivatives(self, T: ca.SX) -> ca.Function:
        """Return derivatives of residual and tool pose with respect to unknowns, frame errors and active joints."""
        e = self.equations
        zero = [(self.error, 0), (e.steps, 0)]

        def at(x: ca.SX) -> ca.SX:
            for symbol, value in zero:
                x = ca.substitute(x, symbol, value)
            return ca.densify(x)

        R = at(T[:3, :3])

        def twist(by: ca.SX) -> ca.SX:
            rows = ca.jacobian(T[:3, 3], by)
            spun = [at(ca.jtimes(T[:3, :3], by, ca.SX.eye(by.numel())[:, k])) @ R.T for k in range(by.numel())]
            vee = [ca.vertcat(W[2, 1], W[0, 2], W[1, 0]) for W in spun]
            return ca.vertcat(at(rows), ca.horzcat(*vee) if vee else ca.SX(3, 0))

        by = (e.steps, self.error, e.q)
        residual = [at(e.jacobian), at(ca.jacobian(e.residual, self.error)), at(ca.jacobian(e.residual, e.q))]
        outs = [*residual, *(twist(x) for x in by)]
        return ca.Function("slopes", [e.q, e.states], [ca.densify(x) for x in outs], {"cse": True})

    def _sensitivity(self, q: Array, state: Array) -> Array:
        """Return the tool twist (6, errors) in base per unit of each error: frame errors first, then encoder errors."""
        Jx, Je, Jq, Tx, Te, Tq = (x.full() for x in self._slopes(q, state))
        direct = np.hstack([Te, Tq])
        if not Jx.size:
            return direct
        return direct - Tx @ np.linalg.pinv(Jx, rcond=1e-9) @ np.hstack([Je, Jq])

    def _chance(self, q: Array, state: Array, samples: int, rng: np.random.Generator) -> Array:
        """Return the tool error (samples, 6) in the base frame for random errors: shift in m, then rotation in rad."""
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
        """Compiled function that closes the loops with given errors, by Gauss-Newton from the error-free state."""
        e = self.equations
        keys = [p.key for p in e.passive]
        stages = [Stage(e.split(), ("seed",), tuple(keys))] if keys else []
        arguments = [self.error, e.q, *[p.state for p in e.passive]]
        takes = ("e", "q", *keys)
        if keys and e.residual.numel():
            pattern = np.array(ca.DM(e.jacobian.sparsity(), 1).full(), bool)
            step = linear.least_squares(e.jacobian, -e.residual, pattern)
            new = stepped(e.passive, step)
            function = ca.Function("step", arguments, [*new.values(), linear.largest(step)], {"cse": True})
            stages.append(Stage(function, takes, (*new, "error"), _NEWTON, _LAST))
        pose = ca.Function("pose", arguments, [ca.densify(ca.vec(e.T_base_tool[:3, :].T))], {"cse": True})
        stages.append(Stage(pose, takes, ("pose",)))
        return Kernel(stages, {"e": self.error.numel(), "q": e.q.numel(), "seed": e.states.numel()}, ["pose"])


def _within(covariance: Array) -> tuple[float, float]:
    """Return (position error in m, rotation error in rad): for each error, the quantile `SHARE` over all robots."""
    draw = np.random.default_rng(0).normal(size=(200_000, 3))
    out = []
    for block in (covariance[:3, :3], covariance[3:, 3:]):
        values = np.maximum(np.linalg.eigvalsh(block), 0)
        out.append(float(np.sqrt(np.quantile(draw**2 @ values, SHARE))))
    return out[0], out[1]


def as_dict(budget: Budget) -> JsonObject:
    """Return a budget as plain data in SI units."""
    sd = np.sqrt(np.diag(budget.covariance))
    out: JsonObject = {
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


@dataclass(frozen=True)
class ToleranceBudget(Result):
    """Tool error in several states, compared with the requirement.

    Attributes:
        budgets: one budget for each state; Monte Carlo checks only the state with the largest error.
        required: maximum position error in m for the fraction `SHARE` of the robots, or None.
        requirement: provenance and note of the requirement.
        beyond: findings on limits that the states exceed.
    """

    robot: str
    spread: Spread
    budgets: tuple[Budget, ...]
    required: float | None = None
    requirement: str = ""
    beyond: tuple[Finding, ...] = ()

    kind = "tolerance"

    @property
    def worst(self) -> Budget:
        """Budget of the state with the largest position error."""
        return max(self.budgets, key=lambda b: b.within[0])

    @property
    def factor(self) -> float | None:
        """Required position error divided by computed position error in the worst state; a value below 1 fails."""
        return None if self.required is None else self.required / self.worst.within[0]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on states beyond limits, and on a requirement that is not met."""
        if self.required is None or self.factor is None or self.factor >= 1:
            return self.beyond
        size, limit = um(self.worst.within[0]), um(self.required)
        what, way = (
            f"{100 * SHARE:g}th-percentile position error",
            f"reduce all errors by a factor of {1 / self.factor:.3g}",
        )
        name, word = self.worst.name, "required"
        missed = disagreement("tolerance.required", "tool", what, size, limit, way, when=name, word=word)
        return (*self.beyond, missed)

    @property
    def verdict(self) -> Verdict:
        """The verdict: "unchecked" without a requirement, "agree" if it is met, else "disagree"."""
        return "unchecked" if self.required is None else super().verdict

    @property
    def word(self) -> str:
        """Text that states whether the requirement is met."""
        met = {"agree": "The requirement is met", "disagree": "The requirement is not met"}
        return met.get(self.verdict, "There is no requirement")

    @property
    def exit_code(self) -> int:
        """Exit code: 1 if a requirement is not met, else 0."""
        return 1 if self.verdict == "disagree" else 0

    def content(self) -> JsonObject:
        """Return all budgets as plain data; keys of values that are not in SI units end with the unit."""
        s = self.spread
        return {
            "robot": self.robot,
            "errors": {
                "sigma_um": s.shift / UM,
                "sigma_deg": s.turn / DEG,
                "encoder_um": s.slide / UM,
                "encoder_deg": s.angle / DEG,
                "note": "normal, independent, for each axis of each joint frame; ASSUMED if not given",
            },
            "required_um": None if self.required is None else self.required / UM,
            "requirement": self.requirement,
            "factor": self.factor,
            "worst": self.worst.name,
            "states": [as_dict(b) for b in self.budgets],
        }

    def text(self) -> Iterator[Part]:
        """Yield a row for each state, the Monte Carlo check, and whether the requirement is met."""
        s = self.spread
        yield f"{self.robot} · tool error caused by part and encoder errors\n"
        yield "  standard deviations (ASSUMED if not given):"
        place = f"joint frames {s.shift / UM:g} µm and {s.turn / DEG:g}° for each axis"
        yield f"  {place}; encoders {s.slide / UM:g} µm and {s.angle / DEG:g}°\n"
        rows = []
        for b in self.budgets:
            sd = ", ".join(f"{x / UM:.3g}" for x in np.sqrt(np.diag(b.covariance))[:3])
            most = ", ".join(f"{what} {100 * p:.0f} %" for what, p, _ in b.contributors[:3])
            rows.append((b.name, f"{b.within[0] / UM:.4g} µm", f"{b.within[1] / DEG:.3g}°", sd, most))
        head = ("state", "position, 95 %", "rotation, 95 %", "sigma x, y, z [µm]", "largest contributors")
        yield Table(head, rows, fit=True)
        yield ""
        for b in self.budgets:
            if b.sampled_within is not None and b.difference is not None:
                yield (
                    f"  Monte Carlo, {b.samples} robots in state '{b.name}': 95 % of the robots have at most "
                    f"{b.sampled_within[0] / UM:.4g} µm; the standard deviations differ by up to "
                    f"{100 * b.difference:.2g} % from the first-order values above"
                )
        if self.required is not None and self.factor is not None:
            small = f", NOT met: reduce all errors by a factor of {1 / self.factor:.3g}"
            yield f"  required: {self.required / UM:g} µm{', met' if self.factor >= 1 else small}"
            if self.requirement:
                yield f"    {self.requirement}"
        if not self.beyond:
            yield "  limits of joints, motors and gaps: kept in all states; collisions are not checked"
        yield ""
        yield from self.beyond


def tolerance(
    robot: Robot,
    spread: Spread,
    protocol: str | None = None,
    *,
    required: float | None = None,
    samples: int = 0,
    seed: int = 0,
    progress: Progress = silent,
) -> ToleranceBudget:
    """Return the tool error caused by errors of parts and encoders.

    Args:
        robot: a robot with CAD, or loaded from a stage.
        spread: standard deviations of the errors.
        protocol: name of a protocol whose states are used; default: the robot's postures.
        required: maximum position error in m; default: the requirement of the description.
        samples: number of Monte Carlo samples (robots with random errors), which check the first-order result in the
            worst state; 0: no check.
        seed: seed of the random errors.
        progress: see `twin.api.Progress`.

    Raises:
        TwinError: a standard deviation is invalid, or the protocol cannot be planned.
    """
    if protocol or robot.mechanism.trocars:
        robot = robot.bound(robot.protocol(protocol))
    if protocol:
        trajectory = plan(robot, protocol, progress)
        at = np.unique(np.linspace(0, len(trajectory.t) - 1, _ALONG).astype(int))
        states = [(f"t = {trajectory.t[k]:.2f} s", trajectory.q[k]) for k in at]
    else:
        postures = robot.mechanism.postures
        states = [(n, robot.mechanism.posture(n)) for n in postures] or [("as drawn", robot.loops.q)]
    progress("error equations", 0.0)
    errors, budgets = Tolerances(robot.mechanism, spread), []
    for i, (name, q) in enumerate(states):
        progress(f"state {name}", i / (len(states) + 1))
        budgets.append(errors.budget(name, q))
    if samples:
        worst = int(np.argmax([b.within[0] for b in budgets]))
        progress(f"{samples} robots with random errors", len(states) / (len(states) + 1))
        budgets[worst] = errors.budget(*states[worst], samples, np.random.default_rng(seed))
    stated = robot.cad.description.requirement if robot.files is not None and required is None else None
    source = f"{stated.provenance}: {stated.note}" if stated else ""
    required = stated.tool_um * UM if stated else required
    beyond = tuple(beyond_limits(robot, errors.solver, states))
    return ToleranceBudget(robot.name, spread, tuple(budgets), required, source, beyond)
