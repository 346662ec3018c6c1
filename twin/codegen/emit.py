"""Write a kernel as LLVM assembly: a loop over samples that calls CasADi functions (stages) in sequence.

Each instruction of a function becomes a line that operates on a vector of `width` samples (lanes). Mathematical library
functions would process one lane at a time and be ten times slower. Therefore sine and cosine are written inline without
branches, and `lower` replaces the other functions. NaN and infinity follow IEEE 754, so that unreachable poses remain
NaN. A product and a sum may be fused, which avoids a rounding.

An exact kernel has one lane and fuses no operations. It rounds after each operation and calls the functions of the C
library, so that its results equal those of CasADi's interpreter bit for bit.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from twin.codegen.lower import lowered

_ARITHMETIC = {
    ca.OP_ADD: "fadd",
    ca.OP_SUB: "fsub",
    ca.OP_MUL: "fmul",
    ca.OP_DIV: "fdiv",
}
_LIBRARY = {
    **{ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan", ca.OP_ASIN: "asin", ca.OP_ACOS: "acos"},
    **{ca.OP_ATAN: "atan", ca.OP_ATAN2: "atan2", ca.OP_HYPOT: "hypot"},
}
"""Functions of the C library that an exact kernel calls."""

_COMPARED = {ca.OP_LT: "olt", ca.OP_LE: "ole", ca.OP_EQ: "oeq", ca.OP_NE: "une"}
_INTRINSIC = {
    **{ca.OP_SQRT: "sqrt", ca.OP_FABS: "fabs", ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil", ca.OP_COPYSIGN: "copysign"},
    **{ca.OP_FMIN: "minnum", ca.OP_FMAX: "maxnum"},
    **{ca.OP_EXP: "exp", ca.OP_LOG: "log", ca.OP_POW: "pow", ca.OP_CONSTPOW: "pow"},
    **{ca.OP_SINH: "sinh", ca.OP_COSH: "cosh", ca.OP_TANH: "tanh"},
}

_HALF_PI = (1.5707963267948966, 6.123233995736766e-17)
"""pi/2 as a sum of two doubles, for an exact reduction of angles."""

_SINE = (
    *(1.58969099521155010221e-10, -2.50507602534068634195e-08, 2.75573137070700676789e-06),
    *(-1.98412698298579493134e-04, 8.33333333332248946124e-03, -1.66666666666666324348e-01),
)
_COSINE = (
    *(-1.13596475577881948265e-11, 2.08757232129817482790e-09, -2.75573143513906633035e-07),
    *(2.48015872894767294178e-05, -1.38888888888741095749e-03, 4.16666666666666019037e-02),
)
"""Polynomial coefficients of sine and cosine from FreeBSD's msun (k_sin.c, k_cos.c), highest power first."""

_ROUND = 1.5 * 2.0**52
"""Constant c for rounding: the lowest bits of the double x + c contain the integer nearest to x."""

_AHEAD = 4
"""Number of vectors between the vector being computed and the vector that is prefetched from memory."""

_TURNS = 1e9
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


