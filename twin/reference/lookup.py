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

from twin.core.machine import Call, compiled
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

    def difference(self, a: list[ir.Value], b: list[ir.Value]) -> list[ir.Value]:
        return [self.b.fsub(x, y) for x, y in zip(a, b, strict=True)]

    def matrix(self, pointer: ir.Value) -> list[list[ir.Value]]:
        """Return the first three rows of the pose (4, 4) at `pointer`."""
        numbers = self.numbers(pointer, 12)
        return [numbers[:4], numbers[4:8], numbers[8:]]

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


def _column(rows: list[list[ir.Value]], c: int) -> list[ir.Value]:
    return [row[c] for row in rows]


def _number(value: float) -> ir.Constant:
    return ir.Constant(_DOUBLE, value)


def _text() -> str:
    """Return the kernel as LLVM assembly."""
    module = ir.Module("lookup")
    kind = ir.FunctionType(ir.VoidType(), [_INT, _INT, _POINTER, _POINTER, _POINTER])
    function = ir.Function(module, kind, "kernel")
    begin, end, given, results, _ = function.args
    entry = function.append_basic_block("entry")
    item = function.append_basic_block("item")
    body = function.append_basic_block("body")
    ball = function.append_basic_block("ball")
    opened = function.append_basic_block("opened")
    skipped = function.append_basic_block("skipped")
    leaf = function.append_basic_block("leaf")
    inner = function.append_basic_block("inner")
    stored = function.append_basic_block("stored")
    done = function.append_basic_block("done")
    w = _Writer(ir.IRBuilder(entry), module)
    b = w.b
    names = ("poses", "states", "pairs", "enough", "reject", "fine", "table", "grids", "values", "balls")
    data = {name: w.at(given, i, _POINTER) for i, name in enumerate(names)}
    lows = w.at(results, 0, _POINTER)
    highs = w.at(results, 1, _POINTER)
    b.branch(item)

    b.position_at_end(item)
    i = b.phi(_INT)
    i.add_incoming(begin, entry)
    b.cbranch(b.icmp_signed("<", i, end), body, done)

    b.position_at_end(body)
    row = w.shifted(data["table"], w.at(data["pairs"], i, _INT), PAIR, _INT)
    count, with_grid, with_balls, grid, first, last = w.numbers(row, PAIR, _INT)
    state = b.mul(w.at(data["states"], i, _INT), count)
    T_base_grid = w.shifted(data["poses"], b.add(state, with_grid), 16)
    T_base_balls = w.shifted(data["poses"], b.add(state, with_balls), 16)
    G = w.matrix(T_base_grid)
    B = w.matrix(T_base_balls)
    # T_grid_balls: rotation R, translation t
    off = w.difference(_column(B, 3), _column(G, 3))
    R = []
    for r in range(3):
        axis = _column(G, r)
        R.append([w.dot(axis, _column(B, c)) for c in range(3)])
    t = [w.dot(_column(G, r), off) for r in range(3)]
    record = w.shifted(data["grids"], grid, GRID)
    numbers = w.numbers(record, GRID)
    start = numbers[:3]
    cell = numbers[3]
    cells_per_length = numbers[4]
    ends = numbers[5:8]
    strides = [b.fptosi(x, _INT) for x in numbers[8:10]]
    values = w.shifted(data["values"], b.fptosi(numbers[10], _INT), 1, _FLOAT)
    box_low = numbers[11:14]
    box_high = numbers[14:17]
    error, known, far = numbers[17:20]
    enough = w.at(data["enough"], i)
    reject = w.at(data["reject"], i)
    small = w.at(data["fine"], i)
    # with `fine`, bounds are coarse anyway: a lower bound close to the upper bound is sufficient
    kept_part = b.select(b.fcmp_ordered(">", small, _number(0.0)), _number(_ROUGH), _number(1.0))
    b.branch(ball)

    b.position_at_end(ball)
    n = b.phi(_INT)
    low = b.phi(_DOUBLE)
    high = b.phi(_DOUBLE)
    n.add_incoming(first, body)
    low.add_incoming(_number(np.inf), body)
    high.add_incoming(_number(np.inf), body)
    # the search ends if the upper bound is below `reject`
    going = b.and_(b.icmp_signed("<", n, last), b.fcmp_ordered(">=", high, reject))
    b.cbranch(going, opened, stored)

    def bound(node: list[ir.Value], p: list[ir.Value]) -> tuple[ir.Value, ir.Value]:
        """Return (stored distance at a node, distance of the point p from the node)."""
        whole = [b.fptosi(x, _INT) for x in node]
        place = b.add(b.add(b.mul(whole[0], strides[0]), b.mul(whole[1], strides[1])), whole[2])
        value = b.fpext(w.at(values, place, _FLOAT), _DOUBLE)
        offsets = [b.fsub(p[k], b.fadd(start[k], b.fmul(node[k], cell))) for k in range(3)]
        return value, w.size(offsets)

    def nodes(rounding: str) -> list[ir.Value]:
        """Return the coordinates of the node nearest to `steps`, in the grid, rounded by an intrinsic of LLVM."""
        rounded = []
        for x, most in zip(steps, ends, strict=True):
            clipped = w.least(w.most(x, _number(0.0)), most)
            rounded.append(w.intrinsic(rounding, clipped))
        return rounded

    b.position_at_end(opened)
    own = w.shifted(data["balls"], n, BALL)
    centre = w.numbers(own, 3)
    radius = w.at(own, 3)
    after = b.fptosi(w.at(own, 4), _INT)
    p = [b.fadd(w.dot(R[r], centre), t[r]) for r in range(3)]
    steps = [b.fmul(b.fsub(p[k], start[k]), cells_per_length) for k in range(3)]
    value, way = bound(nodes("rint"), p)
    zero = _number(0.0)
    outside = []
    for k in range(3):
        below = b.fsub(box_low[k], p[k])
        above = b.fsub(p[k], box_high[k])
        outside.append(w.most(w.most(below, above), zero))
    beyond = w.size(outside)
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
    corners = []
    for x, end_node in zip(nodes("floor"), ends, strict=True):
        # a cell begins at most one node before the last one
        last_start = b.fsub(end_node, _number(1.0))
        corners.append(w.least(x, last_start))
    sharp = proven
    over = high_here
    for shift in product((0.0, 1.0), repeat=3):
        node = [b.fadd(corner, _number(s)) for corner, s in zip(corners, shift, strict=True)]
        value_of_node, distance = bound(node, p)
        sharp = w.most(sharp, b.fsub(value_of_node, distance))
        over = w.least(over, upper(value_of_node, distance))
    low_fine = w.least(low, b.fsub(sharp, radius))
    high_fine = w.least(high, over)
    b.branch(ball)

    b.position_at_end(inner)
    b.branch(ball)

    # the next ball, and the bounds so far, after each of the three ends of `ball`
    n.add_incoming(after, skipped)
    n.add_incoming(after, fine)
    n.add_incoming(next_ball, inner)
    low.add_incoming(low_skipped, skipped)
    low.add_incoming(low_fine, fine)
    low.add_incoming(low, inner)
    high.add_incoming(high, skipped)
    high.add_incoming(high_fine, fine)
    high.add_incoming(high_here, inner)

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
    # the target is that of the machine, chosen by the compiler
    lines = [line for line in str(module).splitlines() if not line.startswith("target ")]
    return "\n".join(lines)


@cache
def _kernel() -> tuple[Call, Any]:
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
    low = np.zeros(len(states))
    high = np.zeros(len(states))
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
    inputs = _addresses(given)
    outputs = _addresses([low, high])
    kernel, _ = _kernel()
    kernel(0, len(states), inputs, outputs, None)
    return low, high


def _addresses(arrays: list[np.ndarray]) -> ctypes.Array[ctypes.c_void_p]:
    """Return the addresses of the memory of arrays, as the kernel takes them."""
    pointers = [array.ctypes.data for array in arrays]
    return (ctypes.c_void_p * len(pointers))(*pointers)
