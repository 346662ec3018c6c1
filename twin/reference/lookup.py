"""The loop of `bounds` as machine code: balls of one surface looked up in the distance grid of the other.

One call handles many items; an item is a pair of shapes in a state. The balls of a shape are in the order of a
depth-first search. Each ball has the index of the first ball after its own smaller balls. The search therefore requires
no stack: it continues with the next ball, or skips the smaller balls of a ball.
"""

from __future__ import annotations

import ctypes
from functools import cache
from itertools import product
from typing import Any

import numpy as np
from llvmlite import ir

from twin.core.machine import compiled
from twin.core.spatial import Array

BALL = 5
"""Count of numbers that describe a ball: centre (3), radius, index of the first ball after its smaller balls."""

GRID = 20
"""Count of numbers that describe a grid: first node (3), cell, 1/cell, index of the last node (3), strides (2), index
of the first value, box of the surface (6), error, known, far (see `bounds.Grid`)."""

PAIR = 6
"""Count of numbers that describe a pair: count of all shapes, then five indices: shape with the grid, shape with the
balls, grid, first ball, last ball + 1."""

_ROUGH = 0.75
"""In a search, a lower bound is sufficient if it is at least this fraction of the upper bound."""

_DOUBLE = ir.DoubleType()
_FLOAT = ir.FloatType()
_INT = ir.IntType(64)
_POINTER = ir.PointerType()


class _Writer:
    """Writes expressions of doubles; a thin layer over llvmlite's builder."""

    def __init__(self, builder: ir.IRBuilder, module: ir.Module) -> None:
        self.b: Any = builder  # llvmlite does not state what its methods return
        self._module = module

    def intrinsic(self, name: str, *values: ir.Value) -> ir.Value:
        kind = ir.FunctionType(_DOUBLE, [_DOUBLE] * len(values))
        full_name = f"llvm.{name}.f64"
        function = self._module.globals.get(full_name)
        if function is None:
            function = ir.Function(self._module, kind, full_name)
        return self.b.call(function, values)

    def least(self, a: ir.Value, b: ir.Value) -> ir.Value:
        return self.intrinsic("minnum", a, b)

    def most(self, a: ir.Value, b: ir.Value) -> ir.Value:
        return self.intrinsic("maxnum", a, b)

    def at(self, pointer: ir.Value, index: ir.Value | int, kind: ir.Type = _DOUBLE) -> ir.Value:
        if isinstance(index, int):
            index = ir.Constant(_INT, index)
        place = self.b.gep(pointer, [index], source_etype=kind)
        return self.b.load(place, typ=kind)

    def numbers(self, pointer: ir.Value, count: int, kind: ir.Type = _DOUBLE) -> list[ir.Value]:
        return [self.at(pointer, k, kind) for k in range(count)]

    def shifted(self, pointer: ir.Value, index: ir.Value, size: int, kind: ir.Type = _DOUBLE) -> ir.Value:
        offset = self.b.mul(index, ir.Constant(_INT, size))
        return self.b.gep(pointer, [offset], source_etype=kind)

    def dot(self, a: list[ir.Value], b: list[ir.Value]) -> ir.Value:
        out = self.b.fmul(a[0], b[0])
        for x, y in zip(a[1:], b[1:], strict=True):
            out = self.b.fadd(out, self.b.fmul(x, y))
        return out

    def size(self, v: list[ir.Value]) -> ir.Value:
        return self.intrinsic("sqrt", self.dot(v, v))


def _number(value: float) -> ir.Constant:
    return ir.Constant(_DOUBLE, value)


