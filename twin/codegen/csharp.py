"""Write CasADi functions as C# methods, for programs that run where no Python is, such as a headset.

A method has no arguments: it reads fields (arrays of double) and writes fields. All results are written at the end, so
that a field may be both read and written. Just-in-time compilers need long for long methods; therefore a function is
split into methods of at most `_LONGEST` operations, and values that a later method needs are kept in an array. Only
`System.Math` and the methods of `HELPERS` are called, and the operations are those of IEEE 754, as in CasADi.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import casadi as ca

Place = tuple[str, int]
"""An entry of a C# array: (name of the array, index)."""

_LONGEST = 400
"""Maximum number of operations in a method."""

_TEXT = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_SQRT: "Math.Sqrt({0})",
    ca.OP_SIN: "Math.Sin({0})",
    ca.OP_COS: "Math.Cos({0})",
    ca.OP_TAN: "Math.Tan({0})",
    ca.OP_ASIN: "Math.Asin({0})",
    ca.OP_ACOS: "Math.Acos({0})",
    ca.OP_ATAN: "Math.Atan({0})",
    ca.OP_ATAN2: "Math.Atan2({0}, {1})",
    ca.OP_SINH: "Math.Sinh({0})",
    ca.OP_COSH: "Math.Cosh({0})",
    ca.OP_TANH: "Math.Tanh({0})",
    ca.OP_EXP: "Math.Exp({0})",
    ca.OP_LOG: "Math.Log({0})",
    ca.OP_POW: "Math.Pow({0}, {1})",
    ca.OP_CONSTPOW: "Math.Pow({0}, {1})",
    ca.OP_HYPOT: "Math.Sqrt({0} * {0} + {1} * {1})",
    ca.OP_FABS: "Math.Abs({0})",
    ca.OP_FLOOR: "Math.Floor({0})",
    ca.OP_CEIL: "Math.Ceiling({0})",
    # Math.Min and Math.Max return NaN if one argument is NaN; the functions of C return the other argument.
    ca.OP_FMIN: "Smaller({0}, {1})",
    ca.OP_FMAX: "Larger({0}, {1})",
    ca.OP_SIGN: "({0} > 0.0 ? 1.0 : {0} < 0.0 ? -1.0 : {0})",
    # The sign bit of a zero shows in its reciprocal.
    ca.OP_COPYSIGN: "({1} < 0.0 || 1.0 / {1} < 0.0 ? -Math.Abs({0}) : Math.Abs({0}))",
    ca.OP_LT: "({0} < {1} ? 1.0 : 0.0)",
    ca.OP_LE: "({0} <= {1} ? 1.0 : 0.0)",
    ca.OP_EQ: "({0} == {1} ? 1.0 : 0.0)",
    ca.OP_NE: "({0} != {1} ? 1.0 : 0.0)",
    ca.OP_NOT: "({0} != 0.0 ? 0.0 : 1.0)",
    ca.OP_AND: "({0} != 0.0 && {1} != 0.0 ? 1.0 : 0.0)",
    ca.OP_OR: "({0} != 0.0 || {1} != 0.0 ? 1.0 : 0.0)",
    ca.OP_IF_ELSE_ZERO: "({0} != 0.0 ? {1} : 0.0)",
}
"""C# expression of each CasADi operation; {0} and {1} are its operands."""


HELPERS = """\
private static double Smaller(double a, double b)
{
    return a < b || double.IsNaN(b) ? a : b;
}

private static double Larger(double a, double b)
{
    return a > b || double.IsNaN(b) ? a : b;
}
"""
"""C# members that the methods call; a class needs them once."""


@dataclass
class _Value:
    """A computed value, in a local variable of one method.

    Attributes:
        local: name of the variable.
        method: number of the method.
        kept_index: its entry in the array of values that later methods need; -1 while none does.
    """

    local: str
    method: int
    kept_index: int = -1


class _Splitter:
    """Writer of the statements of one function, in methods of limited length."""

    def __init__(self, kept_array: str) -> None:
        self.kept_array = kept_array  # name of the array of values that a later method needs
        self.methods: list[list[str]] = [[]]
        self.values: dict[int, _Value | str] = {}  # by place in CasADi's work vector; a constant is a text
        self.count = 0
        self.kept_count = 0
        self._operations = 0

    def operand(self, place: int) -> str:
        """Return the text of a value in the method that is being written."""
        value = self.values[place]
        if isinstance(value, str):
            return value
        if value.method == len(self.methods) - 1:
            return value.local
        if value.kept_index < 0:
            value.kept_index = self.kept_count
            self.kept_count += 1
            self.methods[value.method].append(f"{self.kept_array}[{value.kept_index}] = {value.local};")
        return f"{self.kept_array}[{value.kept_index}]"

    def put(self, place: int, text: str) -> None:
        """Write a local variable with this value, which takes a place of the work vector."""
        local = f"t{self.count}"
        self.count += 1
        self.methods[-1].append(f"double {local} = {text};")
        self.values[place] = _Value(local, len(self.methods) - 1)

    def begin_operation(self) -> None:
        """Begin a new method if the present one has its maximum length."""
        self._operations += 1
        if self._operations > _LONGEST:
            self.methods.append([])
            self._operations = 1


