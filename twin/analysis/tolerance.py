"""Tool error caused by manufacturing and encoder errors, compared with the requirement; see `error_propagation`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from twin.analysis.declared_limits import beyond_limits
from twin.analysis.error_propagation import (
    ACCURATE_SHARE,
    ErrorBudget,
    ErrorPropagation,
    Spread,
    as_dict,
    normal_length_quantile,
)
from twin.analysis.tightening import COST, Tightening, least_cost
from twin.api.protocol_plan import plan
from twin.api.robot import Robot
from twin.api.robot_loading import loaded
from twin.core import compute_device
from twin.core.compute_device import PROCESSOR
from twin.core.errors import TwinError
from twin.core.findings import Finding, Verdict, disagreement
from twin.core.json_types import JsonObject
from twin.core.progress import Progress, silent
from twin.core.quantity import um
from twin.core.result import Part, Result, TextTable
from twin.core.sampling import spread
from twin.core.spatial import Array
from twin.core.units import DEG, UM

_STATES_OF_PROTOCOL = 12
"""Number of states evaluated along a protocol."""


_ONE_PART_TO_BLAME = 0.2
"""Fraction of the variance from which one part is worth tightening alone."""


@dataclass(frozen=True)
class ToleranceBudget(Result):
    """Tool error in several states, compared with the requirement.

    Attributes:
        budgets: one budget for each state; Monte Carlo checks only the state with the largest error.
        required: maximum position error in m for the fraction `ACCURATE_SHARE` of the robots, or None.
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
        return max(self.budgets, key=lambda budget: budget.within[0])

    @property
    def factor(self) -> float | None:
        """Required position error divided by computed position error in the worst state; a value below 1 fails.

        Infinite if no error moves the tool, as those of rotary encoders in a robot that only slides.
        """
        if self.required is None:
            return None
        largest_error = self.worst.within[0]
        if largest_error == 0:
            return np.inf
        return self.required / largest_error

    @cached_property
    def tightening(self) -> Tightening | None:
        """What to tighten so that the worst state meets the requirement at least cost; None if it is met, or none."""
        if self.required is None or self.factor is None or self.factor >= 1:
            return None
        worst = self.worst
        names = tuple(dict.fromkeys(worst.labels))
        labels = np.array(worst.labels)
        # `least_cost` takes the state with the largest error for the present error
        states = sorted(self.budgets, key=lambda budget: -budget.within[0])
        covariances = np.zeros((len(states), len(names), 3, 3))
        for i, budget in enumerate(states):
            for k, name in enumerate(names):
                S = budget.sensitivity[:3, labels == name] * budget.sigma[labels == name]
                covariances[i, k] = S @ S.T
        return least_cost(names, covariances, self.required, normal_length_quantile)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on states beyond limits, and on a requirement that is not met."""
        if self.required is None or self.factor is None or self.factor >= 1:
            return self.beyond
        missed = disagreement(
            "tolerance.required",
            "tool",
            f"{100 * ACCURATE_SHARE:g}th-percentile position error",
            size=um(self.worst.within[0]),
            limit=um(self.required),
            suggestion=self._what_to_tighten(),
            when=self.worst.name,
            word="required",
        )
        return (*self.beyond, missed)

    def _what_to_tighten(self) -> str:
        """Return what to tighten as a sentence; "" if nothing can be told."""
        if self.tightening is None:
            return ""
        return self.tightening.sentence

    @property
    def verdict(self) -> Verdict:
        """The verdict: "unchecked" without a requirement, "agree" if it is met, else "disagree"."""
        if self.required is None:
            return "unchecked"
        return super().verdict

    @property
    def word(self) -> str:
        """Text that states whether the requirement is met."""
        met = {"agree": "The requirement is met", "disagree": "The requirement is not met"}
        return met.get(self.verdict, "There is no requirement")

    @property
    def exit_code(self) -> int:
        """Exit code: 1 if a requirement is not met, else 0."""
        if self.verdict == "disagree":
            return 1
        return 0

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
        required_um = None
        if self.required is not None:
            required_um = self.required / UM
        tightening = None
        if self.tightening is not None:
            tightening = asdict(self.tightening)
        return {
            "robot": self.robot,
            "errors": {
                "sigma_um": spread.shift / UM,
                "sigma_deg": spread.turn / DEG,
                "encoder_um": spread.slide / UM,
                "encoder_deg": spread.angle / DEG,
                "note": "normal, independent, for each axis of each joint frame; ASSUMED if not given",
            },
            "required_um": required_um,
            "requirement": self.requirement,
            "factor": self.factor,
            "tightening": tightening,
            "worst": self.worst.name,
            "device": self.device,
            "states": list(map(as_dict, self.budgets)),
        }

    def text(self) -> Iterator[Part]:
        """Yield a row for each state, the Monte Carlo check, and whether the requirement is met."""
        spread = self.spread
        yield f"{self.robot} · tool error caused by part and encoder errors\n"
        yield "  standard deviations (ASSUMED if not given):"
        place = f"joint frames {spread.shift / UM:g} µm and {spread.turn / DEG:g}° for each axis"
        yield f"  {place}; encoders {spread.slide / UM:g} µm and {spread.angle / DEG:g}°\n"
        head = ("state", "position, 95 %", "rotation, 95 %", "sigma x, y, z [µm]", "largest contributors")
        yield TextTable(head, list(map(_row, self.budgets)))
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
        tightening = self.tightening
        if tightening is None or self.factor is None or self.required is None:
            return
        share = self.worst.contributors[0][1]
        yield ""
        yield f"  what to tighten, so that every state keeps {self.required / UM:g} µm"
        yield ""
        rows = []
        spread = self.spread
        for name, factor in tightening.factors:
            if name.startswith("encoder "):
                is_angle = self.angular.get(name.removeprefix("encoder "), False)
                size = f"{factor * spread.slide / UM:.2g} µm"
                if is_angle:
                    size = f"{factor * spread.angle / DEG:.2g}°"
            else:
                size = f"{factor * spread.shift / UM:.2g} µm and {factor * spread.turn / DEG:.2g}°"
            rows.append((name, f"{100 * factor:.2g} %", size))
        yield TextTable(("joint or encoder", "of the present errors", "standard deviations"), rows)
        yield ""
        yield (
            f"  mean cost of a part: {tightening.cost:.3g} times the present one, instead of "
            f"{tightening.uniform_cost:.3g} times if all errors are reduced by the factor {1 / self.factor:.3g}"
        )
        yield f"  {COST}"
        if share < _ONE_PART_TO_BLAME:
            yield f"  no single part is to blame: the largest contributes {100 * share:.0f} % of the variance"


def _row(budget: ErrorBudget) -> tuple[str, ...]:
    """Return the cells of a state in the table of the text."""
    position, rotation = budget.within
    x, y, z = np.sqrt(np.diag(budget.covariance))[:3] / UM
    largest = []
    for name, share, _ in budget.contributors[:3]:
        largest.append(f"{name} {100 * share:.0f} %")
    return (
        budget.name,
        f"{position / UM:.4g} µm",
        f"{rotation / DEG:.3g}°",
        f"{x:.3g}, {y:.3g}, {z:.3g}",
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
        TwinError: a standard deviation, `required` or `samples` is invalid, or the protocol cannot be planned.

    Examples:
        >>> import twin
        >>> budget = twin.tolerance("sher", twin.Spread(shift=1e-5, turn=1e-5, slide=1e-6, angle=1e-5))
        >>> budget.verdict
        'disagree'
    """
    if required is not None and not (np.isfinite(required) and required > 0):
        raise TwinError(f"required = {required:g} m: give a finite position error above 0")
    if samples < 0:
        raise TwinError(f"samples = {samples}: give at least 1, or 0 to omit the Monte Carlo check")
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
        position_errors = [budget.within[0] for budget in budgets]
        worst = int(np.argmax(position_errors))
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
    return ToleranceBudget(
        robot.name,
        spread=spread,
        budgets=tuple(budgets),
        required=required,
        requirement=requirement,
        beyond=beyond,
        device=device,
        angular=angular,
    )


def _states(robot: Robot, protocol: str | None, progress: Progress) -> list[tuple[str, Array]]:
    """Return (name, q (n,)) of the states to evaluate: along the protocol, else the postures, else as drawn."""
    states = []
    if protocol:
        trajectory = plan(robot, protocol, progress)
        for k in spread(len(trajectory.t), _STATES_OF_PROTOCOL):
            states.append((f"t = {trajectory.t[k]:.2f} s", trajectory.q[k]))
        return states
    for name in robot.mechanism.postures:
        states.append((name, robot.mechanism.posture(name)))
    return states or [("as drawn", robot.loops.q)]
