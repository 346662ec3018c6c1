"""Write a kernel as LLVM assembly: a loop over samples that calls CasADi functions (stages) in sequence.

Each instruction of a function becomes a line that operates on a vector of `width` samples (lanes). Mathematical library
functions would process one lane at a time and be ten times slower. Therefore sine and cosine are written inline without
branches, and `lower` replaces the other functions. NaN and infinity follow IEEE 754, so that unreachable poses remain
NaN.

A product that is added or subtracted is fused with the sum, which avoids a rounding. This is done here, not by LLVM,
which would choose between two products differently for each target: so a sample has the same result, bit for bit, in
vectors of any width, whatever its neighbours, and on a graphics processor that rounds as IEEE 754 prescribes. Sums of
two products and sums of which a square root is taken are not fused: of a**2 - b**2 with equal a and b would remain the
rounding error of one square, and half of such roots, as of a stretched arm, would be NaN. If equal terms are computed
in two ways, rounding decides whether there is a root, as it does in CasADi, but not always in the same way.

An exact kernel has one lane and fuses no operations. It rounds after each operation and calls the functions of the C
library, so that its results equal those of CasADi's interpreter bit for bit.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca

from twin.codegen.lower import lowered

_LIBRARY_FUNCTIONS = {
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos",
    ca.OP_ATAN: "atan",
    ca.OP_ATAN2: "atan2",
    ca.OP_HYPOT: "hypot",
}
"""Functions of the C library that an exact kernel calls."""

_COMPARISONS = {
    ca.OP_LT: "olt",
    ca.OP_LE: "ole",
    ca.OP_EQ: "oeq",
    ca.OP_NE: "une",
}
"""LLVM conditions of comparisons; all but "not equal" are false for NaN, as in IEEE 754."""

_LOGICAL_OPERATIONS = {*_COMPARISONS, ca.OP_NOT, ca.OP_AND, ca.OP_OR, ca.OP_IF_ELSE_ZERO}
"""Operations on truth values, or with a truth value as result."""

_INTRINSICS = {
    ca.OP_SQRT: "sqrt",
    ca.OP_FABS: "fabs",
    ca.OP_FLOOR: "floor",
    ca.OP_CEIL: "ceil",
    ca.OP_COPYSIGN: "copysign",
    ca.OP_FMIN: "minnum",
    ca.OP_FMAX: "maxnum",
    ca.OP_EXP: "exp",
    ca.OP_LOG: "log",
    ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow",
    ca.OP_SINH: "sinh",
    ca.OP_COSH: "cosh",
    ca.OP_TANH: "tanh",
}
"""Functions that LLVM provides for vectors."""

_ARITHMETIC_OPERATIONS = (
    ca.OP_DIV,
    ca.OP_MUL,
    ca.OP_SQ,
    ca.OP_ADD,
    ca.OP_SUB,
    ca.OP_TWICE,
    ca.OP_NEG,
    ca.OP_INV,
    ca.OP_ASSIGN,
)
"""Operations with an instruction of their own."""

_TERM_OPERATIONS = (ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE, ca.OP_ASSIGN)
"""Operations that keep what they add: of a difference of equal terms remains 0."""

_HALF_PI_PARTS = (1.5707963267948966, 6.123233995736766e-17)
"""pi/2 as a sum of two doubles, for an exact reduction of angles."""

_SINE_COEFFICIENTS = (
    1.58969099521155010221e-10,
    -2.50507602534068634195e-08,
    2.75573137070700676789e-06,
    -1.98412698298579493134e-04,
    8.33333333332248946124e-03,
    -1.66666666666666324348e-01,
)
_COSINE_COEFFICIENTS = (
    -1.13596475577881948265e-11,
    2.08757232129817482790e-09,
    -2.75573143513906633035e-07,
    2.48015872894767294178e-05,
    -1.38888888888741095749e-03,
    4.16666666666666019037e-02,
)
"""Polynomial coefficients of sine and cosine from FreeBSD's msun (k_sin.c, k_cos.c), highest power first."""

_ROUNDING_SHIFT = 1.5 * 2.0**52
"""Constant c for rounding: the lowest bits of the double x + c contain the integer nearest to x."""

