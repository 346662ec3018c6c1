"""The equations' side of a proof: functions of the joints or of the pose, in the chosen variants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from twin.core.errors import KinematicsError
from twin.formula import equation_values, symbolic
from twin.formula.contract import POSE_SYMBOL, Formula
from twin.formula.scalar import Value


@dataclass(frozen=True)
class Outputs:
    """A function of the equations, and what its outputs are.

    Attributes:
        function: a function of the state and of the parameters, both as columns.
        state: names of the entries of the state.
        names: names of the outputs: "pose" (16,), "joints", "passive", "reach", "again" (16,), and "point <name>" (3,);
            if they were asked for, "measures" and "aspects" as well.
    """

    function: ca.Function
    state: tuple[str, ...]
    names: tuple[str, ...]


def from_joints(formula: Formula, variants: Mapping[str, str], measures: bool = False) -> Outputs:
    """Return pose, passive joints and reach as functions of the joints; the formula has forward equations.

    With `measures`, measures of singularity and aspects, of which nothing is claimed, are outputs too.
    """
    parameters = _parameters(formula)
    names = tuple(joint.name for joint in formula.joints)
    state = {name: ca.SX.sym(name) for name in names}
    symbols = equation_values.run(formula, variants, {**parameters, **state}, "forward")
    T = _pose(formula, symbols)
    symbols = {**equation_values.from_pose(formula, T), **symbols, POSE_SYMBOL: T}
    symbols = equation_values.run(formula, variants, symbols, "inverse")
    outputs = {"pose": symbolic.flat(T), **_of_helpers(formula, variants, symbols, measures)}
    return _function(formula, state, parameters, outputs)


def from_pose(formula: Formula, variants: Mapping[str, str], coordinates: bool, measures: bool = False) -> Outputs:
    """Return joints, passive joints, points and the pose again as functions of the pose.

    The formula has inverse equations. The state is the pose (16,), row by row, or the coordinates of the equations.
    For `measures` see `from_joints`.
    """
    parameters = _parameters(formula)
    if coordinates:
        state = {name: ca.SX.sym(name) for name in formula.coordinates.names}
        T = equation_values.to_pose(formula, {**parameters, **state})
        symbols: Mapping[str, Value] = {**parameters, **state, POSE_SYMBOL: T}
    else:
        state = {f"T{i}{j}": ca.SX.sym(f"T{i}{j}") for i in range(4) for j in range(4)}
        T = symbolic.unflat(ca.vertcat(*state.values()), 4, 4)
        symbols = {**parameters, **equation_values.from_pose(formula, T)}
    symbols = equation_values.run(formula, variants, symbols, "inverse")
    names = tuple(joint.name for joint in formula.joints)
    joints = equation_values.gather(formula, symbols, names, "joint")
    outputs = {"pose": symbolic.flat(T), "joints": joints}
    if formula.has("forward"):
        joint_symbols = {name: symbols[name] for name in names}
        again = equation_values.run(formula, variants, {**parameters, **joint_symbols}, "forward")
        outputs["again"] = symbolic.flat(_pose(formula, again))
    symbols = equation_values.run(formula, variants, symbols, "forward")
    outputs |= _of_helpers(formula, variants, symbols, measures)
    return _function(formula, state, parameters, outputs)


def aspects(formula: Formula, variants: Mapping[str, str]) -> ca.Function:
    """Return the signs that distinguish assemblies, times the preferred ones, as a function of pose and parameters.

    The pose (16,) is given row by row. A value is positive in the preferred assembly.
    """
    parameters = _parameters(formula)
    state = [ca.SX.sym(f"T{i}{j}") for i in range(4) for j in range(4)]
    T = symbolic.unflat(ca.vertcat(*state), 4, 4)
    symbols: Mapping[str, Value] = {**parameters, **equation_values.from_pose(formula, T)}
    for stage in ("inverse", "forward", "helper"):
        symbols = equation_values.run(formula, variants, symbols, stage)
    found = equation_values.gather(formula, symbols, tuple(aspect.symbol for aspect in formula.aspects), "aspect")
    preferred = ca.DM([aspect.preferred for aspect in formula.aspects])
    numbers = ca.vertcat(*parameters.values()) if parameters else ca.SX(0, 1)
    return ca.Function("aspects", [ca.vertcat(*state), numbers], [found * preferred])


def _of_helpers(
    formula: Formula, variants: Mapping[str, str], symbols: Mapping[str, Value], measures: bool
) -> dict[str, ca.SX]:
    """Return passive joints, reach and points, as far as the helpers can be computed from these symbols."""
    try:
        symbols = equation_values.run(formula, variants, symbols, "helper")
    except KinematicsError:  # a helper needs a symbol of another way of computing: then nothing is claimed of it
        return {}
    outputs = {
        "passive": equation_values.gather(formula, symbols, formula.passive, "passive"),
        "reach": equation_values.gather(formula, symbols, tuple(formula.reach.values()), "reach"),
    }
    for name, symbol in formula.points.items():
        if isinstance(symbol, str):
            outputs[f"point {name}"] = ca.vec(equation_values.expression(formula, symbols, symbol, f"point '{name}':"))
        else:
            outputs[f"point {name}"] = equation_values.gather(formula, symbols, symbol, f"point '{name}':")
    if measures:
        of_measures = tuple(measure.symbol for measure in formula.measures)
        of_aspects = tuple(aspect.symbol for aspect in formula.aspects)
        outputs["measures"] = equation_values.gather(formula, symbols, of_measures, "measure")
        outputs["aspects"] = equation_values.gather(formula, symbols, of_aspects, "aspect")
    return outputs


def _parameters(formula: Formula) -> dict[str, ca.SX]:
    return {parameter.name: ca.SX.sym(parameter.name) for parameter in formula.parameters}


def _pose(formula: Formula, symbols: Mapping[str, Value]) -> ca.SX:
    """Return the pose (4, 4) that forward equations gave as a matrix or as coordinates."""
    if POSE_SYMBOL in symbols:
        return equation_values.expression(formula, symbols, POSE_SYMBOL, "the pose")
    return equation_values.to_pose(formula, symbols)


def _function(
    formula: Formula, state: Mapping[str, ca.SX], parameters: Mapping[str, ca.SX], outputs: Mapping[str, ca.SX]
) -> Outputs:
    columns = [ca.densify(ca.SX(value)) for value in outputs.values()]
    numbers = ca.vertcat(*parameters.values()) if parameters else ca.SX(0, 1)
    function = ca.Function("equations", [ca.vertcat(*state.values()), numbers], columns)
    if any(function.instruction_id(k) == ca.OP_CALL for k in range(function.n_instructions())):
        raise KinematicsError(
            f"formula '{formula.name}': an equation calls a table or another compiled function; no proof can repeat "
            "its operations: write it as an expression of cosines, sines, roots and conditions"
        )
    return Outputs(function, tuple(state), tuple(outputs))
