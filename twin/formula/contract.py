"""Contract of a formula file: plain functions of symbols, and the names, units and sources of the symbols.

A formula is a flow of named symbols: each equation computes symbols from earlier symbols. The flow starts with the
parameters and the pose coordinates (or the joints, for a forward formula). Every equation is a Python function. Its
argument names are its input symbols, and it returns its output symbols in order. All other entries of `Formula` only
name symbols of the flow. Files in `twin/robots/` and a user's `formula.py` follow the same contract: both define a
module-level `FORMULA = Formula(...)`.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from twin.core.errors import KinematicsError
from twin.core.provenance import Parameter
from twin.formula.closed_form import ClosedForm
from twin.formula.scalar import Value

Stage = Literal["inverse", "forward", "helper"]
"""Stage of an equation: the direction in which it is used.

inverse: from the pose to the joints. forward: from the joints to the pose. helper: the equation computes quantities
that the published equations do not name (angles, margins, measures), and is evaluated after all other equations.
"""

POSE_SYMBOL = "T_base_tool"
"""Symbol of the pose (4, 4). A forward flow computes this symbol, or all coordinates."""

SymbolFunction = Callable[..., Value]
"""A function of symbols, which are the names of its arguments.

It returns a CasADi SX, or a tuple of SX in the order of the outputs.
"""


@dataclass(frozen=True)
class Equation:
    """One published equation, or one helper, in all its variants.

    An output that is also an argument is implicit (q1 = ... q2 - q1 ...). Rows (assignments) with implicit outputs are
    written as printed; the compiler solves these rows, and raises an error if they are not linear.

    Attributes:
        name: identifier, "eq1".
        title: inputs and outputs as text, "ball centres -> carriages".
        source: document and equation number.
        stage: see `Stage`.
        outputs: symbols that the function returns, in order.
        variants: functions of the variants (readings) of the equation, by name ("printed", "corrected", ...).
        reasons: difference of each variant from the printed rows, and the reason, by name of the variant.
        default: name of the default variant.
    """

    name: str
    title: str
    source: str
    stage: Stage
    outputs: tuple[str, ...]
    variants: Mapping[str, SymbolFunction]
    reasons: Mapping[str, str] = field(default_factory=dict)
    default: str = "corrected"


@dataclass(frozen=True)
class Coordinates:
    """Pose coordinates of the published equations.

    Attributes:
        names: symbols, in the order of the paper.
        units: "m" or "rad" for each symbol.
        to_pose: function from the coordinates (in order) to the pose SX (4, 4).
        from_pose: function from the pose SX (4, 4) to the tuple of coordinates. If there are fewer than six
            coordinates, they cannot describe every pose; for other poses, `to_pose` returns a different pose.

    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    to_pose: SymbolFunction
    from_pose: SymbolFunction


@dataclass(frozen=True)
class ActiveJoint:
    """An active joint; its name is also the symbol of its coordinate, which is in m or rad."""

    name: str
    kind: Literal["prismatic", "revolute"]


@dataclass(frozen=True)
class Measure:
    """A dimensionless number that is 0 at a singularity.

    Attributes:
        name: identifier in reports.
        symbol: symbol of the measure in the flow.
        kind: "type1" (joints move while the tool is at rest) or "type2" (the tool moves while the joints are at rest).
        alarm: absolute value below which an alarm is raised; dimensionless.
        note: text on the effect of the singularity and on the source of the alarm value.
    """

    name: str
    symbol: str
    kind: Literal["type1", "type2"]
    alarm: float
    note: str


@dataclass(frozen=True)
class Aspect:
    """A symbol whose sign distinguishes assemblies; `preferred` is the sign (+1 or -1) in the preferred assembly."""

    symbol: str
    preferred: int
    note: str


@dataclass(frozen=True)
class PointSearch:
    """A published optimisation whose unknowns are points of the arm, not joints: the shaft is given by tip and trocar.

    The unknowns are symbols (3,) of inverse equations, in m in the base frame. Once they are known, the remaining
    inverse equations give the joints. `SymbolFunction` below may name the unknowns, `tip`, `trocar` and the parameters.

    Attributes:
        source: document, and what it leaves open.
        unknowns: symbols of the points, in order; the last point is on the axis of the shaft.
        tip, trocar: symbols (3,) of the given points.
        axis: direction of the shaft in the tool frame, towards the tip; the tip is the origin of the tool frame.
        residual: function that returns the rows to be brought to zero, in m.
        between: function that is positive, in m, if the trocar is between the arm and the tip. The rows alone also hold
            if the arm is beyond the tip.
        redundant: function that returns (row in m, sign): the row is zero and the sign positive where the redundant
            joint is as in the inverse equations. It is used for whole poses; `residual` alone leaves this joint free.
        places: function of joints and parameters that returns the unknowns at given joints, for starting states.
    """

    source: str
    unknowns: tuple[str, ...]
    tip: str
    trocar: str
    axis: tuple[float, float, float]
    residual: SymbolFunction
    between: SymbolFunction
    redundant: SymbolFunction
    places: SymbolFunction


