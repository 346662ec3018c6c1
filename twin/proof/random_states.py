"""The random states at which claims are judged: joints or pose, parameters, and the mechanism with exact numbers.

Nothing here depends on what the equations compute; only their names, parameters and seeds are read.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.model.mechanism import Mechanism
from twin.proof import draws, values
from twin.proof import form as forms
from twin.proof.constants import exact_number
from twin.proof.drawing import Drawing
from twin.proof.mechanism import ExactMechanism
from twin.proof.values import Angle, Value

SPREAD_LENGTH = 0.04
"""Distance in m to both sides of a seed within which lengths of a pose are drawn, if there are no forward equations."""

SPREAD_ANGLE = 0.3
"""The same for angles, in rad."""

SPREAD_PARAMETER = 0.05
"""The same for a parameter that is an angle, around its published value."""

ANGULAR = ("deg", "rad")
"""Units of parameters that are angles."""


@dataclass(frozen=True)
class ProofStates:
    """Random states of a robot.

    Attributes:
        formula: the equations.
        robot: the mechanism of the CAD.
        drawn_states: number of states that were drawn; those without roots may have been left out since.
        formulas: whether parameters and state are variables of formulas.
        parameters: {parameter: its values}.
        state: {joint or coordinate: its values}.
        ranges: {random number: (whether it is an angle, low, high)}, in m and rad.
        drawn: parameters that are drawn.
        inexact: parameters without an exact form.
    """

    formula: Formula
    robot: Mechanism
    drawn_states: int
    formulas: bool
    parameters: dict[str, Value] = field(default_factory=dict)
    state: dict[str, Value] = field(default_factory=dict)
    ranges: dict[str, tuple[bool, float, float]] = field(default_factory=dict)
    drawn: list[str] = field(default_factory=list)
    inexact: list[str] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Number k of states."""
        return len(next(iter(self.state.values())).real)

    @cached_property
    def exact(self) -> ExactMechanism:
        """The mechanism with exact numbers, in which parameters of the equations are recognised."""
        angles = {}
        lengths = {}
        for parameter in self.formula.parameters:
            value = self.parameters[parameter.name]
            if isinstance(value, Angle) and parameter.name in self.drawn:
                angles[parameter.name] = value
            exact = exact_number(float(parameter.value))
            if parameter.unit in ("mm", "m") and exact is not None and exact.decimal:
                lengths[parameter.name] = exact.decimal
        return ExactMechanism(self.robot, Drawing(self.count, angles, lengths, self.formulas))

    @cached_property
    def real(self) -> dict[str, Array]:
        """{random number: its real values (k,)}."""
        reals = {name: values.real_of(value) for name, value in self.state.items()}
        for name in self.drawn:
            reals[name] = values.real_of(self.parameters[name])
        return reals

    def at(self, places: NDArray[np.integer]) -> ProofStates:
        """Return some of the states, given by their places (m,)."""
        parameters = {name: values.taken(value, places) for name, value in self.parameters.items()}
        state = {name: values.taken(value, places) for name, value in self.state.items()}
        return replace(self, parameters=parameters, state=state)


def angles(formula: Formula) -> list[str]:
    """Return the parameters that are angles."""
    return [parameter.name for parameter in formula.parameters if parameter.unit in ANGULAR]


def random_states(
    formula: Formula,
    robot: Mechanism,
    states: int,
    seed: int,
    drawn: Collection[str] = (),
    formulas: bool = False,
    near: Mapping[str, Array] | None = None,
) -> ProofStates:
    """Return random states of a robot.

    Args:
        formula: the equations.
        robot: the mechanism of the CAD.
        states: number k of states.
        seed: of the random numbers.
        drawn: parameters, which are angles, that have random values; others have their published ones.
        formulas: whether parameters and state are variables of formulas.
        near: {random number: values (k,) near which it is drawn}.
    """
    generator = np.random.default_rng(seed)
    made = ProofStates(formula, robot, states, formulas)
    _set_parameters(made, states, drawn, generator, near)
    ranges = _joint_ranges(formula, robot) if formula.has("forward") else _coordinate_ranges(formula)
    made.ranges.update(ranges)
    made.state.update(draws.named(generator, ranges, states, formulas, near))
    return made


def _set_parameters(
    made: ProofStates,
    states: int,
    drawn: Collection[str],
    generator: np.random.Generator,
    near: Mapping[str, Array] | None,
) -> None:
    """Set the parameters to their published values, but those of `drawn`, which are angles, to random ones nearby."""
    for parameter in made.formula.parameters:
        name = parameter.name
        value = float(parameter.value)
        if not math.isfinite(value):
            raise KinematicsError(
                f"formula '{made.formula.name}': parameter '{name}' is {value}, not a finite number; nothing can be "
                "proved with it"
            )
        if parameter.unit not in ANGULAR:
            number = values.constant(value, states)
            if made.formulas:
                number = replace(number, form=forms.variable(name), constant=None)
            made.parameters[name] = number
            if exact_number(value) is None:
                made.inexact.append(name)
        elif name in drawn:
            low = value - SPREAD_PARAMETER
            high = value + SPREAD_PARAMETER
            made.ranges[name] = (True, low, high)
            values_near = None if near is None else near[name]
            angle = draws.turn(generator, low, high, states, name, near=values_near)
            made.parameters[name] = replace(angle, published=value)
            made.drawn.append(name)
        else:
            angle = draws.fixed_angle(value, states)
            made.parameters[name] = angle
            if not (angle.cosine.known.all() and angle.sine.known.all()):
                made.inexact.append(name)


def _joint_ranges(formula: Formula, robot: Mechanism) -> dict[str, tuple[bool, float, float]]:
    """Return the limits of the active joints of the equations."""
    ranges = {}
    for joint in formula.joints:
        widest = math.pi if joint.kind == "revolute" else 1.0
        low, high = robot.joint(joint.name).limits or (-widest, widest)
        if not low < high:
            low, high = -widest, widest
        if not math.isfinite(low) or not math.isfinite(high):
            low = max(low, -widest)
            high = min(high, widest)
        ranges[joint.name] = (joint.kind == "revolute", low, high)
    return ranges


def _coordinate_ranges(formula: Formula) -> dict[str, tuple[bool, float, float]]:
    """Return ranges of the coordinates around the first seed."""
    ranges = {}
    for name, unit, value in zip(formula.coordinates.names, formula.coordinates.units, formula.seeds[0], strict=True):
        spread = SPREAD_ANGLE if unit == "rad" else SPREAD_LENGTH
        ranges[name] = (unit == "rad", value - spread, value + spread)
    return ranges
