"""Forward equations as sums of sines and cosines: the operations of the compiled formula on such sums."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from twin.core.errors import TwinError
from twin.formula.contract import Formula
from twin.proof import formula_side, trigonometric
from twin.proof.instructions import OPERATION_NAMES, instructions
from twin.proof.trigonometric import AngleSum, Operand, TrigonometricSum

_CONSTANT_ROUNDING = 2.0**-50
"""Relative error of a constant of the equations."""

_ANGULAR = ("deg", "rad")
"""Units of parameters that are angles."""

_EXACT_STEPS = 1024.0
"""Multiples of the reciprocal of this are taken as they are."""


def tool_pose(
    formula: Formula,
    variants: Mapping[str, str],
    sliding: Mapping[str, tuple[float, float]],
    tolerances: Mapping[str, float],
) -> tuple[TrigonometricSum, dict[str, Operand]]:
    """Return T_base_tool (4, 4) of the forward equations, and the values of their joints.

    The places of the active joints are their indices. A passive joint has a value if it is a sum of joint angles.

    Args:
        formula: the equations.
        variants: the chosen variant of each equation.
        sliding: {prismatic joint: (middle, half of its range) in m}.
        tolerances: {parameter: by how much it may differ from its value, in m or rad}.

    Raises:
        TwinError: the equations have no forward model, or an operation that is no sum of sines and cosines.
    """
    if not formula.has("forward"):
        raise TwinError(f"{formula.name}: the equations have no forward model, which is needed for a bound over joints")
    outputs = formula_side.from_joints(formula, variants)
    state: list[Operand] = []
    for place, joint in enumerate(formula.joints):
        if joint.kind == "revolute":
            state.append(AngleSum({place: 1}, 0.0, 0.0))
        else:
            middle, half = sliding[joint.name]
            state.append(trigonometric.variable(place, middle, half))
    symbols = outputs.function.sx_in()
    results = dict(zip(outputs.names, outputs.function(*symbols), strict=True))
    parameters = _parameters(formula, symbols[1], results, tolerances)
    pose = ca.Function("pose", symbols, [results["pose"]])
    rows: list[list[TrigonometricSum]] = [[], [], [], []]
    for entry_number, entry in enumerate(_evaluate(formula.name, pose, [state, parameters])):
        rows[entry_number // 4].append(_as_sum(formula.name, entry))
    joints: dict[str, Operand] = {}
    for joint, value in zip(formula.joints, state, strict=True):
        joints[joint.name] = value
    if "passive" in results:
        for name, value in zip(formula.passive, ca.vertsplit(results["passive"]), strict=True):
            function = ca.Function(name, symbols, [value])
            try:
                joints[name] = _evaluate(formula.name, function, [state, parameters])[0]
            except TwinError:  # this joint may not be needed
                continue
    return trigonometric.stacked(rows), joints


def _parameters(
    formula: Formula, symbols: ca.SX, results: Mapping[str, ca.SX], tolerances: Mapping[str, float]
) -> list[Operand]:
    """Return the parameters as operands; only one that pose or passive joints need is a variable of its own.

    Args:
        formula: the equations.
        symbols: symbols of the parameters, as a column.
        results: {output of the equations: its entries}.
        tolerances: {parameter: by how much it may differ from its value, in m or rad}.
    """
    if not formula.parameters:
        return []
    passive = results.get("passive", ca.SX(0, 1))
    needed = ca.which_depends(ca.vertcat(ca.vec(results["pose"]), ca.vec(passive)), symbols, 1)
    place = len(formula.joints)  # the variables after those of the joints
    operands: list[Operand] = []
    for parameter, is_needed in zip(formula.parameters, needed, strict=True):
        value = float(parameter.value)
        tolerance = tolerances.get(parameter.name, 0.0)
        if parameter.unit in _ANGULAR:
            operands.append(AngleSum({}, value, abs(value) * _CONSTANT_ROUNDING + tolerance))
        elif tolerance and is_needed:
            operands.append(trigonometric.variable(place, value, tolerance))
            place += 1
        else:
            operands.append(trigonometric.constant(value, abs(value) * _CONSTANT_ROUNDING))
    return operands


def _evaluate(name: str, function: ca.Function, inputs: list[list[Operand]]) -> list[Operand]:
    """Return the entries of the only output of a function; `name` is that of the formula, for messages."""
    memory: dict[int, Operand] = {}
    outputs: list[Operand] = [trigonometric.constant(0.0)] * function.nnz_out(0)
    for step in instructions(function):
        operands = [memory[place] for place in step.operands]
        if step.operation == ca.OP_OUTPUT:
            _, entry = step.port
            outputs[entry] = operands[0]
        elif step.operation == ca.OP_CONST:
            memory[step.target] = _constant(step.constant)
        elif step.operation == ca.OP_INPUT:
            column, entry = step.port
            memory[step.target] = inputs[column][entry]
        else:
            memory[step.target] = _applied(name, step.operation, operands)
    return outputs


def _constant(value: float) -> TrigonometricSum:
    """Return a constant of the equations; one that is no multiple of 1/1024 has been rounded."""
    radius = 0.0
    if value != round(value * _EXACT_STEPS) / _EXACT_STEPS:
        radius = abs(value) * _CONSTANT_ROUNDING
    return trigonometric.constant(value, radius)


def _applied(name: str, operation: int, operands: list[Operand]) -> Operand:
    """Return the result of an operation."""
    first = operands[0]
    last = operands[-1]
    if operation in (ca.OP_SIN, ca.OP_COS):
        angle = _as_angle(name, first)
        return trigonometric.wave(angle, operation == ca.OP_SIN)
    if operation == ca.OP_NEG:
        return _negative(first)
    if operation == ca.OP_ADD:
        return _total(name, first, last)
    if operation == ca.OP_SUB:
        return _total(name, first, _negative(last))
    if operation == ca.OP_TWICE:
        if isinstance(first, AngleSum):
            return _scaled(first, 2)
        return first + first
    if operation == ca.OP_MUL:
        return _product(name, first, last)
    if operation == ca.OP_SQ:
        return _as_sum(name, first) * _as_sum(name, first)
    if operation == ca.OP_DIV:
        return _as_sum(name, first) * _reciprocal(name, _as_sum(name, last))
    if operation == ca.OP_INV:
        return _reciprocal(name, _as_sum(name, first))
    raise TwinError(
        f"{name}: the forward equations have a branch, a table, a root or another operation that is no sum of sines "
        f"and cosines of the joints ({OPERATION_NAMES.get(operation, operation)}); they have no bound over all joints"
    )


def _negative(a: Operand) -> Operand:
    """Return -a."""
    if isinstance(a, AngleSum):
        return _scaled(a, -1)
    return -a


def _total(name: str, a: Operand, b: Operand) -> Operand:
    """Return a + b; a sum with an angle is an angle."""
    if isinstance(a, AngleSum) or isinstance(b, AngleSum):
        return _turned(_as_angle(name, a), _as_angle(name, b))
    return a + b


def _product(name: str, a: Operand, b: Operand) -> Operand:
    """Return a b; a whole multiple of an angle is an angle."""
    for factor, angle in ((a, b), (b, a)):
        if isinstance(angle, AngleSum) and isinstance(factor, TrigonometricSum) and factor.number is not None:
            value, radius = factor.number
            if radius == 0 and value == round(value):
                return _scaled(angle, int(value))
    return _as_sum(name, a) * _as_sum(name, b)


def _as_angle(name: str, operand: Operand) -> AngleSum:
    """Return a constant as an angle; an angle as it is."""
    if isinstance(operand, AngleSum):
        return operand
    if operand.number is None:
        raise TwinError(
            f"{name}: the forward equations take a sine of a length or of a sine; it has no bound over all joints"
        )
    return AngleSum({}, *operand.number)


def _as_sum(name: str, operand: Operand) -> TrigonometricSum:
    """Return a constant angle as a number; a sum as it is."""
    if isinstance(operand, TrigonometricSum):
        return operand
    if operand.multiples:
        raise TwinError(f"{name}: the forward equations use an angle as a number; it has no bound over all joints")
    return trigonometric.constant(operand.phase, operand.radius)


def _scaled(angle: AngleSum, factor: int) -> AngleSum:
    """Return a whole multiple of an angle."""
    multiples = {}
    if factor:  # no multiple is 0
        for place, multiple in angle.multiples.items():
            multiples[place] = factor * multiple
    radius = abs(factor) * angle.radius + abs(factor * angle.phase) * _CONSTANT_ROUNDING
    return AngleSum(multiples, factor * angle.phase, radius)


def _turned(a: AngleSum, b: AngleSum) -> AngleSum:
    """Return the sum of two angles."""
    multiples = dict(a.multiples)
    for place, multiple in b.multiples.items():
        multiples[place] = multiples.get(place, 0) + multiple
        if not multiples[place]:
            del multiples[place]
    phase = a.phase + b.phase
    return AngleSum(multiples, phase, a.radius + b.radius + abs(phase) * _CONSTANT_ROUNDING)


def _reciprocal(name: str, value: TrigonometricSum) -> TrigonometricSum:
    """Return 1 / value of a constant.

    Raises:
        TwinError: the value depends on the joints, or may be 0.
    """
    centre, radius = value.number or (0.0, 0.0)
    if abs(centre) <= radius:
        raise TwinError(f"{name}: the forward equations divide by a value that depends on the joints, or that may be 0")
    inverse = 1.0 / centre
    # |1/c - 1/x| = |x - c| / |c x|, at most with |x - c| = radius towards 0
    spread = radius / (abs(centre) * (abs(centre) - radius)) * (1 + 8 * _CONSTANT_ROUNDING)
    return trigonometric.constant(inverse, spread + abs(inverse) * _CONSTANT_ROUNDING)
