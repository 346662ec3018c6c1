"""The equations' side of a proof: functions of the joints or of the pose, in the chosen variants."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.formula import equation_values, symbolic
from twin.formula.contract import POSE_SYMBOL, Formula
from twin.formula.scalar import Value

POSE_ENTRIES = 16
"""Number of entries of a pose."""


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
    state = _symbols(_joint_names(formula))
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
        state = _symbols(formula.coordinates.names)
        T = equation_values.to_pose(formula, {**parameters, **state})
        symbols: Mapping[str, Value] = {**parameters, **state, POSE_SYMBOL: T}
    else:
        state = _pose_symbols()
        T = symbolic.unflat(ca.vertcat(*state.values()), 4, 4)
        symbols = {**parameters, **equation_values.from_pose(formula, T)}
    symbols = equation_values.run(formula, variants, symbols, "inverse")
    names = _joint_names(formula)
    joints = equation_values.gather(formula, symbols, names, "joint")
    outputs = {"pose": symbolic.flat(T), "joints": joints}
    if formula.has("forward"):
        # from the joints alone: the symbols of the inverse equations must not stand in for those of the forward ones
        joint_symbols = {name: symbols[name] for name in names}
        forward_symbols = equation_values.run(formula, variants, {**parameters, **joint_symbols}, "forward")
        outputs["again"] = symbolic.flat(_pose(formula, forward_symbols))
    symbols = equation_values.run(formula, variants, symbols, "forward")
    outputs |= _of_helpers(formula, variants, symbols, measures)
    return _function(formula, state, parameters, outputs)


def aspects(formula: Formula, variants: Mapping[str, str]) -> ca.Function:
    """Return the signs that distinguish assemblies, times the preferred ones, as a function of pose and parameters.

    The pose (16,) is given row by row. A value is positive in the preferred assembly.
    """
    parameters = _parameters(formula)
    state = ca.vertcat(*_pose_symbols().values())
    T = symbolic.unflat(state, 4, 4)
    symbols: Mapping[str, Value] = {**parameters, **equation_values.from_pose(formula, T)}
    for stage in ("inverse", "forward", "helper"):
        symbols = equation_values.run(formula, variants, symbols, stage)
    preferred = ca.DM([aspect.preferred for aspect in formula.aspects])
    return ca.Function("aspects", [state, _column(parameters)], [_aspects(formula, symbols) * preferred])


def _aspects(formula: Formula, symbols: Mapping[str, Value]) -> ca.SX:
    """Return the signs that distinguish assemblies, as a column."""
    names = tuple(aspect.symbol for aspect in formula.aspects)
    return equation_values.gather(formula, symbols, names, "aspect")


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
        what = f"point '{name}':"
        if isinstance(symbol, str):
            p = ca.vec(equation_values.expression(formula, symbols, symbol, what))
        else:
            p = equation_values.gather(formula, symbols, symbol, what)
        outputs[f"point {name}"] = p
    if measures:
        measure_symbols = tuple(measure.symbol for measure in formula.measures)
        outputs["measures"] = equation_values.gather(formula, symbols, measure_symbols, "measure")
        outputs["aspects"] = _aspects(formula, symbols)
    return outputs


def _joint_names(formula: Formula) -> tuple[str, ...]:
    """Return the names of the active joints."""
    return tuple(joint.name for joint in formula.joints)


def _parameters(formula: Formula) -> dict[str, ca.SX]:
    """Return {parameter: its symbol}."""
    return _symbols(parameter.name for parameter in formula.parameters)


def _symbols(names: Iterable[str]) -> dict[str, ca.SX]:
    """Return {name: a symbol with this name}."""
    return {name: ca.SX.sym(name) for name in names}


def parameter_values(formula: Formula) -> Array:
    """Return the published values (n,) of the parameters, in their order and units."""
    return np.array([float(parameter.value) for parameter in formula.parameters])


def _pose_symbols() -> dict[str, ca.SX]:
    """Return {name: symbol} of the 16 entries of a pose, row by row."""
    symbols = {}
    for i in range(4):
        for j in range(4):
            name = f"T{i}{j}"
            symbols[name] = ca.SX.sym(name)
    return symbols


def _column(symbols: Mapping[str, ca.SX]) -> ca.SX:
    """Return symbols as a column, which may be empty."""
    if not symbols:
        return ca.SX(0, 1)
    return ca.vertcat(*symbols.values())


def _pose(formula: Formula, symbols: Mapping[str, Value]) -> ca.SX:
    """Return the pose (4, 4) that forward equations gave as a matrix or as coordinates."""
    if POSE_SYMBOL in symbols:
        return equation_values.expression(formula, symbols, POSE_SYMBOL, "the pose")
    return equation_values.to_pose(formula, symbols)


def _function(
    formula: Formula, state: Mapping[str, ca.SX], parameters: Mapping[str, ca.SX], outputs: Mapping[str, ca.SX]
) -> Outputs:
    """Return the function of state and parameters.

    Raises:
        KinematicsError: an equation calls a table or another compiled function.
    """
    columns = []
    for value in outputs.values():
        # an entry that is always 0 is left out otherwise, and its output would have fewer entries than its name says
        columns.append(ca.densify(ca.SX(value)))
    function = ca.Function("equations", [ca.vertcat(*state.values()), _column(parameters)], columns)
    for number in range(function.n_instructions()):
        if function.instruction_id(number) == ca.OP_CALL:
            raise KinematicsError(
                f"formula '{formula.name}': an equation calls a table or another compiled function; no proof can "
                "repeat its operations: write it as an expression of cosines, sines, roots and conditions"
            )
    return Outputs(function, tuple(state), tuple(outputs))
