"""Tool error caused by manufacturing and encoder errors: first-order propagation through the loops, and Monte Carlo.

Every joint has two frames, one on each body; each frame has a small error in position and rotation. With these errors,
the loops are closed again. Overconstrained loops are closed by least squares, which distributes the gaps as clearances
would; an example is a planar loop with pins that are no longer parallel. The first-order result is the derivative of
the implicit equations. A Monte Carlo simulation with compiled Newton steps checks this result.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path

import casadi as ca
import numpy as np

from twin.analysis.declared_limits import beyond_limits
from twin.analysis.quantile import UpperQuantile
from twin.analysis.tightening import COST, Tightening, least_cost
from twin.api.judge import plan
from twin.api.robot import Progress, Robot, loaded, silent
from twin.codegen import Kernel, Stage
from twin.core import compute_device, spatial
from twin.core.compute_device import PROCESSOR
from twin.core.errors import TwinError
from twin.core.findings import Finding, Verdict, disagreement
from twin.core.json_types import JsonObject
from twin.core.quantity import um
from twin.core.result import Part, Result, TextTable
from twin.core.sampling import spread
from twin.core.spatial import Array
from twin.core.units import DEG, UM
from twin.kinematics.closed_loops import LoopSolver, linear
from twin.kinematics.closed_loops.equations import LoopEquations, stepped
from twin.model.mechanism import Mechanism

_CHUNK = 8192
"""Number of Monte Carlo samples in a batch; each sample has a few hundred errors."""

_NEWTON = 12
"""Maximum number of Newton steps."""

_LAST = 1e-10
"""Step size in m or rad below which the Newton iteration ends."""

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
class ErrorBudget:
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
        variances = (self.sensitivity * self.sigma) ** 2
        position = max(variances[:3].sum(), 1e-300)  # not 0, also where no error has an effect
        rotation = max(variances[3:].sum(), 1e-300)
        labels = np.array(self.labels)
        contributors = []
        for name in dict.fromkeys(self.labels):
            own = variances[:, labels == name]
            contributors.append((name, float(own[:3].sum() / position), float(own[3:].sum() / rotation)))
        contributors.sort(key=lambda contributor: -contributor[1])
        return contributors

    @property
    def difference(self) -> float | None:
        """Largest relative difference between the first-order and Monte Carlo standard deviations of the tool error.

        None without a Monte Carlo check.
        """
        if self.sampled is None:
            return None
        sigma = np.sqrt(np.diag(self.covariance))
        sampled_sigma = np.sqrt(np.diag(self.sampled))
        # relative to the largest component: the direction in which the tool hardly errs needs few digits
        scale = np.repeat([sigma[:3].max(), sigma[3:].max()], 3)
        known = scale > 0
        differences = np.abs(sigma - sampled_sigma)[known] / scale[known]
        return float(differences.max(initial=0.0))


class ErrorPropagation:
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
        self.mechanism = mechanism
        self.spread = spread
        self.solver = LoopSolver(mechanism)
        self.equations = LoopEquations(mechanism, with_errors=True)
        errors = self.equations.errors
        self.error = ca.vertcat(*errors.values()) if errors else ca.SX(0, 1)
        labels: list[str] = []
        sigma: list[float] = []
        for joint_name, _ in errors:
            labels += [joint_name] * 6
            sigma += [spread.shift] * 3
            sigma += [spread.turn] * 3
        for joint in mechanism.active:
            labels.append(f"encoder {joint.name}")
            sigma.append(spread.angle if joint.is_angle else spread.slide)
        self.labels = tuple(labels)
        self.sigma = np.array(sigma)
        tool = mechanism.frame(mechanism.tool)
        T = self.equations.pose(tool.body, tool.T_body_frame, stepping=True)
        self._slopes = self._derivatives(T)

    def budget(self, name: str, q: Array, samples: int = 0, rng: np.random.Generator | None = None) -> ErrorBudget:
        """Return the tool error at active joints q (n,) in m or rad.

        `samples` is the number of samples of the Monte Carlo check; 0: no check. They are computed in batches, but
        up to a tenth of the position errors and of the rotation errors are kept for their quantiles.

        Raises:
            AssemblyError: the loops cannot be closed at q.
        """
        q = np.asarray(q, float)
        solution = self.solver.forward_many(q[None])
        self.solver.forward(q)  # raises a clear error if the loops cannot be closed
        state = solution.states[0]
        S = self._sensitivity(q, state)
        covariance = (S * self.sigma**2) @ S.T
        budget = ErrorBudget(name, q, S, self.labels, self.sigma, covariance, _within(covariance))
        if not samples:
            return budget
        squares = np.zeros((6, 6))
        far = UpperQuantile(SHARE, samples)
        turned = UpperQuantile(SHARE, samples)
        for twists in self._sampled_twists(budget.q, state, samples, rng or np.random.default_rng(0)):
            squares += twists.T @ twists
            far.add(np.linalg.norm(twists[:, :3], axis=1))
            turned.add(np.linalg.norm(twists[:, 3:], axis=1))
        within = (far.value, turned.value)
        return replace(budget, sampled=squares / samples, sampled_within=within, samples=samples)

    def _derivatives(self, T: ca.SX) -> ca.Function:
        """Return derivatives of residual and tool pose with respect to unknowns, frame errors and active joints."""
        e = self.equations

        def without_errors(x: ca.SX) -> ca.SX:
            x = ca.substitute(x, self.error, 0)
            x = ca.substitute(x, e.steps, 0)
            return ca.densify(x)

        R = without_errors(T[:3, :3])

        def twist(by: ca.SX) -> ca.SX:
            shifts = without_errors(ca.jacobian(T[:3, 3], by))
            units = ca.SX.eye(by.numel())
            rotations = ca.SX(3, 0)
            for k in range(by.numel()):
                # dR R^T is the skew matrix of the rotation
                W = without_errors(ca.jtimes(T[:3, :3], by, units[:, k])) @ R.T
                rotations = ca.horzcat(rotations, ca.vertcat(W[2, 1], W[0, 2], W[1, 0]))
            return ca.vertcat(shifts, rotations)

        slopes = [
            without_errors(e.jacobian),
            without_errors(ca.jacobian(e.residual, self.error)),
            without_errors(ca.jacobian(e.residual, e.q)),
            twist(e.steps),
            twist(self.error),
            twist(e.q),
        ]
        dense = [ca.densify(slope) for slope in slopes]
        return ca.Function("slopes", [e.q, e.states], dense, {"cse": True})

    def _sensitivity(self, q: Array, state: Array) -> Array:
        """Return the tool twist (6, errors) in base per unit of each error: frame errors first, then encoder errors."""
        slopes = [slope.full() for slope in self._slopes(q, state)]
        # J: of the residual, T: of the tool; by loop unknowns x, frame errors e and active joints q
        Jx, Je, Jq, Tx, Te, Tq = slopes
        direct = np.hstack([Te, Tq])
        if not Jx.size:
            return direct
        # The pseudoinverse closes overconstrained loops by least squares.
        return direct - Tx @ np.linalg.pinv(Jx, rcond=1e-9) @ np.hstack([Je, Jq])

    def _sampled_twists(self, q: Array, state: Array, samples: int, rng: np.random.Generator) -> Iterator[Array]:
        """Yield the tool errors (k, 6) in the base frame for random errors: shift in m, then rotation in rad.

        There are `samples` of them in all, in batches of `_CHUNK`.
        """
        kernel = self._kernel
        T0 = self.solver.forward(q)
        frames = self.error.numel()
        for first in range(0, samples, _CHUNK):
            k = min(_CHUNK, samples - first)
            errors = self.sigma[:, None] * rng.normal(size=(len(self.sigma), k))
            qs = q[:, None] + errors[frames:]
            states = np.repeat(state[:, None], k, axis=1)
            (pose,) = kernel(errors[:frames], qs, states)
            pose = pose.T.reshape(k, 3, 4)
            shifts = pose[:, :, 3] - T0[:3, 3]
            rotations = spatial.log_so3(pose[:, :, :3] @ T0[:3, :3].T)
            yield np.hstack([shifts, rotations])

    @property
    def _kernel(self) -> Kernel:
        """Compiled function that closes the loops with given errors, by Gauss-Newton from the error-free state."""
        e = self.equations
        keys = [passive.key for passive in e.passive]
        states = [passive.state for passive in e.passive]
        arguments = [self.error, e.q, *states]
        argument_names = ("e", "q", *keys)
        stages = []
        if keys:
            stages.append(Stage(e.split(), ("seed",), tuple(keys)))
        if keys and e.residual.numel():
            pattern = np.array(ca.DM(e.jacobian.sparsity(), 1).full(), bool)
            step = linear.least_squares(e.jacobian, -e.residual, pattern)
            new = stepped(e.passive, step)
            newton = ca.Function("step", arguments, [*new.values(), linear.largest(step)], {"cse": True})
            stages.append(Stage(newton, argument_names, (*new, "error"), _NEWTON, _LAST))
        tool_rows = ca.densify(ca.vec(e.T_base_tool[:3, :].T))
        pose = ca.Function("pose", arguments, [tool_rows], {"cse": True})
        stages.append(Stage(pose, argument_names, ("pose",)))
        inputs = {"e": self.error.numel(), "q": e.q.numel(), "seed": e.states.numel()}
        return Kernel(stages, inputs, ["pose"])


def _within(covariance: Array) -> tuple[float, float]:
    """Return (position error in m, rotation error in rad): for each error, the quantile `SHARE` over all robots."""
    return _quantile(covariance[:3, :3]), _quantile(covariance[3:, 3:])


def _quantile(covariance: Array) -> float:
    """Return the quantile `SHARE` of the length of a normal vector with this covariance (3, 3), from fixed samples."""
    samples = np.random.default_rng(0).normal(size=(200_000, 3))
    # In the principal axes, the components are independent; rounding can make an eigenvalue of 0 negative.
    eigenvalues = np.maximum(np.linalg.eigvalsh(covariance), 0)
    squares = samples**2 @ eigenvalues
    return float(np.sqrt(np.quantile(squares, SHARE)))


def as_dict(budget: ErrorBudget) -> JsonObject:
    """Return a budget as plain data in SI units."""
    sigma = np.sqrt(np.diag(budget.covariance))
    contributors = []
    for name, position, rotation in budget.contributors:
        contributors.append({"what": name, "position": position, "rotation": rotation})
    data: JsonObject = {
        "state": budget.name,
        "q": budget.q.tolist(),
        "sigma_position": sigma[:3].tolist(),
        "sigma_rotation": sigma[3:].tolist(),
        "within_position": budget.within[0],
        "within_rotation": budget.within[1],
        "contributors": contributors,
    }
    if budget.sampled is not None and budget.sampled_within is not None:
        sampled_sigma = np.sqrt(np.diag(budget.sampled))
        data["monte_carlo"] = {
            "samples": budget.samples,
            "sigma_position": sampled_sigma[:3].tolist(),
            "sigma_rotation": sampled_sigma[3:].tolist(),
            "within_position": budget.sampled_within[0],
            "within_rotation": budget.sampled_within[1],
            "difference": budget.difference,
        }
    return data


@dataclass(frozen=True)
class ToleranceBudget(Result):
    """Tool error in several states, compared with the requirement.

    Attributes:
        budgets: one budget for each state; Monte Carlo checks only the state with the largest error.
        required: maximum position error in m for the fraction `SHARE` of the robots, or None.
        requirement: provenance and note of the requirement.
        beyond: findings on limits that the states exceed.
        device: what has computed the Monte Carlo check, see `ComputeDevice.name`.
        angular: whether the coordinate of an active joint is an angle, by name of the joint.
    """

    robot: str
    spread: Spread
    budgets: tuple[ErrorBudget, ...]
    required: float | None = None
    requirement: str = ""
    beyond: tuple[Finding, ...] = ()
    device: str = PROCESSOR
    angular: Mapping[str, bool] = field(default_factory=dict)

    kind = "tolerance"

    @property
    def worst(self) -> ErrorBudget:
        """Budget of the state with the largest position error."""
        return max(self.budgets, key=lambda b: b.within[0])

    @property
    def factor(self) -> float | None:
        """Required position error divided by computed position error in the worst state; a value below 1 fails."""
        return None if self.required is None else self.required / self.worst.within[0]

    @cached_property
    def tightening(self) -> Tightening | None:
        """What to tighten so that the worst state meets the requirement at least cost; None if it is met, or none."""
        if self.required is None or self.factor is None or self.factor >= 1:
            return None
        worst = self.worst
        names = tuple(dict.fromkeys(worst.labels))
        labels = np.array(worst.labels)
        states = sorted(self.budgets, key=lambda budget: -budget.within[0])
        covariances = np.zeros((len(states), len(names), 3, 3))
        for i, budget in enumerate(states):
            for k, name in enumerate(names):
                S = budget.sensitivity[:3, labels == name] * budget.sigma[labels == name]
                covariances[i, k] = S @ S.T
        return least_cost(names, covariances, self.required, _quantile)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on states beyond limits, and on a requirement that is not met."""
        if self.required is None or self.factor is None or self.factor >= 1:
            return self.beyond
        missed = disagreement(
            "tolerance.required",
            "tool",
            f"{100 * SHARE:g}th-percentile position error",
            um(self.worst.within[0]),
            um(self.required),
            self._what_to_tighten(),
            when=self.worst.name,
            word="required",
        )
        return (*self.beyond, missed)

    def _what_to_tighten(self) -> str:
        if self.tightening is None:
            return ""
        return self.tightening.sentence

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

    @property
    def key_figures(self) -> tuple[tuple[str, str, str], ...]:
        """Error of the worst state, what is required, and the cost of the cheapest tightening."""
        worst = self.worst
        figures = [("Tool error, 95 %", f"{worst.within[0] / UM:.4g} µm", f"in the state {worst.name}")]
        if self.required is not None:
            figures.append(("Required", f"{self.required / UM:g} µm", self.requirement.partition(":")[0]))
        name, share, _ = worst.contributors[0]
        figures.append(("Largest contributor", name, f"{100 * share:.0f} % of the variance"))
        if self.tightening is not None:
            parts = len(self.tightening.factors)
            figures.append(
                ("To tighten", f"{parts} of {len(worst.contributors)}", "joints and encoders, see the table")
            )
            remark = f"{self.tightening.uniform_cost:.3g} if all alike"
            figures.append(("Cost of a part", f"{self.tightening.cost:.3g} × now", remark))
        return tuple(figures)

    def content(self) -> JsonObject:
        """Return all budgets as plain data; keys of values that are not in SI units end with the unit."""
        spread = self.spread
        return {
            "robot": self.robot,
            "errors": {
                "sigma_um": spread.shift / UM,
                "sigma_deg": spread.turn / DEG,
                "encoder_um": spread.slide / UM,
                "encoder_deg": spread.angle / DEG,
                "note": "normal, independent, for each axis of each joint frame; ASSUMED if not given",
            },
            "required_um": None if self.required is None else self.required / UM,
            "requirement": self.requirement,
            "factor": self.factor,
            "tightening": None if self.tightening is None else asdict(self.tightening),
            "worst": self.worst.name,
            "device": self.device,
            "states": [as_dict(budget) for budget in self.budgets],
        }

    def text(self) -> Iterator[Part]:
        """Yield a row for each state, the Monte Carlo check, and whether the requirement is met."""
        spread = self.spread
        yield f"{self.robot} · tool error caused by part and encoder errors\n"
        yield "  standard deviations (ASSUMED if not given):"
        place = f"joint frames {spread.shift / UM:g} µm and {spread.turn / DEG:g}° for each axis"
        yield f"  {place}; encoders {spread.slide / UM:g} µm and {spread.angle / DEG:g}°\n"
        head = ("state", "position, 95 %", "rotation, 95 %", "sigma x, y, z [µm]", "largest contributors")
        rows = [_row(budget) for budget in self.budgets]
        yield TextTable(head, rows)
        yield ""
        for budget in self.budgets:
            if budget.sampled_within is not None and budget.difference is not None:
                yield (
                    f"  Monte Carlo, {budget.samples} robots in state '{budget.name}': 95 % of the robots have at most "
                    f"{budget.sampled_within[0] / UM:.4g} µm; the standard deviations differ by up to "
                    f"{100 * budget.difference:.2g} % from the first-order values above"
                )
        if self.device != PROCESSOR:
            yield f"  Monte Carlo computed by {self.device}"
        if self.required is not None and self.factor is not None:
            result = "met"
            if self.factor < 1:
                result = f"NOT met: {self._what_to_tighten()}"
            yield f"  required: {self.required / UM:g} µm, {result}"
            if self.requirement:
                yield f"    {self.requirement}"
            yield from self._tightening_text()
        if not self.beyond:
            yield "  limits of joints, motors and gaps: kept in all states; collisions are not checked"
        yield ""
        yield from self.beyond

    def _tightening_text(self) -> Iterator[Part]:
        """Yield what to tighten, by how much, and the cost; nothing if the requirement is met."""
        found = self.tightening
        if found is None or self.factor is None or self.required is None:
            return
        share = self.worst.contributors[0][1]
        yield ""
        yield f"  what to tighten, so that every state keeps {self.required / UM:g} µm"
        yield ""
        rows = []
        spread = self.spread
        for name, factor in found.factors:
            if name.startswith("encoder "):
                joint = self.angular.get(name.removeprefix("encoder "), False)
                size = f"{factor * spread.angle / DEG:.2g}°" if joint else f"{factor * spread.slide / UM:.2g} µm"
            else:
                size = f"{factor * spread.shift / UM:.2g} µm and {factor * spread.turn / DEG:.2g}°"
            rows.append((name, f"{100 * factor:.2g} %", size))
        yield TextTable(("joint or encoder", "of the present errors", "standard deviations"), rows)
        yield ""
        yield (
            f"  mean cost of a part: {found.cost:.3g} times the present one, instead of {found.uniform_cost:.3g} times "
            f"if all errors are reduced by the factor {1 / self.factor:.3g}"
        )
        yield f"  {COST}"
        if share < 0.2:
            yield f"  no single part is to blame: the largest contributes {100 * share:.0f} % of the variance"


