"""Propagate errors of joint frames and encoders to the tool: to first order through the loops, and by Monte Carlo.

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

from twin.analysis.quantile import UpperQuantile
from twin.codegen import Kernel, Stage
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.kinematics.closed_loops import LoopSolver, linear
from twin.kinematics.closed_loops.equations import LoopEquations, stepped
from twin.model.mechanism import Mechanism

_SAMPLES_PER_BATCH = 8192
"""Number of Monte Carlo samples in a batch; each sample has a few hundred errors."""


_NEWTON_STEPS = 12
"""Maximum number of Newton steps."""


_LAST_STEP = 1e-10
"""Step size in m or rad below which the Newton iteration ends."""


_QUANTILE_SAMPLES = 200_000
"""Number of samples of a quantile: its standard error is below 0.2 %."""

_REDUNDANT_BELOW = 1e-9
"""Singular values below this fraction of the largest are those of redundant loop equations."""

_SMALLEST_VARIANCE = 1e-300
"""Instead of 0 where no error has an effect, so that shares of it are 0."""

ACCURATE_SHARE = 0.95
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
        within: (position error in m, rotation error in rad): the quantiles `ACCURATE_SHARE` over all robots, to first
            order.
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
        position = max(variances[:3].sum(), _SMALLEST_VARIANCE)
        rotation = max(variances[3:].sum(), _SMALLEST_VARIANCE)
        labels = np.array(self.labels)
        contributors = []
        for name in dict.fromkeys(self.labels):
            part_variances = variances[:, labels == name]
            share_of_position = float(part_variances[:3].sum() / position)
            share_of_rotation = float(part_variances[3:].sum() / rotation)
            contributors.append((name, share_of_position, share_of_rotation))
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
        has_scale = scale > 0
        differences = np.abs(sigma - sampled_sigma)[has_scale] / scale[has_scale]
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
        self.error = ca.SX(0, 1)  # `vertcat` of nothing has no column
        if errors:
            self.error = ca.vertcat(*errors.values())
        labels: list[str] = []
        sigma: list[float] = []
        for joint_name, _ in errors:
            labels += [joint_name] * 6
            sigma += [spread.shift] * 3
            sigma += [spread.turn] * 3
        for joint in mechanism.active:
            labels.append(f"encoder {joint.name}")
            if joint.is_angle:
                sigma.append(spread.angle)
            else:
                sigma.append(spread.slide)
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
        budget = ErrorBudget(
            name,
            q=q,
            sensitivity=S,
            labels=self.labels,
            sigma=self.sigma,
            covariance=covariance,
            within=_within(covariance),
        )
        if not samples:
            return budget
        squares = np.zeros((6, 6))
        shift_quantile = UpperQuantile(ACCURATE_SHARE, samples)
        turn_quantile = UpperQuantile(ACCURATE_SHARE, samples)
        for twists in self._sampled_twists(budget.q, state, samples, rng or np.random.default_rng(0)):
            squares += twists.T @ twists
            shift_quantile.add(np.linalg.norm(twists[:, :3], axis=1))
            turn_quantile.add(np.linalg.norm(twists[:, 3:], axis=1))
        within = (shift_quantile.value, turn_quantile.value)
        return replace(budget, sampled=squares / samples, sampled_within=within, samples=samples)

    def _derivatives(self, T: ca.SX) -> ca.Function:
        """Return derivatives of residual and tool pose with respect to unknowns, frame errors and active joints."""
        equations = self.equations

        def without_errors(x: ca.SX) -> ca.SX:
            x = ca.substitute(x, self.error, 0)
            x = ca.substitute(x, equations.steps, 0)
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
            return ca.densify(ca.vertcat(shifts, rotations))

        # already dense: a sparse result would have fewer entries than `_sensitivity` reads
        slopes = [
            without_errors(equations.jacobian),
            without_errors(ca.jacobian(equations.residual, self.error)),
            without_errors(ca.jacobian(equations.residual, equations.q)),
            twist(equations.steps),
            twist(self.error),
            twist(equations.q),
        ]
        return ca.Function("slopes", [equations.q, equations.states], slopes, {"cse": True})

    def _sensitivity(self, q: Array, state: Array) -> Array:
        """Return the tool twist (6, errors) in base per unit of each error: frame errors first, then encoder errors."""
        # J: of the residual, T: of the tool; by loop unknowns x, frame errors e and active joints q
        Jx, Je, Jq, Tx, Te, Tq = map(ca.DM.full, self._slopes(q, state))
        direct = np.hstack([Te, Tq])
        if not Jx.size:
            return direct
        # The pseudoinverse closes overconstrained loops by least squares.
        return direct - Tx @ np.linalg.pinv(Jx, rcond=_REDUNDANT_BELOW) @ np.hstack([Je, Jq])

    def _sampled_twists(self, q: Array, state: Array, samples: int, rng: np.random.Generator) -> Iterator[Array]:
        """Yield the tool errors (k, 6) in the base frame for random errors: shift in m, then rotation in rad.

        There are `samples` of them in all, in batches of `_SAMPLES_PER_BATCH`.
        """
        kernel = self._kernel
        T0 = self.solver.forward(q)
        frames = self.error.numel()
        for first in range(0, samples, _SAMPLES_PER_BATCH):
            count = min(_SAMPLES_PER_BATCH, samples - first)
            errors = self.sigma[:, None] * rng.normal(size=(len(self.sigma), count))
            qs = q[:, None] + errors[frames:]
            states = np.repeat(state[:, None], count, axis=1)
            (pose,) = kernel(errors[:frames], qs, states)
            pose = pose.T.reshape(count, 3, 4)
            shifts = pose[:, :, 3] - T0[:3, 3]
            rotations = spatial.log_so3(pose[:, :, :3] @ T0[:3, :3].T)
            yield np.hstack([shifts, rotations])

    @property
    def _kernel(self) -> Kernel:
        """Compiled function that closes the loops with given errors, by Gauss-Newton from the error-free state."""
        equations = self.equations
        keys = []
        arguments = [self.error, equations.q]
        for passive in equations.passive:
            keys.append(passive.key)
            arguments.append(passive.state)
        argument_names = ("e", "q", *keys)
        stages = []
        if keys:
            stages.append(Stage(equations.split(), ("seed",), tuple(keys)))
        if keys and equations.residual.numel():
            pattern = np.array(ca.DM(equations.jacobian.sparsity(), 1).full(), bool)
            step = linear.solve_least_squares(equations.jacobian, -equations.residual, pattern)
            new = stepped(equations.passive, step)
            newton = ca.Function("step", arguments, [*new.values(), linear.largest(step)], {"cse": True})
            stages.append(
                Stage(newton, takes=argument_names, gives=(*new, "error"), repeat=_NEWTON_STEPS, tolerance=_LAST_STEP)
            )
        tool_rows = ca.densify(ca.vec(equations.T_base_tool[:3, :].T))
        pose = ca.Function("pose", arguments, [tool_rows], {"cse": True})
        stages.append(Stage(pose, argument_names, ("pose",)))
        inputs = {"e": self.error.numel(), "q": equations.q.numel(), "seed": equations.states.numel()}
        return Kernel(stages, inputs, ["pose"])


def _within(covariance: Array) -> tuple[float, float]:
    """Return (position error in m, rotation error in rad): the quantile `ACCURATE_SHARE` of each over all robots."""
    return normal_length_quantile(covariance[:3, :3]), normal_length_quantile(covariance[3:, 3:])


def normal_length_quantile(covariance: Array) -> float:
    """Return the quantile `ACCURATE_SHARE` of the length of a normal vector with covariance (3, 3): fixed samples."""
    samples = np.random.default_rng(0).normal(size=(_QUANTILE_SAMPLES, 3))
    # In the principal axes, the components are independent; rounding can make an eigenvalue of 0 negative.
    eigenvalues = np.maximum(np.linalg.eigvalsh(covariance), 0)
    squares = samples**2 @ eigenvalues
    return float(np.sqrt(np.quantile(squares, ACCURATE_SHARE)))


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