_SMALLEST_DIVISOR = 1e-300
_LARGEST_DIVISOR = 1e300
"""Sizes of numbers between which a reciprocal neither overflows nor loses digits."""

_PREFETCH_DISTANCE = 4
"""Number of vectors between the vector being computed and the vector that is prefetched from memory."""

_LARGEST_ANGLE = 1e9
"""Absolute value in rad above which sine and cosine return NaN, because the argument is not precise enough."""


@dataclass(frozen=True)
class Stage:
    """One function of a kernel.

    Attributes:
        function: CasADi function with dense arguments and results.
        takes: names of the arguments: inputs of the kernel, or results of earlier stages.
        gives: names of the results.
        repeat: maximum number of calls for a sample. In repeated calls, a result with the name of an argument is used
            as that argument in the next call. The calls end when the result `error` is at most `tolerance` (or NaN) in
            every lane.
        tolerance: see `repeat`.
        reciprocals: whether several divisions by the same number are replaced by multiplications with its reciprocal.
            This adds a rounding error, which iterations correct in the next step.
    """

    function: ca.Function
    takes: tuple[str, ...]
    gives: tuple[str, ...]
    repeat: int = 1
    tolerance: float = 0.0
    reciprocals: bool = False


@dataclass
class _FunctionMemory:
    """What is known of the values of a function while its instructions are written.

    Attributes:
        radicands: instructions that add or subtract terms of what a square root is taken of.
        reciprocals: see `Stage`.
        names: {place in CasADi's work vector: LLVM name of its value}.
        numbers: {name of a constant: its number}.
        inverses: {name: name of its reciprocal}.
        sines: {name of an angle: names of its sine and cosine}.
        points: {name of an angle that is an arc tangent: names of its arguments (y, x)}.
        products: {name of a product that a sum may take in: names of its factors}.
    """

    radicands: set[int]
    reciprocals: bool
    names: dict[int, str] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    inverses: dict[str, str] = field(default_factory=dict)
    sines: dict[str, tuple[str, str]] = field(default_factory=dict)
    points: dict[str, tuple[str, str]] = field(default_factory=dict)
    products: dict[str, tuple[str, str]] = field(default_factory=dict)