@dataclass(frozen=True)
class Formula:
    """The equations of one robot.

    Attributes:
        name, title, source: identifier, one-line title, and source document.
        parameters: numbers with provenance; each name is a symbol.
        joints: active joints, in the order of q.
        coordinates: pose coordinates of the published equations.
        equations: the equations in the order of evaluation, helpers last.
        characteristic_length: function of the parameters that returns a length in m; a rotation by 1 rad counts as a
            translation by this length.
        points: symbols of the named points, by name: one symbol (3,) or three scalar symbols for each point. The
            coordinates are in m, in the base frame.
        passive: symbols of the passive joints, in rad or m; zero and sign of each joint are those of the CAD
            description.
        reach: symbol of each reach margin in m, by name of the margin (>= 0: within reach, < 0: beyond). Checks of the
            joint range exclude no state because its margin is NaN.
        measures: numbers that are 0 at singularities.
        aspects: signs that distinguish assemblies.
        branches: function of (q, parameters, variants) that returns the poses (4, 4) of all assemblies; or None.
        seeds: starting values for solvers in SI: coordinates, or joints for a formula without inverse equations.
        motion: published equations of motion of some joints; or None.
        point_search: published optimisation for tip and trocar whose unknowns are points; or None.
        first_fault: function of a pose and the parameters. It returns a text that names the first line of the file
            with a result of NaN or infinity; "" if there is no such line. None: the file is not traced.
    """

    name: str
    title: str
    source: str
    parameters: tuple[Parameter, ...]
    joints: tuple[ActiveJoint, ...]
    coordinates: Coordinates
    equations: tuple[Equation, ...]
    characteristic_length: SymbolFunction
    points: Mapping[str, str | tuple[str, str, str]] = field(default_factory=dict)
    passive: tuple[str, ...] = ()
    reach: Mapping[str, str] = field(default_factory=dict)
    measures: tuple[Measure, ...] = ()
    aspects: tuple[Aspect, ...] = ()
    branches: Callable[[np.ndarray, Mapping[str, float], Mapping[str, str]], list[np.ndarray]] | None = None
    seeds: Sequence[Sequence[float]] = ()
    motion: ClosedForm | None = None
    point_search: PointSearch | None = None
    first_fault: Callable[[np.ndarray, Mapping[str, float]], str] | None = None

    def has(self, stage: Stage) -> bool:
        """Return whether the formula has an equation of a stage: "inverse", "forward" or "helper"."""
        return any(equation.stage == stage for equation in self.equations)

    @property
    def scalars(self) -> dict[str, dict[str, str]]:
        """Symbols of the scalars by kind ("passive", "reach", "measure", "aspect") and name, in order."""
        symbols_of_measures = {}
        for measure in self.measures:
            symbols_of_measures[measure.name] = measure.symbol
        # an aspect has no name of its own: its symbol stands for both
        symbols_of_aspects = [aspect.symbol for aspect in self.aspects]
        return {
            "passive": dict(zip(self.passive, self.passive, strict=True)),
            "reach": dict(self.reach),
            "measure": symbols_of_measures,
            "aspect": dict(zip(symbols_of_aspects, symbols_of_aspects, strict=True)),
        }


_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
"""Pattern of a symbol."""

_JOINT_NAME = re.compile(r"[a-z][a-z0-9_]*")
"""Pattern of a joint's name, which is also a symbol."""


def check_formula(formula: object) -> None:
    """Check a formula as far as possible without evaluating its equations.

    Raises:
        KinematicsError: for the first fault; the message states the fault and the requirement.
    """
    if not isinstance(formula, Formula):
        raise KinematicsError(f"FORMULA must be a twin.kinematics.Formula, not {type(formula).__name__}.")

    def fail(text: str) -> None:
        raise KinematicsError(f"formula '{formula.name}': {text}")

    if not formula.joints:
        fail("the formula has no active joint; give at least one ActiveJoint.")
    _unique(fail, "joint", [joint.name for joint in formula.joints])
    for joint in formula.joints:
        if not _JOINT_NAME.fullmatch(joint.name):
            fail(f"joint name '{joint.name}' is not an identifier [a-z][a-z0-9_]*.")
        if joint.kind not in ("prismatic", "revolute"):
            fail(f"joint '{joint.name}' is '{joint.kind}'; a joint is prismatic or revolute.")
    _unique(fail, "parameter", [parameter.name for parameter in formula.parameters])
    for parameter in formula.parameters:
        value = parameter.value
        if not isinstance(value, int | float) or not math.isfinite(value):
            fail(f"parameter '{parameter.name}' is {value}; the value must be a finite number in SI units.")
        if not parameter.note:
            fail(f"parameter '{parameter.name}' has no note; state the source of the value, or why it is assumed.")
    _check_coordinates(formula, fail)
    _check_equations(formula, fail)
    _check_point_search(formula, fail)
    for aspect in formula.aspects:
        if aspect.preferred not in (-1, 1):
            fail(f"aspect '{aspect.symbol}': preferred is {aspect.preferred}, but must be +1 or -1.")
    _unique(fail, "measure", [measure.name for measure in formula.measures])
    for measure in formula.measures:
        if not measure.alarm >= 0:  # also true for NaN
            fail(f"measure '{measure.name}': alarm {measure.alarm} must not be negative.")
    # a seed has coordinates or, for a formula without inverse equations, joints
    seed_length = len(formula.joints)
    if formula.has("inverse"):
        seed_length = len(formula.coordinates.names)
    for i, seed in enumerate(formula.seeds):
        numbers = np.asarray(seed, float)
        if len(seed) != seed_length or not np.all(np.isfinite(numbers)):
            fail(f"seed {i} must have {seed_length} finite numbers, found {list(seed)}.")


