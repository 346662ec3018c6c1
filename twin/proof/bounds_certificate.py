"""The certificate of a bound over all joint values: both sides as operations, for programs without the prover."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import casadi as ca

from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.model.mechanism import Mechanism
from twin.proof import chain, formula_side
from twin.proof.program import Row

SCHEMA = "twin/bounds-certificate/1"

_ONE_OPERAND = {ca.OP_SIN: "sine", ca.OP_COS: "cosine", ca.OP_NEG: "negative", ca.OP_INV: "inverse"}


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
    found: list[JsonObject] = []
    for name in joints:
        joint = mechanism.joint(name)
        if joint.type == "revolute":
            found.append({"name": name, "angle": True})
        else:
            middle, half = chain.sliding_range(mechanism, name)
            found.append({"name": name, "angle": False, "low": middle - half, "high": middle + half})
    for parameter in formula.parameters if formula is not None else ():
        tolerance = tolerances.get(parameter.name)
        if tolerance:
            value = float(parameter.value)
            found.append({"name": parameter.name, "angle": False, "low": value - tolerance, "high": value + tolerance})
    return found


def equations_side(
    formula: Formula, chosen: Mapping[str, str], mechanism: Mechanism, tolerances: Mapping[str, float]
) -> JsonObject:
    """Return the operations of the forward equations.

    The result has `rows`, `pose` (3 rows of 4 numbers of rows), and `joints`, {passive joint on the way to the tool:
    number of its row}.
    """
    outputs = formula_side.from_joints(formula, chosen)
    symbols = outputs.function.sx_in()
    found = dict(zip(outputs.names, outputs.function(*symbols), strict=True))
    path = {joint.name for joint in mechanism.path(mechanism.frame(mechanism.tool).body)}
    passive = {}
    if "passive" in found:
        values = ca.vertsplit(found["passive"])
        passive = {name: value for name, value in zip(formula.passive, values, strict=True) if name in path}
    function = ca.Function("pose", symbols, [ca.densify(ca.vertcat(found["pose"], *passive.values()))])
    names = [joint.name for joint in formula.joints]
    inputs: list[list[Row]] = [[["variable", name] for name in names], []]
    for parameter in formula.parameters:
        if tolerances.get(parameter.name):
            inputs[1].append(["variable", parameter.name])
        else:
            inputs[1].append(["number", repr(float(parameter.value))])
    rows, results = _rows(formula.name, function, inputs)
    pose = [results[4 * i : 4 * i + 4] for i in range(3)]
    return {"name": "equations", "rows": rows, "pose": pose, "joints": dict(zip(passive, results[16:], strict=True))}


def _rows(name: str, function: ca.Function, inputs: list[list[Row]]) -> tuple[list[Row], list[int]]:
    """Return the operations of a function with one output, and the numbers of the rows of its entries."""
    rows: list[Row] = []
    places: dict[int, int] = {}
    results = [0] * function.nnz_out(0)

    def put(*row: str | int) -> int:
        rows.append(list(row))
        return len(rows) - 1

    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        targets = function.instruction_output(k)
        sources = function.instruction_input(k)
        if operation == ca.OP_CONST:
            places[targets[0]] = put("number", repr(function.instruction_constant(k)))
            continue
        if operation == ca.OP_INPUT:
            places[targets[0]] = put(*inputs[sources[0]][sources[1]])
            continue
        operands = [places[source] for source in sources]
        if operation == ca.OP_OUTPUT:
            results[targets[1]] = operands[0]
        elif operation in _ONE_OPERAND:
            places[targets[0]] = put(_ONE_OPERAND[operation], operands[0])
        elif operation in (ca.OP_ADD, ca.OP_TWICE):
            places[targets[0]] = put("add", operands[0], operands[-1])
        elif operation == ca.OP_SUB:
            places[targets[0]] = put("add", operands[0], put("negative", operands[1]))
        elif operation in (ca.OP_MUL, ca.OP_SQ):
            places[targets[0]] = put("multiply", operands[0], operands[-1])
        elif operation == ca.OP_DIV:
            places[targets[0]] = put("multiply", operands[0], put("inverse", operands[1]))
        else:
            raise TwinError(f"{name}: operation {operation} of the forward equations has no row of a certificate")
    return rows, results


def mechanism_side(mechanism: Mechanism) -> JsonObject:
    """Return the frames and joints from the base to the tool, one after the other."""
    tool = mechanism.frame(mechanism.tool)
    chain: list[list[object]] = []
    for joint in mechanism.path(tool.body):
        chain.append(["frame", _numbers(joint.T_parent_joint)])
        if joint.type != "fixed":
            chain.append(["turn" if joint.type == "revolute" else "slide", joint.name])
        chain.append(["inverse", _numbers(joint.T_child_joint)])
    chain.append(["frame", _numbers(tool.T_body_frame)])
    return {"name": mechanism.name, "chain": chain}


def _numbers(T: Array) -> list[list[float]]:
    """Return the first three rows of a pose (4, 4)."""
    return [[float(entry) for entry in row] for row in T[:3]]