class _LaneWriter:
    """Writer of the lines of an LLVM function that operates on vectors of `width` lanes.

    Attributes:
        width: number of lanes.
        exact: whether results equal those of CasADi bit for bit.
        vector, truths, integers: LLVM types of the values, conditions and integers of all lanes.
        suffix: end of the names of LLVM's functions for this vector.
        lines: the lines so far.
        declared: declarations of the functions that are called.
        sines: whether the function for sine and cosine (`_sine_function`) is called.
        waiting: {input that is not loaded yet: number of its array}.
        loaded: {input: LLVM name of its loaded value}.
    """

    def __init__(self, width: int, exact: bool = False) -> None:
        self.width = width
        self.exact = exact
        if width > 1:
            self.vector = f"<{width} x double>"
            self.truths = f"<{width} x i1>"
            self.integers = f"<{width} x i64>"
            self.suffix = f"v{width}f64"
        else:
            self.vector = "double"
            self.truths = "i1"
            self.integers = "i64"
            self.suffix = "f64"
        self.lines: list[str] = []
        self.declared: set[str] = set()
        self.sines = False
        self.waiting: dict[str, int] = {}
        self.loaded: dict[str, str] = {}
        self._count = 0

    def constant(self, x: float) -> str:
        """Return a number as LLVM's constant: the bits of the double, so that nothing is rounded."""
        (integer,) = struct.unpack("<Q", struct.pack("<d", x))
        bits = f"0x{integer:016X}"
        if self.width > 1:
            return f"splat (double {bits})"
        return bits

    def integer(self, k: int) -> str:
        """Return an integer as LLVM's constant."""
        if self.width > 1:
            return f"splat (i64 {k})"
        return str(k)

    def line(self, text: str) -> None:
        """Write an instruction without result."""
        self.lines.append(f"  {text}")

    def put(self, text: str) -> str:
        """Write an instruction; return the LLVM name of its result."""
        self._count += 1
        name = f"%t{self._count}"
        self.line(f"{name} = {text}")
        return name

    def intrinsic(self, name: str, *arguments: str) -> str:
        """Write a call of a function that LLVM provides for vectors; return the LLVM name of its result."""
        function = f"{self.vector} @llvm.{name}.{self.suffix}"
        types = ", ".join([self.vector] * len(arguments))
        self.declared.add(f"declare {function}({types})")
        return self.put(f"call {function}({_typed(self.vector, arguments)})")

    def library(self, name: str, *arguments: str) -> str:
        """Write a call of a function of the C library; return the LLVM name of its result."""
        types = ", ".join(["double"] * len(arguments))
        self.declared.add(f"declare double @{name}({types}) nounwind memory(none)")
        return self.put(f"call double @{name}({_typed('double', arguments)})")

    def choose(self, condition: str, a: str, b: str) -> str:
        """Return the LLVM name of a where a condition is true, else of b."""
        return self.put(f"select {self.truths} {condition}, {self.vector} {a}, {self.vector} {b}")

    def true(self, x: str) -> str:
        """Return the LLVM name of the condition that a number is not 0."""
        return self.put(f"fcmp une {self.vector} {x}, {self.constant(0.0)}")

    def value(self, name: str) -> str:
        """Return the LLVM name of a value; inputs are loaded at their first use, which saves registers."""
        if name in self.waiting:
            number = self.waiting.pop(name)
            address = self.put(f"getelementptr double, ptr %in{number}, i64 %i")
            self.loaded[name] = self.put(f"load {self.vector}, ptr {address}, align 8")
        return self.loaded.get(name, name)

    def call(
        self, function: ca.Function, arguments: Sequence[Sequence[str]], reciprocals: bool = False
    ) -> list[list[str]]:
        """Write the instructions of a function; return the LLVM names of its results.

        `reciprocals`: see `Stage`.
        """
        if not function.is_a("SXFunction"):
            raise ValueError(f"function '{function.name()}' is not a CasADi function of scalars (SX)")
        memory = _FunctionMemory(radicands=_radicands(function), reciprocals=reciprocals)
        zero = self.constant(0.0)
        results = []
        for output in range(function.n_out()):
            # an entry that no instruction writes is 0
            results.append([zero] * function.numel_out(output))
        for instruction in range(function.n_instructions()):
            op = function.instruction_id(instruction)
            sources = function.instruction_input(instruction)
            targets = function.instruction_output(instruction)
            if op == ca.OP_OUTPUT:
                output, entry = targets
                results[output][entry] = memory.names[sources[0]]
                continue
            target = targets[0]
            if op == ca.OP_INPUT:
                argument, entry = sources
                memory.names[target] = self.value(arguments[argument][entry])
                continue
            if op == ca.OP_CONST:
                number = function.instruction_constant(instruction)
                memory.names[target] = self.constant(number)
                memory.numbers[memory.names[target]] = number
                continue
            operands = [memory.names[source] for source in sources]
            result = self._operation(op, instruction, operands, memory)
            if result is None:
                raise ValueError(f"function '{function.name()}': CasADi's operation {op} cannot be compiled")
            memory.names[target] = result
        return results

    def _operation(self, op: int, instruction: int, operands: Sequence[str], memory: _FunctionMemory) -> str | None:
        """Return the LLVM name of the result of an operation; None if it cannot be compiled."""
        if self.exact and op in _LIBRARY_FUNCTIONS:
            return self.library(_LIBRARY_FUNCTIONS[op], *operands)
        a = operands[0]
        b = operands[-1]  # of an operation with one operand, this operand
        if op in _ARITHMETIC_OPERATIONS:
            return self._arithmetic(op, instruction, a, b, memory)
        if op in (ca.OP_SIN, ca.OP_COS):
            sine, cosine = self._sine_cosine(a, memory)
            if op == ca.OP_SIN:
                return sine
            return cosine
        if op in lowered():
            arguments = [[operand] for operand in operands]
            ((result,),) = self.call(lowered()[op], arguments)
            if op == ca.OP_ATAN2:
                memory.points[result] = (a, b)
            return result
        if op in _INTRINSICS:
            return self.intrinsic(_INTRINSICS[op], *operands)
        if op in _LOGICAL_OPERATIONS:
            return self._logical(op, a, b)
        return None

    def _arithmetic(self, op: int, instruction: int, a: str, b: str, memory: _FunctionMemory) -> str:
        """Return the LLVM name of the result of one of `_ARITHMETIC_OPERATIONS`; of one operand, `b` is `a`."""
        V = self.vector
        if op == ca.OP_DIV:
            return self._quotient(a, b, memory)
        if op == ca.OP_MUL:
            return self._product(a, b, memory.products)
        if op == ca.OP_SQ:
            return self._product(a, a, memory.products)
        if op in (ca.OP_ADD, ca.OP_SUB):
            products = memory.products
            if instruction in memory.radicands:
                products = {}  # nothing is fused: see the docstring of this module
            return self._sum(a, b, products, minus=op == ca.OP_SUB)
        if op == ca.OP_TWICE:
            return self.put(f"fadd {V} {a}, {a}")
        if op == ca.OP_NEG:
            return self.put(f"fneg {V} {a}")
        if op == ca.OP_INV:
            return self.put(f"fdiv {V} {self.constant(1.0)}, {a}")
        return a  # OP_ASSIGN

    def _quotient(self, a: str, b: str, memory: _FunctionMemory) -> str:
        """Return the LLVM name of a / b, where it may be a product with the reciprocal of b."""
        V = self.vector
        number = memory.numbers.get(b, 0.0)
        if not self.exact and _has_safe_reciprocal(number):
            # Multiplication is ten times as fast as division; the rounding error is larger by half a unit.
            return self._product(a, self.constant(1 / number), memory.products)
        if not memory.reciprocals:
            return self.put(f"fdiv {V} {a}, {b}")
        if b not in memory.inverses:
            memory.inverses[b] = self.put(f"fdiv {V} {self.constant(1.0)}, {b}")
        return self._product(a, memory.inverses[b], memory.products)

    def _logical(self, op: int, a: str, b: str) -> str:
        """Return the LLVM name of the result of one of `_LOGICAL_OPERATIONS`; of one operand, `b` is `a`."""
        one = self.constant(1.0)
        zero = self.constant(0.0)
        if op == ca.OP_NOT:
            return self.choose(self.true(a), zero, one)
        if op == ca.OP_IF_ELSE_ZERO:
            return self.choose(self.true(a), b, zero)
        if op in _COMPARISONS:
            condition = self.put(f"fcmp {_COMPARISONS[op]} {self.vector} {a}, {b}")
        else:
            word = "or"
            if op == ca.OP_AND:
                word = "and"
            condition = self.put(f"{word} {self.truths} {self.true(a)}, {self.true(b)}")
        return self.choose(condition, one, zero)

    def _product(self, a: str, b: str, products: dict[str, tuple[str, str]]) -> str:
        """Return the LLVM name of a product, and note its factors; one that only sums take in is not computed."""
        result = self.put(f"fmul {self.vector} {a}, {b}")
        if not self.exact:
            products[result] = (a, b)
        return result

    def _sum(self, a: str, b: str, products: Mapping[str, tuple[str, str]], *, minus: bool) -> str:
        """Return the LLVM name of a + b, or with `minus` of a - b; fused if one of them is a product."""
        V = self.vector
        if a in products and b in products:
            products = {}
        if b in products:
            first, second = products[b]
            if minus:
                first = self.put(f"fneg {V} {first}")
            return self.intrinsic("fma", first, second, a)
        if a in products:
            first, second = products[a]
            if minus:
                b = self.put(f"fneg {V} {b}")
            return self.intrinsic("fma", first, second, b)
        if minus:
            return self.put(f"fsub {V} {a}, {b}")
        return self.put(f"fadd {V} {a}, {b}")

    def _sine_cosine(self, angle: str, memory: _FunctionMemory) -> tuple[str, str]:
        """Return the LLVM names of sine and cosine of an angle, which are computed once."""
        if angle not in memory.sines:
            if angle in memory.points:
                memory.sines[angle] = self._sine_of_point(*memory.points[angle])
            else:
                memory.sines[angle] = self._sine_of_angle(angle)
        return memory.sines[angle]

    def _sine_of_angle(self, x: str) -> tuple[str, str]:
        """Return the LLVM names of sine and cosine of x."""
        self.sines = True
        pair = f"{{{self.vector}, {self.vector}}}"
        both = self.put(f"call {pair} @sines({self.vector} {x})")
        sine = self.put(f"extractvalue {pair} {both}, 0")
        cosine = self.put(f"extractvalue {pair} {both}, 1")
        return sine, cosine

    def _sine_of_point(self, y: str, x: str) -> tuple[str, str]:
        """Return the LLVM names of sine and cosine of atan2(y, x), computed by a square root without an arc tangent."""
        V = self.vector
        zero = self.constant(0.0)
        one = self.constant(1.0)
        x_squared = self.put(f"fmul {V} {x}, {x}")
        y_squared = self.put(f"fmul {V} {y}, {y}")
        square = self.put(f"fadd {V} {x_squared}, {y_squared}")
        length = self.intrinsic("sqrt", square)
        at_origin = self.put(f"fcmp oeq {V} {length}, {zero}")
        inverse = self.put(f"fdiv {V} {one}, {length}")
        cosine = self.put(f"fmul {V} {x}, {inverse}")
        sine = self.put(f"fmul {V} {y}, {inverse}")
        # at the origin, the angle is 0 or pi, by the sign bit of x
        cosine_at_origin = self.intrinsic("copysign", one, x)
        sine = self.choose(at_origin, zero, sine)
        cosine = self.choose(at_origin, cosine_at_origin, cosine)
        return sine, cosine

    def polynomial(self, coefficients: Sequence[float], z: str) -> str:
        """Return the LLVM name of a polynomial of z, by Horner's method."""
        y = self.constant(coefficients[0])
        for coefficient in coefficients[1:]:
            y = self.intrinsic("fma", y, z, self.constant(coefficient))
        return y