def arguments(function: SymbolFunction) -> tuple[list[str], list[str]]:
    """Return (names of the required arguments, names of the optional arguments) of a function of symbols."""
    required = []
    optional = []
    for parameter in inspect.signature(function).parameters.values():
        if parameter.default is inspect.Parameter.empty:
            required.append(parameter.name)
        else:
            optional.append(parameter.name)
    return required, optional


def unread(formula: Formula, variants_in_use: Mapping[str, str]) -> list[str]:
    """Return the parameters that no equation uses in the chosen variants."""
    # the length scale of the formula may be the only reader of a length
    functions = [formula.characteristic_length]
    for equation in formula.equations:
        variant = variants_in_use.get(equation.name, equation.default)
        functions.append(equation.variants[variant])
    used: set[str] = set()
    for function in functions:
        required, optional = arguments(function)
        used.update(required, optional)
    unread_names = []
    for parameter in formula.parameters:
        if parameter.name not in used:
            unread_names.append(parameter.name)
    return unread_names


def _check_coordinates(formula: Formula, fail: Callable[[str], None]) -> None:
    """Call `fail` if the pose coordinates have two equal names, or units other than "m" and "rad"."""
    names = formula.coordinates.names
    units = formula.coordinates.units
    _unique(fail, "coordinate", names)
    if len(units) != len(names) or set(units) - {"m", "rad"}:
        fail(f"coordinates {list(names)} need a unit each, 'm' or 'rad'; found {list(units)}.")


def _check_equations(formula: Formula, fail: Callable[[str], None]) -> None:
    """Call `fail` for the first fault of an equation: its stage, outputs, variants or reasons."""
    if not (formula.has("inverse") or formula.has("forward")):
        fail("the formula has no inverse and no forward equation; write at least one.")
    _unique(fail, "equation", [equation.name for equation in formula.equations])
    for equation in formula.equations:
        if equation.stage not in ("inverse", "forward", "helper"):
            fail(f"equation '{equation.name}': stage '{equation.stage}' is not one of inverse, forward, helper.")
        if not equation.outputs:
            fail(f"equation '{equation.name}' has no outputs.")
        for output in equation.outputs:
            if not _IDENTIFIER.fullmatch(output):
                fail(f"equation '{equation.name}': output '{output}' is not an identifier.")
        if equation.default not in equation.variants:
            existing = sorted(equation.variants)
            fail(f"equation '{equation.name}': default variant '{equation.default}' is not one of {existing}.")
        for variant, function in equation.variants.items():
            if not callable(function):
                fail(f"equation '{equation.name}', variant '{variant}' is not a function.")
            if len(equation.variants) > 1 and not equation.reasons.get(variant):
                fail(f"equation '{equation.name}', variant '{variant}' has no reason; state the change and its reason.")


def _check_point_search(formula: Formula, fail: Callable[[str], None]) -> None:
    """Call `fail` if the unknown points of a search are not computed by the inverse equations."""
    search = formula.point_search
    if search is None:
        return
    if not formula.has("forward"):
        fail("point_search needs a forward equation.")
    outputs: set[str] = set()
    for equation in formula.equations:
        if equation.stage == "inverse":
            outputs.update(equation.outputs)
    for name in search.unknowns:
        if name not in outputs:
            computed = ", ".join(sorted(outputs))
            fail(f"point_search: no inverse equation gives its unknown '{name}'; they give {computed}.")


def _unique(fail: Callable[[str], None], kind: str, names: Iterable[str]) -> None:
    """Call `fail` if two of the names are equal; `kind` is what they name, "joint" or "equation"."""
    first_number: dict[str, int] = {}
    names = list(names)
    for i, name in enumerate(names, 1):  # from 1, as authors count
        if name in first_number:
            count = len(set(names))
            numbers = f"number {first_number[name]} and number {i}"
            fail(
                f"two {kind} entries are named '{name}', {numbers}: {len(names)} entries have "
                f"{count} names. Give each entry a different name."
            )
        first_number[name] = i
