"""Forward equations as sums of sines and cosines: the operations of the compiled formula on such sums."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from twin.core.errors import TwinError
from twin.formula.contract import Formula
from twin.proof import formula_side, trigonometric
from twin.proof.trigonometric import AngleSum, Operand, TrigonometricSum

_ROUNDED = 2.0**-50
"""Relative error of a constant of the equations."""

_ANGULAR = ("deg", "rad")

_NAMES = {getattr(ca, name): name.removeprefix("OP_").lower() for name in dir(ca) if name.startswith("OP_")}


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
            state.append(trigonometric.variable(place, *sliding[joint.name]))
    symbols = outputs.function.sx_in()
    found = dict(zip(outputs.names, outputs.function(*symbols), strict=True))
    parameters: list[Operand] = []
    place = len(formula.joints)
    results = ca.vertcat(ca.vec(found["pose"]), ca.vec(found.get("passive", ca.SX(0, 1))))
    used = ca.which_depends(results, symbols[1], 1) if formula.parameters else []
    for parameter, needed in zip(formula.parameters, used, strict=True):
        value = float(parameter.value)
        tolerance = tolerances.get(parameter.name, 0.0)
        if parameter.unit in _ANGULAR:
            parameters.append(AngleSum({}, value, abs(value) * _ROUNDED + tolerance))
        elif tolerance and needed:
            parameters.append(trigonometric.variable(place, value, tolerance))
            place += 1
        else:
            parameters.append(trigonometric.constant(value, abs(value) * _ROUNDED))
    function = ca.Function("pose", symbols, [found["pose"]])
    entries = [_as_sum(formula.name, entry) for entry in _evaluate(formula.name, function, [state, parameters])]
    joints = dict(zip([joint.name for joint in formula.joints], state, strict=True))
    if "passive" in found:
        for name, value in zip(formula.passive, ca.vertsplit(found["passive"]), strict=True):
            single = ca.Function(name, symbols, [value])
            try:
                joints[name] = _evaluate(formula.name, single, [state, parameters])[0]
            except TwinError:  # this joint may not be needed
                continue
    return trigonometric.stacked([entries[4 * i : 4 * i + 4] for i in range(4)]), joints


def _evaluate(name: str, function: ca.Function, inputs: list[list[Operand]]) -> list[Operand]:
    """Return the entries of the only output of a function."""
    results: dict[int, Operand] = {}
    outputs: list[Operand] = [trigonometric.constant(0.0)] * function.nnz_out(0)
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        targets = function.instruction_output(k)
        sources = function.instruction_input(k)
        if operation == ca.OP_CONST:
            value = function.instruction_constant(k)
            radius = 0.0 if value == round(value * 1024) / 1024 else abs(value) * _ROUNDED
            results[targets[0]] = trigonometric.constant(value, radius)
        elif operation == ca.OP_INPUT:
            results[targets[0]] = inputs[sources[0]][sources[1]]
        elif operation == ca.OP_OUTPUT:
            outputs[targets[1]] = results[sources[0]]
        else:
            operands = [results[source] for source in sources]
            results[targets[0]] = _applied(name, operation, operands)
    return outputs


def _applied(name: str, operation: int, operands: list[Operand]) -> Operand:
    """Return the result of an operation."""
    first = operands[0]
    last = operands[-1]
    if operation in (ca.OP_SIN, ca.OP_COS):
        angle = _as_angle(name, first)
        return trigonometric.wave(angle, operation == ca.OP_SIN)
    if operation == ca.OP_NEG:
        return _scaled(first, -1) if isinstance(first, AngleSum) else -first
    if operation in (ca.OP_ADD, ca.OP_SUB):
        if operation == ca.OP_SUB:
            last = _scaled(last, -1) if isinstance(last, AngleSum) else -last
        if isinstance(first, AngleSum) or isinstance(last, AngleSum):
            return _turned(_as_angle(name, first), _as_angle(name, last))
        return first + last
    if operation == ca.OP_TWICE:
        return _scaled(first, 2) if isinstance(first, AngleSum) else first + first
    if operation == ca.OP_MUL:
        for factor, other in ((first, last), (last, first)):
            if isinstance(other, AngleSum) and isinstance(factor, TrigonometricSum) and factor.number is not None:
                value, radius = factor.number
                if radius == 0 and value == round(value):
                    return _scaled(other, int(value))
        return _as_sum(name, first) * _as_sum(name, last)
    if operation == ca.OP_SQ:
        return _as_sum(name, first) * _as_sum(name, first)
    if operation == ca.OP_DIV:
        return _as_sum(name, first) * _reciprocal(name, _as_sum(name, last))
    if operation == ca.OP_INV:
        return _reciprocal(name, _as_sum(name, first))
    raise TwinError(
        f"{name}: the forward equations have a branch, a table, a root or another operation that is no sum of sines "
        f"and cosines of the joints ({_NAMES.get(operation, operation)}); they have no bound over all joints"
    )


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
    multiples = {place: factor * multiple for place, multiple in angle.multiples.items() if factor}
    radius = abs(factor) * angle.radius + abs(factor * angle.phase) * _ROUNDED
    return AngleSum(multiples, factor * angle.phase, radius)


def _turned(a: AngleSum, b: AngleSum) -> AngleSum:
    multiples = dict(a.multiples)
    for place, multiple in b.multiples.items():
        multiples[place] = multiples.get(place, 0) + multiple
    kept = {place: multiple for place, multiple in multiples.items() if multiple}
    phase = a.phase + b.phase
    return AngleSum(kept, phase, a.radius + b.radius + abs(phase) * _ROUNDED)


def _reciprocal(name: str, value: TrigonometricSum) -> TrigonometricSum:
    number = value.number
    if number is None or abs(number[0]) <= number[1]:
        raise TwinError(f"{name}: the forward equations divide by a value that depends on the joints, or that may be 0")
    centre, radius = number
    inverse = 1.0 / centre
    spread = radius / (abs(centre) * (abs(centre) - radius)) * (1 + 8 * _ROUNDED)
    return trigonometric.constant(inverse, spread + abs(inverse) * _ROUNDED)