def _typed(type_name: str, arguments: Sequence[str]) -> str:
    """Return the arguments of a call, each after its LLVM type."""
    return ", ".join(f"{type_name} {argument}" for argument in arguments)


def _numbered(prefix: str, count: int) -> list[str]:
    """Return `count` LLVM names: the prefix, then a number from 0."""
    return [f"{prefix}{number}" for number in range(count)]


def _radicands(function: ca.Function) -> set[int]:
    """Return the instructions that add or subtract terms of what a square root is taken of."""
    instructions: set[int] = set()
    rooted: set[int] = set()  # places of the work vector whose next reader is a root, seen from the end
    for instruction in reversed(range(function.n_instructions())):
        op = function.instruction_id(instruction)
        if op == ca.OP_OUTPUT:
            continue
        target = function.instruction_output(instruction)[0]
        holds_term = target in rooted and op in _TERM_OPERATIONS
        rooted.discard(target)
        if holds_term:
            instructions.add(instruction)
        if holds_term or op == ca.OP_SQRT:
            rooted.update(function.instruction_input(instruction))
    return instructions


def _sine_function(width: int) -> _LaneWriter:
    """Write the LLVM function for sine and cosine of %x: exact reduction by multiples of pi/2, then polynomials."""
    w = _LaneWriter(width)
    V = w.vector
    integers = w.integers
    pair = f"{{{V}, {V}}}"
    # the number of the quadrant, and r = x - quadrant * pi/2 within +-pi/4
    shifted = w.intrinsic("fma", "%x", w.constant(2 / 3.141592653589793), w.constant(_ROUNDING_SHIFT))
    quadrant = w.put(f"fsub {V} {shifted}, {w.constant(_ROUNDING_SHIFT)}")
    minus_quadrant = w.put(f"fneg {V} {quadrant}")
    size = w.intrinsic("fabs", "%x")
    precise = w.put(f"fcmp olt {V} {size}, {w.constant(_LARGEST_ANGLE)}")
    r = w.choose(precise, "%x", w.constant(float("nan")))
    for part in _HALF_PI_PARTS:
        r = w.intrinsic("fma", minus_quadrant, w.constant(part), r)
    # sin r = r + r³ P(r²), cos r = 1 - r²/2 + r⁴ Q(r²)
    z = w.put(f"fmul {V} {r}, {r}")
    P = w.polynomial(_SINE_COEFFICIENTS, z)
    r_cubed = w.put(f"fmul {V} {z}, {r}")
    sine = w.intrinsic("fma", P, r_cubed, r)
    parabola = w.intrinsic("fma", z, w.constant(-0.5), w.constant(1.0))
    Q = w.polynomial(_COSINE_COEFFICIENTS, z)
    z_squared = w.put(f"fmul {V} {z}, {z}")
    cosine = w.intrinsic("fma", Q, z_squared, parabola)
    # in odd quadrants, sine and cosine of x are cosine and sine of r
    bits = w.put(f"bitcast {V} {shifted} to {integers}")
    last_bit = w.put(f"and {integers} {bits}, {w.integer(1)}")
    odd = w.put(f"icmp ne {integers} {last_bit}, {w.integer(0)}")
    values = (w.choose(odd, cosine, sine), w.choose(odd, sine, cosine))
    pair_value = "undef"
    for component, value in enumerate(values):
        # The sign is bit 1 of the quadrant number (sine), or of the number of the next quadrant (cosine).
        number = w.put(f"add {integers} {bits}, {w.integer(component)}")
        shifted_number = w.put(f"shl {integers} {number}, {w.integer(62)}")
        sign = w.put(f"and {integers} {shifted_number}, {w.integer(-(2**63))}")
        value_bits = w.put(f"bitcast {V} {value} to {integers}")
        signed_bits = w.put(f"xor {integers} {value_bits}, {sign}")
        signed = w.put(f"bitcast {integers} {signed_bits} to {V}")
        pair_value = w.put(f"insertvalue {pair} {pair_value}, {V} {signed}, {component}")
    w.line(f"ret {pair} {pair_value}")
    w.lines = [f"define internal {pair} @sines({V} %x) alwaysinline nounwind {{", *w.lines, "}"]
    return w