class _Writer:
    """Writer of the lines of an LLVM function that operates on vectors of `width` lanes."""

    def __init__(self, width: int, exact: bool = False) -> None:
        self.width, self.exact = width, exact
        self.contract = "" if exact else "contract "
        self.V, self.B, self.I = (f"<{width} x {t}>" if width > 1 else t for t in ("double", "i1", "i64"))
        self.suffix = f"v{width}f64" if width > 1 else "f64"
        self.lines: list[str] = []
        self.declared: set[str] = set()
        self.sines = False
        self.waiting: dict[str, int] = {}
        self.loaded: dict[str, str] = {}
        self._count = 0

    def constant(self, x: float) -> str:
        bits = f"0x{struct.unpack('<Q', struct.pack('<d', x))[0]:016X}"
        return f"splat (double {bits})" if self.width > 1 else bits

    def integer(self, k: int) -> str:
        return f"splat (i64 {k})" if self.width > 1 else str(k)

    def line(self, text: str) -> None:
        self.lines.append(f"  {text}")

    def put(self, text: str) -> str:
        self._count += 1
        self.line(f"%t{self._count} = {text}")
        return f"%t{self._count}"

    def intrinsic(self, name: str, *arguments: str) -> str:
        self.declared.add(f"declare {self.V} @llvm.{name}.{self.suffix}({', '.join([self.V] * len(arguments))})")
        return self.put(f"call {self.V} @llvm.{name}.{self.suffix}({', '.join(f'{self.V} {a}' for a in arguments)})")

    def library(self, name: str, *arguments: str) -> str:
        self.declared.add(f"declare double @{name}({', '.join(['double'] * len(arguments))}) nounwind memory(none)")
        return self.put(f"call double @{name}({', '.join(f'double {a}' for a in arguments)})")

    def choose(self, condition: str, a: str, b: str) -> str:
        return self.put(f"select {self.B} {condition}, {self.V} {a}, {self.V} {b}")

    def true(self, x: str) -> str:
        return self.put(f"fcmp une {self.V} {x}, {self.constant(0.0)}")

    def value(self, name: str) -> str:
        """Return the LLVM name of a value; inputs are loaded at their first use, which saves registers."""
        if name in self.waiting:
            at = self.put(f"getelementptr double, ptr %in{self.waiting.pop(name)}, i64 %i")
            self.loaded[name] = self.put(f"load {self.V}, ptr {at}, align 8")
        return self.loaded.get(name, name)

    def call(
        self, function: ca.Function, arguments: Sequence[Sequence[str]], reciprocals: bool = False
    ) -> list[list[str]]:
        """Write the instructions of a function; return the LLVM names of its results.

        `reciprocals`: see `Stage`.
        """
        if not function.is_a("SXFunction"):
            raise ValueError(f"function '{function.name()}' is not a CasADi function of scalars (SX)")
        V, one, zero = self.V, self.constant(1.0), self.constant(0.0)
        at: dict[int, str] = {}
        fixed: dict[str, float] = {}
        inverse: dict[str, str] = {}
        out = [[zero] * function.numel_out(i) for i in range(function.n_out())]
        sines: dict[str, tuple[str, str]] = {}
        angles: dict[str, tuple[str, str]] = {}
        for k in range(function.n_instructions()):
            op, i, o = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
            if op == ca.OP_OUTPUT:
                out[o[0]][o[1]] = at[i[0]]
                continue
            if op == ca.OP_INPUT:
                at[o[0]] = self.value(arguments[i[0]][i[1]])
                continue
            if op == ca.OP_CONST:
                number = function.instruction_constant(k)
                at[o[0]] = self.constant(number)
                fixed[at[o[0]]] = number
                continue
            a = [at[j] for j in i]
            if self.exact and op in _LIBRARY:
                done = self.library(_LIBRARY[op], *a)
            elif op == ca.OP_DIV and not self.exact and _invertible(fixed.get(a[1], 0.0)):
                # Multiplication is ten times as fast as division; the rounding error is larger by half a unit.
                done = self.put(f"fmul contract {V} {a[0]}, {self.constant(1 / fixed[a[1]])}")
            elif op == ca.OP_DIV and reciprocals:
                if a[1] not in inverse:
                    inverse[a[1]] = self.put(f"fdiv {V} {one}, {a[1]}")
                done = self.put(f"fmul contract {V} {a[0]}, {inverse[a[1]]}")
            elif op in _ARITHMETIC:
                done = self.put(f"{_ARITHMETIC[op]} {'' if op == ca.OP_DIV else self.contract}{V} {a[0]}, {a[1]}")
            elif op in (ca.OP_SQ, ca.OP_TWICE):
                done = self.put(f"{'fmul' if op == ca.OP_SQ else 'fadd'} {self.contract}{V} {a[0]}, {a[0]}")
            elif op == ca.OP_NEG:
                done = self.put(f"fneg {V} {a[0]}")
            elif op == ca.OP_INV:
                done = self.put(f"fdiv {V} {one}, {a[0]}")
            elif op == ca.OP_ASSIGN:
                done = a[0]
            elif op in (ca.OP_SIN, ca.OP_COS):
                if a[0] not in sines:
                    sines[a[0]] = self._of_point(*angles[a[0]]) if a[0] in angles else self._sine(a[0])
                done = sines[a[0]][0 if op == ca.OP_SIN else 1]
            elif op in lowered():
                done = self.call(lowered()[op], [[x] for x in a])[0][0]
                if op == ca.OP_ATAN2:
                    angles[done] = (a[0], a[1])
            elif op in _INTRINSIC:
                done = self.intrinsic(_INTRINSIC[op], *a)
            elif op in _COMPARED:
                done = self.choose(self.put(f"fcmp {_COMPARED[op]} {V} {a[0]}, {a[1]}"), one, zero)
            elif op == ca.OP_NOT:
                done = self.choose(self.true(a[0]), zero, one)
            elif op == ca.OP_IF_ELSE_ZERO:
                done = self.choose(self.true(a[0]), a[1], zero)
            elif op in (ca.OP_AND, ca.OP_OR):
                word = "and" if op == ca.OP_AND else "or"
                both = self.put(f"{word} {self.B} {self.true(a[0])}, {self.true(a[1])}")
                done = self.choose(both, one, zero)
            else:
                raise ValueError(f"function '{function.name()}': CasADi's operation {op} cannot be compiled")
            at[o[0]] = done
        return out

    def _sine(self, x: str) -> tuple[str, str]:
        self.sines = True
        both = self.put(f"call {{{self.V}, {self.V}}} @sines({self.V} {x})")
        return tuple(self.put(f"extractvalue {{{self.V}, {self.V}}} {both}, {i}") for i in (0, 1))  # pyright: ignore[reportReturnType]

    def _of_point(self, y: str, x: str) -> tuple[str, str]:
        """Return the LLVM names of sine and cosine of atan2(y, x), computed by a square root without an arc tangent."""
        V = self.V
        square = self.put(f"fadd contract {V} {self.put(f'fmul {V} {x}, {x}')}, {self.put(f'fmul {V} {y}, {y}')}")
        length = self.intrinsic("sqrt", square)
        nowhere = self.put(f"fcmp oeq {V} {length}, {self.constant(0.0)}")  # at the origin, the angle is 0 or pi
        inverse = self.put(f"fdiv {V} {self.constant(1.0)}, {length}")
        cosine, sine = (self.put(f"fmul {V} {c}, {inverse}") for c in (x, y))
        end = self.intrinsic("copysign", self.constant(1.0), x)
        return self.choose(nowhere, self.constant(0.0), sine), self.choose(nowhere, end, cosine)

    def polynomial(self, coefficients: Sequence[float], z: str) -> str:
        y = self.constant(coefficients[0])
        for c in coefficients[1:]:
            y = self.intrinsic("fma", y, z, self.constant(c))
        return y


