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
from twin.proof.draws import RandomRange
from twin.proof.exact_mechanism import ExactMechanism
from twin.proof.values import Angle, Value

_POSE_LENGTH_SPREAD = 0.04
"""Distance in m to both sides of a seed within which lengths of a pose are drawn, if there are no forward equations."""

_POSE_ANGLE_SPREAD = 0.3
"""Angle in rad to both sides of a seed within which angles of a pose are drawn then."""

_PARAMETER_SPREAD = 0.05
"""Angle in rad to both sides of its published value within which a parameter is drawn."""

_WIDEST_SLIDE = 1.0
"""Distance in m to both sides of 0 within which a sliding joint without limits is drawn."""

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
        ranges: {random number: its range}.
        drawn_parameters: parameters with random values near the published ones.
        inexact_parameters: parameters without an exact form.
    """

    formula: Formula
    robot: Mechanism
    drawn_states: int
    formulas: bool
    parameters: dict[str, Value] = field(default_factory=dict)
    state: dict[str, Value] = field(default_factory=dict)
    ranges: dict[str, RandomRange] = field(default_factory=dict)
    drawn_parameters: list[str] = field(default_factory=list)
    inexact_parameters: list[str] = field(default_factory=list)

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
            if isinstance(value, Angle) and parameter.name in self.drawn_parameters:
                angles[parameter.name] = value
            exact = exact_number(float(parameter.value))
            if parameter.unit in ("mm", "m") and exact is not None and exact.decimal:
                lengths[parameter.name] = exact.decimal
        return ExactMechanism(self.robot, Drawing(self.count, angles, lengths, self.formulas))

    @cached_property
    def real_values(self) -> dict[str, Array]:
        """{random number: its real values (k,)}."""
        random_values = dict(self.state)
        for name in self.drawn_parameters:
            random_values[name] = self.parameters[name]
        return {name: values.real_of(value) for name, value in random_values.items()}

    def at(self, places: NDArray[np.integer]) -> ProofStates:
        """Return some of the states, given by their places (m,)."""
        parameters = _values_at(self.parameters, places)
        state = _values_at(self.state, places)
        return replace(self, parameters=parameters, state=state)


def _values_at(named_values: Mapping[str, Value], places: NDArray[np.integer]) -> dict[str, Value]:
    """Return {name: value} at some of the states, given by their places (m,)."""
    return {name: values.taken(value, places) for name, value in named_values.items()}


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
    centres: Mapping[str, Array] | None = None,
) -> ProofStates:
    """Return random states of a robot.

    Args:
        formula: the equations.
        robot: the mechanism of the CAD.
        states: number k of states.
        seed: of the random numbers.
        drawn: parameters, which are angles, that have random values; others have their published ones.
        formulas: whether parameters and state are variables of formulas.
        centres: {random number: values (k,) near which it is drawn}; None: anywhere in its range.
    """
    generator = np.random.default_rng(seed)
    proof_states = ProofStates(formula, robot, states, formulas)
    _set_parameters(proof_states, drawn, generator, centres)
    if formula.has("forward"):
        ranges = _joint_ranges(formula, robot)
    else:
        ranges = _coordinate_ranges(formula)
    proof_states.ranges.update(ranges)
    proof_states.state.update(draws.named(generator, ranges, states, formulas, centres))
    return proof_states


def _set_parameters(
    proof_states: ProofStates,
    drawn: Collection[str],
    generator: np.random.Generator,
    centres: Mapping[str, Array] | None,
) -> None:
    """Set the parameters to their published values, but those of `drawn`, which are angles, to random ones nearby."""
    states = proof_states.drawn_states
    for parameter in proof_states.formula.parameters:
        name = parameter.name
        value = float(parameter.value)
        if not math.isfinite(value):
            raise KinematicsError(
                f"formula '{proof_states.formula.name}': parameter '{name}' is {value}, not a finite number; nothing "
                "can be proved with it"
            )
        if parameter.unit not in ANGULAR:
            number = values.constant(value, states)
            if proof_states.formulas:
                # Without the constant, so that formulas keep the name of the parameter instead of its value.
                number = replace(number, form=forms.variable(name), constant=None)
            proof_states.parameters[name] = number
            if exact_number(value) is None:
                proof_states.inexact_parameters.append(name)
        elif name in drawn:
            low = value - _PARAMETER_SPREAD
            high = value + _PARAMETER_SPREAD
            proof_states.ranges[name] = RandomRange(True, low, high)
            centres_of_angle = None
            if centres is not None:
                centres_of_angle = centres[name]
            angle = draws.turn(generator, low, high, states, name, centres=centres_of_angle)
            proof_states.parameters[name] = replace(angle, published=value)
            proof_states.drawn_parameters.append(name)
        else:
            angle = draws.fixed_angle(value, states)
            proof_states.parameters[name] = angle
            if not (angle.cosine.known.all() and angle.sine.known.all()):
                proof_states.inexact_parameters.append(name)


def _joint_ranges(formula: Formula, robot: Mechanism) -> dict[str, RandomRange]:
    """Return the limits of the active joints of the equations."""
    ranges = {}
    for joint in formula.joints:
        widest = _WIDEST_SLIDE
        if joint.kind == "revolute":
            widest = math.pi
        low, high = robot.joint(joint.name).limits or (-widest, widest)
        # a locked joint has one value; the equations must hold for all of them
        if not low < high:
            low, high = -widest, widest
        # a joint with one limit is drawn as far from it as one without limits is drawn in all
        if not math.isfinite(high):
            high = widest
            if math.isfinite(low):
                high = low + 2 * widest
        if not math.isfinite(low):
            low = high - 2 * widest
        ranges[joint.name] = RandomRange(joint.kind == "revolute", low, high)
    return ranges


def _coordinate_ranges(formula: Formula) -> dict[str, RandomRange]:
    """Return ranges of the coordinates around the first seed."""
    ranges = {}
    for name, unit, value in zip(formula.coordinates.names, formula.coordinates.units, formula.seeds[0], strict=True):
        is_angle = unit == "rad"
        spread = _POSE_LENGTH_SPREAD
        if is_angle:
            spread = _POSE_ANGLE_SPREAD
        ranges[name] = RandomRange(is_angle, value - spread, value + spread)
    return ranges