def emit(
    stages: Sequence[Stage],
    inputs: Mapping[str, int],
    outputs: Sequence[str],
    width: int,
    carried: Mapping[str, int],
    backwards: bool = False,
    exact: bool = False,
) -> tuple[str, dict[str, int]]:
    """Return the LLVM assembly of `void kernel(i64 begin, i64 end, double **in, double **out, double *carry)`.

    Args:
        stages: functions, called in this order for each sample.
        inputs: {name of the input: count of numbers per sample}; each number has a separate array.
        outputs: names of the stored results.
        width: number of samples in a vector; `end - begin` must be a multiple of `width`.
        carried: {name of a carried argument: count of numbers}. A carried argument is a result of the previous sample.
            `carry` contains the initial values of these arguments and, after the call, the final values.
        backwards: whether the loop runs from the last sample to the first sample.
        exact: whether the results equal those of CasADi bit for bit; requires a width of 1.

    Returns:
        (text, {name of the output: count of numbers per sample}).

    Raises:
        ValueError: an operation is not supported, or a function is not an SX function.
    """
    w = _LaneWriter(width, exact)
    head: list[str] = []
    value_names: dict[str, list[str]] = {}  # {argument or result: LLVM names of its numbers}
    carried_names = []
    for name, count in carried.items():
        value_names[name] = _numbered(f"%c.{name}.", count)
        carried_names += value_names[name]
    number = 0
    for name, count in inputs.items():
        value_names[name] = _numbered(f"%in.{name}.", count)
        for value in value_names[name]:
            head += _pointer("in", number)
            w.waiting[value] = number
            number += 1
    block = "loop"
    for i, stage in enumerate(stages):
        if stage.repeat == 1:
            arguments = list(map(value_names.__getitem__, stage.takes))
            values = w.call(stage.function, arguments, stage.reciprocals)
            value_names |= zip(stage.gives, values, strict=True)
        else:
            block = _repeated(w, i, stage, value_names, block)
    counts = {}
    results = []
    for name in outputs:
        counts[name] = len(value_names[name])
        results += value_names[name]
    if width > 1:
        read = []
        for input_number in range(number):
            if input_number not in w.waiting.values():  # inputs that no stage uses are not loaded
                read.append(f"%in{input_number}")
        _prefetch(w, read, _numbered("%out", len(results)))
    _store(w, results, head)
    first = "%begin"
    step = width
    loop_condition = "slt i64 %next, %end"
    if backwards:
        first = "%last"
        step = -width
        loop_condition = "sge i64 %next, %begin"
    head.append(f"  %last = sub i64 %end, {width}")
    final_values = []
    for name in carried:
        final_values += value_names[name]
    carried_phis, tail = _carried_lines(w, carried_names, final_values, head)
    body = [f"  %i = phi i64 [ {first}, %entry ], [ %next, %latch ]", *carried_phis, *w.lines]
    latch = [f"  %next = add i64 %i, {step}", f"  %more = icmp {loop_condition}"]
    return _module(w, head, body, latch, tail), counts