def _sines(width: int) -> _Writer:
    """Write the LLVM function for sine and cosine of %x: exact reduction by multiples of pi/2, then polynomials."""
    w = _Writer(width)
    V, integers, c = w.V, w.I, w.constant
    shifted = w.intrinsic("fma", "%x", c(2 / 3.141592653589793), c(_ROUND))
    minus = w.put(f"fneg {V} {w.put(f'fsub {V} {shifted}, {c(_ROUND)}')}")
    found = w.put(f"fcmp olt {V} {w.intrinsic('fabs', '%x')}, {c(_TURNS)}")
    r = w.choose(found, "%x", c(float("nan")))
    for part in _HALF_PI:
        r = w.intrinsic("fma", minus, c(part), r)
    z = w.put(f"fmul {V} {r}, {r}")
    sine = w.intrinsic("fma", w.polynomial(_SINE, z), w.put(f"fmul {V} {z}, {r}"), r)
    start = w.intrinsic("fma", z, c(-0.5), c(1.0))
    cosine = w.intrinsic("fma", w.polynomial(_COSINE, z), w.put(f"fmul {V} {z}, {z}"), start)
    bits = w.put(f"bitcast {V} {shifted} to {integers}")
    odd = w.put(f"icmp ne {integers} {w.put(f'and {integers} {bits}, {w.integer(1)}')}, {w.integer(0)}")
    both = "undef"
    for i, value in enumerate((w.choose(odd, cosine, sine), w.choose(odd, sine, cosine))):
        # The sign is bit 1 of the quadrant number (sine), or of the number of the next quadrant (cosine).
        turned = w.put(f"shl {integers} {w.put(f'add {integers} {bits}, {w.integer(i)}')}, {w.integer(62)}")
        sign = w.put(f"and {integers} {turned}, {w.integer(-(2**63))}")
        signed = w.put(f"xor {integers} {w.put(f'bitcast {V} {value} to {integers}')}, {sign}")
        value = w.put(f"bitcast {integers} {signed} to {V}")
        both = w.put(f"insertvalue {{{V}, {V}}} {both}, {V} {value}, {i}")
    w.line(f"ret {{{V}, {V}}} {both}")
    w.lines = [f"define internal {{{V}, {V}}} @sines({V} %x) alwaysinline nounwind {{", *w.lines, "}"]
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
    w = _Writer(width, exact)
    V = w.V
    head: list[str] = []
    known: dict[str, list[str]] = {n: [f"%c.{n}.{i}" for i in range(k)] for n, k in carried.items()}
    number = 0
    for name, count in inputs.items():
        known[name] = [f"%in.{name}.{j}" for j in range(count)]
        for value in known[name]:
            head += _pointer("in", number)
            w.waiting[value] = number
            number += 1
    block = "loop"
    for i, stage in enumerate(stages):
        if stage.repeat == 1:
            results = w.call(stage.function, [known[n] for n in stage.takes], stage.reciprocals)
            known |= zip(stage.gives, results, strict=True)
        else:
            block = _repeated(w, i, stage, known, block)
    if width > 1:
        results = [f"%out{k}" for k in range(sum(len(known[n]) for n in outputs))]
        _fetched(w, [f"%in{k}" for k in range(number) if k not in w.waiting.values()], results)
    number = 0
    for name in outputs:
        for value in map(w.value, known[name]):
            head += _pointer("out", number)
            w.line(f"store {V} {value}, ptr {w.put(f'getelementptr double, ptr %out{number}, i64 %i')}, align 8")
            number += 1
    first, step, more = (
        ("%last", -width, "sge i64 %next, %begin") if backwards else ("%begin", width, "slt i64 %next, %end")
    )
    head.append(f"  %last = sub i64 %end, {width}")
    begin, end = [f"  %i = phi i64 [ {first}, %entry ], [ %next, %latch ]"], []
    for k, (name, j) in enumerate((n, j) for n, count in carried.items() for j in range(count)):
        head += [f"  %cp{k} = getelementptr double, ptr %carry, i64 {k}", f"  %c{k} = load {V}, ptr %cp{k}, align 8"]
        begin.append(f"  %c.{name}.{j} = phi {V} [ %c{k}, %entry ], [ {w.value(known[name][j])}, %latch ]")
        end.append(f"  store {V} {w.value(known[name][j])}, ptr %cp{k}, align 8")
    sines = _sines(width) if w.sines else None
    declared = w.declared | (sines.declared if sines else set())
    text = [
        *sorted(declared),
        *(sines.lines if sines else []),
        "define void @kernel(i64 %begin, i64 %end, ptr noalias %in, ptr noalias %out, ptr noalias %carry) nounwind {",
        *("entry:", *head, "  br label %loop"),
        *("loop:", *begin, *w.lines, "  br label %latch"),
        *("latch:", f"  %next = add i64 %i, {step}", f"  %more = icmp {more}"),
        "  br i1 %more, label %loop, label %exit",
        *("exit:", *end, "  ret void", "}"),
    ]
    return "\n".join(text), {n: len(known[n]) for n in outputs}


