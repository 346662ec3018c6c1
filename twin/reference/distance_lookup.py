"""The loop of `distance_bounds` as machine code: balls of one surface looked up in the distance grid of the other.

One call handles many items; an item is a pair of shapes in a state. The balls of a shape are in the order of a
depth-first search. Each ball has the index of the first ball after its own smaller balls. The search therefore requires
no stack: it continues with the next ball, or skips the smaller balls of a ball. `_LookupKernel` writes this loop, whose
comments are the names of its blocks; `value` is the stored distance at a node, and `way` its distance from the centre:

    for each item:                                                      # item, body
        low = high = infinity
        n = first ball
        while n <= last ball and high >= reject:                        # ball
            value, way = those of the node nearest to the centre        # opened
            sure = max(value - way, distance of the centre from the box of the other surface)
            if sure - radius >= min(low, enough, share * high):         # skipped
                low = min(low, sure - radius)
                n = first ball after the smaller balls of n
                continue
            high = min(high, value + way + radius + error)              # near
            if n has no smaller balls, or radius <= fine:               # leaf
                sure, high = the best of these bounds at the eight nodes around the centre, too
                low = min(low, sure - radius)
                n = first ball after the smaller balls of n
            else:                                                       # inner
                n = n + 1, the first of the smaller balls of n
        store 0 if high < reject else max(low, 0), and high             # stored

`tests/reference/test_distance_bounds.py` compares the bounds with distances of surfaces.
"""

from __future__ import annotations

import ctypes
from functools import cache
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from llvmlite import ir

from twin.core.machine_code import compiled
from twin.core.spatial import Array

if TYPE_CHECKING:
    from _ctypes import CFuncPtr

BALL = 5
"""Count of numbers that describe a ball: centre (3), radius, index of the first ball after its smaller balls."""

GRID = 20
"""Count of numbers that describe a grid: first node (3), cell, 1/cell, index of the last node (3), strides (2), index
of the first value, box of the surface (6), error, known, far (see `distance_bounds.DistanceGrid`)."""

PAIR = 6
"""Count of numbers that describe a pair: count of all shapes, then five indices: shape with the grid, shape with the
balls, grid, first ball, last ball + 1."""

_SUFFICIENT_SHARE = 0.75
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
        differences = []
        for x, y in zip(a, b, strict=True):
            differences.append(self.b.fsub(x, y))
        return differences

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
        total = self.b.fmul(a[0], b[0])
        for x, y in zip(a[1:], b[1:], strict=True):
            total = self.b.fadd(total, self.b.fmul(x, y))
        return total

    def size(self, v: list[ir.Value]) -> ir.Value:
        return self.intrinsic("sqrt", self.dot(v, v))


def _column(rows: list[list[ir.Value]], c: int) -> list[ir.Value]:
    return [row[c] for row in rows]


def _number(value: float) -> ir.Constant:
    return ir.Constant(_DOUBLE, value)