def _carried_lines(
    w: _LaneWriter, carried_names: Sequence[str], final_values: Sequence[str], head: list[str]
) -> tuple[list[str], list[str]]:
    """Return the lines that take carried values from the sample before, and those that store the last ones.

    Args:
        w: the writer.
        carried_names: LLVM names of the carried numbers.
        final_values: LLVM names of their values after a sample.
        head: lines before the loop, which get those that load the initial values.
    """
    V = w.vector
    phis = []
    stores = []
    for number, (name, final_value) in enumerate(zip(carried_names, final_values, strict=True)):
        value = w.value(final_value)
        head.append(f"  %cp{number} = getelementptr double, ptr %carry, i64 {number}")
        head.append(f"  %c{number} = load {V}, ptr %cp{number}, align 8")
        phis.append(f"  {name} = phi {V} [ %c{number}, %entry ], [ {value}, %latch ]")
        stores.append(f"  store {V} {value}, ptr %cp{number}, align 8")
    return phis, stores


def _module(w: _LaneWriter, head: list[str], body: list[str], latch: list[str], tail: list[str]) -> str:
    """Return the text of a kernel from the lines of its blocks, with the functions that it calls."""
    declared = w.declared
    sines = []
    if w.sines:
        sine_writer = _sine_function(w.width)
        sines = sine_writer.lines
        declared = declared | sine_writer.declared
    text = [
        *sorted(declared),
        *sines,
        "define void @kernel(i64 %begin, i64 %end, ptr noalias %in, ptr noalias %out, ptr noalias %carry) nounwind {",
        "entry:",
        *head,
        "  br label %loop",
        "loop:",
        *body,
        "  br label %latch",
        "latch:",
        *latch,
        "  br i1 %more, label %loop, label %exit",
        "exit:",
        *tail,
        "  ret void",
        "}",
    ]
    return "\n".join(text)