def number(x: float) -> str:
    """Return a double as a C# literal that is read back to the same double."""
    if math.isnan(x):
        return "double.NaN"
    if x == math.inf:
        return "double.PositiveInfinity"
    if x == -math.inf:
        return "double.NegativeInfinity"
    text = repr(float(x))
    # in brackets, because an operand may follow another sign; -0.0 is not below 0
    if text.startswith("-"):
        return f"({text})"
    return text


def method(name: str, function: ca.Function, inputs: Sequence[Place], outputs: Sequence[Place]) -> list[str]:
    """Return the lines of C# members that compute a function: a private method `name`, and what it needs.

    Args:
        name: name of the method; further members begin with this name.
        function: CasADi function of scalars (SX) with dense arguments and results.
        inputs: for each number of all arguments, in order, the array entry that is read.
        outputs: for each number of all results, in order, the array entry that is written.

    Raises:
        ValueError: the function is not an SX function, an argument or result is sparse, an operation is not supported,
            or a count is wrong.
    """
    if not function.is_a("SXFunction"):
        raise ValueError(f"function '{function.name()}' is not a CasADi function of scalars (SX)")
    _require_dense(function)
    first_input = _starts(map(function.numel_in, range(function.n_in())))
    first_output = _starts(map(function.numel_out, range(function.n_out())))
    for what, places, count in (("inputs", inputs, first_input[-1]), ("outputs", outputs, first_output[-1])):
        if len(places) != count:
            raise ValueError(f"function '{function.name()}' has {count} {what}; {len(places)} places are given")

    splitter = _Splitter(f"kept{name}")
    results: dict[int, str | _Value] = {}
    for instruction in range(function.n_instructions()):
        op = function.instruction_id(instruction)
        sources = function.instruction_input(instruction)
        targets = function.instruction_output(instruction)
        if op == ca.OP_OUTPUT:
            output, entry = targets
            results[first_output[output] + entry] = splitter.values[sources[0]]
            continue
        if op == ca.OP_CONST:
            splitter.values[targets[0]] = number(function.instruction_constant(instruction))
            continue
        splitter.begin_operation()
        if op == ca.OP_INPUT:
            argument, entry = sources
            array, index = inputs[first_input[argument] + entry]
            splitter.put(targets[0], f"{array}[{index}]")
            continue
        if op not in _TEXT:
            raise ValueError(f"function '{function.name()}': CasADi's operation {op} cannot be written in C#")
        operands = list(map(splitter.operand, sources))
        splitter.put(targets[0], _TEXT[op].format(*operands))

    # last, because an array may be an input as well
    for entry, (array, index) in enumerate(outputs):
        splitter.values[-1] = results.get(entry, "0.0")  # a place that no instruction has
        text = splitter.operand(-1)
        splitter.methods[-1].append(f"{array}[{index}] = {text};")
    return _members(name, splitter)


def _require_dense(function: ca.Function) -> None:
    """Raise ValueError if an argument or result is sparse: CasADi counts its nonzeros, places count all numbers."""
    tables = []
    for i in range(function.n_in()):
        tables.append(("argument", function.name_in(i), function.sparsity_in(i)))
    for i in range(function.n_out()):
        tables.append(("result", function.name_out(i), function.sparsity_out(i)))
    for what, name, sparsity in tables:
        if not sparsity.is_dense():
            raise ValueError(
                f"function '{function.name()}': {what} '{name}' is sparse, with {sparsity.nnz()} of {sparsity.numel()} "
                "numbers; make it dense with casadi.densify"
            )


def _starts(counts: Iterable[int]) -> list[int]:
    """Return the index of the first number of each argument or result, and the total count."""
    starts = [0]
    for count in counts:
        starts.append(starts[-1] + count)
    return starts


def _members(name: str, splitter: _Splitter) -> list[str]:
    """Return the lines of the methods, of the array of kept values, and of the method that calls them in order."""
    lines: list[str] = []
    if len(splitter.methods) == 1:
        return [f"private void {name}()", "{", *_indented(splitter.methods[0]), "}"]
    lines.append(f"private readonly double[] {splitter.kept_array} = new double[{splitter.kept_count}];")
    lines += ["", f"private void {name}()", "{"]
    for part in range(len(splitter.methods)):
        lines.append(f"    {name}Part{part}();")
    lines.append("}")
    for part, statements in enumerate(splitter.methods):
        lines += ["", f"private void {name}Part{part}()", "{", *_indented(statements), "}"]
    return lines


def _indented(statements: Sequence[str]) -> list[str]:
    """Return the statements of a method as its lines."""
    return [f"    {statement}" for statement in statements]
