"""The certificate of a bound over all joint values: both sides as operations, for programs without the prover."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import casadi as ca
import numpy as np

from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.model.mechanism import Mechanism
from twin.proof import chain, formula_side
from twin.proof.formula_side import POSE_ENTRIES
from twin.proof.instructions import instructions
from twin.proof.program import Row

SCHEMA = "twin/bounds-certificate/1"

_ONE_OPERAND = {ca.OP_SIN: "sine", ca.OP_COS: "cosine", ca.OP_NEG: "negative", ca.OP_INV: "inverse"}
"""Names of the operations of one operand."""


def variables(
    formula: Formula | None, mechanism: Mechanism, joints: Collection[str], tolerances: Mapping[str, float]
) -> list[JsonObject]:
    """Return the joints, and the parameters with a range, in m.

    Args:
        formula: the equations; None if two mechanisms are compared.
        mechanism: the mechanism, with the limits of sliding joints.
        joints: names of the joints that are variables.
        tolerances: {parameter: by how much it may differ from its value, in m}.

    Raises:
        TwinError: a sliding joint has no finite limits.
    """
    rows: list[JsonObject] = []
    for name in joints:
        joint = mechanism.joint(name)
        if joint.type == "revolute":
            rows.append({"name": name, "angle": True})
        else:
            middle, half = chain.sliding_range(mechanism, name)
            rows.append({"name": name, "angle": False, "low": middle - half, "high": middle + half})
    if formula is None:
        return rows
    for parameter in formula.parameters:
        tolerance = tolerances.get(parameter.name)
        if tolerance:
            value = float(parameter.value)
            rows.append({"name": parameter.name, "angle": False, "low": value - tolerance, "high": value + tolerance})
    return rows


def equations_side(
    formula: Formula, chosen: Mapping[str, str], mechanism: Mechanism, tolerances: Mapping[str, float]
) -> JsonObject:
    """Return the operations of the forward equations.

    The result has `rows`, `pose` (3 rows of 4 numbers of rows), and `joints`, {passive joint on the way to the tool:
    number of its row}.
    """
    outputs = formula_side.from_joints(formula, chosen)
    symbols = outputs.function.sx_in()
    results = dict(zip(outputs.names, outputs.function(*symbols), strict=True))
    tool_body = mechanism.frame(mechanism.tool).body
    joints_to_tool = {joint.name for joint in mechanism.path(tool_body)}
    passive: dict[str, ca.SX] = {}
    if "passive" in results:
        for name, value in zip(formula.passive, ca.vertsplit(results["passive"]), strict=True):
            if name in joints_to_tool:
                passive[name] = value
    entries = ca.vertcat(results["pose"], *passive.values())
    function = ca.Function("pose", symbols, [ca.densify(entries)])
    joints: list[Row] = [["variable", joint.name] for joint in formula.joints]
    parameters: list[Row] = []
    for parameter in formula.parameters:
        if tolerances.get(parameter.name):
            parameters.append(["variable", parameter.name])
        else:
            parameters.append(["number", repr(float(parameter.value))])
    rows, places = _rows(formula.name, function, [joints, parameters])
    return {
        "name": "equations",
        "rows": rows,
        "pose": [places[0:4], places[4:8], places[8:12]],
        "joints": dict(zip(passive, places[POSE_ENTRIES:], strict=True)),
    }


def _rows(name: str, function: ca.Function, inputs: list[list[Row]]) -> tuple[list[Row], list[int]]:
    """Return the operations of a function with one output, and the numbers of the rows of its entries.

    Raises:
        TwinError: an operation has no row of a certificate; the message has the `name` of the formula.
    """
    rows: list[Row] = []
    row_at: dict[int, int] = {}  # {place of memory: number of the row whose result is there}
    results = [0] * function.nnz_out(0)

    def add(*row: str | int) -> int:
        rows.append(list(row))
        return len(rows) - 1

    for step in instructions(function):
        operation = step.operation
        operands = [row_at[place] for place in step.operands]
        if operation == ca.OP_OUTPUT:
            _, entry = step.port
            results[entry] = operands[0]
            continue
        if operation == ca.OP_CONST:
            row = add("number", repr(step.constant))
        elif operation == ca.OP_INPUT:
            column, entry = step.port
            row = add(*inputs[column][entry])
        elif operation in _ONE_OPERAND:
            row = add(_ONE_OPERAND[operation], operands[0])
        elif operation in (ca.OP_ADD, ca.OP_TWICE):
            row = add("add", operands[0], operands[-1])
        # a certificate knows neither differences nor quotients: its checker stays short
        elif operation == ca.OP_SUB:
            opposite = add("negative", operands[1])
            row = add("add", operands[0], opposite)
        elif operation in (ca.OP_MUL, ca.OP_SQ):
            row = add("multiply", operands[0], operands[-1])
        elif operation == ca.OP_DIV:
            inverse = add("inverse", operands[1])
            row = add("multiply", operands[0], inverse)
        else:
            raise TwinError(f"{name}: operation {operation} of the forward equations has no row of a certificate")
        row_at[step.target] = row
    return rows, results


def mechanism_side(mechanism: Mechanism) -> JsonObject:
    """Return the frames and joints from the base to the tool, one after the other."""
    tool = mechanism.frame(mechanism.tool)
    steps: list[list[object]] = []
    for joint in mechanism.path(tool.body):
        steps.append(["frame", _numbers(joint.T_parent_joint)])
        if joint.type == "revolute":
            steps.append(["turn", joint.name])
        elif joint.type != "fixed":
            steps.append(["slide", joint.name])
        steps.append(["inverse", _numbers(joint.T_child_joint)])
    steps.append(["frame", _numbers(tool.T_body_frame)])
    return {"name": mechanism.name, "chain": steps}


def _numbers(T: Array) -> list[list[float]]:
    """Return the first three rows of a pose (4, 4); the fourth is always 0, 0, 0, 1."""
    return np.asarray(T[:3], float).tolist()