def _store(w: _LaneWriter, names: Sequence[str], head: list[str]) -> None:
    """Write the instructions that store results into the output arrays, whose addresses `head` loads."""
    for number, name in enumerate(names):
        value = w.value(name)
        head += _pointer("out", number)
        address = w.put(f"getelementptr double, ptr %out{number}, i64 %i")
        w.line(f"store {w.vector} {value}, ptr {address}, align 8")


def _has_safe_reciprocal(x: float) -> bool:
    """Return whether multiplication by 1 / x equals division by x, except for rounding."""
    return _SMALLEST_DIVISOR < abs(x) < _LARGEST_DIVISOR


def _prefetch(w: _LaneWriter, inputs: Sequence[str], outputs: Sequence[str]) -> None:
    """Write instructions that prefetch the next samples: processors prefetch only a few arrays automatically."""
    w.declared.add("declare void @llvm.prefetch.p0(ptr, i32, i32, i32)")
    ahead = w.put(f"add i64 %i, {_PREFETCH_DISTANCE * w.width}")
    for writing, arrays in enumerate((inputs, outputs)):
        for array in arrays:
            address = w.put(f"getelementptr double, ptr {array}, i64 {ahead}")
            w.line(f"call void @llvm.prefetch.p0(ptr {address}, i32 {writing}, i32 3, i32 1)")


