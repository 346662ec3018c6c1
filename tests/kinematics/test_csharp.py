"""The text of C# methods; what they compute is shown by mono, tests/witness/test_mono_kinematics.py."""

from __future__ import annotations

import math
import re

import casadi as ca
import numpy as np
import pytest

from twin.codegen.csharp import method, number


def run(lines: list[str], arrays: dict[str, list[float]]) -> None:
    """Execute the statements of methods that have arithmetic only, in their order."""
    for line in lines:
        kept = re.search(r"double\[\] (\w+) = new double\[(\d+)\]", line)
        if kept:
            arrays[kept[1]] = [math.nan] * int(kept[2])
        assigned = re.fullmatch(r"\s+(?:double )?([\w\[\]]+ = .*);", line)
        if assigned:
            exec(assigned[1], {}, arrays)


def test_a_long_function_is_split_and_computes_the_same():
    x = ca.SX.sym("x", 3)
    y = x[0]
    for i in range(700):
        y = y * x[1] / 3.0 + x[2] - (i + 0.1)
    function = ca.Function("f", [x], [ca.vertcat(y, x[0] * x[0], 2.5)])
    places = [("a", 0), ("a", 1), ("b", 0)]
    lines = method("F", function, places, [("a", 0), ("b", 0), ("b", 1)])
    parts = [line for line in lines if re.match(r"private void FPart\d+\(\)", line)]
    assert len(parts) > 3
    for body in "\n".join(lines).split("private void FPart")[1:]:
        assert body.count("\n") < 600
    arrays = {"a": [0.3, 0.7], "b": [1.1, 0.0]}
    run(lines, arrays)
    wanted = function([0.3, 0.7, 1.1]).full().ravel()
    assert np.allclose([arrays["a"][0], *arrays["b"]], wanted, rtol=1e-14)


def test_results_that_are_also_inputs_are_written_last():
    x = ca.SX.sym("x", 2)
    function = ca.Function("swap", [x], [ca.vertcat(x[1] + 1, x[0] + 1)])
    arrays = {"a": [1.0, 5.0]}
    run(method("Swap", function, [("a", 0), ("a", 1)], [("a", 0), ("a", 1)]), arrays)
    assert arrays["a"] == [6.0, 2.0]


@pytest.mark.parametrize("x", [0.0, -1.5, 1e-300, 1 / 3, 5e22, float("inf")])
def test_a_number_is_read_back_exactly(x):
    text = number(x)
    if math.isinf(x):
        assert text == "double.PositiveInfinity"
        return
    assert float(text.strip("()")) == x
    assert any(mark in text for mark in ".e"), "an integer would be divided as one"


def test_what_cannot_be_written_is_named():
    x = ca.SX.sym("x")
    with pytest.raises(ValueError, match=r"operation \d+ cannot be written in C#"):
        method("F", ca.Function("f", [x], [ca.erf(x)]), [("a", 0)], [("a", 0)])
    with pytest.raises(ValueError, match="has 1 inputs; 2 places are given"):
        method("F", ca.Function("f", [x], [x]), [("a", 0), ("a", 1)], [("a", 0)])
    with pytest.raises(ValueError, match="not a CasADi function of scalars"):
        method("F", ca.Function("f", [ca.MX.sym("m")], [ca.MX(1)]), [("a", 0)], [("a", 0)])


def test_sparse_arguments_and_results_are_refused():
    """CasADi numbers only their nonzeros: the second number of a diagonal matrix would be written off the diagonal."""
    x = ca.SX.sym("x")
    result = ca.SX.eye(2) * x
    places = [("b", i) for i in range(4)]
    with pytest.raises(ValueError, match="result 'o0' is sparse, with 2 of 4 numbers; make it dense"):
        method("F", ca.Function("f", [x], [result]), [("a", 0)], places)
    arrays = {"a": [3.0], "b": [math.nan] * 4}
    run(method("F", ca.Function("f", [x], [ca.densify(result)]), [("a", 0)], places), arrays)
    assert arrays["b"] == [3.0, 0.0, 0.0, 3.0]
    diagonal = ca.SX.sym("d", ca.Sparsity.diag(2))
    with pytest.raises(ValueError, match="argument 'i0' is sparse, with 2 of 4 numbers; make it dense"):
        method("F", ca.Function("f", [diagonal], [diagonal[1, 1]]), places, [("a", 0)])