def _invertible(x: float) -> bool:
    """Return whether multiplication by 1 / x equals division by x, except for rounding."""
    return x != 0 and 1e-300 < abs(x) < 1e300


def _fetched(w: _Writer, inputs: Sequence[str], outputs: Sequence[str]) -> None:
    """Write instructions that prefetch the next samples: processors prefetch only a few arrays automatically."""
    w.declared.add("declare void @llvm.prefetch.p0(ptr, i32, i32, i32)")
    ahead = w.put(f"add i64 %i, {_AHEAD * w.width}")
    for writing, arrays in enumerate((inputs, outputs)):
        for array in arrays:
            at = w.put(f"getelementptr double, ptr {array}, i64 {ahead}")
            w.line(f"call void @llvm.prefetch.p0(ptr {at}, i32 {writing}, i32 3, i32 1)")


def _pointer(kind: str, number: int) -> list[str]:
    at = f"  %{kind}p{number} = getelementptr ptr, ptr %{kind}, i64 {number}"
    return [at, f"  %{kind}{number} = load ptr, ptr %{kind}p{number}, align 8"]


def _repeated(w: _Writer, number: int, stage: Stage, known: dict[str, list[str]], before: str) -> str:
    """Write a stage that is repeated until its error is small; return the label of the next block."""
    here, after = f"repeat{number}", f"after{number}"
    fed = [n for n in stage.gives if n in stage.takes]
    known |= {n: [w.value(v) for v in known[n]] for n in stage.takes}
    w.line(f"br label %{here}")
    w.lines.append(f"{here}:")
    place = len(w.lines)
    inside = known | {n: [f"%f{number}.{n}.{j}" for j in range(len(known[n]))] for n in fed}
    results = w.call(stage.function, [inside[n] for n in stage.takes], stage.reciprocals)
    given = dict(zip(stage.gives, results, strict=True))
    phis = [f"  %k{number} = phi i64 [ 1, %{before} ], [ %kn{number}, %{here} ]"]
    for name in fed:
        for at, first, again in zip(inside[name], known[name], given[name], strict=True):
            phis.append(f"  {at} = phi {w.V} [ {first}, %{before} ], [ {again}, %{here} ]")
    w.lines[place:place] = phis
    above = w.put(f"fcmp ogt {w.V} {given['error'][0]}, {w.constant(stage.tolerance)}")
    if w.width > 1:
        w.declared.add(f"declare i1 @llvm.vector.reduce.or.v{w.width}i1({w.B})")
        above = w.put(f"call i1 @llvm.vector.reduce.or.v{w.width}i1({w.B} {above})")
    w.line(f"%kn{number} = add i64 %k{number}, 1")
    again = w.put(f"icmp slt i64 %k{number}, {stage.repeat}")
    w.line(f"br i1 {w.put(f'and i1 {above}, {again}')}, label %{here}, label %{after}")
    w.lines.append(f"{after}:")
    known |= given
    return after