def _text() -> str:
    """Return the kernel as LLVM assembly."""
    module = ir.Module("lookup")
    kind = ir.FunctionType(ir.VoidType(), [_INT, _INT, _POINTER, _POINTER, _POINTER])
    function = ir.Function(module, kind, "kernel")
    begin, end, given, results, _ = function.args
    entry, item, body, ball, opened, skipped, leaf, inner, stored, done = (
        function.append_basic_block(n)
        for n in ("entry", "item", "body", "ball", "opened", "skipped", "leaf", "inner", "stored", "done")
    )
    w = _Writer(ir.IRBuilder(entry), module)
    b = w.b
    names = ("poses", "states", "pairs", "enough", "reject", "fine", "table", "grids", "values", "balls")
    data = {name: w.at(given, i, _POINTER) for i, name in enumerate(names)}
    lows, highs = w.at(results, 0, _POINTER), w.at(results, 1, _POINTER)
    b.branch(item)

    b.position_at_end(item)
    i = b.phi(_INT)
    i.add_incoming(begin, entry)
    b.cbranch(b.icmp_signed("<", i, end), body, done)

    b.position_at_end(body)
    row = w.shifted(data["table"], w.at(data["pairs"], i, _INT), PAIR, _INT)
    count, with_grid, with_balls, grid, first, last = (w.at(row, k, _INT) for k in range(PAIR))
    state = b.mul(w.at(data["states"], i, _INT), count)
    T_g, T_b = (w.shifted(data["poses"], b.add(state, n), 16) for n in (with_grid, with_balls))
    G, B = ([[w.at(T, 4 * r + c) for c in range(4)] for r in range(3)] for T in (T_g, T_b))
    off = [b.fsub(B[r][3], G[r][3]) for r in range(3)]
    R = [[w.dot([G[k][r] for k in range(3)], [B[k][c] for k in range(3)]) for c in range(3)] for r in range(3)]
    t = [w.dot([G[k][r] for k in range(3)], off) for r in range(3)]
    record = w.shifted(data["grids"], grid, GRID)
    numbers = [w.at(record, k) for k in range(GRID)]
    start, cell, per, ends = numbers[:3], numbers[3], numbers[4], numbers[5:8]
    strides, values = [b.fptosi(x, _INT) for x in numbers[8:10]], numbers[10]
    values = w.shifted(data["values"], b.fptosi(values, _INT), 1, _FLOAT)
    box_low, box_high = numbers[11:14], numbers[14:17]
    error, known, far = numbers[17:20]
    # with `fine`, bounds are coarse anyway: a lower bound close to the upper bound is sufficient
    enough, reject, small = (w.at(data[name], i) for name in ("enough", "reject", "fine"))
    kept_part = b.select(b.fcmp_ordered(">", small, _number(0.0)), _number(_ROUGH), _number(1.0))
    b.branch(ball)

    b.position_at_end(ball)
    n, low, high = b.phi(_INT), b.phi(_DOUBLE), b.phi(_DOUBLE)
    for phi, value in ((n, first), (low, _number(np.inf)), (high, _number(np.inf))):
        phi.add_incoming(value, body)
    # the search ends if the upper bound is below `reject`
    going = b.and_(b.icmp_signed("<", n, last), b.fcmp_ordered(">=", high, reject))
    b.cbranch(going, opened, stored)

    def bound(node: list[ir.Value], p: list[ir.Value]) -> tuple[ir.Value, ir.Value]:
        """Return (stored distance at a node, distance of the point p from the node)."""
        whole = [b.fptosi(x, _INT) for x in node]
        place = b.add(b.add(b.mul(whole[0], strides[0]), b.mul(whole[1], strides[1])), whole[2])
        value = b.fpext(w.at(values, place, _FLOAT), _DOUBLE)
        way = w.size([b.fsub(p[k], b.fadd(start[k], b.fmul(node[k], cell))) for k in range(3)])
        return value, way

    def clipped(x: ir.Value, most: ir.Value) -> ir.Value:
        return w.least(w.most(x, _number(0.0)), most)

    b.position_at_end(opened)
    own = w.shifted(data["balls"], n, BALL)
    centre, radius, after = [w.at(own, k) for k in range(3)], w.at(own, 3), b.fptosi(w.at(own, 4), _INT)
    p = [b.fadd(w.dot(R[r], centre), t[r]) for r in range(3)]
    steps = [b.fmul(b.fsub(p[k], start[k]), per) for k in range(3)]
    value, way = bound([w.intrinsic("rint", clipped(x, e)) for x, e in zip(steps, ends, strict=True)], p)
    zero = _number(0.0)
    beyond = w.size([w.most(w.most(b.fsub(box_low[k], p[k]), b.fsub(p[k], box_high[k])), zero) for k in range(3)])
    proven = w.most(b.fsub(value, way), beyond)
    next_ball = b.add(n, ir.Constant(_INT, 1))
    low_here = b.fsub(proven, radius)
    limit = w.least(w.least(low, enough), b.fmul(high, kept_part))
    b.cbranch(b.fcmp_ordered(">=", low_here, limit), skipped, leaf)

    b.position_at_end(skipped)
    low_skipped = w.least(low, low_here)
    b.branch(ball)

    def upper(value: ir.Value, way: ir.Value) -> ir.Value:
        """Return an upper bound of the distance between the surfaces.

        `value` is stored at a grid node at the distance `way` from the centre of the ball.
        """
        off = b.select(b.fcmp_ordered("<", value, known), error, far)
        return b.fadd(b.fadd(b.fadd(value, way), radius), off)

    b.position_at_end(leaf)
    high_here = w.least(high, upper(value, way))
    fine = function.append_basic_block("fine")
    b.cbranch(b.or_(b.icmp_signed("==", after, next_ball), b.fcmp_ordered("<=", radius, small)), fine, inner)

    b.position_at_end(fine)
    floors = [w.intrinsic("floor", clipped(x, e)) for x, e in zip(steps, ends, strict=True)]
    corners = [w.least(x, b.fsub(e, _number(1.0))) for x, e in zip(floors, ends, strict=True)]
    sharp, over = proven, high_here
    for shift in product((0.0, 1.0), repeat=3):
        v, d = bound([b.fadd(c, _number(s)) for c, s in zip(corners, shift, strict=True)], p)
        sharp = w.most(sharp, b.fsub(v, d))
        over = w.least(over, upper(v, d))
    low_fine, high_fine = w.least(low, b.fsub(sharp, radius)), w.least(high, over)
    b.branch(ball)

    b.position_at_end(inner)
    b.branch(ball)

    for phi, ways in (
        (n, ((after, skipped), (after, fine), (next_ball, inner))),
        (low, ((low_skipped, skipped), (low_fine, fine), (low, inner))),
        (high, ((high, skipped), (high_fine, fine), (high_here, inner))),
    ):
        for value, block in ways:
            phi.add_incoming(value, block)

    b.position_at_end(stored)
    rejected = b.fcmp_ordered("<", high, reject)
    kept = b.select(rejected, zero, w.most(low, zero))
    b.store(kept, b.gep(lows, [i], source_etype=_DOUBLE))
    b.store(high, b.gep(highs, [i], source_etype=_DOUBLE))
    following = b.add(i, ir.Constant(_INT, 1))
    i.add_incoming(following, stored)
    b.branch(item)

    b.position_at_end(done)
    b.ret_void()
    return "\n".join(line for line in str(module).splitlines() if not line.startswith("target "))