def _pointer(kind: str, number: int) -> list[str]:
    """Return the lines that load the address of an array; `kind` is "in" or "out"."""
    return [
        f"  %{kind}p{number} = getelementptr ptr, ptr %{kind}, i64 {number}",
        f"  %{kind}{number} = load ptr, ptr %{kind}p{number}, align 8",
    ]


def _repeated(w: _LaneWriter, number: int, stage: Stage, value_names: dict[str, list[str]], before: str) -> str:
    """Write a stage that is repeated until its error is small; return the label of the next block."""
    block = f"repeat{number}"
    after = f"after{number}"
    # loaded before the loop, not in each call
    for name in stage.takes:
        value_names[name] = list(map(w.value, value_names[name]))
    w.line(f"br label %{block}")
    w.lines.append(f"{block}:")
    place_of_phis = len(w.lines)
    arguments = dict(value_names)
    fed_back = [name for name in stage.gives if name in stage.takes]
    for name in fed_back:
        arguments[name] = _numbered(f"%f{number}.{name}.", len(value_names[name]))
    values = w.call(stage.function, list(map(arguments.__getitem__, stage.takes)), stage.reciprocals)
    results = dict(zip(stage.gives, values, strict=True))
    # false for NaN: a sample without solution does not delay the others
    above = w.put(f"fcmp ogt {w.vector} {results['error'][0]}, {w.constant(stage.tolerance)}")
    # %k counts the calls
    phis = [f"  %k{number} = phi i64 [ 1, %{before} ], [ %kn{number}, %{block} ]"]
    if w.width > 1:
        above = _keep_finished(w, number, results, arguments, fed_back, above, phis, (before, block))
    for name in fed_back:
        for argument, first, next_value in zip(arguments[name], value_names[name], results[name], strict=True):
            phis.append(f"  {argument} = phi {w.vector} [ {first}, %{before} ], [ {next_value}, %{block} ]")
    w.lines[place_of_phis:place_of_phis] = phis
    w.line(f"%kn{number} = add i64 %k{number}, 1")
    calls_left = w.put(f"icmp slt i64 %k{number}, {stage.repeat}")
    is_repeated = w.put(f"and i1 {above}, {calls_left}")
    w.line(f"br i1 {is_repeated}, label %{block}, label %{after}")
    w.lines.append(f"{after}:")
    value_names |= results
    return after


def _keep_finished(
    w: _LaneWriter,
    number: int,
    results: dict[str, list[str]],
    arguments: Mapping[str, Sequence[str]],
    fed_back: Sequence[str],
    above: str,
    phis: list[str],
    blocks: tuple[str, str],
) -> str:
    """Write what keeps the results of finished lanes while others are called again; return whether any lane goes on.

    Without it, a sample's result would depend on its neighbours in the vector, and not be that of one lane alone.

    Args:
        w: the writer.
        number: number of the stage.
        results: results of a call; they are replaced by those of the last call in which a lane was not finished.
        arguments: arguments of the call, with the values of the call before for the names `fed_back`.
        fed_back: names of results that are arguments of the next call.
        above: whether the error of each lane is above the tolerance.
        phis: lines at the begin of the loop, which are extended.
        blocks: labels of the block before the loop, and of the loop.
    """
    before, block = blocks
    unfinished = f"%unfinished{number}"
    for k, (name, values) in enumerate(results.items()):
        if name in fed_back:
            last_values = arguments[name]
        else:
            last_values = _numbered(f"%last{number}.{k}.", len(values))
        lane_results = []
        for value, last in zip(values, last_values, strict=True):
            lane_results.append(w.choose(unfinished, value, last))
        if name not in fed_back:
            for value, last in zip(lane_results, last_values, strict=True):
                phis.append(f"  {last} = phi {w.vector} [ {w.constant(0.0)}, %{before} ], [ {value}, %{block} ]")
        results[name] = lane_results
    goes_on = w.put(f"and {w.truths} {unfinished}, {above}")
    phis.append(f"  {unfinished} = phi {w.truths} [ splat (i1 true), %{before} ], [ {goes_on}, %{block} ]")
    any_lane = f"i1 @llvm.vector.reduce.or.v{w.width}i1"
    w.declared.add(f"declare {any_lane}({w.truths})")
    return w.put(f"call {any_lane}({w.truths} {goes_on})")