class _LookupKernel:
    """Writes the kernel of the module's loop; `text` calls the methods that fill its blocks, in order.

    Attributes that a block sets are values of LLVM; later blocks use them. `n`, `low` and `high` are phi nodes: at the
    begin of `ball` they have no value yet from the blocks that return to it, which `_join_balls` adds.
    """

    def __init__(self) -> None:
        self.module = ir.Module("lookup")
        kind = ir.FunctionType(ir.VoidType(), [_INT, _INT, _POINTER, _POINTER, _POINTER])
        self.function = ir.Function(self.module, kind, "kernel")
        self.begin, self.end, arguments, results, _ = self.function.args
        names = ("entry", "item", "body", "ball", "opened", "skipped", "near", "leaf", "inner", "stored", "done")
        self.blocks: dict[str, ir.Block] = {}
        for name in names:
            self.blocks[name] = self.function.append_basic_block(name)
        self.w = _Writer(ir.IRBuilder(self.blocks["entry"]), self.module)
        self.b = self.w.b
        arrays = ("poses", "states", "pairs", "enough", "reject", "fine", "table", "grids", "values", "balls")
        self.data: dict[str, ir.Value] = {}
        for i, name in enumerate(arrays):
            self.data[name] = self.w.at(arguments, i, _POINTER)
        self.lows = self.w.at(results, 0, _POINTER)
        self.highs = self.w.at(results, 1, _POINTER)

    def text(self) -> str:
        """Return the kernel as LLVM assembly."""
        self._begin_item()
        self._read_item()
        self._begin_ball()
        self._bound_ball()
        self._skip_ball()
        self._bound_above()
        self._refine_leaf()
        self._open_inner()
        self._join_balls()
        self._store()
        # the target is that of the machine, chosen by the compiler
        lines = []
        for line in str(self.module).splitlines():
            if not line.startswith("target "):
                lines.append(line)
        return "\n".join(lines)

    def _begin_item(self) -> None:
        """Jump from the entry to the loop over items; end after the last one."""
        b = self.b
        b.branch(self.blocks["item"])
        b.position_at_end(self.blocks["item"])
        self.i = b.phi(_INT)
        self.i.add_incoming(self.begin, self.blocks["entry"])
        b.cbranch(b.icmp_signed("<", self.i, self.end), self.blocks["body"], self.blocks["done"])

    def _read_item(self) -> None:
        """Read the pair of shapes of an item, the pose between them, the grid, and the limits of the search."""
        b = self.b
        w = self.w
        data = self.data
        b.position_at_end(self.blocks["body"])
        row = w.shifted(data["table"], w.at(data["pairs"], self.i, _INT), PAIR, _INT)
        count, with_grid, with_balls, grid, self.first, self.last = w.numbers(row, PAIR, _INT)
        state = b.mul(w.at(data["states"], self.i, _INT), count)
        T_base_grid = w.shifted(data["poses"], b.add(state, with_grid), 16)
        T_base_balls = w.shifted(data["poses"], b.add(state, with_balls), 16)
        G = w.matrix(T_base_grid)
        B = w.matrix(T_base_balls)
        # T_grid_balls: rotation R, translation t
        off = w.difference(_column(B, 3), _column(G, 3))
        self.R = []
        for r in range(3):
            axis = _column(G, r)
            row_of_R = []
            for c in range(3):
                row_of_R.append(w.dot(axis, _column(B, c)))
            self.R.append(row_of_R)
        self.t = []
        for r in range(3):
            self.t.append(w.dot(_column(G, r), off))
        record = w.shifted(data["grids"], grid, GRID)
        numbers = w.numbers(record, GRID)
        self.start = numbers[:3]
        self.cell = numbers[3]
        self.cells_per_length = numbers[4]
        self.ends = numbers[5:8]
        self.strides = [b.fptosi(x, _INT) for x in numbers[8:10]]
        self.values = w.shifted(data["values"], b.fptosi(numbers[10], _INT), 1, _FLOAT)
        self.box_low = numbers[11:14]
        self.box_high = numbers[14:17]
        self.error, self.known, self.far = numbers[17:20]
        self.enough = w.at(data["enough"], self.i)
        self.reject = w.at(data["reject"], self.i)
        self.fine = w.at(data["fine"], self.i)
        # with `fine`, bounds are coarse anyway: a lower bound close to the upper bound is sufficient
        is_coarse = b.fcmp_ordered(">", self.fine, _number(0.0))
        self.sufficient_share = b.select(is_coarse, _number(_SUFFICIENT_SHARE), _number(1.0))
        b.branch(self.blocks["ball"])

    def _begin_ball(self) -> None:
        """Begin the loop over balls with the bounds so far."""
        b = self.b
        body = self.blocks["body"]
        b.position_at_end(self.blocks["ball"])
        self.n = b.phi(_INT)
        self.low = b.phi(_DOUBLE)
        self.high = b.phi(_DOUBLE)
        self.n.add_incoming(self.first, body)
        self.low.add_incoming(_number(np.inf), body)
        self.high.add_incoming(_number(np.inf), body)
        # the search ends if the upper bound is below `reject`
        going = b.and_(b.icmp_signed("<", self.n, self.last), b.fcmp_ordered(">=", self.high, self.reject))
        b.cbranch(going, self.blocks["opened"], self.blocks["stored"])

    def _bound_ball(self) -> None:
        """Bound the distance of one ball from below, by the nearest node of the grid and by the grid's box."""
        b = self.b
        w = self.w
        b.position_at_end(self.blocks["opened"])
        record = w.shifted(self.data["balls"], self.n, BALL)
        centre = w.numbers(record, 3)
        self.radius = w.at(record, 3)
        self.after = b.fptosi(w.at(record, 4), _INT)
        self.p = []
        for r in range(3):
            turned = w.dot(self.R[r], centre)
            self.p.append(b.fadd(turned, self.t[r]))
        # in cells from the first node of the grid
        self.steps = []
        for k in range(3):
            length = b.fsub(self.p[k], self.start[k])
            self.steps.append(b.fmul(length, self.cells_per_length))
        self.value, self.way = self._value_and_way(self._nodes("rint"))
        zero = _number(0.0)
        outside = []
        for k in range(3):
            below = b.fsub(self.box_low[k], self.p[k])
            above = b.fsub(self.p[k], self.box_high[k])
            outside.append(w.most(w.most(below, above), zero))
        beyond = w.size(outside)
        self.sure = w.most(b.fsub(self.value, self.way), beyond)
        self.next_ball = b.add(self.n, ir.Constant(_INT, 1))
        self.low_here = b.fsub(self.sure, self.radius)
        limit = w.least(w.least(self.low, self.enough), b.fmul(self.high, self.sufficient_share))
        b.cbranch(b.fcmp_ordered(">=", self.low_here, limit), self.blocks["skipped"], self.blocks["near"])

    def _skip_ball(self) -> None:
        """Skip the smaller balls of a ball that is far enough away."""
        self.b.position_at_end(self.blocks["skipped"])
        self.low_skipped = self.w.least(self.low, self.low_here)
        self.b.branch(self.blocks["ball"])

    def _bound_above(self) -> None:
        """Lower the upper bound; the bounds of a ball without smaller balls or with a small radius are refined."""
        b = self.b
        b.position_at_end(self.blocks["near"])
        self.high_here = self.w.least(self.high, self._upper(self.value, self.way))
        is_last = b.icmp_signed("==", self.after, self.next_ball)
        is_fine = b.fcmp_ordered("<=", self.radius, self.fine)
        b.cbranch(b.or_(is_last, is_fine), self.blocks["leaf"], self.blocks["inner"])

    def _refine_leaf(self) -> None:
        """Take the best bounds of the eight nodes around the centre of the ball."""
        b = self.b
        w = self.w
        b.position_at_end(self.blocks["leaf"])
        corners = []
        for x, end_node in zip(self._nodes("floor"), self.ends, strict=True):
            # a cell begins at most one node before the last one
            last_start = b.fsub(end_node, _number(1.0))
            corners.append(w.least(x, last_start))
        sure = self.sure
        over = self.high_here
        for shift in product((0.0, 1.0), repeat=3):
            node = []
            for corner, cells in zip(corners, shift, strict=True):
                node.append(b.fadd(corner, _number(cells)))
            value_of_node, way = self._value_and_way(node)
            sure = w.most(sure, b.fsub(value_of_node, way))
            over = w.least(over, self._upper(value_of_node, way))
        self.low_leaf = w.least(self.low, b.fsub(sure, self.radius))
        self.high_leaf = w.least(self.high, over)
        b.branch(self.blocks["ball"])

    def _open_inner(self) -> None:
        """Continue with the smaller balls of a ball."""
        self.b.position_at_end(self.blocks["inner"])
        self.b.branch(self.blocks["ball"])

    def _join_balls(self) -> None:
        """Set the next ball, and the bounds so far, after each of the three ends of `ball`."""
        skipped = self.blocks["skipped"]
        leaf = self.blocks["leaf"]
        inner = self.blocks["inner"]
        self.n.add_incoming(self.after, skipped)
        self.n.add_incoming(self.after, leaf)
        self.n.add_incoming(self.next_ball, inner)
        self.low.add_incoming(self.low_skipped, skipped)
        self.low.add_incoming(self.low_leaf, leaf)
        self.low.add_incoming(self.low, inner)
        self.high.add_incoming(self.high, skipped)
        self.high.add_incoming(self.high_leaf, leaf)
        self.high.add_incoming(self.high_here, inner)

    def _store(self) -> None:
        """Store the bounds of an item, and continue with the next item or end."""
        b = self.b
        zero = _number(0.0)
        b.position_at_end(self.blocks["stored"])
        rejected = b.fcmp_ordered("<", self.high, self.reject)
        stored_low = b.select(rejected, zero, self.w.most(self.low, zero))
        b.store(stored_low, b.gep(self.lows, [self.i], source_etype=_DOUBLE))
        b.store(self.high, b.gep(self.highs, [self.i], source_etype=_DOUBLE))
        following = b.add(self.i, ir.Constant(_INT, 1))
        self.i.add_incoming(following, self.blocks["stored"])
        b.branch(self.blocks["item"])
        b.position_at_end(self.blocks["done"])
        b.ret_void()

    def _value_and_way(self, node: list[ir.Value]) -> tuple[ir.Value, ir.Value]:
        """Return (stored distance at a node, distance of the ball's centre from the node)."""
        b = self.b
        index = [b.fptosi(x, _INT) for x in node]
        row = b.add(b.mul(index[0], self.strides[0]), b.mul(index[1], self.strides[1]))
        place = b.add(row, index[2])
        value = b.fpext(self.w.at(self.values, place, _FLOAT), _DOUBLE)
        offsets = []
        for k in range(3):
            p_node = b.fadd(self.start[k], b.fmul(node[k], self.cell))
            offsets.append(b.fsub(self.p[k], p_node))
        return value, self.w.size(offsets)

    def _nodes(self, rounding: str) -> list[ir.Value]:
        """Return the coordinates of a node at `steps`, moved into the grid and rounded by an intrinsic of LLVM.

        "rint" gives the nearest node, "floor" the first node of the cell around the centre.
        """
        rounded = []
        for x, most in zip(self.steps, self.ends, strict=True):
            clipped = self.w.least(self.w.most(x, _number(0.0)), most)
            rounded.append(self.w.intrinsic(rounding, clipped))
        return rounded

    def _upper(self, value: ir.Value, way: ir.Value) -> ir.Value:
        """Return an upper bound of the distance between the surfaces.

        `value` is stored at a grid node at the distance `way` from the centre of the ball.
        """
        b = self.b
        off = b.select(b.fcmp_ordered("<", value, self.known), self.error, self.far)
        return b.fadd(b.fadd(b.fadd(value, way), self.radius), off)


@cache
def _kernel() -> tuple[CFuncPtr, object]:
    return compiled(_LookupKernel().text())


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
    arguments = [
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
    inputs = _addresses(arguments)
    outputs = _addresses([low, high])
    kernel, _ = _kernel()
    kernel(0, len(states), inputs, outputs, None)
    return low, high


def _addresses(arrays: list[np.ndarray]) -> ctypes.Array[ctypes.c_void_p]:
    """Return the addresses of the memory of arrays, as the kernel takes them."""
    addresses = (ctypes.c_void_p * len(arrays))()
    for i, array in enumerate(arrays):
        addresses[i] = array.ctypes.data
    return addresses