@cache
def _kernel() -> tuple[ctypes._CFuncPtr, object]:
    return compiled(_text())


def look_up(
    poses: Array,
    states: np.ndarray,
    pairs: np.ndarray,
    enough: Array,
    reject: Array,
    fine: Array,
    *,
    table: np.ndarray,
    grids: Array,
    values: np.ndarray,
    balls: Array,
) -> tuple[Array, Array]:
    """Return lower and upper bounds (n,) in m of the distances of n items, each a pair of shapes in a state.

    Args:
        poses: (k, shapes, 4, 4) T_base_shape.
        states: (n,) row of `poses` of each item.
        pairs: (n,) row of `table` of each item.
        enough: (n,) in m; a larger lower bound is not required.
        reject: (n,) in m; if the upper bound is below this value, the search ends and the lower bound is 0.
        fine: (n,) in m; balls with at most this radius are not replaced by their smaller balls.
        table: (pairs, PAIR) int64.
        grids: (grids, GRID) float64.
        values: float32, the values of all grids.
        balls: (balls, BALL) float64, the balls of all shapes.
    """
    low, high = np.zeros(len(states)), np.zeros(len(states))
    given = [
        np.ascontiguousarray(poses, np.float64),
        np.ascontiguousarray(states, np.int64),
        np.ascontiguousarray(pairs, np.int64),
        np.ascontiguousarray(enough, np.float64),
        np.ascontiguousarray(reject, np.float64),
        np.ascontiguousarray(fine, np.float64),
        table,
        grids,
        values,
        balls,
    ]
    ins, outs = ((ctypes.c_void_p * len(a))(*(x.ctypes.data for x in a)) for a in (given, (low, high)))
    _kernel()[0](0, len(states), ins, outs, None)
    return low, high