def _row(budget: ErrorBudget) -> tuple[str, ...]:
    """Return the cells of a state in the table of the text."""
    position, rotation = budget.within
    sigma = [f"{x / UM:.3g}" for x in np.sqrt(np.diag(budget.covariance))[:3]]
    largest = []
    for name, share, _ in budget.contributors[:3]:
        largest.append(f"{name} {100 * share:.0f} %")
    return (
        budget.name,
        f"{position / UM:.4g} µm",
        f"{rotation / DEG:.3g}°",
        ", ".join(sigma),
        ", ".join(largest),
    )


def tolerance(
    robot: Robot | str | Path,
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
        robot: a robot with CAD, its name or its folder; or a stage or description file.
        spread: standard deviations of the errors.
        protocol: name of a protocol whose states are used; default: the robot's postures.
        required: maximum position error in m; default: the requirement of the description.
        samples: number of Monte Carlo samples (robots with random errors), which check the first-order result in the
            worst state; 0: no check.
        seed: seed of the random errors.
        progress: see `twin.api.Progress`.

    Raises:
        TwinError: a standard deviation is invalid, or the protocol cannot be planned.

    Examples:
        >>> import twin
        >>> budget = twin.tolerance("sher", twin.Spread(shift=1e-5, turn=1e-5, slide=1e-6, angle=1e-5))
        >>> budget.verdict
        'disagree'
    """
    robot = loaded(robot)
    if protocol or robot.mechanism.trocars:
        robot = robot.bound(robot.protocol(protocol))
    states = _states(robot, protocol, progress)
    progress("error equations", 0.0)
    tolerances = ErrorPropagation(robot.mechanism, spread)
    budgets = []
    for i, (name, q) in enumerate(states):
        progress(f"state {name}", i / (len(states) + 1))
        budgets.append(tolerances.budget(name, q))
    if samples:
        worst = int(np.argmax([budget.within[0] for budget in budgets]))
        progress(f"{samples} robots with random errors", len(states) / (len(states) + 1))
        name, q = states[worst]
        budgets[worst] = tolerances.budget(name, q, samples, np.random.default_rng(seed))
    requirement = ""
    if required is None and robot.files is not None:
        stated = robot.cad.description.requirement
        if stated:
            required = stated.tool_um * UM
            requirement = f"{stated.provenance}: {stated.note}"
    beyond = tuple(beyond_limits(robot, tolerances.solver, states))
    device = compute_device.current().name
    angular = {joint.name: joint.is_angle for joint in robot.mechanism.active}
    return ToleranceBudget(robot.name, spread, tuple(budgets), required, requirement, beyond, device, angular)


def _states(robot: Robot, protocol: str | None, progress: Progress) -> list[tuple[str, Array]]:
    """Return (name, q (n,)) of the states to evaluate: along the protocol, else the postures, else as drawn."""
    states = []
    if protocol:
        trajectory = plan(robot, protocol, progress)
        for k in spread(len(trajectory.t), _ALONG):
            states.append((f"t = {trajectory.t[k]:.2f} s", trajectory.q[k]))
        return states
    for name in robot.mechanism.postures:
        states.append((name, robot.mechanism.posture(name)))
    return states or [("as drawn", robot.loops.q)]
